//! The `hil` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(hil::cli::guarded(hil::cli::main))
}
