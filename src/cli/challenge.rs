//! `hil challenge`: conceal an effect in fresh data, diagnose it blind, open the seal, score.
//!
//! The diagnosis runs as a user would run it: as processes of this program, in a folder that holds the sweep and the
//! drive and nothing else. The truth and the second drive lie elsewhere.

use std::path::{Path, PathBuf};
use std::process::Command;

use clap::{Args, ValueEnum};
use serde_json::Value;

use super::outputs::Force;
use super::{CliError, CliResult, exit};
use crate::challenge::{Answer, ChallengeError, Contestant, Named, Seal, Verdict, draw_series, hold_trial, write_run, write_text};
use crate::output::{Mark, Outputs};
use crate::recording::{Recording, Run};
use crate::report::challenge as report;

/// What to conceal, and how often.
#[derive(Debug, Args)]
pub struct ChallengeArgs {
    /// Everything is drawn from it; without it, a new one is taken and printed
    #[arg(long)]
    seed: Option<u64>,
    /// How many valves
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    count: u32,
    /// Keep the recordings, models, diagnoses and the opened truth in this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Existing files.
    #[command(flatten)]
    force: Force,
    /// How to print the result
    #[arg(long, value_enum, default_value = "text")]
    format: ChallengeFormat,
}

/// What a kept challenge begins with; a folder that has it holds another one.
const KEPT: [(&str, Mark); 2] = [("sealed", Mark::None), ("case-01", Mark::None)];

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ChallengeFormat {
    Text,
    Json,
    Markdown,
}

/// Draws, seals, asks, opens, scores. Exit code 1 where an answer could not be had.
pub fn run(args: &ChallengeArgs) -> CliResult {
    let seed = args.seed.unwrap_or_else(fresh_seed);
    let folder = args.out.clone().unwrap_or_else(|| std::env::temp_dir().join(format!("hil-challenge-{}", std::process::id())));
    let _claim = Outputs::new(args.force.force).folder(args.out.as_ref(), &KEPT).claim()?;
    let outcome = hold(args, seed, &folder);
    if args.out.is_none() {
        // scratch; what could not be removed harms nobody
        let _ = std::fs::remove_dir_all(&folder);
    }
    outcome
}

fn hold(args: &ChallengeArgs, seed: u64, folder: &Path) -> CliResult {
    let cases = draw_series(seed, args.count as usize);
    let seal = Seal::new(&cases);
    let sealed = folder.join("sealed");
    std::fs::create_dir_all(&sealed).map_err(|e| CliError::not_stored(format!("{}: {e}", sealed.display())))?;
    write_text(&sealed.join("truth.json"), &seal.text).map_err(CliError::not_stored)?;
    let head = report::head(seed, cases.len(), &seal.sha256);
    if args.format == ChallengeFormat::Text {
        super::print(&head)?
    } else {
        anstream::eprint!("{head}")
    }

    let program = std::env::current_exe().map_err(|e| CliError { code: exit::INTERNAL, message: format!("own program: {e}") })?;
    let mut results = Vec::new();
    for (k, case) in cases.iter().enumerate() {
        anstream::eprintln!("case {} of {} ..", k + 1, cases.len());
        let mut contestant = Processes::new(&program, folder, k + 1).map_err(CliError::not_stored)?;
        results.push(hold_trial(case, &mut contestant));
        if args.format == ChallengeFormat::Text {
            super::print(&report::line(k + 1, case, &results[k]))?;
        }
    }
    let opened =
        std::fs::read_to_string(sealed.join("truth.json")).map_err(|e| CliError::not_stored(format!("{}: {e}", sealed.display())))?;
    if !seal.holds(&opened) {
        return Err(CliError { code: exit::INTERNAL, message: format!("{}: the seal is broken, so nothing is scored", sealed.display()) });
    }
    super::print(&match args.format {
        ChallengeFormat::Text => report::text(&results),
        ChallengeFormat::Markdown => report::markdown(seed, &seal.sha256, &results),
        ChallengeFormat::Json => report::json(seed, &seal.sha256, &cases, &results),
    })?;
    Ok(if results.iter().any(Result::is_err) { exit::NEGATIVE } else { exit::DONE })
}

/// A seed that nobody chose: the digits of the clock.
fn fresh_seed() -> u64 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    now.map_or(1, |d| u64::from(d.subsec_nanos()) / 100)
}

/// This program, called as a user calls it.
struct Processes<'a> {
    program: &'a Path,
    /// Holds the sweep and the drive of the case, and what is made of them.
    blind: PathBuf,
    /// Holds the second drive.
    scoring: PathBuf,
    /// Holds the healthy twin.
    twin: PathBuf,
    asked: usize,
}

impl<'a> Processes<'a> {
    fn new(program: &'a Path, folder: &Path, number: usize) -> Result<Self, ChallengeError> {
        let (blind, scoring) = (folder.join(format!("case-{number:02}")), folder.join("sealed").join(format!("case-{number:02}")));
        let twin = scoring.join("twin");
        for path in [&blind, &twin] {
            std::fs::create_dir_all(path).map_err(|source| ChallengeError::Write { path: path.clone(), source })?;
        }
        Ok(Self { program, blind, scoring, twin, asked: 0 })
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

impl Contestant for Processes<'_> {
    type Model = PathBuf;

    fn identify(&mut self, sweep: &Run) -> Result<PathBuf, String> {
        // the first sweep is the case's own; a later one belongs to the twin and is none of the diagnosis's business
        let folder = if self.asked == 0 { self.blind.clone() } else { self.twin.clone() };
        self.asked += 1;
        write_run(&folder.join("sweep.csv"), sweep).map_err(|e| e.to_string())?;
        self.call(&folder, &["identify", "sweep.csv", "-o", "model.toml"])?;
        absolute(&folder.join("model.toml"))
    }

    fn diagnose(&mut self, record: &Run, _: &PathBuf) -> Result<(Answer, PathBuf), String> {
        write_run(&self.blind.join("record.csv"), record).map_err(|e| e.to_string())?;
        let text =
            self.call(&self.blind, &["diagnose", "record.csv", "--model", "model.toml", "-o", "augmented.toml", "--format", "json"])?;
        write_text(&self.blind.join("diagnosis.json"), &text).map_err(|e| e.to_string())?;
        let answer = read_answer(&text)?;
        let augmented = self.blind.join("augmented.toml");
        Ok((answer, absolute(&if augmented.exists() { augmented } else { self.blind.join("model.toml") })?))
    }

    fn simulate(&mut self, model: &PathBuf, run: &Run) -> Result<Vec<f64>, String> {
        let folder = if model.starts_with(absolute(&self.twin)?) { &self.twin } else { &self.scoring };
        write_run(&folder.join("drive.csv"), run).map_err(|e| e.to_string())?;
        self.call(folder, &["simulate", "drive.csv", "--model", &model.to_string_lossy(), "--force", "-o", "simulated.csv"])?;
        let simulated = Recording::read(&folder.join("simulated.csv"), &[]).map_err(|e| e.to_string())?;
        simulated.runs.into_iter().next().and_then(|r| r.pressure_bar).ok_or_else(|| "no pressure_bar came back".to_owned())
    }
}

fn absolute(path: &Path) -> Result<PathBuf, String> {
    std::path::absolute(path).map_err(|e| format!("{}: {e}", path.display()))
}

/// Reads what is scored from a diagnosis document.
fn read_answer(text: &str) -> Result<Answer, String> {
    let document: Value = serde_json::from_str(text).map_err(|e| format!("diagnosis: {e}"))?;
    let word = document["verdict"].as_str().unwrap_or_default();
    let verdict = Verdict::parse(word).ok_or_else(|| format!("diagnosis: verdict `{word}` is none of the contract's"))?;
    let words =
        |value: &Value| -> Vec<String> { value.as_array().into_iter().flatten().filter_map(|v| v.as_str().map(str::to_owned)).collect() };
    let effects = document["effects"].as_array().ok_or("diagnosis: no list `effects`")?;
    let named = |e: &Value| {
        let id = e["id"].as_str().ok_or("diagnosis: an effect without `id`")?.to_owned();
        Ok(Named { id, indistinguishable: words(&e["indistinguishable"]) })
    };
    Ok(Answer { verdict, effects: effects.iter().map(named).collect::<Result<_, String>>()? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_read_from_the_keys_of_the_contract() {
        let text =
            r#"{"schema":"hil.diagnosis/1","verdict":"explained","effects":[{"id":"first_order_lag","indistinguishable":["sensor_lag"]}]}"#;
        let effects = vec![Named { id: "first_order_lag".into(), indistinguishable: vec!["sensor_lag".into()] }];
        assert_eq!(read_answer(text), Ok(Answer { verdict: Verdict::Explained, effects }));
        assert!(read_answer(r#"{"verdict":"perhaps","effects":[]}"#).is_err_and(|e| e.contains("perhaps")));
        assert!(read_answer(r#"{"verdict":"match"}"#).is_err_and(|e| e.contains("effects")));
    }
}
