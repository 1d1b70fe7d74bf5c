//! A candidate model: the base valve with its parameters free within what the calibration allows, and effects.

use super::base::{BASE, Base};
use super::evidence::Evidence;
use super::prior::{Heavy, Prior};
use crate::physics::{Effect, MOST_INNER, Parameter, Pipeline, Sampling, resolve, specification};
use crate::valve::{Hysteresis, Input, Polynomial, ReferenceCurves, Valve};

/// One parameter of the vector that a fit moves.
#[derive(Debug, Clone, Copy)]
pub struct Free {
    /// Smallest and largest value.
    pub range: (f64, f64),
    /// Moved by its logarithm.
    pub log: bool,
    /// Step of the finite difference (a ratio where `log`).
    pub step: f64,
    /// Whether a recording tells it by steps of this size.
    pub resolved: bool,
    /// What the calibration says; none for an effect's parameter.
    pub prior: Option<Prior>,
}

impl Free {
    /// How far it moves from one value to another, in the units in which it moves.
    pub fn distance(&self, from: f64, to: f64) -> f64 {
        if self.log { (to / from).ln() } else { to - from }
    }

    /// Whether it does not move at all.
    pub fn is_still(&self) -> bool {
        self.range.0 == self.range.1
    }

    /// Whether `step` would push it through the end of its range at which it stands.
    pub fn is_blocked(&self, value: f64, step: f64) -> bool {
        value <= self.range.0 && step < 0.0 || value >= self.range.1 && step > 0.0
    }
}

/// Largest lag that the slow sweep of an identification cannot see: coil, spool and hold of the command [s].
pub const UNSEEN_LAG_S: f64 = 0.015;

/// Samples that the lag of a process may last.
const LONGEST_PROCESS: f64 = 60.0;
/// The step with which valves are recorded [s].
pub const VALVE_STEP_S: f64 = 0.01;

/// The lag that coil, spool and hold usually have, and its spread [s].
const USUAL_LAG_S: (f64, f64) = (0.005, 0.0035);

/// How far a good calibration may be off. A slow sweep shows the sum of delay and lag well, and how it is split hardly.
pub const CALIBRATION: Base<f64> = Base { gain: 0.003, offset: 0.03, width: 0.08, ln_a: 0.7, late: 0.0015, lag: USUAL_LAG_S.1 };

/// The largest lag of the base where the one that was calibrated is believed [s].
fn believed_lag_s(valve: &Valve) -> f64 {
    1.3 * valve.lag_s + UNSEEN_LAG_S
}

/// A base valve with a list of effects.
#[derive(Clone)]
pub struct Model<'a> {
    /// The valve as calibrated.
    pub valve: &'a Valve,
    /// Effects that the valve file already has, fixed.
    pub(super) fixed: Vec<(&'static dyn Effect, Vec<f64>)>,
    /// Effects whose parameters are free.
    pub effects: Vec<&'static dyn Effect>,
    /// What the signature of each says beyond the fit [nats].
    signature_nats: Vec<f64>,
    /// Which parameters of each stay at their defaults.
    pub(super) held: Vec<Vec<bool>>,
    /// Largest lag that counts as part of the base [s].
    pub(super) lag_limit_s: f64,
    /// How much slower than a valve the recorded process is.
    pub slowness: f64,
    /// Step of the recording where the base is a foreign model, of which gain, zero and delay alone can move [s].
    pub(super) foreign_step_s: Option<f64>,
    /// How far the model is off where nothing is wrong [bar].
    pub(super) form_error_bar: f64,
    /// Whether the calibration stays as it is.
    pub(super) is_still: bool,
    /// How the recording is sampled that it is fitted to.
    pub(super) sampling: Sampling,
}

impl<'a> Model<'a> {
    /// The base model alone.
    ///
    /// # Errors
    /// Where the valve names an effect that does not exist.
    pub fn base(valve: &'a Valve) -> Result<Self, crate::physics::PhysicsError> {
        let fixed = valve.effects.iter().map(resolve).collect::<Result<_, _>>()?;
        Ok(Self {
            valve,
            fixed,
            effects: Vec::new(),
            signature_nats: Vec::new(),
            held: Vec::new(),
            lag_limit_s: believed_lag_s(valve),
            slowness: 1.0,
            foreign_step_s: None,
            form_error_bar: 0.0,
            is_still: false,
            sampling: Sampling { length_s: 60.0, step_s: VALVE_STEP_S },
        })
    }

    /// This model about the base of the evidence, which may be a foreign one.
    pub fn on(self, evidence: &Evidence) -> Self {
        Self { foreign_step_s: evidence.base.as_ref().map(|_| evidence.step_s()), sampling: evidence.sampling(), ..self }
    }

    /// This model, known to be off by so much where nothing is wrong [bar]: on another drive its gain and its zero may be off by
    /// that, too.
    pub fn off_by(self, form_error_bar: f64) -> Self {
        Self { form_error_bar, ..self }
    }

    /// This model with a calibration that stays as it is.
    pub fn standing_still(&self) -> Self {
        Self { is_still: true, ..self.clone() }
    }

    /// This model with no more lag than a slow sweep cannot see: a longer one, which an identification took in and the
    /// recording does not confirm, is then an effect like any other.
    pub fn distrusting_lag(&self) -> Self {
        Self { lag_limit_s: UNSEEN_LAG_S, ..self.clone() }
    }

    /// This model with the lag that was calibrated, where it was not believed.
    pub fn believing_lag(&self) -> Option<Self> {
        let lag_limit_s = believed_lag_s(self.valve);
        (self.lag_limit_s < lag_limit_s).then(|| Self { lag_limit_s, ..self.clone() })
    }

    /// This model for a recording of a process with samples of `dt_s`, whose lag is part of the base however long it is.
    pub fn of_process(&self, dt_s: f64) -> Self {
        Self { lag_limit_s: LONGEST_PROCESS * dt_s, slowness: dt_s / VALVE_STEP_S, ..self.clone() }
    }

    /// Whether this lag [s] is what the model has, or too small to be seen.
    pub fn confirms_lag(&self, lag_s: f64) -> bool {
        // The lag of a process belongs to the model however it differs.
        if self.slowness > 1.0 {
            return true;
        }
        self.valve.lag_s <= UNSEEN_LAG_S || (0.7..1.3).contains(&(lag_s / self.valve.lag_s))
    }

    /// This model with one effect more, for which its signature says `signature_nats` beyond the fit.
    pub fn with(&self, effect: &'static dyn Effect, signature_nats: f64) -> Self {
        let mut more = self.clone();
        more.effects.push(effect);
        more.signature_nats.push(signature_nats);
        more.held.push(vec![false; effect.parameters().len()]);
        more
    }

    /// This model with parameter `j` of its last effect held at its default; nothing where it has none or is held.
    pub fn holding(&self, j: usize) -> Option<Self> {
        let default = self.effects.last()?.parameters().get(j)?.default;
        let mut simpler = self.clone();
        let held = simpler.held.last_mut()?;
        (default.is_some() && !std::mem::replace(&mut held[j], true)).then_some(simpler)
    }

    /// This model with an effect more whose values stay.
    pub fn beside(&self, effect: &'static dyn Effect, values: Vec<f64>) -> Self {
        let mut more = self.clone();
        more.fixed.push((effect, values));
        more
    }

    /// What the signatures of the effects say beyond the fit [nats].
    pub fn signature_nats(&self) -> f64 {
        self.signature_nats.iter().sum()
    }

    /// This model without its effect number `k`.
    pub fn without(&self, k: usize) -> Self {
        let mut less = self.clone();
        less.effects.remove(k);
        less.signature_nats.remove(k);
        less.held.remove(k);
        less
    }

    /// Where the parameters of effect number `k` stand in the vector.
    pub fn place(&self, k: usize) -> std::ops::Range<usize> {
        let from = BASE + self.effects[..k].iter().map(|e| e.parameters().len()).sum::<usize>();
        from..from + self.effects[k].parameters().len()
    }

    /// The vector of the base as calibrated, without effects.
    pub fn calibrated(&self) -> Vec<f64> {
        let ln_a = match self.valve.hysteresis {
            Hysteresis::Hyperbolic { a_bar2 } => a_bar2.max(1e-6).ln(),
            Hysteresis::None | Hysteresis::Free(_) => 0.0,
        };
        let lag_s = self.valve.lag_s.min(self.lag_limit_s);
        Base { gain: 0.0, offset: 0.0, width: 0.0, ln_a, late: self.valve.delay_s + lag_s, lag: lag_s }.in_order().to_vec()
    }

    /// The free parameters, in the order of the vector.
    pub fn free(&self) -> Vec<Free> {
        let start = Base::of(&self.calibrated());
        let (bottom, top) = self.valve.curves.pressure_range_bar();
        // Offset and loop width in parts of the pressure that the curves span.
        let part = if (0.2..5.0).contains(&((top - bottom) / 30.0)) { 1.0 } else { (top - bottom).abs() / 30.0 };
        let about = |mean: f64, half: f64, step: f64, sigma: f64, heavy: Heavy| Free {
            range: (mean - half, mean + half),
            log: false,
            step,
            resolved: false,
            prior: Some(Prior { mean, sigma, heavy }),
        };
        // Over the span of the curves, and at any of their points.
        let (gain, offset) = (self.form_error_bar / (top - bottom).abs().max(1e-9), self.form_error_bar);
        let late_heavy = if self.valve.lag_s > self.lag_limit_s { Heavy::Both } else { Heavy::Below };
        let usual = Prior { mean: USUAL_LAG_S.0, sigma: CALIBRATION.lag, heavy: Heavy::Below };
        let mut base = Base {
            gain: about(start.gain, 0.3, 1e-4, CALIBRATION.gain.hypot(gain), Heavy::No),
            offset: about(start.offset, 3.0 * part, 2e-3, (CALIBRATION.offset * part).hypot(offset), Heavy::No),
            width: about(start.width, 3.0 * part, 2e-3, CALIBRATION.width * part, Heavy::Both),
            ln_a: about(start.ln_a, 5.0, 0.02, CALIBRATION.ln_a, Heavy::Both),
            late: Free {
                range: (0.0, start.late + 0.15 * self.slowness),
                ..about(start.late, 0.0, 3e-4 * self.slowness, CALIBRATION.late * self.slowness, late_heavy)
            },
            lag: Free {
                range: (0.0, self.lag_limit_s),
                log: false,
                step: 3e-4 * self.slowness,
                resolved: false,
                prior: (self.lag_limit_s <= 1.5 * UNSEEN_LAG_S).then_some(usual),
            },
        };
        let still = |value: f64| Free { range: (value, value), log: false, step: 0.0, resolved: false, prior: None };
        if let Some(step_s) = self.foreign_step_s {
            (base.width, base.ln_a, base.lag) = (still(start.width), still(start.ln_a), still(start.lag));
            base.late.range.0 = -base.late.range.1;
            // Whether a simulation reads its command at the begin or the end of a step is its own affair.
            let sigma = CALIBRATION.late.hypot(step_s);
            base.late.prior = Some(Prior { mean: start.late, sigma, heavy: Heavy::No });
        }
        let mut free = if self.is_still { start.in_order().map(still).to_vec() } else { base.in_order().to_vec() };
        for (effect, held) in self.effects.iter().zip(&self.held) {
            free.extend(effect.parameters().iter().zip(held).enumerate().map(|(k, (p, held))| {
                let resolved = effect.resolved(k, self.sampling);
                let log = resolved.is_none() && p.range.0 > 0.0 && p.range.1 / p.range.0 > 20.0;
                let size = self.size(p);
                // A fit looks for effects of the size of this valve's own signals.
                let range = if size == 1.0 { p.range } else { (p.range.0 * size, p.range.1 * size) };
                let usual = if log { 4e-3 } else { 2e-4 * (p.range.1 - p.range.0).min(20.0) * size };
                let step = resolved.unwrap_or(usual);
                let range = p.default.filter(|_| *held).map_or(range, |value| (value, value));
                Free { range, log, step, resolved: resolved.is_some(), prior: None }
            }));
        }
        free
    }

    /// How much larger the signals of this valve are than those of a clutch valve of 1 A and 30 bar, in the unit of a
    /// parameter; 1 for a valve of that order, and for what has no such unit. An input may be a duty, an output a flow.
    fn size(&self, parameter: &Parameter) -> f64 {
        let of_order_one = |ratio: f64| if (0.2..5.0).contains(&ratio) { 1.0 } else { ratio };
        let (low, high) = self.valve.curves.range_a;
        let (bottom, top) = self.valve.curves.pressure_range_bar();
        let (current, pressure) = (of_order_one((high - low).abs()), of_order_one((top - bottom).abs() / 30.0));
        match parameter.unit.symbol {
            "A" | "A/s" => current,
            "bar" | "bar/s" => pressure,
            "bar/A" => pressure / current,
            _ => 1.0,
        }
    }

    /// All combinations of the starts of an effect's parameters, in the size of this valve's signals.
    pub fn starts(&self, effect: &dyn Effect) -> Vec<Vec<f64>> {
        effect.parameters().iter().fold(vec![Vec::new()], |all, p| {
            let size = self.size(p);
            all.iter().flat_map(|begin| p.starts.iter().map(move |s| [begin.as_slice(), &[s * size]].concat())).collect()
        })
    }

    /// Number of free parameters that the effects bring.
    pub fn extra_parameters(&self) -> usize {
        self.held.iter().flatten().filter(|held| !**held).count()
    }

    /// Number of free parameters that the effects bring and that may go either way from nothing.
    pub fn two_sided_parameters(&self) -> usize {
        let parameters = self.effects.iter().flat_map(|e| e.parameters()).zip(self.held.iter().flatten());
        parameters.filter(|(p, held)| !**held && p.range.0 < 0.0 && p.range.1 > 0.0).count()
    }

    pub(super) fn curves(&self, theta: &[f64]) -> ReferenceCurves {
        let Base { gain, offset, width, .. } = Base::of(theta);
        let curves = &self.valve.curves;
        let moved = |p: &Polynomial, offset: f64| {
            let mut c: Vec<f64> = p.coefficients.iter().map(|c| c * (1.0 + gain)).collect();
            if let Some(constant) = c.last_mut() {
                *constant += offset;
            }
            Polynomial::new(c)
        };
        ReferenceCurves::on_range(
            moved(&curves.ascending, offset - 0.5 * width),
            moved(&curves.descending, offset + 0.5 * width),
            curves.range_a,
        )
    }

    /// All its effects with their values: those of the valve file, and those whose parameters are free.
    pub fn valued(&self, theta: &[f64]) -> Vec<(&'static dyn Effect, Vec<f64>)> {
        let free = self.effects.iter().enumerate().map(|(k, e)| (*e, theta[self.place(k)].to_vec()));
        self.fixed.iter().cloned().chain(free).collect()
    }

    pub(super) fn pipeline<'c>(&self, curves: &'c ReferenceCurves, theta: &[f64]) -> Pipeline<'c> {
        let base = Base::of(theta);
        let hysteresis = match self.valve.hysteresis {
            other @ (Hysteresis::None | Hysteresis::Free(_)) => other,
            Hysteresis::Hyperbolic { .. } => Hysteresis::Hyperbolic { a_bar2: base.ln_a.exp() },
        };
        Pipeline {
            curves,
            hysteresis,
            delay_s: base.delay_s(),
            lag_s: base.lag,
            floor_bar: self.valve.floor_bar,
            input: Input::Ramp,
            most_inner: MOST_INNER,
            effects: self.valued(theta),
        }
    }

    /// Steps of one block that the simulation of a sample takes.
    pub fn steps_per_sample(&self, evidence: &Evidence) -> usize {
        let theta = self.calibrated();
        let curves = self.curves(&theta);
        let pipeline = Pipeline { input: evidence.input, most_inner: evidence.most_inner, ..self.pipeline(&curves, &theta) };
        let dt_s = evidence.step_s();
        pipeline.steps_per_sample(&pipeline.context(0.0, dt_s, None))
    }

    /// The valve file that this model stands for.
    pub fn valve_file(&self, theta: &[f64]) -> Valve {
        let base = Base::of(theta);
        let mut valve = self.valve.clone();
        valve.curves = self.curves(theta);
        if let Hysteresis::Hyperbolic { a_bar2 } = &mut valve.hysteresis {
            *a_bar2 = base.ln_a.exp();
        }
        let delay_s = if self.foreign_step_s.is_some() { 0.0 } else { base.delay_s() };
        let shift = delay_s - valve.delay_s;
        valve.delay_s = delay_s;
        valve.delay_range_s = ((valve.delay_range_s.0 + shift).clamp(0.0, delay_s), (valve.delay_range_s.1 + shift).max(delay_s));
        valve.lag_s = base.lag;
        valve.effects.extend(self.effects.iter().enumerate().map(|(k, e)| specification(*e, &theta[self.place(k)])));
        valve
    }
}
