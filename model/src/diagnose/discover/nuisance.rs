//! The nuisance columns, which a term must surpass: the derivatives of the model by its numbers, and the space of structures.
//!
//! ```text
//! N           columns, each divided by its length on the training runs
//! d           = (N'N + ridge)^-1 N'r                fitted on the training runs
//! e           = r - N d                             on either side, with the same d
//! ```

use super::Search;
use super::series::Series;
use super::structure;
use crate::diagnose::joint::{Fitted, Joint};
use crate::diagnose::rows::{Rows, dot, gram};
use crate::error::Error;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Added to the unit diagonal of the normal matrix.
const RIDGE: f64 = 1e-5;

/// Training or validation runs.
pub(super) struct Side<'a> {
    pub(super) rows: &'a Rows<'a>,
    pub(super) series: Series,
    pub(super) residual_n: Vec<f64>,
    /// The nuisance columns.
    pub(super) columns: Vec<Vec<f64>>,
    /// N'N.
    pub(super) square: DMatrix<f64>,
    /// N'r - N'N d.
    pub(super) left: DVector<f64>,
    /// r - N d.
    pub(super) rest_n: Vec<f64>,
}

/// Both sides, and the factorised normal matrix of the training runs.
pub(super) struct Sides<'a> {
    pub(super) train: Side<'a>,
    pub(super) confirm: Side<'a>,
    factor: Cholesky<f64, Dyn>,
    pub(super) d: DVector<f64>,
}

impl Side<'_> {
    /// Squared error without the nuisance space, N².
    pub(super) fn raw_squares(&self) -> f64 {
        dot(&self.residual_n, &self.residual_n)
    }

    /// Squared error with it, N².
    pub(super) fn squares(&self) -> f64 {
        dot(&self.rest_n, &self.rest_n)
    }

    /// N'x.
    pub(super) fn onto(&self, series: &[f64]) -> DVector<f64> {
        DVector::from_iterator(self.columns.len(), self.columns.iter().map(|column| dot(column, series)))
    }

    /// x - N w.
    pub(super) fn without(&self, mut series: Vec<f64>, weights: &DVector<f64>) -> Vec<f64> {
        for (column, weight) in self.columns.iter().zip(weights.iter()) {
            series.iter_mut().zip(column).for_each(|(value, n)| *value -= weight * n);
        }
        series
    }

    /// Both sides of a search for `fitted`; `None` if it cannot be simulated on the validation runs.
    pub(super) fn both<'b>(search: &Search<'b>, fitted: &Fitted) -> Result<Option<Sides<'b>>, Error> {
        let Some(confirmed) = Fitted::as_is(fitted.model, search.confirm) else { return Ok(None) };
        let levels = structure::levels(search.train);
        let columns = |rows: &'b Rows<'b>, fitted: &Fitted| -> Result<Vec<Vec<f64>>, Error> {
            let (mut all, _) = Joint { rows, ..search.joint }.jacobian(fitted)?;
            if search.beyond_structure {
                all.extend(structure::columns(rows, &search.joint.scales, &levels));
            }
            Ok(all)
        };
        let mut train = columns(search.train, fitted)?;
        let mut confirm = columns(search.confirm, &confirmed)?;
        for (own, other) in train.iter_mut().zip(&mut confirm) {
            let length = dot(own, own).sqrt();
            let scale = if length > 0.0 { length.recip() } else { 0.0 };
            own.iter_mut().chain(other).for_each(|value| *value *= scale);
        }
        let square = gram(&train);
        let Some(factor) = Cholesky::new(&square + DMatrix::identity(train.len(), train.len()) * RIDGE)
        else {
            return Ok(None);
        };
        let side = |rows: &'b Rows<'b>, columns: Vec<Vec<f64>>, square: DMatrix<f64>, fitted: &Fitted| Side {
            rows,
            series: Series::new(&fitted.model, rows, &fitted.predicted_n),
            residual_n: fitted.residual_n.clone(),
            left: DVector::zeros(columns.len()),
            rest_n: Vec::new(),
            square,
            columns,
        };
        let confirm_square = gram(&confirm);
        let mut train = side(search.train, train, square, fitted);
        let mut confirm = side(search.confirm, confirm, confirm_square, &confirmed);
        let d = factor.solve(&train.onto(&train.residual_n));
        for side in [&mut train, &mut confirm] {
            side.left = side.onto(&side.residual_n) - &side.square * &d;
            side.rest_n = side.without(side.residual_n.clone(), &d);
        }
        Ok(Some(Sides { train, confirm, factor, d }))
    }
}

impl Sides<'_> {
    /// (N'N + ridge)^-1 X on the training runs.
    pub(super) fn solve(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        self.factor.solve(columns)
    }

    /// A series on the training runs, with the nuisance space projected off; and the weights of the nuisance columns in it.
    pub(super) fn project(&self, series: Vec<f64>) -> (Vec<f64>, DVector<f64>) {
        let weights = self.factor.solve(&self.train.onto(&series));
        (self.train.without(series, &weights), weights)
    }
}
