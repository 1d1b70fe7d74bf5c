//! `--input`: what a recorded command does between two of its samples.

use clap::ValueEnum;

use crate::valve::Input;

/// The forms of `--input`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum InputShape {
    /// It stands until the next message
    Held,
    /// It goes on a straight line to the next sample
    Ramp,
}

impl From<InputShape> for Input {
    fn from(shape: InputShape) -> Self {
        match shape {
            InputShape::Held => Self::Held,
            InputShape::Ramp => Self::Ramp,
        }
    }
}
