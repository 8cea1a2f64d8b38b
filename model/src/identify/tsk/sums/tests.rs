//! Compares the sums with row-by-row sums of the equations, and slopes with numerical differences.

use super::*;
use crate::force::tsk::NUMBERS;
use crate::force::{Shape, Signal, TskSet};
use crate::sample::DriveKind;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

static GO_ON: AtomicBool = AtomicBool::new(false);

/// Numbers of `count` sets of one shape, evenly over -1 to 1, placed so that no row lies exactly on a peak.
fn sets(shape: Shape, count: usize) -> Vec<[f64; NUMBERS]> {
    let spacing = 2.0 / (count.max(2) - 1) as f64;
    let peak = |j: usize| -1.0 + spacing * j as f64 + 0.03;
    let one = |j: usize| match shape {
        Shape::Gaussian => [peak(j), 0.7 * spacing, 0.0, 0.0],
        Shape::Bell => [0.6 * spacing, 1.7, peak(j), 0.0],
        Shape::Triangle => [peak(j) - spacing, peak(j), peak(j) + spacing, 0.0],
        other => panic!("{} is not trained", other.name()),
    };
    (0..count).map(one).collect()
}

fn input(signal: Signal, shape: Shape, numbers: &[[f64; NUMBERS]]) -> TskInput {
    let set = |n: &[f64; NUMBERS]| TskSet::of(shape, *n);
    TskInput::new(signal, 0.0, 1.0, &numbers.iter().map(set).collect::<Vec<_>>()).expect("an input")
}

/// A problem with the given number of sets per input, and `width` numbers per conclusion.
struct Problem {
    shape: Shape,
    numbers: Vec<Vec<[f64; NUMBERS]>>,
    sums: Sums<'static>,
}

impl Problem {
    fn new(shape: Shape, sets_of_each: &[usize], width: usize) -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(3);
        let mut counts = [1; MAX_INPUTS];
        counts[..sets_of_each.len()].copy_from_slice(sets_of_each);
        // One row more than a chunk plus some groups, and one run that fills neither.
        let runs = [CHUNK + 2 * GROUP + 1, 3].map(|len| {
            let draw = |_| {
                let mut u = [0.0; MAX_INPUTS];
                u[..sets_of_each.len()].fill_with(|| random.random_range(-1.2..1.2));
                u
            };
            let u: Vec<_> = (0..len).map(draw).collect();
            let force: Vec<f64> =
                u.iter().map(|[a, b, c]| f64::tanh(2.0 * a + b) + 0.3 * c + a * b).collect();
            let mean = force.iter().sum::<f64>() / len as f64;
            Rows { u, target: force.iter().map(|f| f - mean).collect() }
        });
        let sums = Sums {
            runs: runs.to_vec(),
            counts,
            width,
            sparse: shape == Shape::Triangle,
            parallel: false,
            cancel: &GO_ON,
        };
        Self { shape, numbers: sets_of_each.iter().map(|count| sets(shape, *count)).collect(), sums }
    }

    fn inputs(&self) -> Vec<TskInput> {
        let signals = [Signal::Displacement, Signal::Velocity, Signal::Drive(DriveKind::CoilCurrent)];
        signals.into_iter().zip(&self.numbers).map(|(s, n)| input(s, self.shape, n)).collect()
    }

    /// Regressors of every row of each run: z_a times the product of the weights, ordered by coefficient.
    fn regressors(&self) -> Vec<Vec<DVector<f64>>> {
        let inputs = self.inputs();
        let [n0, n1, n2] = self.sums.counts;
        let row = |u: &[f64; MAX_INPUTS]| {
            let w: Vec<Vec<f64>> = (0..MAX_INPUTS)
                .map(|d| inputs.get(d).map_or(vec![1.0], |input| input.weights(u[d]).to_vec()))
                .collect();
            let z = [&u[..self.sums.width - 1], &[1.0]].concat();
            let mut phi = Vec::new();
            for z in z {
                for j in 0..n0 {
                    for k in 0..n1 {
                        phi.extend((0..n2).map(|l| z * w[0][j] * w[1][k] * w[2][l]));
                    }
                }
            }
            DVector::from_vec(phi)
        };
        self.sums.runs.iter().map(|run| run.u.iter().map(row).collect()).collect()
    }
}

fn centred(rows: &[DVector<f64>]) -> Vec<DVector<f64>> {
    let mean = rows.iter().sum::<DVector<f64>>() / rows.len() as f64;
    rows.iter().map(|row| row - &mean).collect()
}

fn alike(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, |most: f64, v| most.max(v.abs()));
    let off = most(&mut found.iter().zip(expected).map(|(a, b)| a - b));
    let size = most(&mut expected.iter().copied()).max(1e-3);
    assert!(off < tolerance * size, "{what}: {off:.1e} of {size:.1e}");
}

fn problems() -> [Problem; 6] {
    [
        Problem::new(Shape::Bell, &[3, 2, 4], 4),
        Problem::new(Shape::Gaussian, &[3, 2, 4], 4),
        Problem::new(Shape::Gaussian, &[4, 3], 3),
        Problem::new(Shape::Gaussian, &[2, 3, 2], 1),
        Problem::new(Shape::Triangle, &[3, 4, 2], 4),
        Problem::new(Shape::Triangle, &[5], 2),
    ]
}

#[test]
fn sums_for_the_conclusions_match_row_by_row_sums() {
    for problem in problems() {
        let (sums, regressors) = (&problem.sums, problem.regressors());
        let found = sums.linear(&problem.inputs()).expect("not cancelled");
        let n = sums.len();
        assert_eq!(n, sums.counts.iter().product::<usize>() * sums.width);
        let (mut square, mut rhs, mut power) = (DMatrix::zeros(n, n), DVector::zeros(n), 0.0);
        for ((rows, run), own) in regressors.iter().zip(&sums.runs).zip(&found.run_sums) {
            let total = rows.iter().sum::<DVector<f64>>();
            alike("sums of a run", own.as_slice(), total.as_slice(), 1e-11);
            for (phi, target) in centred(rows).iter().zip(&run.target) {
                square += phi * phi.transpose();
                rhs += phi * *target;
                power += target * target;
            }
        }
        assert_eq!(found.square.shape(), square.shape());
        alike("square", found.square.as_slice(), square.as_slice(), 1e-11);
        alike("right side", found.rhs.as_slice(), rhs.as_slice(), 1e-11);
        assert!((sums.power() / power - 1.0).abs() < 1e-12);
        assert_eq!(sums.rows(), CHUNK + 2 * GROUP + 1 + 3);
    }
}

#[test]
fn sums_for_the_memberships_match_numerical_differences() {
    for mut problem in problems() {
        // Each number of each set; two of them share one parameter; with factors.
        let numbers = problem.shape.width();
        let mut links = Vec::new();
        for (input, sets) in problem.numbers.iter().enumerate() {
            for set in 0..sets.len() {
                for number in 0..numbers {
                    let parameter = links.len() - usize::from(links.len() == 1);
                    links.push(Link { parameter, input, set, number, factor: 0.5 + 0.25 * number as f64 });
                }
            }
        }
        let parameters = links.iter().map(|link| link.parameter + 1).max().expect("some");
        let regressors = problem.regressors();
        let conclusions = DVector::from_fn(problem.sums.len(), |k, _| (k as f64 * 0.7).sin());
        let mut slopes = DMatrix::zeros(problem.sums.rows(), parameters);
        for link in &links {
            const STEP: f64 = 1e-7;
            let at = problem.numbers[link.input][link.set][link.number];
            let mut outputs = |number: f64| -> Vec<f64> {
                problem.numbers[link.input][link.set][link.number] = number;
                problem.regressors().iter().flatten().map(|phi| phi.dot(&conclusions)).collect()
            };
            let (above, below) = (outputs(at + STEP), outputs(at - STEP));
            problem.numbers[link.input][link.set][link.number] = at;
            for (row, (above, below)) in above.iter().zip(&below).enumerate() {
                slopes[(row, link.parameter)] += link.factor * (above - below) / (2.0 * STEP);
            }
        }

        let linear = problem.sums.linear(&problem.inputs()).expect("not cancelled");
        let found = problem
            .sums
            .nonlinear(&problem.inputs(), &links, parameters, &conclusions, &linear.run_sums)
            .expect("not cancelled");
        let (mut cost, mut square) = (0.0, DMatrix::zeros(parameters, parameters));
        let mut gradient = DVector::zeros(parameters);
        let mut cross = DMatrix::zeros(problem.sums.len(), parameters);
        let mut first = 0;
        for (rows, run) in regressors.iter().zip(&problem.sums.runs) {
            let own: Vec<DVector<f64>> =
                (first..first + rows.len()).map(|row| slopes.row(row).transpose()).collect();
            let residual: Vec<DVector<f64>> = rows
                .iter()
                .zip(&run.target)
                .map(|(phi, target)| DVector::from_element(1, phi.dot(&conclusions) - target))
                .collect();
            for ((slope, residual), phi) in centred(&own).iter().zip(centred(&residual)).zip(centred(rows)) {
                cost += residual[0] * residual[0];
                square += slope * slope.transpose();
                gradient += slope * residual[0];
                cross += phi * slope.transpose();
            }
            first += rows.len();
        }
        assert!((found.cost / cost - 1.0).abs() < 1e-11);
        assert_eq!((found.square.shape(), found.cross.shape()), (square.shape(), cross.shape()));
        alike("square", found.square.as_slice(), square.as_slice(), 1e-5);
        alike("gradient", found.gradient.as_slice(), gradient.as_slice(), 1e-5);
        alike("cross", found.cross.as_slice(), cross.as_slice(), 1e-5);
    }
}

#[test]
fn cancelling_stops_the_sums_and_threads_do_not_change_them() {
    static STOP: AtomicBool = AtomicBool::new(true);
    let mut problem = Problem::new(Shape::Gaussian, &[3, 2, 2], 4);
    let alone = problem.sums.linear(&problem.inputs()).expect("not cancelled");
    problem.sums.parallel = true;
    let together = problem.sums.linear(&problem.inputs()).expect("not cancelled");
    assert_eq!((alone.square, alone.rhs), (together.square, together.rhs));
    problem.sums.cancel = &STOP;
    assert!(problem.sums.linear(&problem.inputs()).is_none());
}

#[test]
fn pair_index_matches_the_order_of_pair_products() {
    for n in 1..=5 {
        let values: Vec<f64> = (0..n).map(|j| (j as f64 + 2.0).sqrt()).collect();
        let mut products = vec![0.0; pair_count(n)];
        pair_products(&values, &mut products);
        for j in 0..n {
            for k in 0..n {
                assert!((products[pair_index(j, k, n)] - values[j] * values[k]).abs() < 1e-15);
            }
        }
    }
}
