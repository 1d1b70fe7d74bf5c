//! Loops without friction: what an oscillation from tuning, from a curved valve or from a disturbance looks like.
//!
//! The process value follows the output itself, by a linear equation of any order up to eight (near its limit of stability such
//! a loop oscillates by itself), by one behind a curved characteristic, or by one with a periodic disturbance of any shape.
//!
//! Source: Jelali and Huang, Detection and Diagnosis of Stiction in Control Loops (2010), chapters 11 to 13; Karra and Karim,
//! Control Eng. Practice 17 (2009) 1405 (disturbances beside friction).

use rayon::prelude::*;

use super::regression::{FIRST, LONGEST_DELAY, Orders, Solved, Sums, Used};

/// Highest orders of the plain equation.
const HIGHEST: (usize, usize) = (8, 6);
/// Orders of the equations with something besides.
const BESIDES: [(usize, usize); 5] = [(1, 1), (2, 1), (2, 2), (4, 2), (4, 4)];
/// Harmonics of a periodic disturbance.
const HARMONICS: usize = 5;

/// What stands beside the linear equation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Besides {
    /// Nothing.
    Nothing,
    /// Square and cube of the output.
    Curve,
    /// A disturbance of this period [samples], with so many harmonics.
    Periodic(f64, usize),
}

/// One loop without friction, with the sums of its equation.
pub struct Rival {
    /// What stands beside it.
    pub besides: Besides,
    sums: Sums,
    parameters: usize,
}

/// All of them.
pub struct Rivals(Vec<Rival>);

impl Rivals {
    /// From process value and output, both centred and scaled; `period` of the oscillation, where there is one [samples].
    pub fn of(value: &[f64], output: &[f64], period: Option<f64>) -> Self {
        let delays = 1..=LONGEST_DELAY;
        let mut forms: Vec<(Orders, Besides)> = Vec::new();
        for delay in delays {
            for own in 1..=HIGHEST.0 {
                forms.extend((1..=HIGHEST.1).map(|input| (Orders { own, input, delay }, Besides::Nothing)));
            }
            for (own, input) in BESIDES {
                forms.push((Orders { own, input, delay }, Besides::Curve));
            }
        }
        if let Some(period) = period.and_then(|p| sharpened(value, p)) {
            for delay in [1, 2, 4, 7, 11, LONGEST_DELAY] {
                for (own, input) in BESIDES {
                    let orders = Orders { own, input, delay };
                    forms.extend((1..=HARMONICS).map(|h| (orders, Besides::Periodic(period, h))));
                }
            }
        }
        Self(forms.into_par_iter().map(|(orders, besides)| Rival::new(value, output, orders, besides)).collect())
    }

    /// The best on the blocks used.
    pub fn best(&self, used: &Used) -> Option<(&Rival, Solved, f64)> {
        let all = self.0.par_iter().filter_map(|rival| {
            let solved = rival.sums.solve(used)?;
            let bic = solved.bic(rival.parameters);
            Some((rival, solved, bic))
        });
        all.min_by(|a, b| a.2.total_cmp(&b.2))
    }
}

impl Rival {
    fn new(value: &[f64], output: &[f64], orders: Orders, besides: Besides) -> Self {
        let plain = orders.own + orders.input + 1;
        let more = match besides {
            Besides::Nothing => 0,
            Besides::Curve => 2,
            Besides::Periodic(_, harmonics) => 2 * harmonics,
        };
        let sums = Sums::over(value, plain + more, |t, row| {
            orders.regressors(value, output, t, row);
            match besides {
                Besides::Nothing => {}
                Besides::Curve => {
                    let u = output[t - orders.delay];
                    row.extend([u * u, u * u * u]);
                }
                Besides::Periodic(period, harmonics) => row.extend((1..=harmonics).flat_map(|h| {
                    let (sin, cos) = (std::f64::consts::TAU * h as f64 * t as f64 / period).sin_cos();
                    [sin, cos]
                })),
            }
        });
        Self { besides, sums, parameters: plain + more + 1 }
    }

    /// Sum of squared one-step errors on a block and its samples.
    pub fn error(&self, solved: &Solved, block: usize) -> (f64, f64) {
        self.sums.error(&solved.theta, block)
    }
}

/// The period about this one with which a periodic course takes most of the variance.
fn sharpened(value: &[f64], period: f64) -> Option<f64> {
    let left = |period: f64| {
        let sums = Sums::over(value, 2 * 3 + 1, |t, row| {
            row.push(1.0);
            row.extend((1..=3).flat_map(|h| {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(h) * t as f64 / period).sin_cos();
                [sin, cos]
            }));
        });
        sums.solve(&super::regression::ALL).map(|s| s.variance)
    };
    let span = (value.len() - FIRST) as f64;
    // Neighbouring periods lose a quarter of a turn over the record.
    let step = 0.25 * period / span;
    let tried = (-60..=60).map(|k| period * (1.0 + f64::from(k) * step)).filter(|p| *p > 4.0);
    tried.filter_map(|p| Some((p, left(p)?))).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(p, _)| p)
}
