//! `hil init`: lays a project that a person can go on from.

mod recordings;

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::{CliError, CliResult, exit, schema};
use crate::recording::replace_file;
use crate::shipped;

/// Arguments of `hil init`.
#[derive(Debug, Args)]
pub struct InitArgs {
    /// Folder of the project; it is made where it is not there
    #[arg(default_value = ".")]
    dir: PathBuf,
    /// Lays one kind of project; without it, bench and CI together
    #[arg(long, value_enum)]
    example: Option<Example>,
}

/// The kinds of project.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Example {
    /// A plan, a valve, a driver profile and a station
    Bench,
    /// A plan and a valve that GitHub and GitLab run in simulation, with what moved as a comment
    Ci,
    /// Recordings of a valve before and after it changed, to identify and diagnose
    Diagnosis,
}

/// A file of the project: its place and its bytes.
type File = (&'static str, Vec<u8>);

/// Writes the files, none over another, and says what to do next.
pub fn run(args: &InitArgs) -> CliResult {
    let files = files(args.example)?;
    if args.dir.symlink_metadata().is_ok() && !args.dir.is_dir() {
        return Err(CliError::usage(format!("{}: is a file, and a folder is wanted; name one that is empty or new", args.dir.display())));
    }
    let there: Vec<&str> = files.iter().map(|f| f.0).filter(|f| args.dir.join(f).symlink_metadata().is_ok()).collect();
    if !there.is_empty() {
        return Err(CliError::usage(format!(
            "{}: {} {} already there, and nothing is replaced; name a folder that is empty or new",
            args.dir.display(),
            there.join(", "),
            if there.len() == 1 { "is" } else { "are" }
        )));
    }
    for (place, bytes) in &files {
        write(&args.dir.join(place), bytes)?;
    }
    let mut said = String::new();
    for (place, _) in &files {
        said += &format!("wrote {}\n", args.dir.join(place).display());
    }
    said += "\nNext:\n";
    if args.dir != Path::new(".") {
        said += &format!("  cd {}\n", args.dir.display());
    }
    for line in next(args.example) {
        said += &format!("  {line}\n");
    }
    super::print(&said)?;
    Ok(exit::DONE)
}

/// The commands that a person goes on with.
fn next(example: Option<Example>) -> &'static [&'static str] {
    match example {
        Some(Example::Diagnosis) => &[
            "hil inspect recordings/logger.csv -o recordings/logger.map.toml",
            "hil identify recordings/sweep.csv -o valves/valve.toml --report identify.html",
            "hil diagnose recordings/logger.csv --mapping recordings/logger.map.toml --model valve -o valves/augmented.toml --report diagnosis.html",
            "hil run acceptance --sim --valve augmented",
        ],
        Some(Example::Bench) => &[
            "hil check",
            "hil run acceptance --sim",
            "hil emulate --valve valve --driver driver --pty /tmp/valve     # in another terminal",
            "hil run acceptance --driver driver --port /tmp/valve --watch",
        ],
        _ => &[
            "hil check",
            "hil run acceptance --sim --out reports/runs/first",
            "hil accept reports/runs/first     # the report that changes are compared with",
        ],
    }
}

fn files(example: Option<Example>) -> Result<Vec<File>, CliError> {
    let shipped = |place: &str| shipped::text(Path::new(&format!("{}{place}", shipped::PREFIX))).unwrap_or_default();
    // An editor with the TOML language server reads the schema that the first line names.
    let with_schema = |kind: &str, text: &str| format!("#:schema ../.hil/{kind}.schema.json\n{text}");
    let renamed = |text: &str, from: &str, to: &str| text.replacen(&format!("name = \"{from}\""), &format!("name = \"{to}\""), 1);
    let paper = shipped("valves/paper.toml");
    let valve = paper.split_once('\n').map_or(paper, |(_, rest)| rest);
    let valve = format!(
        "# The valve of the paper, to begin with: `hil identify sweep.csv -o valves/valve.toml` writes the model of yours.\n{}",
        renamed(valve, "paper", "valve")
    );
    let mut files: Vec<(&str, String)> = vec![
        ("hil.toml", format!("#:schema .hil/project.schema.json\n{}", include_str!("templates/project.toml"))),
        (".gitignore", include_str!("templates/gitignore").into()),
        ("plans/acceptance.toml", with_schema("plan", &renamed(shipped("plans/tipin.toml"), "tipin", "acceptance"))),
        ("limits/part.toml", with_schema("limits", include_str!("templates/limits.toml"))),
        (".hil/project.schema.json", schema::text(schema::Kind::Project)?),
        (".hil/plan.schema.json", schema::text(schema::Kind::Plan)?),
        (".hil/valve.schema.json", schema::text(schema::Kind::Valve)?),
        (".hil/limits.schema.json", schema::text(schema::Kind::Limits)?),
    ];
    if example == Some(Example::Diagnosis) {
        // `identify` writes the valve, and never over a file that a person wrote.
        // There is no valve yet: until it is identified, `--sim` simulates the paper's.
        files[0].1 = files[0].1.replacen("\nvalve = ", "\n# valve = ", 1);
        files.push(("valves/.gitkeep", String::new()));
        let mut files = bytes(files);
        files.extend([("recordings/sweep.csv", recordings::sweep()?.into_bytes()), ("recordings/logger.csv", recordings::logger()?)]);
        return Ok(files);
    }
    files.push(("valves/valve.toml", with_schema("valve", &valve)));
    if example != Some(Example::Ci) {
        files.push(("drivers/driver.toml", with_schema("driver", shipped("drivers/emulator.toml"))));
        files.push((".hil/driver.schema.json", schema::text(schema::Kind::Driver)?));
    }
    if example == Some(Example::Bench) {
        files.push(("station.toml", format!("#:schema .hil/station.schema.json\n{}", shipped("examples/batch/station.toml"))));
        files.push((".hil/station.schema.json", schema::text(schema::Kind::Station)?));
    } else {
        files.push(("ci/check.sh", include_str!("templates/check.sh").into()));
        files.push((".github/workflows/hil.yml", include_str!("templates/github.yml").into()));
        files.push((".gitlab-ci.yml", include_str!("templates/gitlab.yml").into()));
    }
    Ok(bytes(files))
}

fn bytes(files: Vec<(&'static str, String)>) -> Vec<File> {
    files.into_iter().map(|(place, text)| (place, text.into_bytes())).collect()
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(|e| CliError::not_stored(format!("{}: {e}", folder.display())))?;
    }
    replace_file(path, |file| file.write_all(bytes)).map_err(CliError::not_stored)
}
