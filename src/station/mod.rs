//! The station in a browser: what the page shows, who may see it and who may act, and the server.
//!
//! The room tests nothing itself. Whoever tests tells the [`Hub`] what happens, and carries out what the page asks for behind the
//! trait [`Conduct`]. Samples come through the bounded ring of a run (`runner::glances`), so that no browser can hold a loop up.

mod access;
mod app;
mod board;
mod conduct;
mod error;
mod events;
mod frame;
mod headers;
mod hub;
mod page;
mod request;
mod serve;

pub use access::{Access, Role, Token};
pub use board::{
    BatchCard, Board, Light, LogLine, PhaseCard, ProductCard, PromptCard, RunCard, SafeCard, SiteCard, StationCard, VerdictCard,
};
pub use conduct::{Accepted, Conduct, Diagnose, Entry, Given, Refused};
pub use error::StationError;
pub use hub::Hub;
pub use serve::{Server, listen, serve};
