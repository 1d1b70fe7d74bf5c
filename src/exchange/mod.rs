//! What leaves the house in other trades' formats: AQDEF for the quality department, FMI for simulation tools.
//!
//! Nothing here judges or computes a figure: an export shows what a record or a model already holds.

pub mod aqdef;
mod attached;
mod error;
#[cfg(feature = "fmi")]
pub mod fmu;
#[cfg(all(unix, feature = "fmi"))]
pub mod foreign;

pub use attached::{Attached, BaseFile, SCHEMA as ATTACHED_SCHEMA, Side};
pub use error::ExchangeError;
