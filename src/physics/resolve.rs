//! From an effect as a valve file writes it to its values, and back.

use super::error::PhysicsError;
use super::{EFFECTS, Effect};
use crate::document::nearest;
use crate::valve::EffectSpec;

/// How much larger or smaller than a clutch valve's a foreign signal may be.
const FOREIGN: f64 = 1e4;

/// The effect and the parameter values that a specification in a valve file stands for.
pub fn resolve(spec: &EffectSpec) -> Result<(&'static dyn Effect, Vec<f64>), PhysicsError> {
    let effect = super::effect(&spec.id).ok_or_else(|| PhysicsError::UnknownEffect {
        id: spec.id.clone(),
        hint: nearest(&spec.id, EFFECTS.iter().map(|e| e.id())).map_or(String::new(), |n| format!(", did you mean `{n}`?")),
        known: EFFECTS.iter().map(|e| e.id()).collect::<Vec<_>>().join(", "),
    })?;
    if let Some(read) = effect.read(spec) {
        return Ok((effect, read?));
    }
    let parameters = effect.parameters();
    if let Some((name, _)) = spec.parameters.iter().find(|(name, _)| !parameters.iter().any(|p| p.name == name)) {
        let known: Vec<_> = parameters.iter().map(|p| p.name).collect();
        return Err(PhysicsError::UnknownParameter { effect: spec.id.clone(), name: name.clone(), known: known.join(", ") });
    }
    let value = |p: &super::Parameter| {
        let Some((_, text)) = spec.parameters.iter().find(|(name, _)| name == p.name) else {
            let missing = || PhysicsError::MissingParameter { effect: spec.id.clone(), name: p.name.into(), meaning: p.meaning.into() };
            return p.default.ok_or_else(missing);
        };
        let value = p.unit.parse(text).map_err(|source| PhysicsError::Quantity {
            effect: spec.id.clone(),
            name: p.name.into(),
            source: Box::new(source),
        })?;
        // A valve with a foreign input or output (a duty, a flow) has effects of that size.
        let size = if matches!(p.unit.symbol, "A" | "A/s" | "bar" | "bar/s" | "bar/A") { FOREIGN } else { 1.0 };
        let (low, high) = if p.range.0 < 0.0 { (p.range.0 * size, p.range.1 * size) } else { (p.range.0 / size, p.range.1 * size) };
        let slack = 1e-9 * (high - low);
        if !(low - slack..=high + slack).contains(&value) {
            let with_unit = |v: f64| format!("{v} {}", p.unit.symbol);
            return Err(PhysicsError::OutOfRange {
                effect: spec.id.clone(),
                name: p.name.into(),
                value: text.clone(),
                low: with_unit(low),
                high: with_unit(high),
            });
        }
        Ok(value)
    };
    Ok((effect, parameters.iter().map(value).collect::<Result<_, _>>()?))
}

/// The specification of an effect with these values, as it stands in a valve file.
pub fn specification(effect: &dyn Effect, theta: &[f64]) -> EffectSpec {
    if let Some(parameters) = effect.write(theta) {
        return EffectSpec { id: effect.id().into(), parameters };
    }
    let text = |(p, v): (&super::Parameter, &f64)| {
        let unit = if p.unit.symbol == "1" { String::new() } else { format!(" {}", p.unit.symbol) };
        (p.name.to_string(), format!("{v}{unit}"))
    };
    EffectSpec { id: effect.id().into(), parameters: effect.parameters().iter().zip(theta).map(text).collect() }
}
