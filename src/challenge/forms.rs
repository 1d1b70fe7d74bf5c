//! The forms that the static hysteresis and the static curve of a valve may have.

/// Form of the static hysteresis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LoopForm {
    /// The gap to the branch decays with its reciprocal: looks like a hyperbola.
    Reciprocal,
    /// A sum of play operators (Prandtl-Ishlinskii): remembers every reversal.
    Play,
    /// Dahl friction between coil force and spool.
    Dahl,
    /// Preisach, with a density that changes along the current.
    Preisach,
    /// Bouc and Wen.
    BoucWen,
    /// Branches of the form of a hyperbolic tangent over the travel since the reversal.
    Tanh,
    /// Duhem, as Coleman and Hodgdon wrote it.
    Duhem,
    /// Bristles after LuGre, with Stribeck's fall of the friction at rest.
    LuGre,
    /// Jiles and Atherton: walls pinned in iron.
    JilesAtherton,
}

impl LoopForm {
    /// The number that stands in the truth file: 1 remembers every reversal, so that more memory or a dead band is
    /// no error to name; 0 looks like the hyperbola; 2 is another.
    pub(super) fn number(self) -> u8 {
        match self {
            Self::Reciprocal => 0,
            Self::Play | Self::Preisach => 1,
            _ => 2,
        }
    }

    /// The word of the truth file.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Reciprocal => "reciprocal",
            Self::Play => "prandtl_ishlinskii",
            Self::Dahl => "dahl",
            Self::Preisach => "preisach",
            Self::BoucWen => "bouc_wen",
            Self::Tanh => "tanh",
            Self::Duhem => "duhem",
            Self::LuGre => "lugre",
            Self::JilesAtherton => "jiles_atherton",
        }
    }
}

/// Form of the static curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CurveForm {
    /// Force of a saturating solenoid: `i^2 / (1 + (i/i_s)^n)^(1/n)`.
    Solenoid,
    /// S-shaped: a logistic function, the iron saturates at both ends of the stroke.
    Logistic,
    /// A power of the current above the onset.
    Power,
    /// Two springs: the slope changes where the second one bears.
    TwoSprings,
    /// Bends over like an exponential.
    Saturating,
    /// Nearly straight, with a wave from the shape of the notches.
    Notched,
}
