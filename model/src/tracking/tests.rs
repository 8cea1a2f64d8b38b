//! The tracker on runs whose values are known: the measured force is the reading of a model with other values.

use super::*;
use crate::effect::EffectModel;
use crate::preset;
use crate::rig::{Channels, Experiment, Plant, record};
use crate::sample::{Reading, Sample};
use crate::units::Newton;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use statrs::distribution::{ContinuousCDF, Normal};

const WINDOW_S: f64 = 48.0;

fn model(effects: &[EffectModel]) -> Model {
    let base = preset::load(preset::BEST_FUZZY_TANH).expect("a preset");
    Model { effects: Effects::new(effects).expect("few effects"), ..base }
}

/// The effect with all its values times `factor`.
fn scaled(effect: &EffectModel, factor: f64) -> EffectModel {
    let values: Vec<f64> = effect.parameters().iter().map(|value| factor * value).collect();
    EffectModel::new(effect.effect(), &values).expect("allowed values")
}

/// Values of the model `loaded` on a run of some windows. The first of `truths` makes its readings, and then the second.
fn track(loaded: &Model, truths: [&Model; 2], windows: [u32; 2], seed: u64) -> Vec<EffectValue> {
    track_times(1.0, loaded, truths, windows, seed)
}

/// The same, with a force that is `ratio` times as large.
fn track_times(
    ratio: f64,
    loaded: &Model,
    truths: [&Model; 2],
    windows: [u32; 2],
    seed: u64,
) -> Vec<EffectValue> {
    let seconds = |windows: u32| WINDOW_S * f64::from(windows);
    let experiment = Experiment::thesis("RP-APRBS")
        .expect("an experiment")
        .with_duration_s(seconds(windows[0] + windows[1]) + 2.0);
    let run = record(&experiment, &Plant::default(), &Channels::PERFECT.with_ambient(), seed);
    let settings = Settings::default();
    let mut truth = Replica::new(*truths[0], settings).expect("a good model");
    let mut later = Some(Replica::new(*truths[1], settings).expect("a good model"));
    let tracking = TrackingSettings { window_s: WINDOW_S, ..TrackingSettings::default() };
    let mut tracker = EffectTracker::new(loaded, &settings, &tracking).expect("good settings");
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let normal = Normal::standard();
    let mut noise_n = 0.0;
    let mut values: Vec<EffectValue> = Vec::new();
    let mut emit = |value| values.push(value);
    let begin = run.samples().next().expect("samples").stamp;
    for sample in run.samples().filter(|sample| !matches!(sample.reading, Reading::Force(_))) {
        if sample.stamp.since(begin).get() > seconds(windows[0])
            && let Some(later) = later.take()
        {
            truth = later;
        }
        truth.step(&sample);
        tracker.step(&sample, &mut emit);
        if !matches!(sample.reading, Reading::Displacement(_)) {
            continue;
        }
        // The residual of a force of zero is minus the reading.
        truth.step(&Sample { reading: Reading::Force(Newton(0.0)), ..sample });
        // The noise has a standard deviation of 2 N and a correlation time of 0.2 s.
        let white = normal.inverse_cdf(random.random_range(1e-12..1.0));
        noise_n = 0.99 * noise_n + 2.0 * (1.0_f64 - 0.99 * 0.99).sqrt() * white;
        if let Some(expected) = truth.residuals.pop_back() {
            let force = Reading::Force(Newton(20.0 + noise_n - ratio * expected.residual.get()));
            tracker.step(&Sample { reading: force, ..sample }, &mut emit);
        }
    }
    values
}

/// Those of effects.
fn of_effects(found: &[EffectValue]) -> Vec<EffectValue> {
    found.iter().copied().filter(|value| value.quantity.effect().is_some()).collect()
}

#[test]
fn the_values_of_each_effect_are_found() {
    for effect in Effect::ALL {
        let loaded = effect.example();
        let truth = scaled(&loaded, 0.95);
        let found = of_effects(&track(&model(&[loaded]), [&model(&[truth]); 2], [1, 0], 7));
        assert_eq!(found.len(), effect.parameters().len(), "{effect:?}");
        for (value, truth) in found.iter().zip(truth.parameters()) {
            let half = 0.5 * (value.ci95[1] - value.ci95[0]);
            // One step of least squares leaves a part of the difference if the force is not linear in the value.
            let allowed = 1.5 * half + 0.35 * (value.running - truth).abs();
            assert!((value.value - truth).abs() < allowed, "{effect:?}: {truth}, {value:?}");
            assert!(half < 0.25 * value.running.abs(), "{effect:?}: {value:?}");
            assert_eq!((value.windows, value.changed), (1, false));
        }
    }
}

#[test]
fn intervals_contain_the_truth() {
    let model = model(&[Effect::CoilLag.example(), Effect::Friction.example()]);
    let found = track(&model, [&model; 2], [40, 0], 3);
    assert!(found.iter().all(|value| !value.changed));
    let ratios = found.iter().filter(|it| it.quantity == Quantity::ForceRatio);
    assert!(ratios.filter(|it| (it.ci95[0]..=it.ci95[1]).contains(&1.0)).count() >= 35);
    let found = of_effects(&found);
    let inside = found.iter().filter(|it| (it.ci95[0]..=it.ci95[1]).contains(&it.running)).count();
    assert_eq!(found.len(), 80);
    assert!((70..80).contains(&inside), "{inside} of 80");
}

#[test]
fn a_change_is_found_and_no_other() {
    let [lag, friction] = [Effect::CoilLag.example(), Effect::Friction.example()];
    let healthy = model(&[lag, friction]);
    let slower = model(&[scaled(&lag, 1.2), friction]);
    let found = track(&healthy, [&healthy, &slower], [12, 4], 5);
    let [lags, frictions]: [Vec<&EffectValue>; 2] = [Effect::CoilLag, Effect::Friction]
        .map(|effect| found.iter().filter(|it| it.quantity.effect() == Some(effect)).collect());
    assert!(frictions.iter().all(|value| !value.changed));
    let changed = lags.iter().position(|value| value.changed).expect("a change");
    assert!((12..16).contains(&changed), "window {changed}");
    assert!(lags[changed..].iter().all(|value| value.changed));
}

#[test]
fn a_weaker_force_is_a_smaller_ratio() {
    let none = model(&[]);
    let found = track_times(0.93, &none, [&none; 2], [2, 0], 4);
    assert_eq!(found.len(), 2);
    for value in &found {
        assert_eq!((value.quantity, value.running), (Quantity::ForceRatio, 1.0));
        assert!((value.value - 0.93).abs() < 0.003 && value.ci95[1] - value.ci95[0] < 0.01, "{value:?}");
        assert!(value.excitation.iter().all(|z| z.is_finite()));
    }
}

#[test]
fn a_value_without_influence_is_not_determined() {
    // Such as a lag of a constant current, beside a friction.
    let mut window = Window::new(2, WINDOW_S);
    let mut found = None;
    for k in 0..49_000 {
        let moving = (0.1 * f64::from(k)).sin();
        found = found.or(window.add(
            1e-3,
            &[0.0, moving.signum()],
            3.0 * moving.signum() + 0.1 * (0.37 * f64::from(k)).sin(),
        ));
    }
    let found = found.expect("a window");
    assert_eq!(found[0], None);
    assert!(
        found[1].is_some_and(|found| (found.difference - 3.0).abs() < 0.01 && found.half < 0.01),
        "{found:?}"
    );
}

#[test]
fn wrong_settings_are_refused() {
    let short = TrackingSettings { window_s: 20.0, ..TrackingSettings::default() };
    let error = EffectTracker::new(&model(&[]), &Settings::default(), &short).expect_err("too short");
    assert_eq!(error.to_string(), "effects.window_s is 20, but must be between 48 and 86400 s");
}
