//! What a diagnosis says (`schema = "hil.diagnosis/1"`): the one value that its text, JSON and page are views of.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::coil::CoilCurrent;
use super::evidence::Evidence;
use super::foreign::Recalibration;
use super::mistake::Mistake;
use crate::least_squares::SIGMAS_95;
use crate::physics::Parameter;
use crate::valve::Valve;

/// The schema key of a diagnosis.
pub const SCHEMA: &str = "hil.diagnosis/1";

/// The answer in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Nothing beyond the noise floor and the base model's own accuracy is worth adding.
    Match,
    /// What is left after the effects is within that.
    Explained,
    /// Effects help, structure remains.
    PartlyExplained,
    /// Structure is there and no effect in the library carries it.
    Unexplained,
    /// Model and recording do not belong together: no cause was looked for.
    NotComparable,
}

/// Which question an effect answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Claim {
    /// The model has no such physics; that the valve has changed is not said.
    Lacks,
    /// The valve has changed: data of the good valve excludes it.
    Changed,
}

impl Claim {
    /// The claim in words.
    pub fn text(self) -> &'static str {
        match self {
            Self::Lacks => "the model lacks it; whether the valve has changed is not said",
            Self::Changed => "the valve has changed by it: data of the good valve excludes it",
        }
    }
}

/// A diagnosis of one recording against one model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    /// `hil.diagnosis/1`.
    pub schema: String,
    /// The recording, by its file name.
    pub recording: String,
    /// The model, by its name.
    pub model: String,
    /// The answer in one word.
    pub verdict: Verdict,
    /// The answer in one paragraph.
    pub summary: String,
    /// The likely mistake where the verdict is `not_comparable`, otherwise `null`.
    pub mistake: Option<Mistake>,
    /// Errors of the models.
    pub rmse_bar: Errors,
    /// What is missing or has changed, most important first.
    pub effects: Vec<Finding>,
    /// Corrections of the curve, the hysteresis or the dynamics that say nothing of a fault.
    pub form: Vec<Finding>,
    /// What a recalibration of the base would change: name, value and unit, where it is more than a trifle.
    pub recalibration: Vec<Change>,
    /// Where the base model errs.
    #[serde(rename = "where")]
    pub place: Place,
    /// All effects that were tried, best first.
    pub candidates: Vec<Candidate>,
    /// What is left and on what it depends; `null` where nothing is left.
    pub unexplained: Option<Remainder>,
    /// A term that no effect of the library holds, confirmed on data that its search has not seen; `null` where none is.
    #[serde(default)]
    pub discovered: Option<Discovery>,
    /// On which side of the measured coil current that lies; `null` where it was not recorded, or nothing is missing.
    #[serde(default)]
    pub coil_current: Option<CoilCurrent>,
    /// How far the augmented model has to be expected off on other drives; `null` where nothing is named, more is missing, or it was not
    /// simulated there.
    #[serde(default)]
    pub other_drives: Option<OtherDrives>,
    /// The experiment that would separate what cannot be told apart; `null` where nothing needs it.
    pub next_experiment: Option<NextExperiment>,
    /// What was noticed about the recording.
    pub notes: Vec<String>,
}

impl Diagnosis {
    /// Whether anything was found that the model as given has not: an effect, or a discovered term.
    pub fn adds(&self) -> bool {
        !self.effects.is_empty() || self.discovered.is_some()
    }

    /// Whether the augmented model follows this record, whatever it does on others.
    pub fn is_followed(&self) -> bool {
        self.verdict == Verdict::Explained || self.other_drives.as_ref().is_some_and(|there| there.is_too_much)
    }
}

/// Root mean square errors [bar].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// The base model as given, over the whole recording.
    pub base: f64,
    /// The base model as given, over the held-out stretches (all of the recording, in turn).
    #[doc(alias("held-out", "held-out error"))]
    pub base_heldout: f64,
    /// The base model recalibrated on the other stretches.
    pub refit_heldout: f64,
    /// The model with the effects, fitted on the other stretches.
    pub augmented_heldout: f64,
    /// The sensor noise: what no model can do better than.
    pub noise_floor: f64,
}

/// What a record leaves open of the augmented model, as pressure on other drives: its parameters within their errors, and the other
/// members of the credible sets.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OtherDrives {
    /// Standard deviation of the pressure over a menu of stimuli [bar].
    pub open_bar: f64,
    /// The stimulus on which it is largest.
    pub most_on: String,
    /// Whether it is why the verdict is not `explained`.
    pub is_too_much: bool,
}

/// A parameter and how sure it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Best value.
    pub value: f64,
    /// The distance to the farther end of the interval over 1.96; `null` where the recording does not bound the parameter on both sides, or
    /// where it stays at its default.
    pub std_error: Option<f64>,
    /// The 95 % interval; an end is `null` where the recording does not bound the parameter there. `null` where it stays at its default, or
    /// where nothing says how sure it is.
    #[serde(default)]
    pub interval: Option<Interval>,
    /// Unit of all.
    pub unit: String,
}

impl Estimate {
    /// A value whose error is as good as normal; what cannot be negative is not.
    pub fn normal(parameter: &Parameter, value: f64, std_error: Option<f64>) -> Self {
        let std_error = std_error.filter(|error| error.is_finite());
        let least = if parameter.range.0 < 0.0 { f64::NEG_INFINITY } else { 0.0 };
        let interval = std_error.map(|error| (Some((value - SIGMAS_95 * error).max(least)), Some(value + SIGMAS_95 * error)));
        Self { value, std_error, interval, unit: parameter.unit.symbol.into() }
    }
}

/// Low and high end, in the unit of the parameter; `None` where it is not bounded.
pub type Interval = (Option<f64>, Option<f64>);

/// One effect that is missing in the model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Id of the effect; of a class that cannot be told apart its likeliest member.
    pub id: String,
    /// Whether the model lacks it or the valve has changed by it.
    pub claim: Claim,
    /// Posterior share of the name among all that could stand in its place.
    #[doc(alias = "posterior share")]
    pub share: f64,
    /// Whether only the class is claimed: no single name has the share that a name needs.
    #[serde(rename = "class")]
    pub is_class: bool,
    /// Its parameters.
    pub parameters: BTreeMap<String, Estimate>,
    /// How much the held-out error grows without it [bar]; for an effect of the scatter its part of the error.
    pub heldout_gain_bar: f64,
    /// 95 % interval of that gain over the held-out blocks [bar].
    pub heldout_gain_ci_bar: Option<(f64, f64)>,
    /// Chance of such a gain were the effect not there, from sign flips of the held-out blocks.
    pub p_value: f64,
    /// The rest of the credible set (90 %), best first.
    #[doc(alias = "credible set")]
    pub indistinguishable: Vec<String>,
    /// What speaks for it.
    pub evidence: String,
}

/// A changed parameter of the base model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// `gain`, `offset`, `loop width`, `a`, `delay` or `lag`.
    pub parameter: String,
    /// In the model as given.
    pub before: f64,
    /// After the fit.
    pub after: f64,
    /// Unit of both.
    pub unit: String,
}

/// Where the base model errs.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Place {
    /// Stretches of time that carry the most of the squared error.
    pub windows: Vec<Window>,
    /// Operating regions that carry the most.
    pub regions: Vec<Region>,
    /// Frequencies between which the error beyond the noise lies [Hz]; `null` where there is none.
    pub band_hz: Option<(f64, f64)>,
}

/// A stretch of time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Window {
    /// Name of the run.
    pub run: Option<String>,
    /// Begin [s].
    pub from_s: f64,
    /// End [s].
    pub to_s: f64,
    /// Share of the squared error.
    pub share: f64,
    /// Share that the noise alone would have.
    pub noise_share: f64,
}

/// A range of one variable.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Region {
    /// `pressure_bar`, `current_a`, `rate_a_per_s`, `distance_since_reversal_a`, `time_since_reversal_s`, `dwell_s`.
    pub variable: String,
    /// Begin, in the unit of the variable's name.
    pub from: f64,
    /// End.
    pub to: f64,
    /// Share of the squared error.
    pub share: f64,
    /// Share of the samples: what an error without a place would have.
    pub samples_share: f64,
    /// Mean error, measured minus simulated [bar].
    pub mean_bar: f64,
}

/// One effect that was tried.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Id of the effect.
    pub id: String,
    /// RMSE on held-out stretches of the base with this effect alone [bar].
    pub heldout_rmse_bar: Option<f64>,
    /// BIC against "recalibrate only", on effective samples; negative is better.
    #[doc(alias = "BIC")]
    pub bic: f64,
    /// Why it is not among the effects; `null` for those that are.
    pub rejected_because: Option<String>,
}

/// What is left.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Remainder {
    /// RMS beyond the noise [bar].
    pub rms_bar: f64,
    /// The variables on which it depends, strongest first, with the share of its variance.
    pub depends_on: Vec<(String, f64)>,
    /// How much a table over the strongest variable lowers the held-out error [bar]; 0 where none does.
    pub table_heldout_gain_bar: f64,
    /// The stretches that carry it.
    pub windows: Vec<Window>,
}

/// A term that no effect of the library holds: what the error follows, never why.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Discovery {
    /// What was found, in one sentence.
    pub text: String,
    /// Whether the augmented model has it: only what a run confirms that its search has not seen, as the end of a recording repeats its
    /// begin.
    #[serde(default)]
    pub in_model: bool,
    /// What is added to the pressure: the terms, with units.
    pub formula: Vec<String>,
    /// The states that it follows, and where they were seen; beyond, a state counts as the end of its range.
    pub follows: Vec<Followed>,
    /// Root mean square of what it adds [bar].
    pub adds_bar: f64,
    /// Error of the model without it, on all data [bar].
    pub rmse_without_bar: f64,
    /// Error of the model with it, on all data [bar].
    pub rmse_with_bar: f64,
    /// On data that the search has not seen, for each formula that was added.
    pub unseen: Vec<OnUnseen>,
    /// How many functions of one or two states were tried.
    pub tried: usize,
    /// Chance that the best of so many is as good where there is nothing to find, from circular shifts of the error.
    pub p_value: f64,
}

/// A state that a discovered term follows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Followed {
    /// The state with its values, as a formula names it.
    pub state: String,
    /// Smallest value that was seen.
    pub from: f64,
    /// Largest value that was seen.
    pub to: f64,
    /// Unit of both.
    pub unit: String,
}

/// A discovered term on data that its search has not seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OnUnseen {
    /// `run` where that is a run of its own, `end` where it is the end of the only one.
    pub on: String,
    /// How long it is [s].
    pub lasts_s: f64,
    /// Error without the term [bar].
    pub rmse_without_bar: f64,
    /// Error with it [bar].
    pub rmse_with_bar: f64,
    /// 95 % interval of the difference over blocks [bar].
    pub gain_ci_bar: Option<(f64, f64)>,
    /// Chance of such a difference were the term not there, from sign flips of the blocks.
    pub p_value: f64,
}

/// A stimulus that separates rivals.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NextExperiment {
    /// What it separates: the effects that could stand in each other's place, the one that was named first; where something is left
    /// that none carries, those that come nearest.
    pub rivals: Vec<String>,
    /// Name of the stimulus.
    pub stimulus: String,
    /// RMS difference of the chosen model's and the likeliest rival's simulations on it that it separates at all, in units of the noise.
    pub separation_sigma: f64,
    /// What to do.
    pub text: String,
    /// The current [A] over the time [s] that it asks for.
    pub table: Vec<(f64, f64)>,
}

/// What the page of a diagnosis draws besides: the recording and the simulations on its grid, runs one after another.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Curves {
    /// Begin of each run in the columns, and its name.
    pub runs: Vec<(usize, Option<String>)>,
    /// Time [s].
    pub time_s: Vec<f64>,
    /// Command [A].
    pub current_a: Vec<f64>,
    /// Measured [bar].
    pub measured_bar: Vec<f64>,
    /// Base model as given [bar].
    pub base_bar: Vec<f64>,
    /// Base recalibrated [bar].
    pub refit_bar: Vec<f64>,
    /// With the effects [bar].
    pub augmented_bar: Vec<f64>,
    /// The runner-up in place of the first effect [bar]; empty where there is none.
    pub runner_up_bar: Vec<f64>,
}

impl Curves {
    /// The recording, and nothing simulated along it yet.
    pub fn along(evidence: &Evidence) -> Self {
        let mut begin = 0;
        let begins = evidence.grids.iter().map(|grid| {
            begin += grid.len();
            (begin - grid.len(), grid.name.clone())
        });
        Self {
            runs: begins.collect(),
            time_s: evidence.grids.iter().flat_map(|g| (0..g.len()).map(|k| g.reading_s(k))).collect(),
            current_a: evidence.grids.iter().flat_map(|g| g.current_a.iter().copied()).collect(),
            measured_bar: evidence.pressure_bar(),
            ..Self::default()
        }
    }
}

/// A diagnosis with the model that it recommends.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnosed {
    /// What it says.
    pub diagnosis: Diagnosis,
    /// The model with the effects, for the simulator.
    pub augmented: Valve,
    /// For the page.
    pub curves: Curves,
    /// What the recording leaves open; `None` where it decides.
    pub open: Option<Open>,
    /// How a foreign base is to be read; `None` where the base is a valve. The effects about it are those of `augmented`.
    pub recalibration: Option<Recalibration>,
    /// Whether only a recalibration that data of the good valve does not allow would hide what is off.
    pub stands_apart: bool,
}

/// A question that the recording does not decide: which of several models the valve is.
#[derive(Debug, Clone, PartialEq)]
pub struct Open {
    /// The effect whose name is in doubt; `None` where something is left that no effect carries.
    pub named: Option<String>,
    /// Share of the model that was chosen.
    pub share: f64,
    /// The others, likeliest first.
    pub rivals: Vec<Rival>,
}

/// A model with another effect in place of one that was found, or besides those that were.
#[derive(Debug, Clone, PartialEq)]
pub struct Rival {
    /// Id of the effect.
    pub id: String,
    /// Its share.
    pub share: f64,
    /// The model.
    pub valve: Valve,
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A diagnosis that says nothing.
    pub fn nothing() -> Diagnosis {
        Diagnosis {
            schema: SCHEMA.into(),
            recording: "drive.csv".into(),
            model: "paper".into(),
            verdict: Verdict::Match,
            summary: String::new(),
            mistake: None,
            rmse_bar: Errors { base: 0.02, base_heldout: 0.02, refit_heldout: 0.02, augmented_heldout: 0.02, noise_floor: 0.02 },
            effects: Vec::new(),
            form: Vec::new(),
            recalibration: Vec::new(),
            place: Place::default(),
            candidates: Vec::new(),
            unexplained: None,
            discovered: None,
            coil_current: None,
            other_drives: None,
            next_experiment: None,
            notes: Vec::new(),
        }
    }
    #[test]
    fn an_interval_ends_where_the_parameter_cannot_be_and_not_where_a_clutch_valve_would() {
        let parameters = || crate::physics::EFFECTS.iter().flat_map(|e| e.parameters());
        let positive = parameters().find(|p| p.range.0 >= 0.0).unwrap();
        let signed = parameters().find(|p| p.range.0 < 0.0).unwrap();
        let interval = |p: &Parameter, value: f64, error: f64| Estimate::normal(p, value, Some(error)).interval;
        assert_eq!(interval(positive, 1.0, 1.0), Some((Some(0.0), Some(2.96))));
        let large = 2.0 * positive.range.1 + 10.0;
        assert_eq!(interval(positive, large, 1.0), Some((Some(large - 1.96), Some(large + 1.96))));
        assert_eq!(interval(signed, 0.0, 1.0), Some((Some(-1.96), Some(1.96))));
        assert_eq!(interval(signed, 0.0, f64::INFINITY), None);
    }
}
