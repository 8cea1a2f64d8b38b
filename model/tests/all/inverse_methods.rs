//! The methods of the inverse controller: each keeps its limits, follows a demanded force within its accuracy, and rejects models that it
//! cannot approximate.

use crate::common::{for_method, maxwell_slip};
use crate::inverse_support::{
    TIGHT, bouc_wen, choi, demand, error, folded, fuzzy_tanh, inputs, keeps_its_limits, with,
};
use mr_damper_model::effect::{AugmentedState, Effect};
use mr_damper_model::force::{ForceLaw, Inputs};
use mr_damper_model::identify::{Form, ModelSpec, Options, Structure, Watch, identify};
use mr_damper_model::inverse::{Demand, InverseController, LimitedBy, Limits, Method, Moment, Solver};
use mr_damper_model::model::Model;
use mr_damper_model::preset;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::units::{Ampere, Newton};

const SURROGATES: [Method; 2] = [Method::Polynomial, Method::Fuzzy];

fn controller(model: &Model, method: Method) -> InverseController {
    InverseController::with_method(model, Limits::default(), method).expect("a model it can approximate")
}

#[test]
fn every_method_keeps_its_limits_and_never_drives_the_rod_for_any_input() {
    let models = [
        fuzzy_tanh(),
        with(&[(Effect::CoilLag, &[0.012]), (Effect::GasSpring, &[2e3])]),
        bouc_wen(),
        maxwell_slip(),
        Model { effects: with(&[(Effect::Friction, &[30.0])]).effects, ..choi() },
    ];
    for (model, seed) in models.iter().zip(0..) {
        for method in Method::ALL {
            let model = for_method(*model, method);
            let controller =
                InverseController::with_method(&model, TIGHT, method).expect("a model it can approximate");
            let commanded = keeps_its_limits(controller, 10_000, seed);
            // A law with state has no force after a displacement of 1e300 m until it restarts.
            assert!(commanded > 1000, "{}: {commanded}", method.name());
        }
    }
}

#[test]
fn surrogates_report_their_accuracy() {
    assert_eq!(controller(&fuzzy_tanh(), Method::Search).fit(), None);
    // Limits of the error of the current, A, and of the force, as a share of the largest force.
    let table = [
        ("fuzzy-tanh", fuzzy_tanh(), [(0.51, 0.042), (0.22, 0.022)]),
        ("bouc-wen", bouc_wen(), [(0.56, 0.11), (0.31, 0.05)]),
        // Choi's model has exactly the form of the polynomial.
        ("choi", choi(), [(1e-6, 1e-6), (0.30, 0.035)]),
    ];
    for (name, model, limits) in table {
        for (method, (most_a, most)) in SURROGATES.into_iter().zip(limits) {
            let fit = *controller(&model, method).fit().expect("a surrogate's fit");
            println!("{name} {}: {:.3} A, {:.4}", method.name(), fit.current.get(), fit.force_share());
            assert!(fit.current.get() < most_a && fit.force_share() < most, "{name} {method:?}: {fit:?}");
            // The surrogate gives a current at nearly all points.
            assert!(fit.points[0] * 20 > fit.points[1] * 18 && fit.points[1] > 1500, "{fit:?}");
        }
    }
}

/// Commands along a sine with a demanded force well within the achievable range.
fn along_a_sine(controller: &InverseController, mut see: impl FnMut(f64, f64, f64)) {
    let (mut controller, mut soft) = (*controller, *controller);
    for k in 0..600 {
        let t = f64::from(k) / 512.0;
        let (sin, cos) = (12.0 * t).sin_cos();
        let mut at = inputs(0.015 * cos, -0.18 * sin);
        at.acceleration_m_s2 = -0.18 * 12.0 * cos;
        let [low, high] = soft.step(&at, Demand::Current(0.0), None).achievable.map(|n| n.get());
        let demand_n = low + (0.5 + 0.4 * (5.0 * t).sin()) * (high - low);
        let command = controller.step(&at, Demand::Force(demand_n), None);
        if command.is_achievable && sin.abs() > 0.1 {
            see(demand_n, command.expected.get(), command.current.get());
        }
    }
}

#[test]
fn the_closed_form_agrees_with_a_search() {
    let controller = controller(&choi(), Method::Search);
    assert!(controller.shape().is_some_and(|shape| shape.is_linear()));
    let mut seen = 0;
    along_a_sine(&controller, |demand_n, expected_n, current_a| {
        seen += 1;
        assert!((0.0..=2.5).contains(&current_a));
        assert!((expected_n - demand_n).abs() < 1e-6, "{expected_n} for {demand_n} N");
    });
    assert!(seen > 300, "{seen}");
    let augmented = choi().augmented();
    let closed = Solver { current_max_a: 2.5, folded: false, linear: true };
    for k in 0..200 {
        let (sin, cos) = f64::from(k).sin_cos();
        let at = Inputs { acceleration_m_s2: -2.0 * cos, ..inputs(0.015 * cos, -0.18 * sin) };
        let mut state = AugmentedState::default();
        let (force_n, moment) = Moment::step(&augmented, &mut state, &at, 1.0).expect("finite");
        let current_a = |solver: Solver| {
            let last = (Ampere(1.0), Newton(force_n));
            solver.solve(&moment, -800.0 * sin, last).expect("finite").current_a
        };
        let searched_a = current_a(Solver { linear: false, ..closed });
        assert!((current_a(closed) - searched_a).abs() < 1e-3, "{at:?}");
    }
    for model in [fuzzy_tanh(), bouc_wen(), maxwell_slip(), folded()] {
        let shape = *self::controller(&model, Method::Search).shape().expect("a shape");
        assert!(!shape.is_linear() && shape.bend_n > 1e-3, "{shape:?}");
    }
}

#[test]
fn a_model_with_bristles_is_monotonic_in_the_current_and_searched_on_its_state() {
    let controller = controller(&maxwell_slip(), Method::Search);
    assert_eq!(controller.shape().and_then(|shape| shape.real_fold()), None);
    let mut seen = 0;
    along_a_sine(&controller, |demand_n, expected_n, current_a| {
        seen += 1;
        assert!((0.0..=2.5).contains(&current_a));
        assert!((expected_n - demand_n).abs() < 1.0, "{expected_n} for {demand_n} N");
    });
    assert!(seen > 300, "{seen}");
}

#[test]
fn the_expected_force_of_a_surrogate_is_the_models_force() {
    // The expected force comes from the model, so it shows the error of the surrogate.
    for method in SURROGATES {
        let (mut squares, mut seen, mut farthest_n) = (0.0, 0.0, 0.0_f64);
        along_a_sine(&controller(&fuzzy_tanh(), method), |demand_n, expected_n, _| {
            squares += (expected_n - demand_n).powi(2);
            seen += 1.0;
            farthest_n = farthest_n.max((expected_n - demand_n).abs());
        });
        let rms_n = f64::sqrt(squares / seen);
        println!("{}: {rms_n:.1} N, {farthest_n:.1} N at most", method.name());
        assert!((5.0..70.0).contains(&rms_n) && seen > 300.0, "{rms_n} {seen}");
    }
}

#[test]
fn the_achievable_range_is_the_same_for_every_method() {
    let model =
        with(&[(Effect::CoilLag, &[0.012]), (Effect::Friction, &[40.0]), (Effect::GasSpring, &[2e3])]);
    let at = |x_m: f64, v_m_s: f64, demand_n: f64, method: Method| {
        controller(&model, method).step(&inputs(x_m, v_m_s), Demand::Force(demand_n), None)
    };
    let mut reasons = Vec::new();
    for (x_m, v_m_s) in [(0.0, 0.1), (0.012, -0.15), (-0.01, 0.05), (0.0, -0.02), (0.005, 1e-3)] {
        for demand_n in [-9e3, -1500.0, -500.0, -20.0, 0.0, 20.0, 500.0, 1500.0, 9e3] {
            let searched = at(x_m, v_m_s, demand_n, Method::Search);
            reasons.push(searched.limited_by);
            for method in SURROGATES {
                let command = at(x_m, v_m_s, demand_n, method);
                if searched.is_achievable {
                    assert_eq!(command.achievable, searched.achievable);
                } else {
                    assert_eq!(command, searched, "{method:?} {x_m} {v_m_s}");
                }
            }
        }
    }
    for reason in [LimitedBy::None, LimitedBy::CurrentMax, LimitedBy::CurrentMin, LimitedBy::Passivity] {
        assert!(reasons.contains(&reason), "{reason:?}");
    }
}

#[test]
fn forces_added_by_effects_are_subtracted_from_the_demand() {
    // The current is the same for the same force of the fluid, with and without effects in parallel.
    let effects: [(Effect, &[f64]); 2] = [(Effect::GasSpring, &[3e3]), (Effect::Friction, &[60.0])];
    for bare in [fuzzy_tanh(), bouc_wen(), maxwell_slip()] {
        let more = Model { effects: with(&effects).effects, ..bare };
        for method in SURROGATES {
            let (mut alone, mut beside) = (controller(&bare, method), controller(&more, method));
            let (mut last_a, mut compared) = (0.0, 0);
            for k in 0..600 {
                let (sin, cos) = (12.0 * f64::from(k) / 512.0).sin_cos();
                let at = Inputs { drive: last_a, ..inputs(0.015 * cos, -0.18 * sin) };
                let fluid_n = -600.0 * sin;
                // The added force is the difference of the achievable forces.
                let (mut look, mut look_beside) = (alone, beside);
                let [without_n, with_n] = [&mut look, &mut look_beside]
                    .map(|look| look.step(&at, Demand::Current(1.0), None).achievable[0].get());
                let added_n = with_n - without_n;
                let of_alone = alone.step(&at, Demand::Force(fluid_n), None);
                let of_beside = beside.step(&at, Demand::Force(fluid_n + added_n), None);
                last_a = of_alone.current.get();
                if of_alone.is_achievable && of_beside.is_achievable && added_n.abs() > 5.0 && sin.abs() > 0.1
                {
                    compared += 1;
                    assert!((of_beside.current.get() - last_a).abs() < 1e-6, "{of_alone:?} {of_beside:?}");
                }
            }
            assert!(compared > 200, "{compared}");
        }
    }
}

#[test]
fn surrogates_reject_models_that_are_not_functions_of_motion_and_force() {
    let arx = preset::load(preset::BEST_ARX).expect("a preset");
    let spring = with(&[(Effect::GasSpring, &[1e3]), (Effect::SeriesSpring, &[2e-7])]);
    for (model, why) in [
        (arx, "arx model: it is autoregressive in force"),
        (folded(), "one force at several currents (the force turns back by 998"),
        (spring, "(series_spring), which does more than add a force"),
    ] {
        assert!(InverseController::new(&model, Limits::default()).is_ok(), "a search takes it");
        for method in SURROGATES {
            let refused = InverseController::with_method(&model, Limits::default(), method).map(|_| ());
            let refused = refused.expect_err("refused").to_string();
            assert!(refused.contains(why), "{refused}");
            assert!(refused.contains(method.name()) && refused.ends_with("use search"), "{refused}");
        }
    }
}

#[test]
fn each_method_follows_a_demand_on_a_damper_that_differs_from_the_model() {
    let plant = Plant::default();
    let experiment = Experiment::thesis("RP-APRBS").expect("a thesis experiment").with_duration_s(21.0);
    let run = [record(&experiment, &plant, &Channels::default(), 1)];
    let options = Options { restarts: 3, ..Options::default() };
    let found = |spec| identify(spec, &run, &options, &Watch::none()).expect("a good run").model;
    let choi = ModelSpec::new(Structure::Law(ForceLaw::Choi), Form::SemiActive).expect("a form of the law");
    let (tanh, choi) = (found(ModelSpec::FUZZY_TANH), found(choi));
    let demands = [
        Experiment::sine(0.01, 2.0, 0.0, 11.0),
        Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(11.0),
    ]
    .map(|experiment| demand(&experiment, &plant));
    // Error limits: feedforward only and with feedback, on a sine and on a road up to 20 Hz.
    let table = [
        ("fuzzy-tanh", &tanh, Method::Search, [0.07, 0.04, 0.09, 0.06]),
        ("fuzzy-tanh", &tanh, Method::Polynomial, [0.11, 0.05, 0.12, 0.065]),
        ("fuzzy-tanh", &tanh, Method::Fuzzy, [0.10, 0.055, 0.11, 0.07]),
        // A less accurate model, but inverted exactly in closed form.
        ("choi", &choi, Method::Search, [0.08, 0.035, 0.125, 0.07]),
        ("choi", &choi, Method::Fuzzy, [0.12, 0.05, 0.15, 0.09]),
    ];
    for (name, model, method, limits) in table {
        let errors = [(0, false), (0, true), (1, false), (1, true)]
            .map(|(which, feedback)| error((model, method), &demands[which], &plant, feedback));
        println!("{name} {}: {errors:.4?}", method.name());
        assert!(errors.iter().zip(&limits).all(|(error, limit)| error <= limit), "{name} {method:?}");
    }
}
