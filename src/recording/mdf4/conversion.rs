//! From raw to physical values: the conversions of a channel that give numbers.
//!
//! # Source
//! ASAM MDF 4.1, "Channel conversion block".

use std::io::{Read, Seek};

use super::block::Blocks;
use crate::recording::mapping;

/// Conversions may refer to others, this many times.
const DEPTH_LIMIT: usize = 8;

/// A conversion.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Conversion {
    Identity,
    /// `offset + factor * raw`.
    Linear {
        offset: f64,
        factor: f64,
    },
    /// `(p1 x^2 + p2 x + p3) / (p4 x^2 + p5 x + p6)`.
    Rational([f64; 6]),
    /// Pairs of raw and physical value; between them a straight line, or the nearer pair.
    Table {
        pairs: Vec<(f64, f64)>,
        interpolate: bool,
    },
    /// Ranges of raw values, each with one physical value; the value of all others.
    Ranges(Vec<(f64, f64, f64)>, f64),
    /// Raw values (lower and upper) that stand for a text and hold no number; another conversion for the rest.
    Texts(Vec<(f64, f64, Conversion)>, Box<Conversion>),
    /// A text: no number.
    Gap,
}

impl Conversion {
    /// Reads the conversion at `address`; 0 is the identity.
    pub fn read<F: Read + Seek>(blocks: &mut Blocks<F>, address: u64, depth: usize) -> Result<Self, String> {
        if address == 0 {
            return Ok(Self::Identity);
        }
        if depth > DEPTH_LIMIT {
            return Err("its conversions refer to one another without end".into());
        }
        let block = blocks.block(address, &[b"##CC"])?;
        let kind = block.u8(0);
        let values: Vec<f64> = (0..usize::from(block.u16(6))).map(|k| block.f64(24 + 8 * k)).collect();
        let value = |k: usize| values.get(k).copied().unwrap_or(0.0);
        let pair = |v: &[f64]| (v[0], v[1]);
        Ok(match kind {
            0 => Self::Identity,
            1 => Self::Linear { offset: value(0), factor: value(1) },
            2 => Self::Rational(std::array::from_fn(value)),
            3 => {
                let text = blocks.text(block.link(4))?;
                let (factor, offset) =
                    mapping::line(&text).ok_or_else(|| format!("its conversion is the formula `{text}`; only straight lines are read"))?;
                Self::Linear { offset, factor }
            }
            4 | 5 => {
                let pairs: Vec<_> = values.chunks_exact(2).map(pair).collect();
                if pairs.is_empty() || pairs.windows(2).any(|w| w[0].0.partial_cmp(&w[1].0) != Some(std::cmp::Ordering::Less)) {
                    return Err("the table of its conversion is not in order".into());
                }
                Self::Table { pairs, interpolate: kind == 4 }
            }
            6 => Self::Ranges(values.chunks_exact(3).map(|v| (v[0], v[1], v[2])).collect(), value(values.len() / 3 * 3)),
            7 | 8 => {
                let keys: Vec<_> =
                    if kind == 7 { values.iter().map(|v| (*v, *v)).collect() } else { values.chunks_exact(2).map(pair).collect() };
                let of_link = |blocks: &mut Blocks<F>, link: u64| match link {
                    0 => Ok(Self::Gap),
                    _ if blocks.header(link)?.id == *b"##CC" => Self::read(blocks, link, depth + 1),
                    _ => Ok(Self::Gap),
                };
                let mut texts = Vec::with_capacity(keys.len());
                for (at, (low, high)) in keys.iter().enumerate() {
                    texts.push((*low, *high, of_link(blocks, block.link(4 + at))?));
                }
                let rest = of_link(blocks, block.link(4 + keys.len()))?;
                if rest == Self::Gap && texts.iter().all(|t| t.2 == Self::Gap) {
                    return Err("its values are texts; numbers are wanted".into());
                }
                Self::Texts(texts, Box::new(rest))
            }
            _ => return Err("its values are texts; numbers are wanted".into()),
        })
    }

    /// The physical value of `raw`; NaN where it has none.
    pub fn apply(&self, raw: f64) -> f64 {
        match self {
            Self::Identity => raw,
            Self::Linear { offset, factor } => offset + factor * raw,
            Self::Rational([a, b, c, d, e, f]) => (a * raw * raw + b * raw + c) / (d * raw * raw + e * raw + f),
            Self::Table { pairs, interpolate } => {
                let after = pairs.partition_point(|p| p.0 < raw);
                let (low, high) = (pairs[after.saturating_sub(1)], pairs[after.min(pairs.len() - 1)]);
                let share = if high.0 > low.0 { (raw - low.0) / (high.0 - low.0) } else { 0.0 };
                match interpolate {
                    _ if raw.is_nan() => f64::NAN,
                    true => low.1 + share * (high.1 - low.1),
                    false if share <= 0.5 => low.1,
                    false => high.1,
                }
            }
            Self::Ranges(ranges, other) => ranges.iter().find(|r| r.0 <= raw && raw <= r.1).map_or(*other, |r| r.2),
            Self::Texts(texts, rest) => texts.iter().find(|t| t.0 <= raw && raw <= t.1).map_or(&**rest, |t| &t.2).apply(raw),
            Self::Gap => f64::NAN,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        assert_eq!(Conversion::Linear { offset: -1.0, factor: 0.5 }.apply(4.0), 1.0);
        assert_eq!(Conversion::Rational([0.0, 2.0, 1.0, 0.0, 0.0, 4.0]).apply(3.5), 2.0);
        let table = |interpolate| Conversion::Table { pairs: vec![(0.0, 10.0), (4.0, 20.0)], interpolate };
        let at = |interpolate| [-1.0, 0.0, 1.0, 3.0, 4.0, 9.0].map(|raw| table(interpolate).apply(raw));
        assert_eq!(at(true), [10.0, 10.0, 12.5, 17.5, 20.0, 20.0]);
        assert_eq!(at(false), [10.0, 10.0, 10.0, 20.0, 20.0, 20.0]);
        let ranges = Conversion::Ranges(vec![(0.0, 1.0, 7.0), (2.0, 3.0, 8.0)], -1.0);
        assert_eq!([0.5, 2.0, 5.0].map(|raw| ranges.apply(raw)), [7.0, 8.0, -1.0]);
        let partial = Conversion::Texts(vec![(255.0, 255.0, Conversion::Gap)], Box::new(Conversion::Linear { offset: 0.0, factor: 0.1 }));
        assert!(partial.apply(255.0).is_nan() && partial.apply(50.0) == 5.0);
    }
}
