//! Rules for every effect, and each effect against a reference that shares no code with it.

use super::*;
use crate::force::{Dependence, ForceLaw, ForceModel, FreeRun, Inputs, LawModel};
use crate::preset;
use crate::sample::DriveKind;
use proptest::prelude::*;

mod derivatives;
mod responses;
mod terms;

/// Force offset of the models below, N.
const OFFSET_N: f64 = 31.0;

fn law(law: ForceLaw, dependence: Dependence, coefficients: &[f64]) -> ForceModel {
    ForceModel::Law(LawModel::new(law, dependence, coefficients, OFFSET_N).expect("a model"))
}

/// C v + offset.
fn dashpot(damping_n_s_m: f64) -> ForceModel {
    law(ForceLaw::Sp, Dependence::None, &[0.0, damping_n_s_m, 1.0, 0.0, 1.0])
}

/// (200 + 400 i) tanh(30 (v + 3 x)) + 700 (v + 3 x) + offset.
fn tanh() -> ForceModel {
    let drive = Dependence::Polynomial { drive: DriveKind::CoilCurrent, degree: 1 };
    law(ForceLaw::Sp, drive, &[200.0, 700.0, 30.0, 3.0, 1.0, 400.0, 0.0, 0.0, 0.0, 0.0])
}

/// Bouc-Wen with the coefficients of its own tests: a model with state.
fn bouc_wen() -> ForceModel {
    law(ForceLaw::BoucWen, Dependence::None, &[700.0, 8000.0, 300.0, 0.0, 400.0, 300.0, 1.2, 300.0, 400.0])
}

fn thesis(name: &str) -> ForceModel {
    preset::load(name).expect("a preset").force
}

fn models() -> Vec<ForceModel> {
    vec![tanh(), dashpot(900.0), bouc_wen(), thesis(preset::BEST_FUZZY_TANH), thesis(preset::BEST_ARX)]
}

/// A motion with a sampling rate that jumps, a current with steps, and a case that warms up.
fn motion(count: usize) -> Vec<Inputs> {
    let (mut t, mut before) = (0.0_f64, None);
    let mut inputs = Vec::with_capacity(count);
    for k in 0..count {
        let dt = [0.002, 0.001, 0.0035][(k / 100) % 3];
        t += dt;
        let v = 0.072 * (9.0 * t).cos() + 0.062 * (31.0 * t).cos();
        inputs.push(Inputs {
            dt_s: (k > 0).then_some(dt),
            displacement_m: 0.008 * (9.0 * t).sin() + 0.002 * (31.0 * t).sin(),
            velocity_m_s: v,
            acceleration_m_s2: before.map_or(f64::NAN, |before| (v - before) / dt),
            drive: [0.4, 1.2, 2.1, 0.8][(t / 0.2) as usize % 4],
            case_temp_c: 25.0 + 4.0 * t,
        });
        before = Some(v);
    }
    inputs
}

fn augmented(force: ForceModel, effects: &[EffectModel]) -> Augmented {
    Augmented::new(force, Effects::new(effects).expect("few enough")).expect("effects that fit the model")
}

fn with(effect: Effect, parameters: &[f64]) -> EffectModel {
    EffectModel::new(effect, parameters).expect("within range")
}

/// The effect with parameters in the middle of their range.
fn present(effect: Effect) -> EffectModel {
    let value = |p: &Parameter| {
        let [low, high] = p.range_at(size(p.scale));
        if low < 0.0 && high <= 0.0 { 0.5 * low } else { 0.5 * (low.max(0.0) + high) }
    };
    with(effect, &effect.parameters().iter().map(value).collect::<Vec<_>>())
}

/// Scales of a damper of 1 kN, 10 mm and 0.2 m/s.
fn size(scale: Scale) -> f64 {
    1e3_f64.powi(scale.force) * 0.01_f64.powi(scale.displacement) * 0.2_f64.powi(scale.velocity)
}

fn run(model: &Augmented, inputs: &[Inputs]) -> Vec<f64> {
    let mut state = AugmentedState::default();
    inputs.iter().map(|inputs| model.free_run(&mut state, inputs).unwrap_or(f64::NAN)).collect()
}

/// The bits of each force, with one value for NaN, so that forces that are not finite can be compared.
fn bits(forces: &[f64]) -> Vec<u64> {
    forces.iter().map(|f| if f.is_nan() { 0 } else { f.to_bits() }).collect()
}

fn suits(effect: Effect, force: &ForceModel) -> bool {
    force.drive().is_some() || !effect.needs().contains(&Need::Drive)
}

#[test]
fn without_effects_the_force_is_bit_identical_to_the_plain_model() {
    let inputs = motion(500);
    for force in models() {
        let mut state = FreeRun::default();
        let plain: Vec<f64> =
            inputs.iter().map(|at| force.free_run(&mut state, at).unwrap_or(f64::NAN)).collect();
        assert_eq!(bits(&plain), bits(&run(&force.into(), &inputs)), "{}", force.name());
    }
}

#[test]
fn a_neutral_effect_is_absent() {
    let inputs = motion(1500);
    for force in models() {
        let plain = run(&force.into(), &inputs);
        let largest_n = plain.iter().filter(|f| f.is_finite()).fold(0.0_f64, |most, f| most.max(f.abs()));
        for effect in Effect::ALL.into_iter().filter(|effect| suits(*effect, &force)) {
            let neutral = run(&augmented(force, &[effect.stepped(None, size)]), &inputs);
            for (a, b) in plain.iter().zip(&neutral) {
                let same = (a - b).abs() <= 1e-12 * largest_n || (a.is_nan() && b.is_nan());
                assert!(same, "{} around {}: {a} {b}", effect.title(), force.name());
            }
        }
    }
}

/// The change of the force is linear for small effects: a hundredth of the probe makes about a hundredth of the change.
#[test]
fn a_small_effect_changes_the_force_in_proportion() {
    let inputs = motion(1500);
    let plain = run(&tanh().into(), &inputs);
    let change = |model: EffectModel| {
        let forces = run(&augmented(tanh(), &[model]), &inputs);
        let squares = forces.iter().zip(&plain).map(|(a, b)| (a - b).powi(2)).filter(|s| s.is_finite());
        squares.sum::<f64>().sqrt()
    };
    // Free play is not linear: the rod is slow at a reversal, so even a small gap takes a while to cross.
    for effect in Effect::ALL.into_iter().filter(|effect| *effect != Effect::Deadzone) {
        for index in (0..effect.parameters().len()).filter(|j| !effect.parameters()[*j].is_shape()) {
            let probe = effect.probe(index, size);
            let small: Vec<f64> = (0..effect.parameters().len())
                .map(|j| probe.parameters()[j] * if j == index { 0.01 } else { 1.0 })
                .collect();
            let ratio = change(probe) / change(with(effect, &small));
            assert!((70.0..130.0).contains(&ratio), "{} {index}: {ratio}", effect.title());
        }
    }
}

#[test]
fn every_effect_changes_the_force_and_is_deterministic() {
    let inputs = motion(1500);
    let plain = run(&tanh().into(), &inputs);
    for effect in Effect::ALL {
        let model = augmented(tanh(), &[present(effect)]);
        let forces = run(&model, &inputs);
        assert!(forces[1..].iter().all(|f| f.is_finite()), "{}", effect.title());
        let most = forces[1..].iter().zip(&plain[1..]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(most > 0.05, "{}: {most} N", effect.title());
        assert_eq!(bits(&forces), bits(&run(&model, &inputs)), "{}", effect.title());
    }
}

#[test]
fn a_gap_restarts_every_effect() {
    let inputs = motion(900);
    for effect in Effect::ALL {
        let model = augmented(tanh(), &[present(effect)]);
        let mut state = AugmentedState::default();
        for at in &inputs {
            model.free_run(&mut state, at);
        }
        let after: Vec<f64> =
            inputs.iter().map(|at| model.free_run(&mut state, at).unwrap_or(f64::NAN)).collect();
        assert_eq!(bits(&after), bits(&run(&model, &inputs)), "{}", effect.title());
    }
}

/// An input that is not finite gives no force at that sample, and some time later the force is as without it.
#[test]
fn an_input_that_is_not_finite_gives_no_force_and_has_no_lasting_influence() {
    let inputs = motion(1500);
    let spoil: [fn(&mut Inputs); 4] = [
        |at| at.displacement_m = f64::NAN,
        |at| at.velocity_m_s = f64::NAN,
        |at| at.velocity_m_s = f64::INFINITY,
        |at| at.drive = f64::NAN,
    ];
    for effect in Effect::ALL {
        let model = augmented(tanh(), &[present(effect)]);
        let sound = run(&model, &inputs);
        for spoil in spoil {
            let mut broken = inputs.clone();
            broken[300..305].iter_mut().for_each(spoil);
            let forces = run(&model, &broken);
            assert!(forces[300..305].iter().all(|f| f.is_nan()), "{}", effect.title());
            assert!(forces[305].is_finite(), "{}: {}", effect.title(), forces[305]);
            for (a, b) in sound[1000..].iter().zip(&forces[1000..]) {
                assert!((a - b).abs() < 1e-6 * (1.0 + a.abs()), "{}: {a} {b}", effect.title());
            }
        }
    }
}

#[test]
fn effects_delay_the_first_force_by_at_most_one_sample() {
    let inputs = motion(600);
    let force = thesis(preset::BEST_ARX);
    let silent = run(&force.into(), &inputs).iter().take_while(|f| f.is_nan()).count();
    assert!(silent > 0, "an ARX model has to fill its history");
    for effect in Effect::ALL {
        let forces = run(&augmented(force, &[present(effect)]), &inputs);
        let late = forces.iter().take_while(|f| f.is_nan()).count();
        assert!(late <= silent + 1, "{}: {late}", effect.title());
        assert!(forces[late..].iter().all(|f| f.is_finite()), "{}", effect.title());
    }
}

#[test]
fn the_last_effect_is_the_outermost() {
    let (asymmetry, gas) = (with(Effect::Asymmetry, &[0.3]), with(Effect::GasSpring, &[2e4]));
    let at = Inputs {
        dt_s: None,
        displacement_m: 0.01,
        velocity_m_s: 0.2,
        acceleration_m_s2: 0.0,
        drive: f64::NAN,
        case_temp_c: f64::NAN,
    };
    let plain_n = 900.0 * 0.2;
    let first = |effects: &[EffectModel]| run(&augmented(dashpot(900.0), effects), &[at])[0] - OFFSET_N;
    // tanh(40) is 1 in double precision.
    assert!((first(&[asymmetry, gas]) - (1.3 * plain_n + 200.0)).abs() < 1e-10);
    assert!((first(&[gas, asymmetry]) - 1.3 * (plain_n + 200.0)).abs() < 1e-10);
}

#[test]
fn the_library_is_consistent() {
    for effect in Effect::ALL {
        let title = effect.title();
        assert_eq!(
            Effect::named(effect.id(), effect.form()),
            Some(effect),
            "{title} is found by its own id and form"
        );
        let forms = Effect::ALL.iter().filter(|other| other.id() == effect.id()).count();
        assert!(effect.form().is_none() || forms > 1, "{title}: has a form only if the id has several");
        assert!(effect.parameters().len() <= MAX_EFFECT_PARAMETERS);
        let example = effect.properties().example;
        assert_eq!(EffectModel::new(effect, example), Ok(effect.example()), "{title}");
        for id in effect.confounders() {
            assert!(Effect::ALL.iter().any(|other| other.id() == *id), "{title}: {id}");
            assert_ne!(*id, effect.id(), "{title}");
        }
        assert!(effect.parameters().iter().any(|p| !p.is_shape()), "{title}: one parameter makes it absent");
        for p in effect.parameters() {
            let [low, high] = p.range;
            assert!(low < high && (low..=high).contains(&(p.neutral + p.probe)), "{title} {}", p.name);
            assert!(p.probe.abs() <= 0.2 * low.abs().max(high.abs()), "{title} {}: a small step", p.name);
            assert!(
                !p.label().is_empty() && p.label().replace(' ', "_") + p.unit.suffix() == p.name,
                "{}",
                p.name
            );
            assert_eq!(Parameter::named(p.name).map(|named| named.unit), Some(p.unit), "{title} {}", p.name);
        }
        for index in 0..effect.parameters().len() {
            let probe = effect.probe(index, size);
            assert_eq!(EffectModel::new(effect, probe.parameters()), Ok(probe), "{title}");
        }
        // A diagnosis applies effects in the order of their layers, which must not depend on the order in which it finds them.
        let same = |other: &Effect| other.layer() == effect.layer();
        assert!(Effect::ALL.iter().filter(|e| same(e)).all(|e| e.id() == effect.id()), "{title}: its layer");
    }
}

/// Effects that model files may contain keep their ids, parameters, ranges and words. A new effect needs no entry here.
#[test]
fn recorded_names_ranges_and_words_stay_as_they_are() {
    let described: Vec<String> = Effect::ALL.into_iter().map(description).collect();
    // The lines of an effect after its first one are indented.
    let recorded = include_str!("tests/recorded.txt").replace("\n    ", "\u{0}");
    assert!(recorded.lines().count() >= 17, "{recorded}");
    for effect in recorded.lines().map(|lines| lines.replace('\u{0}', "\n    ")) {
        assert!(described.contains(&effect), "changed: {effect}\nnow: {described:#?}");
    }
}

fn description(effect: Effect) -> String {
    let mut text = format!("{}: {}", effect.title(), effect.what());
    for p in effect.parameters() {
        let unit = if p.scale == Scale::ONE {
            String::new()
        } else {
            format!("  of F^{} x^{} v^{}", p.scale.force, p.scale.displacement, p.scale.velocity)
        };
        let [low, high] = p.range;
        let role = if p.is_shape() { format!("held {}", p.neutral) } else { format!("probe {}", p.probe) };
        text += &format!("\n    {} {low} to {high}{unit}, {role}", p.name);
    }
    let needs: Vec<&str> = effect.needs().iter().map(|need| need.name()).collect();
    if !needs.is_empty() {
        text += &format!("\n    needs {}", needs.join(", "));
    }
    text += &format!("\n    told apart by {}", effect.separated_by());
    text + &format!("\n    looks like {}", effect.confounders().join(", "))
}

/// The properties that only the diagnosis and the inverse controller read.
#[test]
fn properties_of_the_inverse_and_the_order_of_effects() {
    assert!(Effect::CoilLag.lags_drive() && Effect::CoilLagRiseFall.lags_drive());
    assert!(!Effect::Remanence.lags_drive() && !Effect::ForceLag.lags_drive());
    for effect in [Effect::GasSpring, Effect::Inertia, Effect::Friction, Effect::EndStop] {
        assert!(effect.only_adds(), "{}", effect.title());
    }
    for effect in [Effect::Asymmetry, Effect::SeriesSpring, Effect::CoilLag, Effect::AntiAliasMismatch] {
        assert!(!effect.only_adds(), "{}", effect.title());
    }
    let lag = with(Effect::CoilLag, &[0.012]);
    assert_eq!(lag.drive_lag_s(), Some([0.012; 2]));
    assert_eq!(lag.refined(), Some(with(Effect::CoilLagRiseFall, &[0.012, 0.012])));
    let lag = with(Effect::CoilLagRiseFall, &[0.005, 0.019]);
    assert_eq!((lag.drive_lag_s(), lag.refined()), (Some([0.005, 0.019]), None));
    assert_eq!(with(Effect::GasSpring, &[3e3]).static_stiffness_n_m(), 3e3);
    assert_eq!(with(Effect::EndStop, &[3e3, 0.01]).static_stiffness_n_m(), 0.0);
    // The drive passes the coil and the core, and the force the rod and the load cell.
    let outwards = [
        Effect::Remanence,
        Effect::CoilLag,
        Effect::ThermalFade,
        Effect::PositionDependence,
        Effect::Asymmetry,
        Effect::VelocitySaturation,
        Effect::Friction,
        Effect::GasSpring,
        Effect::EndStop,
        Effect::Deadzone,
        Effect::SeriesSpring,
        Effect::Inertia,
        Effect::ForceLag,
        Effect::SensorDelay,
        Effect::AntiAliasMismatch,
        Effect::LoadCellDrift,
    ];
    assert!(outwards.is_sorted_by(|inner, outer| inner.layer() < outer.layer()), "{outwards:?}");
}

#[test]
fn values_out_of_range_are_rejected_with_their_name() {
    let refused = |effect, parameters: &[f64]| {
        EffectModel::new(effect, parameters).expect_err("a value out of range").to_string()
    };
    assert_eq!(
        refused(Effect::CoilLag, &[0.5]),
        "effect coil_lag (one_tau): tau_s is 0.5, but must be 0 to 0.04"
    );
    assert!(refused(Effect::ThermalFade, &[0.001]).contains("fade_per_k is 0.001, but must be -0.01 to 0"));
    assert!(refused(Effect::Friction, &[f64::NAN]).contains("friction_n is NaN"));
    assert!(
        refused(Effect::EndStop, &[-1.0, 0.01])
            .contains("stiffness_n_m is -1, but must be finite and at least 0")
    );
    assert!(refused(Effect::VelocitySaturation, &[f64::INFINITY]).contains("must be finite"));
    assert!(refused(Effect::CoilLagRiseFall, &[0.01]).contains("has 1 values, but 2 are needed"));
    let four = [present(Effect::Friction); 4];
    assert!(
        Effects::new(&four).is_err_and(|e| e.to_string() == "effects has 4 values, but at most 3 are needed")
    );
    let late = [Effect::CoilLag, Effect::SensorDelay, Effect::LoadCellDrift, Effect::Friction].map(present);
    assert!(Effects::new(&late[..3]).is_ok());
    let refused = Effects::new(&late[1..]).expect_err("friction comes after the load cell").to_string();
    assert!(
        refused.starts_with("effect friction comes after sensor_delay, but sensor_delay changes the reading"),
        "{refused}"
    );
    let lag = Effects::new(&[present(Effect::CoilLag)]).expect("one");
    let refused = Augmented::new(dashpot(1.0), lag).expect_err("no drive to lag");
    assert!(refused.to_string().contains("effect coil_lag acts on the drive, but the sp model has none"));
}

/// Effects with which the force cannot fall as speed grows. Around any other effect a series spring may have no force at which rod and
/// piston agree.
const DISSIPATES: [Effect; 12] = [
    Effect::CoilLag,
    Effect::CoilLagRiseFall,
    Effect::Remanence,
    Effect::ThermalFade,
    Effect::GasSpring,
    Effect::Inertia,
    Effect::Friction,
    Effect::FrictionOwnScale,
    Effect::ForceLag,
    Effect::SeriesSpring,
    Effect::Deadzone,
    Effect::EndStop,
];

/// True if each series spring is around effects of [`DISSIPATES`] only.
fn dissipates(effects: &[EffectModel]) -> bool {
    let spring = effects.iter().rposition(|model| model.effect() == Effect::SeriesSpring).unwrap_or(0);
    effects[..spring].iter().all(|model| DISSIPATES.contains(&model.effect()))
}

fn any_effect() -> impl Strategy<Value = EffectModel> {
    (0..Effect::ALL.len(), 0.0..=1.0f64, 0.0..=1.0f64).prop_map(|(index, a, b)| {
        let effect = Effect::ALL[index];
        let value = |(p, share): (&Parameter, f64)| {
            let [low, high] = p.allowed();
            let [low, high] =
                if high.is_finite() && low.is_finite() { [low, high] } else { p.range_at(size(p.scale)) };
            low + share * (high - low)
        };
        let values: Vec<f64> = effect.parameters().iter().zip([a, b]).map(value).collect();
        with(effect, &values)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Up to three random effects around any model, with random inputs: the result is deterministic, and finite where it has to be.
    #[test]
    fn any_three_effects_run(
        mut effects in prop::collection::vec(any_effect(), 1..=MAX_EFFECTS),
        steps in prop::collection::vec((1e-5..0.1f64, -0.05..0.05f64, -2.0..2.0f64, -500.0..500.0f64, -3.0..3.0f64), 1..60),
    ) {
        let inputs: Vec<Inputs> = steps.iter().enumerate().map(|(k, (dt, x, v, a, i))| Inputs {
            dt_s: (k > 0).then_some(*dt),
            displacement_m: *x,
            velocity_m_s: *v,
            acceleration_m_s2: *a,
            drive: *i,
            case_temp_c: 20.0 + 10.0 * i,
        }).collect();
        for force in models() {
            effects.sort_by_key(|model| model.is_of_load_cell());
            if effects.iter().all(|model| suits(model.effect(), &force)) {
                let model = augmented(force, &effects);
                let forces = run(&model, &inputs);
                prop_assert_eq!(bits(&forces), bits(&run(&model, &inputs)));
                if force == tanh() && dissipates(&effects) {
                    prop_assert!(forces.iter().all(|f| f.is_finite() && f.abs() < 1e9), "{:?}", forces);
                }
            }
        }
    }
}
