//! Discovery of terms on generated runs: effects that the library does not have.
//!
//! The example `discovery_rates` measures how often this succeeds.

use crate::diagnosis::cases::{CaseSpec, Kind};
use crate::diagnosis::instruments::Instrument;
use crate::diagnosis::outcome::{CONDITIONING, names};
use mr_damper_model::diagnose::discover::Claim;
use mr_damper_model::diagnose::{
    DiagnosisResult, EffectSet, Refusal, Runs, Settings, Thresholds, Verdict, close,
};
use mr_damper_model::effect::term::{Argument, Form, Modulator, Term};
use mr_damper_model::force::{ForceLaw, Form as LawForm};
use mr_damper_model::identify::{
    Dataset, DatasetOptions, ModelSpec, Options, Structure, Watch, identify_datasets,
};
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::sample::{Run, Stamp, Trace};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

fn rows(runs: &[Run]) -> Vec<Dataset> {
    let one = |run| Dataset::from_run(run, &CONDITIONING, &DatasetOptions::default()).expect("rows");
    runs.iter().map(one).collect()
}

/// The diagnosis of a case with the effect `truth`, with or without a run of the healthy damper.
fn diagnose(truth: &[(&'static str, f64)], with_healthy: bool, settings: &Settings) -> DiagnosisResult {
    let spec =
        CaseSpec { kind: Kind::Outside, truth: truth.to_vec(), share: 1.0, instrument: Instrument::Fine };
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

/// A run of an oscillator with the force `extra_n` of displacement and velocity beside a linear spring, from its exact motion: twelve sines with
/// frequencies and phases of this seed.
///
/// ```text
/// F = m a + c v + k x + extra(x, v)
/// ```
fn oscillator(seed: u64, extra_n: impl Fn(f64, f64) -> f64) -> Run {
    let (mass_kg, damping_n_s_m, stiffness_n_m) = (1.5, 150.0, 1.2e4);
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let sines: Vec<[f64; 3]> = (0..12_u32)
        .map(|j| {
            let (j, turn) = (f64::from(j), 2.0 * std::f64::consts::PI);
            [
                0.012 / (1.0 + j),
                turn * (0.4 + 0.9 * j + 0.3 * random.random::<f64>()),
                turn * random.random::<f64>(),
            ]
        })
        .collect();
    let (mut displacement_m, mut force_n) = (Trace::default(), Trace::default());
    for k in 0..30 * 512_u32 {
        let time_s = f64::from(k) / 512.0;
        let [mut x, mut v, mut a] = [0.0; 3];
        for [amplitude, omega, phase] in &sines {
            let (sin, cos) = (omega * time_s + phase).sin_cos();
            x += amplitude * sin;
            v += amplitude * omega * cos;
            a -= amplitude * omega * omega * sin;
        }
        let stamp = Stamp::from_nanos((time_s * 1e9).round() as i64);
        let noise_n = 3.0 * (random.random::<f64>() - 0.5);
        displacement_m.stamps.push(stamp);
        displacement_m.values.push(x);
        force_n.stamps.push(stamp);
        force_n.values.push(mass_kg * a + damping_n_s_m * v + stiffness_n_m * x + extra_n(x, v) + noise_n);
    }
    Run { name: format!("oscillator {seed}"), displacement_m, force_n: Some(force_n), ..Run::default() }
}

/// The diagnosis of these runs; the base is the linear model.
pub(crate) fn close_from_linear(runs: [&[Run]; 3], settings: &Settings) -> DiagnosisResult {
    let [estimate, confirm, test] = runs.map(rows);
    let options = Options { conditioning: CONDITIONING, choose_velocity: false, ..Options::default() };
    let spec = ModelSpec::new(Structure::Law(ForceLaw::Linear), LawForm::Passive).expect("a passive law");
    let base = identify_datasets(spec, &estimate, &options, &Watch::none()).expect("a base").model;
    let runs = Runs { estimate: &estimate, confirm: &confirm, test: &test, ..Runs::default() };
    close(&base, &runs, settings, &Watch::none(), &|_| {}).expect("a result")
}

/// The amount of the term that is this modulator alone.
pub(crate) fn constant(found: &DiagnosisResult, modulator: Modulator) -> f64 {
    let is = |term: &&Term| term.kind() == (modulator, Argument::Displacement, Form::Constant);
    let mut terms = found.discovery.terms.iter().map(|found| &found.term);
    terms.find(is).map_or_else(|| panic!("{:?} {:?}", found.verdict, found.discovery), Term::amount)
}

/// The diagnosis of the oscillator with this force; the base is the linear model.
fn diagnose_oscillator(seed: u64, extra_n: impl Fn(f64, f64) -> f64, settings: &Settings) -> DiagnosisResult {
    let [estimate, confirm, test] = [seed, seed + 1, seed + 2].map(|seed| [oscillator(seed, &extra_n)]);
    close_from_linear([&estimate, &confirm, &test], settings)
}

/// The end of the equation and the amount of the only term of `found`, which has inertia as its only effect of the library.
fn spring_beside_inertia(found: &DiagnosisResult) -> (String, f64) {
    assert_eq!(names(found), ["inertia"], "{:?}", found.discovery);
    let [term] = &found.discovery.terms[..] else { panic!("{:?}", found.discovery) };
    let equation = term.term.equation("A");
    (equation.rsplit_once(" N/").expect("a force").1.to_owned(), term.term.amount())
}

#[test]
fn a_cubic_spring_is_found_with_its_sign() {
    let hardening = diagnose_oscillator(60, |x, _| 3e7 * x.powi(3), &Settings::default());
    let softening = diagnose_oscillator(50, |x, _| -1.2e7 * x.powi(3), &Settings::default());
    for (found, cubic_n_m3) in [(hardening, 3e7), (softening, -1.2e7)] {
        let (equation, amount) = spring_beside_inertia(&found);
        assert_eq!(equation, "m³ x³,  x: displacement");
        assert!((amount / cubic_n_m3 - 1.0).abs() < 0.01, "{amount}");
    }
}

#[test]
fn a_term_takes_the_place_of_the_effect_that_it_resembles() {
    let cubic: (u64, fn(f64) -> f64) = (50, |x| 3e7 * x.powi(3));
    let square: (u64, fn(f64) -> f64) = (70, |x| 2e5 * x.abs() * x);
    for ((seed, spring_n), of_spring) in [(cubic, ("m³ x³", 3e7)), (square, ("m² |x| x", 2e5))] {
        // No term leaves nothing of the error that an effect leaves, so the nearest name of the library stands.
        let library = Thresholds { term_surpasses: 1.0, ..Thresholds::default() };
        let settings = Settings { thresholds: library, ..Settings::default() };
        let library = diagnose_oscillator(seed, |x, _| spring_n(x), &settings);
        assert!(names(&library).contains(&"end_stop"), "{:?}", library.discovery);
        let found = diagnose_oscillator(seed, |x, _| spring_n(x), &Settings::default());
        let (equation, amount) = spring_beside_inertia(&found);
        assert_eq!(equation, format!("{},  x: displacement", of_spring.0));
        assert!((amount / of_spring.1 - 1.0).abs() < 0.01, "{amount}");
        let why = found.refused.iter().find(|refused| refused.effect.id() == "end_stop");
        assert_eq!(why.map(|refused| &refused.why), Some(&Refusal::TakenOverByTerm));
    }
}

#[test]
fn a_mass_and_a_friction_are_found_in_their_simplest_form_without_the_library() {
    // A third term would follow the acceleration, which is a difference and lags by half a sample.
    let settings = Settings { effects: EffectSet::NONE, most_terms: 2, ..Settings::default() };
    let found = diagnose_oscillator(80, |_, v| 20.0 * v.signum(), &settings);
    let (mass_kg, friction_n) =
        (constant(&found, Modulator::Acceleration), constant(&found, Modulator::SignVelocity));
    assert!((mass_kg / 1.5 - 1.0).abs() < 0.02, "{mass_kg}");
    assert!((friction_n / 20.0 - 1.0).abs() < 0.05, "{friction_n}");
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
