//! Discovery of terms on measured runs.

use crate::discovery::{close_from_linear, constant};
use crate::measured::folder;
use mr_damper_model::diagnose::{EffectSet, Settings};
use mr_damper_model::effect::term::Modulator;
use mr_damper_model::sample::{Run, Stamp, Trace};

/// The part of `run` from one time to another, s.
fn part(run: &Run, from_s: f64, to_s: f64) -> Run {
    let [from, to] = [from_s, to_s].map(|time_s| Stamp::from_seconds(time_s).expect("a time"));
    let part = |trace: &Trace| {
        let inside = |stamp: &Stamp| (from..to).contains(stamp);
        let (stamps, values) =
            trace.stamps.iter().zip(&trace.values).filter(|(stamp, _)| inside(stamp)).unzip();
        Trace { stamps, values }
    };
    Run {
        displacement_m: part(&run.displacement_m),
        force_n: run.force_n.as_ref().map(part),
        ..Run::default()
    }
}

/// The axis has a moving mass of 95.1 kg and a Coulomb friction of 20.4 N, as the authors of the benchmark EMPS identified them (A. Janot,
/// M. Gautier, M. Brunot, 2019).
#[test]
#[ignore = "needs the measured runs (MR_DAMPER_DATA)"]
fn mass_and_friction_of_a_positioning_axis_are_found_without_the_library() {
    let [run] = &folder("emps")[..] else { panic!("one run") };
    let [estimate, confirm, test] =
        [[0.0, 12.5], [12.5, 16.5], [16.5, 30.0]].map(|[from_s, to_s]| [part(run, from_s, to_s)]);
    let settings = Settings { effects: EffectSet::NONE, block_s: Some(1.0), ..Settings::default() };
    let found = close_from_linear([&estimate, &confirm, &test], &settings);
    let (mass_kg, friction_n) =
        (constant(&found, Modulator::Acceleration), constant(&found, Modulator::SignVelocity));
    assert!((mass_kg / 95.1 - 1.0).abs() < 0.02, "{mass_kg}");
    assert!((friction_n / 20.4 - 1.0).abs() < 0.05, "{friction_n}");
}
