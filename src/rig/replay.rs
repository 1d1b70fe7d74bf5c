//! A recording as a rig: gives the recorded pressures in their order, whatever is commanded.

use super::{Quality, Rig, RigError, RigIdentity, SafeState, Sample};
use crate::recording::Run;

/// A recorded run behind the [`Rig`] trait; for tests of a plan and its metrics against real data.
pub struct ReplayRig {
    run: Run,
    identity: RigIdentity,
    next: usize,
}

impl ReplayRig {
    /// A rig that replays `run`; the name and hash of its file stand in `identity`.
    pub fn new(run: Run, identity: RigIdentity) -> Self {
        Self { run, identity: RigIdentity { kind: "replay".into(), ..identity }, next: 0 }
    }
}

impl Rig for ReplayRig {
    fn identity(&self) -> RigIdentity {
        self.identity.clone()
    }

    /// The next recorded sample; a gap in the recording is a held one.
    fn step(&mut self, _command_a: f64, until_s: f64) -> Result<Sample, RigError> {
        let k = self.next;
        let Some(time_s) = self.run.time_s.get(k).copied() else {
            return Err(RigError::Exhausted { source_name: self.identity.name.clone(), time_s: until_s });
        };
        self.next += 1;
        let at = |channel: &Option<Vec<f64>>| channel.as_ref().map(|c| c[k]).filter(|v| v.is_finite());
        let pressure = at(&self.run.pressure_bar);
        Ok(Sample {
            time_s: time_s - self.run.time_s[0],
            pressure_bar: pressure.unwrap_or(f64::NAN),
            current_a: at(&self.run.current_meas_a),
            oil_temp_c: at(&self.run.oil_temp_c),
            supply_bar: at(&self.run.supply_bar),
            quality: if pressure.is_some() { Quality::Good } else { Quality::Held },
            lateness_s: 0.0,
            round_trip_s: 0.0,
            missed_slots: 0,
        })
    }

    fn make_safe(&mut self) -> Result<SafeState, RigError> {
        Ok(SafeState::of(true, "a recording: nothing to make safe"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_come_in_order_and_end() {
        let run = Run { time_s: vec![5.0, 5.01], pressure_bar: Some(vec![1.0, f64::NAN]), ..Run::default() };
        let mut rig = ReplayRig::new(run, RigIdentity { name: "r.csv".into(), ..RigIdentity::default() });
        let first = rig.step(0.0, 0.01).unwrap();
        assert_eq!((first.time_s, first.pressure_bar, first.quality), (0.0, 1.0, Quality::Good));
        assert_eq!(rig.step(0.0, 0.02).unwrap().quality, Quality::Held);
        assert_eq!(rig.step(0.0, 0.03).unwrap_err().to_string(), "r.csv: no further sample after 0.030 s");
    }
}
