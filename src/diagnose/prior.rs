//! What a calibration says of a parameter before the recording is looked at.

/// What the calibration says of one parameter.
#[derive(Debug, Clone, Copy)]
pub struct Prior {
    /// Its value.
    pub mean: f64,
    /// How far a good calibration may be off.
    pub sigma: f64,
    /// On which side a calibration on a valve that had an effect already may be off by any amount, so that beyond a
    /// few sigma the price hardly rises. What an effect of its own stands for (gain, offset, a longer delay) pays in full.
    pub heavy: Heavy,
}

/// The heavy side of a [`Prior`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heavy {
    /// Neither.
    No,
    /// Below the mean: a delay that had taken in a lag gives it back.
    Below,
    /// Both.
    Both,
}

impl Prior {
    /// Price of a value [nats].
    pub fn nats(&self, value: f64) -> f64 {
        let z2 = ((value - self.mean) / self.sigma).powi(2);
        if self.is_heavy(value) { 2.5 * (z2 / 4.0).ln_1p() } else { 0.5 * z2 }
    }
    /// Curvature that a least-squares step uses for it.
    pub fn stiffness(&self, value: f64) -> f64 {
        let z2 = ((value - self.mean) / self.sigma).powi(2);
        (if self.is_heavy(value) { 5.0 / (4.0 + z2) } else { 1.0 }) / (self.sigma * self.sigma)
    }
    fn is_heavy(&self, value: f64) -> bool {
        self.heavy == Heavy::Both || (self.heavy == Heavy::Below && value < self.mean)
    }
}
