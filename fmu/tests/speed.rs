//! How long a step of 10 ms takes, inputs and outputs included. Only an optimised build says anything.
#![cfg(not(debug_assertions))]

use std::time::Instant;

use hil::exchange::fmu::{CURRENT_IN, PRESSURE_OUT, Part};
use hil::valve::Valve;
use hil_fmu::Instance;

const STEP_S: f64 = 0.01;
const STEPS: usize = 20_000;

/// The quickest of some runs [ns a step]: what else the machine does only adds.
fn step_ns(effects: &str) -> f64 {
    let text = format!("{}\n{effects}", include_str!("../../valves/paper.toml"));
    let valve = Valve::from_toml(&text, "valve.toml").unwrap();
    (0..15)
        .map(|_| {
            let mut instance = Instance::of(valve.clone(), Part::Whole, STEP_S).unwrap();
            instance.enter_initialization().unwrap();
            instance.exit_initialization().unwrap();
            let begun = Instant::now();
            let mut sum = 0.0;
            for k in 0..STEPS {
                instance.set_real(CURRENT_IN, 0.3 + 0.4 * ((k % 700) as f64 / 700.0)).unwrap();
                instance.do_step(k as f64 * STEP_S, STEP_S).unwrap();
                sum += instance.real(PRESSURE_OUT).unwrap();
            }
            assert!(sum > 0.0);
            begun.elapsed().as_secs_f64() / STEPS as f64 * 1e9
        })
        .fold(f64::INFINITY, f64::min)
}

#[test]
fn a_step_takes_less_than_a_microsecond_and_with_three_effects_less_than_three() {
    let plain = step_ns("");
    let three = step_ns(
        "[[effect]]\nreversal_dead_band = { width = \"15 mA\" }\n[[effect]]\nflow_limit = { rise = \"60 bar/s\", fall = \"50 bar/s\" }\n[[effect]]\nsensor_lag = { tau = \"30 ms\" }\n",
    );
    println!("a step of 10 ms: {plain:.0} ns, with three effects {three:.0} ns");
    assert!(plain < 1000.0 && three < 3000.0, "{plain} ns, {three} ns");
}
