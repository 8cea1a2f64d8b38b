//! Terms: their equation, the signals that they depend on, and their place among the effects.

use super::derivatives::{check, driven_bouc_wen};
use super::*;
use crate::effect::term::{Argument, Form, Modulator, Term, Terms};

/// A range that no argument leaves.
const ANYWHERE: [f64; 2] = [-1e9, 1e9];

fn term(modulator: Modulator, argument: Argument, form: Form, amount: f64, parameters: &[f64]) -> Term {
    Term::new((modulator, argument, form), amount, parameters, ANYWHERE).expect("a term")
}

fn with_terms(force: ForceModel, effects: &[EffectModel], terms: &[Term]) -> Augmented {
    let effects =
        Effects::new(effects).expect("few enough").with_terms(Terms::new(terms).expect("few enough"));
    Augmented::new(force, effects).expect("effects that fit the model")
}

/// Numbers of a form for a displacement argument: clear changes within the motion.
fn numbers(form: Form) -> &'static [f64] {
    match form {
        Form::Constant | Form::Linear | Form::Quadratic => &[],
        Form::HingeAbove | Form::HingeBelow => &[0.001],
        Form::Decay | Form::Growth | Form::Tanh => &[0.004],
        Form::Window | Form::Deadband | Form::Staircase => &[0.003],
        Form::Step | Form::Bump | Form::Ramp => &[-0.002, 0.004],
        Form::Sine => &[0.001, 0.007],
        Form::Resonance => &[12.0, 0.1],
    }
}

/// The form by its equation, written without the numbers that carry derivatives.
fn equation(form: Form, p: &[f64], q: f64) -> f64 {
    match form {
        Form::Constant => 1.0,
        Form::Linear => q,
        Form::Quadratic => q.powi(2),
        Form::Step => 1.0 / (1.0 + (-2.0 * (q - p[0]) / p[1]).exp()),
        Form::HingeAbove => {
            if q > p[0] {
                q - p[0]
            } else {
                0.0
            }
        }
        Form::HingeBelow => {
            if q < p[0] {
                p[0] - q
            } else {
                0.0
            }
        }
        Form::Ramp => ((q - p[0]) / p[1]).clamp(0.0, 1.0),
        Form::Decay => (-q.abs() / p[0]).exp(),
        Form::Growth => (q / p[0]).exp() - 1.0,
        Form::Tanh => (q / p[0]).tanh(),
        Form::Bump => (-((q - p[0]) / p[1]).powi(2)).exp(),
        Form::Window => 1.0 / (1.0 + (-2.0 * (p[0] - q.abs()) / (0.1 * p[0])).exp()),
        Form::Deadband => q.signum() * (q.abs() - p[0]).max(0.0),
        Form::Sine => (std::f64::consts::TAU * (q - p[0]) / p[1]).sin(),
        Form::Staircase => (q / p[0]).floor(),
        Form::Resonance => unreachable!("it has a memory: see the filter's own tests"),
    }
}

#[test]
fn each_form_adds_the_force_of_its_equation() {
    let inputs = motion(600);
    let plain = run(&augmented(tanh(), &[]), &inputs);
    for form in Form::ALL.into_iter().filter(|form| *form != Form::Resonance) {
        let model = with_terms(
            tanh(),
            &[],
            &[term(Modulator::One, Argument::Displacement, form, 40.0, numbers(form))],
        );
        for ((with, without), inputs) in run(&model, &inputs).iter().zip(&plain).zip(&inputs) {
            let expected = 40.0 * equation(form, numbers(form), inputs.displacement_m);
            assert!((with - without - expected).abs() < 1e-9, "{}: {with} {without} {expected}", form.name());
        }
    }
}

#[test]
fn each_modulator_multiplies_the_curve() {
    let inputs = motion(600);
    let plain = run(&augmented(tanh(), &[]), &inputs);
    let sign = |v: f64| (v / 5e-3).tanh();
    for modulator in Modulator::ALL {
        let own = term(modulator, Argument::Displacement, Form::Linear, 3.0, &[]);
        let found = run(&with_terms(tanh(), &[], &[own]), &inputs);
        for ((with, without), at) in found.iter().zip(&plain).zip(&inputs).skip(1) {
            let (by, force_n) = (3.0 * at.displacement_m, without - OFFSET_N);
            let changed = |at: Inputs| run(&augmented(tanh(), &[]), &[Inputs { dt_s: None, ..at }])[0];
            let expected = match modulator {
                Modulator::One => without + by,
                Modulator::Force => without + by * force_n,
                Modulator::ForceInExtension => without + by * force_n * (1.0 + sign(at.velocity_m_s)) / 2.0,
                Modulator::ForceInCompression => without + by * force_n * (1.0 - sign(at.velocity_m_s)) / 2.0,
                Modulator::SignVelocity => without + by * sign(at.velocity_m_s),
                Modulator::Velocity => without + by * at.velocity_m_s,
                Modulator::Displacement => without + by * at.displacement_m,
                Modulator::Acceleration => without + by * at.acceleration_m_s2,
                Modulator::Drive => without + by * at.drive,
                Modulator::DriveSignVelocity => without + by * at.drive * sign(at.velocity_m_s),
                Modulator::ForcePerDrive => changed(Inputs { drive: at.drive + by, ..*at }),
                Modulator::ForcePerVelocity => changed(Inputs { velocity_m_s: at.velocity_m_s + by, ..*at }),
            };
            assert!((with - expected).abs() < 1e-7, "{}: {with} {expected}", modulator.name());
        }
    }
}

/// The values of `argument` over `inputs`: the force that a term adds to a model without force.
fn values(argument: Argument, inputs: &[Inputs]) -> Vec<f64> {
    let force = ForceModel::Law(
        LawModel::new(
            ForceLaw::Sp,
            Dependence::Polynomial { drive: DriveKind::CoilCurrent, degree: 1 },
            &[0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            0.0,
        )
        .expect("a model"),
    );
    run(&with_terms(force, &[], &[term(Modulator::One, argument, Form::Linear, 1.0, &[])]), inputs)
}

/// Up by 10 mm at 20 mm/s, and down again, at 1 kHz; the drive steps after 0.2 s.
fn triangle() -> Vec<Inputs> {
    let at = |k: usize| {
        let t = k as f64 * 1e-3;
        let (x, v) = if k < 500 { (0.02 * t, 0.02) } else { (0.02 - 0.02 * t, -0.02) };
        let drive = if k < 200 { 0.5 } else { 1.5 };
        Inputs {
            dt_s: (k > 0).then_some(1e-3),
            displacement_m: x,
            velocity_m_s: v,
            acceleration_m_s2: 0.0,
            drive,
            case_temp_c: 20.0 + t,
        }
    };
    (0..1000).map(at).collect()
}

#[test]
fn signals_with_a_memory_follow_a_known_motion() {
    let inputs = triangle();
    let near = |argument: Argument, k: usize, expected: f64, within: f64| {
        let found = values(argument, &inputs)[k];
        assert!(
            (found - expected).abs() < within,
            "{} at {k}: {found}, expected {expected}",
            argument.name()
        );
    };
    near(Argument::Time, 999, 0.999, 1e-9);
    near(Argument::Path, 999, 0.02, 1e-4);
    near(Argument::TemperatureRise, 500, 0.5, 1e-9);
    // The first reversal is where the motion begins.
    near(Argument::Travel, 499, 0.00998, 1e-6);
    near(Argument::Travel, 800, -0.006, 5e-5);
    near(Argument::TimeSinceReversal, 800, -0.3, 2e-3);
    near(Argument::TimeSinceReversal, 400, 0.4, 1e-9);
    near(Argument::TimeSinceDriveChange, 150, 0.15, 1e-9);
    near(Argument::TimeSinceDriveChange, 700, 0.5, 1e-9);
    near(Argument::DriveChange, 250, (-1.02_f64).exp(), 2e-2);
    near(Argument::MeanSpeed, 999, 0.02 * (1.0 - (-0.999_f64).exp()), 1e-4);
}

#[test]
fn energy_is_the_work_of_the_force_and_force_is_without_offset() {
    let inputs = triangle();
    let energy = term(Modulator::One, Argument::Energy, Form::Linear, 1.0, &[]);
    let found = run(&with_terms(dashpot(1000.0), &[], &[energy]), &inputs);
    // 20 N at 20 mm/s over a second.
    let added_n = found[999] - run(&augmented(dashpot(1000.0), &[]), &inputs)[999];
    assert!((added_n - 0.4).abs() < 2e-3, "{added_n} J");
    let share = term(Modulator::One, Argument::Force, Form::Linear, 1.0, &[]);
    let doubled = run(&with_terms(dashpot(1000.0), &[], &[share]), &inputs);
    assert!((doubled[100] - (20.0 + 20.0 + OFFSET_N)).abs() < 1e-9, "{}", doubled[100]);
}

#[test]
fn terms_are_around_the_damper_and_inside_of_the_load_cell() {
    let inputs = motion(800);
    let half = term(Modulator::Force, Argument::Time, Form::Constant, -0.5, &[]);
    let (friction, delay) = (with(Effect::Friction, &[80.0]), with(Effect::SensorDelay, &[0.006]));
    let all = with_terms(tanh(), &[friction, delay], &[half]);
    let damper = run(&with_terms(tanh(), &[friction], &[half]), &inputs);
    let plain = run(&augmented(tanh(), &[friction]), &inputs);
    for (with, without) in damper.iter().zip(&plain) {
        assert!((with - (OFFSET_N + 0.5 * (without - OFFSET_N))).abs() < 1e-9, "friction is halved too");
    }
    assert_eq!(
        bits(&run(&Augmented::unchecked(*all.force(), all.effects().of_damper()), &inputs)),
        bits(&damper)
    );
    let late = run(&all, &inputs);
    // Six samples of 1 ms in the middle of a stretch of them.
    assert!((late[180] - damper[174]).abs() < 1e-6, "{} {}", late[180], damper[174]);
}

#[test]
fn a_gap_restarts_terms_and_a_range_that_is_left_is_known() {
    let late =
        Term::new((Modulator::One, Argument::Time, Form::Linear), 1.0, &[], [0.0, 0.1005]).expect("a term");
    let model = with_terms(dashpot(900.0), &[], &[late]);
    let mut state = AugmentedState::default();
    let mut left = Vec::new();
    for (k, inputs) in triangle().iter().enumerate() {
        let inputs = if k == 300 { Inputs { dt_s: None, ..*inputs } } else { *inputs };
        model.free_run(&mut state, &inputs).expect("a force");
        left.push(state.extrapolates());
    }
    let first = |from: usize| left[from..].iter().position(|left| *left).map(|k| from + k);
    assert_eq!((first(0), first(300)), (Some(101), Some(401)));
}

#[test]
fn every_form_and_modulator_has_the_derivatives_of_its_simulation() {
    for form in Form::ALL {
        let one = term(Modulator::Force, Argument::Displacement, form, 0.3, numbers(form));
        check(&with_terms(driven_bouc_wen(), &[], &[one]), form.name());
    }
    for modulator in Modulator::ALL {
        let one = term(modulator, Argument::Time, Form::Tanh, 0.02, &[0.4]);
        let spring = Effect::SeriesSpring.example();
        check(&with_terms(driven_bouc_wen(), &[spring], &[one]), modulator.name());
    }
    for argument in Argument::ALL {
        let one = term(Modulator::SignVelocity, argument, Form::Linear, 0.5, &[]);
        check(&with_terms(driven_bouc_wen(), &[], &[one]), argument.name());
    }
}

#[test]
fn the_lists_are_in_the_order_of_their_types() {
    assert!(
        Modulator::ALL.is_sorted() && Argument::ALL.is_sorted(),
        "the simplest term is chosen by this order"
    );
}

#[test]
fn terms_that_cannot_run_are_refused() {
    let new = |kind, parameters: &[f64], confirmed_in| {
        Term::new(kind, 1.0, parameters, confirmed_in).map_err(|e| e.to_string())
    };
    let (one, time, step) = (Modulator::One, Argument::Time, Form::Step);
    let few = new((one, time, step), &[1.0], ANYWHERE).expect_err("few");
    assert!(few.contains("parameters of the form step"), "{few}");
    let flat = new((one, time, step), &[1.0, 0.0], ANYWHERE).expect_err("a width of zero");
    assert!(flat.contains("widths and scales above zero"), "{flat}");
    let loops =
        new((Modulator::ForcePerDrive, Argument::Force, Form::Linear), &[], ANYWHERE).expect_err("a loop");
    assert!(loops.contains("cannot depend on the force"), "{loops}");
    assert!(new((one, time, Form::Linear), &[], [1.0, 0.0]).is_err(), "a range in the wrong order");
    let drive = term(Modulator::Drive, Argument::Time, Form::Linear, 1.0, &[]);
    let effects = Effects::NONE.with_terms(Terms::new(&[drive]).expect("one"));
    let without = Augmented::new(dashpot(900.0), effects).expect_err("no drive").to_string();
    assert!(without.contains("term"), "{without}");
    assert!(Terms::new(&[drive; 4]).is_err(), "four terms");
}
