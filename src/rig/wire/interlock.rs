//! Measured values and commands at which a run ends in the safe state. A value that is no number trips each of them.

use super::WireRig;
use crate::rig::{RigError, Sample, exceeds};

impl WireRig {
    pub(super) fn interlocks(&mut self, sample: &Sample) -> Result<(), RigError> {
        let limits = self.driver.profile.interlock;
        let over = |what: &str, value: f64, limit: Option<f64>, unit: &str| match limit {
            Some(limit) if exceeds(value, limit) => {
                Err(RigError::Interlock { what: format!("{what} {value:.3} {unit} above {limit:.3} {unit} at {:.3} s", sample.time_s) })
            }
            _ => Ok(()),
        };
        over("pressure", sample.pressure_bar, limits.pressure_max_bar, "bar")?;
        // By magnitude, and where the profile has a current: one that is missing shows nothing.
        if let Some(current_a) = sample.current_a {
            over("measured current", current_a.abs(), limits.current_max_a, "A")?;
        }
        self.current_follows(sample)?;
        if let Some((time_s, pressure_bar)) = self.last_good.replace((sample.time_s, sample.pressure_bar))
            && sample.time_s > time_s
        {
            let step = (sample.pressure_bar - pressure_bar).abs();
            let rate = (sample.pressure_bar - pressure_bar).abs() / (sample.time_s - time_s);
            over("rate of pressure", rate, limits.pressure_rate_max_bar_per_s, "bar/s")?;
            over("step of pressure from one sample to the next (a spike of the sensor?)", step, limits.pressure_step_max_bar, "bar")?;
        }
        Ok(())
    }

    /// A coil that does not take the commanded current for some time is a broken wire or a dead driver.
    fn current_follows(&mut self, sample: &Sample) -> Result<(), RigError> {
        let (Some((by_a, for_s)), Some(measured_a)) = (self.driver.profile.interlock.current_deviation, sample.current_a) else {
            return Ok(());
        };
        let (low_a, high_a) = self.commands_a;
        if measured_a >= low_a - by_a && measured_a <= high_a + by_a {
            self.deviates_since_s = None;
            return Ok(());
        }
        let since_s = *self.deviates_since_s.get_or_insert(sample.time_s);
        if sample.time_s - since_s < for_s {
            return Ok(());
        }
        let what = format!(
            "measured current {measured_a:.4} A does not follow the commanded {high_a:.4} A since {since_s:.3} s: a broken wire, or a driver that is not enabled"
        );
        Err(RigError::Interlock { what })
    }

    pub(super) fn check_slew(&self, command_a: f64) -> Result<(), RigError> {
        let change = (command_a - self.last_command_a).abs() / self.period_s;
        match self.driver.profile.limit.slew_a_per_s {
            Some(limit) if change > limit * (1.0 + 1e-9) => Err(RigError::Slew { change_a_per_s: change, limit_a_per_s: limit }),
            _ => Ok(()),
        }
    }
}
