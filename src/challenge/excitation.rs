//! What is commanded: the slow sweep of a calibration, and drives as a transmission would ask for them.

use rand::RngExt;
use rand_pcg::Pcg64;

use super::specimen::{PERIOD_S, uniform};

/// Triangles of 40 s between shrinking limits [A], 0.1..0.95 A first; 100 Hz, 200 s.
pub(super) fn sweep() -> Vec<f64> {
    let half = 2000;
    [(0.1, 0.95), (0.1, 0.95), (0.2, 0.838), (0.35, 0.775), (0.45, 0.705)]
        .into_iter()
        .flat_map(|(low, high): (f64, f64)| {
            let rate = (high - low) / f64::from(half);
            let up = (0..half).map(move |k| low + rate * f64::from(k));
            let down = (0..half).map(move |k| high - rate * f64::from(k));
            up.chain(down)
        })
        .collect()
}

/// A drive of `length_s`: shifts, dips to the empty clutch, holds, ramps, wobbles and small oscillations.
pub(super) fn drive(rng: &mut Pcg64, length_s: f64) -> Vec<f64> {
    let samples = (length_s / PERIOD_S).round() as usize;
    let mut pen = Pen { current_a: Vec::with_capacity(samples + 1000), at: 0.3 };
    let low = uniform(rng, 0.21, 0.225);
    let mut last = usize::MAX;
    while pen.current_a.len() < samples {
        let mut kind = rng.random_range(0..6);
        if kind == last {
            kind = (kind + 1) % 6;
        }
        last = kind;
        match kind {
            // shift up or down, with a hold
            0 | 1 => {
                let far = if rng.random::<bool>() { uniform(rng, 0.62, 0.82) } else { uniform(rng, 0.34, 0.52) };
                let seconds = uniform(rng, 0.15, 0.6);
                pen.ramp(far, seconds);
                let hold = uniform(rng, 0.4, 1.6);
                pen.hold(hold);
                if kind == 1 {
                    let (to, seconds, hold) = (uniform(rng, 0.62, 0.8), uniform(rng, 0.15, 1.0), uniform(rng, 1.5, 5.0));
                    pen.ramp(to, seconds);
                    pen.hold(hold);
                }
            }
            // empty the clutch and fill it again, in two steps
            2 => {
                let (fast, wait) = (uniform(rng, 0.2, 0.5), uniform(rng, 0.5, 1.1));
                pen.ramp(low, fast);
                pen.hold(wait);
                let (to, fast, wait) = (uniform(rng, 0.39, 0.55), uniform(rng, 0.2, 0.5), uniform(rng, 0.5, 1.0));
                pen.ramp(to, fast);
                pen.hold(wait);
                let (to, fast, wait) = (uniform(rng, 0.6, 0.78), uniform(rng, 0.2, 1.2), uniform(rng, 0.5, 3.0));
                pen.ramp(to, fast);
                pen.hold(wait);
            }
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
    pen.current_a.truncate(samples);
    pen.current_a
}

/// Draws a command, sample by sample.
struct Pen {
    current_a: Vec<f64>,
    at: f64,
}

impl Pen {
    fn ramp(&mut self, to: f64, seconds: f64) {
        let n = (seconds / PERIOD_S).ceil().max(1.0);
        let from = self.at;
        self.current_a.extend((1..=n as usize).map(|k| from + (to - from) * k as f64 / n));
        self.at = to;
    }
    fn hold(&mut self, seconds: f64) {
        self.current_a.extend(std::iter::repeat_n(self.at, (seconds / PERIOD_S) as usize));
    }
    fn oscillate(&mut self, amplitude: f64, hz: f64, cycles: f64) {
        let n = (cycles / hz / PERIOD_S) as usize;
        let at = self.at.clamp(0.38, 0.8);
        if at != self.at {
            self.ramp(at, 0.3);
        }
        self.current_a.extend((1..=n).map(|k| at + amplitude * (std::f64::consts::TAU * hz * k as f64 * PERIOD_S).sin()));
    }
}

#[cfg(test)]
mod tests {
    use super::super::specimen::stream;
    use super::*;

    #[test]
    fn the_sweep_lasts_200_s_within_its_limits() {
        let sweep = sweep();
        assert_eq!(sweep.len(), 20_000);
        assert!(sweep.iter().all(|i| (0.1..=0.95).contains(i)));
    }

    #[test]
    fn a_drive_covers_the_range_empties_the_clutch_and_holds() {
        for seed in 0..20 {
            let drive = drive(&mut stream(seed, 3), 120.0);
            assert_eq!(drive.len(), 12_000);
            let (low, high) = drive.iter().fold((9.0_f64, 0.0_f64), |(a, b), i| (a.min(*i), b.max(*i)));
            assert!(low < 0.36 && high > 0.62 && high < 0.9, "seed {seed}: {low} {high}");
            let held = drive.windows(2).filter(|w| w[0] == w[1]).count();
            assert!(held > 2000, "seed {seed}");
        }
    }
}
