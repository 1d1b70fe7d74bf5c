//! The simulations of a fit: what lies before the first changed stage is kept, and several vectors go side by side.

use std::sync::Arc;

use super::base::AT;
use super::evidence::Evidence;
use super::model::Model;
use crate::physics::{EFFECTS, Pipeline, Signals, Stage, Stages, pressure_stages_abreast, signals};
use crate::valve::ReferenceCurves;

/// Simulates one model again and again on the same evidence; what lies before the first changed stage is kept.
#[derive(Clone)]
pub struct Simulator<'e> {
    evidence: &'e Evidence,
    /// Where between its curves the valve stands at first, the same for every run; otherwise as the evidence has it.
    pub start_share: Option<f64>,
    runs: Vec<Kept>,
}

#[derive(Default, Clone)]
struct Kept {
    current_key: Vec<f64>,
    current_a: Arc<Vec<f64>>,
    /// The same as the stages behind the curve read it.
    at_curve_a: Arc<Vec<f64>>,
    static_key: Vec<f64>,
    static_bar: Arc<Vec<f64>>,
}

impl Kept {
    /// Keeps what this vector makes of the stages up to the curve, unless it is kept already.
    fn take(&mut self, pipeline: &Pipeline<'_>, theta: &[f64], start_share: f64, (start_s, dt_s): (f64, f64), signals: &Signals<'_>) {
        let context = pipeline.context(start_s, dt_s, None);
        let mut current_key = vec![pipeline.dead_time_s()];
        for (k, (effect, values)) in pipeline.effects.iter().enumerate() {
            if effect.stage() < Stage::Static {
                current_key.extend([k as f64, EFFECTS.iter().position(|e| e.id() == effect.id()).map_or(-1.0, |at| at as f64)]);
                current_key.extend(values);
            }
        }
        let same_current = self.current_key == current_key && !self.current_a.is_empty();
        if !same_current {
            let mut current_a = Vec::new();
            pipeline.current_stages(&context, signals, &mut current_a);
            let mut at_curve_a = current_a.clone();
            pipeline.read_between(&context, &mut at_curve_a);
            (self.current_a, self.at_curve_a) = (Arc::new(current_a), Arc::new(at_curve_a));
            self.current_key = current_key;
        }
        let static_key = [theta[AT.gain], theta[AT.offset], theta[AT.width], theta[AT.ln_a]];
        if !same_current || self.static_key != static_key {
            let mut static_bar = vec![0.0; self.current_a.len()];
            pipeline.static_curve(start_share, &self.current_a, &mut static_bar);
            pipeline.read_between(&context, &mut static_bar);
            self.static_bar = Arc::new(static_bar);
            self.static_key = static_key.to_vec();
        }
    }
}

impl<'e> Simulator<'e> {
    /// For this evidence.
    pub fn new(evidence: &'e Evidence) -> Self {
        Self { evidence, start_share: None, runs: evidence.grids.iter().map(|_| Kept::default()).collect() }
    }

    /// For this evidence, with the valve between its curves at first: 0 on the ascending one, 1 on the descending.
    pub fn starting_at(evidence: &'e Evidence, start_share: f64) -> Self {
        Self { start_share: Some(start_share), ..Self::new(evidence) }
    }

    /// Pressure of all runs, one after the other [bar].
    pub fn pressure(&mut self, model: &Model<'_>, theta: &[f64], out: &mut Vec<f64>) {
        self.pressures(model, &[theta], std::slice::from_mut(out));
    }

    /// The same for several vectors of one model, side by side.
    pub fn pressures(&mut self, model: &Model<'_>, thetas: &[&[f64]], outs: &mut [Vec<f64>]) {
        let curves: Vec<ReferenceCurves> = thetas.iter().map(|theta| model.curves(theta)).collect();
        let (input, most_inner) = (self.evidence.input, self.evidence.most_inner);
        let ready = |(curves, theta)| Pipeline { input, most_inner, ..model.pipeline(curves, theta) };
        let pipelines: Vec<Pipeline<'_>> = curves.iter().zip(thetas.iter().copied()).map(ready).collect();
        if let Some(base) = &self.evidence.base {
            for ((pipeline, theta), out) in pipelines.into_iter().zip(thetas).zip(outs) {
                base.pressure(&self.evidence.grids, pipeline, theta, out);
            }
            return;
        }
        outs.iter_mut().for_each(Vec::clear);
        for ((grid, kept), share) in self.evidence.grids.iter().zip(&mut self.runs).zip(&self.evidence.start_shares) {
            let start_share = self.start_share.unwrap_or(*share);
            let signals = signals(grid);
            if pipelines.iter().any(|pipeline| pipeline.parts(grid.dt_s) > 1) {
                for (pipeline, out) in pipelines.iter().zip(outs.iter_mut()) {
                    let (mut work, mut pressure) = (Vec::new(), Vec::new());
                    pipeline.run_from(start_share, (grid.elapsed_s, grid.dt_s), &signals, &mut work, &mut pressure);
                    grid.at_readings(&mut pressure);
                    out.extend(pressure);
                }
                continue;
            }
            let from = outs.first().map_or(0, Vec::len);
            let mut at_curve_a: Vec<Arc<Vec<f64>>> = Vec::with_capacity(thetas.len());
            for ((pipeline, theta), out) in pipelines.iter().zip(thetas).zip(outs.iter_mut()) {
                kept.take(pipeline, theta, start_share, (grid.elapsed_s, grid.dt_s), &signals);
                out.extend_from_slice(&kept.static_bar);
                at_curve_a.push(Arc::clone(&kept.at_curve_a));
            }
            let stages = pipelines.iter().zip(&at_curve_a).zip(outs.iter_mut()).map(|((pipeline, at_curve_a), out)| Stages {
                pipeline,
                context: pipeline.context(grid.elapsed_s, grid.dt_s, None),
                at: signals.with_current(at_curve_a),
                pressure_bar: &mut out[from..],
            });
            pressure_stages_abreast(stages.collect());
            outs.iter_mut().for_each(|out| grid.at_readings(&mut out[from..]));
        }
    }

    /// Measured minus simulated [bar]; NaN where not measured.
    pub fn residual(&mut self, model: &Model<'_>, theta: &[f64], measured: &[f64], out: &mut Vec<f64>) {
        self.residuals(model, &[theta], measured, std::slice::from_mut(out));
    }

    /// The same for each of several vectors.
    pub fn residuals(&mut self, model: &Model<'_>, thetas: &[&[f64]], measured: &[f64], outs: &mut [Vec<f64>]) {
        self.pressures(model, thetas, outs);
        for (e, y) in outs.iter_mut().flat_map(|out| out.iter_mut().zip(measured)) {
            *e = y - *e;
        }
    }
}
