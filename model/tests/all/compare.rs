//! Comparison of models on short runs of the rig.

use crate::identify_support::{self, Recipe, tanh_function};
use mr_damper_model::Error;
use mr_damper_model::compare::{
    Cell, Experiment, Finished, InverseRow, Predictor, Replicate, Summary, cells, persistence, run,
    run_inverse,
};
use mr_damper_model::condition::{ApplyTo, Conditioning, VelocitySource};
use mr_damper_model::force::{Arx, ForceModel, FuzzySets, FuzzyTanh, Membership};
use mr_damper_model::identify::{
    Dataset, DatasetOptions, Form, ModelSpec, Options, Structure, Watch, identify, identify_datasets, score,
};
use mr_damper_model::inverse::Method;
use mr_damper_model::rig::{self, Channels, Plant};
use mr_damper_model::sample::{DriveKind, Run};
use mr_damper_model::units::Second;
use rayon::prelude::*;
use std::sync::atomic::AtomicBool;

const SPECS: [ModelSpec; 3] = [ModelSpec::ARX_PASSIVE, ModelSpec::ARX_SEMI_ACTIVE, ModelSpec::FUZZY_TANH];

fn options() -> Options {
    Options { conditioning: Conditioning::THESIS, choose_velocity: false, restarts: 3, ..Options::default() }
}

fn recorded(name: &str, replicate: u32) -> Run {
    let experiment = rig::Experiment::thesis(name).expect("a thesis experiment").with_duration_s(6.0);
    rig::record(&experiment.with_pattern(7), &Plant::default(), &Channels::default(), u64::from(replicate))
}

fn dataset(run: &Run) -> Dataset {
    Dataset::from_run(run, &Conditioning::THESIS, &DatasetOptions::default()).expect("a sound run")
}

/// Two experiments of two replicates.
fn experiments() -> Vec<Experiment> {
    let replicate = |name, number| Replicate { number, data: dataset(&recorded(name, number)) };
    ["RP-ICPS", "RP1-CS"]
        .map(|name| Experiment {
            name: name.to_owned(),
            replicates: vec![replicate(name, 1), replicate(name, 2)],
            training: 1,
            held_out: Vec::new(),
        })
        .to_vec()
}

fn all(experiments: &[Experiment]) -> Vec<Finished> {
    let one = |cell: &Cell| run(*cell, experiments, &options(), &Watch::none()).expect("not cancelled").0;
    cells(&SPECS, experiments).par_iter().map(one).collect()
}

#[test]
fn identification_figures_are_bit_identical_to_those_of_identify() {
    let experiments = experiments();
    for spec in SPECS {
        let (finished, model) = run(Cell { spec, experiment: 0 }, &experiments, &options(), &Watch::none())
            .expect("not cancelled");
        let found =
            identify(spec, &[recorded("RP-ICPS", 1)], &options(), &Watch::none()).expect("a sound run");
        assert_eq!(model, Some(found.model));
        assert_eq!(finished.parameters, Some(found.model.force.parameter_count()));
        for figure in &finished.identification {
            let fit = match figure.predictor {
                Predictor::FreeRun => found.free_run,
                Predictor::OneStep => found.one_step,
                Predictor::SameInstant => panic!("only the phase relation has this predictor"),
            };
            assert_eq!((figure.rsse_n, figure.esr), (fit.map(|f| f.rsse_n), fit.map(|f| f.esr)), "{spec:?}");
        }
        // ARX has two figures, one-step-ahead and simulation; fuzzy-tanh has one.
        assert_eq!(finished.identification.len(), if spec == ModelSpec::FUZZY_TANH { 1 } else { 2 });
    }
}

#[test]
fn every_run_except_the_training_run_is_a_test() {
    let experiments = experiments();
    let finished = &all(&experiments)[SPECS.len()];
    assert_eq!(finished.trained_on, "RP1-CS");
    let tests: Vec<_> =
        finished.cross_validation.iter().map(|t| (t.tested_on.as_str(), t.replicate)).collect();
    assert_eq!(tests, [("RP-ICPS", 1), ("RP-ICPS", 2), ("RP1-CS", 2)]);
    // The replicate differs only in noise, so its test error is close to the identification error.
    let (own, test) = (&finished.identification[1], &finished.cross_validation[2].figures[1]);
    let ratio = test.esr.expect("a figure") / own.esr.expect("a figure");
    assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let experiments = experiments();
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| all(&experiments))
    };
    assert_eq!(on(1), on(4));
}

#[test]
fn a_model_that_cannot_be_identified_gives_a_cell_with_the_reason() {
    let mut experiments = experiments();
    let mut driveless = recorded("RP-ICPS", 1);
    driveless.drive = None;
    experiments[0].replicates[0].data = dataset(&driveless);
    let finished = all(&experiments);
    let failure = finished[1].failure.as_deref().expect("a semi-active model without drive");
    assert!(failure.contains("current_a"), "{failure}");
    assert!(finished[1].identification.is_empty() && finished[1].cross_validation.is_empty());
    // The passive model does not need the drive. Models trained on other runs state why this test has no figure.
    assert!(finished[0].failure.is_none());
    let note = finished[4].cross_validation[0].figures[0].note.as_deref();
    assert!(note.is_some_and(|note| note.contains("current_a")), "{note:?}");

    let summaries = Summary::of(&finished);
    let semi_active: Vec<_> = summaries.iter().filter(|s| s.class.form == "semi_active").collect();
    assert!(
        semi_active.iter().all(|s| s.best().is_none()),
        "a mean that leaves out a test would be too good"
    );
    assert!(semi_active.iter().any(|s| s.failures.len() == 1));
}

#[test]
fn a_diverging_simulation_gives_no_figure() {
    let data = dataset(&recorded("RP-ICPS", 1));
    let grows = Arx::new([1.02, 0.0, 0.0], [1000.0, 0.0, 0.0], [0.0; 3], None, Second(1.0 / 512.0), 0.0)
        .expect("finite coefficients");
    let scores = score(&ForceModel::Arx(grows).into(), &data, &Watch::none()).expect("it runs");
    assert!(scores.diverged && scores.free_run.is_none() && scores.free_run_without_offset.is_none());
    assert!(scores.one_step.is_some(), "the one-step-ahead prediction is fed with measured force");
    let holds = Arx::new([0.5, 0.0, 0.0], [1000.0, 0.0, 0.0], [0.0; 3], None, Second(1.0 / 512.0), 0.0)
        .expect("finite coefficients");
    let scores = score(&ForceModel::Arx(holds).into(), &data, &Watch::none()).expect("it runs");
    assert!(!scores.diverged && scores.free_run.is_some());
    let other_rate = Arx::new([0.5, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0; 3], None, Second(0.01), 0.0)
        .expect("finite coefficients");
    let refused = score(&ForceModel::Arx(other_rate).into(), &data, &Watch::none());
    assert!(refused.is_err_and(|e| e.to_string().contains("100.000000 Hz")));
}

#[test]
fn summaries_have_means_and_separate_the_predictors() {
    let experiments = experiments();
    let finished = all(&experiments);
    let summaries = Summary::of(&finished);
    assert!(summaries.is_sorted_by_key(|s| s.class.predictor));
    assert_eq!(summaries.len(), 5, "three in simulation, two one step ahead");
    let passive = |s: &&Summary| s.class.form == "passive" && s.class.predictor == Predictor::OneStep;
    let arx = summaries.iter().find(passive);
    let row = &arx.expect("arx steps").rows[0];
    let esr = finished[0].cross_validation.iter().map(|t| t.figures[1].esr.expect("a figure"));
    assert_eq!((row.tests, row.without), (3, 0));
    assert!((row.mean_esr.expect("all tests have one") - esr.sum::<f64>() / 3.0).abs() < 1e-15);
    for pair in summaries.windows(2).filter(|p| p[0].class.predictor == p[1].class.predictor) {
        let mean = |s: &Summary| s.best().and_then(|row| row.mean_esr);
        assert!(mean(&pair[0]) <= mean(&pair[1]), "best first");
    }
    let still = persistence(&experiments);
    assert_eq!(still.len(), 4);
    let found = identify_datasets(
        SPECS[0],
        std::slice::from_ref(&experiments[0].replicates[0].data),
        &options(),
        &Watch::none(),
    );
    let expected = found.expect("a sound run").persistence.map(|fit| fit.esr);
    assert_eq!(still[0].esr, expected);
}

#[test]
fn the_cancel_flag_ends_a_cell() {
    let cancel = AtomicBool::new(true);
    let watch = Watch { cancel: Some(&cancel), progress: None };
    for spec in SPECS {
        let found = run(Cell { spec, experiment: 0 }, &experiments(), &options(), &watch);
        assert_eq!(found.err(), Some(Error::Cancelled), "{spec:?}");
    }
}

#[test]
fn the_phase_relation_has_same_instant_figures_and_gives_no_model() {
    let experiments = experiments();
    for form in [Form::Passive, Form::SemiActive] {
        let spec = ModelSpec::new(Structure::Phase, form).expect("a form");
        let (finished, model) = run(Cell { spec, experiment: 0 }, &experiments, &options(), &Watch::none())
            .expect("not cancelled");
        assert_eq!((model, finished.failure), (None, None));
        let tests = finished.cross_validation.iter().flat_map(|test| &test.figures);
        let all: Vec<_> = finished.identification.iter().chain(tests).collect();
        assert!(all.len() > 1);
        for figure in all {
            assert_eq!(figure.predictor, Predictor::SameInstant);
            assert!(figure.esr.is_some_and(|esr| (0.0..1.0).contains(&esr)), "{figure:?}");
        }
        let error =
            identify(spec, &[recorded("RP-ICPS", 1)], &options(), &Watch::none()).expect_err("no model");
        assert!(error.to_string().contains("cannot be made into a model that runs"), "{error}");
    }
}

const MEASURED: Conditioning = Conditioning {
    apply_to: ApplyTo::None,
    cutoff_hz: 20.0,
    velocity: VelocitySource::Measured,
    slope_window_s: 0.01,
};

/// Runs of a fuzzy-tanh damper without noise: the inverse of the identified model then finds the recorded current.
fn exact(kind: DriveKind) -> Vec<Experiment> {
    // The force grows with the drive everywhere, and it always opposes the velocity.
    let functions =
        [(90.0, 500.0), (400.0, 900.0), (800.0, 1300.0)].map(|(a1, a2)| tanh_function(a1, a2, 45.0, 0.0));
    let sets = FuzzySets::new(Membership { drive: kind, sigma: 0.25 }, &[0.0, 0.5, 1.0]).expect("sets");
    let model = FuzzyTanh::new(sets, &functions, 0.0).expect("a model");
    let replicate = |number: u32| {
        let drive = |t: f64| [0.0, 1.0, 0.5, 0.0, 0.5, 1.0][(t / 0.3) as usize % 6];
        let recipe = Recipe {
            name: "steps",
            rate_hz: 512.0,
            drive,
            offset_n: 45.0,
            noise_n: 0.0,
            seed: number.into(),
            ..Recipe::default()
        };
        let run = identify_support::run(recipe, kind, |x, v, i| model.force_n(x, v, i));
        let data = Dataset::from_run(&run, &MEASURED, &DatasetOptions::default()).expect("a sound run");
        Replicate { number, data }
    };
    vec![Experiment {
        name: "steps".to_owned(),
        replicates: vec![replicate(1), replicate(2)],
        training: 1,
        held_out: Vec::new(),
    }]
}

#[test]
fn the_search_finds_the_recorded_current_of_an_exact_model() {
    let options = Options { conditioning: MEASURED, ..options() };
    let methods = [Method::Search, Method::WangHu];
    let found = run_inverse(0, &methods, &exact(DriveKind::CoilCurrent), &options, &Watch::none())
        .expect("not cancelled");
    assert!(found.iter().all(|method| method.failure.is_none()), "{found:?}");
    let tested = |k: usize| &found[k].cross_validation[0];
    assert_eq!((found.len(), tested(0).replicate, tested(1).replicate), (2, 2, 2));
    let nmse = [0, 1].map(|k| tested(k).figure.nmse.expect("the current varies"));
    assert!(nmse[0] < 1e-3, "{:?}", tested(0));
    // Learned rules are no exact inverse.
    assert!(nmse[0] < nmse[1] && nmse[1] < 0.5, "{nmse:?}");
    let best = InverseRow::best(&found);
    assert_eq!(best.iter().map(|row| row.method.as_str()).collect::<Vec<_>>(), ["search", "wang-hu"]);
}

#[test]
fn a_run_without_coil_current_has_no_inverse_and_says_so() {
    let options = Options { conditioning: MEASURED, ..options() };
    let voltage = exact(DriveKind::CommandVoltage);
    let found = run_inverse(0, &Method::ALL, &voltage, &options, &Watch::none()).expect("not cancelled");
    for finished in &found {
        let why = finished.failure.as_deref().unwrap_or_default();
        assert!(why.contains("current"), "{finished:?}");
        assert!(finished.identification.is_none() && finished.cross_validation.is_empty());
    }
    assert!(found.len() == 6 && InverseRow::best(&found).is_empty());
}
