//! Valves that stick are named, loops that oscillate for another reason are not.

use super::bench::{TROUBLES, Trouble, record};
use super::*;
use rayon::prelude::*;

fn sticks(trouble: Trouble, seed: u64) -> bool {
    let (u, y) = record(trouble, seed);
    assess(&y, &u).is_some_and(|found| found.stiction.is_some())
}

/// `HIL_LOOPS=100` counts over so many loops of each trouble and prints what was named; unset, a few are looked at.
#[test]
fn no_loop_without_friction_is_said_to_stick() {
    let count: u64 = std::env::var("HIL_LOOPS").ok().and_then(|v| v.parse().ok()).unwrap_or(0);
    let mut wrong = Vec::new();
    for trouble in TROUBLES {
        let friction = matches!(trouble, Trouble::Slides | Trouble::Steps);
        let few = if friction { 0 } else { 1 };
        let seeds = 0..if count > 0 { count } else { few };
        let named: Vec<u64> = seeds.into_par_iter().filter(|seed| sticks(trouble, *seed)).collect();
        if count > 0 {
            println!("{trouble:?}: {} of {count} said to stick", named.len());
        }
        if !friction {
            wrong.extend(named.into_iter().map(|seed| (trouble, seed)));
        }
    }
    let allowed = count as usize * (TROUBLES.len() - 2) / 100;
    assert!(wrong.len() <= allowed, "{wrong:?}");
}

/// A self-regulating process whose valve sticks: S and J come out, and so does the process.
#[test]
fn a_sticking_valve_is_named_with_its_band_and_slip() {
    use rand::SeedableRng;
    let jump = 2.0;
    let it = bench::Loop {
        gain: 1.6,
        lags: (6.0, 0.0),
        delay: 2,
        controller: 1.0,
        integral: 4.0,
        stem: Some((5.0, jump, true)),
        noise: (0.08, 0.01),
        limit: 50.0,
        ..bench::Loop::default()
    };
    let (u, y) = it.run(900, &mut rand_pcg::Pcg64::seed_from_u64(3));
    let (u, y) = (&u[400..], &y[400..]);
    let found = assess(y, u).unwrap();
    let stiction = found.stiction.unwrap_or_else(|| panic!("{:?} {:?}", found.oscillation, found.symptoms));
    assert!((stiction.stem.band / 5.0 - 1.0).abs() < 0.15, "{stiction:?}");
    assert!((stiction.stem.jump - jump).abs() < 0.8, "{stiction:?}");
    assert!((stiction.process.gain / 1.6 - 1.0).abs() < 0.4, "{stiction:?}");
    assert!(stiction.bands.0 <= 5.2 && stiction.bands.1 >= 4.8, "{stiction:?}");
    // The same loop with the valve freed and a sine from outside.
    let free = bench::Loop { stem: None, load: (0..900).map(|t| 2.0 * (0.25 * f64::from(t)).sin()).collect(), ..it };
    let (u, y) = free.run(900, &mut rand_pcg::Pcg64::seed_from_u64(3));
    assert!(assess(&y[400..], &u[400..]).unwrap().stiction.is_none());
}

/// A sweep in open loop is no control loop, whatever hysteresis the valve has and however slow the process is.
#[test]
fn a_sweep_is_no_loop() {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    let mut random = rand_pcg::Pcg64::seed_from_u64(5);
    let mut noise = || 0.02 * Distribution::<f64>::sample(&StandardNormal, &mut random);
    let u: Vec<f64> = (0..600).map(|t| (f64::from(t) / 50.0 % 2.0 - 1.0).abs()).collect();
    for lag in [0.0, 0.8] {
        let (mut x, mut z) = (u[0], u[0]);
        let y: Vec<f64> = u
            .iter()
            .map(|u| {
                x = x.clamp(u - 0.05, u + 0.05);
                z = lag * z + (1.0 - lag) * x;
                20.0 * z + noise()
            })
            .collect();
        assert!(!is_closed(&y, &u), "{lag}");
        assert!(assess(&y, &u).is_none(), "{lag} {:?}", assess(&y, &u).and_then(|a| a.stiction));
    }
}

#[test]
fn what_is_short_or_stands_still_is_not_looked_at() {
    let u: Vec<f64> = (0..100).map(|t| f64::from(t % 7)).collect();
    assert!(assess(&u, &u).is_none());
    let still = vec![1.0; 400];
    let moving: Vec<f64> = (0..400).map(|t| f64::from(t % 7)).collect();
    assert!(assess(&still, &moving).is_none() && assess(&moving, &still).is_none());
    assert!(assess(&vec![f64::NAN; 400], &moving).is_none());
}
