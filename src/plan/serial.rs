//! Serial numbers: their form, their check character, and what is wrong with one that was typed or scanned.

use serde::{Deserialize, Serialize};

/// How the last character of a serial number guards the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CheckCharacter {
    /// None.
    #[default]
    None,
    /// Luhn's modulus 10 over the digits (ISO/IEC 7812-1).
    Luhn,
    /// Modulus 37, 36 over digits and letters (ISO/IEC 7064).
    Mod3736,
}

/// The form of the serial numbers of a part number.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SerialForm {
    /// `#` a digit, `@` a letter, `?` a digit or letter, everything else itself: `"AB-####-@"`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pattern: Option<String>,
    /// The check character at the end.
    #[serde(default)]
    pub check: CheckCharacter,
}

/// What is wrong with a serial number.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SerialError {
    /// Nothing, or only blanks.
    #[error("the serial number is blank")]
    Blank,
    /// A character that no serial number may hold.
    #[error("`{serial}` holds {character:?}; letters, digits and - _ . / # + are allowed")]
    Character {
        /// As typed.
        serial: String,
        /// The character.
        character: char,
    },
    /// Too long for a label and for a file name.
    #[error("`{serial}` has {length} characters; at most 64 are allowed")]
    Long {
        /// As typed.
        serial: String,
        /// Its length.
        length: usize,
    },
    /// Not of the form.
    #[error("`{serial}` is not of the form `{pattern}` (# digit, @ letter, ? either)")]
    Pattern {
        /// As typed.
        serial: String,
        /// The form.
        pattern: String,
    },
    /// The check character does not fit.
    #[error("`{serial}` ends with {found:?}; its check character should be {expected:?}: a misread or mistyped number")]
    Check {
        /// As typed.
        serial: String,
        /// Its last character.
        found: char,
        /// What the others demand.
        expected: char,
    },
}

impl SerialForm {
    /// The serial number without the blanks around it, or what is wrong with it.
    pub fn check(&self, typed: &str) -> Result<String, SerialError> {
        let serial = typed.trim();
        if serial.is_empty() {
            return Err(SerialError::Blank);
        }
        if let Some(character) = serial.chars().find(|c| !(c.is_ascii_alphanumeric() || "-_./#+".contains(*c))) {
            return Err(SerialError::Character { serial: serial.into(), character });
        }
        if serial.len() > 64 {
            return Err(SerialError::Long { serial: serial.into(), length: serial.len() });
        }
        if let Some(pattern) = &self.pattern {
            let fits = pattern.chars().count() == serial.len()
                && pattern.chars().zip(serial.chars()).all(|(p, c)| match p {
                    '#' => c.is_ascii_digit(),
                    '@' => c.is_ascii_alphabetic(),
                    '?' => c.is_ascii_alphanumeric(),
                    p => p == c,
                });
            if !fits {
                return Err(SerialError::Pattern { serial: serial.into(), pattern: pattern.clone() });
            }
        }
        let (body, found) = serial.split_at(serial.len() - 1);
        let found = found.chars().next().unwrap_or(' ');
        let expected = match self.check {
            CheckCharacter::None => return Ok(serial.into()),
            CheckCharacter::Luhn => luhn(body),
            CheckCharacter::Mod3736 => mod_37_36(body),
        };
        if found.to_ascii_uppercase() == expected {
            Ok(serial.into())
        } else {
            Err(SerialError::Check { serial: serial.into(), found, expected })
        }
    }
}

/// Luhn's check digit for the digits of `body`; other characters do not count.
fn luhn(body: &str) -> char {
    let digits = body.chars().rev().filter_map(|c| c.to_digit(10));
    let sum: u32 = digits.enumerate().map(|(i, d)| if i % 2 == 0 { 2 * d / 10 + 2 * d % 10 } else { d }).sum();
    char::from_digit((10 - sum % 10) % 10, 10).unwrap_or('0')
}

/// The ISO/IEC 7064 MOD 37,36 check character for the letters and digits of `body`.
fn mod_37_36(body: &str) -> char {
    let mut product = 36;
    for value in body.chars().filter_map(|c| c.to_digit(36)) {
        let sum = match (product + value) % 36 {
            0 => 36,
            s => s,
        };
        product = 2 * sum % 37;
    }
    char::from_digit((37 - product) % 36, 36).unwrap_or('0').to_ascii_uppercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_form_is_held() {
        let form = SerialForm { pattern: Some("AB-##@".into()), check: CheckCharacter::None };
        assert_eq!(form.check("  AB-12x\r\n").unwrap(), "AB-12x");
        insta::assert_snapshot!(form.check("AB-1234").unwrap_err(), @"`AB-1234` is not of the form `AB-##@` (# digit, @ letter, ? either)");
        assert_eq!(form.check(" \t").unwrap_err(), SerialError::Blank);
        assert!(matches!(SerialForm::default().check("../x y"), Err(SerialError::Character { character: ' ', .. })));
    }

    /// The account number of the usual description of Luhn's algorithm (US patent 2950048): 7992739871 with check digit 3.
    #[test]
    fn luhn_of_the_known_number() {
        let form = SerialForm { pattern: None, check: CheckCharacter::Luhn };
        assert!(form.check("79927398713").is_ok());
        insta::assert_snapshot!(form.check("79927398731").unwrap_err(), @"`79927398731` ends with '1'; its check character should be '9': a misread or mistyped number");
    }

    /// The example of the Global Release Identifier (IFPI GRid standard, MOD 37,36): A1-2425G-ABC1234002-M.
    #[test]
    fn mod_37_36_of_the_known_identifier() {
        let form = SerialForm { pattern: None, check: CheckCharacter::Mod3736 };
        assert!(form.check("A1-2425G-ABC1234002-M").is_ok());
        assert!(form.check("A1-2425G-ABC1234020-M").is_err());
    }

    /// Every single wrong digit and every swap of neighbours is found by MOD 37,36.
    #[test]
    fn mod_37_36_finds_the_usual_errors() {
        let form = SerialForm { pattern: None, check: CheckCharacter::Mod3736 };
        let good = "A12425GABC1234002M";
        assert!(form.check(good).is_ok());
        for i in 0..good.len() {
            for c in ('0'..='9').chain('A'..='Z').filter(|c| *c != good.as_bytes()[i] as char) {
                let mut wrong = good.to_string();
                wrong.replace_range(i..=i, &c.to_string());
                assert!(form.check(&wrong).is_err(), "{wrong}");
            }
        }
        for i in 0..good.len() - 2 {
            let mut bytes = good.as_bytes().to_vec();
            bytes.swap(i, i + 1);
            let wrong = String::from_utf8(bytes).unwrap();
            assert!(wrong == good || form.check(&wrong).is_err(), "{wrong}");
        }
    }
}
