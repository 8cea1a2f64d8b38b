//! Identification of the Maxwell-slip model on dampers with hysteresis that are not of its form.

use crate::identify_support::{Recipe, run};
use mr_damper_model::evaluate::evaluate;
use mr_damper_model::force::{Dependence, ForceLaw, ForceModel, Form, Inputs, LawModel, LawState};
use mr_damper_model::identify::{Identified, ModelSpec, Options, Placement, Structure, Watch, identify};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::Settings;
use mr_damper_model::sample::{DriveKind, Run};

const KIND: DriveKind = DriveKind::CoilCurrent;

/// Force of a damper along a motion: its argument is the time step in s, then displacement, velocity and current.
type Step = Box<dyn FnMut(f64, f64, f64, f64) -> f64>;

/// A damper of LuGre's form, integrated in fine steps. Its bristles are soft: it yields within about 2 mm.
fn lugre() -> Step {
    let mut z = 0.0_f64;
    Box::new(move |dt_s, _, v, i| {
        const STIFFNESS_N_M: f64 = 3.0e5;
        const PARTS: u32 = 200;
        let slips_n = |v: f64| (80.0 + 500.0 * i) * (1.0 + 0.25 * (-(v / 0.05).powi(2)).exp());
        let rate = |z: f64| v - STIFFNESS_N_M * v.abs() / slips_n(v) * z;
        for _ in 0..PARTS {
            let h = dt_s / f64::from(PARTS);
            let middle = z + 0.5 * h * rate(z);
            z += h * rate(middle);
        }
        STIFFNESS_N_M * z + 300.0 * rate(z) + (200.0 + 300.0 * i) * v
    })
}

/// The modified Bouc-Wen model with a soft start, whose force and damping grow with the current.
fn bouc_wen() -> Step {
    let none = [100.0, 2e4, 300.0, 200.0, 60.0, 100.0, 1.5, 100.0, 200.0];
    let per_a = [50.0, 1e4, 0.0, 0.0, 600.0, 0.0, 0.0, 0.0, 0.0];
    let dependence = Dependence::Polynomial { drive: KIND, degree: 1 };
    let law = LawModel::new(ForceLaw::BoucWen, dependence, &[none, per_a].concat(), 0.0).expect("in order");
    let mut state = LawState::default();
    let mut moved = false;
    Box::new(move |dt_s, displacement_m, velocity_m_s, drive| {
        let dt_s = std::mem::replace(&mut moved, true).then_some(dt_s);
        let acceleration_m_s2 = f64::NAN;
        let case_temp_c = f64::NAN;
        law.force_n(
            &Inputs { dt_s, displacement_m, velocity_m_s, acceleration_m_s2, drive, case_temp_c },
            &mut state,
        )
    })
}

/// A run of `damper` at currents that change every other second.
fn made(damper: fn() -> Step, seed: u64) -> Run {
    let recipe = Recipe {
        drive: |t| [0.0, 1.0, 0.5, 0.25, 0.75][(t / 2.0) as usize % 5],
        duration_s: 20.0,
        seed,
        ..Recipe::default()
    };
    let step = std::cell::RefCell::new(damper());
    run(recipe, KIND, |x, v, i| (step.borrow_mut())(1.0 / recipe.rate_hz, x, v, i))
}

fn identified(name: &str, form: Form, runs: &[Run], options: &Options) -> Identified {
    let spec = ModelSpec::named(name, form).expect("a form of the model");
    identify(spec, runs, options, &Watch::none()).expect("identifies")
}

/// NMSE of `model` on `run` in simulation.
fn esr(model: Model, run: &Run) -> f64 {
    evaluate(model, run, Settings::default(), |_| true).expect("scores").free_run.expect("a simulation").esr
}

#[test]
fn a_damper_with_hysteresis_is_modelled_where_a_static_base_fails() {
    let options = Options { restarts: 4, ..Options::default() };
    for (damper, most) in [(lugre as fn() -> Step, 0.02), (bouc_wen, 0.02)] {
        let (train, test) = (made(damper, 1), made(damper, 2));
        let train = std::slice::from_ref(&train);
        let base = esr(identified("fuzzy-tanh", Form::SemiActive, train, &options).model, &test);
        let found = identified("maxwell-slip", Form::SemiActive, train, &options);
        assert!(found.converged && found.warnings.is_empty(), "{:?}", found.warnings);
        let slip = esr(found.model, &test);
        println!("NMSE on a fresh run: static {base:.4}, with bristles {slip:.4}");
        assert!(slip < most && slip < 0.1 * base && base > 0.1, "{slip} {base}");
    }
}

#[test]
fn each_form_and_placement_of_the_sets_is_identified() {
    let train = made(lugre, 1);
    let sets = |form, placement| {
        let options = Options { placement, choose_velocity: false, ..Options::default() };
        let found = identified("maxwell-slip", form, std::slice::from_ref(&train), &options);
        let ForceModel::MaxwellSlip(model) = found.model.force else { panic!("asked for it") };
        assert_eq!(model.parameter_count(), 15 * model.functions().len());
        (model.sets().map(|sets| sets.centres().to_vec()), found.free_run.expect("a simulation").esr)
    };
    let (levels, levels_esr) = sets(Form::SemiActive, Placement::FromRuns);
    assert_eq!(levels.expect("sets").len(), 5);
    let (even, _) = sets(Form::SemiActive, Placement::Even(3));
    assert_eq!(even.expect("sets"), [0.0, 0.5, 1.0]);
    let (none, passive_esr) = sets(Form::Passive, Placement::FromRuns);
    assert!(none.is_none() && passive_esr > 3.0 * levels_esr, "{passive_esr} {levels_esr}");
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let runs = [made(lugre, 1), made(lugre, 2), made(lugre, 3)];
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| identified("maxwell-slip", Form::SemiActive, &runs, &Options::default()))
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn unsuitable_options_and_runs_are_refused() {
    let train = made(lugre, 1);
    let refused = |form, runs: &[Run], options: &Options| {
        let spec = ModelSpec::new(Structure::MaxwellSlip, form).expect("a form");
        identify(spec, runs, options, &Watch::none()).expect_err("refused").to_string()
    };
    let plain = Options { choose_velocity: false, ..Options::default() };
    let even = Options { placement: Placement::Even(3), ..plain.clone() };
    let why = refused(Form::Passive, std::slice::from_ref(&train), &even);
    assert!(why.contains("maxwell-slip (passive) has no fuzzy sets"), "{why}");
    let huber =
        Options { loss: mr_damper_model::identify::Loss::Huber { threshold_n: 30.0 }, ..plain.clone() };
    let why = refused(Form::Passive, std::slice::from_ref(&train), &huber);
    assert!(why.contains("least squares only"), "{why}");
    let mut short = made(lugre, 1);
    for trace in [&mut short.displacement_m, short.force_n.as_mut().expect("made")] {
        trace.stamps.truncate(100);
        trace.values.truncate(100);
    }
    let why = refused(Form::Passive, &[short], &plain);
    assert!(why.contains("too few for the 15 coefficients of maxwell-slip"), "{why}");
    for form in [Form::Fuzzy, Form::FreeFuzzy] {
        let why = ModelSpec::new(Structure::MaxwellSlip, form).expect_err("no such form").to_string();
        assert!(why.contains("passive or semi_active"), "{why}");
    }
}
