//! What is commanded: the slow sweep of a calibration, and drives as a transmission or a bench would ask for them.

use rand::RngExt;
use rand_pcg::Pcg64;

use super::chance::{normal, uniform};

/// Kind of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drive {
    /// Of everything: shifts, dips, ramps, modulation, corrections.
    Mixed,
    /// Shifts with holds, with dips to the empty clutch.
    Shifts,
    /// Oscillations about levels, 0.2 to 4 Hz.
    Oscillations,
    /// Steps between levels.
    Steps,
    /// A schedule: slow ramps and long holds.
    Schedule,
    /// Little excitation: a hold with few small moves.
    Poor,
    /// Levels by a bounded random walk.
    Walk,
    /// Several tones at once.
    Multisine,
    /// A cycle: smooth random demand, with idling between.
    Cycle,
}

impl Drive {
    /// The word of the truth file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mixed => "mixed",
            Self::Shifts => "shifts",
            Self::Oscillations => "oscillations",
            Self::Steps => "steps",
            Self::Schedule => "schedule",
            Self::Poor => "poor",
            Self::Walk => "walk",
            Self::Multisine => "multisine",
            Self::Cycle => "cycle",
        }
    }
}

/// Triangles of 40 s between shrinking limits [A], 0.1..0.95 A first; 200 s.
pub(super) fn sweep(period_s: f64) -> Vec<f64> {
    let half = (20.0 / period_s).round() as usize;
    [(0.1, 0.95), (0.1, 0.95), (0.2, 0.838), (0.35, 0.775), (0.45, 0.705)]
        .into_iter()
        .flat_map(|(low, high): (f64, f64)| {
            let rate = (high - low) / half as f64;
            let up = (0..half).map(move |k| low + rate * k as f64);
            let down = (0..half).map(move |k| high - rate * k as f64);
            up.chain(down)
        })
        .collect()
}

/// A drive of `length_s`, one command per `period_s`.
pub(super) fn drive(kind: Drive, rng: &mut Pcg64, length_s: f64, period_s: f64) -> Vec<f64> {
    let samples = (length_s / period_s).round() as usize;
    let mut pen = Pen { current_a: Vec::with_capacity(samples + 1000), at: 0.3, period_s };
    let low = uniform(rng, 0.21, 0.225);
    let mut last = usize::MAX;
    while pen.current_a.len() < samples {
        match kind {
            Drive::Mixed => mixed(&mut pen, rng, low, &mut last),
            Drive::Shifts => {
                let kind = rng.random_range(0..3);
                shift(&mut pen, rng, low, kind);
            }
            Drive::Oscillations => {
                let to = uniform(rng, 0.34, 0.8);
                pen.ramp(to, 0.5);
                let (amplitude, hz) = (uniform(rng, 0.01, 0.06), 0.2 * 20.0_f64.powf(rng.random::<f64>()));
                let cycles = rng.random_range(4..12);
                pen.oscillate(amplitude, hz, f64::from(cycles));
            }
            Drive::Steps => {
                let (to, wait) = (uniform(rng, 0.21, 0.85), uniform(rng, 0.5, 3.0));
                pen.ramp(to, 0.0);
                pen.hold(wait);
            }
            Drive::Schedule => {
                let (to, slow, wait) = (uniform(rng, 0.22, 0.85), uniform(rng, 3.0, 12.0), uniform(rng, 2.0, 8.0));
                pen.ramp(to, slow);
                pen.hold(wait);
            }
            Drive::Poor => {
                if pen.current_a.is_empty() {
                    let to = uniform(rng, 0.45, 0.65);
                    pen.ramp(to, 1.0);
                }
                let (to, slow, wait) =
                    ((pen.at + uniform(rng, -0.04, 0.04)).clamp(0.38, 0.75), uniform(rng, 0.3, 2.0), uniform(rng, 3.0, 12.0));
                pen.ramp(to, slow);
                pen.hold(wait);
            }
            Drive::Walk => {
                let (to, wait) = ((pen.at + 0.08 * normal(rng)).clamp(0.22, 0.85), uniform(rng, 0.05, 0.6));
                pen.ramp(to, wait);
            }
            Drive::Multisine => {
                let tones: Vec<(f64, f64)> = (0..8).map(|k| (0.07 * 1.7_f64.powi(k), uniform(rng, 0.0, std::f64::consts::TAU))).collect();
                pen.ramp(0.54, 0.5);
                let n = (30.0 / period_s) as usize;
                let at = |t: f64| {
                    0.54 + 0.055 * tones.iter().map(|(hz, phase)| (std::f64::consts::TAU * hz * t + phase).sin() - phase.sin()).sum::<f64>()
                };
                pen.current_a.extend((1..=n).map(|k| at(k as f64 * period_s).clamp(0.22, 0.86)));
                pen.at = at(n as f64 * period_s).clamp(0.22, 0.86);
            }
            Drive::Cycle => {
                let (to, wait) = (uniform(rng, 0.3, 0.82), uniform(rng, 0.8, 4.0));
                pen.glide(to, wait);
                if rng.random::<f64>() < 0.2 {
                    pen.glide(low, 0.8);
                    pen.hold(1.5);
                }
            }
        }
    }
    pen.current_a.truncate(samples);
    pen.current_a
}

/// One of six kinds, never the same twice.
fn mixed(pen: &mut Pen, rng: &mut Pcg64, low: f64, last: &mut usize) {
    let mut kind = rng.random_range(0..6);
    if kind == *last {
        kind = (kind + 1) % 6;
    }
    *last = kind;
    match kind {
        0..=2 => shift(pen, rng, low, kind),
        // slow ramp
        3 => {
            let (to, slow, wait) = (uniform(rng, 0.36, 0.8), uniform(rng, 2.0, 5.5), uniform(rng, 0.3, 1.5));
            pen.ramp(to, slow);
            pen.hold(wait);
        }
        // modulation of a slipping clutch
        4 => {
            let (amplitude, hz, cycles) = (uniform(rng, 0.01, 0.04), uniform(rng, 0.8, 3.2), rng.random_range(5..11));
            pen.oscillate(amplitude, hz, f64::from(cycles));
        }
        // small corrections
        _ => {
            for _ in 0..rng.random_range(4..10) {
                let to = (pen.at + uniform(rng, -0.06, 0.06)).clamp(0.33, 0.83);
                let seconds = uniform(rng, 0.25, 1.1);
                pen.ramp(to, seconds);
            }
        }
    }
}

/// A shift, a shift in two moves, or the clutch emptied and filled again in two steps.
fn shift(pen: &mut Pen, rng: &mut Pcg64, low: f64, kind: usize) {
    if kind == 2 {
        let (fast, wait) = (uniform(rng, 0.2, 0.5), uniform(rng, 0.5, 1.1));
        pen.ramp(low, fast);
        pen.hold(wait);
        let (to, fast, wait) = (uniform(rng, 0.39, 0.55), uniform(rng, 0.2, 0.5), uniform(rng, 0.5, 1.0));
        pen.ramp(to, fast);
        pen.hold(wait);
        let (to, fast, wait) = (uniform(rng, 0.6, 0.78), uniform(rng, 0.2, 1.2), uniform(rng, 0.5, 3.0));
        pen.ramp(to, fast);
        pen.hold(wait);
        return;
    }
    let far = if rng.random::<bool>() { uniform(rng, 0.62, 0.82) } else { uniform(rng, 0.34, 0.52) };
    let (seconds, hold) = (uniform(rng, 0.15, 0.6), uniform(rng, 0.4, 1.6));
    pen.ramp(far, seconds);
    pen.hold(hold);
    if kind == 1 {
        let (to, seconds, hold) = (uniform(rng, 0.62, 0.8), uniform(rng, 0.15, 1.0), uniform(rng, 1.5, 5.0));
        pen.ramp(to, seconds);
        pen.hold(hold);
    }
}

/// Draws a command, sample by sample.
struct Pen {
    current_a: Vec<f64>,
    at: f64,
    period_s: f64,
}

impl Pen {
    fn ramp(&mut self, to: f64, seconds: f64) {
        let n = (seconds / self.period_s).ceil().max(1.0);
        let from = self.at;
        self.current_a.extend((1..=n as usize).map(|k| from + (to - from) * k as f64 / n));
        self.at = to;
    }
    /// Half a cosine from level to level.
    fn glide(&mut self, to: f64, seconds: f64) {
        let n = (seconds / self.period_s).ceil().max(1.0);
        let from = self.at;
        self.current_a.extend((1..=n as usize).map(|k| from + (to - from) * 0.5 * (1.0 - (std::f64::consts::PI * k as f64 / n).cos())));
        self.at = to;
    }
    fn hold(&mut self, seconds: f64) {
        self.current_a.extend(std::iter::repeat_n(self.at, (seconds / self.period_s) as usize));
    }
    fn oscillate(&mut self, amplitude: f64, hz: f64, cycles: f64) {
        let n = (cycles / hz / self.period_s) as usize;
        let at = self.at.clamp(0.38, 0.8);
        if at != self.at {
            self.ramp(at, 0.3);
        }
        self.current_a.extend((1..=n).map(|k| at + amplitude * (std::f64::consts::TAU * hz * k as f64 * self.period_s).sin()));
    }
}

#[cfg(test)]
mod tests {
    use super::super::chance::stream;
    use super::super::formulation::{DRIVES, Formulations};
    use super::*;

    #[test]
    fn the_sweep_lasts_200_s_within_its_limits() {
        let sweep = sweep(0.01);
        assert_eq!(sweep.len(), 20_000);
        assert!(sweep.iter().all(|i| (0.1..=0.95).contains(i)));
    }

    #[test]
    fn a_mixed_drive_covers_the_range_empties_the_clutch_and_holds() {
        for seed in 0..20 {
            let drive = drive(Drive::Mixed, &mut stream(seed, 3), 120.0, 0.01);
            assert_eq!(drive.len(), 12_000);
            let (low, high) = drive.iter().fold((9.0_f64, 0.0_f64), |(a, b), i| (a.min(*i), b.max(*i)));
            assert!(low < 0.36 && high > 0.62 && high < 0.9, "seed {seed}: {low} {high}");
            let held = drive.windows(2).filter(|w| w[0] == w[1]).count();
            assert!(held > 2000, "seed {seed}");
        }
    }

    #[test]
    fn every_drive_keeps_its_length_at_every_rate_and_stays_within_the_valves_range() {
        for kind in Formulations::All.of(&DRIVES) {
            for rate_hz in [10.0, 100.0, 1000.0] {
                let drive = drive(kind, &mut stream(4, 3), 60.0, 1.0 / rate_hz);
                assert_eq!(drive.len(), (60.0 * rate_hz) as usize, "{kind:?} {rate_hz}");
                assert!(drive.iter().all(|i| (0.15..0.95).contains(i)), "{kind:?} {rate_hz}");
            }
        }
    }
}
