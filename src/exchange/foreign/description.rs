//! `modelDescription.xml` of a foreign FMU: as much of it as running it takes.

use std::collections::BTreeMap;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use serde::{Deserialize, Serialize};

/// A real variable of the model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Port {
    /// Name.
    pub name: String,
    /// Value reference.
    pub reference: u32,
    /// Factor and offset from the model's unit to ours (A, bar): ours = factor * theirs + offset.
    pub to_ours: (f64, f64),
    /// The unit as the model names it; empty where it does not.
    pub unit: String,
}

/// Where the current goes in and the pressure comes out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ports {
    /// The command.
    pub current: Port,
    /// The pressure.
    pub pressure: Port,
}

/// What is known of a foreign model before it runs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Description {
    /// 2 or 3.
    pub version: u8,
    /// Name of the model.
    pub name: String,
    /// Name of its library, without ending.
    pub identifier: String,
    /// `guid` or `instantiationToken`.
    pub token: String,
    /// The step that the model names [s].
    pub step_s: Option<f64>,
    inputs: Vec<Variable>,
    outputs: Vec<Variable>,
    units: BTreeMap<String, Unit>,
}

#[derive(Debug, Clone, PartialEq, Default)]
struct Variable {
    name: String,
    reference: u32,
    unit: String,
    declared_type: String,
}

/// SI = factor * value + offset, with the exponents of the base units.
#[derive(Debug, Clone, PartialEq)]
struct Unit {
    factor: f64,
    offset: f64,
    exponents: BTreeMap<String, i32>,
}

/// A quantity that a port carries: base units, how much of ours one of SI is.
struct Wanted {
    what: &'static str,
    exponents: &'static [(&'static str, i32)],
    ours_per_si: f64,
    names: &'static [&'static str],
}

const CURRENT: Wanted = Wanted { what: "current", exponents: &[("A", 1)], ours_per_si: 1.0, names: &["current", "i", "current_a", "u"] };
const PRESSURE: Wanted = Wanted {
    what: "pressure",
    exponents: &[("kg", 1), ("m", -1), ("s", -2)],
    ours_per_si: 1e-5,
    names: &["pressure", "p", "pressure_bar", "y"],
};
/// Units that models name without defining them, in those of the SI.
const KNOWN: [(&str, &str, f64); 7] = [
    ("A", "current", 1.0),
    ("mA", "current", 1e-3),
    ("bar", "pressure", 1e5),
    ("mbar", "pressure", 1e2),
    ("Pa", "pressure", 1.0),
    ("kPa", "pressure", 1e3),
    ("MPa", "pressure", 1e6),
];

impl Description {
    /// Reads the text of the file.
    ///
    /// # Errors
    /// What is wrong with it, in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut reader = Reader::from_str(text);
        let mut all = Self::default();
        let mut open: Vec<String> = Vec::new();
        let (mut unit, mut variable): (Option<String>, Option<(Variable, String)>) = (None, None);
        let mut types: BTreeMap<String, String> = BTreeMap::new();
        let mut type_name = String::new();
        loop {
            let event = reader.read_event().map_err(|e| format!("modelDescription.xml: {e}"))?;
            let (element, empty) = match &event {
                Event::Start(element) => (element, false),
                Event::Empty(element) => (element, true),
                Event::End(_) => {
                    if open.pop().as_deref() == Some("ScalarVariable") {
                        all.keep(variable.take());
                    }
                    continue;
                }
                Event::Eof => break,
                _ => continue,
            };
            let name = String::from_utf8_lossy(element.local_name().as_ref()).into_owned();
            let attribute = |key: &str| value(element, key);
            let parent = open.last().map(String::as_str).unwrap_or_default();
            match (name.as_str(), parent) {
                ("fmiModelDescription", _) => {
                    let version = attribute("fmiVersion").unwrap_or_default();
                    all.version = match version.split('.').next() {
                        Some("2") => 2,
                        Some("3") => 3,
                        _ => return Err(format!("FMI {version}: 2.0 and 3.0 are read")),
                    };
                    all.name = attribute("modelName").unwrap_or_default();
                    all.token = attribute("guid").or(attribute("instantiationToken")).unwrap_or_default();
                }
                ("CoSimulation", _) => {
                    all.identifier = attribute("modelIdentifier").unwrap_or_default();
                    all.step_s = step(attribute("fixedInternalStepSize")).or(all.step_s);
                }
                ("DefaultExperiment", _) => all.step_s = all.step_s.or(step(attribute("stepSize"))),
                ("Unit", _) => unit = attribute("name"),
                ("BaseUnit", _) => {
                    if let Some(name) = &unit {
                        all.units.insert(name.clone(), base_unit(element));
                    }
                }
                ("SimpleType", _) => type_name = attribute("name").unwrap_or_default(),
                ("Real", "SimpleType") | ("Float64Type", _) => {
                    let name = if name == "Float64Type" { attribute("name").unwrap_or_default() } else { type_name.clone() };
                    types.insert(name, attribute("unit").unwrap_or_default());
                }
                ("ScalarVariable", _) => variable = Some((of(element), attribute("causality").unwrap_or_default())),
                ("Real", "ScalarVariable") => {
                    if let Some((variable, _)) = &mut variable {
                        variable.unit = attribute("unit").unwrap_or_default();
                        variable.declared_type = attribute("declaredType").unwrap_or_default();
                    }
                }
                (_, "ScalarVariable") => {
                    // Of another type: not one that a signal goes through.
                    if matches!(name.as_str(), "Integer" | "Boolean" | "String" | "Enumeration") {
                        variable = None;
                    }
                }
                ("Float64", "ModelVariables") => all.keep(Some((of(element), attribute("causality").unwrap_or_default()))),
                _ => {}
            }
            if !empty {
                open.push(name);
            }
        }
        for variable in all.inputs.iter_mut().chain(&mut all.outputs) {
            if variable.unit.is_empty()
                && let Some(unit) = types.get(&variable.declared_type)
            {
                variable.unit.clone_from(unit);
            }
        }
        if all.version == 0 {
            return Err("modelDescription.xml: no fmiModelDescription".into());
        }
        if all.identifier.is_empty() {
            return Err("it is no FMU for co-simulation; one is wanted".into());
        }
        Ok(all)
    }

    fn keep(&mut self, variable: Option<(Variable, String)>) {
        match variable {
            Some((variable, causality)) if causality == "input" => self.inputs.push(variable),
            Some((variable, causality)) if causality == "output" => self.outputs.push(variable),
            _ => {}
        }
    }

    /// The ports: those named, or the only ones of their kind.
    ///
    /// # Errors
    /// Which there are, where the choice is not clear, or a unit that is neither current nor pressure.
    pub fn ports(&self, current: Option<&str>, pressure: Option<&str>) -> Result<Ports, String> {
        Ok(Ports { current: self.port(&self.inputs, current, &CURRENT)?, pressure: self.port(&self.outputs, pressure, &PRESSURE)? })
    }

    fn port(&self, among: &[Variable], named: Option<&str>, wanted: &Wanted) -> Result<Port, String> {
        let listed = || {
            let all = among.iter().map(|v| if v.unit.is_empty() { v.name.clone() } else { format!("{} [{}]", v.name, v.unit) });
            let all = all.collect::<Vec<_>>().join(", ");
            if all.is_empty() { "none".into() } else { all }
        };
        let chosen = match named {
            Some(name) => {
                among.iter().find(|v| v.name == name).ok_or_else(|| format!("no {} `{name}`; there are: {}", wanted.what, listed()))?
            }
            None => {
                let fits: Vec<&Variable> = among.iter().filter(|v| matches!(self.conversion(v, wanted), Some(Some(_)))).collect();
                let by_name = || among.iter().find(|v| wanted.names.contains(&v.name.to_ascii_lowercase().as_str()));
                match (among, fits.as_slice()) {
                    ([one], _) => one,
                    (_, [one]) => *one,
                    _ => by_name().ok_or_else(|| format!("which is the {}? Name one of: {}", wanted.what, listed()))?,
                }
            }
        };
        let to_ours = match self.conversion(chosen, wanted) {
            Some(Some(conversion)) => conversion,
            // No unit: taken as ours.
            Some(None) => (1.0, 0.0),
            None => return Err(format!("{} [{}] is no {}", chosen.name, chosen.unit, wanted.what)),
        };
        Ok(Port { name: chosen.name.clone(), reference: chosen.reference, to_ours, unit: chosen.unit.clone() })
    }

    /// Factor and offset to our unit: nothing where the unit is of another kind, nothing inside where there is none.
    fn conversion(&self, variable: &Variable, wanted: &Wanted) -> Option<Option<(f64, f64)>> {
        if variable.unit.is_empty() {
            return Some(None);
        }
        if let Some(unit) = self.units.get(&variable.unit).filter(|u| !u.exponents.is_empty()) {
            let same =
                unit.exponents.len() == wanted.exponents.len() && wanted.exponents.iter().all(|(n, e)| unit.exponents.get(*n) == Some(e));
            return same.then_some(Some((unit.factor * wanted.ours_per_si, unit.offset * wanted.ours_per_si)));
        }
        let (_, _, si) = KNOWN.iter().find(|(name, what, _)| *name == variable.unit && *what == wanted.what)?;
        Some(Some((si * wanted.ours_per_si, 0.0)))
    }
}

fn step(text: Option<String>) -> Option<f64> {
    text?.parse().ok().filter(|s: &f64| s.is_finite() && *s > 0.0)
}

fn value(element: &BytesStart<'_>, key: &str) -> Option<String> {
    let attribute = element.try_get_attribute(key).ok().flatten()?;
    // An entity that cannot be read stays as it stands.
    let raw = String::from_utf8_lossy(&attribute.value).into_owned();
    Some(quick_xml::escape::unescape(&raw).map(|t| t.into_owned()).unwrap_or(raw))
}

fn of(element: &BytesStart<'_>) -> Variable {
    Variable {
        name: value(element, "name").unwrap_or_default(),
        reference: value(element, "valueReference").and_then(|v| v.parse().ok()).unwrap_or(u32::MAX),
        unit: value(element, "unit").unwrap_or_default(),
        declared_type: value(element, "declaredType").unwrap_or_default(),
    }
}

fn base_unit(element: &BytesStart<'_>) -> Unit {
    let number = |key: &str, default: f64| value(element, key).and_then(|v| v.parse().ok()).unwrap_or(default);
    let bases = ["kg", "m", "s", "A", "K", "mol", "cd", "rad"];
    let exponents = bases.iter().filter_map(|b| Some(((*b).to_string(), value(element, b)?.parse().ok()?)));
    Unit { factor: number("factor", 1.0), offset: number("offset", 0.0), exponents: exponents.filter(|(_, e)| *e != 0).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: &str = r#"<?xml version="1.0"?><fmiModelDescription fmiVersion="2.0" modelName="plant" guid="{1}">
      <CoSimulation modelIdentifier="plant"/>
      <UnitDefinitions><Unit name="Pa"><BaseUnit kg="1" m="-1" s="-2"/></Unit><Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit></UnitDefinitions>
      <TypeDefinitions><SimpleType name="Pressure"><Real unit="Pa"/></SimpleType></TypeDefinitions>
      <ModelVariables>
        <ScalarVariable name="cmd" valueReference="3" causality="input"><Real unit="mA" start="0"/></ScalarVariable>
        <ScalarVariable name="enable" valueReference="4" causality="input"><Boolean start="true"/></ScalarVariable>
        <ScalarVariable name="oil" valueReference="7" causality="output"><Real unit="degC"/></ScalarVariable>
        <ScalarVariable name="clutch.p" valueReference="9" causality="output"><Real declaredType="Pressure"/></ScalarVariable>
      </ModelVariables></fmiModelDescription>"#;

    #[test]
    fn the_ports_are_found_by_their_units_and_converted() {
        let ports = Description::parse(TWO).unwrap().ports(None, None).unwrap();
        assert_eq!((ports.current.name.as_str(), ports.current.reference), ("cmd", 3));
        assert!((ports.current.to_ours.0 - 1e-3).abs() < 1e-15);
        assert_eq!((ports.pressure.name.as_str(), ports.pressure.reference), ("clutch.p", 9));
        assert!((ports.pressure.to_ours.0 - 1e-5).abs() < 1e-18);
    }

    #[test]
    fn version_three_with_units_of_its_own() {
        let text = r#"<fmiModelDescription fmiVersion="3.0" modelName="plant" instantiationToken="t"><CoSimulation modelIdentifier="plant"/>
          <UnitDefinitions><Unit name="bar"><BaseUnit kg="1" m="-1" s="-2" factor="100000"/></Unit></UnitDefinitions>
          <ModelVariables><Float64 name="i" valueReference="1" causality="input" unit="A"/><Float64 name="x" valueReference="2" causality="output"/>
          <Float64 name="p" valueReference="3" causality="output" unit="bar"/></ModelVariables></fmiModelDescription>"#;
        let description = Description::parse(text).unwrap();
        assert_eq!((description.version, description.token.as_str()), (3, "t"));
        let ports = description.ports(None, None).unwrap();
        assert_eq!(ports.pressure.reference, 3);
        assert!((ports.pressure.to_ours.0 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn what_is_not_clear_is_asked_for() {
        let description = Description::parse(TWO).unwrap();
        let error = description.ports(Some("current"), None).unwrap_err();
        assert!(error.contains("`current`") && error.contains("cmd [mA]"), "{error}");
        let error = description.ports(None, Some("oil")).unwrap_err();
        assert!(error.contains("oil [degC] is no pressure"), "{error}");
        assert!(Description::parse("<fmiModelDescription fmiVersion='1.0'/>").unwrap_err().contains("2.0 and 3.0"));
        assert!(
            Description::parse("<fmiModelDescription fmiVersion='2.0'><ModelExchange/></fmiModelDescription>")
                .unwrap_err()
                .contains("co-simulation")
        );
        assert!(Description::parse("no xml at all <").is_err());
    }
}
