//! One case held against one contestant: record, ask, then look.

use super::case::Case;
use super::score::{Answer, Misfit, Score, score};
use super::session::{record_experiment, record_session};
use crate::recording::Run;

/// Whoever is put to the test. It gets recordings and nothing else.
pub trait Contestant {
    /// A model of a valve, as it hands it over.
    type Model;

    /// A model from a slow sweep and, where there is one and the contestant wants it, a commissioning drive.
    ///
    /// # Errors
    /// Its own words.
    fn identify(&mut self, sweep: &Run, commission: Option<&Run>) -> Result<Self::Model, String>;

    /// A diagnosis of a drive, with the experiment that was asked for after it where there is one, and the model that came of it.
    ///
    /// # Errors
    /// Its own words.
    fn diagnose(&mut self, record: &Run, experiment: Option<&Run>, model: &Self::Model) -> Result<(Answer, Self::Model), String>;

    /// The experiment that it wants to see after its last diagnosis: times [s] and currents [A].
    fn proposed(&self) -> Option<Vec<(f64, f64)>> {
        None
    }

    /// The pressure [bar] that a model expects along the current of a run.
    ///
    /// # Errors
    /// Its own words.
    fn simulate(&mut self, model: &Self::Model, run: &Run) -> Result<Vec<f64>, String>;
}

/// What came of one case.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// The case, now open.
    pub case: Case,
    /// What was answered.
    pub answer: Answer,
    /// On the second drive.
    pub misfit: Misfit,
    /// What it was worth.
    pub score: Score,
    /// The same after the experiment that it asked for; `None` where it asked for none, or got none.
    pub after: Option<Box<Trial>>,
}

/// Holds one trial; with `experiment`, the one that the contestant asks for is driven on the concealed valve, and it is asked again.
///
/// # Errors
/// The contestant's words, with the step at which it gave up.
pub fn hold_trial<C: Contestant>(case: &Case, contestant: &mut C, experiment: bool) -> Result<Trial, String> {
    let (valve, twin) = record_session(case);
    let step = |what: &'static str| move |words: String| format!("{what}: {words}");
    let base = contestant.identify(&valve.sweep, valve.commission.as_ref()).map_err(step("identify"))?;
    let (answer, augmented) = contestant.diagnose(&valve.record, None, &base).map_err(step("diagnose"))?;
    let again = match contestant.proposed().filter(|_| experiment) {
        None => None,
        Some(points) => {
            let driven = record_experiment(case, &points);
            Some(contestant.diagnose(&valve.record, Some(&driven), &base).map_err(step("diagnose, with the experiment"))?)
        }
    };
    // from here on it is only scored
    let reference = contestant
        .identify(&twin.sweep, valve.commission.as_ref().and(twin.commission.as_ref()))
        .map_err(step("identify, healthy twin"))?;
    let mut rmse = |model: &C::Model, run: &Run| -> Result<f64, String> {
        let simulated = contestant.simulate(model, run).map_err(step("simulate"))?;
        misfit_bar(&simulated, run.pressure_bar.as_deref().unwrap_or_default())
            .ok_or_else(|| format!("simulate: {} samples came back for {}", simulated.len(), run.len()))
    };
    let misfit = Misfit {
        base_bar: rmse(&base, &valve.holdout)?,
        augmented_bar: rmse(&augmented, &valve.holdout)?,
        floor_bar: rmse(&reference, &twin.holdout)?,
    };
    let mut trial = Trial::new(case, answer, misfit);
    if let Some((answer, augmented)) = again {
        let misfit = Misfit { augmented_bar: rmse(&augmented, &valve.holdout)?, ..misfit };
        trial.after = Some(Box::new(Trial::new(case, answer, misfit)));
    }
    Ok(trial)
}

impl Trial {
    /// A case with what was answered, scored.
    pub fn new(case: &Case, answer: Answer, misfit: Misfit) -> Self {
        let score = score(case, &answer, Some(misfit));
        Self { case: case.clone(), answer, misfit, score, after: None }
    }
}

fn misfit_bar(simulated: &[f64], measured: &[f64]) -> Option<f64> {
    if simulated.len() != measured.len() || measured.is_empty() {
        return None;
    }
    Some((simulated.iter().zip(measured).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / measured.len() as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::super::case::Concealed;
    use super::super::draw::placed;
    use super::super::score::{Outcome, Verdict};
    use super::*;

    /// Knows nothing: a straight line over the current, and no complaint ever.
    struct Line;

    impl Contestant for Line {
        type Model = (f64, f64);
        fn identify(&mut self, sweep: &Run, _: Option<&Run>) -> Result<(f64, f64), String> {
            let p = sweep.pressure_bar.as_deref().ok_or("no pressure")?;
            let n = p.len() as f64;
            let (mi, mp) = (sweep.current_a.iter().sum::<f64>() / n, p.iter().sum::<f64>() / n);
            let (mut top, mut bottom) = (0.0, 0.0);
            for (i, p) in sweep.current_a.iter().zip(p) {
                top += (i - mi) * (p - mp);
                bottom += (i - mi).powi(2);
            }
            Ok((top / bottom, mp - top / bottom * mi))
        }
        fn diagnose(&mut self, _: &Run, _: Option<&Run>, model: &(f64, f64)) -> Result<(Answer, (f64, f64)), String> {
            Ok((
                Answer { verdict: Verdict::Match, effects: Vec::new(), form: Vec::new(), claimed_gain_bar: 0.0, with_commission: false },
                *model,
            ))
        }
        fn simulate(&mut self, model: &(f64, f64), run: &Run) -> Result<Vec<f64>, String> {
            Ok(run.current_a.iter().map(|i| model.0 * i + model.1).collect())
        }
    }

    #[test]
    fn who_never_complains_is_right_about_healthy_valves_only() {
        let healthy = hold_trial(&placed(3, Vec::new()), &mut Line, false);
        assert!(
            healthy.as_ref().is_ok_and(|t| t.score.outcome == Outcome::LeftAlone && t.misfit.base_bar == t.misfit.floor_bar),
            "{healthy:?}"
        );
        let faulty = hold_trial(&placed(3, vec![Concealed { id: "leakage", variant: 0, severity: 1.0 }]), &mut Line, false);
        assert!(faulty.as_ref().is_ok_and(|t| t.score.outcome == Outcome::Silent && t.score.recovered == Some(0.0)), "{faulty:?}");
    }
}
