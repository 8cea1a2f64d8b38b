//! The inverse controller: its invariants for any input, and how well it follows a demanded force on a damper that differs from the model.
//!
//! `MR_DAMPER_LONG=1 cargo test --release -p mr-damper-model --test all inverse::` tries ten million states instead of a hundred thousand.

use crate::inverse_support::{TIGHT, demand, error, folded, fuzzy_tanh, inputs, keeps_its_limits, with};
use mr_damper_model::condition::{Conditioning, VelocitySource};
use mr_damper_model::diagnose::{self, Runs};
use mr_damper_model::effect::{AugmentedState, Effect};
use mr_damper_model::force::Inputs;
use mr_damper_model::identify::{Dataset, DatasetOptions, ModelSpec, Options, Watch, identify};
use mr_damper_model::inverse::track::{Figures, Point, Trajectory, on_model};
use mr_damper_model::inverse::{Demand, InverseController, LimitedBy, Limits, Method, Shape};
use mr_damper_model::model::Model;
use mr_damper_model::preset;
use mr_damper_model::rig::signal::RATE_HZ;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use std::f64::consts::TAU;

#[test]
fn commands_keep_their_limits_and_never_drive_the_rod_for_any_input() {
    let states: u32 =
        if std::env::var("MR_DAMPER_LONG").as_deref() == Ok("1") { 10_000_000 } else { 100_000 };
    let models = [
        fuzzy_tanh(),
        with(&[(Effect::CoilLag, &[0.012]), (Effect::GasSpring, &[2e3])]),
        with(&[(Effect::CoilLagRiseFall, &[0.004, 0.014]), (Effect::SeriesSpring, &[2e-7])]),
    ];
    for (model, seed) in models.iter().zip(0..) {
        let controller = InverseController::new(model, TIGHT).expect("it follows a current");
        let commanded = keeps_its_limits(controller, states / models.len() as u32, seed);
        assert!(
            commanded > states / 6,
            "{commanded}: too few states with an answer for the test to be meaningful"
        );
    }
}

#[test]
fn demands_that_cannot_be_met_are_answered_with_the_reason() {
    let model = fuzzy_tanh();
    let mut controller = InverseController::new(&model, Limits::default()).expect("it follows a current");
    let mut at = |velocity_m_s: f64, demand_n: f64| {
        let command = controller.step(&inputs(0.0, velocity_m_s), Demand::Force(demand_n), None);
        (command.limited_by, command.current.get(), command)
    };
    let (by, current_a, command) = at(0.1, 600.0);
    assert!(by == LimitedBy::None && command.is_achievable && command.dissipative);
    assert!((command.expected.get() - 600.0).abs() < 1.0 && (0.1..2.4).contains(&current_a), "{command:?}");
    // Ten times too large: the command is at the upper end of the range.
    let (by, current_a, command) = at(0.1, 6000.0);
    assert!(by == LimitedBy::CurrentMax && current_a == 2.5 && !command.is_achievable);
    assert!(command.achievable[1].get() < 3000.0 && command.expected == command.achievable[1]);
    // Below the force without current.
    let (by, current_a, command) = at(0.1, command.achievable[0].get() - 20.0);
    assert!(by == LimitedBy::CurrentMin && current_a == 0.0 && command.dissipative);
    // A force that would drive the motion.
    let (by, current_a, command) = at(0.1, -600.0);
    assert!(by == LimitedBy::Passivity && current_a == 0.0 && !command.dissipative && !command.is_achievable);
    // At rest the current is held for any demand.
    let (_, before_a, _) = at(-0.1, -700.0);
    for demand_n in [500.0, -500.0, 0.0] {
        assert_eq!(at(0.0, demand_n).1, before_a);
    }
    let (by, _, command) = at(0.1, f64::NAN);
    assert!(by == LimitedBy::Safe && command.requested.get().is_nan() && command.expected.get().is_nan());
    assert_eq!(at(f64::NAN, 500.0).0, LimitedBy::Safe, "without a velocity the current is safe");
}

#[test]
fn without_a_rate_limit_a_demanded_current_is_reached_within_no_time() {
    let mut controller = InverseController::without_inverse(Limits::default()).expect("valid limits");
    let command = controller.idle(Demand::Current(1.5), 0.0);
    assert_eq!((command.current.get(), command.limited_by), (1.5, LimitedBy::None));
    let limits = Limits { rate_max_a_s: 10.0, ..Limits::default() };
    let mut controller = InverseController::without_inverse(limits).expect("valid limits");
    let command = controller.idle(Demand::Current(1.5), 0.0);
    assert_eq!((command.current.get(), command.limited_by), (0.0, LimitedBy::Rate));
}

#[test]
fn without_demands_the_current_reaches_the_safe_one_in_time() {
    let limits = Limits { safe_a: 0.4, safe_after_s: 0.25, ..Limits::default() };
    let mut controller = InverseController::new(&fuzzy_tanh(), limits).expect("it follows a current");
    let hard = controller.step(&inputs(0.0, 0.1), Demand::Force(6e3), None).current.get();
    assert_eq!(hard, 2.5);
    let mut currents_a = Vec::new();
    for _ in 0..200 {
        let command = controller.step(&inputs(0.0, 0.1), Demand::None, None);
        assert_eq!(command.limited_by, LimitedBy::Safe);
        currents_a.push(command.current.get());
    }
    assert!(currents_a.windows(2).all(|pair| pair[1] <= pair[0]), "it only falls");
    let arrived = currents_a.iter().position(|a| *a == 0.4).expect("it arrives");
    assert!((f64::from(arrived as u32 + 1) / RATE_HZ - 0.25).abs() <= 1.0 / RATE_HZ, "{arrived}");
    // The current returns within one sample, because no rate limit is set.
    assert_eq!(controller.step(&inputs(0.0, 0.1), Demand::Force(6e3), None).current.get(), 2.5);
}

#[test]
fn models_without_an_inverse_are_rejected_with_the_reason() {
    let refused = |model: &Model| {
        InverseController::new(model, Limits::default()).map(|_| ()).expect_err("no inverse").to_string()
    };
    let passive = preset::load("thesis/sp-passive/rp-icps").expect("a preset");
    assert!(refused(&passive).contains("has no current input"), "{}", refused(&passive));
    // An invalid envelope: the model cannot be evaluated within it.
    let broken = Model {
        envelope: mr_damper_model::model::Envelope {
            displacement_m: Some([f64::NAN, 0.0]),
            ..fuzzy_tanh().envelope
        },
        ..fuzzy_tanh()
    };
    assert!(refused(&broken).contains("of its own envelope"), "{}", refused(&broken));
    let limits = Limits { current_max_a: -1.0, ..Limits::default() };
    let error = InverseController::new(&fuzzy_tanh(), limits).map(|_| ()).expect_err("no limit").to_string();
    assert!(error.starts_with("current.max_a is -1"), "{error}");
}

#[test]
fn a_model_that_is_not_monotone_is_detected_and_can_still_be_used() {
    assert_eq!(Shape::of(&fuzzy_tanh(), 2.5).real_fold(), None);
    let model = folded();
    let fold = Shape::of(&model, 2.5).real_fold().expect("it folds");
    assert!((fold.current_a - 1.25).abs() < 0.11 && (fold.fall_n - 1000.0).abs() < 20.0, "{fold:?}");
    let mut controller = InverseController::new(&model, Limits::default()).expect("it follows a current");
    for demand_n in [300.0, 700.0, 1000.0, 600.0] {
        let command = controller.step(&inputs(0.0, 0.1), Demand::Force(demand_n), None);
        assert!((command.expected.get() - demand_n).abs() < 2.0, "{command:?}");
        assert!(command.current.get() < 1.26, "the current is below the fold: {command:?}");
    }
}

#[test]
fn a_demand_is_followed_on_a_damper_that_differs_from_the_model() {
    let plant = Plant::default();
    let run = |seed: u64| {
        let experiment = Experiment::thesis("RP-APRBS").expect("a thesis experiment").with_duration_s(21.0);
        record(&experiment, &plant, &Channels::default(), seed)
    };
    let options = Options { restarts: 3, ..Options::default() };
    let watch = Watch::default();
    let base = identify(ModelSpec::FUZZY_TANH, &[run(1)], &options, &watch).expect("a good run").model;
    let rows = |seed: u64| {
        let options = DatasetOptions::default();
        vec![Dataset::from_run(&run(seed), &base.conditioning, &options).expect("a good run")]
    };
    let (estimate, confirm) = (rows(1), rows(2));
    let runs = Runs { estimate: &estimate, confirm: &confirm, ..Runs::default() };
    let settings = diagnose::Settings { block_s: Some(1.5), ..diagnose::Settings::default() };
    let closed = diagnose::close(&base, &runs, &settings, &watch, &|_| {}).expect("long enough").after;

    let sine = demand(&Experiment::sine(0.01, 2.0, 0.0, 11.0), &plant);
    let road =
        demand(&Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(11.0), &plant);
    let table = [("sine", &sine), ("road", &road)].map(|(name, demand)| {
        let errors = [(&base, false), (&base, true), (&closed, false), (&closed, true)]
            .map(|(model, feedback)| error((model, Method::Search), demand, &plant, feedback));
        println!(
            "{name}: base {:.4}, with feedback {:.4}; augmented {:.4}, with feedback {:.4}",
            errors[0], errors[1], errors[2], errors[3]
        );
        errors
    });
    // The literature reports 0.07 with feedforward only and 0.024 with feedback. A road up to 20 Hz is harder. The base has not the plant's
    // structure, so the diagnosis refuses some effects that would help, because their intervals include zero.
    for ([base, base_back, closed, closed_back], limits) in
        table.into_iter().zip([[0.07, 0.024, 0.035, 0.024], [0.09, 0.045, 0.06, 0.045]])
    {
        assert!(
            base <= limits[0] && base_back <= limits[1] && closed <= limits[2] && closed_back <= limits[3]
        );
    }
}

#[test]
fn on_the_model_itself_achievable_demands_are_met() {
    let model = with(&[(Effect::CoilLag, &[0.012])]);
    let model = Model {
        conditioning: Conditioning { velocity: VelocitySource::ThreePoint, ..Conditioning::default() },
        ..model
    };
    let omega = TAU * 1.5;
    let seconds = |k: usize| k as f64 / RATE_HZ;
    let samples = 5 * RATE_HZ as usize;
    let demand = Trajectory {
        dt_s: (0..samples).map(|k| (k > 0).then_some(1.0 / RATE_HZ)).collect(),
        displacement_m: (0..samples).map(|k| 0.015 * (omega * seconds(k)).sin()).collect(),
        // In phase with the velocity, and for a part of each cycle too small or too large.
        force_n: (0..samples).map(|k| 700.0 * (omega * seconds(k)).cos()).collect(),
        case_temp_c: vec![f64::NAN; samples],
    };
    let controller = InverseController::new(&model, Limits::default()).expect("it follows a current");
    let points: Vec<Point> = on_model(&model, &controller, &demand).expect("it needs no velocity");
    let figures = Figures::of(&points);
    assert!(figures.error_achievable < 0.06 && figures.error > figures.error_achievable, "{figures:?}");
    assert!((0.05..0.95).contains(&figures.infeasible_share), "{figures:?}");
    assert_eq!(figures.dissipative_violations, 0);
    assert_eq!(points.len(), samples);
}

/// The bias is learnt from the reading without the part that the load cell adds. A controller with the effect and fed with readings therefore
/// commands the same as one without the effect and fed with the damper's force.
#[test]
fn the_bias_does_not_learn_the_effects_of_the_load_cell() {
    let effects: [(Effect, f64); 3] =
        [(Effect::SensorDelay, 0.005), (Effect::AntiAliasMismatch, 0.009), (Effect::LoadCellDrift, 5.0)];
    for (effect, value) in effects {
        let (model, damper) = (with(&[(effect, &[value])]), fuzzy_tanh());
        let mut controllers = [&model, &damper]
            .map(|model| InverseController::new(model, Limits::default()).expect("an inverse"));
        let mut states = [AugmentedState::default(); 2];
        let mut last_a = 0.0;
        for k in 0..1500 {
            let t = f64::from(k) / RATE_HZ;
            let at = Inputs {
                dt_s: (k > 0).then_some(1.0 / RATE_HZ),
                acceleration_m_s2: -6.0 * (30.0 * t).sin(),
                ..inputs(0.0067 * (30.0 * t).sin(), 0.2 * (30.0 * t).cos())
            };
            let driven = Inputs { drive: last_a, ..at };
            let [reading_n, force_n] = [(0, &model), (1, &damper)]
                .map(|(own, model)| model.free_run(&mut states[own], &driven).expect("a force"));
            // The damper is stronger than its model by a tenth.
            let measured_n = [reading_n + 0.1 * force_n, 1.1 * force_n];
            let demand = Demand::Force(400.0 * (30.0 * t).cos().signum());
            let [with_a, without_a] =
                [0, 1].map(|own| controllers[own].step(&at, demand, Some(measured_n[own])).current.get());
            assert!(
                (with_a - without_a).abs() < 1e-9,
                "{effect:?} {value} at {t}: {with_a} A, {without_a} A"
            );
            last_a = without_a;
        }
    }
}

#[test]
fn after_a_gap_only_a_driver_with_a_rate_limit_is_rate_limited() {
    let first = Inputs { dt_s: None, ..inputs(0.0, 0.2) };
    let command = |limits: Limits| {
        let mut controller = InverseController::new(&fuzzy_tanh(), limits).expect("an inverse");
        let command = controller.step(&first, Demand::Force(400.0), None);
        assert!(command.is_achievable, "{command:?}");
        (command.limited_by, command.current.get())
    };
    let (limited_by, current_a) = command(Limits::default());
    assert!(limited_by == LimitedBy::None && current_a > 0.1, "{limited_by:?} at {current_a} A");
    // How far a limited driver can go is not known without a time step.
    assert_eq!(command(Limits { rate_max_a_s: 100.0, ..Limits::default() }), (LimitedBy::Rate, 0.0));
}

#[test]
fn thermal_fade_acts_at_a_known_temperature_and_not_at_an_unknown_one() {
    let (plain, fading) = (fuzzy_tanh(), with(&[(Effect::ThermalFade, &[-0.005])]));
    let most_n = |model: &Model| Shape::of(model, 2.5).most_n;
    assert!((most_n(&fading) / most_n(&plain) - 1.0).abs() < 1e-12, "no temperature is known at a load");
    let samples = RATE_HZ as usize;
    let achieved_n = |model: &Model, case_temp_c: f64| {
        let displacement_m = |k: usize| 0.01 * (10.0 * k as f64 / RATE_HZ).sin();
        let demand = Trajectory {
            dt_s: (0..samples).map(|k| (k > 0).then_some(1.0 / RATE_HZ)).collect(),
            displacement_m: (0..samples).map(displacement_m).collect(),
            // More than the damper can give, so the current is the same at any temperature.
            force_n: (0..samples).map(|k| 9e3 * (10.0 * k as f64 / RATE_HZ).cos()).collect(),
            case_temp_c: vec![case_temp_c; samples],
        };
        let controller = InverseController::new(model, Limits::default()).expect("it follows a current");
        let points = on_model(model, &controller, &demand).expect("it needs no velocity");
        points.iter().map(|point| point.achieved.get()).filter(|n| n.is_finite()).fold(0.0, f64::max)
    };
    let plain_n = achieved_n(&plain, f64::NAN);
    assert!((achieved_n(&fading, f64::NAN) / plain_n - 1.0).abs() < 1e-9);
    assert!((achieved_n(&fading, 45.0) / plain_n - 0.9).abs() < 0.02, "20 K at 0.5 % per kelvin");
}
