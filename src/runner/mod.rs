//! Plan x rig -> record.
//!
//! [`run`] is a pure call: no files, no clock, no global state. The rig decides whether time is simulated or real. In
//! each slot the command computed from the last sample is applied and the next sample taken, as a bus transaction that
//! writes and reads does: one period of computation lies in the loop, on the bench and in simulation alike.

mod attendant;
mod attended;
mod evidence;
#[cfg(feature = "wire")]
mod glance;
mod guard;
mod measure;
mod observer;
mod prepare;
mod run;

pub use attendant::{Attendant, Reply};
pub use attended::Attended;
#[cfg(feature = "wire")]
pub use glance::{Feed, Glance, glances};
pub use observer::{Observer, Progress};
pub use prepare::Prepared;
pub use run::{RunOptions, STOPPED, run};

#[cfg(test)]
mod tests;
