//! `mr-damper export`: a model as C99 source for an electronic control unit, and as FMU for a simulator.

use crate::commands::context::CliContext;
use crate::estimation::models;
use crate::settings::error::{NodeError, PartError};
use mr_damper_base::shown;
use mr_damper_export::fmu::{FmiVersion, Fmu};
use mr_damper_export::{CExport, CSource, ExportError, a2l, vectors};
use mr_damper_model::inverse::{InverseController, InverseParts, Limits, Method};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{Models, Settings};
use mr_damper_runs::{write_bytes, write_text};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Write a model with its effects as C99 source for an electronic control unit.
///
/// NAME.h and NAME.c compute what the node's simulation computes, bit for bit: checks of the readings, filters, the model
/// with its effects, and the reasons of the estimate. They need no C library, no heap and no globals. Call NAME_step once
/// for each sample. All parameters are in one structure, which calibration may change at any time.
///
/// Compile with -std=c99 and without -ffast-math. --vectors writes readings, among them lost, late and impossible ones,
/// with what the code must return, for a test on your own target. --a2l writes a calibration file.
///
/// --fmu writes a Functional Mock-up Unit (FMI co-simulation) with its C sources, for MATLAB/Simulink, Dymola, OpenModelica,
/// FMPy and other simulators. If there is a C compiler (cc), the FMU also has a binary for this machine.
#[derive(Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("output").args(["c", "fmu"]).required(true).multiple(true)))]
pub struct Args {
    /// Model file, or preset.
    #[arg(value_name = "MODEL")]
    model: String,
    /// Folder for NAME.h and NAME.c; files of these names are replaced.
    #[arg(long, value_name = "DIR")]
    c: Option<PathBuf>,
    /// Write a Functional Mock-up Unit (FMU) to this file.
    #[arg(long, value_name = "FILE.fmu")]
    fmu: Option<PathBuf>,
    /// Version of FMI: 3.0, or 2.0, which more tools read.
    #[arg(long, value_name = "VERSION", default_value = "3.0", requires = "fmu", value_parser = ["3.0", "2.0"])]
    fmi: String,
    /// What all names in the code begin with: letters, digits and _, beginning with a letter.
    #[arg(long, value_name = "NAME", default_value = "damper")]
    name: String,
    /// Also write the inverse controller, which commands a coil current for a requested force. The current comes from a
    /// search on the model, from a function fitted to the model (polynomial, fuzzy), or from a learned inverse, which
    /// identify --inverse puts into the model file (chen, wang-liao, wang-hu). Only in the files of --c.
    #[arg(long, value_name = "METHOD", requires = "c",
          value_parser = ["search", "polynomial", "fuzzy", "chen", "wang-liao", "wang-hu"])]
    inverse: Option<String>,
    /// Largest current of the inverse, A.
    #[arg(long, value_name = "A", default_value_t = Limits::default().current_max_a, requires = "inverse")]
    current_max: f64,
    /// Largest rate of change of the inverse's current, A/s; by default it is not limited.
    #[arg(long, value_name = "A/S", requires = "inverse")]
    rate_max: Option<f64>,
    /// Also write test vectors to this file. With --fmu, their time increases, as in a simulation.
    #[arg(long, value_name = "FILE.csv")]
    vectors: Option<PathBuf>,
    /// Number of test vectors.
    #[arg(long, value_name = "COUNT", default_value_t = 20_000, requires = "vectors",
          value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    vector_count: u32,
    /// Also write a calibration file (ASAM A2L) for the variables NAME_calibration and NAME_measured of your code, of type
    /// NAME_parameters and NAME_output.
    #[arg(long, value_name = "FILE.a2l")]
    a2l: Option<PathBuf>,
    /// Address of NAME_calibration, as nm prints it, e.g. 0x20000100.
    #[arg(long, value_name = "ADDRESS", requires = "a2l", value_parser = address)]
    calibration_address: Option<u64>,
    /// Address of NAME_measured.
    #[arg(long, value_name = "ADDRESS", requires = "a2l", value_parser = address)]
    measured_address: Option<u64>,
}

impl PartError for ExportError {}

impl Args {
    /// The service's default settings, with the method and the limits of the inverse.
    fn settings(&self) -> Settings {
        let limits = Limits {
            current_max_a: self.current_max,
            rate_max_a_s: self.rate_max.unwrap_or(f64::INFINITY),
            ..Limits::default()
        };
        let method = self.inverse.as_deref().and_then(Method::named).unwrap_or_default();
        Settings { limits, method, ..Settings::default() }
    }

    /// The inverse, if one was asked for.
    fn inverse_parts(&self, model: &Model, settings: &Settings) -> Result<Option<InverseParts>, NodeError> {
        if self.inverse.is_none() {
            return Ok(None);
        }
        let controller = InverseController::with_method(model, settings.limits, settings.method)?;
        Ok(controller.parts())
    }
}

/// Parses a hexadecimal address, with or without 0x.
fn address(text: &str) -> Result<u64, String> {
    let digits = text.strip_prefix("0x").unwrap_or(text);
    u64::from_str_radix(digits, 16).map_err(|_| "not a hexadecimal address such as 0x20000100".to_owned())
}

/// Writes the files.
///
/// # Errors
/// When the model does not load or has no C code, the name is none of C, or a file cannot be written.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let model = models::load(&args.model)?;
    let hash = models::hash(&Models::alone(model))?;
    let export = CExport::new(&args.name, &model)
        .provenance(format!("From {}.", args.model))
        .provenance(format!("Model hash {hash}, as the node publishes it."));
    let written_from = |export: &CExport<'_>| {
        export.source().map_err(|error| match error {
            ExportError::Name { .. } => NodeError::Usage(error.to_string()),
            other => other.into(),
        })
    };
    let settings = args.settings();
    let inverse = args.inverse_parts(&model, &settings)?;
    let source = match &inverse {
        Some(parts) => written_from(&export.clone().inverse(parts))?,
        None => written_from(&export)?,
    };
    let mut written = Vec::new();
    if let Some(folder) = &args.c {
        let fault =
            |error: std::io::Error| NodeError::File { path: folder.clone(), message: error.to_string() };
        fs::create_dir_all(folder).map_err(fault)?;
        for (ending, text) in [("h", &source.header), ("c", &source.source)] {
            write(&mut written, folder.join(format!("{}.{ending}", args.name)), text)?;
        }
    }
    if let Some(path) = &args.fmu {
        let version = FmiVersion::named(&args.fmi).unwrap_or_default();
        let estimator = written_from(&export)?;
        let fmu = Fmu::new(&estimator, version);
        let binary = compiled(&fmu, version, context)?;
        write_bytes(path, &fmu.archive(binary.as_deref())?)?;
        written.push(path.clone());
    }
    if let Some(path) = &args.vectors {
        let mut readings = vectors::readings(&model, args.vector_count as usize, 1);
        if args.fmu.is_some() {
            readings = vectors::increasing(readings);
        }
        let text = match &inverse {
            Some(parts) => {
                let readings = vectors::with_requests(readings, parts.most_n, 1);
                vectors::csv_with_commands(&model, &settings, &readings)?
            }
            None => vectors::csv(&model, &readings)?,
        };
        write(&mut written, path.clone(), &text)?;
    }
    if let Some(path) = &args.a2l {
        write(&mut written, path.clone(), &calibration_file(args, &source))?;
    }
    if !context.quiet {
        for path in written {
            eprintln!("wrote {}", shown::line(&path.display().to_string()));
        }
    }
    Ok(())
}

/// The shared object of `fmu` for this machine; `None`, with a message, without a compiler or on a machine that FMI has no name for.
fn compiled(fmu: &Fmu<'_>, version: FmiVersion, context: &CliContext) -> Result<Option<Vec<u8>>, NodeError> {
    let without = |why: &str| {
        if !context.quiet {
            eprintln!(
                "the FMU has C sources and no binary: {why}. Simulators that compile sources can use it."
            );
        }
        Ok(None)
    };
    if version.platform().is_none() {
        let name = version.name();
        return without(&format!("FMI {name} has no name for this kind of machine"));
    }
    let folder = tempfile::tempdir().map_err(|error| NodeError::File {
        path: std::env::temp_dir(),
        message: format!("cannot create a folder for the compiler: {error}"),
    })?;
    for (path, text) in fmu.files()? {
        if let Some(name) = path.strip_prefix("sources/") {
            write_text(&folder.path().join(name), &text)?;
        }
    }
    let object = folder.path().join("fmu.so");
    let done = Command::new("cc")
        .current_dir(folder.path())
        .args(["-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-o"])
        .arg(&object)
        .args(fmu.compiled())
        .output();
    let done = match done {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            return without("there is no C compiler (cc) on this machine");
        }
        other => {
            other.map_err(|error| NodeError::Usage(format!("the C compiler (cc) does not start: {error}")))?
        }
    };
    let fault = |message: String| NodeError::File { path: PathBuf::from("cc"), message };
    if !done.status.success() {
        let said = String::from_utf8_lossy(&done.stderr);
        return Err(fault(format!("the C compiler refuses the sources of the FMU: {}", shown::line(&said))));
    }
    fs::read(&object).map(Some).map_err(|error| fault(format!("the compiler wrote no binary: {error}")))
}

fn calibration_file(args: &Args, source: &CSource) -> String {
    let symbols = [format!("{}_calibration", args.name), format!("{}_measured", args.name)];
    let addresses = a2l::Addresses {
        parameters: args.calibration_address.unwrap_or_default(),
        output: args.measured_address.unwrap_or_default(),
    };
    a2l::file(source, [&symbols[0], &symbols[1]], addresses)
}

fn write(written: &mut Vec<PathBuf>, path: impl AsRef<Path>, text: &str) -> Result<(), NodeError> {
    write_text(path.as_ref(), text)?;
    written.push(path.as_ref().to_owned());
    Ok(())
}
