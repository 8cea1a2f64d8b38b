//! The pipeline from the user's view: mode changes as snapshots, bad input, invariants.

use crate::common::{Harness, both, preset, samples};
use mr_damper_model::model::Model;
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::pipeline::{Event, Mode, Models, Pipeline, Reasons, Settings, UseForce, Validity};
use mr_damper_model::sample::{Drive, Reading, Stamp};
use mr_damper_model::units::{Ampere, Metre, Newton, Volt};

/// All inputs fresh; then the force is lost, ARX coasts, the model takes over, and the force returns.
#[test]
fn modes_follow_the_measured_force() {
    let mut harness = Harness::thesis();
    harness.run(0..100, |_| true);
    harness.run(100..300, |_| false);
    harness.run(300..400, |_| true);
    insta::assert_snapshot!(harness.transitions(), @"
       2 ms  fault -> model     the model's inputs are available
       8 ms  model -> arx       measured force is fresh
     244 ms  arx -> arx_coast   measured force is older than force_timeout_s
     445 ms  arx_coast -> model ARX has coasted for coast_s
     592 ms  model -> arx       measured force is fresh
    ");
}

#[test]
fn measured_force_that_must_not_be_used_still_gives_residuals() {
    let mut harness = Harness::new(Settings { use_measured_force: UseForce::Never, ..Settings::default() });
    harness.run(0..100, |_| true);
    insta::assert_snapshot!(harness.transitions(), @"   2 ms  fault -> model     the model's inputs are available");
    assert!(harness.residuals().count() > 90);
}

/// A model may diverge for a while: a force of 10^20 N is reported as invalid, and the residual figures recover afterwards.
#[test]
fn an_impossible_force_is_invalid_and_has_no_lasting_influence() {
    let good = ModelFile { model: preset("thesis/fuzzy-tanh/rp3-cs"), provenance: Provenance::default() };
    let text = good.to_toml().expect("writes");
    let yields = text.lines().find(|line| line.starts_with("yield_force_n = ")).expect("a line");
    let (before, _last) = yields.rsplit_once(", ").expect("several sets");
    let bad = ModelFile::from_toml(&text.replace(yields, &format!("{before}, 1e20]"))).expect("reads").model;
    let settings = Settings { hold_s: 0.0, ..Settings::default() };
    let mut pipeline = Pipeline::new(Models::alone(bad), settings).expect("runs");
    let (mut none, mut last_n) = (0, f64::NAN);
    let mut check = |event: Event| match event {
        Event::Estimate(estimate) if estimate.force.get().is_nan() => {
            assert_eq!(estimate.validity, Validity::Invalid);
            none += 1;
        }
        Event::Estimate(estimate) => assert!(estimate.force.get().abs() < 1e4, "{estimate:?}"),
        Event::Residual(residual) => last_n = residual.windowed_rsse.get(),
        _ => {}
    };
    for k in 0..600 {
        let current_a = if (300..310).contains(&k) { 2.5 } else { 0.0 };
        for mut sample in samples(k, 0) {
            if let Reading::Drive(_) = sample.reading {
                sample.reading = Reading::Drive(Drive::CoilCurrent(Ampere(current_a)));
            }
            pipeline.step(&sample, &mut check);
        }
    }
    assert!((9..=12).contains(&none) && last_n < 1e4, "{none} estimates without a force, then {last_n} N");
}

#[test]
fn silence_holds_the_last_estimate_and_then_ends_in_fault() {
    let mut harness = Harness::thesis();
    harness.run(0..100, |_| true);
    for ms in (200..2200).step_by(20) {
        harness.tick(ms);
    }
    harness.run(1200..1300, |_| true);
    insta::assert_snapshot!(harness.transitions(), @"
       2 ms  fault -> model     the model's inputs are available
       8 ms  model -> arx       measured force is fresh
     193 ms  arx -> hold        displacement is silent for longer than input_timeout_s
     193 ms  hold -> fault      the last estimate was held for hold_s
    2346 ms  fault -> model     the model's inputs are available
    2352 ms  model -> arx       measured force is fresh
    ");
    let stale: Vec<_> = harness.estimates().filter(|e| e.reasons.has(Reasons::DISPLACEMENT_LOST)).collect();
    assert!(
        stale.iter().any(|e| e.mode == Mode::Hold && e.validity == Validity::Stale && e.force.is_finite())
    );
    assert!(
        stale
            .iter()
            .any(|e| e.mode == Mode::Fault && e.validity == Validity::Invalid && !e.force.is_finite())
    );
}

/// A tick between two displacements does only what the next displacement would have done: the results are the same.
#[test]
fn ticks_do_not_change_results() {
    let silent = |ticks: bool| {
        let mut harness = Harness::thesis();
        harness.run(0..100, |_| true);
        if ticks {
            for ms in (200..2300).step_by(20) {
                harness.tick(ms);
            }
        }
        harness.run(1200..1400, |k| k < 1300);
        let estimates = harness.estimates().filter(|e| !e.reasons.has(Reasons::DISPLACEMENT_LOST));
        let estimates: Vec<_> =
            estimates.map(|e| (e.stamp, e.force.get().to_bits(), e.reasons, e.mode)).collect();
        let residuals: Vec<_> = harness.residuals().map(|r| (r.stamp, r.residual.get().to_bits())).collect();
        (estimates, residuals, harness.transitions())
    };
    let (without, with) = (silent(false), silent(true));
    assert_eq!(without.2, with.2);
    assert!(without == with, "estimates or residuals differ");
}

#[test]
fn results_do_not_depend_on_the_epoch() {
    let run = |epoch_ns: i64| {
        let mut harness = Harness::thesis();
        harness.epoch_ns = epoch_ns;
        harness.run(0..500, |k| k % 200 < 120);
        harness.estimates().map(|e| e.force.get().to_bits()).collect::<Vec<_>>()
    };
    assert_eq!(run(0), run(1_790_000_000_123_456_789));
}

/// Channels of one stamp may arrive in any order with displacement last; the force may even arrive after it.
#[test]
fn residuals_do_not_depend_on_when_the_force_arrives() {
    let run = |late: usize| {
        let mut pipeline = Pipeline::new(
            Models::alone(preset("thesis/fuzzy-tanh/rp3-cs")),
            Settings { use_measured_force: UseForce::Never, ..Settings::default() },
        )
        .expect("a preset runs");
        let mut residuals = Vec::new();
        let mut queue = std::collections::VecDeque::new();
        for k in 0..400 {
            let [drive, force, displacement] = samples(k, 0);
            queue.push_back(force);
            let mut feed = vec![drive, displacement];
            if queue.len() > late {
                feed.extend(queue.pop_front());
            }
            for sample in feed {
                pipeline.step(&sample, &mut |event| {
                    if let Event::Residual(r) = event {
                        residuals.push((r.stamp, r.residual.get().to_bits()));
                    }
                });
            }
        }
        residuals
    };
    let (prompt, late) = (run(0), run(20));
    assert!(late.len() > 370, "{}", late.len());
    assert_eq!(prompt[..late.len()], late[..]);
}

/// The residual must show the model error, also while ARX estimates the force nearly perfectly.
#[test]
fn a_seeded_arx_does_not_hide_the_residual() {
    let mut harness = Harness::thesis();
    harness.measure_free_run_plus(200.0, 1000);
    harness.run(0..1000, |_| true);
    assert_eq!(harness.pipeline.mode(), Mode::Arx);
    let last = harness.residuals().last().expect("residuals");
    assert!((last.residual.get() - 200.0).abs() < 1.0, "{last:?}");
    let estimate = harness.estimates().last().expect("estimates");
    assert!((estimate.force.get() - last.measured.get()).abs() < 40.0, "{estimate:?} {last:?}");
}

#[test]
fn a_change_of_mode_makes_no_step() {
    let mut harness = Harness::thesis();
    harness.constant_current = true;
    harness.measure_free_run_plus(100.0, 1200);
    harness.run(0..300, |_| true);
    harness.run(300..900, |_| false);
    harness.run(900..1200, |_| true);
    assert!(harness.events.iter().filter(|e| matches!(e, Event::Transition(_))).count() >= 5);
    // The simulation (free run) itself changes fast at steps of the current; the force added to it must not jump.
    let free = harness.free_run_n();
    let added: Vec<f64> =
        harness.estimates().zip(&free).skip(50).map(|(e, free)| e.force.get() - free).collect();
    let worst = added.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
    assert!(worst < 30.0, "without smoothing the switch would jump by 100 N: {worst}");
    assert!(added[800].abs() < 1.0, "600 samples after the force was lost nothing is added: {}", added[800]);
}

#[test]
fn settings_can_change_between_samples_and_bad_settings_are_rejected() {
    let mut harness = Harness::thesis();
    harness.run(0..100, |_| true);
    let before = *harness.pipeline.settings();
    let bad = Settings { coast_s: f64::NAN, ..before };
    assert!(harness.take(both(), bad).expect_err("NaN").to_string().contains("coast_s is NaN"));
    assert_eq!(*harness.pipeline.settings(), before);
    harness.take(both(), Settings { coast_s: 0.0, ..before }).expect("zero is in range");
    harness.run(100..200, |_| false);
    insta::assert_snapshot!(harness.transitions(), @"
       2 ms  fault -> model     the model's inputs are available
       8 ms  model -> arx       measured force is fresh
     244 ms  arx -> model       measured force is older than force_timeout_s
    ");
}

#[test]
fn models_are_swapped_without_a_gap_or_a_step() {
    let mut harness = Harness::thesis();
    harness.constant_current = true;
    harness.run(0..300, |_| false);
    let models = Models::alone(preset("thesis/fuzzy-tanh/rp1-cs"));
    harness.take(models, *harness.pipeline.settings()).expect("a preset fits the settings");
    harness.run(300..600, |_| false);
    let forces: Vec<f64> = harness.estimates().skip(5).map(|e| e.force.get()).collect();
    assert!(forces.iter().all(|f| f.is_finite()), "no gap");
    let steps: Vec<f64> = forces.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    let (before, at) = steps.split_at(290);
    let largest = |steps: &[f64]| steps.iter().copied().fold(0.0, f64::max);
    assert!(largest(&at[..10]) < 1.2 * largest(before), "{at:?}");
}

/// A swap to the same model with an offset of 300 N: the difference must be faded in.
#[test]
fn a_swap_to_a_model_that_is_higher_makes_no_step() {
    let free = preset("thesis/fuzzy-tanh/rp3-cs");
    let higher = Model { force: free.force.with_force_offset_n(free.force.force_offset_n() + 300.0), ..free };
    let mut harness = Harness::new(Settings { use_measured_force: UseForce::Never, ..Settings::default() });
    harness.run(0..300, |_| false);
    harness
        .take(Models::alone(higher), *harness.pipeline.settings())
        .expect("a model that fits the settings");
    harness.run(300..600, |_| false);
    let mut as_it_was = Harness::new(Settings { use_measured_force: UseForce::Never, ..Settings::default() });
    as_it_was.run(0..600, |_| false);
    let pairs = harness.estimates().zip(as_it_was.estimates());
    let added: Vec<f64> = pairs.map(|(now, then)| now.force.get() - then.force.get()).collect();
    assert!(added[..300].iter().skip(2).all(|n| *n == 0.0));
    let steps = added[299..].windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
    assert!(steps < 20.0, "without smoothing the swap would jump by 300 N: {steps}");
    assert!((added[599] - 300.0).abs() < 0.1, "{}", added[599]);
}

#[test]
fn without_any_current_the_estimate_is_invalid() {
    let mut harness = Harness::thesis();
    harness.without_drive = true;
    harness.run(0..100, |_| false);
    assert!(
        harness
            .estimates()
            .all(|e| { e.mode == Mode::Fault && e.validity == Validity::Invalid && e.force.get().is_nan() })
    );
    assert!(harness.estimates().skip(2).all(|e| e.reasons.has(Reasons::DRIVE_MISSING)));
}

#[test]
fn a_current_that_stops_is_flagged() {
    let mut harness = Harness::thesis();
    harness.run(0..100, |_| false);
    harness.without_drive = true;
    harness.run(100..500, |_| false);
    let last = harness.estimates().last().expect("estimates");
    assert!(last.reasons.has(Reasons::DRIVE_STALE) && last.validity == Validity::Stale, "{last:?}");
    assert!((last.input_age.get() - 400.0 / 512.0).abs() < 0.01, "{last:?}");
    assert!(last.force.is_finite(), "held, and flagged as stale");
}

#[test]
fn the_wrong_kind_of_drive_is_refused_with_the_reason() {
    let mut harness = Harness::thesis();
    harness.run(0..50, |_| false);
    harness.feed_reading(50, Reading::Drive(Drive::CommandVoltage(Volt(2.0))));
    harness.run(51..52, |_| false);
    let last = harness.estimates().last().expect("estimates");
    assert!(last.reasons.has(Reasons::WRONG_DRIVE), "{last:?}");
    assert_eq!(harness.refusals(), "drive: the model wants the other kind of drive");
}

#[test]
fn bad_values_are_refused_one_by_one() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for reading in [
            Reading::Displacement(Metre(bad)),
            Reading::Force(Newton(bad)),
            Reading::Drive(Drive::CoilCurrent(Ampere(bad))),
        ] {
            let mut clean = Harness::thesis();
            clean.run(0..200, |_| true);
            let mut dirty = Harness::thesis();
            dirty.run(0..100, |_| true);
            dirty.feed_reading(100, reading);
            dirty.run(100..200, |_| true);
            let bits =
                |harness: &Harness| harness.estimates().map(|e| e.force.get().to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&clean), bits(&dirty), "the bad sample does not change other estimates");
            let flagged: Vec<_> =
                dirty.estimates().filter(|e| e.reasons.has(Reasons::INPUT_REFUSED)).collect();
            assert_eq!(flagged.len(), 1, "the next estimate reports the refused sample");
        }
    }
}

#[test]
fn a_sample_ten_seconds_late_has_no_effect() {
    let mut harness = Harness::thesis();
    harness.run(0..6000, |_| true);
    let estimates = harness.estimates().count();
    harness.feed_reading(6000 - 5120, Reading::Displacement(Metre(0.01)));
    assert_eq!(harness.estimates().count(), estimates, "no estimate for the past");
    harness.run(6000..6100, |_| true);
    assert_eq!(harness.pipeline.mode(), Mode::Arx);
    assert_eq!(harness.refusals(), "displacement: its stamp is older than the one before");
}

#[test]
fn a_sample_that_arrives_long_after_its_stamp_is_flagged() {
    let mut harness = Harness::thesis();
    harness.run(0..50, |_| true);
    harness.delay_ns = 10_000_000_000;
    harness.run(50..100, |_| true);
    let last = harness.estimates().last().expect("estimates");
    assert!(last.reasons.has(Reasons::LATE) && last.validity == Validity::Stale, "{last:?}");
}

/// One stamp an hour ahead must not make all later samples count as too old.
#[test]
fn a_stamp_an_hour_ahead_affects_that_sample_only() {
    for reading in [
        Reading::Displacement(Metre(0.001)),
        Reading::Force(Newton(10.0)),
        Reading::Drive(Drive::CoilCurrent(Ampere(1.0))),
    ] {
        let mut clean = Harness::thesis();
        clean.run(0..200, |_| true);
        let mut dirty = Harness::thesis();
        dirty.run(0..100, |_| true);
        dirty.feed_ahead(100, 3_600_000_000_000, reading);
        dirty.run(100..200, |_| true);
        let bits =
            |harness: &Harness| harness.estimates().map(|e| e.force.get().to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&clean), bits(&dirty), "the bad sample does not change other estimates");
        let flagged: Vec<_> = dirty.estimates().filter(|e| e.reasons.has(Reasons::STAMP_AHEAD)).collect();
        assert!(flagged.len() == 1 && flagged[0].validity != Validity::Valid, "{flagged:?}");
        assert!(dirty.refusals().contains("later than its arrival"), "{}", dirty.refusals());
    }
}

/// With a publisher's clock an hour ahead there are estimates, but none is VALID; after the clock is corrected, they are VALID again.
#[test]
fn a_clock_an_hour_ahead_gives_flagged_estimates_until_it_is_corrected() {
    let mut harness = Harness::thesis();
    harness.epoch_ns = 3_600_000_000_000;
    harness.delay_ns = -3_600_000_000_000;
    harness.run(0..200, |_| true);
    assert_eq!(harness.pipeline.mode(), Mode::Arx);
    assert!(harness.estimates().count() > 190);
    assert!(
        harness.estimates().all(|e| e.validity != Validity::Valid && e.reasons.has(Reasons::STAMP_AHEAD))
    );
    (harness.epoch_ns, harness.delay_ns) = (0, 0);
    harness.run(200..400, |_| true);
    let last = harness.estimates().last().expect("estimates");
    assert_eq!((last.mode, last.validity), (Mode::Arx, Validity::Valid), "{last:?}");
}

#[test]
fn ten_times_the_rate_disables_arx_with_a_reason() {
    let mut harness = Harness::thesis();
    harness.period_ns = 195_312;
    harness.run(0..4000, |_| true);
    let last = harness.estimates().last().expect("estimates");
    assert_eq!(last.mode, Mode::Model);
    assert!(last.reasons.has(Reasons::RATE_MISMATCH), "{last:?}");
    assert_eq!(harness.estimates().count(), 4000, "every sample still has an estimate");
}

#[test]
fn a_gap_restarts_the_history_with_a_reason() {
    let mut harness = Harness::thesis();
    harness.run(0..300, |_| true);
    harness.run(400..700, |_| true);
    let after: Vec<_> = harness.estimates().skip(300).collect();
    assert!(after[0].reasons.has(Reasons::DISPLACEMENT_GAP));
    assert!(after[0].force.is_finite() && after[0].validity == Validity::Stale, "held: {:?}", after[0]);
    assert!(after[0].reasons.has(Reasons::NO_MODEL_RUNS), "{:?}", after[0]);
    let settled = after.iter().skip(50).all(|e| e.validity == Validity::Valid);
    assert!(settled, "{:?}", after.iter().skip(50).find(|e| e.validity != Validity::Valid));
}

#[test]
fn a_clock_that_jumps_back_restarts_the_pipeline() {
    let mut harness = Harness::thesis();
    harness.epoch_ns = 100_000_000_000;
    harness.run(0..200, |_| true);
    harness.epoch_ns = 0;
    harness.run(0..200, |_| true);
    let text = harness.transitions();
    assert!(text.contains("stamps jumped"), "{text}");
    assert_eq!(harness.pipeline.mode(), Mode::Arx, "ARX is used again");
}

#[test]
fn with_an_output_filter_measured_force_passes_the_same_filter() {
    let mut model = preset("thesis/fuzzy-tanh/rp3-cs");
    model.conditioning.apply_to = mr_damper_model::condition::ApplyTo::Output;
    let mut pipeline = Pipeline::new(Models::alone(model), Settings::default()).expect("a preset runs");
    // The measured force is the model's unfiltered force: behind equal filters the residual vanishes.
    let mr_damper_model::force::ForceModel::FuzzyTanh(fuzzy) = model.force else {
        panic!("a fuzzy-tanh preset")
    };
    let mut before: Option<f64> = None;
    let (mut worst, mut count) = (0.0_f64, 0);
    for k in 0..1000 {
        let [drive, mut force, displacement] = samples(k, 0);
        let x = displacement.reading.get();
        let v = before.map_or(0.0, |b| (x - b) * 512.0);
        before = Some(x);
        force.reading = Reading::Force(Newton(fuzzy.force_n(x, v, drive.reading.get())));
        for sample in [drive, force, displacement] {
            pipeline.step(&sample, &mut |event| {
                if let Event::Residual(r) = event {
                    count += 1;
                    if count > 2 {
                        worst = worst.max(r.residual.get().abs());
                    }
                }
            });
        }
    }
    assert!(count > 990 && worst < 0.05, "{count} {worst}");
}

#[test]
fn an_arx_model_with_an_output_filter_is_rejected() {
    let settings =
        Settings { filter: Some((mr_damper_model::condition::ApplyTo::Output, 20.0)), ..Settings::default() };
    let refused = Pipeline::new(Models::alone(preset("thesis/arx-passive/rp-icps")), settings);
    assert!(refused.expect_err("refused").to_string().contains("inputs or none"));
}

#[test]
fn overload_is_reported_once() {
    let mut harness = Harness::thesis();
    harness.run(0..50, |_| true);
    harness.pipeline.note_overload();
    harness.run(50..60, |_| true);
    assert_eq!(harness.estimates().filter(|e| e.reasons.has(Reasons::OVERLOAD)).count(), 1);
}

#[test]
fn an_estimate_has_the_stamp_of_its_displacement() {
    let mut harness = Harness::thesis();
    harness.run(0..20, |_| true);
    let stamps: Vec<Stamp> = harness.estimates().map(|e| e.stamp).collect();
    let expected: Vec<Stamp> = (0..20).map(|k| samples(k, 0)[2].stamp).collect();
    assert_eq!(stamps, expected);
}
