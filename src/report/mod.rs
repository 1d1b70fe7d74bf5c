//! Pure functions of a record: text, JSON, Markdown, JUnit, HTML. They format; they compute nothing.

mod page;
pub mod plot;

pub use page::page;
