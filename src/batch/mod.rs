//! Many records: acceptance of a batch of valves, its store, its process statistics.

mod error;

pub mod campaign;
pub mod comparison;
pub mod duts;
#[cfg(test)]
mod example;
#[cfg(feature = "history")]
pub mod index;
pub mod journal;
pub mod master;
pub mod measuring;
pub mod msa;
pub mod offer;
pub mod population;
pub mod readings;
pub mod station;
pub mod statistics;
pub mod store;
pub mod summary;
pub mod tally;

pub use error::BatchError;
