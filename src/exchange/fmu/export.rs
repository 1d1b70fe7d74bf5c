//! A model ready to be exported.

use super::part::Part;
use super::variables::Variable;
use crate::valve::Valve;

/// A model ready to be exported.
#[derive(Debug)]
pub struct Export {
    pub(super) valve: Valve,
    pub(super) valve_text: String,
    pub(super) part: Part,
    pub(super) step_s: f64,
    pub(super) token: String,
    pub(super) variables: Vec<Variable>,
}
