//! Intervals beside the bound that no unbiased estimate goes below.

use nalgebra::{DMatrix, DVector};

use super::*;

/// What the valve is driven with.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    /// A plain triangle, twice from end to end.
    Triangle(Input),
    /// Triangles that become smaller, with a jump.
    Shrinking,
    /// Targets in closed loop, so that the noise of the sensor is in the current.
    Closed,
    /// Levels that are held for a while.
    Steps,
}

impl Kind {
    const ALL: [Self; 5] = [Self::Triangle(Input::Ramp), Self::Triangle(Input::Held), Self::Shrinking, Self::Closed, Self::Steps];

    fn input(self) -> Input {
        if let Self::Triangle(input) = self { input } else { Input::Held }
    }

    fn drive(self, valve: &Apart, random: &mut Pcg64) -> Recording {
        let current = match self {
            Self::Triangle(_) => path(0.15, &[(10.0, 0.95), (10.0, 0.15), (10.0, 0.95), (10.0, 0.15)], 0.01),
            Self::Shrinking => sweep(),
            Self::Closed => return closed(valve, 45.0, random),
            Self::Steps => steps(60.0, random),
        };
        open(valve, current, 0.01, self.input(), random)
    }
}

/// Standard deviations that no unbiased estimate goes below (Cramer and Rao), of what is linear in the parameters of `valve`: the eight
/// coefficients, `a`, delay, lag and the start.
struct Bound {
    covariance: DMatrix<f64>,
}

impl Bound {
    const PARAMETERS: usize = 12;

    fn of(valve: &Apart, current_a: &[f64], input: Input) -> Self {
        let pressure = |k: usize, step: f64| -> Vec<f64> {
            let mut moved = valve.clone();
            let mut start_bar = 0.0;
            match k {
                0..4 => moved.up[k] += step,
                4..8 => moved.down[k - 4] += step,
                8 => moved.a_bar2 += step,
                9 => moved.delay_s += step,
                10 => moved.lag_s += step,
                _ => start_bar = step,
            }
            let mut working = Working::new(&moved, current_a[0]);
            working.pressure_bar += start_bar;
            course(&mut working, current_a, 0.01, input)
        };
        // A step of the delay is one of whole fine steps.
        let steps: Vec<f64> = (0..Self::PARAMETERS).map(|k| if k == 9 { 2.0 * FINE_S } else { 1e-4 }).collect();
        let base = pressure(0, 0.0);
        let columns: Vec<Vec<f64>> =
            (0..Self::PARAMETERS).map(|k| pressure(k, steps[k]).iter().zip(&base).map(|(p, b)| (p - b) / steps[k]).collect()).collect();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / (NOISE_BAR * NOISE_BAR);
        let information = DMatrix::from_fn(Self::PARAMETERS, Self::PARAMETERS, |i, j| dot(&columns[i], &columns[j]));
        Self { covariance: super::super::inverse::inverse(&information) }
    }

    fn of_direction(&self, direction: impl Fn(usize) -> f64) -> f64 {
        let v = DVector::from_fn(Self::PARAMETERS, |k, _| direction(k));
        (v.transpose() * &self.covariance * &v)[(0, 0)].max(0.0).sqrt()
    }
}

/// `HIL_SEEDS=40 cargo test --release identify::law::intervals -- --nocapture` prints the figures.
#[test]
fn intervals_hold_the_truth_and_are_not_bought_by_width() {
    let valve = Apart::new(0.8, 0.0237, 0.012);
    for (number, kind) in (0..).zip(Kind::ALL) {
        let (mut inside, mut all, mut widths) = ([0; 3], [0; 3], [Vec::new(), Vec::new(), Vec::new()]);
        for seed in 0..seeds() {
            let random = &mut Pcg64::seed_from_u64(1000 * number + seed);
            let drive = kind.drive(&valve, random);
            let bound = Bound::of(&valve, &drive.runs[0].current_a, kind.input());
            let found = identify(&drive, &Options { input: Some(kind.input()), ..Options::default() }).unwrap();
            let mut seen = |what: usize, holds: bool, width: f64| {
                inside[what] += usize::from(holds);
                all[what] += 1;
                widths[what].push(width);
            };
            let late = valve.delay_s + valve.lag_s;
            for (what, name, truth, least) in [
                (0, "a", valve.a_bar2, bound.of_direction(|k| f64::from(u8::from(k == 8)))),
                (1, "late", late, bound.of_direction(|k| f64::from(u8::from(k == 9 || k == 10)))),
            ] {
                let p = found.parameters.iter().find(|p| p.name == name).unwrap();
                seen(what, (p.interval.0..=p.interval.1).contains(&truth), p.std_error / least);
            }
            for point in &found.curve_points {
                let i = point.current_a;
                let powers = [i * i * i, i * i, i, 1.0];
                for (from, bar, error_bar, curve) in [
                    (0, point.ascending_bar, point.ascending_std_error_bar, &valve.up),
                    (4, point.descending_bar, point.descending_std_error_bar, &valve.down),
                ] {
                    let least = bound.of_direction(|k| powers.get(k.wrapping_sub(from)).copied().unwrap_or(0.0));
                    seen(2, (bar - cubic(curve, i)).abs() <= 1.96 * error_bar, error_bar / least);
                }
            }
        }
        for (what, name) in ["a", "delay and lag", "curves"].into_iter().enumerate() {
            widths[what].sort_by(f64::total_cmp);
            let width = widths[what][widths[what].len() / 2];
            println!("{:<16} {name:<14} {:>4} of {:<4} width over the bound {width:.2}", format!("{kind:?}"), inside[what], all[what]);
            // One in ten may miss, and of few seeds two more; the points of one curve miss together.
            let missed = all[what] - inside[what];
            let few = if what == 2 { 18 } else { 2 };
            assert!(10 * missed <= all[what] + 10 * few, "{kind:?}: {name}");
            // Narrower than the bound is what leaves out something that is not known, as a lag that was not seen.
            assert!((0.9..=2.0 + 1.0 / seeds() as f64).contains(&width), "{kind:?}: {name} {width}");
        }
    }
}
