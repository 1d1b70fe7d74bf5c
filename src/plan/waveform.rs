//! A checked stimulus: pieces, one after the other.

use std::f64::consts::PI;
use std::ops::Range;

use super::LevelKind;

/// One piece of a waveform.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Piece {
    /// A straight line; a hold where both ends are equal.
    Line {
        /// Level at the start.
        from: f64,
        /// Level at the end.
        to: f64,
        /// Duration [s].
        duration_s: f64,
    },
    /// A sine, or a chirp whose frequency changes linearly.
    Sine {
        /// Mean level.
        mean: f64,
        /// Amplitude.
        amplitude: f64,
        /// Frequency at the start and at the end [Hz].
        frequency_hz: (f64, f64),
        /// Duration [s].
        duration_s: f64,
    },
}

impl Piece {
    /// Duration [s].
    pub fn duration_s(&self) -> f64 {
        match self {
            Self::Line { duration_s, .. } | Self::Sine { duration_s, .. } => *duration_s,
        }
    }

    fn at(&self, t: f64) -> f64 {
        match *self {
            Self::Line { from, to, duration_s } => {
                if duration_s > 0.0 {
                    from + (to - from) * (t / duration_s).clamp(0.0, 1.0)
                } else {
                    to
                }
            }
            Self::Sine { mean, amplitude, frequency_hz: (first, last), duration_s } => {
                let turns = first * t + 0.5 * (last - first) * t * t / duration_s;
                mean + amplitude * (2.0 * PI * turns).sin()
            }
        }
    }
}

/// A level with its place in the plan's text, for the check against a valve.
pub type PlacedLevel = (f64, Range<usize>);

/// A stimulus as a function of the time.
#[derive(Debug, Clone, PartialEq)]
pub struct Waveform {
    kind: LevelKind,
    pieces: Vec<Piece>,
    /// End of each piece [s].
    ends_s: Vec<f64>,
    levels: Vec<PlacedLevel>,
}

impl Waveform {
    /// A waveform from its pieces; `levels` are its extremes with their places.
    pub(super) fn new(kind: LevelKind, pieces: Vec<Piece>, levels: Vec<PlacedLevel>) -> Self {
        let mut end = 0.0;
        let ends_s = pieces
            .iter()
            .map(|p| {
                end += p.duration_s();
                end
            })
            .collect();
        Self { kind, pieces, ends_s, levels }
    }

    /// Nothing is commanded.
    pub(super) fn none() -> Self {
        Self::new(LevelKind::Current, vec![Piece::Line { from: 0.0, to: 0.0, duration_s: 0.0 }], Vec::new())
    }

    /// What it commands.
    pub fn kind(&self) -> LevelKind {
        self.kind
    }

    /// Its pieces.
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Its duration [s].
    pub fn duration_s(&self) -> f64 {
        self.ends_s.last().copied().unwrap_or(0.0)
    }

    /// The level at `t` seconds after the start, in bar or A; beyond the end the last one. At a jump the new level.
    pub fn at(&self, t: f64) -> f64 {
        // A sampling instant that falls on a boundary up to rounding belongs to the later piece.
        let index = self.ends_s.partition_point(|end| *end <= t + 1e-9).min(self.pieces.len() - 1);
        let start = if index == 0 { 0.0 } else { self.ends_s[index - 1] };
        self.pieces[index].at((t - start).clamp(0.0, self.pieces[index].duration_s()))
    }

    /// Smallest and largest level.
    pub fn range(&self) -> (f64, f64) {
        let fold = |f: fn(f64, f64) -> f64, start| self.levels.iter().map(|l| l.0).fold(start, f);
        (fold(f64::min, f64::INFINITY), fold(f64::max, f64::NEG_INFINITY))
    }

    /// The first level outside `low..=high`, with its place in the plan's text.
    pub(super) fn outside(&self, low: f64, high: f64) -> Option<&PlacedLevel> {
        self.levels.iter().find(|l| !(low..=high).contains(&l.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(from: f64, to: f64, duration_s: f64) -> Piece {
        Piece::Line { from, to, duration_s }
    }

    #[test]
    fn pieces_follow_one_another() {
        let waveform =
            Waveform::new(LevelKind::Pressure, vec![line(2.0, 2.0, 1.0), line(10.0, 20.0, 2.0)], vec![(2.0, 0..0), (20.0, 0..0)]);
        assert_eq!((waveform.at(0.0), waveform.at(0.99)), (2.0, 2.0));
        assert!((waveform.at(1.0) - 10.0).abs() < 1e-6, "the new level at a jump");
        assert!((waveform.at(2.0) - 15.0).abs() < 1e-6);
        assert_eq!((waveform.at(99.0), waveform.duration_s(), waveform.range()), (20.0, 3.0, (2.0, 20.0)));
        assert_eq!(waveform.outside(0.0, 15.0), Some(&(20.0, 0..0)));
    }

    #[test]
    fn a_chirp_ends_at_its_last_frequency() {
        let chirp = Piece::Sine { mean: 0.0, amplitude: 1.0, frequency_hz: (1.0, 3.0), duration_s: 10.0 };
        // 10 s at a mean of 2 Hz: twenty turns.
        assert!(chirp.at(10.0).abs() < 1e-9);
        assert!((chirp.at(0.25) - (2.0 * PI * (0.25 + 0.1 * 0.0625)).sin()).abs() < 1e-12);
    }
}
