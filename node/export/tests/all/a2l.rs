//! Addresses in a calibration file against a linked program.

use crate::cases::{effects, fuzzy_tanh, learned, with};
use crate::compile::is_here;
use crate::inverse::with_learned;
use mr_damper_export::{CExport, CSource, Precision, a2l};
use mr_damper_model::effect::Effect;
use mr_damper_model::inverse::{InverseController, Limits, Method};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// Each characteristic and measurement of `text`: its name and address.
fn addresses(text: &str) -> BTreeMap<String, u64> {
    let mut found = BTreeMap::new();
    let mut name = String::new();
    for line in text.lines().map(str::trim) {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["/begin", "CHARACTERISTIC" | "MEASUREMENT", own, ..] => name = (*own).to_owned(),
            ["VALUE" | "VAL_BLK" | "ECU_ADDRESS", address, ..] => {
                let digits = address.strip_prefix("0x").expect("hexadecimal");
                found.insert(name.clone(), u64::from_str_radix(digits, 16).expect("hexadecimal"));
            }
            _ => {}
        }
    }
    found
}

/// The fields of the output structure, as the header declares them.
fn output_fields(source: &CSource) -> Vec<String> {
    let (before, _) = source.header.split_once("} damper_output;").expect("the structure");
    let (_, fields) = before.rsplit_once("typedef struct {").expect("the structure");
    let declared = fields.lines().filter_map(|line| line.split_once(';')?.0.split_whitespace().nth(1));
    declared.map(|field| field.split('[').next().expect("a name").to_owned()).collect()
}

/// Links the export with the two variables, and compares the calibration file with the linked program: addresses of the variables from
/// `nm`, offsets of the fields from the compiler. A field's offset is the size of an array, less one, so the program need not run.
fn check(source: &CSource, compiler: &str, nm: &str, options: &[&str]) {
    let dir = tempfile::tempdir().expect("a directory");
    let mut program = "#include \"damper.h\"\n#include <stddef.h>\n
damper_parameters damper_calibration = { 1.0 };\ndamper_output damper_measured;\n"
        .to_owned();
    let fields: Vec<&str> = source.parameters.iter().map(|parameter| parameter.name.as_str()).collect();
    let outputs = output_fields(source);
    for (kind, field) in fields
        .iter()
        .map(|field| ("parameters", *field))
        .chain(outputs.iter().map(|field| ("output", field.as_str())))
    {
        program += &format!("char offset_of_{kind}_{field}[offsetof(damper_{kind}, {field}) + 1];\n");
    }
    program += "int main(void) { return 0; }\n";
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).expect("written");
    write("program.c", &program);
    write("damper.h", &source.header);
    write("damper.c", &source.source);
    let linked = Command::new(compiler)
        .current_dir(dir.path())
        .args(["-std=c99", "-O1", "program.c", "damper.c", "-o", "program.elf"])
        .args(options)
        .output()
        .expect("the compiler runs");
    assert!(linked.status.success(), "{compiler}: {}", String::from_utf8_lossy(&linked.stderr));
    let (addresses_of, sizes) = symbols(nm, &dir.path().join("program.elf"));
    let base = a2l::Memory {
        parameters: addresses_of["damper_calibration"],
        output: addresses_of["damper_measured"],
        is_big_endian: false,
    };
    assert!(base.parameters > 0 && base.output > 0 && base.parameters != base.output);
    let text = a2l::file(source, ["damper_calibration", "damper_measured"], base);
    assert!(text.contains("BYTE_ORDER MSB_LAST\n"));
    let big_endian = a2l::file(source, ["a", "b"], a2l::Memory { is_big_endian: true, ..base });
    assert!(big_endian.contains("BYTE_ORDER MSB_FIRST\n"));
    let found = addresses(&text);
    let mut expected = BTreeMap::new();
    for field in fields {
        let offset = sizes[&format!("offset_of_parameters_{field}")] - 1;
        expected.insert(format!("damper_{field}"), base.parameters + offset);
    }
    for field in &outputs {
        let offset = sizes[&format!("offset_of_output_{field}")] - 1;
        expected.insert(format!("damper_{field}"), base.output + offset);
    }
    assert_eq!(found, expected, "{compiler}");
}

/// Addresses and sizes of the symbols of a program.
fn symbols(nm: &str, program: &Path) -> (BTreeMap<String, u64>, BTreeMap<String, u64>) {
    let out = Command::new(nm).arg("-S").arg(program).output().expect("nm runs");
    let text = String::from_utf8(out.stdout).expect("text");
    let number = |digits: &str| u64::from_str_radix(digits, 16).expect("hexadecimal");
    let (mut addresses, mut sizes) = (BTreeMap::new(), BTreeMap::new());
    for line in text.lines() {
        if let [address, size, _, name] = line.split_whitespace().collect::<Vec<_>>().as_slice() {
            addresses.insert((*name).to_owned(), number(address));
            sizes.insert((*name).to_owned(), number(size));
        }
    }
    (addresses, sizes)
}

/// Exports with scalars, arrays, rows, effects and an inverse.
fn sources() -> Vec<CSource> {
    let mut all: Vec<CSource> = effects()
        .into_iter()
        .chain(learned())
        .step_by(7)
        .map(|(_, model)| CExport::new("damper", &model).source().expect("it is exported"))
        .collect();
    let model = with(fuzzy_tanh(), &[Effect::CoilLag.example(), Effect::SeriesSpring.example()]);
    for method in [Method::Search, Method::Fuzzy, Method::Chen, Method::WangHu] {
        let base = if method == Method::Fuzzy { fuzzy_tanh() } else { with_learned(model, method, 1e-3) };
        let controller =
            InverseController::with_method(&base, Limits::default(), method).expect("an inverse");
        let parts = controller.parts().expect("it has an inverse");
        for precision in [Precision::Double, Precision::Single] {
            let export = CExport::new("damper", &base).inverse(&parts).precision(precision);
            all.push(export.source().expect("it is exported"));
        }
    }
    all
}

#[test]
fn addresses_of_the_calibration_file_are_those_of_the_program() {
    for source in sources() {
        check(&source, "gcc", "nm", &["-no-pie"]);
    }
}

#[test]
#[ignore = "needs gcc-arm-none-eabi and libnewlib-arm-none-eabi"]
fn addresses_of_the_calibration_file_are_those_of_a_cortex_program() {
    assert!(is_here("arm-none-eabi-gcc"), "install it");
    let options = ["-mcpu=cortex-m4", "-mthumb", "--specs=nosys.specs", "-Wl,-Ttext=0,-Tdata=0x20000000"];
    for source in sources() {
        check(&source, "arm-none-eabi-gcc", "arm-none-eabi-nm", &options);
    }
}
