//! Axes: the range of the data, round tick values, and the way from a value to a place.

/// Division of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Equal distances.
    Linear,
    /// Equal ratios; values that are not positive are gaps.
    Log,
}

/// A value of an axis with the text beside it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tick {
    /// Place along the axis, 0 to 1.
    pub place: f64,
    /// The printed value.
    pub text: String,
}

/// An axis with its range.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Axis {
    pub from: f64,
    pub to: f64,
    pub scale: Scale,
}

impl Axis {
    /// The axis over `values`, widened by `margin` of its length on both sides; a fixed `range` wins.
    pub fn over(values: impl Iterator<Item = f64>, range: Option<(f64, f64)>, scale: Scale, margin: f64) -> Self {
        if let Some((from, to)) = range
            && from.is_finite()
            && to.is_finite()
            && from < to
            && (scale == Scale::Linear || from > 0.0)
        {
            return Self { from, to, scale };
        }
        let usable = values.filter(|v| v.is_finite() && (scale == Scale::Linear || *v > 0.0));
        let (mut low, mut high) = usable.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if low > high {
            (low, high) = if scale == Scale::Log { (1.0, 10.0) } else { (0.0, 1.0) };
        }
        match scale {
            Scale::Log => {
                if low == high {
                    (low, high) = (low / 2.0, high * 2.0);
                }
                let widen = (high / low).powf(margin);
                Self { from: low / widen, to: high * widen, scale }
            }
            Scale::Linear => {
                if low == high {
                    let half = if low == 0.0 { 1.0 } else { low.abs() * 0.1 };
                    (low, high) = (low - half, high + half);
                }
                let widen = (high - low) * margin;
                Self { from: low - widen, to: high + widen, scale }
            }
        }
    }

    /// Place of `value` along the axis, 0 to 1 inside the range; NaN where it has none.
    pub fn place(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => (value - self.from) / (self.to - self.from),
            Scale::Log if value > 0.0 => (value / self.from).ln() / (self.to / self.from).ln(),
            Scale::Log => f64::NAN,
        }
    }

    /// Round values inside the range, about `wanted` of them.
    pub fn ticks(&self, wanted: usize) -> Vec<Tick> {
        let values = match self.scale {
            Scale::Linear => linear_ticks(self.from, self.to, wanted),
            Scale::Log => log_ticks(self.from, self.to),
        };
        values.into_iter().map(|(value, text)| Tick { place: self.place(value), text }).collect()
    }
}

fn linear_ticks(from: f64, to: f64, wanted: usize) -> Vec<(f64, String)> {
    let raw = (to - from) / wanted.max(1) as f64;
    if !(raw.is_finite() && raw > 0.0) {
        return Vec::new();
    }
    let exponent = raw.log10().floor() as i32;
    let power = 10f64.powi(exponent);
    let factor = [1.0, 2.0, 5.0, 10.0].into_iter().find(|f| f * power >= raw * 0.999).unwrap_or(10.0);
    let step = factor * power;
    let decimals = (-(step * 1.000_001).log10().floor()).clamp(0.0, 9.0) as usize;
    let first = (from / step - 1e-9).ceil() as i64;
    let last = (to / step + 1e-9).floor() as i64;
    (first..=last)
        .map(|n| {
            let value = n as f64 * step;
            (value, if n == 0 { "0".into() } else { format!("{value:.decimals$}") })
        })
        .collect()
}

fn log_ticks(from: f64, to: f64) -> Vec<(f64, String)> {
    let (first, last) = (from.log10().floor() as i32, to.log10().ceil() as i32);
    let decades = (to / from).log10();
    let factors: &[f64] = if decades > 2.5 { &[1.0] } else { &[1.0, 2.0, 5.0] };
    let every = ((last - first) / 8 + 1) as usize;
    let mut ticks = Vec::new();
    for exponent in (first..=last).step_by(every) {
        for factor in factors {
            let value = factor * 10f64.powi(exponent);
            if value >= from * 0.999_999 && value <= to * 1.000_001 {
                let text = if (-3..=4).contains(&exponent) {
                    format!("{value:.*}", (-exponent).max(0) as usize)
                } else {
                    format!("{factor:.0}e{exponent}")
                };
                ticks.push((value, text));
            }
        }
    }
    ticks
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(from: f64, to: f64, wanted: usize) -> Vec<String> {
        Axis { from, to, scale: Scale::Linear }.ticks(wanted).into_iter().map(|t| t.text).collect()
    }

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(texts(0.0, 24.0, 6), ["0", "5", "10", "15", "20"]);
        assert_eq!(texts(-0.13, 0.21, 4), ["-0.1", "0", "0.1", "0.2"].map(String::from));
        assert_eq!(texts(0.0, 800.0, 8), ["0", "100", "200", "300", "400", "500", "600", "700", "800"]);
        assert_eq!(texts(0.0, 0.2, 8), ["0", "0.05", "0.10", "0.15", "0.20"]);
    }

    #[test]
    fn a_constant_and_an_empty_series_have_a_range() {
        let constant = Axis::over([5.0, 5.0].into_iter(), None, Scale::Linear, 0.0);
        assert!(constant.from < 5.0 && constant.to > 5.0);
        let empty = Axis::over([f64::NAN].into_iter(), None, Scale::Log, 0.0);
        assert_eq!((empty.from, empty.to), (1.0, 10.0));
    }

    #[test]
    fn decades_of_a_log_axis() {
        let axis = Axis { from: 0.01, to: 1000.0, scale: Scale::Log };
        let texts: Vec<String> = axis.ticks(6).into_iter().map(|t| t.text).collect();
        assert_eq!(texts, ["0.01", "0.1", "1", "10", "100", "1000"]);
        assert!((axis.place(1.0) - 0.4).abs() < 1e-12);
        assert!(axis.place(0.0).is_nan());
    }
}
