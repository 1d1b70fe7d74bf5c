//! What a child process is asked to simulate.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::description::Ports;

/// What the child is asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// FMI 2 or 3.
    pub version: u8,
    /// The library.
    pub library: PathBuf,
    /// The folder of the resources.
    pub resources: PathBuf,
    /// `guid` or `instantiationToken`.
    pub token: String,
    /// Where current goes in and pressure comes out.
    pub ports: Ports,
    /// Time between two samples [s].
    pub dt_s: f64,
    /// Command at each sample, held until the next [A].
    pub current_a: Vec<f64>,
    /// Where the pressures go, as little-endian numbers [bar]: a model may print what it likes.
    pub result: PathBuf,
}
