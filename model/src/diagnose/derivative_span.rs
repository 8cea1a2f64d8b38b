//! The span of a model's derivatives by its own coefficients: scores are projected off it, and it gives the change of the base that
//! makes room for an effect.
//!
//! ```text
//! J = dM/dp                              p: coefficients of the base and parameters of the effects already in the model
//! own  = g - J (J'J)^-1 J'g              the part of a score that no coefficient can produce
//! room = - amount (J'J)^-1 J'g           change of the coefficients when this amount of the effect is added
//! ```

use super::basis::Basis;
use super::joint::{Fitted, Joint, Nearby};
use super::rows::dot;
use super::space::Space;
use crate::effect::{Augmented, Effect};
use crate::error::Error;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Added to the unit diagonal of the normal matrix, so that it can be factorised if columns are nearly collinear.
const RIDGE: f64 = 1e-9;

/// The span of a model's derivatives.
pub(super) struct DerivativeSpan {
    basis: Basis,
    columns: Vec<Vec<f64>>,
    /// Factorised normal matrix of the columns, each divided by its length; `None` without columns.
    square: Option<Cholesky<f64, Dyn>>,
    lengths: Vec<f64>,
    of_base: usize,
}

impl DerivativeSpan {
    /// The span of the derivatives of `fitted`.
    pub(super) fn new(joint: &Joint, fitted: &Fitted) -> Result<Self, Error> {
        let (columns, of_base) = joint.jacobian(fitted)?;
        let lengths: Vec<f64> =
            columns.iter().map(|c| dot(c, c).sqrt()).map(|l| if l > 0.0 { l } else { 1.0 }).collect();
        let n = columns.len();
        let square = DMatrix::from_fn(n, n, |a, b| {
            dot(&columns[a], &columns[b]) / (lengths[a] * lengths[b]) + if a == b { RIDGE } else { 0.0 }
        });
        let square = (n > 0).then(|| square.cholesky()).flatten();
        Ok(Self { basis: Basis::of(columns.clone()), columns, square, lengths, of_base })
    }

    /// Projects `score` off the span, and returns the share of its length that is left.
    pub(super) fn take_out(&self, score: &mut [f64]) -> f64 {
        self.basis.take_out(score)
    }

    /// The known derivatives for `with`, which has `effect` in addition to the model here. The derivative by the first parameter of
    /// `effect` is its `score`; its other parameters have none.
    pub(super) fn nearby(&self, with: &Augmented, effect: Effect, score: &[f64]) -> Nearby {
        let mut nearby: Nearby = self.columns.iter().cloned().map(Some).collect();
        let before = with.effects().as_slice().iter().take_while(|other| other.effect() != effect);
        let at = self.of_base + before.map(|other| other.parameters().len()).sum::<usize>();
        let own = (0..effect.parameters().len()).map(|index| (index == 0).then(|| score.to_vec()));
        nearby.splice(at..at, own);
        nearby
    }

    /// `with`, its base coefficients changed to compensate for the part of the effect that they could produce too: `amount` of an effect
    /// whose score is `score`. `None` if the changed numbers are not a valid model.
    pub(super) fn makes_room(
        &self,
        joint: &Joint,
        with: &Augmented,
        score: &[f64],
        amount: f64,
    ) -> Option<Augmented> {
        let shared = DVector::from_iterator(
            self.columns.len(),
            self.columns.iter().zip(&self.lengths).map(|(c, length)| dot(c, score) / length),
        );
        let moves = self.square.as_ref()?.solve(&shared);
        let space = Space::new(with, joint.scales, joint.ranges, joint.base_moves).ok()?;
        let mut values = space.values();
        // Only the coefficients of the base are changed: the position of the effects' parameters depends on the new effect.
        for ((value, bounds), (step, length)) in
            values.iter_mut().zip(space.bounds()).zip(moves.iter().zip(&self.lengths)).take(self.of_base)
        {
            *value = (*value - amount * step / length).clamp(bounds[0], bounds[1]);
        }
        space.model(&values)
    }
}
