//! The valve's static hysteresis in nine published forms, none of them the hyperbola of the model that is identified.
//!
//! Each turns the coil current into the current that the spool "feels", or into pressure, and keeps what it remembers.

use super::curve::Curve;
use super::forms::LoopForm;
use super::lost::Lost;
use super::reversals::Reversals;
use super::specimen::Specimen;

/// A play operator: the output follows the input with a clearance of `radius` on either side.
#[derive(Debug, Clone)]
pub(super) struct Play {
    pub(super) radius_a: f64,
    pub(super) output_a: f64,
}

impl Play {
    pub(super) fn new(radius_a: f64, start_a: f64) -> Self {
        Self { radius_a, output_a: start_a - radius_a }
    }
    pub(super) fn step(&mut self, input_a: f64) -> f64 {
        self.output_a = self.output_a.clamp(input_a - self.radius_a, input_a + self.radius_a);
        self.output_a
    }
}

/// State of the static hysteresis.
#[derive(Debug, Clone)]
pub(super) enum Memory {
    /// Gap of the pressure to the branch of the present direction [bar], decaying as `1/(1 + gap x travel / c)`.
    Reciprocal { half_width_a: f64, c_bar2: f64, last_a: f64, rising: bool, gap_bar: f64 },
    /// Weighted plays.
    Play { plays: Vec<(f64, Play)>, rest: f64 },
    /// The current that is lost on the way obeys a law over the travel.
    Lost(Lost),
    /// Everett's function over the stack of reversals.
    Preisach(Reversals),
}

impl Memory {
    /// On the rising branch at `start_a`.
    pub(super) fn new(valve: &Specimen, start_a: f64) -> Self {
        let r = valve.half_width_a;
        // gap right after a reversal [bar]; its square is the least c with which pressure never falls on a rising current
        let widest = 2.0 * r * valve.curve.steepest();
        match valve.hysteresis {
            LoopForm::Reciprocal => Self::Reciprocal {
                half_width_a: r,
                c_bar2: widest * widest * (0.4 + valve.reach),
                last_a: start_a,
                rising: true,
                gap_bar: 0.0,
            },
            LoopForm::Play => {
                // radii spread in equal ratios, weights so that the full loop is 2 r wide
                let radii: Vec<f64> = (0..7).map(|k| 0.003 * 1.75_f64.powi(k) * valve.reach.sqrt()).collect();
                let weights: Vec<f64> = radii.iter().map(|q| (-q / 0.03).exp()).collect();
                let width: f64 = radii.iter().zip(&weights).map(|(q, w)| q * w).sum();
                let scale = r / width;
                let rest = 1.0 - scale * weights.iter().sum::<f64>();
                Self::Play { plays: radii.iter().zip(&weights).map(|(q, w)| (w * scale, Play::new(*q, start_a))).collect(), rest }
            }
            LoopForm::Preisach => Self::Preisach(Reversals::new(r, valve.reach, start_a)),
            form => Self::Lost(Lost::new(form, r, valve.reach, start_a)),
        }
    }

    /// Pressure in equilibrium [bar] at the coil current [A].
    pub(super) fn step(&mut self, curve: &Curve, current_a: f64) -> f64 {
        match self {
            Self::Reciprocal { half_width_a, c_bar2, last_a, rising, gap_bar } => {
                let branch = |up: bool, i: f64| curve.pressure(if up { i - *half_width_a } else { i + *half_width_a });
                if current_a != *last_a {
                    let up = current_a > *last_a;
                    if up != *rising {
                        // same pressure, seen from the other branch
                        *gap_bar = branch(*rising, *last_a) + *gap_bar - branch(up, *last_a);
                        *rising = up;
                    }
                    let travel = (curve.pressure(current_a) - curve.pressure(*last_a)).abs();
                    *gap_bar /= 1.0 + gap_bar.abs() * travel / *c_bar2;
                    *last_a = current_a;
                }
                (branch(*rising, current_a) + *gap_bar).max(0.0)
            }
            Self::Play { plays, rest } => {
                let felt = plays.iter_mut().fold(*rest * current_a, |sum, (w, play)| sum + *w * play.step(current_a));
                curve.pressure(felt)
            }
            Self::Lost(lost) => curve.pressure(current_a - lost.step(current_a)),
            Self::Preisach(reversals) => curve.pressure(reversals.step(current_a)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::anatomy::Anatomy;
    use super::super::formulation::Formulations;
    use super::*;

    fn loop_of(valve: &Specimen, low: f64, high: f64) -> (f64, f64, bool) {
        let mut memory = Memory::new(valve, low);
        let mut at = |i: f64| memory.step(&valve.curve, i);
        let middle = 0.5 * (low + high);
        let n = 4000;
        let ramp = |a: f64, b: f64| (0..=n).map(move |k| a + (b - a) * f64::from(k) / f64::from(n));
        let mut seen = [0.0; 4];
        let mut monotone = true;
        for (leg, (a, b)) in [(low, high), (high, low), (low, high), (high, low)].into_iter().enumerate() {
            let mut last = None;
            for i in ramp(a, b) {
                let p = at(i);
                if let Some(q) = last {
                    monotone &= if b > a { p >= q - 1e-9 } else { p <= q + 1e-9 };
                }
                last = Some(p);
                if (i - middle).abs() < 0.5 * (high - low) / f64::from(n) {
                    seen[leg] = p;
                }
            }
        }
        (seen[2], seen[3], monotone)
    }

    #[test]
    fn falling_lies_above_rising_and_both_are_monotone() {
        for seed in 0..120 {
            let valve = Specimen::draw(seed, Anatomy::Blocks, Formulations::All);
            let (up, down, monotone) = loop_of(&valve, 0.1, 0.95);
            assert!(monotone, "seed {seed} {:?}", valve.hysteresis);
            assert!((0.5..2.2).contains(&(down - up)), "seed {seed} {:?}: {}", valve.hysteresis, down - up);
            let (inner_up, inner_down, _) = loop_of(&valve, 0.48, 0.52);
            assert!(inner_down - inner_up < down - up, "a minor loop is narrower");
        }
    }
}
