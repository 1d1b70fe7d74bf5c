//! Linear blocks, exact for a step whose input jumps once and is a parabola besides.

use super::block::Dynamic;
use super::signal::{Arrival, Point, Step};

/// Below this ratio of step to time constant the moments are summed as series.
const SMALL: f64 = 0.2;

/// Integrals of v^n q exp(-q v) over v from 0 to 1, n = 0, 1, 2: what a lag keeps of an input v steps before the sample.
fn moments(q: f64) -> [f64; 3] {
    if q < SMALL {
        return std::array::from_fn(|n| {
            let (mut term, mut sum) = (q, 0.0);
            for j in 0..12 {
                sum += term / (n + 1 + j) as f64;
                term *= -q / (j + 1) as f64;
            }
            sum
        });
    }
    let e = (-q).exp();
    let zeroth = -(-q).exp_m1();
    let first = zeroth / q - e;
    [zeroth, first, 2.0 * first / q - e]
}

/// A first-order lag: tau y' = u - y.
#[derive(Debug, Clone, Copy)]
pub struct FirstOrder {
    decay: f64,
    /// Weights of the input: its value before, its value now, its mean, its jump.
    weights: [f64; 4],
    per_ratio: f64,
    output: f64,
}

impl FirstOrder {
    /// A lag of `tau_s` at steps of `dt_s`; a `tau_s` of zero passes the input.
    pub fn new(tau_s: f64, dt_s: f64, arrival: Arrival) -> Self {
        let q = dt_s / tau_s.max(1e-9);
        let [zeroth, first, second] = moments(q);
        // A parabola through both ends with the mean m: the line, and 6 (m - mean of the ends) x (1 - x).
        let bow = 6.0 * (first - second);
        let left = arrival.left();
        let jump = -(-left * q).exp_m1() - (zeroth - first) + bow * (0.5 - left);
        Self { decay: (-q).exp(), weights: [first - 0.5 * bow, zeroth - first - 0.5 * bow, bow, jump], per_ratio: 1.0 / q, output: 0.0 }
    }

    /// Settles at `value`.
    #[inline]
    pub fn settle(&mut self, value: f64) {
        self.output = value;
    }

    /// Its value at the last sample.
    #[inline]
    pub fn output(&self) -> f64 {
        self.output
    }

    /// Value and mean over a step of the input, which began at the value `from`.
    #[inline]
    pub fn advance(&mut self, from: f64, input: Step) -> (f64, f64) {
        let [a, b, c, d] = self.weights;
        let before = self.output;
        self.output = self.decay * before + (a * from + b * input.to + c * input.mean + d * input.jump);
        // What the lag has gained it got from the difference of the means.
        (self.output, input.mean - (self.output - before) * self.per_ratio)
    }
}

impl Dynamic for FirstOrder {
    fn start(&mut self, _: &Point, input: f64) {
        self.settle(input);
    }
    #[inline]
    fn step(&mut self, _: &Point, from: f64, input: Step) -> Step {
        let (to, mean) = self.advance(from, input);
        Step { to, mean, jump: 0.0 }
    }
}

/// A second-order system: y'' + 2 zeta w y' + w^2 y = w^2 u.
#[derive(Debug, Clone, Copy)]
pub struct SecondOrder {
    /// Propagation of (y, y') without input.
    a: [[f64; 2]; 2],
    /// Weights of the input's value before, value now, mean and jump, on y and y'.
    weights: [[f64; 4]; 2],
    /// 1 / (w^2 dt) and 2 zeta / (w dt): the mean of y is that of u less these times the changes of y' and y.
    mean: (f64, f64),
    value: f64,
    slope: f64,
}

impl SecondOrder {
    /// Natural frequency `frequency_hz`, damping ratio `damping`, step `dt_s`.
    pub fn new(frequency_hz: f64, damping: f64, dt_s: f64, arrival: Arrival) -> Self {
        let w = std::f64::consts::TAU * frequency_hz;
        let a = propagation(w, damping, dt_s);
        let after_jump = propagation(w, damping, arrival.left() * dt_s);
        // A unit input that came at once moves the state as far as a unit deviation decays.
        let jumped = [1.0 - after_jump[0][0], -after_jump[1][0]];
        let smooth = |from: f64, to: f64, mean: f64| {
            // u = a0 + a1 t + a2 t^2 has the particular solution b0 + b1 t + b2 t^2.
            let bow = 6.0 * (mean - 0.5 * (from + to));
            let (a0, a1, a2) = (from, (to - from + bow) / dt_s, -bow / (dt_s * dt_s));
            let (b2, b1) = (a2, a1 - 4.0 * damping * a2 / w);
            let b0 = a0 - 2.0 * damping * b1 / w - 2.0 * b2 / (w * w);
            let end = [b0 + b1 * dt_s + b2 * dt_s * dt_s, b1 + 2.0 * b2 * dt_s];
            std::array::from_fn::<f64, 2, _>(|i| end[i] - a[i][0] * b0 - a[i][1] * b1)
        };
        let (from, to, mean) = (smooth(1.0, 0.0, 0.0), smooth(0.0, 1.0, 0.0), smooth(0.0, 0.0, 1.0));
        let left = arrival.left();
        let weights = std::array::from_fn(|i| [from[i], to[i], mean[i], jumped[i] - to[i] - left * mean[i]]);
        Self { a, weights, mean: (1.0 / (w * w * dt_s), 2.0 * damping / (w * dt_s)), value: 0.0, slope: 0.0 }
    }
}

/// How (y, y') of the free system go on in `t_s`.
fn propagation(w: f64, damping: f64, t_s: f64) -> [[f64; 2]; 2] {
    let s = damping * w;
    let d2 = w * w - s * s;
    // sin(wd t)/wd and cos(wd t) for any damping; the limit at critical damping is t and 1.
    let (sine, cosine) = if d2.abs() < 1e-9 * w * w {
        (t_s, 1.0)
    } else if d2 > 0.0 {
        let wd = d2.sqrt();
        ((wd * t_s).sin() / wd, (wd * t_s).cos())
    } else {
        let wd = (-d2).sqrt();
        ((wd * t_s).sinh() / wd, (wd * t_s).cosh())
    };
    let e = (-s * t_s).exp();
    [[e * (cosine + s * sine), e * sine], [-e * w * w * sine, e * (cosine - s * sine)]]
}

impl Dynamic for SecondOrder {
    fn start(&mut self, _: &Point, input: f64) {
        (self.value, self.slope) = (input, 0.0);
    }
    #[inline]
    fn step(&mut self, _: &Point, from: f64, input: Step) -> Step {
        let (x, v) = (self.value, self.slope);
        let [[aa, ab], [ba, bb]] = self.a;
        let driven = |[a, b, c, d]: [f64; 4]| a * from + b * input.to + c * input.mean + d * input.jump;
        let value = aa * x + ab * v + driven(self.weights[0]);
        let slope = ba * x + bb * v + driven(self.weights[1]);
        (self.value, self.slope) = (value, slope);
        Step { to: value, mean: input.mean - self.mean.0 * (slope - v) - self.mean.1 * (value - x), jump: 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HELD: Arrival = Arrival::Held { left: 0.3 };

    /// The answer of a block to steps, at their ends, whatever the grid.
    fn steps(block: &mut dyn Dynamic, dt_s: f64, arrival: Arrival) -> Vec<Step> {
        let input: Vec<f64> = (0..=100).map(|k| if k > 0 && (k / 10) % 2 == 0 { 5.0 } else { 1.0 }).collect();
        let _ = dt_s;
        block.start(&Point::current(0.0), 1.0);
        let mut from = 1.0;
        input
            .iter()
            .map(|u| {
                let out = block.step(&Point::current(0.0), from, Step::arriving(from, *u, arrival));
                from = *u;
                out
            })
            .collect()
    }

    /// The same by explicit Euler steps of a thousandth: value at the samples and means.
    fn fine(dt_s: f64, left: f64, mut derivative: impl FnMut([f64; 2], f64) -> [f64; 2]) -> Vec<(f64, f64)> {
        let input: Vec<f64> = (0..=100).map(|k| if k > 0 && (k / 10) % 2 == 0 { 5.0 } else { 1.0 }).collect();
        let (mut state, mut last, n) = ([1.0, 0.0], 1.0, 4000);
        input
            .iter()
            .map(|u| {
                let mut mean = 0.0;
                for j in 0..n {
                    let now = if j as f64 >= (1.0 - left) * n as f64 - 1e-9 { *u } else { last };
                    let h = dt_s / n as f64;
                    let k1 = derivative(state, now);
                    let k2 = derivative([state[0] + 0.5 * h * k1[0], state[1] + 0.5 * h * k1[1]], now);
                    mean += (state[0] + 0.25 * h * (k1[0] + k2[0])) / n as f64;
                    state = [state[0] + h * k2[0], state[1] + h * k2[1]];
                }
                last = *u;
                (state[0], mean)
            })
            .collect()
    }

    #[test]
    fn held_steps_through_a_lag_are_those_of_a_fine_solution() {
        for tau in [0.002, 0.008, 0.04, 3.0] {
            let coarse = steps(&mut FirstOrder::new(tau, 0.01, HELD), 0.01, HELD);
            let exact = fine(0.01, 0.3, |y, u| [(u - y[0]) / tau, 0.0]);
            for (c, e) in coarse.iter().zip(&exact) {
                assert!((c.to - e.0).abs() < 1e-4 && (c.mean - e.1).abs() < 1e-3, "{tau}: {c:?} {e:?}");
            }
        }
    }

    #[test]
    fn held_steps_through_a_resonance_are_those_of_a_fine_solution() {
        for (f, zeta) in [(2.0, 0.1), (15.0, 0.35), (30.0, 1.0), (20.0, 1.6)] {
            let w = std::f64::consts::TAU * f;
            let coarse = steps(&mut SecondOrder::new(f, zeta, 0.01, HELD), 0.01, HELD);
            let exact = fine(0.01, 0.3, |y, u| [y[1], w * w * (u - y[0]) - 2.0 * zeta * w * y[1]]);
            for (c, e) in coarse.iter().zip(&exact) {
                assert!((c.to - e.0).abs() < 1e-3 && (c.mean - e.1).abs() < 2e-3, "{f} {zeta}: {c:?} {e:?}");
            }
        }
    }

    #[test]
    fn a_ramp_through_a_lag_follows_tau_behind() {
        for tau in [0.03f64, 1e5] {
            let mut lag = FirstOrder::new(tau, 0.01, Arrival::Ramp);
            lag.settle(0.0);
            let mut y = 0.0;
            for k in 1..=100 {
                let (from, to) = (f64::from(k - 1) * 0.01, f64::from(k) * 0.01);
                y = lag.advance(from, Step::arriving(from, to, Arrival::Ramp)).0;
                let exact = to + tau * (-to / tau).exp_m1();
                assert!((y - exact).abs() < 1e-10, "{y} {exact}");
            }
            assert!(tau > 1.0 || (1.0 - y - 0.03).abs() < 1e-9);
        }
    }

    #[test]
    fn a_parabola_with_its_mean_goes_through_exactly() {
        let (tau, dt) = (0.02, 0.05);
        let mut lag = FirstOrder::new(tau, dt, Arrival::Ramp);
        lag.settle(0.0);
        // u = t^2 from rest: y = t^2 - 2 tau t + 2 tau^2 (1 - exp(-t/tau)).
        let mut sum = 0.0;
        for k in 0..10 {
            let (a, b) = (f64::from(k) * dt, f64::from(k + 1) * dt);
            let mean = (b.powi(3) - a.powi(3)) / (3.0 * dt);
            let (to, y_mean) = lag.advance(a * a, Step { to: b * b, mean, jump: 0.0 });
            let exact = b * b - 2.0 * tau * b - 2.0 * tau * tau * (-b / tau).exp_m1();
            assert!((to - exact).abs() < 1e-12);
            sum += y_mean * dt;
        }
        let t: f64 = 10.0 * dt;
        let area = t.powi(3) / 3.0 - tau * t * t + 2.0 * tau * tau * (t + tau * (-t / tau).exp_m1());
        assert!((sum - area).abs() < 1e-12);
    }

    #[test]
    fn the_second_order_overshoot_is_the_textbooks() {
        // Overshoot exp(-pi zeta / sqrt(1 - zeta^2)) of a step, Ogata, Modern Control Engineering, 5th ed., Eq. 5-21.
        for zeta in [0.1f64, 0.3, 0.7] {
            let mut system = SecondOrder::new(2.0, zeta, 1e-3, HELD);
            system.start(&Point::current(0.0), 0.0);
            let peak = (0..2000)
                .map(|k| {
                    let from = if k == 0 { 0.0 } else { 1.0 };
                    system.step(&Point::current(0.0), from, Step::arriving(from, 1.0, HELD)).to
                })
                .fold(0.0, f64::max);
            let overshoot = (-std::f64::consts::PI * zeta / (1.0 - zeta * zeta).sqrt()).exp();
            assert!((peak - 1.0 - overshoot).abs() < 1e-3, "{zeta}: {peak}");
        }
    }
}
