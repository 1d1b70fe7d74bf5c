//! The library inside an exported FMU: the simulator of `hil`, behind the C functions of FMI 2.0 and of FMI 3.0.
//!
//! [`Instance`] is the whole model and free of C; `fmi2` and `fmi3` translate its calls, `c` holds what touches
//! foreign memory. Every function of the interface is there, also those that this model cannot serve: they
//! return an error, for importers that ask for each name. A wrong order of calls, a wrong reference or a value that is
//! no number is an error of the interface; a panic would be a bug and is one, too, instead of the end of the master.

mod c;
mod fmi2;
mod fmi3;
mod instance;

pub use instance::{Instance, Refused};
