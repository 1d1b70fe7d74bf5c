//! Hardware-in-the-loop acceptance tests for electro-hydraulic clutch valves.
//!
//! A current goes in, a pressure comes out, with hysteresis and delay between. What a user of the library begins with stands
//! here at the front door; `examples/` shows it at work. Behind it are the rooms of this house, each depending only on those
//! above it (`tests/architecture.rs` holds that).

pub mod units;

pub mod shipped;

pub mod document;

pub mod digest;

pub mod output;

pub mod valve;

pub mod recording;

pub mod course;

pub mod physics;

pub mod control;

pub mod metrics;

pub mod limits;

pub mod least_squares;

pub mod process_loop;

pub mod identify;

pub mod plan;

pub mod rig;

pub mod record;

pub mod runner;

pub mod diagnose;

pub mod challenge;

pub mod batch;

pub mod fleet;

pub mod exchange;

pub mod report;

#[cfg(feature = "program")]
pub mod station;

#[cfg(feature = "program")]
#[doc(hidden)]
pub mod cli;

pub use course::{Course, Preparation};
pub use diagnose::{Diagnosed, Diagnosis, diagnose};
pub use identify::{Identified, identify};
pub use physics::simulate_course;
pub use recording::Recording;
pub use valve::Valve;
