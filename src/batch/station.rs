//! The station file (`schema = "hil.station/1"`): where, with which instruments and by whom is tested.
//!
//! A test on an instrument whose calibration has run out proves nothing: it is refused, or the override with its
//! reason goes into every record.

use std::path::{Path, PathBuf};

use jiff::civil::Date;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::BatchError;
use super::offer::{Offer, Operator, Product, Site};
use crate::document;
use crate::units::{Current, Pressure, Temperature, Time};

/// The schema key of a station file.
pub const SCHEMA: &str = "hil.station/1";

/// A test station.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Station {
    /// `hil.station/1`.
    pub schema: String,
    /// Id of the station.
    pub id: String,
    /// Site and place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub location: Option<String>,
    /// Who tests, where the command line does not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
    /// Largest current that this station may send, whatever plan and profile allow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_current: Option<Current>,
    /// Pressure at which a run ends in the safe state, whatever plan and profile allow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_pressure: Option<Pressure>,
    /// The oil.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub oil: Option<Oil>,
    /// The hydraulic supply.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub supply: Option<Supply>,
    /// The instruments that the figures rest on.
    #[serde(default, rename = "instrument")]
    pub instruments: Vec<Instrument>,
    /// The master valves that open the gate of production.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub master: Option<MasterGate>,
    /// Folder that holds the records of `hil station`, a batch for every product and day; relative to this file.
    #[serde(default, skip_serializing)]
    pub store: Option<PathBuf>,
    /// Who may test at `hil station`; anybody who gives a name, where none is listed.
    #[serde(default, rename = "operator_badge", skip_serializing)]
    pub operators: Vec<Operator>,
    /// What may be tested at `hil station`.
    #[serde(default, rename = "product", skip_serializing)]
    pub products: Vec<Product>,
    /// The places of `hil station` where a valve is mounted.
    #[serde(default, rename = "site", skip_serializing)]
    pub sites: Vec<Site>,
    /// Valve models that the page of `hil station` may diagnose a recording with: bare names, or paths relative to this file.
    #[serde(default, skip_serializing)]
    pub models: Vec<String>,
}

/// The oil of a station.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Oil {
    /// Name and grade.
    pub name: String,
    /// Temperature at which is tested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature: Option<Temperature>,
}

/// The hydraulic supply of a station.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Supply {
    /// Pressure at which is tested.
    pub pressure: Pressure,
    /// Whether several sites hang on it, so that they take turns.
    #[serde(default)]
    pub shared: bool,
}

/// One instrument.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Instrument {
    /// What it measures or sets: `pressure`, `current`, ...
    pub quantity: String,
    /// Maker and model.
    pub model: String,
    /// Serial number.
    pub serial: String,
    /// Number of the calibration certificate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certificate: Option<String>,
    /// Date of the calibration, `2026-03-01`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub calibrated: Option<Date>,
    /// Last day on which the calibration holds.
    #[schemars(with = "String")]
    pub due: Date,
}

/// The gate that master valves open.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MasterGate {
    /// How old the last check may be.
    pub max_age: Time,
    /// The masters; each must have given its expected verdict.
    #[serde(rename = "valve")]
    pub valves: Vec<MasterValve>,
}

/// A valve whose verdict is known.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MasterValve {
    /// Serial number.
    pub serial: String,
    /// The verdict that a sound station gives it.
    pub expect: Expectation,
}

/// The verdict that a master valve must get.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Expectation {
    /// PASS or MARGINAL.
    Pass,
    /// FAIL.
    Fail,
}

impl Station {
    /// Reads a station file.
    pub fn load(path: &Path) -> Result<Self, BatchError> {
        let text = document::read(path).map_err(|e| BatchError::Input(e.0))?;
        Self::from_toml(&text, &path.display().to_string())
    }

    /// Reads the text of a station file; `source_name` stands in the messages.
    pub fn from_toml(text: &str, source_name: &str) -> Result<Self, BatchError> {
        document::expect_schema(text, source_name, SCHEMA, "a station file").map_err(|e| BatchError::Input(e.0))?;
        let station: Self = document::parse(text, source_name).map_err(|e| BatchError::Input(e.0))?;
        let wrong = |key: &str, problem: String| Err(BatchError::Input(format!("{source_name}: {key}: {problem}")));
        if station.id.trim().is_empty() {
            return wrong("id", "is blank".into());
        }
        for (key, value) in
            [("max_current", station.max_current.map(Current::value)), ("max_pressure", station.max_pressure.map(Pressure::value))]
        {
            if value.is_some_and(|v| v <= 0.0) {
                return wrong(key, "is not positive, so nothing could be tested".into());
            }
        }
        for (k, i) in station.instruments.iter().enumerate() {
            if i.calibrated.is_some_and(|c| c > i.due) {
                return wrong(&format!("instrument[{k}].due"), format!("{} lies before the calibration", i.due));
            }
        }
        if let Some(gate) = &station.master {
            if gate.valves.is_empty() {
                return wrong("master.valve", "names no master valve".into());
            }
            if gate.max_age.value() <= 0.0 {
                return wrong("master.max_age", format!("{} is not positive", gate.max_age));
            }
        }
        station.offer().check().map_err(|(key, problem)| BatchError::Input(format!("{source_name}: {key}: {problem}")))?;
        Ok(station)
    }

    /// What the page of the station offers.
    pub fn offer(&self) -> Offer<'_> {
        Offer { operators: &self.operators, products: &self.products, sites: &self.sites, models: &self.models }
    }

    /// The instruments whose calibration has run out on `today`, as text for a message.
    pub fn expired(&self, today: Date) -> Vec<String> {
        let expired = self.instruments.iter().filter(|i| i.due < today);
        expired.map(|i| format!("{} {} (serial {}): calibration due {}", i.quantity, i.model, i.serial, i.due)).collect()
    }

    /// The block of a record: the station as its file has it, with operator, and overrides where there are any.
    pub fn provenance(&self, operator: Option<&str>, overrides: &[String]) -> serde_json::Value {
        let mut value = serde_json::to_value(self).unwrap_or_default();
        if let Some(object) = value.as_object_mut() {
            if let Some(operator) = operator {
                object.insert("operator".into(), operator.into());
            }
            if !overrides.is_empty() {
                object.insert("overrides".into(), overrides.into());
            }
        }
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BENCH: &str = r#"
schema = "hil.station/1"
id = "example bench"
operator = "name of the operator"
oil = { name = "name and grade of the oil", temperature = "40 degC" }
supply = { pressure = "40 bar", shared = true }

[[instrument]]
quantity = "pressure"
model = "maker and model"
serial = "serial number"
calibrated = "2026-01-15"
due = "2027-01-14"

[master]
max_age = "8 h"
[[master.valve]]
serial = "MASTER-GOOD"
expect = "pass"
"#;

    #[test]
    fn calibration_holds_up_to_its_last_day() {
        let station = Station::from_toml(BENCH, "bench.toml").unwrap();
        assert!(station.expired("2027-01-14".parse().unwrap()).is_empty());
        insta::assert_snapshot!(station.expired("2027-01-15".parse().unwrap())[0], @"pressure maker and model (serial serial number): calibration due 2027-01-14");
    }

    #[test]
    fn overrides_and_operator_go_into_the_record() {
        let station = Station::from_toml(BENCH, "bench.toml").unwrap();
        let value = station.provenance(Some("another"), &["calibration: on the way".into()]);
        assert_eq!((value["operator"].as_str(), value["overrides"][0].as_str()), (Some("another"), Some("calibration: on the way")));
        assert_eq!(value["oil"]["temperature"], "40 degC");
    }

    #[test]
    fn a_wrong_station_names_the_place() {
        let message = |from: &str, to: &str| Station::from_toml(&BENCH.replace(from, to), "bench.toml").unwrap_err().to_string();
        insta::assert_snapshot!(message("due = \"2027-01-14\"", "due = \"2025-01-14\""), @"bench.toml: instrument[0].due: 2025-01-14 lies before the calibration");
        insta::assert_snapshot!(message("hil.station/1", "hil.station/2"), @r#"
        schema: is "hil.station/2"; a station file has "hil.station/1"
         --> bench.toml:2:10
          |
        2 | schema = "hil.station/2"
          |          ^^^^^^^^^^^^^^^
        "#);
        assert!(message("2027-01-14", "14.1.27").contains("bench.toml:13:"));
    }
}
