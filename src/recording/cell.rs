//! A cell of a text: a number, a gap, a time stamp, or none of these.

/// A cell without surrounding space and quotes.
pub(super) fn bare(cell: &[u8]) -> &[u8] {
    let cell = cell.trim_ascii();
    match cell {
        [b'"', inner @ .., b'"'] => inner.trim_ascii(),
        _ => cell,
    }
}

/// What a cell of a number holds.
pub(super) enum Cell {
    Number(f64),
    /// A number with a decimal comma.
    CommaNumber(f64),
    Gap,
    Infinite,
    Other,
}

pub(super) fn number(cell: &[u8]) -> Cell {
    let Ok(text) = std::str::from_utf8(cell) else { return Cell::Other };
    // `parse` also takes "nan", "inf" and "infinity" in any case.
    if let Ok(value) = text.parse::<f64>() {
        return match value {
            v if v.is_finite() => Cell::Number(v),
            v if v.is_nan() => Cell::Gap,
            _ => Cell::Infinite,
        };
    }
    if text.is_empty() || ["na", "n/a", "#n/a", "null", "none", "-", "--"].iter().any(|gap| text.eq_ignore_ascii_case(gap)) {
        return Cell::Gap;
    }
    if text.bytes().filter(|b| *b == b',').count() == 1
        && !text.contains('.')
        && let Ok(value) = text.replace(',', ".").parse::<f64>()
    {
        return if value.is_finite() { Cell::CommaNumber(value) } else { Cell::Infinite };
    }
    Cell::Other
}

/// Digits behind the decimal point.
pub(super) fn decimals(cell: &[u8]) -> usize {
    let cell = bare(cell);
    cell.iter().rposition(|b| matches!(b, b'.' | b',')).map_or(0, |at| cell.len() - at - 1)
}

/// The start of a cell, for a message.
pub(super) fn shown(cell: &[u8]) -> String {
    let text = String::from_utf8_lossy(cell);
    let short: String = text.chars().take(40).collect();
    if short.len() < text.len() { format!("{short}...") } else { short }
}
