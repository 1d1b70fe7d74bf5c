//! Why no model can be identified from a recording.

/// Why no model can be identified.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IdentifyError {
    /// A channel that identification needs is absent or empty.
    #[error("{source_name}: no `{channel}` to identify from; a foreign channel comes in by `--map {channel}=\"CHANNEL [unit]\"`")]
    MissingChannel {
        /// Name of the recording.
        source_name: String,
        /// The channel.
        channel: &'static str,
    },
    /// Too few samples with current and pressure.
    #[error("{source_name}: {samples} samples with current and pressure; at least {wanted} are needed")]
    TooShort {
        /// Name of the recording.
        source_name: String,
        /// Samples found.
        samples: usize,
        /// Samples needed.
        wanted: usize,
    },
    /// The current does not move.
    #[error("{source_name}: the current stays within {span_a:.6} A around {mean_a:.4} A, so no curve can be found; a sweep is wanted")]
    ConstantCurrent {
        /// Name of the recording.
        source_name: String,
        /// Range of the current [A].
        span_a: f64,
        /// Mean current [A].
        mean_a: f64,
    },
    /// The pressure does not follow the current.
    #[error(
        "{source_name}: the pressure stays within {span_bar:.4} bar (noise {noise_bar:.4} bar) while the current moves: nothing to identify"
    )]
    ConstantPressure {
        /// Name of the recording.
        source_name: String,
        /// Range of the pressure [bar].
        span_bar: f64,
        /// Noise of the pressure [bar].
        noise_bar: f64,
    },
    /// An option that cannot be.
    #[error("{option}: {problem}")]
    Option {
        /// The option as typed.
        option: &'static str,
        /// What is wrong and what is allowed.
        problem: String,
    },
    /// The fit left the numbers.
    #[error("{source_name}: the fit did not converge to finite values; check the units of current and pressure")]
    NotFinite {
        /// Name of the recording.
        source_name: String,
    },
}
