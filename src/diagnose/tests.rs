//! The library against itself: each effect put into a simulated valve must come out again, and nothing where there
//! is nothing. Whether other formulas of the same physics are named is for `hil challenge`.

use rand::SeedableRng;
use rand_distr::{Distribution, Normal};

use super::*;
use crate::physics::{effect, simulate, specification};
use crate::recording::Run;
use crate::valve::{Identification, Input, Polynomial, ReferenceCurves};

const NOISE_BAR: f64 = 0.03;

fn valve() -> Valve {
    Valve { lag_s: 0.0, ..crate::physics::tests::valve(Vec::new()) }
}

/// 60 s of holds, ramps, steps, small sines and two visits to tank pressure.
fn drive() -> (Vec<f64>, Vec<f64>) {
    let levels = [0.45, 0.7, 0.15, 0.62, 0.55, 0.8, 0.35, 0.1, 0.66, 0.5, 0.74, 0.42];
    let time: Vec<f64> = (0..6000).map(|k| k as f64 * 0.01).collect();
    let current = time
        .iter()
        .map(|t| {
            let k = (t / 5.0) as usize;
            let (from, to) = (levels[k], levels[(k + 1) % levels.len()]);
            let rise = if k.is_multiple_of(2) { 0.15 } else { 2.0 };
            let wobble = if k % 3 == 1 { 0.02 * (2.0 * std::f64::consts::PI * 1.7 * t).sin() } else { 0.0 };
            from + (to - from) * ((t - 5.0 * k as f64 - 1.5) / rise).clamp(0.0, 1.0) + wobble
        })
        .collect();
    (time, current)
}

fn recording(of: &Valve) -> Recording {
    let (time_s, current_a) = drive();
    let mut random = rand_pcg::Pcg64::seed_from_u64(5);
    let normal = Normal::new(0.0, NOISE_BAR).unwrap();
    let pressure = simulate(of, Input::Held, &time_s, &current_a).unwrap().iter().map(|p| p + normal.sample(&mut random)).collect();
    let run = Run { time_s, current_a, pressure_bar: Some(pressure), ..Run::default() };
    Recording { source: "drive.csv".into(), runs: vec![run], notes: vec![], input: None }
}

/// The valve with this effect.
fn valve_with(id: &str, theta: &[f64]) -> Valve {
    Valve { effects: vec![specification(effect(id).unwrap(), theta)], ..valve() }
}

fn concealing(id: &str, theta: &[f64]) -> Diagnosed {
    diagnose(&recording(&valve_with(id, theta)), &valve()).unwrap()
}

#[test]
fn nothing_is_found_where_nothing_is() {
    let found = diagnose(&recording(&valve()), &valve()).unwrap();
    assert_eq!(found.diagnosis.verdict, Verdict::Match, "{}", found.diagnosis.summary);
    assert!(found.diagnosis.effects.is_empty());
}

#[test]
fn what_was_concealed_comes_out_with_its_size() {
    let cases: [(&str, &[f64]); 6] = [
        ("transport_delay", &[0.04]),
        ("first_order_lag", &[0.06, 1.0]),
        ("reversal_dead_band", &[0.03]),
        ("supply_saturation", &[18.0, 0.05, 0.0, 1e6]),
        ("creep", &[0.06, 3.0, 1.0]),
        ("sensor_drift", &[0.4, 2000.0]),
    ];
    for (id, theta) in cases {
        let found = concealing(id, theta);
        let d = &found.diagnosis;
        let first = d.effects.first().or(d.form.first()).unwrap_or_else(|| panic!("{id}: {}", d.summary));
        assert!(first.id == id || first.indistinguishable.iter().any(|r| r == id), "{id}: {}", d.summary);
        assert!(d.rmse_bar.augmented_heldout < 1.15 * NOISE_BAR, "{id}: {}", d.summary);
        if first.id == id {
            let name = effect(id).unwrap().parameters()[0].name;
            let value = first.parameters[name].value;
            assert!((value / theta[0] - 1.0).abs() < 0.15, "{id}: {value} for {}", theta[0]);
        }
    }
}

#[test]
fn a_spring_seat_that_has_set_is_a_shift_and_no_form() {
    // The valve does at 50 mA less what it did before: on curves that are no straight lines no line of the pressure says it.
    let mut set = recording(&valve());
    let run = &mut set.runs[0];
    let moved: Vec<f64> = run.current_a.iter().map(|i| i + 0.05).collect();
    let mut random = rand_pcg::Pcg64::seed_from_u64(8);
    let normal = Normal::new(0.0, 0.5 * NOISE_BAR).unwrap();
    let quiet = simulate(&valve(), Input::Held, &run.time_s, &moved).unwrap();
    run.pressure_bar = Some(quiet.iter().map(|p| p + normal.sample(&mut random)).collect());
    let d = diagnose(&set, &valve()).unwrap().diagnosis;
    assert_eq!(d.effects.iter().map(|e| e.id.as_str()).collect::<Vec<_>>(), ["reference_shift"], "{}", d.summary);
    assert!(d.rmse_bar.augmented_heldout < 0.1 * d.rmse_bar.base, "{}", d.summary);
}

#[test]
fn a_lag_that_a_recalibration_had_no_use_for_is_believed_beside_a_cause() {
    let calibrated = Valve { delay_s: 0.02, lag_s: 0.03, ..valve() };
    let mut limited = calibrated.clone();
    limited.effects.push(specification(effect("flow_limit").unwrap(), &[60.0, 75.0, 0.0, 0.0]));
    let recording = recording(&limited);
    let course = Course::of(&recording, &Preparation::for_model(&recording, &calibrated)).unwrap();
    let evidence = Evidence::of(course).unwrap();
    let base = Model::base(&calibrated).unwrap().on(&evidence).distrusting_lag();
    let chosen = search::search_in(&mut Fitter::new(&evidence), None, &base).chosen;
    assert_eq!(chosen.ids(), ["flow_limit"]);
    let lag_s = chosen.theta[base::AT.lag];
    assert!((lag_s / calibrated.lag_s - 1.0).abs() < 0.05, "{lag_s}");
}

#[test]
fn a_spool_with_which_no_simulation_keeps_step_is_named_by_its_rests() {
    let mut random = rand_pcg::Pcg64::seed_from_u64(3);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let time_s: Vec<f64> = (0..9000).map(|k| k as f64 * 0.01).collect();
    let current_a: Vec<f64> = time_s.iter().map(|t| 0.3 + 0.4 * (1.0 - (t / 8.3 % 2.0 - 1.0).abs())).collect();
    // It lets go a fifth sooner or later each time.
    let (mut at_a, mut band_a) = (current_a[0], 0.02);
    let mut spool = |i: f64| {
        if f64::abs(i - at_a) > band_a {
            at_a = i - f64::copysign(0.3 * band_a, i - at_a);
            band_a = 0.02 * (1.0 + 0.2 * normal.sample(&mut random));
        }
        at_a
    };
    let felt_a: Vec<f64> = current_a.iter().map(|i| spool(*i)).collect();
    let quiet = simulate(&valve(), Input::Held, &time_s, &felt_a).unwrap();
    let pressure = quiet.iter().map(|p| p + NOISE_BAR * normal.sample(&mut random)).collect();
    let run = Run { time_s, current_a, pressure_bar: Some(pressure), ..Run::default() };
    let sticks = Recording { source: "slow.csv".into(), runs: vec![run], notes: vec![], input: None };
    let d = diagnose(&sticks, &valve()).unwrap().diagnosis;
    let found = d.effects.iter().find(|e| e.id == "stiction").unwrap_or_else(|| panic!("{}", d.summary));
    assert!((found.parameters["band"].value / 0.02 - 1.0).abs() < 0.15, "{:?}", found.parameters);
    assert!(found.evidence.contains("rests and jumps"), "{}", found.evidence);
    // The same drive of a valve that does not stick.
    let run = Run {
        pressure_bar: Some(
            simulate(&valve(), Input::Held, &sticks.runs[0].time_s, &sticks.runs[0].current_a)
                .unwrap()
                .iter()
                .map(|p| p + NOISE_BAR * normal.sample(&mut random))
                .collect(),
        ),
        ..sticks.runs[0].clone()
    };
    let moves = Recording { runs: vec![run], ..sticks };
    assert_eq!(diagnose(&moves, &valve()).unwrap().diagnosis.verdict, Verdict::Match);
}

#[test]
fn the_augmented_model_is_the_one_that_the_diagnosis_speaks_of() {
    let found = concealing("first_order_lag", &[0.06, 1.0]);
    let back = Valve::from_toml(&found.augmented.to_toml(), "augmented").unwrap();
    let (time, current) = drive();
    let simulated = simulate(&back, Input::Held, &time, &current).unwrap();
    for (a, b) in simulated.iter().zip(&found.curves.augmented_bar) {
        assert!((a - b).abs() < 1e-9);
    }
}

#[test]
fn the_lag_of_a_process_is_no_physics_that_the_valve_lacks() {
    // A model of the process, not of a valve alone: one that answers within a second would not belong to it.
    let mut model = valve();
    model.lag_s = 6.0;
    let process = Valve { lag_s: 8.0, ..model.clone() };
    let mut slow = recording(&valve());
    let run = &mut slow.runs[0];
    run.time_s.iter_mut().for_each(|t| *t *= 100.0);
    let quiet = simulate(&process, Input::Held, &run.time_s, &run.current_a).unwrap();
    let mut random = rand_pcg::Pcg64::seed_from_u64(6);
    let normal = Normal::new(0.0, NOISE_BAR).unwrap();
    run.pressure_bar = Some(quiet.iter().map(|p| p + normal.sample(&mut random)).collect());
    let d = diagnose(&slow, &model).unwrap().diagnosis;
    assert!(d.effects.is_empty(), "{}", d.summary);
    let lag = d.recalibration.iter().find(|c| c.parameter == "lag").map(|c| c.after);
    assert!(lag.is_some_and(|tau_s| (tau_s / 8.0 - 1.0).abs() < 0.1), "{lag:?}");
    assert!(d.notes.iter().any(|n| n.contains("process")), "{:?}", d.notes);
}

#[test]
fn a_recording_that_carries_no_diagnosis_is_refused_with_the_reason() {
    let whole = recording(&valve());
    let with = |change: &dyn Fn(&mut Run)| {
        let mut r = whole.clone();
        change(&mut r.runs[0]);
        diagnose(&r, &valve()).unwrap_err().to_string()
    };
    assert!(with(&|r| r.pressure_bar = None).contains("pressure_bar"));
    assert!(with(&|r| r.current_a.fill(0.5)).contains("current is constant"));
    let short = with(&|r| {
        r.time_s.truncate(50);
        r.current_a.truncate(50);
        r.pressure_bar.as_mut().unwrap().truncate(50);
    });
    assert!(short.contains("at least 200"), "{short}");
}

#[test]
fn what_does_not_belong_together_is_told_with_the_mapping_that_mends_it() {
    let whole = recording(&valve());
    let scaled = |values: &mut [f64], factor: f64| values.iter_mut().for_each(|v| *v *= factor);
    let pressure = |r: &mut Run, change: &dyn Fn(&mut Vec<f64>)| change(r.pressure_bar.as_mut().unwrap());
    type Break<'b> = (&'b str, &'b dyn Fn(&mut Run));
    let cases: [Break<'_>; 18] = [
        ("[psi]", &|r| pressure(r, &|p| scaled(p, 14.503_773_8))),
        ("[MPa]", &|r| pressure(r, &|p| scaled(p, 0.1))),
        ("[kPa]", &|r| pressure(r, &|p| scaled(p, 100.0))),
        ("[Pa]", &|r| pressure(r, &|p| scaled(p, 1e5))),
        ("0.1 * pressure_bar", &|r| pressure(r, &|p| scaled(p, 10.0))),
        ("current_a [mA]", &|r| scaled(&mut r.current_a, 1e3)),
        ("time_s [ms]", &|r| scaled(&mut r.time_s, 1e3)),
        ("-1 * pressure_bar", &|r| pressure(r, &|p| scaled(p, -1.0))),
        ("-1 * current_a", &|r| scaled(&mut r.current_a, -1.0)),
        ("--falling", &|r| pressure(r, &|p| p.iter_mut().for_each(|v| *v = 30.0 - *v))),
        ("pressure_bar=current_a", &|r| std::mem::swap(&mut r.current_a, r.pressure_bar.as_mut().unwrap())),
        ("leads the current", &|r| pressure(r, &|p| p.rotate_left(150))),
        ("later than the model", &|r| pressure(r, &|p| p.rotate_right(200))),
        ("does not follow the current", &|r| pressure(r, &|p| (0..p.len()).for_each(|k| p.swap(k, (k * 7919 + 13) % 6000)))),
        ("does not follow the current", &|r| {
            pressure(r, &|p| p.iter_mut().enumerate().for_each(|(k, v)| *v = 9.0 + ((k * 7919) % 101) as f64 / 10.0))
        }),
        ("stands still", &|r| pressure(r, &|p| p.iter_mut().for_each(|v| *v = 5.0))),
        ("hardly moves", &|r| {
            r.current_a.iter_mut().for_each(|i| *i = 0.5 + 1e-4 * *i);
            pressure(r, &|p| p.iter_mut().enumerate().for_each(|(k, v)| *v = 9.0 + 0.05 * ((k * 7919) % 101) as f64 / 50.0));
        }),
        ("another valve", &|r| pressure(r, &|p| p.iter_mut().for_each(|v| *v = 2.4 * *v - 9.0))),
    ];
    for (said, change) in cases {
        let mut broken = whole.clone();
        change(&mut broken.runs[0]);
        let d = diagnose(&broken, &valve()).unwrap().diagnosis;
        assert_eq!(d.verdict, Verdict::NotComparable, "{said}: {}", d.summary);
        assert!(d.effects.is_empty() && d.form.is_empty() && d.summary.contains(said), "{said}: {}", d.summary);
    }
}

#[test]
fn a_model_of_held_commands_is_compared_with_held_commands() {
    let (time_s, current_a) = drive();
    let coarse = |values: Vec<f64>| values.into_iter().step_by(10).collect::<Vec<f64>>();
    let (time_s, current_a) = (coarse(time_s), coarse(current_a));
    let mut random = rand_pcg::Pcg64::seed_from_u64(8);
    let normal = Normal::new(0.0, NOISE_BAR).unwrap();
    let pressure = simulate(&valve(), Input::Held, &time_s, &current_a).unwrap().iter().map(|p| p + normal.sample(&mut random)).collect();
    let run = Run { time_s, current_a, pressure_bar: Some(pressure), ..Run::default() };
    let recording = Recording { source: "drive.csv".into(), runs: vec![run], notes: vec![], input: None };
    let found_for = |input| {
        let found = Identification { input: Some(input), ..Identification::default() };
        Valve { identification: Some(found), ..valve() }
    };
    let d = diagnose(&recording, &found_for(Input::Held)).unwrap().diagnosis;
    assert_eq!(d.verdict, Verdict::Match, "{}", d.summary);
    assert!(d.rmse_bar.base < 1.1 * NOISE_BAR, "{}", d.rmse_bar.base);
    // Under the other convention half a step of 0.1 s is missing.
    assert!(diagnose(&recording, &found_for(Input::Ramp)).unwrap().diagnosis.rmse_bar.base > 5.0 * NOISE_BAR);
}

#[test]
fn a_slow_wander_is_no_drift() {
    let mut wanders = recording(&valve());
    let run = &mut wanders.runs[0];
    let time_s = run.time_s.clone();
    // Up, and then it stays, and then down again by half: what was found in the one half says nothing of the other.
    let course = |t: f64| 0.9 * ((t - 12.0) / 14.0).clamp(0.0, 1.0) - 0.5 * ((t - 40.0) / 12.0).clamp(0.0, 1.0);
    for (p, t) in run.pressure_bar.iter_mut().flatten().zip(&time_s) {
        *p += course(*t);
    }
    let d = diagnose(&wanders, &valve()).unwrap().diagnosis;
    assert!(d.effects.iter().all(|e| e.id != "sensor_drift" && e.id != "reference_drift"), "{}", d.summary);
}

#[test]
fn a_bit_that_is_stuck_is_named_alone_and_the_augmented_model_reads_as_it_does() {
    let mut stuck = recording(&valve());
    let bit = |p: f64| (p / 0.5).floor().rem_euclid(2.0) == 1.0;
    let run = &mut stuck.runs[0];
    for p in run.pressure_bar.iter_mut().flatten() {
        *p -= if bit(*p) { 0.5 } else { 0.0 };
    }
    let found = diagnose(&stuck, &valve()).unwrap();
    let named: Vec<&str> = found.diagnosis.effects.iter().map(|e| e.id.as_str()).collect();
    assert_eq!((named, found.diagnosis.verdict), (vec!["sensor_missing_codes"], Verdict::Explained), "{}", found.diagnosis.summary);
    let run = &stuck.runs[0];
    let simulated = simulate(&found.augmented, Input::Held, &run.time_s, &run.current_a).unwrap();
    let mut off: Vec<f64> = run.pressure_bar.iter().flatten().zip(&simulated).map(|(y, p)| (y - p).abs()).collect();
    off.sort_by(f64::total_cmp);
    assert!(off[off.len() * 3 / 4] < 3.0 * NOISE_BAR, "{} bar, where the bit hides half a bar", off[off.len() * 3 / 4]);
    assert!(found.diagnosis.rmse_bar.augmented_heldout < 0.3 * found.diagnosis.rmse_bar.base, "{:?}", found.diagnosis.rmse_bar);
}

#[test]
fn where_the_curves_of_a_model_do_not_hold_it_may_be_off_by_any_factor() {
    // Identified from a sweep that ended at the limit of the supply; the straight line beyond is steep.
    let ascending = Polynomial::new(vec![160.0, -20.0, 10.0, 0.0]);
    let curves = ReferenceCurves::on_range(ascending.clone(), ascending, (0.0, 0.35));
    let model = Valve { curves, ..valve() };
    let (time_s, current_a) = drive();
    let mut random = rand_pcg::Pcg64::seed_from_u64(8);
    let normal = Normal::new(0.0, NOISE_BAR).unwrap();
    let limited = simulate(&model, Input::Held, &time_s, &current_a).unwrap();
    let pressure = limited.iter().map(|p| p.min(8.0) + normal.sample(&mut random)).collect();
    let run = Run { time_s, current_a, pressure_bar: Some(pressure), ..Run::default() };
    let d = diagnose(&Recording { source: "drive.csv".into(), runs: vec![run], notes: vec![], input: None }, &model).unwrap().diagnosis;
    assert_ne!(d.verdict, Verdict::NotComparable, "{}", d.summary);
    assert_eq!(d.effects[0].id, "supply_saturation", "{}", d.summary);
}

#[test]
fn where_most_of_the_error_lies_elsewhere_spoilt_readings_are_a_cause_only_where_each_stands_alone() {
    // So many readings in a row are spoilt every six seconds.
    let spoilt = |in_a_row: usize, is_knocked: bool| {
        let mut of = recording(&valve());
        let run = &mut of.runs[0];
        let readings = run.pressure_bar.iter_mut().flatten().zip(&run.time_s).enumerate();
        for (k, (p, t)) in readings {
            let place = (k + 600) % 650;
            *p += if k >= 700 && place < in_a_row { 3.0 + 0.8 * place as f64 } else { 0.0 };
            // Knocks from outside that ring out, at times of their own.
            let knocks = [3.1, 9.7, 14.2, 22.9, 27.3, 36.8, 41.1, 49.6, 55.4];
            let since = knocks.iter().map(|at| t - at).filter(|s| *s > 0.0).fold(f64::INFINITY, f64::min);
            *p += if is_knocked { 3.0 * (-since / 1.2).exp() * (19.0 * since).sin() } else { 0.0 };
        }
        let d = diagnose(&of, &valve()).unwrap().diagnosis;
        (d.effects.iter().any(|e| e.id == "sensor_outliers"), d.verdict)
    };
    assert!(spoilt(1, false).0 && spoilt(4, false).0);
    assert_eq!(spoilt(1, true), (true, Verdict::PartlyExplained));
    assert!(!spoilt(4, true).0);
}

#[test]
fn the_measured_current_parts_what_lies_before_it_from_what_lies_behind() {
    let measured = |driver_lag_s: f64, chamber_lag_s: f64, read: &dyn Fn(usize, f64) -> f64| {
        let mut of = recording(&valve());
        let run = &mut of.runs[0];
        let mut coil_a = run.current_a[0];
        let mut random = rand_pcg::Pcg64::seed_from_u64(7);
        let (sensor, probe) = (Normal::new(0.0, NOISE_BAR).unwrap(), Normal::new(0.0, 2e-4).unwrap());
        let share = if driver_lag_s > 0.0 { 1.0 - (-0.01 / driver_lag_s).exp() } else { 1.0 };
        let current: Vec<f64> = run
            .current_a
            .iter()
            .map(|command| {
                coil_a += share * (command - coil_a);
                coil_a
            })
            .collect();
        let mut true_valve = valve();
        if chamber_lag_s > 0.0 {
            true_valve.effects.push(specification(effect("first_order_lag").unwrap(), &[chamber_lag_s, 1.0]));
        }
        let pressure = simulate(&true_valve, Input::Ramp, &run.time_s, &current).unwrap();
        run.pressure_bar = Some(pressure.iter().map(|p| p + sensor.sample(&mut random)).collect());
        run.current_meas_a = Some(current.iter().enumerate().map(|(k, i)| read(k, i + probe.sample(&mut random))).collect());
        of
    };
    let side_by = |driver_lag_s, chamber_lag_s, read: &dyn Fn(usize, f64) -> f64| {
        let (of, valve) = (measured(driver_lag_s, chamber_lag_s, read), valve());
        let evidence = Evidence::read(&of, &valve).unwrap();
        let fitter = Fitter::new(&evidence);
        let (null, _) = search::recalibrated(&fitter, Model::base(&valve).unwrap().on(&evidence));
        coil::coil_current(&of, &fitter, &null).map(|c| c.missing)
    };
    let as_it_is = |_: usize, i: f64| i;
    let side = |driver_lag_s, chamber_lag_s| side_by(driver_lag_s, chamber_lag_s, &as_it_is);
    assert_eq!(side(0.15, 0.0), Some(Side::Before));
    assert_eq!(side(0.0, 0.15), Some(Side::Behind));
    assert_eq!(side(0.15, 0.15), Some(Side::Both));
    // The diagnosis says the same in its summary, and of a valve that lacks nothing it says nothing.
    for (lag_s, said) in [(0.15, Some(Side::Both)), (0.0, None)] {
        let found = diagnose(&measured(lag_s, lag_s, &as_it_is), &valve()).unwrap().diagnosis;
        assert_eq!(found.summary.contains("measured coil current"), said.is_some(), "{}", found.summary);
        assert_eq!(found.coil_current.map(|c| c.missing), said);
    }
    // Milliamperes read as amperes, a sensor that hangs in the air, the current of another coil: nothing is said by them.
    assert_eq!(side_by(0.0, 0.15, &|_, i| 1e3 * i), None);
    assert_eq!(side_by(0.0, 0.15, &|k, _| 0.4 + 0.1 * ((k * 7919) % 101) as f64 / 101.0), None);
    assert_eq!(side_by(0.15, 0.0, &|k, _| 0.5 + 0.3 * (0.031 * k as f64).sin()), None);
}

#[test]
fn an_effect_at_the_end_of_its_range_is_told_from_its_plainest_form() {
    let valve = valve();
    let base = Model::base(&valve).unwrap();
    let at_bound = |id: &str, change: &[(usize, f64)]| {
        let effect = effect(id).unwrap();
        let model = base.with(effect, 0.0);
        let mut theta = [base.calibrated(), model.starts(effect).remove(0)].concat();
        let place = model.place(0);
        change.iter().for_each(|(j, value)| theta[place.start + j] = *value);
        fit::Fit { model, theta, mean_nats: 0.0, prior_nats: 0.0, scale_bar: 1.0, rmse_bar: 1.0 }.at_bound(0)
    };
    assert!(!at_bound("rate_dependent_hysteresis", &[]));
    // A loop that widens by hardly any power of the rate is one that is wider at every rate.
    assert!(at_bound("rate_dependent_hysteresis", &[(1, 0.05)]));
    // No travel is the plainest form; so is a drift that goes on for ever.
    assert!(!at_bound("rate_dependent_hysteresis", &[(2, 0.0)]));
    assert!(!at_bound("sensor_drift", &[(1, 2000.0)]));
}

mod at_rest;
mod denied_repair;
mod good_valve;
mod remembered;
mod what_is_claimed;
mod whole_record;
