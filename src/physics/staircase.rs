//! The staircase of a sticking spool in a residual: a sawtooth over a slowly rising or falling current, with the slip
//! as its period. Its phase is chance in every stretch.

use std::f64::consts::TAU;

use super::effect::Hint;
use super::monotone::monotone;

/// Periods that are looked for: the smallest [share of the current's span], the ratio of one to the next, their number.
const PERIODS: (f64, f64, usize) = (0.003, 1.01, 330);
/// How often a period must fit into a stretch.
const FEWEST_SLIPS: f64 = 2.5;
/// Share of a period over the median of its neighbourhood that counts as a staircase,
const PROMINENT: f64 = 4.0;
/// and how many periods on either side are the neighbourhood.
const NEIGHBOURS: usize = 25;
/// Share of the squared residual that it must carry.
const LEAST_SHARE: f64 = 0.15;
/// Fewest samples on slow stretches.
const FEWEST_SAMPLES: f64 = 300.0;

/// Samples of a residual that count as one.
const TAU_SAMPLES: f64 = 6.0;
/// Most that a signature may say [nats].
const MOST_NATS: f64 = 60.0;

/// A staircase that was found.
pub(super) struct Staircase {
    /// Distance of the steps [A].
    pub slip_a: f64,
    /// Gain of the log-likelihood by this period over that of its neighbours, the search paid [nats].
    pub nats: f64,
}

/// One stretch of a current that moves in one direction, with the residual there, its trend taken out.
struct Stretch<'a> {
    current_a: &'a [f64],
    residual_bar: Vec<f64>,
}

impl Stretch<'_> {
    fn travel_a(&self) -> f64 {
        (self.current_a[self.current_a.len() - 1] - self.current_a[0]).abs()
    }

    /// Sine and cosine parts of the residual at a period over the current; nothing where it cannot show.
    fn project(&self, period_a: f64) -> Option<(f64, f64)> {
        let travel = self.travel_a();
        if travel < FEWEST_SLIPS * period_a || travel / self.current_a.len() as f64 > 0.2 * period_a {
            return None;
        }
        let wave = TAU / period_a;
        let parts = self.residual_bar.iter().zip(self.current_a).map(|(e, i)| {
            let (sine, cosine) = (wave * i).sin_cos();
            (e * sine, e * cosine)
        });
        Some(parts.fold((0.0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1)))
    }
}

/// The strongest staircase in a residual.
pub(super) fn staircase(hint: &Hint<'_>) -> Option<Staircase> {
    let late = (hint.delay_s / hint.dt_s).round().max(0.0) as usize;
    let n = hint.residual_bar.len().saturating_sub(late);
    let current_a = &hint.current_a[..n];
    let (low, high) = current_a.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), i| (l.min(*i), h.max(*i)));
    let clip = 4.0 * hint.scale_bar;
    let stretches: Vec<Stretch<'_>> = monotone(current_a, 0.002 * (high - low), hint.dt_s)
        .into_iter()
        .map(|s| Stretch { residual_bar: detrended(&hint.residual_bar[s.start + late..s.end + late], clip), current_a: &current_a[s] })
        .collect();
    let lines: Vec<Line> = (0..PERIODS.2).map(|k| Line::of(&stretches, PERIODS.0 * (high - low) * PERIODS.1.powi(k as i32))).collect();
    // A sawtooth has overtones that may stand out more, but carry less.
    let (best, share, prominence) = (1..lines.len() - 1)
        .map(|k| (k, lines[k].share(), prominence(&lines, k)))
        .filter(|(_, share, prominence)| *share > LEAST_SHARE && *prominence > PROMINENT)
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    // What the neighbouring periods explain as well says nothing.
    let beyond = (share - share / prominence) / (1.0 - share / prominence);
    let nats = -0.5 * lines[best].samples / TAU_SAMPLES * (-beyond).ln_1p() - (PERIODS.2 as f64).ln();
    (nats > 0.0).then(|| Staircase { slip_a: lines[best].period_a, nats: nats.min(MOST_NATS) })
}

/// What a sine of one period explains in all stretches that can show it.
struct Line {
    period_a: f64,
    explained_bar2: f64,
    total_bar2: f64,
    samples: f64,
}

impl Line {
    fn of(stretches: &[Stretch<'_>], period_a: f64) -> Self {
        let mut line = Self { period_a, explained_bar2: 0.0, total_bar2: 0.0, samples: 0.0 };
        for (s, (sine, cosine)) in stretches.iter().filter_map(|s| Some((s, s.project(period_a)?))) {
            let n = s.current_a.len() as f64;
            line.explained_bar2 += 2.0 * (sine * sine + cosine * cosine) / n;
            line.total_bar2 += s.residual_bar.iter().map(|e| e * e).sum::<f64>();
            line.samples += n;
        }
        line
    }

    fn share(&self) -> f64 {
        if self.samples < FEWEST_SAMPLES { 0.0 } else { (self.explained_bar2 / self.total_bar2).min(0.99) }
    }
}

/// Share of a period over the median of its neighbourhood.
fn prominence(lines: &[Line], at: usize) -> f64 {
    let near = &lines[at.saturating_sub(NEIGHBOURS)..(at + NEIGHBOURS).min(lines.len())];
    let mut others: Vec<f64> = near.iter().map(Line::share).filter(|share| *share > 0.0).collect();
    if others.len() < NEIGHBOURS {
        return 0.0;
    }
    let middle = others.len() / 2;
    lines[at].share() / *others.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The residual less its straight line, its tails clipped; 0 where nothing was measured.
fn detrended(residual: &[f64], clip: f64) -> Vec<f64> {
    let centre = 0.5 * (residual.len() - 1) as f64;
    let finite = || residual.iter().enumerate().filter(|(_, e)| e.is_finite()).map(|(k, e)| (k as f64 - centre, e.clamp(-clip, clip)));
    let mean = finite().map(|(_, e)| e).sum::<f64>() / finite().count().max(1) as f64;
    let (product, square) = finite().fold((0.0, 1e-9), |(p, s), (x, e)| (p + x * (e - mean), s + x * x));
    let rest = |(k, e): (usize, &f64)| {
        if e.is_finite() { e.clamp(-clip, clip) - mean - product / square * (k as f64 - centre) } else { 0.0 }
    };
    residual.iter().enumerate().map(rest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};

    /// Ramps up and down between 0.2 A and 0.8 A in 12 s each, and the position of a spool that slips by `slip_a`.
    fn found(slip_a: f64, noise_bar: f64) -> Option<Staircase> {
        let current_a: Vec<f64> = (0..9600).map(|k| 0.2 + 0.6 * (1.0 - (f64::from(k % 2400) / 1200.0 - 1.0).abs())).collect();
        let mut random = rand_pcg::Pcg64::seed_from_u64(5);
        let normal = Normal::new(0.0, noise_bar).unwrap();
        let mut at_a = current_a[0];
        let residual_bar: Vec<f64> = current_a
            .iter()
            .map(|i| {
                let away = i - at_a;
                if slip_a > 0.0 && away.abs() > 1.3 * slip_a {
                    at_a += slip_a.copysign(away);
                }
                normal.sample(&mut random) + if slip_a > 0.0 { 40.0 * (at_a - i) } else { 0.0 }
            })
            .collect();
        let pressure_bar = vec![0.0; current_a.len()];
        staircase(&Hint {
            start_s: 0.0,
            dt_s: 0.01,
            current_a: &current_a,
            delay_s: 0.0,
            residual_bar: &residual_bar,
            parts: &[],
            pressure_bar: &pressure_bar,
            scale_bar: 0.3,
            recalibrated: (0.0, 0.0),
        })
    }

    #[test]
    fn the_slip_of_a_sticking_spool_is_the_period_of_its_staircase() {
        for slip_a in [0.006, 0.0125, 0.02] {
            let stair = found(slip_a, 0.05).unwrap_or_else(|| panic!("{slip_a} A is not found"));
            assert!((stair.slip_a / slip_a - 1.0).abs() < 0.02, "{} for {slip_a}", stair.slip_a);
            assert!(stair.nats > 20.0);
        }
    }

    #[test]
    fn noise_has_no_staircase() {
        assert!(found(0.0, 0.05).is_none());
    }
}
