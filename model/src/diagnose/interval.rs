//! The 95 % interval of each parameter of an effect.
//!
//! ```text
//! chance      = t95 sqrt((B - 1)/B sum over b of out_b^2)        out_b: change of p when block b of B is left out
//! shift_v     = -g'd_v / g'g                                     d_v: change of the simulated force under variant v
//! interval    = p + sum_v m_v shift_v  +-  sqrt(chance^2 + sum_v (w_v shift_v)^2),   extended to p
//! ```
//!
//! g is the derivative of the simulated force by the parameter p, projected off the derivatives by all other numbers of the model, and r
//! the residual. With Q, the derivatives by all numbers made orthonormal, g the last, and Q_b and r_b the rows of block b,
//!
//! ```text
//! out_b       = - last of (I - Q_b'Q_b)^-1 Q_b'r_b, divided by the length of g
//! ```
//!
//! A fit with many numbers follows each block in part. The sum of g r over a block is too small for that reason, most of all where a block
//! contains much of what determines a number, as few changes of the current do. Leaving the block out undoes that.
//!
//! The scatter over blocks shows chance only. Other errors shift a parameter by the same amount on every block: how the
//! recorded channels are read between their samples, how velocity is computed, and noise in the inputs. [`super::variants`] gives the
//! changes of force d_v, and the share m_v +- w_v of each that may be real. The shift is what one step of least squares would do. For even
//! stamps it is g'r / g'g, with g and r of the changed rows.
//!
//! Source: the jackknife over blocks, CR3 in `[mackinnon2023]` in the bibliography (node/docs/guide/bibliography.md). Independent
//! uncertainties add in quadrature: Guide to the Expression of Uncertainty in Measurement (JCGM 100:2008, 5.1.2).

use super::basis::Basis;
use super::blocks::Blocks;
use super::finding::FoundParameter;
use super::joint::{Fitted, Joint};
use super::rows::dot;
use super::variants::{self, Change};
use crate::effect::Parameter;
use crate::effect::term::{Form, SHARP, Term};
use crate::error::Error;
use crate::identify::Dataset;
use crate::statistics::block_sums::t95;
use nalgebra::{DMatrix, DVector};

/// Added to the unit matrix without the part of a block, which is singular if that block alone determines a number.
const ALONE: f64 = 1e-6;

/// The parts of an interval.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Contents {
    /// Chance only. It decides which effects are in one class.
    Chance,
    /// Chance and the variants. This interval is reported, and an effect is accepted or refused by it.
    All,
}

/// The derivatives and changes that the intervals of all effects of one fitted model come from.
pub(super) struct Intervals<'a> {
    joint: &'a Joint<'a>,
    fitted: &'a Fitted,
    /// Least length of a block, s.
    block_s: f64,
    /// Derivatives of the simulated force, first those by the `of_base` coefficients of the base.
    columns: Vec<Vec<f64>>,
    of_base: usize,
    changes: Vec<Change>,
    /// `None` if the stamps are even.
    on_even_stamps: Option<Linear>,
}

/// A model on some rows: derivatives of the simulated force, and the residual.
struct Linear {
    columns: Vec<Vec<f64>>,
    residual_n: Vec<f64>,
}

impl<'a> Intervals<'a> {
    /// Simulates what the intervals of `fitted` need.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if the work was cancelled.
    pub(super) fn new(
        joint: &'a Joint<'a>,
        fitted: &'a Fitted,
        block_s: f64,
        contents: Contents,
    ) -> Result<Self, Error> {
        let (columns, of_base) = joint.jacobian(fitted)?;
        let (changes, on_even_stamps) = match contents {
            Contents::Chance => (Vec::new(), None),
            Contents::All => (
                variants::changes(joint.rows, &fitted.model, &fitted.predicted_n),
                on_even_stamps(joint, fitted)?,
            ),
        };
        Ok(Self { joint, fitted, block_s, columns, of_base, changes, on_even_stamps })
    }

    /// The parameters of effect number `index` with their intervals.
    pub(super) fn of(&self, index: usize) -> Vec<FoundParameter> {
        let effects = self.fitted.model.effects().as_slice();
        let first = self.of_base + effects[..index].iter().map(|e| e.parameters().len()).sum::<usize>();
        let effect = effects[index].effect();
        let parameters = effect.parameters().iter().zip(effects[index].parameters());
        let found = |(j, (parameter, value)): (usize, (&Parameter, &f64))| FoundParameter {
            name: parameter.name,
            value: *value,
            ci95: self.ci95(first + j, *value),
            range: self.joint.ranges.of(effect, j, parameter, self.joint.scales.size(parameter.scale)),
        };
        parameters.enumerate().map(found).collect()
    }

    /// The intervals of the amount and the parameters of term number `index`. The force does not change with the place of a sharp step while the
    /// step is between two rows, so a derivative says nothing about it; its width, the narrowest that was tried, is the interval then.
    pub(super) fn of_term(&self, index: usize) -> Vec<[f64; 2]> {
        let (effects, terms) = (self.fitted.model.effects().as_slice(), self.fitted.model.effects().terms());
        let of_effects = effects.iter().map(|e| e.parameters().len()).sum::<usize>();
        let before = terms.iter().take(index).map(|term| term.values().len()).sum::<usize>();
        let own = terms.iter().nth(index).map_or(&[][..], Term::values);
        let first = self.of_base + of_effects + before;
        let mut found: Vec<[f64; 2]> =
            own.iter().enumerate().map(|(j, value)| self.ci95(first + j, *value)).collect();
        if let Some(term) = terms.iter().nth(index)
            && let (_, _, Form::Step) = term.kind()
            && let ([at, width], [low, high]) =
                ([term.parameters()[0], term.parameters()[1]], term.confirmed_in())
            && width < SHARP * (high - low)
        {
            found[1..].copy_from_slice(&[[at - width, at + width], [0.0, width]]);
        }
        found
    }

    /// The interval of the number with the derivative `column`, found as `value`.
    fn ci95(&self, column: usize, value: f64) -> [f64; 2] {
        let (basis, own) = own(&self.columns, column);
        let information = dot(&own, &own);
        let residual_n = &self.fitted.residual_n;
        let series: Vec<f64> = own.iter().zip(residual_n).map(|(g, r)| g * r).collect();
        let blocks = Blocks::against(self.joint.rows, &series, self.block_s);
        let out = left_out(basis, &own, residual_n, &blocks);
        let count = out.len() as f64;
        let chance = t95(out.len()) * (dot(&out, &out) * (count - 1.0).max(1.0) / count).sqrt();
        let (mut middle, mut squares) = (value, chance * chance);
        for change in &self.changes {
            let shift = -dot(&own, &change.force_n) / information;
            middle += change.share * shift;
            squares += (change.margin * shift).powi(2);
        }
        if let Some(even) = &self.on_even_stamps {
            let (_, own) = self::own(&even.columns, column);
            let power = dot(&own, &own);
            let shift = if power > 0.0 { dot(&own, &even.residual_n) / power } else { 0.0 };
            let [share, margin] = variants::EVEN_STAMPS;
            middle += share * shift;
            squares += (margin * shift).powi(2);
        }
        let half = squares.sqrt();
        [value.min(middle - half), value.max(middle + half)]
    }
}

/// The basis of all columns but number `column`, and that column projected off it.
fn own(columns: &[Vec<f64>], column: usize) -> (Basis, Vec<f64>) {
    let others = columns.iter().enumerate().filter(|(k, _)| *k != column).map(|(_, c)| c.clone());
    let mut own = columns[column].clone();
    let basis = Basis::of(others);
    basis.take_out(&mut own);
    (basis, own)
}

/// Change of the number whose derivative has the part `own` to itself, when each of `blocks` in turn is left out. `basis` spans the other
/// derivatives.
fn left_out(basis: Basis, own: &[f64], residual_n: &[f64], blocks: &Blocks) -> Vec<f64> {
    let length = dot(own, own).sqrt();
    let mut columns = basis.into_columns();
    columns.push(own.iter().map(|value| value / length).collect());
    let n = columns.len();
    let mut squares = vec![DMatrix::<f64>::identity(n, n); blocks.count()];
    let mut sums = vec![DVector::<f64>::zeros(n); blocks.count()];
    let mut row = DVector::<f64>::zeros(n);
    for (k, (r, block)) in residual_n.iter().zip(blocks.of_row()).enumerate() {
        row.iter_mut().zip(&columns).for_each(|(value, column)| *value = column[k]);
        squares[*block].ger(-1.0, &row, &row, 1.0);
        sums[*block].axpy(*r, &row, 1.0);
    }
    let out = |(mut square, sum): (DMatrix<f64>, DVector<f64>)| {
        // A direction that one block alone determines has no sum in it, and no part in the change. Without a solution, for instance because a
        // derivative is not finite, nothing is known of the number.
        (0..n).for_each(|j| square[(j, j)] += ALONE);
        square.cholesky().map_or(f64::INFINITY, |factors| -factors.solve(&sum)[n - 1] / length)
    };
    squares.into_iter().zip(sums).map(out).collect()
}

/// `fitted` on the same rows with even stamps; `None` if they are even, or if the simulation is not finite there.
fn on_even_stamps(joint: &Joint, fitted: &Fitted) -> Result<Option<Linear>, Error> {
    let runs = joint.rows.runs().iter().map(|run| run.dataset);
    let even: Vec<Option<Dataset>> = runs.clone().map(variants::even_stamps).collect();
    if even.iter().all(Option::is_none) {
        return Ok(None);
    }
    let datasets: Vec<Dataset> =
        even.into_iter().zip(runs).map(|(even, run)| even.unwrap_or_else(|| run.clone())).collect();
    let rows = joint.rows.with_datasets(&datasets);
    let Some(fitted) = Fitted::as_is(fitted.model, &rows) else { return Ok(None) };
    let (columns, _) = Joint { rows: &rows, ..*joint }.jacobian(&fitted)?;
    Ok(Some(Linear { columns, residual_n: fitted.residual_n }))
}
