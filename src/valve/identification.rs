//! How a model was found, as it stands in a valve file: from which recordings, how sure, and what it left of them.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Input;
use crate::units::{Current, Pressure, Time};

/// How a model was found, and how sure that is.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Identification {
    /// Name of the recording, or names of several.
    pub recording: String,
    /// SHA-256 of the only recording's bytes, hex.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// RMSE of the model on the recordings [bar].
    pub rmse: Option<Pressure>,
    /// RMSE of the average model on the recordings [bar].
    pub rmse_average_model: Option<Pressure>,
    /// Error on samples that the model had not seen [bar].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heldout: Option<Pressure>,
    /// Range of current that the recordings covered [A].
    pub covered: Option<(Current, Current)>,
    /// What the command does between its samples, as stated or as the data show it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub input: Option<Input>,
    /// Share of the variance of the pressure that the model explains [%].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit_percent: Option<f64>,
    /// Whether nothing material is left beyond noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adequate: Option<bool>,
    /// What the recordings could not carry.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Parameters with their standard errors, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, ParameterEstimate>,
    /// Each recording: what it excites, and what the model leaves of it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub recordings: Vec<IdentifiedRecording>,
}

impl Identification {
    /// File name and SHA-256 of each recording that has one; of the only recording where the file lists none.
    pub fn sources(&self) -> Vec<(&str, &str)> {
        let listed: Vec<_> = self.recordings.iter().filter_map(|r| Some((r.name.as_str(), r.sha256.as_deref()?))).collect();
        if listed.is_empty() {
            self.sha256.as_deref().map(|sha256| (self.recording.as_str(), sha256)).into_iter().collect()
        } else {
            listed
        }
    }
}

/// An estimate with its standard error, both as text with the unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ParameterEstimate {
    /// The estimate.
    pub value: String,
    /// One standard deviation.
    pub std_error: String,
}

/// A recording that a model was identified from: what it excites, and the error of form that the model leaves of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct IdentifiedRecording {
    /// File name.
    pub name: String,
    /// SHA-256 of its bytes, hex.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// Samples with a reading of the pressure.
    pub samples: usize,
    /// Time step.
    pub step: Time,
    /// Range of its current.
    pub current: (Current, Current),
    /// Range of its pressure.
    pub pressure: (Pressure, Pressure),
    /// Rate of the current that a tenth of its moving samples exceed [A/s].
    pub fast_rate_a_per_s: f64,
    /// RMSE of the model on it.
    pub rmse: Pressure,
    /// What of the RMSE is not noise: the error of the model's form.
    pub form_error: Pressure,
    /// Correlation time of what the model leaves.
    pub correlation_time: Time,
    /// The RMSE by operating point: pressure, RMSE there.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub by_pressure: Vec<(Pressure, Pressure)>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_only_recording_stands_where_none_is_listed() {
        let one = Identification { recording: "sweep.csv".into(), sha256: Some("ab".into()), ..Identification::default() };
        assert_eq!(one.sources(), [("sweep.csv", "ab")]);
        assert!(Identification { sha256: None, ..one }.sources().is_empty());
    }
}
