//! Width of the loop of a swept characteristic.
//!
//! The current of one dead time and one lag of the valve model earlier belongs to a pressure, so that a sweep does not
//! widen the loop by what the model knows; where the phase sweeps at two rates (1 : 1.5 or more), the curves are carried
//! on to the rate zero, and no lag at all is left. Curves are smoothed, so that scatter does not widen the loop either.
//! The first pass of a phase starts from an unknown history; it is left out where there is another of its direction.

use serde::{Deserialize, Serialize};

use super::passes::{Passes, moved, passes};
use super::{Metric, Needs, NotMeasurable, Segment, milliseconds};
use crate::units::{self, Current, Pressure, Unit};

/// Hysteresis as a pressure: the largest difference between the falling and the rising characteristic at one current.
///
/// With `rated` it is a share of the rated pressure, as data sheets give it.
///
/// # Source
/// ISO 10770-3 and IEC 61298-2, hysteresis; ISA-51.1 calls it hysteretic error, and hysteresis what is left of it without
/// the dead band (`dead_band`).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HysteresisWidth {
    /// Rated pressure, of which the figure is then a share.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rated: Option<Pressure>,
}

/// Hysteresis as a current: the largest difference between the rising and the falling characteristic at one pressure.
///
/// Pressures within 5 % of the ends of what both directions reach are left out: where the valve stands at its floor or at its
/// supply pressure, the pressure says nothing of the current. With `rated` it is a share of the rated current.
///
/// # Source
/// ISO 10770-3, hysteresis in percent of the rated input signal.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HysteresisWidthInput {
    /// Rated current, of which the figure is then a share.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rated: Option<Current>,
}

/// Share of the pressures, at either end, at which the width in current is not looked for.
pub const ENDS: f64 = 0.05;

pub fn both_ways(segment: &Segment<'_>) -> Result<Passes, NotMeasurable> {
    let found = passes(segment)?;
    if found.rising.is_empty() || found.falling.is_empty() {
        return Err(NotMeasurable::TooFewSweeps {
            rising: found.rising.len(),
            falling: found.falling.len(),
            needed: "one of each is needed",
        });
    }
    Ok(found)
}

/// Definition with the delay, the lag and the rate of the sweep that it saw, and what it is a share of.
pub fn definition(id: &str, segment: &Segment<'_>, rated: Option<String>) -> String {
    let mut of = format!("delay={}, lag={}", milliseconds(segment.delay_s), milliseconds(segment.lag_s));
    if let Ok(found) = passes(segment) {
        of += &format!(", rate={:.4} A/s", found.rate_a_per_s);
    }
    if let Some(rated) = rated {
        of += &format!(", rated={rated}");
    }
    format!("{id}({of})")
}

impl Metric for HysteresisWidth {
    fn id(&self) -> &'static str {
        "hysteresis_width"
    }
    fn unit(&self) -> &'static Unit {
        if self.rated.is_some() { &units::RATIO } else { &units::PRESSURE }
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        definition("hysteresis_width.max.v2", segment, self.rated.map(|r| r.to_string()))
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let found = both_ways(segment)?;
        let (up, down) = (found.curve(true), found.curve(false));
        let width = up.iter().zip(&down).map(|(u, d)| d - u).fold(f64::NEG_INFINITY, f64::max);
        Ok(width / self.rated.map_or(1.0, Pressure::value))
    }
    fn check(&self) -> Result<(), String> {
        self.rated.map_or(Ok(()), |r| super::positive("rated", r.value(), &r))
    }
}

impl Metric for HysteresisWidthInput {
    fn id(&self) -> &'static str {
        "hysteresis_width_input"
    }
    fn unit(&self) -> &'static Unit {
        if self.rated.is_some() { &units::RATIO } else { &units::CURRENT }
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        definition("hysteresis_width_input.max.v2", segment, self.rated.map(|r| r.to_string()))
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let found = both_ways(segment)?;
        let (up, down) = (rising_envelope(found.curve(true)), rising_envelope(found.curve(false)));
        let last = up.len() - 1;
        // Pressures that both curves reach, less the ends.
        let (low, high) = (up[0].max(down[0]), up[last].min(down[last]));
        let shared_bar = moved(low, high)?;
        // Place on the grid, in its steps; a < p <= b, for p lies well inside both curves.
        let at = |curve: &[f64], p: f64| {
            let k = curve.partition_point(|c| *c < p);
            let (a, b) = (curve[k - 1], curve[k]);
            k as f64 + (p - a) / (b - a)
        };
        let step_a = (found.current_a[last] - found.current_a[0]) / last as f64;
        let share = |i: usize| ENDS + (1.0 - 2.0 * ENDS) * i as f64 / last as f64;
        let widths = (0..=last).map(|i| low + shared_bar * share(i)).map(|p| at(&up, p) - at(&down, p));
        Ok(step_a * widths.fold(f64::NEG_INFINITY, f64::max) / self.rated.map_or(1.0, Current::value))
    }
    fn check(&self) -> Result<(), String> {
        self.rated.map_or(Ok(()), |r| super::positive("rated", r.value(), &r))
    }
}

/// The running maximum: noise must not make a curve fall.
fn rising_envelope(mut curve: Vec<f64>) -> Vec<f64> {
    for i in 1..curve.len() {
        curve[i] = curve[i].max(curve[i - 1]);
    }
    curve
}

#[cfg(test)]
pub mod tests {
    use super::super::tests::{Columns, scatter};
    use super::*;

    /// Triangle 0..1 A with period 40 s.
    pub fn triangle(t: f64) -> f64 {
        let phase = (t / 40.0).fract();
        if phase < 0.5 { 2.0 * phase } else { 2.0 - 2.0 * phase }
    }

    pub fn rising(t: f64) -> bool {
        (t / 40.0).fract() < 0.5
    }

    fn width(columns: &Columns, delay_s: f64) -> f64 {
        HysteresisWidth::default().compute(&columns.segment(delay_s)).unwrap()
    }

    fn input(columns: &Columns, delay_s: f64) -> f64 {
        HysteresisWidthInput::default().compute(&columns.segment(delay_s)).unwrap()
    }

    #[test]
    fn a_parallel_loop_has_its_width_in_both_directions() {
        // p = 20 i, 0.6 bar above when falling: 0.6 bar, or 0.6/20 A.
        let columns = Columns::new(12001, |_| f64::NAN, triangle, |t| 20.0 * triangle(t) + if rising(t) { 0.0 } else { 0.6 });
        assert!((width(&columns, 0.0) - 0.6).abs() < 1e-9);
        assert!((input(&columns, 0.0) - 0.03).abs() < 1e-6);
        let rated = HysteresisWidth { rated: Some(Pressure::new(20.0)) };
        assert!((rated.compute(&columns.segment(0.0)).unwrap() - 0.03).abs() < 1e-9 && rated.unit().symbol == "1");
        assert!(rated.check().is_ok() && HysteresisWidth { rated: Some(Pressure::new(0.0)) }.check().is_err());
    }

    /// Curves of another slope and zero: 5 + 20 (i - 0.1) up from 0.1 to 1.1 A, back 0.03 A to the left.
    #[test]
    fn the_width_in_current_does_not_depend_on_either_zero() {
        let current = |t: f64| 0.1 + triangle(t);
        let columns =
            Columns::new(12001, |_| f64::NAN, current, |t| 5.0 + 20.0 * (triangle(t) + if rising(t) { 0.0 } else { 0.03 * triangle(t) }));
        // Falling, p - 5 = 20.6 (i - 0.1): the current differs by 0.03 / 1.03 of (i - 0.1), most at the upper end that counts. Both
        // curves reach from 0.412 to 19.6 bar above 5; 95 % of that is 18.6406 bar.
        let wanted = (0.412 + 0.95 * (19.6 - 0.412)) * (1.0 / 20.0 - 1.0 / 20.6);
        assert!((input(&columns, 0.0) - wanted).abs() < 1e-9, "{} is not {wanted}", input(&columns, 0.0));
        let rated = HysteresisWidthInput { rated: Some(Current::new(2.0)) };
        assert!((rated.compute(&columns.segment(0.0)).unwrap() - 0.5 * wanted).abs() < 1e-9 && rated.unit().symbol == "1");
        // Directions that share no pressure have no width in current.
        let apart = Columns::new(12001, |_| f64::NAN, current, |t| if rising(t) { 1.0 + triangle(t) } else { 7.0 + triangle(t) });
        let none = HysteresisWidthInput::default().compute(&apart.segment(0.0));
        assert!(matches!(none, Err(NotMeasurable::NoResponse { .. })), "{none:?}");
        // One way only is no loop.
        let up = Columns::new(2001, |_| f64::NAN, current, |t| 20.0 * triangle(t));
        let none = HysteresisWidth::default().compute(&up.segment(0.0));
        assert_eq!(none, Err(NotMeasurable::TooFewSweeps { rising: 1, falling: 0, needed: "one of each is needed" }));
    }

    #[test]
    fn neither_delay_nor_lag_widens_the_loop() {
        let columns = Columns::new(12001, |_| f64::NAN, triangle, |t| 20.0 * triangle((t - 0.03).max(0.0)));
        assert!(width(&columns, 0.03).abs() < 1e-9);
        assert!(width(&columns, 0.0) > 0.05);
        // Behind a lag, a held command is half a period later still: 15 + 10 + 5 ms.
        let mut segment = columns.segment(0.015);
        segment.lag_s = 0.01;
        assert!(HysteresisWidth::default().compute(&segment).unwrap().abs() < 1e-9);
    }

    #[test]
    fn two_rates_take_out_a_lag_that_nobody_knows() {
        // Two cycles of 40 s, two of 20 s; every pressure 0.05 s late.
        let current = |t: f64| if t < 80.0 { triangle(t) } else { triangle(2.0 * (t - 80.0)) };
        let up = |t: f64| if t < 80.0 { rising(t) } else { rising(2.0 * (t - 80.0)) };
        let pressure = |t: f64| 20.0 * current((t - 0.05).max(0.0)) + if up(t) { 0.0 } else { 0.6 };
        let columns = Columns::new(12001, |_| f64::NAN, current, pressure);
        assert!((width(&columns, 0.0) - 0.6).abs() < 1e-3, "{}", width(&columns, 0.0));
        let one_rate = Columns::new(8001, |_| f64::NAN, current, pressure);
        assert!(width(&one_rate, 0.0) > 0.69);
    }

    #[test]
    fn scatter_does_not_widen_the_loop() {
        for noise in [0.02, 0.1] {
            let columns = Columns::new(
                12001,
                |_| f64::NAN,
                triangle,
                |t| 20.0 * triangle(t) + if rising(t) { 0.0 } else { 0.6 } + noise * scatter(t),
            );
            assert!((width(&columns, 0.0) - 0.6).abs() < 0.4 * noise, "{noise}: {}", width(&columns, 0.0));
            assert!((input(&columns, 0.0) - 0.03).abs() < 0.025 * noise, "{noise}: {}", input(&columns, 0.0));
        }
    }

    #[test]
    fn at_the_floor_there_is_no_width() {
        // Below 0.3 A both directions stand at 0 bar; the rising branch leaves it 20 mA later.
        let pressure = |t: f64| (40.0 * (triangle(t) - if rising(t) { 0.3 } else { 0.28 })).max(0.0) + 0.03 * scatter(t);
        for start in 0..20 {
            let columns = Columns::new(12001, |_| f64::NAN, triangle, |t| pressure(t) + 0.03 * scatter(t + 1e3 * f64::from(start)));
            assert!((input(&columns, 0.0) - 0.02).abs() < 2e-3, "{start}: {}", input(&columns, 0.0));
        }
    }

    #[test]
    fn the_first_pass_is_left_out_where_there_is_another() {
        // An unknown history: the first rising pass lies 1 bar higher.
        let pressure = |t: f64| 20.0 * triangle(t) + if rising(t) { if t < 20.0 { 1.0 } else { 0.0 } } else { 0.6 };
        let columns = Columns::new(12001, |_| f64::NAN, triangle, pressure);
        assert!((width(&columns, 0.0) - 0.6).abs() < 1e-9);
    }

    #[test]
    fn noise_does_not_make_a_curve_fall() {
        assert_eq!(rising_envelope(vec![1.0, 3.0, 2.0, 2.5, 4.0]), [1.0, 3.0, 3.0, 3.0, 4.0]);
    }

    #[test]
    fn a_hold_has_no_loop() {
        let columns = Columns::new(300, |_| f64::NAN, |_| 0.5, |_| 10.0);
        let none = Err(NotMeasurable::TooFewSweeps { rising: 0, falling: 0, needed: "one of each is needed" });
        assert_eq!(HysteresisWidth::default().compute(&columns.segment(0.0)), none);
    }
}
