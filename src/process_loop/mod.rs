//! A control loop that a slow recording shows: does its valve stick?
//!
//! The output of the controller moves the stem, the stem moves the process. Stem and process are identified together and held
//! against loops without friction, one step ahead and by their course, each on stretches that the fits have not seen.

#[cfg(test)]
mod bench;
mod feedback;
mod heldout;
mod joint;
mod oscillation;
mod regression;
mod rivals;
mod shape;
mod stick_slip;
mod symptoms;
#[cfg(test)]
mod tests;

pub use heldout::Comparison;
pub use oscillation::Oscillation;
pub use rivals::Besides;
pub use shape::{Process, Shape};
pub use stick_slip::{Motion, StickSlip};
pub use symptoms::Symptom;

use joint::Joint;
use rivals::Rivals;

/// Whether the output answers the process value: whether a controller closes the loop. As [`assess`] asks for it.
pub fn is_closed(value: &[f64], output: &[f64]) -> bool {
    let scaled = Scaled::of(value).zip(Scaled::of(output));
    value.len().min(output.len()) >= FEWEST
        && scaled.is_some_and(|(y, u)| !feedback::is_program(&u.values, range(&u.values)) && feedback::follows(&y.values, &u.values))
}

/// A recording with this step or a longer one shows a process rather than the valve in it [s].
pub const SLOW_STEP_S: f64 = 0.25;

/// Fewest samples.
const FEWEST: usize = 200;
/// Differences of the criterion: very strong (Kass and Raftery 1995), and twice that where the search through stems and orders is
/// paid for by no second kind of evidence.
const VERY_STRONG: f64 = 10.0;
const ALONE: f64 = 20.0;
/// A stem that breaks away less often over the record is no evidence.
const FEWEST_SLIPS: usize = 4;
/// The folds must agree on the band within this factor.
const BANDS_AGREE: f64 = 2.5;
/// Chance of the held-out gain.
const CONFIRMED: f64 = 0.05;
/// Share of the variance that the course with friction may leave: half an amplitude.
const FOLLOWS: f64 = 0.25;
/// Share of samples on either side that the range of the output leaves out.
const TAILS: f64 = 0.02;

/// What a closed loop shows.
#[derive(Debug, Clone)]
pub struct Assessment {
    /// How it oscillates, where it does [samples].
    pub oscillation: Option<Oscillation>,
    /// Friction against none, one step ahead [unit of the process value]; `None` where the record does not carry the fits.
    pub comparison: Option<Comparison>,
    /// Friction against none, by the course [square of the unit of the process value].
    pub shape: Option<Shape>,
    /// What the signals themselves say.
    pub symptoms: Vec<Symptom>,
    /// Width of the ellipse of process value over output [unit of the output].
    pub apparent: Option<f64>,
    /// The stem that sticks, and the process behind it; `None` where it is not shown to stick.
    pub stiction: Option<Stiction>,
    /// Why no name is given although friction would explain more, where it is so.
    pub withheld: Option<&'static str>,
}

/// A valve that was shown to stick, in the units of the record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stiction {
    /// The stem.
    pub stem: StickSlip,
    /// The band by the folds, least and most [unit of the output].
    pub bands: (f64, f64),
    /// Times that it broke away.
    pub slips: usize,
    /// The process behind it, of first order.
    pub process: Process,
}

/// Looks at a closed loop, sampled evenly; `None` where no controller shows itself. The output must be finite, values that are
/// missing are NaN.
pub fn assess(value: &[f64], output: &[f64]) -> Option<Assessment> {
    if value.len().min(output.len()) < FEWEST || value.iter().filter(|v| v.is_finite()).count() < FEWEST {
        return None;
    }
    let (y, u) = (Scaled::of(value)?, Scaled::of(output)?);
    let oscillation = oscillation::oscillation(&y.values);
    let period = oscillation.map(|o| o.period);
    let range = range(&u.values);
    if feedback::is_program(&u.values, range) {
        return None;
    }
    let comparison = heldout::compare(&Joint::of(&y.values, &u.values, range), &Rivals::of(&y.values, &u.values, period));
    let shape = shape::shape(&y.values, &u.values, range, period);
    let mut found = Assessment {
        oscillation,
        shape,
        symptoms: symptoms::symptoms(&y.values, &u.values, period),
        apparent: symptoms::apparent(&y.values, &u.values).map(|w| w * u.scale),
        stiction: None,
        withheld: None,
        comparison: None,
    };
    let stem = comparison.as_ref().map(|c| c.friction.hypothesis.stem);
    let process = stem.and_then(|stem| shape::process(&y.values, &u.values, stem));
    // The direction of the process is sure where it is the same behind a stem that sticks and behind one that does not.
    let free = stem.map(|stem| StickSlip { band: 0.0, jump: 0.0, ..stem });
    let plain = || free.and_then(|free| shape::process(&y.values, &u.values, free));
    let opposed = || [process, plain()].iter().all(|p| p.is_some_and(|p| feedback::opposes(&y.values, &u.values, p.gain)));
    if !feedback::follows(&y.values, &u.values) && !opposed() {
        return None;
    }
    let Some((mut comparison, stem)) = comparison.zip(stem) else { return Some(found) };
    let slips = stem.follow(&u.values, &mut Vec::new());
    let ahead = comparison.bic > ALONE && comparison.gain.0 > 0.0;
    let by_course = comparison.bic > VERY_STRONG
        && found.shape.as_ref().is_some_and(|s| s.p_value <= CONFIRMED && s.heldout.0 < s.heldout.1 && s.heldout.0 < FOLLOWS);
    found.withheld = if !(ahead || by_course) {
        None
    } else if resolution(&y.values) > comparison.rms.0 {
        Some("the process value was recorded in steps wider than what is left, and such steps look like slips")
    } else if slips < FEWEST_SLIPS {
        Some("the stem would have broken away too seldom to tell")
    } else if comparison.bands.1 > BANDS_AGREE * comparison.bands.0 {
        Some("parts of the record ask for bands that do not agree")
    } else {
        let at = |v: f64| v * u.scale;
        found.stiction = process.map(|p| {
            let gain = p.gain * y.scale / u.scale;
            Stiction {
                stem: StickSlip { band: at(stem.band), jump: at(stem.jump), ..stem },
                bands: (at(comparison.bands.0), at(comparison.bands.1)),
                slips,
                process: Process { gain, offset: y.mean + p.offset * y.scale - gain * u.mean, ..p },
            }
        });
        None
    };
    let scale = |(a, b): (f64, f64)| (a * y.scale, b * y.scale);
    if let Some(shape) = &mut found.shape {
        shape.heldout = (shape.heldout.0 * y.scale * y.scale, shape.heldout.1 * y.scale * y.scale);
    }
    (comparison.rms, comparison.heldout_rms) = (scale(comparison.rms), scale(comparison.heldout_rms));
    found.comparison = Some(comparison);
    Some(found)
}

/// A signal about its mean, in units of its standard deviation.
struct Scaled {
    values: Vec<f64>,
    mean: f64,
    scale: f64,
}

impl Scaled {
    fn of(values: &[f64]) -> Option<Self> {
        let finite = || values.iter().filter(|v| v.is_finite());
        let n = finite().count() as f64;
        let mean = finite().sum::<f64>() / n;
        let scale = (finite().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
        (scale > 1e-12 * mean.abs() && scale > 0.0).then(|| Self {
            values: values.iter().map(|v| (v - mean) / scale).collect(),
            mean,
            scale,
        })
    }
}

/// Range of a signal without its tails.
fn range(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted[(share * (sorted.len() - 1) as f64).round() as usize];
    at(1.0 - TAILS) - at(TAILS)
}

/// Smallest step between readings.
fn resolution(values: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 1e-9).fold(f64::INFINITY, f64::min)
}
