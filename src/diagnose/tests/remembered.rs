//! Fits that are remembered: once each, and none for another.

use std::cell::Cell;

use crate::diagnose::Remembered;
use crate::diagnose::descent::Descent;
use crate::diagnose::evidence::Evidence;
use crate::diagnose::evidence::tests::{held, straight, straight_run, waves};
use crate::diagnose::fit::Fitter;
use crate::diagnose::model::Model;
use crate::diagnose::simulator::Simulator;

#[test]
fn what_was_fitted_is_fitted_once_and_what_differs_in_anything_is_another_fit() {
    let valve = straight();
    let mut evidence = held(vec![straight_run(waves(600), |k, _| if k % 2 == 0 { 0.02 } else { -0.02 })]);
    evidence.remembered = Some(Remembered::default());
    let without = Evidence { remembered: None, ..evidence.clone() };
    let base = Model::base(&valve).unwrap().on(&evidence);
    let start = base.calibrated();
    let made = Cell::new(0);
    let ask = |fitter: &Fitter<'_>, model: &Model<'_>, start: &[f64], descent: Descent| {
        let ends = fitter.remembering((model, &[start]), descent, || {
            made.set(made.get() + 1);
            vec![fitter.score(&mut Simulator::new(fitter.evidence), model, start, &mut Vec::new())]
        });
        (made.get(), ends[0].theta.clone(), ends[0].mean_nats)
    };
    let fitter = Fitter::new(&evidence);
    let first = ask(&fitter, &base, &start, Descent::of(4));
    assert_eq!(ask(&fitter, &base, &start, Descent::of(4)), first, "the same is not fitted again");
    let mut moved = start.clone();
    moved[0] += 1e-9;
    let mut masked = Fitter::new(&evidence);
    masked.measured[7] = f64::NAN;
    let mut weighed = Fitter::new(&evidence);
    weighed.weights = vec![0.5; 600];
    let squared = Fitter { squared: !fitter.squared, ..Fitter::new(&evidence) };
    let thinner = Fitter { tau_samples: 7.0, ..Fitter::new(&evidence) };
    let lag = base.with(crate::physics::effect("first_order_lag").unwrap(), 0.0);
    let longer = [start.as_slice(), &[0.05, 1.0]].concat();
    let still = base.standing_still();
    let others: [(&Fitter<'_>, &Model<'_>, &[f64], Descent); 9] = [
        (&fitter, &base, &moved, Descent::of(4)),
        (&fitter, &base, &start, Descent::of(5)),
        (&fitter, &base, &start, Descent { held: 1, ..Descent::of(4) }),
        (&fitter, &still, &start, Descent::of(4)),
        (&fitter, &lag, &longer[..start.len() + lag.extra_parameters()], Descent::of(4)),
        (&masked, &base, &start, Descent::of(4)),
        (&weighed, &base, &start, Descent::of(4)),
        (&squared, &base, &start, Descent::of(4)),
        (&thinner, &base, &start, Descent::of(4)),
    ];
    for (k, (fitter, model, start, descent)) in others.into_iter().enumerate() {
        assert_eq!(ask(fitter, model, start, descent).0, 2 + k, "number {k} is another fit");
    }
    let forgetful = Fitter::new(&without);
    assert_eq!([0, 1].map(|_| ask(&forgetful, &base, &start, Descent::of(4)).0), [11, 12], "nothing is remembered unasked");
}
