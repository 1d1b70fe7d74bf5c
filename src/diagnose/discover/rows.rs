//! What the search for a term looks at: the residual of a free run in rows of a few samples, the derivatives of the base, and the
//! states of the run at each row.

use nalgebra::{DMatrix, DVector};

use super::super::base::Base;
use super::super::descent::Wanted;
use super::super::evidence::Evidence;
use super::super::fit::{Fit, Fitter};
use super::super::heldout::BLOCK_S;
use super::super::simulator::Simulator;
use crate::physics::{Seen, State, StateKind, Tracker};

/// Most rows of the part in which is searched.
const MOST_ROWS: usize = 5_000;
/// Longest row [s].
const LONGEST_S: f64 = 0.04;
/// Parts of it, each predicted by a fit on the others.
pub const FOLDS: usize = 6;
/// Part of a single run in which is searched; the rest is held back.
const SEARCHED: f64 = 0.7;
/// Parts between which the end of a run may stand to divide what is searched from what is held back.
const DIVIDES: (f64, f64) = (0.35, 0.75);
/// Longest time since an event that is told apart [s].
const LONGEST_SINCE_S: f64 = 8.0;
/// Parts of the rows at both ends of a state's range that do not make it wider.
const TAIL: f64 = 0.002;

/// The rows.
pub struct Rows<'e> {
    evidence: &'e Evidence,
    /// Simulated pressure [bar] and current at the curve [A] of all samples.
    pressure_bar: Vec<f64>,
    current_a: Vec<f64>,
    /// The sample in the middle of each row.
    middle: Vec<usize>,
    /// Samples that each row is the mean of.
    pub per_row: usize,
    /// Measured minus simulated [bar].
    pub residual: Vec<f64>,
    /// What may move besides: derivatives of the base, in units of what the calibration leaves open, and terms found before.
    pub besides: Vec<Vec<f64>>,
    /// What holds each of them back.
    pub stiffness: Vec<f64>,
    /// What one of each derivative is, in the units in which its parameter moves.
    pub units: Vec<f64>,
    /// Rows in which is searched stand first.
    pub searched: usize,
    /// Block of each row behind them.
    pub block: Vec<usize>,
    /// Whether what is held back is a run of its own.
    pub own_run: bool,
    /// How long it is [s].
    pub held_s: f64,
}

impl<'e> Rows<'e> {
    /// Of a fit, whose parameters move besides. `turned`: the last run is searched, and the others are held back.
    pub fn of(fitter: &Fitter<'e>, fit: &Fit<'_>, turned: bool) -> Self {
        let evidence = fitter.evidence;
        let mut simulator = Simulator::new(evidence);
        let (mut pressure_bar, mut residual) = (Vec::new(), Vec::new());
        simulator.pressure(&fit.model, &fit.theta, &mut pressure_bar);
        simulator.residual(&fit.model, &fit.theta, &fitter.measured, &mut residual);
        let free = fit.model.free();
        let moving: Vec<usize> = (0..free.len()).collect();
        let slopes = fitter.slopes(&simulator, &free, &moving, fit, &residual, Wanted::Exact);
        let delay_s = Base::of(&fit.theta).delay_s();
        let late = |run: &crate::course::Run| {
            let steps = (delay_s / run.dt_s).round() as usize;
            (0..run.len()).map(move |k| k.saturating_sub(steps)).collect::<Vec<_>>()
        };
        let current_a = evidence.grids.iter().flat_map(|run| late(run).into_iter().map(|k| run.current_a[k])).collect();
        let (cut, own_run) = cut(evidence);
        let dt_s = evidence.step_s();
        let (ahead, behind) = (0..cut, cut..residual.len());
        let (search, held) = if turned { (behind, ahead) } else { (ahead, behind) };
        let longest = ((LONGEST_S / dt_s) as usize).max(1);
        let per_row = search.len().div_ceil(MOST_ROWS).clamp(1, longest);
        let every = (search.len() / per_row).div_ceil(MOST_ROWS).max(1);
        let mut rows = Self {
            evidence,
            pressure_bar,
            current_a,
            middle: Vec::new(),
            per_row,
            residual: Vec::new(),
            besides: vec![Vec::new(); moving.len()],
            stiffness: Vec::new(),
            units: Vec::new(),
            searched: 0,
            block: Vec::new(),
            own_run,
            held_s: held.len() as f64 * dt_s,
        };
        for (part, bound) in [search, held].into_iter().enumerate() {
            for from in bound.clone().step_by(per_row * every) {
                let samples = from..(from + per_row).min(bound.end);
                let finite: Vec<usize> = samples.clone().filter(|k| residual[*k].is_finite()).collect();
                if finite.is_empty() {
                    continue;
                }
                let mean = |column: &[f64]| finite.iter().map(|k| column[*k]).sum::<f64>() / finite.len() as f64;
                rows.middle.push((samples.start + samples.end) / 2);
                rows.residual.push(mean(&residual));
                for (out, column) in rows.besides.iter_mut().zip(slopes.columns()) {
                    out.push(mean(column));
                }
                if part == 0 {
                    rows.searched += 1;
                } else {
                    rows.block.push(((from - bound.start) as f64 * dt_s / BLOCK_S.min(rows.held_s / 12.0)) as usize);
                }
            }
        }
        let variance = rows.residual.iter().map(|e| e * e).sum::<f64>() / rows.residual.len().max(1) as f64;
        // In units of the calibration's own uncertainty, against the variance of what is correlated.
        let tau_rows = (fitter.tau_samples / (per_row * every) as f64).max(1.0);
        for (column, free) in rows.besides.iter_mut().zip(&free) {
            let rms = (column.iter().map(|v| v * v).sum::<f64>() / column.len().max(1) as f64).sqrt();
            let unit = free.prior.map_or(if rms > 0.0 { 1.0 / rms } else { 0.0 }, |p| p.sigma);
            column.iter_mut().for_each(|v| *v *= unit);
            rows.units.push(unit);
            rows.stiffness.push(if free.prior.is_some() { variance * tau_rows } else { 1e-3 * variance });
        }
        rows
    }

    /// All rows.
    pub fn len(&self) -> usize {
        self.residual.len()
    }

    /// The root mean square of single samples whose rows have this mean square [bar].
    pub fn of_samples(&self, mean_square: f64) -> f64 {
        (mean_square + self.evidence.noise_bar.powi(2) * (1.0 - 1.0 / self.per_row as f64)).sqrt()
    }

    /// The pressures between which the simulation moves, rare ends left out [bar].
    pub fn span_bar(&self) -> (f64, f64) {
        range(&self.middle.iter().map(|k| self.pressure_bar[*k]).collect::<Vec<_>>())
    }

    /// A state at each row.
    pub fn follow(&self, state: State) -> Vec<f64> {
        let mut all = Vec::with_capacity(self.pressure_bar.len());
        let mut begin = 0;
        for run in &self.evidence.grids {
            let mut tracker = Tracker::new(state, run.dt_s);
            let channel = |values: &Option<Vec<f64>>, k: usize| values.as_ref().map_or(f64::NAN, |v| v[k]);
            let seen = |from: usize, to: usize, lasts_s: f64| Seen {
                lasts_s,
                from_bar: self.pressure_bar[begin + from],
                to_bar: self.pressure_bar[begin + to],
                current_a: self.current_a[begin + to],
                oil_temp_c: channel(&run.oil_temp_c, to),
                supply_bar: channel(&run.supply_bar, to),
            };
            tracker.start(&seen(0, 0, 0.0));
            all.push(tracker.end_step());
            for k in 1..run.len() {
                tracker.advance(&seen(k - 1, k, run.dt_s));
                all.push(tracker.end_step());
            }
            begin += run.len();
        }
        self.middle.iter().map(|k| all[*k]).collect()
    }

    /// Between what a state moves in the rows that are searched, rare ends left out; nothing where it hardly moves or is not known.
    pub fn seen(&self, state: State, values: &[f64]) -> Option<(f64, f64)> {
        let searched = &values[..self.searched];
        if searched.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let (low, high) = range(searched);
        let high = if matches!(state.kind, StateKind::SinceReversal | StateKind::SinceShift) { high.min(LONGEST_SINCE_S) } else { high };
        (high - low > 1e-3 * low.abs().max(high.abs()).max(1e-3)).then_some((low, high))
    }

    /// The least-squares coefficients of what moves besides and of `columns` on these rows, and what they leave at all rows.
    pub fn regress(&self, columns: &[Vec<f64>], on: std::ops::Range<usize>) -> Option<(Vec<f64>, Vec<f64>)> {
        let all: Vec<&Vec<f64>> = self.besides.iter().chain(columns).collect();
        let n = all.len();
        let dot = |a: &[f64], b: &[f64]| a[on.clone()].iter().zip(&b[on.clone()]).map(|(a, b)| a * b).sum::<f64>();
        let mut normal = DMatrix::from_fn(n, n, |i, j| if j <= i { dot(all[i], all[j]) } else { 0.0 });
        normal.fill_upper_triangle_with_lower_triangle();
        for i in 0..n {
            normal[(i, i)] += self.stiffness.get(i).copied().unwrap_or(0.0) + 1e-9 * normal[(i, i)] + 1e-12;
        }
        let right = DVector::from_fn(n, |i, _| dot(all[i], &self.residual));
        let found = normal.cholesky()?.solve(&right);
        let mut left = self.residual.clone();
        for (column, value) in all.iter().zip(found.iter()) {
            left.iter_mut().zip(column.iter()).for_each(|(e, v)| *e -= value * v);
        }
        Some((found.iter().copied().collect(), left))
    }
}

/// The sample from which on is held back, and whether a run begins there.
fn cut(evidence: &Evidence) -> (usize, bool) {
    let all = evidence.samples();
    let part = |k: usize| k as f64 / all as f64;
    let mut begin = 0;
    let begins = evidence.grids.iter().map(|run| {
        begin += run.len();
        begin
    });
    let fit: Vec<usize> = begins.filter(|k| (DIVIDES.0..=DIVIDES.1).contains(&part(*k))).collect();
    match fit.iter().min_by(|a, b| (part(**a) - SEARCHED).abs().total_cmp(&(part(**b) - SEARCHED).abs())) {
        Some(k) => (*k, true),
        None => ((SEARCHED * all as f64) as usize, false),
    }
}

/// Between what values lie, rare ends left out.
fn range(values: &[f64]) -> (f64, f64) {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |part: f64| sorted.get((part * (sorted.len().max(1) - 1) as f64).round() as usize).copied().unwrap_or(0.0);
    (at(TAIL), at(1.0 - TAIL))
}
