//! The nuisance columns, which a term must surpass: the derivatives of the model by its numbers, and the space of structures.
//!
//! ```text
//! N           columns, each divided by its length on the training runs
//! d           = argmin |r - N d|^2 + ridge |d|^2 + penalty(d)         fitted on one side
//! penalty     = weight (d_S - w)' Q (d_S - w)                         what the healthy runs say about the structure S
//! Q, w        = normal matrix and best weights of S on the healthy runs, with the derivatives of the model projected off
//! e           = r - N d                                               on either side, with the same d
//! ```
//!
//! With healthy runs, the structure that the base lacks is known as far as these runs have excited it. The penalty has the form of the squared
//! error on the healthy runs, so that a direction that they have not excited stays free. Without it, an effect that looks like structure
//! would be projected off.

use super::Search;
use super::series::Series;
use super::structure::{self, Levels};
use crate::diagnose::blocks::Blocks;
use crate::diagnose::joint::{Fitted, Joint};
use crate::diagnose::rows::{Rows, dot, gram};
use crate::effect::term::Terms;
use crate::error::Error;
use crate::lanes::widest;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Added to the unit diagonal of the normal matrix.
const RIDGE: f64 = 1e-5;
/// Weight of the squared error on the healthy runs, relative to that on the training runs.
const WEIGHT_OF_HEALTHY: f64 = 4.0;

/// The nuisance columns on some rows, and the factor of their normal matrix.
pub(super) struct Nuisance {
    pub(super) columns: Vec<Vec<f64>>,
    /// N'N.
    pub(super) square: DMatrix<f64>,
    /// Cholesky factor of N'N with ridge and penalty.
    factor: Cholesky<f64, Dyn>,
}

/// Training or validation runs.
pub(super) struct Side<'a> {
    pub(super) rows: &'a Rows<'a>,
    pub(super) series: Series,
    pub(super) residual_n: Vec<f64>,
    pub(super) nuisance: Nuisance,
    /// d, fitted on this side.
    pub(super) d: DVector<f64>,
    /// r - N d with it.
    pub(super) fitted_rest_n: Vec<f64>,
    /// N'r - N'N d with the d of the other side.
    pub(super) left: DVector<f64>,
    /// r - N d with the d of the other side.
    pub(super) rest_n: Vec<f64>,
}

/// Both sides.
pub(super) struct Sides<'a> {
    pub(super) train: Side<'a>,
    pub(super) confirm: Side<'a>,
    penalty: Penalty,
}

/// The penalty as a quadratic: d'Q d - 2 b'd + constant, over all columns.
struct Penalty {
    square: DMatrix<f64>,
    along: DVector<f64>,
    constant: f64,
}

/// Q and Q w: the knowledge of the healthy runs about the structure, for columns of unit scale.
pub(super) struct KnownStructure {
    square: DMatrix<f64>,
    along: DVector<f64>,
}

/// Columns of one side, before they are scaled.
struct Columns {
    all: Vec<Vec<f64>>,
    /// How many are derivatives of the model; the others are structure.
    of_model: usize,
}

impl Columns {
    /// The columns of `fitted` on `rows`, with the space of structures if `levels` are given.
    fn new(search: &Search, rows: &Rows, fitted: &Fitted, levels: Option<&Levels>) -> Result<Self, Error> {
        let (mut all, _) = Joint { rows, ..search.joint }.jacobian(fitted)?;
        let of_model = all.len();
        if let Some(levels) = levels {
            all.extend(structure::columns(rows, &search.joint.scales, levels));
        }
        Ok(Self { all, of_model })
    }

    /// Reciprocal of the length of each column; 0 for a column without length.
    fn scales(&self) -> Vec<f64> {
        let reciprocal = |length: f64| if length > 0.0 { length.recip() } else { 0.0 };
        self.all.iter().map(|column| reciprocal(dot(column, column).sqrt())).collect()
    }

    /// Removes the derivatives by the numbers of term `index` of `terms`, which are the last ones of the model.
    fn remove_term(&mut self, terms: &Terms, index: usize) {
        let counts: Vec<usize> = terms.iter().map(|term| term.values().len()).collect();
        let first = self.of_model - counts[index..].iter().sum::<usize>();
        self.all.drain(first..first + counts[index]);
        self.of_model -= counts[index];
    }

    fn scale(&mut self, by: &[f64]) {
        for (column, by) in self.all.iter_mut().zip(by) {
            column.iter_mut().for_each(|value| *value *= by);
        }
    }
}

impl KnownStructure {
    /// The structure on the healthy runs of `side`, whose columns have these `scales`. The first ones are the derivatives, which `of_model` has
    /// alone.
    fn new(side: &Side, scales: &[f64], of_model: &Nuisance) -> Self {
        let (square, first) = (&side.nuisance.square, of_model.columns.len());
        let of_structure = scales.len() - first;
        let along = side.nuisance.onto(&side.residual_n);
        let crossed = square.view((0, first), (first, of_structure)).into_owned();
        let solved = of_model.solve(&crossed);
        let mut square =
            square.view((first, first), (of_structure, of_structure)) - crossed.transpose() * &solved;
        let mut right = along.rows(first, of_structure) - solved.transpose() * along.rows(0, first);
        let unit = |index: usize| match scales[first + index] {
            scale if scale > 0.0 => scale.recip(),
            _ => 0.0,
        };
        for a in 0..of_structure {
            right[a] *= unit(a);
            for b in 0..of_structure {
                square[(a, b)] *= unit(a) * unit(b);
            }
        }
        Self { square, along: right }
    }
}

impl Penalty {
    /// No penalty but the ridge, or with what is known about the structure, which is at the end of the columns of these `scales`.
    fn new(scales: &[f64], known: Option<&KnownStructure>) -> Self {
        let n = scales.len();
        let mut penalty =
            Self { square: DMatrix::identity(n, n) * RIDGE, along: DVector::zeros(n), constant: 0.0 };
        let Some(known) = known else { return penalty };
        let first = n - known.along.len();
        let scale = |index: usize| scales[first + index];
        for a in 0..known.along.len() {
            penalty.along[first + a] = WEIGHT_OF_HEALTHY * scale(a) * known.along[a];
            for b in 0..known.along.len() {
                penalty.square[(first + a, first + b)] +=
                    WEIGHT_OF_HEALTHY * scale(a) * scale(b) * known.square[(a, b)];
            }
        }
        // The least value of the quadratic is the error that the healthy runs keep; the constant makes it zero.
        if let Some(factor) = Cholesky::new(penalty.square.clone()) {
            penalty.constant = penalty.along.dot(&factor.solve(&penalty.along));
        }
        penalty
    }

    fn value(&self, d: &DVector<f64>) -> f64 {
        d.dot(&(&self.square * d)) - 2.0 * self.along.dot(d) + self.constant
    }
}

impl Nuisance {
    /// `None` if the normal matrix cannot be factorised.
    fn new(columns: Vec<Vec<f64>>, penalty: &Penalty) -> Option<Self> {
        let square = gram(&columns);
        let factor = Cholesky::new(&square + &penalty.square)?;
        Some(Self { columns, square, factor })
    }

    /// N'x.
    fn onto(&self, series: &[f64]) -> DVector<f64> {
        DVector::from_iterator(self.columns.len(), self.columns.iter().map(|column| dot(column, series)))
    }

    /// x - N w.
    pub(super) fn without(&self, mut series: Vec<f64>, weights: &DVector<f64>) -> Vec<f64> {
        widest(
            #[inline(always)]
            || {
                for (column, weight) in self.columns.iter().zip(weights.iter()) {
                    series.iter_mut().zip(column).for_each(|(value, n)| *value -= weight * n);
                }
            },
        );
        series
    }

    /// (N'N + ridge + penalty)^-1 X.
    pub(super) fn solve(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        self.factor.solve(columns)
    }

    /// d for a residual.
    fn fit(&self, residual_n: &[f64], penalty: &Penalty) -> DVector<f64> {
        self.factor.solve(&(self.onto(residual_n) + &penalty.along))
    }

    /// Weights with which the columns follow a change of the force by `series`.
    pub(super) fn weights(&self, series: &[f64]) -> DVector<f64> {
        self.factor.solve(&self.onto(series))
    }

    /// The rest of a change of the force by `series` when the columns follow it.
    pub(super) fn project(&self, series: Vec<f64>) -> Vec<f64> {
        let weights = self.weights(&series);
        self.without(series, &weights)
    }
}

impl<'a> Side<'a> {
    /// A side; `None` if its normal matrix cannot be factorised.
    fn new(rows: &'a Rows<'a>, columns: Columns, fitted: &Fitted, penalty: &Penalty) -> Option<Self> {
        let nuisance = Nuisance::new(columns.all, penalty)?;
        let residual_n = fitted.residual_n.clone();
        let d = nuisance.fit(&residual_n, penalty);
        Some(Self {
            rows,
            series: Series::new(&fitted.model, rows, &fitted.predicted_n),
            left: DVector::zeros(nuisance.columns.len()),
            rest_n: Vec::new(),
            fitted_rest_n: nuisance.without(residual_n.clone(), &d),
            residual_n,
            nuisance,
            d,
        })
    }

    /// Takes the weights `d` of the other side.
    fn held_out(&mut self, d: &DVector<f64>) {
        self.left = self.nuisance.onto(&self.residual_n) - &self.nuisance.square * d;
        self.rest_n = self.nuisance.without(self.residual_n.clone(), d);
    }

    /// Squared error without the nuisance space, N².
    pub(super) fn raw_squares(&self) -> f64 {
        dot(&self.residual_n, &self.residual_n)
    }

    /// Squared error with it, fitted on the other side, N².
    pub(super) fn squares(&self) -> f64 {
        dot(&self.rest_n, &self.rest_n)
    }

    /// Drop of the squared error on each block when `amount` of `series` is in the model, and the nuisance columns follow with `weights` per amount,
    /// all fitted on the other side, N².
    pub(super) fn gains(
        &self,
        series: Vec<f64>,
        amount: f64,
        weights: &DVector<f64>,
        blocks: &Blocks,
    ) -> Vec<f64> {
        let column = self.nuisance.without(series, weights);
        let after: Vec<f64> =
            self.rest_n.iter().zip(&column).map(|(e, column)| e - amount * column).collect();
        blocks.gains(&self.rest_n, &after)
    }
}

/// The healthy runs of a search.
pub(super) struct HealthySide<'a> {
    pub(super) side: Side<'a>,
    /// The nuisance without the space of structures, and the knowledge about the structure; `None` if the search does not have the space.
    pub(super) structure: Option<(Nuisance, KnownStructure)>,
}

impl<'a> HealthySide<'a> {
    /// `None` if the normal matrix cannot be factorised.
    pub(super) fn new(search: &Search, rows: &'a Rows<'a>, fitted: &Fitted) -> Result<Option<Self>, Error> {
        let levels = search.beyond_structure.then(|| structure::levels(search.train));
        let mut columns = Columns::new(search, rows, fitted, levels.as_ref())?;
        let (of_model, scales) = (columns.of_model, columns.scales());
        columns.scale(&scales);
        let plain = levels.map(|_| columns.all[..of_model].to_vec());
        let Some(side) = Side::new(rows, columns, fitted, &Penalty::new(&scales, None)) else {
            return Ok(None);
        };
        let Some(plain) = plain else { return Ok(Some(Self { side, structure: None })) };
        let plain = Nuisance::new(plain, &Penalty::new(&scales[..of_model], None));
        Ok(plain.map(|plain| {
            let known = KnownStructure::new(&side, &scales, &plain);
            Self { side, structure: Some((plain, known)) }
        }))
    }
}

impl<'a> Sides<'a> {
    /// Both sides of a search for `fitted`, with what the healthy runs say about the structure. `None` if the model cannot be simulated on the
    /// validation runs.
    pub(super) fn new(
        search: &Search<'a>,
        fitted: &Fitted,
        known: Option<&KnownStructure>,
    ) -> Result<Option<Self>, Error> {
        Self::of(search, fitted, known, None)
    }

    /// As [`Sides::new`], but the numbers of term `index` of the model are not in the nuisance space.
    pub(super) fn without_term(
        search: &Search<'a>,
        fitted: &Fitted,
        known: Option<&KnownStructure>,
        index: usize,
    ) -> Result<Option<Self>, Error> {
        Self::of(search, fitted, known, Some(index))
    }

    fn of(
        search: &Search<'a>,
        fitted: &Fitted,
        known: Option<&KnownStructure>,
        left_out: Option<usize>,
    ) -> Result<Option<Self>, Error> {
        let Some(confirmed) = Fitted::as_is(fitted.model, search.confirm) else { return Ok(None) };
        let levels = search.beyond_structure.then(|| structure::levels(search.train));
        let mut train = Columns::new(search, search.train, fitted, levels.as_ref())?;
        let mut confirm = Columns::new(search, search.confirm, &confirmed, levels.as_ref())?;
        if let Some(index) = left_out {
            train.remove_term(fitted.model.effects().terms(), index);
            confirm.remove_term(fitted.model.effects().terms(), index);
        }
        let scales = train.scales();
        train.scale(&scales);
        confirm.scale(&scales);
        let penalty = Penalty::new(&scales, known);
        let train = Side::new(search.train, train, fitted, &penalty);
        let confirm = Side::new(search.confirm, confirm, &confirmed, &penalty);
        let (Some(mut train), Some(mut confirm)) = (train, confirm) else { return Ok(None) };
        confirm.held_out(&train.d);
        train.held_out(&confirm.d);
        Ok(Some(Self { train, confirm, penalty }))
    }

    /// Best weights of the nuisance columns in `residual_n` on the training runs, and the least squared error with the penalty, N².
    pub(super) fn fit(&self, residual_n: &[f64]) -> (DVector<f64>, f64) {
        let nuisance = &self.train.nuisance;
        let weights = nuisance.fit(residual_n, &self.penalty);
        let rest_n = nuisance.without(residual_n.to_vec(), &weights);
        let cost = dot(&rest_n, &rest_n) + self.penalty.value(&weights);
        (weights, cost)
    }
}
