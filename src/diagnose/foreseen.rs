//! How far a model has to be expected off on another drive.
//!
//! A record may be followed by a model whose parameters it hardly tells, or by one of several that part on the next drive: that the
//! error is small on it, held out or not, then promises little. What the record leaves open is simulated on the menu of stimuli: the
//! model with its parameters moved along each axis of their covariance, and the models of the credible set by their shares. The
//! variances add up (Draper, J. R. Stat. Soc. B 57 (1995) 45, eq. 6: within a model and between models).

use rayon::prelude::*;

use super::conclude::Findings;
use super::diagnosis::OtherDrives;
use super::errors::Curvature;
use super::fit::{Fit, shifted};
use super::stimuli::{menu, sampled};
use crate::physics::simulate;
use crate::valve::{Input, Valve};

/// Time step of the simulations [s].
const STEP_S: f64 = 0.01;

/// The menu of stimuli, with what a model does on it.
struct Menu {
    drives: Vec<(&'static str, Vec<f64>, Vec<f64>)>,
    chosen: Vec<Vec<f64>>,
}

impl Menu {
    fn of(valve: &Valve) -> Option<Self> {
        let one = |stimulus: &super::stimuli::Stimulus| {
            let (time_s, current_a) = sampled(&stimulus.points, STEP_S);
            (stimulus.name, time_s, current_a)
        };
        let drives = menu(valve).iter().map(one).collect();
        let mut menu = Self { drives, chosen: Vec::new() };
        menu.chosen = menu.pressures(valve)?;
        Some(menu)
    }

    /// The pressure on each; nothing where one cannot be simulated [bar].
    fn pressures(&self, valve: &Valve) -> Option<Vec<Vec<f64>>> {
        self.drives.iter().map(|(_, time_s, current_a)| simulate(valve, Input::Ramp, time_s, current_a).ok()).collect()
    }

    /// Mean square difference of another model on each, `share` of it [bar^2].
    fn apart(&self, share: f64, valve: &Valve) -> Option<Vec<f64>> {
        let squares =
            |(a, b): (&Vec<f64>, &Vec<f64>)| share * a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len().max(1) as f64;
        Some(self.chosen.iter().zip(&self.pressures(valve)?).map(squares).collect())
    }
}

/// What a record leaves open of the model of this fit, and of those that could stand in its place; `None` where one of them cannot be
/// simulated.
fn foreseen(curvature: &Curvature<'_, '_>, rivals: &[(f64, &Fit<'_>)]) -> Option<OtherDrives> {
    let chosen = curvature.fit;
    let menu = Menu::of(&chosen.model.valve_file(&chosen.theta))?;
    let moved = |step: Vec<f64>| {
        let theta = chosen.theta.iter().zip(step).zip(&curvature.free).map(|((value, step), free)| shifted(free, *value, step));
        chosen.model.valve_file(&theta.collect::<Vec<f64>>())
    };
    let models: Vec<(f64, Valve)> = curvature
        .spread()
        .into_iter()
        .map(|step| (1.0, moved(step)))
        .chain(rivals.iter().map(|(share, fit)| (*share, fit.model.valve_file(&fit.theta))))
        .collect();
    let each: Vec<Vec<f64>> = models.par_iter().map(|(share, valve)| menu.apart(*share, valve)).collect::<Option<_>>()?;
    let on = |k: usize| each.iter().map(|variance| variance[k]).sum::<f64>();
    let variances: Vec<f64> = (0..menu.drives.len()).map(on).collect();
    let most = (0..variances.len()).max_by(|a, b| variances[*a].total_cmp(&variances[*b]))?;
    let open_bar = (variances.iter().sum::<f64>() / variances.len() as f64).sqrt();
    open_bar.is_finite().then(|| OtherDrives { open_bar, most_on: menu.drives[most].0.into(), is_too_much: false })
}

impl Findings<'_, '_> {
    /// What the record leaves open of the chosen model; nothing about a foreign model, which is not simulated on other drives, nor where
    /// no effect of the course is named: the model is as it was calibrated.
    pub fn foreseen(&self, curvature: Option<&Curvature<'_, '_>>) -> Option<OtherDrives> {
        let is_open = !self.search.chosen.model.effects.is_empty() && self.fitter.evidence.base.is_none();
        let curvature = curvature.filter(|_| is_open)?;
        let rivals: Vec<_> = self.weighed.iter().flat_map(|weighed| weighed.rest.iter().map(|m| (m.share, &m.fit))).collect();
        foreseen(curvature, &rivals)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::base::AT;
    use crate::diagnose::evidence::tests::{held, straight, straight_run};
    use crate::diagnose::fit::Fitter;
    use crate::diagnose::model::Model;
    use crate::diagnose::simulator::Simulator;
    use crate::physics::effect;

    /// What a record of two minutes about 0.5 A leaves open of a creep, where the current goes to and fro by `swing_a`; `share` of a
    /// model whose gain is 10 % higher.
    fn open(swing_a: f64, share: f64) -> OtherDrives {
        let valve = straight();
        let current_a = (0..12_000).map(|k| 0.5 + swing_a * (0.01 * f64::from(k)).sin()).collect();
        let evidence = held(vec![straight_run(current_a, |k, _| if k.is_multiple_of(2) { 0.03 } else { -0.03 })]);
        let model = Model::base(&valve).unwrap().on(&evidence).with(effect("creep").unwrap(), 0.0);
        let fitter = Fitter { tau_samples: 100.0, squared: true, ..Fitter::new(&evidence) };
        let theta = [model.calibrated(), vec![0.0, 10.0, 1.0]].concat();
        let fit = fitter.score(&mut Simulator::new(&evidence), &model, &theta, &mut Vec::new());
        let mut other = fit.clone();
        other.theta[AT.gain] += 0.1;
        let curvature = fitter.curvature(&fit).unwrap();
        foreseen(&curvature, &[(share, &other)]).unwrap()
    }

    #[test]
    fn a_current_that_hardly_moves_leaves_open_what_it_does_not_excite() {
        let (lively, faint) = (open(0.3, 0.0), open(0.003, 0.0));
        assert!(faint.open_bar > 5.0 * lively.open_bar, "{faint:?} {lively:?}");
        assert!(lively.open_bar < 0.05, "{lively:?}");
    }

    #[test]
    fn a_rival_counts_by_its_share() {
        let between = |share: f64| (open(0.3, share).open_bar.powi(2) - open(0.3, 0.0).open_bar.powi(2)).sqrt();
        assert!(between(1.0) > 0.5, "a tenth more of some ten bar: {}", between(1.0));
        assert!((between(0.25) / between(1.0) - 0.5).abs() < 1e-3);
    }
}
