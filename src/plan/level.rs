//! A level of a stimulus: a pressure closes the loop, a current opens it.

use std::borrow::Cow;
use std::fmt;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::units::{CURRENT, CURRENT_RATE, PRESSURE, PRESSURE_RATE, Unit};

/// What a stimulus commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LevelKind {
    /// A target pressure: closed loop.
    Pressure,
    /// A current: open loop.
    Current,
}

impl LevelKind {
    /// The unit of a level.
    pub fn unit(self) -> &'static Unit {
        match self {
            Self::Pressure => &PRESSURE,
            Self::Current => &CURRENT,
        }
    }
}

/// A pressure or a current, as its unit says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// Which of the two.
    pub kind: LevelKind,
    /// Value in bar or A.
    pub value: f64,
}

/// A rate of pressure or of current.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LevelRate {
    /// Which of the two.
    pub kind: LevelKind,
    /// Value in bar/s or A/s.
    pub value: f64,
}

/// Reads `text` as the one or the other; the message of a failure names both.
fn parse(text: &str, pressure: &'static Unit, current: &'static Unit) -> Result<(LevelKind, f64), String> {
    if let Ok(value) = pressure.parse(text) {
        return Ok((LevelKind::Pressure, value));
    }
    current.parse(text).map(|value| (LevelKind::Current, value)).map_err(|_| {
        format!(
            "`{text}` is neither a {} ({}) nor a {} ({}); a {} closes the loop, a {} opens it",
            pressure.dimension,
            pressure.allowed(),
            current.dimension,
            current.allowed(),
            pressure.dimension,
            current.dimension
        )
    })
}

macro_rules! as_text {
    ($name:ident, $pressure:expr, $current:expr, $example:literal) => {
        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                let unit = if self.kind == LevelKind::Pressure { $pressure } else { $current };
                write!(f, "{} {}", self.value, unit.symbol)
            }
        }
        impl Serialize for $name {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_str(self)
            }
        }
        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct Visitor;
                impl serde::de::Visitor<'_> for Visitor {
                    type Value = $name;
                    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                        write!(f, "a {} or a {} with its unit as text, for instance {}", $pressure.dimension, $current.dimension, $example)
                    }
                    fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<$name, E> {
                        parse(text, $pressure, $current).map(|(kind, value)| $name { kind, value }).map_err(E::custom)
                    }
                    fn visit_f64<E: serde::de::Error>(self, value: f64) -> Result<$name, E> {
                        self.visit_str(&value.to_string())
                    }
                    fn visit_i64<E: serde::de::Error>(self, value: i64) -> Result<$name, E> {
                        self.visit_str(&value.to_string())
                    }
                }
                deserializer.deserialize_any(Visitor)
            }
        }
        impl schemars::JsonSchema for $name {
            fn inline_schema() -> bool {
                true
            }
            fn schema_name() -> Cow<'static, str> {
                stringify!($name).into()
            }
            fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
                schemars::json_schema!({
                    "type": "string",
                    "description": format!(
                        "{} ({}) for closed loop, or {} ({}) for open loop",
                        $pressure.dimension, $pressure.allowed(), $current.dimension, $current.allowed()
                    ),
                    "examples": [$example.trim_matches('"')],
                })
            }
        }
    };
}

as_text!(Level, &PRESSURE, &CURRENT, "\"20 bar\"");
as_text!(LevelRate, &PRESSURE_RATE, &CURRENT_RATE, "\"10 bar/s\"");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_decides() {
        assert_eq!(parse("20 bar", &PRESSURE, &CURRENT), Ok((LevelKind::Pressure, 20.0)));
        assert_eq!(parse("650 mA", &PRESSURE, &CURRENT), Ok((LevelKind::Current, 0.65)));
        insta::assert_snapshot!(parse("20 ms", &PRESSURE, &CURRENT).unwrap_err(), @"`20 ms` is neither a pressure (bar, mbar, Pa, kPa, MPa, psi) nor a current (A, mA, uA); a pressure closes the loop, a current opens it");
    }
}
