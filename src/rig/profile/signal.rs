//! One value of a device: its place, its raw type, and the straight line between counts and the unit.

use std::fmt;

use super::file::{RawType, Table, WordOrder};
use crate::units::{CURRENT, PRESSURE, TEMPERATURE, Unit};

/// The signals that a profile can have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SignalName {
    /// The commanded current.
    Setpoint,
    /// A constant word written with every set-point.
    Control,
    /// A word given back as written.
    Token,
    /// Status bits.
    Status,
    /// Counter of conversions.
    Counter,
    /// The measured current.
    Current,
    /// The measured pressure.
    Pressure,
    /// The supply pressure.
    Supply,
    /// The oil temperature.
    OilTemp,
}

impl SignalName {
    /// Every name, in the order in which a profile lists them.
    pub const ALL: [Self; 9] = [
        Self::Setpoint,
        Self::Control,
        Self::Token,
        Self::Status,
        Self::Counter,
        Self::Current,
        Self::Pressure,
        Self::Supply,
        Self::OilTemp,
    ];

    /// The name as a profile spells it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Setpoint => "setpoint",
            Self::Control => "control",
            Self::Token => "token",
            Self::Status => "status",
            Self::Counter => "counter",
            Self::Current => "current",
            Self::Pressure => "pressure",
            Self::Supply => "supply",
            Self::OilTemp => "oil_temp",
        }
    }

    /// The signal of that name.
    pub fn parse(text: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|n| n.as_str() == text)
    }

    /// The unit of its value; `None` for words that are not a quantity.
    pub fn unit(self) -> Option<&'static Unit> {
        match self {
            Self::Setpoint | Self::Current => Some(&CURRENT),
            Self::Pressure | Self::Supply => Some(&PRESSURE),
            Self::OilTemp => Some(&TEMPERATURE),
            Self::Control | Self::Token | Self::Status | Self::Counter => None,
        }
    }
}

impl fmt::Display for SignalName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// A bit of a status word that means a fault in one of its states.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FaultBit {
    /// Name of the bit.
    pub name: String,
    /// Its number, 0 the lowest.
    pub bit: u8,
    /// The state that means a fault.
    pub fault_when: bool,
}

/// A signal after the checks.
#[derive(Debug, Clone, PartialEq)]
pub struct Signal {
    /// Which value it is.
    pub name: SignalName,
    /// Modbus table; meaningless for a line driver.
    pub table: Table,
    /// Zero-based protocol address; meaningless for a line driver.
    pub address: u16,
    /// Unit id.
    pub unit_id: u8,
    /// Raw type.
    pub kind: RawType,
    /// Order of the words of a 32-bit value.
    pub order: WordOrder,
    /// Value of one count, in the canonical unit.
    pub scale: f64,
    /// Value of 0 counts, in the canonical unit.
    pub offset: f64,
    /// Raw values that the sensor can deliver.
    pub valid_raw: Option<(f64, f64)>,
    /// Values that are plausible, in the canonical unit.
    pub valid: Option<(f64, f64)>,
    /// Constant of a control word.
    pub constant: u16,
    /// Value of a control word in the safe state.
    pub safe: Option<u16>,
    /// Bits that mean a fault.
    pub faults: Vec<FaultBit>,
    /// All bits by name, for people.
    pub bits: Vec<(String, u8)>,
    /// Time after which an unchanged raw value is a frozen sensor [s].
    pub frozen_after_s: Option<f64>,
    /// Counts a second of a counter, where it is not the rate of the device [Hz].
    pub rate_hz: Option<f64>,
}

impl Signal {
    /// Number of registers.
    pub fn words(&self) -> u16 {
        match self.kind {
            RawType::U16 | RawType::I16 => 1,
            RawType::U32 | RawType::I32 | RawType::F32 => 2,
        }
    }

    /// The raw number nearest to `value`; `None` where the raw type cannot hold it.
    pub fn to_raw(&self, value: f64) -> Option<f64> {
        let raw = (value - self.offset) / self.scale;
        let (raw, low, high) = match self.kind {
            RawType::U16 => (raw.round(), 0.0, f64::from(u16::MAX)),
            RawType::I16 => (raw.round(), f64::from(i16::MIN), f64::from(i16::MAX)),
            RawType::U32 => (raw.round(), 0.0, f64::from(u32::MAX)),
            RawType::I32 => (raw.round(), f64::from(i32::MIN), f64::from(i32::MAX)),
            RawType::F32 => (f64::from(raw as f32), f64::from(f32::MIN), f64::from(f32::MAX)),
        };
        (raw >= low && raw <= high).then_some(raw)
    }

    /// The value of a raw number, in the canonical unit.
    pub fn from_raw(&self, raw: f64) -> f64 {
        raw * self.scale + self.offset
    }

    /// The registers of a raw number, the first at the signal's address; one or two of them are used.
    pub fn encode(&self, raw: f64) -> [u16; 2] {
        let pair = |bits: u32| {
            let (high, low) = ((bits >> 16) as u16, bits as u16);
            if self.order == WordOrder::Big { [high, low] } else { [low, high] }
        };
        match self.kind {
            RawType::U16 => [raw as u16, 0],
            RawType::I16 => [(raw as i16) as u16, 0],
            RawType::U32 => pair(raw as u32),
            RawType::I32 => pair((raw as i32) as u32),
            RawType::F32 => pair((raw as f32).to_bits()),
        }
    }

    /// The raw number in `registers`; `None` where there are too few.
    pub fn decode(&self, registers: &[u16]) -> Option<f64> {
        let first = *registers.first()?;
        if self.words() == 1 {
            return Some(if self.kind == RawType::I16 { f64::from(first as i16) } else { f64::from(first) });
        }
        let second = *registers.get(1)?;
        let (high, low) = if self.order == WordOrder::Big { (first, second) } else { (second, first) };
        let bits = (u32::from(high) << 16) | u32::from(low);
        Some(match self.kind {
            RawType::I32 => f64::from(bits as i32),
            RawType::F32 => f64::from(f32::from_bits(bits)),
            _ => f64::from(bits),
        })
    }

    /// Whether the sensor can deliver this raw number and the value is plausible.
    pub fn plausible(&self, raw: f64) -> bool {
        let value = self.from_raw(raw);
        let inside = |window: Option<(f64, f64)>, x: f64| window.is_none_or(|(low, high)| x >= low && x <= high);
        raw.is_finite() && inside(self.valid_raw, raw) && inside(self.valid, value)
    }

    /// The first bit that reports a fault in this status word.
    pub fn fault(&self, word: u16) -> Option<&FaultBit> {
        self.faults.iter().find(|f| ((word >> f.bit) & 1 == 1) == f.fault_when)
    }

    /// A status word without any fault.
    pub fn healthy_word(&self) -> u16 {
        self.faults.iter().filter(|f| !f.fault_when).fold(0, |word, f| word | (1 << f.bit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn signal(kind: RawType, order: WordOrder) -> Signal {
        Signal {
            name: SignalName::Pressure,
            table: Table::Holding,
            address: 0,
            unit_id: 1,
            kind,
            order,
            scale: 0.01,
            offset: -2.0,
            valid_raw: None,
            valid: None,
            constant: 0,
            safe: None,
            faults: vec![],
            bits: vec![],
            frozen_after_s: None,
            rate_hz: None,
        }
    }

    #[test]
    fn word_order_is_what_the_data_sheet_says() {
        let big = signal(RawType::F32, WordOrder::Big);
        // 1.0 as IEEE 754 is 3F80 0000.
        assert_eq!(big.encode(1.0), [0x3F80, 0]);
        assert_eq!(signal(RawType::F32, WordOrder::Little).encode(1.0), [0, 0x3F80]);
        assert_eq!(signal(RawType::I32, WordOrder::Big).encode(-2.0), [0xFFFF, 0xFFFE]);
        assert_eq!(signal(RawType::I16, WordOrder::Big).decode(&[0xFFFE]), Some(-2.0));
    }

    #[test]
    fn a_value_that_does_not_fit_is_refused() {
        assert_eq!(signal(RawType::U16, WordOrder::Big).to_raw(-2.01), None);
        assert_eq!(signal(RawType::I16, WordOrder::Big).to_raw(-2.01), Some(-1.0));
        assert_eq!(signal(RawType::U16, WordOrder::Big).to_raw(1e6), None);
        assert_eq!(signal(RawType::U16, WordOrder::Big).to_raw(f64::NAN), None);
    }

    #[test]
    fn nan_and_infinity_are_implausible() {
        let s = signal(RawType::F32, WordOrder::Big);
        for (raw, ok) in [(f64::NAN, false), (f64::INFINITY, false), (f64::NEG_INFINITY, false), (12.0, true)] {
            assert_eq!(s.plausible(raw), ok, "{raw}");
        }
    }

    proptest! {
        #[test]
        fn encoding_and_decoding_is_the_identity(raw in i32::MIN..i32::MAX, little: bool) {
            let order = if little { WordOrder::Little } else { WordOrder::Big };
            let s = signal(RawType::I32, order);
            prop_assert_eq!(s.decode(&s.encode(f64::from(raw))), Some(f64::from(raw)));
        }
    }
}
