//! The recordings of the example: a simulated valve swept when it was new, and logged in a drive after it changed.
//!
//! The log is as loggers write them: a preamble, Latin letters, decimal commas, milliamperes and megapascals, date and
//! time of day in two columns, over midnight.

use std::fmt::Write as _;

use crate::cli::CliError;
use crate::physics::Plant;
use crate::shipped;
use crate::valve::{EffectSpec, Valve};

/// Step of both recordings [s].
const STEP_S: f64 = 0.01;
/// Seed of the sensor noise.
const SEED: u64 = 7;
/// Milliseconds of a day.
const DAY_MS: u64 = 86_400_000;

/// Three triangles over the whole current, slow enough for the loop and fast enough for the dynamics.
pub fn sweep() -> Result<String, CliError> {
    let current: Vec<f64> = (0..6000).map(|n| 0.08 + 0.88 * triangle(f64::from(n) * STEP_S / 20.0)).collect();
    let mut text = String::from("# simulated by hil init: the valve when it was new\ntime_s,current_a,pressure_bar\n");
    for (n, (i, p)) in current.iter().zip(measured(&current, &[])?).enumerate() {
        let _ = writeln!(text, "{:.2},{i:.4},{p:.3}", n as f64 * STEP_S);
    }
    Ok(text)
}

/// Levels and ramps of a drive; the valve has become slower since.
pub fn logger() -> Result<Vec<u8>, CliError> {
    let levels = [0.25, 0.55, 0.4, 0.7, 0.3, 0.62, 0.48, 0.8, 0.35, 0.58];
    let current: Vec<f64> = (0..6000)
        .map(|n| {
            let (at, within) = (n / 200, f64::from(n % 200) * STEP_S);
            let level = |k: i32| levels[(k * 7 + k / 10 * 3) as usize % levels.len()];
            let (from, to) = (if at == 0 { levels[0] } else { level(at - 1) }, level(at));
            // A ramp of 0.1 to 0.5 s, then a hold.
            from + (to - from) * (within / (0.1 + 0.1 * f64::from(at % 5))).min(1.0)
        })
        .collect();
    let slower = EffectSpec { id: "first_order_lag".into(), parameters: vec![("tau".into(), "45 ms".into())] };
    let pressure = measured(&current, &[slower])?;
    let mut text = String::from("Logger simulated by hil init\nPr\u{fc}fstand 1\n\nDatum;Zeit;Ventilstrom [mA];\u{d6}ldruck [MPa]\n");
    let start_ms = DAY_MS - 30_000;
    for (n, (i, p)) in current.iter().zip(pressure).enumerate() {
        let ms = start_ms + 10 * n as u64;
        let (day, of_day) = (1 + ms / DAY_MS, ms % DAY_MS);
        let clock = format!("{:02}:{:02}:{:02},{:03}", of_day / 3_600_000, of_day / 60_000 % 60, of_day / 1000 % 60, of_day % 1000);
        let _ = writeln!(text, "{day:02}.03.2026;{clock};{};{}", comma(i * 1e3, 1), comma(p * 0.1, 4));
    }
    // Latin-1: one byte a letter.
    Ok(text.chars().map(|c| u8::try_from(u32::from(c)).unwrap_or(b'?')).collect())
}

/// From 0 to 1 and back within a period of 1.
fn triangle(phase: f64) -> f64 {
    1.0 - (2.0 * phase.fract() - 1.0).abs()
}

fn comma(value: f64, decimals: usize) -> String {
    format!("{value:.decimals$}").replace('.', ",")
}

/// The pressure of the paper's valve with further effects and its sensor noise.
fn measured(current_a: &[f64], effects: &[EffectSpec]) -> Result<Vec<f64>, CliError> {
    let text = shipped::text(std::path::Path::new("hil:valves/paper.toml")).unwrap_or_default();
    let mut valve = Valve::from_toml(text, "hil:valves/paper.toml").map_err(CliError::input)?;
    valve.effects = effects.to_vec();
    let mut plant = Plant::new(&valve, STEP_S, current_a[0], Some(SEED)).map_err(CliError::input)?;
    Ok(current_a.iter().map(|i| plant.step(*i)).collect())
}
