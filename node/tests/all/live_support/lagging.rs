//! A damper whose coil lags, and a model that does not include the lag.

use mr_damper_model::condition::{Conditioning, VelocitySource};
use mr_damper_model::identify::{ModelSpec, Options, Watch, identify};
use mr_damper_model::model::Model;
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::Run;
use std::path::Path;

/// The lag, s.
pub(crate) const LAG_S: f64 = 0.012;

/// A run of a damper whose coil lags by `lag_s`.
pub(crate) fn run(seconds: f64, lag_s: f64, seed: u64) -> Run {
    let experiment = Experiment::thesis("RP-APRBS").expect("a thesis experiment").with_duration_s(seconds);
    let channels = Channels::default().with_fine_displacement();
    record(&experiment, &Plant::quasi_static().with_coil_lag_s(lag_s), &channels, seed)
}

/// A model of the damper without the lag.
pub(crate) fn base() -> Model {
    let options = Options {
        conditioning: Conditioning { velocity: VelocitySource::ThreePoint, ..Conditioning::default() },
        choose_velocity: false,
        restarts: 3,
        ..Options::default()
    };
    identify(ModelSpec::FUZZY_TANH, &[run(20.0, 0.0, 1)], &options, &Watch::none())
        .expect("the rig's damper can be identified")
        .model
}

/// Writes a model file.
pub(crate) fn write(path: &Path, model: Model) {
    let file = ModelFile { model, provenance: Provenance::default() };
    std::fs::write(path, file.to_toml().expect("writable")).expect("written");
}
