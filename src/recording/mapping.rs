//! `--map CHANNEL=EXPR`: takes a channel from a foreign column, converting its unit or scaling it.
//!
//! EXPR holds one column and numbers: `I_cmd [mA]`, `0.01 * duty_pct`, `2.5 * U_p [mbar] - 1`, `"Druck / bar"`.
//! The unit in brackets is that of the column and is converted to the channel's own; a factor and an offset are
//! applied after that. A column named exactly like the whole of EXPR is taken as that column. `Druck / bar` and
//! `group/channel` are names, for no column may divide. The time may stand in two columns: `Datum + Zeit`.

use super::{Channel, RecordingError};
use crate::units::{self, Unit};

/// What a column of a file is taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// `time_s`.
    Time,
    /// `run`: the name of the run that a row belongs to.
    Run,
    /// A channel.
    Channel(Channel),
}

/// One `--map CHANNEL=EXPR`.
#[derive(Debug, Clone, PartialEq)]
pub struct Mapping {
    /// What the column becomes.
    pub role: Role,
    /// EXPR as typed, without surrounding space.
    pub text: String,
    /// Name of the foreign column.
    pub column: String,
    /// Column of the time of day, where `column` holds the date.
    pub second: Option<String>,
    /// Unit of the column as typed in brackets.
    pub unit: Option<String>,
    /// Value in the channel's unit = `scale` * cell + `offset`; the unit's own factor is in it.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
    /// Whether EXPR scales by itself, so that the file's own unit does not count.
    pub scaled: bool,
}

impl Role {
    /// The name of the column in the project's own recordings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Time => "time_s",
            Self::Run => "run",
            Self::Channel(channel) => channel.name(),
        }
    }
    /// Every role, in the order of the columns of a recording that is written.
    pub fn all() -> impl Iterator<Item = Self> {
        [Self::Run, Self::Time].into_iter().chain(Channel::ALL.into_iter().map(Self::Channel))
    }
    /// The units that a column of this role may have; none for a run's name.
    pub fn units(self) -> Option<&'static Unit> {
        match self {
            Self::Time => Some(&units::TIME),
            Self::Run => None,
            Self::Channel(channel) => Some(channel.unit()),
        }
    }
    /// Factor and offset from `unit` to the role's own unit, or what is allowed instead.
    ///
    /// A command may be a ratio (`%`) in place of a current: a duty, a normalised command.
    pub fn conversion(self, unit: &str) -> Result<(f64, f64), String> {
        let Some(own) = self.units() else { return Err("a run's name has no unit".into()) };
        let found = |u: &'static Unit| u.spellings.iter().find(|s| s.0 == unit).map(|s| (s.1, 0.0));
        if let Some(conversion) = found(own) {
            return Ok(conversion);
        }
        let command = matches!(self, Self::Channel(Channel::Current | Channel::MeasuredCurrent));
        match (self, unit) {
            (_, _) if command && found(&units::RATIO).is_some() => Ok(found(&units::RATIO).unwrap_or((1.0, 0.0))),
            (Self::Channel(Channel::OilTemperature), "K") => Ok((1.0, -273.15)),
            (Self::Channel(Channel::OilTemperature), "C" | "deg C") => Ok((1.0, 0.0)),
            (Self::Channel(Channel::OilTemperature), "degF" | "°F") => Ok((5.0 / 9.0, -160.0 / 9.0)),
            (Self::Time, "ns") => Ok((1e-9, 0.0)),
            (Self::Time, "sec") => Ok((1.0, 0.0)),
            // As loggers write them; gauge pressure is what is meant everywhere.
            (_, "barg" | "bar(g)" | "bar_g") if own.symbol == "bar" => Ok((1.0, 0.0)),
            (_, "hPa") if own.symbol == "bar" => Ok((1e-3, 0.0)),
            (_, "N/mm2" | "N/mm²" | "N/mm^2") if own.symbol == "bar" => Ok((10.0, 0.0)),
            _ => {
                let more = match self {
                    Self::Channel(Channel::OilTemperature) => ", K, degF",
                    Self::Time => ", ns",
                    _ if command => "; or, for a command that is no current: 1, %",
                    _ => "",
                };
                let near = own.spellings.iter().map(|s| s.0).min_by_key(|s| strsim::osa_distance(&s.to_lowercase(), &unit.to_lowercase()));
                let near = near.filter(|s| strsim::osa_distance(&s.to_lowercase(), &unit.to_lowercase()) <= 1 + unit.len() / 4);
                let near = near.map_or_else(String::new, |s| format!(" (did you mean `{s}`?)"));
                Err(format!("the unit `{unit}` is not one of a {}{near}; allowed: {}{more}", own.dimension, own.allowed()))
            }
        }
    }
}

impl std::str::FromStr for Mapping {
    type Err = RecordingError;
    fn from_str(text: &str) -> Result<Self, RecordingError> {
        Self::parse(text)
    }
}

impl Mapping {
    /// Whether it names a column and nothing more, so that the file's own unit counts.
    pub fn is_bare(&self) -> bool {
        !self.scaled && self.unit.is_none()
    }

    /// Reads `CHANNEL=EXPR`.
    ///
    /// # Errors
    /// [`RecordingError::Mapping`] where CHANNEL is unknown, EXPR does not hold exactly one column, or a unit is
    /// of another dimension.
    pub fn parse(text: &str) -> Result<Self, RecordingError> {
        let error = |what: String| RecordingError::Mapping { text: text.into(), what };
        let names = || Role::all().map(Role::name).collect::<Vec<_>>().join(", ");
        let Some((channel, expr)) = text.split_once('=') else {
            return Err(error("write CHANNEL=EXPR, for instance current_a=\"I_cmd [mA]\"".into()));
        };
        let channel = channel.trim();
        let Some(role) = Role::all().find(|r| r.name() == channel) else {
            let near = Role::all().map(Role::name).min_by_key(|n| strsim::osa_distance(n, channel));
            let hint = near.filter(|n| strsim::osa_distance(n, channel) <= 3).map(|n| format!(" (did you mean `{n}`?)"));
            return Err(error(format!("no channel `{channel}`{}; allowed: {}", hint.unwrap_or_default(), names())));
        };
        let affine = Parser { text: expr, rest: expr, two: role == Role::Time }.expression().map_err(&error)?;
        if role == Role::Run && (affine.scaled || affine.unit.is_some()) {
            return Err(error("a run's name is a text: it has neither unit nor factor".into()));
        }
        let (factor, shift) = match &affine.unit {
            Some(unit) => role.conversion(unit).map_err(&error)?,
            None => (1.0, 0.0),
        };
        let (scale, offset) = (affine.scale * factor, affine.scale * shift + affine.offset);
        if !scale.is_finite() || !offset.is_finite() || scale == 0.0 {
            return Err(error("the factor must be finite and not 0".into()));
        }
        let Affine { column, second, unit, scaled, .. } = affine;
        if second.is_some() && (unit.is_some() || scaled) {
            return Err(error("a date and a time of day have neither unit nor factor".into()));
        }
        Ok(Self { role, text: expr.trim().into(), column, second, unit, scale, offset, scaled })
    }
}

/// Factor and offset of a formula that is a straight line in one variable; `None` for any other.
pub(super) fn line(formula: &str) -> Option<(f64, f64)> {
    let affine = Parser { text: formula, rest: formula, two: false }.expression().ok()?;
    affine.unit.is_none().then_some((affine.scale, affine.offset))
}

/// `scale * column [unit] + offset` as typed.
struct Affine {
    column: String,
    second: Option<String>,
    unit: Option<String>,
    scale: f64,
    offset: f64,
    scaled: bool,
}

/// A column's name with its unit.
type Named = (String, Option<String>);

/// A reader of sums of terms `number`, `number * column`, `column * number`, `column / number`.
struct Parser<'a> {
    text: &'a str,
    rest: &'a str,
    /// Whether a second column may be added: the time of day to its date.
    two: bool,
}

/// A factor of a term.
enum Factor {
    Number(f64),
    Column(String, Option<String>),
}

impl Parser<'_> {
    fn expression(mut self) -> Result<Affine, String> {
        let mut affine = Affine { column: String::new(), second: None, unit: None, scale: 0.0, offset: 0.0, scaled: false };
        let mut sign = if self.take('-') { -1.0 } else { 1.0 };
        affine.scaled = sign < 0.0;
        loop {
            let (number, column) = self.term()?;
            match column {
                None => (affine.offset, affine.scaled) = (affine.offset + sign * number, true),
                Some((name, None)) if self.two && !affine.column.is_empty() && affine.second.is_none() && sign * number == 1.0 => {
                    affine.second = Some(name);
                }
                Some(_) if !affine.column.is_empty() => return Err("it may hold one column only".into()),
                Some((name, unit)) => {
                    affine.scaled |= sign * number != 1.0;
                    (affine.column, affine.unit, affine.scale) = (name, unit, sign * number);
                }
            }
            if self.rest.trim().is_empty() {
                break;
            }
            sign = if self.take('+') {
                1.0
            } else if self.take('-') {
                -1.0
            } else {
                return Err(format!("`{}` is not understood; allowed are + - * / with numbers, and one column", self.rest.trim()));
            };
        }
        if affine.column.is_empty() { Err("it names no column".into()) } else { Ok(affine) }
    }

    fn term(&mut self) -> Result<(f64, Option<Named>), String> {
        let (mut number, mut column) = (1.0, None);
        let (mut divide, mut begin) = (false, 0);
        loop {
            let before = self.text.len() - self.rest.trim_start().len();
            match self.factor()? {
                Factor::Number(n) if divide => number /= n,
                Factor::Number(n) => number *= n,
                // `Druck / bar`, `CAN1/I_cmd`: no column may divide, so this is one name.
                Factor::Column(name, unit) if divide && column.as_ref().is_some_and(|c: &Named| c.1.is_none()) && !name.is_empty() => {
                    let text = self.text[begin..self.text.len() - self.rest.len()].trim();
                    let text = text.rfind('[').filter(|_| unit.is_some()).map_or(text, |at| text[..at].trim());
                    column = Some((text.into(), unit));
                }
                Factor::Column(..) if divide => return Err("a column may not divide".into()),
                Factor::Column(..) if column.is_some() => return Err("it may hold one column only".into()),
                Factor::Column(name, unit) => (column, begin) = (Some((name, unit)), before),
            }
            divide = if self.take('*') {
                false
            } else if self.take('/') {
                true
            } else {
                return Ok((number, column));
            };
        }
    }

    fn factor(&mut self) -> Result<Factor, String> {
        self.rest = self.rest.trim_start();
        let Some(first) = self.rest.chars().next() else {
            return Err(format!("`{}` ends where a column or a number is wanted", self.text.trim()));
        };
        if let quote @ ('"' | '\'' | '`') = first {
            let inner = &self.rest[1..];
            let end = inner.find(quote).ok_or_else(|| format!("the {quote} is not closed"))?;
            let name = inner[..end].to_string();
            self.rest = &inner[end + 1..];
            return Ok(Factor::Column(name, self.unit()?));
        }
        if first.is_ascii_digit() || first == '.' {
            let bytes = self.rest.as_bytes();
            let digit = |i: usize| bytes.get(i).is_some_and(u8::is_ascii_digit);
            let mut end = 0;
            while digit(end) || bytes.get(end) == Some(&b'.') {
                end += 1;
            }
            if matches!(bytes.get(end), Some(b'e' | b'E')) {
                let signed = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
                if digit(end + 1 + signed) {
                    end += 1 + signed;
                    while digit(end) {
                        end += 1;
                    }
                }
            }
            let text = &self.rest[..end];
            self.rest = &self.rest[end..];
            return match text.parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(Factor::Number(value)),
                _ => Err(format!("`{text}` is not a finite number")),
            };
        }
        let end = self.name_length();
        let name = self.rest[..end].trim_end().to_string();
        if name.is_empty() {
            return Err(format!("`{}` is no column's name; put a name with such characters in quotes", self.rest.trim()));
        }
        self.rest = &self.rest[end..];
        Ok(Factor::Column(name, self.unit()?))
    }

    /// A name goes on over spaces and over a hyphen between letters: `Engine speed`, `duty-cycle`.
    fn name_length(&self) -> usize {
        let letter = |c: char| c.is_alphanumeric() || "_.:#$@|\\%".contains(c) || (!c.is_ascii() && !c.is_whitespace());
        let mut previous = ' ';
        let mut chars = self.rest.char_indices().peekable();
        while let Some((at, c)) = chars.next() {
            let next = chars.peek().map_or(' ', |n| n.1);
            let hyphen = c == '-' && letter(previous) && next.is_alphabetic();
            if !(letter(c) || hyphen || (c.is_whitespace() && at > 0)) {
                return at;
            }
            previous = c;
        }
        self.rest.len()
    }

    fn unit(&mut self) -> Result<Option<String>, String> {
        if !self.take('[') {
            return Ok(None);
        }
        let end = self.rest.find(']').ok_or("the `[` of the unit is not closed")?;
        let unit = self.rest[..end].trim().to_string();
        self.rest = &self.rest[end + 1..];
        Ok(Some(unit))
    }

    fn take(&mut self, c: char) -> bool {
        let rest = self.rest.trim_start();
        match rest.strip_prefix(c) {
            Some(after) => {
                self.rest = after;
                true
            }
            None => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(text: &str) -> (String, f64, f64) {
        let mapping = Mapping::parse(text).unwrap();
        (mapping.column, mapping.scale, mapping.offset)
    }

    #[test]
    fn units_factors_and_offsets() {
        assert_eq!(read("current_a=I_cmd [mA]"), ("I_cmd".into(), 1e-3, 0.0));
        assert_eq!(read("current_a=0.01 * duty_pct"), ("duty_pct".into(), 0.01, 0.0));
        assert_eq!(read("current_a=duty [%]"), ("duty".into(), 0.01, 0.0));
        assert_eq!(read("pressure_bar = 2.5 * U_p - 1.25"), ("U_p".into(), 2.5, -1.25));
        assert_eq!(read("pressure_bar=2 * p [kPa] + 1"), ("p".into(), 0.02, 1.0));
        assert_eq!(read("pressure_bar=-1 + p/4"), ("p".into(), 0.25, -1.0));
        assert_eq!(read("pressure_bar=-p"), ("p".into(), -1.0, 0.0));
        assert_eq!(read("oil_temp_c=T [K]"), ("T".into(), 1.0, -273.15));
        assert_eq!(read("time_s=t [ms]"), ("t".into(), 1e-3, 0.0));
        assert_eq!(read("pressure_bar=\"Druck / bar\" [mbar]"), ("Druck / bar".into(), 1e-3, 0.0));
        assert_eq!(read("current_a=CAN1::Valve current-set [mA]"), ("CAN1::Valve current-set".into(), 1e-3, 0.0));
        assert_eq!(read("current_a=1e-3*I"), ("I".into(), 1e-3, 0.0));
        assert_eq!(read("run=Test name"), ("Test name".into(), 1.0, 0.0));
        assert_eq!(read("pressure_bar=Druck / bar [mbar]"), ("Druck / bar".into(), 1e-3, 0.0));
        assert_eq!(read("current_a=0.5 * CAN1/I_cmd [mA]"), ("CAN1/I_cmd".into(), 5e-4, 0.0));
        let time = Mapping::parse("time_s=Datum + Zeit").unwrap();
        assert_eq!((time.column.as_str(), time.second.as_deref(), time.scaled), ("Datum", Some("Zeit"), false));
    }

    #[test]
    fn what_cannot_be_is_refused_with_what_is_allowed() {
        let message = |text: &str| Mapping::parse(text).unwrap_err().to_string();
        insta::assert_snapshot!(message("I_cmd"), @r#"--map I_cmd: write CHANNEL=EXPR, for instance current_a="I_cmd [mA]""#);
        insta::assert_snapshot!(message("presure_bar=p"), @"--map presure_bar=p: no channel `presure_bar` (did you mean `pressure_bar`?); allowed: run, time_s, current_a, pressure_bar, target_bar, current_meas_a, oil_temp_c, supply_bar");
        insta::assert_snapshot!(message("current_a=p [bar]"), @"--map current_a=p [bar]: the unit `bar` is not one of a current; allowed: A, mA, uA; or, for a command that is no current: 1, %");
        insta::assert_snapshot!(message("pressure_bar=a + b"), @"--map pressure_bar=a + b: it may hold one column only");
        insta::assert_snapshot!(message("pressure_bar=a * b"), @"--map pressure_bar=a * b: it may hold one column only");
        insta::assert_snapshot!(message("pressure_bar=1 / b"), @"--map pressure_bar=1 / b: a column may not divide");
        insta::assert_snapshot!(message("pressure_bar=3"), @"--map pressure_bar=3: it names no column");
        insta::assert_snapshot!(message("pressure_bar=0 * p"), @"--map pressure_bar=0 * p: the factor must be finite and not 0");
        insta::assert_snapshot!(message("pressure_bar=p [bar"), @"--map pressure_bar=p [bar: the `[` of the unit is not closed");
        insta::assert_snapshot!(message("pressure_bar=2 *"), @"--map pressure_bar=2 *: `2 *` ends where a column or a number is wanted");
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "\\PC*") {
            let _ = Mapping::parse(&text);
            let _ = Mapping::parse(&format!("current_a={text}"));
        }

        #[test]
        fn a_line_reads_back(scale in -1e3f64..1e3, offset in 0f64..1e3) {
            prop_assume!(scale != 0.0);
            let (_, s, o) = read(&format!("pressure_bar={scale} * x + {offset}"));
            prop_assert_eq!((s, o), (scale, offset));
        }
    }
}
