//! # Discovered term
//!
//! What it is: a dependence that no effect of the library holds, found in recordings as a formula; the formula says what
//! the error follows, never why.
//!
//! Model: P = P0 + sum of terms, each a coefficient times up to three plain functions (line, square, cube, tanh, sin, bump,
//! decay) of z = (state - centre) / width. A state is made of the pressure, the current or a recorded channel of the free
//! run itself: pressure, current, oil_temperature, supply_pressure, past_pressure(memory), pressure_change(memory, delay),
//! agitation, fall and rise(across, memory), play(half_width), since_reversal(turn), since_shift(shift, quiet),
//! switch(on, off, late). Beyond the range in which it was found a state counts as the end of it.
//!
//! Signature: an error that repeats wherever the states do, also on a recording that the formula was not found on.
//!
//! What to check on the bench: whatever moves the states of the formula one at a time; a second recording confirms or refutes it.
//!
//! Source: Brunton, Proctor, Kutz, PNAS 113 (2016) 3932 (sparse choice of terms); Ramsay and Silverman, Functional Data
//! Analysis, Springer 2005, chapter 5 (splines with a penalty), by which the states are found.

mod formula;
mod state;
mod tracker;

pub use formula::{Factor, MOST_FACTORS, Shape, Term, numbers, state_text, terms};
pub use state::{State, StateKind};
pub use tracker::{Seen, Tracker};

use super::block::{Block, Dynamic};
use super::effect::{Channel, Context, Effect, Parameter, Stage, Theta};
use super::error::PhysicsError;
use super::signal::{Point, Step};
use crate::valve::EffectSpec;
use formula::{FormulaError, quantity, state_of};

/// The effect `discovered`.
pub struct Discovered;

/// Terms that hold each kind of memory, with which the laws of the effects are tried. Events are the same at every sampling
/// rate but where the pressure just touches their threshold, which it does not in the laws' course.
const EXAMPLES: [&str; 6] = [
    "0.8 bar * sin((pressure - 3 bar) / 1.5 bar) * sin((past_pressure(3.8 s) - 1 bar) / 2 bar)",
    "0.5 bar * tanh((pressure_change(0.4 s, 0.33 s) - 0 bar) / 4 bar)",
    "0.4 bar * decay((since_reversal(1.5 bar) - 0 s) / 2 s) * line((play(2 bar) - 0 bar) / 2 bar)",
    "0.3 bar * square((agitation(0.4 s, 2.5 s) - 0 bar) / 2 bar)",
    "0.5 bar * line((switch(14 bar, 6 bar, 0.33 s) - 0) / 1)",
    "0.5 bar * bump((since_shift(5 bar, 1 s) - 0.5 s) / 0.5 s)",
];

impl Effect for Discovered {
    fn id(&self) -> &'static str {
        "discovered"
    }
    fn source_text(&self) -> &'static str {
        include_str!("mod.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Creep
    }
    fn searched(&self) -> bool {
        false
    }
    fn parameters(&self) -> &'static [Parameter] {
        &[]
    }
    fn examples(&self) -> Vec<Vec<f64>> {
        EXAMPLES.iter().filter_map(|text| Term::parse(text).ok()).map(|term| numbers(&[term])).collect()
    }
    fn read(&self, spec: &EffectSpec) -> Option<Result<Vec<f64>, PhysicsError>> {
        Some(read(spec))
    }
    fn write(&self, theta: Theta<'_>) -> Option<Vec<(String, String)>> {
        Some(written(&terms(theta)))
    }
    fn memory_s(&self, theta: Theta<'_>) -> f64 {
        states(&terms(theta)).iter().map(State::memory_s).fold(0.0, f64::max)
    }
    fn shortest_s(&self, theta: Theta<'_>) -> f64 {
        states(&terms(theta)).iter().map(State::shortest_s).fold(f64::INFINITY, f64::min)
    }
    fn uses(&self, theta: Theta<'_>) -> Vec<Channel> {
        let has = |kind: StateKind| states(&terms(theta)).iter().any(|s| s.kind == kind);
        let all = [(StateKind::OilTemperature, Channel::OilTemperature), (StateKind::SupplyPressure, Channel::SupplyPressure)];
        all.into_iter().filter(|(kind, _)| has(*kind)).map(|(_, channel)| channel).collect()
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        Block::dynamic(Adding::new(terms(theta), context))
    }
}

/// The states of these terms, each once.
fn states(terms: &[Term]) -> Vec<State> {
    let mut all: Vec<State> = Vec::new();
    for factor in terms.iter().flat_map(|t| &t.factors) {
        if !all.contains(&factor.state) {
            all.push(factor.state);
        }
    }
    all
}

/// The terms as a valve file has them: `term_1 = ".."` and so on, and the range of each state as `seen_1 = "pressure: 1 bar to 20 bar"`.
pub fn written(terms: &[Term]) -> Vec<(String, String)> {
    let mut out: Vec<(String, String)> = terms.iter().enumerate().map(|(k, t)| (format!("term_{}", k + 1), t.text())).collect();
    let mut seen: Vec<String> = Vec::new();
    for f in terms.iter().flat_map(|t| &t.factors).filter(|f| f.seen.0.is_finite() && f.seen.1.is_finite()) {
        let unit = f.state.kind.unit();
        let text = format!("{}: {} to {}", state_text(&f.state), quantity(f.seen.0, unit), quantity(f.seen.1, unit));
        if !seen.contains(&text) {
            seen.push(text);
        }
    }
    out.extend(seen.into_iter().enumerate().map(|(k, text)| (format!("seen_{}", k + 1), text)));
    out
}

fn read(spec: &EffectSpec) -> Result<Vec<f64>, PhysicsError> {
    let numbered = |name: &str, prefix: &str| name.strip_prefix(prefix).is_some_and(|n| n.parse::<u32>().is_ok());
    let said = |name: &str, e: FormulaError| match e {
        FormulaError::Quantity(source) => PhysicsError::Quantity { effect: spec.id.clone(), name: name.into(), source: Box::new(source) },
        FormulaError::Words(problem) => PhysicsError::Formula { effect: spec.id.clone(), name: name.into(), problem },
    };
    let mut terms = Vec::new();
    for (name, text) in spec.parameters.iter().filter(|(name, _)| !numbered(name, "seen_")) {
        if !numbered(name, "term_") {
            let known = "term_1, term_2, .. and seen_1, seen_2, ..".into();
            return Err(PhysicsError::UnknownParameter { effect: spec.id.clone(), name: name.clone(), known });
        }
        terms.push(Term::parse(text).map_err(|e| said(name, e))?);
    }
    if terms.is_empty() {
        return Err(PhysicsError::MissingParameter { effect: spec.id.clone(), name: "term_1".into(), meaning: "a formula".into() });
    }
    for (name, text) in spec.parameters.iter().filter(|(name, _)| numbered(name, "seen_")) {
        let (state, range) = range_of(text).map_err(|e| said(name, e))?;
        for f in terms.iter_mut().flat_map(|t| &mut t.factors).filter(|f| f.state == state) {
            f.seen = range;
        }
    }
    Ok(numbers(&terms))
}

/// The state and its range of a text such as `past_pressure(3.8 s): 1 bar to 20 bar`.
fn range_of(text: &str) -> Result<(State, (f64, f64)), FormulaError> {
    let form = || FormulaError::Words(format!("`{text}` is no range; write for instance `pressure: 1 bar to 20 bar`"));
    let (state, range) = text.split_once(": ").ok_or_else(form)?;
    let state = state_of(state)?;
    let (low, high) = range.split_once(" to ").ok_or_else(form)?;
    let unit = state.kind.unit();
    let (low, high) = (unit.parse(low)?, unit.parse(high)?);
    if low > high {
        return Err(FormulaError::Words(format!("`{text}`: the smaller one stands first")));
    }
    Ok((state, (low, high)))
}

/// The effect at work.
struct Adding {
    terms: Vec<Term>,
    /// Which tracker each factor of each term reads.
    reads: Vec<Vec<usize>>,
    trackers: Vec<Tracker>,
    values: Vec<f64>,
    dt_s: f64,
    left: f64,
    added: f64,
}

impl Adding {
    fn new(terms: Vec<Term>, context: &Context) -> Self {
        let all = states(&terms);
        let place = |f: &Factor| all.iter().position(|s| *s == f.state);
        let reads = terms.iter().map(|t| t.factors.iter().filter_map(place).collect()).collect();
        let trackers: Vec<Tracker> = all.iter().map(|s| Tracker::new(*s, context.dt_s)).collect();
        let values = vec![0.0; trackers.len()];
        Self { terms, reads, trackers, values, dt_s: context.dt_s, left: context.arrival.left(), added: 0.0 }
    }

    /// The sum of the terms; one that needs what is not recorded adds nothing.
    fn sum(&mut self) -> f64 {
        for (value, tracker) in self.values.iter_mut().zip(&mut self.trackers) {
            *value = tracker.end_step();
        }
        let of = |(term, reads): (&Term, &Vec<usize>)| {
            let product =
                term.factors.iter().zip(reads).map(|(f, at)| if self.values[*at].is_nan() { 0.0 } else { f.at(self.values[*at]) });
            term.coefficient_bar * product.product::<f64>()
        };
        self.terms.iter().zip(&self.reads).map(of).sum()
    }
}

impl Dynamic for Adding {
    fn start(&mut self, at: &Point, input: f64) {
        let seen = seen(at, 0.0, input, input);
        self.trackers.iter_mut().for_each(|t| t.start(&seen));
        self.added = self.sum();
    }
    fn step(&mut self, at: &Point, from: f64, input: Step) -> Step {
        let (dt_s, left) = (self.dt_s, self.left);
        let trackers = &mut self.trackers;
        input.pieces(from, left, f64::INFINITY, |share, a, b| {
            let seen = seen(at, share * dt_s, a, b);
            trackers.iter_mut().for_each(|t| t.advance(&seen));
        });
        let before = std::mem::replace(&mut self.added, 0.0);
        self.added = self.sum();
        Step { to: input.to + self.added, mean: input.mean + 0.5 * (before + self.added), jump: input.jump }
    }
}

fn seen(at: &Point, lasts_s: f64, from_bar: f64, to_bar: f64) -> Seen {
    Seen { lasts_s, from_bar, to_bar, current_a: at.current_a, oil_temp_c: at.oil_temp_c, supply_bar: at.supply_bar }
}

#[cfg(test)]
mod tests;
