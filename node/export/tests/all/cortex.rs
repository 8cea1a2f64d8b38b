//! Exported code on Cortex-M processors under QEMU, bit for bit, and its size there.

use crate::back_to_back::{assert_same, each, is_quick, samples};
use crate::cases::{Case, each_once, effects, forces, fuzzy_tanh, terms, with};
use crate::compile::{WARNINGS, bytes, is_here, parse, run_bytes, write};
use crate::inverse::{Prepared, TIGHT, with_learned};
use mr_damper_export::arm::{SUM, SUM_FILE, SUM_LINKED};
use mr_damper_export::board::{COUNTED, Instructions, LINK, LINKED, Processor, START};
use mr_damper_export::vectors::{Readings, expected, readings, with_late_stamps};
use mr_damper_export::{CExport, CSource, Precision};
use mr_damper_model::effect::Effect;
use mr_damper_model::inverse::Method;
use mr_damper_model::model::Model;
use std::path::Path;
use std::process::Command;

/// The processors whose bits are compared.
pub(crate) const PROCESSORS: [Processor; 3] = [Processor::M3, Processor::M4F, Processor::M7];

/// Samples of a case: few in a quick run, or MR_DAMPER_EXPORT_SAMPLES.
fn count() -> usize {
    samples(1000)
}

/// In a quick run one case of `step`, else all.
fn spread(cases: Vec<Case>, step: usize) -> impl Iterator<Item = Case> {
    cases.into_iter().step_by(if is_quick() { step } else { 1 })
}

/// Compiles the export with its driver, and runs it on `processor`. Returns what the driver writes.
pub(crate) fn run_on(
    dir: &Path,
    source: &CSource,
    processor: Processor,
    all: &[Readings],
    compiled: &[&str],
    ran: &[&str],
) -> Vec<u8> {
    std::fs::write(dir.join(SUM_FILE), SUM).expect("written");
    std::fs::write(dir.join("in.bin"), bytes(all)).expect("written");
    let code = format!("{}.c", source.name);
    let options = [&["-DFILES", SUM_LINKED], compiled].concat();
    on_board(dir, processor, &[&code, "driver.c", SUM_FILE], &options, ran)
}

/// Compiles `files` with these options, and runs the program on `processor` with more options of QEMU. Returns its file `out.bin`.
pub(crate) fn on_board(
    dir: &Path,
    processor: Processor,
    files: &[&str],
    compiled: &[&str],
    ran: &[&str],
) -> Vec<u8> {
    std::fs::write(dir.join("start.c"), START).expect("written");
    std::fs::write(dir.join("link.ld"), LINK).expect("written");
    let (machine, program) = (processor.machine, format!("{}.elf", processor.machine));
    let compiled = Command::new("arm-none-eabi-gcc")
        .current_dir(dir)
        .args(processor.options)
        .args(WARNINGS)
        .args(compiled)
        .args(["-o", &program])
        .args(LINKED)
        .args(files)
        .arg("start.c")
        .output()
        .expect("the compiler runs");
    assert!(compiled.status.success(), "{machine}: {}", String::from_utf8_lossy(&compiled.stderr));
    let ran = Command::new("qemu-system-arm")
        .current_dir(dir)
        .args(processor.qemu(&program))
        .args(ran)
        .output()
        .expect("QEMU runs");
    assert!(ran.status.success(), "{machine}: {}", String::from_utf8_lossy(&ran.stderr));
    std::fs::read(dir.join("out.bin")).expect("its output")
}

#[test]
#[ignore = "needs gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm"]
fn cortex_m_has_the_services_bits() {
    assert!(is_here("arm-none-eabi-gcc") && is_here("qemu-system-arm"), "install them");
    let cases: Vec<Case> = each_once().into_iter().chain(terms().into_iter().step_by(8)).collect();
    each(&cases, |index, (name, model)| {
        let all = readings(model, count(), 90 + index as u64);
        let service = expected(model, &all).expect("a pipeline");
        let source = CExport::new("damper", model).source().expect("it is exported");
        let dir = tempfile::tempdir().expect("a directory");
        write(dir.path(), &source);
        for processor in PROCESSORS {
            let found = run_on(dir.path(), &source, processor, &all, &["-O2"], &[]);
            let exported: Vec<_> = found.chunks_exact(24).map(parse).collect();
            assert_same(&format!("{name}, {}", processor.name), &all, &service, &exported);
        }
    });
}

#[test]
#[ignore = "needs gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm"]
fn cortex_m_has_the_services_bits_on_corrected_stamps() {
    assert!(is_here("arm-none-eabi-gcc") && is_here("qemu-system-arm"), "install them");
    let model = fuzzy_tanh();
    let all = with_late_stamps(readings(&model, 3 * count(), 95), 95);
    let service = expected(&model, &all).expect("a pipeline");
    let source = CExport::new("damper", &model).corrected_stamps().source().expect("it is exported");
    let dir = tempfile::tempdir().expect("a directory");
    write(dir.path(), &source);
    for processor in PROCESSORS {
        let found = run_on(dir.path(), &source, processor, &all, &["-O2"], &[]);
        let exported: Vec<_> = found.chunks_exact(24).map(parse).collect();
        assert_same(processor.name, &all, &service, &exported);
    }
}

#[test]
#[ignore = "needs gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm"]
fn cortex_m_has_the_services_commands() {
    assert!(is_here("arm-none-eabi-gcc") && is_here("qemu-system-arm"), "install them");
    let lag = with(fuzzy_tanh(), &[Effect::CoilLag.example(), Effect::GasSpring.example()]);
    for method in Method::ALL {
        let model = with_learned(lag, method, 1e-3);
        let own = Prepared::of(&model, method, TIGHT, count(), 77).expect("an inverse");
        let dir = tempfile::tempdir().expect("a directory");
        write(dir.path(), &own.source);
        for processor in PROCESSORS {
            let what = format!("{}, {}", method.name(), processor.name);
            let seen =
                own.compare(&what, &run_on(dir.path(), &own.source, processor, &own.all, &["-O2"], &[]));
            assert!(seen.forces > 3 * count() / 10, "{what}: {seen:?}");
            assert!(method.learned().is_none() || seen.learned > 3 * count() / 100, "{what}: {seen:?}");
        }
    }
}

#[test]
#[ignore = "needs gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm"]
fn cortex_m_has_the_hosts_bits_in_single_precision() {
    assert!(is_here("arm-none-eabi-gcc") && is_here("qemu-system-arm"), "install them");
    let cases: Vec<Case> =
        spread(effects(), 9).chain(spread(forces(), 6)).chain(spread(terms(), 8)).collect();
    each(&cases, |index, (name, model)| {
        let all = readings(model, count(), 140 + index as u64);
        let source =
            CExport::new("damper", model).precision(Precision::Single).source().expect("it is exported");
        let dir = tempfile::tempdir().expect("a directory");
        write(dir.path(), &source);
        let host = run_bytes(dir.path(), &source, "gcc", "-O2", &all);
        for processor in PROCESSORS {
            assert!(
                run_on(dir.path(), &source, processor, &all, &["-O2"], &[]) == host,
                "{name}, {}",
                processor.name
            );
        }
    });
}

#[test]
#[ignore = "needs gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm"]
fn instructions_of_a_step_are_counted() {
    assert!(is_here("arm-none-eabi-gcc") && is_here("qemu-system-arm"), "install them");
    let all = readings(&fuzzy_tanh(), 500, 3);
    let count = |precision, processor| {
        let model = fuzzy_tanh();
        let source = CExport::new("damper", &model).precision(precision).source().expect("it is exported");
        let dir = tempfile::tempdir().expect("a directory");
        write(dir.path(), &source);
        let written = run_on(dir.path(), &source, processor, &all, &["-Os", "-DTICKS"], &COUNTED);
        Instructions::of(&written).expect("a count")
    };
    let double = count(Precision::Double, Processor::M4F);
    let single = count(Precision::Single, Processor::M4F);
    let native = count(Precision::Double, Processor::M7);
    println!("M4F: {double}; in single precision: {single}; M7: {native}");
    assert!(double.mean > 5 * single.mean && double.mean > 5 * native.mean, "{double} {single} {native}");
    assert!(native.mean > 500 && single.mean > 500, "{single} {native}");
    assert!([double, single, native].iter().all(|found| found.most >= found.mean));
}

#[test]
#[ignore = "needs gcc-arm-none-eabi"]
fn fuzzy_tanh_with_coil_lag_and_series_spring_is_small() {
    let model = with(fuzzy_tanh(), &[Effect::CoilLag.example(), Effect::SeriesSpring.example()]);
    for (precision, most) in [(Precision::Double, [6 * 1024, 512]), (Precision::Single, [4 * 1024, 256])] {
        assert_small(&model, precision, most);
    }
}

/// Fails if the code of `model` takes more than `most` bytes of flash and of state on a Cortex-M4F, or needs anything but its arithmetic.
fn assert_small(model: &Model, precision: Precision, most: [u64; 2]) {
    let source = CExport::new("damper", model).precision(precision).source().expect("it is exported");
    let dir = tempfile::tempdir().expect("a directory");
    write(dir.path(), &source);
    let file = |name: &str| dir.path().join(name);
    let probe = "#include \"damper.h\"\ndamper_state state;\n";
    std::fs::write(file("probe.c"), probe).expect("written");
    let compile = |name: &str, more: &[&str]| {
        let done = Command::new("arm-none-eabi-gcc")
            .current_dir(dir.path())
            .args(Processor::M4F.options)
            .args(["-std=c99", "-Os", "-ffunction-sections", "-fstack-usage", "-c", name])
            .args(more)
            .status();
        assert!(done.expect("the compiler runs").success());
    };
    compile("damper.c", &[]);
    compile("probe.c", &[]);
    let size = |object: &str| -> [u64; 3] {
        let out = Command::new("arm-none-eabi-size").arg(file(object)).output().expect("size runs").stdout;
        let text = String::from_utf8(out).expect("text");
        let line = text.lines().nth(1).expect("a line").split_whitespace();
        let numbers: Vec<u64> = line.take(3).filter_map(|word| word.parse().ok()).collect();
        [numbers[0], numbers[1], numbers[2]]
    };
    let [code, data, bss] = size("damper.o");
    let [_, _, state] = size("probe.o");
    println!("Cortex-M4F, {}: {code} bytes of flash, {state} bytes of state", precision.c_type());
    assert_eq!((data, bss), (0, 0), "no globals that change");
    assert!(code <= most[0] && state <= most[1], "{code} bytes of flash, {state} of state");
    let symbols =
        Command::new("arm-none-eabi-nm").arg("-u").arg(file("damper.o")).output().expect("nm runs").stdout;
    for symbol in String::from_utf8(symbols).expect("text").split_whitespace().filter(|word| word.len() > 1) {
        // Arithmetic of double precision, differences of times, and copies of structures.
        let is_arithmetic = match precision {
            Precision::Double => symbol.starts_with("__aeabi_"),
            Precision::Single => symbol == "__aeabi_l2f",
        };
        assert!(is_arithmetic || ["memcpy", "memset"].contains(&symbol), "undefined: {symbol}");
    }
}
