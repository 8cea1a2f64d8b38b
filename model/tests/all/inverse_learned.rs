//! Learned inverse models: their identification, their use by the inverse controller, and how well it follows a demanded force with them.

use crate::common::with_learned;
use crate::inverse_support::{demand, error, folded, fuzzy_tanh, inputs, with};
use mr_damper_model::effect::Effect;
use mr_damper_model::force::{Inputs, NetworkStructure, Normalisation};
use mr_damper_model::identify::{
    Form, Identified, ModelSpec, Options, Structure, Watch, identify, identify_inverse, score_inverse,
};
use mr_damper_model::inverse::{
    Demand, InverseController, InverseKind, InverseModel, InverseNetwork, InverseScaling, InverseState,
    Limits, Method,
};
use mr_damper_model::model::Model;
use mr_damper_model::preset;
use mr_damper_model::rig::signal::RATE_HZ;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::{DriveKind, Run, Stamp, Trace};
use mr_damper_model::units::Second;

const LEARNED: [Method; 3] = [Method::Chen, Method::WangLiao, Method::WangHu];

fn controller(model: &Model, method: Method) -> InverseController {
    InverseController::with_method(model, Limits::default(), method).expect("a model with this inverse")
}

/// `model` with an inverse network that has one neuron: i_k = 1 A + 0.5 A * 4 tanh(0.1 (i_{k-1} - 1 A) / 0.5 A + 0.4 (F_k - 30 N) / 500 N).
fn with_one_neuron(model: Model) -> Model {
    let (structure, hidden) = (NetworkStructure::Chen, 25);
    let mut weights = vec![0.0; structure.weights(true)];
    // Inputs: x_k, x_{k-1}, v_k, v_{k-1}, F_k, F_{k-1}, i_{k-1}; then b, then c.
    (weights[4 * hidden], weights[6 * hidden], weights[8 * hidden]) = (0.4, 0.1, 4.0);
    let of = |mean, deviation| Normalisation { mean, deviation };
    let scaling = InverseScaling {
        displacement_m: of(0.0, 1.0),
        velocity_m_s: of(0.0, 1.0),
        force_n: of(30.0, 500.0),
        current_a: of(1.0, 0.5),
    };
    let network =
        InverseNetwork::new(structure, scaling, &weights, Second(1.0 / RATE_HZ)).expect("a network");
    Model { inverse: Some(InverseModel::Network(network)), ..model }
}

fn one_neuron_a(last_a: f64, force_n: f64) -> f64 {
    1.0 + 0.5 * 4.0 * (0.1 * (last_a - 1.0) / 0.5 + 0.4 * (force_n - 30.0) / 500.0).tanh()
}

/// Sample `k` of a sine, far from rest in the samples that count.
fn sine(k: u32) -> Inputs {
    let (sin, cos) = (12.0 * f64::from(k) / RATE_HZ).sin_cos();
    Inputs {
        dt_s: (k > 0).then_some(1.0 / RATE_HZ),
        acceleration_m_s2: -2.2 * cos,
        ..inputs(0.015 * cos, -0.18 * sin)
    }
}

#[test]
fn the_command_is_the_learned_current_with_the_limited_current_fed_back() {
    let model = with_one_neuron(fuzzy_tanh());
    let offset_n = model.force.force_offset_n();
    let limits = Limits { rate_max_a_s: 20.0, ..Limits::default() };
    let mut controller =
        InverseController::with_method(&model, limits, Method::Chen).expect("it has this inverse");
    let (mut last_a, mut compared, mut cut) = (limits.safe_a, 0, 0);
    for k in 0..500 {
        let at = sine(k);
        let demand_n = -700.0 * (12.0 * f64::from(k) / RATE_HZ).sin() + 200.0 * f64::from(k / 40).sin();
        let command = controller.step(&at, Demand::Force(demand_n), None);
        if command.is_achievable && !command.substituted && at.velocity_m_s.abs() > 0.03 {
            let learned_a = one_neuron_a(last_a, demand_n - offset_n).clamp(0.0, 2.5);
            let most_a = 20.0 / RATE_HZ;
            let expected_a = learned_a.clamp(last_a - most_a, last_a + most_a);
            assert!((command.current.get() - expected_a).abs() < 1e-9, "{k}: {command:?} {expected_a}");
            (compared, cut) = (compared + 1, cut + u32::from(expected_a != learned_a));
        }
        last_a = command.current.get();
    }
    assert!(compared > 150 && cut > 10 && compared - cut > 30, "{compared} {cut}");
}

#[test]
fn a_coil_lag_gets_no_lead_and_added_forces_are_not_subtracted() {
    let plain = with_one_neuron(fuzzy_tanh());
    for effects in [
        [(Effect::CoilLag, [0.012].as_slice())].as_slice(),
        &[(Effect::GasSpring, [3e3].as_slice())],
        &[(Effect::SeriesSpring, [2e-7].as_slice())],
    ] {
        let more = Model { effects: with(effects).effects, ..plain };
        let [mut alone, mut beside] = [&plain, &more].map(|model| controller(model, Method::Chen));
        let (mut streak, mut compared) = (0, 0);
        for k in 0..500 {
            let demand_n = -700.0 * (12.0 * f64::from(k) / RATE_HZ).sin();
            let [a, b] = [&mut alone, &mut beside]
                .map(|controller| controller.step(&sine(k), Demand::Force(demand_n), None));
            // The past currents are the same only if both demands have been within the range for a while.
            let both = a.is_achievable && b.is_achievable && !a.substituted && !b.substituted;
            streak = if both { streak + 1 } else { 0 };
            if streak > 30 {
                compared += 1;
                assert!((a.current.get() - b.current.get()).abs() < 1e-6, "{effects:?} {k}: {a:?} {b:?}");
            }
        }
        assert!(compared > 60, "{effects:?} {compared}");
    }
}

/// After a gap, a swap, a sample without a demand, and at another rate.
#[test]
fn the_search_answers_while_the_history_is_incomplete() {
    for (method, incomplete) in [(Method::Chen, 1), (Method::WangLiao, 5), (Method::WangHu, 0)] {
        let model = with_learned(fuzzy_tanh(), method.learned().expect("a learned inverse"));
        // Step 300 of 600 is at the largest speed, and its demand is in the middle of the range.
        let demand_n = |at: &Inputs| 4500.0 * at.velocity_m_s;
        let substituted = |change: &dyn Fn(u32, Inputs, &mut InverseController) -> (Inputs, Demand)| {
            let mut controller = controller(&model, method);
            let mut found = Vec::new();
            for k in 0..600 {
                let (at, demand) = change(k, sine(k), &mut controller);
                let command = controller.step(&at, demand, None);
                let range = command.achievable.map(|n| n.get());
                let inside = range[0] < demand_n(&at) && demand_n(&at) < range[1];
                if command.substituted {
                    assert!(inside, "{k}");
                    found.push(k);
                }
            }
            found
        };
        let follow = |at: Inputs| (at, Demand::Force(demand_n(&at)));
        let within =
            |found: &[u32], from: u32| found.iter().filter(|k| (from..from + 20).contains(k)).count();
        let never = substituted(&|_, at, _| follow(at));
        assert!(never.iter().all(|k| *k < incomplete), "{method:?} {never:?}");
        let gap = substituted(&|k, at, _| follow(if k == 70 { Inputs { dt_s: None, ..at } } else { at }));
        assert_eq!(within(&gap, 70), incomplete as usize, "{method:?}: a gap");
        let silent = substituted(&|k, at, _| if k == 70 { (at, Demand::None) } else { follow(at) });
        assert_eq!(within(&silent, 71), incomplete as usize, "{method:?}: no demand");
        let swapped = substituted(&|k, at, controller| {
            if k == 70 {
                let mut new = self::controller(&model, method);
                new.inherit(controller);
                *controller = new;
            }
            follow(at)
        });
        assert_eq!(within(&swapped, 70), incomplete as usize, "{method:?}: a swap");
        let slow = substituted(&|k, at, _| follow(Inputs { dt_s: (k > 0).then_some(2.0 / RATE_HZ), ..at }));
        assert_eq!(slow.len() > 200, incomplete > 0, "{method:?}: half the rate, {}", slow.len());
    }
}

#[test]
fn at_another_rate_the_commands_are_those_of_the_search() {
    // The current of the search is the current in the fluid, so it is led.
    let model = with_learned(with(&[(Effect::CoilLag, &[0.012])]), InverseKind::Chen);
    let [mut learned, mut search] = [Method::Chen, Method::Search].map(|method| controller(&model, method));
    for k in 0..300 {
        let at = Inputs { dt_s: (k > 0).then_some(2.0 / RATE_HZ), ..sine(k) };
        let demand = Demand::Force(-700.0 * (12.0 * f64::from(k) / RATE_HZ).sin());
        let [a, b] = [&mut learned, &mut search].map(|controller| controller.step(&at, demand, None));
        assert!((a.current.get() - b.current.get()).abs() < 1e-3, "{k}: {a:?} {b:?}");
    }
}

#[test]
fn a_model_without_the_inverse_refuses_the_method_with_what_to_do() {
    let refused = |model: &Model, method: Method| {
        let found = InverseController::with_method(model, Limits::default(), method).map(|_| ());
        found.expect_err("refused").to_string()
    };
    assert_eq!(
        refused(&fuzzy_tanh(), Method::Chen),
        "no inverse of the fuzzy-tanh model: it has no inverse model chen in its file; identify it with the model: \
         `mr-damper identify --inverse chen --model NAME RUN... --out MODEL.toml`, or use search"
    );
    assert_eq!(
        refused(&with_learned(fuzzy_tanh(), InverseKind::WangHu), Method::WangLiao),
        "no inverse of the fuzzy-tanh model: it has the inverse model wang-hu in its file, not wang-liao; identify it with the model: \
         `mr-damper identify --inverse wang-liao --model NAME RUN... --out MODEL.toml`, or use wang-hu"
    );
    let arx = preset::load(preset::BEST_ARX).expect("a preset");
    let other_rate = Model { rate_hz: 1024.0, ..fuzzy_tanh() };
    for method in LEARNED {
        let kind = method.learned().expect("a learned inverse");
        let said = refused(&with_learned(arx, kind), method);
        assert!(said.contains("autoregressive in force") && said.contains(kind.name()), "{said}");
        let said = refused(&with_learned(folded(), kind), method);
        assert!(said.contains("one force at several currents") && said.ends_with("use search"), "{said}");
        let found =
            InverseController::with_method(&with_learned(other_rate, kind), Limits::default(), method);
        match (kind.network(), found) {
            (None, found) => assert!(found.is_ok(), "rules have no memory"),
            (Some(_), found) => assert_eq!(
                found.map(|_| ()).expect_err("refused").to_string(),
                format!(
                    "no inverse of the fuzzy-tanh model: it has an inverse model {} for 512.000000 Hz, but its own rate is 1024.000000 Hz; \
                     identify both from the same runs",
                    kind.name()
                )
            ),
        }
    }
}

/// A run of `seconds` at 500 Hz whose force is `force_n(v, i)`, with a current that varies smoothly.
fn run_of(seconds: f64, phase: f64, force_n: impl Fn(f64, f64) -> f64) -> Run {
    let times = || (0..(500.0 * seconds) as u32).map(|k| f64::from(k) / 500.0);
    let trace = |value: &dyn Fn(f64) -> f64| Trace {
        stamps: times().map(|t| Stamp::from_nanos((t * 1e9).round() as i64)).collect(),
        values: times().map(value).collect(),
    };
    let v = move |t: f64| 0.12 * (9.0 * t + phase).cos() + 0.06 * (23.0 * t).cos();
    let x = move |t: f64| 0.12 / 9.0 * (9.0 * t + phase).sin() + 0.06 / 23.0 * (23.0 * t).sin();
    let i = move |t: f64| 1.2 + 0.9 * (3.1 * t + phase).sin();
    Run {
        name: "made".to_owned(),
        displacement_m: trace(&x),
        velocity_m_s: Some(trace(&v)),
        force_n: Some(trace(&|t| force_n(v(t), i(t)))),
        drive: Some((DriveKind::CoilCurrent, trace(&i))),
        ..Run::default()
    }
}

fn identified(runs: &[Run], options: &Options) -> Identified {
    identify(ModelSpec::FUZZY_TANH, runs, options, &Watch::none()).expect("good runs")
}

/// F = 2000 N s/m v + 150 N/A i + offset has the linear inverse i = (F - offset - 2000 v) / 150. The offset of each run is given.
#[test]
fn a_linear_inverse_is_found_exactly_by_rules_and_closely_by_networks() {
    let conditioning = mr_damper_model::condition::Conditioning {
        velocity: mr_damper_model::condition::VelocitySource::Measured,
        ..Default::default()
    };
    let options = Options { conditioning, choose_velocity: false, restarts: 8, ..Options::default() };
    let force_n = |offset_n: f64| move |v: f64, i: f64| 2000.0 * v + 150.0 * i + offset_n;
    let runs = [run_of(10.0, 0.0, force_n(40.0)), run_of(10.0, 2.0, force_n(-25.0))];
    let mut found = identified(&runs, &options);
    (found.runs[0].force_offset_n, found.runs[1].force_offset_n) = (40.0, -25.0);
    for (kind, most_a) in
        [(InverseKind::WangHu, 1e-4), (InverseKind::Chen, 0.05), (InverseKind::WangLiao, 0.05)]
    {
        let inverse =
            identify_inverse(kind, &found, &runs, &options, &Watch::none()).expect("a varying current");
        let training = inverse.training.expect("it moves");
        println!("{}: {training:?}", kind.name());
        assert!(training.rmse_a < most_a && training.nmse < (most_a / 0.6).powi(2), "{kind:?} {training:?}");
        assert!(training.samples > 8000 && inverse.warnings.is_empty(), "{inverse:?}");
        let model = Model { force: found.model.force.with_force_offset_n(7.0), ..found.model };
        let held_out = [run_of(6.0, 1.0, force_n(7.0))];
        let fit = score_inverse(&inverse.model, &model, &held_out, &options.dataset).expect("a current");
        assert!(fit.expect("it moves").rmse_a < 2.0 * most_a, "{kind:?} {fit:?}");
    }
    // The closed form, at a motion that no run has.
    let inverse =
        identify_inverse(InverseKind::WangHu, &found, &runs, &options, &Watch::none()).expect("as before");
    let at = Inputs { acceleration_m_s2: 0.3, ..inputs(0.0, 0.05) };
    let current_a = inverse.model.step(&mut InverseState::default(), &at, 300.0).expect("no memory");
    assert!((current_a - (300.0 - 100.0) / 150.0).abs() < 1e-3, "{current_a}");
}

#[test]
fn runs_that_cannot_teach_are_refused() {
    let options = Options { restarts: 1, ..Options::default() };
    let runs = [run_of(8.0, 0.0, |v, i| (300.0 + 400.0 * i) * (20.0 * v).tanh())];
    let found = identified(&runs, &options);
    let refused = |kind, found: &Identified, runs: &[Run]| {
        identify_inverse(kind, found, runs, &options, &Watch::none()).expect_err("refused").to_string()
    };
    let mut constant = runs[0].clone();
    if let Some((_, current)) = &mut constant.drive {
        current.values.fill(1.25);
    }
    let passive = ModelSpec::new(Structure::FuzzyTanh, Form::Passive)
        .or_else(|_| ModelSpec::named("sp", Form::Passive))
        .expect("a passive form");
    let passive = identify(passive, &runs, &options, &Watch::none()).expect("a good run");
    for kind in InverseKind::ALL {
        let said = refused(kind, &found, std::slice::from_ref(&constant));
        assert!(said.contains("current_a") && said.contains("1.25"), "{said}");
        assert_eq!(
            refused(kind, &passive, &runs),
            format!(
                "an inverse model {} needs a force model with the coil current as input, but the input of this {} model is motion alone; \
                 identify from runs with current_a, without --passive",
                kind.name(),
                passive.model.force.name()
            )
        );
        let short = [run_of(0.6, 0.0, |v, i| (300.0 + 400.0 * i) * (20.0 * v).tanh())];
        let said = refused(kind, &found, &short);
        assert!(said.contains("samples"), "{said}");
        let without = Run { drive: None, ..runs[0].clone() };
        let inverse = with_learned(fuzzy_tanh(), kind).inverse.expect("an inverse");
        let said =
            score_inverse(&inverse, &found.model, &[without], &options.dataset).expect_err("no current");
        assert!(said.to_string().contains("current_a"), "{said}");
    }
    // A current that does not move the force leaves nothing to learn.
    let idle = [run_of(8.0, 0.0, |v, _| 700.0 * (20.0 * v).tanh())];
    let inverse =
        identify_inverse(InverseKind::WangHu, &found, &idle, &options, &Watch::none()).expect("it fits");
    let training = inverse.training.expect("it moves");
    assert!(training.nmse > 0.5, "{training:?}");
}

/// The figures of the table in node/docs/guide/06-inverse-control.md: learned inverses of one run of 21 s.
#[test]
fn learned_inverses_follow_a_demand_on_a_damper_that_differs_from_the_model() {
    let plant = Plant::default();
    let run = |seed| {
        let experiment = Experiment::thesis("RP-APRBS").expect("a thesis experiment").with_duration_s(21.0);
        record(&experiment, &plant, &Channels::default(), seed)
    };
    let options = Options { restarts: 3, ..Options::default() };
    let (runs, held_out) = ([run(1)], [run(2)]);
    let found = identified(&runs, &options);
    let options = Options { restarts: 25, ..options };
    let demands = [
        Experiment::sine(0.01, 2.0, 0.0, 11.0),
        Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(11.0),
    ]
    .map(|experiment| demand(&experiment, &plant));
    // Error limits of the current, over its variance on the held-out run; and of the force, feedforward only and with feedback, on a sine
    // and on a road up to 20 Hz.
    let table = [
        (Method::Chen, 0.25, [0.06, 0.035, 0.10, 0.055]),
        (Method::WangLiao, 0.25, [0.08, 0.06, 0.14, 0.09]),
        (Method::WangHu, 0.36, [0.09, 0.04, 0.11, 0.065]),
    ];
    for (method, most_nmse, limits) in table {
        let kind = method.learned().expect("a learned inverse");
        let inverse = identify_inverse(kind, &found, &runs, &options, &Watch::none()).expect("it varies");
        let model = Model { inverse: Some(inverse.model), ..found.model };
        let fit = score_inverse(&inverse.model, &model, &held_out, &options.dataset);
        let fit = fit.expect("a current").expect("it moves");
        let errors = [(0, false), (0, true), (1, false), (1, true)]
            .map(|(which, feedback)| error((&model, method), &demands[which], &plant, feedback));
        println!(
            "{}: {errors:.4?}; held-out current RMSE {:.3} A, NMSE {:.3}",
            method.name(),
            fit.rmse_a,
            fit.nmse
        );
        assert!(fit.nmse < most_nmse && inverse.warnings.is_empty(), "{method:?} {fit:?}");
        assert!(errors.iter().zip(&limits).all(|(error, limit)| error <= limit), "{method:?} {errors:?}");
    }
}
