//! The experiment that would separate two models which a recording cannot tell apart, and its plan.
//!
//! Both are simulated on a menu of stimuli; the one on which they differ most against the sensor noise is proposed
//! (Hunter and Reiner, Technometrics 7 (1965) 307: put the next point where the rivals' predictions differ most).

use std::fmt::Write;

use super::diagnosis::{Diagnosed, NextExperiment, Rival};
use super::stimuli::{limits, menu, sampled};
use super::words::title;
use crate::physics::simulate;
use crate::valve::{Input, Valve};

/// Time step of the simulations: the loop rate of a plan [s].
const STEP_S: f64 = 0.01;
/// A separation above this is seen in a record by eye.
const CLEAR_SIGMA: f64 = 3.0;
/// Part of the best separation that a shorter stimulus may lose.
const AS_GOOD: f64 = 0.9;

/// RMS difference of two simulations about its mean: an offset between valves and days separates nothing.
fn rms_difference(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len().max(1) as f64;
    let mean = a.iter().zip(b).map(|(a, b)| a - b).sum::<f64>() / n;
    (a.iter().zip(b).map(|(a, b)| (a - b - mean).powi(2)).sum::<f64>() / n).sqrt()
}

/// How far two models are apart on a current, in units of the noise; `None` where one of them cannot be simulated.
fn separation(rivals: (&Valve, &Valve), time_s: &[f64], current_a: &[f64], noise_bar: f64) -> Option<f64> {
    let first = simulate(rivals.0, Input::Held, time_s, current_a).ok()?;
    let second = simulate(rivals.1, Input::Held, time_s, current_a).ok()?;
    Some(rms_difference(&first, &second) / noise_bar.max(1e-6)).filter(|s| s.is_finite())
}

/// The experiment that separates what was found from its rival; `None` where there is none.
pub fn next_experiment(found: &Diagnosed) -> Option<NextExperiment> {
    let rival = found.rival.as_ref()?;
    let noise_bar = found.diagnosis.rmse_bar.noise_floor;
    let models = (&found.augmented, &rival.valve);
    let mut tried: Vec<(f64, _)> = menu(&found.augmented)
        .into_iter()
        .filter_map(|stimulus| {
            let (time_s, current_a) = sampled(&stimulus.points, STEP_S);
            Some((separation(models, &time_s, &current_a, noise_bar)?, stimulus))
        })
        .collect();
    let best = tried.iter().map(|t| t.0).fold(0.0, f64::max);
    if best <= 0.0 {
        return None;
    }
    // Of those that are about as good, the shortest.
    tried.retain(|t| t.0 >= AS_GOOD * best);
    tried.sort_by(|a, b| duration_s(&a.1.points).total_cmp(&duration_s(&b.1.points)));
    let (separation_sigma, stimulus) = tried.into_iter().next()?;
    let on_record_sigma = on_record(found, rival, noise_bar);
    let text = words(rival, stimulus.name, duration_s(&stimulus.points), separation_sigma, on_record_sigma);
    Some(NextExperiment {
        rivals: (rival.of.clone(), rival.id.clone()),
        stimulus: stimulus.name.into(),
        separation_sigma,
        text,
        table: stimulus.points,
    })
}

fn duration_s(points: &[(f64, f64)]) -> f64 {
    points.last().map_or(0.0, |p| p.0)
}

/// How far the rivals are apart on the recording itself: the largest over its runs.
fn on_record(found: &Diagnosed, rival: &Rival, noise_bar: f64) -> f64 {
    let curves = &found.curves;
    let ends = curves.runs.iter().skip(1).map(|r| r.0).chain([curves.time_s.len()]);
    curves
        .runs
        .iter()
        .zip(ends)
        .filter_map(|((from, _), to)| {
            separation((&found.augmented, &rival.valve), &curves.time_s[*from..to], &curves.current_a[*from..to], noise_bar)
        })
        .fold(0.0, f64::max)
}

fn words(rival: &Rival, stimulus: &str, duration_s: f64, sigma: f64, on_record_sigma: f64) -> String {
    let (first, second) = (title(&rival.of), title(&rival.id));
    let why = if rival.indistinguishable {
        format!("This recording cannot tell {first} from {second}: the two models differ by {on_record_sigma:.1} times the noise on it.")
    } else {
        format!("{second} comes next after {first}; the two models differ by {on_record_sigma:.1} times the noise on this recording.")
    };
    let so = if sigma >= CLEAR_SIGMA {
        format!("Drive {stimulus} ({duration_s:.0} s): there they differ by {sigma:.1} times the noise (RMS), enough to decide.")
    } else {
        format!(
            "The best of the stimuli tried is {stimulus} ({duration_s:.0} s), on which they differ by {sigma:.1} times the noise (RMS): repeat it and average, or measure elsewhere in the valve."
        )
    };
    format!("{why} {so}")
}

impl NextExperiment {
    /// Whether the rivals differ enough to be told apart by it.
    pub fn separates(&self) -> bool {
        self.separation_sigma >= CLEAR_SIGMA
    }

    /// The experiment as a plan for `hil run`. `model` is what the plan names as its valve, `valve` the model itself.
    pub fn plan(&self, model: &str, valve: &Valve) -> String {
        let quoted = |text: &str| toml::Value::from(text).to_string();
        let rest_a = limits(valve).0;
        let first_a = self.table.first().map_or(rest_a, |p| p.1);
        let mut out = String::from("schema = \"hil.plan/1\"\n");
        let _ = writeln!(out, "name = \"separate-{}-from-{}\"", self.rivals.0, self.rivals.1);
        let how = "Afterwards: hil diagnose RUN/trace.parquet --model VALVE, with the valve model as it was before the effect was added.";
        let _ = writeln!(out, "description = {}", quoted(&format!("{} {how}", self.text)));
        let _ = writeln!(out, "rate = \"100 Hz\"\nvalve = {}\nmodel = {}\n", quoted(model), quoted(model));
        let (_, top_bar) = valve.curves.pressure_range_bar();
        let _ = writeln!(out, "[interlocks]\nmax_pressure = \"{:.1} bar\"\n", 1.2 * top_bar + 3.0);
        let approach = if (first_a - rest_a).abs() > 1e-9 {
            format!("stimulus.ramp = {{ from = \"{rest_a:.4} A\", to = \"{first_a:.4} A\", over = \"2 s\" }}")
        } else {
            format!("stimulus.hold = {{ at = \"{rest_a:.4} A\", for = \"2 s\" }}")
        };
        let _ = writeln!(out, "[[setup]]\nname = \"approach\"\n{approach}\n\n[[setup]]\nname = \"settle\"");
        let _ = writeln!(out, "stimulus.hold = {{ at = \"{first_a:.4} A\", for = \"3 s\" }}\n\n[[phase]]\nname = \"{}\"", self.stimulus);
        let _ = writeln!(out, "stimulus.points = [");
        for (time_s, current_a) in &self.table {
            let _ = writeln!(out, "  [\"{time_s:.3} s\", \"{current_a:.4} A\"],");
        }
        let _ = writeln!(out, "]\n\n[[teardown]]\nname = \"release\"");
        let last_a = self.table.last().map_or(rest_a, |p| p.1);
        if (last_a - rest_a).abs() > 1e-9 {
            let _ = writeln!(out, "stimulus.ramp = {{ to = \"{rest_a:.4} A\", over = \"1 s\" }}");
        } else {
            let _ = writeln!(out, "stimulus.hold = {{ at = \"{rest_a:.4} A\", for = \"1 s\" }}");
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::diagnosis::Curves;
    use crate::plan::Plan;

    fn with(effect: &str) -> Valve {
        let text = std::fs::read_to_string("valves/paper.toml").unwrap();
        Valve::from_toml(&format!("{text}\n[[effect]]\n{effect}\n"), "test").unwrap()
    }

    fn found(first: (&str, &str), second: (&str, &str)) -> Diagnosed {
        let mut diagnosis = crate::diagnose::diagnosis::tests::nothing();
        diagnosis.rmse_bar.noise_floor = 0.02;
        let rival = Rival { of: first.0.into(), id: second.0.into(), valve: with(second.1), indistinguishable: true };
        Diagnosed { diagnosis, augmented: with(first.1), curves: Curves::default(), rival: Some(rival), recalibration: None }
    }

    #[test]
    fn a_creep_is_told_from_a_lag_by_a_stimulus_that_waits() {
        let case = found(("creep", "creep = { gain = \"3 %\", tau = \"8 s\" }"), ("sensor_lag", "sensor_lag = { tau = \"20 ms\" }"));
        let next = next_experiment(&case).unwrap();
        assert!(next.separation_sigma > 3.0, "{next:?}");
        let plan = next.plan("paper", &case.augmented);
        let plan = Plan::from_toml(&plan, "next.toml", std::path::Path::new("."), &[]).unwrap();
        plan.check_valve(&case.augmented).unwrap();
        assert!((plan.duration_s() - duration_s(&next.table) - 6.0).abs() < 0.05);
    }

    #[test]
    fn equal_models_have_no_experiment() {
        let same = ("sensor_lag", "sensor_lag = { tau = \"20 ms\" }");
        assert_eq!(next_experiment(&found(same, same)), None);
    }
}
