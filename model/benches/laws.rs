//! Time per sample of each force law: without drive, with polynomials over the current, with fuzzy sets, and
//! with its derivatives.
//!
//! ```text
//! cargo bench -p mr-damper-model --bench laws
//! ```

mod middle;
mod motion;

use divan::Bencher;
use divan::counter::ItemsCount;
use middle::parameters;
use motion::{SAMPLES, motion};
use mr_damper_model::force::law::Hidden;
use mr_damper_model::force::{Dependence, ForceLaw, FuzzySets, LawModel, LawState, Membership};
use mr_damper_model::sample::DriveKind;

const DRIVE: DriveKind = DriveKind::CoilCurrent;

fn main() {
    divan::main();
}

fn run(bencher: Bencher, law: ForceLaw, dependence: Dependence) {
    let copies = match dependence {
        Dependence::Fuzzy(_) => parameters(law).repeat(dependence.copies()),
        _ => {
            let mut powers = parameters(law);
            powers.resize(law.parameters().len() * dependence.copies(), 0.0);
            powers
        }
    };
    let model = LawModel::new(law, dependence, &copies, 0.0).expect("the right number of parameters");
    let motion = motion();
    bencher.counter(ItemsCount::new(SAMPLES)).bench(|| {
        let mut state = LawState::default();
        motion.iter().map(|inputs| model.force_n(divan::black_box(inputs), &mut state)).sum::<f64>()
    });
}

#[divan::bench(args = ForceLaw::ALL)]
fn passive(bencher: Bencher, law: ForceLaw) {
    run(bencher, law, Dependence::None);
}

#[divan::bench(args = ForceLaw::ALL)]
fn quadratic(bencher: Bencher, law: ForceLaw) {
    run(bencher, law, Dependence::Polynomial { drive: DRIVE, degree: 2 });
}

#[divan::bench(args = ForceLaw::ALL)]
fn seven_sets(bencher: Bencher, law: ForceLaw) {
    let centres = [0.0, 0.4, 0.8, 1.2, 1.6, 2.1, 2.5];
    let sets = FuzzySets::new(Membership { drive: DRIVE, sigma: 0.2 }, &centres).expect("centres increase");
    run(bencher, law, Dependence::Fuzzy(sets));
}

#[divan::bench(args = ForceLaw::ALL)]
fn with_derivatives(bencher: Bencher, law: ForceLaw) {
    let (p, motion) = (parameters(law), motion());
    bencher.counter(ItemsCount::new(SAMPLES)).bench(|| {
        let mut hidden = Hidden::default();
        let step = |inputs| law.sensitivity(&p, divan::black_box(inputs), &mut hidden).force_by_parameter[0];
        motion.iter().map(step).sum::<f64>()
    });
}
