//! FMUs: their descriptions, their C code as an importer calls it, and their archives.

use crate::back_to_back::assert_same;
use crate::cases::{Case, conditionings, effects, forces, fuzzy_tanh, learned, terms, with};
use crate::compile::{WARNINGS, bytes, compilers, parse};
use crate::inverse::TIGHT;
use mr_damper_export::fmu::{FmiVersion, Fmu};
use mr_damper_export::vectors::{
    ExpectedCommand, Readings, expected, expected_commands, increasing, readings, with_lost_samples,
    with_requests,
};
use mr_damper_export::{CExport, CSource};
use mr_damper_model::effect::Effect;
use mr_damper_model::inverse::{InverseController, Limits, Method};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::Settings;
use quick_xml::events::Event;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{Read as _, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};

/// The elements of a file of XML, in order: names and attributes. Fails if it is not well formed.
fn elements(text: &str) -> Vec<(String, BTreeMap<String, String>)> {
    let mut reader = quick_xml::Reader::from_str(text);
    reader.config_mut().check_comments = true;
    let mut found = Vec::new();
    loop {
        match reader.read_event().expect("well formed") {
            Event::Start(tag) | Event::Empty(tag) => {
                let attributes = tag.attributes().map(|attribute| {
                    let attribute = attribute.expect("well formed");
                    let value = quick_xml::escape::unescape(&attribute.value).expect("known entities");
                    (attribute.key.as_ref().to_owned(), value.into_owned())
                });
                found.push((tag.name().as_ref().to_owned(), attributes.collect()));
            }
            Event::Eof => return found,
            _ => {}
        }
    }
}

fn text_of(files: &[(String, String)], path: &str) -> String {
    files.iter().find(|(name, _)| name == path).unwrap_or_else(|| panic!("{path}")).1.clone()
}

fn all_cases() -> Vec<Case> {
    [forces(), learned(), conditionings(), effects(), terms()].concat()
}

/// The export of `model` with its inverse by `method`, if it has one.
fn with_inverse(model: &Model, method: Method, limits: Limits) -> Option<(CSource, f64)> {
    let parts = InverseController::with_method(model, limits, method).ok()?.parts()?;
    let source = CExport::new("front_left", model).inverse(&parts).source().expect("it is exported");
    Some((source, parts.most_n))
}

#[test]
fn each_description_is_well_formed_and_complete() {
    for (name, model) in all_cases() {
        let export = CExport::new("damper", &model).provenance("a < b & \"c\" \u{7}");
        assert_description(&name, &export.source().expect("it is exported"), 7);
    }
}

#[test]
fn a_description_has_the_inverse() {
    for method in [Method::Search, Method::Polynomial, Method::Fuzzy] {
        let (source, _) = with_inverse(&fuzzy_tanh(), method, TIGHT).expect("an inverse");
        assert_description(method.name(), &source, 15);
    }
}

/// Checks the descriptions of both versions. In FMI 3.0 there are so many `outputs`, and in FMI 2.0 one more if one is an array of two.
fn assert_description(name: &str, source: &CSource, outputs: usize) {
    for version in FmiVersion::ALL {
        let files = Fmu::new(source, version).files().unwrap_or_else(|error| panic!("{name}: {error}"));
        let all = elements(&text_of(&files, "modelDescription.xml"));
        assert!(source.has_inverse || all[0].1["description"].contains("a < b & \"c\""), "{name}");
        let units: BTreeSet<&String> =
            all.iter().filter(|(tag, _)| tag == "Unit").map(|(_, unit)| &unit["name"]).collect();
        let variables: Vec<_> =
            all.iter().filter(|(_, own)| own.contains_key("causality")).map(|(_, own)| own).collect();
        let names: BTreeSet<_> = variables.iter().map(|own| &own["name"]).collect();
        let references: BTreeSet<_> = variables.iter().map(|own| &own["valueReference"]).collect();
        assert!(names.len() == variables.len() && references.len() == variables.len(), "{name}");
        let mut used = BTreeSet::new();
        let mut starts = 0;
        for (tag, own) in &all {
            if let Some(unit) = own.get("unit") {
                assert!(units.contains(unit), "{name}: {unit} is not defined");
                used.insert(unit);
            }
            let number = |key: &str| own.get(key).map(|text| text.parse::<f64>().expect("a number"));
            if ["Float64", "Real"].contains(&tag.as_str()) {
                let list = own.get("start").cloned().unwrap_or_default();
                for value in list.split_whitespace().map(|value| value.parse::<f64>().expect("a number")) {
                    starts += 1;
                    let (low, high) = (number("min").unwrap_or(f64::MIN), number("max").unwrap_or(f64::MAX));
                    // Only the request has no value at the start.
                    let is_request =
                        source.has_inverse && own.get("name").is_none_or(|name| name == "force_request_n");
                    assert!(
                        (low..=high).contains(&value) || (is_request && value.is_nan()),
                        "{name}: {own:?}"
                    );
                }
            }
        }
        assert_eq!(used, units, "{name}: units that nothing has");
        let inputs = variables.iter().filter(|own| own["causality"] == "input").count();
        let numbers: usize = source.parameters.iter().map(|parameter| parameter.values.len()).sum();
        // The values of the parameters, exact, and one start for each input. FMI 2.0 has them in elements of their own.
        assert_eq!(starts, numbers + inputs, "{name}");
        let found = variables.iter().filter(|own| own["causality"] == "output").count();
        let outputs = outputs + usize::from(source.has_inverse && version == FmiVersion::V2);
        let unknowns =
            all.iter().filter(|(tag, _)| ["Unknown", "Output", "InitialUnknown"].contains(&tag.as_str()));
        assert_eq!((found, unknowns.count()), (outputs, 2 * outputs), "{name}");
    }
}

/// Writes the sources of an FMU.
pub(crate) fn write_sources(dir: &Path, fmu: &Fmu<'_>) {
    for (path, text) in fmu.files().expect("written") {
        if let Some(name) = path.strip_prefix("sources/") {
            std::fs::write(dir.join(name), text).expect("written");
        }
    }
}

/// Compiles the sources of an FMU with `importer` as a program.
fn build(dir: &Path, fmu: &Fmu<'_>, compiler: &str, importer: &str) {
    write_sources(dir, fmu);
    std::fs::write(dir.join("importer.c"), importer).expect("written");
    std::fs::write(dir.join("importer.h"), include_str!("importer.h")).expect("written");
    let compiled = Command::new(compiler)
        .current_dir(dir)
        .args(WARNINGS)
        .args(["-O2", "-o", "importer", "importer.c"])
        .args(fmu.compiled())
        .output()
        .expect("the compiler runs");
    assert!(compiled.status.success(), "{compiler}: {}", String::from_utf8_lossy(&compiled.stderr));
}

/// The value references of the inputs.
pub(crate) fn inputs(source: &CSource) -> Vec<String> {
    let present =
        [true, source.drive.is_some(), source.needs_velocity, source.needs_temperature, source.has_inverse];
    (1..=5).zip(present).filter(|(_, is)| *is).map(|(reference, _)| format!("{reference}")).collect()
}

/// Runs `readings` through the FMU of `source` in an importer that `compiler` compiles. Returns what it writes.
fn imported(what: &str, source: &CSource, version: FmiVersion, compiler: &str, all: &[Readings]) -> Vec<u8> {
    let importer = match version {
        FmiVersion::V3 => include_str!("importer3.c"),
        FmiVersion::V2 => include_str!("importer2.c"),
    };
    let fmu = Fmu::new(source, version);
    let description = elements(&text_of(&fmu.files().expect("written"), "modelDescription.xml"));
    let token =
        ["instantiationToken", "guid"].iter().find_map(|key| description[0].1.get(*key)).expect("one");
    // A scalar parameter in both versions.
    let reference = |name: &str| {
        let own = description.iter().find(|(_, own)| own.get("name").is_some_and(|known| known == name));
        own.map(|(_, own)| own["valueReference"].clone())
    };
    let parameter = reference("parameters.force_offset_n").expect("every model has it");
    let limits = ["safe=inverse_safe_a", "most=inverse_current_max_a"].into_iter().filter_map(|both| {
        let (argument, field) = both.split_once('=')?;
        Some(format!("{argument}={}", reference(&format!("parameters.{field}"))?))
    });
    let dir = tempfile::tempdir().expect("a directory");
    build(dir.path(), &fmu, compiler, importer);
    let mut child = Command::new(dir.path().join("importer"))
        .args([token, &parameter])
        .args(inputs(source))
        .args(limits)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program runs");
    let mut stdin = child.stdin.take().expect("piped");
    let sent = bytes(all);
    let writer = std::thread::spawn(move || stdin.write_all(&sent));
    let output = child.wait_with_output().expect("it ends");
    assert!(output.status.success(), "{what}: {}", String::from_utf8_lossy(&output.stderr));
    writer.join().expect("no panic").expect("it reads everything");
    output.stdout
}

#[test]
fn an_importer_gets_the_services_bits() {
    let cases: Vec<Case> = all_cases().into_iter().step_by(14).collect();
    for (index, (name, model)) in cases.iter().enumerate() {
        let all = increasing(readings(model, 4000, 60 + index as u64));
        let service = expected(model, &all).expect("a pipeline");
        let source = CExport::new("front_left", model).source().expect("it is exported");
        let compiler = compilers()[index % compilers().len()];
        for version in FmiVersion::ALL {
            let what = format!("{name}, FMI {}, {compiler}", version.name());
            let written = imported(&what, &source, version, compiler, &all);
            let found: Vec<_> = written.chunks_exact(24).map(parse).collect();
            assert_same(&what, &all, &service, &found);
        }
    }
}

/// Bytes that an importer writes for a sample with a command.
const WITH_COMMAND: usize = 24 + 48;

/// Fails at the first command that differs, or at a current beyond the limits. Returns how many commands had a force, and in how many
/// samples without a displacement the current changed, because it went to the safe one.
fn assert_commands(what: &str, limits: Limits, service: &[ExpectedCommand], written: &[u8]) -> [usize; 2] {
    assert_eq!(written.len(), WITH_COMMAND * service.len(), "{what}");
    let same = |a: f64, b: f64| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan());
    let (mut seen, mut last_a) = ([0; 2], f64::NAN);
    for (k, (ours, bytes)) in service.iter().zip(written.chunks_exact(WITH_COMMAND)).enumerate() {
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
        let number = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes"));
        let (limited_by, truths) = (word(24), word(28));
        let [current_a, forces @ ..]: [f64; 5] = std::array::from_fn(|n| number(32 + 8 * n));
        let fits = match &ours.command {
            None => truths & 1 == 0,
            Some(command) => {
                let [low, high] = command.achievable.map(|force| force.get());
                let theirs = [command.requested.get(), command.expected.get(), low, high];
                let flags =
                    1 | (u32::from(command.is_achievable) << 1) | (u32::from(command.dissipative) << 2);
                seen[0] += usize::from(command.expected.get().is_finite());
                theirs.iter().zip(&forces).all(|(a, b)| same(*a, *b))
                    && (truths, limited_by) == (flags, command.limited_by as u32)
            }
        };
        let applies = ours.applied_a.is_none_or(|applied_a| same(applied_a, current_a));
        let is_within = (0.0..=limits.current_max_a).contains(&current_a);
        assert!(
            fits && applies && is_within,
            "{what}, sample {k}: service {ours:?}, FMU {current_a} A, {forces:?}, limited by {limited_by}, {truths:03b}"
        );
        seen[1] += usize::from(ours.command.is_none() && ours.applied_a.is_some_and(|own| own != last_a));
        last_a = current_a;
    }
    seen
}

#[test]
fn an_importer_gets_the_services_commands() {
    let lag = with(fuzzy_tanh(), &[Effect::CoilLag.example(), Effect::GasSpring.example()]);
    let mut cases = vec![];
    for method in [Method::Search, Method::Polynomial, Method::Fuzzy] {
        cases.push((
            "fuzzy-tanh".to_owned(),
            fuzzy_tanh(),
            method,
            Limits { safe_a: 0.2, ..Limits::default() },
        ));
        cases.push(("with coil lag and gas spring".to_owned(), lag, method, TIGHT));
    }
    let others: Vec<Case> = [forces(), learned(), effects()].concat();
    cases.extend(others.into_iter().step_by(9).map(|(name, model)| (name, model, Method::Search, TIGHT)));
    let (mut compared, mut seen) = (0, [0; 2]);
    for (index, (name, model, method, limits)) in cases.iter().enumerate() {
        let Some((source, most_n)) = with_inverse(model, *method, *limits) else { continue };
        let seed = 800 + index as u64;
        let all = with_lost_samples(increasing(readings(model, 4000, seed)));
        let all = with_requests(all, most_n, seed);
        let settings = Settings { limits: *limits, method: *method, ..Settings::default() };
        let service = expected_commands(model, &settings, &all).expect("a pipeline");
        let (estimates, commands): (Vec<_>, Vec<_>) = service.into_iter().unzip();
        let compiler = compilers()[index % compilers().len()];
        for version in FmiVersion::ALL {
            let what = format!("{name}, {}, FMI {}, {compiler}", method.name(), version.name());
            let written = imported(&what, &source, version, compiler, &all);
            let found: Vec<_> = written.chunks_exact(WITH_COMMAND).map(parse).collect();
            assert_same(&what, &all, &estimates, &found);
            let own = assert_commands(&what, *limits, &commands, &written);
            seen = std::array::from_fn(|k| seen[k] + own[k]);
        }
        compared += 1;
    }
    // Each compared twice: commands with a force, and currents on their way to the safe one.
    assert!(compared >= 10 && seen[0] > 2000 * compared && seen[1] > 20 * compared, "{compared}: {seen:?}");
}

#[test]
fn the_archive_has_every_file_and_is_the_same_for_equal_models() {
    let (_, model) = &forces()[0];
    let source = CExport::new("damper", model).source().expect("it is exported");
    let changed = CExport::new("damper", model).provenance("other").source().expect("it is exported");
    for version in FmiVersion::ALL {
        let fmu = Fmu::new(&source, version);
        let archive = fmu.archive(Some(b"object")).expect("written");
        assert_eq!(archive, fmu.archive(Some(b"object")).expect("written"));
        let mut opened = zip::ZipArchive::new(std::io::Cursor::new(&archive)).expect("a zip archive");
        let mut names: BTreeSet<String> =
            opened.file_names().map(|name| name.expect("UTF-8").into_owned()).collect();
        for (path, text) in fmu.files().expect("written") {
            let mut found = String::new();
            opened.by_name(&path).expect("there").read_to_string(&mut found).expect("text");
            assert_eq!(found, text, "{path}");
            names.remove(&path);
        }
        let object = version.platform().map(|(folder, extension)| format!("{folder}/damper.{extension}"));
        assert_eq!(names.into_iter().collect::<Vec<_>>(), object.into_iter().collect::<Vec<_>>());
        // Instances are created with the token of their own sources.
        let description = |fmu: Fmu<'_>| {
            let files = fmu.files().expect("written");
            elements(&text_of(&files, "modelDescription.xml"))[0].1.clone()
        };
        let key = if version == FmiVersion::V3 { "instantiationToken" } else { "guid" };
        assert_ne!(description(fmu)[key], description(Fmu::new(&changed, version))[key]);
    }
}
