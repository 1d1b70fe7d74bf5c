//! Records for tests of this room.

use crate::record::{Dut, LimitRecord, Measurement, Outcome, PhaseRecord, PlanIdentity, TestRecord, Timing};
use crate::rig::RigIdentity;

/// A record with one phase `main` and one metric `rmse` in bar, limit 0.5 bar; the value follows from `seed`.
pub fn record(serial: &str, seed: u64) -> TestRecord {
    // Three digits, as records round their figures.
    let value = (400 + seed.wrapping_mul(7919) % 120) as f64 / 1000.0;
    let outcome = if value <= 0.5 { Outcome::Pass } else { Outcome::Fail };
    let limit = LimitRecord { max: Some(0.5), bound: "inclusive".into(), ..LimitRecord::default() };
    let measurement = Measurement {
        metric: "rmse".into(),
        value: Some(value),
        unit: "bar".into(),
        limit: Some(limit),
        outcome,
        definition: "rmse.example.v1".into(),
        reason: None,
    };
    TestRecord {
        schema: "hil.record/1".into(),
        plan: PlanIdentity { name: "example".into(), sha256: "00".into(), parameters: vec![], overridden: vec![] },
        dut: Dut { serial: serial.into(), ..Dut::default() },
        rig: RigIdentity { kind: "sim".into(), ..RigIdentity::default() },
        simulated: true,
        seed,
        outcome,
        reasons: vec![],
        phases: vec![PhaseRecord {
            name: "main".into(),
            role: "main".into(),
            outcome,
            reason: None,
            span_s: Some((0.0, 1.0)),
            measurements: vec![measurement],
            prompt: None,
        }],
        timing: Timing::default(),
        stability: None,
        model: None,
        safe_state: None,
        provenance: None,
    }
}
