//! What no model can be compared with, and why: the refusals that all commands share.

/// Why a recording cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CourseError {
    /// A channel that is needed is absent or empty.
    #[error("{source_name}: no `{channel}` to work with; a foreign channel comes in by `--map {channel}=\"CHANNEL [unit]\"`")]
    MissingChannel {
        /// Name of the recording.
        source_name: String,
        /// The channel.
        channel: &'static str,
    },
    /// Current and pressure are both there, but never at the same time.
    #[error(
        "{source_name}: current and pressure have no time in common: the current is recorded {current_s}, the pressure {pressure_s}; is one clock off?"
    )]
    NothingInCommon {
        /// Name of the recording.
        source_name: String,
        /// When the current is recorded.
        current_s: String,
        /// When the pressure is.
        pressure_s: String,
    },
    /// Too few readings beside a known current.
    #[error("{source_name}: {readings} samples with current and pressure; at least {wanted} are needed")]
    TooShort {
        /// Name of the recording.
        source_name: String,
        /// Readings found.
        readings: usize,
        /// Readings needed.
        wanted: usize,
    },
    /// The current does not move.
    #[error(
        "{source_name}: the current is constant: it stays within {span_a:.6} A around {mean_a:.4} A, so nothing shows how the pressure follows it; a sweep is wanted"
    )]
    ConstantCurrent {
        /// Name of the recording.
        source_name: String,
        /// Range of the current [A].
        span_a: f64,
        /// Mean current [A].
        mean_a: f64,
    },
    /// The pressure does not move.
    #[error(
        "{source_name}: the pressure is constant: it stays within {span_bar:.4} bar (noise {noise_bar:.4} bar) while the current moves; is the sensor alive, and is it this valve's?"
    )]
    ConstantPressure {
        /// Name of the recording.
        source_name: String,
        /// Range of the pressure [bar].
        span_bar: f64,
        /// Noise of the pressure [bar].
        noise_bar: f64,
    },
    /// A run that was asked for and is not there.
    #[error("{source_name}: no run `{run}`; there are: {known}")]
    NoSuchRun {
        /// Name of the recording.
        source_name: String,
        /// The run as asked for.
        run: String,
        /// The runs that are there.
        known: String,
    },
    /// A selection of time that leaves nothing.
    #[error("{source_name}: no sample lies in the stretch that was asked for; the recording goes {recorded}")]
    NothingSelected {
        /// Name of the recording.
        source_name: String,
        /// The times that are there.
        recorded: String,
    },
}
