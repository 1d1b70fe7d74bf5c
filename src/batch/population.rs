//! A simulated population of valves (`schema = "hil.population/1"`): one valve model with a declared spread.
//!
//! Each valve is drawn from the batch's seed and its place alone, so that neither the number of threads nor a resume changes it.

use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::BatchError;
use crate::document;
use crate::units::{PRESSURE, Pressure, Ratio, TIME, Time};
use crate::valve::{Hysteresis, Polynomial, ReferenceCurves, Valve};

/// The schema key of a population file.
pub const SCHEMA: &str = "hil.population/1";

/// A population.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Population {
    /// `hil.population/1`.
    pub schema: String,
    /// Standard deviations of all valves.
    pub spread: Spread,
    /// Groups with a fault of their own.
    #[serde(default, rename = "group", skip_serializing_if = "Vec::is_empty")]
    pub groups: Vec<Group>,
}

/// One standard deviation each; normal, cut at three.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Spread {
    /// Of the pressure at a current, as a share.
    #[serde(default = "ratio_zero")]
    pub gain: Ratio,
    /// Of the pressure at every current.
    #[serde(default = "pressure_zero")]
    pub offset: Pressure,
    /// Of the hyperbola's parameter, as a share.
    #[serde(default = "ratio_zero")]
    pub a: Ratio,
    /// Of the dead time.
    #[serde(default = "time_zero")]
    pub delay: Time,
    /// Of the sensor noise, as a share.
    #[serde(default = "ratio_zero")]
    pub noise: Ratio,
}

/// A share of the valves whose values are shifted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Group {
    /// Name, for the reader of the file.
    pub name: String,
    /// Share of the population.
    pub share: Ratio,
    /// Shift of the pressure at a current, as a share.
    #[serde(default = "ratio_zero")]
    pub gain: Ratio,
    /// Shift of the pressure at every current.
    #[serde(default = "pressure_zero")]
    pub offset: Pressure,
    /// Shift of the hyperbola's parameter, as a share.
    #[serde(default = "ratio_zero")]
    pub a: Ratio,
    /// Shift of the dead time.
    #[serde(default = "time_zero")]
    pub delay: Time,
    /// Shift of the sensor noise, as a share.
    #[serde(default = "ratio_zero")]
    pub noise: Ratio,
}

fn ratio_zero() -> Ratio {
    Ratio::new(0.0)
}
fn pressure_zero() -> Pressure {
    Pressure::new(0.0)
}
fn time_zero() -> Time {
    Time::new(0.0)
}

impl Population {
    /// The population that is used where no file is given.
    pub fn standard() -> Self {
        let spread = Spread {
            gain: Ratio::new(0.005),
            offset: Pressure::new(0.02),
            a: Ratio::new(0.1),
            delay: Time::new(0.001),
            noise: Ratio::new(0.1),
        };
        Self { schema: SCHEMA.into(), spread, groups: Vec::new() }
    }

    /// Reads a population file.
    pub fn load(path: &Path) -> Result<Self, BatchError> {
        let text = document::read(path).map_err(|e| BatchError::Input(e.0))?;
        Self::from_toml(&text, &path.display().to_string())
    }

    /// Reads the text of a population file; `source_name` stands in the messages.
    pub fn from_toml(text: &str, source_name: &str) -> Result<Self, BatchError> {
        document::expect_schema(text, source_name, SCHEMA, "a population file").map_err(|e| BatchError::Input(e.0))?;
        let population: Self = document::parse(text, source_name).map_err(|e| BatchError::Input(e.0))?;
        let wrong = |key: &str, problem: String| Err(BatchError::Input(format!("{source_name}: {key}: {problem}")));
        let s = &population.spread;
        let deviations = [
            ("gain", s.gain.value()),
            ("offset", s.offset.value()),
            ("a", s.a.value()),
            ("delay", s.delay.value()),
            ("noise", s.noise.value()),
        ];
        if let Some((key, value)) = deviations.iter().find(|d| d.1 < 0.0) {
            return wrong(&format!("spread.{key}"), format!("{value} is negative; it is a standard deviation"));
        }
        if let Some((key, value)) = [deviations[0], deviations[2], deviations[4]].iter().find(|d| d.1 > 0.33) {
            return wrong(&format!("spread.{key}"), format!("{value} is more than 0.33: three deviations would turn the sign"));
        }
        let shares: f64 = population.groups.iter().map(|g| g.share.value()).sum();
        if population.groups.iter().any(|g| g.share.value() < 0.0) || shares > 1.0 {
            return wrong("group.share", format!("the shares must not be negative, and their sum ({shares}) not above 1"));
        }
        Ok(population)
    }

    /// The valve at `position` of the population around `nominal`, and what was drawn, for the record.
    pub fn draw(&self, nominal: &Valve, seed: u64, position: usize) -> (Valve, Vec<(String, String)>) {
        let mut rng = Pcg64::seed_from_u64(valve_seed(seed, position));
        let mut normal = || loop {
            let z: f64 = StandardNormal.sample(&mut rng);
            if z.abs() <= 3.0 {
                return z;
            }
        };
        let z = [normal(), normal(), normal(), normal(), normal()];
        let mut lot: f64 = rng.random();
        let group = self.groups.iter().find(|g| {
            lot -= g.share.value();
            lot < 0.0
        });
        let shift = |of: fn(&Group) -> f64| group.map_or(0.0, of);
        let s = &self.spread;
        let gain = 1.0 + s.gain.value() * z[0] + shift(|g| g.gain.value());
        let offset = s.offset.value() * z[1] + shift(|g| g.offset.value());
        let a = (1.0 + s.a.value() * z[2] + shift(|g| g.a.value())).max(0.0);
        let delay = s.delay.value() * z[3] + shift(|g| g.delay.value());
        let noise = (1.0 + s.noise.value() * z[4] + shift(|g| g.noise.value())).max(0.0);
        let mut drawn = vec![
            ("drawn gain".to_string(), format!("{gain:.5}")),
            ("drawn offset".to_string(), PRESSURE.print(offset)),
            ("drawn factor of a".to_string(), format!("{a:.5}")),
            ("drawn change of the delay".to_string(), TIME.print(delay)),
            ("drawn factor of the noise".to_string(), format!("{noise:.5}")),
        ];
        drawn.extend(group.map(|g| ("group".to_string(), g.name.clone())));
        (varied(nominal, gain, offset, a, delay, noise), drawn)
    }
}

fn varied(nominal: &Valve, gain: f64, offset_bar: f64, a: f64, delay_s: f64, noise: f64) -> Valve {
    let curve = |polynomial: &Polynomial| {
        let mut coefficients: Vec<f64> = polynomial.coefficients.iter().map(|c| c * gain).collect();
        if let Some(constant) = coefficients.last_mut() {
            *constant += offset_bar;
        }
        Polynomial::new(coefficients)
    };
    let mut valve = nominal.clone();
    valve.curves = ReferenceCurves::on_range(curve(&nominal.curves.ascending), curve(&nominal.curves.descending), nominal.curves.range_a);
    if let Hysteresis::Hyperbolic { a_bar2 } = &mut valve.hysteresis {
        *a_bar2 *= a;
    }
    valve.delay_s = (nominal.delay_s + delay_s).max(0.0);
    valve.noise_bar = nominal.noise_bar * noise;
    valve
}

/// The seed of the valve at `position`: SplitMix64 (G. L. Steele, D. Lea, C. H. Flood, OOPSLA 2014), so that neighbours have nothing in common.
pub fn valve_seed(seed: u64, position: usize) -> u64 {
    let mut z = seed.wrapping_add((position as u64).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    // JSON numbers above 2^53 lose digits in many readers.
    (z ^ (z >> 31)) >> 11
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nominal() -> Valve {
        let text = "schema = \"hil.valve/1\"\nname = \"n\"\ncurrent_limits = [\"0 A\", \"1 A\"]\nhysteresis.hyperbolic.a = \"0.8 bar^2\"\ndelay = \"20 ms\"\nnoise = \"0.02 bar\"\n[curve]\nascending = [-42.65, 92.5, -8.4, -2.03]\ndescending = [-40.01, 83.32, -1.3, -2.41]\n";
        Valve::from_toml(text, "n.toml").unwrap()
    }

    #[test]
    fn the_spread_is_the_declared_one() {
        let p = Population::from_toml(
            "schema = \"hil.population/1\"\n[spread]\ngain = \"2 %\"\noffset = \"100 mbar\"\ndelay = \"1 ms\"\n",
            "p.toml",
        )
        .unwrap();
        let n = nominal();
        let valves: Vec<Valve> = (0..4000).map(|i| p.draw(&n, 7, i).0).collect();
        let deviation = |of: &dyn Fn(&Valve) -> f64| {
            let values: Vec<f64> = valves.iter().map(of).collect();
            let mean = values.iter().sum::<f64>() / 4000.0;
            (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 3999.0).sqrt())
        };
        // A normal distribution cut at three has 0.9866 of the deviation.
        let (mean, gain) = deviation(&|v| v.curves.ascending.coefficients[0] / n.curves.ascending.coefficients[0]);
        assert!((mean - 1.0).abs() < 0.0015 && (gain - 0.02 * 0.9866).abs() < 0.0008, "{mean} {gain}");
        let (mean, delay) = deviation(&|v| v.delay_s);
        assert!((mean - 0.02).abs() < 1e-4 && (delay - 0.001 * 0.9866).abs() < 5e-5, "{mean} {delay}");
        assert!(valves.iter().all(|v| v.noise_bar == 0.02), "a spread that is not declared is none");
    }

    #[test]
    fn a_valve_depends_on_seed_and_place_alone() {
        let (p, n) = (Population::standard(), nominal());
        assert_eq!(p.draw(&n, 1, 5), p.draw(&n, 1, 5));
        assert_ne!(p.draw(&n, 1, 5), p.draw(&n, 1, 6));
        assert_ne!(p.draw(&n, 1, 5), p.draw(&n, 2, 5));
    }

    #[test]
    fn a_group_takes_its_share() {
        let text = "schema = \"hil.population/1\"\n[spread]\n[[group]]\nname = \"weak\"\nshare = \"5 %\"\ngain = \"-10 %\"\n";
        let (p, n) = (Population::from_toml(text, "p.toml").unwrap(), nominal());
        let weak = (0..4000).filter(|&i| p.draw(&n, 3, i).0.curves.ascending.coefficients[0].abs() < 40.0).count();
        assert!((160..=240).contains(&weak), "{weak}");
    }

    #[test]
    fn a_senseless_population_is_refused() {
        let message = |spread: &str| {
            let text = format!("schema = \"hil.population/1\"\n[spread]\n{spread}\n");
            Population::from_toml(&text, "p.toml").unwrap_err().to_string()
        };
        insta::assert_snapshot!(message("gain = \"-2 %\""), @"p.toml: spread.gain: -0.02 is negative; it is a standard deviation");
        insta::assert_snapshot!(message("a = \"50 %\""), @"p.toml: spread.a: 0.5 is more than 0.33: three deviations would turn the sign");
        assert!(message("offset = \"2 %\"").contains("pressure"));
    }
}
