//! Paired mode on a machine that repeats one motion: runs that begin at another crank angle, with another zero of the displacement, another
//! mean force, and another temperature than their reference.

use crate::diagnosis::outcome::names;
use mr_damper_model::Error;
use mr_damper_model::condition::Conditioning;
use mr_damper_model::diagnose::{DiagnosisResult, FloorSource, Runs, Settings, Verdict, close};
use mr_damper_model::error::{DiagnosisError, IdentifyError};
use mr_damper_model::identify::{Dataset, DatasetOptions, ModelSpec, Options, Watch, identify_datasets};
use mr_damper_model::rig::inject::inject;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use std::sync::LazyLock;

/// Rows of a sine of 1.05 Hz, from sample `from` on, with the displacement shifted by `zero_m`.
fn rows(plant: &Plant, channels: &Channels, seed: u64, from: usize, zero_m: f64) -> Dataset {
    let mut run = record(&Experiment::sine(0.0185, 1.05, 1.2, 14.0), plant, channels, seed);
    run.displacement_m.stamps.drain(..from);
    run.displacement_m.values.drain(..from);
    run.displacement_m.values.iter_mut().for_each(|x_m| *x_m += zero_m);
    Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default()).expect("rows")
}

/// Training and validation run of the healthy damper.
static HEALTHY: LazyLock<[Dataset; 2]> =
    LazyLock::new(|| [1, 2].map(|seed| rows(&Plant::plain(), &Channels::default(), seed, 0, 0.0)));

/// The diagnosis of `plant` and `channels` against the healthy damper. The runs begin 11 ms later and have another zero of the displacement.
fn since_healthy(plant: &Plant, channels: &Channels) -> Result<DiagnosisResult, Error> {
    let options = Options { restarts: 3, ..Options::default() };
    let base = identify_datasets(ModelSpec::FUZZY_TANH, &HEALTHY[..1], &options, &Watch::none())?.model;
    let [estimate, confirm] = [3, 4].map(|seed| [rows(plant, channels, seed, 6, 0.0019)]);
    let runs = Runs { estimate: &estimate, confirm: &confirm, reference: &*HEALTHY, ..Runs::default() };
    close(&base, &runs, &Settings::default(), &Watch::none(), &|_| {})
}

#[test]
fn runs_that_were_cut_at_another_phase_show_no_change() -> Result<(), Error> {
    let found = since_healthy(&Plant::plain(), &Channels::default())?;
    assert_eq!((names(&found), found.verdict), (vec![], Verdict::NothingToExplain), "{found:?}");
    assert_eq!(found.noise_floor.source, FloorSource::Cycles);
    assert_eq!(found.alignments.len(), 2);
    for alignment in &found.alignments {
        assert!(
            alignment.period_s.is_some_and(|period_s| (period_s * 1.05 - 1.0).abs() < 1e-3),
            "{alignment:?}"
        );
        // The zero is the run's; the lag is counted from each run's first row.
        assert!((alignment.offset_m - 0.0019).abs() < 1e-4, "{alignment:?}");
        assert!((alignment.lag_s - 6.0 / 512.0).abs() < 1e-3, "{alignment:?}");
    }
    assert!(found.causes_of_mean_shift().is_empty(), "{:?}", found.mean_shift);
    Ok(())
}

#[test]
fn friction_is_found_at_another_phase() -> Result<(), Error> {
    let (mut plant, mut channels) = (Plant::plain(), Channels::default());
    inject("friction", 80.0, &mut plant, &mut channels)?;
    let found = since_healthy(&plant, &channels)?;
    assert!(found.effects.iter().any(|named| named.class.contains(&"friction")), "{found:?}");
    Ok(())
}

#[test]
fn more_gas_is_a_spring_and_a_change_of_the_mean_force() -> Result<(), Error> {
    let (mut plant, mut channels) = (Plant::plain(), Channels::default());
    inject("gas_spring", 3000.0, &mut plant, &mut channels)?;
    // The rod is pushed out, which reads as a negative force.
    channels.force_offset_n -= 150.0;
    let found = since_healthy(&plant, &channels)?;
    assert_eq!(names(&found), ["gas_spring"], "{found:?}");
    assert!(
        found.mean_shift.is_some_and(|shift| shift.is_proved() && shift.force_n < -20.0),
        "{:?}",
        found.mean_shift
    );
    assert_eq!(found.causes_of_mean_shift(), ["gas_pressure"]);
    // Without the spring, the zero of the load cell may have moved as well.
    let mut channels = Channels::default();
    channels.force_offset_n -= 39.0;
    let found = since_healthy(&Plant::plain(), &channels)?;
    assert_eq!(names(&found), Vec::<&str>::new());
    let shift = found.mean_shift.expect("there are cycles");
    assert!((-40.0..-38.0).contains(&shift.force_n) && shift.ci95_n[0] < shift.force_n, "{shift:?}");
    assert_eq!(found.causes_of_mean_shift(), ["gas_pressure", "load_cell_zero"]);
    Ok(())
}

#[test]
fn a_reversed_load_cell_is_refused_before_anything_is_fitted() -> Result<(), Error> {
    let mut reversed = HEALTHY[0].clone();
    reversed
        .rows
        .iter_mut()
        .for_each(|row| (row.force_n, row.raw_force_n) = (-row.force_n, -row.raw_force_n));
    let fitted =
        identify_datasets(ModelSpec::FUZZY_TANH, &[reversed.clone()], &Options::default(), &Watch::none());
    let Err(Error::Identify(IdentifyError::ReversedForce { correlation, power_w, .. })) = fitted else {
        panic!("{fitted:?}")
    };
    assert!(correlation < -0.5 && power_w < 0.0, "{correlation} {power_w} W");
    let options = Options { restarts: 3, ..Options::default() };
    let base = identify_datasets(ModelSpec::FUZZY_TANH, &HEALTHY[..1], &options, &Watch::none())?.model;
    let runs = Runs { estimate: &HEALTHY[..1], confirm: &[reversed], ..Runs::default() };
    let refused =
        close(&base, &runs, &Settings::default(), &Watch::none(), &|_| {}).expect_err("reversed").to_string();
    assert!(refused.contains("force and velocity have opposite signs"), "{refused}");
    Ok(())
}

#[test]
fn a_reference_of_another_motion_or_current_is_refused() -> Result<(), Error> {
    let options = Options { restarts: 3, ..Options::default() };
    let base = identify_datasets(ModelSpec::FUZZY_TANH, &HEALTHY[..1], &options, &Watch::none())?.model;
    let run = record(&Experiment::sine(0.0185, 1.05, 1.6, 14.0), &Plant::plain(), &Channels::default(), 5);
    let other = [Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default())?];
    let runs = Runs { estimate: &HEALTHY[..1], confirm: &HEALTHY[1..], reference: &other, ..Runs::default() };
    let refused = close(&base, &runs, &Settings::default(), &Watch::none(), &|_| {});
    assert!(matches!(refused, Err(Error::Diagnosis(DiagnosisError::NoReference { .. }))), "{refused:?}");
    Ok(())
}

/// On one motion, a spring, a mass and a delay look alike, and the base, which is of another structure than the damper, has no phase of its
/// own. A named effect must be the true one, or have it in its class.
#[test]
fn what_is_named_on_one_motion_is_there() -> Result<(), Error> {
    let found = |id: &str, size: f64, seed: u64| -> Result<DiagnosisResult, Error> {
        let (mut plant, mut channels) = (Plant::plain(), Channels::default());
        if size != 0.0 {
            inject(id, size, &mut plant, &mut channels)?;
        }
        let options = Options { restarts: 3, seed, ..Options::default() };
        let own = |k: u64| 100 * seed + k;
        let reference = [1, 2].map(|k| rows(&Plant::plain(), &Channels::default(), own(k), 0, 0.0));
        let base = identify_datasets(ModelSpec::FUZZY_TANH, &reference[..1], &options, &Watch::none())?.model;
        let from = 6 + 31 * seed as usize;
        let [estimate, confirm] = [3, 4].map(|k| [rows(&plant, &channels, own(k), from, 0.0019)]);
        let runs = Runs { estimate: &estimate, confirm: &confirm, reference: &reference, ..Runs::default() };
        close(&base, &runs, &Settings::default(), &Watch::none(), &|_| {})
    };
    for seed in 0..12 {
        let found = found("friction", 0.0, seed)?;
        assert_eq!(names(&found), Vec::<&str>::new(), "seed {seed}: {found:?}");
    }
    let sizes = [
        ("friction", 20.0, true),
        ("asymmetry", 0.15, true),
        ("gas_spring", 500.0, true),
        ("deadzone", 3e-4, true),
        ("position_dependence", 5.0, true),
        ("velocity_saturation", 3000.0, true),
        ("force_lag", 0.003, true),
        ("sensor_delay", 0.003, true),
        ("series_spring", 4e-7, true),
        ("inertia", 2.5, false),
        ("thermal_fade", -0.004, false),
    ];
    for (id, size, is_named) in sizes {
        let found = found(id, size, 0)?;
        let truth = if id == "series_spring" { "force_lag" } else { id };
        assert!(found.effects.iter().all(|named| named.class.contains(&truth)), "{id}: {:?}", found.effects);
        assert_eq!(!found.effects.is_empty(), is_named, "{id}: {found:?}");
    }
    Ok(())
}
