//! Exported code on Cortex-M processors under QEMU, bit for bit, and its size there.

use crate::back_to_back::assert_same;
use crate::cases::{effects, forces, fuzzy_tanh, learned, terms, with};
use crate::compile::{WARNINGS, bytes, is_here, parse, run_bytes, write};
use crate::inverse::{Prepared, TIGHT, with_learned};
use mr_damper_export::vectors::{Readings, expected, readings};
use mr_damper_export::{CExport, CSource, Precision};
use mr_damper_model::effect::Effect;
use mr_damper_model::inverse::Method;
use mr_damper_model::model::Model;
use std::path::Path;
use std::process::Command;

/// QEMU's machine, and the options of the compiler for its processor.
const PROCESSORS: [(&str, &[&str]); 3] = [
    ("mps2-an385", &["-mcpu=cortex-m3", "-mthumb"]),
    ("mps2-an386", &["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]),
    ("mps2-an500", &["-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-d16"]),
];

/// The vector table, and the start: the FPU is switched on before the C library's start.
const START: &str = "#include <stdint.h>
extern void _start(void);
void reset(void) {
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20;
    __asm volatile(\"dsb\\n isb\");
    _start();
    for (;;) {
    }
}
__attribute__((section(\".vectors\"), used)) const uintptr_t vectors[2] = { 0x20400000u, (uintptr_t)reset };
";

/// Code from address 0, data from 0x20000000: the memory of QEMU's MPS2 boards.
const LINK: &str =
    "MEMORY { code (rx) : ORIGIN = 0, LENGTH = 4M  data (rwx) : ORIGIN = 0x20000000, LENGTH = 4M }
ENTRY(reset)
SECTIONS {
    .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) *(.init) *(.fini) *(.eh_frame*) } > code
    .ARM.exidx : { *(.ARM.exidx*) } > code
    __data_load = LOADADDR(.data);
    .data : { *(.data*) } > data
    .bss (NOLOAD) : { __bss_start__ = .; *(.bss*) *(COMMON) __bss_end__ = .; end = .; __end__ = .; } > data
    __stack = 0x20400000;
}
";

fn run(dir: &Path, source: &CSource, (machine, options): (&str, &[&str]), all: &[Readings]) -> Vec<u8> {
    std::fs::write(dir.join("start.c"), START).expect("written");
    std::fs::write(dir.join("link.ld"), LINK).expect("written");
    std::fs::write(dir.join("in.bin"), bytes(all)).expect("written");
    let program = format!("{machine}.elf");
    let compiled = Command::new("arm-none-eabi-gcc")
        .current_dir(dir)
        .args(options)
        .args(WARNINGS)
        .args(["-O2", "-DFILES", "--specs=rdimon.specs", "-T", "link.ld", "-o", &program])
        .args([&format!("{}.c", source.name), "driver.c", "start.c"])
        .output()
        .expect("the compiler runs");
    assert!(compiled.status.success(), "{machine}: {}", String::from_utf8_lossy(&compiled.stderr));
    let ran = Command::new("qemu-system-arm")
        .current_dir(dir)
        .args(["-M", machine, "-nographic", "-monitor", "none", "-serial", "none"])
        .args(["-semihosting-config", "enable=on,target=native", "-kernel", &program])
        .output()
        .expect("QEMU runs");
    assert!(ran.status.success(), "{machine}: {}", String::from_utf8_lossy(&ran.stderr));
    std::fs::read(dir.join("out.bin")).expect("its output")
}

#[test]
#[ignore = "needs gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm"]
fn cortex_m_has_the_services_bits() {
    assert!(is_here("arm-none-eabi-gcc") && is_here("qemu-system-arm"), "install them");
    let spread = |cases: Vec<_>, step| cases.into_iter().step_by(step);
    let cases = spread(effects(), 9).chain(spread(learned(), 6)).chain(spread(terms(), 8));
    for (index, (name, model)) in cases.enumerate() {
        let all = readings(&model, 1000, 90 + index as u64);
        let service = expected(&model, &all).expect("a pipeline");
        let source = CExport::new("damper", &model).source().expect("it is exported");
        let dir = tempfile::tempdir().expect("a directory");
        write(dir.path(), &source);
        for processor in PROCESSORS {
            let found = run(dir.path(), &source, processor, &all);
            let exported: Vec<_> = found.chunks_exact(24).map(parse).collect();
            assert_same(&format!("{name}, {}", processor.0), &all, &service, &exported);
        }
    }
}

#[test]
#[ignore = "needs gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm"]
fn cortex_m_has_the_services_commands() {
    assert!(is_here("arm-none-eabi-gcc") && is_here("qemu-system-arm"), "install them");
    let lag = with(fuzzy_tanh(), &[Effect::CoilLag.example(), Effect::GasSpring.example()]);
    for method in Method::ALL {
        let model = with_learned(lag, method, 1e-3);
        let own = Prepared::of(&model, method, TIGHT, 1000, 77).expect("an inverse");
        let dir = tempfile::tempdir().expect("a directory");
        write(dir.path(), &own.source);
        for processor in PROCESSORS {
            let what = format!("{}, {}", method.name(), processor.0);
            let seen = own.compare(&what, &run(dir.path(), &own.source, processor, &own.all));
            assert!(seen.forces > 300, "{what}: {seen:?}");
            assert!(method.learned().is_none() || seen.learned > 30, "{what}: {seen:?}");
        }
    }
}

#[test]
#[ignore = "needs gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm"]
fn cortex_m_has_the_hosts_bits_in_single_precision() {
    assert!(is_here("arm-none-eabi-gcc") && is_here("qemu-system-arm"), "install them");
    let spread = |cases: Vec<_>, step| cases.into_iter().step_by(step);
    let cases = spread(effects(), 9).chain(spread(forces(), 6)).chain(spread(terms(), 8));
    for (index, (name, model)) in cases.enumerate() {
        let all = readings(&model, 1000, 140 + index as u64);
        let source =
            CExport::new("damper", &model).precision(Precision::Single).source().expect("it is exported");
        let dir = tempfile::tempdir().expect("a directory");
        write(dir.path(), &source);
        let host = run_bytes(dir.path(), &source, "gcc", "-O2", &all);
        for processor in PROCESSORS {
            assert!(run(dir.path(), &source, processor, &all) == host, "{name}, {}", processor.0);
        }
    }
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
            .args(PROCESSORS[1].1)
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
