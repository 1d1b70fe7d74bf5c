//! One row a job: flat, the same bytes whoever worked it off.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// What became of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// There is an answer.
    Done,
    /// Recording or model could not be used; `error` says why.
    Unusable,
}

/// An effect in a row.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RowEffect {
    /// Its id.
    pub id: String,
    /// `lacks` or `changed`, where that is known.
    pub claim: Option<String>,
    /// Parameters: value, standard error, unit.
    pub parameters: BTreeMap<String, (f64, Option<f64>, String)>,
    /// What the recording cannot tell it from, the likeliest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub indistinguishable: Vec<String>,
}

/// One row (`schema: "hil.fleet.row/1"`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The job.
    pub id: String,
    /// `diagnose` or `identify`.
    pub task: String,
    /// Counts answers to the same id: a later one, of another recording, model or version, replaces the earlier.
    pub attempt: u32,
    /// What became of it.
    pub status: Status,
    /// Why it is unusable.
    pub error: Option<String>,
    /// The recording, as the list names it.
    pub recording: String,
    /// SHA-256 of its bytes; `None` where it cannot be read.
    pub recording_sha256: Option<String>,
    /// Where the model came from.
    pub model: String,
    /// SHA-256 of the model's text, or of the sweep that it is identified from.
    pub model_sha256: Option<String>,
    /// Version of the program.
    pub version: String,
    /// The answer in one word.
    pub verdict: Option<String>,
    /// The effects named, most important first.
    pub effects: Vec<RowEffect>,
    /// Corrections of form.
    pub form: Vec<String>,
    /// What the fit moved in the model's own parameters: the change and its unit.
    #[serde(default)]
    pub recalibration: BTreeMap<String, (f64, String)>,
    /// Errors of the models [bar], by their keys in the document.
    pub rmse_bar: BTreeMap<String, f64>,
    /// What the unexplained rest looks like: rows of one word look alike.
    pub remainder: Option<String>,
    /// Place of the full answer below the folder.
    pub document: Option<String>,
    /// The free columns of the list.
    pub tags: BTreeMap<String, String>,
}

impl Row {
    /// Takes over what a document of a diagnosis says.
    pub fn fill(&mut self, document: &Value) {
        let word = |v: &Value| v.as_str().map(str::to_owned);
        let numbers = |v: &Value| -> BTreeMap<String, f64> {
            v.as_object().into_iter().flatten().filter_map(|(k, v)| Some((k.clone(), v.as_f64()?))).collect()
        };
        self.verdict = word(&document["verdict"]);
        self.rmse_bar = match &document["rmse_bar"] {
            Value::Number(n) => n.as_f64().map(|n| ("base".to_owned(), n)).into_iter().collect(),
            object => numbers(object),
        };
        self.effects = document["effects"]
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(|e| {
                Some(RowEffect {
                    id: word(&e["id"])?,
                    claim: word(&e["claim"]),
                    parameters: parameters(&e["parameters"]),
                    indistinguishable: e["indistinguishable"].as_array().into_iter().flatten().filter_map(word).collect(),
                })
            })
            .collect();
        self.form = document["form"].as_array().into_iter().flatten().filter_map(|e| word(&e["id"])).collect();
        let change = |c: &Value| {
            let (name, unit) = (word(&c["parameter"])?, word(&c["unit"]).unwrap_or_default());
            Some((name, (c["after"].as_f64()? - c["before"].as_f64()?, unit)))
        };
        self.recalibration = document["recalibration"].as_array().into_iter().flatten().filter_map(change).collect();
        self.remainder = remainder(document);
    }

    /// What the rows of one model have in common.
    pub fn model_key(&self) -> &str {
        self.model_sha256.as_deref().unwrap_or(&self.model)
    }

    /// Whether something is missing that no effect carries.
    pub fn is_open(&self) -> bool {
        match self.verdict.as_deref() {
            Some("unexplained") => true,
            // A cause whose readings no model follows leaves nothing that is not understood.
            Some("partly_explained") => self.remainder.is_some(),
            _ => false,
        }
    }
}

impl RowEffect {
    /// Whether the diagnosis says no more than that the model lacks it.
    pub fn is_lack(&self) -> bool {
        self.claim.as_deref() == Some("lacks")
    }

    /// It, and what the recording cannot tell it from.
    pub fn ids(&self) -> impl Iterator<Item = &String> {
        std::iter::once(&self.id).chain(&self.indistinguishable)
    }
}

fn parameters(object: &Value) -> BTreeMap<String, (f64, Option<f64>, String)> {
    let one = |(name, p): (&String, &Value)| {
        let unit = p["unit"].as_str().unwrap_or_default().to_owned();
        Some((name.clone(), (p["value"].as_f64()?, p["std_error"].as_f64(), unit)))
    };
    object.as_object().into_iter().flatten().filter_map(one).collect()
}

/// The unexplained rest in a word: on what it depends most, and the octave in which it swings.
fn remainder(document: &Value) -> Option<String> {
    let rest = document["unexplained"].as_object()?;
    let on = rest.get("depends_on")?.as_array()?.first().and_then(|d| d.get(0)?.as_str()).unwrap_or("nothing known");
    let band = &document["where"]["band_hz"];
    let octave = band.get(0).and_then(Value::as_f64).zip(band.get(1).and_then(Value::as_f64)).map(|(low, high)| {
        let middle = (low.max(1e-3) * high.max(1e-3)).sqrt();
        let octave = middle.log2().floor();
        format!(", {} to {} Hz", 2_f64.powf(octave), 2_f64.powf(octave + 1.0))
    });
    Some(format!("depends on {on}{}", octave.unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_row_takes_the_answer_from_its_document() {
        let mut row = super::super::table::example("a");
        let text = r#"{"verdict":"partly_explained","rmse_bar":{"base":0.4,"noise_floor":0.05},"form":[{"id":"reference_shape"}],
            "recalibration":[{"parameter":"gain","before":1.0,"after":1.5,"unit":"1"}],
            "effects":[{"id":"creep","claim":"lacks","parameters":{"share":{"value":0.1,"std_error":null,"unit":"1"}}}],
            "unexplained":{"rms_bar":0.2,"depends_on":[["pressure",0.5]]},"where":{"band_hz":[2.0,4.0]}}"#;
        row.fill(&serde_json::from_str(text).unwrap_or_default());
        assert!(row.effects[0].is_lack() && row.is_open());
        assert_eq!(row.remainder.as_deref(), Some("depends on pressure, 2 to 4 Hz"));
        assert_eq!((row.rmse_bar["base"], row.form.len(), row.effects[0].parameters["share"].0), (0.4, 1, 0.1));
        assert_eq!(row.recalibration["gain"], (0.5, "1".to_owned()));
    }
}
