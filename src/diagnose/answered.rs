//! A tone that a controller answers.
//!
//! In a closed loop the current follows the pressure, and with it every tone that stands in it. An effect that makes much of a small
//! ripple of the current then gives back, from the controller's answer, the tone that was answered, on this record and on held-out
//! parts of it alike: in a closed loop, what goes round says nothing of what came first (Ljung, System Identification, 2nd ed.,
//! section 13.4). The tone itself tells: it stands in what the model leaves, as calibrated or recalibrated, in a band in which the current as simulated
//! moves next to nothing. Where that is what an effect gives back, the search begins anew on readings without it.

use super::evidence::Evidence;
use super::excerpt::excerpt;
use super::fit::{Fit, Fitter};
use super::model::Model;
use super::scatter::{Scattered, scatter};
use super::search::{Search, search_in};

/// An effect gives back a tone where that is most of what it gains: half of the squared error.
const MOST: f64 = 0.5;

/// The tone that an effect of what was chosen gives back, where there is one.
pub fn tone_given_back(fitter: &Fitter<'_>, search: &Search<'_>) -> Option<Scattered> {
    let chosen = &search.chosen;
    if chosen.model.effects.is_empty() {
        return None;
    }
    let named = |id: &str| chosen.model.effects.iter().any(|e| e.id() == id) || fitter.found.contains(&id);
    // A recalibration has turned the answer against the tone, and what is left of both is not the tone; the calibration has not.
    let calibrated = fitter.as_it_stands(&Fit { theta: search.null.model.calibrated(), ..search.null.clone() });
    let about = |fit: &Fit<'_>| scatter(fitter, fit, |e| e.is_apart_from_form() && !named(e.id()));
    let tones = about(&calibrated).into_iter().chain(about(&search.null));
    tones.filter(|tone| !tone.finding.alone_bar.is_empty()).find(|tone| {
        let with = fitter.plain_residual(chosen);
        (0..chosen.model.effects.len()).any(|k| {
            let without = fitter.plain_residual(&fitter.refit_without(chosen, k));
            of_tone(&with, &without, &tone.finding.alone_bar) > MOST
        })
    })
}

/// Which part of the squared error that `without` has beyond `with` is that of the tone.
fn of_tone(with: &[f64], without: &[f64], alone_bar: &[f64]) -> f64 {
    let finite = || with.iter().zip(without).zip(alone_bar).filter(|((a, b), _)| a.is_finite() && b.is_finite());
    let gain: f64 = finite().map(|((a, b), _)| b * b - a * a).sum();
    let tone2: f64 = finite().map(|(_, tone)| tone * tone).sum();
    let along = |of: &dyn Fn((&f64, &f64)) -> f64| finite().map(|((a, b), tone)| of((a, b)) * tone).sum::<f64>();
    let (left, there) = (along(&|r| *r.0), along(&|r| *r.1));
    if gain > 0.0 && tone2 > 0.0 { (there * there - left * left) / tone2 / gain } else { 0.0 }
}

/// The search on readings without that tone.
pub fn search_without<'a>(fitter: &Fitter<'_>, base: &Model<'a>, null: &Fit<'_>, tone: &Scattered) -> Search<'a> {
    let alone_bar = &tone.finding.alone_bar;
    let less = |readings: &[f64], own: &[f64]| readings.iter().zip(own).map(|(y, tone)| y - tone).collect::<Vec<f64>>();
    let mut evidence: Evidence = fitter.evidence.clone();
    for (run, range) in evidence.grids.iter_mut().zip(fitter.evidence.runs()) {
        run.pressure_bar = less(&run.pressure_bar, &alone_bar[range]);
    }
    let mut quiet = Fitter { measured: less(&fitter.measured, alone_bar), ..fitter.looking_at(&evidence) };
    let short = excerpt(&quiet, base, Some(null));
    let mut looking = short.as_ref().map(|short| quiet.looking_at(short));
    search_in(&mut quiet, looking.as_mut(), base)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_part_of_a_gain_that_is_a_tones_is_told_from_the_rest() {
        let tone: Vec<f64> = (0..4000).map(|k| 0.3 * (0.7 * f64::from(k)).sin()).collect();
        let course: Vec<f64> = (0..4000).map(|k| 0.3 * (0.01 * f64::from(k)).sin()).collect();
        let both: Vec<f64> = tone.iter().zip(&course).map(|(a, b)| a + b).collect();
        assert!(of_tone(&course, &both, &tone) > 0.95, "the tone is gone");
        assert!(of_tone(&tone, &both, &tone).abs() < 0.05, "the course is gone");
        let none = vec![0.0; 4000];
        assert!((of_tone(&none, &both, &tone) - 0.5).abs() < 0.05, "both are");
    }
}
