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
//! changes of force d_v, and the share m_v +- w_v of each that may be real. The shift is what one step of least squares would do.
//!
//! Source: sums over blocks as in `[ibragimov2010]` in the bibliography (node/docs/guide/bibliography.md). Independent
//! uncertainties add in quadrature: Guide to the Expression of Uncertainty in Measurement (JCGM 100:2008, 5.1.2).

use super::basis::Basis;
use super::blocks::Blocks;
use super::finding::FoundParameter;
use super::joint::{Fitted, Joint};
use super::rows::dot;
use super::variants;
use crate::error::Error;
use crate::statistics::block_sums::t95;

/// What an interval contains.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Contents {
    /// Chance only. An effect is accepted or refused by this interval.
    Chance,
    /// Chance and the variants. This interval is reported.
    All,
}

/// The parameters of effect number `index` of `fitted` with their intervals, from blocks of at least `block_s`.
///
/// # Errors
/// [`Error::Cancelled`] if the work was cancelled.
pub(super) fn parameters(
    joint: &Joint,
    fitted: &Fitted,
    index: usize,
    block_s: f64,
    contents: Contents,
) -> Result<Vec<FoundParameter>, Error> {
    let (columns, of_base) = joint.jacobian(fitted)?;
    let changes = match contents {
        Contents::Chance => Vec::new(),
        Contents::All => variants::changes(joint.rows, &fitted.model, &fitted.predicted_n),
    };
    let effects = fitted.model.effects().as_slice();
    let first = of_base + effects[..index].iter().map(|e| e.parameters().len()).sum::<usize>();
    let effect = &effects[index];
    let mut all = Vec::new();
    for (j, (parameter, value)) in effect.effect().parameters().iter().zip(effect.parameters()).enumerate() {
        let others = columns.iter().enumerate().filter(|(k, _)| *k != first + j).map(|(_, c)| c.clone());
        let mut own = columns[first + j].clone();
        Basis::of(others).take_out(&mut own);
        let information = dot(&own, &own);
        let series: Vec<f64> = own.iter().zip(&fitted.residual_n).map(|(g, r)| g * r).collect();
        let sums = Blocks::against(joint.rows, &series, block_s).sums(&own, &fitted.residual_n);
        let count = sums.len() as f64;
        let chance =
            t95(sums.len()) * (dot(&sums, &sums) * count / (count - 1.0).max(1.0)).sqrt() / information;
        let (mut middle, mut squares) = (*value, chance * chance);
        for change in &changes {
            let shift = -dot(&own, &change.force_n) / information;
            middle += change.share * shift;
            squares += (change.margin * shift).powi(2);
        }
        let half = squares.sqrt();
        all.push(FoundParameter {
            name: parameter.name,
            value: *value,
            ci95: [value.min(middle - half), value.max(middle + half)],
            range: parameter.range_at(joint.scales.size(parameter.scale)),
        });
    }
    Ok(all)
}
