//! Discovery of terms on generated runs: effects that the library does not have.
//!
//! The example `discovery_rates` measures how often this succeeds.

use crate::diagnosis::cases::{CaseSpec, Kind};
use crate::diagnosis::instruments::Instrument;
use crate::diagnosis::outcome::CONDITIONING;
use mr_damper_model::diagnose::discover::Claim;
use mr_damper_model::diagnose::{DiagnosisResult, EffectSet, Runs, Settings, Verdict, close};
use mr_damper_model::effect::term::{Argument, Form, Modulator};
use mr_damper_model::identify::{Dataset, DatasetOptions, ModelSpec, Options, Watch, identify_datasets};
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::sample::Run;

/// The diagnosis of a case with the effect `truth`, with or without a run of the healthy damper.
fn diagnose(truth: &[(&'static str, f64)], with_healthy: bool, settings: &Settings) -> DiagnosisResult {
    let spec =
        CaseSpec { kind: Kind::Outside, truth: truth.to_vec(), share: 1.0, instrument: Instrument::Fine };
    let rows = |runs: &[Run]| -> Vec<Dataset> {
        let one = |run| Dataset::from_run(run, &CONDITIONING, &DatasetOptions::default()).expect("rows");
        runs.iter().map(one).collect()
    };
    let case = spec.case(52).expect("a case");
    let (estimate, confirm, test) = (rows(&case.estimate), rows(&case.confirm), rows(&case.test));
    let healthy = if with_healthy { rows(&spec.healthy(152).expect("a case").estimate) } else { Vec::new() };
    let options =
        Options { conditioning: CONDITIONING, choose_velocity: false, restarts: 4, ..Options::default() };
    let base =
        identify_datasets(ModelSpec::FUZZY_TANH, &estimate, &options, &Watch::none()).expect("a base").model;
    let runs =
        Runs { estimate: &estimate, confirm: &confirm, test: &test, healthy: &healthy, ..Runs::default() };
    close(&base, &runs, settings, &Watch::none(), &|_| {}).expect("a result")
}

#[test]
fn a_sudden_loss_of_force_is_found_and_added() {
    let settings = Settings { most_terms: 1, ..Settings::default() };
    let found = diagnose(&[("force_loss", 0.15)], true, &settings);
    let [term] = &found.discovery.terms[..] else { panic!("{:?}", found.discovery) };
    assert_eq!(term.term.kind(), (Modulator::Force, Argument::Time, Form::Step), "{term:?}");
    assert!((term.term.amount() + 0.15).abs() < 0.01, "{term:?}");
    assert!((term.term.parameters()[0] - 15.0).abs() < 0.1, "the middle of 30 s: {term:?}");
    assert!(
        matches!(term.claim, Claim::Effect { on_healthy: Some(ratio) } if ratio < 0.1),
        "{:?}",
        term.claim
    );
    let [low, high] = term.ci95[0];
    assert!(low < -0.15 + 0.005 && high > -0.15 - 0.005, "{:?}", term.ci95);
    // The curve without a closed form shows the loss too.
    let truth = |time_s: f64| if time_s < 15.0 { 0.0 } else { -0.15 };
    let away: Vec<_> = term.curve.iter().filter(|point| (point.argument - 15.0).abs() > 3.0).collect();
    assert!(away.len() >= 6, "{:?}", term.curve);
    assert!(away.iter().all(|point| (point.value - truth(point.argument)).abs() < 0.02), "{away:?}");
    assert!(away.iter().all(|point| point.ci95[1] - point.ci95[0] < 0.02), "{away:?}");
    let test = found.test.as_ref().expect("a test run");
    assert!(test.removed.is_some_and(|removed| removed > 0.9), "{test:?}");
    assert_eq!(found.verdict, Verdict::Explained);
    let file = ModelFile { model: found.after, provenance: Provenance::default() };
    let read = ModelFile::from_toml(&file.to_toml().expect("writes")).expect("reads");
    assert_eq!(read.model.effects, found.after.effects);
}

#[test]
fn the_resonance_of_a_mount_is_found_with_its_frequency_and_damping() {
    let settings = Settings { most_terms: 1, ..Settings::default() };
    let found = diagnose(&[("mount_resonance", 0.25)], true, &settings);
    let [term] = &found.discovery.terms[..] else { panic!("{:?}", found.discovery) };
    assert_eq!(term.term.kind(), (Modulator::One, Argument::Force, Form::Resonance), "{term:?}");
    let &[frequency_hz, damping] = term.term.parameters() else { panic!("{term:?}") };
    assert!((frequency_hz - 32.0).abs() < 0.3 && (damping - 0.06).abs() < 0.01, "{term:?}");
    assert!(term.claim.is_effect(), "{:?}", term.claim);
}

#[test]
fn a_hum_is_said_with_its_frequency_and_is_not_in_the_model() {
    let settings = Settings { most_terms: 1, effects: EffectSet::NONE, ..Settings::default() };
    let found = diagnose(&[("mains_hum", 30.0)], false, &settings);
    let hum = found.discovery.hum.expect("a hum");
    assert!((hum.frequency_hz - 50.0).abs() < 0.02, "{hum:?}");
    // The anti-alias filter of the rig's force channel takes some of it.
    assert!((24.0..32.0).contains(&hum.amplitude_n), "{hum:?}");
    assert!(found.discovery.terms.iter().all(|term| term.term.kind().1 != Argument::Time));
    assert!(diagnose(&[], false, &settings).discovery.hum.is_none());
}

#[test]
fn nothing_in_the_own_variables_of_the_base_is_called_an_effect_without_a_healthy_run() {
    for truth in [&[][..], &[("relief_valve", 0.3)]] {
        let found = diagnose(truth, false, &Settings::default());
        for term in &found.discovery.terms {
            assert_eq!(term.claim, Claim::EffectOrStructure { on_healthy: None }, "{term:?}");
        }
    }
}

#[test]
fn without_terms_the_result_is_that_of_the_library() {
    let effects = EffectSet::only(&["coil_lag"]).expect("a set");
    let settings = Settings { most_terms: 0, effects, ..Settings::default() };
    let found = diagnose(&[("force_loss", 0.15)], false, &settings);
    assert!(found.discovery.terms.is_empty() && found.discovery.refused.is_none());
    assert_eq!(found.verdict, Verdict::Unexplained);
}
