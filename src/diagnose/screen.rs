//! Fits from several starts: many for a few steps, the best to the end.

use nalgebra::{Matrix4, Vector4};
use rayon::prelude::*;

use super::base::{AT, BASE};
use super::descent::{Descent, Place, Slopes, Wanted};
use super::fit::{Fit, Fitter, clamped, shifted};
use super::loss;
use super::model::{CALIBRATION, Model, UNSEEN_LAG_S};
use super::simulator::Simulator;

/// What a few steps bring no nearer to the incumbent than this is not worth the rest [nats].
const HOPELESS_NATS: f64 = -30.0;

/// Another start goes on where it is no farther behind the first [nats].
const NEAR_NATS: f64 = 6.0;
/// Steps of a fit after which who is far behind stays there.
const FIRST_STEPS: usize = 5;
/// Who is behind by more nats than this is far: all of the first steps bring 25 nats where there is next to nothing to be found,
const FAR_NATS: f64 = 60.0;
/// and shows in so many steps how fast it comes on. Of 212 that were far and did not come on, on fifteen valves of challenges, none would
/// have come to half of the best one's gain with all of the steps.
const PACING_STEPS: usize = 2;

/// What changes no pressure by more does nothing [bar].
const NOTHING_BAR: f64 = 1e-9;
/// Share of itself by which an effect's parameter is moved at least to see what a gradient does not.
const FINEST: f64 = 0.03;
/// Steps of a fit from another base.
const OTHER_BASE_STEPS: usize = 8;
/// A fit goes on for so many steps, so many times at most, until they gain less than this [nats].
const MORE_STEPS: usize = 8;
const MORE: usize = 4;
const AT_THE_END_NATS: f64 = 0.3;

/// How many starts make room for the effect, and how many of these go on: for a first effect, and beside others.
const FIRST: (usize, usize) = (6, 3);
const LATER: (usize, usize) = (4, 2);
/// Of those from a base that gives back what the effect delays, so many besides.
const GIVEN_BACK: usize = 2;

/// A start of an effect, in proportion to what the model without it leaves.
pub struct Proportioned {
    /// Its values.
    pub values: Vec<f64>,
    /// By how much later the base would be beside it [s].
    later_s: f64,
    /// Whether the effect changes any pressure where it begins.
    does_something: bool,
    /// Its pressure, where these are the values that were simulated [bar].
    pressure_bar: Option<Vec<f64>>,
}

/// Whether two simulated pressures [bar] differ anywhere.
fn differ(first: &[f64], second: &[f64]) -> bool {
    first.iter().zip(second).any(|(a, b)| (a - b).abs() > NOTHING_BAR)
}

impl Fitter<'_> {
    /// Fits `model`, whose last effect is new.
    pub fn fit_new<'a>(&self, model: &Model<'a>, incumbent: &Fit<'a>, hints: &[Vec<f64>]) -> Fit<'a> {
        let starts = [model.starts(model.effects[model.effects.len() - 1]).as_slice(), hints].concat();
        let screened = self.screen(model, incumbent, &starts);
        let hopeless = self.gain(incumbent, &screened[0]) < HOPELESS_NATS && screened[0].rmse_bar > incumbent.rmse_bar;
        self.finish(screened, hopeless)
    }

    /// The best fits, best first and at least one, of `model`, whose last effect is new: a few steps from every one of
    /// `starts` of that effect, with the earlier effects held at first.
    pub fn screen<'a>(&self, model: &Model<'a>, incumbent: &Fit<'a>, starts: &[Vec<f64>]) -> Vec<Fit<'a>> {
        let mut from = vec![incumbent.theta.as_slice(), std::slice::from_ref(&incumbent.scale_bar)];
        from.extend(starts.iter().map(Vec::as_slice));
        self.remembering((model, &from), "screen", || self.screened(model, incumbent, starts))
    }

    fn screened<'a>(&self, model: &Model<'a>, incumbent: &Fit<'a>, starts: &[Vec<f64>]) -> Vec<Fit<'a>> {
        let held = model.effects.len() - 1;
        // Beside an effect that was found, the ends of the round before are among the starts, and fewer others are needed.
        let effort = if held == 0 { FIRST } else { LATER };
        let mut simulator = Simulator::new(self.evidence);
        let near = self.near(&mut simulator, incumbent);
        // From the incumbent's base, and from the calibration: what the base had absorbed must be free to go back, and is missing there.
        let mut calibrated = [&model.calibrated(), &incumbent.theta[BASE..]].concat();
        calibrated[AT.lag] += 0.5 * UNSEEN_LAG_S;
        let calibrated = self.score(&mut simulator, &incumbent.model, &clamped(&incumbent.model.free(), &calibrated), &mut Vec::new());
        let (mut tried, mut given_back): (Vec<Place<'a>>, Vec<Place<'a>>) = (Vec::new(), Vec::new());
        // A loop that widens looks late as well.
        let of_course = !model.effects[held].imitates_form();
        for (beside, is_incumbent) in [(incumbent, true), (&calibrated, false)] {
            let starts = self.in_proportion(&mut simulator, model, beside, starts);
            for Proportioned { values, later_s, pressure_bar, .. } in self.living(&mut simulator, model, beside, starts) {
                let mut from = |base: &[f64], pressure_bar: Option<Vec<f64>>| {
                    let wanted = [base, values.as_slice()].concat();
                    let theta = clamped(&model.free(), &wanted);
                    match pressure_bar.filter(|_| theta == wanted) {
                        Some(pressure_bar) => self.placed_by(model, &theta, pressure_bar),
                        None => self.placed(&mut simulator, model, &theta),
                    }
                };
                tried.push(from(&beside.theta, pressure_bar));
                if is_incumbent && of_course && later_s.abs() > CALIBRATION.late * model.slowness {
                    let mut base = incumbent.theta.clone();
                    base[AT.late] += later_s;
                    base[AT.lag] = base[AT.lag].min(base[AT.late]);
                    given_back.push(from(&base, None));
                }
            }
        }
        let order = |a: &Place<'_>, b: &Place<'_>| self.objective(&a.fit).total_cmp(&self.objective(&b.fit));
        for (places, most) in [(&mut tried, effort.0), (&mut given_back, GIVEN_BACK)] {
            places.sort_by(order);
            places.truncate(most);
        }
        tried.append(&mut given_back);
        // The base makes room for the effect before it is judged: what a wider loop has absorbed must be given back. Then the effect moves
        // as well, and derivatives of another model would lead it astray.
        for (iterations, held, near) in [(2, held + 1, near.as_ref()), (4, held, None)] {
            let descent = Descent { held, rough: true, ..Descent::of(iterations) };
            tried = tried.into_iter().map(|place| self.descended_from(&mut simulator, place, descent, near)).collect();
            tried.sort_by(order);
            tried.truncate(effort.1);
        }
        tried.into_iter().map(|place| place.fit).collect()
    }

    /// The derivatives at a fit by what no formula gives and an effect more hardly changes: the loop and the lag of the base. Nothing where
    /// steps are fitted, which no rough derivatives will do for.
    fn near(&self, simulator: &mut Simulator<'_>, fit: &Fit<'_>) -> Option<Slopes> {
        if self.squared {
            return None;
        }
        let mut residual = Vec::new();
        self.residual(simulator, &fit.model, &fit.theta, &mut residual);
        Some(self.slopes(simulator, &fit.model.free(), &[AT.width, AT.ln_a, AT.lag], fit, &residual, Wanted::Exact))
    }

    /// The starts from which a fit can go anywhere, or all where there is none: where the effect does nothing, nor would with any of its
    /// parameters moved a step, as a limit above all pressures, a start would take the place of another one and stay there.
    pub(super) fn living(
        &self,
        simulator: &mut Simulator<'_>,
        model: &Model<'_>,
        incumbent: &Fit<'_>,
        starts: Vec<Proportioned>,
    ) -> Vec<Proportioned> {
        if starts.iter().all(|start| start.does_something) {
            return starts;
        }
        let (mut given, mut with) = (Vec::new(), Vec::new());
        simulator.pressure(&incumbent.model, &incumbent.theta, &mut given);
        let free = model.free();
        let mut may_move = |start: &Proportioned| {
            let stands = clamped(&free, &[incumbent.theta.as_slice(), &start.values].concat());
            (incumbent.theta.len()..free.len()).flat_map(|k| [free[k].step, -free[k].step].map(|step| (k, step))).any(|(k, step)| {
                let mut theta = stands.clone();
                theta[k] = shifted(&free[k], theta[k], step);
                simulator.pressure(model, &theta, &mut with);
                differ(&given, &with)
            })
        };
        let lives: Vec<bool> = starts.iter().map(|start| start.does_something || may_move(start)).collect();
        let all_dead = !lives.contains(&true);
        starts.into_iter().zip(lives).filter(|(_, lives)| all_dead || *lives).map(|(start, _)| start).collect()
    }

    /// The starts with the amplitude, where the last effect of `model` has one, at which what it does comes nearest to what the
    /// incumbent leaves, and by how much later the base would be then [s], while its gain and offset make room: the part of the fit
    /// that is linear, or nearly so, is solved, and only the rest has to be tried (Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413).
    pub(super) fn in_proportion(
        &self,
        simulator: &mut Simulator<'_>,
        model: &Model<'_>,
        incumbent: &Fit<'_>,
        starts: &[Vec<f64>],
    ) -> Vec<Proportioned> {
        let amplitude = model.effects.last().and_then(|e| e.amplitude());
        let range = amplitude.map(|at| model.free()[incumbent.theta.len() + at].range);
        let mut given = Vec::new();
        simulator.pressure(&incumbent.model, &incumbent.theta, &mut given);
        let solved = |start: &Vec<f64>| {
            let mut with = Vec::new();
            simulator.pressure(model, &[incumbent.theta.as_slice(), start].concat(), &mut with);
            let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
            let mut before = with.first().copied().unwrap_or_default();
            for (k, ((y, p), q)) in self.measured.iter().zip(&given).zip(&with).enumerate() {
                let later = before - q;
                before = *q;
                if !y.is_finite() || !later.is_finite() {
                    continue;
                }
                // Without an amplitude it is there as it stands.
                let (stands, own) = if amplitude.is_some() { (p, q - p) } else { (q, 0.0) };
                let row = Vector4::new(own, 1.0, *p, later);
                let trusted = self.weight(k);
                let tail = if self.squared { 1.0 } else { loss::weight(trusted * (y - p), incumbent.scale_bar) };
                let weight = trusted * trusted * tail;
                normal += weight * row * row.transpose();
                right += weight * (y - stands) * row;
            }
            if amplitude.is_none() {
                normal[(0, 0)] = 1.0;
            }
            let later_s = normal.try_inverse().map_or(0.0, |inverse| (inverse * right)[3]) * self.evidence.step_s();
            // With the base as late as it is.
            let (as_late, wanted) = (normal.fixed_view::<3, 3>(0, 0).into_owned(), right.fixed_rows::<3>(0));
            let times = as_late.try_inverse().map_or(f64::NAN, |inverse| (inverse * wanted)[0]);
            let mut values = start.clone();
            if let (Some(at), Some(range)) = (amplitude, range) {
                let value = times * start[at];
                if value.is_finite() && (range.0..=range.1).contains(&value) && value != 0.0 {
                    values[at] = value;
                }
            }
            let later_s = if later_s.is_finite() { later_s } else { 0.0 };
            let does_something = differ(&given, &with);
            let pressure_bar = (values == *start).then_some(with);
            Proportioned { values, later_s, does_something, pressure_bar }
        };
        starts.iter().map(solved).collect()
    }

    /// The first few steps of [`Fitter::finish`], which show who may still win: one fit, or those near it. Who is far from gaining
    /// `wanted` nats over the incumbent goes on only where the first of these steps would bring it there, each as much as the other.
    pub fn begin<'a>(&self, mut rough: Vec<Fit<'a>>, incumbent: &Fit<'_>, wanted: f64) -> Vec<Fit<'a>> {
        let mut simulator = Simulator::new(self.evidence);
        let mut steps = |fit: &Fit<'a>, count: usize| {
            let descent = Descent { rough: true, ..Descent::of(count) };
            self.polish_in(&mut simulator, &fit.model, &fit.theta, descent)
        };
        let missing = wanted - self.gain(incumbent, &rough[0]);
        if missing > FAR_NATS {
            let first = steps(&rough[0], PACING_STEPS);
            if self.gain(&rough[0], &first) * (FIRST_STEPS as f64 / PACING_STEPS as f64) < missing {
                return vec![first];
            }
        }
        rough.truncate(self.that_may_win(&rough));
        let mut fits: Vec<Fit<'a>> = rough.iter().map(|fit| steps(fit, FIRST_STEPS)).collect();
        fits.sort_by(|a, b| self.objective(a).total_cmp(&self.objective(b)));
        fits
    }

    /// How many of these fits, best first, may still win.
    fn that_may_win(&self, rough: &[Fit<'_>]) -> usize {
        rough.iter().take_while(|fit| self.gain(fit, &rough[0]) < NEAR_NATS).count().max(1)
    }

    /// The best of what [`Fitter::screen`] has found, brought to the end with all parameters free; only a few steps where
    /// it is hopeless.
    pub fn finish<'a>(&self, rough: Vec<Fit<'a>>, hopeless: bool) -> Fit<'a> {
        let model = rough[0].model.clone();
        let from: Vec<&[f64]> = rough.iter().flat_map(|f| [f.theta.as_slice(), std::slice::from_ref(&f.scale_bar)]).collect();
        self.remembering((&model, &from), ("finish", hopeless), || vec![self.finished(&rough, hopeless)]).swap_remove(0)
    }

    fn finished<'a>(&self, rough: &[Fit<'a>], hopeless: bool) -> Fit<'a> {
        let (count, steps) = if hopeless { (1, FIRST_STEPS) } else { (self.that_may_win(rough), 18) };
        let fine: Vec<Fit<'a>> = rough[..count].par_iter().map(|f| self.polish(&f.model, &f.theta, steps)).collect();
        let best = self.best(fine).unwrap_or_else(|| rough[0].clone());
        if hopeless { best } else { self.to_the_end(best) }
    }

    /// What a descent that has run out of steps, or into one of the optima that delay and lag have side by side, or beside a base that its
    /// first steps have bent, leaves to be gained.
    fn to_the_end<'a>(&self, mut best: Fit<'a>) -> Fit<'a> {
        let simulator = &mut Simulator::new(self.evidence);
        let calibrated = best.model.calibrated();
        let mut split = best.theta.clone();
        (split[AT.late], split[AT.lag]) = (calibrated[AT.late], calibrated[AT.lag]);
        let starts = [split, [&calibrated[..], &best.theta[BASE..]].concat()];
        let others: Vec<Fit<'a>> = starts.par_iter().map(|start| self.polish(&best.model, start, OTHER_BASE_STEPS)).collect();
        best = others.into_iter().fold(best, |best, next| self.better(best, next));
        best = self.walk(simulator, best);
        for _ in 0..MORE {
            let next = self.polish_in(simulator, &best.model, &best.theta, Descent::of(MORE_STEPS));
            let gain = self.gain(&best, &next);
            if gain > 0.0 {
                best = next;
            }
            if gain < AT_THE_END_NATS {
                break;
            }
        }
        best
    }

    /// Tries each effect parameter a little up and down: what a gradient of a jumping simulation does not see.
    fn walk<'a>(&self, simulator: &mut Simulator<'_>, mut best: Fit<'a>) -> Fit<'a> {
        let free = best.model.free();
        let mut residual = Vec::new();
        let last = best.model.place(best.model.effects.len() - 1);
        for size in [4.0 * FINEST, FINEST] {
            for k in last.clone() {
                for sign in [1.0, -1.0] {
                    let step = if free[k].resolved {
                        (size / FINEST) * free[k].step
                    } else if free[k].log {
                        size
                    } else {
                        size * best.theta[k].abs().max(0.01 * (free[k].range.1 - free[k].range.0).min(10.0))
                    };
                    let mut theta = best.theta.clone();
                    theta[k] = shifted(&free[k], theta[k], sign * step);
                    let next = self.score_near(simulator, &best.model, &theta, best.scale_bar, &mut residual);
                    if self.objective(&next) < self.objective(&best) {
                        best = next;
                        break;
                    }
                }
            }
        }
        best
    }

    /// The fit with each optional parameter of its last effect back at its default, where BIC is better for it.
    pub fn simplified<'a>(&self, mut fit: Fit<'a>) -> Fit<'a> {
        let effective = self.effective();
        let count = fit.model.effects.last().map_or(0, |e| e.parameters().len());
        for j in (0..count).rev() {
            let Some(simpler) = fit.model.holding(j) else { continue };
            // Also from the calibration: the base may have moved for what goes.
            let calibrated = [&simpler.calibrated(), &fit.theta[BASE..]].concat();
            let (less, other) = rayon::join(|| self.polish(&simpler, &fit.theta, 4), || self.polish(&simpler, &calibrated, 4));
            let less = self.better(less, other);
            if less.bic(effective) < fit.bic(effective) {
                fit = less;
            }
        }
        fit
    }

    /// Refits a model from a vector.
    pub fn refit<'a>(&self, model: &Model<'a>, start: &[f64]) -> Fit<'a> {
        self.polish(model, start, 18)
    }

    /// A fit refitted without its effect number `k`.
    pub fn refit_without<'a>(&self, fit: &Fit<'a>, k: usize) -> Fit<'a> {
        let less = fit.without(k);
        self.refit(&less.model, &less.theta)
    }

    /// "Recalibrate only": the base parameters free, from several starts, the same effort as a candidate gets.
    pub fn recalibrate<'a>(&self, model: &Model<'a>, others: &[Vec<f64>]) -> Fit<'a> {
        let start = model.calibrated();
        let mut starts = vec![start.clone()];
        for (more, lag) in [(0.0, 0.008), (0.008, 0.003), (0.004, 0.014)] {
            let mut s = start.clone();
            s[AT.late] += more * model.slowness;
            s[AT.lag] += lag * model.slowness;
            starts.push(s);
        }
        starts.extend(others.iter().map(|t| t[..BASE].to_vec()));
        let fits: Vec<Fit<'a>> = starts.par_iter().map(|s| self.polish(model, s, 10)).collect();
        self.best(fits).unwrap_or_else(|| self.polish(model, &start, 10))
    }
}
