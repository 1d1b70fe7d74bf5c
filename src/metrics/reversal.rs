//! What a small change of the current does: after a turn, after a standstill, in a small loop.
//!
//! The current of one dead time and one lag of the valve model earlier belongs to a pressure, as for the sweeps. From where
//! the pressure has moved by `change` and by three times that, a straight line is carried back to no movement: a valve
//! that follows at once has 0, whatever `change` is.

use serde::{Deserialize, Serialize};

use super::passes::{Point, paired, smoothed, stretches};
use super::{Metric, Needs, NotMeasurable, Segment, milliseconds};
use crate::units::{self, Current, Pressure, Unit};

/// Dead band: by how much the current changes after a turn before the pressure follows, mean over the turns of the phase.
///
/// A phase of slow small triangles about a working point measures it. With `rated` it is a share of the rated current.
///
/// # Source
/// ISA-51.1, dead band: the range through which the input may be varied, upon reversal of direction, without an observable
/// change of the output. Data sheets of valves call it reversal span, or threshold in ISO 10770-1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DeadBand {
    /// Movement of the pressure that counts as seen; 100 mbar where it is not given.
    #[serde(default = "visible")]
    pub change: Pressure,
    /// Rated current, of which the figure is then a share.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rated: Option<Current>,
}

/// Threshold, or resolution: by how much the current changes after a standstill, in the direction that it had before, until the
/// pressure follows; mean over the standstills of the phase. With `rated` it is a share of the rated current.
///
/// # Source
/// IEC 61298-2 and ISA-51.1, resolution and threshold; response sensitivity in data sheets of valves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Threshold {
    /// Movement of the pressure that counts as seen; 100 mbar where it is not given.
    #[serde(default = "visible")]
    pub change: Pressure,
    /// Rated current, of which the figure is then a share.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rated: Option<Current>,
}

/// Reversal error: the difference of pressure between the ways down and up, in the middle of small triangles about a working point.
///
/// # Source
/// VDI/VDE 2600, reversal error: one value of the input, reached from below and from above.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReversalError {}

fn visible() -> Pressure {
    Pressure::new(0.1)
}

impl Default for DeadBand {
    fn default() -> Self {
        Self { change: visible(), rated: None }
    }
}

impl Default for Threshold {
    fn default() -> Self {
        Self { change: visible(), rated: None }
    }
}

/// Samples of a standstill that its pressure is taken from, at most.
const STANDING: usize = 200;

/// Change of the current along `moving` until the pressure has moved by `change` from `from_bar`, carried back to no movement.
fn lost(moving: &[Point], from_bar: f64, change: f64) -> Option<f64> {
    let (first, last) = (moving.first()?, moving.last()?);
    let rising = last.0 > first.0;
    let (low, high) = if rising { (first.0, last.0) } else { (last.0, first.0) };
    const STEPS: usize = 200;
    let grid: Vec<f64> = (0..=STEPS).map(|k| low + (high - low) * k as f64 / STEPS as f64).collect();
    let (mut curve, _) = smoothed(moving, rising, &grid, 0.03 * (high - low));
    if !rising {
        curve.reverse();
    }
    let turned = if rising { 1.0 } else { -1.0 };
    let moved: Vec<f64> = curve.iter().map(|p| turned * (p - from_bar)).collect();
    let at = |wanted: f64| {
        let k = moved.iter().position(|m| *m >= wanted)?;
        if k == 0 {
            return Some(0.0);
        }
        let part = (wanted - moved[k - 1]) / (moved[k] - moved[k - 1]);
        Some((high - low) / STEPS as f64 * ((k - 1) as f64 + part))
    };
    let (one, three) = (at(change)?, at(3.0 * change)?);
    Some((one - 0.5 * (three - one)).max(0.0))
}

/// Pressure at the end of a stretch, by a straight line through its last samples.
fn end_bar(stretch: &[Point]) -> f64 {
    let tail = &stretch[stretch.len() - (stretch.len() / 20).clamp(1, stretch.len())..];
    let last = tail[tail.len() - 1].0;
    let (x, y): (Vec<f64>, Vec<f64>) = tail.iter().map(|p| (p.0 - last, p.1)).unzip();
    let (_, offset) = super::line::least_squares(&x, &y);
    if offset.is_finite() { offset } else { y.iter().sum::<f64>() / y.len() as f64 }
}

fn mean_of(found: &[f64], wanted: &'static str) -> Result<f64, NotMeasurable> {
    if found.is_empty() { Err(NotMeasurable::NoSuchMove { wanted }) } else { Ok(found.iter().sum::<f64>() / found.len() as f64) }
}

fn definition(id: &str, segment: &Segment<'_>, change: Pressure, rated: Option<Current>) -> String {
    let rated = rated.map_or_else(String::new, |r| format!(", rated={r}"));
    format!("{id}(change={change}, delay={}, lag={}{rated})", milliseconds(segment.delay_s), milliseconds(segment.lag_s))
}

fn check(change: Pressure, rated: Option<Current>) -> Result<(), String> {
    super::positive("change", change.value(), &change)?;
    rated.map_or(Ok(()), |r| super::positive("rated", r.value(), &r))
}

impl Metric for DeadBand {
    fn id(&self) -> &'static str {
        "dead_band"
    }
    fn unit(&self) -> &'static Unit {
        if self.rated.is_some() { &units::RATIO } else { &units::CURRENT }
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        definition("dead_band.turns.v1", segment, self.change, self.rated)
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let points = paired(segment)?;
        let stretches = stretches(&points);
        let turns = stretches.windows(2).filter_map(|w| lost(w[1].1, end_bar(w[0].1), self.change.value()));
        let found = mean_of(&turns.collect::<Vec<_>>(), "turns and then moves the pressure")?;
        Ok(found / self.rated.map_or(1.0, Current::value))
    }
    fn check(&self) -> Result<(), String> {
        check(self.change, self.rated)
    }
}

impl Metric for Threshold {
    fn id(&self) -> &'static str {
        "threshold"
    }
    fn unit(&self) -> &'static Unit {
        if self.rated.is_some() { &units::RATIO } else { &units::CURRENT }
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        definition("threshold.after_standstill.v1", segment, self.change, self.rated)
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let points = paired(segment)?;
        let mut found = Vec::new();
        for (_, stretch) in stretches(&points) {
            // Inside a stretch, which begins with a movement, a run of equal currents and what comes after it.
            let mut k = 1;
            while k < stretch.len() {
                let begin = k - 1;
                while k < stretch.len() && stretch[k].0 == stretch[begin].0 {
                    k += 1;
                }
                let standing = k - begin;
                if standing >= 10 && k + 10 < stretch.len() {
                    let rest = &stretch[begin + standing / 2..k];
                    let rest = &rest[rest.len().saturating_sub(STANDING)..];
                    let mean = rest.iter().map(|p| p.1).sum::<f64>() / rest.len() as f64;
                    let end = (k..stretch.len()).find(|j| stretch[*j].0 == stretch[*j - 1].0).unwrap_or(stretch.len());
                    found.extend(lost(&stretch[k - 1..end], mean, self.change.value()));
                }
                k += 1;
            }
        }
        Ok(mean_of(&found, "rests and then goes on in the same direction")? / self.rated.map_or(1.0, Current::value))
    }
    fn check(&self) -> Result<(), String> {
        check(self.change, self.rated)
    }
}

impl Metric for ReversalError {
    fn id(&self) -> &'static str {
        "reversal_error"
    }
    fn unit(&self) -> &'static Unit {
        &units::PRESSURE
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        super::loop_width::definition("reversal_error.middle.v1", segment, None)
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let found = super::loop_width::both_ways(segment)?;
        let (up, down) = (found.curve(true), found.curve(false));
        let middle = up.len() / 2;
        Ok(down[middle] - up[middle])
    }
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Columns, scatter};
    use super::*;

    /// A play of `band` between the current and 40 bar/A.
    fn play(band: f64, current: impl Fn(f64) -> f64, noise: f64, samples: usize) -> Columns {
        let mut held = current(0.0) - 0.5 * band;
        let pressures: Vec<f64> = (0..samples)
            .map(|k| {
                let t = k as f64 * 0.01;
                held = held.clamp(current(t) - band, current(t));
                40.0 * held + noise * scatter(t)
            })
            .collect();
        Columns::new(samples, |_| f64::NAN, &current, |t| pressures[(t * 100.0).round() as usize])
    }

    /// Triangles of 20 mA about 0.5 A, 20 s each.
    fn small(t: f64) -> f64 {
        let phase = (t / 20.0).fract();
        0.48 + 0.04 * if phase < 0.5 { 2.0 * phase } else { 2.0 - 2.0 * phase }
    }

    #[test]
    fn a_play_has_its_band_and_its_reversal_error_whatever_the_noise() {
        for noise in [0.0, 0.02, 0.05] {
            for band in [0.002, 0.01] {
                let columns = play(band, small, noise, 8001);
                let found = DeadBand::default().compute(&columns.segment(0.0)).unwrap();
                assert!((found - band).abs() < 3e-4 + 8e-3 * noise, "{band} with {noise}: {found}");
                let error = ReversalError {}.compute(&columns.segment(0.0)).unwrap();
                assert!((error - 40.0 * band).abs() < 1e-6 + noise, "{band} with {noise}: {error}");
            }
        }
        let share = DeadBand { rated: Some(Current::new(1.0)), ..DeadBand::default() };
        assert_eq!(share.unit().symbol, "1");
    }

    #[test]
    fn a_valve_that_follows_at_once_has_no_dead_band() {
        let columns = Columns::new(8001, |_| f64::NAN, small, |t| 40.0 * small(t));
        assert!(DeadBand::default().compute(&columns.segment(0.0)).unwrap() < 1e-9);
    }

    #[test]
    fn the_threshold_is_what_is_lost_after_a_standstill() {
        // Up, 5 s of rest, on; a valve that sticks after each rest for 4 mA.
        let current = |t: f64| if t < 10.0 { 0.4 + 0.002 * t } else { 0.42 + 0.002 * (t - 15.0).max(0.0) };
        let pressure = |t: f64| {
            let i = current(t);
            40.0 * if t < 15.0 || i > 0.424 { if t < 15.0 { i } else { i - 0.004 } } else { 0.42 }
        };
        let columns = Columns::new(3001, |_| f64::NAN, current, |t| pressure(t) + 0.02 * scatter(t));
        let found = Threshold::default().compute(&columns.segment(0.0)).unwrap();
        assert!((found - 0.004).abs() < 5e-4, "{found}");
        let free = Columns::new(3001, |_| f64::NAN, current, |t| 40.0 * current(t));
        assert!(Threshold::default().compute(&free.segment(0.0)).unwrap() < 1e-4);
    }

    /// Currents in steps of 1 mA from 0.4 A on, either way, and the pressure over the current.
    fn moving(samples: u32, up: bool, pressure: impl Fn(f64) -> f64) -> Vec<Point> {
        let way = |k: u32| 0.4 + if up { 1e-3 } else { -1e-3 } * f64::from(k);
        (0..=samples).map(|k| (way(k), pressure(way(k)), 0.01 * f64::from(k))).collect()
    }

    /// 100 bar/A behind a dead band: carried back from 2 and 6 bar to where the pressure began to move, either way.
    #[test]
    fn a_movement_is_carried_back_to_its_beginning() {
        let up = moving(200, true, |i| 10.0 + 100.0 * (i - 0.45).max(0.0));
        let down = moving(200, false, |i| 10.0 + 100.0 * (i - 0.33).min(0.0));
        let found = (lost(&up, 10.0, 2.0).unwrap(), lost(&down, 10.0, 2.0).unwrap());
        assert!((found.0 - 0.05).abs() < 1e-9 && (found.1 - 0.07).abs() < 1e-9, "{found:?}");
        // A pressure that moves against the current first: 3 bar down in the first 20 mA, and then up.
        let against = moving(200, true, |i| 10.0 - 150.0 * (i - 0.4).min(0.02) + 200.0 * (i - 0.42).max(0.0));
        let found = lost(&against, 10.0, 3.0).unwrap();
        assert!((found - 0.035).abs() < 1e-9, "{found}");
        // From beyond what it would move to, nothing is lost; where it does not move so far, nothing is known.
        assert_eq!((lost(&up, 3.0, 2.0), lost(&up, 10.0, 5.1)), (Some(0.0), None));
        assert_eq!((lost(&down, 17.0, 2.0), lost(&down, 10.0, 4.4)), (Some(0.0), None));
    }

    /// The last of a hundred samples by the line through the last five, by hand: mean 3.2, slope 1.2 a step, two steps on.
    #[test]
    fn the_pressure_at_the_end_of_a_stretch() {
        let mut stretch = moving(99, true, |_| 50.0);
        for (p, bar) in stretch[95..].iter_mut().zip([1.0, 2.0, 3.0, 4.0, 6.0]) {
            p.1 = bar;
        }
        assert!((end_bar(&stretch) - 5.6).abs() < 1e-9, "{}", end_bar(&stretch));
        // Where the current stands there is no line: the mean; of less than twenty samples the last.
        stretch[95..].iter_mut().for_each(|p| p.0 = 0.5);
        assert!((end_bar(&stretch) - 3.2).abs() < 1e-9, "{}", end_bar(&stretch));
        assert_eq!(end_bar(&stretch[90..]), 6.0);
    }

    /// 1 mA a sample, either way, with rests from a sample on for so many steps; 0.1 bar/mA, of which 5 mA are lost after each rest.
    fn rested(way: f64, rests: &[(i32, i32)], samples: usize) -> Columns {
        let moved = |k: i32| k - rests.iter().map(|(from, steps)| (k - from).clamp(0, *steps)).sum::<i32>();
        let lost = |k: i32| rests.iter().map(|(from, _)| (moved(k) - moved(*from)).clamp(0, 5)).sum::<i32>();
        let sample = |t: f64| (t * 100.0).round() as i32;
        let (current, pressure) = (|t| moved(sample(t)), |t| moved(sample(t)) - lost(sample(t)));
        Columns::new(samples, |_| f64::NAN, |t| 1.0 + way * 1e-3 * f64::from(current(t)), |t| 50.0 + way * 0.1 * f64::from(pressure(t)))
    }

    /// Threshold [mA] with `change` [bar].
    fn threshold_ma(columns: &Columns, change: f64) -> Result<f64, NotMeasurable> {
        let found = Threshold { change: Pressure::new(change), rated: None }.compute(&columns.segment(0.0))?;
        Ok((found * 1e9).round() / 1e6)
    }

    #[test]
    fn a_standstill_lies_inside_a_stretch_and_has_ten_samples_at_least() {
        let none = Err(NotMeasurable::NoSuchMove { wanted: "rests and then goes on in the same direction" });
        for way in [1.0, -1.0] {
            let found = |rests: &[(i32, i32)], samples| threshold_ma(&rested(way, rests, samples), 0.1);
            // Nine steps at rest are ten equal samples; after them eleven are needed.
            assert_eq!([found(&[(50, 9)], 71), found(&[(51, 9)], 72)], [Ok(5.0), Ok(5.0)]);
            assert_eq!([found(&[(50, 9)], 70), found(&[(50, 8)], 71)], [none.clone(), none.clone()]);
            // Nor is there one where the phase ends with it, or begins: what rests first has no direction before.
            assert_eq!(found(&[(50, 90)], 130), none);
            assert_eq!([found(&[(0, 30)], 44), found(&[(1, 30)], 44)], [none.clone(), Ok(5.0)]);
        }
    }

    #[test]
    fn a_standstill_ends_before_the_next_and_its_pressure_is_that_of_its_end() {
        // 20 mA between two rests: too little for 3 bar, and what comes after the second is not added.
        assert_eq!(threshold_ma(&rested(1.0, &[(50, 20), (90, 20)], 300), 1.0), Ok(5.0));
        // With 0.2 bar both count: 5 mA the first, and 5.5 mA the second, at whose end half the readings lie 0.1 bar higher.
        let mut columns = rested(1.0, &[(50, 19), (90, 19)], 110 + 20);
        columns.pressure[50..60].fill(99.0);
        columns.pressure[90..100].fill(99.0);
        assert_eq!(threshold_ma(&columns, 0.2), Ok(5.0));
        columns.pressure[100..105].iter_mut().for_each(|p| *p += 0.1);
        assert_eq!(threshold_ma(&columns, 0.2), Ok(5.25));
        // Of a long one the last 200 readings.
        let mut columns = rested(1.0, &[(50, 999)], 1300);
        columns.pressure[50..850].fill(99.0);
        assert_eq!(threshold_ma(&columns, 1.0), Ok(5.0));
        columns.pressure[850..950].iter_mut().for_each(|p| *p += 0.2);
        assert_eq!(threshold_ma(&columns, 1.0), Ok(6.0));
    }

    #[test]
    fn figures_are_shares_of_the_rated_current() {
        let (columns, turning) = (rested(1.0, &[(50, 20)], 300), play(0.01, small, 0.0, 8001));
        for rated in [0.5, 4.0] {
            let rated = Some(Current::new(rated));
            let shares = (
                Threshold { rated, ..Threshold::default() }.compute(&columns.segment(0.0)).unwrap(),
                DeadBand { rated, ..DeadBand::default() }.compute(&turning.segment(0.0)).unwrap(),
            );
            let whole =
                (Threshold::default().compute(&columns.segment(0.0)).unwrap(), DeadBand::default().compute(&turning.segment(0.0)).unwrap());
            let of = rated.map_or(0.0, Current::value);
            assert!(
                (shares.0 * of - whole.0).abs() < 1e-12 && (shares.1 * of - whole.1).abs() < 1e-12,
                "{shares:?} of {of} A are not {whole:?}"
            );
        }
    }

    #[test]
    fn a_ramp_neither_turns_nor_rests() {
        let columns = Columns::new(1000, |_| f64::NAN, |t| 0.01 * t, |t| t);
        assert!(matches!(DeadBand::default().compute(&columns.segment(0.0)), Err(NotMeasurable::NoSuchMove { .. })));
        assert!(matches!(Threshold::default().compute(&columns.segment(0.0)), Err(NotMeasurable::NoSuchMove { .. })));
    }
}
