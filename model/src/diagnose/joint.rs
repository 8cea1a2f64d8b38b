//! Joint fit of a base and its effects, running free.
//!
//! ```text
//! minimise  sum r^2,   r = M(p) - F, each run's mean taken out;     dr/dp by differences of the whole simulator
//! ```
//!
//! Broyden, C. G. (1965), Math. Comp. 19, 577: derivatives are carried on by what the last step missed, and taken afresh now and
//! then, since each costs as many free runs as there are numbers; a first fit of an effect begins with those that its score was
//! taken with. Levenberg and Marquardt from where the base stands: a closing starts from a base that was searched for from many
//! points, and an effect moves its coefficients only a little; but for yields that it had to lay flat without the effect, which get a
//! second start ([`Space::upright`]).

use super::rows::{Rows, dot};
use super::space::Space;
use crate::effect::Augmented;
use crate::error::Error;
use crate::identify::least_squares::{Normal, Problem, Stop, minimise};
use crate::identify::{Scales, Watch};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Relative change below which a fit has converged: far finer than what any check looks at.
const CONVERGED: f64 = 1e-5;

/// Broyden's updates between derivatives that are taken afresh, each of which costs a free run a number.
const UPDATES: usize = 3;

/// A model with its residual on some rows.
#[derive(Debug, Clone)]
pub(super) struct Fitted {
    pub(super) model: Augmented,
    /// Its free run at each row, N.
    pub(super) predicted_n: Vec<f64>,
    /// Measured minus predicted, each run's mean taken out, N.
    pub(super) residual_n: Vec<f64>,
    /// Sum of its squares, N².
    pub(super) squares: f64,
}

impl Fitted {
    /// `model` as it is; `None` where its free run is not finite.
    pub(super) fn as_is(model: Augmented, rows: &Rows) -> Option<Self> {
        let predicted_n = rows.predict(&model)?;
        let residual_n = rows.residual(&predicted_n);
        let squares = dot(&residual_n, &residual_n);
        squares.is_finite().then_some(Self { model, predicted_n, residual_n, squares })
    }
}

/// Derivatives at a point nearby, one a number; `None` for a number that has none, and nothing at all where none is known.
pub(super) type Nearby = Vec<Option<Vec<f64>>>;

/// What a joint fit works on.
#[derive(Clone, Copy)]
pub(super) struct Joint<'a> {
    pub(super) rows: &'a Rows<'a>,
    pub(super) scales: Scales,
    /// False in paired mode.
    pub(super) base_moves: bool,
    pub(super) watch: &'a Watch<'a>,
}

impl Joint<'_> {
    /// The best fit near `start`, within so many evaluations. `None` where `start` does not run.
    pub(super) fn refit(&self, start: &Augmented, evaluations: usize) -> Result<Option<Fitted>, Error> {
        self.refit_from(start, Nearby::new(), evaluations)
    }

    /// The same from derivatives that are known nearby, in place of fresh ones at `start`: of each number, where it is known.
    pub(super) fn refit_from(
        &self,
        start: &Augmented,
        nearby: Nearby,
        evaluations: usize,
    ) -> Result<Option<Fitted>, Error> {
        let space = Space::new(start, self.scales, self.base_moves)?;
        if space.values().is_empty() {
            return Ok(Fitted::as_is(*start, self.rows));
        }
        let stop = Stop { evaluations, cost: CONVERGED, step: CONVERGED };
        let from = |start: &[f64], nearby| {
            let problem =
                Simulated { joint: self, space: &space, best: Mutex::new(None), nearby: Mutex::new(nearby) };
            minimise(&problem, start, &space.bounds(), &stop).ok_or(Error::Cancelled)
        };
        let mut found = from(&space.values(), nearby)?;
        if let Some(upright) = space.upright(&found.parameters) {
            let other = from(&upright, Nearby::new())?;
            if other.cost < found.cost {
                found = other;
            }
        }
        if self.watch.is_cancelled() {
            return Err(Error::Cancelled);
        }
        Ok(space.model(&found.parameters).and_then(|model| Fitted::as_is(model, self.rows)))
    }

    /// Derivatives of the free run of `fitted` by all its numbers, each run's mean taken out; those of the base first, and how
    /// many these are.
    pub(super) fn jacobian(&self, fitted: &Fitted) -> Result<(Vec<Vec<f64>>, usize), Error> {
        let space = Space::new(&fitted.model, self.scales, self.base_moves)?;
        let columns = self
            .columns(&space, &space.values(), &fitted.predicted_n, Nearby::new())
            .ok_or(Error::Cancelled)?;
        Ok((columns, space.of_base()))
    }

    /// The derivatives at `at`, where the free run is `predicted_n`. A number that the free run does not survive a step in
    /// has no derivative: zeros. Those that are `known` are taken as they are. `None` when the work was cancelled.
    fn columns(
        &self,
        space: &Space,
        at: &[f64],
        predicted_n: &[f64],
        mut known: Nearby,
    ) -> Option<Vec<Vec<f64>>> {
        let steps = space.steps(at);
        known.resize(steps.len(), None);
        let column = |((j, step), known): ((usize, &f64), Option<Vec<f64>>)| {
            if known.is_some() {
                return known;
            }
            if self.watch.is_cancelled() {
                return None;
            }
            let mut moved = at.to_vec();
            moved[j] += step;
            // What the number became, not what was added.
            let step = moved[j] - at[j];
            let there = space.model(&moved).and_then(|model| self.rows.predict(&model));
            Some(there.map_or_else(
                || vec![0.0; predicted_n.len()],
                |mut there| {
                    there
                        .iter_mut()
                        .zip(predicted_n)
                        .for_each(|(there, here)| *there = (*there - here) / step);
                    self.rows.centre(&mut there);
                    there
                },
            ))
        };
        steps.par_iter().enumerate().zip(known).map(column).collect()
    }
}

/// The joint fit as the solver sees it.
struct Simulated<'a, 'b> {
    joint: &'a Joint<'b>,
    space: &'a Space,
    /// The best point so far, with its derivatives. The solver asks for one point after the other.
    best: Mutex<Option<Point>>,
    /// What the first derivatives are made of; taken by the first point.
    nearby: Mutex<Nearby>,
}

/// A point with its derivatives.
struct Point {
    parameters: Vec<f64>,
    predicted_n: Vec<f64>,
    squares: f64,
    columns: Vec<Vec<f64>>,
    /// Updates since the derivatives were taken.
    updates: usize,
}

impl Simulated<'_, '_> {
    /// Derivatives at `parameters`: those at the best point with Broyden's update, or after a few of those fresh ones.
    fn columns(
        &self,
        best: Option<Point>,
        parameters: &[f64],
        fitted: &Fitted,
    ) -> Option<(Vec<Vec<f64>>, usize)> {
        let Some(mut best) = best.filter(|best| best.updates < UPDATES) else {
            // No thread panics while it holds it.
            let nearby = std::mem::take(&mut *self.nearby.lock().unwrap_or_else(PoisonError::into_inner));
            return Some((self.joint.columns(self.space, parameters, &fitted.predicted_n, nearby)?, 0));
        };
        // Numbers of unlike units, each by the step that its derivative is taken with.
        let steps = self.space.steps(parameters);
        let moved: Vec<f64> = parameters
            .iter()
            .zip(&best.parameters)
            .zip(&steps)
            .map(|((to, from), step)| (to - from) / step)
            .collect();
        let length = dot(&moved, &moved);
        let mut missed: Vec<f64> =
            fitted.predicted_n.iter().zip(&best.predicted_n).map(|(there, here)| there - here).collect();
        self.joint.rows.centre(&mut missed);
        for ((column, moved), step) in best.columns.iter().zip(&moved).zip(&steps) {
            missed.iter_mut().zip(column).for_each(|(missed, c)| *missed -= c * moved * step);
        }
        if length > 0.0 {
            best.columns.par_iter_mut().zip(&moved).zip(&steps).for_each(|((column, moved), step)| {
                let share = moved / (step * length);
                column.iter_mut().zip(&missed).for_each(|(c, missed)| *c += share * missed);
            });
        }
        Some((best.columns, best.updates + 1))
    }
}

impl Problem for Simulated<'_, '_> {
    fn normal(&self, parameters: &[f64]) -> Option<Normal> {
        if self.joint.watch.is_cancelled() {
            return None;
        }
        let n = parameters.len();
        let fitted = self.space.model(parameters).and_then(|model| Fitted::as_is(model, self.joint.rows));
        // No thread panics while it holds it.
        let mut best = self.best.lock().unwrap_or_else(PoisonError::into_inner);
        let bound = best.as_ref().map_or(f64::INFINITY, |best| best.squares);
        // What does not run is worse than anything. What is worse the solver does not go to, and needs no derivatives of.
        let Some(fitted) = fitted.filter(|fitted| fitted.squares < bound) else {
            if let Some(best) = best.as_mut() {
                // A step that failed may have been the derivatives' fault.
                best.updates = UPDATES;
            }
            let (square, gradient) = (DMatrix::zeros(n, n), DVector::zeros(n));
            return Some(Normal { cost: f64::INFINITY, square, gradient });
        };
        let (columns, updates) = self.columns(best.take(), parameters, &fitted)?;
        let lower: Vec<Vec<f64>> = (0..n)
            .into_par_iter()
            .map(|a| (0..=a).map(|b| dot(&columns[a], &columns[b])).collect())
            .collect();
        let normal = Normal {
            cost: fitted.squares,
            square: DMatrix::from_fn(n, n, |a, b| lower[a.max(b)][a.min(b)]),
            // The residual here is measured minus model.
            gradient: DVector::from_iterator(n, columns.iter().map(|c| -dot(c, &fitted.residual_n))),
        };
        *best = Some(Point {
            parameters: parameters.to_vec(),
            predicted_n: fitted.predicted_n,
            squares: fitted.squares,
            columns,
            updates,
        });
        Some(normal)
    }
}
