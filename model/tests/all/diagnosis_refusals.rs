//! Inputs that the diagnosis rejects, effects that it cannot test, and independence of the number of threads.

use crate::diagnosis::cases::spec;
use crate::diagnosis::outcome::CONDITIONING;
use mr_damper_model::Error;
use mr_damper_model::diagnose::{
    Bases, DiagnosisError, DiagnosisResult, FloorSource, NoInterval, NoiseFloor, Refusal, Runs, Settings,
    Verdict, close, close_any,
};
use mr_damper_model::identify::{Dataset, DatasetOptions, ModelSpec, Options, Watch, identify_datasets};
use mr_damper_model::model::Model;
use mr_damper_model::sample::{Run, Stamp};
use std::sync::LazyLock;

fn rows(run: &Run) -> Dataset {
    Dataset::from_run(run, &CONDITIONING, &DatasetOptions::default()).expect("rows of a rig run")
}

/// Training, validation and test run of a damper with a coil lag, and a base without it.
static LAGGING: LazyLock<([Run; 3], Model)> = LazyLock::new(|| {
    let case = spec("single coil_lag x1").case(5).expect("a case");
    let runs = [case.estimate[0].clone(), case.confirm[0].clone(), case.test[0].clone()];
    let options =
        Options { conditioning: CONDITIONING, choose_velocity: false, restarts: 3, ..Options::default() };
    let found = identify_datasets(ModelSpec::FUZZY_TANH, &[rows(&runs[0])], &options, &Watch::none());
    (runs, found.expect("a base").model)
});

fn closed(estimate: &[Dataset], confirm: &[Dataset], test: &[Dataset]) -> Result<DiagnosisResult, Error> {
    let runs = Runs { estimate, confirm, test, ..Runs::default() };
    close(&LAGGING.1, &runs, &Settings::default(), &Watch::none(), &|_| {})
}

/// The diagnosis of the whole runs, which several tests compare with.
static DIAGNOSED: LazyLock<DiagnosisResult> = LazyLock::new(|| {
    let [estimate, confirm, test] = LAGGING.0.each_ref().map(|run| [rows(run)]);
    closed(&estimate, &confirm, &test).expect("a diagnosis")
});

/// Why the diagnosis was refused.
fn refused(result: Result<DiagnosisResult, Error>) -> DiagnosisError {
    match result {
        Err(Error::Diagnosis(refused)) => refused,
        other => panic!("{other:?}"),
    }
}

/// The identification of a base takes a minute.
#[test]
fn runs_are_rejected_before_a_base_is_identified() {
    let [estimate, confirm, _] = LAGGING.0.each_ref().map(rows);
    let short = [rows(&LAGGING.0[0].between(Stamp::from_nanos(0), Stamp::from_nanos(9_000_000_000)))];
    let (twin, confirm) = ([estimate.clone()], [confirm]);
    let chosen = |estimate: &[Dataset], confirm: &[Dataset]| {
        let (runs, watch) = (Runs { estimate, confirm, ..Runs::default() }, Watch::none());
        let structures = [ModelSpec::FUZZY_TANH];
        let begins = |stage| panic!("{stage:?} has begun");
        let bases = Bases { given: None, structures: &structures, options: &Options::default() };
        close_any(&bases, &runs, &Settings::default(), &watch, &begins)
    };
    assert!(matches!(refused(chosen(&twin, &twin)), DiagnosisError::SameRun { .. }));
    assert!(matches!(refused(chosen(&short, &confirm)), DiagnosisError::TooShort { .. }));
}

#[test]
fn missing_repeated_short_and_differently_conditioned_runs_are_rejected() {
    let [estimate, confirm, test] = LAGGING.0.each_ref().map(rows);
    let one = std::slice::from_ref;
    assert_eq!(refused(closed(one(&estimate), &[], one(&test))), DiagnosisError::NoValidationRun);
    assert_eq!(refused(closed(&[], one(&confirm), one(&test))), DiagnosisError::NoTrainingRuns);
    // Runs are compared by content: another name does not make another run.
    let mut twin = estimate.clone();
    twin.name = "another name".to_owned();
    for (role, confirm, test) in [("confirm", &twin, &test), ("test", &confirm, &twin)] {
        let twice = refused(closed(one(&estimate), one(confirm), one(test)));
        let runs = [twin.name.clone(), estimate.name.clone()];
        assert_eq!(twice, DiagnosisError::SameRun { roles: [role, "estimate"], runs });
    }
    let short = rows(&LAGGING.0[0].between(Stamp::from_nanos(0), Stamp::from_nanos(9_000_000_000)));
    let short = refused(closed(one(&short), one(&confirm), one(&test)));
    let expected = DiagnosisError::TooShort { blocks: 3, needed_blocks: 6, block_s: 3.0, needed_s: 18.0 };
    assert_eq!(short, expected);
    let sentence = short.to_string();
    assert!(sentence.contains("3 blocks of 3 s") && sentence.contains("18 s of motion"), "{sentence}");
    let otherwise = Dataset::from_run(&LAGGING.0[1], &Default::default(), &DatasetOptions::default());
    let otherwise = refused(closed(one(&estimate), one(&otherwise.expect("rows")), one(&test)));
    assert_eq!(otherwise, DiagnosisError::OtherConditioning { run: confirm.name });
}

#[test]
fn a_missing_channel_makes_an_effect_untestable_but_not_rejected() -> Result<(), Error> {
    let mut runs = LAGGING.0.clone();
    runs[1].case_temp_c = None;
    let [estimate, confirm, test] = runs.each_ref().map(rows);
    let one = std::slice::from_ref;
    let found = closed(one(&estimate), one(&confirm), one(&test))?;
    let fade = found.untestable.iter().find(|refused| refused.effect.id() == "thermal_fade");
    let why = &fade.expect("it is listed").why;
    assert_eq!(*why, Refusal::MissingChannel { run: confirm.name, channel: "case_temp_c" });
    assert!(found.refused.iter().all(|refused| refused.effect.id() != "thermal_fade"));
    assert!(found.effects.iter().any(|named| named.effect.effect().id() == "coil_lag"), "{found:?}");
    Ok(())
}

fn near(found: f64, expected: f64) {
    assert!((found / expected - 1.0).abs() < 1e-6, "{found}, not {expected}");
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads_and_its_figures_are_consistent() {
    let [estimate, confirm, test] = LAGGING.0.each_ref().map(rows);
    let one = std::slice::from_ref;
    // All processors have made the other one; on a machine with one processor, three threads make this one.
    let threads = if std::thread::available_parallelism().is_ok_and(|count| count.get() > 1) { 1 } else { 3 };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    let found = pool.install(|| closed(one(&estimate), one(&confirm), one(&test))).expect("a diagnosis");
    assert_eq!(found, *DIAGNOSED);

    // The figures are consistent: shares refer to the error above the noise floor.
    let (floor, test) = (found.noise_floor, found.test.expect("test runs"));
    assert!(test.ratio < 0.1 && test.ratio_ci95.as_ref().is_ok_and(|[_, high]| *high < 0.2));
    let forces: Vec<f64> = estimate.rows.iter().filter(|row| row.counts).map(|row| row.force_n).collect();
    let mean = forces.iter().sum::<f64>() / forces.len() as f64;
    let variance = forces.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / forces.len() as f64;
    near(floor.esr, floor.rsse_n.powi(2) / variance);
    near(test.ratio, (test.after.rsse_n / test.before.rsse_n).powi(2));
    near(
        test.removed.expect("something"),
        (1.0 - test.ratio) / (1.0 - (floor.rsse_n / test.before.rsse_n).powi(2)),
    );
    near(test.ratio, test.after.esr / test.before.esr);
    assert!(test.ratio_ci95.is_ok_and(|[low, high]| low < test.ratio && test.ratio < high));
    assert!(test.removed > Some(1.0 - test.ratio), "the noise floor is above zero");
}

/// Two healthy runs of one pattern differ by the noise that the third differences of a single run also measure.
#[test]
fn noise_from_replicates_and_from_a_single_run_agree() -> Result<(), Error> {
    let case = spec("paired null").case(2)?;
    let [estimate, confirm, _] = LAGGING.0.each_ref().map(|run| [rows(run)]);
    let replicates = [rows(&case.test[0]), rows(&case.reference[2])];
    let floor = |replicates: &[Dataset], noise_floor_n| -> Result<NoiseFloor, Error> {
        let runs = Runs { estimate: &estimate, confirm: &confirm, replicates, ..Runs::default() };
        let settings = Settings { most_effects: 1, most_terms: 0, noise_floor_n, ..Settings::default() };
        Ok(close(&LAGGING.1, &runs, &settings, &Watch::none(), &|_| {})?.noise_floor)
    };
    let (replicated, estimated) = (floor(&replicates, None)?, floor(&[], None)?);
    assert_eq!((replicated.source, estimated.source), (FloorSource::Replicates, FloorSource::Estimated));
    let ratio = replicated.rsse_n / estimated.rsse_n;
    assert!((0.8..1.5).contains(&ratio), "{replicated:?} {estimated:?}");
    let declared = floor(&[], Some(7.0))?;
    assert_eq!((declared.source, declared.rsse_n), (FloorSource::Declared, 7.0));
    // Runs with different displacements are rejected as replicates, and so is a single run.
    let strangers = floor(&[replicates[0].clone(), confirm[0].clone()], None);
    assert!(matches!(
        strangers,
        Err(Error::Diagnosis(DiagnosisError::DifferentMotion { difference, most: 0.1, .. })) if difference > 0.1
    ));
    let alone = floor(&replicates[..1], None);
    assert!(matches!(alone, Err(Error::Diagnosis(DiagnosisError::OneReplicate { .. }))));
    Ok(())
}

#[test]
fn short_test_runs_give_neither_an_interval_nor_the_verdict_explained() -> Result<(), Error> {
    let [estimate, confirm, _] = LAGGING.0.each_ref().map(rows);
    let short = rows(&LAGGING.0[2].between(Stamp::from_nanos(0), Stamp::from_nanos(5_000_000_000)));
    let one = std::slice::from_ref;
    let long = &*DIAGNOSED;
    let cut = closed(one(&estimate), one(&confirm), one(&short))?;
    // The effects and their errors are the same; only the proof is missing.
    assert_eq!((long.verdict, cut.verdict), (Verdict::Explained, Verdict::Unexplained));
    assert_eq!(long.effects, cut.effects);
    assert!(long.test.as_ref().is_some_and(|test| test.proves() && (8..=10).contains(&test.blocks)));
    let test = cut.test.expect("a test result");
    let Err(why @ NoInterval::TooShort { .. }) = test.ratio_ci95 else { panic!("{test:?}") };
    assert!(why.needed_s().is_some_and(|s| s > 5.0) && why.to_string().contains(" s of motion"), "{why}");
    assert!(!test.proves() && test.ratio < 0.2, "{test:?}");
    Ok(())
}

#[test]
fn a_low_sample_rate_makes_the_noise_floor_unknown_and_hides_no_effect() -> Result<(), Error> {
    let options = DatasetOptions { rate_hz: Some(64.0), ..DatasetOptions::default() };
    let slow = |run: &Run| Dataset::from_run(run, &CONDITIONING, &options);
    let [estimate, confirm, test] = LAGGING.0.each_ref().map(slow);
    let (fast, slow) = (&*DIAGNOSED, &closed(&[estimate?], &[confirm?], &[test?])?);
    assert!(fast.noise_floor.is_known() && fast.noise_floor.rsse_n < 4.0, "{:?}", fast.noise_floor);
    assert!(!slow.noise_floor.is_known() && slow.noise_floor.rsse_n == 0.0, "{:?}", slow.noise_floor);
    assert_ne!(slow.verdict, Verdict::NothingToExplain);
    assert_eq!(fast.verdict, Verdict::Explained);
    // At 64 Hz another structure may fit better; then the effect is withdrawn with that reason.
    for found in [fast, slow] {
        let named = found.effects.iter().map(|named| named.effect.effect().id());
        let refused =
            found.refused.iter().filter(|refused| matches!(refused.why, Refusal::BaseInadequate(_)));
        let mut seen = named.chain(refused.map(|refused| refused.effect.id()));
        assert!(seen.any(|id| id == "coil_lag"), "{:?}", found.refused);
    }
    Ok(())
}
