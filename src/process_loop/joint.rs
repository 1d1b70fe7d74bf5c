//! Friction and process identified together: a stem that sticks and slips in front of a linear equation.
//!
//! Band and jump are searched on a grid and then by steps that halve; for each the linear part is solved exactly.
//!
//! Source: Srinivasan, Rengaswamy, Narasimhan and Miller, Ind. Eng. Chem. Res. 44 (2005) 6719; Jelali, J. Process Control 18
//! (2008) 632; Lee, Ren and Huang in Jelali and Huang (2010), chapter 12.

use rayon::prelude::*;

use super::regression::{LONGEST_DELAY, Orders, Solved, Sums, Used};
use super::stick_slip::StickSlip;

/// Bands that are tried, as shares of the output's range: from, to, how many.
const BANDS: (f64, f64, usize) = (0.02, 1.25, 22);
/// Jumps that are tried, as shares of the band.
const JUMPS: [f64; 7] = [0.0, 0.1, 0.25, 0.45, 0.65, 0.85, 1.0];
/// Orders of the screening and of the end.
const SCREEN: (usize, usize) = (4, 2);
const ORDERS: [(usize, usize); 9] = [(1, 1), (2, 1), (2, 2), (3, 2), (4, 2), (4, 4), (6, 2), (8, 2), (8, 4)];
/// Parameters of the friction: band, jump, motion.
const FRICTION: usize = 3;
/// Candidates that are refined.
const REFINED: usize = 4;
/// First and last step of the refinement, relative.
const STEPS: (f64, f64) = (0.08, 0.008);

/// Steps of the profile over the band, relative, and how many of them down and up.
const FINE: f64 = 0.01;
const PROFILE: (i32, i32) = (-30, 15);
/// Scatter of the band from slip to slip that is allowed for [steps of the profile].
const SCATTER: usize = 4;

/// A stem in front of a linear equation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hypothesis {
    /// The stem.
    pub stem: StickSlip,
    /// The equation from its position to the process value.
    pub orders: Orders,
}

/// A hypothesis that was fitted.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// What was fitted.
    pub hypothesis: Hypothesis,
    /// The coefficients.
    pub solved: Solved,
    /// Bayesian information criterion.
    pub bic: f64,
    sums: Sums,
}

impl Fitted {
    /// Sum of squared one-step errors on a block and its samples.
    pub fn error(&self, block: usize) -> (f64, f64) {
        self.sums.error(&self.solved.theta, block)
    }
}

/// The screened grid of a record, from which searches on any blocks go out.
pub struct Joint<'a> {
    value: &'a [f64],
    output: &'a [f64],
    range: f64,
    screened: Vec<(Hypothesis, Sums)>,
}

impl<'a> Joint<'a> {
    /// From process value and output; `range` of the output.
    pub fn of(value: &'a [f64], output: &'a [f64], range: f64) -> Self {
        let stems = StickSlip::grid((BANDS.0 * range, BANDS.1 * range, BANDS.2), &JUMPS);
        let of_stem = |stem: &StickSlip| {
            let mut position = Vec::new();
            let slips = stem.follow(output, &mut position);
            let delays = 1..if slips > 1 { LONGEST_DELAY + 1 } else { 1 };
            let orders = delays.map(|delay| Orders { own: SCREEN.0, input: SCREEN.1, delay });
            orders.map(|orders| (Hypothesis { stem: *stem, orders }, Sums::of_orders(value, &position, orders))).collect::<Vec<_>>()
        };
        Self { value, output, range, screened: stems.par_iter().flat_map_iter(of_stem).collect() }
    }

    /// The best hypothesis on the blocks used.
    pub fn best(&self, used: &Used) -> Option<Fitted> {
        let mut screened: Vec<(f64, Hypothesis)> =
            self.screened.par_iter().filter_map(|(h, sums)| Some((sums.solve(used)?.variance, *h))).collect();
        screened.sort_by(|a, b| a.0.total_cmp(&b.0));
        // One delay of each stem.
        let mut firsts: Vec<Hypothesis> = Vec::new();
        for (_, h) in screened {
            if firsts.len() < REFINED && !firsts.iter().any(|f| f.stem == h.stem) {
                firsts.push(h);
            }
        }
        firsts.into_par_iter().filter_map(|h| self.refined(h, used)).min_by(|a, b| a.bic.total_cmp(&b.bic))
    }

    fn refined(&self, h: Hypothesis, used: &Used) -> Option<Fitted> {
        let starts = [-0.9, 0.0, 0.9].map(|start| StickSlip { start, ..h.stem });
        let mut best = starts
            .iter()
            .filter_map(|stem| self.fit(*stem, &[SCREEN], near(h.orders.delay, 1), used))
            .min_by(|a, b| a.bic.total_cmp(&b.bic))?;
        let mut step = STEPS.0;
        while step > STEPS.1 {
            let mut better = false;
            for (of_band, of_jump) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)] {
                let stem = best.hypothesis.stem;
                let band = (stem.band * (1.0 + step * of_band)).min(BANDS.1 * self.range);
                let jump = (stem.jump / stem.band + 2.0 * step * of_jump).clamp(0.0, 1.0) * band;
                let tried = self.fit(StickSlip { band, jump, ..stem }, &[SCREEN], near(best.hypothesis.orders.delay, 1), used);
                if let Some(tried) = tried.filter(|t| t.bic < best.bic - 1e-6) {
                    (best, better) = (tried, true);
                }
            }
            if !better {
                step *= 0.5;
            }
        }
        self.fit(best.hypothesis.stem, &ORDERS, 1..=LONGEST_DELAY, used)
    }

    /// The band that is good for its neighbours, too: a band scatters from slip to slip, and one that is a trifle too wide
    /// misses a slip altogether.
    pub fn centred(&self, best: Fitted, used: &Used) -> Fitted {
        let Hypothesis { stem, orders } = best.hypothesis;
        let delays = near(orders.delay, 4);
        let scaled = |k: i32| {
            let factor = (f64::from(k) * FINE).exp();
            StickSlip { band: factor * stem.band, jump: factor * stem.jump, ..stem }
        };
        let orders = [(orders.own, orders.input)];
        let profile: Vec<Option<Fitted>> =
            (PROFILE.0..=PROFILE.1).into_par_iter().map(|k| self.fit(scaled(k), &orders, delays.clone(), used)).collect();
        let error = |fits: &[Option<Fitted>]| fits.iter().map(|f| f.as_ref().map_or(f64::INFINITY, |f| f.solved.variance)).sum::<f64>();
        let windows = profile.windows(2 * SCATTER + 1).map(error).enumerate();
        let Some((first, _)) = windows.min_by(|a, b| a.1.total_cmp(&b.1)) else { return best };
        let Some(Some(chosen)) = profile.get(first + SCATTER) else { return best };
        self.fit(chosen.hypothesis.stem, &ORDERS, 1..=LONGEST_DELAY, used).unwrap_or(best)
    }

    fn fit(&self, stem: StickSlip, orders: &[(usize, usize)], delays: std::ops::RangeInclusive<usize>, used: &Used) -> Option<Fitted> {
        let mut position = Vec::new();
        stem.follow(self.output, &mut position);
        let forms = delays.flat_map(|delay| orders.iter().map(move |(own, input)| Orders { own: *own, input: *input, delay }));
        let fits = forms.filter_map(|orders| {
            let sums = Sums::of_orders(self.value, &position, orders);
            let solved = sums.solve(used)?;
            let bic = solved.bic(orders.own + orders.input + 2 + FRICTION);
            Some(Fitted { hypothesis: Hypothesis { stem, orders }, solved, bic, sums })
        });
        fits.min_by(|a, b| a.bic.total_cmp(&b.bic))
    }
}

/// Delays about this one.
fn near(delay: usize, by: usize) -> std::ops::RangeInclusive<usize> {
    delay.saturating_sub(by).max(1)..=(delay + by).min(LONGEST_DELAY)
}
