//! A foreign file as its reader finds it: columns with names, units and values that nobody has made sense of yet.

/// A column as the file holds it, with all its values.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RawColumn {
    /// Channel group of an MDF file; empty elsewhere.
    pub group: String,
    /// Name as in the file.
    pub header: String,
    /// Unit that the file gives apart from the name.
    pub unit: Option<String>,
    pub content: Content,
}

/// What the cells of a column are.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// Numbers; NaN is a gap.
    Numbers(Vec<f64>),
    /// Time stamps as seconds since the first, which stands beside them.
    Stamps(Vec<f64>, String),
    /// Dates; the first.
    Dates(String),
    /// Texts: how many different ones, and the first of them.
    Texts(Vec<String>),
    /// Nothing.
    Empty,
}

/// A file as its reader finds it.
#[derive(Debug, Clone, Default)]
pub(super) struct Table {
    pub columns: Vec<RawColumn>,
    /// Line of the header, of a text.
    pub header_row: Option<usize>,
    pub notes: Vec<String>,
}
