//! Which part of the signal's way an FMU is: a whole valve, or the effects that stand about somebody else's model.

/// What an FMU stands for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Part {
    /// A valve: current in, pressure out.
    #[default]
    Whole,
    /// Effects ahead of a model: current in, current out.
    Ahead,
    /// Effects behind a model: its pressure and the current in, pressure out.
    Behind,
}

/// The place of the part's name below the resources; a whole valve needs none.
pub const PART_FILE: &str = "part.txt";

impl Part {
    /// Its name in the file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Whole => "whole",
            Self::Ahead => "ahead",
            Self::Behind => "behind",
        }
    }

    /// The part of this name.
    pub fn of(name: &str) -> Option<Self> {
        [Self::Whole, Self::Ahead, Self::Behind].into_iter().find(|part| part.name() == name)
    }
}
