//! Runs and recordings in memory.

use super::channel::Channel;
use crate::valve::Input;

/// Most values of all channels of a recording together: a day of five channels at 100 Hz, 350 MB while they are read.
pub const MOST_VALUES: u64 = 45_000_000;

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
    /// What the command does between its samples, where that was stated.
    pub input: Option<Input>,
}

impl Recording {
    /// Whether any run holds the channel.
    pub fn has(&self, channel: Channel) -> bool {
        self.runs.iter().any(|run| run.channel(channel).is_some())
    }
}

impl Run {
    /// The values of a channel, `None` where the file has no such channel.
    pub fn channel(&self, channel: Channel) -> Option<&[f64]> {
        match channel {
            Channel::Current => Some(&self.current_a),
            Channel::Pressure => self.pressure_bar.as_deref(),
            Channel::Target => self.target_bar.as_deref(),
            Channel::MeasuredCurrent => self.current_meas_a.as_deref(),
            Channel::OilTemperature => self.oil_temp_c.as_deref(),
            Channel::Supply => self.supply_bar.as_deref(),
        }
    }
    /// Sets the values of a channel; a current that is taken away leaves an empty channel.
    pub fn set(&mut self, channel: Channel, values: Option<Vec<f64>>) {
        match channel {
            Channel::Current => self.current_a = values.unwrap_or_default(),
            Channel::Pressure => self.pressure_bar = values,
            Channel::Target => self.target_bar = values,
            Channel::MeasuredCurrent => self.current_meas_a = values,
            Channel::OilTemperature => self.oil_temp_c = values,
            Channel::Supply => self.supply_bar = values,
        }
    }
    /// Whether a channel never changes over the values that it holds; false where it holds none.
    pub fn is_constant(&self, channel: Channel) -> bool {
        let Some(values) = self.channel(channel) else { return false };
        let mut finite = values.iter().filter(|v| v.is_finite());
        finite.next().is_some_and(|first| finite.all(|v| v == first))
    }
    /// Every vector of the run, time first.
    pub(super) fn columns_mut(&mut self) -> impl Iterator<Item = &mut Vec<f64>> {
        let optional = [&mut self.pressure_bar, &mut self.target_bar, &mut self.current_meas_a, &mut self.oil_temp_c, &mut self.supply_bar];
        [&mut self.time_s, &mut self.current_a].into_iter().chain(optional.into_iter().flatten())
    }
    /// Keeps the samples that `keep` marks.
    pub(super) fn retain(&mut self, keep: &[bool]) {
        for values in self.columns_mut() {
            let mut marks = keep.iter();
            values.retain(|_| marks.next().copied().unwrap_or(true));
        }
    }
    /// Cuts the run at a sample and returns what stands behind it.
    pub(super) fn split_off(&mut self, sample: usize) -> Self {
        let mut behind = Self { name: self.name.clone(), time_s: self.time_s.split_off(sample), ..Self::default() };
        for channel in Channel::ALL {
            let cut = match channel {
                Channel::Current => Some(self.current_a.split_off(sample)),
                Channel::Pressure => self.pressure_bar.as_mut().map(|v| v.split_off(sample)),
                Channel::Target => self.target_bar.as_mut().map(|v| v.split_off(sample)),
                Channel::MeasuredCurrent => self.current_meas_a.as_mut().map(|v| v.split_off(sample)),
                Channel::OilTemperature => self.oil_temp_c.as_mut().map(|v| v.split_off(sample)),
                Channel::Supply => self.supply_bar.as_mut().map(|v| v.split_off(sample)),
            };
            behind.set(channel, cut);
        }
        behind
    }
    /// The first of every so many samples.
    pub fn every(&self, samples: usize) -> Self {
        let mut few = self.clone();
        let keep: Vec<bool> = (0..self.len()).map(|k| k % samples.max(1) == 0).collect();
        few.retain(&keep);
        few
    }
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
