//! What a plan and a valve model give before anything runs; thousands of runs share it.

use serde_json::Value;

use crate::control::stability::margins;
use crate::control::{LinearLoop, Mode, linear_loop};
use crate::plan::Plan;
use crate::valve::Valve;

/// Margins and model of a record, computed once.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Prepared {
    /// Margins of the loop with the gains of the plan; `None` where the plan never closes it.
    pub stability: Option<Value>,
    /// The valve model that the controller believes in, as the text of its file.
    pub model: Option<Value>,
}

impl Prepared {
    /// Margins of `plan` on `model`. Where phases have gains of their own, those with the largest K_I are judged, and
    /// the others stand beside them.
    pub fn new(plan: &Plan, model: &Valve) -> Self {
        let LinearLoop { plant, delay_range_s, at_current_a, left_out } = linear_loop(model);
        let mut loops: Vec<(String, crate::control::Gains)> = Vec::new();
        for phase in plan.phases.iter().filter(|p| p.closed_loop() && p.controller.mode != Mode::FeedForward) {
            if !loops.iter().any(|(_, gains)| *gains == phase.controller.gains) {
                loops.push((phase.name.clone(), phase.controller.gains));
            }
        }
        loops.sort_by(|a, b| b.1.ki_ma_per_bar_s.total_cmp(&a.1.ki_ma_per_bar_s));
        let judged: Vec<Value> = loops
            .iter()
            .filter_map(|(phase, gains)| {
                // A loop that cannot be judged (a model without slope) has no margins.
                let found = margins(&plant, delay_range_s, *gains, 1.0 / plan.period_s).ok()?;
                let mut value = serde_json::to_value(found).ok()?;
                value["phase"] = Value::from(phase.as_str());
                value["loop"]["at_current_a"] = Value::from((at_current_a * 1e4).round() / 1e4);
                if !left_out.is_empty() {
                    value["loop"]["left_out"] = Value::from(left_out.clone());
                }
                Some(value)
            })
            .collect();
        let mut judged = judged.into_iter();
        let stability = judged.next().map(|mut first| {
            let others: Vec<Value> = judged
                .map(|mut other| {
                    if let Some(fields) = other.as_object_mut() {
                        fields.remove("boundary");
                    }
                    other
                })
                .collect();
            if !others.is_empty() {
                first["others"] = Value::from(others);
            }
            first
        });
        Self { stability, model: Some(Value::from(model.to_toml())) }
    }
}
