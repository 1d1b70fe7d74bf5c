//! A foreign model with the effects that a diagnosis found about it (`schema = "hil.attached/1"`): the file names the model
//! and holds the effects; the model stays where it is.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::ExchangeError;
use crate::diagnose::{Diagnosed, Recalibration};
use crate::document;
use crate::physics::{Stage, resolve};
use crate::units::{Current, Pressure, Time};
use crate::valve::{EffectSpec, Hysteresis, Polynomial, ReferenceCurves, Valve};

/// The schema key of such a file.
pub const SCHEMA: &str = "hil.attached/1";

/// A foreign model with effects about it.
#[derive(Debug, Clone, PartialEq)]
pub struct Attached {
    /// Name.
    pub name: String,
    /// The model.
    pub base: BaseFile,
    /// How its pressure is read.
    pub recalibration: Recalibration,
    /// Smallest and largest current for which it was diagnosed [A].
    pub range_a: (f64, f64),
    /// Standard deviation of the sensor noise [bar].
    pub noise_bar: f64,
    /// The effects.
    pub effects: Vec<EffectSpec>,
}

/// What the base is: an FMU, or a pressure that was simulated once.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaseFile {
    /// The FMU, relative to the file that names it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fmu: Option<PathBuf>,
    /// Its digest: another file of that name is another model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// Its input that takes the current.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub current: Option<String>,
    /// Its output that gives the pressure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pressure: Option<String>,
    /// The column or the file of the simulated pressure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simulated: Option<String>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    schema: String,
    name: String,
    current_range: (Current, Current),
    #[serde(default)]
    noise: Option<Pressure>,
    base: BaseFile,
    recalibration: RecalibrationFile,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    effect: Vec<BTreeMap<String, BTreeMap<String, String>>>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RecalibrationFile {
    gain: f64,
    zero: Pressure,
    delay: Time,
}

/// On which side of the model an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// On its command.
    Ahead,
    /// On its pressure.
    Behind,
}

impl Side {
    /// The side of an effect.
    ///
    /// # Errors
    /// [`ExchangeError::Model`] where the effect is not known or a value is out of range.
    pub fn of(spec: &EffectSpec) -> Result<Self, ExchangeError> {
        let (effect, _) = resolve(spec).map_err(|e| ExchangeError::Model(e.to_string()))?;
        Ok(if effect.stage() < Stage::Static { Self::Ahead } else { Self::Behind })
    }
}

impl Attached {
    /// What a diagnosis found about a foreign model; nothing where its base was a valve.
    pub fn of(diagnosed: &Diagnosed, base: BaseFile) -> Option<Self> {
        let valve = &diagnosed.augmented;
        Some(Self {
            name: valve.name.clone(),
            base,
            recalibration: diagnosed.recalibration?,
            range_a: valve.curves.range_a,
            noise_bar: valve.noise_bar,
            effects: valve.effects.clone(),
        })
    }

    /// Whether a text is such a file.
    pub fn is(text: &str) -> bool {
        text.parse::<toml::Table>().is_ok_and(|t| t.get("schema").and_then(|s| s.as_str()) == Some(SCHEMA))
    }

    /// Reads a file; every effect in it is known and every value allowed.
    ///
    /// # Errors
    /// [`ExchangeError`] with file, line and key.
    pub fn load(path: &Path) -> Result<Self, ExchangeError> {
        let text = document::read(path).map_err(|e| ExchangeError::Model(e.to_string()))?;
        let name = path.display().to_string();
        let file: File = document::parse(&text, &name).map_err(|e| ExchangeError::Model(e.to_string()))?;
        let wrong = |key: &str, problem: &str| Err(ExchangeError::Model(document::underline_key(&text, &name, key, problem).0));
        if file.schema != SCHEMA {
            return wrong("schema", &format!("is {:?}; a foreign model with effects has \"{SCHEMA}\"", file.schema));
        }
        if file.base.fmu.is_some() == file.base.simulated.is_some() {
            return wrong("base", "names one of `fmu` and `simulated`");
        }
        let RecalibrationFile { gain, zero, delay } = file.recalibration;
        if !gain.is_finite() || gain <= 0.0 {
            return wrong("recalibration.gain", &format!("{gain} is not allowed; above 0 is"));
        }
        let range_a = (file.current_range.0.value(), file.current_range.1.value());
        if range_a.0 >= range_a.1 {
            return wrong("current_range", "the smaller one stands first");
        }
        let effects: Vec<EffectSpec> =
            file.effect.into_iter().flatten().map(|(id, p)| EffectSpec { id, parameters: p.into_iter().collect() }).collect();
        for spec in &effects {
            Side::of(spec).map_err(|e| ExchangeError::Model(format!("{name}: {e}")))?;
        }
        let recalibration = Recalibration { gain, zero_bar: zero.value(), delay_s: delay.value() };
        let noise_bar = file.noise.map_or(0.0, Pressure::value);
        Ok(Self { name: file.name, base: file.base, recalibration, range_a, noise_bar, effects })
    }

    /// The text of the file, which reads back as the same.
    pub fn to_toml(&self) -> String {
        let file = File {
            schema: SCHEMA.into(),
            name: self.name.clone(),
            current_range: (Current::new(self.range_a.0), Current::new(self.range_a.1)),
            noise: (self.noise_bar > 0.0).then(|| Pressure::new(self.noise_bar)),
            base: self.base.clone(),
            recalibration: RecalibrationFile {
                gain: self.recalibration.gain,
                zero: Pressure::new(self.recalibration.zero_bar),
                delay: Time::new(self.recalibration.delay_s),
            },
            effect: self.effects.iter().map(|e| BTreeMap::from([(e.id.clone(), e.parameters.iter().cloned().collect())])).collect(),
        };
        toml::to_string(&file).unwrap_or_default()
    }

    /// The effects of one side alone, as a valve whose curve changes nothing.
    ///
    /// # Errors
    /// [`ExchangeError::Model`] where there is none on this side.
    pub fn side(&self, side: Side) -> Result<Valve, ExchangeError> {
        let mut effects = Vec::new();
        for spec in &self.effects {
            if Side::of(spec)? == side {
                effects.push(spec.clone());
            }
        }
        if effects.is_empty() {
            let word = if side == Side::Ahead { "ahead of" } else { "behind" };
            return Err(ExchangeError::Model(format!("{}: holds no effect {word} the model", self.name)));
        }
        let same = || Polynomial::new(vec![1.0, 0.0]);
        Ok(Valve {
            name: self.name.clone(),
            source: "effects alone, to stand about a model".into(),
            curves: ReferenceCurves::on_range(same(), same(), self.range_a),
            hysteresis: Hysteresis::None,
            delay_s: 0.0,
            delay_range_s: (0.0, 0.0),
            lag_s: 0.0,
            current_limits_a: self.range_a,
            floor_bar: None,
            noise_bar: 0.0,
            effects,
            identification: None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attached() -> Attached {
        let spec = |id: &str, name: &str, value: &str| EffectSpec { id: id.into(), parameters: vec![(name.into(), value.into())] };
        Attached {
            name: "plant+reversal_dead_band+sensor_lag".into(),
            base: BaseFile { fmu: Some("plant.fmu".into()), sha256: Some("ab".into()), current: Some("i".into()), ..BaseFile::default() },
            recalibration: Recalibration { gain: 1.01, zero_bar: -0.25, delay_s: -0.0035 },
            range_a: (0.25, 0.75),
            noise_bar: 0.0,
            effects: vec![spec("reversal_dead_band", "width", "15 mA"), spec("sensor_lag", "tau", "30 ms")],
        }
    }

    #[test]
    fn the_text_reads_back_the_same_and_a_wrong_one_says_where() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("found.toml");
        std::fs::write(&path, attached().to_toml()).unwrap();
        assert!(Attached::is(&attached().to_toml()));
        assert_eq!(Attached::load(&path).unwrap(), attached());
        for (from, to, said) in
            [("sensor_lag", "sensor_log", "sensor_log"), ("1.01", "-1.0", "recalibration.gain"), ("fmu =", "fmv =", "fmv")]
        {
            std::fs::write(&path, attached().to_toml().replace(from, to)).unwrap();
            let error = Attached::load(&path).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }

    #[test]
    fn each_side_holds_its_own_effects() {
        let ids = |side| attached().side(side).unwrap().effects.into_iter().map(|e| e.id).collect::<Vec<_>>();
        assert_eq!((ids(Side::Ahead), ids(Side::Behind)), (vec!["reversal_dead_band".to_string()], vec!["sensor_lag".to_string()]));
        let one = Attached { effects: attached().effects[1..].to_vec(), ..attached() };
        assert!(one.side(Side::Ahead).unwrap_err().to_string().contains("no effect ahead of"));
    }
}
