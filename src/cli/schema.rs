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

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Kind {
    Plan,
    Valve,
    Driver,
    Limits,
    Station,
    Population,
}

/// Prints the schema.
pub fn run(args: &SchemaArgs) -> CliResult {
    let schema = match args.kind {
        Kind::Plan => schemars::schema_for!(crate::plan::PlanFile),
        Kind::Limits => schemars::schema_for!(crate::plan::LimitsFile),
        Kind::Valve => schemars::schema_for!(crate::valve::ValveFile),
        Kind::Station => schemars::schema_for!(crate::batch::station::Station),
        Kind::Population => schemars::schema_for!(crate::batch::population::Population),
        Kind::Driver => schemars::schema_for!(crate::rig::profile::ProfileFile),
    };
    let text = serde_json::to_string_pretty(&schema).map_err(|e| CliError { code: exit::INTERNAL, message: e.to_string() })?;
    super::print(&(text + "\n"))?;
    Ok(exit::DONE)
}
