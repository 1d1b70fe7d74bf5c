//! The run itself: phases, slots, interlocks, verdict.

mod ask;

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use super::evidence::{broken, timing};
use super::guard::Guard;
use super::measure::{Columns, entered, measured, not_measured};
use super::{Observer, Prepared, Progress};
use crate::control::Controller;
use crate::plan::{Interlocks, OnFail, Phase, Plan, Preconditions, Role};
use crate::record::{Dut, Outcome, PhaseRecord, PlanIdentity, PromptRecord, TestRecord, Trace};
use crate::rig::{Quality, Rig, RigIdentity, Sample, exceeds};
use crate::valve::Valve;

/// Why a run ended that its flag stopped.
pub const STOPPED: &str = "stopped by a signal";

/// What a run needs beside plan and rig.
#[derive(Debug, Clone, Copy)]
pub struct RunOptions<'a> {
    /// The valve model that the controller believes in.
    pub model: &'a Valve,
    /// The valve under test.
    pub dut: &'a Dut,
    /// Seed of everything random, for the record.
    pub seed: u64,
    /// Set by a signal or an operator: the run ends as ABORTED at the next sample.
    pub stop: Option<&'a AtomicBool>,
    /// Margins and model, where many runs share them; computed here otherwise.
    pub prepared: Option<&'a Prepared>,
}

/// Why a run ended before its plan did.
struct Ended {
    outcome: Outcome,
    reason: String,
}

/// A phase that ran, wholly or in part.
struct Ran {
    range: Range<usize>,
    repetitions: Vec<Range<usize>>,
}

/// Runs `plan` on `rig`. Whatever happens, the rig is made safe and every planned phase is in the record.
pub fn run(plan: &Plan, rig: &mut dyn Rig, options: &RunOptions<'_>, observer: &mut dyn Observer) -> (TestRecord, Trace) {
    let identity = rig.identity();
    let simulated = identity.kind == "sim";
    let mut bench = Bench::new(plan, rig, options, simulated);
    let mut records: Vec<PhaseRecord> = Vec::with_capacity(plan.phases.len());
    let mut ended: Option<Ended> = None;
    let mut failed: Option<&str> = None;
    let mut ran: Vec<Option<Ran>> = Vec::with_capacity(plan.phases.len());
    for (index, phase) in plan.phases.iter().enumerate() {
        let stopped = failed.filter(|_| phase.role != Role::Teardown).map(|name| format!("phase `{name}` failed"));
        let reason = ended.as_ref().map(|_| "the run had ended".to_string()).or(stopped);
        if let Some(reason) = reason {
            records.push(skipped(phase, &reason));
            ran.push(None);
            continue;
        }
        observer.phase(index, phase);
        if let Some(prompt) = &phase.prompt {
            let mut record = skipped(phase, "");
            match bench.ask(index, phase, prompt, observer.attendant()) {
                Ok(reply) => {
                    entered(&mut record, prompt, &reply);
                    if phase.on_fail == OnFail::Stop && record.outcome == Outcome::Fail {
                        failed = Some(&phase.name);
                    }
                }
                Err(end) => {
                    record.outcome = end.outcome;
                    record.reason = Some(end.reason.clone());
                    ended = Some(end);
                }
            }
            records.push(record);
            ran.push(None);
            continue;
        }
        let (samples, end) = bench.phase(index, phase, observer);
        let mut record = PhaseRecord { span_s: bench.span(&samples.range), ..skipped(phase, "") };
        record.reason = None;
        if let Some(end) = end {
            record.outcome = end.outcome;
            record.reason = Some(end.reason.clone());
            record.measurements = phase.measures.iter().map(|m| not_measured(m, "the phase did not run to its end")).collect();
            ended = Some(end);
        } else if phase.on_fail == OnFail::Stop && !phase.measures.is_empty() {
            // The verdict decides what runs next, so it is needed now and not at the end.
            judge(plan, options, &bench.trace, phase, &samples, &mut record);
            if record.outcome == Outcome::Fail {
                failed = Some(&phase.name);
            }
        }
        records.push(record);
        ran.push(Some(samples));
    }
    let safe = bench.guard.make_safe();
    let Bench { trace, missed_slots, invalid, .. } = bench;
    let columns = Columns::new(plan, options.model, &trace);
    for ((phase, record), samples) in plan.phases.iter().zip(&mut records).zip(&ran) {
        if let (Some(samples), true) = (samples, record.outcome == Outcome::NotRun) {
            judge_with(&columns, options, &trace, phase, samples, record);
        }
    }
    let timing = timing(&trace, plan.period_s, missed_slots, simulated);
    let mut reasons: Vec<String> = ended.iter().map(|e| e.reason.clone()).collect();
    let mut outcome = verdict(&records, ended.as_ref());
    let broken: Vec<String> = broken(&timing, &plan.timing).into_iter().chain(invalid).collect();
    if !broken.is_empty() && outcome < Outcome::Error {
        outcome = Outcome::Invalid;
    }
    reasons.extend(broken);
    if let Some(fault) = &safe.fault {
        outcome = Outcome::Error;
        reasons.push(fault.clone());
    }
    if !safe.confirmed {
        // Before anything else that can be said of this run; neither an abort nor a verdict may stand over it.
        outcome = Outcome::Error;
        reasons.insert(0, format!("SAFE STATE NOT CONFIRMED: {}", safe.evidence));
    }
    let own;
    let prepared = match options.prepared {
        Some(prepared) => prepared,
        None => {
            own = Prepared::new(plan, options.model);
            &own
        }
    };
    let record = TestRecord {
        schema: "hil.record/1".into(),
        plan: PlanIdentity {
            name: plan.name.clone(),
            sha256: plan.sha256.clone(),
            parameters: plan.parameters.clone(),
            overridden: plan.overridden.clone(),
        },
        dut: options.dut.clone(),
        rig: RigIdentity { ..identity },
        simulated,
        seed: options.seed,
        outcome,
        reasons,
        phases: records,
        timing,
        stability: prepared.stability.clone(),
        model: prepared.model.clone(),
        safe_state: (!simulated).then(|| safe.into()),
        provenance: None,
    };
    (record, trace)
}

/// The worst of the phases that were judged; NOT_RUN where none has a limit.
fn verdict(records: &[PhaseRecord], ended: Option<&Ended>) -> Outcome {
    if let Some(ended) = ended {
        return ended.outcome;
    }
    records.iter().map(|r| r.outcome).filter(|o| *o != Outcome::NotRun).max().unwrap_or(Outcome::NotRun)
}

fn skipped(phase: &Phase, reason: &str) -> PhaseRecord {
    PhaseRecord {
        name: phase.name.clone(),
        role: phase.role.name().into(),
        outcome: Outcome::NotRun,
        reason: Some(reason.into()),
        span_s: None,
        measurements: phase.measures.iter().map(|m| not_measured(m, reason)).collect(),
        prompt: phase.prompt.as_ref().map(|p| PromptRecord { text: p.text.clone(), kind: p.kind.name().into(), answer: None, by: None }),
    }
}

fn judge(plan: &Plan, options: &RunOptions<'_>, trace: &Trace, phase: &Phase, samples: &Ran, record: &mut PhaseRecord) {
    judge_with(&Columns::new(plan, options.model, trace), options, trace, phase, samples, record);
}

fn judge_with(columns: &Columns, options: &RunOptions<'_>, trace: &Trace, phase: &Phase, samples: &Ran, record: &mut PhaseRecord) {
    let segment = columns.segment(trace, samples.range.clone(), samples.repetitions.clone(), options.model);
    record.measurements = phase.measures.iter().map(|m| measured(m, &segment)).collect();
    let judged = record.measurements.iter().filter(|m| m.limit.is_some()).map(|m| m.outcome);
    record.outcome = judged.max().unwrap_or(Outcome::NotRun);
}

/// The rig with everything that changes from slot to slot.
struct Bench<'a> {
    plan: &'a Plan,
    options: &'a RunOptions<'a>,
    guard: Guard<'a>,
    controller: Controller,
    trace: Trace,
    /// Slot of the rig's clock that comes next.
    slot: u64,
    samples: usize,
    last: Option<Sample>,
    last_current_a: f64,
    /// Whether the loop was closed in the last slot.
    closed: bool,
    last_good: Option<(f64, f64)>,
    missed_slots: u64,
    simulated: bool,
    invalid: Option<String>,
}

impl<'a> Bench<'a> {
    fn new(plan: &'a Plan, rig: &'a mut dyn Rig, options: &'a RunOptions<'a>, simulated: bool) -> Self {
        // A valve at rest has its smallest current.
        let rest_a = options.model.current_limits_a.0;
        let samples = plan.samples();
        let column = || Vec::with_capacity(samples);
        let trace = Trace {
            time_s: column(),
            phase: Vec::with_capacity(samples),
            target_bar: column(),
            current_a: column(),
            feed_forward_a: column(),
            feedback_a: column(),
            pressure_bar: column(),
            current_meas_a: column(),
            oil_temp_c: column(),
            supply_bar: column(),
            quality: Vec::with_capacity(samples),
            lateness_s: column(),
            round_trip_s: column(),
        };
        Self {
            plan,
            options,
            guard: Guard::new(rig),
            controller: Controller::new(plan.controller, options.model, rest_a),
            trace,
            slot: 0,
            samples,
            last: None,
            last_current_a: rest_a,
            closed: false,
            last_good: None,
            missed_slots: 0,
            simulated,
            invalid: None,
        }
    }

    fn span(&self, range: &Range<usize>) -> Option<(f64, f64)> {
        Some((*self.trace.time_s.get(range.start)?, *self.trace.time_s.get(range.end.checked_sub(1)?)?))
    }

    fn phase(&mut self, index: usize, phase: &Phase, observer: &mut dyn Observer) -> (Ran, Option<Ended>) {
        let start = self.trace.time_s.len();
        self.controller.change(phase.controller, self.options.model);
        if phase.closed_loop() && !self.closed {
            self.controller.engage(self.last_current_a);
        }
        self.closed = phase.closed_loop();
        let mut repetitions = Vec::with_capacity(phase.repeat as usize);
        let mut end = None;
        'phase: for _ in 0..phase.repeat {
            let first = self.trace.time_s.len();
            let slots = phase.samples_per_repetition(self.plan.period_s) as u64;
            let start_slot = self.slot;
            while self.slot - start_slot < slots {
                let t = (self.slot - start_slot) as f64 * self.plan.period_s;
                if let Err(ended) = self.slot(index, phase, phase.waveform.at(t), observer) {
                    end = Some(ended);
                    break 'phase;
                }
            }
            repetitions.push(first..self.trace.time_s.len());
        }
        (Ran { range: start..self.trace.time_s.len(), repetitions }, end)
    }

    fn slot(&mut self, index: usize, phase: &Phase, level: f64, observer: &mut dyn Observer) -> Result<(), Ended> {
        if self.options.stop.is_some_and(|stop| stop.load(Ordering::Relaxed)) {
            return Err(Ended { outcome: Outcome::Aborted, reason: STOPPED.into() });
        }
        let (target_bar, current_a, parts) = if phase.closed_loop() {
            let measured = self.last.filter(|s| s.quality == Quality::Good).map(|s| s.pressure_bar);
            let command = self.controller.step(level, measured);
            (level, command.current_a, (command.feed_forward_a, command.feedback_a))
        } else {
            self.controller.follow(level);
            (f64::NAN, level, (f64::NAN, f64::NAN))
        };
        let until_s = (self.slot + 1) as f64 * self.plan.period_s;
        let sample = self.guard.step(current_a, until_s).map_err(|error| Ended { outcome: Outcome::Error, reason: error.to_string() })?;
        let trace = &mut self.trace;
        trace.time_s.push(sample.time_s);
        trace.phase.push(index as u16);
        trace.target_bar.push(target_bar);
        trace.current_a.push(current_a);
        trace.feed_forward_a.push(parts.0);
        trace.feedback_a.push(parts.1);
        trace.pressure_bar.push(sample.pressure_bar);
        trace.current_meas_a.push(sample.current_a.unwrap_or(f64::NAN));
        trace.oil_temp_c.push(sample.oil_temp_c.unwrap_or(f64::NAN));
        trace.supply_bar.push(sample.supply_bar.unwrap_or(f64::NAN));
        trace.quality.push(sample.quality);
        trace.lateness_s.push(sample.lateness_s);
        trace.round_trip_s.push(sample.round_trip_s);
        let progress =
            Progress { sample: trace.time_s.len(), samples: self.samples, phase: &phase.name, target_bar, current_a, measured: &sample };
        observer.sample(&progress);
        self.slot += 1 + u64::from(sample.missed_slots);
        self.missed_slots += u64::from(sample.missed_slots);
        self.last_current_a = current_a;
        self.interlock(&sample, self.plan.interlocks)?;
        self.precondition(&sample, self.plan.preconditions);
        self.last = Some(sample);
        Ok(())
    }

    /// Ends the run where a value is beyond its interlock.
    fn interlock(&mut self, sample: &Sample, limits: Interlocks) -> Result<(), Ended> {
        let trip = |what: &str, value: f64, most: f64, unit: &str| {
            let reason = format!("interlock: {what} {value:.3} {unit} at {:.3} s, at most {most:.3} {unit}", sample.time_s);
            Err(Ended { outcome: Outcome::Error, reason })
        };
        if let (Some(current), Some(most)) = (sample.current_a, limits.max_current_a)
            && exceeds(current.abs(), most)
        {
            return trip("measured current", current, most, "A");
        }
        if sample.quality != Quality::Good {
            let since = self.last_good.map_or(0.0, |good| good.0);
            let silent = sample.time_s - since;
            return if silent > limits.silence_s + 1e-9 { trip("silence of", silent, limits.silence_s, "s") } else { Ok(()) };
        }
        let before = self.last_good.replace((sample.time_s, sample.pressure_bar));
        if let Some(most) = limits.max_pressure_bar
            && exceeds(sample.pressure_bar, most)
        {
            return trip("pressure", sample.pressure_bar, most, "bar");
        }
        if let (Some(most), Some((time, pressure))) = (limits.max_pressure_rate_bar_per_s, before) {
            let rate = ((sample.pressure_bar - pressure) / (sample.time_s - time)).abs();
            if exceeds(rate, most) {
                return trip("rate of the pressure", rate, most, "bar/s");
            }
        }
        Ok(())
    }

    /// Notes the first time that a precondition does not hold. A simulation has neither oil nor supply.
    fn precondition(&mut self, sample: &Sample, wanted: Preconditions) {
        if self.simulated || self.invalid.is_some() {
            return;
        }
        let windows = [
            ("oil temperature", sample.oil_temp_c, wanted.oil_temp_c, "degC"),
            ("supply pressure", sample.supply_bar, wanted.supply_bar, "bar"),
        ];
        for (what, value, window, unit) in windows {
            let Some((low, high)) = window else { continue };
            self.invalid = match value {
                None => Some(format!("precondition: the rig has no {what}, but the plan wants {low} to {high} {unit}")),
                Some(v) if !(low..=high).contains(&v) => {
                    Some(format!("precondition: {what} {v:.1} {unit} at {:.3} s, wanted {low} to {high} {unit}", sample.time_s))
                }
                Some(_) => continue,
            };
            return;
        }
    }
}
