//! Compares the gradient with numerical differences of an error that is written directly from the equations, and trains
//! on planted functions.

use super::super::premises::{Axis, Trained};
use super::super::sums::Rows;
use super::*;
use crate::force::{Signal, TskSet};
use crate::numbers::agrees;
use crate::sample::DriveKind;
use rand_pcg::Pcg64Mcg;
use std::sync::atomic::AtomicBool;

static GO_ON: AtomicBool = AtomicBool::new(false);

/// One list of the unknowns.
type Numbers = fn(&mut Unknowns) -> &mut Vec<f64>;

fn uniform(random: &mut Pcg64Mcg, low: f64, high: f64) -> f64 {
    low + (high - low) * random.random::<f64>()
}

/// Sets per input over -1 to 1, and two runs of `lens` rows with targets `target(u)` without their means.
fn problem(
    shape: Trained,
    sets: &[usize],
    width: usize,
    lens: [usize; 2],
    target: impl Fn(&[f64; MAX_INPUTS]) -> f64,
) -> (Sums<'static>, Premises) {
    let signals = [Signal::Displacement, Signal::Velocity, Signal::Drive(DriveKind::CoilCurrent)];
    let axis = |(signal, sets): (Signal, &usize)| Axis {
        signal,
        mean: 0.0,
        std_dev: 1.0,
        range: [-1.0, 1.0],
        sets: *sets,
    };
    let premises = Premises { axes: signals.into_iter().zip(sets).map(axis).collect(), shape };
    let mut counts = [1; MAX_INPUTS];
    counts[..sets.len()].copy_from_slice(sets);
    let mut random = evolve::stream(9, 0, 0);
    let runs = lens.map(|len| {
        let mut rows = Rows::default();
        for _ in 0..len {
            let mut u = [0.0; MAX_INPUTS];
            u[..sets.len()].fill_with(|| uniform(&mut random, -1.0, 1.0));
            rows.target.push(target(&u));
            rows.u.push(u);
        }
        let mean = rows.target.iter().sum::<f64>() / len as f64;
        rows.target.iter_mut().for_each(|t| *t -= mean);
        rows
    });
    let sums = Sums {
        runs: runs.to_vec(),
        counts,
        width,
        sparse: shape.is_sparse(),
        parallel: false,
        cancel: &GO_ON,
    };
    (sums, premises)
}

/// Value of a set, from MATLAB's formulas; triangles have shoulders.
fn value(set: TskSet, u: f64, first: bool, last: bool) -> f64 {
    match set {
        TskSet::Gaussian { centre, sigma } => (-0.5 * ((u - centre) / sigma).powi(2)).exp(),
        TskSet::Bell { half_width, exponent, centre } => {
            1.0 / (1.0 + ((u - centre) / half_width).abs().powf(2.0 * exponent))
        }
        TskSet::Triangle { left, peak, right } => {
            let rise = if first { 1.0 } else { (u - left) / (peak - left) };
            let fall = if last { 1.0 } else { (right - u) / (right - peak) };
            rise.min(fall).clamp(0.0, 1.0)
        }
        other => panic!("{other:?}"),
    }
}

/// E over a batch, from the equations.
fn cost(sums: &Sums, premises: &Premises, at: &Unknowns, batch: &[Place]) -> f64 {
    let inputs = premises.inputs(&at.memberships).expect("in range");
    let [_, n1, n2] = sums.counts;
    let squares = batch.iter().map(|&(run, k)| {
        let u = &sums.runs[run].u[k];
        let (mut above, mut below) = (0.0, 0.0);
        for rule in 0..sums.rules() {
            let place = [rule / (n1 * n2), rule / n2 % n1, rule % n2];
            let strength = |(i, input): (usize, &TskInput)| {
                let set = input.sets().nth(place[i]).expect("a set");
                value(set, u[i], place[i] == 0, place[i] + 1 == input.len())
            };
            let weight: f64 = inputs.iter().enumerate().map(strength).product();
            let mut f = at.conclusions[(sums.width - 1) * sums.rules() + rule];
            for (a, u) in u.iter().enumerate().take(sums.width - 1) {
                f += at.conclusions[a * sums.rules() + rule] * u;
            }
            above += weight * f;
            below += weight;
        }
        (at.offsets[run] + above / below - sums.runs[run].target[k]).powi(2)
    });
    squares.sum::<f64>() / (2.0 * batch.len() as f64)
}

#[test]
fn the_gradient_matches_numerical_differences() {
    for (shape, sets, width) in [
        (Trained::Triangle, &[5, 5, 5][..], 1),
        (Trained::Triangle, &[4, 3], 1),
        (Trained::Bell, &[3, 2, 4], 4),
        (Trained::Gaussian, &[3, 3], 3),
    ] {
        let (sums, premises) = problem(shape, sets, width, [40, 25], |u| (2.0 * u[0] + u[1]).tanh());
        let mut random = evolve::stream(4, 0, 0);
        let mut draw = |around: &[f64], by: f64| -> Vec<f64> {
            around.iter().map(|x| x + uniform(&mut random, -by, by)).collect()
        };
        let at = Unknowns {
            memberships: draw(&premises.start(), 0.2),
            conclusions: draw(&vec![0.0; sums.len()], 1.0),
            offsets: draw(&[0.0; 2], 0.5),
        };
        let batch: Vec<Place> = (0..40).step_by(3).map(|k| (0, k)).chain((0..25).map(|k| (1, k))).collect();
        let inputs = premises.inputs(&at.memberships).expect("in range");
        let found = gradient(&sums, &inputs, &premises.links(&at.memberships), &at, &batch);
        let difference = |numbers: Numbers, k: usize| {
            const STEP: f64 = 1e-6;
            let moved = |by: f64| {
                let mut moved = at.clone();
                numbers(&mut moved)[k] += by;
                cost(&sums, &premises, &moved, &batch)
            };
            (moved(STEP) - moved(-STEP)) / (2.0 * STEP)
        };
        let parts: [(&str, &[f64], Numbers); 3] = [
            ("memberships", &found.memberships, |u| &mut u.memberships),
            ("conclusions", &found.conclusions, |u| &mut u.conclusions),
            ("offsets", &found.offsets, |u| &mut u.offsets),
        ];
        for (part, found, numbers) in parts {
            assert!(found.iter().any(|g| *g != 0.0), "{part}");
            for (k, found) in found.iter().enumerate() {
                let expected = difference(numbers, k);
                assert!((found - expected).abs() < 1e-7, "{shape:?} {part} {k}: {found} {expected}");
            }
        }
    }
}

#[test]
fn a_planted_system_is_found_without_least_squares() {
    // Five triangles at -1, -0.4, 0, 0.4, 1 over both inputs: not the uniform grid where training starts.
    let peaks = [-1.0, -0.4, 0.0, 0.4, 1.0];
    let corner = |u: f64| {
        let heights = [-1.0, -0.9, 0.0, 0.9, 1.0];
        let j = peaks.iter().rposition(|p| u >= *p).unwrap_or(0).min(3);
        heights[j] + (heights[j + 1] - heights[j]) * (u - peaks[j]) / (peaks[j + 1] - peaks[j])
    };
    let (sums, premises) =
        problem(Trained::Triangle, &[5, 5], 1, [3000, 1000], |u| corner(u[0]) * (1.0 + 0.5 * u[1]));
    let (found, errors) =
        descend(&sums, &premises, &BackPropagation::default(), &Watch::none()).expect("not cancelled");
    let share = |error: f64| error / sums.power();
    assert!(errors.windows(2).all(|pair| pair[1] <= pair[0]), "{errors:?}");
    assert!(share(errors[59]) < 1e-3 && share(errors[59]) < 0.1 * share(errors[0]), "{errors:?}");
    let learned: Vec<f64> =
        premises.inputs(&found.memberships).expect("in range")[0].sets().map(|s| s.top()).collect();
    assert!(learned.iter().zip(peaks).all(|(a, b)| (a - b).abs() < 0.1), "{learned:?}");
    let bounds = premises.bounds();
    assert!(found.memberships.iter().zip(&bounds).all(|(m, b)| (b[0]..=b[1]).contains(m)));
}

#[test]
fn the_seed_decides_and_threads_do_not() {
    let (mut sums, premises) = problem(Trained::Triangle, &[5, 5], 1, [2500, 300], |u| u[0] * u[1]);
    let mut trained = |parallel, seed| {
        sums.parallel = parallel;
        let settings = BackPropagation { epochs: 3, seed, ..BackPropagation::default() };
        descend(&sums, &premises, &settings, &Watch::none()).expect("not cancelled")
    };
    assert_eq!(trained(true, 1), trained(false, 1));
    assert_ne!(trained(true, 1), trained(true, 2));
}

/// Ahn et al. in numpy: complex steps give the gradient, and one batch of all rows makes the order of rows irrelevant.
#[test]
fn epochs_of_gradient_descent_give_the_unknowns_of_numpy() {
    let (_, premises) = problem(Trained::Triangle, &[5, 4], 1, [1, 1], |_| 0.0);
    let runs = [(0.0, 60), (1.0, 40)].map(|(r, count)| {
        let mut rows = Rows::default();
        for k in (0..count).map(f64::from) {
            let u = [(0.7 * k + r + 0.1).sin(), (1.3 * k + 2.0 * r + 0.2).cos(), 0.0];
            rows.target.push((2.0 * u[0]).tanh() + 0.5 * u[1] * u[0]);
            rows.u.push(u);
        }
        let mean = rows.target.iter().sum::<f64>() / f64::from(count);
        rows.target.iter_mut().for_each(|t| *t -= mean);
        rows
    });
    let sums = Sums {
        runs: runs.to_vec(),
        counts: [5, 4, 1],
        width: 1,
        sparse: true,
        parallel: false,
        cancel: &GO_ON,
    };
    let settings = BackPropagation { epochs: 40, batch: 100, ..BackPropagation::default() };
    let (found, errors) = descend(&sums, &premises, &settings, &Watch::none()).expect("not cancelled");
    for (name, found) in [
        ("memberships", &found.memberships),
        ("conclusions", &found.conclusions),
        ("offsets", &found.offsets),
        ("errors", &errors),
    ] {
        agrees(&format!("back_propagation.{name}"), found, 1e-12);
    }
}
