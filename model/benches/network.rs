//! Time a step of the models that learn from data, running free.
//!
//! ```text
//! cargo bench -p mr-damper-model --bench network
//! ```

use divan::Bencher;
use mr_damper_model::force::{
    ForceModel, FreeRun, Inputs, Lazy, LazyMetric, LazyPoint, MAX_POINTS, Network, NetworkScaling,
    NetworkStructure, Normalisation,
};
use mr_damper_model::sample::DriveKind;
use mr_damper_model::units::Second;

fn main() {
    divan::main();
}

const STEPS: usize = 1000;

fn inputs() -> Vec<Inputs> {
    let at = |k: usize| {
        let t = k as f64 / 512.0;
        Inputs {
            dt_s: (k > 0).then_some(1.0 / 512.0),
            displacement_m: 0.01 * (20.0 * t).sin(),
            velocity_m_s: 0.2 * (20.0 * t).cos(),
            acceleration_m_s2: -4.0 * (20.0 * t).sin(),
            drive: 1.0 + (7.0 * t).sin(),
            case_temp_c: f64::NAN,
        }
    };
    (0..STEPS).map(at).collect()
}

/// Runs the model over a thousand samples; the figure is a thousand steps.
fn run(bencher: Bencher, force: ForceModel) {
    let inputs = inputs();
    bencher.counter(divan::counter::ItemsCount::new(STEPS)).bench_local(|| {
        let mut state = FreeRun::default();
        inputs.iter().filter_map(|inputs| force.free_run(&mut state, inputs)).sum::<f64>()
    });
}

fn network(structure: NetworkStructure, driven: bool) -> ForceModel {
    let weights: Vec<f64> =
        (0..structure.weights(driven)).map(|k| 0.2 * (k as f64 * 12.9898).sin()).collect();
    let scaling = NetworkScaling {
        displacement_m: Normalisation { mean: 0.0, deviation: 0.006 },
        velocity_m_s: Normalisation { mean: 0.0, deviation: 0.1 },
        drive: driven.then_some((DriveKind::CoilCurrent, Normalisation { mean: 1.0, deviation: 0.7 })),
        force_deviation_n: 500.0,
    };
    let network = Network::new(structure, scaling, &weights, Second(1.0 / 512.0), 0.0);
    ForceModel::Network(network.expect("finite weights"))
}

#[divan::bench(args = [NetworkStructure::WangLiao, NetworkStructure::Chen])]
fn passive(bencher: Bencher, structure: NetworkStructure) {
    run(bencher, network(structure, false));
}

#[divan::bench(args = [NetworkStructure::WangLiao, NetworkStructure::Chen])]
fn semi_active(bencher: Bencher, structure: NetworkStructure) {
    run(bencher, network(structure, true));
}

#[divan::bench(args = [8, 12, 16])]
fn boada(bencher: Bencher, neighbours: usize) {
    let point = |k: usize| {
        let k = k as f64;
        LazyPoint {
            displacement_m: 0.01 * (k * 12.9898).sin(),
            velocity_m_s: 0.2 * (k * 78.233).sin(),
            drive: 1.0 + (k * 37.719).sin(),
            force_n: 400.0 * (k * 78.233).sin(),
        }
    };
    let points: Vec<LazyPoint> = (0..MAX_POINTS).map(point).collect();
    let metric = LazyMetric {
        displacement_scale_m: 0.01,
        velocity_scale_m_s: 0.1,
        drive_scale: Some((DriveKind::CoilCurrent, 0.7)),
    };
    let lazy = Lazy::new(metric, [8, neighbours], &points, 0.0).expect("finite points");
    run(bencher, ForceModel::Lazy(lazy));
}
