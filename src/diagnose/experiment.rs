//! The experiment that would separate the models which a recording cannot tell apart, and its plan.
//!
//! All are simulated on a menu of stimuli; the one on which they differ most against the sensor noise, each pair by its
//! shares, is proposed (Hunter and Reiner, Technometrics 7 (1965) 307: put the next point where the rivals' predictions
//! differ most; for more than two: Box and Hill, Technometrics 9 (1967) 57).

use std::fmt::Write;

use super::diagnosis::{Diagnosed, NextExperiment, Open};
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

/// The models between which an experiment is to decide, with their shares: the chosen one first.
struct Between<'o> {
    models: Vec<(f64, &'o Valve)>,
    noise_bar: f64,
}

impl Between<'_> {
    /// How far each two models are apart on a current, in units of the noise, with the product of their shares; `None` where one
    /// cannot be simulated.
    fn separations(&self, time_s: &[f64], current_a: &[f64]) -> Option<Vec<Vec<(f64, f64)>>> {
        let simulated: Vec<Vec<f64>> =
            self.models.iter().map(|m| simulate(m.1, Input::Held, time_s, current_a).ok()).collect::<Option<_>>()?;
        let apart = |a: usize, b: usize| {
            let sigma = rms_difference(&simulated[a], &simulated[b]) / self.noise_bar.max(1e-6);
            sigma.is_finite().then_some((self.models[a].0 * self.models[b].0, sigma))
        };
        (0..simulated.len()).map(|a| (a + 1..simulated.len()).map(|b| apart(a, b)).collect()).collect()
    }
}

/// The part of the doubt that separations take away: a pair counts by its shares, and half where it is as far apart as is seen by eye.
fn decided(separations: &[Vec<(f64, f64)>]) -> f64 {
    let (mut taken, mut all) = (0.0, 0.0);
    for (weight, sigma) in separations.iter().flatten() {
        taken += weight * sigma * sigma / (sigma * sigma + CLEAR_SIGMA * CLEAR_SIGMA);
        all += weight;
    }
    if all > 0.0 { taken / all } else { 0.0 }
}

/// The experiment that takes away most of the doubt that a diagnosis leaves; `None` where there is none, or no stimulus helps.
pub fn next_experiment(found: &Diagnosed) -> Option<NextExperiment> {
    let open = found.open.as_ref()?;
    let models = std::iter::once((open.share, &found.augmented)).chain(open.rivals.iter().map(|r| (r.share, &r.valve))).collect();
    let between = Between { models, noise_bar: found.diagnosis.rmse_bar.noise_floor };
    let mut tried: Vec<_> = menu(&found.augmented)
        .into_iter()
        .filter_map(|stimulus| {
            let (time_s, current_a) = sampled(&stimulus.points, STEP_S);
            let separations = between.separations(&time_s, &current_a)?;
            // Were the noise white and all else known, a difference adds up as the root of the samples: what is not clear then never is.
            let reach = CLEAR_SIGMA / (time_s.len() as f64).sqrt();
            let is_seen = separations.iter().flatten().any(|(_, sigma)| *sigma >= reach);
            is_seen.then(|| (decided(&separations), separations, stimulus))
        })
        .collect();
    let best = tried.iter().map(|t| t.0).fold(0.0, f64::max);
    if best <= 0.0 {
        return None;
    }
    // Of those that are about as good, the shortest.
    tried.retain(|t| t.0 >= AS_GOOD * best);
    tried.sort_by(|a, b| duration_s(&a.2.points).total_cmp(&duration_s(&b.2.points)));
    let (_, separations, stimulus) = tried.into_iter().next()?;
    let of_chosen = separations.first()?;
    // Two lags in series are the same on every current: what such a pair leaves open, no experiment takes away.
    let told: Vec<(&str, f64)> = open.rivals.iter().map(|r| r.id.as_str()).zip(of_chosen.iter().map(|s| s.1)).collect();
    let separation_sigma =
        told.iter().map(|t| t.1).find(|s| *s >= CLEAR_SIGMA).or_else(|| told.iter().map(|t| t.1).max_by(f64::total_cmp))?;
    let text = words(open, &told, stimulus.name, duration_s(&stimulus.points));
    let rivals = open.named.iter().cloned().chain(open.rivals.iter().map(|r| r.id.clone())).collect();
    Some(NextExperiment { rivals, stimulus: stimulus.name.into(), separation_sigma, text, table: stimulus.points })
}

fn duration_s(points: &[(f64, f64)]) -> f64 {
    points.last().map_or(0.0, |p| p.0)
}

fn words(open: &Open, told: &[(&str, f64)], stimulus: &str, duration_s: f64) -> String {
    let listed = |ids: Vec<&str>| ids.into_iter().map(title).collect::<Vec<_>>().join(" or ");
    let all = listed(told.iter().map(|t| t.0).collect());
    let why = match &open.named {
        Some(named) => format!("This recording cannot tell {} from {all}.", title(named)),
        None => format!(
            "No effect carries what is left; of those that were tried, {all} {} nearest.",
            if told.len() == 1 { "comes" } else { "come" }
        ),
    };
    let sigma = |t: &(&str, f64)| format!("{:.1} times the noise from {}", t.1, title(t.0));
    let apart = told.iter().map(sigma).collect::<Vec<_>>().join(", ");
    let model = if open.named.is_some() { "the named one" } else { "the model without them" };
    let clear = told.iter().filter(|t| t.1 >= CLEAR_SIGMA).count();
    let so = match clear {
        0 => format!(
            "The best of the stimuli tried is {stimulus} ({duration_s:.0} s), where {model} is {apart} (RMS): repeat it and average, or measure elsewhere in the valve."
        ),
        n if n == told.len() => format!("Drive {stimulus} ({duration_s:.0} s): there {model} is {apart} (RMS), enough to decide."),
        _ => format!("Drive {stimulus} ({duration_s:.0} s): there {model} is {apart} (RMS), enough to decide a part of it."),
    };
    format!("{why} {so} Then diagnose both recordings together.")
}

impl NextExperiment {
    /// Whether it tells a rival from what was chosen.
    pub fn separates(&self) -> bool {
        self.separation_sigma >= CLEAR_SIGMA
    }

    /// The experiment as a plan for `hil run`. `model` is what the plan names as its valve, `valve` the model itself.
    pub fn plan(&self, model: &str, valve: &Valve) -> String {
        let quoted = |text: &str| toml::Value::from(text).to_string();
        let rest_a = limits(valve).0;
        let first_a = self.table.first().map_or(rest_a, |p| p.1);
        let mut out = String::from("schema = \"hil.plan/1\"\n");
        let _ = writeln!(out, "name = \"separate-{}\"", self.rivals.join("-from-"));
        let how =
            "Afterwards: hil diagnose RECORD RUN/trace.parquet --model VALVE, with the valve model as it was before the effect was added.";
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
    use crate::diagnose::diagnosis::{Curves, Rival};
    use crate::plan::Plan;

    fn with(effect: &str) -> Valve {
        let text = std::fs::read_to_string("valves/paper.toml").unwrap();
        Valve::from_toml(&format!("{text}\n[[effect]]\n{effect}\n"), "test").unwrap()
    }

    fn found(first: (&str, &str), others: &[(&str, &str)]) -> Diagnosed {
        let mut diagnosis = crate::diagnose::diagnosis::tests::nothing();
        diagnosis.rmse_bar.noise_floor = 0.02;
        let share = 1.0 / (others.len() + 1) as f64;
        let rivals = others.iter().map(|(id, effect)| Rival { id: (*id).into(), share, valve: with(effect) }).collect();
        let open = Some(Open { named: Some(first.0.into()), share, rivals });
        Diagnosed { diagnosis, augmented: with(first.1), curves: Curves::default(), open, recalibration: None, stands_apart: false }
    }

    const CREEP: (&str, &str) = ("creep", "creep = { gain = \"3 %\", tau = \"8 s\" }");
    const LAG: (&str, &str) = ("sensor_lag", "sensor_lag = { tau = \"20 ms\" }");
    const SAME_LAG: (&str, &str) = ("first_order_lag", "first_order_lag = { tau = \"20 ms\" }");

    #[test]
    fn a_creep_is_told_from_a_lag_by_a_stimulus_that_waits() {
        let case = found(CREEP, &[LAG]);
        let next = next_experiment(&case).unwrap();
        assert!(next.separation_sigma > 3.0, "{next:?}");
        let plan = next.plan("paper", &case.augmented);
        let plan = Plan::from_toml(&plan, "next.toml", std::path::Path::new("."), &[]).unwrap();
        plan.check_valve(&case.augmented).unwrap();
        assert!((plan.duration_s() - duration_s(&next.table) - 6.0).abs() < 0.05);
    }

    #[test]
    fn equal_models_have_no_experiment_and_nothing_open_has_none() {
        assert_eq!(next_experiment(&found(LAG, &[LAG])), None);
        assert_eq!(next_experiment(&Diagnosed { open: None, ..found(CREEP, &[LAG]) }), None);
        // Two lags of which no stimulus of the menu could ever say which it is.
        assert_eq!(next_experiment(&found(LAG, &[("first_order_lag", "first_order_lag = { tau = \"20.002 ms\" }")])), None);
    }

    #[test]
    fn the_whole_set_is_asked_about_and_what_stays_open_is_said() {
        let next = next_experiment(&found(LAG, &[SAME_LAG, CREEP])).unwrap();
        assert_eq!(next.rivals, ["sensor_lag", "first_order_lag", "creep"]);
        assert!(next.separates() && next.text.contains("enough to decide a part of it"), "{}", next.text);
        let alone = next_experiment(&found(LAG, &[CREEP])).unwrap();
        assert_eq!(alone.stimulus, next.stimulus, "what no stimulus separates moves nothing");
    }
}
