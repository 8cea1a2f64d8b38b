//! The cases for testing the diagnosis: their contents, a few diagnoses, and the counting of rates.

use crate::diagnosis::cases::{Case, CaseSpec, Kind, OUTSIDE, catalogue, sizes, spec};
use crate::diagnosis::intervals::interval;
use crate::diagnosis::outcome::{Instrumentation, Named, Outcome, Prepared, diagnose, names};
use crate::diagnosis::rates::{Rate, Row, library_id};
use mr_damper_model::Error;
use mr_damper_model::diagnose::{Change, DiagnosisResult, Settings, Verdict};
use mr_damper_model::effect::Effect;
use mr_damper_model::force::law::Scale;
use mr_damper_model::sample::Run;
use std::collections::HashSet;

fn force(run: &Run) -> &[f64] {
    run.force_n.as_ref().map_or(&[], |trace| &trace.values)
}

#[test]
fn the_catalogue_has_every_effect_of_the_library_at_three_physical_sizes() {
    let put_in: HashSet<_> = sizes().iter().filter_map(|(id, _)| library_id(id)).collect();
    assert_eq!(put_in, Effect::ALL.into_iter().map(Effect::id).collect());
    assert!(OUTSIDE.iter().all(|(id, _)| library_id(id).is_none()));
    let specs = catalogue();
    let names: HashSet<String> = specs.iter().map(CaseSpec::name).collect();
    assert_eq!(names.len(), specs.len());
    for (id, full) in sizes() {
        for share in [0.5, 1.0, 2.0] {
            let size = full * share;
            assert_eq!(spec(&format!("single {id} x{share}")).truth, [(id, size)]);
            let form = (id == "series_spring").then_some("series_spring");
            let effect = Effect::ALL
                .into_iter()
                .find(|e| Some(e.id()) == library_id(id) && (form.is_none() || e.form() == form));
            let parameter = effect.expect("in the library").parameters()[0];
            let [low, high] = parameter.range;
            // Ranges relative to the data are not checked here.
            assert!(parameter.scale != Scale::ONE || (low..=high).contains(&size), "{id} {size}");
        }
    }
}

#[test]
fn runs_of_a_case_differ_and_the_reference_differs_from_the_test_run_by_effect_and_noise() -> Result<(), Error>
{
    let case = spec("paired friction x1").case(3)?;
    let Case { estimate, confirm, test, reference, .. } = &case;
    let x = |run: &Run| run.displacement_m.values.clone();
    let apart = |a: &Run, b: &Run| {
        let off = x(a).iter().zip(x(b)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert_eq!(a.displacement_m.len(), 15_360);
        off
    };
    assert!(apart(&estimate[0], &confirm[0]) > 5e-3 && apart(&confirm[0], &test[0]) > 5e-3);
    let reference = &reference[2];
    let off = apart(&test[0], reference);
    assert!(off > 1e-6 && off < 4e-5, "{off} m");
    // The difference is 80 N of friction and the 3 N of noise of both runs.
    let change = force(&test[0]).iter().zip(force(reference)).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let rms = (change / 15_360.0).sqrt();
    assert!((60.0..82.0).contains(&rms), "{rms} N");
    let again = spec("paired friction x1").case(3)?;
    assert_eq!((&again.test, &again.reference), (&case.test, &case.reference));
    assert_ne!(spec("paired friction x1").case(4)?.test, case.test);
    assert!(spec("single friction x1").case(3)?.reference.is_empty());
    Ok(())
}

#[test]
fn every_effect_changes_the_force_and_a_larger_one_changes_it_more() -> Result<(), Error> {
    assert_eq!(spec("null").change(0)?, 0.0);
    for (id, _) in sizes() {
        let half = spec(&format!("single {id} x0.5")).change(0)?;
        let double = spec(&format!("single {id} x2")).change(0)?;
        // Noise is 0.7 % of the force.
        assert!(half > 0.001 && half < 0.2 && double > 1.4 * half && double < 0.5, "{id}: {half} {double}");
    }
    for (id, _) in OUTSIDE {
        let change = spec(&format!("outside {id} x1")).change(0)?;
        assert!((0.02..0.2).contains(&change), "{id}: {change}");
    }
    Ok(())
}

/// The counts of one outcome.
fn counted(spec: &CaseSpec, outcome: &Outcome) -> Row {
    let mut row = Row::default();
    row.take(spec, outcome, None, 0.0);
    row
}

/// A few of the cases that `examples/diagnosis_rates.rs` counts over hundreds of seeds.
#[test]
fn only_effects_that_are_present_are_named() -> Result<(), Error> {
    for name in ["null", "wrong base null", "outside force_loss x1", "paired null"] {
        let outcome = diagnose(&spec(name).case(1)?, &[], Instrumentation::Displacement)?;
        assert!(outcome.named.is_empty(), "{name}: {outcome:?}");
    }
    for name in
        ["single coil_lag x1", "single asymmetry x0.5", "pair coil_lag + gas_spring x1", "paired friction x1"]
    {
        let spec = spec(name);
        let outcome = diagnose(&spec.case(1)?, &[], Instrumentation::Displacement)?;
        let row = counted(&spec, &outcome);
        assert_eq!((row.right.hits, row.wrong.hits), (1, 0), "{name}: {outcome:?}");
        assert!(row.error() < 0.1, "{name}: {outcome:?}");
        assert!(outcome.removed.is_some_and(|share| share > 0.9), "{name}: {outcome:?}");
        assert_eq!(outcome.verdict, Verdict::Explained, "{name}");
    }
    // A drift of 0.1 N/s, which is negligible next to the misfit of a finite-difference velocity.
    let outcome = diagnose(&spec("single load_cell_drift x0.5").case(1)?, &[], Instrumentation::Velocity)?;
    assert_eq!(
        outcome.named.iter().map(|named| named.ids[0].as_str()).collect::<Vec<_>>(),
        ["load_cell_drift"]
    );
    assert!(outcome.removed.is_some_and(|share| share > 0.8), "{outcome:?}");
    Ok(())
}

#[test]
fn long_runs_are_searched_on_stretches_and_fitted_as_a_whole() -> Result<(), Error> {
    let spec = spec("single coil_lag x1");
    let mut case = spec.case(1)?;
    for seed in [2, 3] {
        let more = spec.case(seed)?;
        case.estimate.extend(more.estimate);
        case.confirm.extend(more.confirm);
    }
    let prepared = Prepared::new(&case, &[], Instrumentation::Displacement)?;
    let diagnose =
        |most_samples| prepared.diagnose(&Settings { most_terms: 0, most_samples, ..Settings::default() });
    // A stretch of 9.3 s from each run.
    let (whole, short) = (diagnose(usize::MAX)?, diagnose(20_480)?);
    assert_eq!(whole.searched, None);
    let searched = short.searched.expect("runs of 90 s");
    assert!((searched.used_s - 28.0).abs() < 1.0 && (searched.of_s - 90.0).abs() < 3.0, "{searched:?}");
    assert_eq!((names(&whole), names(&short)), (vec!["coil_lag"], vec!["coil_lag"]));
    let lag = |result: &DiagnosisResult| result.effects[0].parameters[0];
    let ([low, high], value) = (lag(&whole).ci95, lag(&short).value);
    assert!(low < value && value < high && (value / lag(&whole).value - 1.0).abs() < 2e-3, "{value} s");
    // All validation runs and the test run, with the models that are fitted to all training runs.
    let errors = |result: &DiagnosisResult| {
        let runs = result.confirm.iter().chain(result.test.iter().flat_map(|test| &test.runs));
        runs.flat_map(|run| [run.before.rsse_n, run.after.rsse_n]).collect::<Vec<_>>()
    };
    assert_eq!(errors(&short).len(), 8);
    for (whole_n, short_n) in errors(&whole).into_iter().zip(errors(&short)) {
        assert!((short_n / whole_n - 1.0).abs() < 5e-3, "{short_n} and {whole_n} N");
    }
    assert_eq!(short.verdict, whole.verdict);
    Ok(())
}

/// Likewise, with the structure of the base chosen.
#[test]
fn a_chosen_base_shows_only_effects_that_are_present() -> Result<(), Error> {
    // The structure of fuzzy-tanh lacks the memory of this damper.
    let lag = spec("wrong base coil_lag x1");
    let outcome = diagnose(&lag.case(1)?, &lag.healthy(7)?.estimate, Instrumentation::Auto)?;
    let row = counted(&lag, &outcome);
    assert_eq!((row.right.hits, row.wrong.hits), (1, 0), "{outcome:?}");
    assert!(row.error() < 0.1, "{outcome:?}");
    // The spring in series is there when the damper is healthy, the lag is not.
    let changes: Vec<_> = outcome.named.iter().map(|named| (named.ids[0].as_str(), named.change)).collect();
    assert_eq!(changes, [("coil_lag", Some(Change::New)), ("force_lag", Some(Change::None))]);
    // No structure follows the breakaway force of the bristles, which must not become an effect. A gas spring cannot be named: the
    // Bouc-Wen law has a stiffness of its own.
    let gas = spec("wrong base (bristle) gas_spring x1");
    let outcome = diagnose(&gas.case(400)?, &[], Instrumentation::Auto)?;
    assert_eq!(counted(&gas, &outcome).wrong.hits, 0, "{outcome:?}");
    // Before stamps, noise in the velocity and runs with one current were considered, these named inertia, a velocity saturation, and
    // an asymmetry.
    for name in ["null, jitter", "null, 12 bit", "wrong base null, one current"] {
        let spec = spec(name);
        let outcome = diagnose(&spec.case(500)?, &[], Instrumentation::Auto)?;
        assert_eq!(counted(&spec, &outcome).wrong.hits, 0, "{name}: {outcome:?}");
    }
    Ok(())
}

#[test]
fn wilson_intervals_match_published_tables() {
    let near = |hits, of, expected: [f64; 2]| {
        let found = Rate { hits, of }.interval();
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 5e-4), "{hits}/{of}: {found:?}");
    };
    near(0, 200, [0.0, 0.0188]);
    near(10, 20, [0.2993, 0.7007]);
    near(19, 20, [0.7639, 0.9911]);
    near(0, 0, [0.0, 1.0]);
}

#[test]
fn a_named_class_is_right_if_it_contains_a_true_effect_and_wrong_otherwise() {
    let named = |ids: &[&str], value| Named {
        ids: ids.iter().map(|id| (*id).to_owned()).collect(),
        form: None,
        value,
        change: None,
    };
    let outcome = |named: &[Named]| Outcome {
        before: 1.0,
        after: None,
        removed: None,
        over_noise_n2: [1.0; 2],
        named: named.to_vec(),
        verdict: Verdict::Unexplained,
    };
    let counts = |name: &str, named: &[Named]| {
        let mut row = Row::default();
        row.take(&spec(name), &outcome(named), None, 0.0);
        (row.right.hits, row.wrong.hits)
    };
    assert_eq!(counts("null", &[]), (1, 0));
    assert_eq!(counts("null", &[named(&["friction"], 3.0)]), (1, 1));
    let class = named(&["inertia", "sensor_delay"], 1.0);
    assert_eq!(counts("single sensor_delay x1", std::slice::from_ref(&class)), (1, 0));
    assert_eq!(counts("single sensor_delay x1", &[named(&["friction"], 3.0)]), (0, 1));
    assert_eq!(counts("single sensor_delay x1", &[class, named(&["friction"], 3.0)]), (1, 1));
    assert_eq!(counts("single series_spring x2", &[named(&["force_lag"], 3.0)]), (1, 0));
    let both = [named(&["gas_spring"], 6e3), named(&["coil_lag"], 0.012)];
    assert_eq!(counts("pair coil_lag + gas_spring x1", &both), (1, 0));
    assert_eq!(counts("pair coil_lag + gas_spring x1", &both[..1]), (0, 0));
    assert_eq!(counts("outside mains_hum x1", &[]), (0, 0));
    let mut row = Row::default();
    row.take(&spec("single coil_lag x1"), &outcome(&[named(&["coil_lag"], 0.0132)]), None, 0.0);
    assert!((row.error() - 0.1).abs() < 1e-12, "{}", row.error());
    assert_eq!(spec("single coil_lag x1").kind, Kind::Single);
}

/// Chance alone gave intervals that exclude these three truths: the drive is held between samples, a step of the model is longer than the
/// spring's lag, and the velocity comes from a finite difference. The example `interval_coverage` measures all effects on more seeds.
#[test]
fn intervals_contain_what_the_recorded_samples_leave_open() -> Result<(), Error> {
    for id in ["coil_lag", "series_spring", "sensor_delay"] {
        let found = interval(id, 40)?.unwrap_or_else(|| panic!("{id} is not named"));
        assert!(found.contains(), "{id}: {found:?}");
        assert!(found.half() < 0.2 * found.truth, "{id}: {found:?} is too wide to be of use");
    }
    Ok(())
}
