//! Many recordings, one answer: a list of jobs, rows that survive every kill, and what the rows say together.
//!
//! The room knows nothing of engines. Whoever divides the work (Spark, Slurm, GNU parallel, nobody) calls the same
//! command on parts of one list; [`store::Store`] makes sure that the parts add up: a row is there whole or not at all,
//! and what agrees in recording, model and version is not done again.

mod chance;
mod comparison;
mod error;

pub mod collected;
pub mod findings;
pub mod levels;
pub mod list;
pub mod onset;
pub mod rate;
pub mod row;
pub mod standing;
pub mod store;
#[cfg(feature = "parquet")]
pub mod table;
pub mod work;

pub use error::FleetError;
