//! From the samples of a run to its measurements.

use std::ops::Range;

use super::Reply;
use crate::course::{Course, Preparation};
use crate::limits::{Bound, Limit, Verdict};
use crate::metrics::{Segment, Signals};
use crate::physics::simulate_course;
use crate::plan::{Measure, Plan, Prompt, PromptKind};
use crate::record::{LimitRecord, Measurement, Outcome, PhaseRecord, Trace};
use crate::recording::{Recording, Run};
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
        let run = trace.run();
        let needed = plan.phases.iter().flat_map(|p| &p.measures).any(|m| m.metric.needs().model);
        let of = |valve: &Valve| if needed { from_rest(valve, plan.period_s, &run) } else { Vec::new() };
        let average = Valve { hysteresis: Hysteresis::None, ..model.clone() };
        Self { model_bar: of(model), average_model_bar: of(&average), usable_bar: run.pressure_bar.unwrap_or_default() }
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

/// The model's pressure at the times of a run for its command, and for its oil and supply where they were measured; like the valve it
/// starts at rest, one period before the run.
fn from_rest(valve: &Valve, period_s: f64, run: &Run) -> Vec<f64> {
    let Some(first) = run.time_s.first() else { return Vec::new() };
    // The clock of a bench may be broken, which makes a run invalid.
    if !run.time_s.is_sorted_by(|a, b| a < b) {
        return Vec::new();
    }
    let before = |value: f64, values: &[f64]| std::iter::once(value).chain(values.iter().copied()).collect::<Vec<f64>>();
    let unknown = |values: &Option<Vec<f64>>| values.as_ref().map(|v| before(f64::NAN, v));
    let run = Run {
        time_s: before(first - period_s, &run.time_s),
        current_a: before(valve.current_limits_a.0, &run.current_a),
        oil_temp_c: unknown(&run.oil_temp_c),
        supply_bar: unknown(&run.supply_bar),
        ..Run::default()
    };
    let time_s = run.time_s.clone();
    let preparation = Preparation { input: Some(Input::Held), ..Preparation::default() };
    let recording = Recording { source: "trace".into(), runs: vec![run], notes: Vec::new(), input: None };
    // Without a model the metrics that need it say so.
    let Ok(course) = Course::take(recording, &preparation) else { return Vec::new() };
    simulate_course(valve, &course).map(|simulated| course.on_recorded(0, &time_s, &simulated)[1..].to_vec()).unwrap_or_default()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::valve::EffectSpec;

    fn model() -> Valve {
        Valve::load(&Valve::find("paper").unwrap()).unwrap()
    }

    fn run(samples: u32) -> Run {
        let time_s: Vec<f64> = (0..samples).map(|k| 0.01 * f64::from(k)).collect();
        Run { current_a: time_s.iter().map(|t| 0.4 + 0.1 * t).collect(), time_s, ..Run::default() }
    }

    #[test]
    fn a_model_that_knows_the_oil_is_driven_by_the_oil_of_the_run() {
        let mut thermal = model();
        let gain = ("gain".to_string(), "0.05".to_string());
        thermal.effects = vec![EffectSpec { id: "thermal_gain".into(), parameters: vec![gain] }];
        let mut run = run(300);
        let without = from_rest(&thermal, 0.01, &run);
        assert_eq!(without, from_rest(&model(), 0.01, &run));
        // 20 K above the temperature at which the curves hold.
        run.oil_temp_c = Some(vec![80.0; 300]);
        let warm = from_rest(&thermal, 0.01, &run);
        assert!((warm[299] / without[299] - 1.1).abs() < 1e-3, "{} {}", warm[299], without[299]);
    }

    #[test]
    fn a_clock_that_goes_back_gives_no_model_and_a_long_gap_a_new_start() {
        let mut broken = run(300);
        broken.time_s[200] = 0.5;
        assert!(from_rest(&model(), 0.01, &broken).is_empty());
        let mut apart = run(300);
        apart.time_s[150..].iter_mut().for_each(|t| *t += 60.0);
        let simulated = from_rest(&model(), 0.01, &apart);
        let behind = Run { time_s: apart.time_s[150..].to_vec(), current_a: apart.current_a[150..].to_vec(), ..Run::default() };
        assert_eq!(simulated.len(), 300);
        let average = model().curves.average_at(behind.current_a[0]);
        assert!((simulated[150] - average).abs() < 1e-9, "{} {average}", simulated[150]);
    }
}
