//! How far the pressure follows the oil temperature and the supply, where nothing else changes.

use serde::{Deserialize, Serialize};

use super::line::least_squares;
use super::{Metric, Needs, NotMeasurable, Segment, enough};
use crate::units::{self, Pressure, TemperatureChange, Unit};

/// Sensitivity to temperature: by how much the pressure changes when the oil becomes warmer by `per`, while the commanded current,
/// or in closed loop the target, stands still: the slope of the least-squares line of the pressure over the oil temperature, times `per`.
/// The oil must become warmer or colder by half of `per` at least. With `rated` it is a share of the rated pressure.
/// `examples/batch/influence.plan.toml` measures it.
///
/// # Source
/// IEC 61298-3, effects of influence quantities, temperature: the change of the output for a change of the temperature, at one input.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TemperatureSensitivity {
    /// The change of the temperature that the figure is given for.
    #[serde(default = "ten_kelvin")]
    pub per: TemperatureChange,
    /// Rated pressure, of which the figure is then a share.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rated: Option<Pressure>,
}

/// Sensitivity to the supply: by how much the controlled pressure changes when the supply pressure rises by `per`, while the commanded
/// current, or in closed loop the target, stands still: the slope of the least-squares line of the pressure over the supply pressure,
/// times `per`. The supply must change by half of `per` at least. With `rated` it is a share of the rated pressure.
/// `examples/batch/influence.plan.toml` measures it.
///
/// # Source
/// IEC 61298-3, effects of influence quantities, supply: the change of the output for a change of the supply, at one input.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SupplySensitivity {
    /// The change of the supply pressure that the figure is given for.
    #[serde(default = "ten_bar")]
    pub per: Pressure,
    /// Rated pressure, of which the figure is then a share.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rated: Option<Pressure>,
}

/// Share of `per` by which the influence must change: a slope is carried on to twice what was seen, and no further.
const LEAST_SHARE: f64 = 0.5;
/// Change of a command that stands still [A or bar]: the last digit of a computed waveform.
const STILL: f64 = 1e-9;

fn ten_kelvin() -> TemperatureChange {
    TemperatureChange::new(10.0)
}

fn ten_bar() -> Pressure {
    Pressure::new(10.0)
}

impl Default for TemperatureSensitivity {
    fn default() -> Self {
        Self { per: ten_kelvin(), rated: None }
    }
}

impl Default for SupplySensitivity {
    fn default() -> Self {
        Self { per: ten_bar(), rated: None }
    }
}

/// Difference between the largest and the smallest value.
fn range(values: impl Iterator<Item = f64>) -> f64 {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    high - low
}

/// An influence: its channel, its name, its unit.
struct Influence<'a> {
    values: &'a [f64],
    name: &'static str,
    unit: &'static str,
}

/// Change of the pressure for a change of the influence by `per` [bar].
fn change(segment: &Segment<'_>, influence: &Influence<'_>, per: f64) -> Result<f64, NotMeasurable> {
    let s = &segment.signals;
    let at = |k: usize| influence.values.get(k).copied().unwrap_or(f64::NAN);
    if segment.range.clone().all(|k| at(k).is_nan()) {
        return Err(NotMeasurable::NoChannel { name: influence.name });
    }
    let command = if segment.range.clone().all(|k| s.target_bar[k].is_finite()) { s.target_bar } else { s.current_a };
    if range(segment.range.clone().map(|k| command[k])) > STILL {
        return Err(NotMeasurable::NoSuchMove { wanted: "stands still through the phase" });
    }
    let pairs = segment.range.clone().map(|k| (at(k), s.pressure_bar[k])).filter(|(x, p)| x.is_finite() && p.is_finite());
    let (x, p): (Vec<f64>, Vec<f64>) = pairs.unzip();
    enough(x.len(), segment.range.len())?;
    let (changed, needed) = (range(x.iter().copied()), LEAST_SHARE * per);
    if changed < needed {
        return Err(NotMeasurable::TooLittleChange { name: influence.name, changed, needed, unit: influence.unit });
    }
    Ok(least_squares(&x, &p).0 * per)
}

/// The change of the pressure for a change of the influence by `per`, as a share of the rated pressure where there is one.
fn sensitivity(segment: &Segment<'_>, influence: &Influence<'_>, per: f64, rated: Option<Pressure>) -> Result<f64, NotMeasurable> {
    Ok(change(segment, influence, per)? / rated.map_or(1.0, Pressure::value))
}

fn unit(rated: Option<Pressure>) -> &'static Unit {
    if rated.is_some() { &units::RATIO } else { &units::PRESSURE }
}

fn check(per: f64, written: impl std::fmt::Display, rated: Option<Pressure>) -> Result<(), String> {
    super::positive("per", per, &written)?;
    rated.map_or(Ok(()), |r| super::positive("rated", r.value(), &r))
}

impl Metric for TemperatureSensitivity {
    fn id(&self) -> &'static str {
        "temperature_sensitivity"
    }
    fn unit(&self) -> &'static Unit {
        unit(self.rated)
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        definition("temperature_sensitivity.slope.v1", self.per, self.rated)
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let oil = Influence { values: segment.signals.oil_temp_c, name: "oil temperature", unit: "K" };
        sensitivity(segment, &oil, self.per.value(), self.rated)
    }
    fn check(&self) -> Result<(), String> {
        check(self.per.value(), self.per, self.rated)
    }
}

impl Metric for SupplySensitivity {
    fn id(&self) -> &'static str {
        "supply_sensitivity"
    }
    fn unit(&self) -> &'static Unit {
        unit(self.rated)
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        definition("supply_sensitivity.slope.v1", self.per, self.rated)
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let supply = Influence { values: segment.signals.supply_bar, name: "supply pressure", unit: "bar" };
        sensitivity(segment, &supply, self.per.value(), self.rated)
    }
    fn check(&self) -> Result<(), String> {
        check(self.per.value(), self.per, self.rated)
    }
}

fn definition(id: &str, per: impl std::fmt::Display, rated: Option<Pressure>) -> String {
    let rated = rated.map(|r| format!(", rated={r}")).unwrap_or_default();
    format!("{id}(per={per}{rated})")
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Columns, scatter};
    use super::*;

    /// Ten minutes at 500 mA: the oil warms from 30 to 45 degC, the supply falls from 60 to 52 bar.
    fn warming(target: f64) -> (Columns, Vec<f64>, Vec<f64>) {
        let (oil, supply) = (|t: f64| 30.0 + 15.0 * (t / 600.0).sqrt(), |t: f64| 60.0 - 8.0 * (t / 600.0).powi(3));
        let pressure = move |t: f64| 18.0 - 0.02 * (oil(t) - 40.0) + 0.03 * (supply(t) - 60.0) + 0.02 * scatter(t);
        let columns = Columns::new(60_001, |_| target, |_| 0.5, pressure);
        let (oil, supply) = columns.time_s.iter().map(|t| (oil(*t), supply(*t))).unzip();
        (columns, oil, supply)
    }

    #[test]
    fn a_slope_over_the_temperature_is_found_for_ten_kelvin_and_as_a_share() {
        let columns = Columns::new(60_001, |_| f64::NAN, |_| 0.5, |t| 18.0 - 0.02 * 15.0 * (t / 600.0).sqrt() + 0.02 * scatter(t));
        let oil: Vec<f64> = columns.time_s.iter().map(|t| 30.0 + 15.0 * (t / 600.0).sqrt()).collect();
        let mut segment = columns.segment(0.0);
        segment.signals.oil_temp_c = &oil;
        let found = TemperatureSensitivity::default().compute(&segment).unwrap();
        assert!((found + 0.2).abs() < 1e-3, "{found}");
        let share = TemperatureSensitivity { per: TemperatureChange::new(20.0), rated: Some(Pressure::new(40.0)) };
        assert!((share.compute(&segment).unwrap() + 0.01).abs() < 1e-4);
        assert_eq!(share.definition(&segment), "temperature_sensitivity.slope.v1(per=20 K, rated=40 bar)");
        assert_eq!((share.unit().symbol, TemperatureSensitivity::default().unit().symbol), ("1", "bar"));
    }

    #[test]
    fn a_slope_over_the_supply_is_found() {
        let columns = Columns::new(20_001, |_| 18.0, |t| 0.5 + 0.01 * t, |t| 18.0 + 0.03 * (0.1 * t).sin() * 5.0);
        let supply: Vec<f64> = columns.time_s.iter().map(|t| 60.0 + 5.0 * (0.1 * t).sin()).collect();
        let mut segment = columns.segment(0.0);
        segment.signals.supply_bar = &supply;
        // In closed loop the current may do what it must: the target stands still.
        let found = SupplySensitivity::default().compute(&segment).unwrap();
        assert!((found - 0.3).abs() < 1e-9, "{found}");
        let share = SupplySensitivity { rated: Some(Pressure::new(30.0)), ..SupplySensitivity::default() };
        assert!((share.compute(&segment).unwrap() - 0.01).abs() < 1e-9);
    }

    #[test]
    fn without_a_channel_a_change_or_a_command_that_stands_still_there_is_no_figure() {
        let (columns, oil, supply) = warming(f64::NAN);
        let mut segment = columns.segment(0.0);
        assert_eq!(TemperatureSensitivity::default().compute(&segment), Err(NotMeasurable::NoChannel { name: "oil temperature" }));
        assert_eq!(SupplySensitivity::default().compute(&segment), Err(NotMeasurable::NoChannel { name: "supply pressure" }));
        (segment.signals.oil_temp_c, segment.signals.supply_bar) = (&oil, &supply);
        assert!(SupplySensitivity::default().compute(&segment).is_ok());
        let wide = TemperatureSensitivity { per: TemperatureChange::new(30.1), rated: None };
        let error = wide.compute(&segment).unwrap_err().to_string();
        insta::assert_snapshot!(error, @"the oil temperature changed by 15.00 K; 15.05 K are needed");
        assert!(TemperatureSensitivity { per: TemperatureChange::new(29.9), rated: None }.compute(&segment).is_ok());
        let moving = Columns::new(1000, |_| f64::NAN, |t| 0.5 + 0.001 * t, |_| 18.0);
        let mut segment = moving.segment(0.0);
        segment.signals.oil_temp_c = &oil;
        let error = TemperatureSensitivity::default().compute(&segment).unwrap_err();
        assert!(matches!(error, NotMeasurable::NoSuchMove { .. }), "{error}");
        let mut gaps = vec![f64::NAN; 60_001];
        gaps[..30_000].copy_from_slice(&oil[..30_000]);
        let mut segment = columns.segment(0.0);
        segment.signals.oil_temp_c = &gaps;
        assert!(matches!(TemperatureSensitivity::default().compute(&segment), Err(NotMeasurable::TooFewSamples { .. })));
    }

    /// Half of `per` is enough, to the last digit.
    #[test]
    fn a_change_as_large_as_is_needed_is_enough() {
        let columns = Columns::new(200, |_| f64::NAN, |_| 0.5, |t| if t < 1.0 { 18.0 } else { 18.5 });
        let oil: Vec<f64> = columns.time_s.iter().map(|t| if *t < 1.0 { 30.0 } else { 35.0 }).collect();
        let mut segment = columns.segment(0.0);
        segment.signals.oil_temp_c = &oil;
        let found = TemperatureSensitivity { per: TemperatureChange::new(10.0), rated: None }.compute(&segment).unwrap();
        assert!((found - 1.0).abs() < 1e-9, "{found}");
    }

    #[test]
    fn per_and_rated_must_be_positive() {
        for value in [0.0, -1.0] {
            assert!(TemperatureSensitivity { per: TemperatureChange::new(value), rated: None }.check().is_err());
            assert!(TemperatureSensitivity { rated: Some(Pressure::new(value)), ..Default::default() }.check().is_err());
            assert!(SupplySensitivity { per: Pressure::new(value), rated: None }.check().is_err());
            assert!(SupplySensitivity { rated: Some(Pressure::new(value)), ..Default::default() }.check().is_err());
        }
        assert!(TemperatureSensitivity::default().check().is_ok() && SupplySensitivity::default().check().is_ok());
    }
}
