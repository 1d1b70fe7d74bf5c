//! Change of a metric over the batch: a straight line over the order of the test.

use serde::{Deserialize, Serialize};

use super::distribution::{t_quantile, t_two_sided};
use super::{CONFIDENCE, Finding, Interval};

/// A least-squares line over the place in the batch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Drift {
    /// Change over the whole batch, first to last valve, in the metric's unit.
    pub change: f64,
    /// Its interval.
    pub change_interval: Interval,
    /// Probability of so large a slope if there were none.
    pub p_value: f64,
    /// Whether a drift is claimed: the 1 % level.
    pub significant: bool,
}

/// The drift of at least ten values.
pub fn drift(values: &[f64], positions: &[usize]) -> Finding<Drift> {
    if values.len() < 10 || values.len() != positions.len() {
        return Finding::absent(format!("{} value(s); a drift needs 10", values.len()));
    }
    let x: Vec<f64> = positions.iter().map(|&p| p as f64).collect();
    let span = x[x.len() - 1] - x[0];
    let line = line(&x, values);
    if line.slope_error == 0.0 {
        return Finding::absent("the values lie on a line without scatter");
    }
    let freedom = values.len() as f64 - 2.0;
    let half = t_quantile(0.5 + CONFIDENCE / 2.0, freedom) * line.slope_error;
    let p_value = t_two_sided(line.slope / line.slope_error, freedom);
    Finding::of(Drift {
        change: line.slope * span,
        change_interval: Interval { low: (line.slope - half) * span, high: (line.slope + half) * span },
        p_value,
        significant: p_value < 0.01,
    })
}

struct Line {
    slope: f64,
    slope_error: f64,
    #[cfg(test)]
    intercept: f64,
}

fn line(x: &[f64], y: &[f64]) -> Line {
    let n = x.len() as f64;
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let sxx: f64 = x.iter().map(|x| (x - mx).powi(2)).sum();
    let sxy: f64 = x.iter().zip(y).map(|(x, y)| (x - mx) * (y - my)).sum();
    let slope = sxy / sxx;
    let rest: f64 = x.iter().zip(y).map(|(x, y)| (y - my - slope * (x - mx)).powi(2)).sum();
    Line {
        slope,
        slope_error: (rest / (n - 2.0) / sxx).sqrt(),
        #[cfg(test)]
        intercept: my - slope * mx,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// NIST StRD "Norris" (calibration of ozone monitors), <https://www.itl.nist.gov/div898/strd/lls/data/Norris.shtml>:
    /// certified slope, its standard deviation, and intercept.
    #[test]
    fn certified_regression() {
        let y = [
            0.1, 338.8, 118.1, 888.0, 9.2, 228.1, 668.5, 998.5, 449.1, 778.9, 559.2, 0.3, 0.1, 778.1, 668.8, 339.3, 448.9, 10.8, 557.7,
            228.3, 998.0, 888.8, 119.6, 0.3, 0.6, 557.6, 339.3, 888.0, 998.5, 778.9, 10.2, 117.6, 228.9, 668.4, 449.2, 0.2,
        ];
        let x = [
            0.2, 337.4, 118.2, 884.6, 10.1, 226.5, 666.3, 996.3, 448.6, 777.0, 558.2, 0.4, 0.6, 775.5, 666.9, 338.0, 447.5, 11.6, 556.0,
            228.1, 995.8, 887.6, 120.2, 0.3, 0.3, 556.8, 339.1, 887.2, 999.0, 779.0, 11.1, 118.3, 229.2, 669.1, 448.9, 0.5,
        ];
        let l = line(&x, &y);
        assert!((l.slope - 1.002_116_818_020_45).abs() < 1e-12, "{}", l.slope);
        assert!((l.slope_error - 0.429_796_848_199_937e-3).abs() < 1e-14, "{}", l.slope_error);
        assert!((l.intercept + 0.262_323_073_774_029).abs() < 1e-10, "{}", l.intercept);
    }

    #[test]
    fn a_slope_is_claimed_and_scatter_is_not() {
        let scatter = [0.3, -0.1, -0.4, 0.2, 0.1, -0.2, 0.4, -0.3, 0.0, 0.1, -0.2, 0.2];
        let positions: Vec<usize> = (0..12).collect();
        assert!(!drift(&scatter, &positions).value.unwrap().significant);
        let rising: Vec<f64> = scatter.iter().enumerate().map(|(i, s)| s + i as f64).collect();
        let d = drift(&rising, &positions).value.unwrap();
        assert!(d.significant && (d.change - 11.0).abs() < 1.0, "{d:?}");
        assert!(drift(&scatter[..9], &positions[..9]).value.is_none());
    }

    /// Ten values at every second place from 3 on, on 0.05 a place with 0.3 up and down in turn. By hand: the slope is 0.05 - 1/110, its
    /// standard deviation 1/55, so t = 2.25 with eight degrees of freedom; the table's t for 97.5 % is 2.306.
    #[test]
    fn change_interval_and_probability_of_ten_values() {
        let positions: Vec<usize> = (0..10).map(|k| 3 + 2 * k).collect();
        let values: Vec<f64> = (0..10).map(|k| 0.05 * positions[k] as f64 + if k % 2 == 0 { 0.3 } else { -0.3 }).collect();
        let d = drift(&values, &positions).value.unwrap();
        assert!((d.change - 18.0 * (0.05 - 1.0 / 110.0)).abs() < 1e-12, "{d:?}");
        let half = 18.0 * 2.306 / 55.0;
        assert!((d.change_interval.low - (d.change - half)).abs() < 1e-3 && (d.change_interval.high - (d.change + half)).abs() < 1e-3);
        assert!((d.p_value - 0.054_567).abs() < 1e-6 && !d.significant, "{d:?}");
    }
}
