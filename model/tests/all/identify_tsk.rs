//! Identification of TSK models: known surfaces are recovered, the error falls, the number of threads does not matter, and data that
//! are not sufficient for a fit are rejected with the reason.

use crate::identify_support::peers;

use mr_damper_model::Error;
use mr_damper_model::condition::{Conditioning, VelocitySource};
use mr_damper_model::force::{
    ForceModel, FreeRun, Order, OutputScale, Shape, Signal, Tsk, TskInput, TskKind, TskSet,
};
use mr_damper_model::identify::{
    Algorithm, Dataset, DatasetOptions, Evolution, Form, Learning, ModelSpec, Options, Row, TskOptions,
    Variant, Watch, fit_tsk, identify,
};
use mr_damper_model::metrics::ErrorSum;
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::preset;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::DriveKind;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

const DRIVE: Option<DriveKind> = Some(DriveKind::CoilCurrent);

/// NMSE (thesis: ESR) of `model` on `dataset`, with the best offset.
fn esr(model: &Tsk, dataset: &Dataset) -> f64 {
    let mut sum = ErrorSum::default();
    for row in dataset.rows.iter().filter(|row| row.counts) {
        let force_n = model.force_n(&row.inputs());
        if force_n.is_finite() {
            sum.add(row.force_n, force_n);
        }
    }
    sum.fit_without_offset().expect("rows that count").esr
}

/// Every `every`-th row of the peers' motion, with the force from `force_n`.
fn rows_of(seed: u64, every: usize, force_n: impl Fn(&Row) -> f64) -> Dataset {
    let mut data = peers::synth(seed);
    data.rows = data.rows.into_iter().step_by(every).collect();
    for row in &mut data.rows {
        row.force_n = force_n(row);
        row.raw_force_n = row.force_n;
    }
    data
}

fn fit(data: &[Dataset], kind: TskKind, options: &TskOptions) -> mr_damper_model::identify::FittedTsk {
    fit_tsk(data, kind, DRIVE, options, &Watch::none()).expect("a fit")
}

fn rig(experiment: &str, seed: u64) -> Dataset {
    let experiment = Experiment::thesis(experiment).expect("an experiment");
    let run = record(&experiment, &Plant::default(), &Channels::default(), seed);
    Dataset::from_run(&run, &Conditioning::THESIS, &DatasetOptions::default()).expect("rows")
}

#[test]
fn a_known_surface_and_the_offsets_of_its_runs_are_recovered() {
    // The truth is a fit of each kind to a damper; a second fit to its forces must reproduce them.
    for kind in TskKind::ALL {
        let truth = fit(&[rows_of(0, 3, |row| row.force_n)], kind, &TskOptions::default()).model;
        let offset = |offset_n: f64| move |row: &Row| truth.force_n(&row.inputs()) + offset_n;
        let runs = [rows_of(0, 3, offset(25.0)), rows_of(3, 6, offset(-60.0))];
        let found = fit(&runs, kind, &TskOptions::default());
        let limit = if kind == TskKind::Evolved { 3e-3 } else { 3e-4 };
        assert!(esr(&found.model, &runs[0]) < limit, "{kind:?}: {}", esr(&found.model, &runs[0]));
        let apart = found.offsets_n[0] - found.offsets_n[1];
        assert!((apart - 85.0).abs() < 8.0, "{kind:?}: {:?}", found.offsets_n);
        let mean = (2.0 * found.offsets_n[0] + found.offsets_n[1]) / 3.0;
        assert!((found.model.force_offset_n() - mean).abs() < 1e-9);
    }
}

#[test]
fn the_error_falls_with_the_epochs_and_matches_the_model() {
    let data = [peers::synth(0)];
    for (kind, learning) in [
        (TskKind::Anfis, Learning::GaussNewton),
        (TskKind::Anfis, Learning::Gradient),
        (TskKind::Ahn, Learning::GaussNewton),
        (TskKind::Ahn, Learning::BackPropagation),
        (TskKind::Atray, Learning::GaussNewton),
        (TskKind::Evolved, Learning::GaussNewton),
    ] {
        let found = fit(&data, kind, &TskOptions { learning, ..TskOptions::default() });
        let errors = &found.epoch_rsse_n;
        // The cost includes a penalty and falls in every epoch; the error alone may rise by a little.
        assert!(errors.windows(2).all(|pair| pair[1] <= 1.003 * pair[0]), "{kind:?} {errors:?}");
        let [first, last] = [errors[0], errors[errors.len() - 1]];
        assert!(last < 0.99 * first, "{kind:?} {learning:?} learned nothing: {first} {last}");
        let mut sum = ErrorSum::default();
        data[0].rows.iter().for_each(|row| sum.add(row.force_n, found.model.force_n(&row.inputs())));
        let rsse_n = sum.fit().expect("rows").rsse_n;
        // Evolution and back-propagation report the error on a sample of the rows.
        let sampled = kind == TskKind::Evolved || learning == Learning::BackPropagation;
        let tolerance = if sampled { 0.1 } else { 1e-6 };
        assert!((rsse_n / last - 1.0).abs() < tolerance, "{kind:?} {learning:?}: {rsse_n} {last}");
    }
}

#[test]
fn ten_epochs_of_gauss_newton_beat_fifty_of_the_gradient() {
    for data in [peers::synth(0), rig("RP-ICPS", 1)] {
        let by = |learning, epochs| {
            let options = TskOptions { learning, epochs, ..TskOptions::default() };
            esr(&fit(std::slice::from_ref(&data), TskKind::Anfis, &options).model, &data)
        };
        let grid = by(Learning::Gradient, 1);
        let (newton, gradient) = (by(Learning::GaussNewton, 10), by(Learning::Gradient, 50));
        assert!(gradient < 0.99 * grid, "{gradient} {grid}");
        assert!(newton < 0.99 * gradient, "{newton} {gradient}");
    }
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let data = [rows_of(0, 2, |row| row.force_n), rows_of(1, 3, |row| row.force_n + 40.0)];
    // Few steps: a sum in another order would show in the first.
    let mut plain = TskOptions { epochs: 8, ..TskOptions::default() };
    plain.evolution.generations = 6;
    plain.back_propagation.epochs = 6;
    let descent = TskOptions { learning: Learning::BackPropagation, ..plain };
    let genetic =
        TskOptions { evolution: Evolution { algorithm: Algorithm::Genetic, ..plain.evolution }, ..plain };
    for (kind, options) in [
        (TskKind::Anfis, plain),
        (TskKind::Atray, plain),
        (TskKind::Ahn, plain),
        (TskKind::Ahn, descent),
        (TskKind::Evolved, plain),
        (TskKind::Evolved, genetic),
    ] {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| fit(&data, kind, &options))
        };
        assert_eq!(on(1), on(2), "{kind:?}");
    }
}

#[test]
fn planted_memberships_are_found_by_the_genetic_algorithm() {
    // The truth has memberships off the uniform grid, so that the grid alone leaves an error.
    let truth = fit(&[rows_of(0, 3, |row| row.force_n)], TskKind::Anfis, &TskOptions::default()).model;
    let runs = [rows_of(0, 3, |row| truth.force_n(&row.inputs()))];
    let plain = TskOptions::default();
    let by = |algorithm, generations| {
        let evolution = Evolution { algorithm, generations, ..plain.evolution };
        esr(&fit(&runs, TskKind::Evolved, &TskOptions { evolution, ..plain }).model, &runs[0])
    };
    let grid = by(Algorithm::Genetic, 0);
    let (genetic, differential) = (by(Algorithm::Genetic, 40), by(Algorithm::Differential, 40));
    println!("grid {grid:.2e} genetic {genetic:.2e} differential {differential:.2e}");
    assert!(genetic < 0.2 * grid, "{genetic} {grid}");
    assert!(genetic < 3.0 * differential, "{genetic} {differential}");
}

#[test]
fn variants_reach_the_fit_through_identify() {
    let experiment = Experiment::thesis("RP-ICPS").expect("an experiment").with_duration_s(8.0);
    let run = record(&experiment, &Plant::default(), &Channels::default(), 1);
    let options =
        Options { conditioning: Conditioning::THESIS, choose_velocity: false, ..Options::default() };
    for (name, variant) in [("tsk-555", Variant::BackPropagation), ("tsk-evolved", Variant::Genetic)] {
        for form in [Form::Passive, Form::SemiActive] {
            let spec = ModelSpec::named(name, form).expect("a known model");
            assert_eq!(spec.variants(), [variant]);
            let fitted = |spec| {
                identify(spec, std::slice::from_ref(&run), &options, &Watch::none()).expect("a fit").free_run
            };
            let (plain, other) = (fitted(spec), fitted(spec.with_variant(variant).expect("registered")));
            let (plain, other) = (plain.expect("an error").esr, other.expect("an error").esr);
            println!("{name} {form:?}: {plain:.4} {other:.4}");
            assert!(plain != other && other < 2.0 * plain, "{name} {form:?} {plain} {other}");
        }
    }
}

#[test]
fn shapes_are_chosen_for_anfis_and_refused_otherwise() {
    let data = [rows_of(0, 4, |row| row.force_n)];
    let with = |kind, shape| {
        let options = TskOptions { shape: Some(shape), epochs: 3, ..TskOptions::default() };
        fit_tsk(&data, kind, DRIVE, &options, &Watch::none())
    };
    for shape in [Shape::Bell, Shape::Triangle, Shape::Gaussian] {
        let model = with(TskKind::Anfis, shape).expect("a fit").model;
        assert!(model.inputs().iter().all(|input| input.shape() == shape));
        assert!(esr(&model, &data[0]) < 0.1, "{shape:?}");
    }
    let message = |kind, shape| with(kind, shape).expect_err("refused").to_string();
    assert!(message(TskKind::Anfis, Shape::Trapezoid).contains("cannot be trained with trapezoid"));
    assert!(message(TskKind::Anfis, Shape::TwoSidedGaussian).contains("with two-sided gaussian memberships"));
    assert!(message(TskKind::Ahn, Shape::Bell).contains("tsk-555 has no bell memberships"));
}

/// A small model of each shape.
fn shaped(kind: TskKind, sets: [TskSet; 2]) -> Tsk {
    let velocity = TskInput::new(Signal::Velocity, 0.01, 0.1, &sets).expect("an input");
    let output = OutputScale { mean_n: 0.0, std_dev_n: 300.0 };
    Tsk::new(kind, &[velocity], Order::Constant, &[-1.0, 1.0 / 3.0], output, 5.0).expect("a model")
}

#[test]
fn every_shape_is_stored_in_a_model_file() {
    for (sets, keys) in [
        (
            [(0.5, 2.0, -1.0), (0.7, 1.1, 1.0)].map(|(half_width, exponent, centre)| TskSet::Bell {
                half_width,
                exponent,
                centre,
            }),
            &["velocity_half_widths = [0.5, 0.7]", "velocity_exponents", "velocity_centres"][..],
        ),
        (
            [(-9.0, -2.0, -1.0, 0.0), (-1.0, 1.0, 2.0, 9.0)].map(
                |(left_foot, left_shoulder, right_shoulder, right_foot)| TskSet::Trapezoid {
                    left_foot,
                    left_shoulder,
                    right_shoulder,
                    right_foot,
                },
            ),
            &["velocity_left_shoulders = [-2.0, 1.0]", "velocity_right_shoulders", "velocity_left_feet"],
        ),
        (
            [(0.5, -2.0, 1.0, -1.0), (0.7, 1.0, 0.3, 0.5)].map(
                |(left_sigma, left_centre, right_sigma, right_centre)| TskSet::TwoSidedGaussian {
                    left_sigma,
                    left_centre,
                    right_sigma,
                    right_centre,
                },
            ),
            &["velocity_left_sigmas = [0.5, 0.7]", "velocity_right_centres"],
        ),
    ] {
        let mut model = preset::load(preset::BEST_ANFIS).expect("a preset");
        model.force = ForceModel::Tsk(shaped(TskKind::Anfis, sets));
        model.envelope.drive = None;
        let file = ModelFile { model, provenance: Provenance::default() };
        let text = file.to_toml().expect("writes");
        assert!(keys.iter().all(|key| text.contains(key)), "{text}");
        assert_eq!(ModelFile::from_toml(&text).unwrap_or_else(|e| panic!("{e}\n{text}")), file);
        let mixed = text.replacen("velocity_mean_m_s", "velocity_peaks = [1.0]\nvelocity_mean_m_s", 1);
        let message = ModelFile::from_toml(&mixed).expect_err("two shapes").to_string();
        assert!(message.contains("keys of two shapes"), "{message}");
    }
}

#[test]
fn a_file_of_atray_with_gaussians_still_loads() {
    // A grid of 3, 2, 4 Gaussians, as a file of tsk-324 holds when it was written before the model had bells.
    let text = r#"schema = "mr-damper/model/1"
model = "tsk-324"
drive = "current_a"
"#;
    let gaussians = [rows_of(0, 4, |row| row.force_n)];
    let options = TskOptions { shape: Some(Shape::Gaussian), epochs: 3, ..TskOptions::default() };
    let model = fit(&gaussians, TskKind::Atray, &options).model;
    assert_eq!(model.parameter_count(), 114);
    let mut whole = preset::load(preset::BEST_ANFIS).expect("a preset");
    whole.force = ForceModel::Tsk(model);
    let file = ModelFile { model: whole, provenance: Provenance::default() };
    let written = file.to_toml().expect("writes");
    assert!(written.starts_with(text), "{written}");
    let keys = ["displacement_centres", "displacement_sigmas", "velocity_sigmas", "drive_sigmas"];
    assert!(keys.iter().all(|key| written.contains(key)), "{written}");
    let ForceModel::Tsk(read) = ModelFile::from_toml(&written).expect("reads").model.force else { panic!() };
    for row in gaussians[0].rows.iter().take(50) {
        assert_eq!(read.force_n(&row.inputs()).to_bits(), model.force_n(&row.inputs()).to_bits());
    }
}

#[test]
fn another_seed_gives_another_evolution() {
    let data = [rows_of(0, 4, |row| row.force_n)];
    let seeded = |seed| {
        let mut options = TskOptions::default();
        options.evolution.seed = seed;
        options.evolution.generations = 5;
        fit(&data, TskKind::Evolved, &options)
    };
    assert_eq!(seeded(3), seeded(3));
    assert_ne!(seeded(3).model, seeded(4).model);
}

#[test]
fn a_rank_deficient_problem_has_a_solution_of_moderate_size() {
    // Two levels of current for three fuzzy sets; and displacement proportional to velocity.
    let data = rows_of(0, 1, |row| {
        let i = if row.drive > 1.25 { 2.0 } else { 0.5 };
        (100.0 + 300.0 * i) * (30.0 * row.velocity_m_s).tanh()
    });
    let mut levels = data.clone();
    levels.rows.iter_mut().for_each(|row| row.drive = if row.drive > 1.25 { 2.0 } else { 0.5 });
    let mut tied = levels.clone();
    tied.rows.iter_mut().for_each(|row| row.displacement_m = 0.1 * row.velocity_m_s);
    for data in [levels, tied] {
        for kind in [TskKind::Anfis, TskKind::Ahn, TskKind::SchurterRoschke] {
            let found = fit(std::slice::from_ref(&data), kind, &TskOptions::default()).model;
            assert!(esr(&found, &data) < 0.01, "{kind:?} {}", esr(&found, &data));
            let largest = found.conclusions().iter().fold(0.0_f64, |a, c| a.max(c.abs()));
            assert!(largest < 20.0, "{kind:?}: a conclusion of {largest} standard deviations of the force");
        }
    }
}

#[test]
fn insufficient_data_are_rejected_with_the_reason() {
    let message = |data: &Dataset, kind, drive| {
        let options = TskOptions::default();
        fit_tsk(std::slice::from_ref(data), kind, drive, &options, &Watch::none())
            .expect_err("no fit")
            .to_string()
    };
    let data = peers::synth(0);
    let mut constant = data.clone();
    constant.rows.iter_mut().for_each(|row| row.drive = 1.2);
    assert!(message(&constant, TskKind::Anfis, DRIVE).contains("drive never varies"));
    assert!(fit_tsk(&[constant], TskKind::Anfis, None, &TskOptions::default(), &Watch::none()).is_ok());
    let mut short = data.clone();
    short.rows.truncate(10);
    let text = message(&short, TskKind::Anfis, DRIVE);
    assert!(
        text.starts_with("10 samples with ")
            && text.contains("are too few for the 126 parameters of anfis (378 are needed)"),
        "{text}"
    );
    let mut still = data.clone();
    still.rows.iter_mut().for_each(|row| row.force_n = 5.0);
    assert!(message(&still, TskKind::Anfis, DRIVE).contains("force_n never varies"));
    let mut unknown = data.clone();
    unknown.rows.iter_mut().for_each(|row| row.acceleration_m_s2 = f64::NAN);
    assert!(
        message(&unknown, TskKind::WangHu, DRIVE)
            .starts_with("0 samples with velocity, acceleration, drive are too few")
    );
    let none: [Dataset; 0] = [];
    assert!(fit_tsk(&none, TskKind::Anfis, DRIVE, &TskOptions::default(), &Watch::none()).is_err());
}

#[test]
fn it_reports_progress_and_can_be_cancelled() {
    let data = [rows_of(0, 4, |row| row.force_n)];
    for kind in [TskKind::Anfis, TskKind::Evolved] {
        let (cancel, calls) = (AtomicBool::new(false), AtomicU32::new(0));
        let progress = |_| {
            if calls.fetch_add(1, Ordering::Relaxed) == 2 {
                cancel.store(true, Ordering::Relaxed);
            }
        };
        let watch = Watch { cancel: Some(&cancel), progress: Some(&progress) };
        let found = fit_tsk(&data, kind, DRIVE, &TskOptions::default(), &watch);
        assert_eq!(found.expect_err("cancelled"), Error::Cancelled);
        assert_eq!(calls.load(Ordering::Relaxed), 3, "{kind:?}");
    }
}

#[test]
fn on_the_rig_the_model_is_accurate_on_a_new_run() {
    let (train, test) = (rig("RP-ICPS", 1), rig("RP-ICPS", 2));
    // The thesis found 0.07; on the rig, displacement is delayed a little more against the force. A model with acceleration as an
    // input explains most of it.
    for (kind, trained, tested) in [(TskKind::Anfis, 0.12, 0.17), (TskKind::WangHu, 0.013, 0.02)] {
        let found = fit(std::slice::from_ref(&train), kind, &TskOptions::default());
        let reached = [esr(&found.model, &train), esr(&found.model, &test)];
        assert!(reached[0] < trained && reached[1] < tested, "{kind:?} {reached:?}");
    }
}

#[test]
fn every_kind_can_be_identified_in_both_forms_and_stored_in_a_file() {
    let experiment = Experiment::thesis("RP-ICPS").expect("an experiment").with_duration_s(8.0);
    let run = record(&experiment, &Plant::default(), &Channels::default(), 1);
    let options =
        Options { conditioning: Conditioning::THESIS, choose_velocity: false, ..Options::default() };
    for kind in TskKind::ALL {
        for form in [Form::Passive, Form::SemiActive] {
            let spec = ModelSpec::named(kind.name(), form).expect("a known model");
            let found = identify(spec, std::slice::from_ref(&run), &options, &Watch::none()).expect("a fit");
            assert_eq!(found.model.force.name(), kind.name());
            assert_eq!(found.model.force.drive().is_some(), form == Form::SemiActive);
            let esr = found.free_run.expect("a simulation error").esr;
            assert!(esr < if form == Form::SemiActive { 0.15 } else { 0.4 }, "{kind:?} {form:?} {esr}");
            let file = ModelFile { model: found.model, provenance: Provenance::default() };
            let text = file.to_toml().expect("writes");
            assert_eq!(ModelFile::from_toml(&text).unwrap_or_else(|e| panic!("{e}\n{text}")), file);
        }
    }
}

#[test]
fn the_derivative_is_chosen_by_the_runs() {
    let experiment = Experiment::thesis("RP-ICPS").expect("an experiment").with_duration_s(8.0);
    let run = record(&experiment, &Plant::default(), &Channels::default(), 1);
    let spec = ModelSpec::named("anfis", Form::SemiActive).expect("a known model");
    let found = identify(spec, &[run], &Options::default(), &Watch::none()).expect("a fit");
    assert!(found.velocity_trials.len() > 4);
    let best = found.velocity_trials.iter().map(|trial| trial.mean_esr).fold(f64::INFINITY, f64::min);
    assert!(best.is_finite() && best < 0.2);
    assert_ne!(found.model.conditioning.velocity, VelocitySource::Measured);
}

#[test]
fn an_error_in_the_file_names_the_key() {
    let model = preset::load(preset::BEST_ANFIS).expect("a preset");
    let text = ModelFile { model, provenance: Provenance::default() }.to_toml().expect("writes");
    for (from, to, expected) in [
        (
            "displacement_mean_m",
            "displacement_mean_in",
            "displacement_mean_in is unknown; did you mean displacement_mean_m?",
        ),
        ("velocity_sigmas = [", "velocity_sigmas = [1.0, ", "parameters.velocity_sigmas has 4 values, but 3"),
        ("drive_centres", "drive_peaks", "parameters.drive_left_feet is missing"),
        ("order = \"first\"", "order = \"second\"", "parameters.order is \"second\""),
        ("order = \"first\"", "order = \"constant\"", "parameters.conclusions[0] has 4 values, but 1"),
        ("drive = \"current_a\"\n", "", "drive is absent"),
        ("\"displacement\", ", "", "displacement_centres belongs to no input"),
        ("\"displacement\", ", "\"jerk\", ", "parameters.inputs holds \"jerk\""),
        ("model = \"anfis\"", "model = \"tsk-243\"", "do not match tsk-243"),
        ("force_std_dev_n = ", "force_std_dev_n = -", "force_std_dev_n is -"),
        ("drive_std_dev_a = ", "drive_std_dev_a = -", "drive_std_dev_a is -"),
    ] {
        assert!(text.contains(from), "the test must change the file: {from}\n{text}");
        let message = ModelFile::from_toml(&text.replacen(from, to, 1)).expect_err("broken").to_string();
        assert!(message.contains(expected), "{to}: {message}");
    }
}

#[test]
fn it_can_be_simulated_as_a_force_model() {
    let model = preset::load(preset::BEST_ANFIS).expect("a preset");
    let ForceModel::Tsk(tsk) = model.force else { panic!("{}", model.force.name()) };
    let inputs = peers::synth(0).rows[500].inputs();
    let force_n = model.force.free_run(&mut FreeRun::default(), &inputs).expect("a force");
    assert_eq!(force_n.to_bits(), tsk.force_n(&inputs).to_bits());
    let shifted = model.force.with_force_offset_n(11.0);
    assert_eq!(shifted.force_offset_n(), 11.0);
    assert!(
        (shifted.free_run(&mut FreeRun::default(), &inputs).expect("a force") - force_n - 11.0).abs() < 1e-9
    );
    assert_eq!(model.force.parameter_count(), 126);
    assert_eq!(model.force.force_fed_period(), None);
}
