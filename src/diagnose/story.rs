//! What the page of a diagnosis shows beyond the diagnosis itself: the error over time, operating point and
//! frequency, before and after, and the signature of what was found.

use super::diagnosis::{Curves, Diagnosed};
use super::evidence::Evidence;
use super::locate::{Variable, bins, variables};
use super::signature::{Signature, label, signatures};
use crate::course::Run;

/// Slices that a run is cut into.
const SLICES: usize = 60;
/// Cells of a strip.
const CELLS: usize = 8;
/// Bands of the spectrum per decade.
const BANDS_PER_DECADE: f64 = 12.0;

/// Everything that is drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct Story {
    /// The runs, the one with the largest error first.
    pub runs: Vec<RunStory>,
    /// The error over the operating point, one strip per variable.
    pub strips: Vec<Strip>,
    /// Where the error changes most; `None` where nothing changes.
    pub signature: Option<Signature>,
    /// What is left, over the variable on which it depends most; `None` where nothing is left.
    pub rest: Option<Signature>,
    /// Frequency [Hz], amplitude density of the error as given, with the effects [bar/sqrt(Hz)].
    pub spectrum: Vec<(f64, f64, f64)>,
    /// What white sensor noise has in that spectrum [bar/sqrt(Hz)].
    pub spectrum_noise: f64,
}

/// One run.
#[derive(Debug, Clone, PartialEq)]
pub struct RunStory {
    /// Its name.
    pub name: Option<String>,
    /// Where it lies in the columns of the curves.
    pub samples: std::ops::Range<usize>,
    /// Its error over time.
    pub slices: Vec<Slice>,
    /// The stretch with the largest error: begin and end [s].
    pub worst_s: (f64, f64),
    /// Sum of squares of the error as given [bar^2].
    pub squares_bar2: f64,
}

/// A stretch of time.
#[derive(Debug, Clone, PartialEq)]
pub struct Slice {
    /// Begin [s].
    pub from_s: f64,
    /// End [s].
    pub to_s: f64,
    /// RMS error of the model as given [bar]; NaN where nothing was measured.
    pub base_bar: f64,
    /// RMS error with the effects [bar].
    pub augmented_bar: f64,
}

/// The error over one variable.
#[derive(Debug, Clone, PartialEq)]
pub struct Strip {
    /// The variable with its unit.
    pub label: String,
    /// Its ranges.
    pub cells: Vec<Cell>,
}

/// A range of one variable.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// Begin.
    pub from: f64,
    /// End.
    pub to: f64,
    /// RMS error of the model as given [bar].
    pub base_bar: f64,
    /// RMS error with the effects [bar].
    pub augmented_bar: f64,
}

/// The story of a diagnosis.
pub fn story(found: &Diagnosed) -> Story {
    let curves = &found.curves;
    let noise_bar = found.diagnosis.rmse_bar.noise_floor;
    let error = |model: &[f64]| curves.measured_bar.iter().zip(model).map(|(y, p)| y - p).collect::<Vec<f64>>();
    let (base, augmented) = (error(&curves.base_bar), error(&curves.augmented_bar));
    let grids = grids(curves);
    let evidence = Evidence::new(grids, noise_bar, crate::course::Input::default());
    let mut all = variables(&evidence, &curves.base_bar);
    let (rate, direction) = movement(&evidence, &curves.base_bar);
    let strips = all.iter().map(|v| strip(v, &base, &augmented)).filter(|s| s.cells.len() > 1).collect();
    all.push(Variable { name: "pressure_rate_bar_per_s", values: rate });
    let changed = found.diagnosis.adds();
    let signature = if changed {
        // A change within a small part of the noise is no signature.
        let visible = |s: &Signature| s.explained_bar2 > (0.1 * noise_bar).powi(2);
        signatures(&all, &direction, &base, &augmented).into_iter().next().filter(visible)
    } else {
        None
    };
    let rest = found.diagnosis.unexplained.as_ref().and_then(|rest| {
        let nothing = vec![0.0; augmented.len()];
        let dependent = |s: &Signature| s.explained_bar2 > 0.05 * rest.rms_bar.powi(2);
        signatures(&all, &direction, &augmented, &nothing).into_iter().next().filter(dependent)
    });
    let mut runs: Vec<RunStory> = ranges(curves)
        .into_iter()
        .zip(&evidence.grids)
        .map(|(samples, grid)| run(grid, samples.clone(), &base[samples.clone()], &augmented[samples]))
        .collect();
    runs.sort_by(|a, b| b.squares_bar2.total_cmp(&a.squares_bar2));
    let longest = runs.iter().zip(0..).max_by_key(|(r, _)| r.samples.len()).map(|(r, _)| r.samples.clone());
    let (spectrum, spectrum_noise) = match (longest, evidence.grids.first()) {
        (Some(r), Some(grid)) => (spectrum(&base[r.clone()], &augmented[r], grid.dt_s), noise_bar * (2.0 * grid.dt_s).sqrt()),
        _ => (Vec::new(), 0.0),
    };
    Story { runs, strips, signature, rest, spectrum, spectrum_noise }
}

fn ranges(curves: &Curves) -> Vec<std::ops::Range<usize>> {
    let ends = curves.runs.iter().skip(1).map(|r| r.0).chain([curves.time_s.len()]);
    curves.runs.iter().zip(ends).map(|(r, end)| r.0..end).filter(|r| !r.is_empty()).collect()
}

fn grids(curves: &Curves) -> Vec<Run> {
    let names = curves.runs.iter().map(|r| r.1.clone());
    ranges(curves)
        .into_iter()
        .zip(names)
        .map(|(r, name)| {
            let dt_s = (curves.time_s[r.end - 1] - curves.time_s[r.start]) / (r.len() - 1).max(1) as f64;
            Run::even(name, curves.time_s[r.start], dt_s, curves.current_a[r.clone()].to_vec(), curves.measured_bar[r].to_vec())
        })
        .collect()
}

/// Rate of the simulated pressure [bar/s], and the sign of the last movement of the current (0 before the first).
fn movement(evidence: &Evidence, simulated_bar: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (mut rate, mut direction) = (Vec::new(), Vec::new());
    let mut begin = 0;
    for grid in &evidence.grids {
        let n = grid.current_a.len();
        let reach = ((0.03 / grid.dt_s) as usize).max(1);
        let pressure = &simulated_bar[begin..begin + n];
        let mut sign = 0.0;
        for k in 0..n {
            let (a, b) = (k.saturating_sub(reach), (k + reach).min(n - 1));
            rate.push((pressure[b] - pressure[a]) / ((b - a).max(1) as f64 * grid.dt_s));
            let behind = k.saturating_sub(reach);
            let moved = grid.current_a[k] - grid.current_a[behind];
            // Two milliamperes per second are rest, as for the operating point.
            if moved.abs() > 2e-3 * (k - behind).max(1) as f64 * grid.dt_s {
                sign = moved.signum();
            }
            direction.push(sign);
        }
        begin += n;
    }
    (rate, direction)
}

fn rms_of(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.filter(|v| v.is_finite()).fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0));
    if n > 0.0 { f64::sqrt(sum / n) } else { f64::NAN }
}

fn strip(variable: &Variable, base: &[f64], augmented: &[f64]) -> Strip {
    let cells = bins(&variable.values, base, CELLS)
        .into_iter()
        .filter(|(from, to, _)| to > from)
        .map(|(from, to, members)| Cell {
            from,
            to,
            base_bar: rms_of(members.iter().map(|k| base[*k])),
            augmented_bar: rms_of(members.iter().map(|k| augmented[*k])),
        })
        .collect();
    Strip { label: label(variable.name), cells }
}

fn run(grid: &Run, samples: std::ops::Range<usize>, base: &[f64], augmented: &[f64]) -> RunStory {
    let n = samples.len();
    let per = n.div_ceil(SLICES.min(n / 10 + 1));
    let slices: Vec<Slice> = (0..n)
        .step_by(per)
        .map(|from| {
            let to = (from + per).min(n);
            Slice {
                from_s: grid.time_s(from),
                to_s: grid.time_s(to),
                base_bar: rms_of(base[from..to].iter().copied()),
                augmented_bar: rms_of(augmented[from..to].iter().copied()),
            }
        })
        .collect();
    let worst =
        (0..slices.len()).filter(|k| slices[*k].base_bar.is_finite()).max_by(|a, b| slices[*a].base_bar.total_cmp(&slices[*b].base_bar));
    let begin = grid.time_s(0);
    let end = grid.time_s(n - 1);
    // The worst slice with its neighbours, and at least two seconds.
    let worst_s = worst.map_or((begin, end), |k| {
        let middle = 0.5 * (slices[k].from_s + slices[k].to_s);
        let half = (1.5 * (slices[k].to_s - slices[k].from_s)).clamp(1.0, 4.0);
        ((middle - half).max(begin), (middle + half).min(end))
    });
    let squares_bar2 = base.iter().filter(|e| e.is_finite()).map(|e| e * e).sum();
    RunStory { name: grid.name.clone(), samples, slices, worst_s, squares_bar2 }
}

/// Amplitude density of two errors in bands of equal ratio.
fn spectrum(base: &[f64], augmented: &[f64], dt_s: f64) -> Vec<(f64, f64, f64)> {
    let n = base.len();
    let transform = |error: &[f64]| {
        let used: Vec<f64> = error.iter().copied().filter(|e| e.is_finite()).collect();
        let mean = used.iter().sum::<f64>() / used.len().max(1) as f64;
        let window = |k: usize| (std::f64::consts::PI * k as f64 / n as f64).sin();
        let mut input: Vec<f64> = error.iter().enumerate().map(|(k, e)| if e.is_finite() { (e - mean) * window(k) } else { 0.0 }).collect();
        let plan = realfft::RealFftPlanner::<f64>::new().plan_fft_forward(n);
        let mut out = plan.make_output_vec();
        // The window halves the power; one side of the spectrum doubles it.
        plan.process(&mut input, &mut out).ok().map(|()| out.iter().map(|c| 4.0 * c.norm_sqr() * dt_s / n as f64).collect::<Vec<f64>>())
    };
    let (Some(before), Some(after)) = (transform(base), transform(augmented)) else { return Vec::new() };
    let step_hz = 1.0 / (n as f64 * dt_s);
    let mut out = Vec::new();
    let mut from = 1;
    while from < before.len() {
        let to = ((from as f64 * 10f64.powf(1.0 / BANDS_PER_DECADE)).ceil() as usize).max(from + 1).min(before.len());
        let mean = |p: &[f64]| (p[from..to].iter().sum::<f64>() / (to - from) as f64).sqrt();
        out.push((step_hz * 0.5 * (from + to - 1) as f64, mean(&before), mean(&after)));
        from = to;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_noise_has_its_density_and_a_tone_its_place() {
        use rand::{RngExt, SeedableRng};
        let mut random = rand_pcg::Pcg64::seed_from_u64(5);
        let noise: Vec<f64> = (0..8000).map(|_| 0.1 * 12f64.sqrt() * (random.random::<f64>() - 0.5)).collect();
        let tone: Vec<f64> =
            noise.iter().enumerate().map(|(k, e)| e + (2.0 * std::f64::consts::PI * 5.0 * 0.01 * k as f64).sin()).collect();
        let found = spectrum(&tone, &noise, 0.01);
        let expected = 0.1 * 0.02f64.sqrt();
        let high: Vec<f64> = found.iter().filter(|f| f.0 > 10.0).map(|f| f.2).collect();
        let mean = high.iter().sum::<f64>() / high.len() as f64;
        assert!((mean / expected - 1.0).abs() < 0.1, "{mean} {expected}");
        let peak = found.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        assert!((peak.0 / 5.0 - 1.0).abs() < 0.12, "{peak:?}");
    }
}
