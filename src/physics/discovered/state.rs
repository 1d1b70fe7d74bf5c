//! The states on which a discovered term may depend: what the model's own free run goes through, never what was measured.

use crate::units::{CURRENT, PRESSURE, RATIO, TEMPERATURE, TIME, Unit};

/// Most values that a state has of its own.
pub const MOST_VALUES: usize = 3;

/// What a state is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StateKind {
    /// The simulated pressure.
    Pressure,
    /// The current at the static curve.
    Current,
    /// The recorded oil temperature.
    OilTemperature,
    /// The recorded supply pressure.
    SupplyPressure,
    /// The pressure through a lag: what it was some time ago, on the average.
    PastPressure,
    /// The pressure less its past, some time ago: a rate over the memory.
    PressureChange,
    /// How lively the pressure has been: the size of its change over a short time, through a longer lag.
    Agitation,
    /// The same of falls alone.
    Fall,
    /// The same of rises alone.
    Rise,
    /// The pressure less a play that it drags along.
    Play,
    /// Time since the pressure turned back by so much.
    SinceReversal,
    /// Time since the pressure left the level of the last half second by so much, after so long a time without.
    SinceShift,
    /// 1 from some time after the pressure is above a level until some time after it is below another, else 0; through a lag of 0.1 s.
    Switch,
}

/// A value of a state: its name and its unit.
pub type Value = (&'static str, &'static Unit);

impl StateKind {
    /// All kinds; a number in an effect's values is a place in this list.
    pub const ALL: [Self; 13] = [
        Self::Pressure,
        Self::Current,
        Self::OilTemperature,
        Self::SupplyPressure,
        Self::PastPressure,
        Self::PressureChange,
        Self::Agitation,
        Self::Fall,
        Self::Rise,
        Self::Play,
        Self::SinceReversal,
        Self::SinceShift,
        Self::Switch,
    ];

    /// Its name in a formula.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pressure => "pressure",
            Self::Current => "current",
            Self::OilTemperature => "oil_temperature",
            Self::SupplyPressure => "supply_pressure",
            Self::PastPressure => "past_pressure",
            Self::PressureChange => "pressure_change",
            Self::Agitation => "agitation",
            Self::Fall => "fall",
            Self::Rise => "rise",
            Self::Play => "play",
            Self::SinceReversal => "since_reversal",
            Self::SinceShift => "since_shift",
            Self::Switch => "switch",
        }
    }

    /// The unit in which it is counted.
    pub fn unit(self) -> &'static Unit {
        match self {
            Self::Current => &CURRENT,
            Self::OilTemperature => &TEMPERATURE,
            Self::SinceReversal | Self::SinceShift => &TIME,
            Self::Switch => &RATIO,
            _ => &PRESSURE,
        }
    }

    /// The values that it has of its own.
    pub fn values(self) -> &'static [Value] {
        static MEMORY: [Value; 1] = [("memory", &TIME)];
        static CHANGE: [Value; 2] = [("memory", &TIME), ("delay", &TIME)];
        static LIVELY: [Value; 2] = [("across", &TIME), ("memory", &TIME)];
        static PLAY: [Value; 1] = [("half_width", &PRESSURE)];
        static TURN: [Value; 1] = [("turn", &PRESSURE)];
        static SHIFT: [Value; 2] = [("shift", &PRESSURE), ("quiet", &TIME)];
        static SWITCH: [Value; 3] = [("on", &PRESSURE), ("off", &PRESSURE), ("late", &TIME)];
        match self {
            Self::Pressure | Self::Current | Self::OilTemperature | Self::SupplyPressure => &[],
            Self::PastPressure => &MEMORY,
            Self::PressureChange => &CHANGE,
            Self::Agitation | Self::Fall | Self::Rise => &LIVELY,
            Self::Play => &PLAY,
            Self::SinceReversal => &TURN,
            Self::SinceShift => &SHIFT,
            Self::Switch => &SWITCH,
        }
    }
}

/// A state with its values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// What it is made of.
    pub kind: StateKind,
    /// Its values in canonical units, as [`StateKind::values`] lists them; 0 beyond.
    pub values: [f64; MOST_VALUES],
}

/// Share of a memory in which the signal is followed, so that what is no line between two samples is followed too.
const SHARE_OF_MEMORY: f64 = 0.05;
/// Step in which events are seen [s].
const EVENT_S: f64 = 2e-3;

impl State {
    /// A state with these values.
    pub fn new(kind: StateKind, values: &[f64]) -> Self {
        let mut all = [0.0; MOST_VALUES];
        for (to, from) in all.iter_mut().zip(values) {
            *to = *from;
        }
        Self { kind, values: all }
    }

    /// How long it remembers [s].
    pub fn memory_s(&self) -> f64 {
        let [a, b, c] = self.values;
        match self.kind {
            StateKind::PastPressure => a,
            StateKind::PressureChange | StateKind::Agitation | StateKind::Fall | StateKind::Rise => a + b,
            StateKind::Switch => c,
            _ => 0.0,
        }
    }

    /// The step in which it must be followed [s].
    pub fn shortest_s(&self) -> f64 {
        match self.kind {
            StateKind::PastPressure => SHARE_OF_MEMORY * self.values[0],
            StateKind::PressureChange if self.values[1] > 0.0 => EVENT_S,
            StateKind::PressureChange => SHARE_OF_MEMORY * self.values[0],
            StateKind::Agitation | StateKind::Fall | StateKind::Rise => SHARE_OF_MEMORY * self.values[0].min(self.values[1]),
            StateKind::Play | StateKind::SinceReversal | StateKind::SinceShift | StateKind::Switch => EVENT_S,
            _ => f64::INFINITY,
        }
    }
}
