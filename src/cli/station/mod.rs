//! `hil station`: the station in a browser.

mod args;
mod asking;
mod diagnosing;
mod floor;
mod product;
mod seats;
mod session;
mod shelf;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

pub use self::args::StationArgs;
use self::floor::Floor;
use super::batch_error::failed;
use super::run::stop_on_signals;
use super::{CliError, CliResult, exit, files};
use crate::batch::station::Station;
use crate::document;
use crate::station::{self as page, Access, StationError, Token};

/// Serves until a signal ends it. What runs then is stopped, made safe and stored.
pub fn run(args: &StationArgs) -> CliResult {
    let path = files::station(&args.station)?;
    let station = Station::load(&path).map_err(failed)?;
    let operator = match &args.token_file {
        Some(file) => token_in(file)?,
        None => Token::random(),
    };
    let viewer = match (&args.viewer_token, &args.viewer_token_file) {
        (Some(text), _) if text.is_empty() => Some(Token::random()),
        (Some(text), _) => Some(Token::chosen(text, "--viewer-token").map_err(refused)?),
        (None, Some(file)) => Some(token_in(file)?),
        (None, None) => None,
    };
    if viewer.as_ref().is_some_and(|v| v.text() == operator.text()) {
        return Err(CliError::usage("the token of the viewers is that of those who may act"));
    }
    let floor = Floor::open(args, path, station)?;
    let (listener, address) = page::listen(&args.listen).map_err(refused)?;
    let stop = stop_on_signals()?;
    let access = Access::new(operator.clone(), viewer.clone(), address, &args.hosts);
    let conduct: Arc<dyn page::Conduct> = floor.clone();
    let server = page::serve(listener, floor.hub(), conduct, access).map_err(refused)?;
    let shown = if address.ip().is_unspecified() { format!("localhost:{}", address.port()) } else { address.to_string() };
    // The token stands behind the `#`, which a browser sends to nobody.
    super::print(&format!("station `{}`: http://{shown}/#{}\n", floor.id(), operator.text()))?;
    if let Some(viewer) = &viewer {
        super::print(&format!("viewers: http://{shown}/#{}\n", viewer.text()))?;
    }
    super::say(&format!("records in {}", floor.store().display()));
    if !address.ip().is_loopback() {
        super::note("warning: reached from the network without encryption: put a reverse proxy with TLS before it (docs/station.md)");
    }
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(50));
    }
    let interrupted = floor.shut();
    drop(server);
    Ok(if interrupted { exit::ABORTED } else { exit::DONE })
}

/// The token that a file holds; only its owner may be able to read it.
fn token_in(file: &Path) -> Result<Token, CliError> {
    let text = document::read(file).map_err(CliError::input)?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(file).map_or(0, |m| m.permissions().mode());
        if mode & 0o077 != 0 {
            return Err(CliError::input(format!("{}: others can read this token; chmod 600", file.display())));
        }
    }
    Token::chosen(&text, &file.display().to_string()).map_err(CliError::input)
}

fn refused(error: StationError) -> CliError {
    match error {
        StationError::Listen { .. } => CliError::rig(error),
        StationError::Token { .. } => CliError::usage(error),
    }
}
