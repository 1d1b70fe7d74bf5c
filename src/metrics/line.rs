//! How straight a characteristic is.

use serde::{Deserialize, Serialize};

use super::loop_width::{both_ways, definition};
use super::passes::span;
use super::{Metric, Needs, NotMeasurable, Segment};
use crate::units::{self, Unit};

/// The straight line that a characteristic is compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Line {
    /// The line from which the largest deviation is smallest: independent linearity.
    #[default]
    Independent,
    /// The line through both ends: terminal-based linearity.
    Terminal,
    /// The line of least squares.
    LeastSquares,
}

/// Largest deviation of the mean of the rising and the falling characteristic from a straight line, as a share of the span of
/// the pressure. `line` says from which: the independent one by default.
///
/// # Source
/// IEC 61298-2 and ISA-51.1, linearity: independent, terminal-based. The line of least squares is in neither; older
/// reports use it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Linearity {
    /// The straight line.
    #[serde(default)]
    pub line: Line,
}

impl Metric for Linearity {
    fn id(&self) -> &'static str {
        "linearity"
    }
    fn unit(&self) -> &'static Unit {
        &units::RATIO
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        let id = match self.line {
            Line::Independent => "linearity.independent.v2",
            Line::Terminal => "linearity.terminal.v2",
            Line::LeastSquares => "linearity.least_squares.v2",
        };
        definition(id, segment, None)
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let found = both_ways(segment)?;
        let (up, down) = (found.curve(true), found.curve(false));
        // Twice the mean of both ways: a share of its span is the same.
        let both: Vec<f64> = up.iter().zip(&down).map(|(a, b)| a + b).collect();
        let (_, span_bar) = span(&both)?;
        let x = &found.current_a;
        let deviation = match self.line {
            Line::Independent => independent(x, &both),
            Line::Terminal => {
                let last = x.len() - 1;
                let slope = (both[last] - both[0]) / (x[last] - x[0]);
                largest(x, &both, slope, both[0] - slope * x[0])
            }
            Line::LeastSquares => {
                let (slope, offset) = least_squares(x, &both);
                largest(x, &both, slope, offset)
            }
        };
        Ok(deviation / span_bar)
    }
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

/// Slope and offset of the line of least squares.
pub fn least_squares(x: &[f64], y: &[f64]) -> (f64, f64) {
    let n = x.len() as f64;
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let sxy: f64 = x.iter().zip(y).map(|(x, y)| (x - mx) * (y - my)).sum();
    let sxx: f64 = x.iter().map(|x| (x - mx).powi(2)).sum();
    (sxy / sxx, my - sxy / sxx * mx)
}

fn largest(x: &[f64], y: &[f64], slope: f64, offset: f64) -> f64 {
    x.iter().zip(y).map(|(x, y)| (y - offset - slope * x).abs()).fold(0.0, f64::max)
}

/// Half the height of the narrowest strip that holds all points. Its height is a convex function of its slope.
fn independent(x: &[f64], y: &[f64]) -> f64 {
    let height = |slope: f64| {
        let (low, high) = x.iter().zip(y).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), (x, y)| {
            let d = y - slope * x;
            (l.min(d), h.max(d))
        });
        0.5 * (high - low)
    };
    let slopes = x.windows(2).zip(y.windows(2)).map(|(x, y)| (y[1] - y[0]) / (x[1] - x[0]));
    let (mut low, mut high) = slopes.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), s| (l.min(s), h.max(s)));
    for _ in 0..200 {
        let (left, right) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if height(left) < height(right) { high = right } else { low = left }
    }
    height(0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use super::super::loop_width::tests::triangle;
    use super::super::tests::Columns;
    use super::*;

    fn of(line: Line, columns: &Columns) -> f64 {
        Linearity { line }.compute(&columns.segment(0.0)).unwrap()
    }

    #[test]
    fn a_parabola_has_its_known_linearities() {
        // y = x^2 on a chord of width w: 1/4 w^2 from the chord, 1/8 w^2 from the best line, 1/6 w^2 from that of least squares.
        let columns = Columns::new(12001, |_| f64::NAN, triangle, |t| triangle(t).powi(2));
        let (width, span) = (0.96f64, 0.98f64.powi(2) - 0.02f64.powi(2));
        for (line, share) in [(Line::Terminal, 4.0), (Line::Independent, 8.0), (Line::LeastSquares, 6.0)] {
            let wanted = width * width / share / span;
            assert!((of(line, &columns) - wanted).abs() < 2e-3, "{line:?}: {} is not {wanted}", of(line, &columns));
        }
    }

    /// The same from another zero of both: the parabola 5 + (i - 0.5)^2 over 0.5 to 1.5 A; fine, so that the smoothing leaves nothing.
    #[test]
    fn linearity_does_not_depend_on_either_zero() {
        let current = |t: f64| 0.5 + triangle(t);
        let columns = Columns::new(12001, |_| f64::NAN, current, |t| 5.0 + triangle(t).powi(2));
        let (width, span) = (0.96f64, 0.98f64.powi(2) - 0.02f64.powi(2));
        for (line, share, near) in [(Line::Terminal, 4.0, 1e-6), (Line::Independent, 8.0, 1e-6), (Line::LeastSquares, 6.0, 4e-3)] {
            let wanted = width * width / share / span;
            assert!((of(line, &columns) - wanted).abs() < near, "{line:?}: {} is not {wanted}", of(line, &columns));
        }
        let (slope, offset) = least_squares(&[1.0, 2.0, 4.0], &[3.0, 5.0, 9.0]);
        assert!((slope - 2.0).abs() < 1e-12 && (offset - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_straight_line_is_straight() {
        let columns = Columns::new(12001, |_| f64::NAN, triangle, |t| 3.0 + 20.0 * triangle(t));
        for line in [Line::Terminal, Line::Independent, Line::LeastSquares] {
            assert!(of(line, &columns) < 1e-9, "{line:?}");
        }
    }
}
