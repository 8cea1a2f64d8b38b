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
use crate::parallel;

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
    let solved = match space.model(at) {
        Some(model) if !needed.is_empty() => joint.rows.solved(&model),
        _ => Vec::new(),
    };
    let directions: Vec<&[usize]> = needed.chunks(DIRECTIONS).collect();
    let of_some = |numbers: &&[usize]| -> Option<Vec<Vec<f64>>> {
        if joint.watch.is_cancelled() {
            return None;
        }
        Some(match on_jets(space, at, numbers) {
            Some(model) => joint.rows.derivatives(&model, &solved, numbers.len()),
            None => numbers.iter().map(|j| difference(joint, space, at, predicted_n, *j)).collect(),
        })
    };
    let found: Option<Vec<_>> = parallel::map(&directions, of_some).into_iter().collect();
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::ranges::Ranges;
    use crate::diagnose::rows::{Rows, dot};
    use crate::effect::{Augmented, Effect, EffectModel, Effects};
    use crate::identify::{
        Dataset, DatasetOptions, Form, ModelSpec, Options, Scales, Structure, Watch, identify_datasets,
    };
    use crate::rig::{Channels, Experiment, Plant, record};

    #[test]
    fn derivatives_behind_a_spring_are_those_of_differences() {
        let run = record(&Experiment::sine(0.01, 2.0, 1.0, 3.0), &Plant::default(), &Channels::default(), 1);
        let data = [Dataset::from_run(&run, &Default::default(), &DatasetOptions::default()).expect("rows")];
        let spec =
            ModelSpec::new(Structure::Law(crate::force::ForceLaw::BoucWen), Form::Passive).expect("a spec");
        let options = Options { restarts: 1, ..Options::default() };
        let base =
            identify_datasets(spec, &data, &options, &Watch::default()).expect("it is identified").model;
        let effect = |effect, value| EffectModel::new(effect, &[value]).expect("it is in its range");
        let effects = Effects::new(&[effect(Effect::SeriesSpring, 1e-6)]).expect("one effect");
        let model = Augmented::new(base.force, effects).expect("a model");
        let rows = Rows::new(&data, 400);
        let joint = Joint {
            rows: &rows,
            scales: Scales::of(&data).expect("scales"),
            ranges: Ranges::default(),
            base_moves: true,
            watch: &Watch::default(),
        };
        let space = Space::new(&model, joint.scales, joint.ranges, true).expect("a space");
        let (at, predicted_n) = (space.values(), rows.predict(&model).expect("it is finite"));
        let all = vec![true; at.len()];
        let found = columns(&joint, &space, &at, &predicted_n, &all, Nearby::new()).expect("not cancelled");
        for (j, column) in found.iter().enumerate() {
            let expected = difference(&joint, &space, &at, &predicted_n, j);
            let missed: Vec<f64> = column.iter().zip(&expected).map(|(a, b)| a - b).collect();
            let share = (dot(&missed, &missed) / dot(&expected, &expected)).sqrt();
            // The spring passes each change of branch of the law on to all later samples, where a difference lies between two derivatives.
            assert!(share < 2e-2, "number {j}: {share}");
        }
    }
}
