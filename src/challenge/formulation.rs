//! In words: how the plant makes each effect. Two formulations of each, so that one formula cannot be learnt.

use rand::RngExt;
use rand_pcg::Pcg64;

use super::controller::Controller;
use super::excitation::Drive;
use super::forms::CurveForm;
use super::forms::LoopForm;

/// Ids of the effects that this plant can conceal, with the two ways in which it makes them.
const FORMULATIONS: [(&str, [&str; 2]); 22] = [
    ("transport_delay", ["messages arrive later", "the pressure reaches the sensor later"]),
    ("delay_jitter", ["each message late by its own chance, overtaken ones void", "a bus that is loaded for fractions of a second"]),
    ("first_order_lag", ["compliance behind a laminar restrictor", "compliance behind a sharp orifice (square root of the pressure drop)"]),
    ("second_order_resonance", ["spool on its spring, viscous damping", "oil column with damping that grows with the flow"]),
    ("flow_limit", ["pump and drain flow bounded by constants", "bounded by orifices against supply and tank"]),
    ("reversal_dead_band", ["clearance between armature and spool", "clearance with a soft seat and an elastic part"]),
    ("stiction", ["spool stands, then slips", "mass on a spring with Coulomb friction after Karnopp"]),
    ("fill_phase", ["orifice, piston and return spring before the clutch bears", "lines that run empty and have to be filled"]),
    ("supply_saturation", ["relief valve set low, drooping with flow", "shared pump that sags at times"]),
    ("reference_drift", ["gain and zero at constant speed", "gain and zero towards an end value"]),
    ("reference_shift", ["gain and zero changed for good", "spring seat set, so more or less current for the same pressure"]),
    ("leakage", ["laminar gap", "sharp edge (square root of the pressure)"]),
    ("rate_dependent_hysteresis", ["clearance that grows with the rate", "Dahl friction whose level grows with the rate"]),
    ("creep", ["three time constants, nearly a logarithm", "one time constant"]),
    ("air_entrainment", ["bulk modulus with polytropic air, laminar feed", "isothermal air, feed through an orifice"]),
    ("coil_heating", ["winding as one body, output stage without feedback", "winding and housing, feedback in part"]),
    ("nonlocal_memory", ["seven more play operators", "four hundred Preisach relays"]),
    ("sensor_lag", ["one RC stage", "two RC stages"]),
    ("sensor_quantization", ["rounding", "truncation with uneven steps"]),
    ("sensor_drift", ["zero walks off at constant speed", "zero follows the warming of the electronics"]),
    ("sensor_outliers", ["single spikes", "bursts of wrong samples, some of them zero"]),
    ("periodic_disturbance", ["a tone between 3 and 30 Hz", "pump ripple that grows with pressure, with harmonic and wandering speed"]),
];

/// What stands for physics outside every library, by its number.
const OUTSIDE: [&str; 11] = [
    "a neighbour on the same block answers each shift with a pull of its own",
    "hills and valleys over pressure and the pressure of some seconds ago",
    "a sleeve that flips between two seats when it will",
    "knocks from outside that ring out, at times of their own",
    "a seat that changes sides at every second turn of the current",
    "a mean that moves with how lively the command has been",
    "a bypass that opens late above a pressure and closes late below another",
    "an echo of the pressure from the end of a long line",
    "a gain that wanders by chance within seconds",
    "a squeal within one band of pressure only",
    "a rebound after every quick fall",
];

/// The effects that a diagnosis can name and this plant can conceal. The shape of the curve is no entry: every
/// specimen's curve differs from a cubic.
pub const EFFECTS: [&str; 22] = {
    let mut ids = [""; 22];
    let mut k = 0;
    while k < 22 {
        ids[k] = FORMULATIONS[k].0;
        k += 1;
    }
    ids
};

/// How the plant makes an effect, in words.
pub fn formulation(id: &str, variant: u8) -> &'static str {
    match FORMULATIONS.iter().find(|f| f.0 == id) {
        Some((_, [first, second])) => {
            if variant == 0 {
                first
            } else {
                second
            }
        }
        None => OUTSIDE[usize::from(variant) % OUTSIDE.len()],
    }
}

/// Which formulations of valves, drives, controllers and unknown physics a series may draw.
///
/// Two thirds may be looked at while a diagnosis is worked on; one third is kept for the end. The marks in the lists
/// below are fixed: moving one makes every figure of before and after incomparable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Formulations {
    /// Those that may be looked at.
    #[default]
    Open,
    /// Those kept for the end.
    Kept,
    /// Both.
    All,
}

/// A formulation, and whether it is kept for the end.
pub(super) type Marked<T> = (T, bool);

/// Static hysteresis.
pub(super) const LOOPS: [Marked<LoopForm>; 9] = [
    (LoopForm::Reciprocal, false),
    (LoopForm::Play, false),
    (LoopForm::Dahl, false),
    (LoopForm::Preisach, false),
    (LoopForm::BoucWen, false),
    (LoopForm::Tanh, false),
    (LoopForm::Duhem, true),
    (LoopForm::LuGre, true),
    (LoopForm::JilesAtherton, true),
];

/// Static curves.
pub(super) const CURVES: [Marked<CurveForm>; 6] = [
    (CurveForm::Solenoid, false),
    (CurveForm::Logistic, false),
    (CurveForm::Power, false),
    (CurveForm::TwoSprings, false),
    (CurveForm::Saturating, true),
    (CurveForm::Notched, true),
];

/// Drives.
pub(super) const DRIVES: [Marked<Drive>; 9] = [
    (Drive::Mixed, false),
    (Drive::Shifts, false),
    (Drive::Oscillations, false),
    (Drive::Steps, false),
    (Drive::Schedule, false),
    (Drive::Poor, false),
    (Drive::Walk, true),
    (Drive::Multisine, true),
    (Drive::Cycle, true),
];

/// Controllers of the drives in closed loop.
pub(super) const CONTROLLERS: [Marked<Controller>; 3] =
    [(Controller::FeedForwardPi, false), (Controller::Pi, false), (Controller::ThreeStep, true)];

/// Physics outside every library, by its number.
pub(super) const UNKNOWNS: [Marked<u8>; 11] =
    [(0, false), (1, false), (2, false), (3, false), (4, false), (5, false), (6, false), (7, true), (8, true), (9, true), (10, true)];

impl Formulations {
    /// Those of a list that may be drawn.
    pub(super) fn of<T: Copy>(self, list: &[Marked<T>]) -> Vec<T> {
        let may = |kept: bool| match self {
            Self::Open => !kept,
            Self::Kept => kept,
            Self::All => true,
        };
        list.iter().filter(|(_, kept)| may(*kept)).map(|(item, _)| *item).collect()
    }

    /// One of them.
    pub(super) fn choose<T: Copy>(self, list: &[Marked<T>], rng: &mut Pcg64) -> T {
        let may = self.of(list);
        may[rng.random_range(0..may.len())]
    }
}
