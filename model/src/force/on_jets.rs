//! Force models on numbers that carry derivatives.
//!
//! An effect does not know the number type of the simulation that it is in. [`Number`] gives it the force model inside: a [`ForceModel`] for
//! `f64`, a [`ForceOnJets`] for [`Jet`].

use super::jet::{Jet, Real};
use super::law::Hidden;
use super::{ForceModel, FreeRun, FuzzyTanhAlong, Inputs, LawState};
use crate::lanes::widest;

/// Number type of a simulation: `f64`, or a [`Jet`] that carries derivatives along.
pub(crate) trait Number: Real {
    /// The force model.
    type Force;
    /// Its state.
    type State: Copy + Default;
    /// An error of a force, relative to |force| + 1 N, that one more secant step makes exact.
    const SOLVED: f64;

    /// See [`ForceModel::free_run`].
    fn free_run(force: &Self::Force, state: &mut Self::State, inputs: &Inputs<Self>) -> Option<Self>;

    /// The state of a law.
    fn law(state: &mut Self::State) -> &mut LawState<Self>;

    /// See [`ForceModel::along`].
    fn along(force: &Self::Force, drive: f64) -> Option<FuzzyTanhAlong<'_>>;

    /// The model with its properties.
    fn model(force: &Self::Force) -> &ForceModel;
}

/// The part of a state that a model uses. A whole state takes kilobytes, so copies of it would take longer than a step.
#[allow(clippy::large_enum_variant, reason = "a box would allocate")]
pub(crate) enum Kept<R: Number> {
    /// A model without memory.
    Nothing,
    /// A law with one set of parameters.
    Law(Hidden<R>),
    Everything(R::State),
}

impl<R: Number> Kept<R> {
    /// The part of `state` that the model uses.
    #[inline]
    pub(crate) fn of(force: &R::Force, state: &mut R::State) -> Self {
        match R::model(force) {
            model if !model.remembers() => Self::Nothing,
            ForceModel::Law(model) if model.has_one_state() => Self::Law(*R::law(state).first()),
            _ => Self::Everything(*state),
        }
    }

    /// Brings it back.
    #[inline]
    pub(crate) fn restore(&self, state: &mut R::State) {
        match self {
            Self::Nothing => {}
            Self::Law(hidden) => *R::law(state).first() = *hidden,
            Self::Everything(all) => *state = *all,
        }
    }
}

impl Number for f64 {
    type Force = ForceModel;
    type State = FreeRun;
    /// Scores are differences of forces and need them to one part in 1e10.
    const SOLVED: f64 = 1e-7;

    #[inline]
    fn free_run(force: &ForceModel, state: &mut FreeRun, inputs: &Inputs) -> Option<Self> {
        force.free_run(state, inputs)
    }

    #[inline]
    fn law(state: &mut FreeRun) -> &mut LawState {
        &mut state.law
    }

    #[inline]
    fn along(force: &ForceModel, drive: f64) -> Option<FuzzyTanhAlong<'_>> {
        force.along(drive)
    }

    #[inline]
    fn model(force: &ForceModel) -> &ForceModel {
        force
    }
}

/// A force model whose coefficients carry derivatives.
#[derive(Debug, Clone)]
pub(crate) struct ForceOnJets<const N: usize> {
    model: ForceModel,
    /// In the order of [`ForceModel::coefficients`].
    coefficients: Vec<Jet<N>>,
}

impl<const N: usize> ForceOnJets<N> {
    /// `model` with each coefficient as `jet` makes it; `None` if the model has no list of them.
    pub(crate) fn new(model: &ForceModel, jet: impl FnMut(f64) -> Jet<N>) -> Option<Self> {
        Some(Self { model: *model, coefficients: model.coefficients()?.into_iter().map(jet).collect() })
    }
}

impl<const N: usize> Number for Jet<N> {
    type Force = ForceOnJets<N>;
    type State = LawState<Self>;
    /// Derivatives are not differences, and a fit needs them to a part in a thousand.
    const SOLVED: f64 = 1e-4;

    #[inline]
    fn free_run(force: &ForceOnJets<N>, state: &mut LawState<Self>, inputs: &Inputs<Self>) -> Option<Self> {
        let coefficients = force.coefficients.as_slice();
        match &force.model {
            ForceModel::FuzzyTanh(fuzzy) => {
                let (x, v, i) = (inputs.displacement_m, inputs.velocity_m_s, inputs.drive);
                Some(widest(
                    #[inline(always)]
                    || fuzzy.force_on(coefficients.as_chunks().0, x, v, i),
                ))
            }
            ForceModel::Law(law) => Some(law.force_on(coefficients, inputs, state)),
            _ => None,
        }
    }

    #[inline]
    fn law(state: &mut LawState<Self>) -> &mut LawState<Self> {
        state
    }

    #[inline]
    fn along(_: &ForceOnJets<N>, _: f64) -> Option<FuzzyTanhAlong<'_>> {
        None
    }

    #[inline]
    fn model(force: &ForceOnJets<N>) -> &ForceModel {
        &force.model
    }
}
