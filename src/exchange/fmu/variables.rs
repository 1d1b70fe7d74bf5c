//! What an FMU of a valve shows: its inputs, its outputs and the parameters of its model.
//!
//! One list serves the description that is written into the FMU and the library inside it, so that a value reference
//! means the same in both.

use super::part::Part;
use crate::physics::{Channel, PhysicsError, REFERENCE_C, resolve};
use crate::units::{CURRENT, PRESSURE, PRESSURE_SQUARED, TEMPERATURE, TIME};
use crate::valve::{Hysteresis, Valve};

/// Value reference of the command [A].
pub const CURRENT_IN: u32 = 1;
/// Value reference of the pressure that comes from the model ahead [bar].
pub const PRESSURE_IN: u32 = 2;
/// Value reference of the oil temperature [degC], where an effect of the model uses it.
pub const OIL_TEMPERATURE_IN: u32 = 3;
/// Value reference of the supply pressure [bar], where an effect of the model uses it.
pub const SUPPLY_PRESSURE_IN: u32 = 4;
/// Value reference of the pressure [bar].
pub const PRESSURE_OUT: u32 = 10;
/// Value reference of the time that the model has reached [s].
pub const MODEL_TIME_OUT: u32 = 11;
/// Value reference of the current that has arrived at the static curve [A]: of a whole valve a state, of effects ahead of a
/// model the current for it.
pub const CURRENT_OUT: u32 = 12;
/// Value reference of the pressure on the static curve with its hysteresis, ahead of all dynamics [bar].
pub const CURVE_PRESSURE_OUT: u32 = 13;
/// Value reference of the seed of noise and other chance; 0 for none.
pub const SEED: u32 = 90;
/// Value reference of the first parameter of the model.
const FIRST_PARAMETER: u32 = 100;

/// What a master may do with a variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Causality {
    /// Set by the master at the begin of a step.
    Input,
    /// Read by the master at the end of a step.
    Output,
    /// Set at any time.
    Parameter,
}

/// What a value of the model belongs to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Meaning {
    /// The command.
    Current,
    /// The pressure of the model ahead.
    PressureIn,
    /// What the valve stands in: oil temperature or supply pressure.
    Around(Channel),
    /// The pressure.
    Pressure,
    /// The current at the static curve, or for the model behind.
    CurrentOut,
    /// The pressure on the static curve.
    CurvePressure,
    /// The time that the model has reached.
    ModelTime,
    /// Dead time.
    Delay,
    /// Lag of the chamber.
    Lag,
    /// The parameter `a` of the hyperbola.
    HysteresisA,
    /// Standard deviation of the sensor noise.
    Noise,
    /// Parameter number `.1` of effect number `.0`.
    Effect(usize, usize),
}

/// One variable of real type.
#[derive(Debug, Clone, PartialEq)]
pub struct Variable {
    /// Value reference.
    pub reference: u32,
    /// Name, `effect.parameter` for those of effects.
    pub name: String,
    /// What it is.
    pub description: String,
    /// Symbol of its unit.
    pub unit: &'static str,
    /// What a master may do with it.
    pub causality: Causality,
    /// Its value before anybody sets it; none for what is computed.
    pub start: Option<f64>,
    /// Smallest and largest value that physics allows.
    pub range: Option<(f64, f64)>,
    /// What it belongs to.
    pub meaning: Meaning,
}

/// The variables of a valve, or of effects about another model, in the order of their value references.
///
/// # Errors
/// [`PhysicsError`] where the valve names an effect that does not exist, or a value out of range.
pub fn variables(valve: &Valve, part: Part) -> Result<Vec<Variable>, PhysicsError> {
    let input = |reference, name: &str, description: &str, unit, start, meaning| Variable {
        reference,
        name: name.into(),
        description: description.into(),
        unit,
        causality: Causality::Input,
        start: Some(start),
        range: None,
        meaning,
    };
    let rest_a = valve.current_limits_a.0.max(valve.curves.range_a.0);
    let mut all = vec![input(CURRENT_IN, "current", "command, held from step to step", CURRENT.symbol, rest_a, Meaning::Current)];
    if part == Part::Behind {
        let text = "pressure of the model ahead, held from step to step";
        all.push(input(PRESSURE_IN, "pressure_in", text, PRESSURE.symbol, 0.0, Meaning::PressureIn));
    }
    for (channel, reference, name, description, unit, start) in [
        (
            Channel::OilTemperature,
            OIL_TEMPERATURE_IN,
            "oil_temperature",
            "temperature of the oil, held from step to step",
            TEMPERATURE.symbol,
            REFERENCE_C,
        ),
        (
            Channel::SupplyPressure,
            SUPPLY_PRESSURE_IN,
            "supply_pressure",
            "pressure of the supply, held from step to step",
            PRESSURE.symbol,
            0.0,
        ),
    ] {
        let uses = |spec| {
            let (effect, theta) = resolve(spec)?;
            Ok(effect.uses(&theta).contains(&channel))
        };
        if valve.effects.iter().map(uses).collect::<Result<Vec<bool>, PhysicsError>>()?.contains(&true) {
            all.push(input(reference, name, description, unit, start, Meaning::Around(channel)));
        }
    }
    all.push(match part {
        Part::Ahead => output(CURRENT_OUT, "current_out", "current for the model behind", CURRENT.symbol, Meaning::CurrentOut),
        Part::Whole | Part::Behind => output(PRESSURE_OUT, "pressure", "pressure at the sensor", PRESSURE.symbol, Meaning::Pressure),
    });
    all.push(output(MODEL_TIME_OUT, "model_time", "time that the model has reached", TIME.symbol, Meaning::ModelTime));
    if part == Part::Whole {
        let (current, pressure) =
            ("current at the static curve", "pressure on the static curve with its hysteresis, ahead of all dynamics");
        all.push(output(CURRENT_OUT, "curve.current", current, CURRENT.symbol, Meaning::CurrentOut));
        all.push(output(CURVE_PRESSURE_OUT, "curve.pressure", pressure, PRESSURE.symbol, Meaning::CurvePressure));
    }
    let mut next = FIRST_PARAMETER;
    let mut parameter = |name: String, description: &str, unit, start, range, meaning| {
        let causality = Causality::Parameter;
        all.push(Variable { reference: next, name, description: description.into(), unit, causality, start: Some(start), range, meaning });
        next += 1;
    };
    let positive = Some((0.0, f64::INFINITY));
    if part == Part::Whole {
        parameter("delay".into(), "dead time between command and pressure", TIME.symbol, valve.delay_s, positive, Meaning::Delay);
        parameter("lag".into(), "time constant of the chamber", TIME.symbol, valve.lag_s, positive, Meaning::Lag);
        if let Hysteresis::Hyperbolic { a_bar2 } = valve.hysteresis {
            parameter("hysteresis.a".into(), "parameter of the hyperbola", PRESSURE_SQUARED.symbol, a_bar2, positive, Meaning::HysteresisA);
        }
        let noise = "standard deviation of the sensor noise; acts only with a seed";
        parameter("noise".into(), noise, PRESSURE.symbol, valve.noise_bar, positive, Meaning::Noise);
    }
    for (number, spec) in valve.effects.iter().enumerate() {
        let (effect, theta) = resolve(spec)?;
        let before = valve.effects[..number].iter().filter(|e| e.id == spec.id).count();
        let id = if before == 0 { spec.id.clone() } else { format!("{}_{}", spec.id, before + 1) };
        for (place, (p, value)) in effect.parameters().iter().zip(theta).enumerate() {
            parameter(format!("{id}.{}", p.name), p.meaning, p.unit.symbol, value, Some(p.range), Meaning::Effect(number, place));
        }
    }
    Ok(all)
}

fn output(reference: u32, name: &str, description: &str, unit: &'static str, meaning: Meaning) -> Variable {
    let (name, description) = (name.into(), description.into());
    Variable { reference, name, description, unit, causality: Causality::Output, start: None, range: None, meaning }
}

/// Writes a parameter's value into the model.
///
/// # Errors
/// What is wrong with the value, in words.
pub fn set(valve: &mut Valve, variable: &Variable, value: f64) -> Result<(), String> {
    let refused = |allowed: &str| Err(format!("{} = {value} {}: {allowed} is allowed", variable.name, variable.unit));
    if !value.is_finite() {
        return refused("a finite value");
    }
    if let Some((low, high)) = variable.range
        && !(low..=high).contains(&value)
    {
        return refused(&format!("{low} to {high}"));
    }
    match variable.meaning {
        Meaning::Delay => valve.delay_s = value,
        Meaning::Lag => valve.lag_s = value,
        Meaning::HysteresisA => valve.hysteresis = Hysteresis::Hyperbolic { a_bar2: value },
        Meaning::Noise => valve.noise_bar = value,
        Meaning::Effect(number, place) => {
            let spec = &mut valve.effects[number];
            let (effect, _) = resolve(spec).map_err(|e| e.to_string())?;
            let parameter = &effect.parameters()[place];
            let text = if parameter.unit.symbol == "1" { value.to_string() } else { format!("{value} {}", parameter.unit.symbol) };
            match spec.parameters.iter_mut().find(|(name, _)| name == parameter.name) {
                Some((_, old)) => *old = text,
                None => spec.parameters.push((parameter.name.into(), text)),
            }
        }
        Meaning::Current
        | Meaning::PressureIn
        | Meaning::Around(_)
        | Meaning::CurrentOut
        | Meaning::CurvePressure
        | Meaning::Pressure
        | Meaning::ModelTime => {
            return Err(format!("{} is no parameter", variable.name));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn valve() -> Valve {
        let text = format!(
            "{}\n[[effect]]\nfirst_order_lag = {{ tau = \"45 ms\" }}\n[[effect]]\nflow_limit = {{ rise = \"80 bar/s\", fall = \"60 bar/s\" }}\n",
            include_str!("../../../valves/paper.toml")
        );
        Valve::from_toml(&text, "valve.toml").unwrap()
    }

    #[test]
    fn every_parameter_can_be_set_and_is_read_back() {
        let mut valve = valve();
        for variable in variables(&valve, Part::Whole).unwrap().iter().filter(|v| v.causality == Causality::Parameter) {
            let value = 0.5 * variable.start.unwrap() + 0.011;
            set(&mut valve, variable, value).unwrap();
            let again = variables(&valve, Part::Whole).unwrap();
            let read = again.iter().find(|v| v.reference == variable.reference).unwrap();
            assert!((read.start.unwrap() - value).abs() < 1e-12, "{}", variable.name);
        }
    }

    #[test]
    fn a_value_that_physics_does_not_allow_is_refused_and_changes_nothing() {
        let mut valve = valve();
        let before = valve.clone();
        let all = variables(&valve, Part::Whole).unwrap();
        let tau = all.iter().find(|v| v.name == "first_order_lag.tau").unwrap();
        for wrong in [f64::NAN, f64::INFINITY, -1.0] {
            assert!(set(&mut valve, tau, wrong).is_err());
        }
        assert!(set(&mut valve, &all[0], 0.5).is_err());
        assert_eq!(valve, before);
    }

    #[test]
    fn references_and_names_are_unique() {
        let all = variables(&valve(), Part::Whole).unwrap();
        let references: std::collections::BTreeSet<u32> = all.iter().map(|v| v.reference).collect();
        let names: std::collections::BTreeSet<&str> = all.iter().map(|v| v.name.as_str()).collect();
        assert_eq!((references.len(), names.len()), (all.len(), all.len()));
    }
}
