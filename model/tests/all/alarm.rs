//! The residual alarm from the user's view: when it is raised, when it ends, and what ends it at once.

use crate::common::{Harness, preset};
use mr_damper_model::identify::{Form, ModelSpec, Options, Watch, identify};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{Event, Models, Pipeline, Settings};
use mr_damper_model::preset::BEST_FUZZY_TANH;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use std::fmt::Write;

/// Samples per second.
const SECOND: i64 = 512;

/// A [`Harness`] on which the measured force is the model's simulation plus `bias` times its expected RMSE.
fn biased(bias: f64, seconds: i64) -> Harness {
    let expected_n = preset(BEST_FUZZY_TANH).expected.free_run_rsse_n.expect("the preset states one");
    let mut harness = Harness::new(Settings::default());
    harness.measure_free_run_plus(bias * expected_n, seconds * SECOND);
    harness
}

/// Changes of the alarm, one per line.
fn changes(harness: &Harness) -> String {
    let line = |event: &Event| match event {
        Event::Alarm(a) => {
            let change = if a.raised { "raised" } else { "over" };
            Some(format!("{:6.2} s  {change:<6}  ratio {:.2}", a.stamp.nanos() as f64 / 1e9, a.ratio))
        }
        _ => None,
    };
    harness.events.iter().filter_map(line).collect::<Vec<_>>().join("\n")
}

/// Checks that the alarm flag of each residual matches the last change of the alarm.
fn assert_residuals_follow(harness: &Harness) {
    let mut raised = false;
    for event in &harness.events {
        match event {
            Event::Alarm(change) => {
                assert_ne!(change.raised, raised, "only changes are reported");
                raised = change.raised;
            }
            Event::Residual(residual) => assert_eq!(residual.alarm, raised, "{residual:?}"),
            _ => {}
        }
    }
}

#[test]
fn a_model_that_is_as_good_as_expected_raises_no_alarm() {
    let mut harness = biased(1.0, 60);
    harness.run(0..60 * SECOND, |_| true);
    assert!(harness.residuals().count() > 59 * SECOND as usize);
    assert_eq!(changes(&harness), "");
}

#[test]
fn the_alarm_is_raised_when_the_model_is_wrong_and_ends_when_it_is_right_again() {
    let mut harness = biased(3.0, 20);
    harness.run(0..20 * SECOND, |_| true);
    let mut right = biased(0.5, 40);
    right.run(0..20 * SECOND, |_| true);
    // The first harness continues with the measured force of the second.
    std::mem::swap(&mut harness.measured_n, &mut right.measured_n);
    harness.run(20 * SECOND..40 * SECOND, |_| true);
    insta::assert_snapshot!(changes(&harness), @"
      5.05 s  raised  ratio 3.00
     25.05 s  over    ratio 1.84
    ");
    assert_residuals_follow(&harness);
}

#[test]
fn a_swap_a_reset_and_a_gap_end_the_alarm_at_once() {
    let mut harness = biased(3.0, 60);
    let models = Models::alone(preset(BEST_FUZZY_TANH));
    harness.run(0..12 * SECOND, |_| true);
    harness.take(models, Settings::default()).expect("a preset fits the settings");
    harness.run(12 * SECOND..24 * SECOND, |_| true);
    let events = &mut harness.events;
    harness.pipeline.reset(&mut |event| events.push(event));
    harness.run(24 * SECOND..36 * SECOND, |_| true);
    harness.run(37 * SECOND..49 * SECOND, |_| true);
    insta::assert_snapshot!(changes(&harness), @"
      5.05 s  raised  ratio 3.00
     12.00 s  over    ratio NaN
     17.00 s  raised  ratio 3.00
     24.00 s  over    ratio NaN
     29.05 s  raised  ratio 3.00
     37.00 s  over    ratio NaN
     42.05 s  raised  ratio 3.00
    ");
    assert_residuals_follow(&harness);
}

#[test]
fn without_an_expected_rmse_no_alarm_is_raised() {
    let mut model: Model = preset(BEST_FUZZY_TANH);
    model.expected.free_run_rsse_n = None;
    let mut harness = biased(100.0, 30);
    harness.pipeline = Pipeline::new(Models::alone(model), Settings::default()).expect("it runs");
    harness.run(0..30 * SECOND, |_| true);
    assert!(harness.residuals().all(|r| !r.alarm && r.expected_rsse.get().is_nan()));
    assert_eq!(changes(&harness), "");
}

/// Tests the assumption of the alarm with a model identified on one run of an experiment and run on other replicates of it. The residual
/// is coloured and depends on motion and current. If both vary freely, as in the runs that give the expected RMSE, no alarm may be
/// raised. RP3-CS holds each current for half a minute, and at some currents the model error is above its average. There the assumption
/// fails, and a factor of 2 allows for it.
#[test]
fn other_replicates_of_the_training_experiment_raise_no_alarm() {
    let mut table = String::new();
    for (name, ratio, runs, allowed) in [
        ("RP-ICPS", 1.5, 5, 0),
        ("RP-APRBS", 1.5, 5, 0),
        ("RP-PRBS", 1.5, 5, 0),
        ("RP3-CS", 1.5, 3, 1),
        ("RP3-CS", 2.0, 3, 0),
    ] {
        let experiment = Experiment::thesis(name).expect("a thesis experiment");
        let measured = |seed| record(&experiment, &Plant::default(), &Channels::default(), seed);
        let spec = ModelSpec::named("fuzzy-tanh", Form::SemiActive).expect("a known model");
        let options = Options { restarts: 2, ..Options::default() };
        let model = identify(spec, &[measured(1)], &options, &Watch::none()).expect("it fits").model;
        let settings = Settings { alarm_ratio: ratio, ..Settings::default() };
        let mut pipeline = Pipeline::new(Models::alone(model), settings).expect("it runs");
        let (mut raised, mut worst, mut seconds) = (0, 0.0_f64, 0.0);
        for seed in 2..2 + runs {
            let run = measured(seed);
            seconds += run.duration().get();
            pipeline.reset(&mut |_| {});
            for sample in run.samples() {
                pipeline.step(&sample, &mut |event| match event {
                    Event::Alarm(change) => raised += u32::from(change.raised),
                    Event::Residual(r) => worst = worst.max(r.windowed_rsse.get() / r.expected_rsse.get()),
                    _ => {}
                });
            }
        }
        writeln!(table, "{name}, factor {ratio}: {raised} alarms in {seconds:.0} s, windowed RMSE at most {worst:.2} times the expected RMSE")
            .expect("a text");
        assert!(raised <= allowed, "{table}");
    }
    println!("{table}");
}
