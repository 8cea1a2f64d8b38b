//! `mr-damper export`: a model as C99 source for an electronic control unit, and as FMU for a simulator.

mod compilers;
mod cortex;

use crate::commands::context::CliContext;
use crate::estimation::models;
use crate::settings::error::{NodeError, PartError};
use mr_damper_base::shown;
use mr_damper_export::fmu::{FmiVersion, Fmu};
use mr_damper_export::vectors::{self, Readings};
use mr_damper_export::{CExport, CSource, ExportError, Precision, a2l};
use mr_damper_model::inverse::{InverseController, InverseParts, Limits, Method};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{Models, Settings};
use mr_damper_runs::{write_bytes, write_text};
use std::fs;
use std::path::{Path, PathBuf};

/// Write a model with its effects as C99 source for an electronic control unit.
///
/// NAME.h and NAME.c compute what the node's simulation computes, bit for bit: checks of the readings, filters, the model
/// with its effects, and the reasons of the estimate. They need no C library, no heap and no globals. Call NAME_step once
/// for each sample. All parameters are in one structure, which calibration may change at any time.
///
/// Compile with -std=c99 and without -ffast-math. --vectors writes readings, among them lost, late and impossible ones,
/// with what the code must return, for a test on your own target. --a2l writes a calibration file. For an Arm processor without
/// an FPU for double precision, also link mr_damper_sum.c, as it says: without it, GCC's library rounds some sums wrongly.
///
/// --fmu writes a Functional Mock-up Unit (FMI co-simulation) with its C sources, for MATLAB/Simulink, Dymola, OpenModelica,
/// FMPy and other simulators. If there is a C compiler (cc), the FMU also has a binary for this machine.
///
/// --float writes C code in single precision, for a processor whose FPU has no double precision. Its results differ from the
/// node's by rounding errors. If there is a C compiler (cc), the difference is measured, and said in the files.
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
    /// Write the code in single precision. Only in the files of --c; --vectors has the node's results, in double precision.
    #[arg(long, requires = "c", conflicts_with = "fmu")]
    float: bool,
    /// Also correct stamps that jitter, as the node does. Without this, the code takes each stamp as the time at which its
    /// displacement was taken, as the time of a periodic task is.
    #[arg(long, requires = "c", conflicts_with = "fmu")]
    correct_stamps: bool,
    /// Also write the inverse controller, which commands a coil current for a requested force. The current comes from a
    /// search on the model, from a function fitted to the model (polynomial, fuzzy), or from a learned inverse, which
    /// identify --inverse puts into the model file (chen, wang-liao, wang-hu).
    #[arg(long, value_name = "METHOD",
          value_parser = ["search", "polynomial", "fuzzy", "chen", "wang-liao", "wang-hu"])]
    inverse: Option<String>,
    /// Largest current of the inverse, A.
    #[arg(long, value_name = "A", default_value_t = Limits::default().current_max_a, requires = "inverse")]
    current_max: f64,
    /// Largest rate of change of the inverse's current, A/s; by default it is not limited.
    #[arg(long, value_name = "A/S", requires = "inverse")]
    rate_max: Option<f64>,
    /// Also write test vectors to this file. With --fmu, their time increases, as in a simulation; with --inverse, too, their gaps are
    /// filled with samples without readings.
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
    /// The processor stores the first byte of a number first, as a PowerPC does (big-endian).
    #[arg(long, requires = "a2l")]
    big_endian: bool,
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
    let precision = if args.float { Precision::Single } else { Precision::Double };
    let mut export = CExport::new(&args.name, &model)
        .precision(precision)
        .provenance(format!("From {}.", args.model))
        .provenance(format!("Model hash {hash}, as the node publishes it."));
    if args.correct_stamps {
        export = export.corrected_stamps();
    }
    let written_from = |export: &CExport<'_>| {
        export.source().map_err(|error| match error {
            ExportError::Name { .. } => NodeError::Usage(error.to_string()),
            other => other.into(),
        })
    };
    let generated = |count: usize| {
        let readings = vectors::readings(&model, count, 1);
        if args.correct_stamps { vectors::with_late_stamps(readings, 1) } else { readings }
    };
    let settings = args.settings();
    let inverse = args.inverse_parts(&model, &settings)?;
    if args.float {
        for line in compilers::difference(&written_from(&export)?, &model, &generated(COMPARED), context)? {
            export = export.provenance(line);
        }
    }
    if let Some(parts) = &inverse {
        export = export.inverse(parts);
    }
    let mut source = written_from(&export)?;
    // The size in a control unit does not concern a simulator.
    let simulated = source.clone();
    if args.c.is_some() {
        let readings = with_requests(generated(COUNTED), inverse.as_ref());
        match cortex::footprint(&source, &readings) {
            Ok(lines) => export = lines.into_iter().fold(export, CExport::provenance),
            Err(error) => eprintln!("the header does not state what a step takes: {error}"),
        }
        source = written_from(&export)?;
    }
    let mut written = Vec::new();
    if let Some(folder) = &args.c {
        let fault =
            |error: std::io::Error| NodeError::File { path: folder.clone(), message: error.to_string() };
        fs::create_dir_all(folder).map_err(fault)?;
        written.extend(compilers::write_code(folder, &source)?);
    }
    if let Some(path) = &args.fmu {
        let version = FmiVersion::named(&args.fmi).unwrap_or_default();
        let fmu = Fmu::new(&simulated, version);
        let binary = compilers::fmu_binary(&fmu, version, context)?;
        write_bytes(path, &fmu.archive(binary.as_deref())?)?;
        written.push(path.clone());
    }
    if let Some(path) = &args.vectors {
        let count = args.vector_count as usize;
        let readings = match args.fmu {
            Some(_) => vectors::simulated(&model, count, 1, inverse.is_some()),
            None => generated(count),
        };
        let readings = with_requests(readings, inverse.as_ref());
        let text = match &inverse {
            Some(_) => vectors::csv_with_commands(&model, &settings, &readings)?,
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

/// Readings on which code in single precision is compared with the service.
const COMPARED: usize = 20_000;

/// Readings on which the instructions of a step are counted.
const COUNTED: usize = 500;

/// The readings, with requested forces if there is an inverse.
fn with_requests(readings: Vec<Readings>, inverse: Option<&InverseParts>) -> Vec<Readings> {
    match inverse {
        Some(parts) => vectors::with_requests(readings, parts.most_n, 1),
        None => readings,
    }
}

fn calibration_file(args: &Args, source: &CSource) -> String {
    let symbols = [format!("{}_calibration", args.name), format!("{}_measured", args.name)];
    let memory = a2l::Memory {
        is_big_endian: args.big_endian,
        parameters: args.calibration_address.unwrap_or_default(),
        output: args.measured_address.unwrap_or_default(),
    };
    a2l::file(source, [&symbols[0], &symbols[1]], memory)
}

fn write(written: &mut Vec<PathBuf>, path: impl AsRef<Path>, text: &str) -> Result<(), NodeError> {
    write_text(path.as_ref(), text)?;
    written.push(path.as_ref().to_owned());
    Ok(())
}
