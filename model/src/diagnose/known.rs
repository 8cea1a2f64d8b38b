//! What a model can do by its own numbers: what a score must not be counted for, and what makes room for an effect.
//!
//! ```text
//! J = dM/dp                              p the coefficients of the base and the parameters of the effects that are there
//! own  = g - J (J'J)^-1 J'g              what is an effect's own
//! room = - amount (J'J)^-1 J'g           how the base moves when so much of the effect comes in
//! ```

use super::basis::Basis;
use super::joint::{Fitted, Joint, Nearby};
use super::rows::dot;
use super::space::Space;
use crate::effect::{Augmented, Effect};
use crate::error::Error;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Added to a unit diagonal, so that columns that are nearly one can be told apart.
const RIDGE: f64 = 1e-9;

/// The span of a model's derivatives.
pub(super) struct Known {
    basis: Basis,
    columns: Vec<Vec<f64>>,
    /// Of the columns, each over its length; `None` where there are none.
    square: Option<Cholesky<f64, Dyn>>,
    lengths: Vec<f64>,
    of_base: usize,
}

impl Known {
    /// What `fitted` can do.
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

    /// Takes out of `score` what it knows, and returns the share of its length that is left.
    pub(super) fn take_out(&self, score: &mut [f64]) -> f64 {
        self.basis.take_out(score)
    }

    /// The derivatives of `with`, which has `effect` beside what is known, as they are here: that by the first parameter of
    /// `effect` is its `score`, and by others there is none.
    pub(super) fn nearby(&self, with: &Augmented, effect: Effect, score: &[f64]) -> Nearby {
        let mut nearby: Nearby = self.columns.iter().cloned().map(Some).collect();
        let before = with.effects().as_slice().iter().take_while(|other| other.effect() != effect);
        let at = self.of_base + before.map(|other| other.parameters().len()).sum::<usize>();
        let own = (0..effect.parameters().len()).map(|index| (index == 0).then(|| score.to_vec()));
        nearby.splice(at..at, own);
        nearby
    }

    /// `with`, its other numbers moved so that they make up for what they have in common with `amount` of an effect whose score
    /// is `score`. `None` where they make no model.
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
        let space = Space::new(with, joint.scales, joint.base_moves).ok()?;
        let mut values = space.values();
        // Of several effects only the base makes room: where theirs stand in the list depends on the new one.
        for ((value, bounds), (step, length)) in
            values.iter_mut().zip(space.bounds()).zip(moves.iter().zip(&self.lengths)).take(self.of_base)
        {
            *value = (*value - amount * step / length).clamp(bounds[0], bounds[1]);
        }
        space.model(&values)
    }
}
