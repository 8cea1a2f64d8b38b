//! Time per sample with each effect, compared with the model alone: for the model, and for everything that
//! the estimating thread does with a sample of displacement, current and force.
//!
//! ```text
//! cargo bench -p mr-damper-model --bench effects
//! ```

mod middle;
mod motion;
mod subject;

use divan::Bencher;
use divan::counter::ItemsCount;
use middle::present;
use motion::{SAMPLES, motion};
use mr_damper_model::effect::{Augmented, AugmentedState, Effect, EffectModel, Effects};
use mr_damper_model::force::{ForceModel, FreeRun};
use mr_damper_model::preset;
use mr_damper_model::sample::{Drive, Reading, Sample, Stamp};
use mr_damper_model::units::{Ampere, Metre, Newton};

fn main() {
    divan::main();
}

fn force() -> ForceModel {
    preset::load(preset::BEST_FUZZY_TANH).expect("a preset").force
}

fn run(bencher: Bencher, effects: &[EffectModel]) {
    let effects = Effects::new(effects).expect("few enough");
    let (model, motion) = (Augmented::new(force(), effects).expect("compatible effects"), motion());
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

/// The motion as samples that the node receives.
fn samples() -> Vec<Sample> {
    let at = |(k, inputs): (usize, &mr_damper_model::force::Inputs)| {
        let stamp = Stamp::from_nanos(k as i64 * 1_953_125);
        let drive = Drive::CoilCurrent(Ampere(inputs.drive));
        [
            Reading::Drive(drive),
            Reading::Displacement(Metre(inputs.displacement_m)),
            Reading::Force(Newton(1e3 * inputs.velocity_m_s)),
        ]
        .map(|reading| Sample { stamp, received: stamp, reading })
    };
    motion().iter().enumerate().flat_map(at).collect()
}

fn service(bencher: Bencher, effects: &[EffectModel]) {
    let pipeline = subject::service(effects, true);
    let samples = samples();
    bencher.counter(ItemsCount::new(SAMPLES)).with_inputs(|| pipeline.clone()).bench_refs(|pipeline| {
        let mut events = 0_u32;
        for sample in &samples {
            pipeline.step(divan::black_box(sample), &mut |event| {
                divan::black_box(event);
                events += 1;
            });
        }
        events
    });
}

#[divan::bench]
fn service_without(bencher: Bencher) {
    service(bencher, &[]);
}

#[divan::bench(args = Effect::ALL)]
fn service_with(bencher: Bencher, effect: Effect) {
    service(bencher, &[present(effect)]);
}
