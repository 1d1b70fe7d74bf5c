//! Margins of the sampled loop: zero-order hold, fractional delay, one period of computation; exact in the z-plane.
//!
//! The lag behind a hold with the total delay (n - m) T, 0 <= m < 1, is
//! k z^-n [(1 - e^(-m T/tau)) + (e^(-m T/tau) - e^(-T/tau)) z^-1] / (1 - e^(-T/tau) z^-1) (modified z-transform;
//! Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., section 2.3). The controller is
//! K_P + K_I T / (1 - z^-1), as it runs.

use std::f64::consts::PI;

use super::search::{bisect, maximum};
use super::{FrequencyMargins, LoopPlant};
use crate::control::Gains;

/// Time over which the answer of the loop to one noisy sample is followed [s].
const FOLLOWED_S: f64 = 5.0;

/// The sampled loop.
#[derive(Debug, Clone)]
pub struct SampledLoop {
    period_s: f64,
    /// Numerator and denominator of L in rising powers of z^-1.
    numerator: Vec<f64>,
    denominator: Vec<f64>,
}

impl SampledLoop {
    /// The loop at `rate_hz`, with one period of computation on top of the plant's delay.
    pub fn new(plant: &LoopPlant, gains: Gains, rate_hz: f64) -> Self {
        let (controller, lag) = pi(gains, rate_hz);
        let (held, decay) = held(plant, rate_hz);
        Self { period_s: 1.0 / rate_hz, numerator: product(&controller, &held), denominator: product(&lag, &decay) }
    }

    /// The same with O. J. Smith's predictor ("Closer control of loops with dead time", Chem. Eng. Progress 53 (1957) 217): the
    /// controller sees what `believed` would show without its delay, and the difference between the measurement and what
    /// `believed` shows with it.
    pub fn with_predictor(plant: &LoopPlant, believed: &LoopPlant, gains: Gains, rate_hz: f64) -> Self {
        let ((controller, lag), (real, decay)) = (pi(gains, rate_hz), held(plant, rate_hz));
        let (late, believed_decay) = held(believed, rate_hz);
        let (prompt, _) = held(&LoopPlant { delay_s: 0.0, ..*believed }, rate_hz);
        // C / (1 + C (G_0 - G)), with the denominator that G_0 and G share.
        let difference: Vec<f64> = (0..late.len().max(prompt.len())).map(|i| at(&prompt, i) - at(&late, i)).collect();
        let (own, fed_back) = (product(&lag, &believed_decay), product(&controller, &difference));
        let inner: Vec<f64> = (0..own.len().max(fed_back.len())).map(|i| at(&own, i) + at(&fed_back, i)).collect();
        Self {
            period_s: 1.0 / rate_hz,
            numerator: product(&product(&controller, &believed_decay), &real),
            denominator: product(&inner, &decay),
        }
    }

    /// Whether every closed-loop pole lies inside the unit circle.
    pub fn stable(&self) -> bool {
        let length = self.numerator.len().max(self.denominator.len());
        schur((0..length).map(|i| at(&self.numerator, i) + at(&self.denominator, i)).collect())
    }

    /// What the closed loop leaves of a disturbance of the pressure, sample by sample.
    pub fn left_of(&self, disturbance: &[f64]) -> Vec<f64> {
        let length = self.numerator.len().max(self.denominator.len());
        // The sensitivity 1/(1 + N/D) = D/(D + N) as a difference equation.
        let closed: Vec<f64> = (0..length).map(|i| at(&self.numerator, i) + at(&self.denominator, i)).collect();
        let mut left: Vec<f64> = Vec::with_capacity(disturbance.len());
        for k in 0..disturbance.len() {
            let driven: f64 = (0..self.denominator.len().min(k + 1)).map(|i| self.denominator[i] * disturbance[k - i]).sum();
            let kept: f64 = (1..length.min(k + 1)).map(|i| closed[i] * left[k - i]).sum();
            // closed[0] is 1: nothing of a sample is seen before the next one.
            left.push(driven - kept);
        }
        left
    }

    /// Standard deviation of the current that a PI with `gains` in this loop makes of a noise of 1 bar in every sample [mA/bar].
    pub fn noise_gain(&self, gains: Gains) -> f64 {
        let samples = (FOLLOWED_S / self.period_s) as usize;
        let mut impulse = vec![0.0; samples];
        impulse[0] = 1.0;
        let (mut integral, mut squares) = (0.0, 0.0);
        for error in self.left_of(&impulse) {
            integral += gains.ki_ma_per_bar_s * self.period_s * error;
            squares += (gains.kp_ma_per_bar * error + integral).powi(2);
        }
        squares.sqrt()
    }

    /// The margins at the sampling instants, of a loop without predictor.
    pub fn margins(&self) -> FrequencyMargins {
        let stable = self.stable();
        let grid = self.grid();
        let gain: Vec<f64> = grid.iter().map(|w| self.magnitude(*w).ln()).collect();
        let phase = self.unwrapped_phase(&grid);
        // The gain of PI, lag and hold only falls with the frequency: it crosses one once.
        let gain_crossing = (1..grid.len()).find(|&i| gain[i - 1] > 0.0 && gain[i] <= 0.0).map(|i| {
            let w = bisect(|w| self.magnitude(w).ln(), grid[i - 1], grid[i]);
            (w, PI + nearest(self.phase(w), phase[i]))
        });
        // The integral gives way once and lag and delay grow: the phase falls through -180 deg once.
        let gain_margin = (1..grid.len()).find(|&i| phase[i - 1] > -PI && phase[i] <= -PI).map(|i| {
            let w = bisect(|w| nearest(self.phase(w), phase[i]) + PI, grid[i - 1], grid[i]);
            (w, -20.0 * self.magnitude(w).log10())
        });
        FrequencyMargins {
            gain_margin_db: gain_margin.map(|c| c.1),
            phase_margin_deg: gain_crossing.map(|(_, margin)| margin.to_degrees()),
            delay_margin_s: gain_crossing.filter(|_| stable).map(|(w, margin)| margin / w),
            max_sensitivity: if stable { self.max_sensitivity() } else { None },
            gain_crossover_rad_s: gain_crossing.map(|(w, _)| w),
            phase_crossover_rad_s: gain_margin.map(|c| c.0),
            stable,
        }
    }

    /// The largest sensitivity over the frequencies up to half the rate; `None` when it is not finite.
    pub fn max_sensitivity(&self) -> Option<f64> {
        let sensitivity = |w: f64| {
            let (real, imaginary) = self.response(w);
            1.0 / (1.0 + real).hypot(imaginary)
        };
        maximum(sensitivity, &self.grid()).filter(|m| m.is_finite())
    }

    /// Frequencies from a millionth of half the rate up to it, dense where the phase turns fast.
    fn grid(&self) -> Vec<f64> {
        let nyquist = PI / self.period_s;
        let mut grid = super::search::logarithmic(1e-6 * nyquist, 0.02 * nyquist, 200);
        let steps = 300.max(40 * self.numerator.len());
        grid.extend((1..=steps).map(|i| nyquist * (0.02 + 0.98 * i as f64 / steps as f64)));
        grid
    }

    fn unwrapped_phase(&self, grid: &[f64]) -> Vec<f64> {
        // At the lowest frequency it is between -90 deg, with an integral, and 0.
        let mut last = 0.0;
        grid.iter()
            .map(|w| {
                last = nearest(self.phase(*w), last);
                last
            })
            .collect()
    }

    fn response(&self, w: f64) -> (f64, f64) {
        let (sine, cosine) = (w * self.period_s).sin_cos();
        let (nr, ni) = horner(&self.numerator, cosine, -sine);
        let (dr, di) = horner(&self.denominator, cosine, -sine);
        let scale = dr * dr + di * di;
        ((nr * dr + ni * di) / scale, (ni * dr - nr * di) / scale)
    }

    fn magnitude(&self, w: f64) -> f64 {
        let (real, imaginary) = self.response(w);
        real.hypot(imaginary)
    }

    fn phase(&self, w: f64) -> f64 {
        let (real, imaginary) = self.response(w);
        imaginary.atan2(real)
    }
}

/// The PI controller as it runs.
fn pi(gains: Gains, rate_hz: f64) -> (Vec<f64>, Vec<f64>) {
    let (kp, step) = (gains.kp_ma_per_bar, gains.ki_ma_per_bar_s / rate_hz);
    if step != 0.0 { (vec![kp + step, -kp], vec![1.0, -1.0]) } else { (vec![kp], vec![1.0]) }
}

/// The plant behind the hold, with one period of computation.
fn held(plant: &LoopPlant, rate_hz: f64) -> (Vec<f64>, Vec<f64>) {
    let period = 1.0 / rate_hz;
    let delay = plant.delay_s + period;
    // A delay that is a whole number of periods up to rounding counts as whole: without a lag, the least part of a period is a sample.
    let exact = delay / period;
    let whole = if (exact - exact.round()).abs() < 1e-9 { exact.round() } else { exact };
    let periods = whole.ceil();
    let part = periods - whole;
    let decay = |time: f64| if plant.lag_s > 0.0 { (-time / plant.lag_s).exp() } else { f64::from(u8::from(time == 0.0)) };
    let (at_part, at_period) = (decay(part * period), decay(period));
    let k = plant.gain_bar_per_ma;
    let mut numerator = vec![0.0; periods as usize];
    numerator.extend([k * (1.0 - at_part), k * (at_part - at_period)]);
    (numerator, vec![1.0, -at_period])
}

/// A coefficient, 0 beyond the last.
fn at(polynomial: &[f64], i: usize) -> f64 {
    polynomial.get(i).copied().unwrap_or(0.0)
}

/// `angle` plus the whole turns that bring it nearest to `reference`.
fn nearest(angle: f64, reference: f64) -> f64 {
    angle + 2.0 * PI * ((reference - angle) / (2.0 * PI)).round()
}

fn product(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; a.len() + b.len() - 1];
    for (i, x) in a.iter().enumerate() {
        for (j, y) in b.iter().enumerate() {
            out[i + j] += x * y;
        }
    }
    out
}

/// The polynomial with coefficients in rising powers at the complex point (re, im).
fn horner(coefficients: &[f64], re: f64, im: f64) -> (f64, f64) {
    coefficients.iter().rev().fold((0.0, 0.0), |(r, i), c| (r * re - i * im + c, r * im + i * re))
}

/// Schur-Cohn step-down on c0 + c1 z^-1 + ...: whether all zeros lie inside the unit circle.
fn schur(mut c: Vec<f64>) -> bool {
    while c.len() > 1 {
        let reflection = c[c.len() - 1] / c[0];
        if reflection.is_nan() || reflection.abs() >= 1.0 {
            return false;
        }
        let last = c.len() - 1;
        c = (0..last).map(|i| c[i] - reflection * c[last - i]).collect();
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PAPER: LoopPlant = LoopPlant { gain_bar_per_ma: 0.04, lag_s: 0.01, delay_s: 0.04 };
    const GAINS: Gains = Gains { kp_ma_per_bar: 1.0, ki_ma_per_bar_s: 5.0 };

    #[test]
    fn schur_on_known_polynomials() {
        assert!(schur(vec![1.0, -1.5, 0.7]));
        assert!(!schur(vec![1.0, -2.0, 1.0]));
        assert!(!schur(vec![1.0, -0.5, 1.2]));
        assert!(schur(vec![1.0]));
    }

    #[test]
    fn an_integrator_behind_computation_and_hold_is_stable_below_gain_one() {
        // A step that arrives exactly at a sampling instant is seen at the next one, as with any lag however short:
        // L = K z^-2 / (1 - z^-1), stable for K < 1.
        let plant = LoopPlant { gain_bar_per_ma: 1.0, lag_s: 0.0, delay_s: 0.0 };
        let closed = |ki: f64| SampledLoop::new(&plant, Gains { kp_ma_per_bar: 0.0, ki_ma_per_bar_s: ki }, 1.0);
        assert!(closed(0.99).stable());
        assert!(!closed(1.01).stable());
        assert!((closed(0.5).margins().gain_margin_db.unwrap() - 20.0 * 2f64.log10()).abs() < 1e-6);
    }

    #[test]
    fn a_fast_loop_tends_to_the_continuous_one() {
        let exact = super::super::exact::margins(&PAPER, GAINS);
        let fast = SampledLoop::new(&PAPER, GAINS, 20_000.0).margins();
        assert!((fast.gain_margin_db.unwrap() - exact.gain_margin_db.unwrap()).abs() < 0.02, "{fast:?}");
        assert!((fast.phase_margin_deg.unwrap() - exact.phase_margin_deg.unwrap()).abs() < 0.01);
        assert!((fast.max_sensitivity.unwrap() - exact.max_sensitivity.unwrap()).abs() < 1e-4);
    }

    #[test]
    fn frequencies_are_looked_at_from_a_millionth_of_half_the_rate_up_to_it() {
        let grid = SampledLoop::new(&PAPER, GAINS, 100.0).grid();
        let (first, last) = (grid[0] / (100.0 * PI), grid[grid.len() - 1] / (100.0 * PI));
        assert!((first - 1e-6).abs() < 1e-15 && (last - 1.0).abs() < 1e-12 && grid.is_sorted(), "{first} {last}");
    }

    /// A dead time of many periods and little lag: a row of narrow peaks, of which the first is the highest and none may be stepped over.
    #[test]
    fn no_frequency_has_more_than_the_largest_sensitivity() {
        for periods in 20..45 {
            let plant = LoopPlant { gain_bar_per_ma: 1.0, lag_s: 0.004, delay_s: 0.01 * f64::from(periods) };
            let closed = SampledLoop::new(&plant, Gains { kp_ma_per_bar: 0.97, ki_ma_per_bar_s: 0.0 }, 100.0);
            let largest = closed.max_sensitivity().unwrap();
            for w in (1..20_000).map(|k| PI / 0.01 * f64::from(k) / 20_000.0) {
                let (real, imaginary) = closed.response(w);
                assert!(1.0 / (1.0 + real).hypot(imaginary) <= largest * (1.0 + 1e-9), "{periods} periods at {w} rad/s: {largest}");
            }
        }
    }

    #[test]
    fn sampling_costs_margin() {
        let exact = super::super::exact::margins(&PAPER, GAINS);
        let sampled = SampledLoop::new(&PAPER, GAINS, 100.0).margins();
        assert!(sampled.stable);
        assert!(sampled.gain_margin_db.unwrap() < exact.gain_margin_db.unwrap());
        assert!(sampled.phase_margin_deg.unwrap() < exact.phase_margin_deg.unwrap());
    }

    #[test]
    fn the_response_equals_a_simulated_step() {
        // Sampled plant with fractional delay against the closed form of the lag at the sampling instants.
        let plant = LoopPlant { gain_bar_per_ma: 1.0, lag_s: 0.013, delay_s: 0.0234 };
        let sampled = SampledLoop::new(&plant, Gains { kp_ma_per_bar: 1.0, ki_ma_per_bar_s: 0.0 }, 100.0);
        let mut out: Vec<f64> = Vec::new();
        for n in 0..30usize {
            let input: f64 = sampled.numerator.iter().enumerate().filter(|(j, _)| *j <= n).map(|(_, c)| c).sum();
            let last = if n > 0 { -sampled.denominator[1] * out[n - 1] } else { 0.0 };
            out.push(input + last);
            let elapsed = n as f64 * 0.01 - 0.0234 - 0.01;
            let truth = if elapsed > 0.0 { 1.0 - (-elapsed / 0.013).exp() } else { 0.0 };
            assert!((out[n] - truth).abs() < 1e-12, "sample {n}: {} against {truth}", out[n]);
        }
    }

    #[test]
    fn with_the_right_delay_the_predictor_takes_it_out_of_the_loop() {
        // Gains far beyond what the plant bears without it: the closed loop is that of the plant without delay.
        let (gains, prompt) = (Gains { kp_ma_per_bar: 40.0, ki_ma_per_bar_s: 1000.0 }, LoopPlant { delay_s: 0.0, ..PAPER });
        assert!(!SampledLoop::new(&PAPER, gains, 100.0).stable());
        assert_eq!(SampledLoop::with_predictor(&PAPER, &PAPER, gains, 100.0).stable(), SampledLoop::new(&prompt, gains, 100.0).stable());
        let gains = Gains { kp_ma_per_bar: 5.0, ki_ma_per_bar_s: 900.0 };
        assert!(SampledLoop::new(&prompt, gains, 100.0).stable() && !SampledLoop::new(&PAPER, gains, 100.0).stable());
        let closed = SampledLoop::with_predictor(&PAPER, &PAPER, gains, 100.0);
        assert!(closed.stable() && closed.left_of(&[1.0; 400])[399].abs() < 1e-3);
        // 1 - S is that of the prompt loop, later by the delay: four samples.
        let of = |l: &SampledLoop| l.left_of(&[1.0; 60]).iter().map(|e| 1.0 - e).collect::<Vec<_>>();
        let (late, early) = (of(&closed), of(&SampledLoop::new(&prompt, gains, 100.0)));
        assert!((0..50).all(|k| (late[k + 4] - early[k]).abs() < 1e-9), "{late:?} {early:?}");
        // A delay that is not the believed one shows.
        let off = LoopPlant { delay_s: 0.06, ..PAPER };
        assert!(SampledLoop::with_predictor(&off, &PAPER, gains, 100.0).max_sensitivity() > closed.max_sensitivity());
    }

    #[test]
    fn integral_action_takes_a_disturbance_away_and_before_the_dead_time_nothing_happens() {
        let left = SampledLoop::new(&PAPER, Gains { kp_ma_per_bar: 3.0, ki_ma_per_bar_s: 100.0 }, 100.0).left_of(&[1.0; 400]);
        // 40 ms and one period of computation: the first correction is seen in the sixth sample after.
        assert!(left[..6].iter().all(|e| (e - 1.0).abs() < 1e-12) && left[6] < 1.0, "{:?}", &left[..8]);
        assert!(left[399].abs() < 1e-3, "{}", left[399]);
    }

    proptest! {
        #[test]
        fn the_gain_margin_leads_to_the_boundary(kp in 0.0..15.0f64, ki in 0.5..300.0f64, td in 0.0..0.08f64, tau in 0.0..0.05f64) {
            let plant = LoopPlant { gain_bar_per_ma: 0.04, lag_s: tau, delay_s: td };
            let closed = |f: f64| SampledLoop::new(&plant, Gains { kp_ma_per_bar: kp * f, ki_ma_per_bar_s: ki * f }, 100.0);
            let found = closed(1.0).margins();
            if let (true, Some(db)) = (found.stable, found.gain_margin_db) {
                let factor = 10f64.powf(db / 20.0);
                prop_assert!(closed(factor * 0.999).stable());
                prop_assert!(!closed(factor * 1.001).stable());
            }
        }
    }
}
