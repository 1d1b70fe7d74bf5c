//! From the samples of a run to its measurements.

use std::ops::Range;

use super::Reply;
use crate::limits::{Bound, Limit, Verdict};
use crate::metrics::{Segment, Signals};
use crate::physics::simulate;
use crate::plan::{Measure, Plan, Prompt, PromptKind};
use crate::record::{LimitRecord, Measurement, Outcome, PhaseRecord, Trace};
use crate::rig::Quality;
use crate::valve::{Hysteresis, Input, Valve};

/// The columns that metrics look at, beside those of the trace.
pub struct Columns {
    usable_bar: Vec<f64>,
    model_bar: Vec<f64>,
    average_model_bar: Vec<f64>,
}

impl Columns {
    /// Masks unusable pressures, and simulates the model where a metric of the plan needs it.
    pub fn new(plan: &Plan, model: &Valve, trace: &Trace) -> Self {
        let pairs = trace.pressure_bar.iter().zip(&trace.quality);
        let usable_bar = pairs.map(|(p, q)| if *q == Quality::Good { *p } else { f64::NAN }).collect();
        let needed = plan.phases.iter().flat_map(|p| &p.measures).any(|m| m.metric.needs().model);
        let of = |valve: &Valve| if needed { from_rest(valve, plan.period_s, trace) } else { Vec::new() };
        let average = Valve { hysteresis: Hysteresis::None, ..model.clone() };
        Self { usable_bar, model_bar: of(model), average_model_bar: of(&average) }
    }

    /// The segment of a phase.
    pub fn segment<'a>(&'a self, trace: &'a Trace, range: Range<usize>, repetitions: Vec<Range<usize>>, model: &Valve) -> Segment<'a> {
        Segment {
            signals: Signals {
                time_s: &trace.time_s,
                target_bar: &trace.target_bar,
                current_a: &trace.current_a,
                feed_forward_a: &trace.feed_forward_a,
                feedback_a: &trace.feedback_a,
                pressure_bar: &self.usable_bar,
                oil_temp_c: &trace.oil_temp_c,
                supply_bar: &trace.supply_bar,
                model_bar: &self.model_bar,
                average_model_bar: &self.average_model_bar,
            },
            range,
            repetitions,
            delay_s: model.delay_s,
            lag_s: model.lag_s,
        }
    }
}

/// The model's pressure for the commanded current; like the valve it starts at rest, one period before the run.
fn from_rest(valve: &Valve, period_s: f64, trace: &Trace) -> Vec<f64> {
    let Some(first) = trace.time_s.first() else { return Vec::new() };
    let time_s: Vec<f64> = std::iter::once(first - period_s).chain(trace.time_s.iter().copied()).collect();
    let current_a: Vec<f64> = std::iter::once(valve.current_limits_a.0).chain(trace.current_a.iter().copied()).collect();
    // Without a model the metrics that need it say so.
    simulate(valve, Input::Held, &time_s, &current_a).map(|p| p[1..].to_vec()).unwrap_or_default()
}

/// One figure of a phase that ran to its end.
pub fn measured(measure: &Measure, segment: &Segment<'_>) -> Measurement {
    let metric = measure.metric.metric();
    let (value, reason) = match metric.compute(segment) {
        Ok(value) => (Some(value), None),
        Err(why) => (None, Some(why.to_string())),
    };
    let verdict = match &measure.limit {
        None => Outcome::NotRun,
        // The limit judges what was measured, not the digits that are shown.
        Some(limit) => outcome(limit.judge(value)),
    };
    let decimals = metric.unit().decimals;
    let shown = |v: f64| measure.limit.as_ref().map_or_else(|| rounded(v, decimals), |limit| without_sign(limit.shown(v, decimals)));
    Measurement { value: value.map(shown), outcome: verdict, reason, ..blank(measure, metric.definition(segment)) }
}

/// What a person answered, in the record of the phase that asked.
pub fn entered(record: &mut PhaseRecord, prompt: &Prompt, reply: &Reply) {
    let answer = &reply.answer;
    record.reason = None;
    record.outcome = answer.verdict.map_or(Outcome::NotRun, outcome);
    if let (PromptKind::Number { unit, limit, .. }, Some(value)) = (&prompt.kind, answer.value) {
        let shown = limit.as_ref().map_or_else(|| rounded(value, unit.decimals), |l| without_sign(l.shown(value, unit.decimals)));
        record.measurements.push(Measurement {
            metric: "answer".into(),
            value: Some(shown),
            unit: unit.symbol.into(),
            limit: limit.as_ref().map(limit_record),
            outcome: record.outcome,
            definition: "entered.v1".into(),
            reason: None,
        });
    }
    if let Some(asked) = &mut record.prompt {
        asked.answer = Some(answer.text.clone());
        asked.by = Some(reply.by.into());
    }
}

fn outcome(verdict: Verdict) -> Outcome {
    match verdict {
        Verdict::Pass => Outcome::Pass,
        Verdict::Marginal => Outcome::Marginal,
        Verdict::Fail => Outcome::Fail,
    }
}

/// One figure of a phase that did not run, or not to its end.
pub fn not_measured(measure: &Measure, reason: &str) -> Measurement {
    Measurement { reason: Some(reason.into()), ..blank(measure, measure.metric.metric().id().into()) }
}

fn blank(measure: &Measure, definition: String) -> Measurement {
    let metric = measure.metric.metric();
    Measurement {
        metric: metric.id().into(),
        value: None,
        unit: metric.unit().symbol.into(),
        limit: measure.limit.as_ref().map(limit_record),
        outcome: Outcome::NotRun,
        definition,
        reason: None,
    }
}

fn limit_record(limit: &Limit) -> LimitRecord {
    LimitRecord {
        min: limit.min,
        max: limit.max,
        marginal_min: limit.marginal_min,
        marginal_max: limit.marginal_max,
        bound: match limit.bound {
            Bound::Inclusive => "inclusive".into(),
            Bound::Exclusive => "exclusive".into(),
        },
    }
}

fn rounded(value: f64, decimals: usize) -> f64 {
    without_sign(format!("{value:.decimals$}").parse().unwrap_or(value))
}

/// A zero without the sign that rounding left.
fn without_sign(value: f64) -> f64 {
    if value == 0.0 { 0.0 } else { value }
}
