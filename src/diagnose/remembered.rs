//! Fits that were made before. Diagnoses of one recording by other thresholds go the same way until a threshold parts them; what
//! they fit up to there is the same to the last digit and need not be fitted again.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

/// Where fits from one start have ended, best first.
pub type Ends = Arc<Vec<End>>;

/// The fits of all diagnoses that share it; a copy shares them, too.
#[derive(Debug, Clone, Default)]
pub struct Remembered(Arc<Mutex<HashMap<u64, Ends>>>);

/// Where a fit has ended, without its model.
#[derive(Debug)]
pub struct End {
    /// Its parameters.
    pub theta: Vec<f64>,
    /// Negative log-likelihood [nats per sample].
    pub mean_nats: f64,
    /// What the calibration says against the base parameters [nats].
    pub prior_nats: f64,
    /// Scale of the residual [bar].
    pub scale_bar: f64,
    /// Root of the mean square of the residual [bar].
    pub rmse_bar: f64,
}

impl Remembered {
    /// What was kept under this number.
    pub(super) fn ends(&self, of: u64) -> Option<Ends> {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).get(&of).cloned()
    }

    /// Keeps it.
    pub(super) fn keep(&self, of: u64, ends: Vec<End>) {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).insert(of, Arc::new(ends));
    }
}
