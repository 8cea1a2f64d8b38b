//! Models of runs that do not show all of the damper: bounded and dissipative beyond them as well.

use mr_damper_model::force::{ForceLaw, Form};
use mr_damper_model::identify::{
    Dataset, DatasetOptions, Identified, ModelSpec, Options, Structure, SweptFaultKind, Watch, identify,
    score,
};
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::Run;

fn run(experiment: &str, seconds: f64, seed: u64) -> Run {
    let experiment = Experiment::thesis(experiment).expect("of the thesis").with_duration_s(seconds);
    record(&experiment.with_pattern(seed), &Plant::default(), &Channels::default(), seed)
}

fn identified(spec: ModelSpec, run: &Run) -> Identified {
    let options = Options { choose_velocity: false, restarts: 12, ..Options::default() };
    identify(spec, std::slice::from_ref(run), &options, &Watch::none()).expect("a model")
}

/// NMSE of the simulation on another run.
fn nmse(found: &Identified, run: &Run) -> f64 {
    let data = Dataset::from_run(run, &found.model.conditioning, &DatasetOptions::default()).expect("a run");
    let scores = score(&found.model.augmented(), &data, &Watch::none()).expect("it can be stepped");
    scores.free_run_without_offset.expect("finite").esr
}

#[test]
fn runs_that_fill_the_range_are_fitted_by_least_squares_alone() {
    let found = identified(ModelSpec::FUZZY_TANH, &run("RP-PRBS", 30.0, 1));
    let swept = found.swept.expect("a model without measured force is swept");
    assert!(found.without_prior.is_none() && swept.faults.is_empty() && swept.grows, "{swept}");
    assert!(found.warnings.is_empty(), "{:?}", found.warnings);
}

#[test]
fn a_fit_that_drives_the_motion_where_the_runs_have_no_rows_gets_a_prior() {
    // 8 s of random current hold no fast motion at 0 A. Least squares alone: -21 J in a cycle there, NMSE .12 to .14 on runs that
    // have it.
    let found = identified(ModelSpec::FUZZY_TANH, &run("RP-APRBS", 8.0, 0));
    let without = found.without_prior.as_ref().expect("a prior");
    let drives_motion = |kind| matches!(kind, SweptFaultKind::DrivesMotion { .. });
    assert!(without.faults.iter().any(|fault| drives_motion(fault.kind)), "{without}");
    assert!(found.swept.as_ref().expect("swept").faults.is_empty(), "{:?}", found.warnings);
    let [before, after] = [without.free_run, found.free_run].map(|fit| fit.expect("finite").esr);
    assert!(after < 1.1 * before, "the training error hardly rises: {before} {after}");
    for (experiment, limit) in [("RP-ICPS", 0.03), ("RP1-CS", 0.03), ("RP-PRBS", 0.06)] {
        let error = nmse(&found, &run(experiment, 8.0, 1000));
        assert!(error < limit, "{experiment}: {error}");
    }
}

fn choi() -> ModelSpec {
    ModelSpec::new(Structure::Law(ForceLaw::Choi), Form::SemiActive).expect("a form")
}

#[test]
fn a_polynomial_of_the_velocity_stays_bounded_where_the_runs_have_no_fast_motion() {
    let found = identified(choi(), &run("RP-APRBS", 8.0, 2));
    let without = found.without_prior.expect("a prior");
    assert!(matches!(without.faults[0].kind, SweptFaultKind::TooLarge { .. }), "{without}");
    assert!(found.swept.expect("swept").faults.is_empty(), "{:?}", found.warnings);
}

#[test]
fn a_polynomial_that_the_runs_determine_keeps_its_fit_and_has_a_warning() {
    // A fifth power of the velocity cannot follow the runs and stay bounded above their speeds.
    let found = identified(choi(), &run("RP-ICPS", 10.0, 0));
    assert!(found.without_prior.is_none());
    let warning = found.warnings.first().expect("a warning");
    assert!(
        warning.contains("times the largest measured force") && warning.contains("add runs"),
        "{warning}"
    );
}

#[test]
fn a_model_that_uses_measured_force_is_not_swept() {
    let arx = ModelSpec::new(Structure::Arx, Form::SemiActive).expect("a form");
    let found = identified(arx, &run("RP-PRBS", 10.0, 1));
    assert!(found.swept.is_none() && found.without_prior.is_none());
}
