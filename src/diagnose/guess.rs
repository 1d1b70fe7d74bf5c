//! An answer that three things speak against at once: a guess, and none is made.
//!
//! Each of them is told beside a name, and leaves it one: that no single name reaches its share, that what the model does on other drives
//! is open, and that the calibration beside the effects is one that data of the good valve denies. With all three the
//! record has been followed by something, at a price that the valve does not pay, and nobody knows by what.

use super::diagnosis::Diagnosis;
use super::fit::{Fit, Fitter};
use super::words::title;

/// What to say of a diagnosis that is a guess, by the fit that it was made of; nothing where it is none.
pub fn guess(fitter: &Fitter<'_>, found: &Diagnosis, chosen: &Fit<'_>) -> Option<String> {
    let is_class = !found.effects.is_empty() && found.effects.iter().all(|effect| effect.is_class);
    let is_open = found.other_drives.as_ref().is_some_and(|there| there.is_too_much);
    let is_denied = fitter.is_vouched && fitter.criteria.denies(chosen.prior_nats);
    (is_class && is_open && is_denied).then(|| {
        let mut names: Vec<String> = found.effects.iter().map(|effect| title(&effect.id)).collect();
        names.extend(found.effects.iter().flat_map(|effect| effect.indistinguishable.iter().map(|id| title(id))));
        format!(
            "{} would follow this record beside a calibration that data of the good valve denies, and leave open what other drives do: none is named",
            names.join(" or ")
        )
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::super::diagnosis::tests::nothing;
    use super::super::diagnosis::{Claim, Finding, OtherDrives};
    use super::super::model::Model;
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
            heldout_gain_ci_bar: None,
            p_value: 0.01,
            indistinguishable: vec!["sensor_lag".into()],
            evidence: String::new(),
        }
    }

    #[test]
    fn a_class_beside_a_denied_calibration_that_leaves_other_drives_open_is_a_guess_and_two_of_the_three_are_none() {
        let valve = straight();
        let evidence = held(vec![straight_run(waves(3000), |_, _| 0.0)]);
        let fitter = Fitter { is_vouched: true, ..Fitter::new(&evidence) };
        let base = Model::base(&valve).unwrap().on(&evidence);
        let free = fitter.recalibrate(&base, &[]);
        let said = |is_class: bool, is_too_much: bool, is_vouched: bool, prior_nats: f64| {
            let mut found = nothing();
            found.effects = vec![finding(is_class)];
            found.other_drives = Some(OtherDrives { open_bar: 0.4, most_on: "steps".into(), is_too_much });
            let fitter = Fitter { is_vouched, ..fitter.looking_at(&evidence) };
            guess(&fitter, &found, &Fit { prior_nats, ..free.clone() })
        };
        let note = said(true, true, true, 40.0).unwrap();
        assert!(note.starts_with("flow limit or sensor lag would follow"), "{note}");
        for two in
            [said(false, true, true, 40.0), said(true, false, true, 40.0), said(true, true, false, 40.0), said(true, true, true, 4.0)]
        {
            assert_eq!(two, None);
        }
        let of_nothing = guess(&fitter, &nothing(), &Fit { prior_nats: 40.0, ..free });
        assert_eq!(of_nothing, None);
    }
}
