//! Text in a cell of a CSV file that no spreadsheet takes for a formula.

use std::borrow::Cow;

/// What begins a formula in the usual spreadsheets; a tab or a line end before it is skipped by some.
const FORMULA: [char; 6] = ['=', '+', '-', '@', '\t', '\r'];

/// The text as it is, or behind an apostrophe where a spreadsheet would run it. [`original`] is the way back.
pub fn inert(text: &str) -> Cow<'_, str> {
    let begins = |t: &str| t.starts_with(FORMULA);
    // An apostrophe that stands before such a sign already gets a second one, so that the way back is unique.
    if begins(text) || text.trim_start_matches('\'').len() < text.len() && begins(text.trim_start_matches('\'')) {
        Cow::Owned(format!("'{text}"))
    } else {
        Cow::Borrowed(text)
    }
}

/// The text that [`inert`] was given.
pub fn original(cell: &str) -> &str {
    match cell.strip_prefix('\'') {
        Some(rest) if rest.trim_start_matches('\'').starts_with(FORMULA) => rest,
        _ => cell,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_formula_does_not_begin_a_cell() {
        for formula in ["=cmd|' /C calc'!A0", "+1", "-2+3", "@SUM(A1)", "\t=1", "\r=1"] {
            assert!(inert(formula).starts_with('\''), "{formula:?}");
        }
        for plain in ["V-1", "", "a=b", "'quoted'", "0815"] {
            assert_eq!(inert(plain), plain);
        }
    }

    proptest! {
        #[test]
        fn the_way_back_is_unique(text in "['=+@a\t-]{0,6}|.*") {
            let cell = inert(&text);
            prop_assert_eq!(original(&cell), text.as_str());
            prop_assert!(!cell.starts_with(FORMULA));
        }
    }
}
