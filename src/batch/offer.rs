//! What the page of a station offers: operators, products, sites. Nothing else can be asked for there.

use std::collections::BTreeSet;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Who may test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Operator {
    /// What a badge says when it is scanned.
    pub badge: String,
    /// The name in the records.
    pub name: String,
}

/// One part that is tested: plan, limits and driver that belong together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Product {
    /// Its id: letters, digits, `-`, `_`, `.`; names the folder of its batches.
    pub id: String,
    /// Its name on the page; the id by default.
    #[serde(default)]
    pub title: Option<String>,
    /// Plan: the bare name of one, or a path relative to the station file.
    pub plan: String,
    /// Limits file of the part, relative to the station file.
    #[serde(default)]
    pub limits: Option<PathBuf>,
    /// Part number of its valves.
    #[serde(default)]
    pub part_number: Option<String>,
    /// Revision of the part.
    #[serde(default)]
    pub revision: Option<String>,
    /// Valve model that the controller believes in, and that is simulated; the plan's by default.
    #[serde(default)]
    pub valve: Option<String>,
    /// Driver profile of every site: a bare name, or a path relative to the station file.
    #[serde(default)]
    pub driver: Option<String>,
    /// Tested on simulated valves: to learn the page, or to try a plan. Its records never count as those of real valves.
    #[serde(default)]
    pub simulated: bool,
    /// Spread of the valves that are simulated or emulated: a population file.
    #[serde(default)]
    pub population: Option<String>,
}

/// A place where a valve is mounted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Site {
    /// Its name on the page.
    pub name: String,
    /// Serial port of its driver.
    #[serde(default)]
    pub port: Option<PathBuf>,
    /// HOST:PORT of its driver.
    #[serde(default)]
    pub tcp: Option<String>,
    /// Valve model behind an emulated driver: a site without hardware.
    #[serde(default)]
    pub emulate: Option<String>,
}

/// What a station file offers.
#[derive(Debug, Clone, Copy)]
pub struct Offer<'a> {
    /// Who may test.
    pub operators: &'a [Operator],
    /// What may be tested.
    pub products: &'a [Product],
    /// Where.
    pub sites: &'a [Site],
    /// With which models a recording may be diagnosed.
    pub models: &'a [String],
}

/// Key and problem.
type Wrong = (String, String);

impl Offer<'_> {
    /// Whether everything that is offered can be told apart and says where it is.
    pub(super) fn check(&self) -> Result<(), Wrong> {
        distinct("product", "id", self.products.iter().map(|p| p.id.as_str()))?;
        distinct("site", "name", self.sites.iter().map(|s| s.name.as_str()))?;
        distinct("operator_badge", "badge", self.operators.iter().map(|o| o.badge.as_str()))?;
        distinct("models", "", self.models.iter().map(String::as_str))?;
        for (k, product) in self.products.iter().enumerate() {
            let wrong = |key: &str, problem: &str| Err((format!("product[{k}].{key}"), problem.to_string()));
            if !product.id.chars().all(|c| c.is_ascii_alphanumeric() || "-_.".contains(c)) || product.id.starts_with('.') {
                return wrong("id", "letters, digits, - _ . are allowed, and no dot first: it names a folder");
            }
            match (product.simulated, &product.driver) {
                (true, Some(_)) => return wrong("driver", "a simulated product has no driver"),
                (false, None) => return wrong("driver", "say on what it is tested: a driver, or simulated = true"),
                _ => {}
            }
        }
        for (k, site) in self.sites.iter().enumerate() {
            let places = [site.port.is_some(), site.tcp.is_some(), site.emulate.is_some()].into_iter().filter(|p| *p).count();
            let simulated_only = self.products.iter().all(|p| p.simulated);
            if places > 1 || (places == 0 && !simulated_only) {
                return Err((format!("site[{k}]"), "one of `port`, `tcp` and `emulate` is wanted".into()));
            }
        }
        for (k, operator) in self.operators.iter().enumerate() {
            if operator.name.trim().is_empty() {
                return Err((format!("operator_badge[{k}].name"), "is blank".into()));
            }
        }
        Ok(())
    }

    /// The name behind a badge or a name that was typed; with no list, the name itself.
    ///
    /// # Errors
    /// What is wrong with it, in words.
    pub fn operator(&self, typed: &str) -> Result<String, String> {
        let typed = typed.trim();
        if typed.is_empty() {
            return Err("the operator is blank".into());
        }
        if typed.chars().count() > 64 || typed.chars().any(char::is_control) {
            return Err("the operator is longer than 64 characters, or holds what cannot be printed".into());
        }
        if self.operators.is_empty() {
            return Ok(typed.into());
        }
        let known = self.operators.iter().find(|o| o.badge == typed || o.name == typed);
        known.map(|o| o.name.clone()).ok_or_else(|| format!("operator `{typed}` is not one of this station"))
    }
}

fn distinct<'a>(what: &str, key: &str, names: impl Iterator<Item = &'a str>) -> Result<(), Wrong> {
    let mut seen = BTreeSet::new();
    for (k, name) in names.enumerate() {
        let place = if key.is_empty() { format!("{what}[{k}]") } else { format!("{what}[{k}].{key}") };
        if name.trim().is_empty() {
            return Err((place, "is blank".into()));
        }
        if !seen.insert(name) {
            return Err((place, format!("`{name}` stands twice")));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::station::Station;

    const FLOOR: &str = r#"
schema = "hil.station/1"
id = "floor"
store = "records"
models = ["paper"]
[[operator_badge]]
badge = "4711"
name = "first operator"
[[product]]
id = "clutch"
plan = "tipin"
driver = "emulator-tcp"
[[site]]
name = "left"
emulate = "paper"
"#;

    fn station(from: &str, to: &str) -> Result<Station, String> {
        Station::from_toml(&FLOOR.replace(from, to), "floor.toml").map_err(|e| e.to_string())
    }

    #[test]
    fn what_is_offered_is_read_and_stays_out_of_the_records() {
        let station = station("", "").unwrap();
        assert_eq!((station.products[0].plan.as_str(), station.sites[0].name.as_str()), ("tipin", "left"));
        let block = station.provenance(Some("first operator"), &[]).to_string();
        assert!(!block.contains("4711") && !block.contains("clutch"), "{block}");
    }

    #[test]
    fn what_cannot_be_offered_names_its_place() {
        insta::assert_snapshot!(station("id = \"clutch\"", "id = \"../up\"").unwrap_err(), @"floor.toml: product[0].id: letters, digits, - _ . are allowed, and no dot first: it names a folder");
        insta::assert_snapshot!(station("driver = \"emulator-tcp\"", "").unwrap_err(), @"floor.toml: product[0].driver: say on what it is tested: a driver, or simulated = true");
        insta::assert_snapshot!(station("emulate = \"paper\"", "").unwrap_err(), @"floor.toml: site[0]: one of `port`, `tcp` and `emulate` is wanted");
        insta::assert_snapshot!(station("[[site]]", "[[site]]\nname = \"left\"\ntcp = \"h:1\"\n[[site]]").unwrap_err(), @"floor.toml: site[1].name: `left` stands twice");
    }

    #[test]
    fn an_operator_is_known_by_badge_or_name() {
        let station = station("", "").unwrap();
        assert_eq!(station.offer().operator(" 4711 ").unwrap(), "first operator");
        assert_eq!(station.offer().operator("first operator").unwrap(), "first operator");
        assert!(station.offer().operator("4712").unwrap_err().contains("not one of this station"));
        assert!(station.offer().operator(" ").is_err());
    }
}
