use super::*;
use crate::condition::Conditioning;
use crate::force::{Dependence, ForceLaw, ForceModel, LawModel};
use crate::identify::DatasetOptions;
use crate::sample::{Run, Trace};

/// Peak speed of the run, m/s, and its half stroke, m.
const SPEED_M_S: f64 = 0.2;
const STROKE_M: f64 = 0.02;

/// A sine of 20 s at 500 Hz whose drive steps through `levels`, with a force of 800 N either way.
fn dataset(levels: &[f64]) -> Vec<Dataset> {
    let trace = |f: &dyn Fn(f64) -> f64| Trace {
        stamps: (0..10_000).map(|k| Stamp::from_nanos(k * 2_000_000)).collect(),
        values: (0..10_000).map(|k| f(f64::from(k) * 2e-3)).collect(),
    };
    let omega = SPEED_M_S / STROKE_M;
    let run = Run {
        name: "made".to_owned(),
        displacement_m: trace(&|t| STROKE_M * (omega * t).sin()),
        drive: Some((DriveKind::CoilCurrent, trace(&|t| levels[t as usize % levels.len()]))),
        force_n: Some(trace(&|t| 800.0 * (omega * t).cos())),
        ..Run::default()
    };
    vec![Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default()).expect("a run")]
}

/// A law whose coefficients are polynomials of the current.
fn swept(law: ForceLaw, degree: usize, coefficients: &[f64], levels: &[f64]) -> SweptRange {
    let dependence = Dependence::Polynomial { drive: DriveKind::CoilCurrent, degree };
    let model = LawModel::new(law, dependence, coefficients, 30.0).expect("a model");
    sweep(&Augmented::from(ForceModel::Law(model)), &dataset(levels)).expect("the run moves")
}

/// S-P with this force step and damping, as polynomials of degree 2.
fn step_and_damping(step_n: [f64; 3], damping_n_s_m: [f64; 3], levels: &[f64]) -> SweptRange {
    let of_power = |d: usize| {
        let [slope, stroke] = if d == 0 { [50.0, 1.0] } else { [0.0, 0.0] };
        [step_n[d], damping_n_s_m[d], slope, 0.0, stroke]
    };
    swept(ForceLaw::Sp, 2, &[of_power(0), of_power(1), of_power(2)].concat(), levels)
}

fn kinds(swept: &SweptRange) -> Vec<&'static str> {
    swept.faults.iter().map(|fault| fault.kind.name()).collect()
}

#[test]
fn a_viscous_damper_takes_the_energy_that_theory_says() {
    // f = c v: E = pi c v X in a cycle
    let damping_n_s_m = 3000.0;
    let swept = step_and_damping([0.0; 3], [damping_n_s_m, 0.0, 0.0], &[0.0, 1.0]);
    assert_eq!((swept.sines.len(), kinds(&swept), swept.grows), (20, vec![], false));
    for (k, sine) in swept.sines.iter().enumerate() {
        let share = SPEEDS[k % 4];
        let expected = std::f64::consts::PI * damping_n_s_m * SPEED_M_S * share * STROKE_M * share.min(1.0);
        let SweptResponse { largest, energy_j } = sine.response.expect("finite");
        // The conditioned run is an interpolation of the true sine.
        assert!((energy_j / expected - 1.0).abs() < 0.01, "{sine}: {energy_j} J, {expected} J");
        assert!((largest.0 / (damping_n_s_m * sine.speed.0) - 1.0).abs() < 1e-3, "{sine}: {largest:?}");
    }
    let drives: Vec<f64> =
        swept.sines.iter().step_by(4).map(|sine| sine.drive.expect("a drive").get()).collect();
    assert_eq!(drives, [0.0, 0.25, 0.5, 0.75, 1.0]);
}

#[test]
fn the_runs_time_counts_near_the_drive_and_at_the_speed_only() {
    let swept = step_and_damping([100.0, 500.0, 0.0], [500.0, 0.0, 0.0], &[1.0]);
    let time_s = |k: usize| swept.sines[k].runs_s;
    assert_eq!([0, 4, 8, 12].map(time_s), [0.0; 4], "the runs hold 1 A alone");
    assert!(time_s(16) > time_s(17) && time_s(17) > time_s(18) && time_s(18) > 5.0 && time_s(19) == 0.0);
}

#[test]
fn faults_are_named_where_they_are() {
    let all = [0.0, 0.25, 0.5, 0.75, 1.0];
    let negative = step_and_damping([100.0, 400.0, 0.0], [-2000.0, 4000.0, 0.0], &all);
    assert!(negative.grows);
    let drives: Vec<f64> =
        negative.faults.iter().filter_map(|fault| fault.sine.drive).map(Drive::get).collect();
    assert!(kinds(&negative).iter().all(|kind| *kind == "drives_motion") && !drives.is_empty());
    assert!(drives.iter().all(|drive| *drive < 0.5), "{drives:?}");
    let text = negative.faults[0].to_string();
    assert!(text.starts_with("on a sine at 0.00 A with a peak speed of "), "{text}");

    let strong = step_and_damping([100.0, 400.0, 0.0], [20_000.0, 0.0, 0.0], &all);
    assert!(kinds(&strong).contains(&"too_large"), "{strong}");

    let lost = swept(ForceLaw::Linear, 1, &[1e6, 0.0, 0.0, 0.0], &all);
    assert!(kinds(&lost).contains(&"diverges") && lost.sines.last().expect("20").response.is_none());
}

#[test]
fn a_force_that_falls_with_the_drive_is_a_fault_only_of_a_damper_whose_force_grows() {
    // 500 N at 0 A and 1 A, 300 N at .5 A
    let valley = ([500.0, -800.0, 800.0], [100.0, 0.0, 0.0]);
    let upper = step_and_damping(valley.0, valley.1, &[0.5, 0.75, 1.0]);
    let falls = |swept: &SweptRange| kinds(swept).iter().filter(|kind| **kind == "falls_with_drive").count();
    assert!(upper.grows && falls(&upper) > 0, "{upper}");
    // The level that the runs do not show is the one to add.
    assert!(upper.faults.iter().all(|fault| fault.sine.drive.is_some_and(|drive| drive.get() < 0.3)));
    let lower = step_and_damping(valley.0, valley.1, &[0.0, 0.25, 0.5]);
    assert!(!lower.grows && falls(&lower) == 0, "{lower}");
}

#[test]
fn noise_around_zero_is_no_negative_drive() {
    let swept = step_and_damping([100.0, 500.0, 0.0], [500.0, 0.0, 0.0], &[-0.01, 1.0]);
    assert_eq!(swept.sines[0].drive.map(Drive::get), Some(0.0));
    let both = step_and_damping([500.0, 0.0, 0.0], [500.0, 0.0, 0.0], &[-1.0, 1.0]);
    assert_eq!(both.sines[0].drive.map(Drive::get), Some(-1.0));
}
