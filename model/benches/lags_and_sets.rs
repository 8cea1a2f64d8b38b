//! Time a step of the models that are linear in lags (arx, savaresi, lpv) and of fuzzy-tanh, running free, and of the
//! relation p, which holds at one instant.
//!
//! ```text
//! cargo bench -p mr-damper-model --bench lags_and_sets
//! ```

#[path = "../tests/identify_support/peers.rs"]
mod peers;

use divan::{Bencher, black_box};
use mr_damper_model::force::{ForceModel, ForceMotion, FreeRun, Inputs};
use mr_damper_model::identify::{Dataset, Form, ModelSpec, Options, Watch, identify_datasets};
use mr_damper_model::preset;

fn main() {
    divan::main();
}

/// Runs the model over the rows of the peers' problem.
fn run(bencher: Bencher, force: ForceModel) {
    let inputs: Vec<Inputs> = peers::synth(1).rows.iter().map(|row| row.inputs()).collect();
    bencher.counter(divan::counter::ItemsCount::new(inputs.len())).bench_local(|| {
        let mut state = FreeRun::default();
        inputs.iter().filter_map(|inputs| force.free_run(&mut state, black_box(inputs))).sum::<f64>()
    });
}

fn preset(name: &str) -> ForceModel {
    preset::load(name).expect("a preset").force
}

#[divan::bench(args = ["thesis/arx-passive/rp-icps", "thesis/arx-semi-active/rp-icps"])]
fn arx(bencher: Bencher, name: &str) {
    run(bencher, preset(name));
}

fn fitted(name: &str, form: Form) -> ForceModel {
    let data: [Dataset; 1] = [peers::synth(0)];
    let spec = ModelSpec::named(name, form).expect("a model");
    identify_datasets(spec, &data, &Options::default(), &Watch::none()).expect("a fit").model.force
}

#[divan::bench]
fn savaresi(bencher: Bencher) {
    run(bencher, fitted("savaresi", Form::SemiActive));
}

#[divan::bench]
fn lpv_quadratic(bencher: Bencher) {
    run(bencher, fitted("lpv", Form::SemiActive));
}

#[divan::bench]
fn lpv_seven_sets(bencher: Bencher) {
    run(bencher, fitted("lpv", Form::Fuzzy));
}

#[divan::bench]
fn fuzzy_tanh(bencher: Bencher) {
    run(bencher, preset("thesis/fuzzy-tanh/rp3-cs"));
}

/// One instant of the phase-transition relation.
#[divan::bench(sample_count = 200, sample_size = 200)]
fn p(bencher: Bencher) {
    let phase = preset::phase("thesis/p-semi-active/rp-icps").expect("a preset");
    let row = peers::synth(1).rows[700];
    let force = ForceMotion { force_n: row.force_n, rate_n_s: 3e4, curvature_n_s2: -2e6 };
    bencher.bench(|| black_box(&phase).same_instant_n(black_box(row.velocity_m_s), &force, row.drive));
}

/// A fit of twelve coefficients on 15360 rows.
#[divan::bench]
fn fit_arx(bencher: Bencher) {
    let data = [peers::synth(0)];
    let options = Options::default();
    bencher.bench(|| identify_datasets(ModelSpec::ARX_SEMI_ACTIVE, &data, &options, &Watch::none()));
}
