//! Exported code in single precision: it compiles without a warning, its results do not depend on the compiler, and they differ
//! from the service's by rounding errors.

use crate::back_to_back::samples;
use crate::cases::{Case, conditionings, effects, forces, fuzzy_tanh, learned, terms, with};
use crate::compile::{compilers, parse, run_bytes, write};
use crate::inverse::{TIGHT, with_learned};
use mr_damper_export::fmu::{FmiVersion, Fmu};
use mr_damper_export::vectors::{
    Expected, Readings, expected, expected_commands, readings, with_late_stamps, with_requests,
};
use mr_damper_export::{CExport, Difference, ExportError, Precision};
use mr_damper_model::effect::Effect;
use mr_damper_model::inverse::{InverseController, Method};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::Settings;

/// Samples of a case.
fn count() -> usize {
    samples(5_000)
}

fn difference(name: &str, export: CExport<'_>, model: &Model, all: &[Readings], seed: u64) -> Difference {
    let service = expected(model, all).expect("a pipeline");
    let source = export.precision(Precision::Single).source().expect("it is exported");
    let dir = tempfile::tempdir().expect("a directory");
    write(dir.path(), &source);
    // A quick run takes the second compiler for every third case.
    let is_compared = count() > 5_000 || seed.is_multiple_of(3);
    let outputs: Vec<Vec<u8>> = compilers()
        .into_iter()
        .zip(["-O3", "-O0"])
        .take(if is_compared { 2 } else { 1 })
        .map(|(compiler, level)| run_bytes(dir.path(), &source, compiler, level, all))
        .collect();
    assert!(outputs.windows(2).all(|pair| pair[0] == pair[1]), "{name}: the compilers differ");
    let exported: Vec<Expected> = outputs[0].chunks_exact(24).map(parse).collect();
    Difference::of(&service, &exported)
}

/// The effect of rounding errors on a model.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    /// They stay what they are.
    Smooth,
    /// Its force jumps with the sign of the acceleration, at a moment that rounding errors move.
    Jumps,
    /// It feeds its own force back through random weights, and so amplifies them.
    Amplifies,
}

/// The kind of a case.
fn kind(name: &str) -> Kind {
    let jumps = ["li ", "cesmeci-engin ", "choi "];
    match name {
        _ if jumps.iter().any(|known| name.starts_with(known)) => Kind::Jumps,
        _ if name.starts_with("chen ") => Kind::Amplifies,
        // Free play opens and closes, which moves as jumps do, but the force is continuous.
        _ => Kind::Smooth,
    }
}

/// Measures every case, and fails at one beyond the limits.
fn check(cases: &[Case]) {
    let mut failed = Vec::new();
    for (index, (name, model)) in cases.iter().enumerate() {
        let seed = 22 + index as u64;
        let all = readings(model, count(), seed);
        let own = difference(name, CExport::new("damper", model), model, &all, seed);
        let (largest, rms) = (own.largest_share(), own.rms_share());
        println!("{name}: largest {largest:.1e}, rms {rms:.1e}, far {}, other {}", own.far, own.other);
        let fits = match kind(name) {
            Kind::Smooth => largest <= 2e-3 && rms <= 3e-5,
            Kind::Jumps => own.far as f64 <= 5e-3 * own.samples as f64,
            Kind::Amplifies => largest <= 1e-2 && rms <= 1e-3,
        };
        let has_forces = 10 * own.samples > 7 * count();
        if !(fits && has_forces && own.other as f64 <= 1e-3 * own.samples as f64) {
            failed.push(format!("{name}: {own:?}"));
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

#[test]
fn force_models_in_single_precision_differ_by_rounding_errors() {
    let all = [forces(), learned()].concat();
    let lazy = |(name, _): &Case| name.starts_with("boada ");
    check(&all.iter().filter(|case| !lazy(case)).cloned().collect::<Vec<_>>());
    // Its local regressions are nearly singular.
    for (name, model) in all.iter().filter(|case| lazy(case)) {
        let refused = CExport::new("damper", model).precision(Precision::Single).source();
        assert!(matches!(refused, Err(ExportError::Precision { .. })), "{name}");
    }
    assert_eq!(all.iter().filter(|case| lazy(case)).count(), 2);
}

#[test]
fn conditionings_in_single_precision_differ_by_rounding_errors() {
    check(&conditionings());
}

#[test]
fn effects_in_single_precision_differ_by_rounding_errors() {
    check(&effects());
}

#[test]
fn terms_in_single_precision_differ_by_rounding_errors() {
    check(&terms());
}

#[test]
fn commands_in_single_precision_differ_by_rounding_errors() {
    let lag = with(fuzzy_tanh(), &[Effect::CoilLag.example(), Effect::GasSpring.example()]);
    for method in Method::ALL {
        let model = with_learned(lag, method, 1e-3);
        let controller = InverseController::with_method(&model, TIGHT, method).expect("an inverse");
        let parts = controller.parts().expect("an inverse");
        let settings = Settings { limits: TIGHT, method, ..Settings::default() };
        let all = with_requests(readings(&model, count(), 31), parts.most_n, 31);
        let service = expected_commands(&model, &settings, &all).expect("a pipeline");
        let export = CExport::new("damper", &model).inverse(&parts).precision(Precision::Single);
        let source = export.source().expect("it is exported");
        let dir = tempfile::tempdir().expect("a directory");
        write(dir.path(), &source);
        let found = run_bytes(dir.path(), &source, compilers()[0], "-O3", &all);
        let (mut commands, mut far, mut largest_a) = (0, 0, 0.0_f64);
        for ((_, ours), bytes) in service.iter().zip(found.chunks_exact(80)) {
            let number = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes"));
            let current_a = number(32);
            // In single precision the largest current is the nearest float.
            assert!((0.0..=TIGHT.current_max_a * (1.0 + 1e-7)).contains(&current_a), "{current_a}");
            let Some(command) = ours.command else { continue };
            let difference_a = (command.current.get() - current_a).abs();
            commands += 1;
            far += usize::from(difference_a > 2e-3);
            largest_a = largest_a.max(difference_a);
        }
        println!(
            "{}: {far} of {commands} commands differ by more than 2 mA, the largest by {largest_a:.1e} A",
            method.name()
        );
        assert!(commands > count() / 2 && 100 * far <= commands, "{}", method.name());
    }
}

#[test]
fn code_in_single_precision_has_no_fmu() {
    let source = CExport::new("damper", &fuzzy_tanh()).precision(Precision::Single).source().expect("code");
    let written = Fmu::new(&source, FmiVersion::V3).archive(None);
    assert_eq!(written, Err(ExportError::FmuPrecision));
}

/// The choice between stamps and even times moves by a sample or two.
#[test]
fn corrected_stamps_in_single_precision_differ_by_rounding_errors() {
    let model = fuzzy_tanh();
    let all = with_late_stamps(readings(&model, count(), 30), 30);
    let export = CExport::new("damper", &model).corrected_stamps();
    let own = difference("corrected stamps", export, &model, &all, 30);
    println!("largest {:.1e}, rms {:.1e}, far {}", own.largest_share(), own.rms_share(), own.far);
    assert!(own.far as f64 <= 5e-3 * own.samples as f64, "{own:?}");
}
