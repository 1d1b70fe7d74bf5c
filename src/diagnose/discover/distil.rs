//! From states of which a smooth function predicts the residual to a short formula: products of plain functions, the best one
//! after the other (orthogonal matching pursuit: Pati, Rezaiifar, Krishnaprasad, Asilomar 1993), each time with all centres, widths
//! and memories refined.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::atoms::products;
use super::rows::Rows;
use super::states::Tried;
use crate::physics::{Factor, State, StateKind, Term};

/// Most terms of one formula.
const MOST_TERMS: usize = 4;
/// A further term must take this share of the square that is left.
const WORTH: f64 = 0.15;
/// What is refined by how much, from coarse to fine: ratios of widths and memories, parts of a width for centres.
const STEPS: [f64; 4] = [0.3, 0.12, 0.05, 0.02];
/// Rounds of each.
const ROUNDS: usize = 3;
/// Between which parts of its range a width may be, and memories [s].
const WIDTHS: (f64, f64) = (0.02, 4.0);
const MEMORIES_S: (f64, f64) = (0.03, 30.0);

/// Products of functions whose coefficients are solved for.
pub type Formula = Vec<Vec<Factor>>;

/// States at the rows that were followed before.
pub struct Known<'r, 'e> {
    rows: &'r Rows<'e>,
    states: Vec<(State, Vec<f64>)>,
}

impl<'r, 'e> Known<'r, 'e> {
    /// With these already known.
    pub fn new(rows: &'r Rows<'e>, tried: &[&Tried]) -> Self {
        Self { rows, states: tried.iter().map(|t| (t.state, t.values.clone())).collect() }
    }

    fn values(&mut self, state: State) -> &[f64] {
        let at = self.states.iter().position(|(s, _)| *s == state).unwrap_or_else(|| {
            // Refining leaves many behind.
            if self.states.len() > 12 {
                self.states.remove(2);
            }
            self.states.push((state, self.rows.follow(state)));
            self.states.len() - 1
        });
        &self.states[at].1
    }

    /// A product at all rows.
    pub fn column(&mut self, factors: &[Factor]) -> Vec<f64> {
        let mut out = vec![1.0; self.rows.len()];
        for f in factors {
            let values = self.values(f.state);
            out.iter_mut().zip(values).for_each(|(o, v)| *o *= f.at(*v));
        }
        out
    }
}

/// The residual and everything else without what moves besides, on the rows that are searched.
struct Cleared {
    axes: Vec<Vec<f64>>,
    residual: Vec<f64>,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Cleared {
    fn of(rows: &Rows<'_>) -> Self {
        let n = rows.searched;
        let mut cleared = Self { axes: Vec::new(), residual: rows.residual[..n].to_vec() };
        for column in &rows.besides {
            cleared.add(&column[..n]);
        }
        cleared
    }

    /// One direction more that counts as explained.
    fn add(&mut self, column: &[f64]) {
        let length = dot(column, column);
        let mut left = column.to_vec();
        // Twice, as one pass leaves rounding.
        self.clear(&mut left);
        self.clear(&mut left);
        let rest = dot(&left, &left);
        if rest <= 1e-8 * length || rest <= 0.0 {
            return;
        }
        let scale = 1.0 / rest.sqrt();
        left.iter_mut().for_each(|v| *v *= scale);
        let part = dot(&left, &self.residual);
        self.residual.iter_mut().zip(&left).for_each(|(e, v)| *e -= part * v);
        self.axes.push(left);
    }

    fn clear(&self, column: &mut [f64]) {
        for axis in &self.axes {
            let part = dot(axis, column);
            column.iter_mut().zip(axis).for_each(|(c, a)| *c -= part * a);
        }
    }

    /// The square that a column takes of the residual.
    fn takes(&self, column: &[f64]) -> f64 {
        let length = dot(column, column);
        let rest = length - self.axes.iter().map(|axis| dot(axis, column).powi(2)).sum::<f64>();
        if rest > 1e-4 * length && rest > 0.0 { dot(column, &self.residual).powi(2) / rest } else { 0.0 }
    }

    /// The square that all columns together leave.
    fn leave(&self, columns: &[Vec<f64>]) -> f64 {
        let n = columns.len();
        let cleared: Vec<Vec<f64>> = columns
            .iter()
            .map(|c| {
                let mut c = c[..self.residual.len()].to_vec();
                self.clear(&mut c);
                c
            })
            .collect();
        let mut normal = DMatrix::from_fn(n, n, |i, j| dot(&cleared[i], &cleared[j]));
        for k in 0..n {
            // A little, so that two terms that are nearly one do not grow against each other.
            normal[(k, k)] *= 1.0 + 1e-4;
            normal[(k, k)] += 1e-12;
        }
        let right = DVector::from_fn(n, |k, _| dot(&cleared[k], &self.residual));
        let all = dot(&self.residual, &self.residual);
        normal.cholesky().map_or(all, |factor| {
            let found = factor.solve(&right);
            let mut left = self.residual.clone();
            for (column, value) in cleared.iter().zip(found.iter()) {
                left.iter_mut().zip(column).for_each(|(e, v)| *e -= value * v);
            }
            dot(&left, &left)
        })
    }
}

/// The formula of these states.
pub fn distil(rows: &Rows<'_>, states: &[&Tried]) -> Formula {
    let base = Cleared::of(rows);
    let mut known = Known::new(rows, states);
    let mut formula: Formula = Vec::new();
    let mut left = dot(&base.residual, &base.residual);
    let mut now: Vec<Tried> = states.iter().copied().cloned().collect();
    while formula.len() < MOST_TERMS {
        let Some(factors) = best(rows, &base, &mut known, &formula, &now) else { break };
        let mut longer = formula.clone();
        longer.push(factors);
        let (longer, next) = refined(rows, &base, &mut known, longer);
        if next > (1.0 - WORTH) * left {
            break;
        }
        (formula, left) = (longer, next);
        // What follows begins at the states as they are refined.
        for tried in &mut now {
            let same = formula.iter().flatten().find(|f| f.state.kind == tried.state.kind);
            if let Some(f) = same {
                (tried.state, tried.values, tried.seen) = (f.state, known.values(f.state).to_vec(), f.seen);
            }
        }
    }
    formula
}

/// The product of functions of these states that takes most of what a formula leaves.
fn best(rows: &Rows<'_>, base: &Cleared, known: &mut Known<'_, '_>, formula: &Formula, states: &[Tried]) -> Option<Vec<Factor>> {
    let n = rows.searched;
    let mut now = Cleared { axes: base.axes.clone(), residual: base.residual.clone() };
    for factors in formula {
        now.add(&known.column(factors)[..n]);
    }
    let offered = products(&states.iter().collect::<Vec<_>>());
    let single: Vec<(Factor, Vec<f64>)> = offered.iter().filter(|f| f.len() == 1).map(|f| (f[0], known.column(f))).collect();
    let column = |f: &Factor| single.iter().find(|(own, _)| own == f).map(|(_, column)| &column[..n]);
    let takes = |factors: &[Factor]| match factors {
        [one] => column(one).map_or(0.0, |c| now.takes(c)),
        [one, two] => {
            column(one).zip(column(two)).map_or(0.0, |(a, b)| now.takes(&a.iter().zip(b).map(|(a, b)| a * b).collect::<Vec<f64>>()))
        }
        _ => 0.0,
    };
    let all = offered.par_iter().enumerate().map(|(k, factors)| (takes(factors), k));
    let most = all.reduce(|| (0.0, usize::MAX), |a, b| if b.0 > a.0 || b.0 == a.0 && b.1 < a.1 { b } else { a });
    offered.get(most.1).cloned()
}

/// One number of a formula.
#[derive(Clone, Copy)]
enum Number {
    Centre(usize, usize),
    Width(usize, usize),
    /// A value of the state that stands here, wherever it stands.
    Of(usize, usize, usize),
}

/// The formula with its numbers moved one by one as long as less is left, and what is.
fn refined(rows: &Rows<'_>, base: &Cleared, known: &mut Known<'_, '_>, mut formula: Formula) -> (Formula, f64) {
    let mut columns: Vec<Vec<f64>> = formula.iter().map(|f| known.column(f)).collect();
    let mut left = base.leave(&columns);
    for step in STEPS {
        for _ in 0..ROUNDS {
            let before = left;
            for number in numbers_of(&formula) {
                for sign in [1.0, -1.0] {
                    let Some(moved) = moved(rows, known, &formula, number, sign * step) else { continue };
                    let next: Vec<Vec<f64>> = (0..moved.len())
                        .map(|k| if moved[k] == formula[k] { columns[k].clone() } else { known.column(&moved[k]) })
                        .collect();
                    let square = base.leave(&next);
                    if square < left {
                        (formula, columns, left) = (moved, next, square);
                        break;
                    }
                }
            }
            if left > 0.998 * before {
                break;
            }
        }
    }
    (formula, left)
}

fn numbers_of(formula: &Formula) -> Vec<Number> {
    let mut out = Vec::new();
    let mut met: Vec<State> = Vec::new();
    for (t, term) in formula.iter().enumerate() {
        for (f, factor) in term.iter().enumerate() {
            if !met.contains(&factor.state) {
                met.push(factor.state);
                out.extend((0..factor.state.kind.values().len()).filter(|v| factor.state.values[*v] > 0.0).map(|v| Number::Of(t, f, v)));
            }
            // A single line is its coefficient and a constant, which moves besides.
            if term.len() > 1 || !matches!(factor.shape, crate::physics::Shape::Line) {
                out.extend([Number::Centre(t, f), Number::Width(t, f)]);
            }
        }
    }
    out
}

/// The formula with one number moved; nothing where it may not.
fn moved(rows: &Rows<'_>, known: &mut Known<'_, '_>, formula: &Formula, number: Number, step: f64) -> Option<Formula> {
    let mut moved = formula.clone();
    match number {
        Number::Centre(t, f) => {
            let factor = &mut moved[t][f];
            factor.centre += step * factor.width;
            let wide = factor.seen.1 - factor.seen.0;
            (factor.seen.0 - wide..factor.seen.1 + wide).contains(&factor.centre).then_some(moved)
        }
        Number::Width(t, f) => {
            let factor = &mut moved[t][f];
            factor.width *= step.exp();
            let wide = factor.seen.1 - factor.seen.0;
            (WIDTHS.0 * wide..WIDTHS.1 * wide).contains(&factor.width).then_some(moved)
        }
        Number::Of(t, f, v) => {
            let old = formula[t][f].state;
            let mut state = old;
            state.values[v] *= step.exp();
            let is_time = old.kind.values()[v].1.symbol == "s";
            let allowed = !is_time || (MEMORIES_S.0..MEMORIES_S.1).contains(&state.values[v]);
            let apart = state.kind != StateKind::Switch || state.values[0] > state.values[1];
            if !allowed || !apart {
                return None;
            }
            let seen = rows.seen(state, known.values(state))?;
            for factor in moved.iter_mut().flatten().filter(|f| f.state == old) {
                (factor.state, factor.seen) = (state, seen);
            }
            Some(moved)
        }
    }
}

/// A number as short as a formula has it.
fn short(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// The formula with its numbers as they are written.
pub fn shortened(formula: &Formula) -> Formula {
    let factor = |f: &Factor| Factor {
        state: State { values: f.state.values.map(short), ..f.state },
        centre: short(f.centre),
        width: short(f.width),
        seen: (short(f.seen.0), short(f.seen.1)),
        ..*f
    };
    formula.iter().map(|term| term.iter().map(factor).collect()).collect()
}

/// The terms of a formula with these coefficients [bar].
pub fn with_coefficients(formula: &Formula, coefficients_bar: &[f64]) -> Vec<Term> {
    formula.iter().zip(coefficients_bar).map(|(f, c)| Term { coefficient_bar: short(*c), factors: f.clone() }).collect()
}
