//! `Pipeline::step`, `Pipeline::tick`, `Pipeline::take` and `InverseController::step` never allocate. A guard aborts the test process at the first
//! allocation.
//!
//! This is a binary of its own, because the guard is the allocator of the whole process, and an abort would also end all other tests.

#[path = "all/common/mod.rs"]
mod common;

use assert_no_alloc::{AllocDisabler, assert_no_alloc};
use common::{calibrated, for_method, maxwell_slip, preset, samples};
use mr_damper_model::condition::{ApplyTo, VelocitySource};
use mr_damper_model::effect::term::{Argument, Form, Modulator, Term, Terms};
use mr_damper_model::effect::{Augmented, AugmentedState, Effect, EffectModel, Effects};
use mr_damper_model::force::{
    Dependence, ForceLaw, ForceModel, FuzzySets, Inputs, LawModel, LawState, Membership,
};
use mr_damper_model::inverse::{self, Demand, InverseController, LimitedBy, Limits, Method};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{Event, Models, Pipeline, PipelineSetup, Settings};
use mr_damper_model::preset::{BEST_ANFIS, BEST_ARX, BEST_FUZZY_TANH};
use mr_damper_model::sample::{DriveKind, Reading, Sample, Stamp};
use mr_damper_model::units::{Metre, MetrePerSecond, Newton};

#[global_allocator]
static GUARD: AllocDisabler = AllocDisabler;

#[test]
fn the_hot_path_does_not_allocate() {
    let mut slope = preset(BEST_FUZZY_TANH);
    slope.conditioning.velocity = VelocitySource::Slope;
    slope.conditioning.apply_to = ApplyTo::Output;
    let both =
        Models::alone(preset(BEST_FUZZY_TANH)).with_seeded(preset(BEST_ARX)).expect("both want a current");
    let anfis = Models::alone(preset(BEST_ANFIS));
    let slips = Models::alone(maxwell_slip());
    let lazy = Models::alone(common::lazy());
    for mut models in [both, Models::alone(preset(BEST_ARX)), Models::alone(slope), anfis, slips, lazy] {
        // The expected error is so small, and the blocks are so short, that the alarm is raised between two of the gaps below.
        models.free.expected.free_run_rsse_n = Some(1.0);
        // The models with a seeded channel get uncertainty tables.
        if models.seeded.is_some() {
            models.free = calibrated(models.free);
            models.seeded = models.seeded.map(calibrated);
        }
        let learns = matches!(models.free.force, ForceModel::Lazy(_));
        let gains = inverse::SkyhookGains::new(&[800.0, 500.0, 300.0], &[0.0, 1.0, 2.5]);
        let settings = Settings {
            alarm_block_s: 0.05,
            false_alarm_interval_s: 60.0,
            lazy_learning: learns,
            ..Settings::default()
        };
        let mut pipeline = Pipeline::new(models, settings).expect("presets run");
        let mut counts = [0_u32; 7];
        let changed = PipelineSetup::new(
            models,
            Settings { law: inverse::ControlLaw::SkyhookGains(gains), ..settings },
        )
        .or_else(|_| PipelineSetup::new(models, Settings { coast_s: 0.1, ..settings }))
        .expect("in range");
        let other = PipelineSetup::new(
            Models::alone(preset("thesis/fuzzy-tanh/rp1-cs")),
            Settings { lazy_learning: false, ..settings },
        )
        .expect("a preset runs");
        assert_no_alloc(|| {
            let mut count = |event: Event| {
                counts[match event {
                    Event::Input(_) => 0,
                    Event::Refusal(_) => 1,
                    Event::Estimate(_) => 2,
                    Event::Residual(_) => 3,
                    Event::Transition(_) => 4,
                    Event::Alarm(_) => 5,
                    Event::Command(_) => 6,
                }] += 1;
            };
            for k in 0..3000_i64 {
                // The force comes and goes, samples are lost and broken, and the clock jumps, so that every kind of event occurs.
                let epoch_ns = if k < 2500 { 10_000_000_000 } else { 0 };
                let stamp = Stamp::from_nanos(epoch_ns + k * common::PERIOD_NS);
                if k % 5 == 0 {
                    let reading = Reading::ForceRequest(Newton(if k % 50 == 0 { f64::NAN } else { 400.0 }));
                    pipeline.step(&Sample { stamp, received: stamp, reading }, &mut count);
                }
                for mut sample in samples(k, epoch_ns) {
                    if matches!(sample.reading, Reading::Force(_)) && k % 700 > 400 {
                        continue;
                    }
                    if matches!(sample.reading, Reading::Displacement(_)) && k % 333 == 0 {
                        sample.reading = Reading::Displacement(Metre(f64::NAN));
                    }
                    if k % 1000 > 900 {
                        continue;
                    }
                    pipeline.step(&sample, &mut count);
                }
                if k % 1000 == 950 {
                    pipeline.tick(Stamp::from_nanos(epoch_ns + (k + 600) * common::PERIOD_NS), &mut count);
                }
            }
            pipeline.note_overload();
            pipeline.note_interleaved();
            pipeline.reset(&mut count);
            pipeline.take(changed, &mut count);
            for k in 0..100_i64 {
                for sample in samples(k, 20_000_000_000) {
                    let reading = Reading::BodyVelocity(MetrePerSecond(0.2));
                    pipeline.step(&Sample { reading, ..sample }, &mut count);
                    pipeline.step(&sample, &mut count);
                }
            }
            pipeline.take(other.clone(), &mut count);
            // A node creates and drops a pipeline on this thread when it is activated and deactivated.
            drop(Pipeline::from(other));
        });
        assert!(counts.iter().all(|n| *n > 0), "every kind of event occurred: {counts:?}");
    }
}

#[test]
fn no_law_allocates() {
    let drive = DriveKind::CoilCurrent;
    let sets = FuzzySets::new(Membership { drive, sigma: 0.4 }, &[0.0, 1.0, 2.0]).expect("sets");
    for law in ForceLaw::ALL {
        for dependence in
            [Dependence::None, Dependence::Polynomial { drive, degree: 2 }, Dependence::Fuzzy(sets)]
        {
            // Any positive coefficients will do.
            let coefficients = vec![1.0; law.parameters().len() * dependence.copies()];
            let model = LawModel::new(law, dependence, &coefficients, 0.0).expect("as many as it takes");
            let mut sum = 0.0;
            assert_no_alloc(|| {
                let mut state = LawState::default();
                for k in 0..100 {
                    let inputs = Inputs {
                        dt_s: (k > 0).then_some(0.002),
                        displacement_m: 1e-4 * f64::from(k),
                        velocity_m_s: 0.05,
                        acceleration_m_s2: f64::from(50 - k),
                        drive: 0.02 * f64::from(k),
                        case_temp_c: f64::NAN,
                    };
                    sum += model.force_n(&inputs, &mut state);
                }
            });
            assert!(sum.is_finite(), "{} {}", law.name(), dependence.name());
        }
    }
}

/// Sample `k` of a sine with a varying drive, with gaps and one sample without displacement.
fn moving(k: u32) -> Inputs {
    let t = 0.002 * f64::from(k);
    Inputs {
        dt_s: (!k.is_multiple_of(130)).then_some(0.002),
        displacement_m: if k == 200 { f64::NAN } else { 0.01 * (20.0 * t).sin() },
        velocity_m_s: 0.2 * (20.0 * t).cos(),
        acceleration_m_s2: -4.0 * (20.0 * t).sin(),
        drive: 1.0 + (7.0 * t).sin(),
        case_temp_c: 40.0,
    }
}

/// An inverse controller with each kind of search (tanh functions alone, with effects, and a model that is tried on copies), with
/// each surrogate that can approximate one of them, and with each learned inverse.
#[test]
fn no_command_allocates() {
    let effect = |effect, parameters: &[f64]| EffectModel::new(effect, parameters).expect("within range");
    let (lag, gas) = (effect(Effect::CoilLag, &[0.012]), effect(Effect::GasSpring, &[1e3]));
    let spring = effect(Effect::SeriesSpring, &[1e-7]);
    let tanh = preset(BEST_FUZZY_TANH);
    let models = [
        (tanh, vec![]),
        (tanh, vec![lag, gas]),
        (tanh, vec![lag, spring]),
        (maxwell_slip(), vec![]),
        (maxwell_slip(), vec![lag, spring]),
    ];
    for (model, effects) in models {
        let model = Model { effects: Effects::new(&effects).expect("few enough"), ..model };
        for method in Method::ALL {
            let model = for_method(model, method);
            let controller = InverseController::with_method(&model, Limits::default(), method);
            let Ok(mut controller) = controller else {
                let surrogate = [Method::Polynomial, Method::Fuzzy].contains(&method);
                assert!(model.effects.as_slice().contains(&spring) && surrogate);
                continue;
            };
            let (mut commanded, mut learned) = (0, 0);
            assert_no_alloc(|| {
                for k in 0..300 {
                    let inputs = Inputs { drive: f64::NAN, case_temp_c: f64::NAN, ..moving(k) };
                    let demand_n = (!k.is_multiple_of(7)).then_some(4500.0 * inputs.velocity_m_s);
                    let command = controller.step(&inputs, Demand::of_force(demand_n), Some(500.0));
                    commanded += u32::from(command.limited_by != LimitedBy::Safe);
                    learned += u32::from(command.limited_by != LimitedBy::Safe && !command.substituted);
                }
            });
            assert!(commanded > 200 && learned > 50, "{}: {commanded} {learned}", method.name());
        }
    }
}

/// Each effect alone, within a spring that tries the model on copies, and between two springs.
#[test]
fn no_effect_allocates() {
    let force = preset(BEST_FUZZY_TANH).force;
    let present = |effect: Effect| {
        // Half of the upper end, or of the lower end if the upper end is zero; any size of the scales will do.
        let value = |p: &mr_damper_model::effect::Parameter| {
            let [low, high] = p.range;
            0.5 * if high > 0.0 { high } else { low }
        };
        let values: Vec<f64> = effect.parameters().iter().map(value).collect();
        EffectModel::new(effect, &values).expect("within range")
    };
    let spring = EffectModel::new(Effect::SeriesSpring, &[1e-7]).expect("within range");
    for effect in Effect::ALL {
        let one = present(effect);
        for mut effects in
            [vec![one], vec![one, spring, present(Effect::SensorDelay)], vec![spring, one, spring]]
        {
            effects.sort_by_key(|effect| effect.is_of_load_cell());
            let effects = Effects::new(&effects).expect("few enough");
            let model = Augmented::new(force, effects).expect("the model has a drive");
            let mut forces = 0;
            assert_no_alloc(|| {
                let mut state = AugmentedState::default();
                for k in 0..300 {
                    forces += u32::from(model.free_run(&mut state, &moving(k)).is_some());
                }
            });
            assert!(forces >= 280, "{}: {forces}", effect.title());
        }
    }
}

/// Each modulator with each argument, with as many terms as a model may have.
#[test]
fn no_term_allocates() {
    let force = preset(BEST_FUZZY_TANH).force;
    for modulator in Modulator::ALL {
        for argument in
            Argument::ALL.into_iter().filter(|q| !(modulator.acts_on_input() && *q == Argument::Force))
        {
            let term = |form, parameters: &[f64]| {
                Term::new((modulator, argument, form), 0.01, parameters, [-1.0, 1.0]).expect("a term")
            };
            let terms =
                [term(Form::Linear, &[]), term(Form::Step, &[0.1, 0.01]), term(Form::Sine, &[0.0, 0.1])];
            let effects = Effects::NONE.with_terms(Terms::new(&terms).expect("few enough"));
            let model = Augmented::new(force, effects).expect("the model has a drive");
            assert_no_alloc(|| {
                let mut state = AugmentedState::default();
                for k in 0..30 {
                    model.free_run(&mut state, &moving(k));
                }
            });
        }
    }
}
