//! What can be wrong with the physics of a model.

/// What can be wrong with the physics of a model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PhysicsError {
    /// No effect of that id.
    #[error("no effect `{id}`{hint}; there are: {known}")]
    UnknownEffect {
        /// The id as typed.
        id: String,
        /// "did you mean" or nothing.
        hint: String,
        /// The known ids.
        known: String,
    },
    /// No parameter of that name.
    #[error("effect `{effect}` has no parameter `{name}`; there are: {known}")]
    UnknownParameter {
        /// The effect.
        effect: String,
        /// The name as typed.
        name: String,
        /// The known names.
        known: String,
    },
    /// A parameter that has no default is not given.
    #[error("effect `{effect}` wants its parameter `{name}` ({meaning})")]
    MissingParameter {
        /// The effect.
        effect: String,
        /// The parameter.
        name: String,
        /// Its meaning.
        meaning: String,
    },
    /// A value that is no quantity of the wanted dimension.
    #[error("effect `{effect}`, parameter `{name}`: {source}")]
    Quantity {
        /// The effect.
        effect: String,
        /// The parameter.
        name: String,
        /// What is wrong.
        source: Box<crate::units::UnitError>,
    },
    /// A formula that is none.
    #[error("effect `{effect}`, `{name}`: {problem}")]
    Formula {
        /// The effect.
        effect: String,
        /// The key.
        name: String,
        /// What is wrong.
        problem: String,
    },
    /// A value outside what physics allows.
    #[error("effect `{effect}`, parameter `{name}`: {value} is outside {low} to {high}")]
    OutOfRange {
        /// The effect.
        effect: String,
        /// The parameter.
        name: String,
        /// The value with its unit.
        value: String,
        /// Smallest allowed value.
        low: String,
        /// Largest allowed value.
        high: String,
    },
    /// Times that do not increase, or no samples.
    #[error("{0}")]
    Input(String),
    /// A simulation that leaves the numbers.
    #[error("the simulation has no finite pressure from sample {sample}{of_run} ({time_s} s) on: {cause}")]
    NotFinite {
        /// Which run, in words; empty where there is one only.
        of_run: String,
        /// The first such sample, counted from 1.
        sample: usize,
        /// Its time [s].
        time_s: f64,
        /// The effect and the parameter that make it so.
        cause: String,
    },
}

impl PhysicsError {
    /// The same with the time by the recording's clock [s] and the name of the run.
    pub(super) fn at_clock(self, clock_s: f64, run: Option<&str>) -> Self {
        match self {
            Self::NotFinite { sample, cause, .. } => {
                let of_run = run.map_or(String::new(), |name| format!(" of run {name}"));
                Self::NotFinite { of_run, sample, time_s: clock_s, cause }
            }
            other => other,
        }
    }
}
