//! What a user must know about an identified model.

use super::fit::{Fit, Problem};
use super::parameters::Parameter;
use super::survey::Survey;
use super::windows::Taken;
use super::{HysteresisChoice, Options};
use crate::course::Course;
use crate::units::three_figures;
use crate::valve::Valve;

/// A valve's current lies below this; more is a duty or a percentage [A].
const LARGEST_CURRENT_A: f64 = 5.0;
/// Decimals that hold three figures of whatever is not zero.
const MOST_DECIMALS: i32 = 330;
/// A current that moves on by more than this share of its range until the pressure follows sweeps no loop.
const SWEEP: f64 = 0.2;
/// Fewer reversals do not carry the hyperbola.
const MIN_REVERSALS: usize = 2;

/// What is said of a slow recording in which a controller is at work.
pub(super) const CONTROLLED: &str = "this is a control loop: the current answers the pressure, and both move as the controller lets them. Loop width and delay of this model may be friction of the valve, and the phase of an oscillation; `hil diagnose` tells whether the valve sticks";

/// What was found and handled.
pub(super) fn notes(courses: &[Course], survey: &Survey, fit: &Fit, valve: &Valve) -> Vec<String> {
    let mut out: Vec<String> = courses.iter().flat_map(|c| c.notes.iter().cloned()).collect();
    let share = 100.0 * survey.steady as f64 / survey.samples.max(1) as f64;
    out.push(format!("{} of {} samples ({share:.0} %) are steady enough to lie on a static curve", survey.steady, survey.samples));
    match survey.outliers {
        0 => {}
        1 => out.push("1 sample stands alone, far from its neighbours, and was left out as an outlier".into()),
        n => out.push(format!("{n} samples stand alone, far from their neighbours, and were left out as outliers")),
    }
    if let Some(floor) = survey.floor_bar {
        let seen = survey.covered_a.0 > survey.recorded_a.0;
        let unseen = fit.shape.range_a.0;
        let from = match (seen, unseen < survey.covered_a.0) {
            (false, _) => String::new(),
            (true, false) => format!(" below {:.3} A: the curves begin there", survey.covered_a.0),
            (true, true) => format!(
                " below {:.3} A: the curves are seen from there on; down to {unseen:.3} A, hidden by the floor, they are their polynomials carried on",
                survey.covered_a.0
            ),
        };
        out.push(format!("the pressure stands at a floor of {floor:.3} bar{from}"));
    }
    if fit.shape.has_loop() {
        let late_s = valve.delay_s + valve.lag_s;
        let wide_a = 2.0 * survey.rate_a_per_s * late_s;
        let slope = fit.theta.get(1).map_or(0.0, |c| 2.0 * c / (fit.shape.range_a.1 - fit.shape.range_a.0));
        // Only a sweep that is slow beside the valve draws a loop that delay and lag widen.
        if wide_a < SWEEP * (survey.covered_a.1 - survey.covered_a.0) {
            out.push(format!(
                "the current moves at {:.4} A/s (median); delay and lag of {} would widen the loop by {} or {:.3} bar, which the model takes out",
                survey.rate_a_per_s,
                time(late_s),
                current(wide_a),
                wide_a * slope
            ));
        }
    }
    let runs: usize = courses.iter().map(|c| c.runs.len()).sum();
    if runs > 1 {
        out.push(format!("{runs} runs, each simulated from its own start"));
    }
    out
}

/// How a long recording was fitted.
pub(super) fn taken_note(courses: &[Course], problem: &Problem<'_>, taken: Taken) -> Option<String> {
    let samples: usize = courses.iter().map(Course::samples).sum();
    let fitted = problem.len();
    match taken {
        Taken::All => None,
        Taken::Every(every) => Some(format!("of {samples} samples, one of {every} was fitted at first, and all of them at the end")),
        Taken::Windows(_) => Some(format!(
            "of {samples} samples, {fitted} in {} windows were fitted that together show every current, direction and rate; the RMSE is that \
             of all samples",
            problem.segments.len()
        )),
    }
}

/// What the data cannot carry.
pub(super) fn warnings(
    problem: &Problem<'_>,
    survey: &Survey,
    fit: &Fit,
    parameters: &[Parameter],
    options: &Options,
    valve: &Valve,
) -> Vec<String> {
    let mut out = Vec::new();
    let error = |name: &str| parameters.iter().find(|p| p.name == name).map(|p| (p.value, p.std_error));
    let (low, high) = survey.covered_a;
    if let Some(level) = survey.ceiling_bar {
        out.push(format!(
            "the pressure stands at {level:.2} bar whatever the current above {high:.3} A (supply limit?): {} samples there were left out, and the curves hold up to {high:.3} A only",
            survey.on_ceiling
        ));
    }
    let slack = 0.01 * (survey.recorded_a.1 - survey.recorded_a.0);
    let floor_explains = survey.floor_bar.is_some() && survey.ceiling_bar.is_none() && high > survey.recorded_a.1 - slack;
    if (low > survey.recorded_a.0 + slack || high < survey.recorded_a.1 - slack) && !floor_explains {
        out.push(format!(
            "the current was recorded from {:.3} A to {:.3} A, but the curves are seen from {low:.3} A to {high:.3} A only; beyond, they continue as straight lines",
            survey.recorded_a.0, survey.recorded_a.1
        ));
    }
    let largest = survey.recorded_a.0.abs().max(survey.recorded_a.1.abs());
    if largest > LARGEST_CURRENT_A {
        out.push(format!(
            "the input reaches {largest:.1}, much for a current in A: a duty or a command in other units comes in by --map current_a=\"..\""
        ));
    }
    if !fit.shape.has_loop() && options.hysteresis != HysteresisChoice::None {
        out.push("rising and falling currents never meet at the same pressure in this recording (step tests?): no hysteresis could be identified, and the model has none; a slow sweep up and down shows it".into());
    }
    if fit.shape.has_loop() {
        if survey.reversals < MIN_REVERSALS {
            out.push(format!("{} reversal of the current: the parameter a of the hyperbola is hardly seen", survey.reversals));
        }
        if let Some((a, e)) = error("a")
            && e > 0.5 * a
        {
            let (a, e) = (figures(a), figures(e));
            out.push(format!("a = {a} bar^2 has a standard error of {e} bar^2: the recording does not carry it; minor loops would"));
        }
        let span = (high - low).max(f64::MIN_POSITIVE);
        let crossed = (0..=20).any(|k| {
            let i = low + span * f64::from(k) / 20.0;
            valve.curves.descending_at(i) < valve.curves.ascending_at(i) - 1e-6
        });
        if crossed {
            out.push("the fitted curves cross within the covered range: there is hardly any hysteresis; consider --hysteresis none".into());
        }
    }
    let half_step = 0.5 * problem.step_s();
    if let Some((delay, e)) = error("delay") {
        if 2.0 * e > half_step.max(0.005) {
            let why = if survey.steps > 0 {
                "the answer to a step is not quite a delay and a lag"
            } else {
                "at a constant rate delay and loop width trade places; steps, other rates or minor loops tell them apart"
            };
            out.push(format!("the delay of {} has a standard error of {}: {why}", time(delay), time(e)));
        }
        if delay >= problem.delay_max_s * 0.999 {
            out.push(format!("the delay stands at the longest that was searched, {:.3} s", problem.delay_max_s));
        }
    }
    if survey.steps == 0 {
        out.push(if fit.shape.lag {
            format!(
                "no steps of the current: delay and lag are hardly told apart; the recording shows their sum of {}",
                time(valve.delay_s + valve.lag_s)
            )
        } else {
            "no steps of the current: a lag cannot be told from a delay, and is contained in it; the interval of the delay holds for a valve without a lag".into()
        });
    }
    out
}

/// A time in the unit in which it is spoken of.
fn time(s: f64) -> String {
    if s.abs() < 1.0 { format!("{:.1} ms", 1e3 * s) } else { format!("{} s", figures(s)) }
}

/// A difference of currents, likewise.
fn current(a: f64) -> String {
    if a.abs() < 1.0 { format!("{:.2} mA", 1e3 * a) } else { format!("{} A", figures(a)) }
}

/// A value with three figures, however small.
fn figures(value: f64) -> String {
    three_figures(value, MOST_DECIMALS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_are_written_as_they_are_spoken_of() {
        assert_eq!([0.0237, 0.9994, 23.7713, 150.2].map(time), ["23.7 ms", "999.4 ms", "23.8 s", "150 s"]);
        assert_eq!([0.00491, 54.95456].map(current), ["4.91 mA", "55.0 A"]);
        assert_eq!([0.80148, 0.00012, 2035.54, 39_338.7, 0.0].map(figures), ["0.801", "0.000120", "2036", "39339", "0"]);
    }
}
