//! The states that are tried, alone and in pairs, in the size of the valve's own pressures.

use super::rows::Rows;
use crate::physics::{State, StateKind};

/// A state with its values at the rows and the range in which it moves.
#[derive(Clone)]
pub struct Tried {
    /// The state.
    pub state: State,
    /// Its value at each row.
    pub values: Vec<f64>,
    /// Where it moves.
    pub seen: (f64, f64),
}

impl Tried {
    /// Whether it is a time since an event.
    pub fn is_since(&self) -> bool {
        matches!(self.state.kind, StateKind::SinceReversal | StateKind::SinceShift)
    }
}

/// What a smooth function is tried of: one state, or two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Candidate {
    /// The first.
    pub first: usize,
    /// The second; the first again where there is one only.
    pub second: usize,
}

impl Candidate {
    /// Whether there is one state only.
    pub fn alone(self) -> bool {
        self.first == self.second
    }
}

/// Memories of a past [s].
const MEMORIES_S: [f64; 9] = [0.05, 0.1, 0.2, 0.4, 0.8, 1.5, 3.0, 6.0, 12.0];
/// Memories and delays of a late change [s].
const LATE_MEMORIES_S: [f64; 2] = [0.4, 1.5];
const DELAYS_S: [f64; 8] = [0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.1, 1.4];
/// Times across which and over which agitation is counted [s].
const ACROSS_S: [f64; 2] = [0.1, 0.4];
const OVER_S: [f64; 5] = [0.2, 0.5, 1.2, 2.5, 6.0];
/// Half-widths of a play, sizes of a turn and of a shift, in parts of the span.
const PLAYS: [f64; 4] = [0.02, 0.06, 0.15, 0.3];
const TURNS: [f64; 2] = [0.03, 0.1];
const SHIFTS: [f64; 5] = [0.08, 0.12, 0.17, 0.24, 0.32];
/// Times without a shift ahead of one [s].
const QUIETS_S: [f64; 2] = [0.5, 2.5];
/// Levels of a switch, in parts of the span, and how late it turns [s].
const LEVELS: [f64; 6] = [0.15, 0.28, 0.41, 0.54, 0.67, 0.8];
const LATES_S: [f64; 2] = [0.0, 0.7];

/// All states that are tried.
pub fn tried(rows: &Rows<'_>) -> Vec<Tried> {
    use rayon::prelude::*;
    let (low, high) = rows.span_bar();
    let span = high - low;
    let mut all: Vec<State> = Vec::new();
    let mut add = |kind: StateKind, values: &[f64]| all.push(State::new(kind, values));
    for kind in [StateKind::Pressure, StateKind::Current, StateKind::OilTemperature, StateKind::SupplyPressure] {
        add(kind, &[]);
    }
    for memory in MEMORIES_S {
        add(StateKind::PastPressure, &[memory]);
        add(StateKind::PressureChange, &[memory, 0.0]);
    }
    for (memory, delay) in LATE_MEMORIES_S.iter().flat_map(|m| DELAYS_S.iter().map(move |d| (*m, *d))) {
        add(StateKind::PressureChange, &[memory, delay]);
    }
    for (across, over) in ACROSS_S.iter().flat_map(|a| OVER_S.iter().map(move |o| (*a, *o))) {
        add(StateKind::Agitation, &[across, over]);
        add(StateKind::Fall, &[across, over]);
        add(StateKind::Rise, &[across, over]);
    }
    PLAYS.iter().for_each(|part| add(StateKind::Play, &[part * span]));
    TURNS.iter().for_each(|part| add(StateKind::SinceReversal, &[part * span]));
    for (part, quiet) in SHIFTS.iter().flat_map(|s| QUIETS_S.iter().map(move |q| (*s, *q))) {
        add(StateKind::SinceShift, &[part * span, quiet]);
    }
    for (k, on) in LEVELS.iter().enumerate() {
        for (off, late) in LEVELS[..k].iter().flat_map(|o| LATES_S.iter().map(move |l| (*o, *l))) {
            add(StateKind::Switch, &[low + on * span, low + off * span, late]);
        }
    }
    let of = |state: State| {
        let values = rows.follow(state);
        let seen = rows.seen(state, &values)?;
        Some(Tried { state, values, seen })
    };
    all.into_par_iter().filter_map(of).collect()
}

/// What is tried: every state alone; the pressure, the oil temperature and the quick change each with every other one.
pub fn candidates(tried: &[Tried]) -> Vec<Candidate> {
    let alone = (0..tried.len()).map(|k| Candidate { first: k, second: k });
    let leads = |s: &State| {
        matches!(s.kind, StateKind::Pressure | StateKind::OilTemperature)
            || s.kind == StateKind::PressureChange && s.values[0] == MEMORIES_S[1] && s.values[1] == 0.0
    };
    let leading: Vec<usize> = (0..tried.len()).filter(|k| leads(&tried[*k].state)).collect();
    let pairs = leading.iter().enumerate().flat_map(|(n, first)| {
        let earlier = leading[..n].to_vec();
        (0..tried.len()).filter(move |k| k != first && !earlier.contains(k)).map(|second| Candidate { first: *first, second })
    });
    alone.chain(pairs).collect()
}
