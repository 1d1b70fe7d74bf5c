//! Known answers: data simulated from a known valve by `physics`, with noise of a known seed.

use std::collections::BTreeMap;

use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;

use super::*;
use crate::physics::simulate;
use crate::recording::Run;
use crate::valve::{Hysteresis, Input, Polynomial, ReferenceCurves, Valve};

const DT_S: f64 = 0.01;

fn valve(delay_s: f64, lag_s: f64) -> Valve {
    let curves =
        ReferenceCurves::new(Polynomial::new([-42.65, 92.5, -8.4, -2.03]), Polynomial::new([-40.01, 83.32, -1.3, -2.0]), (0.0, 1.0))
            .unwrap();
    Valve {
        name: "known".into(),
        source: "a test".into(),
        curves,
        hysteresis: Hysteresis::Hyperbolic { a_bar2: 0.5 },
        delay_s,
        delay_range_s: (delay_s, delay_s),
        lag_s,
        current_limits_a: (0.0, 1.0),
        floor_bar: Some(0.0),
        noise_bar: 0.03,
        effects: Vec::new(),
        identification: None,
    }
}

/// A path of straight lines through `(duration [s], current [A])`; a duration of 0 is a step.
fn path(from_a: f64, legs: &[(f64, f64)]) -> Vec<f64> {
    let mut out = vec![from_a];
    for (duration_s, to) in legs {
        let begin = out[out.len() - 1];
        let n = ((duration_s / DT_S).round() as usize).max(1);
        out.extend((1..=n).map(|k| begin + (to - begin) * k as f64 / n as f64));
    }
    out
}

/// Sweeps of shrinking amplitude with a step between them.
fn shrinking() -> Vec<f64> {
    path(0.1, &[(12.0, 0.95), (12.0, 0.15), (9.0, 0.85), (9.0, 0.3), (0.0, 0.5), (6.0, 0.75), (6.0, 0.4), (4.0, 0.65)])
}

fn recorded(valve: &Valve, current_a: Vec<f64>, seed: u64) -> Run {
    recorded_every(DT_S, valve, current_a, seed)
}

fn recorded_every(step_s: f64, valve: &Valve, current_a: Vec<f64>, seed: u64) -> Run {
    let time_s: Vec<f64> = (0..current_a.len()).map(|k| k as f64 * step_s).collect();
    let mut pressure = simulate(valve, Input::Ramp, &time_s, &current_a).unwrap();
    let (mut random, normal) = (Pcg64::seed_from_u64(seed), Normal::new(0.0, valve.noise_bar).unwrap());
    for p in &mut pressure {
        *p += normal.sample(&mut random);
    }
    Run { time_s, current_a, pressure_bar: Some(pressure), ..Run::default() }
}

fn recording(runs: Vec<Run>) -> Recording {
    Recording { source: "test.csv".into(), runs, notes: Vec::new(), input: Some(Input::Ramp) }
}

fn value(found: &Identified, name: &str) -> f64 {
    found.parameters.iter().find(|p| p.name == name).unwrap().value
}

#[test]
fn a_shrinking_sweep_gives_back_the_valve_that_made_it() {
    let truth = valve(0.0234, 0.0);
    let found = identify(&recording(vec![recorded(&truth, shrinking(), 1)]), &Options::default()).unwrap();
    assert!((value(&found, "delay") - 0.0234).abs() < 0.001, "{:?}", found.parameters);
    assert!((value(&found, "a") - 0.5).abs() < 0.1, "{:?}", found.parameters);
    assert_eq!(found.valve.lag_s, 0.0);
    assert_eq!(found.valve.floor_bar, Some(0.0));
    assert!((found.valve.noise_bar - 0.03).abs() < 0.002, "{}", found.valve.noise_bar);
    assert!((found.rmse_bar - 0.03).abs() < 0.002, "{}", found.rmse_bar);
    assert!(found.rmse_average_model_bar > 10.0 * found.rmse_bar);
    assert!(found.r2_ascending.unwrap() > 0.9999 && found.r2_descending.unwrap() > 0.9999);
    let curves = &found.valve.curves;
    for i in [0.25, 0.4, 0.6, 0.8, 0.93] {
        assert!((curves.ascending_at(i) - truth.curves.ascending_at(i)).abs() < 0.03, "{i}");
        assert!((curves.descending_at(i) - truth.curves.descending_at(i)).abs() < 0.03, "{i}");
    }
    assert_eq!(found.warnings, Vec::<String>::new());
}

#[test]
fn a_lag_is_found_beside_the_delay_where_there_are_steps() {
    let truth = valve(0.021, 0.035);
    let found = identify(&recording(vec![recorded(&truth, shrinking(), 2)]), &Options::default()).unwrap();
    assert!((found.valve.delay_s - 0.021).abs() < 0.002, "{:?}", found.parameters);
    assert!((found.valve.lag_s - 0.035).abs() < 0.003, "{:?}", found.parameters);
}

#[test]
fn nine_of_ten_intervals_of_95_percent_hold_the_truth() {
    // Every parameter of every repetition; an interval that is too narrow fails this, as does a bias.
    let truth = valve(0.0234, 0.02);
    let above = path(0.15, &[(6.0, 0.95), (6.0, 0.2), (4.0, 0.8), (0.0, 0.5), (3.0, 0.7), (3.0, 0.45)]);
    let above = covered(&truth, &above, 60, f64::NEG_INFINITY);
    // Turns below the floor, which the pressure does not show, with a sensor that is cut at zero and one that is not.
    let truth = valve(0.0234, 0.0);
    let dips = [covered(&truth, &shrinking(), 60, f64::NEG_INFINITY), covered(&truth, &triangle(0.06), 60, 0.0)];
    assert!(share(&dips, "") >= 0.9, "{dips:?}");
    let all = share(&[&[above][..], &dips].concat(), "");
    assert!(all >= 0.9, "{all}");
    // And not by intervals that hold everything.
    assert!(all <= 0.995, "{all}");
}

#[test]
fn the_interval_of_the_delay_holds_the_truth_on_a_plain_triangle() {
    // Only the turns tell the delay from the width of the loop there, and they fall between two samples. A sensor of
    // little noise shows the smallest bias, the usual one how well the loss between two samples is followed.
    let mut quiet = valve(0.0234, 0.0);
    quiet.noise_bar = 0.003;
    let triangles = [
        covered(&valve(0.0234, 0.0), &triangle(0.06), 60, f64::NEG_INFINITY),
        covered(&valve(0.0215, 0.0), &triangle(0.25), 60, f64::NEG_INFINITY),
        covered(&quiet, &triangle(0.06), 40, f64::NEG_INFINITY),
    ];
    for counts in &triangles {
        assert!(share(std::slice::from_ref(counts), "delay") >= 0.9, "{triangles:?}");
        assert!(share(std::slice::from_ref(counts), "") >= 0.9, "{triangles:?}");
    }
}

/// Two plain triangles between `low_a` and 0.98 A.
fn triangle(low_a: f64) -> Vec<f64> {
    path(low_a, &[(12.0, 0.98), (12.0, low_a), (12.0, 0.98), (12.0, low_a)])
}

/// Of how many 95 % intervals of each parameter how many hold the truth.
type Counts = BTreeMap<String, (usize, usize)>;

/// The share of intervals that hold the truth, of the parameters whose names begin with `of`.
fn share(counts: &[Counts], of: &str) -> f64 {
    let (inside, all) =
        counts.iter().flatten().filter(|(name, _)| name.starts_with(of)).fold((0, 0), |sum, (_, c)| (sum.0 + c.0, sum.1 + c.1));
    inside as f64 / all as f64
}

/// The intervals of seeded repetitions.
fn covered(truth: &Valve, current: &[f64], repetitions: u64, cut_bar: f64) -> Counts {
    let options = Options { order: Some(3), ..Options::default() };
    let mut counts = Counts::new();
    for seed in 0..repetitions {
        let mut run = recorded(truth, current.to_vec(), 100 + seed);
        run.pressure_bar.iter_mut().flatten().for_each(|p| *p = p.max(cut_bar));
        let found = identify(&recording(vec![run]), &options).unwrap();
        let (up, down) = (&truth.curves.ascending.coefficients, &truth.curves.descending.coefficients);
        let mut known: Vec<(String, f64)> =
            (0..4).flat_map(|k| [(format!("ascending_c{}", 3 - k), up[k]), (format!("descending_c{}", 3 - k), down[k])]).collect();
        known.extend([("a".into(), 0.5), ("delay".into(), truth.delay_s)]);
        if truth.lag_s > 0.0 {
            known.push(("lag".into(), truth.lag_s));
        }
        for (name, expected) in known {
            let p = found.parameters.iter().find(|p| p.name == name).unwrap_or_else(|| panic!("no {name}"));
            let count = counts.entry(name).or_default();
            count.0 += usize::from((p.value - expected).abs() <= 1.96 * p.std_error);
            count.1 += 1;
        }
    }
    counts
}

#[test]
fn step_tests_alone_give_a_model_without_hysteresis_that_says_so() {
    let truth = valve(0.04, 0.05);
    let run = |level: f64, seed: u64| {
        let mut run = recorded(&truth, path(0.0, &[(0.2, 0.0), (0.0, level), (2.0, level), (0.0, 0.0), (0.6, 0.0)]), seed);
        run.name = Some(format!("step to {level}"));
        run
    };
    let runs = [0.4, 0.5, 0.6, 0.7].into_iter().zip(1..).map(|(level, seed)| run(level, seed)).collect();
    let found = identify(&recording(runs), &Options::default()).unwrap();
    assert_eq!(found.valve.hysteresis, Hysteresis::None);
    assert!(found.warnings.iter().any(|w| w.contains("no hysteresis could be identified")), "{:?}", found.warnings);
    assert!((found.valve.delay_s - 0.04).abs() < 0.004 && (found.valve.lag_s - 0.05).abs() < 0.005, "{:?}", found.parameters);
    assert!((found.valve.curves.average_at(0.6) - truth.curves.ascending_at(0.6)).abs() < 0.3);
}

#[test]
fn a_drive_without_any_sweep_is_enough() {
    // Sums of sines wander over the range with reversals everywhere, as a controller's output does.
    let truth = valve(0.02, 0.0);
    let current = (0..6000)
        .map(|k| {
            let t = k as f64 * DT_S;
            0.5 + 0.2 * (0.31 * t).sin() + 0.12 * (1.3 * t + 1.0).sin() + 0.05 * (4.1 * t).sin() + 0.002 * (60.0 * t).sin()
        })
        .collect();
    let found = identify(&recording(vec![recorded(&truth, current, 3)]), &Options::default()).unwrap();
    assert!((found.valve.delay_s + found.valve.lag_s - 0.02).abs() < 0.002, "{:?}", found.parameters);
    assert!((value(&found, "a") - 0.5).abs() < 0.2, "{:?}", found.parameters);
    assert!((found.rmse_bar - 0.03).abs() < 0.003, "{}", found.rmse_bar);
}

/// No reading of the ramps of twenty seconds stands still; those of a slow one at the top do, and those on the floor.
#[test]
fn ramps_of_which_a_slow_logger_leaves_few_readings_show_their_curves() {
    let truth = valve(0.0234, 0.0);
    let sweep = path(0.1, &[(2.0, 0.95), (2.0, 0.1), (2.0, 0.95), (2.0, 0.1), (0.0, 0.75), (2.0, 0.9), (2.0, 0.75)]);
    let levels = [0.9, 0.8, 0.7, 0.85, 0.75, 0.92, 0.72].map(|level| [(0.0, level), (0.4, level)]);
    let runs = [sweep, path(0.75, &levels.concat())].map(|current_a| recorded_every(0.1, &truth, current_a, 3));
    for runs in [runs[..1].to_vec(), runs.to_vec()] {
        let found = identify(&recording(runs), &Options::default()).unwrap();
        assert!(found.rmse_bar < 1.1 * truth.noise_bar, "{}", found.quality.why);
        assert!((value(&found, "delay") - 0.0234).abs() < 0.001, "{:?}", found.parameters);
        let curves = &found.valve.curves;
        for i in [0.25, 0.4, 0.6, 0.8] {
            assert!((curves.ascending_at(i) - truth.curves.ascending_at(i)).abs() < 0.06, "{i}");
        }
    }
}

#[test]
fn some_minutes_of_a_fast_logger_keep_their_turns() {
    let truth = valve(0.0234, 0.0);
    let outer = [(200.0, 0.95), (200.0, 0.1)].repeat(2);
    let inner = [(0.2, 0.838), (0.35, 0.775), (0.45, 0.705)].map(|(low, high)| [(0.0, low), (200.0, high), (200.0, low)]);
    let legs = [outer, inner.concat()].concat();
    let found = identify(&recording(vec![recorded_every(0.001, &truth, path(0.1, &legs), 4)]), &Options::default()).unwrap();
    assert!(found.notes.iter().any(|n| n.contains("one of 4 was fitted at first")), "{:?}", found.notes);
    assert!((value(&found, "delay") - 0.0234).abs() < 0.0005, "{:?}", found.parameters);
    assert!(found.rmse_bar < 1.05 * truth.noise_bar, "{}", found.quality.why);
}

#[test]
fn a_flat_top_stays_out_of_the_curves() {
    let truth = valve(0.02, 0.0);
    let mut run = recorded(&truth, shrinking(), 4);
    for p in run.pressure_bar.as_mut().unwrap() {
        *p = p.min(25.0);
    }
    let found = identify(&recording(vec![run]), &Options::default()).unwrap();
    assert!(found.warnings[0].contains("stands at 25.0"), "{:?}", found.warnings);
    assert!(found.valve.curves.range_a.1 < 0.8, "{:?}", found.valve.curves.range_a);
    assert!((found.valve.curves.ascending_at(0.6) - truth.curves.ascending_at(0.6)).abs() < 0.05);
    assert!(found.rmse_fitted_bar < 0.04 && found.rmse_bar > 0.5);
}

#[test]
fn single_wild_samples_are_left_out_and_counted() {
    let truth = valve(0.02, 0.0);
    let mut run = recorded(&truth, shrinking(), 5);
    for p in run.pressure_bar.as_mut().unwrap().iter_mut().skip(50).step_by(97) {
        *p += 7.0;
    }
    let found = identify(&recording(vec![run]), &Options::default()).unwrap();
    assert!(found.notes.iter().any(|n| n.contains("left out as outliers")), "{:?}", found.notes);
    assert!((found.valve.delay_s - 0.02).abs() < 0.001 && found.rmse_fitted_bar < 0.032, "{:?}", found.parameters);
}

#[test]
fn gaps_hold_the_current_and_never_count_as_zero() {
    let truth = valve(0.02, 0.0);
    let mut run = recorded(&truth, shrinking(), 6);
    for p in run.pressure_bar.as_mut().unwrap().iter_mut().step_by(7) {
        *p = f64::NAN;
    }
    let found = identify(&recording(vec![run]), &Options::default()).unwrap();
    assert!((found.valve.delay_s - 0.02).abs() < 0.001 && found.rmse_bar < 0.032, "{} {:?}", found.rmse_bar, found.parameters);
}

#[test]
fn a_long_recording_is_fitted_in_windows_and_judged_whole() {
    let truth = valve(0.02, 0.0);
    let sweep = shrinking();
    let current: Vec<f64> = (0..70_000).map(|k| if k % 20_000 < 8_000 { sweep[(k % 20_000).min(sweep.len() - 1)] } else { 0.6 }).collect();
    let found = identify(&recording(vec![recorded(&truth, current, 7)]), &Options::default()).unwrap();
    assert!(found.notes.iter().any(|n| n.starts_with("of 70000 samples")), "{:?}", found.notes);
    assert!(
        (found.valve.delay_s - 0.02).abs() < 0.001 && (found.rmse_bar - 0.03).abs() < 0.003,
        "{} {:?}",
        found.rmse_bar,
        found.parameters
    );
}

#[test]
fn what_cannot_be_identified_is_refused() {
    let n = 200;
    let run = |current_a: Vec<f64>, pressure_bar: Option<Vec<f64>>| {
        let time_s = (0..current_a.len()).map(|k| k as f64 * DT_S).collect();
        recording(vec![Run { time_s, current_a, pressure_bar, ..Run::default() }])
    };
    let refused = |r: &Recording| identify(r, &Options::default()).unwrap_err().to_string();
    insta::assert_snapshot!(refused(&run(vec![0.5; n], Some(vec![20.0; n]))), @"test.csv: the current is constant: it stays within 0.000000 A around 0.5000 A, so nothing shows how the pressure follows it; a sweep is wanted");
    insta::assert_snapshot!(refused(&run(vec![0.5; n], None)), @r#"test.csv: no `pressure_bar` to work with; a foreign channel comes in by `--map pressure_bar="CHANNEL [unit]"`"#);
    insta::assert_snapshot!(refused(&run((0..n).map(|k| k as f64 * 0.005).collect(), Some(vec![20.0; n]))), @"test.csv: the pressure is constant: it stays within 0.0000 bar (noise 0.0000 bar) while the current moves; is the sensor alive, and is it this valve's?");
    insta::assert_snapshot!(refused(&run(vec![0.1, 0.2], Some(vec![1.0, 2.0]))), @"test.csv: 2 samples with current and pressure; at least 50 are needed");
    let order = Options { order: Some(40), ..Options::default() };
    let error = identify(&run(vec![0.5; n], None), &order).unwrap_err();
    insta::assert_snapshot!(error.to_string(), @"--order: 40 is not allowed; 1 to 9 are");
}

#[test]
fn a_percentage_taken_for_a_current_is_warned_of() {
    let truth = valve(0.02, 0.0);
    let mut run = recorded(&truth, shrinking(), 8);
    for i in &mut run.current_a {
        *i *= 100.0;
    }
    let found = identify(&recording(vec![run]), &Options::default()).unwrap();
    assert!(found.warnings.iter().any(|w| w.contains("--map current_a")), "{:?}", found.warnings);
}

#[test]
fn the_written_model_reads_back_and_the_same_input_gives_the_same_bytes() {
    let recording = recording(vec![recorded(&valve(0.02, 0.0), shrinking(), 9)]);
    let text = identify(&recording, &Options::default()).unwrap().valve.to_toml();
    assert_eq!(identify(&recording, &Options::default()).unwrap().valve.to_toml(), text);
    let back = Valve::from_toml(&text, "back.toml").unwrap();
    assert_eq!(back.to_toml(), text);
    assert!(back.identification.unwrap().parameters.contains_key("delay"));
}
