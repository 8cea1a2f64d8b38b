//! Runs the same pipeline offline, without ROS.

use mr_damper_model::pipeline::{Event, Pipeline};
use mr_damper_model::sample::Run;
use mr_damper_node::estimation::models;
use mr_damper_node::settings::config::Config;

/// Steps `run` through the same pipeline without ROS, and collects what `of` takes from its events.
pub(crate) fn offline<T>(config: &Config, run: &Run, of: impl Fn(Event) -> Option<T>) -> Vec<T> {
    let (models, _) = models::from_config(config).expect("it loads");
    let settings = config.pipeline_settings(models.free.conditioning.cutoff_hz);
    let mut pipeline = Pipeline::new(models, settings).expect("it runs");
    let mut taken = Vec::new();
    for sample in run.samples() {
        pipeline.step(&sample, &mut |event| taken.extend(of(event)));
    }
    taken
}
