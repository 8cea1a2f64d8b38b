//! Rows of a dataset compared with the live pipeline, and the rows that count.

use crate::identify_support::{Recipe, run, truth};
use mr_damper_model::condition::{ApplyTo, Conditioning, LowPassState, VelocitySource};
use mr_damper_model::effect::Effects;
use mr_damper_model::force::ForceModel;
use mr_damper_model::identify::{Dataset, DatasetOptions};
use mr_damper_model::model::{Envelope, Expected, Model};
use mr_damper_model::pipeline::{Event, Models, Pipeline, Settings, UseForce};
use mr_damper_model::sample::{DriveKind, Run, Stamp, Trace};

const KIND: DriveKind = DriveKind::CoilCurrent;

/// A run whose channels have different rates, with a gap in the displacement.
fn uneven() -> Run {
    let model = truth(KIND);
    let recipe =
        Recipe { duration_s: 2.0, drive: |t| (3.0 * t).sin().abs(), offset_n: 20.0, ..Recipe::default() };
    let make = |rate_hz| run(Recipe { rate_hz, ..recipe }, KIND, |x, v, i| model.force_n(x, v, i));
    let cut = |trace: Trace| {
        let kept = |stamp: &Stamp| !(800_000_000..1_050_000_000).contains(&stamp.nanos());
        let (stamps, values) =
            trace.stamps.into_iter().zip(trace.values).filter(|(stamp, _)| kept(stamp)).unzip();
        Trace { stamps, values }
    };
    Run {
        displacement_m: cut(make(500.0).displacement_m),
        velocity_m_s: make(320.0).velocity_m_s,
        drive: make(110.0).drive,
        force_n: make(770.0).force_n,
        ..Run::default()
    }
}

/// The same run without the gap, read at even times; the stamps of displacement and force jitter.
fn jittered() -> Run {
    let model = truth(KIND);
    let recipe = Recipe { rate_hz: 500.0, duration_s: 2.0, drive: |_| 1.0, ..Recipe::default() };
    let even = run(recipe, KIND, |x, v, i| model.force_n(x, v, i));
    let jitter = |trace: Trace| {
        // Up to 0.8 ms late, without a pattern.
        let late = |k: usize| ((k as f64 * 0.618_034 + (k as f64 * 1.7).sin()).rem_euclid(1.0) * 8e5) as i64;
        let stamps = trace.stamps.iter().enumerate().map(|(k, stamp)| stamp.shifted(late(k))).collect();
        Trace { stamps, ..trace }
    };
    Run { displacement_m: jitter(even.displacement_m), force_n: even.force_n.map(jitter), ..even }
}

#[test]
fn rows_match_the_live_pipeline() {
    for run in [uneven(), jittered()] {
        assert_rows_match(&run);
    }
}

fn assert_rows_match(run: &Run) {
    for apply_to in [ApplyTo::None, ApplyTo::Inputs, ApplyTo::Output] {
        for velocity in [VelocitySource::Backward, VelocitySource::Slope, VelocitySource::Measured] {
            let conditioning = Conditioning { apply_to, velocity, ..Conditioning::default() };
            let fuzzy = truth(KIND);
            let model = Model {
                force: ForceModel::FuzzyTanh(fuzzy),
                effects: Effects::NONE,
                conditioning,
                rate_hz: 500.0,
                envelope: Envelope::default(),
                expected: Expected::default(),
                inverse: None,
            };
            let settings = Settings { use_measured_force: UseForce::Never, ..Settings::default() };
            let mut pipeline = Pipeline::new(Models::alone(model), settings).expect("settings hold");
            let mut live: Vec<(Stamp, f64, f64)> = Vec::new();
            for sample in run.samples() {
                pipeline.step(&sample, &mut |event| {
                    if let Event::Residual(r) = event {
                        live.push((r.stamp, r.measured.get(), r.predicted.get()));
                    }
                });
            }
            let set = Dataset::from_run(run, &conditioning, &DatasetOptions::default()).expect("rows");
            let (filter, mut state, mut fresh) = (conditioning.low_pass(), LowPassState::default(), true);
            let mut compared = 0;
            for row in &set.rows {
                let mut predicted = fuzzy.force_n(row.displacement_m, row.velocity_m_s, row.drive);
                if apply_to == ApplyTo::Output && predicted.is_finite() {
                    predicted = filter.step(&mut state, row.dt_s.filter(|_| !fresh), predicted);
                    fresh = false;
                }
                let Some((_, measured_n, predicted_n)) =
                    live.iter().find(|(stamp, _, _)| *stamp == row.stamp)
                else {
                    assert!(!row.counts, "{conditioning:?}: the pipeline lacks {:?}", row.stamp);
                    continue;
                };
                assert!(
                    (predicted - predicted_n).abs() < 1e-9,
                    "{conditioning:?}: {predicted} {predicted_n}"
                );
                // The filter of the force starts with the first known force, which may differ between the two; 1 % of the difference
                // remains.
                if row.counts {
                    let tolerance = if apply_to == ApplyTo::Output { 5.0 } else { 1e-9 };
                    assert!(
                        (row.force_n - measured_n).abs() < tolerance,
                        "{conditioning:?}: {row:?} {measured_n}"
                    );
                    compared += 1;
                }
            }
            assert!(compared > 600, "{conditioning:?}: {compared}");
        }
    }
}

#[test]
fn only_the_moving_part_counts() {
    // Rest from 0 to 2 s, a sine to 6 s, rest to 8 s; the displacement sensor flickers by one step all the time.
    let trace = |f: &dyn Fn(f64) -> f64| Trace {
        stamps: (0..8000).map(|k| Stamp::from_nanos(k * 1_000_000)).collect(),
        values: (0..8000).map(|k| f(f64::from(k) * 1e-3)).collect(),
    };
    let moving = |t: f64| (2.0..6.0).contains(&t);
    let flicker = |t: f64| if (t * 1000.0).round() as i64 % 2 == 0 { 0.0 } else { 2e-5 };
    let run = Run {
        name: "rests".to_owned(),
        displacement_m: trace(
            &|t| if moving(t) { 0.01 * (std::f64::consts::TAU * t).sin() } else { 0.0 } + flicker(t),
        ),
        force_n: Some(trace(&|t| if moving(t) { 100.0 } else { 0.0 })),
        ..Run::default()
    };
    let set =
        |options: DatasetOptions| Dataset::from_run(&run, &Conditioning::default(), &options).expect("rows");
    let counted = set(DatasetOptions::default());
    let stamps: Vec<f64> =
        counted.rows.iter().filter(|row| row.counts).map(|row| row.stamp.nanos() as f64 * 1e-9).collect();
    let (first, last) = (stamps[0], stamps[stamps.len() - 1]);
    assert!((1.88..1.92).contains(&first) && (6.08..6.12).contains(&last), "{first} {last}");
    assert!(
        stamps.windows(2).all(|pair| pair[1] - pair[0] < 0.0015),
        "turning points are part of the motion"
    );
    let all = set(DatasetOptions { moving_only: false, ..DatasetOptions::default() });
    // The first two rows do not count: velocity needs one, acceleration another.
    assert_eq!(all.counted(), 7998);
    assert_eq!(all.envelope.force_n, Some([0.0, 100.0]));
    assert_eq!(counted.drive, None);
    let thinned =
        set(DatasetOptions { rate_hz: Some(250.0), moving_only: false, ..DatasetOptions::default() });
    assert_eq!((thinned.counted(), thinned.rate_hz.round()), (1998, 250.0));
}

#[test]
fn stretches_are_segments_spread_over_the_whole_run() {
    let trace = |f: fn(f64) -> f64| Trace {
        stamps: (0..20_000).map(|k| Stamp::from_nanos(k * 1_000_000)).collect(),
        values: (0..20_000).map(|k| f(f64::from(k) * 1e-3)).collect(),
    };
    let run = Run {
        name: "long".to_owned(),
        displacement_m: trace(|t| 0.01 * (6.0 * t).sin()),
        force_n: Some(trace(|t| 100.0 * (6.0 * t).cos())),
        ..Run::default()
    };
    let all = Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default()).expect("rows");
    let some = all.stretches(4);
    let starts = some.rows.iter().filter(|row| row.dt_s.is_none()).count();
    assert_eq!((some.rows.len(), starts), (5 * 1024, 5), "one stretch of 1024 rows from each 4096");
    assert!(some.rows.windows(2).all(|pair| pair[0].stamp < pair[1].stamp));
    let last = some.rows[some.rows.len() - 1].stamp.nanos();
    assert!(last > 18_000_000_000, "the end of the run is included: {last}");
    assert_eq!(all.stretches(1).rows.len(), all.rows.len());
}
