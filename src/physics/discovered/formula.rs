//! A discovered term as a formula: a coefficient and up to three factors, each a plain function of one state; as text with units,
//! and as the numbers that an effect's values are.

use super::state::{MOST_VALUES, State, StateKind};
use crate::units::{PRESSURE, Unit, UnitError};

/// A plain function of z = (state - centre) / width.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// z.
    Line,
    /// z^2.
    Square,
    /// z^3.
    Cube,
    /// tanh z.
    Tanh,
    /// sin z.
    Sin,
    /// exp(-z^2).
    Bump,
    /// exp(-z), 1 ahead of the centre.
    Decay,
}

impl Shape {
    /// All shapes; a number in an effect's values is a place in this list.
    pub const ALL: [Self; 7] = [Self::Line, Self::Square, Self::Cube, Self::Tanh, Self::Sin, Self::Bump, Self::Decay];

    /// Its name in a formula.
    pub fn name(self) -> &'static str {
        match self {
            Self::Line => "line",
            Self::Square => "square",
            Self::Cube => "cube",
            Self::Tanh => "tanh",
            Self::Sin => "sin",
            Self::Bump => "bump",
            Self::Decay => "decay",
        }
    }

    /// Its value.
    #[inline]
    pub fn at(self, z: f64) -> f64 {
        match self {
            Self::Line => z,
            Self::Square => z * z,
            Self::Cube => z * z * z,
            Self::Tanh => z.tanh(),
            Self::Sin => z.sin(),
            Self::Bump => (-z * z).exp(),
            Self::Decay => (-z.max(0.0)).exp(),
        }
    }
}

/// A function of one state, which counts no further than it was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factor {
    /// The function.
    pub shape: Shape,
    /// The state.
    pub state: State,
    /// Where it is centred, in the unit of the state.
    pub centre: f64,
    /// What counts as one, in the unit of the state.
    pub width: f64,
    /// The range of the state in which the term was found; beyond it the state counts as its end.
    pub seen: (f64, f64),
}

impl Factor {
    /// Its value at a value of its state.
    #[inline]
    pub fn at(&self, state: f64) -> f64 {
        self.shape.at((state.max(self.seen.0).min(self.seen.1) - self.centre) / self.width)
    }
}

/// A term.
#[derive(Debug, Clone, PartialEq)]
pub struct Term {
    /// What it adds where all factors are one [bar].
    pub coefficient_bar: f64,
    /// Its factors.
    pub factors: Vec<Factor>,
}

/// What is wrong with the text of a term.
#[derive(Debug, Clone, PartialEq)]
pub enum FormulaError {
    /// A quantity.
    Quantity(UnitError),
    /// Anything else, in words.
    Words(String),
}

impl From<UnitError> for FormulaError {
    fn from(e: UnitError) -> Self {
        Self::Quantity(e)
    }
}

/// Most factors of a term.
pub const MOST_FACTORS: usize = 3;
/// Numbers of a factor, and of a term ahead of its factors.
const PER_FACTOR: usize = 6 + MOST_VALUES;
const AHEAD: usize = 2;

/// A value with its unit, as a file has it.
pub fn quantity(value: f64, unit: &Unit) -> String {
    if unit.symbol == "1" { format!("{value}") } else { format!("{value} {}", unit.symbol) }
}

/// The text of a state.
pub fn state_text(state: &State) -> String {
    let values: Vec<String> = state.kind.values().iter().zip(state.values).map(|((_, unit), v)| quantity(v, unit)).collect();
    if values.is_empty() { state.kind.name().into() } else { format!("{}({})", state.kind.name(), values.join(", ")) }
}

/// The state of a text.
///
/// # Errors
/// [`FormulaError`] in words for the user.
pub fn state_of(text: &str) -> Result<State, FormulaError> {
    let text = text.trim();
    let (name, inner) = match text.split_once('(') {
        Some((name, rest)) => {
            (name.trim(), rest.strip_suffix(')').ok_or_else(|| FormulaError::Words(format!("`{text}` lacks its closing bracket")))?)
        }
        None => (text, ""),
    };
    let kind = StateKind::ALL.into_iter().find(|k| k.name() == name).ok_or_else(|| {
        let known: Vec<&str> = StateKind::ALL.iter().map(|k| k.name()).collect();
        FormulaError::Words(format!("`{name}` is no state; there are: {}", known.join(", ")))
    })?;
    let given: Vec<&str> = inner.split(',').map(str::trim).filter(|v| !v.is_empty()).collect();
    let wanted = kind.values();
    if given.len() != wanted.len() {
        let names: Vec<String> = wanted.iter().map(|(n, unit)| format!("{n} [{}]", unit.symbol)).collect();
        return Err(FormulaError::Words(format!(
            "`{text}` has {} values; `{name}` takes {}: {}",
            given.len(),
            wanted.len(),
            names.join(", ")
        )));
    }
    let values = given.iter().zip(wanted).map(|(text, (_, unit))| unit.parse(text)).collect::<Result<Vec<f64>, _>>()?;
    if let Some((at, value)) = values.iter().enumerate().find(|(_, v)| **v < 0.0) {
        return Err(FormulaError::Words(format!("{} of `{text}` is {value}; 0 or more is allowed", wanted[at].0)));
    }
    Ok(State::new(kind, &values))
}

impl Term {
    /// Its text: `0.8 bar * sin((pressure - 3 bar) / 1.1 bar) * tanh((past_pressure(3.8 s) - 12 bar) / 2 bar)`.
    pub fn text(&self) -> String {
        let factor = |f: &Factor| {
            let unit = f.state.kind.unit();
            format!("{}(({} - {}) / {})", f.shape.name(), state_text(&f.state), quantity(f.centre, unit), quantity(f.width, unit))
        };
        let first = quantity(self.coefficient_bar, &PRESSURE);
        std::iter::once(first).chain(self.factors.iter().map(factor)).collect::<Vec<_>>().join(" * ")
    }

    /// The term of a text; where its states were seen is not in it.
    ///
    /// # Errors
    /// What is wrong with the formula, in words for the user.
    pub fn parse(text: &str) -> Result<Self, FormulaError> {
        let mut parts = text.split(" * ");
        let coefficient_bar = PRESSURE.parse(parts.next().unwrap_or_default())?;
        let factors = parts.map(factor_of).collect::<Result<Vec<_>, _>>()?;
        if factors.is_empty() || factors.len() > MOST_FACTORS {
            return Err(FormulaError::Words(format!(
                "has {} factors behind its coefficient; 1 to {MOST_FACTORS} are allowed",
                factors.len()
            )));
        }
        Ok(Self { coefficient_bar, factors })
    }
}

fn factor_of(text: &str) -> Result<Factor, FormulaError> {
    let form = || FormulaError::Words(format!("`{text}` is no factor; write for instance `tanh((pressure - 3 bar) / 1.5 bar)`"));
    let (name, rest) = text.trim().split_once('(').ok_or_else(form)?;
    let shape = Shape::ALL.into_iter().find(|s| s.name() == name).ok_or_else(|| {
        let known: Vec<&str> = Shape::ALL.iter().map(|s| s.name()).collect();
        FormulaError::Words(format!("`{name}` is no shape; there are: {}", known.join(", ")))
    })?;
    let inner = rest.strip_suffix(')').ok_or_else(form)?;
    let (left, width) = inner.rsplit_once(" / ").ok_or_else(form)?;
    let left = left.strip_prefix('(').and_then(|l| l.strip_suffix(')')).ok_or_else(form)?;
    let (state, centre) = left.rsplit_once(" - ").ok_or_else(form)?;
    let state = state_of(state)?;
    let unit = state.kind.unit();
    let width = unit.parse(width)?;
    if width == 0.0 {
        return Err(FormulaError::Words(format!("`{text}` divides by 0")));
    }
    Ok(Factor { shape, state, centre: unit.parse(centre)?, width, seen: (f64::NEG_INFINITY, f64::INFINITY) })
}

/// Terms as the numbers of an effect's values: an effect knows numbers only.
pub fn numbers(terms: &[Term]) -> Vec<f64> {
    let mut out = Vec::new();
    for term in terms {
        out.extend([term.coefficient_bar, term.factors.len() as f64]);
        for f in &term.factors {
            let place = |at: Option<usize>| at.unwrap_or(0) as f64;
            out.push(place(Shape::ALL.iter().position(|s| *s == f.shape)));
            out.push(place(StateKind::ALL.iter().position(|k| *k == f.state.kind)));
            out.extend(f.state.values);
            out.extend([f.centre, f.width, f.seen.0, f.seen.1]);
        }
    }
    out
}

/// The terms of an effect's values, as [`numbers`] writes them.
pub fn terms(numbers: &[f64]) -> Vec<Term> {
    let mut out = Vec::new();
    let mut rest = numbers;
    while let [coefficient_bar, count, ..] = *rest {
        let end = AHEAD + count as usize * PER_FACTOR;
        let Some(body) = rest.get(AHEAD..end) else { break };
        let factor = |n: &[f64]| {
            let [shape, kind] = [n[0], n[1]].map(|at| at as usize);
            let (values, tail) = n[2..].split_at(MOST_VALUES);
            Factor {
                shape: Shape::ALL[shape.min(Shape::ALL.len() - 1)],
                state: State::new(StateKind::ALL[kind.min(StateKind::ALL.len() - 1)], values),
                centre: tail[0],
                width: tail[1],
                seen: (tail[2], tail[3]),
            }
        };
        out.push(Term { coefficient_bar, factors: body.chunks_exact(PER_FACTOR).map(factor).collect() });
        rest = &rest[end..];
    }
    out
}
