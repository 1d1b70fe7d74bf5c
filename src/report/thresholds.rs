//! What the thresholds of a diagnosis are worth, as a table.

use std::fmt::Write as _;

use crate::challenge::Outcome;

/// What became of the valves of a series.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    /// All that is concealed is named first.
    pub named: usize,
    /// A wrong name, also beside what no effect of the library is.
    pub wrong: usize,
    /// Healthy valves accused.
    pub accused: usize,
}

impl Tally {
    /// Counts one more.
    pub fn add(&mut self, outcome: Outcome) {
        self.named += usize::from(outcome == Outcome::Named);
        self.wrong += usize::from(outcome == Outcome::Wrong);
        self.accused += usize::from(outcome == Outcome::FalseAlarm);
    }

    fn text(self) -> String {
        format!("{}, {}, {}", self.named, self.wrong, self.accused)
    }
}

/// A threshold with what it is worth at other values.
#[derive(Debug, Clone, PartialEq)]
pub struct Threshold {
    /// Its name.
    pub name: String,
    /// Its usual value.
    pub value: f64,
    /// Below and above: the value, what became of the valves, and of how many it became something else.
    pub beside: [(f64, Tally, usize); 2],
}

/// A value without the digits that say nothing.
fn short(value: f64) -> f64 {
    (1e4 * value).round() / 1e4
}

/// The table, in Markdown: the most telling threshold first.
pub fn markdown(valves: usize, usual: Tally, mut thresholds: Vec<Threshold>) -> String {
    thresholds.sort_by_key(|t| std::cmp::Reverse(t.beside[0].2 + t.beside[1].2));
    let mut text = format!(
        "{valves} valves; by the usual thresholds named first, wrong, healthy accused: {}. A cell: the value, the same three, and in brackets of how many valves the outcome is another one.\n\n| threshold | usual | below | above |\n|---|---|---|---|\n",
        usual.text()
    );
    for t in thresholds {
        let [below, above] = t.beside.map(|(value, tally, moved)| match moved {
            0 => format!("{}: as usual", short(value)),
            _ => format!("{}: {} ({moved})", short(value), tally.text()),
        });
        let _ = writeln!(text, "| `{}` | {} | {below} | {above} |", t.name, t.value);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_threshold_that_moves_most_stands_first_and_one_without_effect_says_so() {
        let mut some = Tally::default();
        [Outcome::Named, Outcome::Wrong, Outcome::FalseAlarm, Outcome::Silent, Outcome::Named].into_iter().for_each(|o| some.add(o));
        let row = |name: &str, moved: usize| Threshold { name: name.into(), value: 2.0, beside: [(1.0, some, moved), (4.0, some, 0)] };
        insta::assert_snapshot!(markdown(5, some, vec![row("idle", 0), row("telling", 3)]), @r"
        5 valves; by the usual thresholds named first, wrong, healthy accused: 2, 1, 1. A cell: the value, the same three, and in brackets of how many valves the outcome is another one.

        | threshold | usual | below | above |
        |---|---|---|---|
        | `telling` | 2 | 1: 2, 1, 1 (3) | 4: as usual |
        | `idle` | 2 | 1: as usual | 4: as usual |
        ");
    }
}
