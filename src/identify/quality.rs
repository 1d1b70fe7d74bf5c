//! How good the model is: the share of the variance that it explains, and whether what it leaves is noise.

use super::fit::{Fit, Problem};
use super::select::correlation_time;
use super::survey::{Survey, play};

/// A root mean square up to this many times the noise is that of the noise: beyond, the form of the model costs more than
/// a fifth of what the sensor does.
const NOISE_RATIO: f64 = 1.2;
/// Share of the pressure's range below which a misfit is of no account, whatever the noise [-]: a thousandth, a tenth of the
/// usual accuracy class of a pressure sensor.
const MATERIAL: f64 = 1e-3;
/// Correlation time of white residuals is one sample; beyond this their course is seen.
const WHITE_SAMPLES: f64 = 3.0;
/// Residuals depend on what they are sorted by where the means of the bins explain this share of their variance.
const DEPENDENT: f64 = 0.1;
/// Bins of the current, of the pressure and of the rate of the current.
const BINS: usize = 12;

/// What the residuals say about the model.
#[derive(Debug, Clone, PartialEq)]
pub struct Quality {
    /// Share of the variance of the pressure that the model explains [%].
    pub fit_percent: f64,
    /// Root mean square of the residual over the noise of the sensor; infinite without noise.
    pub noise_ratio: f64,
    /// Correlation time of the residuals [samples]: 1 for white ones.
    pub correlation_samples: f64,
    /// Share of the variance of the residuals that the current explains, separately for both directions [-].
    pub by_current: f64,
    /// Share of the variance of the residuals that the rate of the current explains [-].
    pub by_rate: f64,
    /// Whether the form of the model fits: nothing material is left beyond noise.
    pub adequate: bool,
    /// Why, in words.
    pub why: String,
}

/// Judges the residuals of a fit over the samples that were fitted.
pub(super) fn quality(problem: &Problem<'_>, survey: &Survey, fit: &Fit, weights: &[f64], limit_bar: f64, delayed_a: &[f64]) -> Quality {
    let used: Vec<usize> = (0..weights.len()).filter(|k| weights[*k] > 0.0).collect();
    let measured: Vec<f64> = problem.segments.iter().flat_map(|s| s.pressure_bar.iter().copied()).collect();
    let variance = |of: &dyn Fn(usize) -> f64| {
        let (sum, squares) = used.iter().fold((0.0, 0.0), |(s, q), k| (s + of(*k), q + of(*k) * of(*k)));
        let n = used.len().max(1) as f64;
        ((squares - sum * sum / n) / n, squares / n)
    };
    let (total, _) = variance(&|k| measured[k]);
    let (_, left) = variance(&|k| fit.residual_bar[k]);
    let rms_bar = left.sqrt();
    let fit_percent = if total > 0.0 { 100.0 * (1.0 - left / total) } else { 0.0 };
    let noise_ratio = if survey.noise_bar > 0.0 { rms_bar / survey.noise_bar } else { f64::INFINITY };
    let correlation_samples = correlation_time(problem, &fit.residual_bar, weights, limit_bar);
    let (mut by_current, mut by_rate) = (Bins::default(), Bins::default());
    let (low, high) = survey.covered_a;
    let fastest = 3.0 * survey.rate_a_per_s.max(f64::MIN_POSITIVE);
    for (n, s) in problem.segments.iter().enumerate() {
        let range = problem.range(n);
        let state = play(&delayed_a[range.clone()], 0.02 * (high - low));
        for (j, at) in range.enumerate().skip(1).filter(|(_, at)| weights[*at] > 0.0) {
            let place = |x: f64, from: f64, to: f64| (((x - from) / (to - from)).clamp(0.0, 0.999) * BINS as f64) as usize;
            let residual = fit.residual_bar[at].clamp(-limit_bar, limit_bar);
            by_current.add(2 * place(delayed_a[at], low, high) + usize::from(state[j] < 0.0), residual);
            by_rate.add(place((delayed_a[at] - delayed_a[at - 1]) / s.step_s, -fastest, fastest), residual);
        }
    }
    let (by_current, by_rate) = (by_current.share(), by_rate.share());
    let small = rms_bar <= MATERIAL * survey.span_bar;
    let adequate = fit_percent > 0.0 && (noise_ratio <= NOISE_RATIO || small);
    let why = why(
        &Quality { fit_percent, noise_ratio, correlation_samples, by_current, by_rate, adequate, why: String::new() },
        rms_bar,
        survey.noise_bar,
    );
    Quality { fit_percent, noise_ratio, correlation_samples, by_current, by_rate, adequate, why }
}

fn why(q: &Quality, rms_bar: f64, noise_bar: f64) -> String {
    let white = if q.correlation_samples <= WHITE_SAMPLES {
        "look like white noise".to_string()
    } else {
        format!("hang together over {:.0} samples", q.correlation_samples)
    };
    let on: Vec<&str> = [(q.by_current, "the current and its direction"), (q.by_rate, "the rate of the current")]
        .into_iter()
        .filter(|(share, _)| *share > DEPENDENT)
        .map(|(_, name)| name)
        .collect();
    let depend = if on.is_empty() { "do not depend on the input".to_string() } else { format!("depend on {}", on.join(" and on ")) };
    let head = if q.adequate {
        format!("the model leaves {rms_bar:.4} bar RMSE where the sensor's noise is {noise_bar:.4} bar")
    } else if q.fit_percent <= 0.0 {
        format!("the model explains nothing of the pressure: {rms_bar:.3} bar RMSE")
    } else {
        format!("this model does not fit: {rms_bar:.4} bar RMSE, {:.1} times the noise of {noise_bar:.4} bar", q.noise_ratio)
    };
    let scatter = q.fit_percent > 0.0 && on.is_empty() && q.correlation_samples <= WHITE_SAMPLES;
    let tail = match (q.adequate, scatter) {
        (true, _) => "",
        (false, true) => ": no course is left that a model could follow; the pressure scatters more than from one reading to the next",
        (false, false) => "; `hil diagnose` says what it lacks",
    };
    format!("{head}; the residuals {white} and {depend}{tail}")
}

/// Means of values in bins.
#[derive(Default)]
struct Bins {
    sums: [(f64, f64); 2 * BINS],
    squares: f64,
    count: f64,
}

impl Bins {
    fn add(&mut self, bin: usize, value: f64) {
        let (sum, count) = &mut self.sums[bin];
        (*sum, *count) = (*sum + value, *count + 1.0);
        self.squares += value * value;
        self.count += 1.0;
    }

    /// Share of the mean square that the means of the bins explain, less what they explain of noise.
    fn share(&self) -> f64 {
        let explained: f64 = self.sums.iter().filter(|(_, n)| *n > 0.0).map(|(s, n)| s * s / n).sum();
        let bins = self.sums.iter().filter(|(_, n)| *n > 0.0).count() as f64;
        if self.squares <= 0.0 { 0.0 } else { (explained / self.squares - bins / self.count.max(1.0)).max(0.0) }
    }
}
