//! `modelDescription.xml` of a valve, in the form of FMI 2.0 and of FMI 3.0.
//!
//! Source: Functional Mock-up Interface Specification 2.0.4 (section 2.2) and 3.0.1 (section 2.4), Modelica Association.

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesText, Event};

use super::variables::{Causality, SEED, Variable};
use super::{Export, Part};

/// Version of the interface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Version {
    /// FMI 2.0.
    Two,
    /// FMI 3.0.
    Three,
}

type Sink = Writer<Vec<u8>>;
type Written = std::io::Result<()>;

/// A unit as a product of powers of base units: name, factor, offset, exponents.
struct BaseUnit {
    symbol: &'static str,
    factor: f64,
    offset: f64,
    exponents: &'static [(&'static str, &'static str)],
}

/// The units that variables have, in terms of those of the SI.
const UNITS: [BaseUnit; 11] = [
    BaseUnit { symbol: "A", factor: 1.0, offset: 0.0, exponents: &[("A", "1")] },
    BaseUnit { symbol: "A/s", factor: 1.0, offset: 0.0, exponents: &[("A", "1"), ("s", "-1")] },
    BaseUnit { symbol: "bar", factor: 1e5, offset: 0.0, exponents: &[("kg", "1"), ("m", "-1"), ("s", "-2")] },
    BaseUnit { symbol: "bar^2", factor: 1e10, offset: 0.0, exponents: &[("kg", "2"), ("m", "-2"), ("s", "-4")] },
    BaseUnit { symbol: "bar/s", factor: 1e5, offset: 0.0, exponents: &[("kg", "1"), ("m", "-1"), ("s", "-3")] },
    BaseUnit { symbol: "bar/A", factor: 1e5, offset: 0.0, exponents: &[("kg", "1"), ("m", "-1"), ("s", "-2"), ("A", "-1")] },
    BaseUnit { symbol: "s", factor: 1.0, offset: 0.0, exponents: &[("s", "1")] },
    BaseUnit { symbol: "Hz", factor: 1.0, offset: 0.0, exponents: &[("s", "-1")] },
    BaseUnit { symbol: "1/s", factor: 1.0, offset: 0.0, exponents: &[("s", "-1")] },
    BaseUnit { symbol: "degC", factor: 1.0, offset: 273.15, exponents: &[("K", "1")] },
    BaseUnit { symbol: "1", factor: 1.0, offset: 0.0, exponents: &[] },
];

/// Name of the library inside the FMU, without its ending.
pub const MODEL_IDENTIFIER: &str = "hil_valve";

/// The description.
///
/// # Errors
/// None in practice: writing to memory does not fail.
pub fn description(export: &Export, version: Version) -> std::io::Result<Vec<u8>> {
    let mut sink = Writer::new_with_indent(Vec::new(), b' ', 1);
    sink.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let tool = format!("hil {}", env!("CARGO_PKG_VERSION"));
    let description = match export.part {
        Part::Whole => "electro-hydraulic valve: current in, pressure out; no FMU state can be saved, blocks have no copy",
        Part::Ahead => "effects ahead of a valve: current in, current out; no FMU state can be saved, blocks have no copy",
        Part::Behind => {
            "effects behind a valve: its pressure and its current in, pressure out; no FMU state can be saved, blocks have no copy"
        }
    };
    let root = sink.create_element("fmiModelDescription").with_attributes([
        ("fmiVersion", if version == Version::Two { "2.0" } else { "3.0" }),
        ("modelName", export.valve.name.as_str()),
        (if version == Version::Two { "guid" } else { "instantiationToken" }, export.token.as_str()),
        ("description", description),
        ("generationTool", tool.as_str()),
        ("variableNamingConvention", "structured"),
    ]);
    root.write_inner_content(|sink| {
        simulation(sink, export, version)?;
        sink.create_element("UnitDefinitions").write_inner_content(|sink| units(sink, &export.variables))?;
        sink.create_element("LogCategories").write_inner_content(|sink| {
            let error = [("name", "logStatusError"), ("description", "what was refused, and what is allowed")];
            sink.create_element("Category").with_attributes(error).write_empty().map(drop)
        })?;
        let step = export.step_s.to_string();
        sink.create_element("DefaultExperiment").with_attributes([("startTime", "0"), ("stepSize", step.as_str())]).write_empty()?;
        sink.create_element("ModelVariables").write_inner_content(|sink| variables(sink, export, version))?;
        sink.create_element("ModelStructure").write_inner_content(|sink| structure(sink, &export.variables, version))?;
        Ok(())
    })?;
    sink.write_event(Event::Text(BytesText::new("\n")))?;
    Ok(sink.into_inner())
}

fn simulation(sink: &mut Sink, export: &Export, version: Version) -> Written {
    let mut element = sink
        .create_element("CoSimulation")
        .with_attributes([("modelIdentifier", MODEL_IDENTIFIER), ("canHandleVariableCommunicationStepSize", "true")]);
    if version == Version::Three {
        let step = export.step_s.to_string();
        element = element.with_attribute(("fixedInternalStepSize", step.as_str()));
    }
    element.write_empty().map(drop)
}

fn units(sink: &mut Sink, variables: &[Variable]) -> Written {
    for unit in UNITS.iter().filter(|u| variables.iter().any(|v| v.unit == u.symbol)) {
        sink.create_element("Unit").with_attribute(("name", unit.symbol)).write_inner_content(|sink| {
            let (factor, offset) = (unit.factor.to_string(), unit.offset.to_string());
            let base = sink.create_element("BaseUnit").with_attributes(unit.exponents.iter().copied());
            base.with_attributes([("factor", factor.as_str()), ("offset", offset.as_str())]).write_empty().map(drop)
        })?;
    }
    Ok(())
}

fn variables(sink: &mut Sink, export: &Export, version: Version) -> Written {
    if version == Version::Three {
        let time = [("name", "time"), ("valueReference", "0"), ("causality", "independent"), ("variability", "continuous"), ("unit", "s")];
        sink.create_element("Float64").with_attributes(time).write_empty()?;
    }
    for variable in &export.variables {
        let (causality, variability) = match variable.causality {
            Causality::Input => ("input", "continuous"),
            Causality::Output => ("output", "continuous"),
            Causality::Parameter => ("parameter", "tunable"),
        };
        let reference = variable.reference.to_string();
        let head = [
            ("name", variable.name.as_str()),
            ("valueReference", reference.as_str()),
            ("description", variable.description.as_str()),
            ("causality", causality),
            ("variability", variability),
        ];
        let (start, range) = (variable.start.map(|v| v.to_string()), variable.range.map(|(l, h)| (l.to_string(), h.to_string())));
        let mut value = vec![("unit", variable.unit)];
        if let Some((low, high)) = &range {
            value.extend([("min", low.as_str()), ("max", high.as_str())].into_iter().filter(|(_, v)| *v != "inf" && *v != "-inf"));
        }
        value.extend(start.as_deref().map(|v| ("start", v)));
        scalar(sink, version, ("Real", "Float64"), &head, &value, variable.causality == Causality::Output)?;
    }
    let reference = SEED.to_string();
    let head = [
        ("name", "seed"),
        ("valueReference", reference.as_str()),
        ("description", "seed of noise and other chance; 0: the mean course, without chance"),
        ("causality", "parameter"),
        ("variability", "fixed"),
    ];
    scalar(sink, version, ("Integer", "Int32"), &head, &[("min", "0"), ("start", "0")], false)
}

/// One variable: in FMI 2 the type is an element inside, in FMI 3 it is the element.
fn scalar(sink: &mut Sink, version: Version, kind: (&str, &str), head: &[(&str, &str)], value: &[(&str, &str)], computed: bool) -> Written {
    let initial =
        computed.then_some(("initial", "calculated")).or(head.contains(&("causality", "parameter")).then_some(("initial", "exact")));
    let head = head.iter().copied().chain(initial);
    if version == Version::Three {
        return sink.create_element(kind.1).with_attributes(head.chain(value.iter().copied())).write_empty().map(drop);
    }
    let outer = sink.create_element("ScalarVariable").with_attributes(head);
    outer.write_inner_content(|sink| sink.create_element(kind.0).with_attributes(value.iter().copied()).write_empty().map(drop))?;
    Ok(())
}

/// The outputs: none follows the input at once, as the command acts from the begin of a step.
fn structure(sink: &mut Sink, variables: &[Variable], version: Version) -> Written {
    let outputs = || variables.iter().enumerate().filter(|(_, v)| v.causality == Causality::Output);
    let places: Vec<String> =
        outputs().map(|(k, v)| if version == Version::Two { k + 1 } else { v.reference as usize }.to_string()).collect();
    if version == Version::Three {
        for (element, place) in ["Output", "InitialUnknown"].iter().flat_map(|e| places.iter().map(move |p| (e, p))) {
            sink.create_element(*element).with_attribute(("valueReference", place.as_str())).write_empty()?;
        }
        return Ok(());
    }
    for element in ["Outputs", "InitialUnknowns"] {
        sink.create_element(element).write_inner_content(|sink| {
            for place in &places {
                sink.create_element("Unknown").with_attribute(("index", place.as_str())).write_empty()?;
            }
            Ok(())
        })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::EFFECTS;

    #[test]
    fn every_unit_of_a_parameter_is_defined() {
        for unit in EFFECTS.iter().flat_map(|e| e.parameters()).map(|p| p.unit.symbol) {
            assert!(UNITS.iter().any(|u| u.symbol == unit), "{unit}");
        }
    }
}
