//! The descent of Levenberg and Marquardt: normal equations with a diagonal that grows until a step goes down.
//!
//! K. Levenberg, Quart. Appl. Math. 2 (1944) 164; D. Marquardt, SIAM J. Appl. Math. 11 (1963) 431.

use nalgebra::{DMatrix, DVector};

/// Share of the largest diagonal element below which one counts as this share, so that a parameter which the data do not
/// show is damped too.
const LEAST_DIAGONAL: f64 = 1e-12;
/// After a step that went well the damping falls to this share.
const EASED: f64 = 0.2;
/// A damping that has failed is at least this.
const LEAST_AFTER_FAILURE: f64 = 1e-6;

/// The normal equations at a point.
#[derive(Debug, Clone)]
pub struct Equations {
    /// J' W J.
    pub normal: DMatrix<f64>,
    /// J' W r, in the sense in which [`Landscape::moved`] takes a step.
    pub gradient: DVector<f64>,
}

/// What a descent walks down.
pub trait Landscape {
    /// A point: its parameters with all that was computed there.
    type Point;
    /// Derivatives of the residual.
    type Slopes;

    /// The derivatives at a point.
    fn slopes(&mut self, at: &Self::Point) -> Self::Slopes;

    /// The normal equations at a point; nothing where they are not finite, which ends the descent.
    fn equations(&self, slopes: &Self::Slopes, at: &Self::Point) -> Option<Equations>;

    /// The point a step away.
    fn moved(&mut self, at: &Self::Point, step: &DVector<f64>) -> Self::Point;

    /// What is made small.
    fn objective(&self, at: &Self::Point) -> f64;

    /// Whether what a step has gained is worth another.
    fn is_worth_more(&self, before: f64, gain: f64) -> bool;

    /// Whether parameter `k` does not move at all.
    fn is_held(&self, _k: usize) -> bool {
        false
    }

    /// Whether `step` would push parameter `k` through a bound at which it stands.
    fn is_blocked(&self, _at: &Self::Point, _k: usize, _step: f64) -> bool {
        false
    }

    /// The derivatives corrected by what the step between two points has shown, where these will do.
    fn corrected(&self, _slopes: Self::Slopes, _metric: &Equations, _from: &Self::Point, _to: &Self::Point) -> Option<Self::Slopes> {
        None
    }
}

/// How a descent goes.
#[derive(Debug, Clone, Copy)]
pub struct Pace {
    /// Most steps.
    pub steps: usize,
    /// Damping of the first step.
    pub damping: f64,
    /// Smallest damping.
    pub least: f64,
    /// Factor by which the damping grows where a step goes up.
    pub raised: f64,
    /// Dampings tried with the same derivatives.
    pub tries: usize,
}

/// Where a descent has ended.
#[derive(Debug, Clone)]
pub struct Descended<P> {
    /// The point.
    pub at: P,
    /// The equations of the last step; nothing where no step was allowed.
    pub equations: Option<Equations>,
    /// Whether it ended by itself, before its steps ran out.
    pub ended: bool,
}

/// Walks down from `start`.
pub fn descend<L: Landscape>(landscape: &mut L, start: L::Point, pace: &Pace) -> Descended<L::Point> {
    let mut at = start;
    let mut damping = pace.damping;
    let mut kept: Option<L::Slopes> = None;
    let mut last = None;
    for _ in 0..pace.steps {
        let fresh = kept.is_none();
        let mut slopes = Some(kept.take().unwrap_or_else(|| landscape.slopes(&at)));
        let Some(equations) = slopes.as_ref().and_then(|s| landscape.equations(s, &at)) else {
            return Descended { at, equations: last, ended: true };
        };
        let before = landscape.objective(&at);
        let mut gain = 0.0;
        // Derivatives that were corrected only get one try: where it fails, the derivatives are at fault.
        for _ in 0..if fresh { pace.tries } else { 1 } {
            let Some(step) = damped_step(landscape, &at, &equations, damping) else {
                damping *= 10.0;
                continue;
            };
            let next = landscape.moved(&at, &step);
            gain = before - landscape.objective(&next);
            if gain > 0.0 {
                kept = slopes.take().and_then(|s| landscape.corrected(s, &equations, &at, &next));
                at = next;
                damping = (damping * EASED).max(pace.least);
                break;
            }
            if fresh {
                damping = (damping * pace.raised).max(LEAST_AFTER_FAILURE);
            }
        }
        last = Some(equations);
        if !(gain > 0.0 && landscape.is_worth_more(before, gain)) {
            if fresh {
                return Descended { at, equations: last, ended: true };
            }
            kept = None;
        }
    }
    Descended { at, equations: last, ended: false }
}

/// The step of the damped equations; parameters that it would push through their bounds stay. Nothing where the equations
/// cannot be solved.
fn damped_step<L: Landscape>(landscape: &L, at: &L::Point, equations: &Equations, damping: f64) -> Option<DVector<f64>> {
    let n = equations.gradient.len();
    let mut held: Vec<bool> = (0..n).map(|k| landscape.is_held(k)).collect();
    let largest = equations.normal.diagonal().max();
    // Each round takes at least one more parameter out of the step.
    for _ in 0..=n {
        let (mut damped, mut right) = (equations.normal.clone(), equations.gradient.clone());
        for k in 0..n {
            damped[(k, k)] += damping * damped[(k, k)].max(LEAST_DIAGONAL * largest);
            if held[k] {
                damped.row_mut(k).fill(0.0);
                damped.column_mut(k).fill(0.0);
                damped[(k, k)] = 1.0;
                right[k] = 0.0;
            }
        }
        let step = damped.cholesky()?.solve(&right);
        let mut again = false;
        for k in 0..n {
            if !held[k] && landscape.is_blocked(at, k, step[k]) {
                (held[k], again) = (true, true);
            }
        }
        if !again {
            return Some(step);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's valley as two residuals, 10 (y - x^2) and 1 - x, with a bound of x.
    struct Valley {
        most_x: f64,
        corrections: bool,
        slopes_taken: usize,
    }

    fn residual(at: &[f64; 2]) -> [f64; 2] {
        [10.0 * (at[1] - at[0] * at[0]), 1.0 - at[0]]
    }

    impl Landscape for Valley {
        type Point = [f64; 2];
        type Slopes = DMatrix<f64>;

        fn slopes(&mut self, at: &[f64; 2]) -> DMatrix<f64> {
            self.slopes_taken += 1;
            DMatrix::from_row_slice(2, 2, &[-20.0 * at[0], 10.0, -1.0, 0.0])
        }

        fn equations(&self, slopes: &DMatrix<f64>, at: &[f64; 2]) -> Option<Equations> {
            let residual = DVector::from_row_slice(&residual(at));
            Some(Equations { normal: slopes.tr_mul(slopes), gradient: -slopes.tr_mul(&residual) })
        }

        fn moved(&mut self, at: &[f64; 2], step: &DVector<f64>) -> [f64; 2] {
            [(at[0] + step[0]).min(self.most_x), at[1] + step[1]]
        }

        fn objective(&self, at: &[f64; 2]) -> f64 {
            residual(at).iter().map(|r| r * r).sum()
        }

        fn is_worth_more(&self, before: f64, gain: f64) -> bool {
            gain > 1e-14 * before
        }

        fn is_blocked(&self, at: &[f64; 2], k: usize, step: f64) -> bool {
            k == 0 && at[0] >= self.most_x && step > 0.0
        }

        fn corrected(&self, slopes: DMatrix<f64>, _: &Equations, from: &[f64; 2], to: &[f64; 2]) -> Option<DMatrix<f64>> {
            let step = DVector::from_row_slice(&[to[0] - from[0], to[1] - from[1]]);
            let made = DVector::from_row_slice(&residual(to)) - DVector::from_row_slice(&residual(from));
            let missed = (made - &slopes * &step) / step.norm_squared();
            self.corrections.then(|| slopes + missed * step.transpose())
        }
    }

    const PACE: Pace = Pace { steps: 200, damping: 1e-3, least: 1e-9, raised: 5.0, tries: 8 };

    #[test]
    fn it_follows_a_bent_valley_to_its_end() {
        for corrections in [false, true] {
            let mut valley = Valley { most_x: f64::INFINITY, corrections, slopes_taken: 0 };
            let found = descend(&mut valley, [-1.2, 1.0], &PACE);
            assert!(found.ended && (found.at[0] - 1.0).abs() < 1e-6 && (found.at[1] - 1.0).abs() < 1e-6, "{:?}", found.at);
        }
    }

    #[test]
    fn at_a_bound_the_other_parameters_go_on() {
        let mut valley = Valley { most_x: 0.5, corrections: false, slopes_taken: 0 };
        let found = descend(&mut valley, [-1.2, 1.0], &PACE);
        assert!(found.ended && found.at[0] == 0.5 && (found.at[1] - 0.25).abs() < 1e-6, "{:?}", found.at);
    }

    #[test]
    fn it_says_when_its_steps_ran_out() {
        let mut valley = Valley { most_x: f64::INFINITY, corrections: false, slopes_taken: 0 };
        let found = descend(&mut valley, [-1.2, 1.0], &Pace { steps: 2, ..PACE });
        assert!(!found.ended && found.equations.is_some() && valley.slopes_taken == 2);
        let none = descend(&mut valley, [-1.2, 1.0], &Pace { steps: 0, ..PACE });
        assert!(!none.ended && none.equations.is_none() && none.at == [-1.2, 1.0]);
    }
}
