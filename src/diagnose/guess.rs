//! An answer that several things speak against at once: a guess, and none is made.
//!
//! Each of them is told beside a name, and leaves it one: that no single name reaches its share or has to go to the end of its range, that
//! what the model does on other drives is open, and that the calibration beside the effects is one that data of the good valve denies. With
//! all three the record has been followed by something, at a price that the valve does not pay, and nobody knows by what. Likewise where
//! the record sets no end to a value, others would do as well as the one that is named, and more is open on other drives than was wrong on
//! this one: values that cancel each other here, and nowhere else. Likewise a class that is not in its own credible set, or beside which
//! much stays that nothing explains, where held-out data does not confirm it beyond chance. And a cause that is no name, as nobody knows
//! whether the valve always had it, where the calibration beside it is denied and the record is unexplained all the same: a model with it
//! is off elsewhere, and farther than without.

use super::diagnosis::{Diagnosis, Finding, Verdict};
use super::fit::{Fit, Fitter};
use super::words::title;
use crate::physics::effect;

/// What to say of a diagnosis that is a guess, by the fit that it was made of; nothing where it is none.
pub fn guess(fitter: &Fitter<'_>, found: &Diagnosis, chosen: &Fit<'_>) -> Option<String> {
    let criteria = &fitter.criteria;
    if found.effects.is_empty() {
        return unnamed(fitter, found, chosen);
    }
    let is_class = found.effects.iter().all(|effect| effect.is_class);
    let there = found.other_drives.as_ref().filter(|there| there.is_too_much);
    let remains = found.unexplained.is_some();
    let is_by_chance = |effect: &Finding| {
        (remains || effect.share < 1.0 - criteria.credible) && effect.heldout_gain_ci_bar.is_some_and(|(low_bar, _)| low_bar <= 0.0)
    };
    let price = match there {
        Some(_) if is_class && fitter.is_vouched && criteria.denies(chosen.prior_nats) => {
            "beside a calibration that data of the good valve denies, and leave open what other drives do".to_string()
        }
        Some(there)
            if there.open_bar > found.rmse_bar.base
                && found.effects.iter().all(|effect| effect.is_class || effect.share < criteria.credible)
                && found.effects.iter().chain(&found.form).any(is_without_end) =>
        {
            format!("and leave {:.3} bar open on other drives, more than the model as given is off here", there.open_bar)
        }
        _ if is_class && found.effects.iter().all(is_by_chance) => "no better than by chance where it was held out".to_string(),
        _ => return None,
    };
    let mut names: Vec<String> = found.effects.iter().map(|effect| title(&effect.id)).collect();
    names.extend(found.effects.iter().flat_map(|effect| effect.indistinguishable.iter().map(|id| title(id))));
    Some(format!("{} would follow this record {price}: none is named", names.join(" or ")))
}

/// The same where nothing is named: what a cause in the form of the valve takes, with a denied calibration, of a record that stays
/// unexplained.
fn unnamed(fitter: &Fitter<'_>, found: &Diagnosis, chosen: &Fit<'_>) -> Option<String> {
    let is_cause = |id: &&str| effect(id).is_some_and(|e| e.is_cause() && !e.imitates_form());
    let causes: Vec<String> = chosen.ids().into_iter().filter(is_cause).map(title).collect();
    let is_guess = found.verdict == Verdict::Unexplained && fitter.criteria.denies(chosen.prior_nats) && !causes.is_empty();
    is_guess.then(|| {
        let causes = causes.join(" and ");
        format!(
            "{causes} would take a part of the error beside a calibration that the model's own data denies, and leave what nothing \
             explains: the model stays as given"
        )
    })
}

/// Whether the record sets no end to a value on one side.
fn is_without_end(finding: &Finding) -> bool {
    finding.parameters.values().any(|estimate| estimate.interval.is_some_and(|(low, high)| low.is_none() || high.is_none()))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::super::diagnosis::tests::nothing;
    use super::super::diagnosis::{Claim, Estimate, Finding, Interval, OtherDrives, Remainder};
    use super::super::model::Model;
    use super::super::simulator::Simulator;
    use super::*;
    use crate::diagnose::evidence::tests::{held, straight, straight_run, waves};

    fn finding(is_class: bool) -> Finding {
        Finding {
            id: "flow_limit".into(),
            claim: Claim::Changed,
            share: 0.3,
            is_class,
            parameters: BTreeMap::new(),
            heldout_gain_bar: 0.1,
            heldout_gain_ci_bar: Some((0.01, 0.2)),
            p_value: 0.01,
            indistinguishable: vec!["sensor_lag".into()],
            evidence: String::new(),
        }
    }

    #[test]
    fn what_leaves_other_drives_open_is_a_guess_as_a_class_beside_a_denied_calibration_or_where_it_has_no_end() {
        let valve = straight();
        let evidence = held(vec![straight_run(waves(3000), |_, _| 0.0)]);
        let fitter = Fitter { is_vouched: true, ..Fitter::new(&evidence) };
        let base = Model::base(&valve).unwrap().on(&evidence);
        let free = fitter.recalibrate(&base, &[]);
        let found = |is_class: bool, is_too_much: bool, base: f64| {
            let mut found = nothing();
            found.effects = vec![finding(is_class)];
            found.rmse_bar.base = base;
            found.other_drives = Some(OtherDrives { open_bar: 0.4, most_on: "steps".into(), is_too_much });
            found
        };
        let said = |is_class: bool, is_too_much: bool, is_vouched: bool, prior_nats: f64| {
            let fitter = Fitter { is_vouched, ..fitter.looking_at(&evidence) };
            guess(&fitter, &found(is_class, is_too_much, 0.39), &Fit { prior_nats, ..free.clone() })
        };
        let note = said(true, true, true, 40.0).unwrap();
        assert!(note.starts_with("flow limit or sensor lag would follow"), "{note}");
        for two in
            [said(false, true, true, 40.0), said(true, false, true, 40.0), said(true, true, false, 40.0), said(true, true, true, 4.0)]
        {
            assert_eq!(two, None);
        }
        let estimate = |interval: Interval| Estimate { value: -0.04, std_error: None, interval: Some(interval), unit: "A".into() };
        let ended = |interval: Interval, share: f64, is_too_much: bool, base_bar: f64| {
            let mut found = found(false, is_too_much, base_bar);
            found.effects[0].share = share;
            found.effects[0].parameters.insert("current".into(), estimate(interval));
            guess(&fitter, &found, &free)
        };
        let (without_end, with_ends) = ((None, Some(-0.02)), (Some(-0.045), Some(-0.02)));
        let note = ended(without_end, 0.7, true, 0.39).unwrap();
        assert!(note.contains("leave 0.400 bar open on other drives"), "{note}");
        for none in [
            ended(with_ends, 0.7, true, 0.39),
            ended(without_end, 1.0, true, 0.39),
            ended(without_end, 0.7, false, 0.39),
            ended(without_end, 0.7, true, 0.41),
        ] {
            assert_eq!(none, None);
        }
        // A class is one whatever its share is, and a form has values, too.
        let of_form = |interval: Interval| {
            let mut found = found(true, true, 0.39);
            found.effects[0].share = 1.0;
            found.form = vec![Finding { parameters: [("k2".into(), estimate(interval))].into(), ..finding(false) }];
            guess(&fitter, &found, &free)
        };
        assert!(of_form(without_end).is_some() && of_form(with_ends).is_none());
        let by_chance = |share: f64, low_bar: f64| {
            let mut found = nothing();
            found.effects = vec![Finding { share, heldout_gain_ci_bar: Some((low_bar, 0.2)), ..finding(true) }];
            guess(&fitter, &found, &free)
        };
        assert!(by_chance(0.05, -0.01).is_some_and(|note| note.contains("no better than by chance")));
        assert_eq!([by_chance(0.05, 0.01), by_chance(0.3, -0.01)], [None, None]);
        let beside_what_remains = |low_bar: f64| {
            let mut found = nothing();
            found.effects = vec![Finding { heldout_gain_ci_bar: Some((low_bar, 0.2)), ..finding(true) }];
            found.unexplained = Some(Remainder { rms_bar: 1.3, depends_on: Vec::new(), table_heldout_gain_bar: 0.0, windows: Vec::new() });
            guess(&fitter, &found, &free)
        };
        assert!(beside_what_remains(-0.01).is_some() && beside_what_remains(0.01).is_none());
        let of_nothing = guess(&fitter, &nothing(), &Fit { prior_nats: 40.0, ..free });
        assert_eq!(of_nothing, None);
    }

    #[test]
    fn a_cause_that_is_no_name_stays_out_of_a_model_that_explains_nothing_beside_a_denied_calibration() {
        let valve = straight();
        let evidence = held(vec![straight_run(waves(3000), |_, _| 0.0)]);
        let fitter = Fitter::new(&evidence);
        let base = Model::base(&valve).unwrap().on(&evidence);
        let said = |id: &str, prior_nats: f64, verdict: Verdict| {
            let model = base.with(effect(id).unwrap(), 0.0);
            let values: Vec<f64> = effect(id).unwrap().parameters().iter().map(|p| p.starts[0]).collect();
            let fit = fitter.score(&mut Simulator::new(&evidence), &model, &[base.calibrated(), values].concat(), &mut Vec::new());
            guess(&fitter, &Diagnosis { verdict, ..nothing() }, &Fit { prior_nats, ..fit })
        };
        let note = said("coil_heating", 40.0, Verdict::Unexplained).unwrap();
        assert!(note.starts_with("coil heating would take a part"), "{note}");
        for none in [
            said("coil_heating", 4.0, Verdict::Unexplained),
            said("coil_heating", 40.0, Verdict::Match),
            said("nonlocal_memory", 40.0, Verdict::Unexplained),
        ] {
            assert_eq!(none, None);
        }
    }
}
