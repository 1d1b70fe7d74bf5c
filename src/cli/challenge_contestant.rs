//! This program, put to the test as a user calls it: as processes, in a folder that holds the recordings and nothing
//! else.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use super::good_data::GoodData;
use super::valves::checked_valve;
use crate::challenge::{Answer, ChallengeError, Contestant, Estimate, Named, Verdict, write_run, write_text};
use crate::diagnose::{Criteria, Remembered, diagnose_by};
use crate::recording::{Recording, Run};
use crate::valve::Valve;

/// The folders of one case.
pub(super) struct Processes<'a> {
    program: &'a Path,
    /// Holds the recordings of the case that may be seen, and what is made of them.
    blind: PathBuf,
    /// Holds the second drive.
    scoring: PathBuf,
    /// Holds the healthy twin.
    twin: PathBuf,
    commission: bool,
    asked: usize,
}

impl<'a> Processes<'a> {
    pub(super) fn new(program: &'a Path, folder: &Path, number: usize, commission: bool) -> Result<Self, ChallengeError> {
        let (blind, scoring) = (folder.join(format!("case-{number:02}")), folder.join("sealed").join(format!("case-{number:02}")));
        let twin = scoring.join("twin");
        for folder in [&blind, &twin] {
            std::fs::create_dir_all(folder).map_err(|source| ChallengeError::Write { path: folder.clone(), source })?;
        }
        Ok(Self { program, blind, scoring, twin, commission, asked: 0 })
    }

    fn call(&self, folder: &Path, args: &[&str]) -> Result<String, String> {
        let done = Command::new(self.program).args(args).current_dir(folder).output().map_err(|e| e.to_string())?;
        if done.status.success() {
            return Ok(String::from_utf8_lossy(&done.stdout).into_owned());
        }
        let words = String::from_utf8_lossy(&done.stderr);
        let last = words.lines().rev().find(|l| !l.trim().is_empty()).unwrap_or("no message");
        Err(format!("hil {}: {} ({last})", args.join(" "), done.status))
    }
}

/// The answer, and that after an experiment.
pub(super) const DIAGNOSIS: &str = "diagnosis.json";
pub(super) const DIAGNOSIS_2: &str = "diagnosis-2.json";

impl Processes<'_> {
    /// What a kept diagnosis of the case says.
    pub(super) fn answered(&self, diagnosis: &str) -> Result<Answer, String> {
        let text = std::fs::read_to_string(self.blind.join(diagnosis)).map_err(|e| format!("{diagnosis}: {e}"))?;
        read_answer(&text, self.blind.join("commission.csv").exists())
    }

    /// The record that lies there, to be asked about again.
    pub(super) fn again(&self) -> Result<Again, String> {
        let model = self.blind.join("model.toml");
        let valve = checked_valve(&model).map_err(|e| e.message)?;
        let records = [self.blind.join("record.csv")];
        // By its file's name alone, as in the folder itself.
        let read = |path: &Path| {
            let source = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            Recording::read(path, &[]).map(|recording| Recording { source, ..recording })
        };
        let good = GoodData::of((&model, &valve), &records, read).recordings;
        let recording = read(&records[0]).map_err(|e| e.to_string())?;
        Ok(Again { folder: self.blind.clone(), recording, valve, good, remembered: Remembered::default() })
    }
}

/// A case that is asked about again and again by other thresholds, in this process, so that what all of these diagnoses fit is fitted
/// once.
pub(super) struct Again {
    folder: PathBuf,
    recording: Recording,
    valve: Valve,
    good: Vec<Recording>,
    remembered: Remembered,
}

impl Again {
    /// Asks by the usual thresholds, so that what is common to all is remembered, and holds the answer against the one that a process of
    /// its own has given: what a diagnosis says must not hang on who calls it, nor on what is remembered.
    pub(super) fn as_usual(&self) -> Result<(), String> {
        let (told, kept) = (self.told_by(&Criteria::default())?, self.folder.join(DIAGNOSIS));
        match std::fs::read_to_string(&kept) {
            Ok(text) if text.trim() == told.trim() => Ok(()),
            Ok(_) => Err(format!("{}: another version said something else; ask in another folder", kept.display())),
            Err(e) => Err(format!("{}: {e}", kept.display())),
        }
    }

    fn path(&self, name: &str, value: f64) -> PathBuf {
        self.folder.join(format!("by-{name}-{value}-{}.json", env!("CARGO_PKG_VERSION")))
    }

    /// What was answered before when one threshold was another one, where that was asked and can be read.
    pub(super) fn kept(&self, name: &str, value: f64) -> Option<Answer> {
        let text = std::fs::read_to_string(self.path(name, value)).ok()?;
        self.read(&text).ok()
    }

    /// What is answered when one threshold is another one; kept beside the record.
    pub(super) fn by_criterion(&self, name: &str, value: f64) -> Result<Answer, String> {
        if let Some(answer) = self.kept(name, value) {
            return Ok(answer);
        }
        let told = self.told_by(&Criteria::default().with(name, value)?)?;
        write_text(&self.path(name, value), &told).map_err(|e| e.to_string())?;
        self.read(&told)
    }

    fn read(&self, text: &str) -> Result<Answer, String> {
        read_answer(text, self.folder.join("commission.csv").exists())
    }

    fn told_by(&self, criteria: &Criteria) -> Result<String, String> {
        let found = diagnose_by(criteria, Some(&self.remembered), &self.recording, &self.valve, &self.good);
        Ok(crate::report::diagnosis::json(&found.map_err(|e| e.to_string())?.diagnosis))
    }
}

impl Contestant for Processes<'_> {
    type Model = PathBuf;

    fn identify(&mut self, sweep: &Run, commission: Option<&Run>) -> Result<PathBuf, String> {
        // the first sweep is the case's own; a later one belongs to the twin and is none of the diagnosis's business
        let folder = if self.asked == 0 { self.blind.clone() } else { self.twin.clone() };
        self.asked += 1;
        write_run(&folder.join("sweep.csv"), sweep).map_err(|e| e.to_string())?;
        let mut args = vec!["identify", "sweep.csv"];
        if let Some(drive) = commission.filter(|_| self.commission) {
            write_run(&folder.join("commission.csv"), drive).map_err(|e| e.to_string())?;
            args.push("commission.csv");
        }
        args.extend(["-o", "model.toml"]);
        self.call(&folder, &args)?;
        absolute(&folder.join("model.toml"))
    }

    fn diagnose(&mut self, record: &Run, experiment: Option<&Run>, _: &PathBuf) -> Result<(Answer, PathBuf), String> {
        write_run(&self.blind.join("record.csv"), record).map_err(|e| e.to_string())?;
        let mut args = vec!["diagnose", "record.csv"];
        let (mut augmented, mut diagnosis) = ("augmented.toml", DIAGNOSIS);
        if let Some(run) = experiment {
            write_run(&self.blind.join("experiment.csv"), run).map_err(|e| e.to_string())?;
            args.push("experiment.csv");
            (augmented, diagnosis) = ("augmented-2.toml", DIAGNOSIS_2);
        }
        args.extend(["--model", "model.toml", "-o", augmented, "--format", "json"]);
        let text = self.call(&self.blind, &args)?;
        write_text(&self.blind.join(diagnosis), &text).map_err(|e| e.to_string())?;
        let answer = self.answered(diagnosis)?;
        let augmented = self.blind.join(augmented);
        Ok((answer, absolute(&if augmented.exists() { augmented } else { self.blind.join("model.toml") })?))
    }

    fn proposed(&self) -> Option<Vec<(f64, f64)>> {
        let text = std::fs::read_to_string(self.blind.join(DIAGNOSIS)).ok()?;
        let document: Value = serde_json::from_str(&text).ok()?;
        serde_json::from_value(document["next_experiment"]["table"].clone()).ok()
    }

    fn simulate(&mut self, model: &PathBuf, run: &Run) -> Result<Vec<f64>, String> {
        let folder = if model.starts_with(absolute(&self.twin)?) { &self.twin } else { &self.scoring };
        write_run(&folder.join("drive.csv"), run).map_err(|e| e.to_string())?;
        self.call(folder, &["simulate", "drive.csv", "--model", &model.to_string_lossy(), "-o", "simulated.csv", "--force"])?;
        let simulated = Recording::read(&folder.join("simulated.csv"), &[]).map_err(|e| e.to_string())?;
        simulated.runs.into_iter().next().and_then(|r| r.pressure_bar).ok_or_else(|| "no pressure_bar came back".to_owned())
    }
}

fn absolute(path: &Path) -> Result<PathBuf, String> {
    std::path::absolute(path).map_err(|e| format!("{}: {e}", path.display()))
}

/// Reads what is scored from a diagnosis document.
fn read_answer(text: &str, with_commission: bool) -> Result<Answer, String> {
    let document: Value = serde_json::from_str(text).map_err(|e| format!("diagnosis: {e}"))?;
    let word = document["verdict"].as_str().unwrap_or_default();
    let verdict = Verdict::parse(word).ok_or_else(|| format!("diagnosis: verdict `{word}` is none of the contract's"))?;
    let words =
        |value: &Value| -> Vec<String> { value.as_array().into_iter().flatten().filter_map(|v| v.as_str().map(str::to_owned)).collect() };
    let effects = document["effects"].as_array().ok_or("diagnosis: no list `effects`")?;
    let named = |e: &Value| {
        let id = e["id"].as_str().ok_or("diagnosis: an effect without `id`")?.to_owned();
        let parameters = e["parameters"].as_object().into_iter().flatten().filter_map(|(name, p)| estimate(name, p)).collect();
        Ok(Named { id, indistinguishable: words(&e["indistinguishable"]), lacks: e["claim"] == "lacks", parameters })
    };
    let error = |key: &str| document["rmse_bar"][key].as_f64();
    Ok(Answer {
        verdict,
        effects: effects.iter().map(named).collect::<Result<_, String>>()?,
        form: document["form"].as_array().into_iter().flatten().filter_map(|e| e["id"].as_str().map(str::to_owned)).collect(),
        claimed_gain_bar: error("base_heldout").zip(error("augmented_heldout")).map_or(0.0, |(base, augmented)| base - augmented),
        with_commission,
    })
}

/// A parameter with its 95 % interval; an end that is open is beyond all.
fn estimate(name: &str, parameter: &Value) -> Option<Estimate> {
    let ends = parameter["interval"].as_array()?;
    let (low, high) = (ends.first()?.as_f64(), ends.get(1)?.as_f64());
    low.or(high)?;
    Some(Estimate { name: name.to_owned(), low: low.unwrap_or(f64::NEG_INFINITY), high: high.unwrap_or(f64::INFINITY) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_read_from_the_keys_of_the_contract() {
        let text = r#"{"schema":"hil.diagnosis/1","verdict":"explained","rmse_bar":{"base_heldout":0.5,"augmented_heldout":0.25},
            "effects":[{"id":"first_order_lag","indistinguishable":["sensor_lag"],"claim":"lacks",
            "parameters":{"tau":{"value":0.045,"std_error":0.001,"interval":[0.043,null],"unit":"s"},
            "exponent":{"value":1,"std_error":null,"interval":null,"unit":""},"band":{"value":1,"interval":[null,null]}}}],
            "form":[{"id":"reference_shape"}]}"#;
        let answer = read_answer(text, true).unwrap_or_else(|e| panic!("{e}"));
        let effect = &answer.effects[0];
        assert!(effect.id == "first_order_lag" && effect.indistinguishable == ["sensor_lag"] && effect.lacks);
        assert_eq!(effect.parameters, [Estimate { name: "tau".into(), low: 0.043, high: f64::INFINITY }]);
        assert_eq!((answer.claimed_gain_bar, answer.form, answer.with_commission), (0.25, vec!["reference_shape".to_owned()], true));
        assert!(read_answer(r#"{"verdict":"perhaps","effects":[]}"#, false).is_err_and(|e| e.contains("perhaps")));
        assert!(read_answer(r#"{"verdict":"match"}"#, false).is_err_and(|e| e.contains("effects")));
    }
}
