//! How far a parameter can be moved, with all others fitted again, before the record speaks against it.
//!
//! The 95 % interval of a parameter is where its profile likelihood stays within 3.84 of twice its maximum (Bates and Watts, Nonlinear
//! Regression Analysis and Its Applications, Wiley 1988, chapter 6): a limit that the drive hardly reaches is then known from below and
//! not from above, which no standard error says. The likelihood is that of effective samples; where the blocks of the record pull the
//! parameter about more than these would, twice its logarithm counts as many times less (Pace, Salvan and Sartori, Statistica Sinica 21
//! (2011) 129, eq. 6, for one parameter). What other models would make of the parameter comes on top.
//!
//! The others follow with the derivatives of the fit itself, so that a point of the profile costs two or three simulations.

use nalgebra::DVector;

use super::descent::Place;
use super::diagnosis::Interval;
use super::errors::Curvature;
use super::fit::{Fit, Fitter, shifted};
use super::simulator::Simulator;
use crate::least_squares::{Equations, Landscape, Pace, SIGMAS_95, descend};

/// The 95 % quantile of chi-square with one degree of freedom.
const CHI_SQUARE: f64 = SIGMAS_95 * SIGMAS_95;
/// Points of one side of a profile.
const POINTS: usize = 6;
/// So near to the root of what is asked for a point is one of its end.
const NEAR: f64 = 0.03;
/// The first point of a parameter that moves nothing here: this ratio, or this share of its range.
const BLIND: f64 = 0.05;
/// How much farther out the next point lies at most.
const FARTHER: f64 = 4.0;
/// How the other parameters follow.
const PACE: Pace = Pace { steps: 3, damping: 1e-6, least: 1e-6, raised: 100.0, tries: 2 };
/// What a further step of theirs has to gain [nats].
const TRIFLE_NATS: f64 = 0.02;

/// The profiles of a fit.
pub struct Profiles<'p, 'f, 'a> {
    fitter: &'p Fitter<'f>,
    curvature: &'p Curvature<'p, 'a>,
    /// The parameters at the lowest point, and what is made small there.
    lowest: (Vec<f64>, f64),
}

/// All parameters but one, which go down with derivatives that stay.
struct Others<'o, 'f, 'a> {
    profiles: &'o Profiles<'o, 'f, 'a>,
    simulator: Simulator<'f>,
    held: Option<usize>,
}

impl<'a> Landscape for Others<'_, '_, 'a> {
    type Point = Place<'a>;
    type Slopes = ();

    fn slopes(&mut self, _: &Place<'a>) {}

    fn equations(&self, (): &(), at: &Place<'a>) -> Option<Equations> {
        let Profiles { fitter, curvature, .. } = self.profiles;
        fitter.normal_equations(&curvature.slopes, &curvature.free, &at.fit, &at.residual)
    }

    fn moved(&mut self, at: &Place<'a>, step: &DVector<f64>) -> Place<'a> {
        let moved = at.fit.theta.iter().zip(step.iter()).zip(&self.profiles.curvature.free);
        self.place(&moved.map(|((value, step), free)| shifted(free, *value, *step)).collect::<Vec<f64>>())
    }

    fn objective(&self, at: &Place<'a>) -> f64 {
        self.profiles.fitter.objective(&at.fit)
    }

    fn is_held(&self, k: usize) -> bool {
        self.held == Some(k) || self.profiles.curvature.free[k].is_still()
    }

    fn is_blocked(&self, at: &Place<'a>, k: usize, step: f64) -> bool {
        self.profiles.curvature.free[k].is_blocked(at.fit.theta[k], step)
    }

    fn is_worth_more(&self, _: f64, gain: f64) -> bool {
        gain * self.profiles.fitter.effective() > TRIFLE_NATS
    }
}

impl<'a> Others<'_, '_, 'a> {
    fn place(&mut self, theta: &[f64]) -> Place<'a> {
        let Profiles { fitter, curvature, .. } = self.profiles;
        let mut residual = Vec::new();
        let fit = fitter.score_near(&mut self.simulator, &curvature.fit.model, theta, curvature.fit.scale_bar, &mut residual);
        Place { fit, residual }
    }

    /// The best fit from here.
    fn best(&mut self, theta: &[f64]) -> Fit<'a> {
        let start = self.place(theta);
        descend(self, start, &PACE).at.fit
    }
}

impl<'p, 'f, 'a> Profiles<'p, 'f, 'a> {
    /// The profiles of the fit of this curvature.
    pub fn new(fitter: &'p Fitter<'f>, curvature: &'p Curvature<'p, 'a>) -> Self {
        let fit = curvature.fit;
        let mut profiles = Self { fitter, curvature, lowest: (fit.theta.clone(), fitter.objective(fit)) };
        // The fit itself may have stopped a little above its lowest point.
        let lowest = profiles.others(None).best(&fit.theta);
        if fitter.objective(&lowest) < profiles.lowest.1 {
            profiles.lowest = (lowest.theta.clone(), fitter.objective(&lowest));
        }
        profiles
    }

    fn others(&self, held: Option<usize>) -> Others<'_, 'f, 'a> {
        Others { profiles: self, simulator: Simulator::new(self.fitter.evidence), held }
    }

    /// The parameters where `k` has moved by `shift`, in the unit in which it moves, and the others as the derivatives have them follow.
    fn following(&self, k: usize, shift: f64) -> Vec<f64> {
        let Curvature { free, normal, .. } = self.curvature;
        let mut theta = self.lowest.0.clone();
        let value = if free[k].log { theta[k] * shift.exp() } else { theta[k] + shift };
        theta[k] = value.clamp(free[k].range.0, free[k].range.1);
        let others: Vec<usize> = (0..theta.len()).filter(|j| *j != k && !free[*j].is_still() && normal[(*j, *j)] > 0.0).collect();
        let within = normal.select_rows(&others).select_columns(&others);
        let across = DVector::from_iterator(others.len(), others.iter().map(|j| -shift * normal[(*j, k)]));
        if let Some(factors) = within.cholesky() {
            for (j, step) in others.iter().zip(factors.solve(&across).iter()) {
                theta[*j] = shifted(&free[*j], theta[*j], *step);
            }
        }
        theta
    }

    /// How far parameter `k` can be moved in one direction before twice the log-likelihood has fallen by `most`, in the unit in which it moves;
    /// `None` where it never does.
    fn reach(&self, k: usize, direction: f64, most: f64) -> Option<f64> {
        let mut others = self.others(Some(k));
        let free = &self.curvature.free[k];
        let edge = if direction > 0.0 { free.range.1 } else { free.range.0 };
        let end = free.distance(self.lowest.0[k], edge).abs();
        let goal = most.sqrt();
        let (mut inside, mut outside): ((f64, f64), Option<(f64, f64)>) = ((0.0, 0.0), None);
        let sigma = self.curvature.by_information(k).sqrt();
        let first = if self.curvature.carries(k) { goal * sigma } else { BLIND * if free.log { 1.0 } else { end } };
        let mut at = first.min(end);
        for _ in 0..POINTS {
            let best = others.best(&self.following(k, direction * at));
            let fallen = (2.0 * self.fitter.effective() * (self.fitter.objective(&best) - self.lowest.1)).max(0.0).sqrt();
            if (fallen / goal - 1.0).abs() < NEAR {
                return Some(at);
            }
            if fallen < goal {
                if at >= end {
                    return None;
                }
                inside = (at, fallen);
            } else {
                outside = Some((at, fallen));
            }
            at = match outside {
                Some(out) => inside.0 + (out.0 - inside.0) * ((goal - inside.1) / (out.1 - inside.1)).clamp(0.1, 0.9),
                None => (at * (goal / fallen.max(1e-9)).clamp(1.2, FARTHER)).min(end),
            };
        }
        outside.map(|_| at)
    }

    /// The standard error and the 95 % interval of parameter `k`, in its own unit. The error is the distance to the farther end of the
    /// interval over 1.96, `None` where an end is open; both are `None` of a parameter that does not move. `between`: the variance of the
    /// parameter between the models that the record allows, in its own unit.
    pub fn interval(&self, k: usize, between: f64) -> (Option<f64>, Option<Interval>) {
        let curvature = self.curvature;
        let (free, value, middle) = (&curvature.free[k], curvature.fit.theta[k], self.lowest.0[k]);
        if free.is_still() {
            return (None, None);
        }
        let most = CHI_SQUARE * (curvature.variance(k) / curvature.by_information(k).max(1e-300)).max(1.0);
        let side = |direction: f64| {
            let moved = direction * self.reach(k, direction, most)?.hypot(SIGMAS_95 * between.sqrt() / curvature.unit(k));
            let end = if free.log { middle * moved.exp() } else { middle + moved };
            Some(end.clamp(free.range.0, free.range.1))
        };
        let (low, high) = (side(-1.0).map(|low| low.min(value)), side(1.0).map(|high| high.max(value)));
        let error = low.zip(high).map(|(low, high)| (high - value).max(value - low) / SIGMAS_95);
        (error, Some((low, high)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::base::AT;
    use crate::diagnose::evidence::Evidence;
    use crate::diagnose::evidence::tests::{held, straight, straight_run, waves};
    use crate::diagnose::model::Model;
    use crate::diagnose::search::correlation;
    use crate::physics::EFFECTS;
    use crate::valve::Valve;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};

    /// Noise of 20 mbar that hangs together over some twenty samples, or over one.
    fn noise(seed: u64, keeps: f64, samples: usize) -> Vec<f64> {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        let normal = Normal::new(0.0, 0.02 * (1.0 - keeps * keeps).sqrt()).unwrap();
        let mut last = 0.0;
        let mut next = || {
            last = keeps * last + normal.sample(&mut random);
            last
        };
        (0..samples).map(|_| next()).collect()
    }

    /// The valve as it is, and a limit of its rise and its fall that is free.
    fn model<'a>(valve: &'a Valve, evidence: &Evidence) -> Model<'a> {
        let limit = EFFECTS.iter().find(|e| e.parameters()[0].unit.symbol == "bar/s").unwrap();
        let model = Model::base(valve).unwrap().on(evidence).standing_still().with(*limit, 0.0);
        (2..limit.parameters().len()).fold(model, |model, j| model.holding(j).unwrap())
    }

    #[test]
    fn of_repeated_recordings_nineteen_in_twenty_intervals_hold_the_truth() {
        let valve = straight();
        let quiet = held(vec![straight_run(waves(6000), |_, _| 0.0)]);
        // It asks for 12 bar/s at most.
        let truth = [8.0, 9.0];
        let limited = model(&valve, &quiet);
        let theta = [limited.calibrated(), truth.to_vec(), vec![0.0, 0.0]].concat();
        let mut pressure = Vec::new();
        Simulator::new(&quiet).pressure(&limited, &theta, &mut pressure);
        let (mut held_truth, mut wide) = (0, 0.0);
        for seed in 0..60 {
            let noise = noise(seed, 0.9, 6000);
            let evidence = held(vec![straight_run(waves(6000), |k, i| pressure[k] - 20.0 * i + noise[k])]);
            let model = model(&valve, &evidence);
            let mut fitter = Fitter { squared: true, ..Fitter::new(&evidence) };
            let fit = fitter.polish(&model, &theta, 20);
            fitter.tau_samples = correlation(&fitter, &fit);
            let curvature = fitter.curvature(&fit).unwrap();
            let profiles = Profiles::new(&fitter, &curvature);
            for (k, truth) in model.place(0).zip(truth) {
                let (error, interval) = profiles.interval(k, 0.0);
                let Some((Some(low), Some(high))) = interval else { panic!("{interval:?}") };
                held_truth += i32::from(low <= truth && truth <= high);
                wide += error.unwrap_or(f64::NAN) / fitter.standard_errors(&fit)[k] / 120.0;
            }
        }
        // Of 120 at 95 % fewer than 108 come once in a hundred times.
        assert!((108..=119).contains(&held_truth) && (0.9..1.3).contains(&wide), "{held_truth} {wide}");
    }

    #[test]
    fn where_the_loss_is_a_parabola_the_interval_is_that_of_the_standard_error() {
        let valve = straight();
        let noise = noise(7, 0.0, 6000);
        let evidence = held(vec![straight_run(waves(6000), |k, _| noise[k])]);
        let base = Model::base(&valve).unwrap().on(&evidence);
        let fitter = Fitter { squared: true, ..Fitter::new(&evidence) };
        let fit = fitter.refit(&base, &base.calibrated());
        let curvature = fitter.curvature(&fit).unwrap();
        let profiles = Profiles::new(&fitter, &curvature);
        for k in [AT.gain, AT.offset] {
            let (error, interval) = profiles.interval(k, 0.0);
            let usual = fitter.standard_errors(&fit)[k];
            assert!(error.is_some_and(|e| (0.9..1.15).contains(&(e / usual))), "{k}: {error:?} {usual}");
            // What other models would make of it comes on top.
            let (more, wider) = profiles.interval(k, 9.0 * usual * usual);
            assert!(more.is_some_and(|e| (3.0..3.4).contains(&(e / usual))), "{k}: {more:?} {usual}");
            let width = |i: Option<Interval>| i.and_then(|(low, high)| Some(high? - low?)).unwrap_or(f64::NAN);
            assert!(width(wider) > 2.5 * width(interval));
        }
    }

    #[test]
    fn a_limit_that_the_drive_does_not_reach_is_known_from_below_only() {
        let valve = straight();
        let noise = noise(3, 0.0, 6000);
        // It rises and falls at 12 bar/s at most.
        let evidence = held(vec![straight_run(waves(6000), |k, _| noise[k])]);
        let model = model(&valve, &evidence);
        let fitter = Fitter::new(&evidence);
        let theta = [model.calibrated(), vec![14.0, 14.0, 0.0, 0.0]].concat();
        let fit = fitter.score(&mut Simulator::new(&evidence), &model, &theta, &mut Vec::new());
        let curvature = fitter.curvature(&fit).unwrap();
        let profiles = Profiles::new(&fitter, &curvature);
        let rise = model.place(0).start;
        let (error, interval) = profiles.interval(rise, 0.0);
        let Some((Some(low), None)) = interval else { panic!("{interval:?} {:?}", fit.theta) };
        assert!(error.is_none() && (10.0..12.1).contains(&low), "{low}");
        assert_eq!(profiles.interval(rise + 2, 0.0), (None, None), "what stays at its default has no interval");
    }
}
