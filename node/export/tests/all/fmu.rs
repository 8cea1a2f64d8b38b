//! FMUs: their descriptions, their C code as an importer calls it, and their archives.

use crate::back_to_back::assert_same;
use crate::cases::{Case, conditionings, effects, forces, learned, terms};
use crate::compile::{WARNINGS, bytes, compilers, parse};
use mr_damper_export::fmu::{FmiVersion, Fmu};
use mr_damper_export::vectors::{expected, increasing, readings};
use mr_damper_export::{CExport, CSource};
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

#[test]
fn each_description_is_well_formed_and_complete() {
    for (name, model) in all_cases() {
        let export = CExport::new("damper", &model).provenance("a < b & \"c\" \u{7}");
        let source = export.source().expect("it is exported");
        for version in FmiVersion::ALL {
            let files = Fmu::new(&source, version).files().unwrap_or_else(|error| panic!("{name}: {error}"));
            let all = elements(&text_of(&files, "modelDescription.xml"));
            assert!(all[0].1["description"].contains("a < b & \"c\""), "{name}");
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
                    for value in list.split_whitespace().map(|value| value.parse::<f64>().expect("a number"))
                    {
                        starts += 1;
                        let (low, high) =
                            (number("min").unwrap_or(f64::MIN), number("max").unwrap_or(f64::MAX));
                        assert!((low..=high).contains(&value), "{name}: {own:?}");
                    }
                }
            }
            assert_eq!(used, units, "{name}: units that nothing has");
            let inputs = variables.iter().filter(|own| own["causality"] == "input").count();
            let numbers: usize = source.parameters.iter().map(|parameter| parameter.values.len()).sum();
            // The values of the parameters, exact, and one start for each input. FMI 2.0 has them in elements of their own.
            assert_eq!(starts, numbers + inputs, "{name}");
            let outputs = variables.iter().filter(|own| own["causality"] == "output").count();
            let unknowns =
                all.iter().filter(|(tag, _)| ["Unknown", "Output", "InitialUnknown"].contains(&tag.as_str()));
            assert_eq!((outputs, unknowns.count()), (7, 14), "{name}");
        }
    }
}

/// Writes the sources of an FMU, and compiles them with `importer` as a program.
fn build(dir: &Path, fmu: &Fmu<'_>, compiler: &str, importer: &str) {
    for (path, text) in fmu.files().expect("written") {
        if let Some(name) = path.strip_prefix("sources/") {
            std::fs::write(dir.join(name), text).expect("written");
        }
    }
    std::fs::write(dir.join("importer.c"), importer).expect("written");
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
fn inputs(source: &CSource) -> Vec<String> {
    let present = [true, source.drive.is_some(), source.needs_velocity, source.needs_temperature];
    (1..=4).zip(present).filter(|(_, is)| *is).map(|(reference, _)| format!("{reference}")).collect()
}

#[test]
fn an_importer_gets_the_services_bits() {
    let cases: Vec<Case> = all_cases().into_iter().step_by(14).collect();
    for (index, (name, model)) in cases.iter().enumerate() {
        let all = increasing(readings(model, 4000, 60 + index as u64));
        let service = expected(model, &all).expect("a pipeline");
        let source = CExport::new("front_left", model).source().expect("it is exported");
        for (version, importer) in
            [(FmiVersion::V3, include_str!("importer3.c")), (FmiVersion::V2, include_str!("importer2.c"))]
        {
            let fmu = Fmu::new(&source, version);
            let files = fmu.files().expect("written");
            let description = elements(&text_of(&files, "modelDescription.xml"));
            let token = ["instantiationToken", "guid"]
                .iter()
                .find_map(|key| description[0].1.get(*key))
                .expect("one");
            // A scalar parameter in both versions.
            let parameter = description
                .iter()
                .find(|(_, own)| own.get("name").is_some_and(|name| name == "parameters.force_offset_n"))
                .map(|(_, own)| own["valueReference"].clone())
                .expect("every model has it");
            let dir = tempfile::tempdir().expect("a directory");
            let compiler = compilers()[index % compilers().len()];
            build(dir.path(), &fmu, compiler, importer);
            let mut child = Command::new(dir.path().join("importer"))
                .args([token, &parameter])
                .args(inputs(&source))
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .stderr(Stdio::piped())
                .spawn()
                .expect("the program runs");
            let mut stdin = child.stdin.take().expect("piped");
            let sent = bytes(&all);
            let writer = std::thread::spawn(move || stdin.write_all(&sent));
            let output = child.wait_with_output().expect("it ends");
            let what = format!("{name}, FMI {}, {compiler}", version.name());
            assert!(output.status.success(), "{what}: {}", String::from_utf8_lossy(&output.stderr));
            writer.join().expect("no panic").expect("it reads everything");
            let found: Vec<_> = output.stdout.chunks_exact(24).map(parse).collect();
            assert_same(&what, &all, &service, &found);
        }
    }
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
