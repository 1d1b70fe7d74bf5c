//! Channels over time, from a file or from a rig.
//!
//! A [`Recording`] holds one or more [`Run`]s; each run starts from its own initial state. Values are in the
//! canonical units of [`crate::units`]; a value that was not recorded is NaN, never zero.

/// The channels that `hil` knows, by the names of the recording format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Channel {
    /// `current_a`: the commanded current [A].
    Current,
    /// `pressure_bar`: the measured pressure [bar].
    Pressure,
    /// `target_bar`: the pressure that the controller was asked for [bar].
    Target,
    /// `current_meas_a`: the measured current [A].
    MeasuredCurrent,
    /// `oil_temp_c`: oil temperature [degC].
    OilTemperature,
    /// `supply_bar`: supply pressure [bar].
    Supply,
}

/// One run: samples from its own start.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Run {
    /// Name from the `run` column; `None` where the file holds one nameless run.
    pub name: Option<String>,
    /// Time of each sample [s], strictly increasing.
    pub time_s: Vec<f64>,
    /// Commanded current [A], NaN where not recorded.
    pub current_a: Vec<f64>,
    /// Measured pressure [bar], NaN where not recorded; `None` where the file has no such channel.
    pub pressure_bar: Option<Vec<f64>>,
    /// Target pressure [bar].
    pub target_bar: Option<Vec<f64>>,
    /// Measured current [A].
    pub current_meas_a: Option<Vec<f64>>,
    /// Oil temperature [degC].
    pub oil_temp_c: Option<Vec<f64>>,
    /// Supply pressure [bar].
    pub supply_bar: Option<Vec<f64>>,
}

/// A recording: its runs, and what was noticed while it was read.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    /// File name, for messages.
    pub source: String,
    /// The runs in the order of the file; never empty.
    pub runs: Vec<Run>,
    /// What was handled while reading, for instance "3 rows with a repeated time were dropped (first: row 17)".
    pub notes: Vec<String>,
}

impl Run {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }
    /// Whether the run has no sample.
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }
    /// Median time step [s]; 0 for a run of fewer than two samples.
    pub fn step_s(&self) -> f64 {
        let mut steps: Vec<f64> = self.time_s.windows(2).map(|w| w[1] - w[0]).collect();
        if steps.is_empty() {
            return 0.0;
        }
        let middle = steps.len() / 2;
        *steps.select_nth_unstable_by(middle, f64::total_cmp).1
    }
}
