//! Live learning of the `boada` model in a running pipeline.

use crate::common::{PERIOD_NS, lazy, preset, remembered_n};
use mr_damper_model::effect::{Effect, EffectModel, Effects};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{
    Estimate, Event, Models, Pipeline, PipelineSetup, Reasons, Settings, UseForce,
};
use mr_damper_model::preset::BEST_FUZZY_TANH;
use mr_damper_model::sample::{Drive, Reading, Sample, Stamp};
use mr_damper_model::units::{Ampere, Metre, Newton};

/// Rows of one second.
const SECOND: i64 = 512;

fn learning() -> Settings {
    Settings { lazy_learning: true, ..Settings::default() }
}

/// Drives `pipeline` through rows `range` of a motion under a stepping current. The damper has `share` of the remembered force. Returns the
/// estimates, N, with the true forces.
fn drive(pipeline: &mut Pipeline, range: std::ops::Range<i64>, share: f64) -> Vec<(f64, f64)> {
    let mut estimates = Vec::new();
    let true_n = drive_with(pipeline, range, share, |estimate| estimates.push(estimate.force.get()));
    estimates.into_iter().zip(true_n).collect()
}

/// As [`drive`], with each estimate given to `take`. Returns the true forces, N.
fn drive_with(
    pipeline: &mut Pipeline,
    range: std::ops::Range<i64>,
    share: f64,
    mut take: impl FnMut(&Estimate),
) -> Vec<f64> {
    let mut true_n = Vec::new();
    for k in range {
        let t = k as f64 / SECOND as f64;
        let (x, v) = [(0.006, 9.0, 0.0), (0.003, 17.3, 1.0), (0.001, 41.0, 2.0)]
            .iter()
            .fold((0.0, 0.0), |(x, v), (a, w, phase)| {
                (x + a * f64::sin(w * t + phase), v + a * w * f64::cos(w * t + phase))
            });
        let current_a = [0.0, 1.2, 0.6, 2.4, 1.8][(t / 0.7) as usize % 5];
        let force_n = share * remembered_n(x, v, current_a) + 15.0;
        let stamp = Stamp::from_nanos(k * PERIOD_NS);
        let readings = [
            Reading::Drive(Drive::CoilCurrent(Ampere(current_a))),
            // The force of a sample is known before its displacement.
            Reading::Force(Newton(force_n)),
            Reading::Displacement(Metre(x)),
        ];
        for reading in readings {
            pipeline.step(&Sample { stamp, received: stamp, reading }, &mut |event| {
                if let Event::Estimate(estimate) = event {
                    true_n.push(force_n);
                    take(&estimate);
                }
            });
        }
    }
    true_n
}

fn pipeline(settings: Settings) -> Pipeline {
    Pipeline::new(Models::alone(lazy()), settings).expect("the model runs")
}

fn bits(estimates: Vec<(f64, f64)>) -> Vec<u64> {
    estimates.into_iter().map(|(force_n, _)| force_n.to_bits()).collect()
}

fn rmse_n(estimates: &[(f64, f64)]) -> f64 {
    let squares = estimates.iter().map(|(found, truth)| (found - truth).powi(2));
    (squares.sum::<f64>() / estimates.len() as f64).sqrt()
}

#[test]
fn learning_follows_a_damper_that_loses_force_and_the_default_does_not() {
    let run = |settings| {
        let mut pipeline = pipeline(settings);
        let healthy = drive(&mut pipeline, 0..5 * SECOND, 1.0);
        let weaker = drive(&mut pipeline, 5 * SECOND..35 * SECOND, 0.8);
        let first = &weaker[..SECOND as usize];
        let last = &weaker[weaker.len() - 10 * SECOND as usize..];
        [rmse_n(&healthy[10..]), rmse_n(first), rmse_n(last)]
    };
    let ([healthy, fixed_first, fixed], [_, first, learned]) = (run(Settings::default()), run(learning()));
    println!("healthy {healthy}, fixed {fixed_first} then {fixed}, learning {first} then {learned}");
    // A fifth of the force is missing, and the fixed memory never knows.
    assert!(fixed > 2.0 * healthy && (fixed / fixed_first - 1.0).abs() < 0.4, "{fixed} {healthy}");
    assert!(learned < 0.4 * fixed, "{learned} {fixed}");
}

#[test]
fn a_sample_does_not_know_its_own_force() {
    let mut before = pipeline(learning());
    drive(&mut before, 0..SECOND, 0.8);
    // From the same state, the next sample comes with two forces: the estimates are equal. The one after it may differ.
    let next = |share: f64| {
        let mut pipeline = before.clone();
        let one = drive(&mut pipeline, SECOND..SECOND + 1, share)[0].0;
        (
            one,
            drive(&mut pipeline, SECOND + 1..SECOND + 40, share).iter().map(|(found, _)| *found).sum::<f64>(),
        )
    };
    let ((one, later), (other, other_later)) = (next(1.0), next(0.5));
    assert_eq!(one.to_bits(), other.to_bits());
    assert!(later != other_later, "later samples were learned");
}

#[test]
fn a_replay_is_bit_identical_and_loading_or_resetting_forgets() {
    let run = || {
        let mut pipeline = pipeline(learning());
        drive(&mut pipeline, 0..10 * SECOND, 0.8)
    };
    assert_eq!(bits(run()), bits(run()));

    let after = |change: &dyn Fn(&mut Pipeline)| {
        let mut pipeline = pipeline(learning());
        drive(&mut pipeline, 0..10 * SECOND, 0.8);
        change(&mut pipeline);
        rmse_n(&drive(&mut pipeline, 10 * SECOND..10 * SECOND + SECOND / 4, 0.8)[20..])
    };
    let take = |settings, anew: bool| {
        move |pipeline: &mut Pipeline| {
            let setup = PipelineSetup::new(Models::alone(lazy()), settings).expect("it runs");
            pipeline.take(if anew { setup.learning_anew() } else { setup }, &mut |_| {});
        }
    };
    let kept = after(&take(Settings { coast_s: 0.1, ..learning() }, false));
    assert_eq!(kept, after(&|_| {}), "another setting keeps what was learned");
    let loaded = after(&take(learning(), true));
    let reset = after(&|pipeline| pipeline.reset(&mut |_| {}));
    let off = after(&take(Settings::default(), false));
    for forgotten in [loaded, reset, off] {
        assert!(forgotten > 1.5 * kept, "{forgotten} {kept}");
    }
}

#[test]
fn samples_outside_of_the_training_range_are_not_learned_and_stay_flagged() {
    let mut narrow = lazy();
    narrow.envelope.velocity_m_s = Some([-1e-6, 1e-6]);
    let run = |settings| {
        let mut pipeline = Pipeline::new(Models::alone(narrow), settings).expect("the model runs");
        drive(&mut pipeline, 0..10 * SECOND, 0.8)
    };
    assert_eq!(bits(run(learning())), bits(run(Settings::default())));
    // A model that learns the range of small velocities flags the others as before.
    let mut partly = lazy();
    partly.envelope.velocity_m_s = Some([-0.05, 0.05]);
    let flags = |settings| {
        let mut pipeline = Pipeline::new(Models::alone(partly), settings).expect("the model runs");
        let mut flags = Vec::new();
        drive_with(&mut pipeline, 0..10 * SECOND, 0.8, |estimate| {
            flags.push(estimate.reasons.has(Reasons::OUTSIDE_ENVELOPE));
        });
        flags
    };
    let learned = flags(learning());
    let outside = learned.iter().filter(|flag| **flag).count();
    assert!((1000..4500).contains(&outside), "{outside}");
    assert_eq!(learned, flags(Settings::default()));
}

#[test]
fn learning_that_is_not_possible_is_refused() {
    let refused = |model: Model, settings: Settings| {
        Pipeline::new(Models::alone(model), settings).expect_err("refused").to_string()
    };
    let text = refused(preset(BEST_FUZZY_TANH), learning());
    assert!(text.contains("boada.learn: a fuzzy-tanh model does not learn"), "{text}");
    let never = Settings { use_measured_force: UseForce::Never, ..learning() };
    assert!(refused(lazy(), never).contains("use_measured_force is never"));
    let gas = EffectModel::new(Effect::GasSpring, &[1e3]).expect("within range");
    let effects = Effects::new(&[gas]).expect("few enough");
    assert!(refused(Model { effects, ..lazy() }, learning()).contains("contains the model's effects"));
}
