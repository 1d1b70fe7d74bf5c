//! Recordings that do not belong to the model: a wrong unit, a swapped channel, another run. No cause may be named.

use rand::RngExt;

use super::case::Case;
use super::chance::{normal, stream, uniform};
use super::session::{Session, record_session};

/// What has been done to a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Broken {
    /// Pressure multiplied: kPa, psi, MPa and the like for bar.
    PressureBy(f64),
    /// Current multiplied: mA, duty for A.
    CurrentBy(f64),
    /// Time in milliseconds.
    Milliseconds,
    /// The sign of the pressure or of the current.
    NegativePressure,
    /// The same of the current.
    NegativeCurrent,
    /// Pressure counted down from the top: a falling characteristic.
    Falling,
    /// Current and pressure changed places.
    Swapped,
    /// Time stands in the column of the current.
    TimeAsCurrent,
    /// Pressure of another run of the same valve.
    OtherRun,
    /// Pressure of another valve under the same currents, beyond what gain and zero can be.
    OtherValve,
    /// Pressure in random order.
    Shuffled,
    /// Noise instead of pressure.
    Noise,
    /// Pressure leads or follows by so many seconds.
    Shifted(f64),
    /// Time reversed.
    Backwards,
    /// A dead transmitter: constant, with a little noise.
    Dead,
    /// Nothing moves: an excitation of 0.1 mA.
    NoExcitation,
    /// A transmitter that rests at its end most of the time.
    Clipped,
    /// Random walk instead of pressure.
    Walk,
}

/// Everything that is done.
pub const BROKEN: [Broken; 26] = [
    Broken::PressureBy(10.0),
    Broken::PressureBy(14.504),
    Broken::PressureBy(100.0),
    Broken::PressureBy(1e5),
    Broken::PressureBy(0.1),
    Broken::PressureBy(0.0689),
    Broken::CurrentBy(1000.0),
    Broken::CurrentBy(100.0),
    Broken::CurrentBy(0.001),
    Broken::Milliseconds,
    Broken::NegativePressure,
    Broken::NegativeCurrent,
    Broken::Falling,
    Broken::Swapped,
    Broken::TimeAsCurrent,
    Broken::OtherRun,
    Broken::OtherValve,
    Broken::Shuffled,
    Broken::Noise,
    Broken::Shifted(-2.0),
    Broken::Shifted(3.0),
    Broken::Backwards,
    Broken::Dead,
    Broken::NoExcitation,
    Broken::Clipped,
    Broken::Walk,
];

impl Broken {
    /// The word of the truth file.
    pub fn name(self) -> String {
        match self {
            Self::PressureBy(by) => format!("pressure_by_{by}"),
            Self::CurrentBy(by) => format!("current_by_{by}"),
            Self::Shifted(by) => format!("shifted_by_{by}_s"),
            Self::Milliseconds => "time_in_ms".to_owned(),
            Self::NegativePressure => "pressure_negative".to_owned(),
            Self::NegativeCurrent => "current_negative".to_owned(),
            Self::Falling => "falling".to_owned(),
            Self::Swapped => "swapped".to_owned(),
            Self::TimeAsCurrent => "time_as_current".to_owned(),
            Self::OtherRun => "other_run".to_owned(),
            Self::OtherValve => "other_valve".to_owned(),
            Self::Shuffled => "shuffled".to_owned(),
            Self::Noise => "noise".to_owned(),
            Self::Backwards => "backwards".to_owned(),
            Self::Dead => "dead".to_owned(),
            Self::NoExcitation => "no_excitation".to_owned(),
            Self::Clipped => "clipped".to_owned(),
            Self::Walk => "walk".to_owned(),
        }
    }
}

/// The session of a case with its record broken; sweep, commissioning drive and second drive stay whole.
pub fn break_record(case: &Case, how: Broken) -> Session {
    let (mut session, _) = record_session(case);
    let rng = &mut stream(case.seed, 40);
    let run = &mut session.record;
    let mut p = run.pressure_bar.take().unwrap_or_default();
    match how {
        Broken::PressureBy(by) => p.iter_mut().for_each(|p| *p *= by),
        Broken::CurrentBy(by) => run.current_a.iter_mut().for_each(|i| *i *= by),
        Broken::Milliseconds => run.time_s.iter_mut().for_each(|t| *t *= 1000.0),
        Broken::NegativePressure => p.iter_mut().for_each(|p| *p = -*p),
        Broken::NegativeCurrent => run.current_a.iter_mut().for_each(|i| *i = -*i),
        Broken::Falling => {
            let top = p.iter().fold(0.0_f64, |m, p| m.max(*p));
            p.iter_mut().for_each(|p| *p = top - *p);
        }
        Broken::Swapped => std::mem::swap(&mut run.current_a, &mut p),
        Broken::TimeAsCurrent => run.current_a = run.time_s.clone(),
        Broken::OtherRun => p = fitted(session.holdout.pressure_bar.as_deref().unwrap_or_default(), p.len()),
        Broken::OtherValve => p.iter_mut().for_each(|p| *p = 0.02 * p.max(0.0).powi(2) + 3.0),
        Broken::Shuffled => {
            for k in (1..p.len()).rev() {
                p.swap(k, rng.random_range(0..=k));
            }
        }
        Broken::Noise => p.iter_mut().for_each(|p| *p = 12.0 + 5.0 * normal(rng)),
        Broken::Shifted(seconds) => {
            let by = (seconds * case.rate_hz).round() as isize;
            let last = p.len() as isize - 1;
            p = (0..p.len() as isize).map(|k| p[(k - by).clamp(0, last) as usize]).collect();
        }
        Broken::Backwards => p.reverse(),
        Broken::Dead => p.iter_mut().for_each(|p| *p = 5.0 + 0.005 * normal(rng)),
        Broken::NoExcitation => {
            let (i, bar) = (uniform(rng, 0.4, 0.7), uniform(rng, 8.0, 20.0));
            run.current_a.iter_mut().for_each(|x| *x = i + 1e-4 * (*x - 0.5));
            p.iter_mut().for_each(|p| *p = bar + case.noise_bar() * normal(rng));
        }
        Broken::Clipped => p.iter_mut().for_each(|p| *p = p.clamp(9.0, 9.6)),
        Broken::Walk => {
            let mut at = 12.0;
            p.iter_mut().for_each(|p| {
                at += 0.1 * normal(rng) - 0.005 * (at - 12.0);
                *p = at;
            });
        }
    }
    run.target_bar = None;
    run.pressure_bar = Some(p);
    session
}

/// As long as wanted, from the start again where it ends.
fn fitted(values: &[f64], length: usize) -> Vec<f64> {
    values.iter().copied().cycle().take(length).collect()
}
