//! `hil schema`: the JSON Schema of a kind of file, for editors that complete and check while typing.

use clap::{Args, ValueEnum};

use super::{CliError, CliResult, exit};

/// Which kind of file.
#[derive(Debug, Args)]
pub struct SchemaArgs {
    /// The kind of file
    #[arg(value_enum)]
    kind: Kind,
}

/// The kinds of file that have a schema.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Kind {
    /// A test plan
    Plan,
    /// A valve model
    Valve,
    /// A driver profile
    Driver,
    /// Limits of a part
    Limits,
    /// A station
    Station,
    /// Answers to the questions of a plan
    Answers,
    /// A simulated population
    Population,
    /// A project
    Project,
}

/// Prints the schema.
pub fn run(args: &SchemaArgs) -> CliResult {
    super::print(&text(args.kind)?)?;
    Ok(exit::DONE)
}

/// The schema of a kind of file.
pub fn text(kind: Kind) -> Result<String, CliError> {
    let schema = match kind {
        Kind::Plan => schemars::schema_for!(crate::plan::PlanFile),
        Kind::Limits => schemars::schema_for!(crate::plan::LimitsFile),
        Kind::Valve => schemars::schema_for!(crate::valve::ValveFile),
        Kind::Station => schemars::schema_for!(crate::batch::station::Station),
        Kind::Answers => schemars::schema_for!(super::answers::AnswersFile),
        Kind::Population => schemars::schema_for!(crate::batch::population::Population),
        Kind::Driver => schemars::schema_for!(crate::rig::profile::ProfileFile),
        Kind::Project => schemars::schema_for!(super::files::ProjectFile),
    };
    super::to_json(&schema)
}
