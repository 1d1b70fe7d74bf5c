//! The runner against rigs that behave, and rigs that do not.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use super::*;
use crate::plan::Plan;
use crate::record::{Dut, Outcome, TestRecord, Trace};
use crate::rig::simulated::SimulatedRig;
use crate::rig::{Quality, Rig, RigError, RigIdentity, SafeState, Sample};
use crate::valve::Valve;

const PLAN: &str = r#"
schema = "hil.plan/1"
name = "test"
[interlocks]
max_pressure = "35 bar"
silence = "50 ms"
[[setup]]
name = "fill"
stimulus.ramp = { from = "0 bar", to = "10 bar", over = "1 s" }
[[phase]]
name = "hold"
stimulus.hold = { at = "10 bar", for = "1 s" }
measure = [{ metric.rmse = {}, limit = { max = "0.5 bar" } }]
[[phase]]
name = "rise"
repeat = 2
stimulus.sequence = [{ ramp = { from = "10 bar", to = "20 bar", over = "0.5 s" } }, { ramp = { to = "10 bar", over = "0.5 s" } }]
measure = [{ metric.rmse = {}, limit = { max = "0.5 bar" } }, { metric.model_rmse = {} }]
[[teardown]]
name = "release"
stimulus.hold = { at = "0 A", for = "0.2 s" }
"#;

fn plan(text: &str) -> Plan {
    Plan::from_toml(text, "test.toml", Path::new("."), &[]).unwrap()
}

fn valve() -> Valve {
    Valve { noise_bar: 0.02, ..crate::control::test_valve() }
}

fn run_on(plan: &Plan, rig: &mut dyn Rig, stop: Option<&AtomicBool>) -> (TestRecord, Trace) {
    let (model, dut) = (crate::control::test_valve(), Dut { serial: "t".into(), ..Dut::default() });
    run(plan, rig, &RunOptions { model: &model, dut: &dut, seed: 3, stop, prepared: None }, &mut ())
}

fn simulated(seed: u64) -> SimulatedRig {
    SimulatedRig::new(&valve(), 0.01, Some(seed), RigIdentity::default()).unwrap()
}

/// A simulated rig whose samples go through `change`; counts how often it was made safe.
struct Faulty<F> {
    inner: SimulatedRig,
    change: F,
    slots: usize,
    made_safe: usize,
    confirmed: bool,
}

impl<F: FnMut(usize, &mut Sample) -> Result<(), RigError>> Faulty<F> {
    fn new(change: F) -> Self {
        Self { inner: simulated(3), change, slots: 0, made_safe: 0, confirmed: true }
    }
}

impl<F: FnMut(usize, &mut Sample) -> Result<(), RigError>> Rig for Faulty<F> {
    fn identity(&self) -> RigIdentity {
        RigIdentity { kind: "test".into(), ..RigIdentity::default() }
    }
    fn step(&mut self, command_a: f64, until_s: f64) -> Result<Sample, RigError> {
        let mut sample = self.inner.step(command_a, until_s)?;
        (self.change)(self.slots, &mut sample)?;
        self.slots += 1;
        Ok(sample)
    }
    fn make_safe(&mut self) -> Result<SafeState, RigError> {
        self.made_safe += 1;
        Ok(SafeState::of(self.confirmed, "seen by the test"))
    }
}

fn outcomes(record: &TestRecord) -> Vec<(&str, Outcome)> {
    record.phases.iter().map(|p| (p.name.as_str(), p.outcome)).collect()
}

#[test]
fn a_plan_runs_on_a_simulated_valve() {
    let (record, trace) = run_on(&plan(PLAN), &mut simulated(3), None);
    assert_eq!(record.outcome, Outcome::Pass, "{:?}", record.phases);
    assert_eq!(
        outcomes(&record),
        [("fill", Outcome::NotRun), ("hold", Outcome::Pass), ("rise", Outcome::Pass), ("release", Outcome::NotRun)]
    );
    assert_eq!((trace.time_s.len(), record.timing.samples), (100 + 100 + 200 + 20, 420));
    assert_eq!(record.phases[1].span_s, Some((1.0, 1.99)));
    // The model is the plant but for the noise: the trace reproduces it sample by sample.
    let model = record.phases[2].measurements[1].value.unwrap();
    assert!((0.015..0.025).contains(&model), "{model}");
    assert!(record.simulated && record.stability.is_some() && record.safe_state.is_none());
}

#[test]
fn the_same_seed_gives_the_same_run_and_another_another() {
    let of = |seed: u64| run_on(&plan(PLAN), &mut simulated(seed), None);
    let (a, b, c) = (of(3), of(3), of(4));
    assert_eq!(a.0, b.0);
    assert_eq!(a.1.pressure_bar, b.1.pressure_bar);
    assert_ne!(a.1.pressure_bar, c.1.pressure_bar);
}

#[test]
fn a_signal_aborts_at_the_next_sample_and_makes_the_rig_safe() {
    let stop = AtomicBool::new(false);
    let mut rig = Faulty::new(|k, _: &mut Sample| {
        if k == 130 {
            stop.store(true, std::sync::atomic::Ordering::Relaxed);
        }
        Ok(())
    });
    let (record, trace) = run_on(&plan(PLAN), &mut rig, Some(&stop));
    assert_eq!((record.outcome, trace.time_s.len(), rig.made_safe), (Outcome::Aborted, 131, 1));
    assert_eq!(
        outcomes(&record),
        [("fill", Outcome::NotRun), ("hold", Outcome::Aborted), ("rise", Outcome::NotRun), ("release", Outcome::NotRun)]
    );
    assert_eq!(record.phases[1].measurements[0].value, None);
    assert_eq!(record.reasons, ["stopped by a signal"]);
}

#[test]
fn an_interlock_ends_the_run_before_the_next_slot() {
    let mut rig = Faulty::new(|k, s: &mut Sample| {
        if k == 150 {
            s.pressure_bar = 36.0;
        }
        Ok(())
    });
    let (record, trace) = run_on(&plan(PLAN), &mut rig, None);
    assert_eq!((record.outcome, trace.time_s.len(), rig.made_safe), (Outcome::Error, 151, 1));
    insta::assert_snapshot!(record.reasons.join("\n"), @"interlock: pressure 36.000 bar at 1.500 s, at most 35.000 bar");
    assert_eq!(record.safe_state.unwrap().evidence, "seen by the test");
}

#[test]
fn silence_ends_the_run_and_lost_samples_make_it_invalid() {
    let silent = |from: usize, to: usize| {
        move |k: usize, s: &mut Sample| {
            if (from..to).contains(&k) {
                s.quality = Quality::Held;
            }
            Ok(())
        }
    };
    let (record, _) = run_on(&plan(PLAN), &mut Faulty::new(silent(150, 400)), None);
    assert_eq!(record.outcome, Outcome::Error);
    insta::assert_snapshot!(record.reasons.join("\n"), @r"
    interlock: silence of 0.060 s at 1.550 s, at most 0.050 s
    lost samples: 6 of 156 (3.846 %), at most 1.000 % are allowed
    ");
    let (record, _) = run_on(
        &plan(PLAN),
        &mut Faulty::new(|k, s: &mut Sample| {
            if (150..153).contains(&k) || (250..253).contains(&k) {
                s.quality = Quality::Held;
            }
            Ok(())
        }),
        None,
    );
    assert_eq!(record.outcome, Outcome::Invalid);
    insta::assert_snapshot!(record.reasons.join("\n"), @"lost samples: 6 of 420 (1.429 %), at most 1.000 % are allowed");
}

#[test]
fn a_stale_pressure_reaches_neither_the_controller_nor_a_metric() {
    let mut rig = Faulty::new(|k, s: &mut Sample| {
        if k % 50 == 7 {
            s.quality = Quality::Stale;
            s.pressure_bar = 999.0;
        }
        Ok(())
    });
    let tolerant = PLAN.replace("[interlocks]", "timing.max_stale = \"5 %\"\n[interlocks]");
    let (record, _) = run_on(&plan(&tolerant), &mut rig, None);
    assert_eq!((record.outcome, record.timing.stale_samples), (Outcome::Pass, 9));
}

#[test]
fn a_failed_phase_stops_the_main_phases_but_not_the_teardown() {
    let strict = PLAN.replacen("max = \"0.5 bar\"", "max = \"0.001 bar\"", 1);
    let (record, _) = run_on(&plan(&strict.replace("[interlocks]", "on_fail = \"stop\"\n[interlocks]")), &mut simulated(3), None);
    assert_eq!(record.outcome, Outcome::Fail);
    assert_eq!(
        outcomes(&record),
        [("fill", Outcome::NotRun), ("hold", Outcome::Fail), ("rise", Outcome::NotRun), ("release", Outcome::NotRun)]
    );
    assert_eq!((record.phases[2].span_s, record.phases[2].reason.as_deref()), (None, Some("phase `hold` failed")));
    assert!(record.phases[3].span_s.is_some(), "teardown runs");
    let (record, _) = run_on(&plan(&strict), &mut simulated(3), None);
    assert!(record.phases[2].span_s.is_some(), "without on_fail the rest runs");
}

#[test]
fn a_rig_that_fails_or_cannot_be_made_safe_is_an_error() {
    let mut rig = Faulty::new(|k, s: &mut Sample| match k {
        120 => Err(RigError::Exhausted { source_name: "bench".into(), time_s: s.time_s }),
        _ => Ok(()),
    });
    let (record, _) = run_on(&plan(PLAN), &mut rig, None);
    assert_eq!((record.outcome, rig.made_safe), (Outcome::Error, 1));
    let mut rig = Faulty::new(|_, _: &mut Sample| Ok(()));
    rig.confirmed = false;
    let (record, _) = run_on(&plan(PLAN), &mut rig, None);
    assert_eq!(record.outcome, Outcome::Error);
    assert_eq!(record.reasons, ["SAFE STATE NOT CONFIRMED: seen by the test"]);
}

#[test]
fn a_panic_leaves_the_rig_safe() {
    let mut rig = Faulty::new(|k, _: &mut Sample| if k == 50 { panic!("of the test") } else { Ok(()) });
    let plan = plan(PLAN);
    let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| run_on(&plan, &mut rig, None)));
    assert!(caught.is_err());
    assert_eq!(rig.made_safe, 1);
}

#[test]
fn missed_slots_are_skipped_not_doubled() {
    let mut rig = Faulty::new(|k, s: &mut Sample| {
        s.missed_slots = u32::from(k == 110) * 2;
        Ok(())
    });
    let (record, trace) = run_on(&plan(PLAN), &mut rig, None);
    assert_eq!((record.timing.missed_slots, trace.time_s.len()), (2, 418));
    // After the gap the stimulus goes on where the clock is.
    assert!((trace.time_s[111] - 1.13).abs() < 1e-9);
}

#[test]
fn preconditions_are_watched_on_a_bench() {
    let wanting = plan(&PLAN.replace("[interlocks]", "preconditions.oil_temp = { min = \"35 degC\", max = \"45 degC\" }\n[interlocks]"));
    let with = |oil: Option<f64>| {
        let mut rig = Faulty::new(move |_, s: &mut Sample| {
            s.oil_temp_c = oil;
            Ok(())
        });
        run_on(&wanting, &mut rig, None).0
    };
    assert_eq!(with(Some(40.0)).outcome, Outcome::Pass);
    insta::assert_snapshot!(with(Some(50.0)).reasons.join("\n"), @"precondition: oil temperature 50.0 degC at 0.000 s, wanted 35 to 45 degC");
    insta::assert_snapshot!(with(None).reasons.join("\n"), @"precondition: the rig has no oil temperature, but the plan wants 35 to 45 degC");
    assert_eq!(with(None).outcome, Outcome::Invalid);
    assert_eq!(run_on(&wanting, &mut simulated(3), None).0.outcome, Outcome::Pass, "a simulation has no oil");
}

/// Each interlock of a plan ends the run, by magnitude, and where its value is no number; within its limit it does not.
#[test]
fn every_interlock_of_a_plan_trips_on_its_own_and_on_no_number() {
    let with = |interlock: &str, change: fn(usize, &mut Sample)| {
        let text = PLAN.replace("max_pressure = \"35 bar\"", interlock);
        let mut rig = Faulty::new(move |k, s: &mut Sample| {
            s.current_a = Some(0.3);
            if k == 150 {
                change(k, s);
            }
            Ok(())
        });
        let (record, trace) = run_on(&plan(&text), &mut rig, None);
        assert_eq!(rig.made_safe, 1);
        (record.outcome, record.reasons.join("; "), trace.time_s.len())
    };
    type Change = fn(usize, &mut Sample);
    let trips: [(&str, Change, &str); 8] = [
        ("max_current = \"0.6 A\"", |_, s| s.current_a = Some(0.61), "measured current"),
        ("max_current = \"0.6 A\"", |_, s| s.current_a = Some(-0.61), "measured current"),
        ("max_current = \"0.6 A\"", |_, s| s.current_a = Some(f64::NAN), "measured current"),
        ("max_pressure = \"35 bar\"", |_, s| s.pressure_bar = 36.0, "pressure"),
        ("max_pressure = \"35 bar\"", |_, s| s.pressure_bar = f64::NAN, "pressure"),
        ("max_pressure_rate = \"2000 bar/s\"", |_, s| s.pressure_bar += 30.0, "rate of the pressure"),
        ("max_pressure_rate = \"2000 bar/s\"", |_, s| s.pressure_bar -= 30.0, "rate of the pressure"),
        ("max_pressure_rate = \"2000 bar/s\"", |_, s| s.pressure_bar = f64::NAN, "rate of the pressure"),
    ];
    for (interlock, change, what) in trips {
        let (outcome, reasons, samples) = with(interlock, change);
        assert_eq!(outcome, Outcome::Error, "{interlock}: {reasons}");
        assert!(reasons.contains(&format!("interlock: {what}")) && samples == 151, "{interlock}: {reasons}, {samples}");
    }
    for interlock in ["max_current = \"0.6 A\"", "max_pressure_rate = \"2000 bar/s\""] {
        assert_eq!(with(interlock, |_, s| s.current_a = Some(0.59)).0, Outcome::Pass, "{interlock}");
    }
}

/// What is said of the safe state stands above a stop, a failed limit and a verdict.
#[test]
fn an_unconfirmed_safe_state_is_the_first_reason_whatever_ended_the_run() {
    let stop = AtomicBool::new(true);
    for stopped in [None, Some(&stop)] {
        let mut rig = Faulty::new(|_, _: &mut Sample| Ok(()));
        rig.confirmed = false;
        let record = run_on(&plan(PLAN), &mut rig, stopped).0;
        assert_eq!((record.outcome, record.ended_unsafe()), (Outcome::Error, true));
        assert!(record.reasons[0].starts_with("SAFE STATE NOT CONFIRMED"), "{:?}", record.reasons);
    }
}

/// Answers after so many looks.
struct Slow(std::sync::Mutex<u32>);

impl Attendant for Slow {
    fn ask(&self, _index: usize, _phase: &crate::plan::Phase, _prompt: &crate::plan::Prompt) {}
    fn reply(&self) -> Option<Reply> {
        let mut left = self.0.lock().unwrap();
        *left = left.saturating_sub(1);
        let answer = crate::plan::Answer { text: "yes".into(), value: None, verdict: Some(crate::limits::Verdict::Pass) };
        (*left == 0).then_some(Reply { answer, by: "terminal" })
    }
}

/// A rig with a clock: it counts its steps and the currents that were held.
struct Clocked {
    inner: SimulatedRig,
    currents: Vec<f64>,
}

impl Rig for Clocked {
    fn identity(&self) -> RigIdentity {
        RigIdentity { kind: "modbus".into(), ..self.inner.identity() }
    }
    fn step(&mut self, command_a: f64, until_s: f64) -> Result<Sample, RigError> {
        self.currents.push(command_a);
        self.inner.step(command_a, until_s)
    }
    fn make_safe(&mut self) -> Result<SafeState, RigError> {
        self.inner.make_safe()
    }
}

#[test]
fn while_a_question_stands_the_current_is_held_and_nothing_is_measured() {
    let plan = plan(&PLAN.replacen(
        "[[phase]]\nname = \"rise\"",
        "[[phase]]\nname = \"ask\"\nprompt = { text = \"Tight?\", timeout = \"2 s\" }\n[[phase]]\nname = \"rise\"",
        1,
    ));
    let (model, dut) = (crate::control::test_valve(), Dut::default());
    let run = |looks: u32, attendant: bool| {
        let mut rig = Clocked { inner: simulated(3), currents: Vec::new() };
        let slow = std::sync::Arc::new(Slow(std::sync::Mutex::new(looks)));
        let options = RunOptions { model: &model, dut: &dut, seed: 3, stop: None, prepared: None };
        let mut observer = Attended { observer: (), attendant: attendant.then_some(slow as _) };
        let (record, trace) = super::run(&plan, &mut rig, &options, &mut observer);
        (record, trace, rig.currents)
    };
    let (record, trace, currents) = run(50, true);
    assert_eq!((record.outcome, record.phases[2].outcome), (Outcome::Pass, Outcome::Pass));
    assert_eq!(record.phases[2].prompt.as_ref().unwrap().answer.as_deref(), Some("yes"));
    // 200 samples before the question, 49 slots while it stands.
    assert_eq!((currents.len() - trace.time_s.len(), trace.time_s.len()), (49, plan.samples()));
    assert!(currents[200..249].iter().all(|c| *c == currents[199]), "the current moved while the question stood");
    assert_eq!(record.timing.missed_slots, 0);
    let (record, ..) = run(1000, true);
    assert_eq!((record.outcome, record.reasons[0].as_str()), (Outcome::Aborted, "phase `ask`: nobody answered within 2 s"));
    let (record, ..) = run(1, false);
    assert!(record.outcome == Outcome::Error && record.reasons[0].contains("nobody is there to answer"), "{:?}", record.reasons);
}

/// What a bench measures beside the valve reaches the figures and the trace.
#[test]
fn a_sensitivity_needs_its_channel_and_is_measured_where_there_is_one() {
    let text = include_str!("../../examples/batch/influence.plan.toml");
    let plan = plan(&text.replace("20 min", "4 s"));
    let of = |record: &TestRecord| -> Vec<(Option<f64>, Outcome, Option<String>)> {
        let measured = record.phases.iter().flat_map(|p| &p.measurements);
        measured.map(|m| (m.value, m.outcome, m.reason.clone())).collect()
    };
    let mut rig = Faulty::new(|k, s: &mut Sample| {
        let t = k as f64 * 0.01;
        s.oil_temp_c = Some(30.0 + 5.0 * t);
        s.supply_bar = Some(60.0 - 0.25 * t * t);
        s.pressure_bar = if t < 4.0 { 18.0 - 0.01 * 5.0 * t } else { 18.0 + 0.02 * (0.25 * t * t) };
        Ok(())
    });
    let (record, trace) = run_on(&plan, &mut rig, None);
    // 10 mbar/K, and -20 mbar/bar, of 40 bar rated.
    assert_eq!(of(&record), [(Some(-0.0025), Outcome::Pass, None), (Some(-0.005), Outcome::Pass, None)]);
    assert_eq!((trace.oil_temp_c[100], trace.supply_bar[0]), (35.0, 60.0));
    let (record, trace) = run_on(&plan, &mut simulated(3), None);
    let reasons: Vec<String> = of(&record).into_iter().filter_map(|m| m.2).collect();
    assert_eq!(reasons, ["the rig measures no oil temperature", "the rig measures no supply pressure"]);
    assert_eq!(record.outcome, Outcome::Fail, "a limit on what was not measured fails");
    assert!(trace.supply_bar.iter().all(|p| p.is_nan()));
}
