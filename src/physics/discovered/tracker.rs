//! A state followed through time, on the pressure that a model goes through by itself.

use std::collections::VecDeque;

use super::state::{State, StateKind};

/// A time since an event that has not been [s].
const NEVER_S: f64 = 100.0;
/// Memory of the level from which a shift is counted [s].
const LEVEL_S: f64 = 0.5;
/// Lag of a switch [s].
const SWITCH_S: f64 = 0.1;
/// Longest delay [steps]: of longer ones this much.
const MOST_STEPS: f64 = 1e6;

/// What is seen over a part of a step.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// How long it is [s].
    pub lasts_s: f64,
    /// Pressure at its begin [bar].
    pub from_bar: f64,
    /// Pressure at its end [bar].
    pub to_bar: f64,
    /// Current at the static curve [A].
    pub current_a: f64,
    /// Oil temperature [degC]; NaN where not recorded.
    pub oil_temp_c: f64,
    /// Supply pressure [bar]; NaN where not recorded.
    pub supply_bar: f64,
}

/// A first-order lag on straight lines of any length.
#[derive(Debug, Clone, Copy)]
struct Lag {
    tau_s: f64,
    value: f64,
    /// The last length of a line, and what is left of a deviation after it.
    decay: (f64, f64),
}

impl Lag {
    fn new(tau_s: f64) -> Self {
        Self { tau_s: tau_s.max(1e-4), value: 0.0, decay: (0.0, 1.0) }
    }

    fn advance(&mut self, lasts_s: f64, from: f64, to: f64) -> f64 {
        if lasts_s <= 0.0 {
            return self.value;
        }
        if self.decay.0 != lasts_s {
            self.decay = (lasts_s, (-lasts_s / self.tau_s).exp());
        }
        let behind = (to - from) / lasts_s * self.tau_s;
        self.value = to - behind + (self.value - from + behind) * self.decay.1;
        self.value
    }
}

/// A state at work.
#[derive(Debug, Clone)]
pub struct Tracker {
    state: State,
    /// Of the pressure, and of what is made of it.
    lags: [Lag; 2],
    /// What is made of the pressure, at the last time.
    made: f64,
    value: f64,
    /// The extreme since the last turn, or where a play stands [bar].
    mark_bar: f64,
    /// Whether the pressure rises, or a switch is on.
    up: bool,
    /// Time since an event, or for which a switch has been asked to turn [s].
    since_s: f64,
    /// Past values, the latest first, and the delay in steps.
    past: VecDeque<f64>,
    delay_steps: f64,
}

/// The part of a line from `from` to `to` that lies behind its crossing of `level`; none where it ends there.
fn behind(from: f64, to: f64, level: f64) -> f64 {
    if (from - level) * (to - level) < 0.0 { (to - level) / (to - from) } else { 0.0 }
}

impl Tracker {
    /// Followed in steps of `dt_s`.
    pub fn new(state: State, dt_s: f64) -> Self {
        let [a, b, _] = state.values;
        let lags = match state.kind {
            StateKind::SinceShift => [LEVEL_S, LEVEL_S],
            StateKind::Switch => [SWITCH_S, SWITCH_S],
            _ => [a, b],
        };
        let delay_steps = if state.kind == StateKind::PressureChange { (b / dt_s).clamp(0.0, MOST_STEPS) } else { 0.0 };
        Self {
            state,
            lags: lags.map(Lag::new),
            made: 0.0,
            value: 0.0,
            mark_bar: 0.0,
            up: true,
            since_s: NEVER_S,
            past: VecDeque::new(),
            delay_steps,
        }
    }

    /// Settles where the pressure has always stood.
    pub fn start(&mut self, seen: &Seen) {
        let pressure = seen.to_bar;
        self.lags[0].value = pressure;
        self.lags[1].value = 0.0;
        (self.mark_bar, self.made) = (pressure, 0.0);
        self.since_s = NEVER_S;
        let [on, off, _] = self.state.values;
        self.up = self.state.kind != StateKind::Switch || pressure > 0.5 * (on + off);
        self.past = std::iter::repeat_n(0.0, self.delay_steps.ceil() as usize + 2).collect();
        self.value = match self.state.kind {
            StateKind::PastPressure => pressure,
            StateKind::SinceReversal | StateKind::SinceShift => NEVER_S,
            StateKind::Switch => {
                (self.lags[1].value, self.since_s) = (f64::from(self.up), 0.0);
                self.lags[1].value
            }
            _ => self.plain(seen).unwrap_or(0.0),
        };
    }

    /// A state that is what is seen.
    fn plain(&self, seen: &Seen) -> Option<f64> {
        match self.state.kind {
            StateKind::Pressure => Some(seen.to_bar),
            StateKind::Current => Some(seen.current_a),
            StateKind::OilTemperature => Some(seen.oil_temp_c),
            StateKind::SupplyPressure => Some(seen.supply_bar),
            _ => None,
        }
    }

    /// Goes on over a part of a step.
    pub fn advance(&mut self, seen: &Seen) {
        let Seen { lasts_s, from_bar, to_bar, .. } = *seen;
        self.value = match self.state.kind {
            StateKind::PastPressure => self.lags[0].advance(lasts_s, from_bar, to_bar),
            StateKind::PressureChange => to_bar - self.lags[0].advance(lasts_s, from_bar, to_bar),
            StateKind::Agitation => self.through(seen, f64::abs),
            StateKind::Fall => self.through(seen, |change| (-change).max(0.0)),
            StateKind::Rise => self.through(seen, |change| change.max(0.0)),
            StateKind::Play => {
                let half = self.state.values[0];
                self.mark_bar = self.mark_bar.clamp(to_bar - half, to_bar + half);
                to_bar - self.mark_bar
            }
            StateKind::SinceReversal => self.turned(seen),
            StateKind::SinceShift => self.shifted(seen),
            StateKind::Switch => self.switched(seen),
            _ => self.plain(seen).unwrap_or(0.0),
        };
    }

    /// The state at the end of a step.
    pub fn end_step(&mut self) -> f64 {
        if self.delay_steps == 0.0 {
            return self.value;
        }
        self.past.pop_back();
        self.past.push_front(self.value);
        let (whole, part) = (self.delay_steps as usize, self.delay_steps.fract());
        let at = |k: usize| self.past.get(k).copied().unwrap_or(0.0);
        at(whole) + part * (at(whole + 1) - at(whole))
    }

    /// What is made of the change over a short time, through a longer lag.
    fn through(&mut self, seen: &Seen, of: fn(f64) -> f64) -> f64 {
        let made = of(seen.to_bar - self.lags[0].advance(seen.lasts_s, seen.from_bar, seen.to_bar));
        let before = std::mem::replace(&mut self.made, made);
        self.lags[1].advance(seen.lasts_s, before, made)
    }

    fn turned(&mut self, seen: &Seen) -> f64 {
        self.since_s = (self.since_s + seen.lasts_s).min(NEVER_S);
        let turn = self.state.values[0];
        let (ahead, back) = if self.up {
            (seen.to_bar >= self.mark_bar, self.mark_bar - turn)
        } else {
            (seen.to_bar <= self.mark_bar, self.mark_bar + turn)
        };
        if ahead {
            self.mark_bar = seen.to_bar;
        } else if (seen.to_bar < back) == self.up {
            self.since_s = behind(seen.from_bar, seen.to_bar, back) * seen.lasts_s;
            (self.up, self.mark_bar) = (!self.up, seen.to_bar);
        }
        self.since_s
    }

    fn shifted(&mut self, seen: &Seen) -> f64 {
        self.since_s = (self.since_s + seen.lasts_s).min(NEVER_S);
        let [shift, quiet, _] = self.state.values;
        let away = (seen.to_bar - self.lags[0].advance(seen.lasts_s, seen.from_bar, seen.to_bar)).abs();
        let before = std::mem::replace(&mut self.made, away);
        if away > shift && self.since_s > quiet {
            self.since_s = behind(before, away, shift) * seen.lasts_s;
        }
        self.since_s
    }

    fn switched(&mut self, seen: &Seen) -> f64 {
        let [on, off, late] = self.state.values;
        let level = if self.up { off } else { on };
        let asks = (seen.to_bar > level) != self.up;
        let (goal, lag) = (f64::from(self.up), &mut self.lags[1]);
        if !asks {
            self.since_s = 0.0;
            return lag.advance(seen.lasts_s, goal, goal);
        }
        let new = (seen.from_bar > level) == self.up;
        self.since_s += if new { behind(seen.from_bar, seen.to_bar, level) } else { 1.0 } * seen.lasts_s;
        let rest = self.since_s - late;
        if rest < 0.0 {
            return lag.advance(seen.lasts_s, goal, goal);
        }
        let rest = rest.min(seen.lasts_s);
        lag.advance(seen.lasts_s - rest, goal, goal);
        (self.up, self.since_s) = (!self.up, 0.0);
        lag.advance(rest, 1.0 - goal, 1.0 - goal)
    }
}
