//! Exported code against the pipeline of the service, bit for bit.

use crate::cases::{Case, conditionings, effects, forces, learned, terms};
use crate::compile::{compilers, run, write};
use mr_damper_export::CExport;
use mr_damper_export::vectors::{Expected, Readings, expected, readings};

/// Samples of a case: few in a quick run, or MR_DAMPER_EXPORT_SAMPLES.
pub(crate) fn sample_count() -> usize {
    std::env::var("MR_DAMPER_EXPORT_SAMPLES").ok().and_then(|text| text.parse().ok()).unwrap_or(5_000)
}

/// Fails at the first sample where the exported code differs from the service.
pub(crate) fn assert_same(what: &str, readings: &[Readings], service: &[Expected], exported: &[Expected]) {
    assert_eq!(service.len(), exported.len(), "{what}");
    let same = |a: f64, b: f64| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan());
    for (k, (ours, theirs)) in service.iter().zip(exported).enumerate() {
        // A refused sample has no estimate with reasons in the service.
        let flags = !ours.accepted || ours.flags == theirs.flags;
        // The service gives an expected reading only where the measured force meets its displacement.
        let reading = ours.reading_n.is_nan() || same(ours.reading_n, theirs.reading_n);
        assert!(
            ours.accepted == theirs.accepted && same(ours.force_n, theirs.force_n) && reading && flags,
            "{what}, sample {k} ({:?}): service {ours:?}, exported {theirs:?}",
            readings[k]
        );
    }
}

/// Compares every case on each compiler at two levels of optimisation.
fn check(cases: &[Case]) {
    let count = sample_count();
    for (index, (name, model)) in cases.iter().enumerate() {
        let all = readings(model, count, 22 + index as u64);
        let service = expected(model, &all).expect("a pipeline");
        let forces = service.iter().filter(|output| output.force_n.is_finite()).count();
        assert!(10 * forces > 7 * count, "{name}: only {forces} of {count} samples have a force");
        let source =
            CExport::new("damper", model).provenance(name.as_str()).source().expect("it is exported");
        let dir = tempfile::tempdir().expect("a directory");
        write(dir.path(), &source);
        for compiler in compilers() {
            for level in ["-O0", "-O3"] {
                let exported = run(dir.path(), &source, compiler, level, &all);
                assert_same(&format!("{name}, {compiler} {level}"), &all, &service, &exported);
            }
        }
    }
}

#[test]
fn every_force_model_has_the_services_bits() {
    check(&forces());
}

#[test]
fn every_learned_model_has_the_services_bits() {
    check(&learned());
}

#[test]
fn every_conditioning_has_the_services_bits() {
    check(&conditionings());
}

#[test]
fn every_effect_has_the_services_bits() {
    check(&effects());
}

#[test]
fn every_term_has_the_services_bits() {
    check(&terms());
}
