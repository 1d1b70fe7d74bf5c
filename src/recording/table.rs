//! Named columns, as a file of any format holds them.

/// A column of a table.
#[derive(Debug, Clone, Copy)]
pub struct Column<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its values; every column of a table has equally many.
    pub values: Values<'a>,
}

/// The values of a [`Column`].
#[derive(Debug, Clone, Copy)]
pub enum Values<'a> {
    /// Numbers; NaN is a gap.
    Numbers(&'a [f64]),
    /// As many gaps.
    Absent(usize),
    /// Whole numbers.
    Integers(&'a [i64]),
    /// Texts.
    Texts(&'a [&'a str]),
    /// One text in that many rows.
    Same(&'a str, usize),
}

impl Values<'_> {
    /// Number of rows.
    pub fn len(&self) -> usize {
        match self {
            Self::Numbers(v) => v.len(),
            Self::Integers(v) => v.len(),
            Self::Texts(v) => v.len(),
            Self::Absent(n) | Self::Same(_, n) => *n,
        }
    }
    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// All cells of a column.
#[derive(Debug, Clone, PartialEq)]
pub enum Cells {
    /// Numbers; NaN is a gap.
    Numbers(Vec<f64>),
    /// Time stamps as seconds since the first.
    Stamps(Vec<f64>),
    /// Texts; a gap is empty.
    Texts(Vec<String>),
}
