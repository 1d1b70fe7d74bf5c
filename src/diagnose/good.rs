//! What data of the good valve says: how the model has to be corrected where nothing is wrong, how far it is off even
//! then, and which effects that data excludes.

use std::path::Path;

use super::against::{Against, Price};
use super::base::AT;
use super::diagnosis::{Claim, Estimate, Finding};
use super::error::DiagnoseError;
use super::evidence::{Evidence, rms};
use super::excerpt::excerpt;
use super::fit::{Fit, Fitter};
use super::foreign::Foreign;
use super::model::Model;
use super::scatter::{mask, restored, scatter};
use super::search::search_in;
use super::simulator::Simulator;
use super::trust::Trust;
use super::{comparable, settled, slower};
use crate::physics::{Effect, Scatter, ScatterFinding};
use crate::recording::Recording;
use crate::valve::{Identification, Valve};

/// The good valve, as its own data shows it.
pub struct Good {
    /// The recordings, by name.
    pub names: Vec<String>,
    /// Whether it is the one recording that the model was identified from, and nobody has driven the valve besides.
    pub is_identification: bool,
    /// Their data.
    pub evidence: Evidence,
    /// The model corrected by what that data shows to be missing.
    pub valve: Valve,
    /// What was added to it: effects, with the values of their parameters and their errors.
    pub corrections: Vec<Correction>,
    /// Effects of the scatter that the good valve shows as well, with the values of their parameters.
    scatter: Vec<(&'static str, Vec<f64>)>,
    /// What of it a search looks at; `None` where that is all.
    short: Option<Evidence>,
    /// It as a logger as slow as that of the record would have written it, where that is slower.
    slowly: Option<Evidence>,
    /// Measured pressures; NaN where masked [bar].
    measured: Vec<f64>,
    /// Samples of that data that count as one.
    tau_samples: f64,
    /// RMSE of the model as given and of the corrected one [bar].
    pub rmse_bar: (f64, f64),
    /// RMSE of the corrected one on the run that it fits worst, each reading as much as it weighs: a slow sweep says little of how far
    /// it is off on a drive [bar].
    worst_bar: f64,
    /// Where it is to be trusted less than at rest.
    pub trust: Option<Trust>,
}

/// An effect that the good valve has and its model lacks.
pub struct Correction {
    /// The effect.
    pub effect: &'static dyn Effect,
    /// Values and standard errors of its parameters.
    pub parameters: Vec<(f64, f64)>,
    /// By how much the RMSE on the good valve's data grows without it [bar].
    pub gain_bar: f64,
}

impl Correction {
    /// It as a finding of a diagnosis.
    pub fn finding(&self, names: &[String]) -> Finding {
        let parameters = self
            .effect
            .parameters()
            .iter()
            .zip(&self.parameters)
            .map(|(p, (value, error))| (p.name.to_string(), Estimate::normal(p, *value, Some(*error))))
            .collect();
        Finding {
            id: self.effect.id().into(),
            claim: Claim::Lacks,
            share: 1.0,
            is_class: false,
            parameters,
            heldout_gain_bar: self.gain_bar,
            heldout_gain_ci_bar: None,
            p_value: 1.0,
            indistinguishable: Vec::new(),
            evidence: format!(
                "data of the good valve shows it already ({}): without it the error there grows by {:.3} bar",
                names.join(", "),
                self.gain_bar
            ),
        }
    }
}

impl Good {
    /// Corrects the model by data of the good valve, by the thresholds of the record that it is to speak for.
    ///
    /// # Errors
    /// [`DiagnoseError`] where that data cannot be used, or does not belong to the model.
    pub fn of(recordings: &[Recording], valve: &Valve, foreign: Option<&Foreign>, record: &Evidence) -> Result<Self, DiagnoseError> {
        let names: Vec<String> = recordings.iter().map(|r| r.source.clone()).collect();
        let all = together(recordings);
        let model = |source| DiagnoseError::Model { model: valve.name.clone(), source: Box::new(source) };
        let mut evidence = Evidence::read(&all, valve)?;
        (evidence.criteria, evidence.remembered) = (record.criteria, record.remembered.clone());
        if let Some(foreign) = foreign {
            evidence.about(foreign)?;
        }
        if let Some((mistake, _)) = comparable::mistake(&evidence, valve).map_err(model)? {
            return Err(DiagnoseError::Recording {
                source_name: all.source,
                problem: format!("is to be data of the good valve, but does not belong to the model: {}", mistake.text()),
            });
        }
        // Rows that tell too little say nothing against an effect.
        let few = slower::read_every(&all, record.step_s()).filter(|_| foreign.is_none());
        let slowly = few.and_then(|few| Evidence::read(&few, valve).ok());
        let mut base = Model::base(valve).map_err(model)?.on(&evidence);
        let slow = evidence.is_slow();
        if slow {
            base = base.of_process(evidence.step_s());
        }
        let unsettled = settled::unsettled(&mut evidence, &base);
        let mut fitter = Fitter::without(&evidence, &unsettled);
        let (null, base, mut masked) = restored(&mut fitter, base);
        masked.extend(scatter(&fitter, &null, |e| !e.restores()));
        mask(&masked, &mut fitter.measured);
        let short = excerpt(&fitter, &base, Some(&null));
        (fitter.criteria.worth, fitter.criteria.rounds) = (fitter.criteria.worth_of_form, fitter.criteria.rounds_of_form);
        fitter.corrects = true;
        let mut looking = short.as_ref().map(|short| fitter.looking_at(short));
        let found = search_in(&mut fitter, looking.as_mut(), &base);
        let chosen = within_range(&fitter, found.chosen);
        let late = scatter(&fitter, &chosen, |_| true);
        let seen = masked.into_iter().chain(late).map(|s| (s.effect.id(), s.finding.theta)).collect();
        let errors = fitter.standard_errors(&chosen);
        let corrections = (0..chosen.model.effects.len())
            .map(|k| {
                let less = chosen.without(k);
                let without = fitter.polish(&less.model, &less.theta, 4);
                Correction {
                    effect: chosen.model.effects[k],
                    parameters: chosen.model.place(k).map(|j| (chosen.theta[j], errors[j])).collect(),
                    gain_bar: (without.rmse_bar - chosen.rmse_bar).max(0.0),
                }
            })
            .collect();
        let mut given = base.calibrated();
        given[AT.lag] = valve.lag_s;
        let as_given = fitter.score(&mut Simulator::new(&evidence), &base, &given, &mut Vec::new()).rmse_bar;
        let corrected = chosen.model.valve_file(&chosen.theta);
        let rmse_bar = (as_given, chosen.rmse_bar);
        let trust = if slow { None } else { trusted(&fitter, &chosen) };
        let fitter = fitter.trusting(trust.clone());
        let chosen = fitter.as_it_stands(&chosen);
        let worst_bar = worst(&fitter, &chosen).max(chosen.rmse_bar);
        let theta = chosen.theta.clone();
        let tau_samples = looking.as_ref().map_or(fitter.tau_samples, |l| l.tau_samples);
        let measured = fitter.measured.clone();
        // From here on the base is read as the good valve shows it.
        if let Some(base) = &mut evidence.base {
            base.read_as(base.recalibration(&theta));
        }
        let sources = valve.identification.iter().flat_map(Identification::sources);
        let identified: Vec<&str> = sources.map(|(name, _)| name).collect();
        let file = |name: &String| Path::new(name).file_name().is_some_and(|file| identified == [file.to_string_lossy()]);
        let is_identification = names.len() == 1 && names.iter().all(file);
        Ok(Self {
            names,
            is_identification,
            valve: corrected,
            corrections,
            scatter: seen,
            short,
            slowly,
            measured,
            tau_samples,
            rmse_bar,
            worst_bar,
            trust,
            evidence,
        })
    }

    /// How far the corrected model is off where nothing is wrong, beyond the noise of the good valve's data [bar].
    pub fn form_error_bar(&self) -> f64 {
        (self.worst_bar.powi(2) - self.evidence.noise_bar.powi(2)).max(0.0).sqrt()
    }

    /// Whether it is nothing but the recording that the model was identified from, and the model does not follow even that: a poor fit
    /// at the identification is a reason for a diagnosis, not an excuse for what is off elsewhere. What differs from it has changed all
    /// the same.
    pub fn is_denied(&self) -> bool {
        self.is_identification && self.worst_bar > self.evidence.criteria.structure * self.evidence.noise_bar
    }

    /// The noise of a record of the same sensor [bar]: readings that stand still tell nothing of it, and that of the good valve's data
    /// counts.
    pub fn noise_of_bar(&self, record: &Evidence) -> f64 {
        let stand_still = record.repeats() > REPEATS && self.evidence.repeats() < REPEATS;
        if stand_still { record.noise_bar.max(self.evidence.noise_bar) } else { record.noise_bar }
    }

    /// Whether this data shows scatter of this kind and size as well: what is left of it is no smaller then.
    pub fn scatters(&self, effect: &dyn Effect, found: &ScatterFinding) -> bool {
        let noisier = self.evidence.criteria.noisier;
        let is_no_larger = |known: &[f64]| found.theta.iter().zip(known).all(|(here, there)| here.abs() <= noisier * there.abs());
        if self.scatter.iter().any(|(id, known)| *id == effect.id() && is_no_larger(known)) {
            return true;
        }
        let Ok(base) = Model::base(&self.valve).map(|base| base.on(&self.evidence)) else { return false };
        let (mut simulated, calibrated) = (Vec::new(), base.calibrated());
        Simulator::new(&self.evidence).pressure(&base, &calibrated, &mut simulated);
        let (current_a, runs) = (self.evidence.current_a(), self.evidence.runs());
        let look = Scatter {
            dt_s: self.evidence.step_s(),
            noise_bar: self.evidence.noise_bar,
            measured_bar: &self.measured,
            simulated_bar: &simulated,
            current_a: &current_a,
            runs: &runs,
            delay_s: calibrated[AT.late],
            lag_s: calibrated[AT.lag],
        };
        effect.scatter_nats(found, &look).is_some_and(|nats| nats > 0.0)
    }

    /// That data as a search looks at it.
    fn fitter(&self) -> Fitter<'_> {
        let fitter = match &self.short {
            Some(short) => Fitter { tau_samples: self.tau_samples, ..Fitter::new(short) },
            None => Fitter { measured: self.measured.clone(), tau_samples: self.tau_samples, ..Fitter::new(&self.evidence) },
        };
        fitter.trusting(self.trust.clone())
    }

    /// How much that data speaks against an effect of the values `theta`, with which the record is explained [nats]; the base
    /// may make room for it. `on_record`: the price on the record [nats] of other values of it. Where `recalibrated` gives the base that
    /// the record has with an effect on the form of the loop, the cheapest of the values between those that the record wants and those
    /// that this data wants; the base may then be that one, at no price but that of this data, from which the calibration was made.
    ///
    /// Read as slowly as the record, that data has to speak against such an effect of any size: it may stand in for what the current does
    /// between two readings.
    pub fn excludes(&self, effect: &'static dyn Effect, theta: &[f64], on_record: Price<'_>, recalibrated: Option<&[f64]>) -> f64 {
        let Ok(base) = Model::base(&self.valve) else { return 0.0 };
        let slowly = self.slowly.as_ref().map_or(f64::INFINITY, |slowly| {
            let fitter = Fitter::new(slowly);
            let against = Against::of(&fitter, &base.clone().on(slowly), effect);
            against.at(theta).min(against.between(theta, on_record))
        });
        let fitter = self.fitter();
        let against = Against::of(&fitter, &base.on(&self.evidence), effect);
        let own = against.at(theta).min(slowly);
        recalibrated.map_or(own, |base| own.min(against.at_recalibrated(base, theta)).min(against.between(theta, on_record)))
    }
}

/// Several recordings of one valve as one.
pub fn together(recordings: &[Recording]) -> Recording {
    let names: Vec<&str> = recordings.iter().map(|r| r.source.as_str()).collect();
    Recording {
        source: names.join(", "),
        runs: recordings.iter().flat_map(|r| r.runs.iter().cloned()).collect(),
        notes: Vec::new(),
        input: recordings.iter().find_map(|r| r.input),
    }
}

/// A fit without the shifts of the calibration that had to go to the end of their range: two parameters that stand in for one another on
/// this data are far off on another drive.
fn within_range<'a>(fitter: &Fitter<'_>, mut fit: Fit<'a>) -> Fit<'a> {
    let at_end = |fit: &Fit<'a>| (0..fit.model.effects.len()).find(|k| fit.model.effects[*k].is_shift_of_calibration() && fit.at_bound(*k));
    while let Some(k) = at_end(&fit) {
        fit = fitter.refit_without(&fit, k);
    }
    fit
}

/// Where the fit of the good valve's data is to be trusted less than at rest.
fn trusted(fitter: &Fitter<'_>, fit: &Fit<'_>) -> Option<Trust> {
    let mut residual = Vec::new();
    fitter.residual(&mut Simulator::new(fitter.evidence), &fit.model, &fit.theta, &mut residual);
    Trust::of(fit.model.valve, fitter.evidence, &residual)
}

/// RMSE of a fit on the run that it fits worst [bar].
fn worst(fitter: &Fitter<'_>, fit: &Fit<'_>) -> f64 {
    let mut residual = Vec::new();
    fitter.residual(&mut Simulator::new(fitter.evidence), &fit.model, &fit.theta, &mut residual);
    let mut begin = 0;
    let runs = fitter.evidence.grids.iter().map(|run| {
        begin += run.len();
        rms(&residual[begin - run.len()..begin])
    });
    runs.fold(0.0, f64::max)
}

/// From this share of readings that are the same as the one before on, a recording shows less noise than its sensor has.
const REPEATS: f64 = 0.1;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::evidence::tests::{held, straight, straight_run, waves};

    #[test]
    fn a_shift_at_the_end_of_its_range_is_no_correction() {
        let valve = straight();
        let evidence = held(vec![straight_run(waves(3000), |k, _| if k % 2 == 0 { 0.02 } else { -0.02 })]);
        let fitter = Fitter::new(&evidence);
        let base = Model::base(&valve).unwrap().on(&evidence);
        let kept = |offset_bar: f64| {
            let model = base.with(crate::physics::effect("reference_shift").unwrap(), 0.0);
            let theta = [base.calibrated().as_slice(), &[-0.1, offset_bar, 0.0, 0.0]].concat();
            let fit = fitter.score(&mut Simulator::new(&evidence), &model, &theta, &mut Vec::new());
            within_range(&fitter, fit).model.effects.len()
        };
        assert_eq!([kept(3.0), kept(6.0)], [1, 0]);
    }

    #[test]
    fn a_model_is_known_no_better_than_on_the_run_that_it_fits_worst() {
        let valve = straight();
        let run =
            |samples: usize, error_bar: f64| straight_run(waves(samples), move |k, _| if k % 2 == 0 { error_bar } else { -error_bar });
        let evidence = held(vec![run(9000, 0.02), run(1000, 0.3)]);
        let base = Model::base(&valve).unwrap().on(&evidence);
        let fitter = Fitter::new(&evidence);
        let fit = fitter.score(&mut Simulator::new(&evidence), &base, &base.calibrated(), &mut Vec::new());
        assert!((worst(&fitter, &fit) - 0.3).abs() < 0.01, "{}", worst(&fitter, &fit));
        assert!(fit.rmse_bar < 0.11, "{}", fit.rmse_bar);
    }
}
