//! Derivatives of a simulation by the numbers of a model.
//!
//! ```text
//! dF/dp = (dF/dp_1, dF/dp_2, ...)        each a series over the rows, each run's mean removed
//! ```
//!
//! They are exact: the whole simulator runs on numbers that carry derivatives ([`Jet`]), [`DIRECTIONS`] at a time, through filters,
//! internal states and effects. A pass takes the time of a few simulations, where finite differences take one for each number. A base
//! that is not a law or fuzzy-tanh has no such form. It is used in paired mode only, where it is not refitted, and the derivatives by the
//! few parameters of its effects are finite differences.

use super::joint::{Joint, Nearby};
use super::space::Space;
use crate::effect::AugmentedOnJets;
use crate::force::jet::Jet;
use rayon::prelude::*;

/// Derivatives in one pass.
const DIRECTIONS: usize = 8;

/// The derivatives at `at`, where the simulated force is `predicted_n`. A derivative that is not finite is zeros. Derivatives in `known` are
/// used as they are. Numbers that are not in `wanted` have an empty one. `None` if the work was cancelled.
pub(super) fn columns(
    joint: &Joint,
    space: &Space,
    at: &[f64],
    predicted_n: &[f64],
    wanted: &[bool],
    mut known: Nearby,
) -> Option<Vec<Vec<f64>>> {
    known.resize(at.len(), None);
    let needed: Vec<usize> = (0..at.len()).filter(|&j| wanted[j] && known[j].is_none()).collect();
    let found: Option<Vec<Vec<Vec<f64>>>> = needed
        .par_chunks(DIRECTIONS)
        .map(|numbers| {
            if joint.watch.is_cancelled() {
                return None;
            }
            Some(match on_jets(space, at, numbers) {
                Some(model) => joint.rows.derivatives(&model, numbers.len()),
                None => numbers.iter().map(|j| difference(joint, space, at, predicted_n, *j)).collect(),
            })
        })
        .collect();
    for (j, column) in needed.into_iter().zip(found?.into_iter().flatten()) {
        known[j] = Some(column);
    }
    Some(known.into_iter().map(Option::unwrap_or_default).collect())
}

/// The model at `at` with one direction for each of `numbers`; `None` if its base has no derivatives.
fn on_jets(space: &Space, at: &[f64], numbers: &[usize]) -> Option<AugmentedOnJets<DIRECTIONS>> {
    // Coefficients of a base that is not refitted are not among the numbers of the space.
    let fixed = space.fixed();
    AugmentedOnJets::new(&space.model(at)?, |number, value| {
        let number = number.checked_sub(fixed);
        match numbers.iter().position(|j| Some(*j) == number) {
            Some(direction) => Jet::variable(value, direction),
            None => Jet::from(value),
        }
    })
}

/// The derivative by number `j` as a finite difference.
fn difference(joint: &Joint, space: &Space, at: &[f64], predicted_n: &[f64], j: usize) -> Vec<f64> {
    let mut moved = at.to_vec();
    moved[j] += space.steps(at)[j];
    // The step as it was rounded, not as it was requested.
    let step = moved[j] - at[j];
    let by = space.model(&moved).and_then(|model| joint.rows.difference(&model, predicted_n, step));
    let Some(mut by) = by else { return vec![0.0; predicted_n.len()] };
    joint.rows.centre(&mut by);
    by
}
