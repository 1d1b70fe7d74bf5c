//! The channels that `hil` knows.

use crate::units::{self, Unit};

/// The channels that `hil` knows, by the names of the recording format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Channel {
    /// `current_a`: the commanded current [A].
    Current,
    /// `pressure_bar`: the measured pressure [bar].
    Pressure,
    /// `target_bar`: the pressure that the controller was asked for [bar].
    Target,
    /// `current_meas_a`: the measured current [A].
    MeasuredCurrent,
    /// `oil_temp_c`: oil temperature [degC].
    OilTemperature,
    /// `supply_bar`: supply pressure [bar].
    Supply,
}

impl Channel {
    /// Number of channels.
    pub const COUNT: usize = 6;
    /// Every channel, in the order of the columns of a recording that is written.
    pub const ALL: [Self; Self::COUNT] =
        [Self::Current, Self::Pressure, Self::Target, Self::MeasuredCurrent, Self::OilTemperature, Self::Supply];

    /// Name of the column.
    pub fn name(self) -> &'static str {
        match self {
            Self::Current => "current_a",
            Self::Pressure => "pressure_bar",
            Self::Target => "target_bar",
            Self::MeasuredCurrent => "current_meas_a",
            Self::OilTemperature => "oil_temp_c",
            Self::Supply => "supply_bar",
        }
    }
    /// Unit that its values are kept in.
    pub fn unit(self) -> &'static Unit {
        match self {
            Self::Current | Self::MeasuredCurrent => &units::CURRENT,
            Self::Pressure | Self::Target | Self::Supply => &units::PRESSURE,
            Self::OilTemperature => &units::TEMPERATURE,
        }
    }
    /// Place in [`Channel::ALL`].
    pub fn index(self) -> usize {
        self as usize
    }
}
