//! The command line: one file per subcommand, each with its arguments and its `run`.
//!
//! Data goes to stdout, progress and messages to stderr. The exit codes are part of the contract with scripts
//! and CI: see [`exit`].

mod accept;
mod answers;
mod batch;
mod batch_args;
mod batch_bench;
mod batch_diff;
mod batch_emulated;
mod batch_error;
mod batch_folder;
mod batch_open;
mod batch_prompt;
mod challenge;
mod challenge_contestant;
mod challenge_criteria;
mod challenge_fleet;
mod challenge_set;
mod check;
mod clock;
mod collect;
mod compare;
mod completions;
mod control_page;
mod diagnose;
mod diagnose_args;
mod diagnose_foreign;
mod diff;
mod diff_format;
mod emulate;
mod error;
mod explain;
mod export;
mod files;
mod foreign_base;
mod good_data;
mod history;
mod identify;
mod init;
mod input;
mod inspect;
mod jobs;
mod last_word;
mod lock;
mod man;
mod manners;
mod margins;
mod master;
mod metrics_page;
mod msa;
mod narrow;
mod next_plan;
mod on_wire;
mod outputs;
mod paper;
mod paper_search;
mod print;
mod probe;
mod progress;
mod reading;
mod report;
mod run;
#[cfg(all(unix, feature = "fmi"))]
mod run_fmu;
mod run_folder;
mod schema;
mod seat;
mod shard;
mod simulate;
mod station;
mod tune;
mod valves;

use clap::{CommandFactory, Parser, Subcommand};

pub use error::{CliError, CliResult, exit};
pub use manners::say;
pub use print::{note, print, to_json};

/// Hardware-in-the-loop acceptance tests for electro-hydraulic clutch valves.
#[derive(Debug, Parser)]
#[command(name = "hil", version, max_term_width = 100)]
struct Cli {
    /// Colours on the terminal
    #[arg(long, global = true, value_name = "WHEN", default_value = "auto", help_heading = "Output")]
    color: clap::ColorChoice,
    /// Say nothing beside the result: no progress, no hints; warnings and errors are said
    #[arg(short, long, global = true, help_heading = "Output")]
    quiet: bool,
    /// Say more: which files were taken, and how long it took
    #[arg(short, long, global = true, conflicts_with = "quiet", help_heading = "Output")]
    verbose: bool,
    #[command(subcommand)]
    command: Command,
    /// Let plans read files outside of their projects (the nearest folder up with `hil.toml` or `.git`, else the plan's own).
    #[arg(long, global = true, hide_short_help = true)]
    allow_outside: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Conceal an effect in fresh data, diagnose it blind, open the seal, score.
    #[command(
        after_help = "Examples:\n  hil challenge\n  hil challenge --seed 7 --count 20\n  hil challenge --seed 7 --count 64 --format markdown > table.md\n  hil challenge --seed 7 --out kept/\n\nThe digest of the sealed truth is printed before anything is diagnosed."
    )]
    Challenge(challenge::ChallengeArgs),
    /// Lay a project to go on from: plan, valve, driver, limits, files for CI.
    #[command(
        after_help = "Examples:\n  hil init\n  hil init acceptance --example ci\n  hil init workshop --example diagnosis\n\nNothing is replaced. Without a project, too: hil run tipin --sim"
    )]
    Init(init::InitArgs),
    /// Run a test plan and report its verdict.
    #[command(
        after_help = "Examples:\n  hil run tipin --sim\n  hil run tipin --sim --valve clutch-1 --set high=\"26 bar\" --format markdown\n  hil run tipin --driver emulator --port /tmp/valve --watch\n\nExit codes: 0 PASS or MARGINAL, 1 FAIL, 3 wrong input, 4 rig error, 5 aborted, 6 INVALID, 7 not stored"
    )]
    Run(run::RunArgs),
    /// Check plans, valves, driver profiles and limits without a rig.
    #[command(after_help = "Examples:\n  hil check plans/*.toml valves/*.toml drivers/*.toml")]
    Check(check::CheckArgs),
    /// Margins of stability of the pressure loop.
    #[command(
        after_help = "Examples:\n  hil margins --gain 0.04 --lag 0.01 --delay 0.04 --kp 1 --ki 5\n  hil margins --model paper --kp \"1 mA/bar\" --ki \"5 mA/(bar s)\" --delay-range \"10 ms..40 ms\" --format json"
    )]
    Margins(margins::MarginsArgs),
    /// Propose gains that hold a largest sensitivity over the whole delay range.
    #[command(after_help = "Examples:\n  hil tune --model paper\n  hil tune --model paper --max-sensitivity 1.6 --plan gain-comparison")]
    Tune(tune::TuneArgs),
    /// Put a simulated valve behind an emulated driver, on a pseudo terminal or on TCP.
    #[command(
        after_help = "Examples:\n  hil emulate --valve paper --driver emulator --pty /tmp/valve\n  hil emulate --valve paper --driver emulator-tcp --tcp 127.0.0.1:1502 --fault late.toml\n\nThen, in another terminal:\n  hil run tipin --driver emulator --port /tmp/valve"
    )]
    Emulate(emulate::EmulateArgs),
    /// Look at a driver: identity, readings, round-trip times, the highest loop rate.
    #[command(
        after_help = "Examples:\n  hil probe --driver emulator --port /tmp/valve\n  hil probe --driver beckhoff-kl2535 --tcp 192.168.0.10:502"
    )]
    Probe(probe::ProbeArgs),
    /// Look at a log: its channels, runs and gaps, and the mapping to read it with.
    #[command(
        after_help = "Examples:\n  hil inspect log.csv\n  hil inspect log.mf4 -o log.map.toml\n\nThen: hil identify log.mf4 --mapping log.map.toml -o valve.toml"
    )]
    Inspect(inspect::InspectArgs),
    /// Identify a valve model from a recording.
    #[command(
        after_help = "Examples:\n  hil identify sweep.csv -o valve.toml\n  hil identify log.csv --map current_a=\"I_cmd [mA]\" -o valve.toml"
    )]
    Identify(identify::IdentifyArgs),
    /// Replay a recorded current through a model, run by run.
    #[command(
        after_help = "Examples:\n  hil simulate drive.csv --model valve.toml -o simulated.csv\n  hil simulate log.mf4 --model paper --map current_a=\"I_cmd [mA]\" -o simulated.mf4\n\nThe RMSE against the measured pressure is printed for the model and for the average model."
    )]
    Simulate(simulate::SimulateArgs),
    /// Say where a simulation and a recording differ, what physics is missing, and how sure that is.
    ///
    /// Example: hil diagnose drive.csv --model valve.toml -o augmented.toml --report diagnosis.html
    Diagnose(diagnose_args::DiagnoseArgs),
    /// Put the rows of many diagnoses into one table and one page: which lot, which effect, since when.
    #[command(
        after_help = "Examples:\n  hil diagnose --jobs fleet/jobs.csv --out answers\n  hil collect answers -o fleet.parquet --report fleet.html\n  hil collect answers -o fleet.parquet --fail-on new-finding"
    )]
    Collect(collect::CollectArgs),
    /// Show an old record again, in any format.
    #[command(
        after_help = "Examples:\n  hil report reports/runs/tipin-paper-1\n  hil report reports/tipin/record.json --format html -o tipin.html\n  hil report reports/runs/batch-tipin-1 --format markdown"
    )]
    Report(report::ReportArgs),
    /// Compare two records, or two folders of records: verdicts first, then figures beyond tolerance.
    #[command(
        after_help = "Examples:\n  hil diff reports/tipin reports/runs/tipin\n  hil diff reports reports/runs --format markdown > diff.md\n  hil diff A B --tolerance rmse=\"5 mbar\"\n\nExit code 1 when anything differs beyond tolerance."
    )]
    Diff(diff::DiffArgs),
    /// Draw records, recordings and models over each other, on one page.
    #[command(
        after_help = "Examples:\n  hil compare drive.csv valve.toml augmented.toml\n  hil compare reports/runs/a reports/runs/b -o ab.html\n  hil compare paper clutch-1 clutch-2\n\nThe others are compared with the first; models see the first current."
    )]
    Compare(compare::CompareArgs),
    /// Run a plan on a batch of valves: every attempt kept, statistics and a page at the end.
    #[command(
        after_help = "Examples:\n  hil batch tipin --count 100 --sim\n  hil batch tipin --count 10000 --sim --population population --out reports/runs/big\n  hil batch tipin --duts lot.csv --sim --station station.toml --limits part.toml\n  hil batch tipin --count 10000 --sim --out reports/runs/big --resume"
    )]
    Batch(Box<batch_args::BatchArgs>),
    /// Serve the page of a test station: operators test valves, engineers watch.
    #[command(
        after_help = "Examples:\n  hil station emulated\n  hil station bench.toml --listen 0.0.0.0:8080 --token-file /etc/hil/token --viewer-token\n\nOpen the printed address in a browser. Ctrl-C stops what runs, makes it safe, stores it."
    )]
    Station(station::StationArgs),
    /// Ask the records of many batches: by serial number, lot, metric, time.
    #[command(
        after_help = "Examples:\n  hil history --serial SIM-000017\n  hil history reports/runs --lot L7 --metric tip-in/rmse\n  hil history --outcome FAIL --since 2026-11-21"
    )]
    History(history::HistoryArgs),
    /// Gauge R&R: how much of the spread is the measuring system's own.
    #[command(
        after_help = "Examples:\n  hil msa readings.csv --tolerance \"0.6 bar\"\n  hil msa tipin --sim --metric tip-in/steady_offset\n  hil msa tipin --driver emulator --tcp localhost:1502 --metric tip-in/rmse --tolerance \"0.5 bar\"\n\nExit code 1 where the verdict is `unacceptable`."
    )]
    Msa(Box<msa::MsaArgs>),
    /// Check a master valve, whose verdict is known, and so open the gate of production.
    #[command(after_help = "Example:\n  hil master tipin --station station.toml --serial MASTER-1 --driver emulator --tcp localhost:1502")]
    Master(Box<master::MasterArgs>),
    /// Make a record the accepted one of its plan, under reports/.
    #[command(after_help = "Example:\n  hil accept reports/runs/tipin")]
    Accept(accept::AcceptArgs),
    /// Put every number of the paper beside ours; docs/paper.md is what this prints.
    #[command(after_help = "Example:\n  hil paper > docs/paper.md")]
    Paper(paper::PaperArgs),
    /// Hand a batch or a model to other tools, in their formats.
    #[command(
        after_help = "Examples:\n  hil export valve.toml -o valve.fmu\n  hil export paper -o paper.fmu --fmi 3 --step \"1 ms\"\n  hil export paper -o paper.json\n  hil export reports/runs/lot-7 -o lot.dfq\n\nThe ending of the output decides."
    )]
    Export(export::ExportArgs),
    /// The child process of a foreign FMU: its task on stdin, the pressures on stdout.
    #[cfg(all(unix, feature = "fmi"))]
    #[command(hide = true)]
    RunFmu,
    /// Explain a metric, an effect, a margin, or a key of a plan or of a valve file.
    #[command(after_help = "Examples:\n  hil explain\n  hil explain settling_time\n  hil explain \"gain margin\"")]
    Explain(explain::ExplainArgs),
    /// Print the JSON Schema of a kind of file, for editors.
    #[command(after_help = "Example:\n  hil schema valve > valve.schema.json")]
    Schema(schema::SchemaArgs),
    /// Write the man pages, and without a folder also the completions, where this user's shell looks for them.
    #[command(after_help = "Examples:\n  hil man\n  hil man target/man")]
    Man(man::ManArgs),
    /// Print a completion script for a shell.
    #[command(after_help = "Example:\n  hil completions bash > ~/.local/share/bash-completion/completions/hil")]
    Completions(completions::CompletionsArgs),
}

/// Runs the program; a panic, which is a bug, ends it with [`exit::INTERNAL`] and says so. The last word has the safe state.
pub fn guarded(program: impl FnOnce() -> u8 + std::panic::UnwindSafe) -> u8 {
    let code = std::panic::catch_unwind(program).unwrap_or_else(|_| {
        note("error: this is a bug in hil; the message above says where. Please report it with the command line and its files.");
        exit::INTERNAL
    });
    last_word::say(code)
}

/// Runs the command line and returns the exit code.
pub fn main() -> u8 {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            let code = if error.use_stderr() { exit::USAGE } else { exit::DONE };
            match error::not_a_number(&error) {
                Some(text) => note(&format!("error: {text}\n\nFor more information, try '--help'.")),
                None => drop(error.print()),
            }
            return code;
        }
    };
    if cli.allow_outside {
        crate::plan::allow_anywhere();
    }
    manners::set(cli.color, cli.quiet, cli.verbose);
    let started = std::time::Instant::now();
    let result: CliResult = match cli.command {
        Command::Challenge(args) => challenge::run(&args),
        Command::Init(args) => init::run(&args),
        Command::Run(args) => run::run(&args),
        Command::Check(args) => check::run(&args),
        Command::Margins(args) => margins::run(&args),
        Command::Tune(args) => tune::run(&args),
        Command::Emulate(args) => emulate::run(&args),
        Command::Probe(args) => probe::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Identify(args) => identify::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        Command::Diagnose(args) => diagnose::run(&args),
        Command::Collect(args) => collect::run(&args),
        Command::Report(args) => report::run(&args),
        Command::Diff(args) => diff::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Batch(args) => batch::run(&args),
        Command::Station(args) => station::run(&args),
        Command::History(args) => history::run(&args),
        Command::Msa(args) => msa::run(&args),
        Command::Master(args) => master::run(&args),
        Command::Accept(args) => accept::run(&args),
        Command::Paper(args) => paper::run(&args),
        Command::Export(args) => export::run(&args),
        #[cfg(all(unix, feature = "fmi"))]
        Command::RunFmu => run_fmu::run(),
        Command::Explain(args) => explain::run(&args),
        Command::Schema(args) => schema::run(&args),
        Command::Man(args) => man::run(&args, Cli::command()),
        Command::Completions(args) => completions::run(&args, &mut Cli::command()),
    };
    manners::detail(|| format!("took {:.2} s", started.elapsed().as_secs_f64()));
    result.unwrap_or_else(|error| {
        note(&format!("error: {}", error::plain(&error.message)));
        error.code
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_internal_error() {
        assert_eq!(guarded(|| exit::NEGATIVE), exit::NEGATIVE);
        assert_eq!(guarded(|| panic!("on purpose")), exit::INTERNAL);
    }
}
