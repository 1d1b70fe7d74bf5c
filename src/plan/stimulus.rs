//! Stimuli as a plan writes them, and their way to a [`Waveform`].

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;

use super::error::Wrong;
use super::level::LevelRate;
use super::waveform::PlacedLevel;
use super::{Level, LevelKind, Piece, Waveform};
use crate::units::{Frequency, Time};

/// What a phase commands. A level in bar closes the loop, one in A opens it; the two do not mix in one phase.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum StimulusFile {
    /// One level.
    Hold {
        /// The level.
        #[schemars(with = "Level")]
        at: Spanned<Level>,
        /// How long.
        #[serde(rename = "for")]
        #[schemars(with = "Time")]
        duration: Spanned<Time>,
    },
    /// A straight line.
    Ramp {
        /// Start; where the stimulus before ended if it is not given.
        #[schemars(with = "Option<Level>")]
        from: Option<Spanned<Level>>,
        /// End.
        #[schemars(with = "Level")]
        to: Spanned<Level>,
        /// Duration; this or `rate`.
        #[schemars(with = "Option<Time>")]
        over: Option<Spanned<Time>>,
        /// Rate; this or `over`.
        #[schemars(with = "Option<LevelRate>")]
        rate: Option<Spanned<LevelRate>>,
    },
    /// A jump.
    Step {
        /// Level before the jump.
        #[schemars(with = "Level")]
        from: Spanned<Level>,
        /// Level after it.
        #[schemars(with = "Level")]
        to: Spanned<Level>,
        /// Time before the jump; 1 s by default.
        #[schemars(with = "Option<Time>")]
        before: Option<Spanned<Time>>,
        /// Time after the jump.
        #[schemars(with = "Time")]
        hold: Spanned<Time>,
    },
    /// Up and down in straight lines; with `last_low` or `last_high` the turning points move evenly from cycle to cycle.
    Triangle {
        /// Lower turning point, where it starts and ends.
        #[schemars(with = "Level")]
        low: Spanned<Level>,
        /// Upper turning point.
        #[schemars(with = "Level")]
        high: Spanned<Level>,
        /// Duration of one cycle.
        #[schemars(with = "Time")]
        period: Spanned<Time>,
        /// Number of cycles; 1 by default.
        #[schemars(with = "Option<u32>")]
        cycles: Option<Spanned<u32>>,
        /// Lower turning point after the last cycle.
        #[schemars(with = "Option<Level>")]
        last_low: Option<Spanned<Level>>,
        /// Upper turning point of the last cycle.
        #[schemars(with = "Option<Level>")]
        last_high: Option<Spanned<Level>>,
    },
    /// A sine, or with `to_frequency` a chirp.
    Sine {
        /// Mean level.
        #[schemars(with = "Level")]
        mean: Spanned<Level>,
        /// Amplitude.
        #[schemars(with = "Level")]
        amplitude: Spanned<Level>,
        /// Frequency, of a chirp at its start.
        #[schemars(with = "Frequency")]
        frequency: Spanned<Frequency>,
        /// Frequency at the end of a chirp.
        #[schemars(with = "Option<Frequency>")]
        to_frequency: Option<Spanned<Frequency>>,
        /// How long.
        #[serde(rename = "for")]
        #[schemars(with = "Time")]
        duration: Spanned<Time>,
    },
    /// Straight lines between points.
    Points(
        /// Pairs of time and level, the times increasing from 0 s.
        #[schemars(with = "Vec<(Time, Level)>")]
        Vec<Spanned<(Time, Spanned<Level>)>>,
    ),
    /// Straight lines between the rows of a CSV with `time_s` and either `target_bar` or `current_a`.
    Table {
        /// Path, relative to the plan.
        #[schemars(with = "String")]
        file: Spanned<String>,
    },
    /// Stimuli one after the other.
    Sequence(
        /// At least one.
        #[schemars(with = "Vec<StimulusFile>")]
        Vec<Spanned<StimulusFile>>,
    ),
}

/// Longest single piece [s].
const MAX_DURATION_S: f64 = 7.0 * 24.0 * 3600.0;

/// A waveform in the making.
struct Builder<'a> {
    folder: &'a Path,
    kind: Option<LevelKind>,
    pieces: Vec<Piece>,
    levels: Vec<PlacedLevel>,
    /// Where the last piece, or the phase before, ended.
    last: Option<Level>,
}

/// The waveform of `stimulus`; `before` is where the phase before ended.
pub(super) fn waveform(stimulus: &Spanned<StimulusFile>, before: Option<Level>, folder: &Path) -> Result<Waveform, Wrong> {
    let mut builder = Builder { folder, kind: None, pieces: Vec::new(), levels: Vec::new(), last: before };
    builder.add(stimulus)?;
    match builder.kind {
        Some(kind) if !builder.pieces.is_empty() => Ok(Waveform::new(kind, builder.pieces, builder.levels)),
        _ => Err(Wrong::new(stimulus.span(), "the stimulus is empty")),
    }
}

impl Builder<'_> {
    fn add(&mut self, stimulus: &Spanned<StimulusFile>) -> Result<(), Wrong> {
        match stimulus.get_ref() {
            StimulusFile::Hold { at, duration } => {
                let level = self.level(at)?;
                self.line(level, level, positive(duration)?);
            }
            StimulusFile::Ramp { from, to, over, rate } => self.ramp(stimulus.span(), from.as_ref(), to, over.as_ref(), rate.as_ref())?,
            StimulusFile::Step { from, to, before, hold } => {
                let (first, last) = (self.level(from)?, self.level(to)?);
                let before_s = before.as_ref().map_or(Ok(1.0), positive)?;
                self.line(first, first, before_s);
                self.line(last, last, positive(hold)?);
            }
            StimulusFile::Triangle { low, high, period, cycles, last_low, last_high } => {
                let count = cycles.as_ref().map_or(1, |c| *c.get_ref());
                if count == 0 || count > 100_000 {
                    return Err(Wrong::new(
                        cycles.as_ref().map_or(stimulus.span(), Spanned::span),
                        format!("{count} cycles; 1 to 100000 are allowed"),
                    ));
                }
                if low.get_ref().value >= high.get_ref().value {
                    return Err(Wrong::new(low.span(), format!("`low` ({}) must lie below `high` ({})", low.get_ref(), high.get_ref())));
                }
                let half = 0.5 * positive(period)?;
                let (first_low, first_high) = (self.level(low)?, self.level(high)?);
                let end_low = last_low.as_ref().map_or(Ok(first_low), |l| self.level(l))?;
                let end_high = last_high.as_ref().map_or(Ok(first_high), |l| self.level(l))?;
                let part = |i: u32, of: u32| if of == 0 { 0.0 } else { f64::from(i) / f64::from(of) };
                for cycle in 0..count {
                    let from = first_low + (end_low - first_low) * part(cycle, count);
                    let peak = first_high + (end_high - first_high) * part(cycle, count - 1);
                    let to = first_low + (end_low - first_low) * part(cycle + 1, count);
                    self.line(from, peak, half);
                    self.line(peak, to, half);
                }
            }
            StimulusFile::Sine { mean, amplitude, frequency, to_frequency, duration } => {
                let middle = self.level(mean)?;
                let size = self.kind_of(amplitude)?;
                let hertz = |f: &Spanned<Frequency>| match f.get_ref().value() {
                    v if v > 0.0 => Ok(v),
                    v => Err(Wrong::new(f.span(), format!("a frequency of {v} Hz; it must be positive"))),
                };
                let first = hertz(frequency)?;
                let last = to_frequency.as_ref().map_or(Ok(first), hertz)?;
                let duration_s = positive(duration)?;
                self.levels.push((middle + size.abs(), amplitude.span()));
                self.levels.push((middle - size.abs(), amplitude.span()));
                self.pieces.push(Piece::Sine { mean: middle, amplitude: size, frequency_hz: (first, last), duration_s });
                let turns = 0.5 * (first + last) * duration_s;
                self.end(middle + size * (2.0 * std::f64::consts::PI * turns).sin());
            }
            StimulusFile::Points(points) => self.points(stimulus.span(), points)?,
            StimulusFile::Table { file } => self.table(file)?,
            StimulusFile::Sequence(parts) => {
                if parts.is_empty() {
                    return Err(Wrong::new(stimulus.span(), "the sequence is empty"));
                }
                for part in parts {
                    self.add(part)?;
                }
            }
        }
        Ok(())
    }

    fn ramp(
        &mut self,
        span: std::ops::Range<usize>,
        from: Option<&Spanned<Level>>,
        to: &Spanned<Level>,
        over: Option<&Spanned<Time>>,
        rate: Option<&Spanned<LevelRate>>,
    ) -> Result<(), Wrong> {
        let last = self.level(to)?;
        let first = match (from, self.last) {
            (Some(from), _) => self.level(from)?,
            (None, Some(before)) if before.kind == to.get_ref().kind => before.value,
            (None, _) => return Err(Wrong::new(span, "nothing of the same kind came before, so the ramp needs `from`")),
        };
        let duration_s = match (over, rate) {
            (Some(over), None) => positive(over)?,
            (None, Some(rate)) => {
                if rate.get_ref().kind != to.get_ref().kind {
                    let wanted = if to.get_ref().kind == LevelKind::Pressure { "bar/s" } else { "A/s" };
                    return Err(Wrong::new(
                        rate.span(),
                        format!("`{}` is not the rate of `{}`; a rate in {wanted} is wanted", rate.get_ref(), to.get_ref()),
                    ));
                }
                if rate.get_ref().value <= 0.0 {
                    return Err(Wrong::new(rate.span(), format!("`{}` must be positive; the direction follows from `to`", rate.get_ref())));
                }
                (last - first).abs() / rate.get_ref().value
            }
            _ => return Err(Wrong::new(span, "a ramp needs either `over` (a time) or `rate`, not both")),
        };
        if duration_s > MAX_DURATION_S {
            return Err(Wrong::new(span, format!("the ramp would take {duration_s:.0} s; at most {MAX_DURATION_S} s are allowed")));
        }
        self.line(first, last, duration_s);
        Ok(())
    }

    fn points(&mut self, span: std::ops::Range<usize>, points: &[Spanned<(Time, Spanned<Level>)>]) -> Result<(), Wrong> {
        if points.len() < 2 {
            return Err(Wrong::new(span, "two points at least are wanted"));
        }
        let mut before: Option<(f64, f64)> = None;
        for point in points {
            let (time, level) = point.get_ref();
            let value = self.level(level)?;
            match before {
                None if time.value() != 0.0 => {
                    return Err(Wrong::new(point.span(), format!("the first point is at {time}; it must be at 0 s")));
                }
                Some((at, _)) if time.value() < at => {
                    return Err(Wrong::new(point.span(), format!("{time} is before the point at {at} s")));
                }
                Some((at, from)) => self.line(from, value, time.value() - at),
                None => {}
            }
            before = Some((time.value(), value));
        }
        match before {
            Some((end, _)) if end > 0.0 && end <= MAX_DURATION_S => Ok(()),
            _ => Err(Wrong::new(span, format!("the points must span more than 0 s and at most {MAX_DURATION_S} s"))),
        }
    }

    fn table(&mut self, file: &Spanned<String>) -> Result<(), Wrong> {
        let path = self.folder.join(file.get_ref());
        let wrong = |problem: String| Wrong::new(file.span(), format!("{}: {problem}", path.display()));
        super::territory::check(self.folder, file.get_ref(), &path).map_err(|problem| Wrong::new(file.span(), problem))?;
        let (kind, rows) = super::stimulus_table::read(&path).map_err(wrong)?;
        self.same_kind(kind, file.span())?;
        for pair in rows.windows(2) {
            self.line(pair[0].1, pair[1].1, pair[1].0 - pair[0].0);
        }
        self.levels.extend(rows.iter().map(|row| (row.1, file.span())));
        Ok(())
    }

    fn line(&mut self, from: f64, to: f64, duration_s: f64) {
        if duration_s > 0.0 {
            self.pieces.push(Piece::Line { from, to, duration_s });
        }
        self.end(to);
    }

    fn end(&mut self, value: f64) {
        self.last = self.kind.map(|kind| Level { kind, value });
    }

    /// The value of a level that the waveform reaches.
    fn level(&mut self, level: &Spanned<Level>) -> Result<f64, Wrong> {
        let value = self.kind_of(level)?;
        self.levels.push((value, level.span()));
        Ok(value)
    }

    /// The value of a level of the waveform's kind.
    fn kind_of(&mut self, level: &Spanned<Level>) -> Result<f64, Wrong> {
        self.same_kind(level.get_ref().kind, level.span())?;
        Ok(level.get_ref().value)
    }

    fn same_kind(&mut self, kind: LevelKind, span: std::ops::Range<usize>) -> Result<(), Wrong> {
        if *self.kind.get_or_insert(kind) == kind {
            return Ok(());
        }
        let name = |k: LevelKind| k.unit().dimension;
        let other = self.kind.map_or("", name);
        Err(Wrong::new(span, format!("a {} in a phase that began with a {other}; one phase commands one of the two", name(kind))))
    }
}

/// A duration above zero [s].
fn positive(time: &Spanned<Time>) -> Result<f64, Wrong> {
    match time.get_ref().value() {
        v if v > 0.0 && v <= MAX_DURATION_S => Ok(v),
        _ => Err(Wrong::new(time.span(), format!("`{}` must be more than 0 s and at most {MAX_DURATION_S} s", time.get_ref()))),
    }
}
