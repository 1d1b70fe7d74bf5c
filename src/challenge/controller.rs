//! Who closes the loop in the drives of the challenge.

/// Who closes the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Controller {
    /// Feed-forward by a calibration that is a little off, and PI above 6 bar against the target of a delay ago.
    FeedForwardPi,
    /// PI alone, from the mean slope of the curve.
    Pi,
    /// Feed-forward without hysteresis, and an output that moves by fixed steps while the error is beyond a band.
    ThreeStep,
}

impl Controller {
    /// The word of the truth file.
    pub fn name(self) -> &'static str {
        match self {
            Self::FeedForwardPi => "feed_forward_pi",
            Self::Pi => "pi",
            Self::ThreeStep => "three_step",
        }
    }
}
