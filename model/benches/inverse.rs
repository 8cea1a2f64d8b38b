//! Time of one command of the inverse controller: the search for the current, the model's step, and the
//! limits. Times are per sample.
//!
//! ```text
//! cargo bench -p mr-damper-model --bench inverse
//! ```

mod learned;
mod motion;

use divan::Bencher;
use divan::counter::ItemsCount;
use learned::with_learned;
use motion::{SAMPLES, motion};
use mr_damper_model::effect::{Effect, EffectModel, Effects};
use mr_damper_model::force::{Dependence, ForceLaw, ForceModel, LawModel};
use mr_damper_model::inverse::{Demand, InverseController, Limits, Method};
use mr_damper_model::model::Model;
use mr_damper_model::preset;
use mr_damper_model::sample::DriveKind;

fn main() {
    divan::main();
}

fn fuzzy_tanh_model() -> Model {
    preset::load(preset::BEST_FUZZY_TANH).expect("a preset")
}

/// A model of `law` whose parameters are linear in the current.
fn law_model(law: ForceLaw, none: &[f64], per_a: &[f64]) -> Model {
    let dependence = Dependence::Polynomial { drive: DriveKind::CoilCurrent, degree: 1 };
    let force = LawModel::new(law, dependence, &[none, per_a].concat(), 0.0).expect("in order");
    Model { force: ForceModel::Law(force), ..fuzzy_tanh_model() }
}

fn bouc_wen_model() -> Model {
    law_model(
        ForceLaw::BoucWen,
        &[600.0, 8e3, 1e3, 500.0, 80.0, 150.0, 2.0, 150.0, 300.0],
        &[200.0, 4e3, 0.0, 0.0, 300.0, 0.0, 0.0, 0.0, 0.0],
    )
}

fn with_effects(bencher: Bencher, effects: &[EffectModel]) {
    let effects = Effects::new(effects).expect("few enough");
    command(bencher, &Model { effects, ..fuzzy_tanh_model() }, Method::Search);
}

fn command(bencher: Bencher, model: &Model, method: Method) {
    let controller =
        InverseController::with_method(model, Limits::default(), method).expect("a model with an inverse");
    let motion = motion();
    bencher.counter(ItemsCount::new(SAMPLES)).with_inputs(|| controller).bench_refs(|controller| {
        let demand_n = |v_m_s: f64| 500.0 * v_m_s.signum() + 1500.0 * v_m_s;
        let step = |at: &mr_damper_model::force::Inputs| {
            controller
                .step(divan::black_box(at), Demand::Force(demand_n(at.velocity_m_s)), None)
                .current
                .get()
        };
        motion.iter().map(step).sum::<f64>()
    });
}

#[divan::bench(args = [Method::Search, Method::Polynomial, Method::Fuzzy])]
fn fuzzy_tanh(bencher: Bencher, method: Method) {
    command(bencher, &fuzzy_tanh_model(), method);
}

/// Learned inverses, with the step of the force model, which gives the achievable range. A search answers while the history is incomplete.
#[divan::bench(args = [Method::Chen, Method::WangLiao, Method::WangHu])]
fn fuzzy_tanh_learned(bencher: Bencher, method: Method) {
    let kind = method.learned().expect("a learned inverse");
    command(bencher, &with_learned(fuzzy_tanh_model(), kind), method);
}

#[divan::bench(args = [Method::Search, Method::Polynomial, Method::Fuzzy])]
fn bouc_wen(bencher: Bencher, method: Method) {
    command(bencher, &bouc_wen_model(), method);
}

/// The closed form of the search, and its surrogates.
#[divan::bench(args = [Method::Search, Method::Polynomial, Method::Fuzzy])]
fn choi(bencher: Bencher, method: Method) {
    let none = [0.0, 2500.0, 0.0, -2e4, 0.0, 0.0, 0.0].repeat(2);
    let per_a = [0.0, 4000.0, 0.0, -6e4, 0.0, 0.0, 0.0].repeat(2);
    command(bencher, &law_model(ForceLaw::Choi, &none, &per_a), method);
}

#[divan::bench]
fn with_coil_lag(bencher: Bencher) {
    with_effects(bencher, &[EffectModel::new(Effect::CoilLag, &[0.012]).expect("within range")]);
}

#[divan::bench]
fn with_coil_lag_and_gas_spring(bencher: Bencher) {
    let effects = [(Effect::CoilLag, 0.012), (Effect::GasSpring, 2e3)];
    with_effects(
        bencher,
        &effects.map(|(effect, value)| EffectModel::new(effect, &[value]).expect("within range")),
    );
}
