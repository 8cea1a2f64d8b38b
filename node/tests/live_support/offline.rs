//! A run put through the same pipeline without any ROS.

use mr_damper_model::pipeline::{Event, Pipeline};
use mr_damper_model::sample::Run;
use mr_damper_node::config::Config;
use mr_damper_node::models;

/// What `of` takes of the events when `run` is put through the same pipeline without any ROS.
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
