//! What the field looks for in the signals themselves, each told beside the joint identification.
//!
//! The cross-correlation of output and process value of a self-regulating process is odd under stiction and even under an
//! oscillation that comes from elsewhere (Horch, Control Eng. Practice 7 (1999) 1221). The half waves are triangles rather than
//! sines: of the output where the process regulates itself, of the process value where it integrates (He, Wang, Pottmann and Qin,
//! Ind. Eng. Chem. Res. 46 (2007) 4549). The ellipse of process value over output is as wide as the stiction appears
//! (Choudhury, Thornhill and Shah, Control Eng. Practice 13 (2005) 641).

use super::regression::{ALL, FIRST, Sums};

/// Index of a half wave above which it is a triangle and below which a sine (He et al. 2007).
const TRIANGLE: f64 = 0.6;
const SINE: f64 = 0.4;
/// Share of the cross-correlation that is odd, below which it is even and above which odd (Horch 1999).
const EVEN: f64 = 1.0 / 3.0;
const ODD: f64 = 2.0 / 3.0;
/// Fewest samples of a half wave.
const SHORTEST: usize = 6;
/// Fewest half waves that speak.
const FEWEST: usize = 3;

/// A symptom and what it speaks for; `None` where it is silent.
#[derive(Debug, Clone, PartialEq)]
pub struct Symptom {
    /// What was looked at.
    pub method: &'static str,
    /// Whether it speaks for stiction.
    pub stiction: Option<bool>,
    /// The figure behind it.
    pub figure: f64,
}

impl Symptom {
    /// It speaks against stiction below the first figure, for it above the second.
    fn of(method: &'static str, figure: f64, (against, speaks_for): (f64, f64)) -> Self {
        let stiction = (figure > speaks_for).then_some(true).or((figure < against).then_some(false));
        Self { method, stiction, figure }
    }
}

/// All symptoms. `period` of the oscillation [samples].
pub fn symptoms(value: &[f64], output: &[f64], period: Option<f64>) -> Vec<Symptom> {
    let mut out = Vec::new();
    if let Some(period) = period {
        let figure = oddness(value, output, period);
        out.extend(figure.map(|figure| Symptom::of("cross-correlation (Horch)", figure, (EVEN, ODD))));
    }
    let figure = [triangle(output, period), triangle(value, period)].into_iter().flatten().reduce(f64::max);
    out.extend(figure.map(|figure| Symptom::of("half waves (He)", figure, (SINE, TRIANGLE))));
    out
}

/// How odd the cross-correlation is about lag zero: 1 odd, 0 even, from its values about zero over half a period either way.
fn oddness(value: &[f64], output: &[f64], period: f64) -> Option<f64> {
    let reach = (0.5 * period).round() as i64;
    if reach < 3 || 4 * reach as usize > value.len() {
        return None;
    }
    let n = value.len() as i64;
    let at = |lag: i64| {
        let sum = (0..n).filter(|t| (0..n).contains(&(t + lag))).map(|t| value[(t + lag) as usize] * output[t as usize]);
        sum.filter(|v| v.is_finite()).sum::<f64>()
    };
    let (mut odd, mut even) = (0.0, at(0).powi(2));
    for lag in 1..=reach {
        let (a, b) = (at(lag), at(-lag));
        odd += 0.5 * (a - b).powi(2);
        even += 0.5 * (a + b).powi(2);
    }
    (odd + even > 0.0).then_some(odd / (odd + even))
}

/// How much better triangles fit the half waves of a signal than half sines: 1 triangles, 0 sines.
fn triangle(signal: &[f64], period: Option<f64>) -> Option<f64> {
    // The slow part is taken out by a mean over a period.
    let wide = period.map_or(signal.len(), |p| p.round() as usize).clamp(2, signal.len());
    let detrended: Vec<f64> = (0..signal.len())
        .map(|t| {
            let (from, to) = (t.saturating_sub(wide / 2), (t + wide / 2 + 1).min(signal.len()));
            let finite = signal[from..to].iter().filter(|v| v.is_finite());
            signal[t] - finite.clone().sum::<f64>() / finite.count().max(1) as f64
        })
        .collect();
    let turns: Vec<usize> = (1..detrended.len()).filter(|t| detrended[t - 1] * detrended[*t] < 0.0).collect();
    let (mut sine, mut tri, mut waves) = (0.0, 0.0, 0);
    for w in turns.windows(2).filter(|w| w[1] - w[0] >= SHORTEST) {
        let wave = &detrended[w[0]..w[1]];
        let fit = |form: &dyn Fn(f64) -> f64| {
            let n = wave.len() as f64;
            let shape: Vec<f64> = (0..wave.len()).map(|k| form((k as f64 + 0.5) / n)).collect();
            let gain = shape.iter().zip(wave).map(|(s, v)| s * v).sum::<f64>() / shape.iter().map(|s| s * s).sum::<f64>();
            shape.iter().zip(wave).map(|(s, v)| (v - gain * s).powi(2)).sum::<f64>()
        };
        sine += fit(&|x| (std::f64::consts::PI * x).sin());
        tri += (2..=8)
            .map(|k| f64::from(k) / 10.0)
            .map(|apex| fit(&|x| if x < apex { x / apex } else { (1.0 - x) / (1.0 - apex) }))
            .fold(f64::INFINITY, f64::min);
        waves += 1;
    }
    (waves >= FEWEST && (sine + tri).is_finite()).then(|| sine / (sine + tri).max(f64::MIN_POSITIVE))
}

/// Width of the ellipse of process value over output, at its middle [unit of the output]; `None` where the fit is no ellipse.
pub fn apparent(value: &[f64], output: &[f64]) -> Option<f64> {
    if value.len() <= FIRST {
        return None;
    }
    // a p^2 + b p u + c u^2 + d p + e u = 1, by least squares.
    let ones = vec![1.0; value.len()];
    let sums = Sums::over(&ones, 5, |t, row| {
        let (p, u) = (value[t], output[t]);
        row.extend([p * p, p * u, u * u, p, u]);
    });
    let theta = sums.solve(&ALL)?.theta;
    let (a, b, c, d, e) = (theta[0], theta[1], theta[2], theta[3], theta[4]);
    let determinant = 4.0 * a * c - b * b;
    if determinant <= 0.0 {
        return None;
    }
    let (p, u) = ((b * e - 2.0 * c * d) / determinant, (b * d - 2.0 * a * e) / determinant);
    let level = 1.0 + a * p * p + b * p * u + c * u * u;
    let width = 2.0 * (level / c).sqrt();
    width.is_finite().then_some(width)
}
