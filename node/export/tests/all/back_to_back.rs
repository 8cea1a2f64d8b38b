//! Exported code against the pipeline of the service, bit for bit.

use crate::cases::{Case, conditionings, each_once, effects, forces, fuzzy_tanh, learned, terms};
use crate::compile::{compilers, run, write};
use mr_damper_export::vectors::{Expected, Readings, expected, readings, with_late_stamps};
use mr_damper_export::{CExport, Precision};
use std::num::NonZero;
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// Samples of a case, if MR_DAMPER_EXPORT_SAMPLES says how many; a quick run takes few.
fn requested_count() -> Option<usize> {
    std::env::var("MR_DAMPER_EXPORT_SAMPLES").ok()?.parse().ok()
}

/// True without MR_DAMPER_EXPORT_SAMPLES.
pub(crate) fn is_quick() -> bool {
    requested_count().is_none()
}

/// Samples of a case: `quick` in a quick run.
pub(crate) fn samples(quick: usize) -> usize {
    requested_count().unwrap_or(quick)
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

/// Calls `work` with every case and its number, on every processor. A long run prints each case as it is done.
pub(crate) fn each(cases: &[Case], work: impl Fn(usize, &Case) + Sync) {
    let next = AtomicUsize::new(0);
    let test = std::thread::current().name().unwrap_or_default().to_owned();
    let run = || {
        while let Some((index, case)) = take(cases, &next) {
            let started = Instant::now();
            work(index, case);
            if !is_quick() {
                let (seconds, last) = (started.elapsed().as_secs(), cases.len() - 1);
                eprintln!("{test}, {index} of 0 to {last}, {}: same bits, {seconds} s", case.0);
            }
        }
    };
    // In a quick run the tests have the processors.
    let threads = if is_quick() { 1 } else { std::thread::available_parallelism().map_or(1, NonZero::get) };
    std::thread::scope(|scope| (0..threads).for_each(|_| drop(scope.spawn(run))));
}

/// The next case that no thread has taken, and its number.
fn take<'a>(cases: &'a [Case], next: &AtomicUsize) -> Option<(usize, &'a Case)> {
    let index = next.fetch_add(1, Ordering::Relaxed);
    Some((index, cases.get(index)?))
}

/// Compares every case on each compiler at two levels of optimisation.
fn check(cases: &[Case], has_late_stamps: bool) {
    let count = samples(5_000);
    each(cases, |index, (name, model)| {
        let seed = 22 + index as u64;
        let mut all = readings(model, count, seed);
        let mut export = CExport::new("damper", model).provenance(name.as_str());
        if has_late_stamps {
            (all, export) = (with_late_stamps(all, seed), export.corrected_stamps());
        }
        let service = expected(model, &all).expect("a pipeline");
        let forces = service.iter().filter(|output| output.force_n.is_finite()).count();
        assert!(10 * forces > 7 * count, "{name}: only {forces} of {count} samples have a force");
        let source = export.source().expect("it is exported");
        let dir = tempfile::tempdir().expect("a directory");
        write(dir.path(), &source);
        for compiler in compilers() {
            for level in ["-O0", "-O3"] {
                let exported = run(dir.path(), &source, compiler, level, &all);
                assert_same(&format!("{name}, {compiler} {level}"), &all, &service, &exported);
            }
        }
    });
}

#[test]
fn every_force_model_has_the_services_bits() {
    check(&forces(), false);
}

#[test]
fn every_learned_model_has_the_services_bits() {
    check(&learned(), false);
}

#[test]
fn every_conditioning_has_the_services_bits() {
    check(&conditionings(), false);
}

#[test]
fn every_effect_has_the_services_bits() {
    check(&effects(), false);
}

#[test]
fn every_term_has_the_services_bits() {
    check(&terms(), false);
}

#[test]
#[ignore = "for .ci/bits: the tests above take more models, and fewer samples"]
fn each_model_and_effect_has_the_services_bits() {
    check(&each_once(), false);
}

#[test]
fn corrected_stamps_have_the_services_bits() {
    let some = |cases: Vec<Case>, step: usize| cases.into_iter().step_by(step);
    let cases = some(effects(), 5).chain(some(forces(), 6)).chain(some(terms(), 12));
    check(&conditionings().into_iter().chain(cases).collect::<Vec<_>>(), true);
}

#[test]
fn stamps_that_jitter_need_the_correction() {
    let model = fuzzy_tanh();
    let all = with_late_stamps(readings(&model, 5_000, 22), 22);
    let service = expected(&model, &all).expect("a pipeline");
    let source = CExport::new("damper", &model).source().expect("it is exported");
    let dir = tempfile::tempdir().expect("a directory");
    write(dir.path(), &source);
    let exported = run(dir.path(), &source, compilers()[0], "-O2", &all);
    let differ = service.iter().zip(&exported).filter(|(ours, theirs)| {
        ours.force_n.is_finite() && ours.force_n.to_bits() != theirs.force_n.to_bits()
    });
    assert!(differ.count() > 1_000, "the readings test the correction");
}

#[test]
fn options_that_change_results_are_refused() {
    let dir = tempfile::tempdir().expect("a directory");
    for (precision, name) in [(Precision::Double, "double"), (Precision::Single, "single")] {
        let model = fuzzy_tanh();
        let export = CExport::new("damper", &model).precision(precision);
        write(dir.path(), &export.source().expect("it is exported"));
        let refusal = |compiler: &str, options: &[&str]| {
            let mut command = Command::new(compiler);
            command.current_dir(dir.path()).args(["-c", "damper.c", "-o", "damper.o"]).args(options);
            let done = command.output().expect("the compiler runs");
            (!done.status.success()).then(|| String::from_utf8_lossy(&done.stderr).into_owned())
        };
        for compiler in compilers() {
            // Clang does not say that sums may be reordered, and GCC before version 12 does not either.
            let mut options = vec![["-ffast-math"].as_slice(), &["-ffinite-math-only"]];
            if compiler == "gcc" {
                options.extend([["-funsafe-math-optimizations"].as_slice(), &["-freciprocal-math"]]);
            }
            for options in options {
                let said = refusal(compiler, options).unwrap_or_default();
                assert!(said.contains("Compile without"), "{compiler} {options:?}, {name}: {said}");
            }
            let (usual, gnu) = (["-std=c99"], ["-std=gnu11", "-ffp-contract=off"]);
            for options in [usual.as_slice(), &gnu] {
                assert_eq!(refusal(compiler, options), None, "{compiler} {options:?}, {name}");
            }
        }
        // A processor with arithmetic in half precision.
        let half =
            refusal("gcc", &["-std=gnu11", "-ffp-contract=off", "-march=sapphirerapids"]).unwrap_or_default();
        assert!(half.is_empty() || half.contains("sapphirerapids"), "{name}: {half}");
    }
}
