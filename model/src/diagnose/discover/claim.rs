//! The claim about a term: it is an effect, or a part of the base's structure.
//!
//! ```text
//! ratio = |amount refitted on the healthy runs / amount of the term|
//! ```
//!
//! | evidence | claim |
//! |---|---|
//! | the argument grows while the damper runs; the curve has a place or a wavelength in the stroke; a resonance | effect |
//! | healthy runs: the ratio is below 0.2 | effect |
//! | healthy runs: the ratio is above 0.5 | structure: the healthy damper has it too |
//! | otherwise | effect or structure |
//!
//! No structure of a damper model changes with time, or at one place of the stroke. A term in velocity, force, drive or a short memory of
//! them may be what the structure of the base lacks. In trials, effects had a ratio of 0.12 or less, and structure
//! 0.55 or more. On the healthy runs, the base is refitted linearly together with the space of structures. A term that this space can follow is
//! compared without it.

use super::nuisance::{HealthySide, KnownStructure, Nuisance, Side};
use super::screen::is_identifiable;
use super::{Search, with_term};
use crate::diagnose::Thresholds;
use crate::diagnose::joint::{Fitted, Joint};
use crate::diagnose::rows::{Rows, dot};
use crate::effect::Augmented;
use crate::effect::term::{Form, Origin, Term};
use crate::error::Error;

/// Share by which the amount is changed for its derivative.
const STEP: f64 = 1e-3;
/// Evaluations of the refit on the healthy runs.
const REFIT: usize = 15;

/// The claim about a term.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Claim {
    /// The damper has an effect that its model lacks.
    Effect {
        /// Amount on the healthy runs as a share of the term's; `None` without healthy runs that can tell.
        on_healthy: Option<f64>,
    },
    /// The structure of the base lacks this term: the healthy damper has it too.
    Structure {
        /// Amount on the healthy runs as a share of the term's.
        on_healthy: f64,
    },
    /// One of the two.
    EffectOrStructure {
        /// Amount on the healthy runs as a share of the term's; `None` without healthy runs that can tell.
        on_healthy: Option<f64>,
    },
}

impl Claim {
    /// Name in JSON.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Effect { .. } => "effect",
            Self::Structure { .. } => "structure",
            Self::EffectOrStructure { .. } => "effect_or_structure",
        }
    }

    /// True if it is an effect.
    #[must_use]
    pub const fn is_effect(&self) -> bool {
        matches!(self, Self::Effect { .. })
    }
}

/// The claim about the last term of `model`. `healthy` is the model that was fitted on the healthy runs before, with its sides.
pub(super) fn claim(healthy: Option<&Healthy>, term: &Term, thresholds: &Thresholds) -> Claim {
    let on_healthy = healthy.and_then(|healthy| healthy.ratio(term));
    let (_, argument, form) = term.kind();
    let local = matches!(form, Form::Sine | Form::Bump | Form::Step | Form::Window | Form::Staircase);
    let beyond_structure = match (form, argument.origin()) {
        (Form::Resonance, _) => true,
        (_, Origin::Growing) => form != Form::Constant,
        (_, Origin::Position) => local,
        (_, Origin::Input) => false,
    };
    match on_healthy {
        Some(ratio) if ratio >= thresholds.structure_on_healthy => Claim::Structure { on_healthy: ratio },
        Some(ratio) if ratio > thresholds.effect_on_healthy && !beyond_structure => {
            Claim::EffectOrStructure { on_healthy: Some(ratio) }
        }
        None if !beyond_structure => Claim::EffectOrStructure { on_healthy: None },
        on_healthy => Claim::Effect { on_healthy },
    }
}

/// The healthy runs, with a model that was refitted on them.
pub(super) struct Healthy<'a> {
    rows: &'a Rows<'a>,
    fitted: Fitted,
    own: HealthySide<'a>,
}

impl<'a> Healthy<'a> {
    /// `model` refitted on `rows`; `None` without rows, or if it cannot be simulated on them.
    pub(super) fn new(
        search: &Search<'a>,
        rows: &'a Rows<'a>,
        model: &Augmented,
    ) -> Result<Option<Self>, Error> {
        if rows.len() == 0 {
            return Ok(None);
        }
        let joint = Joint { rows, ..search.joint };
        let Some(fitted) = joint.refit(model, REFIT)? else { return Ok(None) };
        let own = HealthySide::new(search, rows, &fitted)?;
        Ok(own.map(|own| Self { rows, fitted, own }))
    }

    /// The healthy runs as a side.
    pub(super) const fn side(&self) -> &Side<'a> {
        &self.own.side
    }

    /// The structure that the base lacks on them, if the search is beyond it.
    pub(super) fn structure(&self) -> Option<&KnownStructure> {
        self.own.structure.as_ref().map(|(_, known)| known)
    }

    /// The amount of `term` here as a share of its own, without its sign; `None` if these runs cannot tell.
    fn ratio(&self, term: &Term) -> Option<f64> {
        let mut values = term.values().to_vec();
        values[0] *= STEP;
        let small = with_term(&self.fitted.model, term.with_values(&values)?).ok()?;
        let mut column = self.rows.difference(&small, &self.fitted.predicted_n, STEP)?;
        self.rows.centre(&mut column);
        self.share(&column).map(f64::abs)
    }

    /// Amount of a change of the force by `column` that fits these runs. A change that the space of structures can follow is judged without this
    /// space, because the base may lack it on every run. `None` if these runs do not excite it, or if the numbers of the model alone can follow it.
    pub(super) fn share(&self, column: &[f64]) -> Option<f64> {
        let HealthySide { side, structure } = &self.own;
        let amount = |nuisance: &Nuisance| {
            let rest = nuisance.project(column.to_vec());
            let power = dot(&rest, &rest);
            is_identifiable(power, dot(column, column)).then(|| dot(&rest, &side.residual_n) / power)
        };
        let without_space = || structure.as_ref().and_then(|(plain, _)| amount(plain));
        amount(&side.nuisance).or_else(without_space)
    }
}
