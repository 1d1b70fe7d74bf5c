//! A tone whose pace wanders, as a pump's does: no sine stays in step with it, and yet its power stands in one narrow band of the
//! spectrum, in holds and in ramps alike.
//!
//! The spectrum is averaged over overlapping segments, phases and all forgotten (Welch, IEEE Trans. Audio Electroacoust. 15 (1967)
//! 70); how far a band stands above its neighbourhood is told by the likelihood of averaged periodograms (Whittle, Ark. Mat. 2 (1953)
//! 423).

use realfft::RealFftPlanner;

use super::effect::{Scatter, ScatterFinding};

/// Length of a segment [s]: a tone that wanders has the same pace for about so long.
const SEGMENT_S: f64 = 4.0;
/// Shortest segment [samples], and the fewest of them.
const SHORTEST: usize = 64;
const FEWEST: usize = 8;
/// Half of the width of the band, as a share of its middle, and at least in bins: two are the window's.
const HALF: f64 = 0.06;
const HALF_BINS: usize = 2;
/// The neighbourhood reaches from the middle by this factor to either side.
const AROUND: f64 = 1.6;
/// Bins below which slow courses are not told from a tone.
const LOWEST: usize = 6;
/// How far the band stands above its neighbourhood at least: a hump of a few times it is colour of the noise.
const STANDS_OUT: f64 = 5.0;
/// Least gain of likelihood [nats]: some hundred places were looked at, and twenty to one is three nats.
const LEAST_NATS: f64 = 20.0;
/// Least share of the residual's variance: what leaves more than half of it is no cause.
const SHARE: f64 = 0.5;
/// What the current moves in the band may be this share of what is found there: beyond it, it is an answer to the current.
const MOVED: f64 = 0.5;
/// Harmonics that a tone may have beside itself, at most this one.
const HARMONICS: f64 = 3.0;
/// In the calmest third of the time the tone keeps at least this share of its power; what rings after movements does not.
const CALM: f64 = 0.4;
/// The pressure is calm by how little it has moved over so many periods of the tone.
const PERIODS: f64 = 6.0;

/// The tone in what is left of a recording, where there is one.
pub(super) fn wandering_tone(of: &Scatter<'_>) -> Option<ScatterFinding> {
    let residual: Vec<f64> =
        of.measured_bar.iter().zip(of.simulated_bar).map(|(y, p)| y - p).map(|e| if e.is_finite() { e } else { 0.0 }).collect();
    let samples = residual.len();
    let wanted = ((SEGMENT_S / of.dt_s) as usize).max(SHORTEST).next_power_of_two();
    let segment = wanted.min((samples / FEWEST).checked_ilog2().map_or(0, |log| 1 << log));
    if segment < SHORTEST {
        return None;
    }
    let (left, moved) = (spectrum(&residual, segment), spectrum(of.simulated_bar, segment));
    let bands = (LOWEST..left.len()).filter_map(|middle| Band::about(middle, &left));
    let band = bands.max_by(|a, b| a.power.total_cmp(&b.power))?;
    let hz = |bin: f64| bin / (segment as f64 * of.dt_s);
    let variance = residual.iter().map(|e| e * e).sum::<f64>() / samples as f64;
    let nats = band.nats(&left) * samples as f64 / segment as f64;
    let follows = band.beyond(&moved) > MOVED * band.power;
    if band.stands_out < STANDS_OUT || nats < LEAST_NATS || band.power < SHARE * variance || follows {
        return None;
    }
    let (middle, width) = band.moments(&left);
    // The band, and that of each of its harmonics.
    let (from, to) = (hz(band.from as f64), hz(band.to as f64));
    let within_band = |bin: f64, harmonics: f64| {
        let at = bin / (samples as f64 * of.dt_s);
        let nearest = (at / hz(middle)).round();
        (1.0..=harmonics).contains(&nearest) && (from..=to).contains(&(at / nearest))
    };
    let alone = passed(&residual, |bin| within_band(bin, 1.0));
    // Of a closed loop, the current answers the tone, and what is simulated with it: that is no movement of its own.
    let answer = passed(of.simulated_bar, |bin| within_band(bin, HARMONICS));
    let course: Vec<f64> = of.simulated_bar.iter().zip(answer).map(|(p, tone)| p - tone).collect();
    let within = (PERIODS / (hz(middle) * of.dt_s)).ceil() as usize;
    let calm = calm_share(&alone, &course, within)?;
    if calm < CALM {
        return None;
    }
    let rms_bar = band.power.sqrt();
    Some(ScatterFinding {
        theta: vec![hz(middle), 2f64.sqrt() * rms_bar, 0.0],
        std_errors: vec![hz(width) / (samples as f64 / segment as f64).sqrt(), f64::NAN, f64::NAN],
        gain_nats: nats,
        masked: Vec::new(),
        alone_bar: passed(&residual, |bin| within_band(bin, HARMONICS)),
        spread_bar: vec![rms_bar; samples],
        is_event: true,
        evidence: format!(
            "from {:.2} to {:.2} Hz the error has {:.0} times the power of its neighbourhood and {:.0} % of all that is left, also where the pressure rests; the pace wanders, so that no sine stays in step with it and the augmented model is without it",
            hz(band.from as f64),
            hz(band.to as f64),
            band.stands_out,
            100.0 * band.power / variance
        ),
        ..ScatterFinding::default()
    })
}

/// A few bins of a spectrum that stand above their neighbourhood.
struct Band {
    from: usize,
    to: usize,
    /// Median of a bin of the neighbourhood.
    around: f64,
    /// Power beyond the neighbourhood's.
    power: f64,
    /// Mean of its bins over the neighbourhood's.
    stands_out: f64,
}

impl Band {
    fn about(middle: usize, spectrum: &[f64]) -> Option<Self> {
        let half = ((HALF * middle as f64) as usize).max(HALF_BINS);
        let (from, to) = (middle.checked_sub(half)?, middle + half);
        let (low, high) = ((middle as f64 / AROUND) as usize, ((middle as f64 * AROUND) as usize).min(spectrum.len() - 1));
        let mut around: Vec<f64> = (low.max(1)..=high).filter(|k| !(from..=to).contains(k)).map(|k| spectrum[k]).collect();
        if to >= spectrum.len() || around.len() < 4 {
            return None;
        }
        around.sort_by(f64::total_cmp);
        let around = around[around.len() / 2].max(1e-300);
        let sum: f64 = spectrum[from..=to].iter().sum();
        let count = (to - from + 1) as f64;
        Some(Self { from, to, around, power: sum - count * around, stands_out: sum / count / around })
    }

    /// Gain of the likelihood of one segment over a band like its neighbourhood [nats].
    fn nats(&self, spectrum: &[f64]) -> f64 {
        let over = |power: &f64| power / self.around;
        spectrum[self.from..=self.to].iter().map(over).filter(|r| *r > 1.0).map(|r| r - 1.0 - r.ln()).sum()
    }

    /// The power of another spectrum in this band beyond that of its neighbourhood there.
    fn beyond(&self, spectrum: &[f64]) -> f64 {
        Self::about((self.from + self.to) / 2, spectrum).map_or(0.0, |band| band.power)
    }

    /// Mean and standard deviation of the power over the bins.
    fn moments(&self, spectrum: &[f64]) -> (f64, f64) {
        let power = |k: usize| (spectrum[k] - self.around).max(0.0);
        let sum = |of: &dyn Fn(f64) -> f64| (self.from..=self.to).map(|k| power(k) * of(k as f64)).sum::<f64>();
        let all = sum(&|_| 1.0).max(1e-300);
        let mean = sum(&|k| k) / all;
        (mean, (sum(&|k| (k - mean).powi(2)) / all).sqrt())
    }
}

/// Variance in each bin of a spectrum over overlapping segments, each less its mean, under a Hann window.
fn spectrum(values: &[f64], segment: usize) -> Vec<f64> {
    let forward = RealFftPlanner::<f64>::new().plan_fft_forward(segment);
    let window: Vec<f64> = (0..segment).map(|k| (std::f64::consts::PI * (k as f64 + 0.5) / segment as f64).sin().powi(2)).collect();
    let scale = 2.0 / (segment as f64 * window.iter().map(|w| w * w).sum::<f64>());
    let (mut input, mut output) = (forward.make_input_vec(), forward.make_output_vec());
    let mut power = vec![0.0; output.len()];
    let mut count = 0.0;
    for begin in (0..=values.len() - segment).step_by(segment / 2) {
        let part = &values[begin..begin + segment];
        let mean = part.iter().sum::<f64>() / segment as f64;
        input.iter_mut().zip(part).zip(&window).for_each(|((x, v), w)| *x = (v - mean) * w);
        if forward.process(&mut input, &mut output).is_ok() {
            power.iter_mut().zip(&output).for_each(|(sum, line)| *sum += scale * line.norm_sqr());
            count += 1.0;
        }
    }
    power.iter_mut().for_each(|p| *p /= f64::max(count, 1.0));
    power[0] = 0.0;
    power
}

/// The values without the bins that are not `kept`.
fn passed(values: &[f64], kept: impl Fn(f64) -> bool) -> Vec<f64> {
    let mut planner = RealFftPlanner::<f64>::new();
    let (forward, back) = (planner.plan_fft_forward(values.len()), planner.plan_fft_inverse(values.len()));
    let (mut input, mut bins, mut output) = (values.to_vec(), forward.make_output_vec(), back.make_output_vec());
    if forward.process(&mut input, &mut bins).is_err() {
        return values.to_vec();
    }
    for (k, bin) in bins.iter_mut().enumerate() {
        *bin = if kept(k as f64) { *bin / values.len() as f64 } else { realfft::num_complex::Complex::new(0.0, 0.0) };
    }
    // Zeros of both ends of the spectrum of a real signal are real.
    if back.process(&mut bins, &mut output).is_err() { values.to_vec() } else { output }
}

/// Mean power of `values` in the third of the time in which the pressure has come least far over the last `within` samples, over that
/// of all of it.
fn calm_share(values: &[f64], pressure_bar: &[f64], within: usize) -> Option<f64> {
    // What it has come, not the way that it went: noise that a controller answers goes a long way and comes nowhere.
    let come = |k: usize| (pressure_bar[k] - pressure_bar[k.saturating_sub(within)]).abs();
    let mut moved: Vec<(f64, f64)> = values.iter().enumerate().map(|(k, value)| (come(k), value * value)).collect();
    let third = values.len() / 3;
    if third == 0 {
        return None;
    }
    let all = moved.iter().map(|m| m.1).sum::<f64>() / moved.len() as f64;
    moved.select_nth_unstable_by(third, |a, b| a.0.total_cmp(&b.0));
    let calm = moved[..third].iter().map(|m| m.1).sum::<f64>() / third as f64;
    (all > 0.0).then(|| calm / all)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};

    use super::*;

    const DT_S: f64 = 0.01;

    /// Two minutes of steps every four seconds, with noise of 50 mbar and what `and_then` gives at a time and the seconds since the step.
    fn look(and_then: impl Fn(f64, f64, f64) -> f64) -> Option<ScatterFinding> {
        let mut random = rand_pcg::Pcg64::seed_from_u64(4);
        let normal = Normal::new(0.0, 1.0).unwrap();
        let levels = [4.0, 12.0, 7.0, 15.0, 9.0];
        let mut wander = 0.0;
        let (mut simulated, mut measured) = (Vec::new(), Vec::new());
        for k in 0..12_000usize {
            let t = DT_S * k as f64;
            wander += 0.05 * normal.sample(&mut random);
            let p = levels[(k / 400) % levels.len()];
            simulated.push(p);
            measured.push(p + and_then(t, (k % 400) as f64 * DT_S, wander) + 0.05 * normal.sample(&mut random));
        }
        wandering_tone(&Scatter::between(&measured, &simulated, 0.05))
    }

    fn turn(cycles: f64) -> f64 {
        (std::f64::consts::TAU * cycles).sin()
    }

    #[test]
    fn a_tone_that_wanders_is_found_with_its_pace_and_size() {
        let found = look(|t, _, wander| 0.2 * turn(7.0 * t + 0.3 * wander)).unwrap();
        assert!((found.theta[0] - 7.0).abs() < 0.1, "{:?}", found.theta);
        assert!((found.theta[1] - 0.2).abs() < 0.02, "{:?}", found.theta);
        assert!(found.is_event && found.evidence.contains("7."), "{}", found.evidence);
    }

    fn finds(and_then: impl Fn(f64, f64, f64) -> f64) -> bool {
        look(and_then).is_some()
    }

    #[test]
    fn a_tone_that_grows_with_the_pressure_is_one_also_where_a_controller_answers_it() {
        // The current answers the tone, the more the larger it is, and so does what is simulated.
        let levels = [4.0, 12.0, 7.0, 15.0, 9.0];
        let level = |k: usize| levels[(k / 400) % levels.len()];
        let tone = |k: usize| 0.03 * level(k) * turn(7.0 * DT_S * k as f64);
        let mut random = rand_pcg::Pcg64::seed_from_u64(4);
        let normal = Normal::new(0.0, 0.05).unwrap();
        let simulated: Vec<f64> = (0..12_000).map(|k| level(k) - 0.3 * tone(k.saturating_sub(4)) + normal.sample(&mut random)).collect();
        let measured: Vec<f64> = (0..12_000).map(|k| level(k) + tone(k) + normal.sample(&mut random)).collect();
        let found = wandering_tone(&Scatter::between(&measured, &simulated, 0.05));
        let alone_bar = found.expect("a tone").alone_bar;
        let missed = (100..11_900).map(|k| (alone_bar[k] - tone(k) - 0.3 * tone(k - 4)).powi(2)).sum::<f64>() / 11_800.0;
        assert!(missed.sqrt() < 0.05, "what it adds is told within the noise: {missed}");
    }

    #[test]
    fn noise_ringing_and_slow_courses_are_none() {
        assert!(!finds(|_, _, _| 0.0));
        let rings = |_: f64, since_s: f64, _: f64| 2.0 * (-since_s / 0.4).exp() * turn(5.0 * since_s);
        assert!(!finds(rings));
        assert!(!finds(|t, _, _| 0.5 * turn(0.05 * t)));
        // Half of what is left and more is something else.
        assert!(!finds(|t, _, wander| 0.2 * turn(7.0 * t + 0.3 * wander) + 0.1 * wander));
    }

    #[test]
    fn what_the_current_swings_is_an_answer_to_it() {
        let time: Vec<f64> = (0..12_000).map(|k| DT_S * f64::from(k)).collect();
        let simulated: Vec<f64> = time.iter().map(|t| 10.0 + turn(4.0 * t)).collect();
        let measured: Vec<f64> = time.iter().map(|t| 10.0 + 0.6 * turn(4.0 * t - 0.05)).collect();
        assert!(wandering_tone(&Scatter::between(&measured, &simulated, 0.05)).is_none());
    }
}
