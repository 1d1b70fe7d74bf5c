//! One case of the challenge: a valve, what is concealed in it, and the drive that it is seen in.

use super::anatomy::Anatomy;
use super::controller::Controller;
use super::excitation::Drive;
use super::formulation::Formulations;
use super::specimen::Specimen;

/// The id that stands for physics outside every library.
pub const UNKNOWN: &str = "unknown";

/// One concealed effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Concealed {
    /// Id as in the effects of the valve file, or `unknown`.
    pub id: &'static str,
    /// Which of its physical formulations.
    pub variant: u8,
    /// Size relative to a clear case (1.0); 0.35 to 0.5 is faint.
    pub severity: f64,
}

/// How large an effect stands beside what a plain model of the healthy valve leaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// Below a third: nobody can be asked to see it.
    Hidden,
    /// Up to once the floor.
    Faint,
    /// Once to twice.
    Medium,
    /// Beyond.
    Clear,
}

impl Grade {
    /// The grade of a misfit relative to the floor.
    pub fn of(visible: f64) -> Self {
        match visible {
            v if v < 0.33 => Self::Hidden,
            v if v < 1.0 => Self::Faint,
            v if v < 2.0 => Self::Medium,
            _ => Self::Clear,
        }
    }
    /// The word of the truth file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Hidden => "hidden",
            Self::Faint => "faint",
            Self::Medium => "medium",
            Self::Clear => "clear",
        }
    }
}

/// One case of the challenge.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Everything else follows from it.
    pub seed: u64,
    /// What is concealed; empty for a healthy valve.
    pub effects: Vec<Concealed>,
    /// Which plant.
    pub anatomy: Anatomy,
    /// Which forms of curve and hysteresis the valve may have.
    pub formulations: Formulations,
    /// Kind of the record's drive.
    pub drive: Drive,
    /// Samples and commands per second.
    pub rate_hz: f64,
    /// Length of the record [s].
    pub length_s: f64,
    /// Who closes the loop, in the drives; `None`: open loop.
    pub controller: Option<Controller>,
    /// Whether the effects were there when the valve was calibrated.
    pub absorbed: bool,
    /// RMS by which the effects move the record's pressure, over the floor of a plain model; 0 for a healthy valve.
    pub visible: f64,
}

impl Case {
    pub(super) fn specimen(&self) -> Specimen {
        Specimen::draw(self.seed, self.anatomy, self.formulations)
    }
    /// Number of the hysteresis form: 0 reciprocal, 1 remembers every reversal, 2 another.
    pub fn family(&self) -> u8 {
        match self.anatomy {
            Anatomy::Blocks => self.specimen().hysteresis.number(),
            Anatomy::Equations => 2,
        }
    }
    /// Form of the static hysteresis, as a word.
    pub fn form(&self) -> &'static str {
        match self.anatomy {
            Anatomy::Blocks => self.specimen().hysteresis.name(),
            Anatomy::Equations => "magnet_and_friction",
        }
    }
    /// Delay of the healthy valve [s].
    pub fn delay_s(&self) -> f64 {
        self.specimen().delay_s
    }
    /// Standard deviation of the sensor's noise [bar].
    pub fn noise_bar(&self) -> f64 {
        self.specimen().noise_bar
    }
    /// Share of the noise's variance that is coloured.
    pub fn coloured(&self) -> f64 {
        self.specimen().coloured
    }
    /// Whether the drives run in closed loop.
    pub fn closed(&self) -> bool {
        self.controller.is_some()
    }
    /// The grade of what is concealed.
    pub fn grade(&self) -> Grade {
        Grade::of(self.visible)
    }
    /// The ids concealed, in order.
    pub fn ids(&self) -> Vec<&'static str> {
        self.effects.iter().map(|e| e.id).collect()
    }
    /// Name of the case: `stiction`, `first_order_lag+creep`, `healthy`.
    pub fn name(&self) -> String {
        if self.effects.is_empty() { "healthy".to_owned() } else { self.ids().join("+") }
    }
}
