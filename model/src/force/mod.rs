//! The force models, one file each, and the enum that the pipeline steps.
//!
//! A model is immutable; what changes from sample to sample is its state, a small `Copy` type of its own.
//! Models are `Copy` too (fixed capacity, no heap), so that one can be handed to the estimating thread and
//! swapped in between two samples without an allocation.

mod arx;
mod fuzzy_tanh;
pub(crate) mod tsk;

pub use arx::{Arx, ArxHistory, ArxRegressors, LAGS};
pub use fuzzy_tanh::{FuzzyTanh, MAX_FUNCTIONS, Membership, TanhFunction};
pub use tsk::{
    MAX_CONCLUSIONS, MAX_INPUTS, MAX_SETS, Order, OutputScale, Shape, Signal, Tsk, TskGradient, TskInput,
    TskKind, TskSet,
};

use crate::sample::DriveKind;

/// Any force model of this crate.
#[expect(
    clippy::large_enum_variant,
    reason = "boxing the larger one would put it on the heap, out of `Copy`"
)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ForceModel {
    /// Auto-regression with exogenous inputs; can be fed with measured force.
    Arx(Arx),
    /// Fuzzy sets over the drive, a tanh function under each.
    FuzzyTanh(FuzzyTanh),
}

/// What a model is given at one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inputs {
    /// Time since the sample before, s; `None` when there is none.
    pub dt_s: Option<f64>,
    /// Conditioned displacement, m.
    pub displacement_m: f64,
    /// Conditioned velocity, m/s.
    pub velocity_m_s: f64,
    /// Conditioned acceleration, m/s²; NaN while it is not known.
    pub acceleration_m_s2: f64,
    /// Drive in the unit of the model's [`DriveKind`]; ignored by models without one.
    pub drive: f64,
}

/// State of a model that runs free (never sees measured force).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FreeRun {
    arx: ArxHistory,
}

impl ForceModel {
    /// The model's name, as in the contract: `arx`, `fuzzy-tanh`.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Arx(_) => "arx",
            Self::FuzzyTanh(_) => "fuzzy-tanh",
        }
    }

    /// Which drive the model wants; `None` for a passive model.
    #[must_use]
    pub const fn drive(&self) -> Option<DriveKind> {
        match self {
            Self::Arx(arx) => arx.drive(),
            Self::FuzzyTanh(fuzzy) => Some(fuzzy.drive()),
        }
    }

    /// How many numbers were identified: coefficients, without memberships and offset.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        match self {
            Self::Arx(arx) => arx.parameter_count(),
            Self::FuzzyTanh(fuzzy) => fuzzy.parameter_count(),
        }
    }

    /// Advances a free run by one sample and returns the force in newtons, or `None` while the model's
    /// history is still filling.
    #[inline]
    pub fn free_run(&self, state: &mut FreeRun, inputs: &Inputs) -> Option<f64> {
        match self {
            Self::FuzzyTanh(fuzzy) => {
                Some(fuzzy.force_n(inputs.displacement_m, inputs.velocity_m_s, inputs.drive))
            }
            Self::Arx(arx) => {
                state.arx.push_inputs(inputs);
                let predicted = state.arx.regressors(arx).map(|r| arx.predict_n(&r));
                // At rest the damper's force is its offset: the neutral start of a free run.
                state.arx.push_force(predicted.unwrap_or(arx.force_offset_n()));
                predicted
            }
        }
    }
}
