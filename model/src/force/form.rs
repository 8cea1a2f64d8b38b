//! The forms in which the drive enters a model.

/// How the drive enters a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Form {
    /// The drive does not enter.
    Passive,
    /// The structure's own form: drive terms in ARX, polynomials of the parameters in a force law, fuzzy sets
    /// in fuzzy-tanh and maxwell-slip.
    SemiActive,
    /// Fuzzy sets over the drive, each with a copy of the structure, for structures that have no sets of
    /// their own.
    Fuzzy,
    /// Fuzzy sets whose centres and widths are identified as well.
    FreeFuzzy,
}

impl Form {
    /// The name in reports: `passive`, `semi_active`, `fuzzy`, `free_fuzzy`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Passive => "passive",
            Self::SemiActive => "semi_active",
            Self::Fuzzy => "fuzzy",
            Self::FreeFuzzy => "free_fuzzy",
        }
    }
}
