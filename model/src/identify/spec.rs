//! Selects the model to identify: a structure by its name in the contract, the form in which the drive enters
//! it, and, where the literature differs from the default, a variant.

use crate::edit_distance::edit_distance;
use crate::error::{Error, IdentifyError};
use crate::force::{ForceLaw, Form, NetworkStructure, TskKind};

/// A model structure of the thesis, or of the literature that the thesis reviews.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Structure {
    /// Auto-regression with exogenous inputs (thesis 4.3, 4.4).
    Arx,
    /// ARX whose inputs start at the sample before (equation 5 of the thesis' first paper).
    ArxDelayed,
    /// ARX with two lags of each signal (thesis 2.8).
    Savaresi,
    /// ARX with coefficients that depend on the drive (linear parameter-varying; future work in the thesis).
    Lpv,
    /// The phase-transition relation P (thesis 4.6), which cannot run as a model: see
    /// [`crate::force::Phase`].
    Phase,
    /// Fuzzy sets over the drive, each with a tanh function (thesis 4.8).
    FuzzyTanh,
    /// Fuzzy sets over the drive, each with a damping curve and slipping bristles.
    MaxwellSlip,
    /// Recursive lazy learning.
    Boada,
    /// An autoregressive network.
    Network(NetworkStructure),
    /// A force law.
    Law(ForceLaw),
    /// Fuzzy rules on a grid: ANFIS and its relatives.
    Tsk(TskKind),
}

/// What a publication does in another way than the default of this library.
///
/// ```
/// use mr_damper_model::force::{ForceLaw, Form};
/// use mr_damper_model::identify::{ModelSpec, Structure, Variant};
///
/// let kwok = ModelSpec::new(Structure::Law(ForceLaw::Kwok), Form::SemiActive)?;
/// assert_eq!(kwok.with_variant(Variant::Linear)?.label(), "kwok/linear");
/// assert!(ModelSpec::FUZZY_TANH.with_variant(Variant::Linear).is_err());
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Variant {
    /// Parameters linear in the drive, in place of polynomials of degree two.
    Linear,
    /// Fitted by a particle swarm; in the semi-active form with parameters linear in the drive.
    Swarm,
    /// Fitted by recursive least squares: one pass over the samples in their order.
    Recursive,
    /// Fitted by a genetic algorithm.
    Genetic,
    /// Fitted by back-propagation alone.
    BackPropagation,
}

impl Variant {
    /// All variants.
    pub const ALL: [Self; 5] =
        [Self::Linear, Self::Swarm, Self::Recursive, Self::Genetic, Self::BackPropagation];
    /// The variants that differ from the default by their fit.
    pub const FITS: [Self; 4] = [Self::Swarm, Self::Recursive, Self::Genetic, Self::BackPropagation];

    /// The name, as in labels and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Swarm => "pso",
            Self::Recursive => "rls",
            Self::Genetic => "ga",
            Self::BackPropagation => "back-propagation",
        }
    }

    /// The variant called `name`.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|variant| variant.name() == name)
    }
}

/// Selects the model to identify.
///
/// ```
/// use mr_damper_model::force::Form;
/// use mr_damper_model::identify::{ModelSpec, Structure};
///
/// assert_eq!(ModelSpec::named("fuzzy-tanh", Form::SemiActive)?, ModelSpec::FUZZY_TANH);
/// let error = ModelSpec::named("fuzy-tanh", Form::SemiActive).unwrap_err();
/// assert!(error.to_string().contains("did you mean fuzzy-tanh?"), "{error}");
///
/// // The passive form of lpv is arx, so it does not exist.
/// assert!(ModelSpec::new(Structure::Lpv, Form::Passive).is_err());
/// assert!(ModelSpec::new(Structure::Lpv, Form::SemiActive)?.feeds_on_force());
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ModelSpec {
    structure: Structure,
    form: Form,
    variant: Option<Variant>,
}

impl Structure {
    /// All structures, in the order of the contract.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let mut all = vec![
            Self::Arx,
            Self::ArxDelayed,
            Self::Savaresi,
            Self::Lpv,
            Self::Phase,
            Self::FuzzyTanh,
            Self::MaxwellSlip,
            Self::Boada,
        ];
        all.extend(NetworkStructure::ALL.map(Self::Network));
        all.extend(ForceLaw::ALL.map(Self::Law));
        all.extend(TskKind::ALL.map(Self::Tsk));
        all
    }

    /// The name in the contract.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Arx => "arx",
            Self::ArxDelayed => "arx-delayed",
            Self::Savaresi => "savaresi",
            Self::Lpv => "lpv",
            Self::Phase => "p",
            Self::FuzzyTanh => "fuzzy-tanh",
            Self::MaxwellSlip => "maxwell-slip",
            Self::Boada => "boada",
            Self::Network(network) => network.name(),
            Self::Law(law) => law.name(),
            Self::Tsk(kind) => kind.name(),
        }
    }

    /// False for a relation that explains measured force but cannot predict it, so that no model can run.
    #[must_use]
    pub const fn can_run(self) -> bool {
        !matches!(self, Self::Phase)
    }

    /// Forms that are available for the structure.
    #[must_use]
    pub const fn forms(self) -> &'static [Form] {
        match self {
            Self::Arx
            | Self::ArxDelayed
            | Self::Savaresi
            | Self::Phase
            | Self::MaxwellSlip
            | Self::Boada
            | Self::Network(_)
            | Self::Tsk(_) => &[Form::Passive, Form::SemiActive],
            // The passive form of lpv is arx.
            Self::Lpv => &[Form::SemiActive, Form::Fuzzy],
            Self::FuzzyTanh => &[Form::SemiActive, Form::FreeFuzzy],
            // The fuzzy form of the S-P law is the fuzzy-tanh model.
            Self::Law(ForceLaw::Sp) => &[Form::Passive, Form::SemiActive],
            Self::Law(_) => &[Form::Passive, Form::SemiActive, Form::Fuzzy, Form::FreeFuzzy],
        }
    }
}

impl ModelSpec {
    /// ARX without drive terms, 9 coefficients.
    pub const ARX_PASSIVE: Self = Self::plain(Structure::Arx, Form::Passive);
    /// ARX with drive terms, 12 coefficients.
    pub const ARX_SEMI_ACTIVE: Self = Self::plain(Structure::Arx, Form::SemiActive);
    /// Fuzzy sets over the drive, each with a tanh function of 4 parameters.
    pub const FUZZY_TANH: Self = Self::plain(Structure::FuzzyTanh, Form::SemiActive);

    /// `structure` in `form`.
    ///
    /// # Errors
    /// [`IdentifyError::UnknownForm`] if the structure does not have that form.
    pub fn new(structure: Structure, form: Form) -> Result<Self, Error> {
        if structure.forms().contains(&form) {
            return Ok(Self::plain(structure, form));
        }
        let known: Vec<&str> = structure.forms().iter().map(|form| form.name()).collect();
        Err(IdentifyError::UnknownForm { model: structure.name(), form: form.name(), known }.into())
    }

    /// The structure `name` in `form`.
    ///
    /// # Errors
    /// [`IdentifyError::UnknownModel`] with the most similar name; [`IdentifyError::UnknownForm`] for a form that the
    /// structure does not have.
    pub fn named(name: &str, form: Form) -> Result<Self, Error> {
        let all = Structure::all();
        if let Some(structure) = all.iter().find(|structure| structure.name() == name) {
            return Self::new(*structure, form);
        }
        let nearest = all.iter().map(|s| s.name()).min_by_key(|known| edit_distance(known, name));
        let names: Vec<&str> = all.iter().map(|s| s.name()).collect();
        Err(IdentifyError::UnknownModel {
            name: name.to_owned(),
            nearest: nearest.unwrap_or("arx"),
            known: names,
        }
        .into())
    }

    /// Without a variant.
    const fn plain(structure: Structure, form: Form) -> Self {
        Self { structure, form, variant: None }
    }

    /// The same model in another variant.
    ///
    /// # Errors
    /// [`IdentifyError::UnknownVariant`] if the structure does not have the variant in this form.
    pub fn with_variant(self, variant: Variant) -> Result<Self, Error> {
        let known = self.variants();
        if known.contains(&variant) {
            return Ok(Self { variant: Some(variant), ..self });
        }
        Err(IdentifyError::UnknownVariant {
            model: self.structure.name(),
            form: self.form.name(),
            variant: variant.name(),
            known: known.iter().map(|variant| variant.name()).collect(),
        }
        .into())
    }

    /// The variants of the structure in this form; `compare` shows each beside the default.
    #[must_use]
    pub fn variants(self) -> &'static [Variant] {
        match (self.structure, self.form) {
            (Structure::Arx | Structure::ArxDelayed, _) => &[Variant::Recursive],
            (Structure::Law(ForceLaw::Kwok), Form::Passive) => &[Variant::Swarm],
            (Structure::Law(ForceLaw::Kwok), Form::SemiActive) => &[Variant::Linear, Variant::Swarm],
            (Structure::Law(ForceLaw::Li | ForceLaw::Choi), Form::SemiActive) => &[Variant::Linear],
            (Structure::Tsk(TskKind::Ahn), _) => &[Variant::BackPropagation],
            (Structure::Tsk(TskKind::Evolved), _) => &[Variant::Genetic],
            _ => &[],
        }
    }

    /// Every structure in every form, without variants.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let forms =
            |structure: Structure| structure.forms().iter().map(move |form| Self::plain(structure, *form));
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

    /// The variant; `None` for the default.
    #[must_use]
    pub const fn variant(self) -> Option<Variant> {
        self.variant
    }

    /// The name in a comparison: the structure's name, and the variant after a slash (`kwok/linear`).
    #[must_use]
    pub fn label(self) -> String {
        match self.variant {
            Some(variant) => format!("{}/{}", self.structure.name(), variant.name()),
            None => self.structure.name().to_owned(),
        }
    }

    /// True when the model predicts from measured force; such a model is valid for one rate only.
    #[must_use]
    pub const fn feeds_on_force(self) -> bool {
        matches!(
            self.structure,
            Structure::Arx
                | Structure::ArxDelayed
                | Structure::Savaresi
                | Structure::Lpv
                | Structure::Network(_)
        )
    }

    /// True when the model has fuzzy sets over the drive whose place can be chosen.
    #[must_use]
    pub const fn has_sets(self) -> bool {
        match (self.structure, self.form) {
            (_, Form::Passive) => false,
            (Structure::FuzzyTanh | Structure::MaxwellSlip, _) | (_, Form::Fuzzy | Form::FreeFuzzy) => true,
            (_, Form::SemiActive) => false,
        }
    }

    /// True when the model needs a drive.
    #[must_use]
    pub const fn needs_drive(self) -> bool {
        !matches!(self.form, Form::Passive)
    }
}
