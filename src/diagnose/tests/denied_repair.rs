//! A form of the loop that has changed, where a recalibration follows the record as well.

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};

use super::super::*;
use super::{valve, valve_with};
use crate::physics::simulate;
use crate::recording::Run;
use crate::valve::Input;

/// Ramps of all rates with holds between `low_a` and `high_a` for `length_s`, and what is read of a valve whose curve the model does not
/// quite have.
fn driven(of: &Valve, (low_a, high_a): (f64, f64), (length_s, dt_s): (f64, f64), seed: u64) -> Recording {
    let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
    let (mut time_s, mut current_a) = (vec![0.0], vec![0.5 * (low_a + high_a)]);
    let (mut at_a, mut goal_a, mut a_per_s, mut hold_s) = (current_a[0], current_a[0], 0.1, 0.0);
    while time_s[time_s.len() - 1] < length_s {
        if at_a != goal_a {
            at_a += (goal_a - at_a).clamp(-a_per_s * dt_s, a_per_s * dt_s);
        } else if hold_s > 0.0 {
            hold_s -= dt_s;
        } else {
            goal_a = random.random_range(low_a..high_a);
            a_per_s = 0.02 * 30f64.powf(random.random());
            hold_s = random.random_range(0.2..2.0);
        }
        time_s.push(dt_s * time_s.len() as f64);
        current_a.push(at_a);
    }
    let noise = Normal::new(0.0, 0.03).unwrap();
    let pressure = simulate(of, Input::Held, &time_s, &current_a).unwrap();
    let pressure = pressure.iter().map(|p| p + 0.05 * (p / 1.7).sin() + noise.sample(&mut random)).collect();
    let run = Run { time_s, current_a, pressure_bar: Some(pressure), ..Run::default() };
    Recording { source: "drive.csv".into(), runs: vec![run], notes: vec![], input: Some(Input::Held) }
}

#[test]
fn a_loop_that_alone_explains_what_a_denied_recalibration_hides_has_changed() {
    let name = "rate_dependent_hysteresis";
    let good = [driven(&valve(), (0.25, 0.9), (150.0, 0.05), 100)];
    let about_a_point = |of: &Valve| diagnose_against(&driven(of, (0.44, 0.56), (100.0, 0.1), 0), &valve(), &good).unwrap().diagnosis;
    let changed = about_a_point(&valve_with(name, &[0.8, 0.4, 0.03, 0.2]));
    let told: Vec<_> = changed.effects.iter().map(|f| (f.id.as_str(), f.claim)).collect();
    assert_eq!(told, [(name, Claim::Changed)], "{}", changed.summary);
    let healthy = about_a_point(&valve());
    assert_eq!((healthy.verdict, healthy.effects.len()), (Verdict::Match, 0), "{}", healthy.summary);
}

/// Without the rule, the late valve is a match: it is no farther off than a good one may be.
#[test]
fn what_stands_in_the_place_of_a_denied_recalibration_has_changed_however_small_it_is() {
    let good = [driven(&valve(), (0.25, 0.9), (120.0, 0.01), 201)];
    let found = |of: &Valve| diagnose_against(&driven(of, (0.25, 0.9), (80.0, 0.01), 1), &valve(), &good).unwrap().diagnosis;
    let changed = found(&valve_with("transport_delay", &[0.022]));
    let [first] = changed.effects.as_slice() else { panic!("{}", changed.summary) };
    let says = |id: &str| first.id == id || first.indistinguishable.iter().any(|other| other == id);
    assert!(first.claim == Claim::Changed && says("transport_delay"), "{}", changed.summary);
    let healthy = found(&valve());
    assert_eq!((healthy.verdict, healthy.effects.len()), (Verdict::Match, 0), "{}", healthy.summary);
}

/// The model has the same effect from data of the good valve already, a tenth of it: nothing was named.
#[test]
fn a_form_that_the_good_valve_has_in_small_has_changed_where_it_stands_for_a_denied_recalibration() {
    let widens = |width: f64| valve_with("rate_dependent_hysteresis", &[width, 0.5, 0.0, 0.05, 0.0]);
    let good = driven(&widens(0.4), (0.1, 0.9), (30.0, 0.02), 2);
    let d = diagnose_against(&driven(&widens(4.0), (0.1, 0.9), (30.0, 0.02), 1), &valve(), &[good]).unwrap().diagnosis;
    let first = d.effects.first().unwrap_or_else(|| panic!("{}", d.summary));
    assert_eq!((first.id.as_str(), first.claim), ("rate_dependent_hysteresis", Claim::Changed), "{}", d.summary);
}
