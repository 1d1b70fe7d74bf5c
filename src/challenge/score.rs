//! One answer held against the truth.

use super::draw::{Case, UNKNOWN};

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
}

impl Verdict {
    /// The word of the diagnosis document.
    pub fn name(self) -> &'static str {
        match self {
            Self::Match => "match",
            Self::Explained => "explained",
            Self::PartlyExplained => "partly_explained",
            Self::Unexplained => "unexplained",
        }
    }
    /// Reads the word.
    pub fn parse(word: &str) -> Option<Self> {
        [Self::Match, Self::Explained, Self::PartlyExplained, Self::Unexplained].into_iter().find(|v| v.name() == word)
    }
}

/// An effect that was named, with those that it cannot be told apart from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// Id of the effect.
    pub id: String,
    /// Ids that explain the recording as well, best first.
    pub indistinguishable: Vec<String>,
}

/// A diagnosis, as far as it is scored.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Its verdict.
    pub verdict: Verdict,
    /// Most important first.
    pub effects: Vec<Named>,
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

/// What one answer was worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Score {
    /// All concealed effects are named first; a healthy valve is left alone; an unknown effect is admitted.
    pub right: bool,
    /// All concealed effects are named, or stand among the first two that a named one cannot be told apart from.
    pub in_class: bool,
    /// Effects named that are neither concealed, nor in a concealed one's class, nor part of every valve.
    pub spurious: usize,
    /// `(base - augmented) / (base - floor)`, where a simulation of another drive can follow the effect at all.
    pub recovered: Option<f64>,
    /// The first effect named, beside those that are part of every valve; `None` where nothing was named.
    pub first: Option<String>,
}

/// Part of every specimen here, so that naming it is no error: no curve is a cubic.
const OF_EVERY_VALVE: &str = "reference_shape";
/// Part of every specimen whose hysteresis is a sum of plays (family 1).
const OF_PLAYS: [&str; 2] = ["nonlocal_memory", "reversal_dead_band"];
/// These change the scatter: a simulation of another drive cannot follow chance.
const SCATTER: [&str; 3] = ["delay_jitter", "sensor_quantization", "sensor_outliers"];
/// Two linear lags in series are one and the same from current and pressure alone.
const LAGS: [&str; 2] = ["first_order_lag", "sensor_lag"];

/// Scores an answer. `misfit` is `None` where a model could not be simulated.
pub fn score(case: &Case, answer: &Answer, misfit: Option<Misfit>) -> Score {
    let truth = case.ids();
    let present = |id: &str| {
        !truth.contains(&id)
            && (id == OF_EVERY_VALVE
                || (case.family() == 1 && OF_PLAYS.contains(&id))
                // a delay that scatters is a longer one on average
                || (id == "transport_delay" && truth.contains(&"delay_jitter")))
    };
    let named: Vec<&Named> = answer.effects.iter().filter(|e| !present(&e.id)).collect();
    let first = named.first().map(|e| e.id.clone());
    let healthy = truth.is_empty();
    if healthy || truth == [UNKNOWN] {
        let right = if healthy {
            answer.verdict == Verdict::Match || named.is_empty()
        } else {
            matches!(answer.verdict, Verdict::Unexplained | Verdict::PartlyExplained)
        };
        return Score { right, in_class: right, spurious: named.len(), recovered: None, first };
    }
    let class_holds = |e: &Named, id: &str| same(id, &e.id) || e.indistinguishable.iter().take(2).any(|other| same(id, other));
    let right = truth.iter().all(|id| named.iter().take(truth.len()).any(|e| same(id, &e.id)));
    let in_class = truth.iter().all(|id| named.iter().any(|e| class_holds(e, id)));
    let spurious = named.iter().filter(|e| !truth.iter().any(|id| class_holds(e, id))).count();
    let timed = case.effects.iter().any(|e| e.id == "supply_saturation" && e.variant == 1);
    let follows = !timed && !truth.iter().any(|id| SCATTER.contains(id));
    let recovered =
        misfit.filter(|m| follows && m.base_bar - m.floor_bar > 1e-6).map(|m| (m.base_bar - m.augmented_bar) / (m.base_bar - m.floor_bar));
    Score { right, in_class, spurious, recovered, first }
}

fn same(a: &str, b: &str) -> bool {
    a == b || (LAGS.contains(&a) && LAGS.contains(&b))
}

#[cfg(test)]
mod tests {
    use super::super::draw::{Concealed, placed};
    use super::*;

    fn case_of(ids: &[&'static str]) -> Case {
        // a seed whose valve has no plays
        let seed = (0..).find(|s| placed(*s, Vec::new()).family() == 2).unwrap_or(0);
        placed(seed, ids.iter().map(|id| Concealed { id, variant: 0, severity: 1.0 }).collect())
    }
    fn answer(verdict: Verdict, named: &[(&str, &[&str])]) -> Answer {
        let effects = named
            .iter()
            .map(|(id, other)| Named { id: (*id).into(), indistinguishable: other.iter().map(|o| (*o).into()).collect() })
            .collect();
        Answer { verdict, effects }
    }
    const MISFIT: Option<Misfit> = Some(Misfit { base_bar: 0.5, augmented_bar: 0.14, floor_bar: 0.1 });

    #[test]
    fn a_name_counts_a_class_counts_less_and_a_false_name_counts_against() {
        let case = case_of(&["stiction"]);
        let s = score(&case, &answer(Verdict::Explained, &[("reference_shape", &[]), ("stiction", &[])]), MISFIT);
        assert!(s.right && s.in_class && s.spurious == 0 && s.first.as_deref() == Some("stiction"));
        assert!((s.recovered.unwrap_or(0.0) - 0.9).abs() < 1e-12);
        let s = score(&case, &answer(Verdict::Explained, &[("reversal_dead_band", &["creep", "stiction"])]), MISFIT);
        assert!(!s.right && s.in_class && s.spurious == 0);
        let s = score(&case, &answer(Verdict::Explained, &[("reversal_dead_band", &["creep", "leakage", "stiction"])]), MISFIT);
        assert!(!s.right && !s.in_class && s.spurious == 1);
        let s = score(&case, &answer(Verdict::Explained, &[("creep", &[]), ("stiction", &[])]), MISFIT);
        assert!(!s.right && s.in_class && s.spurious == 1, "named, but not first");
    }

    #[test]
    fn lags_of_plant_and_sensor_are_one_and_pairs_need_both() {
        let case = case_of(&["first_order_lag", "reference_drift"]);
        assert!(score(&case, &answer(Verdict::Explained, &[("reference_drift", &[]), ("sensor_lag", &[])]), MISFIT).right);
        assert!(!score(&case, &answer(Verdict::Explained, &[("reference_drift", &[])]), MISFIT).right);
    }

    #[test]
    fn healthy_means_left_alone_and_unknown_means_admitted() {
        let healthy = case_of(&[]);
        assert!(score(&healthy, &answer(Verdict::Match, &[]), None).right);
        assert!(score(&healthy, &answer(Verdict::Explained, &[("reference_shape", &[])]), None).right);
        assert!(!score(&healthy, &answer(Verdict::Explained, &[("creep", &[])]), None).right);
        let unknown = case_of(&[UNKNOWN]);
        assert!(score(&unknown, &answer(Verdict::PartlyExplained, &[("creep", &[])]), None).right);
        assert!(!score(&unknown, &answer(Verdict::Explained, &[("creep", &[])]), None).right);
        assert!(!score(&unknown, &answer(Verdict::Match, &[]), None).right);
    }

    #[test]
    fn chance_cannot_be_recovered() {
        let case = case_of(&["sensor_outliers"]);
        assert_eq!(score(&case, &answer(Verdict::Explained, &[("sensor_outliers", &[])]), MISFIT).recovered, None);
    }
}
