//! The valve model file (`schema = "hil.valve/1"`).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{FreeLoop, Hysteresis, Identification, MOST_PLAYS, Polynomial, ReferenceCurves, Valve, ValveError, WIDEST_PLAY};
use crate::document;
use crate::shipped;
use crate::units::{Current, Pressure, PressureSquared, Time};

/// The schema key of a valve file.
pub const SCHEMA: &str = "hil.valve/1";

/// One further effect: its id and its parameters, in the canonical units that its physics declares.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EffectSpec {
    /// Id of the effect, for instance `first_order_lag`.
    pub id: String,
    /// Name and text with unit of each parameter, for instance `tau` and `45 ms`.
    pub parameters: Vec<(String, String)>,
}

/// A valve file as it is written.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ValveFile {
    /// `hil.valve/1`.
    pub schema: String,
    /// Name of the valve.
    pub name: String,
    /// Where the figures come from.
    #[serde(default)]
    pub source: String,
    /// Reference curves.
    pub curve: CurveFile,
    /// Path between the curves.
    pub hysteresis: HysteresisFile,
    /// Dead time between command and pressure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay: Option<Time>,
    /// Range over which the dead time may vary.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay_range: Option<(Time, Time)>,
    /// Time constant of a first-order lag of the pressure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lag: Option<Time>,
    /// Smallest and largest current that the valve may see.
    pub current_limits: (Current, Current),
    /// Tank pressure, below which the outlet cannot fall.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor: Option<Pressure>,
    /// Standard deviation of the sensor noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<Pressure>,
    /// Further physics: one table each, `[[effect]]` with `id = { parameter = "value unit", .. }`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effect: Vec<BTreeMap<String, BTreeMap<String, String>>>,
    /// How the model was identified.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub identification: Option<Identification>,
}

/// The reference curves as they are written.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CurveFile {
    /// Coefficients of the pressure [bar] over the rising current [A], highest power first.
    pub ascending: Vec<f64>,
    /// Coefficients of the pressure [bar] over the falling current [A], highest power first.
    pub descending: Vec<f64>,
    /// Range on which the curves hold; found from slope and crossing where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<(Current, Current)>,
}

/// The hysteresis as it is written: `"none"`, `{ hyperbolic = { a = ".." } }` or `{ free = { half_widths = [..], weights = [..] } }`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HysteresisFile {
    /// No dependence on the direction.
    None,
    /// The hyperbola of Eqs. (5)-(8).
    Hyperbolic {
        /// Parameter `a`.
        a: PressureSquared,
    },
    /// A stack of plays between the reference curves.
    Free {
        /// Half-width of each play, in half-widths of the loop: 0 follows the average of the curves, 1 is the loop itself.
        half_widths: Vec<f64>,
        /// Weight of each play; scaled so that they sum to 1 and the large loop is that of the reference curves.
        weights: Vec<f64>,
    },
}

impl Valve {
    /// Finds a valve by path, or by the bare name of a file in `valves/` or of one that ships with the program.
    pub fn find(name_or_path: &str) -> Result<PathBuf, ValveError> {
        Self::find_beside(name_or_path, None)
    }

    /// The same for a name at work with a plan: `beside` is the plan's folder, where it is looked for first.
    pub fn find_beside(name_or_path: &str, beside: Option<&Path>) -> Result<PathBuf, ValveError> {
        Ok(shipped::find(shipped::Kind::Valve, name_or_path, beside)?)
    }

    /// Reads a valve file.
    ///
    /// # Errors
    /// [`ValveError`] with file, line and key.
    pub fn load(path: &Path) -> Result<Self, ValveError> {
        let text = document::read(path).map_err(|e| ValveError::Syntax(e.0))?;
        Self::from_toml(&text, &path.display().to_string())
    }

    /// Reads the text of a valve file; `source_name` stands in the messages.
    pub fn from_toml(text: &str, source_name: &str) -> Result<Self, ValveError> {
        let underlined = |key: &str, problem: &str| ValveError::Syntax(document::underline_key(text, source_name, key, problem).0);
        // A file of another kind is not refused for its first strange key.
        match text.parse::<toml::Table>().ok().as_ref().map(|table| table.get("schema")) {
            Some(Some(toml::Value::String(schema))) if schema == SCHEMA => {}
            Some(Some(other)) => return Err(underlined("schema", &format!("is {other}; a valve file has \"{SCHEMA}\""))),
            Some(None) => return Err(underlined("schema", &format!("is missing; a valve file has \"{SCHEMA}\""))),
            None => {}
        }
        let file: ValveFile = document::parse(text, source_name).map_err(|e| ValveError::Syntax(e.0))?;
        Self::from_file(file, source_name).map_err(|e| match e {
            ValveError::Value { key, problem, .. } => underlined(&key, &problem),
            other => other,
        })
    }

    fn from_file(file: ValveFile, source_name: &str) -> Result<Self, ValveError> {
        let wrong = |key: &str, problem: String| ValveError::Value { file: source_name.into(), key: key.into(), problem };
        let limits_a = (file.current_limits.0.value(), file.current_limits.1.value());
        if limits_a.0 >= limits_a.1 {
            return Err(wrong("current_limits", format!("{} A is not below {} A; the smaller one stands first", limits_a.0, limits_a.1)));
        }
        for (key, coefficients) in [("curve.ascending", &file.curve.ascending), ("curve.descending", &file.curve.descending)] {
            if coefficients.len() < 2 || coefficients.len() > 13 {
                return Err(wrong(key, format!("has {} coefficients; 2 to 13 are allowed", coefficients.len())));
            }
            if !coefficients.iter().all(|c| c.is_finite()) {
                return Err(wrong(key, "has a coefficient that is not finite".into()));
            }
        }
        let (ascending, descending) = (Polynomial::new(file.curve.ascending), Polynomial::new(file.curve.descending));
        let curves = match file.curve.range {
            Some((low, high)) if low.value() < high.value() => {
                ReferenceCurves::on_range(ascending, descending, (low.value(), high.value()))
            }
            Some((low, high)) => return Err(wrong("curve.range", format!("{low} is not below {high}; the smaller one stands first"))),
            None => ReferenceCurves::new(ascending, descending, limits_a).map_err(|e| match e {
                ValveError::Value { key, problem, .. } => wrong(&key, problem),
                other => other,
            })?,
        };
        let hysteresis = match file.hysteresis {
            HysteresisFile::None => Hysteresis::None,
            HysteresisFile::Hyperbolic { a } if a.value() >= 0.0 => Hysteresis::Hyperbolic { a_bar2: a.value() },
            HysteresisFile::Hyperbolic { a } => {
                return Err(wrong("hysteresis.hyperbolic.a", format!("{a} is negative; 0 bar^2 or more is allowed")));
            }
            HysteresisFile::Free { half_widths, weights } => {
                if half_widths.len() != weights.len() {
                    let counts =
                        format!("has {} values, hysteresis.free.weights {}; each play has one of both", half_widths.len(), weights.len());
                    return Err(wrong("hysteresis.free.half_widths", counts));
                }
                Hysteresis::Free(FreeLoop::new(half_widths.into_iter().zip(weights)).ok_or_else(|| {
                    wrong(
                        "hysteresis.free.half_widths",
                        format!("no stack of plays: 1 to {MOST_PLAYS} half-widths of 0 to {WIDEST_PLAY} and weights of 0 or more are allowed, one play of them with both above 0"),
                    )
                })?)
            }
        };
        let seconds = |key: &str, value: Option<Time>| match value.map_or(0.0, Time::value) {
            s if (0.0..=MAX_TIME_S).contains(&s) => Ok(s),
            s => Err(wrong(key, format!("{s} s is not allowed; 0 s to {MAX_TIME_S} s is"))),
        };
        let delay_s = seconds("delay", file.delay)?;
        let delay_range_s = match file.delay_range {
            None => (delay_s, delay_s),
            Some((low, high)) if 0.0 <= low.value() && low.value() <= delay_s && delay_s <= high.value() => (low.value(), high.value()),
            Some((low, high)) => {
                return Err(wrong(
                    "delay_range",
                    format!("{low} to {high} does not hold the delay of {delay_s} s; the smaller one stands first"),
                ));
            }
        };
        let noise_bar = file.noise.map_or(0.0, Pressure::value);
        if noise_bar < 0.0 {
            return Err(wrong("noise", format!("{noise_bar} bar is negative; a standard deviation of 0 bar or more is allowed")));
        }
        let effects = file.effect.into_iter().flatten().map(|(id, p)| EffectSpec { id, parameters: p.into_iter().collect() }).collect();
        Ok(Self {
            name: file.name,
            source: file.source,
            curves,
            hysteresis,
            delay_s,
            delay_range_s,
            lag_s: seconds("lag", file.lag)?,
            current_limits_a: limits_a,
            floor_bar: file.floor.map(Pressure::value),
            noise_bar,
            effects,
            identification: file.identification,
        })
    }

    /// The valve as the text of a file that reads back as the same valve.
    pub fn to_toml(&self) -> String {
        let time = |s: f64| (s != 0.0).then(|| Time::new(s));
        let file = ValveFile {
            schema: SCHEMA.into(),
            name: self.name.clone(),
            source: self.source.clone(),
            curve: CurveFile {
                ascending: self.curves.ascending.coefficients.clone(),
                descending: self.curves.descending.coefficients.clone(),
                range: Some((Current::new(self.curves.range_a.0), Current::new(self.curves.range_a.1))),
            },
            hysteresis: match self.hysteresis {
                Hysteresis::None => HysteresisFile::None,
                Hysteresis::Hyperbolic { a_bar2 } => HysteresisFile::Hyperbolic { a: PressureSquared::new(a_bar2) },
                Hysteresis::Free(stack) => {
                    let (half_widths, weights) = stack.plays().unzip();
                    HysteresisFile::Free { half_widths, weights }
                }
            },
            delay: time(self.delay_s),
            delay_range: (self.delay_range_s != (self.delay_s, self.delay_s))
                .then(|| (Time::new(self.delay_range_s.0), Time::new(self.delay_range_s.1))),
            lag: time(self.lag_s),
            current_limits: (Current::new(self.current_limits_a.0), Current::new(self.current_limits_a.1)),
            floor: self.floor_bar.map(Pressure::new),
            noise: (self.noise_bar > 0.0).then(|| Pressure::new(self.noise_bar)),
            effect: self.effects.iter().map(|e| BTreeMap::from([(e.id.clone(), e.parameters.iter().cloned().collect())])).collect(),
            identification: self.identification.clone(),
        };
        toml::to_string(&file).unwrap_or_default()
    }

    /// What a user of this model should know at load.
    pub fn warnings(&self) -> Vec<String> {
        let (low, high) = self.curves.range_a;
        let mut warnings = Vec::new();
        let slack = 5e-3 * (self.current_limits_a.1 - self.current_limits_a.0);
        if low > self.current_limits_a.0 + slack || high < self.current_limits_a.1 - slack {
            warnings.push(format!(
                "{}: the reference curves hold from {low:.3} A to {high:.3} A, not over all of {} A to {} A (slope and crossing); beyond, they continue as straight lines",
                self.name, self.current_limits_a.0, self.current_limits_a.1
            ));
        }
        warnings
    }
}

/// Longest delay or lag that a valve file may name [s], and that `identify` writes: slow processes have lags of minutes.
pub const MAX_TIME_S: f64 = 10_000.0;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PAPER: &str = r#"
schema = "hil.valve/1"
name = "paper"
current_limits = ["0 A", "1 A"]
hysteresis.hyperbolic.a = "0.8 bar^2"
delay = "20 ms"
delay_range = ["10 ms", "30 ms"]
floor = "0 bar"

[curve]
ascending = [-42.65, 92.5, -8.4, -2.03]
descending = [-40.01, 83.32, -1.3, -2.41]

[[effect]]
first_order_lag = { tau = "45 ms" }
"#;

    #[test]
    fn a_file_reads_and_its_text_reads_back_the_same() {
        let valve = Valve::from_toml(PAPER, "paper.toml").unwrap();
        assert_eq!(valve.delay_range_s, (0.01, 0.03));
        assert_eq!(valve.effects[0].parameters[0], ("tau".to_string(), "45 ms".to_string()));
        let back = Valve::from_toml(&valve.to_toml(), "back.toml").unwrap();
        assert_eq!(back, valve);
        assert!(valve.warnings()[0].contains("hold from 0.058 A"), "{:?}", valve.warnings());
    }

    #[test]
    fn what_is_wrong_is_said_with_its_key() {
        let wrong = |from: &str, to: &str| Valve::from_toml(&PAPER.replace(from, to), "paper.toml").unwrap_err().to_string();
        insta::assert_snapshot!(wrong("hil.valve/1", "hil.plan/1"), @r#"
        schema: is "hil.plan/1"; a valve file has "hil.valve/1"
         --> paper.toml:2:10
          |
        2 | schema = "hil.plan/1"
          |          ^^^^^^^^^^^^
        "#);
        insta::assert_snapshot!(wrong("\"10 ms\"", "\"25 ms\""), @r#"
        delay_range: 0.025 s to 0.03 s does not hold the delay of 0.02 s; the smaller one stands first
         --> paper.toml:7:15
          |
        7 | delay_range = ["25 ms", "30 ms"]
          |               ^^^^^^^^^^^^^^^^^^
        "#);
        insta::assert_snapshot!(wrong("0.8 bar^2", "-1 bar^2"), @r#"
        hysteresis.hyperbolic.a: -1 bar^2 is negative; 0 bar^2 or more is allowed
         --> paper.toml:5:27
          |
        5 | hysteresis.hyperbolic.a = "-1 bar^2"
          |                           ^^^^^^^^^^
        "#);
        insta::assert_snapshot!(wrong("[\"0 A\", \"1 A\"]", "[\"1 A\", \"0 A\"]"), @r#"
        current_limits: 1 A is not below 0 A; the smaller one stands first
         --> paper.toml:4:18
          |
        4 | current_limits = ["1 A", "0 A"]
          |                  ^^^^^^^^^^^^^^
        "#);
        insta::assert_snapshot!(wrong("schema = \"hil.valve/1\"", ""), @r#"paper.toml: schema: is missing; a valve file has "hil.valve/1""#);
    }

    #[test]
    fn a_free_loop_reads_and_its_text_reads_back_the_same() {
        let free = "hysteresis.free = { half_widths = [0.0, 0.5, 2.0], weights = [1.0, 2.0, 3.0] }";
        let text = PAPER.replace("hysteresis.hyperbolic.a = \"0.8 bar^2\"", free);
        let valve = Valve::from_toml(&text, "free.toml").unwrap();
        let Hysteresis::Free(stack) = valve.hysteresis else { panic!("{:?}", valve.hysteresis) };
        let (weight, width) = stack.plays().fold((0.0, 0.0), |(a, b), (r, w)| (a + w, b + r * w));
        assert!((weight - 1.0).abs() < 1e-12 && (width - 1.0).abs() < 1e-12);
        assert_eq!(Valve::from_toml(&valve.to_toml(), "back.toml").unwrap(), valve);
        let wrong = |from: &str, to: &str| Valve::from_toml(&text.replace(from, to), "free.toml").unwrap_err().to_string();
        assert!(wrong("[1.0, 2.0, 3.0]", "[1.0, 2.0]").contains("has 3 values, hysteresis.free.weights 2"));
        assert!(wrong("[1.0, 2.0, 3.0]", "[1.0, 0.0, 0.0]").contains("no stack of plays"));
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "\\PC*") {
            let _ = Valve::from_toml(&text, "x");
        }
    }
}
