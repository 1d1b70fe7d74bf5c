//! `hil challenge`: conceal an effect in fresh data, diagnose it blind, open the seal, score.
//!
//! The diagnosis runs as a user would run it: as processes of this program, in a folder that holds the sweep and the
//! drive and nothing else. The truth and the second drive lie elsewhere.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::json;

use super::challenge_contestant::{DIAGNOSIS, DIAGNOSIS_2, Processes};
use super::challenge_criteria::Tallies;
use super::outputs::Force;
use super::progress::left;
use super::shard::Shard;
use super::{CliError, CliResult, exit};
use crate::challenge::{
    Anatomy, BROKEN, Broken, Case, Contestant, Formulations, Misfit, Range, Seal, Trial, break_record, draw_healthy, draw_series,
    hold_trial, write_text,
};
use crate::output::{Mark, Outputs};
use crate::report::{challenge as report, thresholds};

/// What to conceal, and how often.
#[derive(Debug, Args)]
pub struct ChallengeArgs {
    /// Everything is drawn from it; without it, a new one is taken and printed
    #[arg(long)]
    seed: Option<u64>,
    /// How many valves
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    count: u32,
    /// Keep the recordings, models, diagnoses and the opened truth in this folder; called again with the same series, it
    /// goes on with what is there
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Ask part I of N only, such as 2/4; the last call, without it, on the same --out puts all parts into one table
    #[arg(long, value_name = "I/N", requires = "out")]
    shard: Option<Shard>,
    /// Give the identification a drive of the good valve beside its sweep
    #[arg(long)]
    commission: bool,
    /// One plant only; without it, two of three valves are blocks, one is differential equations
    #[arg(long, value_enum)]
    plant: Option<PlantArg>,
    /// Which formulations of valves, drives, controllers and unknown physics are drawn: those that may be looked at while
    /// working, or those kept for the end
    #[arg(long, value_enum, default_value = "open")]
    formulations: FormulationsArg,
    /// Recordings of healthy valves that are damaged, or belong to another model: no cause may be named
    #[arg(long)]
    broken: bool,
    /// Drive the experiment that a diagnosis asks for on the concealed valve, and ask again with both recordings
    #[arg(long, conflicts_with_all = ["broken", "record", "fleet"])]
    with_experiment: bool,
    /// Ask about each valve again by every threshold of the diagnosis at half its value and at twice, and print what each is worth
    #[arg(long, conflicts_with_all = ["broken", "record", "fleet", "with_experiment", "format"])]
    criteria: bool,
    /// Only record into --out: a folder of recordings for each valve and truth.json beside them; nothing is asked
    #[arg(long, requires = "out")]
    record: bool,
    /// Write a fleet of N valves into --out: lots with a concealed story, and jobs.csv for `hil diagnose --jobs`
    #[arg(long, value_name = "N", requires = "out", value_parser = clap::value_parser!(u32).range(30..=1_000_000))]
    fleet: Option<u32>,
    /// Hold what `hil collect --format json` printed of the fleet of this --seed against its story
    #[arg(long, value_name = "COLLECTED.json", requires = "fleet", requires = "seed")]
    collected: Option<PathBuf>,
    /// Existing files.
    #[command(flatten)]
    force: Force,
    /// How to print the result
    #[arg(long, value_enum, default_value = "text")]
    format: ChallengeFormat,
}

/// What a kept challenge begins with; a folder that has it holds another one.
const KEPT: [(&str, Mark); 3] = [("sealed", Mark::None), ("case-01", Mark::None), ("truth.json", Mark::None)];

/// What a fleet's folder begins with.
const FLEET: [(&str, Mark); 3] = [("jobs.csv", Mark::None), ("recordings", Mark::None), ("sealed", Mark::None)];

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ChallengeFormat {
    Text,
    Json,
    Markdown,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PlantArg {
    Blocks,
    Equations,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FormulationsArg {
    Open,
    Kept,
    All,
}

impl ChallengeArgs {
    fn range(&self) -> Range {
        let anatomy = self.plant.map(|p| match p {
            PlantArg::Blocks => Anatomy::Blocks,
            PlantArg::Equations => Anatomy::Equations,
        });
        let formulations = match self.formulations {
            FormulationsArg::Open => Formulations::Open,
            FormulationsArg::Kept => Formulations::Kept,
            FormulationsArg::All => Formulations::All,
        };
        Range { anatomy, formulations }
    }
}

/// Draws, seals, asks, opens, scores. Exit code 1 where an answer could not be had.
pub fn run(args: &ChallengeArgs) -> CliResult {
    let seed = args.seed.unwrap_or_else(fresh_seed);
    let (count, range) = (args.count as usize, args.range());
    let guard = || Outputs::new(args.force.force).folder(args.out.as_ref(), &KEPT).claim();
    if let (Some(valves), Some(out)) = (args.fleet, &args.out) {
        if let Some(collected) = &args.collected {
            return super::challenge_fleet::score(collected, seed, valves as usize);
        }
        let _claim = Outputs::new(args.force.force).folder(Some(out), &FLEET).claim()?;
        return super::challenge_fleet::write(out, seed, valves as usize);
    }
    if let (true, Some(out)) = (args.record, &args.out) {
        let _claim = guard()?;
        return super::challenge_set::write(out, seed, count, range, args.broken);
    }
    let folder = args.out.clone().unwrap_or_else(|| std::env::temp_dir().join(format!("hil-challenge-{}", std::process::id())));
    let cases = if args.broken { draw_healthy(seed, count, range) } else { draw_series(seed, count, range) };
    let seal = Seal::new(&cases);
    let sealed = folder.join("sealed").join("truth.json");
    // the same series goes on with what is there; another one needs another folder
    let goes_on = std::fs::read_to_string(&sealed).is_ok_and(|text| seal.holds(&text));
    let _claim = if goes_on { None } else { Some(guard()?) };
    let outcome = hold(args, seed, &cases, &seal, &folder);
    if args.out.is_none() {
        // scratch; what could not be removed harms nobody
        let _ = std::fs::remove_dir_all(&folder);
    }
    outcome
}

fn hold(args: &ChallengeArgs, seed: u64, cases: &[Case], seal: &Seal, folder: &Path) -> CliResult {
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
    let mut asked = Vec::new();
    let (mut results, mut broken, mut tallies) = (Vec::new(), Vec::new(), Tallies::default());
    let own: Vec<(usize, &Case)> = cases.iter().enumerate().filter(|(k, _)| args.shard.is_none_or(|s| s.holds(*k))).collect();
    let begun = std::time::Instant::now();
    for (done, (k, case)) in own.iter().copied().enumerate() {
        anstream::eprintln!("case {} of {}{} ..", k + 1, cases.len(), left(begun, done, own.len()));
        let mut contestant = Processes::new(&program, folder, k + 1, args.commission).map_err(CliError::not_stored)?;
        if args.broken {
            let how = BROKEN[k % BROKEN.len()];
            broken.push((how.name(), ask_broken(case, how, &mut contestant)));
            continue;
        }
        let misfit = sealed.join(format!("case-{:02}", k + 1)).join("misfit.json");
        results.push(held(case, &mut contestant, &misfit, args.with_experiment).and_then(|trial| {
            if args.criteria {
                tallies.ask(case, trial.score.outcome, &contestant)?;
            }
            Ok(trial)
        }));
        asked.push(case.clone());
        if let (ChallengeFormat::Text, Some(result)) = (args.format, results.last()) {
            super::print(&report::line(k + 1, case, result))?;
        }
    }
    let opened =
        std::fs::read_to_string(sealed.join("truth.json")).map_err(|e| CliError::not_stored(format!("{}: {e}", sealed.display())))?;
    if !seal.holds(&opened) {
        return Err(CliError { code: exit::INTERNAL, message: format!("{}: the seal is broken, so nothing is scored", sealed.display()) });
    }
    if args.broken {
        super::print(&match args.format {
            ChallengeFormat::Json => report::broken_json(seed, &seal.sha256, &broken),
            ChallengeFormat::Text | ChallengeFormat::Markdown => report::broken_text(&broken, args.format == ChallengeFormat::Markdown),
        })?;
        return Ok(exit::DONE);
    }
    if args.criteria {
        let (usual, rows) = tallies.rows();
        super::print(&thresholds::markdown(results.iter().flatten().count(), usual, rows))?;
        results.iter().filter_map(|r| r.as_ref().err()).for_each(|words| super::note(words));
        return Ok(if results.iter().any(Result::is_err) { exit::NEGATIVE } else { exit::DONE });
    }
    super::print(&match args.format {
        ChallengeFormat::Text => report::text(&results),
        ChallengeFormat::Markdown => report::markdown(seed, &seal.sha256, &results),
        ChallengeFormat::Json => report::json(seed, &seal.sha256, &asked, &results),
    })?;
    Ok(if results.iter().any(Result::is_err) { exit::NEGATIVE } else { exit::DONE })
}

/// Holds a trial, or takes one that was held before from its files: the answers, and the misfit beside them.
fn held(case: &Case, contestant: &mut Processes, misfit: &Path, experiment: bool) -> report::Outcome {
    let before = || {
        let kept: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(misfit).ok()?).ok()?;
        let bar = |key: &str| kept[key].as_f64();
        let as_answered = Misfit { base_bar: bar("base")?, augmented_bar: bar("augmented")?, floor_bar: bar("floor")? };
        let mut trial = Trial::new(case, contestant.answered(DIAGNOSIS).ok()?, as_answered);
        if let Some(augmented_bar) = bar("augmented_after") {
            let after = Trial::new(case, contestant.answered(DIAGNOSIS_2).ok()?, Misfit { augmented_bar, ..as_answered });
            trial.after = Some(Box::new(after));
        }
        let as_asked = kept["version"] == env!("CARGO_PKG_VERSION") && kept["experiment"].as_bool().unwrap_or(false) == experiment;
        as_asked.then_some(trial)
    };
    if let Some(trial) = before() {
        return Ok(trial);
    }
    let trial = hold_trial(case, contestant, experiment)?;
    let m = trial.misfit;
    let kept = json!({
        "version": env!("CARGO_PKG_VERSION"), "base": m.base_bar, "augmented": m.augmented_bar, "floor": m.floor_bar,
        "experiment": experiment, "augmented_after": trial.after.as_ref().map(|t| t.misfit.augmented_bar),
    });
    write_text(misfit, &format!("{kept:#}\n")).map_err(|e| e.to_string())?;
    Ok(trial)
}

/// What is said of a recording that does not belong to the model; the words of the refusal where it is refused.
fn ask_broken(case: &Case, how: Broken, contestant: &mut Processes) -> Result<crate::challenge::Answer, String> {
    let session = break_record(case, how);
    let model = contestant.identify(&session.sweep, session.commission.as_ref())?;
    contestant.diagnose(&session.record, None, &model).map(|(answer, _)| answer)
}

/// A seed that nobody chose: the digits of the clock.
fn fresh_seed() -> u64 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    now.map_or(1, |d| u64::from(d.subsec_nanos()) / 100)
}
