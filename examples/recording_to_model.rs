//! From a recording to a model, and from the model to what it lacks: `cargo run --example recording_to_model -- sweep.csv drive.csv`.
//!
//! Without files the example makes both itself: a sweep of the paper's valve, and a drive of the same valve with a lag that
//! the sweep did not show.

use std::error::Error;
use std::path::Path;

use hil::identify::Options;
use hil::physics::{Misfit, simulate};
use hil::recording::Run;
use hil::{Course, Preparation, Recording, Valve, diagnose, identify, simulate_course};

fn main() -> Result<(), Box<dyn Error>> {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let (sweep, drive) = match files.as_slice() {
        [sweep, drive] => (Recording::read(Path::new(sweep), &[])?, Recording::read(Path::new(drive), &[])?),
        _ => made()?,
    };
    let found = identify(&sweep, &Options::default())?;
    println!("{}: delay {:.4} s, off by {:.4} bar on the sweep", found.valve.name, found.valve.delay_s, found.rmse_bar);

    let course = Course::of(&drive, &Preparation::default())?;
    let simulated = simulate_course(&found.valve, &course)?;
    let misfit = course.runs.iter().zip(&simulated).map(|(run, values)| Misfit::of(run, values)).fold(Misfit::default(), Misfit::and);
    println!("{} readings of the drive, noise {:.4} bar, off by {:.4?} bar", misfit.readings, course.noise.bar, misfit.rmse_bar());

    let diagnosed = diagnose(&drive, &found.valve)?;
    println!("{}", diagnosed.diagnosis.summary);
    Ok(())
}

/// A slow sweep, and a livelier drive of a valve that has become slower.
fn made() -> Result<(Recording, Recording), Box<dyn Error>> {
    let valve = Valve::load(&Valve::find("paper")?)?;
    let slower = Valve { lag_s: 0.06, ..valve.clone() };
    let recorded = |name: &str, valve: &Valve, current: &dyn Fn(f64) -> f64| -> Result<Recording, Box<dyn Error>> {
        let time_s: Vec<f64> = (0..6000).map(|k| f64::from(k) * 0.01).collect();
        let current_a: Vec<f64> = time_s.iter().map(|t| current(*t)).collect();
        let pressure_bar = simulate(valve, hil::valve::Input::Held, &time_s, &current_a)?;
        let pressure_bar =
            Some(pressure_bar.iter().enumerate().map(|(k, p)| p + 0.02 * ((k * 7919 % 1000) as f64 / 500.0 - 1.0)).collect());
        let run = Run { time_s, current_a, pressure_bar, ..Run::default() };
        Ok(Recording { source: name.into(), runs: vec![run], notes: Vec::new(), input: None })
    };
    let sweep = recorded("sweep", &valve, &|t| 0.5 + 0.4 * (1.0 - t / 120.0) * (0.25 * t).sin())?;
    let drive = recorded("drive", &slower, &|t| 0.5 + 0.25 * (0.37 * t).sin().signum() * (0.9 * t).sin().powi(2))?;
    Ok((sweep, drive))
}
