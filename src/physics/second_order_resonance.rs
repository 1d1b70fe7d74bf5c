//! # Second-order resonance
//!
//! What it is: spool and spring, or oil column and line, swing.
//!
//! Model: y'' + 2 zeta w y' + w^2 y = w^2 u, w = 2 pi frequency.
//!
//! Signature: ringing after steps with an overshoot of exp(-pi zeta / sqrt(1 - zeta^2)); a peak in the spectrum of
//! the error.
//!
//! What to check on the bench: a small step at high sample rate; damping orifice of the spool.
//!
//! Source: Ogata, Modern Control Engineering, 5th ed., section 5-3; Merritt, Wiley 1967, chapter 6.

use super::block::Block;
use super::effect::{Context, Effect, Hint, Parameter, Stage, Theta};
use super::linear::SecondOrder;
use super::periodic_disturbance::strongest_line;
use crate::units::{FREQUENCY, RATIO};

/// The effect `second_order_resonance`.
pub struct SecondOrderResonance;

impl Effect for SecondOrderResonance {
    fn id(&self) -> &'static str {
        "second_order_resonance"
    }
    fn source_text(&self) -> &'static str {
        include_str!("second_order_resonance.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Chamber
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 2] = [
            Parameter {
                name: "frequency",
                unit: &FREQUENCY,
                range: (0.3, 200.0),
                starts: &[2.0, 4.0, 6.0, 9.0, 13.0, 18.0, 25.0],
                default: None,
                meaning: "undamped natural frequency",
            },
            Parameter {
                name: "damping",
                unit: &RATIO,
                range: (0.04, 0.8),
                starts: &[0.1, 0.35],
                default: None,
                meaning: "damping ratio zeta",
            },
        ];
        &PARAMETERS
    }
    /// Where the residual rings, and the band above the starts up to what the sampling carries.
    fn propose(&self, hint: &Hint<'_>) -> Vec<Vec<f64>> {
        let highest_hz = (CARRIED / hint.dt_s).min(200.0);
        let above = (1..).map(|k| 25.0 * RATIO_OF_STARTS.powi(k)).take_while(|f| *f < highest_hz);
        let ringing = strongest_line(hint).map(|line| line.0).filter(|f| (0.3..highest_hz).contains(f));
        above.map(|f| vec![f, 0.1]).chain(ringing.into_iter().flat_map(|f| [0.06, 0.2].map(|zeta| vec![f, zeta]))).collect()
    }
    fn is_linear(&self, _: Theta<'_>) -> bool {
        true
    }
    fn shortest_s(&self, theta: Theta<'_>) -> f64 {
        1.0 / (std::f64::consts::TAU * theta[0])
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        Block::dynamic(SecondOrder::new(theta[0], theta[1], context.dt_s, context.arrival))
    }
}

/// Highest frequency that the sampling carries, in units of the sampling rate.
const CARRIED: f64 = 0.45;
/// Ratio of neighbouring starts: a resonance of moderate damping is found from either side.
const RATIO_OF_STARTS: f64 = 1.4;
