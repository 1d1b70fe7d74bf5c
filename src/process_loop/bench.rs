//! Loops of a PI controller, a valve and a process, to try the room on: with friction, and with what is taken for it.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal, Uniform};
use rand_pcg::Pcg64;

/// What a loop suffers from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trouble {
    /// A stem that slides once it moves (Kano).
    Slides,
    /// A stem that sticks after each move (He).
    Steps,
    /// A controller near the limit of stability.
    Tuning,
    /// A sine from outside, of a period that wanders a little.
    Sine,
    /// A clipped sine from outside.
    Clipped,
    /// The process value of another loop whose valve sticks.
    Neighbour,
    /// A load that wanders.
    Walk,
    /// Steps of the set-point.
    SetPoint,
    /// An unstable controller that the limits of its output hold.
    Limits,
    /// A valve with a curved characteristic, and a sine.
    Curved,
    /// A coarse converter, and a sine.
    Coarse,
    /// Nothing but noise about a quiet set-point.
    Quiet,
}

/// All troubles, those with friction first.
pub const TROUBLES: [Trouble; 12] = [
    Trouble::Slides,
    Trouble::Steps,
    Trouble::Tuning,
    Trouble::Sine,
    Trouble::Clipped,
    Trouble::Neighbour,
    Trouble::Walk,
    Trouble::SetPoint,
    Trouble::Limits,
    Trouble::Curved,
    Trouble::Coarse,
    Trouble::Quiet,
];

/// Samples before the record begins.
const WARM: usize = 600;

/// A loop, at rest where nothing disturbs it; one sample a time unit.
#[derive(Debug, Clone, Default)]
pub struct Loop {
    /// Process value over position.
    pub gain: f64,
    /// Lags [samples].
    pub lags: (f64, f64),
    /// Delay [samples].
    pub delay: usize,
    /// Output over control error.
    pub controller: f64,
    /// Time of the integral part [samples].
    pub integral: f64,
    /// S, J, and whether the stem slides.
    pub stem: Option<(f64, f64, bool)>,
    /// Exponent of the valve's characteristic; 0 for a straight one.
    pub curved: f64,
    /// Standard deviation of the reading, and of a step of the load.
    pub noise: (f64, f64),
    /// Load at the input of the process, sample by sample.
    pub load: Vec<f64>,
    /// Set-point, likewise.
    pub wanted: Vec<f64>,
    /// Limit of the output either way.
    pub limit: f64,
    /// Step of the converter; 0 for none.
    pub step: f64,
}

impl Loop {
    /// Output and process value.
    pub fn run(&self, samples: usize, random: &mut Pcg64) -> (Vec<f64>, Vec<f64>) {
        let mut normal = || -> f64 { StandardNormal.sample(random) };
        let (mut first, mut second, mut walk, mut integral) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
        let (mut x, mut last, mut sliding) = (0.0f64, 0.0f64, 0.0f64);
        let mut positions = vec![0.0; self.delay + 1];
        let kept = |lag: f64| if lag > 0.0 { (-1.0 / lag).exp() } else { 0.0 };
        let (a, b) = (kept(self.lags.0), kept(self.lags.1));
        let (mut outputs, mut values) = (Vec::new(), Vec::new());
        for t in 0..samples {
            walk = 0.995 * walk + self.noise.1 * normal();
            let load = self.load.get(t).copied().unwrap_or(0.0) + walk;
            let input = positions[t % positions.len()] + load;
            first = a * first + (1.0 - a) * self.gain * input;
            second = b * second + (1.0 - b) * first;
            let mut value = second + self.noise.0 * normal();
            if self.step > 0.0 {
                value = (value / self.step).round() * self.step;
            }
            let error = self.wanted.get(t).copied().unwrap_or(0.0) - value;
            integral = (integral + self.controller * error / self.integral).clamp(-self.limit, self.limit);
            let output = (self.controller * error + integral).clamp(-self.limit, self.limit);
            match self.stem {
                Some((band, jump, slides)) => {
                    if (output - last) * sliding <= 0.0 {
                        sliding = 0.0;
                    }
                    let direction = if sliding == 0.0 { (output - x).signum() } else { sliding };
                    if sliding != 0.0 || (output - x).abs() > 0.5 * (band + jump) {
                        x = output - direction * 0.5 * (band - jump);
                        sliding = if slides { direction } else { 0.0 };
                    }
                }
                None if self.curved > 0.0 => x = 50.0 * ((1.0 + output / 50.0).max(0.0).powf(self.curved) - 1.0),
                None => x = output,
            }
            last = output;
            let place = t % positions.len();
            positions[place] = x;
            outputs.push(50.0 + (1e4 * output).round() / 1e4);
            values.push(100.0 + (1e4 * value).round() / 1e4);
        }
        (outputs, values)
    }

    /// How much more the controller may amplify before the loop oscillates by itself.
    fn reserve(&self) -> f64 {
        let (mut low, mut high) = (0.02f64, 50.0f64);
        for _ in 0..24 {
            let middle = (low * high).sqrt();
            let tried = Loop { controller: middle * self.controller, limit: 1e9, wanted: vec![1.0; 1500], ..self.clone() };
            let (_, y) = tried.run(1500, &mut Pcg64::seed_from_u64(0));
            let swing = |part: &[f64]| part.windows(2).map(|w| (w[1] - w[0]).powi(2)).sum::<f64>();
            if swing(&y[1100..]) < swing(&y[600..1000]) { low = middle } else { high = middle }
        }
        low
    }
}

/// A record of a loop with this trouble: output and process value.
pub fn record(trouble: Trouble, seed: u64) -> (Vec<f64>, Vec<f64>) {
    let mut random = Pcg64::seed_from_u64(100 * seed + TROUBLES.iter().position(|t| *t == trouble).unwrap_or(0) as u64);
    loop {
        if let Some(found) = tried(trouble, &mut random) {
            return found;
        }
    }
}

fn tried(trouble: Trouble, random: &mut Pcg64) -> Option<(Vec<f64>, Vec<f64>)> {
    let uniform = |random: &mut Pcg64, low: f64, high: f64| Uniform::new(low, high).map_or(low, |u| u.sample(random));
    let spread = |random: &mut Pcg64, low: f64, high: f64| low * (high / low).powf(uniform(random, 0.0, 1.0));
    let samples = WARM + 500 + uniform(random, 0.0, 400.0) as usize;
    let lag = spread(random, 2.0, 50.0);
    let second = if uniform(random, 0.0, 1.0) < 0.4 { lag * uniform(random, 0.1, 0.8) } else { 0.0 };
    let delay = 1 + (spread(random, 0.05, 0.6) * lag.min(25.0)) as usize;
    let gain = spread(random, 0.3, 5.0) * if uniform(random, 0.0, 1.0) < 0.25 { -1.0 } else { 1.0 };
    // Internal model control with a closed loop of one to five delays.
    let dead = delay as f64 + 0.5 + 0.5 * second;
    let closed = dead * spread(random, 0.8, 4.0);
    let mut it = Loop {
        gain,
        lags: (lag, second),
        delay,
        controller: lag / (gain * (closed + dead)),
        integral: lag.min(4.0 * (closed + dead)) * spread(random, 0.4, 1.2),
        limit: 50.0,
        ..Loop::default()
    };
    let period = (dead + 2.0) * spread(random, 4.0, 20.0);
    let amplitude = spread(random, 1.0, 8.0);
    let jitter = 0.2 * uniform(random, 0.0, 1.0);
    let mut phase = uniform(random, 0.0, std::f64::consts::TAU);
    let sine: Vec<f64> = (0..samples)
        .map(|_| {
            let normal: f64 = StandardNormal.sample(random);
            phase += std::f64::consts::TAU / period * (1.0 + jitter * normal);
            amplitude * phase.sin()
        })
        .collect();
    let mut walk = if uniform(random, 0.0, 1.0) < 0.6 { spread(random, 0.003, 0.06) } else { 0.0 };
    match trouble {
        Trouble::Slides | Trouble::Steps => {
            let band = spread(random, 1.5, 12.0);
            it.stem = Some((band, band * uniform(random, 0.0, 1.0), trouble == Trouble::Slides));
        }
        Trouble::Tuning => {
            it.controller *= it.reserve() * uniform(random, 0.93, 1.0);
            walk = spread(random, 0.02, 0.3);
            it.wanted = (0..samples).map(|t| if t < WARM - 100 { 0.0 } else { 5.0 * gain }).collect();
        }
        Trouble::Sine => it.load = sine,
        Trouble::Clipped => it.load = sine.iter().map(|v| v.clamp(-0.5 * amplitude, 0.5 * amplitude)).collect(),
        Trouble::Neighbour => {
            let band = spread(random, 2.0, 10.0);
            let other =
                Loop { stem: Some((band, 0.5 * band, true)), lags: (spread(random, 2.0, 50.0), 0.0), noise: (0.01, 0.0), ..it.clone() };
            let (_, y) = other.run(samples, random);
            let swing = y.iter().map(|v| (v - 100.0).abs()).fold(0.0, f64::max);
            it.load = y.iter().map(|v| amplitude * (v - 100.0) / swing.max(1e-3)).collect();
        }
        Trouble::Walk => walk = spread(random, 0.3, 1.5),
        Trouble::SetPoint => {
            let mut wanted = 0.0;
            let mut next = || {
                if uniform(random, 0.0, 1.0) < 0.012 {
                    wanted = gain * uniform(random, -8.0, 8.0);
                }
                wanted
            };
            it.wanted = (0..samples).map(|_| next()).collect();
        }
        Trouble::Limits => {
            it.controller *= it.reserve() * uniform(random, 1.02, 1.3);
            it.limit = uniform(random, 3.0, 20.0);
            it.wanted = (0..samples).map(|t| if t < 200 { 0.0 } else { 0.5 * gain }).collect();
        }
        Trouble::Curved => (it.curved, it.load) = (spread(random, 0.4, 3.0), sine.iter().map(|v| 2.5 * v).collect()),
        Trouble::Coarse => it.load = sine,
        Trouble::Quiet => walk = spread(random, 0.05, 0.5),
    }
    it.noise.1 = walk;
    let deviation = |v: &[f64]| {
        let mean = v.iter().sum::<f64>() / v.len() as f64;
        (v.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / v.len() as f64).sqrt()
    };
    let swing = deviation(&it.run(samples, &mut Pcg64::seed_from_u64(1)).1[WARM..]);
    if !(swing > 1e-3 * gain.abs() && swing < 1e4) {
        return None;
    }
    it.noise.0 = swing * spread(random, 0.003, 0.15);
    if trouble == Trouble::Coarse {
        it.step = swing * uniform(random, 0.3, 1.5);
    }
    let (mut u, mut y) = it.run(samples, random);
    let (u, y) = (u.split_off(WARM), y.split_off(WARM));
    (deviation(&u) > 0.05).then_some((u, y))
}
