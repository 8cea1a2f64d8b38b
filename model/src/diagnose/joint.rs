//! Joint fit of a base and its effects to measured force, in simulation (free run).
//!
//! ```text
//! minimise  sum r^2,   r = M(p) - F, each run's mean removed;     dr/dp from [`super::derivatives`]
//! ```
//!
//! The solver is Levenberg-Marquardt, started at the current coefficients: the base was identified from many starts already, and an
//! effect changes its coefficients only a little. The exception are tanh functions that the fit without the effect had flattened;
//! they get a second start ([`Space::upright`]).
//!
//! One full set of derivatives takes the time of several simulations. Between full sets, derivatives are therefore updated by the error of
//! the last step (Broyden, C. G. (1965), Math. Comp. 19, 577). The first fit of an effect starts with the derivatives
//! that its score was computed with.
//!
//! Source: `[broyden1965]` and `[levenberg-marquardt]` in the bibliography (node/docs/guide/bibliography.md).

use super::derivatives::columns;
use super::ranges::Ranges;
use super::rows::{Rows, dot, gram};
use super::space::Space;
use crate::effect::Augmented;
use crate::error::Error;
use crate::identify::least_squares::{Normal, Problem, Stop, minimise};
use crate::identify::{Scales, Watch};
use nalgebra::DVector;
use std::sync::{Mutex, PoisonError};

/// Relative change below which a fit has converged; far smaller than the threshold of any check.
const CONVERGED: f64 = 1e-5;

/// Broyden updates between two full sets of derivatives.
const UPDATES: usize = 6;

/// A model with its residual on some rows.
#[derive(Debug, Clone)]
pub(super) struct Fitted {
    pub(super) model: Augmented,
    /// Simulated force at each row, N.
    pub(super) predicted_n: Vec<f64>,
    /// Measured minus simulated force, each run's mean removed, N.
    pub(super) residual_n: Vec<f64>,
    /// Sum of the squared residuals, N².
    pub(super) squares: f64,
}

impl Fitted {
    /// `model` without fitting; `None` if its simulation is not finite.
    pub(super) fn as_is(model: Augmented, rows: &Rows) -> Option<Self> {
        let predicted_n = rows.predict(&model)?;
        let residual_n = rows.residual(&predicted_n);
        let squares = dot(&residual_n, &residual_n);
        squares.is_finite().then_some(Self { model, predicted_n, residual_n, squares })
    }

    /// Squared error of `model` without fitting, N²; infinite if its simulation is not finite.
    pub(super) fn squares_of(model: &Augmented, rows: &Rows) -> f64 {
        Self::as_is(*model, rows).map_or(f64::INFINITY, |fitted| fitted.squares)
    }
}

/// Derivatives known from a nearby point, one for each number; `None` where a derivative is not known, and no derivatives if none is.
pub(super) type Nearby = Vec<Option<Vec<f64>>>;

/// The inputs of a joint fit.
#[derive(Clone, Copy)]
pub(super) struct Joint<'a> {
    pub(super) rows: &'a Rows<'a>,
    pub(super) scales: Scales,
    /// Physical ranges of the effects' parameters.
    pub(super) ranges: Ranges,
    /// True if the coefficients of the base are fitted too; false in paired mode.
    pub(super) base_moves: bool,
    pub(super) watch: &'a Watch<'a>,
}

impl Joint<'_> {
    /// The best fit near `start`, with at most `evaluations`. `None` if the simulation of the result is not finite.
    pub(super) fn refit(&self, start: &Augmented, evaluations: usize) -> Result<Option<Fitted>, Error> {
        self.refit_from(start, Nearby::new(), evaluations)
    }

    /// As [`Joint::refit`], with the derivatives in `nearby` used at `start` instead of computing them.
    pub(super) fn refit_from(
        &self,
        start: &Augmented,
        nearby: Nearby,
        evaluations: usize,
    ) -> Result<Option<Fitted>, Error> {
        let space = Space::new(start, self.scales, self.ranges, self.base_moves)?;
        if space.values().is_empty() {
            return Ok(Fitted::as_is(*start, self.rows));
        }
        let stop = Stop { evaluations, cost: CONVERGED, step: CONVERGED };
        let from = |start: &[f64], nearby| {
            let problem = Simulated {
                joint: self,
                space: &space,
                free: space.bounds().iter().map(|[low, high]| low < high).collect(),
                best: Mutex::new(None),
                nearby: Mutex::new(nearby),
            };
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

    /// Derivatives of the simulation of `fitted` by all its numbers, each run's mean removed: first those by the coefficients of the base.
    /// Also returns how many belong to the base.
    pub(super) fn jacobian(&self, fitted: &Fitted) -> Result<(Vec<Vec<f64>>, usize), Error> {
        let space = Space::new(&fitted.model, self.scales, self.ranges, self.base_moves)?;
        let all = vec![true; space.values().len()];
        let columns = columns(self, &space, &space.values(), &fitted.predicted_n, &all, Nearby::new())
            .ok_or(Error::Cancelled)?;
        Ok((columns, space.of_base()))
    }
}

/// The joint fit as the solver sees it.
struct Simulated<'a, 'b> {
    joint: &'a Joint<'b>,
    space: &'a Space,
    /// Whether the bounds let each number move. The solver needs no derivatives by the others.
    free: Vec<bool>,
    /// The best point so far, with its derivatives. The solver evaluates one point at a time.
    best: Mutex<Option<Point>>,
    /// Derivatives known in advance; used up by the first point.
    nearby: Mutex<Nearby>,
}

/// A point with its derivatives.
struct Point {
    parameters: Vec<f64>,
    predicted_n: Vec<f64>,
    squares: f64,
    columns: Vec<Vec<f64>>,
    /// Updates since the last full set of derivatives.
    updates: usize,
}

impl Simulated<'_, '_> {
    /// Derivatives at `parameters`, and the number of updates that they contain: those at the best point with Broyden's update, or a full
    /// set after [`UPDATES`].
    fn columns(
        &self,
        best: Option<Point>,
        parameters: &[f64],
        fitted: &Fitted,
    ) -> Option<(Vec<Vec<f64>>, usize)> {
        let Some(mut best) = best.filter(|best| best.updates < UPDATES) else {
            // A poisoned lock is harmless: no thread panics while it holds the lock.
            let nearby = std::mem::take(&mut *self.nearby.lock().unwrap_or_else(PoisonError::into_inner));
            let all = columns(self.joint, self.space, parameters, &fitted.predicted_n, &self.free, nearby)?;
            return Some((all, 0));
        };
        // The numbers have different units; each is scaled by the step of its derivative.
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
            for ((column, moved), step) in best.columns.iter_mut().zip(&moved).zip(&steps) {
                let share = moved / (step * length);
                column.iter_mut().zip(&missed).for_each(|(c, missed)| *c += share * missed);
            }
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
        // A poisoned lock is harmless: no thread panics while it holds the lock.
        let mut best = self.best.lock().unwrap_or_else(PoisonError::into_inner);
        let bound = best.as_ref().map_or(f64::INFINITY, |best| best.squares);
        // A model whose simulation is not finite is worse than any other. The solver does not move to a worse point, so that needs no
        // derivatives.
        let Some(fitted) = fitted.filter(|fitted| fitted.squares < bound) else {
            if let Some(best) = best.as_mut() {
                // The step may have failed because the derivatives are outdated: the next point computes a full set.
                best.updates = UPDATES;
            }
            return Some(Normal::impossible(n));
        };
        let (columns, updates) = self.columns(best.take(), parameters, &fitted)?;
        let normal = Normal {
            cost: fitted.squares,
            square: gram(&columns),
            // The sign follows from the residual, which is measured minus simulated.
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
