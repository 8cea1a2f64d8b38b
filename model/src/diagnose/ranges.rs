//! Physical ranges of the effects' parameters, for the machine under test.
//!
//! The library's ranges fit an MR damper of a few kilonewtons. A positioning axis moves a mass of a hundred kilograms, so its
//! user gives a range for the mass.

use super::effect_set::check_id;
use crate::effect::{Effect, Parameter};
use crate::error::{DiagnosisError, Error};

/// The library's ranges, or those given by [`Ranges::with`] in their place.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Ranges {
    /// Range of the first parameter of each effect, in its unit, in the order of [`Effect::ALL`].
    own: [Option<[f64; 2]>; Effect::ALL.len()],
}

impl Ranges {
    /// These ranges, with `range` for the first parameter (the amount) of the effect `id`, in the parameter's unit.
    ///
    /// ```
    /// use mr_damper_model::diagnose::Ranges;
    ///
    /// let axis = Ranges::default().with("inertia", [0.0, 200.0])?; // kg
    /// let refused = axis.with("inertia", [-5.0, 200.0]).expect_err("a mass is not negative");
    /// assert!(refused.to_string().contains("mass_kg"), "{refused}");
    /// # Ok::<(), mr_damper_model::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`DiagnosisError::UnknownEffect`]; [`DiagnosisError::Range`] if the ends are not finite and increasing, or if a model cannot have
    /// such values.
    pub fn with(mut self, id: &str, range: [f64; 2]) -> Result<Self, Error> {
        check_id(id)?;
        for (effect, own) in
            Effect::ALL.into_iter().zip(&mut self.own).filter(|(effect, _)| effect.id() == id)
        {
            let parameter = &effect.parameters()[0];
            let [low, high] = parameter.allowed();
            if !(range[0] < range[1]
                && range.into_iter().all(|end| end.is_finite() && low <= end && end <= high))
            {
                return Err(DiagnosisError::Range {
                    effect: effect.title(),
                    parameter: parameter.name,
                    range,
                    allowed: [low, high],
                }
                .into());
            }
            *own = Some(range);
        }
        Ok(self)
    }

    /// Range of `parameter`, whose place among the parameters of `effect` is `index`, if its scale has the size `size` in the data.
    pub(super) fn of(&self, effect: Effect, index: usize, parameter: &Parameter, size: f64) -> [f64; 2] {
        let own = Effect::ALL.iter().position(|known| *known == effect).and_then(|at| self.own[at]);
        own.filter(|_| index == 0).unwrap_or_else(|| parameter.range_at(size))
    }
}
