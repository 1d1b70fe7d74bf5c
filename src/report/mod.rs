//! Pure functions of a record: text, JSON, Markdown, JUnit, HTML. They format; they compute nothing.

pub mod batch;
pub mod challenge;
pub mod compare;
pub mod diagnosis;
pub mod diff;
pub mod fleet;
pub mod format;
mod html;
pub mod identify;
mod json;
mod junit;
mod markdown;
mod page;
pub mod plot;
mod sharpened;
mod text;
pub mod thresholds;

pub use html::{badge, html};
pub use json::{json, without_provenance};
pub use junit::junit;
pub use markdown::markdown;
pub use page::page;
pub use text::{COLUMNS, fold, text};

#[cfg(test)]
pub(crate) mod tests;
