//! Frequency response from a sweep of a sine: gain and phase of the pressure over the input.
//!
//! The input is the target in closed loop, the current in open loop. Gain and phase are those of the averaged cross spectrum
//! over the averaged spectrum of the input (Welch's windows of Hann, half overlapped; J. S. Bendat, A. G. Piersol, "Random
//! Data", 4th ed., section 6.1: noise of the output averages out). The gain is relative to that at the lowest excited
//! frequencies; the phase is counted from the command, dead time included.

use std::f64::consts::PI;

use realfft::RealFftPlanner;
use realfft::num_complex::Complex64;
use serde::{Deserialize, Serialize};

use super::{Metric, Needs, NotMeasurable, Segment, enough};
use crate::units::{self, Unit};

/// Bandwidth by gain: the lowest frequency at which the amplitude of the pressure has fallen by 3 dB against that at the lowest
/// frequencies of the sweep.
///
/// # Source
/// ISO 10770-3, frequency response: frequency at -3 dB, by amplitude of the input. A plan has one phase per amplitude.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BandwidthGain {}

/// Bandwidth by phase: the lowest frequency at which the pressure lags the input by 90 deg, dead time included.
///
/// # Source
/// ISO 10770-3, frequency response: frequency at -90 deg, by amplitude of the input.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BandwidthPhase {}

/// One point of a frequency response.
#[doc(alias = "Bode")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response {
    /// Frequency [Hz].
    pub frequency_hz: f64,
    /// Gain against that at the lowest excited frequencies [dB].
    pub gain_db: f64,
    /// Phase against the input, without jumps [deg].
    pub phase_deg: f64,
}

/// Length of a window [s]: a resolution of 0.4 Hz.
const WINDOW_S: f64 = 2.5;
/// Share of the largest input spectrum below which a frequency counts as not excited.
const EXCITED: f64 = 0.02;
/// Share of the spectrum of the mean below which nothing but its rounding is seen: a millionth of a millionth of its amplitude.
const ROUNDING: f64 = 1e-24;
/// Number of the lowest excited frequencies that the gain is relative to.
const LOWEST: usize = 2;

/// Gain and phase over the excited frequencies.
pub fn frequency_response(segment: &Segment<'_>) -> Result<Vec<Response>, NotMeasurable> {
    let s = &segment.signals;
    let range = segment.range.clone();
    let closed = range.clone().all(|k| s.target_bar[k].is_finite());
    let input: Vec<f64> = if closed { s.target_bar[range.clone()].to_vec() } else { s.current_a[range.clone()].to_vec() };
    let usable = range.clone().filter(|k| s.pressure_bar[*k].is_finite()).count();
    enough(usable, range.len())?;
    let output = filled(&s.pressure_bar[range.clone()]);
    let period_s = (s.time_s[range.end - 1] - s.time_s[range.start]) / (range.len() - 1) as f64;
    let length = (WINDOW_S / period_s).round() as usize;
    if length < 8 || range.len() < 2 * length {
        return Err(NotMeasurable::TooShort { window_s: 2.0 * WINDOW_S });
    }
    let transform = RealFftPlanner::<f64>::new().plan_fft_forward(length);
    let hann: Vec<f64> = (0..length).map(|k| 0.5 - 0.5 * (2.0 * PI * k as f64 / length as f64).cos()).collect();
    let spectrum = |signal: &[f64]| {
        let mut windowed: Vec<f64> = signal.iter().zip(&hann).map(|(v, h)| v * h).collect();
        let mut out = transform.make_output_vec();
        // The lengths are those of the plan.
        let _ = transform.process(&mut windowed, &mut out);
        out
    };
    let (mut auto, mut cross) = (vec![0.0; length / 2 + 1], vec![Complex64::default(); length / 2 + 1]);
    let mut start = 0;
    while start + length <= input.len() {
        let (u, y) = (spectrum(&input[start..start + length]), spectrum(&output[start..start + length]));
        for (k, (u, y)) in u.iter().zip(&y).enumerate() {
            auto[k] += u.norm_sqr();
            cross[k] += y * u.conj();
        }
        start += length / 2;
    }
    // The two lowest lines hold what the taper makes of the mean, and the others what rounding leaves of it.
    let largest = auto[2..].iter().copied().fold(0.0, f64::max);
    let lines: Vec<usize> = (2..auto.len()).filter(|k| auto[*k] > EXCITED * largest).collect();
    if largest < ROUNDING * auto[0] || lines.len() <= LOWEST {
        return Err(NotMeasurable::NotReached { from_hz: 0.0, to_hz: 0.0, wanted: "exist" });
    }
    let gain = |k: usize| (cross[k] / auto[k]).norm();
    let reference = lines[..LOWEST].iter().map(|k| gain(*k)).sum::<f64>() / LOWEST as f64;
    let mut last = 0.0;
    Ok(lines
        .into_iter()
        .map(|k| {
            let angle = cross[k].arg();
            last = angle + 2.0 * PI * ((last - angle) / (2.0 * PI)).round();
            Response {
                frequency_hz: k as f64 / (length as f64 * period_s),
                gain_db: 20.0 * (gain(k) / reference).log10(),
                phase_deg: last.to_degrees(),
            }
        })
        .collect())
}

/// Lost samples on the straight line between their neighbours.
fn filled(values: &[f64]) -> Vec<f64> {
    let known: Vec<usize> = (0..values.len()).filter(|k| values[*k].is_finite()).collect();
    let mut out = values.to_vec();
    for pair in known.windows(2) {
        let gap = pair[1] - pair[0];
        for (k, value) in out[pair[0] + 1..pair[1]].iter_mut().enumerate() {
            let part = (k + 1) as f64 / gap as f64;
            *value = values[pair[0]] + part * (values[pair[1]] - values[pair[0]]);
        }
    }
    if let (Some(first), Some(last)) = (known.first(), known.last()) {
        out[..*first].fill(values[*first]);
        out[last + 1..].fill(values[*last]);
    }
    out
}

/// Where a figure of the response first falls below `level`, interpolated.
fn crossing(found: &[Response], level: f64, of: impl Fn(&Response) -> f64, wanted: &'static str) -> Result<f64, NotMeasurable> {
    match found.iter().position(|r| of(r) <= level) {
        None | Some(0) => {
            let (from_hz, to_hz) = (found[0].frequency_hz, found[found.len() - 1].frequency_hz);
            Err(NotMeasurable::NotReached { from_hz, to_hz, wanted })
        }
        Some(k) => {
            let (a, b) = (&found[k - 1], &found[k]);
            Ok(a.frequency_hz + (of(a) - level) / (of(a) - of(b)) * (b.frequency_hz - a.frequency_hz))
        }
    }
}

impl Metric for BandwidthGain {
    fn id(&self) -> &'static str {
        "bandwidth_gain"
    }
    fn unit(&self) -> &'static Unit {
        &units::FREQUENCY
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        "bandwidth_gain.minus_3_db.v1".into()
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        crossing(&frequency_response(segment)?, -3.0, |r| r.gain_db, "fall by 3 dB")
    }
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

impl Metric for BandwidthPhase {
    fn id(&self) -> &'static str {
        "bandwidth_phase"
    }
    fn unit(&self) -> &'static Unit {
        &units::FREQUENCY
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        "bandwidth_phase.minus_90_deg.v1".into()
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        crossing(&frequency_response(segment)?, -90.0, |r| r.phase_deg, "lag by 90 deg")
    }
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Columns, scatter};
    use super::*;

    /// A chirp from 0.5 to 25 Hz in 60 s.
    fn chirp(t: f64) -> f64 {
        0.5 + 0.05 * (2.0 * PI * (0.5 * t + 0.5 * 24.5 / 60.0 * t * t)).sin()
    }

    /// The chirp through a lag and a dead time, solved in steps of 0.1 ms.
    fn lagged(tau: f64, delay: f64, noise: f64) -> Columns {
        let mut state = 20.0;
        let mut samples = Vec::new();
        for k in 0..600_000 {
            if k % 100 == 0 {
                samples.push(state);
            }
            let input = 40.0 * chirp((f64::from(k) * 1e-4 - delay).max(0.0));
            state += (input - state) * 1e-4 / tau;
        }
        Columns::new(6000, |_| f64::NAN, chirp, |t| samples[(t * 100.0).round() as usize] + noise * scatter(t))
    }

    #[test]
    fn a_lag_with_dead_time_has_its_textbook_bandwidths() {
        for noise in [0.0, 0.05] {
            let columns = lagged(0.02, 0.01, noise);
            let segment = columns.segment(0.0);
            // -3 dB at 1/(2 pi tau); -90 deg where atan(w tau) + w T_d is a quarter turn.
            let gain = BandwidthGain {}.compute(&segment).unwrap();
            assert!((gain - 1.0 / (2.0 * PI * 0.02)).abs() < 0.25, "{noise}: {gain}");
            let phase = BandwidthPhase {}.compute(&segment).unwrap();
            let wanted = (0..40_000).map(|k| f64::from(k) * 1e-3).find(|f| {
                let w = 2.0 * PI * f;
                (w * 0.02).atan() + w * 0.01 >= 0.5 * PI
            });
            assert!((phase - wanted.unwrap()).abs() < 0.25, "{noise}: {phase} is not {wanted:?}");
        }
    }

    #[test]
    fn what_is_not_reached_has_no_figure() {
        let columns = lagged(0.001, 0.0, 0.0);
        assert!(matches!(BandwidthGain {}.compute(&columns.segment(0.0)), Err(NotMeasurable::NotReached { .. })));
        let short = Columns::new(300, |_| f64::NAN, chirp, chirp);
        assert_eq!(BandwidthGain {}.compute(&short.segment(0.0)), Err(NotMeasurable::TooShort { window_s: 5.0 }));
        // A command that stands still, whatever its last digit.
        for command in [0.0, 0.3, 0.5] {
            let still = Columns::new(3000, |_| f64::NAN, |_| command, |_| 20.1);
            let none = BandwidthGain {}.compute(&still.segment(0.0));
            assert!(matches!(none, Err(NotMeasurable::NotReached { wanted: "exist", .. })), "{none:?}");
        }
        // Of eight samples in a window something is seen, of seven nothing.
        for (period, samples) in [(0.32, 8), (0.36, 7)] {
            let mut slow = Columns::new(200, |_| f64::NAN, |t| chirp(t * 32.0), |t| chirp(t * 32.0));
            slow.time_s = (0..200).map(|k| period * f64::from(k)).collect();
            let refused = frequency_response(&slow.segment(0.0)) == Err(NotMeasurable::TooShort { window_s: 5.0 });
            assert_eq!(refused, samples < 8, "{samples}");
        }
    }

    /// By hand: 10 dB down in 2 Hz, the second half of it in half a hertz.
    #[test]
    fn a_level_is_crossed_between_two_lines() {
        let line = |(frequency_hz, gain_db)| Response { frequency_hz, gain_db, phase_deg: 0.0 };
        let found = [(1.0, 0.0), (2.0, -1.0), (2.5, -6.0), (3.0, -10.0)].map(line);
        assert_eq!(crossing(&found, -3.0, |r| r.gain_db, "fall"), Ok(2.2));
        let none = Err(NotMeasurable::NotReached { from_hz: 1.0, to_hz: 3.0, wanted: "fall" });
        assert_eq!([crossing(&found, -11.0, |r| r.gain_db, "fall"), crossing(&found, 0.0, |r| r.gain_db, "fall")], [none.clone(), none]);
    }

    /// Of 250 samples in 2.5 s each line is 0.4 Hz. The taper spreads a sine that lies on a line to its two neighbours and no further.
    #[test]
    fn a_sine_on_a_line_is_seen_there_and_beside_it() {
        let sine = |hz: f64| move |t: f64| 0.5 + 0.1 * (2.0 * PI * hz * t).sin();
        let seen = |hz: f64, samples: usize, scale: f64| {
            let columns = Columns::new(samples, |_| f64::NAN, |t| scale * sine(hz)(t), |t| 30.0 * scale * sine(hz)(t));
            frequency_response(&columns.segment(0.0))
        };
        for scale in [1.0, 1e3, 1e-3] {
            let found = seen(2.0, 500, scale).unwrap();
            let at: Vec<f64> = found.iter().map(|r| r.frequency_hz).collect();
            assert!(at.len() == 3 && at.iter().zip([1.6, 2.0, 2.4]).all(|(f, w)| (f - w).abs() < 1e-9), "{at:?}");
            assert!(found.iter().all(|r| r.gain_db.abs() < 1e-6 && r.phase_deg.abs() < 1e-6), "{found:?}");
        }
        // Two windows are needed; and of a sine on the first line only its upper neighbour is left, too few for a reference.
        assert!(matches!(seen(2.0, 499, 1.0), Err(NotMeasurable::TooShort { .. })));
        assert!(matches!(seen(0.4, 500, 1.0), Err(NotMeasurable::NotReached { .. })));
        // Its neighbours have a quarter of its power: those of a second sine are seen where a quarter is 2 % of the first.
        for (second, lines) in [(0.275f64, 4), (0.29, 6)] {
            let both = |t: f64| sine(2.0)(t) + second * (sine(4.0)(t) - 0.5);
            let columns = Columns::new(500, |_| f64::NAN, both, both);
            assert_eq!(frequency_response(&columns.segment(0.0)).unwrap().len(), lines, "{second}");
        }
        // Windows overlap by half: what comes in the second half of two is seen.
        let burst = |t: f64| if t < 2.5 { 0.5 } else { sine(2.0)(t) };
        let late = Columns::new(500, |_| f64::NAN, burst, burst);
        assert!(frequency_response(&late.segment(0.0)).is_ok());
    }

    /// A delay alone: the phase falls by 360 deg in each 1/T_d without a jump, and is -90 deg at 1/(4 T_d). The phase begins at 5 s.
    #[test]
    fn a_pure_delay_has_a_straight_phase() {
        let of = |delay: f64| Columns::new(6000, |_| f64::NAN, chirp, move |t| 40.0 * chirp(t - delay));
        let columns = of(0.1);
        let mut segment = columns.segment(0.0);
        segment.range = 500..5900;
        let found = frequency_response(&segment).unwrap();
        assert!(found.len() > 40 && found.last().unwrap().phase_deg < -700.0);
        for r in found.iter().filter(|r| (4.0..22.0).contains(&r.frequency_hz)) {
            assert!((r.frequency_hz / 0.4 - (r.frequency_hz / 0.4).round()).abs() < 1e-9);
            assert!((r.phase_deg + 360.0 * 0.1 * r.frequency_hz).abs() < 6.0 && r.gain_db.abs() < 2.0, "{r:?}");
        }
        // However often it has turned.
        let far = of(0.15);
        let found = frequency_response(&far.segment(0.0)).unwrap();
        assert!(found.windows(2).all(|w| (w[1].phase_deg - w[0].phase_deg).abs() < 120.0) && found[found.len() - 1].phase_deg < -1100.0);
        let short = of(0.02);
        let phase = BandwidthPhase {}.compute(&short.segment(0.0)).unwrap();
        assert!((phase - 12.5).abs() < 0.03, "{phase}");
    }

    #[test]
    fn lost_samples_lie_on_a_line_between_their_neighbours() {
        let lost = f64::NAN;
        assert_eq!(filled(&[lost, lost, 2.0, lost, lost, 8.0, 9.0, lost, 5.0, lost]), [2.0, 2.0, 2.0, 4.0, 6.0, 8.0, 9.0, 7.0, 5.0, 5.0]);
        assert!(filled(&[lost, lost]).iter().all(|v| v.is_nan()));
    }

    #[test]
    fn a_lost_sample_is_bridged() {
        let mut columns = lagged(0.02, 0.01, 0.0);
        let whole = BandwidthGain {}.compute(&columns.segment(0.0)).unwrap();
        for k in (0..6000).step_by(50) {
            columns.pressure[k] = f64::NAN;
        }
        assert!((BandwidthGain {}.compute(&columns.segment(0.0)).unwrap() - whole).abs() < 0.3);
    }
}
