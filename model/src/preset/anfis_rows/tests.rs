use super::super::{BEST_ANFIS, EXPERIMENTS, fuzzy_rows, load};
use super::*;
use crate::force::{ForceModel, Inputs};

fn anfis(name: &str) -> Tsk {
    match load(name).expect("a preset").force {
        ForceModel::Tsk(model) => model,
        other => panic!("{} is not an ANFIS model", other.name()),
    }
}

fn all() -> impl Iterator<Item = (&'static str, Tsk)> {
    EXPERIMENTS.into_iter().map(|name| (name, anfis(&format!("thesis/anfis/{name}"))))
}

fn force_n(model: &Tsk, x: f64, v: f64, i: f64) -> f64 {
    model.force_n(&Inputs {
        dt_s: None,
        displacement_m: x,
        velocity_m_s: v,
        acceleration_m_s2: f64::NAN,
        drive: i,
        case_temp_c: f64::NAN,
    })
}

#[test]
fn all_eight_have_27_rules_and_126_numbers() {
    assert_eq!(all().count(), 8);
    for (name, model) in all() {
        assert_eq!((model.rules(), model.parameter_count()), (27, 126), "{name}");
        assert_eq!(model.drive(), Some(DriveKind::CoilCurrent));
    }
    assert_eq!(anfis(BEST_ANFIS).rules(), 27);
}

#[test]
fn force_grows_with_velocity_and_current() {
    for (name, model) in all() {
        for i in [0.8, 1.2, 1.6] {
            assert!(force_n(&model, 0.0, 0.0, i).abs() < 40.0, "{name}: no force at rest");
            let along: Vec<f64> = (-10..=10).map(|k| force_n(&model, 0.0, f64::from(k) * 0.01, i)).collect();
            assert!(along.is_sorted(), "{name} {i} A: force grows with velocity: {along:?}");
        }
        for v in [-0.1, -0.05, 0.05, 0.1] {
            let up: Vec<f64> = [0.4, 0.8, 1.2, 1.6].map(|i| force_n(&model, 0.0, v, i).abs()).to_vec();
            assert!(up.is_sorted(), "{name} {v} m/s: force grows with current: {up:?}");
        }
    }
}

#[test]
fn scales_agree_with_the_fuzzy_tanh_models_of_the_same_data() {
    // The two were identified independently, so a wrong scale of force, velocity or current would show here.
    for name in &EXPERIMENTS[5..] {
        let (anfis, tanh) =
            (anfis(&format!("thesis/anfis/{name}")), fuzzy_rows::model(name).expect("a model"));
        for i in [0.8, 1.6, 2.5] {
            for v in [-0.15, -0.1, -0.05, 0.05, 0.1, 0.15] {
                let (a, t) = (force_n(&anfis, 0.0, v, i), tanh.force_n(0.0, v, i));
                assert!((a - t).abs() < 0.15 * t.abs() + 30.0, "{name} {v} m/s {i} A: {a} N and {t} N");
            }
        }
    }
}

#[test]
fn values_match_the_printed_numbers() {
    // Computed from the tables by a plain sum over the rules, in another language.
    for (name, x, v, i, expected) in VALUES {
        let found = force_n(&anfis(&format!("thesis/anfis/{name}")), x, v, i);
        assert!((found - expected).abs() < 1e-9 * expected.abs(), "{name}: {found} {expected}");
    }
}

/// Experiment, displacement m, velocity m/s, current A, force N.
const VALUES: [(&str, f64, f64, f64, f64); 3] = [
    ("rp1-cs", 0.004, -0.08, 1.1, -544.907_132_185_091_2),
    ("rp-icps", -0.003, 0.12, 2.0, 955.525_384_432_792_3),
    ("rp-aprbs", 0.001, 0.03, 1.4, 246.157_752_416_929),
];
