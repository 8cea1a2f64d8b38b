//! Models with effects from the user's view: the pipeline is bit-identical to a walk over the rows, swaps keep the state that is
//! still valid, and a missing channel is named.

use mr_damper_model::condition::{ApplyTo, VelocitySource};
use mr_damper_model::effect::term::{Argument, Form, Modulator, Term, Terms};
use mr_damper_model::effect::{Effect, EffectModel, Effects};
use mr_damper_model::evaluate::evaluate;
use mr_damper_model::force::{Dependence, ForceLaw, ForceModel, LawModel};
use mr_damper_model::identify::{Dataset, DatasetOptions, Watch, score, walk};
use mr_damper_model::inverse::ControlLaw;
use mr_damper_model::model::{Envelope, Model};
use mr_damper_model::pipeline::{
    Estimate, Event, Mode, Models, Pipeline, PipelineSetup, Reasons, Settings, StampedCommand, UseForce,
    Validity,
};
use mr_damper_model::preset;
use mr_damper_model::sample::{DriveKind, Reading, Run, Sample, Stamp, Trace};
use mr_damper_model::units::Newton;
use std::collections::HashMap;
use std::ops::ControlFlow;

/// Every effect at a size that clearly changes the force.
fn all() -> Vec<EffectModel> {
    Effect::ALL.map(Effect::example).to_vec()
}

fn of(effects: &[EffectModel]) -> Effects {
    Effects::new(effects).expect("few enough")
}

/// The thesis' fuzzy-tanh model with `effects`.
fn fuzzy(effects: &[EffectModel]) -> Model {
    let plain = preset::load(preset::BEST_FUZZY_TANH).expect("a preset");
    Model { effects: of(effects), envelope: Envelope::default(), ..plain }
}

/// Eight seconds at 512 Hz with a jittering rate and two gaps; a current in steps, a temperature at a low rate, and a force with its own
/// stamps.
fn recorded() -> Run {
    let trace = |rate_hz: f64, jitter: i64, value: fn(f64) -> f64| {
        let (mut stamps, mut values) = (Vec::new(), Vec::new());
        for k in 0..(8.0 * rate_hz) as i64 {
            let ns = (k as f64 / rate_hz * 1e9) as i64 + (k * k * 7919) % jitter.max(1);
            let t = ns as f64 * 1e-9;
            if (2.0..2.3).contains(&t) || (5.0..5.5).contains(&t) {
                continue;
            }
            stamps.push(Stamp::from_nanos(ns));
            values.push(value(t));
        }
        Trace { stamps, values }
    };
    Run {
        name: "made".to_owned(),
        displacement_m: trace(512.0, 300_000, |t| 0.008 * (9.0 * t).sin() + 0.002 * (31.0 * t).sin()),
        drive: Some((
            DriveKind::CoilCurrent,
            trace(100.0, 0, |t| [0.4, 1.2, 2.1, 0.8][(t / 0.2) as usize % 4]),
        )),
        force_n: Some(trace(700.0, 100_000, |t| 400.0 * (9.0 * t).cos())),
        case_temp_c: Some(trace(3.0, 0, |t| 25.0 + 2.0 * t)),
        ..Run::default()
    }
}

/// Never seeded and not smoothed: estimates are the simulation (free run) itself.
fn never() -> Settings {
    Settings { use_measured_force: UseForce::Never, bumpless_tau_s: 0.0, ..Settings::default() }
}

/// Stamps and bits of the forces of the free-run channel: the damper's, and the expected readings that a measured force was compared with.
#[derive(Debug, PartialEq)]
struct Live {
    damper: Vec<(Stamp, u64)>,
    readings: Vec<(Stamp, u64)>,
}

fn live(model: Model, run: &Run) -> Live {
    let mut pipeline = Pipeline::new(Models::alone(model), never()).expect("it runs");
    let mut found = Live { damper: Vec::new(), readings: Vec::new() };
    for sample in run.samples() {
        pipeline.step(&sample, &mut |event| match event {
            Event::Estimate(e) if e.mode == Mode::Model => {
                found.damper.push((e.stamp, e.force.get().to_bits()));
            }
            Event::Residual(r) => found.readings.push((r.stamp, r.predicted.get().to_bits())),
            _ => {}
        });
    }
    found
}

/// `model` without the effects of the load cell.
fn damper(model: &Model) -> Model {
    let list = model.effects.as_slice().iter().filter(|effect| !effect.is_of_load_cell());
    let effects = of(&list.copied().collect::<Vec<_>>()).with_terms(*model.effects.terms());
    Model { effects, ..*model }
}

fn walked(model: &Model, run: &Run) -> Vec<(Stamp, u64)> {
    let data = Dataset::from_run(run, &model.conditioning, &DatasetOptions::default()).expect("rows");
    let mut found = Vec::new();
    let done = walk(&model.augmented(), &data, |row, predicted| {
        if predicted.free_run_n.is_finite() {
            found.push((row.stamp, predicted.free_run_n.to_bits()));
        }
        ControlFlow::Continue(())
    });
    assert!(done.is_continue());
    found
}

#[test]
fn the_pipeline_is_bit_identical_to_a_walk_over_the_rows() {
    let run = recorded();
    let effects = all();
    let [lag, filter, spring, fade, delay] = [
        Effect::CoilLag,
        Effect::AntiAliasMismatch,
        Effect::SeriesSpring,
        Effect::ThermalFade,
        Effect::SensorDelay,
    ]
    .map(Effect::example);
    let mut lists: Vec<Vec<EffectModel>> = effects.iter().map(|effect| vec![*effect]).collect();
    lists.push(vec![]);
    // A filter around a spring and a lag, a delay around a spring, and every effect in lists of three.
    lists.push(vec![lag, spring, filter]);
    lists.push(vec![spring, fade, delay]);
    lists.push(vec![EffectModel::new(Effect::SensorDelay, &[-0.005]).expect("within range"), filter]);
    let (of_load_cell, others): (Vec<_>, Vec<_>) =
        effects.iter().partition(|effect| effect.is_of_load_cell());
    lists.extend(
        [others, of_load_cell].iter().flat_map(|effects| effects.chunks(3)).map(<[EffectModel]>::to_vec),
    );
    for list in lists {
        pipeline_equals_walk(&fuzzy(&list), &run, &format!("{list:?}"));
    }
}

#[test]
fn the_pipeline_with_terms_is_bit_identical_to_a_walk_over_the_rows() {
    let run = recorded();
    let drift = Effect::LoadCellDrift.example();
    // Each argument with another modulator, three terms at a time, inside of an effect of the load cell.
    let modulators = Modulator::ALL.into_iter().cycle();
    let pairs = Argument::ALL.into_iter().zip(modulators);
    let terms: Vec<Term> = pairs
        .filter(|(argument, modulator)| !(modulator.acts_on_input() && *argument == Argument::Force))
        .map(|(argument, modulator)| {
            Term::new((modulator, argument, Form::Tanh), 0.02, &[0.3], [-1.0, 1.0]).expect("a term")
        })
        .collect();
    assert!(terms.len() >= 16, "{}", terms.len());
    for terms in terms.chunks(3) {
        let mut model = fuzzy(&[drift]);
        model.effects = model.effects.with_terms(Terms::new(terms).expect("few enough"));
        pipeline_equals_walk(
            &model,
            &run,
            &format!("{:?}", terms.iter().map(Term::kind).collect::<Vec<_>>()),
        );
        let plain = walked(&damper(&fuzzy(&[])), &run);
        assert!(walked(&damper(&model), &run) != plain, "the terms change the force");
    }
}

/// Checks that the pipeline with `model` gives the bits of a walk over the rows of `run`, under each kind of conditioning.
fn pipeline_equals_walk(model: &Model, run: &Run, what: &str) {
    for (apply_to, velocity) in [
        (ApplyTo::Inputs, VelocitySource::Backward),
        (ApplyTo::None, VelocitySource::Slope),
        (ApplyTo::Output, VelocitySource::Slope),
    ] {
        let mut model = *model;
        (model.conditioning.apply_to, model.conditioning.velocity) = (apply_to, velocity);
        let found = live(model, run);
        let (a, b) = (&found.damper, walked(&damper(&model), run));
        assert!(a.len() > 3000, "{} estimates", a.len());
        let differ = a.iter().zip(&b).filter(|(a, b)| a != b).count();
        assert!(a.len() == b.len() && differ == 0, "{apply_to:?} {what}: {differ} of {}", a.len());
        // Not every displacement has a measured force near it.
        let readings: HashMap<Stamp, u64> = walked(&model, run).into_iter().collect();
        assert!(found.readings.len() > 3000, "{} readings", found.readings.len());
        let differ = found.readings.iter().filter(|(at, bits)| readings.get(at) != Some(bits)).count();
        assert!(differ == 0, "{apply_to:?} {what}: {differ} readings");
    }
}

/// Estimates and commands of a pipeline whose input includes force requests, and the expected readings.
fn published(model: Model, run: &Run) -> (Vec<Estimate>, Vec<StampedCommand>, Vec<f64>) {
    let settings =
        Settings { law: ControlLaw::Follow, use_measured_force: UseForce::Auto, ..Settings::default() };
    let mut pipeline = Pipeline::new(Models::alone(model), settings).expect("it runs");
    let (mut estimates, mut commands, mut readings) = (Vec::new(), Vec::new(), Vec::new());
    for sample in run.samples() {
        let mut take = |event| match event {
            Event::Estimate(estimate) => estimates.push(estimate),
            Event::Command(command) => commands.push(command),
            Event::Residual(residual) => readings.push(residual.predicted.get()),
            _ => {}
        };
        if matches!(sample.reading, Reading::Displacement(_)) {
            let reading = Reading::ForceRequest(Newton(300.0));
            pipeline.step(&Sample { reading, ..sample }, &mut take);
        }
        pipeline.step(&sample, &mut take);
    }
    (estimates, commands, readings)
}

/// Effects of the load cell describe its reading. Debug text is compared, because NaN is not equal to itself.
#[test]
fn effects_of_the_load_cell_change_neither_the_estimate_nor_the_command() {
    let with = |effect, value| EffectModel::new(effect, &[value]).expect("within range");
    let lag = with(Effect::CoilLag, 0.01);
    let lists = [
        vec![with(Effect::SensorDelay, 0.005)],
        vec![with(Effect::AntiAliasMismatch, 0.009)],
        vec![with(Effect::LoadCellDrift, 0.2)],
        vec![lag, with(Effect::SensorDelay, 0.005), with(Effect::LoadCellDrift, 0.2)],
    ];
    let measured = recorded();
    let unmeasured = Run { force_n: None, ..measured.clone() };
    for list in lists {
        for apply_to in [ApplyTo::Inputs, ApplyTo::Output] {
            let mut model = fuzzy(&list);
            model.conditioning.apply_to = apply_to;
            let damper = damper(&model);
            let ((with, _, readings), (without, _, forces)) =
                (published(model, &measured), published(damper, &measured));
            assert!(
                with.len() > 3000 && with.iter().filter(|e| e.validity == Validity::Valid).count() > 2000
            );
            assert!(format!("{with:?}") == format!("{without:?}"), "{apply_to:?} {list:?}");
            let changed = readings.iter().zip(&forces).filter(|(reading, force)| reading != force).count();
            assert!(changed > 2000, "{apply_to:?} {list:?}: {changed} readings differ from the force");
            let ((_, with, _), (_, without, _)) =
                (published(model, &unmeasured), published(damper, &unmeasured));
            assert!(with.iter().filter(|command| command.command.current.get() > 0.1).count() > 500);
            assert!(format!("{with:?}") == format!("{without:?}"), "{apply_to:?} {list:?}");
        }
    }
}

#[test]
fn a_swap_to_a_model_with_an_effect_makes_no_gap() {
    let run = recorded();
    let samples: Vec<_> = run.samples().collect();
    let lag = |tau_s| [EffectModel::new(Effect::CoilLag, &[tau_s]).expect("within range")];
    // The plain model, then a lag, then another time constant of the lag, then a filter as well.
    let filter = EffectModel::new(Effect::AntiAliasMismatch, &[0.006]).expect("within range");
    let models = [fuzzy(&[]), fuzzy(&lag(0.01)), fuzzy(&lag(0.02)), fuzzy(&[lag(0.02)[0], filter])];
    let settings = Settings { use_measured_force: UseForce::Never, ..Settings::default() };
    let mut pipeline = Pipeline::new(Models::alone(models[0]), settings).expect("it runs");
    let (mut estimates, mut last, mut largest) = (0, None, 0.0_f64);
    for (k, sample) in samples.iter().enumerate().take(3500) {
        if k % 800 == 700 {
            let next = Models::alone(models[(k / 800 + 1) % 4]);
            pipeline.take(PipelineSetup::new(next, settings).expect("it runs"), &mut |_| {});
        }
        pipeline.step(sample, &mut |event| {
            if let Event::Estimate(e) = event
                && e.force.is_finite()
            {
                estimates += 1;
                let t = sample.stamp.nanos();
                if let Some((before, t_before)) = last
                    && t - t_before < 4_000_000
                {
                    largest = largest.max(f64::abs(e.force.get() - before));
                }
                last = Some((e.force.get(), t));
            }
        });
    }
    assert!(estimates > 1200, "{estimates}");
    // In the plain model, steps of the current alone change the force by up to 250 N per sample.
    assert!(largest < 300.0, "{largest} N from one sample to the next");
}

#[test]
fn thermal_fade_without_a_temperature_is_reported() {
    let model = fuzzy(&[EffectModel::new(Effect::ThermalFade, &[-0.003]).expect("within range")]);
    let run = Run { case_temp_c: None, ..recorded() };
    let data = Dataset::from_run(&run, &model.conditioning, &DatasetOptions::default()).expect("rows");
    let expected = "run made: has no case_temp_c, which the effect thermal_fade needs";
    let refused = score(&model.augmented(), &data, &Watch::none()).expect_err("no temperature");
    assert_eq!(refused.to_string(), expected);
    let refused = evaluate(model, &run, never(), |_| true).expect_err("no temperature");
    assert_eq!(refused.to_string(), expected);
    assert!(live(model, &run).damper.is_empty(), "no force without a temperature");
    let mut pipeline = Pipeline::new(Models::alone(model), never()).expect("it runs");
    for sample in run.samples() {
        pipeline.step(&sample, &mut |event| {
            if let Event::Estimate(e) = event {
                assert!(e.reasons.has(Reasons::TEMPERATURE_MISSING) && e.validity == Validity::Invalid);
            }
        });
    }
    // With a temperature the estimate is flagged as extrapolating where it is warmer than in training.
    let model =
        Model { envelope: Envelope { case_temp_c: Some([20.0, 30.0]), ..Envelope::default() }, ..model };
    let mut pipeline = Pipeline::new(Models::alone(model), never()).expect("it runs");
    let (mut cold, mut hot) = (0, 0);
    for sample in recorded().samples() {
        pipeline.step(&sample, &mut |event| {
            if let Event::Estimate(e) = event {
                let count = if e.stamp.nanos() < 2_000_000_000 { &mut cold } else { &mut hot };
                *count += u32::from(e.reasons.has(Reasons::OUTSIDE_ENVELOPE));
            }
        });
    }
    assert!(cold == 0 && hot > 1000, "{cold} {hot}");
}

/// A model that is fed with measured force has the effects in its input, so a model with effects is only simulated (free run).
#[test]
fn a_model_with_effects_is_not_seeded() {
    let arx = preset::load(preset::BEST_ARX).expect("a preset");
    let with = Model { effects: of(&[Effect::GasSpring.example()]), ..arx };
    assert!(Models::alone(arx).seeded.is_some() && Models::alone(with).seeded.is_none());
    let refused = Models::alone(fuzzy(&[])).with_seeded(with).expect_err("it has effects");
    assert!(refused.to_string().contains("arx_model has effects"), "{refused}");
    let steady = recorded().between(Stamp::from_nanos(2_400_000_000), Stamp::from_nanos(4_900_000_000));
    let data = Dataset::from_run(&steady, &arx.conditioning, &DatasetOptions::default()).expect("rows");
    let plain = score(&arx.augmented(), &data, &Watch::none()).expect("it runs");
    let scores = score(&with.augmented(), &data, &Watch::none()).expect("it runs");
    assert!(plain.one_step.is_some() && scores.one_step.is_none());
}

#[test]
fn an_effect_on_the_drive_of_a_passive_model_is_rejected() {
    let law =
        LawModel::new(ForceLaw::Sp, Dependence::None, &[0.0, 900.0, 1.0, 0.0, 1.0], 0.0).expect("a law");
    let model = Model { force: ForceModel::Law(law), ..fuzzy(&[Effect::CoilLag.example()]) };
    let refused = Pipeline::new(Models::alone(model), never()).expect_err("no drive to lag");
    assert!(refused.to_string().contains("effect coil_lag acts on the drive"), "{refused}");
}
