//! Models and pipelines for timing and instruction counts: models of the thesis, and the whole pipeline.

#![allow(dead_code, reason = "each bench and example is a separate crate and uses only a part")]

use mr_damper_model::effect::{Effect, EffectModel, Effects};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{Models, Pipeline, Settings};
use mr_damper_model::preset;
use mr_damper_model::sample::{Drive, Reading, Sample, Stamp};
use mr_damper_model::units::{Ampere, Metre, Newton};

const RATE_HZ: f64 = 512.0;
/// Number of instants of the motion for the pipeline.
const INSTANTS: u64 = 2048;

/// Models of the thesis that depend on the current.
pub(crate) const PRESETS: [&str; 4] = [
    "thesis/arx-semi-active/rp-icps-l",
    "thesis/fuzzy-tanh/rp3-cs",
    "thesis/sp-semi-active/rp3-cs",
    "thesis/anfis/rp1-cs",
];

/// The pipeline alone, with its supervisor, and with further options.
pub(crate) const PIPELINES: [&str; 5] = [
    "fuzzy-tanh",
    "fuzzy-tanh + arx",
    "fuzzy-tanh with coil lag + arx",
    "fuzzy-tanh with spring in series + arx",
    "fuzzy-tanh + arx + command",
];

/// The pipeline `name`.
pub(crate) fn pipeline(name: &str) -> Pipeline {
    let known = [("coil lag", Effect::CoilLag, 0.01), ("spring in series", Effect::SeriesSpring, 2e-7)];
    let there = known.into_iter().filter(|(words, ..)| name.contains(words));
    let present = |(_, effect, value)| EffectModel::new(effect, &[value]).expect("within range");
    service(&there.map(present).collect::<Vec<_>>(), name.contains("arx"))
}

/// A service that estimates with fuzzy-tanh and `effects`. If `seeded`, it also predicts one step ahead with
/// ARX, as `thesis/fuzzy-tanh` does by default.
pub(crate) fn service(effects: &[EffectModel], seeded: bool) -> Pipeline {
    let effects = Effects::new(effects).expect("few enough");
    let free = Model { effects, ..preset::load(preset::BEST_FUZZY_TANH).expect("a preset") };
    let mut models = Models::alone(free);
    if seeded {
        models = models
            .with_seeded(preset::load(preset::BEST_ARX).expect("a preset"))
            .expect("a model with force as input");
    }
    Pipeline::new(models, Settings::default()).expect("presets run")
}

/// Readings per instant.
pub(crate) fn readings(name: &str) -> usize {
    if name.contains("command") { 4 } else { 3 }
}

/// Input of the pipeline `name` at instant `k`: a road of three sines, a current that rises and falls, and a
/// demanded force that sometimes exceeds the damper's range.
pub(crate) fn instant(name: &str, k: u64) -> impl Iterator<Item = Sample> {
    let t = k as f64 / RATE_HZ;
    let [a, b, c] = [9.0, 31.0, 57.0].map(|omega: f64| omega * t);
    let velocity_m_s = 0.072 * a.cos() + 0.062 * b.cos() + 0.03 * c.cos();
    let displacement_m = 0.008 * a.sin() + 0.002 * b.sin() + 0.03 / 57.0 * c.sin();
    let share = 0.5 + 0.7 * (4.4 * t).sin();
    let demand_n = share * (700.0 * (20.0 * velocity_m_s).tanh() + 1500.0 * velocity_m_s);
    let stamp = Stamp::from_nanos((k as f64 * 1e9 / RATE_HZ) as i64);
    let demand = name.contains("command").then_some(Reading::ForceRequest(Newton(demand_n)));
    let given = [
        Reading::Drive(Drive::CoilCurrent(Ampere(1.2 + (0.006 * k as f64).sin()))),
        Reading::Force(Newton(0.9 * demand_n)),
        Reading::Displacement(Metre(displacement_m)),
    ];
    demand.into_iter().chain(given).map(move |reading| Sample { stamp, received: stamp, reading })
}

/// Four seconds of input.
pub(crate) fn samples(name: &str) -> Vec<Sample> {
    (0..INSTANTS).flat_map(|k| instant(name, k)).collect()
}
