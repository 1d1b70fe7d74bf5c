//! Least squares on simulations: the one descent of Levenberg and Marquardt, and how much a residual is worth.
//!
//! What is fitted, and by which loss, belongs to the rooms that fit; how a descent goes on and ends stands here.

mod correlation;
mod descent;
mod product;

pub use correlation::correlation_samples;
pub use descent::{Descended, Equations, Landscape, Pace, descend};
pub use product::dot;

/// Half the width of a 95 % interval in standard deviations; its square is the 95 % point of the likelihood ratio.
pub const SIGMAS_95: f64 = 1.96;
