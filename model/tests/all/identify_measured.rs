//! Identification on measured runs of real dampers, split by run: the figures are on runs that were not used for the fit.
//!
//! The data are not part of this repository. `MR_DAMPER_DATA` is their folder (default `../shared/data` from the workspace). Without
//! them these tests are ignored.

use crate::measured::folder;
use mr_damper_model::force::{ForceModel, Form, FreeRun};
use mr_damper_model::identify::{Dataset, Identified, ModelSpec, Options, Watch, identify};
use mr_damper_model::metrics::ErrorSum;
use mr_damper_model::model::Model;
use mr_damper_model::sample::{Run, Trace};

/// A part of a run, by shares of its samples.
fn part(run: &Run, from: f64, to: f64) -> Run {
    let len = run.displacement_m.len() as f64;
    let range = (from * len) as usize..(to * len) as usize;
    let cut = |t: &Trace| Trace {
        stamps: t.stamps[range.clone()].to_vec(),
        values: t.values[range.clone()].to_vec(),
    };
    Run {
        name: run.name.clone(),
        displacement_m: cut(&run.displacement_m),
        velocity_m_s: run.velocity_m_s.as_ref().map(cut),
        force_n: run.force_n.as_ref().map(cut),
        drive: run.drive.as_ref().map(|(kind, trace)| (*kind, cut(trace))),
        ..Run::default()
    }
}

/// Mean over the runs of the NMSE (thesis: ESR) in simulation (free run) on raw force, with each run's mean error removed.
fn mean_esr(model: &Model, runs: &[Run], options: &Options) -> f64 {
    let esr = |run: &Run| {
        let rows = Dataset::from_run(run, &model.conditioning, &options.dataset).expect("rows").rows;
        let (mut sum, mut state) = (ErrorSum::default(), FreeRun::default());
        for row in rows {
            let force_n = model.force.free_run(&mut state, &row.inputs());
            if row.counts {
                sum.add(row.raw_force_n, force_n.unwrap_or(f64::NAN));
            }
        }
        sum.fit_without_offset().expect("rows that count").esr
    };
    runs.iter().map(esr).sum::<f64>() / runs.len() as f64
}

fn find(spec: ModelSpec, runs: &[Run]) -> Identified {
    identify(spec, runs, &Options { restarts: 10, ..Options::default() }, &Watch::none()).expect("identifies")
}

fn centres(found: &Identified) -> Vec<f64> {
    match found.model.force {
        ForceModel::FuzzyTanh(fuzzy) => fuzzy.sets().centres().to_vec(),
        _ => panic!("asked for fuzzy-tanh"),
    }
}

fn near(found: &[f64], expected: &[f64], tolerance: f64) -> bool {
    found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < tolerance)
}

#[test]
#[ignore = "needs the measured runs: set MR_DAMPER_DATA"]
fn a_model_of_sines_predicts_faster_sines() {
    let runs = folder("utfsm-mr");
    let (test, train): (Vec<Run>, Vec<Run>) =
        runs.into_iter().partition(|run| run.name.contains("5mm4hz") || run.name.contains("2mm5hz"));
    assert_eq!((train.len(), test.len()), (20, 10));
    let found = find(ModelSpec::FUZZY_TANH, &train);
    assert!(near(&centres(&found), &[0.0, 0.25, 0.5, 0.75, 1.0], 1e-9), "{:?}", centres(&found));
    // One tanh function per level with a velocity from both sides of a sample, which a live system cannot have, reaches 0.0715. Measured
    // here: 0.0260.
    let esr = mean_esr(&found.model, &test, &Options::default());
    assert!(esr < 0.030, "{esr} {:?}", found.velocity_trials);
    assert!(found.active_bounds.is_empty() && found.converged, "{:?}", found.active_bounds);
}

#[test]
#[ignore = "needs the measured runs: set MR_DAMPER_DATA"]
fn random_motion_with_a_switching_command() {
    let runs = folder("nees-mr");
    let (train, test) = (part(&runs[0], 0.0, 2.0 / 3.0), part(&runs[0], 2.0 / 3.0, 1.0));
    let found = find(ModelSpec::FUZZY_TANH, std::slice::from_ref(&train));
    assert!(
        near(&centres(&found), &[0.0, 2.26], 0.02),
        "ramps do not count as levels: {:?}",
        centres(&found)
    );
    // The coil lag is not in the model. With a velocity from both sides of a sample: 0.115. Measured here, causal: 0.1354.
    let esr = mean_esr(&found.model, std::slice::from_ref(&test), &Options::default());
    assert!(esr < 0.145, "{esr} {:?}", found.velocity_trials);

    let found = find(ModelSpec::ARX_SEMI_ACTIVE, &[train]);
    let (one_step, persistence) = (found.one_step.expect("figures"), found.persistence.expect("figures"));
    assert!(one_step.esr < 0.5 * persistence.esr, "{one_step:?} {persistence:?}");
}

#[test]
#[ignore = "needs the measured runs: set MR_DAMPER_DATA"]
fn near_sines_at_four_voltages() {
    let runs = folder("utfpr-mr");
    let half = |first: usize| runs.iter().skip(first).step_by(2).cloned().collect::<Vec<Run>>();
    let (train, test) = (half(0), half(1));
    let found = find(ModelSpec::FUZZY_TANH, &train);
    assert!(near(&centres(&found), &[0.0, 0.871, 1.98, 3.212], 1e-2), "{:?}", centres(&found));
    // Measured here: 0.0276.
    let esr = mean_esr(&found.model, &test, &Options::default());
    assert!(esr < 0.031, "{esr} {:?}", found.velocity_trials);
}

/// Whole runs are held out, as in the tests of fuzzy-tanh above.
#[test]
#[ignore = "needs the measured runs: set MR_DAMPER_DATA"]
fn bristles_reduce_the_error_on_measured_runs() {
    let bristles = ModelSpec::named("maxwell-slip", Form::SemiActive).expect("a form of the model");
    let sines = folder("utfsm-mr").into_iter();
    let (test, train): (Vec<Run>, Vec<Run>) =
        sines.partition(|run| run.name.contains("5mm4hz") || run.name.contains("2mm5hz"));
    let found = find(bristles, &train);
    let esr = mean_esr(&found.model, &test, &Options::default());
    // Measured here: 0.0222; fuzzy-tanh 0.0260.
    println!("utfsm-mr: {esr:.4} {:?}", found.model.conditioning);
    assert!(found.converged && esr < 0.024, "{esr} {:?}", found.velocity_trials);

    let runs = folder("utfpr-mr");
    let half = |first: usize| runs.iter().skip(first).step_by(2).cloned().collect::<Vec<Run>>();
    let found = find(bristles, &half(0));
    let esr = mean_esr(&found.model, &half(1), &Options::default());
    // Measured here: 0.0253; fuzzy-tanh 0.0276.
    println!("utfpr-mr: {esr:.4} {:?}", found.model.conditioning);
    assert!(found.converged && esr < 0.027, "{esr} {:?}", found.velocity_trials);
}
