//! Cost of the uncertainty band: the table alone, and a sample through the pipeline with and without the
//! table.
//!
//! ```text
//! cargo bench -p mr-damper-model --bench uncertainty
//! ```

#[path = "../tests/all/common/mod.rs"]
mod common;

use common::{calibrated, preset, samples};
use divan::{Bencher, black_box};
use mr_damper_model::pipeline::{Models, Pipeline, Settings};
use mr_damper_model::preset::BEST_ARX;
use mr_damper_model::uncertainty::{Operating, Predictor};

fn main() {
    divan::main();
}

#[divan::bench(args = [0.001, 0.06], sample_count = 300, sample_size = 1000)]
fn spread(bencher: Bencher, seconds: f64) {
    let table = calibrated(preset(BEST_ARX)).expected.uncertainty.expect("given");
    let at = Operating {
        predictor: Predictor::OneStep,
        velocity_m_s: 0.12,
        drive: 1.1,
        coast_s: seconds,
        drive_age_s: seconds,
    };
    bencher.bench(|| black_box(&table).spread(black_box(&at)));
}

/// Drive, force and displacement samples of two seconds.
#[divan::bench(args = [false, true], sample_count = 100, sample_size = 1)]
fn a_thousand_samples(bencher: Bencher, with: bool) {
    let model = preset(BEST_ARX);
    let model = if with { calibrated(model) } else { model };
    let fed: Vec<_> = (0..1000).flat_map(|k| samples(k, 0)).collect();
    let pipeline = Pipeline::new(Models::alone(model), Settings::default()).expect("a preset runs");
    bencher.with_inputs(|| pipeline.clone()).bench_values(|mut pipeline| {
        for sample in &fed {
            pipeline.step(sample, &mut |event| {
                black_box(&event);
            });
        }
        pipeline
    });
}
