//! The `hil` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    // A panic is a bug; its message is already on stderr.
    ExitCode::from(std::panic::catch_unwind(hil::cli::main).unwrap_or(hil::cli::exit::INTERNAL))
}
