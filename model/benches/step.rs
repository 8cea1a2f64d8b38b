//! Time per sample: for the simulation of each model, and for everything that the estimating thread does with
//! a sample of displacement, current and force.
//!
//! ```text
//! cargo bench -p mr-damper-model --bench step                # nanoseconds on this machine
//! model/examples/step_cost.sh                                # instructions, independent of the machine
//! ```

#[path = "../tests/all/identify_support/peers.rs"]
mod peers;
mod subject;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use mr_damper_model::force::{ForceModel, ForceMotion, FreeRun, Inputs};
use mr_damper_model::identify::{Form, ModelSpec, Options, Structure, Watch, identify_datasets};
use mr_damper_model::preset;
use subject::{PIPELINES, PRESETS};

fn main() {
    divan::main();
}

/// Simulates the model over the rows of the peers' problem.
fn run(bencher: Bencher, force: ForceModel) {
    let inputs: Vec<Inputs> = peers::synth(1).rows.iter().map(|row| row.inputs()).collect();
    bencher.counter(ItemsCount::new(inputs.len())).bench_local(|| {
        let mut state = FreeRun::default();
        inputs.iter().filter_map(|inputs| force.free_run(&mut state, black_box(inputs))).sum::<f64>()
    });
}

/// Models of the thesis.
#[divan::bench(args = PRESETS)]
fn thesis(bencher: Bencher, name: &str) {
    run(bencher, preset::load(name).expect("a preset").force);
}

/// Every structure that can be identified with the current as drive, fitted to four seconds; with fuzzy sets
/// if that form exists.
#[divan::bench(args = Structure::all().into_iter().map(|structure| structure.name()).filter(|name| *name != "p"))]
fn identified(bencher: Bencher, name: &str) {
    let mut whole = peers::synth(0);
    whole.rows.truncate(2048);
    let data = [whole];
    let fit = |form| {
        let spec = ModelSpec::named(name, form)?;
        identify_datasets(spec, &data, &Options::default(), &Watch::none())
    };
    let identified = fit(Form::Fuzzy).or_else(|_| fit(Form::SemiActive)).expect("a fit");
    run(bencher, identified.model.force);
}

/// One instant of the phase-transition relation.
#[divan::bench(sample_count = 200, sample_size = 200)]
fn p(bencher: Bencher) {
    let phase = preset::phase("thesis/p-semi-active/rp-icps").expect("a preset");
    let row = peers::synth(1).rows[700];
    let force = ForceMotion { force_n: row.force_n, rate_n_s: 3e4, curvature_n_s2: -2e6 };
    bencher.bench(|| black_box(&phase).same_instant_n(black_box(row.velocity_m_s), &force, row.drive));
}

/// Conditioning, gates, the model, a supervisor that seeds an ARX model, residual and uncertainty.
#[divan::bench(args = PIPELINES)]
fn pipeline(bencher: Bencher, name: &str) {
    let (pipeline, seconds) = (subject::pipeline(name), subject::samples(name));
    let instants = seconds.len() / subject::readings(name);
    bencher.counter(ItemsCount::new(instants)).with_inputs(|| pipeline.clone()).bench_refs(|pipeline| {
        let mut events = 0_u32;
        for sample in &seconds {
            pipeline.step(black_box(sample), &mut |event| {
                black_box(event);
                events += 1;
            });
        }
        events
    });
}
