//! A valve whose fault is concealed: the blind test of the diagnosis.
//!
//! Whoever judges a diagnosis on data from the diagnosis's own simulator commits the inverse crime: the same
//! formula writes the data and reads them. This room therefore holds a second plant, finer in time (0.5 ms) and
//! written from first principles rather than from the effect blocks of the simulator: message line, coil and
//! current loop, spool with friction, static curve with a hysteresis of another form, supply, chamber with orifice
//! and compliance, sensor. It shares no line with them, and `tests/it` holds that.
//!
//! The seed draws a specimen and what is wrong with it, the recordings are written, and the truth goes into a
//! sealed file whose digest is known before anybody diagnoses anything. `docs/proof.md` explains it to a sceptic.

mod anatomy;
mod bench;
mod broken;
mod case;
mod chamber;
mod chance;
mod controller;
mod curve;
mod draw;
mod driver;
mod excitation;
mod files;
mod fleet;
mod forms;
mod formulation;
mod hydraulics;
mod lost;
mod memory;
mod plain;
mod plant;
mod reversals;
mod score;
mod seal;
mod sensor;
mod session;
mod specimen;
mod spool;
mod supply;
mod table;
mod trial;
mod unknown;

pub use anatomy::Anatomy;
pub use bench::Bench;
pub use broken::{BROKEN, Broken, break_record};
pub use case::{Case, Concealed, Grade, UNKNOWN};
pub use controller::Controller;
pub use draw::{Range, draw_healthy, draw_series, placed};
pub use excitation::Drive;
pub use files::{ChallengeError, write_run, write_text};
pub use fleet::{Fleet, FleetValve, draw_fleet, tells};
pub use formulation::{EFFECTS, Formulations, formulation};
pub use score::{Answer, Estimate, Misfit, Named, Outcome, Score, Verdict, score};
pub use seal::{Seal, truth_of};
pub use session::{Session, record_session};
pub use table::{Curve, Share, Table, tabulate};
pub use trial::{Contestant, Trial, hold_trial};
