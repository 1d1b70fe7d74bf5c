//! One answer held against the truth.

use super::case::{Case, UNKNOWN};
use super::session::planted;

/// What a diagnosis says about the whole of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Nothing is worth adding.
    Match,
    /// What is left after the effects is noise.
    Explained,
    /// Effects help, structure remains.
    PartlyExplained,
    /// Structure that no effect of the library carries.
    Unexplained,
    /// Model and recording do not belong together.
    NotComparable,
}

impl Verdict {
    /// The word of the diagnosis document.
    pub fn name(self) -> &'static str {
        match self {
            Self::Match => "match",
            Self::Explained => "explained",
            Self::PartlyExplained => "partly_explained",
            Self::Unexplained => "unexplained",
            Self::NotComparable => "not_comparable",
        }
    }
    /// Reads the word.
    pub fn parse(word: &str) -> Option<Self> {
        [Self::Match, Self::Explained, Self::PartlyExplained, Self::Unexplained, Self::NotComparable].into_iter().find(|v| v.name() == word)
    }
}

/// A parameter as answered, in the unit of the effect's documentation.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Its name.
    pub name: String,
    /// Its 95 % interval.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

/// An effect that was named, with those that it cannot be told apart from.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Named {
    /// Id of the effect.
    pub id: String,
    /// Ids that explain the recording as well, best first.
    pub indistinguishable: Vec<String>,
    /// Whether it is said of the model (it lacks this) and not of the valve (this has changed).
    pub lacks: bool,
    /// Parameters that have an interval.
    pub parameters: Vec<Estimate>,
}

/// A diagnosis, as far as it is scored.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Its verdict.
    pub verdict: Verdict,
    /// Most important first.
    pub effects: Vec<Named>,
    /// Ids that stand as corrections of form.
    pub form: Vec<String>,
    /// What it claims to gain on held-out data [bar].
    pub claimed_gain_bar: f64,
    /// Whether data of the good valve beside the sweep was given.
    pub with_commission: bool,
}

/// RMSE on the second drive [bar], which the diagnosis never saw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Misfit {
    /// Of the model identified from the sweep.
    pub base_bar: f64,
    /// Of the model after the diagnosis.
    pub augmented_bar: f64,
    /// Of a model of the healthy twin, identified in the same way, on the twin's drive: what an explanation can reach.
    pub floor_bar: f64,
}

/// What came of a question.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Outcome {
    /// All that is concealed is named first.
    Named,
    /// It is in the answer: not first, or among the first two of a credible set, or as a form.
    Class,
    /// Of two effects, one is in the answer.
    Half,
    /// No name, but an admission that something is missing.
    Admitted,
    /// No name, and no admission.
    Silent,
    /// A name, and the truth is not in the answer.
    Wrong,
    /// A healthy valve, and no name.
    LeftAlone,
    /// A healthy valve, and a name.
    FalseAlarm,
}

impl Outcome {
    /// The word for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Named => "named",
            Self::Class => "class",
            Self::Half => "half",
            Self::Admitted => "admitted",
            Self::Silent => "silent",
            Self::Wrong => "WRONG",
            Self::LeftAlone => "left alone",
            Self::FalseAlarm => "FALSE ALARM",
        }
    }
}

/// What one answer was worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Score {
    /// What came of it.
    pub outcome: Outcome,
    /// Where a cause is named: whether the truth is in one of the credible sets.
    pub set_holds_truth: Option<bool>,
    /// Size of the credible set of each name.
    pub set_sizes: Vec<usize>,
    /// Effects named that are neither concealed, nor in a concealed one's class, nor part of every valve.
    pub spurious: usize,
    /// `(base - augmented) / (base - floor)`, where a simulation of another drive can follow the effect at all.
    pub recovered: Option<f64>,
    /// The first effect named, beside those that are part of every valve; `None` where nothing was named.
    pub first: Option<String>,
    /// Claimed and real gain [bar] where something is named: held out by the diagnosis, and on the second drive.
    pub gain_bar: Option<(f64, f64)>,
    /// Of the parameters that mean the same in the plant: whether the 95 % interval holds what was planted.
    pub intervals: Vec<bool>,
    /// The verdict is `explained`, and more than one and a half of the floor is left on the second drive.
    pub explained_too_early: Option<bool>,
    /// The second drive got worse by more than 2 %.
    pub worse: bool,
}

/// Part of every specimen here, so that naming it is no error: no curve is a cubic.
const OF_EVERY_VALVE: &str = "reference_shape";
/// Part of every specimen whose hysteresis is a sum of plays (family 1).
const OF_PLAYS: [&str; 2] = ["nonlocal_memory", "reversal_dead_band"];
/// These change the scatter: a simulation of another drive cannot follow chance.
const SCATTER: [&str; 3] = ["delay_jitter", "sensor_quantization", "sensor_outliers"];
/// Two linear lags in series are one and the same from current and pressure alone.
const LAGS: [&str; 2] = ["first_order_lag", "sensor_lag"];

/// What the data of the good valve cannot clear stands as a form: these count there as found.
const PLAYS: [&str; 3] = ["reversal_dead_band", "nonlocal_memory", "rate_dependent_hysteresis"];

/// Scores an answer. `misfit` is `None` where a model could not be simulated.
pub fn score(case: &Case, answer: &Answer, misfit: Option<Misfit>) -> Score {
    let truth = case.ids();
    let healthy = truth.is_empty();
    let present = |id: &str| {
        !truth.contains(&id)
            && (id == OF_EVERY_VALVE
                || (case.family() == 1 && OF_PLAYS.contains(&id))
                // a delay that scatters is a longer one on average
                || (id == "transport_delay" && truth.contains(&"delay_jitter")))
    };
    // what the good valve lacks, too, accuses nobody
    let accuses = |e: &&Named| !(e.lacks && (answer.with_commission || healthy));
    let names: Vec<&Named> = answer.effects.iter().filter(accuses).collect();
    let main: Vec<&Named> = names.iter().copied().filter(|e| !present(&e.id)).collect();
    let as_form = |id: &str| PLAYS.contains(&id) && answer.form.iter().any(|f| f == id);
    let class_holds = |e: &Named, id: &str| same(id, &e.id) || e.indistinguishable.iter().take(2).any(|other| same(id, other));
    let set_holds = |e: &Named, id: &str| same(id, &e.id) || e.indistinguishable.iter().any(|other| same(id, other));
    let hit = truth.iter().all(|id| main.iter().take(truth.len()).any(|e| same(id, &e.id)));
    let in_class = |id: &str| main.iter().any(|e| class_holds(e, id)) || as_form(id);
    let anywhere = truth.iter().all(|id| names.iter().any(|e| set_holds(e, id)) || as_form(id));
    let quiet = match answer.verdict {
        Verdict::Unexplained | Verdict::PartlyExplained => Outcome::Admitted,
        _ => Outcome::Silent,
    };
    let unknown = truth == [UNKNOWN];
    let outcome = match () {
        () if healthy && main.is_empty() => Outcome::LeftAlone,
        () if healthy => Outcome::FalseAlarm,
        () if unknown && main.is_empty() => quiet,
        () if unknown => Outcome::Wrong,
        () if hit => Outcome::Named,
        () if truth.iter().all(|id| in_class(id)) => Outcome::Class,
        () if main.is_empty() => quiet,
        () if truth.len() == 2 && truth.iter().any(|id| in_class(id)) => Outcome::Half,
        () if anywhere => Outcome::Class,
        () => Outcome::Wrong,
    };
    let known = !healthy && !unknown;
    let spurious = main.iter().filter(|e| !truth.iter().any(|id| class_holds(e, id))).count();
    let timed = case.effects.iter().any(|e| e.id == "supply_saturation" && e.variant == 1);
    let follows = known && !timed && !truth.iter().any(|id| SCATTER.contains(id));
    let recovered =
        misfit.filter(|m| follows && m.base_bar - m.floor_bar > 1e-6).map(|m| (m.base_bar - m.augmented_bar) / (m.base_bar - m.floor_bar));
    let planted = if known { planted(case) } else { Vec::new() };
    let covered = |(id, name, value): &(&str, &str, f64)| {
        let found = names.iter().find(|e| e.id == *id)?.parameters.iter().find(|p| p.name == *name)?;
        Some((found.low..=found.high).contains(value))
    };
    Score {
        outcome,
        set_holds_truth: (known && !main.is_empty()).then_some(anywhere),
        set_sizes: main.iter().filter(|_| known).map(|e| 1 + e.indistinguishable.len()).collect(),
        spurious,
        recovered,
        first: main.first().map(|e| e.id.clone()),
        gain_bar: misfit.filter(|_| !names.is_empty()).map(|m| (answer.claimed_gain_bar, m.base_bar - m.augmented_bar)),
        intervals: planted.iter().filter_map(covered).collect(),
        explained_too_early: misfit.filter(|_| answer.verdict == Verdict::Explained).map(|m| m.augmented_bar > 1.5 * m.floor_bar),
        worse: misfit.is_some_and(|m| m.augmented_bar > 1.02 * m.base_bar),
    }
}

fn same(a: &str, b: &str) -> bool {
    a == b || (LAGS.contains(&a) && LAGS.contains(&b))
}

#[cfg(test)]
mod tests {
    use super::super::case::Concealed;
    use super::super::draw::placed;
    use super::*;

    fn case_of(ids: &[&'static str]) -> Case {
        // a seed whose valve has no plays
        let seed = (0..).find(|s| placed(*s, Vec::new()).family() == 2).unwrap_or(0);
        placed(seed, ids.iter().map(|id| Concealed { id, variant: 0, severity: 1.0 }).collect())
    }
    fn answer(verdict: Verdict, named: &[(&str, &[&str])]) -> Answer {
        let effects = named
            .iter()
            .map(|(id, other)| Named {
                id: (*id).into(),
                indistinguishable: other.iter().map(|o| (*o).into()).collect(),
                ..Named::default()
            })
            .collect();
        Answer { verdict, effects, form: Vec::new(), claimed_gain_bar: 0.3, with_commission: false }
    }
    const MISFIT: Option<Misfit> = Some(Misfit { base_bar: 0.5, augmented_bar: 0.14, floor_bar: 0.1 });
    fn outcome(case: &Case, verdict: Verdict, named: &[(&str, &[&str])]) -> Outcome {
        score(case, &answer(verdict, named), MISFIT).outcome
    }

    #[test]
    fn a_name_counts_a_class_counts_less_and_a_false_name_counts_against() {
        let case = case_of(&["stiction"]);
        let s = score(&case, &answer(Verdict::Explained, &[("reference_shape", &[]), ("stiction", &[])]), MISFIT);
        assert!(s.outcome == Outcome::Named && s.spurious == 0 && s.first.as_deref() == Some("stiction"));
        assert!((s.recovered.unwrap_or(0.0) - 0.9).abs() < 1e-12 && s.gain_bar == Some((0.3, 0.5 - 0.14)));
        let s = score(&case, &answer(Verdict::Explained, &[("reversal_dead_band", &["creep", "stiction"])]), MISFIT);
        assert!(s.outcome == Outcome::Class && s.spurious == 0 && s.set_holds_truth == Some(true) && s.set_sizes == [3]);
        let s = score(&case, &answer(Verdict::Explained, &[("reversal_dead_band", &["creep", "leakage", "stiction"])]), MISFIT);
        assert!(s.outcome == Outcome::Class && s.spurious == 1, "in the credible set, beyond the first two");
        let s = score(&case, &answer(Verdict::Explained, &[("creep", &["leakage"])]), MISFIT);
        assert!(s.outcome == Outcome::Wrong && s.set_holds_truth == Some(false));
        assert_eq!(outcome(&case, Verdict::Explained, &[("creep", &[]), ("stiction", &[])]), Outcome::Class, "named, but not first");
        assert_eq!(outcome(&case, Verdict::Match, &[]), Outcome::Silent);
        assert_eq!(outcome(&case, Verdict::Unexplained, &[]), Outcome::Admitted);
        assert_eq!(outcome(&case, Verdict::NotComparable, &[]), Outcome::Silent, "the recording is of this valve");
    }

    #[test]
    fn lags_of_plant_and_sensor_are_one_and_pairs_need_both() {
        let case = case_of(&["first_order_lag", "reference_drift"]);
        assert_eq!(outcome(&case, Verdict::Explained, &[("reference_drift", &[]), ("sensor_lag", &[])]), Outcome::Named);
        assert_eq!(outcome(&case, Verdict::Explained, &[("reference_drift", &[])]), Outcome::Half);
    }

    #[test]
    fn healthy_means_left_alone_and_unknown_means_admitted_without_a_name() {
        let healthy = case_of(&[]);
        assert_eq!(outcome(&healthy, Verdict::Match, &[]), Outcome::LeftAlone);
        assert_eq!(outcome(&healthy, Verdict::Explained, &[("reference_shape", &[])]), Outcome::LeftAlone);
        assert_eq!(outcome(&healthy, Verdict::Explained, &[("creep", &[])]), Outcome::FalseAlarm);
        let mut lacking = answer(Verdict::Explained, &[("creep", &[])]);
        lacking.effects[0].lacks = true;
        assert_eq!(score(&healthy, &lacking, None).outcome, Outcome::LeftAlone, "a lack of the model accuses no valve");
        let unknown = case_of(&[UNKNOWN]);
        assert_eq!(
            outcome(&unknown, Verdict::PartlyExplained, &[("creep", &[])]),
            Outcome::Wrong,
            "a false name beside an admission is one"
        );
        assert_eq!(outcome(&unknown, Verdict::Unexplained, &[]), Outcome::Admitted);
        assert_eq!(outcome(&unknown, Verdict::Match, &[]), Outcome::Silent);
    }

    #[test]
    fn what_was_planted_is_held_against_its_interval() {
        let case = case_of(&["transport_delay"]);
        let (_, name, value) = planted(&case)[0];
        for (low, high, holds) in [(value - 1e-3, value + 1e-3, true), (value + 1e-3, value + 2e-3, false)] {
            let mut a = answer(Verdict::Explained, &[("transport_delay", &[])]);
            a.effects[0].parameters.push(Estimate { name: name.into(), low, high });
            assert_eq!(score(&case, &a, MISFIT).intervals, [holds]);
        }
    }

    #[test]
    fn chance_cannot_be_recovered_and_too_much_left_is_not_explained() {
        let case = case_of(&["sensor_outliers"]);
        let s = score(&case, &answer(Verdict::Explained, &[("sensor_outliers", &[])]), MISFIT);
        assert!(s.recovered.is_none() && s.explained_too_early == Some(false) && !s.worse);
        let bad = Some(Misfit { base_bar: 0.5, augmented_bar: 0.52, floor_bar: 0.1 });
        let s = score(&case, &answer(Verdict::Explained, &[("sensor_outliers", &[])]), bad);
        assert!(s.explained_too_early == Some(true) && s.worse);
    }
}
