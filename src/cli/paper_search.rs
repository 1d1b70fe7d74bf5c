//! The physics of the clutches of Table 1: a search over plausible causes for the paper's six figures.
//!
//! Causes that both clutches share (they are on one bench, with one oil): more noise and ripple than the model has, dead time and
//! lag of the messages and the driver. Causes that each has of its own: gain and zero of its curve. Every set of at most so many parameters is
//! fitted to the six figures by least squares, from several starts; the triangles of Fig. 5
//! and the ramps of Fig. 7, which the fit does not see, judge it.

use std::path::Path;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::CliError;
use super::valves::believed;
use crate::least_squares::{Equations, Landscape, Pace, descend};
use crate::plan::Plan;
use crate::record::{Dut, TestRecord};
use crate::rig::RigIdentity;
use crate::rig::simulated::SimulatedRig;
use crate::runner::{Prepared, RunOptions, run};
use crate::valve::{EffectSpec, Valve};

/// Table 1 of the paper: RMSE of the whole drive with feed-forward only, with K_P 1 and K_I 5, with K_P 1 and K_I 10, of clutch 1 and 2
/// [bar].
pub const TABLE_1: [[f64; 3]; 2] = [[0.413, 0.352, 0.312], [0.487, 0.362, 0.345]];
/// What the fit does not see, hyperbolic model: Fig. 5 (twice, for our two kinds of triangles) and Fig. 7 [bar].
pub const UNSEEN: [f64; 3] = [0.173, 0.173, 0.207];
/// Something that may differ between the model that the controller believes in and the clutches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// Standard deviation of noise and ripple [bar]; shared.
    Noise,
    /// Dead time between the command and the current in the coil [s]; shared.
    Delay,
    /// A first-order lag between the two [s]; shared.
    Lag,
    /// Offset of both curves [bar]; shared.
    Offset,
    /// Relative gain of the curve of each clutch.
    Gains,
    /// Offset of the curve of each clutch [bar].
    Offsets,
}

/// The effects by which the clutches have the dead time and the lag of the driver. (The pressure behind a lag is nearly that behind
/// the same lag of the current: the loop is narrow.)
const DRIVER: [&str; 2] = ["transport_delay", "first_order_lag"];

const CAUSES: [Cause; 6] = [Cause::Noise, Cause::Delay, Cause::Lag, Cause::Offset, Cause::Gains, Cause::Offsets];

impl Cause {
    /// Name in the table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Noise => "noise",
            Self::Delay => "dead time",
            Self::Lag => "lag",
            Self::Offset => "zero, shared",
            Self::Gains => "gains",
            Self::Offsets => "zeros",
        }
    }

    /// Number of parameters.
    pub fn parameters(self) -> usize {
        if matches!(self, Self::Gains | Self::Offsets) { 2 } else { 1 }
    }

    /// Where the search begins, and what counts as a step of its parameter.
    fn start(self) -> (f64, f64) {
        match self {
            Self::Noise => (0.15, 0.02),
            Self::Delay | Self::Lag => (0.02, 0.003),
            Self::Offset | Self::Offsets => (-0.3, 0.05),
            Self::Gains => (0.03, 0.005),
        }
    }

    /// Largest and smallest value that is plausible.
    fn range(self) -> (f64, f64) {
        match self {
            Self::Noise => (0.0, 0.5),
            Self::Delay | Self::Lag => (0.0, 0.09),
            Self::Offset | Self::Offsets => (-2.0, 2.0),
            Self::Gains => (-0.15, 0.15),
        }
    }
}

/// One set of causes with its fit.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The causes.
    pub causes: Vec<Cause>,
    /// Their values, in the order of the causes; two each for gains and zeros.
    pub values: Vec<f64>,
    /// The six figures [bar].
    pub figures: [[f64; 3]; 2],
    /// Largest miss [bar].
    pub worst_bar: f64,
    /// The figures of [`UNSEEN`], of both clutches [bar].
    pub unseen: [[f64; 3]; 2],
}

impl Fit {
    /// Number of parameters.
    pub fn parameters(&self) -> usize {
        self.values.len()
    }

    /// Largest relative miss of the figures that the fit did not see, of the nearer clutch: the paper does not say which one it is.
    pub fn off(&self) -> f64 {
        let of = |unseen: &[f64; 3]| unseen.iter().zip(UNSEEN).map(|(ours, paper)| (ours / paper - 1.0).abs()).fold(0.0, f64::max);
        of(&self.unseen[0]).min(of(&self.unseen[1]))
    }
}

/// Where a fit begins: sign and size of what a curve is off, as multiples of a cause's start. A zero has the other sign than a gain,
/// so that both leave the middle of the range where it is.
const STARTS: [f64; 4] = [1.0, -1.0, 3.0, -3.0];

/// How the fit to the six figures goes down.
const PACE: Pace = Pace { steps: 15, damping: 1e-2, least: 1e-6, raised: 8.0, tries: 7 };
/// A step that lowers the sum of squares by less ends it [bar^2]: a tenth of a millibar in each figure is printed by none.
const LEAST_GAIN: f64 = 1e-7;

/// The valve as the measured current drives it, which is what the paper gives its model in Figs. 5 to 7: without what stands
/// between the command and that current.
pub fn behind_the_driver(valve: &Valve) -> Valve {
    let effects = valve.effects.iter().filter(|e| !DRIVER.contains(&e.id.as_str())).cloned().collect();
    Valve { effects, ..valve.clone() }
}

/// What all evaluations share.
pub struct Search {
    plan: Plan,
    /// Figs. 5 and 7.
    unseen: [Plan; 2],
    valve: Valve,
    model: Valve,
    prepared: Prepared,
}

/// The valve of clutch 0 or 1 with these causes.
pub fn clutch(base: &Valve, causes: &[Cause], values: &[f64], which: usize) -> Valve {
    let mut valve = Valve { name: format!("clutch-{}", which + 1), ..base.clone() };
    let (mut gain, mut offset, mut k) = (0.0, 0.0, 0);
    let effect = |id: &str, name: &str, text: String| EffectSpec { id: id.into(), parameters: vec![(name.into(), text)] };
    for cause in causes {
        let value = values[k + if cause.parameters() == 2 { which } else { 0 }];
        k += cause.parameters();
        match cause {
            Cause::Noise => valve.noise_bar = value,
            Cause::Delay => valve.effects.push(effect("transport_delay", "extra", format!("{value} s"))),
            Cause::Lag => valve.effects.push(effect("first_order_lag", "tau", format!("{} s", value.max(1e-4)))),
            Cause::Offset | Cause::Offsets => offset = value,
            Cause::Gains => gain = value,
        }
    }
    if gain != 0.0 || offset != 0.0 {
        let parameters = vec![("gain".into(), format!("{gain}")), ("offset".into(), format!("{offset} bar"))];
        valve.effects.push(EffectSpec { id: "reference_shift".into(), parameters });
    }
    valve
}

impl Search {
    /// The search on `plans/gain-comparison.toml`, from `valve`, which the controller believes in.
    pub fn new(plans: &Path, valve: &Valve) -> Result<Self, CliError> {
        let load = |name: &str| Plan::load(&plans.join(name), &[]).map_err(CliError::input);
        let mut plan = load("gain-comparison.toml")?;
        let unseen = [load("triangle-amplitudes.toml")?, load("model-validation.toml")?];
        // Its rounds are alike: one tells as much as three.
        for phase in &mut plan.phases {
            phase.repeat = 1;
        }
        let model = believed(&plan, valve)?;
        let prepared = Prepared::default();
        Ok(Self { plan, unseen, valve: valve.clone(), model, prepared })
    }

    /// The figures of one clutch under a plan, phase by phase.
    fn run(&self, plan: &Plan, valve: &Valve, metric: &str) -> Option<Vec<f64>> {
        // The seed of the accepted reports: the noise is the same for every set, so that sets differ by what they are.
        let mut rig = SimulatedRig::new(valve, plan.period_s, Some(1), RigIdentity::default()).ok()?;
        let dut = Dut::default();
        let options = RunOptions { model: &self.model, dut: &dut, seed: 1, stop: None, prepared: Some(&self.prepared) };
        let record: TestRecord = run(plan, &mut rig, &options, &mut ()).0;
        Some(record.phases.iter().flat_map(|p| p.measurements.iter().find(|m| m.metric == metric)).filter_map(|m| m.value).collect())
    }

    /// The three figures of one clutch.
    fn figures(&self, valve: &Valve) -> Option<[f64; 3]> {
        self.run(&self.plan, valve, "rmse")?.try_into().ok()
    }

    /// The figures that the fit does not see: both triangles of Fig. 5, and the ramps of Fig. 7.
    fn unseen(&self, valve: &Valve) -> Option<[f64; 3]> {
        let [triangles, ramps] = &self.unseen;
        let mut found = self.run(triangles, valve, "model_rmse")?;
        found.extend(self.run(ramps, valve, "model_rmse")?.last());
        found.try_into().ok()
    }

    fn residuals(&self, causes: &[Cause], values: &[f64]) -> Option<Vec<f64>> {
        let each: Vec<Option<[f64; 3]>> =
            (0..2usize).into_par_iter().map(|which| self.figures(&clutch(&self.valve, causes, values, which))).collect();
        let mut out = Vec::with_capacity(6);
        for (which, figures) in each.into_iter().enumerate() {
            out.extend(figures?.iter().zip(TABLE_1[which]).map(|(f, t)| f - t));
        }
        Some(out)
    }

    /// The best values for a set of causes.
    pub fn fit(&self, causes: &[Cause]) -> Option<Fit> {
        let each: Vec<Cause> = causes.iter().flat_map(|c| std::iter::repeat_n(*c, c.parameters())).collect();
        let mut best: Option<Values> = None;
        for size in STARTS {
            // What both share begins a little further out with what each has of its own.
            let begin = |c: &Cause| {
                let of = c.start().0 * if matches!(c, Cause::Gains | Cause::Offset | Cause::Offsets) { size } else { size.abs().sqrt() };
                of.clamp(c.range().0, c.range().1)
            };
            let values: Vec<f64> = each.iter().map(begin).collect();
            let start = Values { residuals: self.residuals(causes, &values)?, values };
            let found = descend(&mut Figures { search: self, causes, each: &each }, start, &PACE).at;
            if best.as_ref().is_none_or(|b| squares(&found.residuals) < squares(&b.residuals)) {
                best = Some(found);
            }
        }
        let Values { values, residuals } = best?;
        let figures = [0, 1].map(|c| [0, 1, 2].map(|k| TABLE_1[c][k] + residuals[3 * c + k]));
        let worst_bar = residuals.iter().fold(0.0f64, |w, r| w.max(r.abs()));
        let unseen = [0, 1].map(|which| self.unseen(&behind_the_driver(&clutch(&self.valve, causes, &values, which))));
        let [Some(first), Some(second)] = unseen else { return None };
        Some(Fit { causes: causes.to_vec(), values, figures, worst_bar, unseen: [first, second] })
    }

    /// Every set of causes with at most `most` parameters that tells the clutches apart, the best first.
    pub fn all(&self, most: usize) -> Vec<Fit> {
        let sets: Vec<Vec<Cause>> = (1..1u32 << CAUSES.len())
            .map(|mask| (0..CAUSES.len()).filter(|k| mask >> k & 1 == 1).map(|k| CAUSES[k]).collect::<Vec<_>>())
            .filter(|set| set.iter().map(|c| c.parameters()).sum::<usize>() <= most)
            .filter(|set| set.contains(&Cause::Gains) || set.contains(&Cause::Offsets))
            // Two zeros hold the shared one.
            .filter(|set| !(set.contains(&Cause::Offset) && set.contains(&Cause::Offsets)))
            .collect();
        let mut fits: Vec<Fit> = sets.par_iter().filter_map(|set| self.fit(set)).collect();
        fits.sort_by(|a, b| a.worst_bar.total_cmp(&b.worst_bar));
        fits
    }
}

/// Values of a set of causes, and what the six figures miss with them [bar]; nothing where they could not be had.
struct Values {
    values: Vec<f64>,
    residuals: Vec<f64>,
}

/// The six figures over the values of one set of causes, each value counted in steps of its cause.
struct Figures<'s> {
    search: &'s Search,
    causes: &'s [Cause],
    /// The cause of each value.
    each: &'s [Cause],
}

impl Landscape for Figures<'_> {
    type Point = Values;
    type Slopes = Option<DMatrix<f64>>;

    fn slopes(&mut self, at: &Values) -> Option<DMatrix<f64>> {
        let columns: Option<Vec<DVector<f64>>> = (0..self.each.len())
            .into_par_iter()
            .map(|k| {
                let mut moved = at.values.clone();
                let step = self.each[k].start().1;
                let sign = if moved[k] + step > self.each[k].range().1 { -1.0 } else { 1.0 };
                moved[k] += sign * step;
                let found = self.search.residuals(self.causes, &moved)?;
                Some(DVector::from_iterator(found.len(), found.iter().zip(&at.residuals).map(|(a, b)| sign * (a - b))))
            })
            .collect();
        Some(DMatrix::from_columns(&columns?))
    }

    fn equations(&self, slopes: &Option<DMatrix<f64>>, at: &Values) -> Option<Equations> {
        let slopes = slopes.as_ref()?;
        Some(Equations { normal: slopes.tr_mul(slopes), gradient: slopes.tr_mul(&DVector::from_row_slice(&at.residuals)) })
    }

    /// At most five steps of a parameter at once.
    fn moved(&mut self, at: &Values, step: &DVector<f64>) -> Values {
        let value = |((v, s), c): ((&f64, &f64), &Cause)| (v - s.clamp(-5.0, 5.0) * c.start().1).clamp(c.range().0, c.range().1);
        let values: Vec<f64> = at.values.iter().zip(step).zip(self.each).map(value).collect();
        Values { residuals: self.search.residuals(self.causes, &values).unwrap_or_default(), values }
    }

    fn objective(&self, at: &Values) -> f64 {
        squares(&at.residuals)
    }

    fn is_worth_more(&self, _: f64, gain: f64) -> bool {
        gain >= LEAST_GAIN
    }

    fn is_blocked(&self, at: &Values, k: usize, step: f64) -> bool {
        let (low, high) = self.each[k].range();
        (at.values[k] <= low && step > 0.0) || (at.values[k] >= high && step < 0.0)
    }
}

/// Sum of the squares [bar^2]; infinite where there are none.
fn squares(residuals: &[f64]) -> f64 {
    if residuals.is_empty() {
        return f64::INFINITY;
    }
    residuals.iter().map(|r| r * r).sum()
}
