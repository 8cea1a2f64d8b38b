//! Which model to identify: a structure by its name in the contract, and the form in which the drive enters.

use crate::error::Error;
use crate::force::{Law, NetworkStructure, TskKind};
use crate::preset::edit_distance;

/// A structure of the thesis or of the literature that it reviews.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Structure {
    /// Auto-regression with exogenous inputs (thesis 4.3, 4.4).
    Arx,
    /// The same with two lags of each signal (thesis 2.8).
    Savaresi,
    /// Auto-regression whose coefficients follow the drive (future work in the thesis).
    Lpv,
    /// The phase-transition relation P (thesis 4.6), which cannot run: see [`crate::force::Phase`].
    Phase,
    /// Fuzzy sets over the drive, a tanh function under each (thesis 4.8).
    FuzzyTanh,
    /// Recursive lazy learning.
    Boada,
    /// An autoregressive network.
    Network(NetworkStructure),
    /// A law of force.
    Law(Law),
    /// Fuzzy rules on a grid: ANFIS and its relatives.
    Tsk(TskKind),
}

/// How the drive enters a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Form {
    /// Not at all.
    Passive,
    /// As the structure has it: drive terms of ARX, polynomials on the parameters of a law, sets of fuzzy-tanh.
    SemiActive,
    /// Fuzzy sets over the drive, the whole structure under each, where that is not how the structure has it anyway.
    Fuzzy,
    /// Fuzzy sets whose centres and widths are identified too.
    FreeFuzzy,
}

/// Which model to identify.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ModelSpec {
    structure: Structure,
    form: Form,
}

impl Structure {
    /// All structures, in the order of the contract.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let mut all = vec![Self::Arx, Self::Savaresi, Self::Lpv, Self::Phase, Self::FuzzyTanh, Self::Boada];
        all.extend(NetworkStructure::ALL.map(Self::Network));
        all.extend(Law::ALL.map(Self::Law));
        all.extend(TskKind::ALL.map(Self::Tsk));
        all
    }

    /// The name, as in the contract.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Arx => "arx",
            Self::Savaresi => "savaresi",
            Self::Lpv => "lpv",
            Self::Phase => "p",
            Self::FuzzyTanh => "fuzzy-tanh",
            Self::Boada => "boada",
            Self::Network(network) => network.name(),
            Self::Law(law) => law.name(),
            Self::Tsk(kind) => kind.name(),
        }
    }

    /// False for a relation that explains measured force and predicts none: it makes no model that can run.
    #[must_use]
    pub const fn can_run(self) -> bool {
        !matches!(self, Self::Phase)
    }

    /// Forms that the structure comes in.
    #[must_use]
    pub const fn forms(self) -> &'static [Form] {
        match self {
            Self::Arx | Self::Savaresi | Self::Phase | Self::Boada | Self::Network(_) | Self::Tsk(_) => {
                &[Form::Passive, Form::SemiActive]
            }
            // Its passive form is arx.
            Self::Lpv => &[Form::SemiActive, Form::Fuzzy],
            Self::FuzzyTanh => &[Form::SemiActive, Form::FreeFuzzy],
            // Fuzzy sets over the tanh function are the fuzzy-tanh model.
            Self::Law(Law::Sp) => &[Form::Passive, Form::SemiActive],
            Self::Law(_) => &[Form::Passive, Form::SemiActive, Form::Fuzzy, Form::FreeFuzzy],
        }
    }
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

impl ModelSpec {
    /// ARX without drive terms, 9 coefficients.
    pub const ARX_PASSIVE: Self = Self { structure: Structure::Arx, form: Form::Passive };
    /// ARX with drive terms, 12 coefficients.
    pub const ARX_SEMI_ACTIVE: Self = Self { structure: Structure::Arx, form: Form::SemiActive };
    /// Fuzzy sets over the drive, a tanh function of 4 parameters under each.
    pub const FUZZY_TANH: Self = Self { structure: Structure::FuzzyTanh, form: Form::SemiActive };

    /// `structure` in `form`.
    ///
    /// # Errors
    /// [`Error::Data`] when the structure does not come in that form.
    pub fn new(structure: Structure, form: Form) -> Result<Self, Error> {
        if structure.forms().contains(&form) {
            return Ok(Self { structure, form });
        }
        let known: Vec<&str> = structure.forms().iter().map(|form| form.name()).collect();
        Err(Error::Data {
            message: format!(
                "a {} model has no {} form, but {}",
                structure.name(),
                form.name(),
                known.join(" or ")
            ),
        })
    }

    /// The structure called `name` in `form`.
    ///
    /// # Errors
    /// [`Error::Data`] for an unknown name, with the nearest one, or a form that it does not come in.
    pub fn named(name: &str, form: Form) -> Result<Self, Error> {
        let all = Structure::all();
        if let Some(structure) = all.iter().find(|structure| structure.name() == name) {
            return Self::new(*structure, form);
        }
        let nearest = all.iter().map(|s| s.name()).min_by_key(|known| edit_distance(known, name));
        let names: Vec<&str> = all.iter().map(|s| s.name()).collect();
        Err(Error::Data {
            message: format!(
                "there is no model \"{name}\"; did you mean {}? Known are {}",
                nearest.unwrap_or("arx"),
                names.join(", ")
            ),
        })
    }

    /// Every structure in every form.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let forms =
            |structure: Structure| structure.forms().iter().map(move |form| Self { structure, form: *form });
        Structure::all().into_iter().flat_map(forms).collect()
    }

    /// The structure.
    #[must_use]
    pub const fn structure(self) -> Structure {
        self.structure
    }

    /// The form.
    #[must_use]
    pub const fn form(self) -> Form {
        self.form
    }

    /// True when the model predicts from measured force (and so holds at one rate).
    #[must_use]
    pub const fn feeds_on_force(self) -> bool {
        matches!(
            self.structure,
            Structure::Arx | Structure::Savaresi | Structure::Lpv | Structure::Network(_)
        )
    }

    /// True when the model has fuzzy sets over the drive that can be placed.
    #[must_use]
    pub const fn has_sets(self) -> bool {
        matches!(self.structure, Structure::FuzzyTanh) || matches!(self.form, Form::Fuzzy | Form::FreeFuzzy)
    }

    /// True when the model takes a drive.
    #[must_use]
    pub const fn wants_drive(self) -> bool {
        !matches!(self.form, Form::Passive)
    }
}
