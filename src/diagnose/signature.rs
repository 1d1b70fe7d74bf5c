//! The plot that shows an effect: the variable over which the mean error changes most when the effect is added.

use super::locate::{Variable, bins};

/// Bins of the conditional mean.
const BINS: usize = 24;
/// Fewest samples of a bin that is drawn.
const FEWEST: usize = 8;

/// What a conditional mean is taken over.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// The variable with its unit, as a plot prints it.
    pub label: String,
    /// Whether the error counts along the last movement of the current: behind it is negative.
    pub along_movement: bool,
}

/// The mean error over bins of one variable, before and after.
#[derive(Debug, Clone, PartialEq)]
pub struct Signature {
    /// The variable.
    pub axis: Axis,
    /// Centre of each bin.
    pub at: Vec<f64>,
    /// Mean error of the model as given [bar].
    pub base_bar: Vec<f64>,
    /// Mean error with the effects [bar].
    pub augmented_bar: Vec<f64>,
    /// Mean square of the conditional mean that the effects take away [bar^2].
    pub explained_bar2: f64,
}

/// The candidates for the axis of a signature, strongest first. `direction` is the sign of the last movement.
pub fn signatures(variables: &[Variable], direction: &[f64], base: &[f64], augmented: &[f64]) -> Vec<Signature> {
    let along = |e: &[f64]| e.iter().zip(direction).map(|(e, d)| if *d == 0.0 { f64::NAN } else { e * d }).collect::<Vec<f64>>();
    let (base_along, augmented_along) = (along(base), along(augmented));
    let mut all: Vec<Signature> = variables
        .iter()
        .flat_map(|v| {
            let plain = (!counts_from_a_turn(v.name)).then(|| one(v, false, base, augmented));
            let turned = (v.name != "time_s" && !v.name.starts_with("rate") && v.name != "pressure_rate_bar_per_s")
                .then(|| one(v, true, &base_along, &augmented_along));
            plain.into_iter().chain(turned).flatten()
        })
        .collect();
    all.sort_by(|a, b| b.explained_bar2.total_cmp(&a.explained_bar2));
    all
}

/// Variables that begin anew at a reversal: there the two directions would cancel.
fn counts_from_a_turn(name: &str) -> bool {
    name.contains("since_reversal") || name == "dwell_s"
}

fn one(variable: &Variable, along_movement: bool, base: &[f64], augmented: &[f64]) -> Option<Signature> {
    let mut found = Signature {
        axis: Axis { label: label(variable.name), along_movement },
        at: Vec::new(),
        base_bar: Vec::new(),
        augmented_bar: Vec::new(),
        explained_bar2: 0.0,
    };
    let mut samples = 0.0;
    for (_, _, members) in bins(&variable.values, base, BINS) {
        let used: Vec<usize> = members.into_iter().filter(|k| augmented[*k].is_finite()).collect();
        if used.len() < FEWEST {
            continue;
        }
        let n = used.len() as f64;
        let mean = |of: &[f64]| used.iter().map(|k| of[*k]).sum::<f64>() / n;
        let (before, after) = (mean(base), mean(augmented));
        samples += n;
        found.at.push(mean(&variable.values));
        found.base_bar.push(before);
        found.augmented_bar.push(after);
        found.explained_bar2 += n * (before * before - after * after);
    }
    // Many samples at one value (rest, dwell 0) fill several bins: one point is enough.
    let mut k = 1;
    while k < found.at.len() {
        if (found.at[k] - found.at[k - 1]).abs() < 1e-9 {
            found.base_bar[k] = 0.5 * (found.base_bar[k] + found.base_bar[k - 1]);
            found.augmented_bar[k] = 0.5 * (found.augmented_bar[k] + found.augmented_bar[k - 1]);
            found.at.remove(k - 1);
            found.base_bar.remove(k - 1);
            found.augmented_bar.remove(k - 1);
        } else {
            k += 1;
        }
    }
    found.explained_bar2 /= f64::max(samples, 1.0);
    (found.at.len() >= 4).then_some(found)
}

/// A variable as a plot prints it: `time since reversal [s]`.
pub fn label(name: &str) -> String {
    let units = [("_bar_per_s", "bar/s"), ("_a_per_s", "A/s"), ("_bar", "bar"), ("_a", "A"), ("_s", "s")];
    let (stem, unit) = units.iter().find_map(|(end, unit)| Some((name.strip_suffix(end)?, *unit))).unwrap_or((name, "1"));
    let words = match stem {
        "rate" => "rate of the current".to_string(),
        "pressure_rate" => "rate of the pressure".to_string(),
        "dwell" => "time at rest".to_string(),
        "distance_since_reversal" => "way since reversal".to_string(),
        "pressure" => "simulated pressure".to_string(),
        other => other.replace('_', " "),
    };
    format!("{words} [{unit}]")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lag_shows_over_the_rate_and_an_offset_that_turns_over_the_direction() {
        let n = 2000;
        // The strength of the movement changes, so that the pressure alone does not say its rate.
        let rate: Vec<f64> = (0..n).map(f64::from).map(|k| (0.05 * k).sin() * (1.0 + 0.9 * (0.0037 * k).sin())).collect();
        let pressure = rate
            .iter()
            .scan(0.0, |p, r| {
                *p += 0.05 * r;
                Some(*p)
            })
            .collect();
        let direction: Vec<f64> = rate.iter().map(|r| r.signum()).collect();
        let variables =
            [Variable { name: "pressure_bar", values: pressure }, Variable { name: "pressure_rate_bar_per_s", values: rate.clone() }];
        let after = vec![0.0; rate.len()];
        let lag: Vec<f64> = rate.iter().map(|r| -0.1 * r).collect();
        let found = &signatures(&variables, &direction, &lag, &after)[0];
        assert_eq!(found.axis, Axis { label: "rate of the pressure [bar/s]".into(), along_movement: false });
        assert!(found.base_bar[0] > 0.15 && found.augmented_bar.iter().all(|a| *a == 0.0));

        let friction: Vec<f64> = direction.iter().map(|d| -0.1 * d).collect();
        let found = &signatures(&variables[..1], &direction, &friction, &after)[0];
        assert!(found.axis.along_movement);
        assert!(found.base_bar.iter().all(|b| (b + 0.1).abs() < 1e-9));
        assert!((found.explained_bar2 - 0.01).abs() < 1e-9);
    }
}
