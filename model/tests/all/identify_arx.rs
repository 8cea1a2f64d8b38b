//! Identification of the ARX model on data with known truth.

use crate::identify_support::{Recipe, fed_run, run, truth};
use mr_damper_model::condition::{ApplyTo, Conditioning, VelocitySource};
use mr_damper_model::force::{Arx, ForceModel, History, Inputs};
use mr_damper_model::identify::{
    DatasetOptions, Form, Identified, ModelSpec, Options, Variant, Watch, identify,
};
use mr_damper_model::sample::{DriveKind, Run, Stamp};
use mr_damper_model::units::Second;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const KIND: DriveKind = DriveKind::CoilCurrent;

fn options(velocity: VelocitySource) -> Options {
    Options { conditioning: Conditioning { velocity, ..Conditioning::default() }, ..Options::default() }
}

fn arx(found: &Identified) -> Arx {
    match found.model.force {
        ForceModel::Arx(arx) => arx,
        _ => panic!("asked for ARX"),
    }
}

fn the_truth(semi_active: bool) -> Arx {
    let drive = semi_active.then_some((KIND, [30.0, -12.0, 5.0]));
    Arx::new(
        [1.3, -0.5, 0.1],
        [4000.0, -6000.0, 2500.0],
        [300.0, 150.0, -80.0],
        drive,
        Second(1.0 / 500.0),
        0.0,
    )
    .expect("a model")
}

/// A run with the force of `model`; see [`fed_run`].
fn arx_run(model: &Arx, noise_n: f64, recipe: Recipe) -> Run {
    fed_run(noise_n, recipe, KIND, |history| model.predict_n(history))
}

fn steps(t: f64) -> f64 {
    [0.0, 1.1, 0.4, 2.0, 0.9][(t / 0.25) as usize % 5]
}

#[test]
fn coefficients_and_offsets_are_recovered() {
    for (spec, semi_active) in [(ModelSpec::ARX_PASSIVE, false), (ModelSpec::ARX_SEMI_ACTIVE, true)] {
        let model = the_truth(semi_active);
        let recipe = Recipe { drive: steps, duration_s: 20.0, ..Recipe::default() };
        let runs = [
            arx_run(&model, 2.0, Recipe { name: "a", offset_n: 45.0, seed: 1, ..recipe }),
            arx_run(&model, 2.0, Recipe { name: "b", offset_n: -20.0, seed: 2, ..recipe }),
        ];
        let found =
            identify(spec, &runs, &options(VelocitySource::Measured), &Watch::none()).expect("identifies");
        let a = arx(&found);
        assert_eq!(found.rank, Some(model.parameter_count()));
        for (found, truth) in a.force_lags().iter().zip(model.force_lags()) {
            assert!((found - truth).abs() < 0.05, "{:?}", a.force_lags());
        }
        if let (Some((kind, found)), Some((_, truth))) = (a.drive_lags(), model.drive_lags()) {
            assert_eq!(kind, KIND);
            let error = found.iter().zip(truth).map(|(f, t)| (f - t).abs()).fold(0.0, f64::max);
            assert!(error < 2.5, "{found:?} {truth:?}");
        }
        // White noise of half width 2 N drives the truth; the one-step-ahead error can only be this noise.
        let noise_n = 2.0 / 3.0_f64.sqrt();
        let one_step = found.one_step.expect("a one-step predictor").rsse_n;
        assert!(one_step <= noise_n * 1.01 && one_step > noise_n * 0.97, "{one_step}");
        assert!(found.persistence.expect("figures").rsse_n > one_step);
        assert!(found.free_run.is_some());
        for (run, offset_n) in found.runs.iter().zip([45.0, -20.0]) {
            assert!((run.force_offset_n - offset_n).abs() < 1.5, "{run:?}");
        }
        let mean = found.runs.iter().map(|run| run.force_offset_n).sum::<f64>() / 2.0;
        assert!((a.force_offset_n() - mean).abs() < 1e-9);
    }
}

#[test]
fn the_truth_lies_within_two_standard_errors_in_95_percent() {
    const RUNS: u64 = 200;
    /// 97.5 % quantile of Student's t for the 40 blocks of a run.
    const QUANTILE: f64 = 2.02;
    let model = the_truth(true);
    let (f, x, v) = (model.force_lags(), model.displacement_lags_n_m(), model.velocity_lags_n_s_m());
    let (_, i) = model.drive_lags().expect("the model has a drive");
    let truth = [f, x, v, i].concat();
    let (mut inside, mut all) = (vec![0; truth.len()], 0);
    for seed in 0..RUNS {
        let recipe = Recipe { drive: steps, duration_s: 40.0, seed: 100 + seed, ..Recipe::default() };
        let found = identify(
            ModelSpec::ARX_SEMI_ACTIVE,
            &[arx_run(&model, 2.0, recipe)],
            &options(VelocitySource::Measured),
            &Watch::none(),
        )
        .expect("identifies");
        assert_eq!(found.parameters.len(), truth.len());
        assert_eq!(found.parameters[3].name, "displacement_lags_n_m[0]");
        all += 1;
        for ((count, estimate), truth) in inside.iter_mut().zip(&found.parameters).zip(&truth) {
            *count += u64::from((estimate.value - truth).abs() < QUANTILE * estimate.standard_error);
        }
    }
    let share = inside.iter().sum::<u64>() as f64 / (all * truth.len() as u64) as f64;
    println!("inside 95 %: {share:.3}, by coefficient {inside:?} of {all}");
    assert!((0.92..=0.97).contains(&share), "{share} {inside:?}");
    assert!(inside.iter().all(|count| *count * 100 >= all * 85), "{inside:?} of {all}");
}

#[test]
fn a_coefficient_that_the_runs_do_not_determine_has_no_standard_error() {
    let model = truth(KIND);
    let recipe = Recipe { drive: steps, noise_n: 3.0, ..Recipe::default() };
    let runs = [run(recipe, KIND, |x, v, i| model.force_n(x, v, i))];
    let backward = options(VelocitySource::Backward);
    let found = identify(ModelSpec::ARX_SEMI_ACTIVE, &runs, &backward, &Watch::none()).expect("identifies");
    for estimate in &found.parameters {
        // v_k is a difference of x_k and x_{k-1}; x_{k-3} is in v_{k-2} only.
        let of_motion = estimate.name.starts_with("displacement") || estimate.name.starts_with("velocity");
        let is_exchangeable = of_motion && estimate.name != "velocity_lags_n_s_m[2]";
        assert_eq!(estimate.standard_error.is_nan(), is_exchangeable, "{estimate:?}");
    }
}

#[test]
fn collinear_regressors_give_the_minimum_norm_solution() {
    let model = truth(KIND);
    let recipe = Recipe { drive: steps, noise_n: 3.0, offset_n: 30.0, ..Recipe::default() };
    let exact = [run(recipe, KIND, |x, v, i| model.force_n(x, v, i))];
    let backward = options(VelocitySource::Backward);
    for (spec, rank) in [(ModelSpec::ARX_PASSIVE, 7), (ModelSpec::ARX_SEMI_ACTIVE, 10)] {
        let found = identify(spec, &exact, &backward, &Watch::none()).expect("identifies");
        assert_eq!(found.rank, Some(rank));
        let a = arx(&found);
        // x_k and x_{k-1} can be exchanged for v_k without changing a prediction. The minimum-norm solution has no component in that
        // direction.
        let period = 1.0 / recipe.rate_hz;
        let (x, v) = (a.displacement_lags_n_m(), a.velocity_lags_n_s_m());
        let x_norm = column_norm(&exact[0].displacement_m.values);
        let v_norm = column_norm(&exact[0].velocity_m_s.as_ref().expect("made").values);
        for k in 0..2 {
            // In columns of unit norm the null direction is (x_norm, -x_norm) / period against -v_norm.
            let along = (x[k] - x[k + 1]) * x_norm * x_norm / period - v[k] * v_norm * v_norm;
            let size = x[k].abs() * x_norm * x_norm / period + v[k].abs() * v_norm * v_norm;
            assert!(along.abs() < 0.02 * size, "{k}: {along} of {size}: {x:?} {v:?}");
        }
        // The predictions equal the predictions of the full-rank regression on x_k .. x_{k-3}.
        let full = reference_rsse(&exact[0], rank == 10);
        let ours = found.one_step.expect("figures").rsse_n;
        assert!((ours / full - 1.0).abs() < 1e-6, "{ours} {full}");
    }
}

fn column_norm(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter().map(|v| (v - mean).powi(2)).sum::<f64>().sqrt()
}

/// RMSE of the plain regression of F on three F lags, x_k .. x_{k-3}, drive lags and a constant, over the same rows.
fn reference_rsse(run: &Run, drive: bool) -> f64 {
    let (x, f) = (&run.displacement_m.values, &run.force_n.as_ref().expect("made").values);
    let i = &run.drive.as_ref().expect("made").1.values;
    // The first row of a dataset is the second sample, because a velocity needs two; three more rows are needed for the lags.
    let rows: Vec<usize> = (4..x.len()).collect();
    let width = if drive { 11 } else { 8 };
    let entry = |k: usize, j: usize| match j {
        0..3 => f[k - 1 - j],
        3..7 => x[k - (j - 3)],
        7 => 1.0,
        _ => i[k - (j - 8)],
    };
    let a = nalgebra::DMatrix::from_fn(rows.len(), width, |r, j| entry(rows[r], j));
    let y = nalgebra::DVector::from_fn(rows.len(), |r, _| f[rows[r]]);
    let solution = a.clone().svd(true, true).solve(&y, 1e-14).expect("solves");
    ((a * solution - y).norm_squared() / rows.len() as f64).sqrt()
}

#[test]
fn rounded_stamps_do_not_inflate_coefficients() {
    let model = truth(KIND);
    let recipe = Recipe { drive: steps, noise_n: 3.0, ..Recipe::default() };
    let exact = run(recipe, KIND, |x, v, i| model.force_n(x, v, i));
    let mut rounded = exact.clone();
    let mut jitter = Pcg64Mcg::seed_from_u64(3);
    for k in 0..rounded.displacement_m.len() {
        let stamp =
            Stamp::from_nanos(exact.displacement_m.stamps[k].nanos() + (jitter.random::<f64>() * 2e3) as i64);
        rounded.displacement_m.stamps[k] = stamp;
        for trace in [&mut rounded.force_n, &mut rounded.velocity_m_s].into_iter().flatten() {
            trace.stamps[k] = stamp;
        }
        rounded.drive.as_mut().expect("made").1.stamps[k] = stamp;
    }
    let backward = options(VelocitySource::Backward);
    let one = identify(ModelSpec::ARX_PASSIVE, &[exact], &backward, &Watch::none()).expect("identifies");
    let other = identify(ModelSpec::ARX_PASSIVE, &[rounded], &backward, &Watch::none()).expect("identifies");
    assert_eq!((one.rank, other.rank), (Some(7), Some(7)));
    for (a, b) in arx(&one).velocity_lags_n_s_m().iter().zip(arx(&other).velocity_lags_n_s_m()) {
        assert!((a - b).abs() < 0.01 * a.abs() + 1.0, "{a} {b}");
    }
}

#[test]
fn runs_must_have_one_rate_or_be_thinned_to_one() {
    let model = truth(KIND);
    let make = |name, rate_hz| {
        run(Recipe { name, rate_hz, drive: steps, noise_n: 2.0, ..Recipe::default() }, KIND, |x, v, i| {
            model.force_n(x, v, i)
        })
    };
    let runs = [make("slow", 200.0), make("fast", 1000.0)];
    let backward = options(VelocitySource::Backward);
    let error = identify(ModelSpec::ARX_PASSIVE, &runs, &backward, &Watch::none()).expect_err("two rates");
    let text = error.to_string();
    assert!(text.contains("run slow is at 200") && text.contains("run fast at 1000"), "{text}");
    let at = |rate_hz| Options {
        dataset: DatasetOptions { rate_hz: Some(rate_hz), ..DatasetOptions::default() },
        ..backward.clone()
    };
    let found = identify(ModelSpec::ARX_PASSIVE, &runs, &at(200.0), &Watch::none()).expect("thinned");
    assert!((arx(&found).sample_period().get() - 0.005).abs() < 1e-6);
    assert!((found.model.rate_hz - 200.0).abs() < 0.1);
    let error = identify(ModelSpec::ARX_PASSIVE, &runs, &at(300.0), &Watch::none()).expect_err("no multiple");
    assert!(error.to_string().contains("run slow: its rate is 200"), "{error}");
}

#[test]
fn a_constant_drive_gets_zero_coefficients_and_a_warning() {
    let model = truth(KIND);
    // 3.212 has no exact binary form, so subtracting its mean leaves rounding errors.
    let fitted = |offset_n| {
        let recipe = Recipe { drive: |_| 3.212, noise_n: 3.0, offset_n, ..Recipe::default() };
        let runs = [run(recipe, KIND, |x, v, i| model.force_n(x, v, i))];
        identify(ModelSpec::ARX_SEMI_ACTIVE, &runs, &options(VelocitySource::Backward), &Watch::none())
            .expect("identifies")
    };
    let (found, without) = (fitted(40.0), fitted(0.0));
    assert!(found.warnings[0].contains("one level of current_a, 3.212"), "{:?}", found.warnings);
    assert_eq!((found.rank, arx(&found).drive_lags()), (Some(7), Some((KIND, [0.0; 3]))));
    // The damper is not an ARX model, so an offset is found even without one; the offset of the run is added to it.
    let added = arx(&found).force_offset_n() - arx(&without).force_offset_n();
    assert!((added - 40.0).abs() < 1e-6, "{added}");
}

#[test]
fn rows_around_gaps_are_left_out_of_fit_and_figures() {
    let model = the_truth(false);
    let whole = arx_run(&model, 2.0, Recipe { duration_s: 20.0, ..Recipe::default() });
    let mut gap = whole.clone();
    let cut = |trace: &mut mr_damper_model::sample::Trace| {
        trace.stamps.drain(3000..3500);
        trace.values.drain(3000..3500);
    };
    cut(&mut gap.displacement_m);
    gap.force_n.iter_mut().chain(&mut gap.velocity_m_s).for_each(cut);
    let measured = options(VelocitySource::Measured);
    let found = identify(ModelSpec::ARX_PASSIVE, &[gap], &measured, &Watch::none()).expect("identifies");
    let one_step = found.one_step.expect("figures").rsse_n;
    assert!(one_step < 1.02 * 2.0 / 3.0_f64.sqrt(), "{one_step}");
}

#[test]
fn lost_samples_do_not_change_the_period() {
    let model = the_truth(false);
    let mut lossy = arx_run(&model, 2.0, Recipe { duration_s: 20.0, ..Recipe::default() });
    let drop = |trace: &mut mr_damper_model::sample::Trace| {
        let kept = |k: usize| !k.is_multiple_of(20);
        let all = trace.stamps.iter().zip(&trace.values).enumerate().filter(|(k, _)| kept(*k));
        (trace.stamps, trace.values) = all.map(|(_, (stamp, value))| (*stamp, *value)).unzip();
    };
    drop(&mut lossy.displacement_m);
    lossy.force_n.iter_mut().chain(&mut lossy.velocity_m_s).for_each(drop);
    let measured = options(VelocitySource::Measured);
    let found = identify(ModelSpec::ARX_PASSIVE, &[lossy], &measured, &Watch::none()).expect("identifies");
    let period_s = arx(&found).sample_period().get();
    assert!((period_s - 0.002).abs() < 1e-9, "{period_s}");
}

#[test]
fn runs_that_cannot_be_fitted_are_rejected_with_the_reason() {
    let model = truth(KIND);
    let made =
        |duration_s| run(Recipe { duration_s, ..Recipe::default() }, KIND, |x, v, i| model.force_n(x, v, i));
    let refused = |runs: &[Run], options: &Options| {
        identify(ModelSpec::ARX_SEMI_ACTIVE, runs, options, &Watch::none()).expect_err("refused").to_string()
    };
    let mut output = options(VelocitySource::Backward);
    output.conditioning.apply_to = ApplyTo::Output;
    let text = refused(&[made(8.0)], &output);
    assert!(text.contains("apply_to = inputs or none, not output"), "{text}");
    let text = refused(&[made(0.2)], &options(VelocitySource::Backward));
    assert!(text.contains("too few for the 12 coefficients of arx"), "{text}");
    let text = refused(&[Run { drive: None, ..made(8.0) }], &options(VelocitySource::Backward));
    assert!(text.contains("has no current_a or command_v"), "{text}");
    let dead = run(Recipe::default(), KIND, |_, _, _| 5.0);
    let text = refused(&[dead], &options(VelocitySource::Backward));
    assert!(text.contains("force_n never varies in these runs (it stays at 5 N)"), "{text}");
    // The passive form needs no drive.
    let free = [Run { drive: None, ..made(8.0) }];
    let found = identify(ModelSpec::ARX_PASSIVE, &free, &options(VelocitySource::Backward), &Watch::none());
    assert_eq!(found.expect("identifies").model.force.drive(), None);
}

#[test]
fn savaresi_has_two_lags_and_is_recovered() {
    let drive = Some((KIND, [30.0, -12.0]));
    let model = Arx::savaresi([1.3, -0.4], [4000.0, -3500.0], [300.0, 90.0], drive, Second(1.0 / 500.0), 0.0)
        .expect("a model");
    assert_eq!((model.name(), model.parameter_count()), ("savaresi", 8));
    let runs = [arx_run(
        &model,
        2.0,
        Recipe { offset_n: 45.0, drive: steps, duration_s: 20.0, ..Recipe::default() },
    )];
    let spec = ModelSpec::named("savaresi", Form::SemiActive).expect("a model");
    let found =
        identify(spec, &runs, &options(VelocitySource::Measured), &Watch::none()).expect("identifies");
    let a = arx(&found);
    assert_eq!((found.model.force.name(), found.rank, a.lags()), ("savaresi", Some(8), 2));
    assert!((a.force_offset_n() - 45.0).abs() < 1.5);
    for (found, truth) in a.force_lags().iter().zip([1.3, -0.4, 0.0]) {
        assert!((found - truth).abs() < 0.03, "{:?}", a.force_lags());
    }
    let passive = ModelSpec::named("savaresi", Form::Passive).expect("a model");
    let found = identify(passive, &runs, &options(VelocitySource::Backward), &Watch::none());
    // With a backward difference x_k, x_{k-1} and v_k are linearly dependent.
    let found = found.expect("identifies");
    assert_eq!((found.rank, found.model.force.parameter_count()), (Some(5), 6));
}

#[test]
fn the_delayed_structure_is_recovered_and_does_not_use_the_inputs_of_its_sample() {
    let (x, v) = ([4000.0, -6000.0, 2500.0], [300.0, 150.0, -80.0]);
    let drive = Some((KIND, [30.0, -12.0, 5.0]));
    let model = Arx::delayed([1.3, -0.5, 0.1], x, v, drive, Second(1.0 / 500.0), 0.0).expect("a model");
    assert_eq!((model.name(), model.delay(), model.parameter_count()), ("arx-delayed", 1, 12));

    // F_6 = 1.3 F_5 - 0.5 F_4 + 0.1 F_3 + 4000 x_5 - ... with x_k = k mm, v_k = 0.01 k m/s, i_k = 0.1 k A and F_k = 10 k N.
    let mut history = History::default();
    for k in 1..=6 {
        let k = f64::from(k);
        let inputs = Inputs {
            dt_s: Some(0.002),
            displacement_m: 1e-3 * k,
            velocity_m_s: 0.01 * k,
            acceleration_m_s2: f64::NAN,
            drive: 0.1 * k,
            case_temp_c: f64::NAN,
        };
        history.push_inputs(&inputs);
        if k < 4.0 {
            assert_eq!(model.predict_n(&history), None, "the inputs of sample {k} have no use");
        }
        if k < 6.0 {
            history.push_force(10.0 * k);
        }
    }
    let force = 1.3 * 50.0 - 0.5 * 40.0 + 0.1 * 30.0;
    let motion = (4.0 * 5.0 - 6.0 * 4.0 + 2.5 * 3.0) + (3.0 * 5.0 + 1.5 * 4.0 - 0.8 * 3.0);
    let expected_n = force + motion + (3.0 * 5.0 - 1.2 * 4.0 + 0.5 * 3.0);
    let found_n = model.predict_n(&history).expect("the history is complete");
    assert!((found_n - expected_n).abs() < 1e-9, "{found_n} {expected_n}");

    let recipe = Recipe { offset_n: 45.0, drive: steps, duration_s: 20.0, ..Recipe::default() };
    let runs = [arx_run(&model, 2.0, recipe)];
    for (form, rank) in [(Form::SemiActive, 12), (Form::Passive, 9)] {
        let spec = ModelSpec::named("arx-delayed", form).expect("a model");
        let found = identify(spec, &runs, &options(VelocitySource::Measured), &Watch::none());
        let found = found.expect("identifies");
        assert_eq!((found.model.force.name(), found.rank), ("arx-delayed", Some(rank)));
        if form == Form::SemiActive {
            for (found, truth) in arx(&found).force_lags().iter().zip(model.force_lags()) {
                assert!((found - truth).abs() < 0.05, "{found} {truth}");
            }
            // The noise of half width 2 N drives the truth.
            let (one_step, noise_n) =
                (found.one_step.expect("a one-step predictor").rsse_n, 2.0 / 3f64.sqrt());
            assert!(one_step <= noise_n * 1.01 && one_step > noise_n * 0.97, "{one_step}");
        }
    }
}

#[test]
fn recursive_least_squares_agrees_with_the_regression() {
    for (name, semi_active) in [("arx", false), ("arx", true), ("arx-delayed", true)] {
        let truth = the_truth(semi_active);
        let recipe = Recipe { drive: steps, duration_s: 20.0, ..Recipe::default() };
        let runs = [
            arx_run(&truth, 2.0, Recipe { name: "a", offset_n: 45.0, seed: 1, ..recipe }),
            arx_run(&truth, 2.0, Recipe { name: "b", offset_n: -20.0, seed: 2, ..recipe }),
        ];
        let form = if semi_active { Form::SemiActive } else { Form::Passive };
        let spec = ModelSpec::named(name, form).expect("a model");
        let recursive = spec.with_variant(Variant::Recursive).expect("the published fit");
        assert_eq!(recursive.label(), format!("{name}/rls"));
        let fitted =
            |spec, velocity| identify(spec, &runs, &options(velocity), &Watch::none()).expect("fits");
        // The motion is a sum of four sines, so that the coefficients of displacement and velocity are not determined one by
        // one, but the force lags and the prediction are.
        for velocity in [VelocitySource::Measured, VelocitySource::Backward] {
            let [batch, found] = [spec, recursive].map(|spec| fitted(spec, velocity));
            assert_eq!(found.rank, None);
            for (found, batch) in arx(&found).force_lags().iter().zip(arx(&batch).force_lags()) {
                assert!((found - batch).abs() < 1e-3, "{name} {semi_active}: {found} {batch}");
            }
            let [batch_n, found_n] =
                [&batch, &found].map(|found| found.one_step.expect("a one-step predictor").rsse_n);
            assert!((found_n / batch_n - 1.0).abs() < 1e-3, "{found_n} {batch_n}");
            for (found, batch) in found.runs.iter().zip(&batch.runs) {
                assert!((found.force_offset_n - batch.force_offset_n).abs() < 1.0, "{found:?} {batch:?}");
            }
        }
    }
    assert!(
        ModelSpec::named("savaresi", Form::Passive).and_then(|s| s.with_variant(Variant::Recursive)).is_err()
    );
}
