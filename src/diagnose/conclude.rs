//! From fits to a diagnosis: the verdict, the figures, the words.

use super::base::{AT, BASE, Base};
use super::diagnosis::{Change, Claim, Curves, Diagnosed, Diagnosis, Errors, SCHEMA, Verdict};
use super::errors::Curvature;
use super::evidence::MIDDLE;
use super::evidence::rms;
use super::fit::{Fit, Fitter};
use super::good::Good;
use super::heldout::{HeldOut, blocks, held_out};
use super::locate::locate;
use super::model::Model;
use super::outcome::Outcome;
use super::remainder::remainder;
use super::scatter::{Scattered, give_back, mask};
use super::search::Search;
use super::simulator::Simulator;
use super::witness::Witness;
use crate::recording::Recording;
use crate::valve::Valve;

/// What every search about a recording goes with.
#[derive(Clone, Copy)]
pub struct Beside<'s> {
    /// The recording.
    pub recording: &'s Recording,
    /// The model as given.
    pub given: &'s Model<'s>,
    /// What data of the good valve says, where there is some.
    pub good: Option<&'s Good>,
    /// Slower data of the good valve, where that is all there is.
    pub witness: Option<Witness<'s>>,
    /// What the effects of the scatter found.
    pub scattered: &'s [Scattered],
    /// Samples before the valve has settled from where it stood.
    pub unsettled: &'s [usize],
}

impl<'s> Beside<'s> {
    /// The diagnosis by a search that went out from `base`, and that search; `looking`: the fitter of the part of the
    /// recording that the search has looked at, where that is not all.
    pub fn answer<'a>(
        self,
        base: &'s Model<'a>,
        (fitter, looking): (&'s Fitter<'s>, Option<&'s Fitter<'s>>),
        search: Search<'a>,
    ) -> (Diagnosed, Search<'a>) {
        let Self { recording, given, good, witness, scattered, unsettled } = self;
        let weighed = Vec::new();
        let findings = Findings { recording, given, base, good, witness, fitter, looking, search, scattered, unsettled, weighed }.weighed();
        (findings.conclude(), findings.search)
    }
}

/// Everything that the searches found, to be put into words.
pub struct Findings<'s, 'a> {
    /// The recording.
    pub recording: &'s Recording,
    /// The model as given.
    pub given: &'s Model<'s>,
    /// The model from which the search went out: as given, or corrected by data of the good valve.
    pub base: &'s Model<'a>,
    /// What data of the good valve says, where there is some.
    pub good: Option<&'s Good>,
    /// Slower data of the good valve, where that is all there is.
    pub witness: Option<Witness<'s>>,
    /// The fitter, with outliers masked.
    pub fitter: &'s Fitter<'s>,
    /// The fitter of the part of the recording that the search has looked at, where that is not all.
    pub looking: Option<&'s Fitter<'s>>,
    /// The search over the effects of the course.
    pub search: Search<'a>,
    /// What the effects of the scatter found.
    pub scattered: &'s [Scattered],
    /// Samples before the valve has settled from where it stood.
    pub unsettled: &'s [usize],
    /// The effects of the course, each against what could stand in its place.
    pub weighed: Vec<Weighed<'a>>,
}

/// An effect against its rivals.
pub struct Weighed<'a> {
    /// The chosen model without it.
    pub without: Fit<'a>,
    /// Its posterior share.
    pub share: f64,
    /// The rest of the credible set, best first.
    pub rest: Vec<Member<'a>>,
    /// The rival of the largest share, where that is much larger than its own.
    pub likelier: Option<(f64, Fit<'a>)>,
}

/// Another effect of a credible set.
pub struct Member<'a> {
    /// Its id.
    pub id: &'static str,
    /// Its posterior share.
    pub share: f64,
    /// The model with it.
    pub fit: Fit<'a>,
}

impl<'a> Findings<'_, 'a> {
    /// The pressure of a fit [bar].
    pub fn simulated(&self, fit: &Fit<'_>) -> Vec<f64> {
        let mut out = Vec::new();
        Simulator::new(self.fitter.evidence).pressure(&fit.model, &fit.theta, &mut out);
        out
    }

    /// Measured minus simulated; NaN where masked [bar].
    pub fn residual(&self, simulated: &[f64]) -> Vec<f64> {
        self.fitter.measured.iter().zip(simulated).map(|(y, p)| y - p).collect()
    }

    /// The diagnosis.
    pub fn conclude(&self) -> Diagnosed {
        let (fitter, search) = (self.fitter, &self.search);
        let evidence = fitter.evidence;
        let mut measured_all = evidence.pressure_bar();
        let base_bar = self.as_given();
        let (refit_bar, augmented_bar) = (self.simulated(&search.null), self.simulated(&search.chosen));
        let base_residual: Vec<f64> = measured_all.iter().zip(&base_bar).map(|(y, p)| y - p).collect();
        give_back(self.scattered, &mut measured_all);
        let (refit_held, chosen_held) = rayon::join(|| held_out(fitter, &search.null, 6), || held_out(fitter, &search.chosen, 6));
        let curvature = fitter.curvature(&search.chosen);
        let mut findings = self.course_findings(&chosen_held, curvature.as_ref());
        findings.extend(self.scattered.iter().map(|s| self.scatter_finding(s)));
        findings.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (mut form, effects) = self.sorted(findings);
        let candidates = self.candidates(&[effects.as_slice(), form.as_slice()].concat());
        form.extend(self.good.into_iter().flat_map(|g| g.corrections.iter().map(|c| c.finding(&g.names))));

        // Readings that were left out, but that no named cause has spoilt, are part of what is left.
        let mut counted = measured_all.clone();
        mask(self.scattered, &mut counted);
        let residual = if effects.is_empty() {
            self.residual_settled(&counted, &augmented_bar)
        } else {
            self.off_from_any_start(&counted, &augmented_bar)
        };
        let standardised = self.standardised(&residual);
        let block = blocks(fitter);
        let allowed_bar = (self.noise_bar(), self.accuracy_bar(!effects.is_empty()));
        let left = |standardised: &[f64], simulated_bar: &[f64], allowed_bar: (f64, f64)| {
            let mut weighed = standardised.to_vec();
            fitter.weigh(&mut weighed);
            remainder(evidence, (standardised, &weighed), simulated_bar, &block, allowed_bar)
        };
        let mut unexplained = left(&standardised, &augmented_bar, allowed_bar);
        let corrected = self.corrected(&base_bar, &block);
        let known_bar = corrected.as_ref().map_or(&base_bar, |corrected| &corrected.1);
        let stands_apart = effects.is_empty() && unexplained.is_none() && self.stands_apart(known_bar, [&refit_bar, &augmented_bar]);
        if stands_apart {
            let residual = self.residual_settled(&counted, &base_bar);
            unexplained = left(&self.standardised(&residual), &base_bar, (self.noise_bar(), 0.0));
        }
        // A cause may be right and yet no model follows what it does, or the record tells too little of it: on the readings of the
        // printed error, and as far as the record says on other drives, the promise has to be kept.
        let mut other_drives = (!effects.is_empty() && unexplained.is_none()).then(|| self.foreseen(curvature.as_ref())).flatten();
        let followed_bar = || {
            let mut all = self.residual_settled(&measured_all, &augmented_bar);
            fitter.weigh(&mut all);
            rms(&all).max(chosen_held.weighed_bar())
        };
        let verdict = match (effects.is_empty(), unexplained.is_some()) {
            (true, false) => Verdict::Match,
            (true, true) => Verdict::Unexplained,
            (false, false) => {
                let (here_bar, allowed_bar) = (followed_bar(), allowed_bar.0.hypot(allowed_bar.1));
                let open_bar = other_drives.as_ref().map_or(0.0, |there| there.open_bar);
                let is_explained = here_bar.hypot(open_bar) <= allowed_bar;
                other_drives.iter_mut().for_each(|there| there.is_too_much = !is_explained && here_bar <= allowed_bar);
                if is_explained { Verdict::Explained } else { Verdict::PartlyExplained }
            }
            (false, true) => Verdict::PartlyExplained,
        };
        let off_bar = |simulated_bar: &[f64]| rms(&self.residual(simulated_bar));
        let outcome = Outcome {
            verdict,
            has_good: self.good.is_some(),
            is_named: !effects.is_empty(),
            is_form: !form.is_empty(),
            found_nothing: search.chosen.model.effects.is_empty(),
            given_bar: off_bar(&base_bar),
            refit_bar: off_bar(&refit_bar),
            chosen_bar: off_bar(&augmented_bar),
        };
        let kept = outcome.leaves_the_model(fitter.criteria.recalibrates);
        let (mut augmented, augmented_bar) = match corrected.filter(|_| kept) {
            Some(corrected) => corrected,
            None if kept => (self.given.valve.clone(), base_bar.clone()),
            None => (search.chosen.model.valve_file(&search.chosen.theta), augmented_bar),
        };
        augmented.effects.extend(self.scattered.iter().filter_map(Scattered::specification));
        if evidence.noise_bar > 0.0 {
            augmented.noise_bar = evidence.noise_bar;
        }
        let runner_up_bar = self.runner_up().map(|fit| self.simulated(&fit)).unwrap_or_default();
        let errors = Errors {
            base: rms(&base_residual),
            base_heldout: rms(&base_residual),
            refit_heldout: self.with_masked(&refit_held, &measured_all, &refit_bar),
            augmented_heldout: if kept {
                // It was not fitted to this record at all.
                rms(&measured_all.iter().zip(&augmented_bar).map(|(y, p)| y - p).collect::<Vec<f64>>())
            } else {
                self.with_masked(&chosen_held, &measured_all, &augmented_bar)
            },
            noise_floor: self.noise_bar(),
        };
        let recalibration = self.recalibration(curvature.as_ref());
        let mut notes = evidence.notes.clone();
        match self.good {
            Some(good) => notes.push(format!(
                "data of the good valve: {}; the model as given is off by {:.3} bar RMSE there, corrected by it {:.3} bar",
                good.names.join(", "),
                good.rmse_bar.0,
                good.rmse_bar.1
            )),
            None if effects.iter().all(|f| f.claim == Claim::Changed) => {}
            None => notes.push(
                "whether the valve has changed is not said: a drive of the good valve with movements as fast as these would decide it (--reference GOOD.csv, or several recordings to `hil identify`)".into(),
            ),
        }
        if self.noise_bar() < evidence.noise_bar {
            notes.push(format!(
                "neighbouring readings differ as by a noise of {:.3} bar, on data of the good valve by one of {:.3} bar: what goes beyond that counts as an error, but no cause was looked for in it",
                evidence.noise_bar,
                self.noise_bar()
            ));
        }
        if !fitter.found.is_empty() {
            let names = fitter.found.iter().map(|id| super::words::title(id)).collect::<Vec<_>>().join(" and ");
            notes.push(format!(
                "without the readings that {names} spoils, the augmented model is off by {:.3} bar RMSE on held-out data",
                rms(&chosen_held.residual)
            ));
        }
        let mut diagnosis = Diagnosis {
            schema: SCHEMA.into(),
            recording: self.recording.source.clone(),
            model: self.base.valve.name.clone(),
            verdict,
            summary: String::new(),
            mistake: None,
            rmse_bar: errors,
            place: locate(evidence, &base_residual, &base_bar),
            candidates,
            effects,
            form,
            recalibration,
            unexplained,
            discovered: None,
            coil_current: None,
            other_drives,
            next_experiment: None,
            notes,
        };
        diagnosis.summary = super::words::summary(&diagnosis);
        if stands_apart {
            diagnosis.summary = format!(
                "{} {}",
                diagnosis.summary,
                super::words::stands_apart(&diagnosis.recalibration, !search.chosen.model.effects.is_empty())
            );
        }
        let curves = Curves { base_bar, refit_bar, augmented_bar, runner_up_bar, ..Curves::along(evidence) };
        let open = self.open(&diagnosis);
        let mut theta = if kept { self.given.calibrated() } else { search.chosen.theta.clone() };
        if let Some(base) = evidence.base.as_ref().filter(|_| kept) {
            base.undo(&mut theta);
        }
        let recalibration = evidence.base.as_ref().map(|foreign| foreign.recalibration(&theta));
        Diagnosed { diagnosis, augmented, curves, open, recalibration, stands_apart }
    }

    /// Pressure of the model as given [bar].
    fn as_given(&self) -> Vec<f64> {
        let mut theta = self.given.calibrated();
        theta[AT.lag] = self.given.valve.lag_s;
        if let Some(base) = &self.fitter.evidence.base {
            base.undo(&mut theta);
        }
        let mut out = Vec::new();
        Simulator::starting_at(self.fitter.evidence, MIDDLE).pressure(self.given, &theta, &mut out);
        out
    }

    /// The model as data of the good valve has corrected it, with its pressure [bar], where this record, which the corrections have
    /// not seen, confirms them against the model as given: beyond the chance of its blocks, whose number each sample has.
    fn corrected(&self, as_given_bar: &[f64], block: &[usize]) -> Option<(Valve, Vec<f64>)> {
        self.good.filter(|good| !good.corrections.is_empty() && self.fitter.evidence.base.is_none())?;
        let theta = self.base.calibrated();
        let mut pressure_bar = Vec::new();
        Simulator::starting_at(self.fitter.evidence, MIDDLE).pressure(self.base, &theta, &mut pressure_bar);
        let [corrected, given] = [&pressure_bar, as_given_bar].map(|p: &[f64]| HeldOut::plain(self.residual(p), block.to_vec()));
        let is_confirmed = corrected.gain_over(&given).1.is_some_and(|interval| interval.0 > 0.0);
        is_confirmed.then(|| (self.base.valve.clone(), pressure_bar))
    }

    /// The second best candidate of the first round that led to an effect.
    fn runner_up(&self) -> Option<Fit<'a>> {
        let first = self.search.rounds.first()?;
        let found = self.search.chosen.model.effects.first()?;
        first.ranked.iter().find(|c| c.effect.id() != found.id()).map(|c| c.fit.clone())
    }

    /// What the fit moved in the base, where it is more than its standard error and more than a trifle.
    fn recalibration(&self, curvature: Option<&Curvature<'_, '_>>) -> Vec<Change> {
        let chosen = &self.search.chosen;
        let start = chosen.model.calibrated();
        let error = |k: usize| curvature.map_or(f64::INFINITY, |curvature| curvature.error(k));
        // What is too small to be told of.
        let trifle = Base { gain: 0.002f64, offset: 0.03, width: 0.05, ln_a: 0.2, late: 0.002, lag: 0.003 }.in_order();
        let names = Base {
            gain: ("gain", "1"),
            offset: ("offset", "bar"),
            width: ("loop width", "bar"),
            ln_a: ("a", "bar^2"),
            late: ("delay", "s"),
            lag: ("lag", "s"),
        }
        .in_order();
        let told = |theta: &[f64]| {
            let base = Base::of(theta);
            // About a foreign model, which has no lag, what comes late is told as it is.
            Base { late: if self.fitter.evidence.base.is_some() { base.late } else { base.delay_s() }, ..base }
        };
        let (before, after) = (told(&start), told(&chosen.theta));
        let read = |base: Base<f64>| Base { gain: 1.0 + base.gain, ln_a: base.ln_a.exp(), ..base }.in_order();
        let moved: Vec<f64> = after.in_order().iter().zip(before.in_order()).map(|(a, b)| (a - b).abs()).collect();
        let (before, after) = (read(before), read(after));
        (0..BASE)
            .filter(|k| moved[*k] > trifle[*k].max(2.0 * error(*k)))
            .map(|k| Change { parameter: names[k].0.into(), before: before[k], after: after[k], unit: names[k].1.into() })
            .collect()
    }
}
