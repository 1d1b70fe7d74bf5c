//! The pipeline: a whole recorded current through a valve model, free-running from its own start.

use super::effect::{Context, PhysicsError, Signals, Stage};
use super::linear::{DelayLine, FirstOrder};
use super::{EFFECTS, Effect};
use crate::document::nearest;
use crate::valve::{EffectSpec, Hysteresis, ReferenceCurves, Valve, hyperbola_stretches};

/// Time steps that differ by more than this share of their median are resampled.
const UNEVEN: f64 = 0.02;

/// How much larger or smaller than a clutch valve's a foreign signal may be.
const FOREIGN: f64 = 1e4;

/// The effect and the parameter values that a specification in a valve file stands for.
pub fn resolve(spec: &EffectSpec) -> Result<(&'static dyn Effect, Vec<f64>), PhysicsError> {
    let effect = super::effect(&spec.id).ok_or_else(|| PhysicsError::UnknownEffect {
        id: spec.id.clone(),
        hint: nearest(&spec.id, EFFECTS.iter().map(|e| e.id())).map_or(String::new(), |n| format!(", did you mean `{n}`?")),
        known: EFFECTS.iter().map(|e| e.id()).collect::<Vec<_>>().join(", "),
    })?;
    let parameters = effect.parameters();
    if let Some((name, _)) = spec.parameters.iter().find(|(name, _)| !parameters.iter().any(|p| p.name == name)) {
        let known: Vec<_> = parameters.iter().map(|p| p.name).collect();
        return Err(PhysicsError::UnknownParameter { effect: spec.id.clone(), name: name.clone(), known: known.join(", ") });
    }
    let value = |p: &super::Parameter| {
        let Some((_, text)) = spec.parameters.iter().find(|(name, _)| name == p.name) else {
            let missing = || PhysicsError::MissingParameter { effect: spec.id.clone(), name: p.name.into(), meaning: p.meaning.into() };
            return p.default.ok_or_else(missing);
        };
        let value = p.unit.parse(text).map_err(|source| PhysicsError::Quantity {
            effect: spec.id.clone(),
            name: p.name.into(),
            source: Box::new(source),
        })?;
        // A valve with a foreign input or output (a duty, a flow) has effects of that size.
        let size = if matches!(p.unit.symbol, "A" | "A/s" | "bar" | "bar/s" | "bar/A") { FOREIGN } else { 1.0 };
        let (low, high) = if p.range.0 < 0.0 { (p.range.0 * size, p.range.1 * size) } else { (p.range.0 / size, p.range.1 * size) };
        let slack = 1e-9 * (high - low);
        if !(low - slack..=high + slack).contains(&value) {
            let with_unit = |v: f64| format!("{v} {}", p.unit.symbol);
            return Err(PhysicsError::OutOfRange {
                effect: spec.id.clone(),
                name: p.name.into(),
                value: text.clone(),
                low: with_unit(low),
                high: with_unit(high),
            });
        }
        Ok(value)
    };
    Ok((effect, parameters.iter().map(value).collect::<Result<_, _>>()?))
}

/// The specification of an effect with these values, as it stands in a valve file.
pub fn specification(effect: &dyn Effect, theta: &[f64]) -> EffectSpec {
    let text = |(p, v): (&super::Parameter, &f64)| {
        let unit = if p.unit.symbol == "1" { String::new() } else { format!(" {}", p.unit.symbol) };
        (p.name.to_string(), format!("{v}{unit}"))
    };
    EffectSpec { id: effect.id().into(), parameters: effect.parameters().iter().zip(theta).map(text).collect() }
}

/// A valve model made ready to simulate signals of one time step, again and again.
pub struct Pipeline<'a> {
    /// Reference curves.
    pub curves: &'a ReferenceCurves,
    /// Path between the curves.
    pub hysteresis: Hysteresis,
    /// Dead time [s].
    pub delay_s: f64,
    /// First-order lag of the chamber [s].
    pub lag_s: f64,
    /// Tank pressure [bar].
    pub floor_bar: Option<f64>,
    /// Further effects with their values.
    pub effects: Vec<(&'static dyn Effect, Vec<f64>)>,
}

impl<'a> Pipeline<'a> {
    /// The pipeline of a valve file.
    ///
    /// # Errors
    /// [`PhysicsError`] where an effect or a parameter is not known or out of range.
    pub fn of(valve: &'a Valve) -> Result<Self, PhysicsError> {
        let effects = valve.effects.iter().map(resolve).collect::<Result<_, _>>()?;
        let Valve { curves, hysteresis, delay_s, lag_s, floor_bar, .. } = valve;
        Ok(Self { curves, hysteresis: *hysteresis, delay_s: *delay_s, lag_s: *lag_s, floor_bar: *floor_bar, effects })
    }

    /// Whether nothing but the static model remains, so that the time step does not matter.
    fn is_static(&self) -> bool {
        self.delay_s == 0.0 && self.lag_s == 0.0 && self.effects.is_empty()
    }

    /// What a block needs to know of this simulation.
    pub fn context(&self, start_s: f64, dt_s: f64, seed: Option<u64>) -> Context {
        let range_a = self.curves.range_a;
        let (low, high) = (self.curves.average_at(range_a.0), self.curves.average_at(range_a.1));
        Context { dt_s, start_s, range_a, slope_bar_per_a: (high - low) / (range_a.1 - range_a.0), seed }
    }

    /// Pressure [bar] at each sample of an even grid, free-running. `work` holds the current at the static curve.
    pub fn run(&self, start_s: f64, dt_s: f64, current_a: &[f64], work: &mut Vec<f64>, pressure_bar: &mut Vec<f64>) {
        let context = self.context(start_s, dt_s, None);
        self.current_stages(&context, current_a, work);
        pressure_bar.resize(current_a.len(), 0.0);
        self.static_curve(0.5, work, pressure_bar);
        self.pressure_stages(&context, work, pressure_bar);
    }

    /// The stages before the static curve: command in, current at the curve out.
    pub fn current_stages(&self, context: &Context, current_a: &[f64], work: &mut Vec<f64>) {
        let extra: f64 = self.effects.iter().filter(|(e, _)| e.id() == "transport_delay").map(|(_, theta)| theta[0]).sum();
        DelayLine::apply((self.delay_s + extra).max(0.0), context.dt_s, current_a, work);
        for stage in [Stage::Coil, Stage::Spool] {
            for (effect, theta) in self.effects.iter().filter(|(e, _)| e.stage() == stage) {
                let input = work.clone();
                effect.block(theta, context).run(Signals { current_a: &input }, work);
            }
        }
    }

    /// The static curve with its hysteresis. `start_share` is where the valve stands at first: 0 on the ascending curve,
    /// 1/2 on the average, 1 on the descending.
    pub fn static_curve(&self, start_share: f64, current_a: &[f64], pressure_bar: &mut [f64]) {
        match (self.hysteresis, current_a.first()) {
            (Hysteresis::Hyperbolic { a_bar2 }, Some(first)) => {
                let (low, high) = (self.curves.ascending_at(*first), self.curves.descending_at(*first));
                hyperbola_stretches(self.curves, a_bar2, low + start_share * (high - low), current_a, pressure_bar);
            }
            _ => {
                for (i, p) in current_a.iter().zip(pressure_bar) {
                    *p = self.curves.average_at(*i);
                }
            }
        }
    }

    /// The stages after the static curve, in place.
    pub fn pressure_stages(&self, context: &Context, current_a: &[f64], pressure_bar: &mut [f64]) {
        let stages = |stage: Stage, pressure_bar: &mut [f64]| {
            for (effect, theta) in self.effects.iter().filter(|(e, _)| e.stage() == stage) {
                effect.block(theta, context).run(Signals { current_a }, pressure_bar);
            }
        };
        stages(Stage::Static, pressure_bar);
        stages(Stage::Curve, pressure_bar);
        stages(Stage::Supply, pressure_bar);
        if let Some(floor) = self.floor_bar {
            for p in pressure_bar.iter_mut() {
                *p = p.max(floor);
            }
        }
        if self.lag_s > 0.0 {
            FirstOrder::new(self.lag_s, context.dt_s).run(pressure_bar);
        }
        stages(Stage::Chamber, pressure_bar);
        stages(Stage::Creep, pressure_bar);
        stages(Stage::Sensor, pressure_bar);
    }
}

/// Simulates one recorded run: pressure [bar] at each time, free-running from the average curve at its first current.
///
/// A gap (NaN) in the current holds its last value. Uneven times are simulated on an even grid of their median step.
///
/// # Errors
/// [`PhysicsError`] for unequal lengths, times that do not increase, a current that is never recorded.
pub fn simulate(valve: &Valve, time_s: &[f64], current_a: &[f64]) -> Result<Vec<f64>, PhysicsError> {
    if time_s.len() != current_a.len() {
        return Err(PhysicsError::Input(format!("{} times, but {} currents", time_s.len(), current_a.len())));
    }
    if let Some(row) = time_s.windows(2).position(|w| w[1] <= w[0] || w[1].is_nan() || w[0].is_nan()) {
        return Err(PhysicsError::Input(format!("time does not increase at sample {}", row + 2)));
    }
    let Some(first) = current_a.iter().copied().find(|i| i.is_finite()) else {
        return if current_a.is_empty() { Ok(Vec::new()) } else { Err(PhysicsError::Input("the current is never recorded".into())) };
    };
    let mut last = first;
    let held: Vec<f64> = current_a
        .iter()
        .map(|i| {
            if i.is_finite() {
                last = *i;
            }
            last
        })
        .collect();
    let pipeline = Pipeline::of(valve)?;
    let (mut work, mut pressure) = (Vec::new(), Vec::new());
    if time_s.len() < 2 || pipeline.is_static() {
        pipeline.run(time_s[0], 0.01, &held, &mut work, &mut pressure);
        return Ok(pressure);
    }
    let mut steps: Vec<f64> = time_s.windows(2).map(|w| w[1] - w[0]).collect();
    let middle = steps.len() / 2;
    let dt_s = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
    if steps.iter().all(|s| (s - dt_s).abs() <= UNEVEN * dt_s) {
        let dt_s = (time_s[time_s.len() - 1] - time_s[0]) / (time_s.len() - 1) as f64;
        pipeline.run(time_s[0], dt_s, &held, &mut work, &mut pressure);
        return Ok(pressure);
    }
    let span = time_s[time_s.len() - 1] - time_s[0];
    let n = (span / dt_s).ceil() as usize + 1;
    if n > 50 * time_s.len() + 1000 {
        return Err(PhysicsError::Input(format!(
            "the times leave gaps of up to {:.1} s at a step of {dt_s} s: split the recording into runs",
            steps.iter().fold(0.0, |a: f64, b| a.max(*b))
        )));
    }
    let even: Vec<f64> = (0..n).map(|k| time_s[0] + k as f64 * dt_s).collect();
    let current = interpolate(time_s, &held, &even);
    pipeline.run(time_s[0], dt_s, &current, &mut work, &mut pressure);
    Ok(interpolate(&even, &pressure, time_s))
}

/// Linear interpolation of `(x, y)` at increasing `at`; beyond the ends the end values.
fn interpolate(x: &[f64], y: &[f64], at: &[f64]) -> Vec<f64> {
    let mut k = 0;
    at.iter()
        .map(|t| {
            while k + 2 < x.len() && x[k + 1] <= *t {
                k += 1;
            }
            let share = ((t - x[k]) / (x[k + 1] - x[k])).clamp(0.0, 1.0);
            y[k] + share * (y[k + 1] - y[k])
        })
        .collect()
}
