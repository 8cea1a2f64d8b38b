//! Identification of the fuzzy-tanh model on data with known truth.

use crate::identify_support::{Recipe, run, truth};
use mr_damper_model::Error;
use mr_damper_model::condition::{ApplyTo, Conditioning, VelocitySource};
use mr_damper_model::force::{ForceModel, FuzzyTanh};
use mr_damper_model::identify::{
    Identified, MembershipSource, ModelSpec, Options, Placement, Progress, Watch, identify,
};
use mr_damper_model::sample::{DriveKind, Run};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::{Duration, Instant};

const MEASURED: Conditioning = Conditioning {
    apply_to: ApplyTo::None,
    cutoff_hz: 20.0,
    velocity: VelocitySource::Measured,
    slope_window_s: 0.01,
};

fn options() -> Options {
    Options { conditioning: MEASURED, choose_velocity: false, restarts: 8, ..Options::default() }
}

/// Four runs of one damper with different rates, constant and stepping drives, and an offset each.
fn runs(kind: DriveKind, noise_n: f64) -> Vec<Run> {
    type Drive = fn(f64) -> f64;
    let steps: Drive = |t| [0.0, 1.0, 0.5, 0.0, 0.5, 1.0][(t / 0.3) as usize % 6];
    let recipes: [(&str, f64, Drive, f64); 4] = [
        ("a", 200.0, |_| 0.0, 45.0),
        ("b", 1000.0, |_| 0.5, -30.0),
        ("c", 512.0, |_| 1.0, 120.0),
        ("d", 1000.0, steps, 0.0),
    ];
    let model = truth(kind);
    (1..)
        .zip(recipes)
        .map(|(seed, (name, rate_hz, drive, offset_n))| {
            let recipe = Recipe { name, rate_hz, drive, offset_n, noise_n, seed, ..Recipe::default() };
            run(recipe, kind, |x, v, i| model.force_n(x, v, i))
        })
        .collect()
}

fn fuzzy(found: &Identified) -> FuzzyTanh {
    match found.model.force {
        ForceModel::FuzzyTanh(fuzzy) => fuzzy,
        _ => panic!("asked for fuzzy-tanh"),
    }
}

fn find(runs: &[Run], options: &Options) -> Identified {
    identify(ModelSpec::FUZZY_TANH, runs, options, &Watch::none()).expect("identifies")
}

#[test]
fn parameters_and_offsets_are_recovered_from_runs_with_different_rates_and_drives() {
    for kind in [DriveKind::CoilCurrent, DriveKind::CommandVoltage] {
        let found = find(&runs(kind, 4.0), &options());
        let (model, true_model) = (fuzzy(&found), truth(kind));
        assert_eq!(model.drive(), kind);
        assert_eq!(found.memberships.as_ref().expect("sets").source, MembershipSource::Levels);
        assert_eq!(model.sets(), true_model.sets());
        for (f, t) in model.functions().iter().zip(true_model.functions()) {
            assert!((f.yield_force_n / t.yield_force_n - 1.0).abs() < 0.02, "{f:?} {t:?}");
            assert!(
                (f.post_yield_damping_n_s_m / t.post_yield_damping_n_s_m - 1.0).abs() < 0.03,
                "{f:?} {t:?}"
            );
            assert!((f.pre_yield_slope_s_m / t.pre_yield_slope_s_m - 1.0).abs() < 0.03, "{f:?} {t:?}");
            assert!((f.coupling_per_s - t.coupling_per_s).abs() < 0.03, "{f:?} {t:?}");
        }
        for (run, offset_n) in found.runs.iter().zip([45.0, -30.0, 120.0, 0.0]) {
            assert!((run.force_offset_n - offset_n).abs() < 0.3, "{run:?}");
        }
        // Only the uniform noise of half width 4 N remains.
        let rsse_n = found.free_run.expect("a simulation error").rsse_n;
        assert!((rsse_n - 4.0 / 3.0_f64.sqrt()).abs() < 0.05, "{rsse_n}");
        assert!(found.converged && found.active_bounds.is_empty() && found.one_step.is_none());
        assert_eq!((found.model.rate_hz.round(), found.restart_rsse_n.len()), (200.0, 8));
        assert_eq!(found.model.envelope.drive, Some([0.0, 1.0]));
        assert_eq!(found.model.expected.free_run_rsse_n, Some(rsse_n));
    }
}

#[test]
fn the_fit_is_no_worse_than_the_truth_on_its_own_data() {
    // The truth's error is computed on the same rows, with each run's mean error removed.
    for noise_n in [1.0, 20.0, 100.0] {
        let runs = runs(DriveKind::CoilCurrent, noise_n);
        let found = find(&runs, &options());
        let mut sums = (0.0, 0.0);
        let model = truth(DriveKind::CoilCurrent);
        for run in &runs {
            let set = mr_damper_model::identify::Dataset::from_run(run, &MEASURED, &options().dataset)
                .expect("rows");
            let errors: Vec<f64> = set
                .rows
                .iter()
                .filter(|row| row.counts)
                .map(|row| row.force_n - model.force_n(row.displacement_m, row.velocity_m_s, row.drive))
                .collect();
            let mean = errors.iter().sum::<f64>() / errors.len() as f64;
            sums.0 += errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>();
            sums.1 += errors.len() as f64;
        }
        let fit = found.free_run.expect("a simulation error");
        assert_eq!(fit.samples as f64, sums.1);
        assert!(fit.rsse_n <= (sums.0 / sums.1).sqrt() * (1.0 + 1e-9), "{} {}", fit.rsse_n, sums.0 / sums.1);
    }
}

#[test]
fn a_filtered_output_gives_the_same_parameters() {
    let conditioning = Conditioning { apply_to: ApplyTo::Output, ..MEASURED };
    let found = find(&runs(DriveKind::CoilCurrent, 4.0), &Options { conditioning, ..options() });
    for (f, t) in fuzzy(&found).functions().iter().zip(truth(DriveKind::CoilCurrent).functions()) {
        assert!((f.yield_force_n / t.yield_force_n - 1.0).abs() < 0.03, "{f:?} {t:?}");
        assert!((f.coupling_per_s - t.coupling_per_s).abs() < 0.06, "{f:?} {t:?}");
    }
    let rsse_n = found.free_run.expect("a simulation error").rsse_n;
    assert!(rsse_n < 1.2, "the filter removes most of the 2.3 N of noise: {rsse_n}");
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let runs = runs(DriveKind::CoilCurrent, 20.0);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| find(&runs, &Options { seed: 7, choose_velocity: true, restarts: 4, ..options() }))
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn the_velocity_source_is_chosen_by_the_data() {
    let model = truth(DriveKind::CoilCurrent);
    let mut run = run(
        Recipe { rate_hz: 1000.0, noise_n: 5.0, drive: |_| 0.5, ..Recipe::default() },
        DriveKind::CoilCurrent,
        |x, v, i| model.force_n(x, v, i),
    );
    let options = Options { choose_velocity: true, ..options() };
    // The force has no lag, so the shortest delay is best.
    let found = find(std::slice::from_ref(&run), &options);
    assert_eq!(found.model.conditioning.velocity, VelocitySource::Backward, "{:?}", found.velocity_trials);
    // With a force lag of 5 ms, a window of about twice that is best.
    if let Some(force) = &mut run.force_n {
        force.stamps.iter_mut().for_each(|stamp| *stamp = stamp.shifted(5_000_000));
    }
    let found = find(&[run], &options);
    let conditioning = found.model.conditioning;
    assert_eq!(conditioning.velocity, VelocitySource::Slope);
    assert!((0.007..=0.015).contains(&conditioning.slope_window_s), "{:?}", found.velocity_trials);
}

#[test]
fn centres_can_be_given_but_need_data_near_them() {
    let runs = runs(DriveKind::CoilCurrent, 4.0);
    let given = |centres: &[f64]| Options {
        placement: Placement::Given { centres: centres.to_vec(), sigma: Some(0.2) },
        ..options()
    };
    let found = find(&runs, &given(&[0.0, 1.0]));
    assert_eq!(
        (fuzzy(&found).sets().centres(), fuzzy(&found).sets().sigmas()),
        (&[0.0, 1.0][..], &[0.2; 2][..])
    );
    let error = identify(ModelSpec::FUZZY_TANH, &runs, &given(&[0.0, 1.0, 2.5]), &Watch::none())
        .expect_err("no data");
    assert!(error.to_string().contains("near current_a = 2.5"), "{error}");
    let error =
        identify(ModelSpec::FUZZY_TANH, &runs, &given(&[1.0, 0.0]), &Watch::none()).expect_err("order");
    assert!(error.to_string().contains("centres[1] is 0"), "{error}");
}

#[test]
fn errors_name_the_run_and_the_channel() {
    let good = runs(DriveKind::CoilCurrent, 4.0);
    let volts = run(Recipe { name: "volts", ..Recipe::default() }, DriveKind::CommandVoltage, |_, v, _| v);
    let message = |runs: &[Run]| {
        identify(ModelSpec::FUZZY_TANH, runs, &options(), &Watch::none()).expect_err("refused").to_string()
    };
    assert!(message(&[]).contains("no runs"));
    let text = message(&[good[0].clone(), volts]);
    assert!(text.contains("run volts: the drive is command_v, but the model needs current_a"), "{text}");
    let text = message(&[good[0].clone(), Run { drive: None, ..good[1].clone() }]);
    assert!(text.contains("run b: has no current_a or command_v"), "{text}");
    let text = message(&[Run { force_n: None, ..good[2].clone() }]);
    assert!(text.contains("run c: has no force_n"), "{text}");
    let text = message(&[Run { velocity_m_s: None, ..good[2].clone() }]);
    assert!(text.contains("run c: has no velocity_m_s"), "{text}");
    let text = message(&[run(
        Recipe { duration_s: 0.05, ..Recipe::default() },
        DriveKind::CoilCurrent,
        |_, v, _| v,
    )]);
    assert!(text.contains("too few samples near current_a = 0.5"), "{text}");
    let text = message(&[run(Recipe::default(), DriveKind::CoilCurrent, |_, _, _| 3.0)]);
    assert!(text.contains("never varies"), "{text}");
}

#[test]
fn identification_reports_progress_and_can_be_cancelled() {
    let runs = runs(DriveKind::CoilCurrent, 20.0);
    let restarts = AtomicU32::new(0);
    let progress = |p: Progress| {
        if let Progress::Restart { .. } = p {
            restarts.fetch_add(1, Ordering::Relaxed);
        }
    };
    let watch = Watch { cancel: None, progress: Some(&progress) };
    identify(ModelSpec::FUZZY_TANH, &runs, &options(), &watch).expect("identifies");
    assert_eq!(restarts.load(Ordering::Relaxed), 8);

    restarts.store(0, Ordering::Relaxed);
    let cancel = AtomicBool::new(false);
    let many = Options { restarts: 1_000_000, ..options() };
    let (outcome, took) = std::thread::scope(|scope| {
        let work = scope.spawn(|| {
            let watch = Watch { cancel: Some(&cancel), progress: Some(&progress) };
            identify(ModelSpec::FUZZY_TANH, &runs, &many, &watch)
        });
        let begun_at = Instant::now();
        while restarts.load(Ordering::Relaxed) == 0 {
            assert!(begun_at.elapsed() < Duration::from_secs(60), "a restart ends within a minute");
            std::thread::sleep(Duration::from_millis(5));
        }
        cancel.store(true, Ordering::Relaxed);
        let requested_at = Instant::now();
        (work.join().expect("no panic"), requested_at.elapsed())
    });
    assert_eq!(outcome, Err(Error::Cancelled));
    assert!(took < Duration::from_secs(1), "{took:?}");
}
