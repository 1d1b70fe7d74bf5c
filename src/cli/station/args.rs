//! The arguments of `hil station`.

use std::path::PathBuf;

use clap::Args;

/// Arguments of `hil station`.
#[derive(Debug, Args)]
pub struct StationArgs {
    /// Station file, or the bare name of one that ships with the program (`emulated`).
    pub station: PathBuf,
    /// Where the page is served; port 0 takes a free one.
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:8080", value_parser = super::super::on_wire::host_port)]
    pub listen: String,
    /// Folder for the records; by default the `store` of the station file.
    #[arg(long, value_name = "DIR")]
    pub store: Option<PathBuf>,
    /// File with the token of those who may act; a new one is printed at every start without it.
    #[arg(long, value_name = "FILE", help_heading = "Access")]
    pub token_file: Option<PathBuf>,
    /// Let viewers in, who may not act, with this token; without a value a new one is printed.
    #[arg(long, value_name = "TOKEN", num_args = 0..=1, default_missing_value = "", conflicts_with = "viewer_token_file", help_heading = "Access")]
    pub viewer_token: Option<String>,
    /// File with the token of the viewers.
    #[arg(long, value_name = "FILE", help_heading = "Access")]
    pub viewer_token_file: Option<PathBuf>,
    /// A further name that the page is reached by, as a reverse proxy passes it on.
    #[arg(long = "host", value_name = "NAME[:PORT]", help_heading = "Access")]
    pub hosts: Vec<String>,
    /// Test although a calibration has run out; the reason goes into the records.
    #[arg(long, value_name = "REASON")]
    pub override_calibration: Option<String>,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}
