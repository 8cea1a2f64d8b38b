//! The criterion of a design: how far the forces of two models are apart after everything is refitted that a fit may change.
//!
//! ```text
//! N    = [1, dM/dp]                       force offset, coefficients of the base, parameters of the effects in the model
//! g_A  = M(A) - M                         change of the force by the effect A of its size
//! d_AB = | g_A - projection on [N, B] |   B: the changes by the rival at its size and at a third of it
//! d_A  = | g_A - projection on N |        the same without a rival
//! ```
//!
//! All of it follows from the scalar products of the columns, which are sums over segments. Two sizes of the rival let it follow a curved
//! path, so the distance is not overestimated if the rival is not linear in its amount. This is the T-criterion of a design that tells
//! models apart: the truth is one model, and the distance is what the best fit of the other leaves.
//!
//! Source: `[atkinson1975]` in the bibliography (node/docs/guide/bibliography.md).

use super::super::joint::{Fitted, Joint};
use super::super::rows::dot;
use super::super::space::with_effect;
use crate::effect::{Augmented, EffectModel, Parameter};
use crate::error::Error;
use crate::parallel;
use nalgebra::{DMatrix, DVector};

/// Added to the unit diagonal of the normal matrix.
const RIDGE: f64 = 1e-9;
/// Share of its length below which a column of a rival is dependent on the others.
const DEPENDENT: f64 = 1e-5;
/// Smaller size of a rival, as a share of its size.
const SMALLER: f64 = 1.0 / 3.0;

/// The columns over some rows: the first `nuisance` are `N`, then two for each form of an effect.
pub(super) struct Columns {
    pub(super) series: Vec<Vec<f64>>,
    pub(super) nuisance: usize,
}

/// The effect with its first parameter moved towards neutral to `share` of its size.
pub(super) fn at_share(effect: &EffectModel, share: f64) -> Result<EffectModel, Error> {
    let scaled = |(index, (value, parameter)): (usize, (&f64, &Parameter))| match index {
        _ if parameter.is_shape() => *value,
        _ => parameter.neutral + share * (value - parameter.neutral),
    };
    let values: Vec<f64> =
        effect.parameters().iter().zip(effect.effect().parameters()).enumerate().map(scaled).collect();
    EffectModel::new(effect.effect(), &values)
}

/// The columns of `model` with each of `effects`; `None` if the simulation of the model is not finite. A change that is not finite is zeros.
pub(super) fn columns(
    joint: &Joint,
    model: &Augmented,
    effects: &[EffectModel],
) -> Result<Option<Columns>, Error> {
    let Some(here) = Fitted::as_is(*model, joint.rows) else { return Ok(None) };
    let (derivatives, _) = joint.jacobian(&here)?;
    let mut series = vec![vec![1.0; joint.rows.len()]];
    // A coefficient that cannot move has no column.
    series.extend(derivatives.into_iter().filter(|column| dot(column, column) > 0.0));
    let nuisance = series.len();
    let changed = |&(effect, share): &(&EffectModel, f64)| -> Result<Vec<f64>, Error> {
        if joint.watch.is_cancelled() {
            return Err(Error::Cancelled);
        }
        let there = at_share(effect, share).and_then(|effect| with_effect(model, effect));
        let change = there.ok().and_then(|there| joint.rows.difference(&there, &here.predicted_n, 1.0));
        Ok(change.unwrap_or_else(|| vec![0.0; joint.rows.len()]))
    };
    let shares: Vec<(&EffectModel, f64)> =
        effects.iter().flat_map(|effect| [(effect, 1.0), (effect, SMALLER)]).collect();
    let changes: Vec<Vec<f64>> = parallel::map(&shares, changed).into_iter().collect::<Result<_, _>>()?;
    series.extend(changes);
    Ok(Some(Columns { series, nuisance }))
}

impl Columns {
    /// Scalar products of all columns over the rows `keep`.
    pub(super) fn gram(&self, keep: &[usize]) -> DMatrix<f64> {
        let part = DMatrix::from_fn(keep.len(), self.series.len(), |k, column| self.series[column][keep[k]]);
        part.tr_mul(&part)
    }
}

/// An effect and its rival.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PairOfForms {
    /// Form that is taken as present.
    pub(super) truth: usize,
    /// Forms of the rival; empty for the model without the effect.
    pub(super) rival: Vec<usize>,
}

/// Squared distances of a pair, summed over the rows, N².
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Squares {
    /// Of the truth from the model without it.
    pub(super) alone: f64,
    /// Of the truth from the rival.
    pub(super) apart: f64,
}

/// The squared distances of `pairs` from the scalar products `gram`.
pub(super) fn squares<'a>(
    gram: &DMatrix<f64>,
    nuisance: usize,
    pairs: impl Iterator<Item = &'a PairOfForms>,
) -> Vec<Squares> {
    let n = gram.nrows();
    let length: Vec<f64> =
        (0..n).map(|k| gram[(k, k)].sqrt()).map(|l| if l > 0.0 { l } else { 1.0 }).collect();
    let own = DMatrix::from_fn(nuisance, nuisance, |a, b| {
        gram[(a, b)] / (length[a] * length[b]) + if a == b { RIDGE } else { 0.0 }
    });
    let others = DMatrix::from_fn(nuisance, n - nuisance, |a, b| gram[(a, nuisance + b)] / length[a]);
    let Some(factors) = own.cholesky() else { return pairs.map(|_| Squares::default()).collect() };
    let solved = factors.l().solve_lower_triangular(&others).unwrap_or_else(|| others.clone());
    let rest = gram.view((nuisance, nuisance), (n - nuisance, n - nuisance)) - solved.tr_mul(&solved);
    pairs.map(|pair| apart(&rest, gram, nuisance, pair)).collect()
}

/// The squares of one pair from the scalar products `rest` of what is left of the effects' columns.
fn apart(rest: &DMatrix<f64>, gram: &DMatrix<f64>, nuisance: usize, pair: &PairOfForms) -> Squares {
    let truth = 2 * pair.truth;
    let alone = rest[(truth, truth)].max(0.0);
    // Gram-Schmidt on the scalar products: each direction is a combination of the columns.
    let m = rest.nrows();
    let mut directions: Vec<DVector<f64>> = Vec::new();
    for column in pair.rival.iter().flat_map(|form| [2 * form, 2 * form + 1]) {
        let whole = gram[(nuisance + column, nuisance + column)];
        let mut direction = DVector::zeros(m);
        direction[column] = 1.0;
        for _ in 0..2 {
            for known in &directions {
                let part = known.dot(&(rest * &direction));
                direction -= known * part;
            }
        }
        let power = direction.dot(&(rest * &direction));
        if power > DEPENDENT * DEPENDENT * whole && power > 0.0 {
            directions.push(direction / power.sqrt());
        }
    }
    let taken: f64 = directions.iter().map(|d| d.dot(&rest.column(truth)).powi(2)).sum();
    Squares { alone, apart: (alone - taken).max(0.0) }
}
