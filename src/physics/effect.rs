//! What an effect is: where it sits in the signal's way, which parameters it has, what it does to the signal.

use std::ops::Range;

use super::block::Block;
use super::error::PhysicsError;
use super::signal::Arrival;
use crate::units::Unit;
use crate::valve::{EffectSpec, ReferenceCurves, Valve};

/// The stages of a valve in the order in which the signal passes them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// Dead time of command and message. Signal: current [A].
    Delay,
    /// Driver and coil. Signal: current [A].
    Coil,
    /// Spool friction. Signal: current [A].
    Spool,
    /// Hysteresis and its memory. Signal: pressure [bar], after the static curve.
    Static,
    /// Changes of the curve. Signal: pressure [bar].
    Curve,
    /// Supply pressure; the floor at tank pressure follows it. Signal: pressure [bar].
    Supply,
    /// Spool and chamber dynamics. Signal: pressure [bar].
    Chamber,
    /// Creep. Signal: pressure [bar].
    Creep,
    /// Sensor. Signal: pressure [bar].
    Sensor,
}

/// How an effect shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// In the course of the pressure: judged by the error of a free simulation.
    Course,
    /// In the scatter about the course: judged by likelihood and signature, not by RMSE.
    Scatter,
    /// In the form of the static curve: a finding about the calibration that stands beside any other effect.
    Form,
}

/// One parameter of an effect.
#[derive(Debug)]
pub struct Parameter {
    /// Name in a valve file.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static Unit,
    /// Smallest and largest value that physics allows, in the canonical unit.
    pub range: (f64, f64),
    /// Where a fit begins: the values tried one by one, in the canonical unit.
    pub starts: &'static [f64],
    /// The value where a file does not give one: that of the plainest form of the effect; `None`: must be given.
    pub default: Option<f64>,
    /// What it means.
    pub meaning: &'static str,
}

/// Values of the parameters in their order, in canonical units.
pub type Theta<'a> = &'a [f64];

/// What a block needs to know of the simulation that it stands in.
#[derive(Debug, Clone, Copy)]
pub struct Context<'c> {
    /// Time step [s].
    pub dt_s: f64,
    /// Time of the first sample [s].
    pub start_s: f64,
    /// When within a step the command changes.
    pub arrival: Arrival,
    /// Most inner steps of a sample.
    pub most_inner: usize,
    /// The reference curves.
    pub curves: &'c ReferenceCurves,
    /// Seed for what is random; `None`: the mean course, without chance.
    pub seed: Option<u64>,
}

/// How a recording is sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// From its first sample to its last [s].
    pub length_s: f64,
    /// From one sample to the next [s].
    pub step_s: f64,
}

/// A plainer effect inside another one.
#[derive(Debug, Clone, Copy)]
pub struct Nested {
    /// Its id.
    pub id: &'static str,
    /// The values of the effect that holds it at which the two are the same.
    pub same: fn(Theta<'_>) -> Vec<f64>,
}

/// What an effect is in the linear loop for which margins are judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearForm {
    /// Factor on the gain.
    pub gain: f64,
    /// Dead time [s].
    pub delay_s: f64,
    /// By how much the dead time may be longer at times [s].
    pub delay_spread_s: f64,
    /// Time constant of a first-order lag [s].
    pub lag_s: f64,
}

impl LinearForm {
    /// An effect that the loop does not feel.
    pub const NEUTRAL: Self = Self { gain: 1.0, delay_s: 0.0, delay_spread_s: 0.0, lag_s: 0.0 };
}

/// A channel of a recording that an effect may need besides the current.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// Oil temperature, `oil_temp_c`.
    OilTemperature,
    /// Supply pressure, `supply_bar`.
    SupplyPressure,
}

/// A physical effect that a model can have and a diagnosis can name.
pub trait Effect: Sync {
    /// Id in files and reports.
    fn id(&self) -> &'static str;
    /// Takes out of a base model the part that this effect stands for; whether it had one.
    fn leave_base(&self, _valve: &mut Valve) -> bool {
        false
    }
    /// The source file, whose head is the effect's manual page.
    fn source_text(&self) -> &'static str;
    /// Where in the signal's way it acts.
    fn stage(&self) -> Stage;
    /// How it shows.
    fn kind(&self) -> Kind {
        Kind::Course
    }
    /// Whether it acts on a loop as another form of the hysteresis would, so that only data of the good valve can tell a
    /// change from a form that the model never had.
    fn imitates_form(&self) -> bool {
        self.kind() == Kind::Form
    }
    /// Whether it acts on the course of the pressure, and no other form of the hysteresis would act so: a cause.
    fn is_cause(&self) -> bool {
        self.kind() == Kind::Course && !self.imitates_form()
    }
    /// Whether no error in the form of a model looks like it, as the current does not make it: how far the model of a good valve is
    /// off then says nothing of it.
    fn is_apart_from_form(&self) -> bool {
        false
    }
    /// Its parameters.
    fn parameters(&self) -> &'static [Parameter];
    /// The effect at work.
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block;

    /// Whether a diagnosis tries it. A form that holds a plainer one takes the name of it wherever that is not quite exact; such a
    /// form is for models that are written by hand until its names have been counted on concealed valves.
    fn searched(&self) -> bool {
        true
    }

    /// Its values from a valve file, where they are more than numbers with names; `None`: the file has its parameters.
    fn read(&self, _: &EffectSpec) -> Option<Result<Vec<f64>, PhysicsError>> {
        None
    }

    /// Its values as a valve file has them, where [`Effect::read`] reads them.
    fn write(&self, _: Theta<'_>) -> Option<Vec<(String, String)>> {
        None
    }

    /// Values with which the laws of all effects are tried: the first start of every parameter, then each other start of one of them.
    fn examples(&self) -> Vec<Vec<f64>> {
        let first: Vec<f64> = self.parameters().iter().map(|p| p.starts[0]).collect();
        let others = self.parameters().iter().enumerate().flat_map(|(k, p)| p.starts[1..].iter().map(move |s| (k, *s)));
        let moved = others.map(|(k, start)| {
            let mut theta = first.clone();
            theta[k] = start;
            theta
        });
        std::iter::once(first.clone()).chain(moved).collect()
    }

    /// Whether a recalibration of the model does the same, so that only data of the good valve makes it a finding.
    fn recalibrates(&self) -> bool {
        false
    }

    /// Whether it is what a valve has whose gain or zero stands apart from that of others of its type.
    fn is_shift_of_calibration(&self) -> bool {
        false
    }

    /// A plainer effect that it holds, and its own values at which it is the plainer one with these values: a fit of it can
    /// never be worse than the plainer one's.
    fn nested(&self) -> Option<Nested> {
        None
    }

    /// Its values for a stem that rests until the current is `(resting, ..)` away from it and then moves to within `(.., moving)` of
    /// it [A]; `None` for an effect that is no such friction.
    fn stick_slip(&self, _: (f64, f64)) -> Option<Vec<f64>> {
        None
    }

    /// The parameter that what it does to the pressure is in proportion to, with the others as they are: a fit then needs to try
    /// the others only.
    fn amplitude(&self) -> Option<usize> {
        None
    }

    /// How far parameter `k` may be moved to see what it does, where a recording tells it more finely than by the usual share; it then
    /// moves on a straight line.
    fn resolved(&self, _k: usize, _of: Sampling) -> Option<f64> {
        None
    }

    /// Dead time that it adds to that of the valve [s].
    fn dead_time_s(&self, _: Theta<'_>) -> f64 {
        0.0
    }

    /// The shortest time in which its output moves by itself [s]: what follows it must be simulated in steps of that order.
    fn shortest_s(&self, _: Theta<'_>) -> f64 {
        f64::INFINITY
    }

    /// How long what it does goes on changing by itself [s]: stretches of a recording that are shorter tell of one another.
    fn memory_s(&self, _: Theta<'_>) -> f64 {
        0.0
    }

    /// The longest step of the recording up to which it may be simulated sample by sample ahead of the curve [s].
    fn longest_step_s(&self, _: Theta<'_>) -> f64 {
        f64::INFINITY
    }

    /// Whether it is linear and does not change with time, so that its order among others of the kind does not matter.
    fn is_linear(&self, _: Theta<'_>) -> bool {
        false
    }

    /// What it is in the linear loop; `None` where it has no place there.
    fn linear(&self, _: Theta<'_>) -> Option<LinearForm> {
        None
    }

    /// The channel without which it does nothing.
    fn needs(&self) -> Option<Channel> {
        None
    }

    /// The recorded channels that it looks at with these values.
    fn uses(&self, _: Theta<'_>) -> Vec<Channel> {
        self.needs().into_iter().collect()
    }

    /// Further starts of a fit that the residual suggests, besides those of the parameters.
    fn propose(&self, _: &Hint<'_>) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// What the signature of the effect in the residual says for it beyond the fit, where the course of the effect does
    /// not repeat and no free simulation can follow it [nats].
    fn signature_nats(&self, _: &Hint<'_>) -> f64 {
        0.0
    }

    /// For an effect of the scatter, or one that comes and goes at times of its own: whether its signature is in the recording.
    fn scatter(&self, _: &Scatter<'_>) -> Option<ScatterFinding> {
        None
    }

    /// Whether [`Effect::scatter`] gives the readings back as the pressure was: it goes first then, so that what it did to them is not
    /// taken for anything else.
    fn restores(&self) -> bool {
        false
    }

    /// What another recording says for what was found in a first one [nats]; `None` where that cannot be said.
    fn scatter_nats(&self, _: &ScatterFinding, _: &Scatter<'_>) -> Option<f64> {
        None
    }

    /// The manual page: the head of the source file.
    fn doc(&self) -> String {
        let head = self.source_text().lines().take_while(|l| l.starts_with("//!"));
        head.map(|l| l.trim_start_matches("//!").trim_start_matches(' ')).collect::<Vec<_>>().join("\n")
    }
}

/// What the residual of the present model looks like, for an effect to propose where its fit begins.
#[derive(Debug, Clone, Copy)]
pub struct Hint<'a> {
    /// Time of the first sample [s].
    pub start_s: f64,
    /// Time step [s].
    pub dt_s: f64,
    /// Command [A].
    pub current_a: &'a [f64],
    /// Dead time and lag between command and pressure [s].
    pub delay_s: f64,
    /// Measured minus simulated [bar]; NaN where not measured.
    pub residual_bar: &'a [f64],
    /// The same of all runs with this step, each with the time of its first sample [s].
    pub parts: &'a [(f64, &'a [f64])],
    /// Simulated [bar].
    pub pressure_bar: &'a [f64],
    /// Robust scale of the residual [bar].
    pub scale_bar: f64,
    /// By how much new values of the calibration have raised the gain [-] and the offset [bar] of the curves.
    pub recalibrated: (f64, f64),
}

/// What an effect of the scatter looks at.
#[derive(Debug, Clone, Copy)]
pub struct Scatter<'a> {
    /// Time step [s].
    pub dt_s: f64,
    /// Standard deviation of the sensor noise [bar].
    pub noise_bar: f64,
    /// Measured [bar]; NaN where not measured.
    pub measured_bar: &'a [f64],
    /// Simulated [bar].
    pub simulated_bar: &'a [f64],
    /// Command [A].
    pub current_a: &'a [f64],
    /// Where each run stands among these.
    pub runs: &'a [Range<usize>],
    /// Dead time and lag between command and pressure [s].
    pub delay_s: f64,
    /// The lag in it [s].
    pub lag_s: f64,
}

#[cfg(test)]
impl<'a> Scatter<'a> {
    /// What was measured beside what was simulated, 100 times a second and without a current.
    pub(super) fn between(measured_bar: &'a [f64], simulated_bar: &'a [f64], noise_bar: f64) -> Self {
        Self { dt_s: 0.01, noise_bar, measured_bar, simulated_bar, current_a: &[], runs: &[], delay_s: 0.0, lag_s: 0.0 }
    }
}

/// What an effect of the scatter found.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ScatterFinding {
    /// Its parameters.
    pub theta: Vec<f64>,
    /// Their standard errors.
    pub std_errors: Vec<f64>,
    /// Gain of the log-likelihood [nats].
    pub gain_nats: f64,
    /// Readings that are no measurement of the pressure and must not enter a fit.
    pub masked: Vec<usize>,
    /// The fastest movement of the current at which it shows, where it depends on that [A/s].
    pub shows_up_to_a_per_s: Option<f64>,
    /// All readings as the pressure was, where it can be told from what it did to them; empty where not [bar].
    pub restored: Vec<f64>,
    /// What it adds to each reading, where that can be told from all else; empty where not [bar].
    pub alone_bar: Vec<f64>,
    /// Standard deviation of what it adds to each sample [bar].
    pub spread_bar: Vec<f64>,
    /// Whether it came at times of its own, which say nothing of another drive: no model of the valve holds it then.
    pub is_event: bool,
    /// The figures that speak for it.
    pub evidence: String,
}
