//! Writes valve files to try FMUs on: one with each effect that there is, one without any, one with three.
//!
//!     cargo run -p hil-fmu --example models -- FOLDER

use std::path::PathBuf;

use hil::physics::{EFFECTS, specification};
use hil::valve::{EffectSpec, Valve};

/// Effects of both sides of the curve, one after the other.
const THREE: [&str; 3] = ["reversal_dead_band", "flow_limit", "sensor_lag"];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("which folder?")?);
    std::fs::create_dir_all(&folder)?;
    let paper = Valve::from_toml(include_str!("../../valves/paper.toml"), "paper.toml")?;
    let write = |name: &str, effects: Vec<EffectSpec>| {
        let valve = Valve { name: name.into(), effects, ..paper.clone() };
        std::fs::write(folder.join(format!("{name}.toml")), valve.to_toml())
    };
    let mut three = Vec::new();
    for effect in EFFECTS {
        let plainest: Vec<f64> = effect.parameters().iter().map(|p| p.default.unwrap_or(p.starts[0])).collect();
        let theta = if plainest.is_empty() { effect.examples().swap_remove(0) } else { plainest };
        let spec = specification(*effect, &theta);
        if THREE.contains(&effect.id()) {
            three.push(spec.clone());
        }
        write(effect.id(), vec![spec])?;
    }
    write("plain", Vec::new())?;
    write("three", three)?;
    Ok(())
}
