//! Models, motions and demands for the tests of the inverse controller, and the invariants of its commands.

use mr_damper_model::effect::{Effect, EffectModel, Effects};
use mr_damper_model::force::{Dependence, ForceLaw, ForceModel, Inputs, LawModel};
use mr_damper_model::inverse::track::{Figures, TrackingRig, on_rig};
use mr_damper_model::inverse::{CurrentCommand, Demand, InverseController, LimitedBy, Limits, Method};
use mr_damper_model::model::Model;
use mr_damper_model::preset;
use mr_damper_model::rig::signal::RATE_HZ;
use mr_damper_model::rig::{Channels, Experiment, Motion, Plant, record};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

pub(crate) fn fuzzy_tanh() -> Model {
    preset::load(preset::BEST_FUZZY_TANH).expect("a preset")
}

pub(crate) fn with(effects: &[(Effect, &[f64])]) -> Model {
    let effects: Vec<EffectModel> =
        effects.iter().map(|(e, p)| EffectModel::new(*e, p).expect("within range")).collect();
    Model { effects: Effects::new(&effects).expect("few enough"), ..fuzzy_tanh() }
}

pub(crate) fn inputs(displacement_m: f64, velocity_m_s: f64) -> Inputs {
    Inputs {
        dt_s: Some(1.0 / RATE_HZ),
        displacement_m,
        velocity_m_s,
        acceleration_m_s2: 0.0,
        drive: f64::NAN,
        case_temp_c: 23.0,
    }
}

/// Any number that an input can have, most of them plausible.
fn any(rng: &mut Pcg64Mcg, size: f64) -> f64 {
    match rng.random_range(0..40_u32) {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => -1e300,
        3 => 0.0,
        4 => 1e-12 * size,
        _ => size * (2.0 * rng.random::<f64>() - 1.0),
    }
}

/// Limits under which every kind of limitation occurs.
pub(crate) const TIGHT: Limits = Limits {
    current_max_a: 2.5,
    rate_max_a_s: 200.0,
    safe_a: 0.3,
    safe_after_s: 0.5,
    hold_m_s: 2e-3,
    lead_s: 4e-3,
    feedback_s: 10e-3,
    feedback_gain: 1.0,
};

/// Checks that an inverse controller with [`TIGHT`] limits stays within them and never drives the rod, over `states` states with broken
/// values among them. Returns the number of states in which it answered a demand.
pub(crate) fn keeps_its_limits(mut controller: InverseController, states: u32, seed: u64) -> u32 {
    let limits = TIGHT;
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let (mut last_a, mut commanded) = (limits.safe_a, 0_u32);
    for _ in 0..states {
        let mut at = inputs(any(&mut rng, 0.02), any(&mut rng, 0.3));
        at.acceleration_m_s2 = any(&mut rng, 5.0);
        if rng.random_range(0..50_u32) == 0 {
            at.dt_s =
                [None, Some(f64::NAN), Some(0.0), Some(1e3), Some(1e-320)][rng.random_range(0..5_usize)];
        }
        at.drive = if rng.random::<bool>() { f64::NAN } else { any(&mut rng, 3.0) };
        let demand_n = rng.random::<f32>().gt(&0.05).then(|| any(&mut rng, 3e3));
        let measured_n = rng.random::<bool>().then(|| any(&mut rng, 2e3));
        let CurrentCommand { current, dissipative, limited_by, requested, .. } =
            controller.step(&at, Demand::of_force(demand_n), measured_n);
        let current_a = current.get();
        assert!((0.0..=limits.current_max_a).contains(&current_a), "{current_a} {at:?}");
        if let Some(dt_s) = at.dt_s.filter(|dt_s| *dt_s > 0.0) {
            assert!((current_a - last_a).abs() <= limits.rate_max_a_s * dt_s + 1e-12, "{at:?}");
        } else {
            assert_eq!(current_a, last_a, "without a time step the current does not change: {at:?}");
        }
        if limited_by != LimitedBy::Safe {
            commanded += 1;
            assert!(requested.is_finite() && at.velocity_m_s.is_finite());
            assert!(dissipative || current_a <= last_a, "{requested:?} {at:?}");
        }
        last_a = current_a;
    }
    commanded
}

/// Semi-phenomenological model with a yield force that grows up to 1.25 A and falls above.
pub(crate) fn folded() -> Model {
    let law = ForceLaw::Sp;
    let names: Vec<&str> = law.parameters().iter().map(|parameter| parameter.name).collect();
    let level = |name: &str| match name {
        "yield_force_n" => [100.0, 1600.0, -640.0],
        "post_yield_damping_n_s_m" => [500.0, 0.0, 0.0],
        "pre_yield_slope_s_m" => [60.0, 0.0, 0.0],
        "coupling_stroke_m" => [1.0, 0.0, 0.0],
        _ => [0.0; 3],
    };
    let coefficients: Vec<f64> =
        (0..3).flat_map(|power| names.iter().map(move |name| level(name)[power])).collect();
    let dependence =
        Dependence::Polynomial { drive: mr_damper_model::sample::DriveKind::CoilCurrent, degree: 2 };
    let force = LawModel::new(law, dependence, &coefficients, 0.0).expect("in order");
    Model { force: ForceModel::Law(force), ..fuzzy_tanh() }
}

/// Bouc-Wen model with damping and hysteresis that grow with the current.
pub(crate) fn bouc_wen() -> Model {
    let none = [600.0, 8e3, 1e3, 500.0, 80.0, 150.0, 2.0, 150.0, 300.0];
    let per_a = [200.0, 4e3, 0.0, 0.0, 300.0, 0.0, 0.0, 0.0, 0.0];
    polynomial(ForceLaw::BoucWen, &[none, per_a].concat())
}

/// The polynomial of Choi et al., linear in the current, with the falling branch a little below the rising one.
pub(crate) fn choi() -> Model {
    let none = |b0: f64| [b0, 2500.0, 0.0, -2e4, 0.0, 0.0, 0.0];
    let per_a = |b0: f64| [b0, 4000.0, 0.0, -6e4, 0.0, 0.0, 0.0];
    polynomial(ForceLaw::Choi, &[none(-40.0), none(40.0), per_a(-15.0), per_a(15.0)].concat())
}

/// `law` with parameters linear in the current.
fn polynomial(law: ForceLaw, coefficients: &[f64]) -> Model {
    let drive = mr_damper_model::sample::DriveKind::CoilCurrent;
    let dependence = Dependence::Polynomial { drive, degree: 1 };
    let force = LawModel::new(law, dependence, coefficients, 20.0).expect("in order");
    Model { force: ForceModel::Law(force), ..fuzzy_tanh() }
}

/// A motion, and a demanded force that `plant` can give along it: 15 to 85 % of the way from its softest to its hardest force.
pub(crate) fn demand(experiment: &Experiment, plant: &Plant) -> (Motion, Vec<f64>) {
    let x = record(experiment, plant, &Channels::PERFECT, 77).displacement_m.values;
    let (samples, motion) = (x.len(), Motion::recorded(x));
    let at = |current_a: f64| plant.respond(&motion, &vec![current_a; samples], 16).force_n;
    let (soft, hard) = (at(0.0), at(2.5));
    let share = |k: usize| 0.5 + 0.35 * (TAU * 0.7 * k as f64 / RATE_HZ).sin();
    let force_n = (0..samples).map(|k| soft[k] + share(k) * (hard[k] - soft[k])).collect();
    (motion, force_n)
}

/// Tracking error on the rig, without the first second.
pub(crate) fn error(
    (model, method): (&Model, Method),
    (motion, force_n): &(Motion, Vec<f64>),
    plant: &Plant,
    feedback: bool,
) -> f64 {
    let channels = Channels::default();
    let tracking_rig = TrackingRig { plant, channels: &channels, seed: 5, feedback };
    let controller =
        InverseController::with_method(model, Limits::default(), method).expect("it follows a current");
    let points = on_rig(model, &controller, motion, force_n, &tracking_rig).expect("it needs no velocity");
    let figures = Figures::of(&points[RATE_HZ as usize..]);
    assert_eq!(figures.dissipative_violations, 0);
    figures.error
}
