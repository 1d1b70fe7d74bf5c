//! Linear blocks, discretised exactly for an input that is linear between samples.

/// A first-order lag: tau y' = u - y.
#[derive(Debug, Clone, Copy)]
pub struct FirstOrder {
    decay: f64,
    now: f64,
    before: f64,
    input: f64,
    output: f64,
}

impl FirstOrder {
    /// A lag of `tau_s` at steps of `dt_s`; a `tau_s` of zero passes the input.
    pub fn new(tau_s: f64, dt_s: f64) -> Self {
        let ratio = dt_s / tau_s.max(1e-9);
        let decay = (-ratio).exp();
        // Weights of the input at the begin and the end of the step, from the exact response to a ramp.
        let mean = -(-ratio).exp_m1() / ratio;
        Self { decay, now: 1.0 - mean, before: mean - decay, input: 0.0, output: 0.0 }
    }

    /// Settles at `value`.
    #[inline]
    pub fn start(&mut self, value: f64) {
        (self.input, self.output) = (value, value);
    }

    /// Output one step later.
    #[inline]
    pub fn step(&mut self, input: f64) -> f64 {
        self.output = self.decay * self.output + self.before * self.input + self.now * input;
        self.input = input;
        self.output
    }

    /// The whole signal, from its first value settled.
    pub fn run(&mut self, signal: &mut [f64]) {
        if let Some(first) = signal.first() {
            self.start(*first);
        }
        for value in signal {
            *value = self.step(*value);
        }
    }
}

/// A second-order system: y'' + 2 zeta w y' + w^2 y = w^2 u.
#[derive(Debug, Clone, Copy)]
pub struct SecondOrder {
    // Propagation of (y - u, y') relative to the ramp's particular solution.
    a: [[f64; 2]; 2],
    dt_s: f64,
    lead: f64,
    input: f64,
    value: f64,
    slope: f64,
}

impl SecondOrder {
    /// Natural frequency `frequency_hz`, damping ratio `damping`, step `dt_s`.
    pub fn new(frequency_hz: f64, damping: f64, dt_s: f64) -> Self {
        let w = std::f64::consts::TAU * frequency_hz;
        let s = damping * w;
        let d2 = w * w - s * s;
        // sin(wd t)/wd and cos(wd t) for any damping; the limit at critical damping is t and 1.
        let (sine, cosine) = if d2.abs() < 1e-9 * w * w {
            (dt_s, 1.0)
        } else if d2 > 0.0 {
            let wd = d2.sqrt();
            ((wd * dt_s).sin() / wd, (wd * dt_s).cos())
        } else {
            let wd = (-d2).sqrt();
            ((wd * dt_s).sinh() / wd, (wd * dt_s).cosh())
        };
        let e = (-s * dt_s).exp();
        let a = [[e * (cosine + s * sine), e * sine], [-e * w * w * sine, e * (cosine - s * sine)]];
        Self { a, dt_s, lead: 2.0 * damping / w, input: 0.0, value: 0.0, slope: 0.0 }
    }

    /// Settles at `value`.
    #[inline]
    pub fn start(&mut self, value: f64) {
        (self.input, self.value, self.slope) = (value, value, 0.0);
    }

    /// Output one step later.
    #[inline]
    pub fn step(&mut self, input: f64) -> f64 {
        let ramp = (input - self.input) / self.dt_s;
        // Particular solution of a ramp: u - lead * ramp, with the ramp as its slope.
        let (x, v) = (self.value - (self.input - self.lead * ramp), self.slope - ramp);
        self.value = self.a[0][0] * x + self.a[0][1] * v + input - self.lead * ramp;
        self.slope = self.a[1][0] * x + self.a[1][1] * v + ramp;
        self.input = input;
        self.value
    }
}

/// A dead time that need not be a whole number of samples; the input is linear between samples.
#[derive(Debug, Clone)]
pub struct DelayLine {
    past: Vec<f64>,
    next: usize,
    whole: usize,
    part: f64,
}

impl DelayLine {
    /// A delay of `delay_s` at steps of `dt_s`.
    pub fn new(delay_s: f64, dt_s: f64) -> Self {
        let steps = (delay_s / dt_s).max(0.0);
        let whole = steps.floor() as usize;
        Self { past: vec![0.0; whole + 2], next: 0, whole, part: steps - whole as f64 }
    }

    /// Settles at `value`.
    pub fn start(&mut self, value: f64) {
        self.past.fill(value);
    }

    /// Output one step later.
    #[inline]
    pub fn step(&mut self, input: f64) -> f64 {
        let n = self.past.len();
        self.past[self.next] = input;
        let late = self.past[(self.next + n - self.whole) % n];
        let later = self.past[(self.next + n - self.whole - 1) % n];
        self.next = (self.next + 1) % n;
        late + self.part * (later - late)
    }

    /// The whole signal `input`, delayed, into `output`.
    pub fn apply(delay_s: f64, dt_s: f64, input: &[f64], output: &mut Vec<f64>) {
        output.clear();
        let Some(first) = input.first().copied() else { return };
        let steps = delay_s / dt_s;
        let (whole, part) = (steps.floor(), steps - steps.floor());
        let shift = whole as isize;
        let n = input.len() as isize;
        let last = input[input.len() - 1];
        let at = |k: isize| {
            if k < 0 {
                first
            } else if k >= n {
                last
            } else {
                input[k as usize]
            }
        };
        // The part of the signal that has both neighbours needs no test of the ends.
        let from = (shift + 1).clamp(0, n);
        let to = (n + shift).clamp(from, n);
        output.extend((0..from).map(|k| at(k - shift) + part * (at(k - shift - 1) - at(k - shift))));
        if to > from {
            let late = &input[(from - shift) as usize..(to - shift) as usize];
            let later = &input[(from - shift - 1) as usize..(to - shift - 1) as usize];
            output.extend(late.iter().zip(later).map(|(a, b)| a + part * (b - a)));
        }
        output.extend((to..n).map(|k| at(k - shift) + part * (at(k - shift - 1) - at(k - shift))));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_through_a_lag_follows_tau_behind() {
        let mut lag = FirstOrder::new(0.03, 0.01);
        lag.start(0.0);
        let mut y = 0.0;
        for k in 1..=100 {
            y = lag.step(k as f64 * 0.01);
            let t = k as f64 * 0.01;
            let exact = t - 0.03 * (1.0 - (-t / 0.03f64).exp());
            assert!((y - exact).abs() < 1e-12, "{y} {exact}");
        }
        assert!((1.0 - y - 0.03).abs() < 1e-9);
    }

    #[test]
    fn the_second_order_overshoot_is_the_textbooks() {
        // Overshoot exp(-pi zeta / sqrt(1 - zeta^2)) of a step, Ogata, Modern Control Engineering, 5th ed., Eq. 5-21.
        for zeta in [0.1f64, 0.3, 0.7] {
            let mut system = SecondOrder::new(2.0, zeta, 1e-4);
            system.start(0.0);
            system.step(1.0);
            let peak = (0..20_000).map(|_| system.step(1.0)).fold(0.0, f64::max);
            let overshoot = (-std::f64::consts::PI * zeta / (1.0 - zeta * zeta).sqrt()).exp();
            assert!((peak - 1.0 - overshoot).abs() < 1e-3, "{zeta}: {peak}");
        }
        for zeta in [1.0, 1.5] {
            let mut system = SecondOrder::new(5.0, zeta, 0.01);
            system.start(0.0);
            let end = (0..1000).map(|_| system.step(1.0)).fold(0.0, |_, y| y);
            assert!((end - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn the_whole_and_the_stepwise_delay_agree_and_a_ramp_is_late_by_the_delay() {
        let ramp: Vec<f64> = (0..50).map(f64::from).collect();
        for delay in [0.0, 0.004, 0.01, 0.0237, 0.2] {
            let mut out = Vec::new();
            DelayLine::apply(delay, 0.01, &ramp, &mut out);
            let mut line = DelayLine::new(delay, 0.01);
            line.start(ramp[0]);
            for (k, value) in out.iter().enumerate() {
                assert!((line.step(ramp[k]) - value).abs() < 1e-12);
                assert!((value - (k as f64 - delay / 0.01).max(0.0)).abs() < 1e-9, "{delay} {k} {value}");
            }
        }
    }
}
