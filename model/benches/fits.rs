//! TSK models: time of one step, and of an identification on the same problem as the Python peers
//! (anfis-toolbox: 122 s for 27 rules, 15360 samples, 50 epochs).
//!
//! ```text
//! cargo bench -p mr-damper-model --bench fits
//! ```

#[path = "../tests/all/identify_support/peers.rs"]
mod peers;

use divan::{Bencher, black_box};
use mr_damper_model::force::{ForceModel, TskKind};
use mr_damper_model::identify::{Learning, TskOptions, Watch, fit_tsk};
use mr_damper_model::preset;
use mr_damper_model::sample::DriveKind;

fn main() {
    divan::main();
}

const DRIVE: Option<DriveKind> = Some(DriveKind::CoilCurrent);

/// One force of the thesis' best ANFIS model: 27 rules.
#[divan::bench(sample_count = 200, sample_size = 200)]
fn step_anfis(bencher: Bencher) {
    let ForceModel::Tsk(model) = preset::load(preset::BEST_ANFIS).expect("a preset").force else {
        panic!("not an ANFIS model")
    };
    let inputs = peers::synth(1).rows[700].inputs();
    bencher.bench(|| black_box(&model).force_n(black_box(&inputs)));
}

/// One force of 125 rules with triangles.
#[divan::bench(sample_count = 200, sample_size = 200)]
fn step_tsk_555(bencher: Bencher) {
    let data = [peers::synth(0)];
    let options = TskOptions { epochs: 1, ..TskOptions::default() };
    let found = fit_tsk(&data, TskKind::Ahn, DRIVE, &options, &Watch::none()).expect("a fit");
    let inputs = data[0].rows[700].inputs();
    bencher.bench(|| black_box(&found.model).force_n(black_box(&inputs)));
}

/// Identification on the peers' problem, at most 50 epochs.
#[divan::bench(args = TskKind::ALL, sample_count = 5, sample_size = 1)]
fn fit(bencher: Bencher, kind: TskKind) {
    let data = [peers::synth(0)];
    bencher.bench(|| fit_tsk(&data, kind, DRIVE, &TskOptions::default(), &Watch::none()));
}

/// The same identification with Jang's rule, which runs all 50 epochs as the peer does.
#[divan::bench(sample_count = 5, sample_size = 1)]
fn fit_anfis_by_gradient(bencher: Bencher) {
    let data = [peers::synth(0)];
    let options = TskOptions { learning: Learning::Gradient, ..TskOptions::default() };
    bencher.bench(|| fit_tsk(&data, TskKind::Anfis, DRIVE, &options, &Watch::none()));
}
