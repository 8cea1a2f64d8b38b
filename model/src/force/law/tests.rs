//! Tests of every law: derivatives, dependence on the drive, parameter names.

use super::*;
use crate::force::{FuzzySets, Membership};
use crate::sample::DriveKind;
use num_dual::{Dual64, DualNum};
use proptest::prelude::*;

impl Real for Dual64 {
    fn re(self) -> f64 {
        self.re
    }

    fn exp(self) -> Self {
        DualNum::exp(&self)
    }

    fn exp_m1(self) -> Self {
        DualNum::exp_m1(&self)
    }

    fn ln(self) -> Self {
        DualNum::ln(&self)
    }

    /// tanh z = 1 - 2 / (e^(2z) + 1). The derivative of the library's sinh z / cosh z loses its digits where tanh is nearly constant.
    fn tanh(self) -> Self {
        -(Real::exp(self * 2.0) + 1.0).recip() * 2.0 + 1.0
    }

    fn atan(self) -> Self {
        DualNum::atan(&self)
    }

    fn sin(self) -> Self {
        DualNum::sin(&self)
    }
}

/// Force of the damper of [`sensible`], N.
const FORCE_N: f64 = 1000.0;
/// Hidden variables of that damper with the Bouc-Wen law: m, 1, m/s.
const HIDDEN: Hidden = [0.02, 1.0, 0.3];

/// Whether `found` equals `exact`, both derivatives of a quantity by a variable with sizes `of` and `by`. Without the sizes it would fail
/// where tanh is nearly constant: there, 1 - tanh² has few digits.
fn agree(found: f64, exact: f64, of: f64, by: f64) -> bool {
    (found - exact).abs() <= 1e-10 * (exact.abs() + of / by.abs())
}

/// Derivatives of a sample by one variable.
struct Derivatives {
    /// Name of the variable.
    by: &'static str,
    /// Size of the variable.
    size: f64,
    force: f64,
    hidden: Hidden,
}

impl Derivatives {
    /// Derivatives by parameter `index`; beyond the parameters, by a hidden variable.
    fn by(law: ForceLaw, p: &[f64], index: usize, found: &Sensitivity) -> Self {
        match p.get(index) {
            Some(value) => Self {
                by: law.parameters()[index].name,
                size: *value,
                force: found.force_by_parameter[index],
                hidden: found.hidden_by_parameter.map(|row| row[index]),
            },
            None => {
                let h = index - p.len();
                Self {
                    by: ["r", "z", "velocity before"][h],
                    size: HIDDEN[h],
                    force: found.force_by_hidden[h],
                    hidden: found.hidden_by_hidden.map(|row| row[h]),
                }
            }
        }
    }
}

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
    fn derivatives_agree_with_dual_numbers(
        law in prop::sample::select(ForceLaw::ALL.to_vec()),
        share in prop::collection::vec(0.05..0.95, MAX_PARAMETERS),
        before in prop::array::uniform3(-1.0..1.0),
        dt_s in prop::option::of(Just(0.002)),
        x in -0.02..0.02, v in -0.3..0.3, a in -5.0..5.0,
    ) {
        let p = sensible(law, &share);
        let before: Hidden = std::array::from_fn(|h| before[h] * HIDDEN[h]);
        let inputs = Inputs { dt_s, displacement_m: x, velocity_m_s: v, acceleration_m_s2: a, drive: 0.0, case_temp_c: f64::NAN };
        let (mut plain, mut after) = (before, before);
        let force_n = law.force_n(&p, &inputs, &mut plain);
        let found = law.sensitivity(&p, &inputs, &mut after);
        prop_assert!((found.force_n - force_n).abs() <= 1e-12 * (FORCE_N + force_n.abs()), "{} against {}", found.force_n, force_n);
        for h in 0..MAX_HIDDEN {
            prop_assert!((after[h] - plain[h]).abs() <= 1e-12 * HIDDEN[h], "{}: {:?} against {:?}", law.name(), after, plain);
        }
        let directions = if law.has_memory() { p.len() + MAX_HIDDEN } else { p.len() };
        for direction in 0..directions {
            let dual = |index: usize, value: f64| Dual64::new(value, f64::from(index == direction));
            let q: Vec<Dual64> = p.iter().enumerate().map(|(j, value)| dual(j, *value)).collect();
            let mut next: [Dual64; MAX_HIDDEN] = std::array::from_fn(|h| dual(p.len() + h, before[h]));
            let exact = law.force_on(&q, &inputs.lifted(), &mut next);
            let Derivatives { by, size, force, hidden } = Derivatives::by(law, &p, direction, &found);
            prop_assert!(agree(force, exact.eps, FORCE_N, size), "{}, {}: {} against {}", law.name(), by, force, exact.eps);
            for ((found, exact), of) in hidden.into_iter().zip(next).zip(HIDDEN) {
                prop_assert!(agree(found, exact.eps, of, size), "{}, hidden by {}: {} against {}", law.name(), by, found, exact.eps);
            }
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
