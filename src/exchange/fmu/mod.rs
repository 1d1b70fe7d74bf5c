//! A valve model as a functional mock-up unit: co-simulation, FMI 2.0 or 3.0.
//!
//! There is one simulator: the library inside the FMU is this library, built as `fmu/`, and the model lies beside it as
//! the valve file that it is (`resources/valve.toml`). Parameters of the model are tunable parameters of the FMU.

mod description;
mod export;
mod part;
mod variables;

use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

pub use description::{MODEL_IDENTIFIER, Version};
pub use export::Export;
pub use part::{PART_FILE, Part};
pub use variables::{
    CURRENT_IN, CURRENT_OUT, CURVE_PRESSURE_OUT, Causality, MODEL_TIME_OUT, Meaning, OIL_TEMPERATURE_IN, PRESSURE_IN, PRESSURE_OUT, SEED,
    SUPPLY_PRESSURE_IN, Variable, set, variables,
};

use super::ExchangeError;
use crate::units::{TIME, Time};
use crate::valve::Valve;

/// The model's place below the resources.
pub const VALVE_FILE: &str = "valve.toml";
/// The place of the internal step below the resources.
pub const STEP_FILE: &str = "step.txt";
/// File name of the library that goes into an FMU.
pub const LIBRARY: &str = "libhil_fmu.so";

impl Export {
    /// A model, or effects about another one, from the text of its file, stepped every `step`.
    ///
    /// # Errors
    /// [`ExchangeError`] where the model is wrong or the step no positive time.
    pub fn new(valve_text: &str, source_name: &str, part: Part, step: Time) -> Result<Self, ExchangeError> {
        let valve = Valve::from_toml(valve_text, source_name)?;
        let variables = variables(&valve, part).map_err(|e| ExchangeError::Model(format!("{source_name}: {e}")))?;
        let step_s = step.value();
        if !(1e-5..=1.0).contains(&step_s) {
            return Err(ExchangeError::Model(format!("--step {}: 10 us to 1 s is allowed", TIME.print(step_s))));
        }
        let token = token(valve_text, part, step_s);
        Ok(Self { valve, valve_text: valve_text.into(), part, step_s, token, variables })
    }

    /// What the user of the FMU should know of how it differs from `hil simulate`.
    pub fn notes(&self) -> Vec<String> {
        if self.part != Part::Whole {
            let text = "effects alone: a master reads their output one step after it has set their input";
            return vec![text.into()];
        }
        let short = self.valve.delay_s < self.step_s;
        let note = format!(
            "the model's delay of {} is below one step of {}: a master sets the input at a step's begin, so the pressure follows one step later",
            TIME.print(self.valve.delay_s),
            TIME.print(self.step_s)
        );
        if short { vec![note] } else { Vec::new() }
    }

    /// The file, around the library's bytes.
    ///
    /// # Errors
    /// [`ExchangeError::Archive`].
    pub fn archive(&self, version: Version, library: &[u8]) -> Result<Vec<u8>, ExchangeError> {
        let folder = if version == Version::Two { "linux64" } else { "x86_64-linux" };
        let step = self.step_s.to_string();
        let description = description::description(self, version).map_err(|e| ExchangeError::Archive(e.to_string()))?;
        let files: [(String, &[u8]); 5] = [
            ("modelDescription.xml".into(), &description),
            (format!("binaries/{folder}/{MODEL_IDENTIFIER}.so"), library),
            (format!("resources/{VALVE_FILE}"), self.valve_text.as_bytes()),
            (format!("resources/{STEP_FILE}"), step.as_bytes()),
            (format!("resources/{PART_FILE}"), self.part.name().as_bytes()),
        ];
        let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
        // No time of its own: the same model gives the same bytes.
        let options = zip::write::SimpleFileOptions::default().last_modified_time(zip::DateTime::default());
        let archived = |e: &dyn std::fmt::Display| ExchangeError::Archive(e.to_string());
        for (name, bytes) in files {
            zip.start_file(name, options).map_err(|e| archived(&e))?;
            zip.write_all(bytes).map_err(|e| archived(&e))?;
        }
        Ok(zip.finish().map_err(|e| archived(&e))?.into_inner())
    }
}

/// What tells one exported model from another: a digest of the model, its part and its step, hex.
pub fn token(valve_text: &str, part: Part, step_s: f64) -> String {
    crate::digest::sha256([valve_text.as_bytes(), part.name().as_bytes(), &step_s.to_le_bytes()].concat())
}

/// The library that goes into an FMU: beside the program, or in `../lib/hil/` as packages lay it.
///
/// # Errors
/// [`ExchangeError::Library`] with the places and the command that builds it.
pub fn find_library() -> Result<PathBuf, ExchangeError> {
    let program = std::env::current_exe().unwrap_or_default();
    let folder = program.parent().unwrap_or(Path::new("."));
    let places = [folder.join(LIBRARY), folder.join("../lib/hil").join(LIBRARY), folder.join("release").join(LIBRARY)];
    places.iter().find(|p| p.is_file()).cloned().ok_or_else(|| ExchangeError::Library {
        places: places[..2].iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", "),
    })
}
