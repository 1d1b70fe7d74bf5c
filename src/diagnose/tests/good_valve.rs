//! What data of the good valve says, and what it does not.

use rand::SeedableRng;
use rand_distr::{Distribution, Normal};

use super::super::*;
use super::{NOISE_BAR, drive, recording, valve, valve_with};
use crate::physics::{effect, simulate, specification};
use crate::recording::Run;
use crate::valve::{Identification, Input, Polynomial, ReferenceCurves};

/// The same valve with other noise, driven the other way round in time.
fn another_drive(of: &Valve) -> Recording {
    let (time_s, mut current_a) = drive();
    current_a.reverse();
    let mut random = rand_pcg::Pcg64::seed_from_u64(9);
    let normal = Normal::new(0.0, NOISE_BAR).unwrap();
    let pressure = simulate(of, Input::Held, &time_s, &current_a).unwrap().iter().map(|p| p + normal.sample(&mut random)).collect();
    let run = Run { time_s, current_a, pressure_bar: Some(pressure), ..Run::default() };
    Recording { source: "good.csv".into(), runs: vec![run], notes: vec![], input: None }
}

#[test]
fn what_the_good_valve_has_is_form_and_what_its_data_excludes_has_changed() {
    let good = valve_with("first_order_lag", &[0.05, 1.0]);
    let reference = [another_drive(&good)];
    let healthy = diagnose_against(&recording(&good), &valve(), &reference).unwrap().diagnosis;
    assert_eq!(healthy.verdict, Verdict::Match, "{}", healthy.summary);
    assert!(healthy.form.iter().any(|f| f.claim == Claim::Lacks), "{}", healthy.summary);

    let mut worn = good.clone();
    worn.effects.insert(0, specification(effect("reversal_dead_band").unwrap(), &[0.03]));
    let changed = diagnose_against(&recording(&worn), &valve(), &reference).unwrap().diagnosis;
    let first = changed.effects.first().unwrap_or_else(|| panic!("{}", changed.summary));
    assert_eq!((first.id.as_str(), first.claim), ("reversal_dead_band", Claim::Changed), "{}", changed.summary);
    // What only that data shows was none of the names that the search weighed.
    let kept = changed.candidates.iter().filter(|c| c.rejected_because.is_none());
    assert!(kept.clone().all(|c| changed.effects.iter().any(|e| e.id == c.id)), "{:?}", kept.collect::<Vec<_>>());

    // Without that data nothing is claimed to have changed, and a dead band may be the form of the loop.
    let alone = diagnose(&recording(&worn), &valve()).unwrap().diagnosis;
    assert!(alone.effects.iter().all(|f| f.claim == Claim::Lacks && f.id != "reversal_dead_band"), "{}", alone.summary);
    assert!(alone.form.iter().any(|f| f.id == "reversal_dead_band"), "{}", alone.summary);
}

#[test]
fn a_valve_that_is_no_farther_off_than_when_it_was_good_has_not_changed() {
    let disturbed = |mut of: Recording, by: &dyn Fn(f64) -> f64| {
        let run = &mut of.runs[0];
        let time_s = run.time_s.clone();
        run.pressure_bar.iter_mut().flatten().zip(time_s).for_each(|(p, t)| *p += by(t));
        of
    };
    // A wander that nothing in the library holds: of the good valve, or not.
    let wanders = |t: f64| 0.5 * (0.9 * t + 2.0 * (0.23 * t).sin()).sin() * (0.61 * t).cos();
    let (steady, restless) = (another_drive(&valve()), disturbed(another_drive(&valve()), &wanders));
    let drifts = disturbed(recording(&valve()), &|t| 0.004 * t);
    let found = |good: &Recording| diagnose_against(&drifts, &valve(), std::slice::from_ref(good)).unwrap().diagnosis;
    let changed = found(&steady);
    assert!(changed.effects.iter().any(|f| f.claim == Claim::Changed), "{}", changed.summary);
    let as_ever = found(&restless);
    assert_eq!((as_ever.verdict, as_ever.effects.len()), (Verdict::Match, 0), "{}", as_ever.summary);
    // One drive tells only so well how far another one will be off.
    let farther = |times: f64| {
        let record = disturbed(recording(&valve()), &|t| times * wanders(t + 3.0));
        diagnose_against(&record, &valve(), std::slice::from_ref(&restless)).unwrap().diagnosis
    };
    assert_eq!(farther(1.7).verdict, Verdict::Match, "{}", farther(1.7).summary);
    assert_eq!(farther(2.6).verdict, Verdict::Unexplained, "{}", farther(2.6).summary);
}

#[test]
fn a_worn_form_has_changed_though_a_denied_calibration_follows_it_half() {
    let wandering = |mut of: Recording, from_s: f64| {
        let run = &mut of.runs[0];
        let times_s = run.time_s.iter().map(|t| t + from_s);
        for (p, t) in run.pressure_bar.iter_mut().flatten().zip(times_s) {
            *p += 0.2 * (0.9 * t + 2.0 * (0.23 * t).sin()).sin() * (0.61 * t).cos();
        }
        of
    };
    let worn = valve_with("reversal_dead_band", &[0.03]);
    let d = diagnose_against(&wandering(recording(&worn), 3.0), &valve(), &[wandering(another_drive(&valve()), 0.0)]).unwrap().diagnosis;
    let first = d.effects.first().unwrap_or_else(|| panic!("{}", d.summary));
    assert_eq!((first.id.as_str(), first.claim), ("reversal_dead_band", Claim::Changed), "{}", d.summary);
}

#[test]
fn what_the_good_valve_would_show_as_well_if_it_were_read_as_slowly_has_not_changed() {
    for every in [5, 8] {
        let mut slow = recording(&valve());
        slow.runs[0] = slow.runs[0].every(every);
        let d = diagnose_against(&slow, &valve(), &[another_drive(&valve())]).unwrap().diagnosis;
        assert!(d.effects.is_empty() && !d.form.is_empty(), "{every}: {}", d.summary);
    }
}

#[test]
fn what_a_recalibration_of_a_days_size_hides_is_no_other_state_of_the_valve() {
    let said = |gain: f64, zero_bar: f64| {
        let mut record = recording(&valve());
        record.runs[0].pressure_bar.iter_mut().flatten().for_each(|p| *p = gain.mul_add(*p, zero_bar));
        let criteria = Criteria { another_drive: 1.2, ..Criteria::default() };
        diagnose_by(&criteria, None, &record, &valve(), &[another_drive(&valve())]).unwrap().diagnosis
    };
    let (day, moved) = (said(1.002, 0.03), said(1.0, 0.2));
    assert!(day.rmse_bar.base > 2.0 * day.rmse_bar.refit_heldout, "{}", day.summary);
    assert_eq!((day.verdict, day.effects.len()), (Verdict::Match, 0), "{}", day.summary);
    assert_ne!(moved.verdict, Verdict::Match, "{}", moved.summary);
}

#[test]
fn good_data_that_a_slower_logger_would_have_missed_is_no_bar_to_a_diagnosis() {
    let mut slow = recording(&valve());
    slow.runs[0] = slow.runs[0].every(5);
    let mut sparse = another_drive(&valve());
    sparse.runs[0].pressure_bar.iter_mut().flatten().step_by(5).for_each(|p| *p = f64::NAN);
    let found = diagnose_against(&slow, &valve(), &[sparse]);
    assert!(found.is_ok(), "{:?}", found.err());
}

/// The whole range of the current up and down in two minutes.
fn sweep(of: &Valve) -> Recording {
    let mut random = rand_pcg::Pcg64::seed_from_u64(13);
    let normal = Normal::new(0.0, NOISE_BAR).unwrap();
    let time_s: Vec<f64> = (0..12_000).map(|k| f64::from(k) * 0.01).collect();
    let (low_a, high_a) = of.curves.range_a;
    let current_a: Vec<f64> = time_s.iter().map(|t| low_a + (high_a - low_a) * (1.0 - (t / 60.0 - 1.0).abs())).collect();
    let pressure = simulate(of, Input::Held, &time_s, &current_a).unwrap().iter().map(|p| p + normal.sample(&mut random)).collect();
    let run = Run { time_s, current_a, pressure_bar: Some(pressure), ..Run::default() };
    Recording { source: "sweep.csv".into(), runs: vec![run], notes: vec![], input: None }
}

#[test]
fn a_slow_sweep_speaks_beside_a_drive_and_not_alone() {
    let told = |good: &[Recording]| {
        let d = diagnose_against(&recording(&valve()), &valve(), good).unwrap().diagnosis;
        assert_eq!(d.verdict, Verdict::Match, "{}", d.summary);
        d.notes.iter().find_map(|n| Some(n.strip_prefix("data of the good valve: ")?.split(';').next()?.to_string()))
    };
    assert_eq!(told(&[sweep(&valve()), another_drive(&valve())]).as_deref(), Some("sweep.csv, good.csv"));
    assert_eq!(told(&[sweep(&valve())]), None);
}

#[test]
fn a_sensor_that_is_off_is_named_against_data_of_the_good_valve_only() {
    for (id, theta) in [("sensor_gain", [0.04]), ("sensor_zero", [-0.5])] {
        let off = valve_with(id, &theta);
        let d = diagnose_against(&recording(&off), &valve(), &[another_drive(&valve())]).unwrap().diagnosis;
        let first = d.effects.first().unwrap_or_else(|| panic!("{id}: {}", d.summary));
        assert_eq!((first.id.as_str(), first.claim, d.effects.len()), (id, Claim::Changed, 1), "{}", d.summary);
        let value = first.parameters[effect(id).unwrap().parameters()[0].name].value;
        assert!((value / theta[0] - 1.0).abs() < 0.1, "{id}: {value}");
        // Nothing moved in its place, so that the gain is seen on held-out data.
        assert!(first.p_value < 0.01 && first.heldout_gain_bar > NOISE_BAR, "{id}: {} {}", first.p_value, first.heldout_gain_bar);
        // Nobody knows how the sensor stood before.
        let alone = diagnose(&recording(&off), &valve()).unwrap().diagnosis;
        assert!(alone.effects.iter().all(|f| f.id != id), "{}", alone.summary);
    }
}

#[test]
fn noise_that_the_good_valve_did_not_have_is_no_excuse() {
    let mut rough = recording(&valve());
    let mut random = rand_pcg::Pcg64::seed_from_u64(12);
    let more = Normal::new(0.0, 8.0 * NOISE_BAR).unwrap();
    rough.runs[0].pressure_bar.iter_mut().flatten().for_each(|p| *p += more.sample(&mut random));
    let d = diagnose_against(&rough, &valve(), &[another_drive(&valve())]).unwrap().diagnosis;
    // Fast movements count for noise in part.
    assert!(d.rmse_bar.noise_floor < 3.0 * NOISE_BAR, "{}", d.rmse_bar.noise_floor);
    assert_eq!((d.verdict, d.effects.len()), (Verdict::Unexplained, 0), "{}", d.summary);
    assert!(d.notes.iter().any(|n| n.contains("counts as an error")), "{:?}", d.notes);
    // A simulation, or a log that was smoothed, is no word of the sensor's noise.
    let mut smooth = another_drive(&valve());
    let run = &mut smooth.runs[0];
    run.pressure_bar = Some(simulate(&valve(), Input::Held, &run.time_s, &run.current_a).unwrap());
    let healthy = diagnose_against(&recording(&valve()), &valve(), &[smooth]).unwrap().diagnosis;
    assert_eq!(healthy.verdict, Verdict::Match, "{}", healthy.summary);
    // Without that data nobody knows what noise the sensor has.
    assert_eq!(diagnose(&rough, &valve()).unwrap().diagnosis.verdict, Verdict::Match);
}

/// That drive with no movement as fast as those of the record: over 1.2 s where the record takes 0.15 s.
fn gentle(of: &Valve) -> Recording {
    let mut recording = another_drive(of);
    let run = &mut recording.runs[0];
    let most_a = 0.005;
    for k in 1..run.current_a.len() {
        run.current_a[k] = run.current_a[k].clamp(run.current_a[k - 1] - most_a, run.current_a[k - 1] + most_a);
    }
    let mut random = rand_pcg::Pcg64::seed_from_u64(11);
    let normal = Normal::new(0.0, NOISE_BAR).unwrap();
    let quiet = simulate(of, Input::Held, &run.time_s, &run.current_a).unwrap();
    run.pressure_bar = Some(quiet.iter().map(|p| p + normal.sample(&mut random)).collect());
    recording
}

#[test]
fn what_shows_only_where_the_good_valve_was_never_driven_so_fast_is_no_change() {
    // The limit lies above what the gentle drive asks for, and below what the record does.
    let limited = valve_with("flow_limit", &[60.0, 60.0, 1.0, 0.0]);
    let claimed = |good: &Recording| diagnose_against(&recording(&limited), &valve(), std::slice::from_ref(good)).unwrap().diagnosis;
    let lively = claimed(&another_drive(&valve()));
    assert!(lively.effects.iter().any(|f| f.id == "flow_limit" && f.claim == Claim::Changed), "{}", lively.summary);
    let unknown = claimed(&gentle(&valve()));
    assert!(unknown.effects.iter().all(|f| f.claim == Claim::Lacks), "{}", unknown.summary);
}

#[test]
fn how_far_a_good_valve_is_off_behind_faster_movements_than_its_own_nobody_knows() {
    // It answers later to each movement that is faster than any of the good data; its gain is off by less than that data allows.
    let reference = [gentle(&valve())];
    let later = recording(&Valve { delay_s: valve().delay_s + 0.01, ..valve() });
    let mut late = recording(&valve());
    let run = &mut late.runs[0];
    let mut since_s = f64::INFINITY;
    for (k, p) in run.pressure_bar.iter_mut().flatten().enumerate() {
        let fast = k >= 10 && (run.current_a[k] - run.current_a[k - 10]).abs() > 0.08;
        since_s = if fast { 0.0 } else { since_s + 0.01 };
        let answer_bar = if since_s < 0.4 { later.runs[0].pressure_bar.as_ref().unwrap()[k] } else { *p };
        *p = 1.0065 * answer_bar;
    }
    let verdict = |speaks: f64| {
        // A gain of that size is no day's any more.
        let criteria = Criteria { speaks, very_strong: 4.0, ..Criteria::default() };
        diagnose_by(&criteria, None, &late, &valve(), &reference).unwrap().diagnosis.verdict
    };
    assert_eq!(verdict(Criteria::default().speaks), Verdict::Match);
    assert_eq!(verdict(0.01), Verdict::Unexplained, "where any movement is known");
}

#[test]
fn what_a_recalibration_hides_is_no_match_where_data_of_the_good_valve_does_not_allow_it() {
    // Loop and curves are fitted to the record as well as they were to the good valve, elsewhere.
    let mut apart = valve();
    let moved = |curve: &Polynomial, by_bar: f64| {
        let mut coefficients = curve.coefficients.clone();
        *coefficients.last_mut().unwrap() += by_bar;
        Polynomial::new(coefficients)
    };
    let curves = &apart.curves;
    apart.curves = ReferenceCurves::on_range(moved(&curves.ascending, 0.35), moved(&curves.descending, -0.35), curves.range_a);
    let reference = [another_drive(&valve())];
    let d = diagnose_against(&recording(&apart), &valve(), &reference).unwrap().diagnosis;
    assert!(d.rmse_bar.base > 5.0 * d.rmse_bar.refit_heldout, "{}", d.summary);
    assert_eq!((d.verdict, d.effects.len()), (Verdict::Unexplained, 0), "{}", d.summary);
    assert!(d.summary.contains("loop width -0.7"), "{}", d.summary);
    assert!(d.unexplained.is_some_and(|left| left.rms_bar > 0.2));
    // Without that data nobody knows how the valve stood.
    let alone = diagnose(&recording(&apart), &valve()).unwrap().diagnosis;
    assert_eq!(alone.verdict, Verdict::Match, "{}", alone.summary);
}

/// What a valve does besides, by steps of this size [bar], comes when it will: no model follows it, on any drive.
fn knocked(mut recording: Recording, source: &str, (seed, size_bar): (u64, f64)) -> Recording {
    let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
    let normal = Normal::new(0.0, size_bar).unwrap();
    let mut level = 0.0;
    for (k, p) in recording.runs[0].pressure_bar.iter_mut().flatten().enumerate() {
        if k % 80 == 0 {
            level = normal.sample(&mut random);
        }
        *p += level;
    }
    Recording { source: source.into(), ..recording }
}

#[test]
fn a_zero_that_is_off_by_more_than_a_good_valve_wanders_is_named() {
    // The good valve wanders by 0.12 bar, and by as much gain and zero may be off on another drive: by 0.3 bar they may not.
    let reference = [knocked(another_drive(&valve()), "good.csv", (3, 0.12))];
    let off = |by_bar: f64| {
        let mut record = recording(&valve());
        record.runs[0].pressure_bar.iter_mut().flatten().for_each(|p| *p += by_bar);
        diagnose_against(&record, &valve(), &reference).unwrap().diagnosis
    };
    let d = off(0.3);
    let told = |f: &Finding| f.id == "sensor_zero" || f.indistinguishable.iter().any(|id| id == "sensor_zero");
    assert!(d.effects.len() == 1 && d.effects[0].claim == Claim::Changed && told(&d.effects[0]), "{}", d.summary);
    assert_eq!(d.verdict, Verdict::Explained, "{}", d.summary);
    let d = off(0.1);
    assert_eq!((d.verdict, d.effects.len()), (Verdict::Match, 0), "{}", d.summary);
}

#[test]
fn a_tone_near_half_the_rate_is_no_noise() {
    // Neighbouring readings differ by more than all that is left, and the tone was taken for noise.
    let mut hums = recording(&valve());
    let run = &mut hums.runs[0];
    for (p, t) in run.pressure_bar.iter_mut().flatten().zip(&run.time_s) {
        *p += 0.5 * (std::f64::consts::TAU * 46.3 * t).sin();
    }
    let found = diagnose_against(&hums, &valve(), &[another_drive(&valve())]).unwrap();
    let d = found.diagnosis;
    assert_eq!(d.effects.first().map(|f| f.id.as_str()), Some("periodic_disturbance"), "{}", d.summary);
    assert_eq!(found.augmented.effects.len(), 1, "in step with a sine: {}", d.summary);
    assert!((d.effects[0].parameters["frequency"].value - 46.3).abs() < 0.05, "{}", d.summary);
}

#[test]
fn a_droop_in_proportion_to_the_pressure_is_a_leak_before_it_is_the_gain_of_a_sensor() {
    let leaks = valve_with("leakage", &[0.4, 1.0, 0.0]);
    let d = diagnose_against(&recording(&leaks), &valve(), &[another_drive(&valve())]).unwrap().diagnosis;
    let first = d.effects.first().unwrap_or_else(|| panic!("{}", d.summary));
    assert_eq!((d.effects.len(), first.id.as_str(), first.claim), (1, "leakage", Claim::Changed), "{}", d.summary);
    assert!(first.indistinguishable.iter().any(|id| id == "sensor_gain"), "nothing tells them apart: {}", d.summary);
}

/// A drive in a closed loop: the current answers the pressure as it was read a sample before, and a tone that grows with the pressure
/// and whose pace wanders stands in it.
fn humming_in_a_loop() -> Recording {
    const AMPERE_PER_BAR: f64 = 0.006;
    let (time_s, ahead_a) = drive();
    let target = simulate(&valve(), Input::Held, &time_s, &ahead_a).unwrap();
    let mut random = rand_pcg::Pcg64::seed_from_u64(12);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let mut phase = 0.0;
    let besides: Vec<f64> = target
        .iter()
        .map(|p| {
            phase += std::f64::consts::TAU * 9.3 * 0.01 + 0.005 * normal.sample(&mut random);
            0.04 * p * phase.sin() + NOISE_BAR * normal.sample(&mut random)
        })
        .collect();
    let (mut current_a, mut pressure) = (ahead_a.clone(), target.clone());
    // Each pass is the loop once around; it loses most of what is wrong in it.
    for _ in 0..30 {
        for k in 1..current_a.len() {
            current_a[k] = ahead_a[k] + AMPERE_PER_BAR * (target[k] - pressure[k - 1]);
        }
        pressure = simulate(&valve(), Input::Held, &time_s, &current_a).unwrap().iter().zip(&besides).map(|(p, more)| p + more).collect();
    }
    let run = Run { time_s, current_a, pressure_bar: Some(pressure), ..Run::default() };
    Recording { source: "loop.csv".into(), runs: vec![run], notes: vec![], input: None }
}

#[test]
fn a_tone_that_a_controller_answers_is_no_hysteresis() {
    let d = diagnose_against(&humming_in_a_loop(), &valve(), &[another_drive(&valve())]).unwrap().diagnosis;
    let named: Vec<&str> = d.effects.iter().map(|f| f.id.as_str()).collect();
    assert_eq!(named, ["periodic_disturbance"], "{}", d.summary);
    let hz = d.effects[0].parameters["frequency"].value;
    assert!((hz - 9.3).abs() < 0.2, "{hz}");
}

#[test]
fn the_recording_of_an_identification_that_failed_excuses_nothing() {
    let (sweep, record) = (knocked(recording(&valve()), "sweep.csv", (1, 0.4)), knocked(recording(&valve()), "drive.csv", (2, 0.4)));
    let identified = Identification { recording: "sweep.csv".into(), sha256: Some("0".repeat(64)), ..Identification::default() };
    let model = Valve { identification: Some(identified), ..valve() };
    let d = diagnose_against(&record, &model, std::slice::from_ref(&sweep)).unwrap().diagnosis;
    assert_eq!(d.verdict, Verdict::Unexplained, "{}", d.summary);
    assert!(d.notes.iter().any(|n| n.contains("does not vouch for it")), "{:?}", d.notes);
    // Any other drive of the good valve says what is usual.
    let other = Recording { source: "good.csv".into(), ..sweep };
    let d = diagnose_against(&record, &model, std::slice::from_ref(&other)).unwrap().diagnosis;
    assert_eq!(d.verdict, Verdict::Match, "{}", d.summary);
}

#[test]
fn spoilt_readings_far_larger_than_the_good_valve_has_are_a_change() {
    let spoilt = |mut of: Recording, by_bar: f64| {
        for (k, p) in of.runs[0].pressure_bar.iter_mut().flatten().enumerate() {
            *p += if k % 97 == 50 { by_bar } else { 0.0 };
        }
        of
    };
    let good = [spoilt(another_drive(&valve()), 0.8)];
    let claim = |by_bar: f64| {
        let d = diagnose_against(&spoilt(recording(&valve()), by_bar), &valve(), &good).unwrap().diagnosis;
        let finding = d.effects.iter().chain(&d.form).find(|f| f.id == "sensor_outliers").map(|f| f.claim);
        finding.unwrap_or_else(|| panic!("{}", d.summary))
    };
    assert_eq!((claim(0.8), claim(4.0)), (Claim::Lacks, Claim::Changed));
}

#[test]
fn what_has_changed_behind_a_few_steps_is_not_hidden_by_all_the_readings_at_rest() {
    // A step every ten seconds, behind each of which the good valve rings as nothing in the model does.
    let levels = [0.35, 0.6, 0.45, 0.7, 0.4, 0.55, 0.3, 0.65, 0.5];
    let drive = |delay_s: f64, ringing: f64, seed: u64| {
        let mut of = valve();
        of.delay_s += delay_s;
        let time_s: Vec<f64> = (0..2 * levels.len() * 1000).map(|k| 0.01 * k as f64).collect();
        let current_a: Vec<f64> = (0..time_s.len()).map(|k| levels[(k / 1000 + seed as usize) % levels.len()]).collect();
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        let normal = Normal::new(0.0, NOISE_BAR).unwrap();
        let simulated = simulate(&of, Input::Held, &time_s, &current_a).unwrap();
        let pressure = simulated.iter().enumerate().map(|(k, p)| {
            let since_s = 0.01 * (k % 1000) as f64;
            let phase = ((k / 1000) * 7 % 5) as f64;
            p + 0.8 * ringing * (-since_s / 0.2).exp() * (20.0 * since_s + phase).sin() + normal.sample(&mut random)
        });
        let run = Run { pressure_bar: Some(pressure.collect()), time_s, current_a, ..Run::default() };
        Recording { source: format!("{seed}.csv"), runs: vec![run], notes: vec![], input: None }
    };
    let good = [drive(0.0, 1.0, 1)];
    let found = |delay_s: f64, ringing: f64| diagnose_against(&drive(delay_s, ringing, 4), &valve(), &good).unwrap().diagnosis;
    let as_ever = found(0.0, 1.0);
    assert_eq!((as_ever.verdict, as_ever.effects.len()), (Verdict::Match, 0), "{}", as_ever.summary);
    // Steps like those of its own data allow it less than another kind of drive would.
    assert_ne!(found(0.0, 3.0).verdict, Verdict::Match);
    for delay_s in [0.06, 0.1] {
        let late = found(delay_s, 1.0);
        let named = late.effects.iter().find(|f| f.id == "transport_delay" && f.claim == Claim::Changed);
        let extra_s = named.unwrap_or_else(|| panic!("{}", late.summary)).parameters["extra"].value;
        assert!((extra_s - delay_s).abs() < 0.01, "{}", late.summary);
    }
}

#[test]
fn a_zero_that_wanders_gets_no_name_that_wanders_otherwise() {
    let wandering = |seed: u64| {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        let step = Normal::new(0.0, 0.012).unwrap();
        let mut of = recording(&valve());
        let mut at_bar = 0.0;
        of.runs[0].pressure_bar.iter_mut().flatten().for_each(|p| {
            at_bar += step.sample(&mut random);
            *p += at_bar;
        });
        of
    };
    let good = [another_drive(&valve())];
    for seed in [1, 2, 4] {
        let found = diagnose_against(&wandering(seed), &valve(), &good).unwrap().diagnosis;
        assert_eq!((found.verdict, found.effects.len()), (Verdict::Unexplained, 0), "{seed}: {}", found.summary);
    }
}
