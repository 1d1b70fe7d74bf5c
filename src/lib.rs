//! Hardware-in-the-loop acceptance tests for electro-hydraulic clutch valves.
//!
//! A current goes in, a pressure comes out, with hysteresis and delay between. The rooms of this house, each
//! depending only on those above it (`tests/architecture.rs` holds that):

pub mod units;

pub mod recording;
pub mod record;
pub mod rig;
