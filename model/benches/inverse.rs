//! Time of one command: the search for the current, the model's step, the limits. Figures are per sample.
//!
//! ```text
//! cargo bench -p mr-damper-model --bench inverse
//! ```

mod motion;

use divan::Bencher;
use divan::counter::ItemsCount;
use motion::{SAMPLES, motion};
use mr_damper_model::effect::{Effect, EffectModel, Effects};
use mr_damper_model::inverse::{Commander, Demand, Limits};
use mr_damper_model::model::Model;
use mr_damper_model::preset;

fn main() {
    divan::main();
}

fn command(bencher: Bencher, effects: &[EffectModel]) {
    let effects = Effects::new(effects).expect("few enough");
    let model = Model { effects, ..preset::load(preset::BEST_FUZZY_TANH).expect("a preset") };
    let commander = Commander::new(&model, Limits::default()).expect("it follows a current");
    let motion = motion();
    bencher.counter(ItemsCount::new(SAMPLES)).with_inputs(|| commander).bench_refs(|commander| {
        let demand_n = |v_m_s: f64| 500.0 * v_m_s.signum() + 1500.0 * v_m_s;
        let step = |at: &mr_damper_model::force::Inputs| {
            commander.step(divan::black_box(at), Demand::Force(demand_n(at.velocity_m_s)), None).current.get()
        };
        motion.iter().map(step).sum::<f64>()
    });
}

#[divan::bench]
fn fuzzy_tanh(bencher: Bencher) {
    command(bencher, &[]);
}

#[divan::bench]
fn with_coil_lag(bencher: Bencher) {
    command(bencher, &[EffectModel::new(Effect::CoilLag, &[0.012]).expect("within range")]);
}

#[divan::bench]
fn with_coil_lag_and_gas_spring(bencher: Bencher) {
    let effects = [(Effect::CoilLag, 0.012), (Effect::GasSpring, 2e3)];
    command(
        bencher,
        &effects.map(|(effect, value)| EffectModel::new(effect, &[value]).expect("within range")),
    );
}
