//! Effects, one file each, and the pipeline that simulates a valve.
//!
//! A signal goes through the valve stage by stage ([`Stage`]); an effect names its stage, so it can be added to
//! any model. `run --sim`, `simulate`, `identify` and `diagnose` all use this one pipeline.

mod air_entrainment;
mod around;
mod asymmetric_lag;
mod block;
mod chain;
mod coil_heating;
mod course;
mod creep;
mod delay;
mod delay_jitter;
mod discovered;
mod effect;
mod error;
mod fill_phase;
mod finite;
mod first_order_lag;
mod flow;
mod flow_limit;
mod follow;
mod leakage;
mod levels;
mod linear;
mod lost_messages;
mod missing_codes;
mod monotone;
mod nonlocal_memory;
mod oil_viscosity;
mod periodic_disturbance;
mod pipeline;
mod plant;
mod power;
mod rate_clearance;
mod rate_dependent_hysteresis;
mod reference_drift;
mod reference_shape;
mod reference_shift;
mod resolve;
mod reversal_dead_band;
mod sag;
mod second_order_resonance;
mod sensor_dead_band;
mod sensor_drift;
mod sensor_gain;
mod sensor_lag;
mod sensor_missing_codes;
mod sensor_outliers;
mod sensor_quantization;
mod sensor_zero;
mod signal;
mod simulate;
mod spool_friction;
mod staircase;
mod stick_slip;
mod stiction;
mod supply_accumulator;
mod supply_saturation;
mod thermal_gain;
mod thermal_zero;
mod transport_delay;
mod wandering_tone;

pub use block::{Block, Dynamic, Pointwise};
pub use course::{Misfit, signals, simulate_course};
pub use delay::{Delay, DelayLine};
pub use discovered::{Discovered, Factor, MOST_FACTORS, Seen, Shape, State, StateKind, Term, Tracker, numbers, state_text, written};
pub use effect::{Channel, Context, Effect, Hint, Kind, LinearForm, Nested, Parameter, Sampling, Scatter, ScatterFinding, Stage, Theta};
pub use error::PhysicsError;
pub use linear::{FirstOrder, SecondOrder};
pub use oil_viscosity::REFERENCE_C;
pub use pipeline::{MOST_INNER, Pipeline, Stages, pressure_stages_abreast};
pub use plant::Plant;
pub use resolve::{resolve, specification};
pub use signal::{Arrival, Courses, Point, Signals, Step};
pub use simulate::{simulate, simulate_with};

/// Every effect that a model can have and a diagnosis can name. Adding one: a file, and its line here.
pub const EFFECTS: &[&dyn Effect] = &[
    &transport_delay::TransportDelay,
    &delay_jitter::DelayJitter,
    &lost_messages::LostMessages,
    &coil_heating::CoilHeating,
    &reversal_dead_band::ReversalDeadBand,
    &stiction::Stiction,
    &spool_friction::SpoolFriction,
    &nonlocal_memory::NonlocalMemory,
    &rate_dependent_hysteresis::RateDependentHysteresis,
    &reference_drift::ReferenceDrift,
    &reference_shift::ReferenceShift,
    &reference_shape::ReferenceShape,
    &leakage::Leakage,
    &thermal_gain::ThermalGain,
    &supply_saturation::SupplySaturation,
    &supply_accumulator::SupplyAccumulator,
    &fill_phase::FillPhase,
    &flow_limit::FlowLimit,
    &first_order_lag::FirstOrderLag,
    &asymmetric_lag::AsymmetricLag,
    &oil_viscosity::OilViscosity,
    &air_entrainment::AirEntrainment,
    &second_order_resonance::SecondOrderResonance,
    &creep::Creep,
    &discovered::Discovered,
    &sensor_lag::SensorLag,
    &sensor_dead_band::SensorDeadBand,
    &sensor_gain::SensorGain,
    &sensor_zero::SensorZero,
    &thermal_zero::ThermalZero,
    &sensor_drift::SensorDrift,
    &periodic_disturbance::PeriodicDisturbance,
    &sensor_outliers::SensorOutliers,
    &sensor_quantization::SensorQuantization,
    &sensor_missing_codes::SensorMissingCodes,
];

/// The effect with this id.
pub fn effect(id: &str) -> Option<&'static dyn Effect> {
    EFFECTS.iter().copied().find(|e| e.id() == id)
}

#[cfg(test)]
pub(crate) mod tests;
