//! Quantities with units.
//!
//! A number that a person types carries its unit (`"650 mA"`, `"30 ms"`); inside the program it is an `f64` in
//! the one canonical unit of its dimension: A, bar, s, Hz, bar^2, mA/bar, mA/(bar s). A text with the wrong
//! dimension is refused, and the message lists what is allowed.

use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A dimension with its canonical unit and every spelling that is accepted for it.
#[derive(Debug, PartialEq)]
pub struct Unit {
    /// What is measured, as a message names it: `pressure`.
    pub dimension: &'static str,
    /// The canonical unit, in which values are kept: `bar`.
    pub symbol: &'static str,
    /// Spelling and factor to the canonical unit.
    pub spellings: &'static [(&'static str, f64)],
    /// Decimals of the canonical unit in a report, so that equal inputs print equal text on every machine.
    pub decimals: usize,
}

/// Why a text is not a quantity of the wanted dimension.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum UnitError {
    /// No number at the start of the text.
    #[error("`{text}` does not begin with a number; write for instance `{example}`")]
    NotANumber {
        /// The text as typed.
        text: String,
        /// A valid text of the wanted dimension.
        example: String,
    },
    /// A number without a unit.
    #[error("`{text}` has no unit; a {dimension} is wanted, in one of: {allowed}")]
    NoUnit {
        /// The text as typed.
        text: String,
        /// The wanted dimension.
        dimension: &'static str,
        /// The accepted spellings.
        allowed: String,
    },
    /// A unit of another dimension, or none that is known.
    #[error("`{text}` is not a {dimension}: the unit `{unit}` {why}; allowed: {allowed}")]
    WrongUnit {
        /// The text as typed.
        text: String,
        /// The unit as typed.
        unit: String,
        /// The wanted dimension.
        dimension: &'static str,
        /// What the unit is instead.
        why: String,
        /// The accepted spellings.
        allowed: String,
    },
    /// Infinite or not a number.
    #[error("`{text}` is not finite")]
    NotFinite {
        /// The text as typed.
        text: String,
    },
}

impl Unit {
    /// The accepted spellings, for a message.
    pub fn allowed(&self) -> String {
        let names: Vec<&str> = self.spellings.iter().map(|s| s.0).collect();
        names.join(", ")
    }

    /// The value of `text` in the canonical unit.
    pub fn parse(&'static self, text: &str) -> Result<f64, UnitError> {
        let (number, unit) = split(text);
        let Ok(value) = number.parse::<f64>() else {
            return Err(UnitError::NotANumber { text: text.into(), example: format!("1 {}", self.symbol) });
        };
        if unit.is_empty() {
            let dimensionless = self.spellings.iter().find(|s| s.0 == "1");
            let Some((_, factor)) = dimensionless else {
                return Err(UnitError::NoUnit { text: text.into(), dimension: self.dimension, allowed: self.allowed() });
            };
            return finite(text, value * factor);
        }
        match self.spellings.iter().find(|s| s.0 == unit) {
            Some((_, factor)) => finite(text, value * factor),
            None => Err(UnitError::WrongUnit {
                text: text.into(),
                unit: unit.into(),
                dimension: self.dimension,
                why: match all_units().find(|u| u.spellings.iter().any(|s| s.0 == unit)) {
                    Some(other) => format!("is of a {}", other.dimension),
                    None => "is unknown".into(),
                },
                allowed: self.allowed(),
            }),
        }
    }

    /// The unit whose canonical symbol is `symbol`, for printing a figure that carries its unit as text.
    pub fn by_symbol(symbol: &str) -> Option<&'static Unit> {
        all_units().find(|u| u.symbol == symbol)
    }

    /// The unit of which `text`, a number with its unit, carries a spelling; of several, the first.
    pub fn of_text(text: &str) -> Option<&'static Unit> {
        let (number, unit) = split(text);
        let unit = if unit.is_empty() { "1" } else { unit };
        number.parse::<f64>().ok()?;
        all_units().find(|u| u.spellings.iter().any(|s| s.0 == unit))
    }

    /// `value` with the canonical unit and this unit's fixed number of decimals.
    pub fn print(&self, value: f64) -> String {
        let text = format!("{value:.*}", self.decimals);
        // A rounded -0.000 and 0.000 are the same figure.
        let text = if text.starts_with('-') && text[1..].bytes().all(|b| b == b'0' || b == b'.') { text[1..].to_string() } else { text };
        if self.symbol == "1" { text } else { format!("{text} {}", self.symbol) }
    }
}

/// `value` with three figures that count, in at most so many decimals.
pub fn three_figures(value: f64, most_decimals: i32) -> String {
    let decimals = if value == 0.0 { 0 } else { (2 - value.abs().log10().floor() as i32).clamp(0, most_decimals) as usize };
    format!("{value:.decimals$}")
}

fn finite(text: &str, value: f64) -> Result<f64, UnitError> {
    if value.is_finite() { Ok(value) } else { Err(UnitError::NotFinite { text: text.into() }) }
}

/// Splits `"650 mA"` into its number and its unit. An exponent (`1e-3`) belongs to the number.
fn split(text: &str) -> (&str, &str) {
    let text = text.trim();
    let bytes = text.as_bytes();
    let mut end = 0;
    while end < bytes.len() {
        let c = bytes[end];
        let exponent = (c == b'e' || c == b'E')
            && end > 0
            && bytes
                .get(end + 1)
                .is_some_and(|n| n.is_ascii_digit() || ((*n == b'-' || *n == b'+') && bytes.get(end + 2).is_some_and(u8::is_ascii_digit)));
        let sign = (c == b'-' || c == b'+') && (end == 0 || matches!(bytes[end - 1], b'e' | b'E'));
        if !(c.is_ascii_digit() || c == b'.' || exponent || sign) {
            break;
        }
        end += 1;
    }
    (&text[..end], text[end..].trim())
}

macro_rules! units {
    ($($(#[$doc:meta])* $constant:ident $marker:ident $alias:ident $dimension:literal $symbol:literal $decimals:literal [$($spelling:literal $factor:expr),+ $(,)?];)+) => {
        $(
            $(#[$doc])*
            pub static $constant: Unit = Unit { dimension: $dimension, symbol: $symbol, decimals: $decimals, spellings: &[$(($spelling, $factor)),+] };
            #[doc = concat!("Marks a quantity as a ", $dimension, ".")]
            #[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
            pub struct $marker;
            impl Dimension for $marker { fn unit() -> &'static Unit { &$constant } }
            $(#[$doc])*
            pub type $alias = Quantity<$marker>;
        )+
        /// Every unit that quantities are kept in.
        pub fn all_units() -> impl Iterator<Item = &'static Unit> { [$(&$constant),+].into_iter() }
    };
}

units! {
    /// Electric current, kept in A.
    CURRENT CurrentUnit Current "current" "A" 4 ["A" 1.0, "mA" 1e-3, "uA" 1e-6];
    /// Gauge pressure, kept in bar.
    PRESSURE PressureUnit Pressure "pressure" "bar" 3 ["bar" 1.0, "mbar" 1e-3, "Pa" 1e-5, "kPa" 1e-2, "MPa" 10.0, "psi" 0.0689475729];
    /// Time, kept in s.
    TIME TimeUnit Time "time" "s" 4 ["s" 1.0, "ms" 1e-3, "us" 1e-6, "min" 60.0, "h" 3600.0];
    /// Frequency, kept in Hz.
    FREQUENCY FrequencyUnit Frequency "frequency" "Hz" 3 ["Hz" 1.0, "kHz" 1e3, "mHz" 1e-3];
    /// Angular frequency, kept in rad/s.
    ANGULAR_FREQUENCY AngularFrequencyUnit AngularFrequency "angular frequency" "rad/s" 4 ["rad/s" 1.0];
    /// Ratio, kept as a fraction; `5 %` is 0.05.
    RATIO RatioUnit Ratio "ratio" "1" 4 ["1" 1.0, "%" 1e-2, "ppm" 1e-6];
    /// Rate of pressure, kept in bar/s.
    PRESSURE_RATE PressureRateUnit PressureRate "pressure rate" "bar/s" 3 ["bar/s" 1.0, "bar/ms" 1e3, "mbar/s" 1e-3, "bar/min" 1.0 / 60.0];
    /// Rate of current, kept in A/s.
    CURRENT_RATE CurrentRateUnit CurrentRate "current rate" "A/s" 4 ["A/s" 1.0, "mA/s" 1e-3, "mA/ms" 1.0];
    /// Parameter `a` of the hyperbola, Eq. (5), kept in bar^2.
    PRESSURE_SQUARED PressureSquaredUnit PressureSquared "squared pressure" "bar^2" 4 ["bar^2" 1.0, "bar2" 1.0, "bar²" 1.0];
    /// Proportional gain K_P of Eq. (12), kept in mA/bar.
    PROPORTIONAL_GAIN ProportionalGainUnit ProportionalGain "proportional gain" "mA/bar" 4 ["mA/bar" 1.0, "A/bar" 1e3];
    /// Integral gain K_I of Eq. (12), kept in mA/(bar s).
    INTEGRAL_GAIN IntegralGainUnit IntegralGain "integral gain" "mA/(bar s)" 4 ["mA/(bar s)" 1.0, "mA/(bar*s)" 1.0, "mA/bar/s" 1.0, "A/(bar s)" 1e3];
    /// Slope of the pressure over the current, kept in bar/A.
    PRESSURE_PER_CURRENT PressurePerCurrentUnit PressurePerCurrent "slope of pressure over current" "bar/A" 3 ["bar/A" 1.0, "bar/mA" 1e3];
    /// Oil or coil temperature, kept in degC.
    TEMPERATURE TemperatureUnit Temperature "temperature" "degC" 1 ["degC" 1.0, "°C" 1.0];
    /// Difference of two temperatures, kept in K.
    TEMPERATURE_CHANGE TemperatureChangeUnit TemperatureChange "temperature difference" "K" 1 ["K" 1.0];
    /// Angle, kept in deg.
    ANGLE AngleUnit Angle "angle" "deg" 3 ["deg" 1.0, "°" 1.0, "rad" 57.295_779_513_082_32];
    /// Level of a gain, kept in dB.
    LEVEL LevelUnit Level "level" "dB" 3 ["dB" 1.0];
    /// Rate of a ratio, kept in 1/s.
    RATIO_RATE RatioRateUnit RatioRate "rate of a ratio" "1/s" 6 ["1/s" 1.0, "%/s" 1e-2, "%/min" 1e-2 / 60.0, "1/min" 1.0 / 60.0, "%/h" 1e-2 / 3600.0];
    /// Ratio per ampere, kept in 1/A.
    PER_CURRENT PerCurrentUnit PerCurrent "ratio per current" "1/A" 4 ["1/A" 1.0, "1/mA" 1e3, "%/A" 1e-2];
    /// Number of things counted.
    COUNT CountUnit Count "count" "1" 0 ["1" 1.0];
}

/// The dimension of a [`Quantity`].
pub trait Dimension {
    /// Its unit with all spellings.
    fn unit() -> &'static Unit;
}

/// A number in the canonical unit of the dimension `D`. Reads and writes texts like `"20 bar"`.
#[derive(PartialEq, PartialOrd)]
pub struct Quantity<D>(f64, PhantomData<D>);

impl<D> Clone for Quantity<D> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<D> Copy for Quantity<D> {}

impl<D: Dimension> Quantity<D> {
    /// A quantity from its value in the canonical unit.
    pub const fn new(value: f64) -> Self {
        Self(value, PhantomData)
    }
    /// The value in the canonical unit.
    pub const fn value(self) -> f64 {
        self.0
    }
}

impl<D: Dimension> FromStr for Quantity<D> {
    type Err = UnitError;
    fn from_str(text: &str) -> Result<Self, UnitError> {
        D::unit().parse(text).map(Self::new)
    }
}

impl<D: Dimension> fmt::Display for Quantity<D> {
    /// The shortest text that reads back as the same value.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match D::unit().symbol {
            "1" => write!(f, "{}", self.0),
            symbol => write!(f, "{} {symbol}", self.0),
        }
    }
}

impl<D: Dimension> fmt::Debug for Quantity<D> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl<D: Dimension> Serialize for Quantity<D> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de, D: Dimension> Deserialize<'de> for Quantity<D> {
    fn deserialize<T: Deserializer<'de>>(deserializer: T) -> Result<Self, T::Error> {
        deserializer.deserialize_any(QuantityVisitor(PhantomData))
    }
}

struct QuantityVisitor<D>(PhantomData<D>);

impl<D: Dimension> serde::de::Visitor<'_> for QuantityVisitor<D> {
    type Value = Quantity<D>;
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = D::unit();
        write!(f, "a {} with its unit as text, for instance \"1 {}\" (units: {})", unit.dimension, unit.symbol, unit.allowed())
    }
    fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<Self::Value, E> {
        text.parse().map_err(E::custom)
    }
    fn visit_f64<E: serde::de::Error>(self, value: f64) -> Result<Self::Value, E> {
        self.visit_str(&value.to_string())
    }
    fn visit_i64<E: serde::de::Error>(self, value: i64) -> Result<Self::Value, E> {
        self.visit_str(&value.to_string())
    }
}

impl<D: Dimension> schemars::JsonSchema for Quantity<D> {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        D::unit().dimension.into()
    }
    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        let unit = D::unit();
        let spellings: Vec<String> = unit.spellings.iter().map(|s| regex_escape(s.0)).collect();
        schemars::json_schema!({
            "type": "string",
            "description": format!("{} with its unit: {}", unit.dimension, unit.allowed()),
            "pattern": format!("^[-+]?[0-9.]+([eE][-+]?[0-9]+)? *({})$", spellings.join("|")),
            "examples": [format!("1 {}", unit.symbol)],
        })
    }
}

fn regex_escape(text: &str) -> String {
    text.chars().flat_map(|c| if "()*^/.".contains(c) { vec!['\\', c] } else { vec![c] }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn texts_become_canonical_values() {
        assert_eq!("650 mA".parse::<Current>().unwrap().value(), 0.65);
        assert_eq!("1.5e-3A".parse::<Current>().unwrap().value(), 0.0015);
        assert_eq!("-2 bar".parse::<Pressure>().unwrap().value(), -2.0);
        assert_eq!("30ms".parse::<Time>().unwrap().value(), 0.03);
        assert_eq!("5 %".parse::<Ratio>().unwrap().value(), 0.05);
        assert_eq!("0.5".parse::<Ratio>().unwrap().value(), 0.5);
        assert_eq!("5 mA/(bar s)".parse::<IntegralGain>().unwrap().value(), 5.0);
    }

    #[test]
    fn a_wrong_dimension_is_named_with_what_is_allowed() {
        let message = |text: &str| text.parse::<Pressure>().unwrap_err().to_string();
        insta::assert_snapshot!(message("20 mA"), @"`20 mA` is not a pressure: the unit `mA` is of a current; allowed: bar, mbar, Pa, kPa, MPa, psi");
        insta::assert_snapshot!(message("20"), @"`20` has no unit; a pressure is wanted, in one of: bar, mbar, Pa, kPa, MPa, psi");
        insta::assert_snapshot!(message("x bar"), @"`x bar` does not begin with a number; write for instance `1 bar`");
        insta::assert_snapshot!(message("20 furlong"), @"`20 furlong` is not a pressure: the unit `furlong` is unknown; allowed: bar, mbar, Pa, kPa, MPa, psi");
        insta::assert_snapshot!(message("1e999 bar"), @"`1e999 bar` is not finite");
    }

    #[test]
    fn a_rounded_zero_has_no_sign() {
        assert_eq!(PRESSURE.print(-1e-9), "0.000 bar");
        assert_eq!(PRESSURE.print(-0.5), "-0.500 bar");
    }

    proptest! {
        #[test]
        fn printing_and_reading_back_is_the_identity(value in -1e9f64..1e9) {
            let back: Pressure = Pressure::new(value).to_string().parse().unwrap();
            prop_assert_eq!(back.value(), value);
        }

        #[test]
        fn no_text_panics(text in "\\PC*") {
            let _ = text.parse::<Current>();
        }
    }
}
