//! Tests of every law: derivatives, dependence on the drive, parameter names.

use super::*;
use crate::force::{FuzzySets, Membership};
use crate::sample::DriveKind;
use num_dual::Dual64;
use proptest::prelude::*;

impl Scalar for Dual64 {}

/// Realistic values of all parameters for a damper of 1 kN, 20 mm, 0.3 m/s and 5 m/s².
fn sensible(law: ForceLaw, share: &[f64]) -> Vec<f64> {
    let size = |s: Scale| {
        1000f64.powi(s.force)
            * 0.02f64.powi(s.displacement)
            * 0.3f64.powi(s.velocity)
            * 5f64.powi(s.acceleration)
    };
    let value = |(parameter, share): (&Parameter, &f64)| {
        let [low, high] = parameter.start;
        size(parameter.scale) * (low + (high - low) * share)
    };
    law.parameters().iter().zip(share).map(value).collect()
}

proptest! {
    #[test]
    fn derivatives_agree_with_automatic_differentiation(
        law in prop::sample::select(ForceLaw::ALL.to_vec()),
        share in prop::collection::vec(0.05..0.95, MAX_PARAMETERS),
        x in -0.02..0.02, v in -0.3..0.3, a in -5.0..5.0,
    ) {
        prop_assume!(!law.has_memory());
        let p = sensible(law, &share);
        let inputs = Inputs { dt_s: Some(0.002), displacement_m: x, velocity_m_s: v, acceleration_m_s2: a, drive: 0.0, case_temp_c: f64::NAN };
        let mut gradient = [0.0; MAX_PARAMETERS];
        let force = law.gradient(&p, &inputs, &mut gradient);
        let plain = law.force_n(&p, &inputs, &mut Hidden::default());
        prop_assert!((force - plain).abs() <= 1e-12 * (1.0 + plain.abs()), "{} against {}", force, plain);
        for j in 0..p.len() {
            let dual: Vec<Dual64> = p
                .iter()
                .enumerate()
                .map(|(k, value)| if k == j { Dual64::from_re(*value).derivative() } else { Dual64::from_re(*value) })
                .collect();
            let exact = law.on_duals(&dual, &inputs).expect("a law without memory");
            prop_assert!((exact.re - plain).abs() <= 1e-12 * (1.0 + plain.abs()));
            let error = (gradient[j] - exact.eps).abs();
            prop_assert!(
                error <= 1e-9 * (exact.eps.abs() + plain.abs() / p[j].abs().max(1e-12)),
                "{}, {}: {} against {}", law.name(), law.parameters()[j].name, gradient[j], exact.eps
            );
        }
    }

    #[test]
    fn a_model_whose_copies_are_equal_is_the_law_itself(
        law in prop::sample::select(ForceLaw::ALL.to_vec()),
        share in prop::collection::vec(0.05..0.95, MAX_PARAMETERS),
        x in -0.02..0.02, v in -0.3..0.3, i in -1.0..4.0,
    ) {
        let p = sensible(law, &share);
        let inputs = Inputs { dt_s: Some(0.002), displacement_m: x, velocity_m_s: v, acceleration_m_s2: 1.0, drive: i, case_temp_c: f64::NAN };
        let alone = LawModel::new(law, Dependence::None, &p, 3.0).expect("a model");
        let force = alone.force_n(&inputs, &mut LawState::default());
        let mut powers = p.clone();
        powers.resize(3 * p.len(), 0.0);
        let drive = DriveKind::CoilCurrent;
        let polynomial = LawModel::new(law, Dependence::Polynomial { drive, degree: 2 }, &powers, 3.0).expect("a model");
        prop_assert_eq!(polynomial.force_n(&inputs, &mut LawState::default()), force);
        let sets = FuzzySets::new(Membership { drive, sigma: 0.4 }, &[0.0, 1.0, 2.0]).expect("sets");
        let fuzzy = LawModel::new(law, Dependence::Fuzzy(sets), &p.repeat(3), 3.0).expect("a model");
        let blended = fuzzy.force_n(&inputs, &mut LawState::default());
        prop_assert!((blended - force).abs() <= 1e-12 * (1.0 + force.abs()), "{} against {}", blended, force);
    }
}

#[test]
fn names_are_unique_and_carry_units() {
    for law in ForceLaw::ALL {
        let mut names: Vec<&str> = law.parameters().iter().map(|p| p.name).collect();
        assert!(names.len() <= MAX_PARAMETERS);
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), law.parameters().len(), "{}", law.name());
    }
}

#[test]
fn a_polynomial_dependence_follows_its_equation() {
    // yield_force = 100 + 50 i - 4 i^2, all else constant.
    let constants = [100.0, 0.0, 50.0, -0.1, 0.02];
    let first = [50.0, 0.0, 0.0, 0.0, 0.0];
    let second = [-4.0, 0.0, 0.0, 0.0, 0.0];
    let dependence = Dependence::Polynomial { drive: DriveKind::CoilCurrent, degree: 2 };
    let model =
        LawModel::new(ForceLaw::Sp, dependence, &[constants, first, second].concat(), 0.0).expect("a model");
    let at = |drive| {
        let inputs = Inputs {
            dt_s: None,
            displacement_m: 0.0,
            velocity_m_s: 10.0,
            acceleration_m_s2: f64::NAN,
            drive,
            case_temp_c: f64::NAN,
        };
        model.force_n(&inputs, &mut LawState::default())
    };
    for i in [0.0, 1.0, 2.5] {
        assert!((at(i) - (100.0 + 50.0 * i - 4.0 * i * i)).abs() < 1e-9);
    }
}

#[test]
fn wrong_numbers_are_named() {
    let error = |dependence, coefficients: &[f64]| {
        LawModel::new(ForceLaw::Sp, dependence, coefficients, 0.0).expect_err("refused").to_string()
    };
    assert!(error(Dependence::None, &[1.0; 4]).contains("5 parameters times 1"));
    let mut p = [1.0; 10];
    p[7] = f64::NAN;
    let linear = Dependence::Polynomial { drive: DriveKind::CoilCurrent, degree: 1 };
    assert!(error(linear, &p).contains("pre_yield_slope_s_m[1] is NaN"));
    let ninth = Dependence::Polynomial { drive: DriveKind::CoilCurrent, degree: 9 };
    assert!(error(ninth, &[1.0; 50]).contains("degree is 9"));
}

#[test]
fn without_acceleration_laws_that_need_it_have_no_force() {
    for law in ForceLaw::ALL {
        let p = sensible(law, &[0.5; MAX_PARAMETERS]);
        let inputs = |acceleration_m_s2| Inputs {
            dt_s: None,
            displacement_m: 0.003,
            velocity_m_s: 0.1,
            acceleration_m_s2,
            drive: 0.0,
            case_temp_c: f64::NAN,
        };
        let needs = matches!(law, ForceLaw::Li | ForceLaw::CesmeciEngin | ForceLaw::Choi);
        let force = law.force_n(&p, &inputs(f64::NAN), &mut Hidden::default());
        assert_eq!(force.is_nan(), needs, "{}", law.name());
        let mut gradient = [0.0; MAX_PARAMETERS];
        assert_eq!(law.gradient(&p, &inputs(f64::NAN), &mut gradient).is_nan(), needs, "{}", law.name());
        // An acceleration of exactly zero is on the rising branch.
        let at = |a| law.force_n(&p, &inputs(a), &mut Hidden::default());
        assert_eq!(at(0.0), at(f64::MIN_POSITIVE), "{}", law.name());
    }
}

#[test]
fn a_law_without_memory_has_nothing_hidden() {
    let inputs = Inputs {
        dt_s: Some(0.002),
        displacement_m: 0.003,
        velocity_m_s: 0.1,
        acceleration_m_s2: 1.0,
        drive: 0.0,
        case_temp_c: f64::NAN,
    };
    for law in ForceLaw::ALL.into_iter().filter(|law| !law.has_memory()) {
        let p = sensible(law, &[0.3; MAX_PARAMETERS]);
        let (mut hidden, mut gradient) = (Hidden::default(), [0.0; MAX_PARAMETERS]);
        let found = law.sensitivity(&p, &inputs, &mut hidden);
        let force_n = law.gradient(&p, &inputs, &mut gradient);
        assert_eq!(found, Sensitivity { force_n, force_by_parameter: gradient, ..Sensitivity::default() });
        assert_eq!(hidden, Hidden::default());
    }
}
