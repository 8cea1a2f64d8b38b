use super::*;
use crate::condition::{Conditioning, VelocitySource};
use crate::force::{FuzzyTanh, TanhFunction};
use crate::identify::DatasetOptions;
use crate::identify::levels::Memberships;
use crate::identify::scales::Scales;
use crate::identify::tanh_columns::{PER_FUNCTION, TanhColumns};
use crate::sample::{DriveKind, Run, Stamp, Trace};

static NEVER: AtomicBool = AtomicBool::new(false);

fn made(apply_to: ApplyTo) -> (Vec<Dataset>, Memberships) {
    let trace = |f: &dyn Fn(f64) -> f64| Trace {
        // Steps of two lengths, so that the filter's coefficients change.
        stamps: (0..900).map(|k| Stamp::from_nanos(k * 1_000_000 + (k % 2) * 300_000)).collect(),
        values: (0..900).map(|k| f(f64::from(k) * 1e-3)).collect(),
    };
    let conditioning = Conditioning { apply_to, velocity: VelocitySource::Slope, ..Conditioning::default() };
    let run = |force_n: f64| Run {
        name: "made".to_owned(),
        displacement_m: trace(&|t| 0.01 * (13.0 * t).sin()),
        drive: Some((DriveKind::CoilCurrent, trace(&|t| 0.5 + 0.5 * (3.0 * t).sin()))),
        force_n: Some(trace(&|t| force_n + 400.0 * (12.0 * t).cos())),
        ..Run::default()
    };
    let datasets = [30.0, -80.0]
        .iter()
        .map(|f| Dataset::from_run(&run(*f), &conditioning, &DatasetOptions::default()).expect("conditions"))
        .collect();
    (datasets, Memberships::given(DriveKind::CoilCurrent, &[0.0, 0.5, 1.0], Some(0.3)).expect("sets"))
}

fn columns(datasets: &[Dataset], memberships: &Memberships) -> TanhColumns {
    let scales = Scales::of(datasets).expect("moving data");
    TanhColumns { sets: memberships.sets, scales }
}

const POINT: [f64; 12] = [80.0, 400.0, 3.9, -0.5, 300.0, 600.0, 3.2, 1.5, 650.0, -200.0, 2.5, 4.0];

#[test]
fn gradient_matches_differences_of_the_cost() {
    for apply_to in [ApplyTo::None, ApplyTo::Inputs, ApplyTo::Output] {
        let (datasets, memberships) = made(apply_to);
        let problem = RowProblem::new(&datasets[..], columns(&datasets, &memberships), &NEVER);
        let here = problem.normal(&POINT).expect("not cancelled");
        for j in 0..POINT.len() {
            let step = 1e-5 * POINT[j].abs();
            let at = |sign: f64| {
                let mut p = POINT;
                p[j] += sign * step;
                problem.normal(&p).expect("not cancelled")
            };
            let (below, above) = (at(-1.0), at(1.0));
            let slope = (above.cost - below.cost) / (4.0 * step);
            let size = here.square[(j, j)].sqrt() * here.cost.sqrt();
            assert!((here.gradient[j] - slope).abs() < 1e-6 * size, "{apply_to:?} {j}: {slope}");
        }
    }
}

#[test]
fn square_matches_a_numerical_jacobian() {
    // Residuals of the model at shifted parameters give the Jacobian by central differences.
    let (datasets, memberships) = made(ApplyTo::None);
    let problem = RowProblem::new(&datasets[..], columns(&datasets, &memberships), &NEVER);
    let here = problem.normal(&POINT).expect("not cancelled");
    let residuals = |p: &[f64]| -> Vec<DVector<f64>> {
        let functions: Vec<TanhFunction> =
            p.chunks(PER_FUNCTION).map(|p| TanhFunction::new([p[0], p[1], p[2].exp(), p[3]])).collect();
        let model = FuzzyTanh::new(memberships.sets, &functions, 0.0);
        let model = model.expect("a model");
        let one = |dataset: &Dataset| {
            let rows = dataset.rows.iter().filter(|row| row.counts);
            let r: Vec<f64> = rows
                .map(|row| model.force_n(row.displacement_m, row.velocity_m_s, row.drive) - row.force_n)
                .collect();
            let mean = r.iter().sum::<f64>() / r.len() as f64;
            DVector::from_vec(r).add_scalar(-mean)
        };
        datasets.iter().map(one).collect()
    };
    let cost: f64 = residuals(&POINT).iter().map(DVector::norm_squared).sum();
    assert!((here.cost / cost - 1.0).abs() < 1e-9, "{} {cost}", here.cost);
    let column = |j: usize| -> Vec<DVector<f64>> {
        let step = 1e-5 * POINT[j].abs();
        let at = |sign: f64| {
            let mut p = POINT;
            p[j] += sign * step;
            residuals(&p)
        };
        at(1.0).iter().zip(at(-1.0)).map(|(a, b)| (a - b) / (2.0 * step)).collect()
    };
    let columns: Vec<Vec<DVector<f64>>> = (0..POINT.len()).map(column).collect();
    for i in 0..POINT.len() {
        for j in 0..POINT.len() {
            let product: f64 = columns[i].iter().zip(&columns[j]).map(|(a, b)| a.dot(b)).sum();
            let size = (here.square[(i, i)] * here.square[(j, j)]).sqrt();
            assert!((here.square[(i, j)] - product).abs() < 1e-6 * size, "{i} {j}");
        }
    }
    let mean: Vec<f64> = problem.offsets_n(&POINT);
    assert!((mean[0] - mean[1] - 110.0).abs() < 1e-9, "{mean:?}");
}

#[test]
fn a_prior_adds_its_cost_times_its_weight() {
    for apply_to in [ApplyTo::None, ApplyTo::Output] {
        let (datasets, memberships) = made(apply_to);
        let at_point = |training: Training| {
            let problem = RowProblem::new(training, columns(&datasets, &memberships), &NEVER);
            problem.normal(&POINT).expect("not cancelled")
        };
        let [measured, assumed] = [&datasets[..1], &datasets[1..]].map(|runs| at_point(runs.into()));
        let prior = Prior { run: datasets[1].clone(), weight: 0.3 };
        let both = at_point(Training { runs: &datasets[..1], prior: Some(&prior) });
        let expected = measured.cost + 0.3 * assumed.cost;
        assert!((both.cost / expected - 1.0).abs() < 1e-12, "{} {expected}", both.cost);
        let difference = &both.gradient - &measured.gradient - 0.3 * &assumed.gradient;
        assert!(difference.norm() < 1e-12 * both.gradient.norm(), "{difference}");
    }
}

/// Rows at 512 Hz whose drive is `level(t)`.
fn driven(seconds: usize, level: impl Fn(f64) -> f64) -> Rows {
    let mut rows = Rows::none(0.0, 1.0);
    for k in 0..seconds * 512 {
        rows.drive.push(level(k as f64 / 512.0));
        rows.counts.push(true);
        rows.dt_s.push(1.0 / 512.0);
        for values in [
            &mut rows.displacement_m,
            &mut rows.velocity_m_s,
            &mut rows.acceleration_m_s2,
            &mut rows.force_n,
            &mut rows.basis,
        ] {
            values.push(0.0);
        }
    }
    rows
}

#[test]
fn a_sample_for_a_model_with_memory_shows_every_level_of_the_drive() {
    // Seven levels of 3 s, at the same times in both runs: long stretches show one or two of them.
    let held = [1, 2].map(|_| driven(21, |t| 0.4 * (t / 3.0).floor()));
    let sample = stretches(&held, 1, 10);
    for level in (0..7).map(|k| 0.4 * f64::from(k)) {
        let counted = sample.iter().flat_map(|rows| rows.drive.iter().zip(&rows.counts));
        let rows = counted.filter(|(drive, counts)| **counts && (**drive - level).abs() < 1e-9).count();
        assert!(rows >= 100, "{level} A: {rows} rows");
    }
    // A drive that changes within every stretch keeps the longest stretches.
    let varied = [1, 2].map(|_| driven(21, |t| 1.2 + 1.2 * (40.0 * t).sin()));
    let sample = stretches(&varied, 1, 10);
    assert_eq!(sample.iter().map(Rows::len).collect::<Vec<_>>(), [1536, 1536]);
    assert!(sample.iter().all(|rows| rows.counts.iter().filter(|counts| !**counts).count() == 2 * WARM_UP));
    // One level in all runs is covered by any sample.
    let constant = [driven(21, |_| 1.2)];
    assert_eq!(stretches(&constant, 1, 10)[0].len(), 1536);
}
