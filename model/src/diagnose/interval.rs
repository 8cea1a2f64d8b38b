//! The 95 % interval of each parameter of an effect.
//!
//! ```text
//! chance      = t95 sd(S_b) sqrt(B) / g'g            S_b = sum of g r over block b of B
//! shift_v     = -g'd_v / g'g                         d_v: change of the simulated force under variant v
//! interval    = p + sum_v m_v shift_v  +-  sqrt(chance^2 + sum_v (w_v shift_v)^2),   extended to p
//! ```
//!
//! g is the derivative of the simulated force by the parameter p, projected off the derivatives by all other numbers of the model, and r
//! the residual. The scatter over blocks shows chance only. Other errors shift a parameter by the same amount on every block: how the
//! recorded channels are read between their samples, how velocity is computed, and noise in the inputs. [`super::variants`] gives the
//! changes of force d_v, and the share m_v +- w_v of each that may be real. The shift is what one step of least squares would do. For even
//! stamps it is g'r / g'g, with g and r of the changed rows.
//!
//! Source: sums over blocks as in `[ibragimov2010]` in the bibliography (node/docs/guide/bibliography.md). Independent
//! uncertainties add in quadrature: Guide to the Expression of Uncertainty in Measurement (JCGM 100:2008, 5.1.2).

use super::basis::Basis;
use super::blocks::Blocks;
use super::finding::FoundParameter;
use super::joint::{Fitted, Joint};
use super::rows::dot;
use super::variants::{self, Change};
use crate::effect::Parameter;
use crate::error::Error;
use crate::identify::Dataset;
use crate::statistics::block_sums::t95;

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

    /// The interval of the number with the derivative `column`, found as `value`.
    fn ci95(&self, column: usize, value: f64) -> [f64; 2] {
        let own = own(&self.columns, column);
        let information = dot(&own, &own);
        let residual_n = &self.fitted.residual_n;
        let series: Vec<f64> = own.iter().zip(residual_n).map(|(g, r)| g * r).collect();
        let sums = Blocks::against(self.joint.rows, &series, self.block_s).sums(&own, residual_n);
        let count = sums.len() as f64;
        let chance =
            t95(sums.len()) * (dot(&sums, &sums) * count / (count - 1.0).max(1.0)).sqrt() / information;
        let (mut middle, mut squares) = (value, chance * chance);
        for change in &self.changes {
            let shift = -dot(&own, &change.force_n) / information;
            middle += change.share * shift;
            squares += (change.margin * shift).powi(2);
        }
        if let Some(even) = &self.on_even_stamps {
            let own = self::own(&even.columns, column);
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

/// Column number `column`, projected off the others.
fn own(columns: &[Vec<f64>], column: usize) -> Vec<f64> {
    let others = columns.iter().enumerate().filter(|(k, _)| *k != column).map(|(_, c)| c.clone());
    let mut own = columns[column].clone();
    Basis::of(others).take_out(&mut own);
    own
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
