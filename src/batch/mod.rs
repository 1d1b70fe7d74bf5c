//! Many records: acceptance of a batch of valves, its store, its process statistics.

pub mod msa;
pub mod statistics;
