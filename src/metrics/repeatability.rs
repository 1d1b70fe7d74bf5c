//! How alike repeated passes over a characteristic are.

use serde::{Deserialize, Serialize};

use super::loop_width::definition;
use super::passes::{Pass, passes};
use super::{Metric, Needs, NotMeasurable, Segment};
use crate::units::{self, Pressure, Unit};

/// Repeatability: the difference that two passes in the same direction stay within in 95 of 100 cases, at one current.
///
/// It is 2.8 times the standard deviation between passes, which is pooled over the range and both directions, and from which the
/// share of the sensor's noise is taken away. So it grows neither with the noise nor with the number of passes. The
/// first pass of the phase starts from an unknown history and does not count. With `rated` it is a share of the rated
/// pressure.
///
/// # Source
/// IEC 61298-2, repeatability (same input, same direction, full traverses); the factor 2.8 is that of the repeatability
/// limit of ISO 5725-6. IEC 61298-2 takes the extremes of three traverses, which grow with noise and number.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Repeatability {
    /// Rated pressure, of which the figure is then a share.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rated: Option<Pressure>,
}

/// 1.96 sqrt(2): 95 % of the differences of two normal values lie within it.
const LIMIT: f64 = 2.8;

impl Metric for Repeatability {
    fn id(&self) -> &'static str {
        "repeatability"
    }
    fn unit(&self) -> &'static Unit {
        if self.rated.is_some() { &units::RATIO } else { &units::PRESSURE }
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        definition("repeatability.limit.v2", segment, self.rated.map(|r| r.to_string()))
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let found = passes(segment)?;
        let (rising, falling) = (found.counted(true), found.counted(false));
        if rising.len() < 2 && falling.len() < 2 {
            return Err(NotMeasurable::TooFewSweeps {
                rising: rising.len(),
                falling: falling.len(),
                needed: "two of one kind are needed, the first pass of all not counted",
            });
        }
        let (mut squares, mut freedom) = (0.0, 0.0);
        for group in [&rising, &falling].into_iter().filter(|g| g.len() >= 2) {
            squares += between(group);
            freedom += group.len() as f64 - 1.0;
        }
        let deviation = (squares / freedom).max(0.0).sqrt();
        Ok(LIMIT * deviation / self.rated.map_or(1.0, Pressure::value))
    }
    fn check(&self) -> Result<(), String> {
        self.rated.map_or(Ok(()), |r| super::positive("rated", r.value(), &r))
    }
}

/// Sum of squares between passes, mean over the grid, less what the scatter within the passes gives [bar^2].
fn between(group: &[&Pass]) -> f64 {
    let (n, points) = (group.len() as f64, group[0].pressure_bar.len());
    let at = |i: usize| {
        let mean = group.iter().map(|p| p.pressure_bar[i]).sum::<f64>() / n;
        group.iter().map(|p| (p.pressure_bar[i] - mean).powi(2)).sum::<f64>()
    };
    let squares = (0..points).map(at).sum::<f64>() / points as f64;
    let noise = group.iter().map(|p| p.variance_bar2).sum::<f64>() / n;
    squares - (n - 1.0) * noise
}

#[cfg(test)]
mod tests {
    use super::super::loop_width::tests::triangle;
    use super::super::tests::{Columns, scatter};
    use super::*;

    fn of(columns: &Columns) -> f64 {
        Repeatability::default().compute(&columns.segment(0.0)).unwrap()
    }

    #[test]
    fn passes_that_differ_have_2_8_times_their_deviation() {
        // Cycles at 0, 0.1 and 0.2 bar, and the first, which does not count on its way up.
        let columns = Columns::new(12001, |_| f64::NAN, triangle, |t| 20.0 * triangle(t) + 0.1 * (t / 40.0).floor());
        // Rising: 0.1, 0.2; falling: 0, 0.1, 0.2: squares 0.005 and 0.02 with 1 and 2 degrees of freedom.
        assert!((of(&columns) - 2.8 * (0.025f64 / 3.0).sqrt()).abs() < 1e-6, "{}", of(&columns));
    }

    #[test]
    fn a_share_of_the_rated_pressure_and_the_fewest_passes() {
        let columns = |samples| Columns::new(samples, |_| f64::NAN, triangle, |t| 20.0 * triangle(t) + 0.1 * (t / 40.0).floor());
        let rated = Repeatability { rated: Some(Pressure::new(20.0)) };
        let (whole, three) = (columns(12001), of(&columns(12001)));
        assert!((rated.compute(&whole.segment(0.0)).unwrap() - three / 20.0).abs() < 1e-12 && rated.unit().symbol == "1");
        // Two cycles: falling twice at 0 and 0.1 bar; of the two on the way up the first does not count.
        let two = columns(8001);
        assert!((of(&two) - 2.8 * 0.005f64.sqrt()).abs() < 1e-6, "{}", of(&two));
    }

    /// From the top: down, up, down, up. The first way down does not count, both ways up do: 0.1 bar apart.
    #[test]
    fn two_passes_of_either_kind_are_enough() {
        let columns = Columns::new(8001, |_| f64::NAN, |t| 1.0 - triangle(t), |t| 20.0 * (1.0 - triangle(t)) + 0.1 * (t / 40.0).floor());
        assert!((of(&columns) - 2.8 * 0.005f64.sqrt()).abs() < 1e-6, "{}", of(&columns));
    }

    /// Two passes 0.1 bar apart, smoothed values of a variance of 0.001: 0.005 between them, less the one share of noise.
    #[test]
    fn the_noise_of_the_sensor_is_taken_away_once_for_each_degree_of_freedom() {
        let pass =
            |level: f64, place| Pass { pressure_bar: vec![level; 4], variance_bar2: 0.001 + 1e-3 * level, rate_a_per_s: 0.05, place };
        let passes = [pass(0.0, 1), pass(0.1, 3), pass(0.2, 5)];
        let found = between(&passes.iter().collect::<Vec<_>>());
        assert!((found - (0.02 - 2.0 * 0.0011)).abs() < 1e-12, "{found}");
        let found = between(&passes[..2].iter().collect::<Vec<_>>());
        assert!((found - (0.005 - 0.00105)).abs() < 1e-12, "{found}");
    }

    #[test]
    fn neither_noise_nor_more_cycles_are_a_lack_of_repeatability() {
        for (noise, samples) in [(0.02, 12001), (0.1, 12001), (0.1, 40001)] {
            let columns = Columns::new(samples, |_| f64::NAN, triangle, |t| 20.0 * triangle(t) + noise * scatter(t));
            assert!(of(&columns) < 0.4 * noise, "{noise}, {samples}: {}", of(&columns));
        }
    }

    #[test]
    fn one_cycle_carries_no_figure() {
        let columns = Columns::new(4001, |_| f64::NAN, triangle, |t| 20.0 * triangle(t));
        assert!(matches!(Repeatability::default().compute(&columns.segment(0.0)), Err(NotMeasurable::TooFewSweeps { .. })));
    }
}
