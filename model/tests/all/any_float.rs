//! The pipeline with arbitrary bits from sensors, clocks and force requests. Each number that it gives is finite, or NaN where that is
//! documented as unknown. A force far beyond the range of the training data is never VALID.

use crate::common::{maxwell_slip, preset};
use crate::middle::{parameters, present};
use mr_damper_model::condition::{ApplyTo, VelocitySource};
use mr_damper_model::effect::{Effect, Effects};
use mr_damper_model::force::{Dependence, ForceLaw, ForceModel, FuzzySets, LawModel, Membership};
use mr_damper_model::inverse;
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{Estimate, Event, Models, Pipeline, Settings, UseForce, Validity};
use mr_damper_model::preset::{self as presets, BEST_ARX, BEST_FUZZY_TANH};
use mr_damper_model::sample::{Drive, DriveKind, Reading, Sample, Stamp};
use mr_damper_model::units::{Ampere, Celsius, Metre, MetrePerSecond, Newton};
use proptest::prelude::*;

/// A VALID force is at most this factor times the largest force that its model was identified on.
const WITHIN: f64 = 4.0;

/// A force law over seven fuzzy sets.
fn law(law: ForceLaw) -> ForceModel {
    let membership = Membership { drive: DriveKind::CoilCurrent, sigma: 0.2 };
    let sets = FuzzySets::new(membership, &[0.0, 0.4, 0.8, 1.2, 1.6, 2.1, 2.5]).expect("centres increase");
    let dependence = Dependence::Fuzzy(sets);
    let parameters = parameters(law).repeat(dependence.copies());
    ForceModel::Law(LawModel::new(law, dependence, &parameters, 0.0).expect("as many as it takes"))
}

/// Each preset that loads, each force law, a model with bristles, and each effect around a preset.
fn subjects() -> Vec<(String, Model)> {
    let base = preset(BEST_FUZZY_TANH);
    let of_thesis = presets::names().into_iter().filter_map(|name| Some((presets::load(&name).ok()?, name)));
    let laws = ForceLaw::ALL.into_iter().map(|of| (Model { force: law(of), ..base }, of.name().to_owned()));
    let effects = Effect::ALL.into_iter().filter_map(|effect| {
        let effects = Effects::new(&[present(effect)]).ok()?;
        Some((Model { effects, ..base }, format!("{effect:?}")))
    });
    let slips = [(maxwell_slip(), "maxwell-slip".to_owned())];
    of_thesis.chain(laws).chain(slips).chain(effects).map(|(model, name)| (name, model)).collect()
}

/// A sensor value: mostly plausible, sometimes arbitrary bits.
fn number(scale: f64) -> impl Strategy<Value = f64> {
    prop_oneof![
        6 => (-1.0..1.0_f64).prop_map(move |share| scale * share),
        1 => any::<u64>().prop_map(f64::from_bits),
        1 => prop::sample::select(vec![
            f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN, f64::MIN_POSITIVE, -0.0, 5e-324, 1e300, -1e300, 1e154, 1e-200,
        ]),
    ]
}

/// Time since the sample before, ns: a normal period, zero, or a jump in either direction.
fn pause_ns() -> impl Strategy<Value = i64> {
    prop_oneof![
        20 => 100_000..4_000_000_i64,
        1 => Just(0),
        1 => -3_000_000_000..3_000_000_000_i64,
        1 => any::<i64>(),
    ]
}

fn reading() -> impl Strategy<Value = Reading> {
    prop_oneof![
        6 => number(0.02).prop_map(|x| Reading::Displacement(Metre(x))),
        3 => number(2.0).prop_map(|a| Reading::Drive(Drive::CoilCurrent(Ampere(a)))),
        3 => number(1500.0).prop_map(|n| Reading::Force(Newton(n))),
        1 => number(0.5).prop_map(|v| Reading::Velocity(MetrePerSecond(v))),
        1 => number(60.0).prop_map(|t| Reading::CaseTemperature(Celsius(t))),
        1 => number(0.5).prop_map(|v| Reading::BodyVelocity(MetrePerSecond(v))),
        2 => number(1500.0).prop_map(|n| Reading::ForceRequest(Newton(n))),
    ]
}

fn settings() -> impl Strategy<Value = Settings> {
    let law = prop::sample::select(vec![
        inverse::ControlLaw::Follow,
        inverse::ControlLaw::Skyhook(1500.0),
        inverse::ControlLaw::SkyhookGains(inverse::SkyhookGains::new(&[2000.0, 900.0], &[0.0, 2.0])),
        inverse::ControlLaw::Groundhook(1500.0),
        inverse::ControlLaw::Fixed(0.7),
    ]);
    let force = prop::sample::select(vec![UseForce::Auto, UseForce::Never, UseForce::Observer(0.2)]);
    (law, force).prop_map(|(law, use_measured_force)| Settings {
        law,
        use_measured_force,
        ..Settings::default()
    })
}

/// True for a finite number, or NaN for unknown.
fn is_known_or_unknown(number: f64) -> bool {
    !number.is_infinite()
}

fn check_estimate(estimate: &Estimate, largest_n: f64) -> Result<(), TestCaseError> {
    let force_n = estimate.force.get();
    let none = force_n.is_nan() && estimate.validity == Validity::Invalid;
    prop_assert!(force_n.is_finite() || none, "{:?}", estimate);
    prop_assert!(estimate.smoothing.get().is_finite() || force_n.is_nan(), "{:?}", estimate);
    let [low, high] = estimate.band.map(Newton::get);
    let unknown = [estimate.std_dev.get(), estimate.input_age.get(), low, high];
    prop_assert!(unknown.into_iter().all(is_known_or_unknown), "{:?}", estimate);
    prop_assert!(
        low.is_nan() == high.is_nan() && (low.is_nan() || low <= force_n && force_n <= high),
        "{:?}",
        estimate
    );
    if estimate.validity == Validity::Valid {
        prop_assert!(force_n.abs() <= WITHIN * largest_n, "{:?} is valid, beyond {} N", estimate, largest_n);
    }
    Ok(())
}

fn check(event: &Event, largest_n: f64, limit_a: f64) -> Result<(), TestCaseError> {
    match event {
        Event::Estimate(estimate) => check_estimate(estimate, largest_n)?,
        Event::Residual(residual) => {
            let known = [residual.measured.get(), residual.predicted.get(), residual.residual.get()];
            prop_assert!(known.into_iter().all(f64::is_finite), "{:?}", residual);
            let unknown = [
                residual.expected_rsse.get(),
                residual.normalised,
                residual.windowed_rsse.get(),
                residual.windowed_esr,
            ];
            prop_assert!(unknown.into_iter().all(is_known_or_unknown), "{:?}", residual);
        }
        Event::Command(commanded) => {
            let command = &commanded.command;
            prop_assert!((0.0..=limit_a).contains(&command.current.get()), "{:?}", command);
            let unknown = [
                command.requested.get(),
                command.expected.get(),
                command.achievable[0].get(),
                command.achievable[1].get(),
            ];
            prop_assert!(unknown.into_iter().all(is_known_or_unknown), "{:?}", command);
        }
        Event::Input(sample) => prop_assert!(sample.reading.get().is_finite(), "{:?}", sample),
        Event::Alarm(alarm) => prop_assert!(is_known_or_unknown(alarm.ratio), "{:?}", alarm),
        Event::Refusal(_) | Event::Transition(_) => {}
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(if std::env::var("MR_DAMPER_LONG").as_deref() == Ok("1") { 20_000 } else { 400 }))]

    #[test]
    fn every_output_is_finite_or_documented_as_unknown(
        subject in any::<prop::sample::Index>(),
        velocity in prop::sample::select(vec![VelocitySource::Backward, VelocitySource::ThreePoint, VelocitySource::Slope, VelocitySource::Measured]),
        apply_to in prop::sample::select(vec![ApplyTo::Inputs, ApplyTo::Output]),
        settings in settings(),
        seeded in any::<bool>(),
        sent in prop::collection::vec((pause_ns(), reading()), 1..400),
    ) {
        let subjects = subjects();
        let (name, mut model) = subjects[subject.index(subjects.len())].clone();
        if !matches!(model.force, ForceModel::Arx(_)) {
            model.conditioning.velocity = velocity;
            model.conditioning.apply_to = apply_to;
        }
        let mut models = Models::alone(model);
        if seeded {
            models = models.with_seeded(preset(BEST_ARX)).unwrap_or(models);
        }
        // Not every control law works with every model, because not every model has an inverse.
        let Ok(mut pipeline) = Pipeline::new(models, settings).or_else(|_| Pipeline::new(models, Settings::default())) else {
            return Err(TestCaseError::reject("these models do not run together"));
        };
        let range = |model: &Model| model.envelope.force_n.map_or(f64::INFINITY, |[low, high]| low.abs().max(high.abs()));
        let largest_n = range(&models.free).max(models.seeded.as_ref().map_or(0.0, range));
        let limit_a = settings.limits.current_max_a;
        let mut wrong = Ok(());
        let mut at = Stamp::from_nanos(1_700_000_000_000_000_000);
        for (pause_ns, reading) in sent {
            let stamp = at.shifted(pause_ns);
            // A large jump of the clock affects one sample only; after a small one time continues from there.
            if pause_ns.unsigned_abs() < 3_000_000_000 {
                at = stamp;
            }
            let mut emit = |event: Event| {
                if wrong.is_ok() {
                    wrong = check(&event, largest_n, limit_a);
                }
            };
            pipeline.step(&Sample { stamp, received: stamp, reading }, &mut emit);
            pipeline.tick(stamp.shifted(1_000_000), &mut emit);
        }
        wrong.map_err(|error| TestCaseError::fail(format!("{name}: {error}")))?;
    }
}
