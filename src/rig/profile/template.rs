//! Lines of text with values in them: the requests and replies of a line driver.
//!
//! `"CUR {setpoint mA .1} {token x4}"`: in braces the signal, for a quantity its unit and its decimals, for a word
//! `d` or `x` and the number of digits. Everything else is literal.

use super::cycle_file::Checksum;
use super::signal::SignalName;

/// One piece of a template.
#[derive(Debug, Clone, PartialEq)]
pub enum Piece {
    /// Text as it stands.
    Literal(String),
    /// A value of a signal.
    Value {
        /// The signal.
        name: SignalName,
        /// Canonical unit per printed unit; 1 for a word.
        factor: f64,
        /// How it is written.
        format: NumberFormat,
    },
}

/// How a number is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NumberFormat {
    /// Decimal number with so many decimals.
    Decimal(usize),
    /// Whole number, padded with zeros to so many digits.
    Whole(usize),
    /// Upper-case hex, padded with zeros to so many digits.
    Hex(usize),
}

/// A line with its values, terminator and checksum.
#[derive(Debug, Clone, PartialEq)]
pub struct Template {
    /// The pieces in their order.
    pub pieces: Vec<Piece>,
    /// End of the line.
    pub terminator: String,
    /// Checksum behind the text.
    pub checksum: Checksum,
}

impl Template {
    /// Reads a template; the message says what is wrong and what is allowed.
    pub fn parse(text: &str, terminator: &str, checksum: Checksum) -> Result<Self, String> {
        if !text.is_ascii() {
            return Err(format!("`{text}`: a line of ASCII text is wanted"));
        }
        let mut pieces = Vec::new();
        let mut rest = text;
        while let Some(open) = rest.find('{') {
            let close = rest[open..].find('}').map(|c| open + c).ok_or_else(|| format!("`{text}`: `{{` without `}}`"))?;
            if open > 0 {
                pieces.push(Piece::Literal(rest[..open].into()));
            } else if matches!(pieces.last(), Some(Piece::Value { .. })) {
                return Err(format!("`{text}`: two values without text between them cannot be told apart"));
            }
            pieces.push(value(&rest[open + 1..close])?);
            rest = &rest[close + 1..];
        }
        if !rest.is_empty() {
            pieces.push(Piece::Literal(rest.into()));
        }
        if pieces.is_empty() {
            return Err(format!("`{text}`: a line of ASCII text is wanted"));
        }
        if terminator.is_empty() || !terminator.is_ascii() {
            return Err("`terminator` must be one or more ASCII characters, for instance \"\\r\\n\"".into());
        }
        Ok(Self { pieces, terminator: terminator.into(), checksum })
    }

    /// The signals in the line.
    pub fn signals(&self) -> impl Iterator<Item = SignalName> + '_ {
        self.pieces.iter().filter_map(|p| if let Piece::Value { name, .. } = p { Some(*name) } else { None })
    }

    /// Longest line in characters, for the wire budget: eight for a decimal number.
    pub fn longest(&self) -> u16 {
        let text: usize = self
            .pieces
            .iter()
            .map(|p| match p {
                Piece::Literal(text) => text.len(),
                Piece::Value { format: NumberFormat::Decimal(_), .. } => 8,
                Piece::Value { format: NumberFormat::Whole(n) | NumberFormat::Hex(n), .. } => (*n).max(1),
            })
            .sum();
        let checksum = match self.checksum {
            Checksum::None => 0,
            Checksum::Xor => 3,
            Checksum::Sum8 => 2,
            Checksum::Crc16 => 4,
        };
        u16::try_from(text + checksum + self.terminator.len()).unwrap_or(u16::MAX)
    }

    /// Writes the line with the values that `value` gives, in canonical units.
    pub fn write(&self, out: &mut Vec<u8>, value: impl Fn(SignalName) -> f64) {
        use std::io::Write;
        let start = out.len();
        for piece in &self.pieces {
            // Writing to a vector cannot fail.
            let _ = match piece {
                Piece::Literal(text) => out.write_all(text.as_bytes()),
                Piece::Value { name, factor, format } => match format {
                    NumberFormat::Decimal(n) => write!(out, "{:.n$}", value(*name) / factor, n = *n),
                    NumberFormat::Whole(n) => write!(out, "{:0n$}", value(*name) as i64, n = *n),
                    NumberFormat::Hex(n) => write!(out, "{:0n$X}", value(*name) as i64 & 0xFFFF, n = *n),
                },
            };
        }
        let sum = checksum_text(self.checksum, &out[start..]);
        out.extend_from_slice(sum.as_bytes());
        out.extend_from_slice(self.terminator.as_bytes());
    }

    /// Reads the values of a line without its terminator; `None` where it does not have this form.
    pub fn read(&self, line: &[u8], mut found: impl FnMut(SignalName, f64)) -> Option<()> {
        let length = checksum_text(self.checksum, b"").len();
        let (text, sum) = line.split_at_checked(line.len().checked_sub(length)?)?;
        if checksum_text(self.checksum, text).as_bytes() != sum {
            return None;
        }
        let mut rest = std::str::from_utf8(text).ok()?;
        for piece in &self.pieces {
            match piece {
                Piece::Literal(literal) => rest = rest.strip_prefix(literal.as_str())?,
                Piece::Value { name, factor, format } => {
                    let belongs = |c: char| match format {
                        NumberFormat::Hex(_) => c.is_ascii_hexdigit(),
                        _ => c.is_ascii_digit() || matches!(c, '+' | '-' | '.'),
                    };
                    let end = rest.find(|c| !belongs(c)).unwrap_or(rest.len());
                    let raw = match format {
                        NumberFormat::Hex(_) => f64::from(u16::from_str_radix(&rest[..end], 16).ok()?),
                        NumberFormat::Decimal(_) => rest[..end].parse::<f64>().ok()?,
                        NumberFormat::Whole(_) => rest[..end].parse::<i32>().ok().map(f64::from)?,
                    };
                    found(*name, raw * factor);
                    rest = &rest[end..];
                }
            }
        }
        rest.is_empty().then_some(())
    }
}

fn value(inside: &str) -> Result<Piece, String> {
    let mut words = inside.split_whitespace();
    let name = words.next().unwrap_or_default();
    let names: Vec<&str> = SignalName::ALL.iter().map(|n| n.as_str()).collect();
    let name = SignalName::parse(name).ok_or_else(|| format!("`{{{inside}}}`: unknown signal; known: {}", names.join(", ")))?;
    let wrong = |what: &str| format!("`{{{inside}}}`: {what}");
    let digits = |text: &str| text.parse::<usize>().ok().filter(|n| *n <= 9);
    if let Some(unit) = name.unit() {
        let spelling = words.next().ok_or_else(|| wrong(&format!("a unit is wanted behind the signal, one of: {}", unit.allowed())))?;
        let factor = unit.spellings.iter().find(|s| s.0 == spelling).map(|s| s.1);
        let factor =
            factor.ok_or_else(|| wrong(&format!("`{spelling}` is not a unit of {}; allowed: {}", unit.dimension, unit.allowed())))?;
        let format = words.next().unwrap_or(".3");
        let decimals = format.strip_prefix('.').and_then(digits).ok_or_else(|| wrong("the format is `.N`, N decimals"))?;
        return Ok(Piece::Value { name, factor, format: NumberFormat::Decimal(decimals) });
    }
    let format = words.next().unwrap_or("d");
    let (kind, n) = format.split_at(format.len().min(1));
    let n = if n.is_empty() { Some(1) } else { digits(n) };
    match (kind, n) {
        ("d", Some(n)) => Ok(Piece::Value { name, factor: 1.0, format: NumberFormat::Whole(n) }),
        ("x", Some(n)) => Ok(Piece::Value { name, factor: 1.0, format: NumberFormat::Hex(n) }),
        _ => Err(wrong("the format is `d` or `x`, with the number of digits: `x4`")),
    }
}

/// CRC-16/MODBUS: polynomial 0xA001 reflected, start 0xFFFF.
pub fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| (0..8).fold(crc ^ u16::from(*byte), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xA001 } else { c >> 1 }))
}

fn checksum_text(kind: Checksum, text: &[u8]) -> String {
    match kind {
        Checksum::None => String::new(),
        Checksum::Xor => format!("*{:02X}", text.iter().fold(0, |x, b| x ^ b)),
        Checksum::Sum8 => format!("{:02X}", text.iter().fold(0u8, |x, b| x.wrapping_add(*b))),
        Checksum::Crc16 => format!("{:04X}", crc16(text)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn template(text: &str, checksum: Checksum) -> Template {
        Template::parse(text, "\r\n", checksum).unwrap()
    }

    #[test]
    fn a_request_is_written_in_the_unit_of_the_device() {
        let mut out = Vec::new();
        let value = |name| if name == SignalName::Setpoint { 0.4512 } else { 255.0 };
        template("CUR {setpoint mA .1} {token x4}", Checksum::Xor).write(&mut out, value);
        assert_eq!(String::from_utf8(out).unwrap(), "CUR 451.2 00FF*68\r\n");
    }

    #[test]
    fn a_reply_of_another_form_is_refused() {
        let reply = template("OK {token x4} {pressure bar .3}", Checksum::None);
        let read = |line: &str| {
            let mut values = Vec::new();
            reply.read(line.as_bytes(), |n, v| values.push((n, v))).map(|()| values)
        };
        assert_eq!(read("OK 00FF 12.500"), Some(vec![(SignalName::Token, 255.0), (SignalName::Pressure, 12.5)]));
        for wrong in ["", "OK", "OK 00FF", "OK 00FF 12.5 ", "OK 00FF 1-2", "ok 00FF 12.5", "OK 12345 12.5", "\u{ff}OK 00FF 12.5"] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn the_crc_is_that_of_the_specification() {
        // CRC-16/MODBUS check value of "123456789".
        assert_eq!(crc16(b"123456789"), 0x4B37);
    }

    #[test]
    fn messages_say_what_is_allowed() {
        let message = |text: &str| Template::parse(text, "\n", Checksum::None).unwrap_err();
        insta::assert_snapshot!(message("{setpoint}"), @"`{setpoint}`: a unit is wanted behind the signal, one of: A, mA, uA");
        insta::assert_snapshot!(message("{setpoint bar}"), @"`{setpoint bar}`: `bar` is not a unit of current; allowed: A, mA, uA");
        insta::assert_snapshot!(message("{flow bar}"), @"`{flow bar}`: unknown signal; known: setpoint, control, token, status, counter, current, pressure, supply, oil_temp");
        insta::assert_snapshot!(message("{token q}"), @"`{token q}`: the format is `d` or `x`, with the number of digits: `x4`");
        insta::assert_snapshot!(message("{token}{status}"), @"`{token}{status}`: two values without text between them cannot be told apart");
        insta::assert_snapshot!(message("a{token"), @"`a{token`: `{` without `}`");
        insta::assert_snapshot!(message("{token \u{fffd}4}"), @"`{token �4}`: a line of ASCII text is wanted");
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back(token in 0u16.., pressure in -5.0f64..50.0, kind in 0usize..4) {
            let checksum = [Checksum::None, Checksum::Xor, Checksum::Sum8, Checksum::Crc16][kind];
            let t = template("V {token d} P{pressure mbar .2};", checksum);
            let mut out = Vec::new();
            t.write(&mut out, |n| if n == SignalName::Token { f64::from(token) } else { pressure });
            let mut values = Vec::new();
            t.read(out.strip_suffix(b"\r\n").unwrap(), |_, v| values.push(v)).unwrap();
            prop_assert_eq!(values[0], f64::from(token));
            prop_assert!((values[1] - pressure).abs() < 1e-5);
        }

        #[test]
        fn no_line_panics(line in proptest::collection::vec(any::<u8>(), 0..40)) {
            let t = template("V {token d} P{pressure mbar .2};", Checksum::Crc16);
            let _ = t.read(&line, |_, _| ());
        }
    }
}
