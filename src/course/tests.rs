//! What a recording becomes: gaps, grids, noise, refusals.

use super::*;
use crate::recording;
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};

fn course(text: &str) -> Course {
    Course::of(&Recording::from_csv(text, "x.csv", &[]).unwrap(), &Preparation::default()).unwrap()
}

fn of_run(time_s: Vec<f64>, current_a: Vec<f64>, pressure_bar: Vec<f64>, input: Input) -> Course {
    let run = recording::Run { time_s, current_a, pressure_bar: Some(pressure_bar), ..recording::Run::default() };
    let recording = Recording { source: "x".into(), runs: vec![run], notes: Vec::new(), input: None };
    Course::take(recording, &Preparation { input: Some(input), ..Preparation::default() }).unwrap()
}

/// A slow sweep with noise, read in steps and held as the case wants.
fn noisy(n: usize, sigma: f64, correlation: f64, step: f64, every: usize) -> Vec<f64> {
    let mut random = rand_pcg::Pcg64::seed_from_u64(11);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let mut coloured = 0.0;
    let mut last = 0.0;
    (0..n)
        .map(|k| {
            let t = k as f64 * 0.01;
            coloured = correlation * coloured + (1.0 - correlation * correlation).sqrt() * sigma * normal.sample(&mut random);
            let pressure = 10.0 + 8.0 * (0.3 * t).sin() + coloured;
            if k % every == 0 {
                last = if step > 0.0 { (pressure / step).round() * step } else { pressure };
            }
            last
        })
        .collect()
}

fn noise_of(pressure_bar: Vec<f64>) -> Noise {
    let n = pressure_bar.len();
    Noise::of(&[Run::even(None, 0.0, 0.01, vec![0.5; n], pressure_bar)])
}

#[test]
fn the_noise_is_found_whatever_the_sensor_does_to_it() {
    for (what, sigma, correlation, step, every) in [
        ("white", 0.05, 0.0, 0.0, 1),
        ("fine steps", 0.05, 0.0, 0.01, 1),
        ("steps as large as the noise", 0.05, 0.0, 0.05, 1),
        ("coarse steps", 0.02, 0.0, 0.1, 1),
        ("steps that hide the noise", 0.005, 0.0, 0.1, 1),
        ("memory", 0.05, 0.8, 0.0, 1),
        ("short memory", 0.05, 0.5, 0.0, 1),
        ("slow sensor", 0.05, 0.0, 0.0, 5),
        ("slow sensor in fine steps", 0.05, 0.0, 0.01, 4),
    ] {
        let noise = noise_of(noisy(20_000, sigma, correlation, step, every));
        let truth = (sigma * sigma + step * step / 12.0f64).sqrt();
        assert!((noise.bar / truth - 1.0).abs() < 0.1, "{what}: {noise:?}, true {truth}");
        assert_eq!(noise.renewed_every, every, "{what}");
        assert_eq!(noise.memory_s > 0.0, correlation > 0.0, "{what}: {noise:?}");
    }
}

#[test]
fn the_readings_of_any_sensor_are_judged_as_those_of_the_pressure_are() {
    let mut readings = noisy(20_000, 0.005, 0.0, 0.1, 1);
    assert!((Noise::deviation(&readings) / noise_of(readings.clone()).bar - 1.0).abs() < 1e-9);
    readings.iter_mut().step_by(3).for_each(|r| *r = f64::NAN);
    assert!((Noise::deviation(&readings) / noise_of(readings).bar - 1.0).abs() < 1e-9);
    assert_eq!(Noise::deviation(&[]), 0.0);
}

#[test]
fn a_ripple_and_a_moving_course_are_no_noise() {
    let ripple: Vec<f64> = noisy(20_000, 0.02, 0.0, 0.0, 1)
        .iter()
        .enumerate()
        .map(|(k, p)| p + 0.1 * (std::f64::consts::TAU * 0.08 * k as f64).sin())
        .collect();
    // What ripples within a few samples cannot be told from noise by neighbours; it is no memory of the noise.
    assert_eq!(noise_of(ripple).memory_s, 0.0);
    let steps: Vec<f64> =
        noisy(20_000, 0.02, 0.0, 0.0, 1).iter().enumerate().map(|(k, p)| p + if k / 100 % 2 == 0 { 0.0 } else { 5.0 }).collect();
    let noise = noise_of(steps);
    assert!((noise.bar / 0.02 - 1.0).abs() < 0.1, "{noise:?}");
}

#[test]
fn a_sensor_cut_at_zero_shows_its_noise_above() {
    let cut: Vec<f64> = noisy(20_000, 0.05, 0.0, 0.0, 1).iter().map(|p| (p - 8.0).max(0.0)).collect();
    let noise = noise_of(cut);
    assert!((noise.bar / 0.05 - 1.0).abs() < 0.1, "{noise:?}");
}

#[test]
fn a_long_gap_splits_and_the_time_goes_on() {
    let rows = |from: u32, to: u32, gap: f64| -> String {
        (from..to).map(|k| format!("{},{},{}\n", f64::from(k) * 0.01 + gap, f64::from(k % 7), k)).collect()
    };
    let course = course(&format!("time_s,current_a,pressure_bar\n{}{}", rows(0, 100, 0.0), rows(100, 160, 200.0)));
    assert_eq!(
        course.runs.iter().map(|r| (r.len(), r.readings(), r.origin.samples.clone())).collect::<Vec<_>>(),
        [(100, 100, 0..100), (60, 60, 100..160)]
    );
    assert!((course.runs[1].elapsed_s - 201.0).abs() < 1e-9 && course.runs[0].elapsed_s == 0.0);
    assert_eq!(course.ranges(), [0..100, 100..160]);
    assert!(course.notes.iter().any(|n| n.contains("1 long gap in the command, the longest 200.0100 s")), "{:?}", course.notes);
}

#[test]
fn a_short_gap_does_not_split_and_no_reading_is_lost() {
    let rows: String = (0..200).filter(|k| !(50..60).contains(k)).map(|k| format!("{},{},{k}\n", f64::from(k) * 0.01, k % 7)).collect();
    let course = course(&format!("time_s,current_a,pressure_bar\n{rows}"));
    assert_eq!((course.runs.len(), course.samples(), course.readings()), (1, 200, 190));
    assert!(course.runs[0].pressure_bar[50].is_nan() && course.runs[0].pressure_bar[60] == 60.0);
}

#[test]
fn two_rates_in_one_run_are_two_parts() {
    let fast = (0..300).map(|k| f64::from(k) * 0.01);
    let slow = (0..100).map(|k| 3.0 + f64::from(k));
    let again = (1..300).map(|k| 102.0 + f64::from(k) * 0.01);
    let time: Vec<f64> = fast.chain(slow).chain(again).collect();
    let n = time.len();
    let course = of_run(time, (0..n).map(|k| (k % 10) as f64).collect(), (0..n).map(|k| k as f64).collect(), Input::Held);
    assert_eq!(course.readings(), n);
    assert!(course.samples() < 2 * n, "{}", course.samples());
    let steps: Vec<f64> = course.runs.iter().map(|r| r.dt_s).collect();
    assert_eq!(steps, [0.01, 1.0, 0.01]);
}

#[test]
fn the_clock_does_not_matter() {
    let at = |start: f64| {
        let time = (0..500).map(|k| start + f64::from(k) * 0.01).collect();
        of_run(time, (0..500).map(|k| f64::from(k % 7)).collect(), vec![1.0; 500], Input::Held)
    };
    let zero = at(0.0);
    for start in [-86_400.0, 1.7e9, 12.34] {
        let moved = at(start);
        assert_eq!((moved.runs[0].dt_s, moved.runs[0].elapsed_s, moved.runs[0].len()), (0.01, 0.0, 500));
        assert_eq!(moved.runs[0].current_a, zero.runs[0].current_a);
    }
}

#[test]
fn a_reading_of_its_own_raster_is_compared_where_it_was_taken() {
    // The command every 10 ms, the pressure every 10 ms but 3 ms later: no cell is full.
    let (mut time, mut current, mut pressure) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..200 {
        let t = f64::from(k) * 0.01;
        time.extend([t, t + 0.003]);
        current.extend([t, f64::NAN]);
        pressure.extend([f64::NAN, 2.0 * (t + 0.003)]);
    }
    let course = of_run(time, current, pressure, Input::Ramp);
    let run = &course.runs[0];
    assert_eq!((course.runs.len(), run.readings()), (1, 200));
    assert!((run.dt_s - 0.01).abs() < 1e-9, "{}", run.dt_s);
    // A simulation of twice the current meets every reading.
    let mut simulated: Vec<f64> = run.current_a.iter().map(|i| 2.0 * i).collect();
    run.at_readings(&mut simulated);
    for (s, p) in simulated.iter().zip(&run.pressure_bar).take(run.len() - 1) {
        assert!((s - p).abs() < 1e-6, "{s} {p}");
    }
}

#[test]
fn messages_between_the_samples_act_for_the_part_that_is_left() {
    let course = of_run(vec![0.0, 0.01, 0.0225, 0.03, 0.04], vec![0.0, 1.0, 2.0, 3.0, 3.0], vec![0.0; 5], Input::Held);
    assert_eq!(course.runs[0].dt_s, 0.01);
    let current = &course.runs[0].current_a;
    assert!((current[2] - 1.75).abs() < 1e-9 && current[1] == 1.0 && current[3] == 3.0, "{current:?}");
}

#[test]
fn a_missing_command_is_held_or_a_line_and_a_rest_is_no_gap() {
    let text = "time_s,current_a,pressure_bar\n0,0.1,1\n0.01,,2\n0.02,0.3,3\n0.03,0.4,4\n";
    let recording = Recording::from_csv(text, "x.csv", &[]).unwrap();
    let of = |input| Course::of(&recording, &Preparation { input: Some(input), ..Preparation::default() }).unwrap();
    let held = of(Input::Held);
    assert_eq!(held.runs[0].current_a, [0.1, 0.1, 0.3, 0.4]);
    assert!((of(Input::Ramp).runs[0].current_a[1] - 0.2).abs() < 1e-12);
    // A logger that writes the command when it changes: the rest of 5 s is none without a command.
    let current =
        |k: usize| if k.is_multiple_of(100) || (300..400).contains(&k) || k >= 900 { (k.clamp(300, 400)) as f64 / 100.0 } else { f64::NAN };
    let logged = of_run((0..1000).map(|k| k as f64 * 0.01).collect(), (0..1000).map(current).collect(), vec![1.0; 1000], Input::Held);
    assert_eq!((logged.runs.len(), logged.readings()), (1, 1000));
}

#[test]
fn a_part_of_the_recording_can_be_selected() {
    let text: String =
        (0..300).map(|k| format!("{},{},{},{k}\n", if k < 150 { "a" } else { "b" }, f64::from(k % 150) * 0.01, k % 5)).collect();
    let recording = Recording::from_csv(format!("run,time_s,current_a,pressure_bar\n{text}"), "x.csv", &[]).unwrap();
    let of = |selection: Selection| Course::of(&recording, &Preparation { selection, ..Preparation::default() });
    let b = of(Selection { runs: vec!["b".into()], from_s: Some(0.5), to_s: Some(0.99) }).unwrap();
    assert_eq!((b.runs.len(), b.runs[0].len(), b.runs[0].pressure_bar[0]), (1, 50, 200.0));
    insta::assert_snapshot!(of(Selection { runs: vec!["c".into()], ..Selection::default() }).unwrap_err(), @"x.csv: no run `c`; there are: a, b");
    insta::assert_snapshot!(of(Selection { from_s: Some(7.0), ..Selection::default() }).unwrap_err(), @"x.csv: no sample lies in the stretch that was asked for; the recording goes from 0 s to 1.49 s");
}

#[test]
fn what_cannot_be_compared_is_refused_in_words() {
    let refused = |current: fn(f64) -> f64, pressure: fn(f64) -> f64| {
        let rows: String =
            (0..300).map(|k| f64::from(k) * 0.01).map(|t| format!("{t},{},{}\n", text(current(t)), text(pressure(t)))).collect();
        fn text(v: f64) -> String {
            if v.is_finite() { v.to_string() } else { String::new() }
        }
        course(&format!("time_s,current_a,pressure_bar\n{rows}")).carries(50).unwrap_err().to_string()
    };
    insta::assert_snapshot!(refused(|_| 0.5, |t| t), @"x.csv: the current is constant: it stays within 0.000000 A around 0.5000 A, so nothing shows how the pressure follows it; a sweep is wanted");
    insta::assert_snapshot!(refused(|t| t, |_| 5.0), @"x.csv: the pressure is constant: it stays within 0.0000 bar (noise 0.0000 bar) while the current moves; is the sensor alive, and is it this valve's?");
    insta::assert_snapshot!(refused(|t| t, |t| if t < 0.2 { t } else { f64::NAN }), @"x.csv: 20 samples with current and pressure; at least 50 are needed");
    insta::assert_snapshot!(refused(|t| if t < 1.0 { t } else { f64::NAN }, |t| if t < 2.0 { f64::NAN } else { t }), @"x.csv: current and pressure have no time in common: the current is recorded from 0 s to 0.99 s, the pressure from 2 s to 2.99 s; is one clock off?");
}
