//! # Sensor missing codes
//!
//! What it is: a converter that never gives some of its codes: a bit that is stuck, a ladder that is off.
//!
//! Model: a pressure in one of the bands of `width` from `first` on, one every `period`, is read as that pressure plus
//! `shift`, below its band (a bit stuck at 0) or above it (at 1).
//!
//! Signature: bands, evenly spaced, in which no reading falls though the pressure passes them slowly, and cut off sharply;
//! where the pressure jumps by itself, the noise of the sensor blurs the edges.
//!
//! What to check on the bench: histogram of the raw codes over a slow ramp; the converter, its message.
//!
//! Source: IEEE Std 1241-2010, Terminology and Test Methods for Analog-to-Digital Converters (missing codes).

use super::block::{Block, Pointwise};
use super::effect::{Context, Effect, Kind, Parameter, Scatter, ScatterFinding, Stage, Theta};
use super::missing_codes::{Comb, comb};
use super::signal::Point;
use crate::units::PRESSURE;

/// The effect `sensor_missing_codes`.
pub struct SensorMissingCodes;

impl Effect for SensorMissingCodes {
    fn id(&self) -> &'static str {
        "sensor_missing_codes"
    }
    fn source_text(&self) -> &'static str {
        include_str!("sensor_missing_codes.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Sensor
    }
    fn kind(&self) -> Kind {
        Kind::Scatter
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 4] = [
            Parameter {
                name: "shift",
                unit: &PRESSURE,
                range: (-50.0, 50.0),
                starts: &[-0.5, 0.25],
                default: None,
                meaning: "what a reading in a band is off by",
            },
            Parameter { name: "width", unit: &PRESSURE, range: (1e-4, 50.0), starts: &[0.5], default: None, meaning: "width of a band" },
            Parameter {
                name: "period",
                unit: &PRESSURE,
                range: (2e-4, 100.0),
                starts: &[1.0, 2.0],
                default: None,
                meaning: "from the begin of a band to that of the next",
            },
            Parameter {
                name: "first",
                unit: &PRESSURE,
                range: (0.0, 100.0),
                starts: &[0.5],
                default: None,
                meaning: "where a band begins",
            },
        ];
        &PARAMETERS
    }
    fn restores(&self) -> bool {
        true
    }
    fn scatter(&self, of: &Scatter<'_>) -> Option<ScatterFinding> {
        let Comb { first_bar, period_bar, width_bar, error_bar, passages } = comb(of)?;
        let bands = |shift: f64| Bands { shift, width: width_bar, period: period_bar, first: first_bar };
        let off = |bands: &Bands| {
            let pairs = of.measured_bar.iter().zip(of.simulated_bar).filter(|(y, _)| y.is_finite());
            pairs.map(|(y, p)| (y - bands.read(*p)).abs()).sum::<f64>()
        };
        let bands = [bands(-width_bar), bands(width_bar)].into_iter().min_by(|a, b| off(a).total_cmp(&off(b)))?;
        Some(ScatterFinding {
            theta: vec![bands.shift, width_bar, period_bar, first_bar],
            std_errors: vec![error_bar; 4],
            gain_nats: passages as f64 * NATS,
            restored: restored(of, &bands),
            spread_bar: vec![0.0; of.measured_bar.len()],
            evidence: format!(
                "no reading lies in bands of {width_bar:.3} bar, one every {period_bar:.3} bar, though the pressure passes them slowly: {passages} times a reading stands on the one side and the next on the other"
            ),
            ..ScatterFinding::default()
        })
    }
    fn block(&self, theta: Theta<'_>, _: &Context) -> Block {
        Block::pointwise(Bands { shift: theta[0], width: theta[1], period: theta[2], first: theta[3] })
    }
}

/// A slow passage of a sound converter leaves four readings or more in a band: it leaves none with less than this chance [nats].
const NATS: f64 = 1.4;
/// Share of a band over which its edge is blurred by the noise of what is read.
const BLURRED: f64 = 0.05;

struct Bands {
    shift: f64,
    width: f64,
    period: f64,
    first: f64,
}

impl Bands {
    /// How far within a band a pressure stands, negative outside [bar].
    #[inline]
    fn within(&self, pressure: f64) -> f64 {
        let phase = (pressure - self.first).rem_euclid(self.period);
        if phase < 0.5 * (self.width + self.period) { phase.min(self.width - phase) } else { phase - self.period }
    }
    /// The reading of a pressure [bar].
    fn read(&self, pressure: f64) -> f64 {
        if self.within(pressure) > 0.0 { pressure + self.shift } else { pressure }
    }
}

impl Pointwise for Bands {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        input + self.shift * (0.5 + 0.5 * self.within(input) / (BLURRED * self.width)).clamp(0.0, 1.0)
    }
}

/// How much less than from reading to reading a distance from the simulated pressure counts: the model may be off.
const TRUSTED: f64 = 0.01;

/// The readings as the pressure was: of the two that each may have been, the course that goes from reading to reading as the
/// simulated pressure does (Viterbi, IEEE Trans. Inf. Theory 13 (1967) 260).
fn restored(of: &Scatter<'_>, bands: &Bands) -> Vec<f64> {
    let mut out = of.measured_bar.to_vec();
    let most = bands.width * bands.width;
    for run in of.runs {
        let read: Vec<usize> = run.clone().filter(|k| of.measured_bar[*k].is_finite()).collect();
        let may_be = |k: usize| [of.measured_bar[k], of.measured_bar[k] - bands.shift];
        let own = |k: usize, pressure: f64, state: usize| {
            let impossible = state == 1 && bands.within(pressure) < -0.1 * bands.width;
            if impossible { f64::INFINITY } else { TRUSTED * (pressure - of.simulated_bar[k]).powi(2).min(100.0 * most) }
        };
        let mut costs = [0.0, f64::INFINITY];
        let mut from: Vec<[usize; 2]> = Vec::with_capacity(read.len());
        for (n, k) in read.iter().copied().enumerate() {
            let here = may_be(k);
            let Some(before) = n.checked_sub(1).map(|n| read[n]) else {
                costs = [0, 1].map(|s| own(k, here[s], s));
                from.push([0, 1]);
                continue;
            };
            let (there, expected) = (may_be(before), of.simulated_bar[k] - of.simulated_bar[before]);
            let way = |s: usize, t: usize| costs[t] + (here[s] - there[t] - expected).powi(2).min(most);
            let best = [0, 1].map(|s| if way(s, 1) < way(s, 0) { 1 } else { 0 });
            let next = [0, 1].map(|s| way(s, best[s]) + own(k, here[s], s));
            from.push(best);
            costs = next;
        }
        let mut state = usize::from(costs[1] < costs[0]);
        for (k, best) in read.iter().zip(&from).rev() {
            out[*k] = may_be(*k)[state];
            state = best[state];
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};

    /// What is found where the sensor reads a pressure as told, with noise before and behind that, and how often what it gives back is off.
    fn look(
        pressure: impl Fn(f64) -> f64,
        (before_bar, behind_bar): (f64, f64),
        read: impl Fn(f64) -> f64,
    ) -> Option<(ScatterFinding, f64)> {
        let mut random = rand_pcg::Pcg64::seed_from_u64(3);
        let [before, behind] = [before_bar, behind_bar].map(|bar| Normal::new(0.0, bar).unwrap());
        let simulated_bar: Vec<f64> = (0..9000).map(|k| pressure(0.01 * f64::from(k))).collect();
        let sensed: Vec<f64> = simulated_bar.iter().map(|p| p + before.sample(&mut random)).collect();
        let measured_bar: Vec<f64> = sensed.iter().map(|p| read(*p) + behind.sample(&mut random)).collect();
        // A model that is off.
        let simulated_bar: Vec<f64> = simulated_bar.iter().map(|p| 1.004 * p + 0.05).collect();
        let runs = [0..4000, 4000..9000];
        let found = SensorMissingCodes.scatter(&Scatter {
            current_a: &simulated_bar,
            runs: &runs,
            ..Scatter::between(&measured_bar, &simulated_bar, before_bar.hypot(behind_bar))
        })?;
        let off = found.restored.iter().zip(&sensed).filter(|(a, b)| (*a - *b).abs() > 0.1 * found.theta[1]).count();
        Some((found, off as f64 / 9000.0))
    }

    /// Slow waves with quick steps between them.
    fn drive(t: f64) -> f64 {
        12.0 + 4.0 * (0.6 * t).sin() + if ((t / 15.0) as usize).is_multiple_of(2) { 3.0 } else { 0.0 }
    }

    #[test]
    fn a_bit_that_is_stuck_is_found_and_undone() {
        for (step, stuck_at_one) in [(0.5, false), (0.5, true), (0.2, false), (2.0, false)] {
            let bit = |p: f64| (p / step).floor().rem_euclid(2.0) == 1.0;
            let read = |p: f64| {
                if bit(p) == stuck_at_one {
                    p
                } else if stuck_at_one {
                    p + step
                } else {
                    p - step
                }
            };
            let (found, off) = look(drive, (0.02, 0.0), read).unwrap();
            let expected = if stuck_at_one { [step, step, 2.0 * step, 0.0] } else { [-step, step, 2.0 * step, step] };
            for (k, (value, expected)) in found.theta.iter().zip(expected).enumerate() {
                let away = (value - expected).abs();
                assert!(away.min((away - 2.0 * step).abs()) < 0.06 * step, "{k} of {:?} for {step} {stuck_at_one}", found.theta);
            }
            assert!(off < 0.01, "{off} of the readings with {step} {stuck_at_one}");
        }
    }

    #[test]
    fn codes_that_never_come_are_found_among_steps() {
        let code = |p: f64| (p / 0.11).floor();
        let read = |p: f64| 0.11 * if code(p).rem_euclid(8.0) == 7.0 { code(p) - 1.0 } else { code(p) };
        let (found, _) = look(drive, (0.02, 0.0), read).unwrap();
        assert!((found.theta[1] - 0.11).abs() < 0.02 && (found.theta[2] - 0.88).abs() < 0.02 && found.theta[0] < 0.0, "{:?}", found.theta);
        assert!(look(drive, (0.02, 0.0), |p| 0.11 * code(p)).is_none(), "steps alone");
        for step in [0.0244, 0.037, 0.15, 0.1125, 0.26] {
            let printed = |p: f64, digit: f64| (((p / step).floor() * step + 0.02) / digit).round() * digit;
            for digit in [0.1, 0.01] {
                let found = look(drive, (0.02, 0.0), |p| printed(p, digit));
                assert!(found.is_none(), "steps of {step} printed to {digit}: {:?}", found.map(|f| f.0.theta));
            }
        }
        assert!(look(drive, (0.02, 0.0), |p| p.floor()).is_none(), "coarse steps");
    }

    #[test]
    fn a_sound_sensor_lacks_no_code() {
        assert!(look(drive, (0.02, 0.0), |p| p).is_none());
        assert!(look(drive, (0.0, 1e-6), |p| p).is_none(), "without noise");
        let staircase = |t: f64| 5.0 + (t / 3.0).floor() % 8.0;
        assert!(look(staircase, (0.02, 0.0), |p| p).is_none(), "levels that the pressure steps between");
        assert!(look(|_| 12.0, (0.02, 0.0), |p| p).is_none(), "at rest");
        // A valve that snaps from seat to seat, which its model does not know: the noise blurs what it leaves out.
        let snaps = |p: f64| p + 0.5 * p.floor();
        for noise_bar in [0.05, 0.02, 0.01] {
            let found = look(drive, (0.0, noise_bar), snaps);
            assert!(found.is_none(), "a pressure that jumps by itself, with {noise_bar} bar of noise");
        }
    }
}
