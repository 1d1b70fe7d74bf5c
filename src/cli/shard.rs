//! `--shard I/N`: one part of many, so that engines can divide the work without talking to each other.

use std::str::FromStr;

/// Part `index` (from 1) of `of`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// Which part, from 1.
    pub index: usize,
    /// Of how many.
    pub of: usize,
}

impl Shard {
    /// Whether the item at place `k` (from 0) belongs to this part: every `of`-th, so that long lists spread evenly.
    pub fn holds(self, k: usize) -> bool {
        k % self.of == self.index - 1
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is no part I/N with 1 <= I <= N, such as 3/8");
        let (index, of) = text.split_once('/').ok_or_else(wrong)?;
        let (index, of) = (index.trim().parse::<usize>().map_err(|_| wrong())?, of.trim().parse::<usize>().map_err(|_| wrong())?);
        if (1..=of).contains(&index) { Ok(Self { index, of }) } else { Err(wrong()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_hold_everything_once() {
        for of in 1..6 {
            for k in 0..20 {
                assert_eq!((1..=of).filter(|index| Shard { index: *index, of }.holds(k)).count(), 1);
            }
        }
    }

    #[test]
    fn a_part_that_is_none_is_refused() {
        assert_eq!("3/8".parse(), Ok(Shard { index: 3, of: 8 }));
        for wrong in ["0/4", "5/4", "1", "a/b", "1/0", "-1/2"] {
            assert!(wrong.parse::<Shard>().is_err_and(|e| e.contains("I/N")), "{wrong}");
        }
    }
}
