//! Time of one sample of a model with each effect around it, beside the model alone. Figures are per sample.
//!
//! ```text
//! cargo bench -p mr-damper-model --bench effects
//! ```

mod motion;

use divan::Bencher;
use divan::counter::ItemsCount;
use motion::{SAMPLES, motion};
use mr_damper_model::effect::{Augmented, AugmentedState, Effect, EffectModel, Effects};
use mr_damper_model::force::{ForceModel, FreeRun};
use mr_damper_model::preset;

fn main() {
    divan::main();
}

fn force() -> ForceModel {
    preset::load(preset::BEST_FUZZY_TANH).expect("a preset").force
}

/// In the middle of its range, on a damper of 1 kN, 15 mm, 0.2 m/s.
fn present(effect: Effect) -> EffectModel {
    let value = |p: &mr_damper_model::effect::Parameter| {
        let size = 1e3_f64.powi(p.scale.force)
            * 0.015_f64.powi(p.scale.displacement)
            * 0.2_f64.powi(p.scale.velocity);
        let [low, high] = p.range_at(size);
        if high > 0.0 { 0.5 * high } else { 0.5 * low }
    };
    let values: Vec<f64> = effect.parameters().iter().map(value).collect();
    EffectModel::new(effect, &values).expect("within range")
}

fn run(bencher: Bencher, effects: &[EffectModel]) {
    let effects = Effects::new(effects).expect("few enough");
    let (model, motion) = (Augmented::new(force(), effects).expect("they go together"), motion());
    bencher.counter(ItemsCount::new(SAMPLES)).bench(|| {
        let mut state = AugmentedState::default();
        motion.iter().filter_map(|at| model.free_run(&mut state, divan::black_box(at))).sum::<f64>()
    });
}

#[divan::bench]
fn model_alone(bencher: Bencher) {
    let (force, motion) = (force(), motion());
    bencher.counter(ItemsCount::new(SAMPLES)).bench(|| {
        let mut state = FreeRun::default();
        motion.iter().filter_map(|at| force.free_run(&mut state, divan::black_box(at))).sum::<f64>()
    });
}

#[divan::bench]
fn no_effect(bencher: Bencher) {
    run(bencher, &[]);
}

#[divan::bench(args = Effect::ALL)]
fn one_effect(bencher: Bencher, effect: Effect) {
    run(bencher, &[present(effect)]);
}

#[divan::bench]
fn three_effects(bencher: Bencher) {
    run(bencher, &[Effect::CoilLagRiseFall, Effect::GasSpring, Effect::AntiAliasMismatch].map(present));
}
