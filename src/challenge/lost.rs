//! Hysteresis as a current that is lost on the way, which follows a law over the travel of the current.

use super::forms::LoopForm;

/// The lost current, between minus and plus the half width of the loop.
#[derive(Debug, Clone)]
pub(super) struct Lost {
    law: Law,
    half_width_a: f64,
    last_a: f64,
    lost_a: f64,
}

/// How the lost current `q`, relative to the half width, changes with the travel `s` [A] in the direction `d`.
#[derive(Debug, Clone)]
enum Law {
    /// P. Dahl (1968): `q' = (d - q) / l`.
    Dahl { length_a: f64 },
    /// Y. K. Wen (1976): `q' = (1 - |q|^n (beta sign(d q) + gamma)) / l`, beta + gamma = 1.
    BoucWen { length_a: f64, n: f64, beta: f64 },
    /// Branches `d tanh(s / l + c)`, continued from where the reversal left them.
    Tanh { length_a: f64 },
    /// B. D. Coleman and M. L. Hodgdon (1986): `B' = d a (f(H) - B) + g(H)`; here the lost part of it, with a pull
    /// that grows along the current.
    Duhem { length_a: f64, growth: f64 },
    /// C. Canudas de Wit et al. (1995): bristles `z' = v - |v| z / g(v)`, whose level falls with the speed.
    LuGre { length_a: f64, rise: f64, speed_a: f64 },
    /// D. C. Jiles and D. L. Atherton (1986): irreversible magnetisation by `M' = (M_an - M) / (d k - alpha (M_an - M))`,
    /// with Langevin's function as the state without pinning.
    JilesAtherton { pin_a: f64, alpha: f64, shape_a: f64, magnetised: f64 },
}

impl Lost {
    /// On the rising branch at `start_a`. The laws are longer than the loop is wide, or pressure would fall on a rising
    /// current.
    pub(super) fn new(form: LoopForm, half_width_a: f64, reach: f64, start_a: f64) -> Self {
        let length_a = half_width_a * (1.4 + reach);
        let law = match form {
            LoopForm::BoucWen => Law::BoucWen { length_a, n: 1.0 + reach, beta: 0.45 + 0.3 * reach },
            LoopForm::Tanh => Law::Tanh { length_a: 1.3 * length_a },
            LoopForm::Duhem => Law::Duhem { length_a, growth: 0.8 * reach },
            LoopForm::LuGre => Law::LuGre { length_a: 1.5 * length_a, rise: 0.35 * reach, speed_a: 0.0 },
            LoopForm::JilesAtherton => Law::JilesAtherton {
                pin_a: 1.8 * half_width_a * (1.0 + reach),
                alpha: 0.02,
                shape_a: 0.4,
                magnetised: langevin(start_a / 0.4),
            },
            _ => Law::Dahl { length_a },
        };
        Self { law, half_width_a, last_a: start_a, lost_a: half_width_a }
    }

    /// The lost current [A] after the input has moved on.
    pub(super) fn step(&mut self, current_a: f64) -> f64 {
        let travel = current_a - self.last_a;
        self.last_a = current_a;
        let (r, s, d) = (self.half_width_a, travel.abs(), if travel < 0.0 { -1.0 } else { 1.0 });
        if travel == 0.0 {
            return self.lost_a;
        }
        let q = self.lost_a / r;
        self.lost_a = r * match &mut self.law {
            Law::Dahl { length_a } => d + (q - d) * (-s / *length_a).exp(),
            Law::BoucWen { length_a, n, beta } => {
                let pull = *beta * (d * q).signum() + (1.0 - *beta);
                (q + d * s / *length_a * (1.0 - q.abs().powf(*n) * pull)).clamp(-1.0, 1.0)
            }
            Law::Tanh { length_a } => d * (s / *length_a + (d * q).clamp(-0.995, 0.995).atanh()).tanh(),
            Law::Duhem { length_a, growth } => {
                let length = *length_a * (1.0 + *growth * current_a.clamp(0.0, 1.0));
                d + (q - d) * (-s / length).exp()
            }
            Law::LuGre { length_a, rise, speed_a } => {
                // Stribeck: the level falls from 1 + rise at rest to 1; 5 mA of travel in one fine step is quick
                *speed_a += 0.05 * (s - *speed_a);
                let level = 1.0 + *rise * (-(*speed_a / 4e-5).powi(2)).exp();
                level * d + (q - level * d) * (-s / *length_a).exp()
            }
            Law::JilesAtherton { pin_a, alpha, shape_a, magnetised } => {
                let still = langevin(current_a / *shape_a);
                let miss = still - *magnetised;
                // walls move only the way the field goes
                if miss * d > 0.0 {
                    *magnetised += (s * miss * d / (*pin_a - *alpha * miss * d).max(1e-4)).min(miss.abs()) * d;
                }
                // the slope in the middle of the range: there the loop is as wide as drawn
                let slope = 0.24 / *shape_a;
                (still - *magnetised) / (slope * *pin_a)
            }
        };
        self.lost_a
    }
}

/// Langevin's function, `coth x - 1/x`.
fn langevin(x: f64) -> f64 {
    if x.abs() < 1e-3 { x / 3.0 } else { 1.0 / x.tanh() - 1.0 / x }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_law_opens_a_loop_near_its_width_and_never_runs_backwards() {
        for form in [LoopForm::Dahl, LoopForm::BoucWen, LoopForm::Tanh, LoopForm::Duhem, LoopForm::LuGre, LoopForm::JilesAtherton] {
            for reach in [0.7, 1.4] {
                let mut lost = Lost::new(form, 0.011, reach, 0.1);
                let leg = |lost: &mut Lost, from: f64, to: f64| -> Vec<f64> {
                    (1..=4000).map(|k| from + (to - from) * f64::from(k) / 4000.0).map(|i| i - lost.step(i)).collect()
                };
                let up = leg(&mut lost, 0.1, 0.9);
                assert!(up.windows(2).all(|w| w[1] > w[0] - 1e-12), "{form:?} falls on a rising current");
                let down = leg(&mut lost, 0.9, 0.1);
                assert!(down.windows(2).all(|w| w[1] < w[0] + 1e-12), "{form:?} rises on a falling current");
                let width = down[1999] - up[1999];
                assert!((0.008..0.04).contains(&width), "{form:?} {reach}: {width}");
            }
        }
    }
}
