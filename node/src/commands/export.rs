//! `mr-damper export`: a model as C99 source for an electronic control unit.

use crate::commands::context::CliContext;
use crate::estimation::models;
use crate::settings::error::{NodeError, PartError};
use mr_damper_base::shown;
use mr_damper_export::{CExport, CSource, ExportError, a2l, vectors};
use mr_damper_model::pipeline::Models;
use mr_damper_runs::write_text;
use std::fs;
use std::path::{Path, PathBuf};

/// Write a model with its effects as C99 source for an electronic control unit.
///
/// NAME.h and NAME.c compute what the node's simulation computes, bit for bit: checks of the readings, filters, the model
/// with its effects, and the reasons of the estimate. They need no C library, no heap and no globals. Call NAME_step once
/// for each sample. All parameters are in one structure, which calibration may change at any time.
///
/// Compile with -std=c99 and without -ffast-math. --vectors writes readings, among them lost, late and impossible ones,
/// with what the code must return, for a test on your own target. --a2l writes a calibration file.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Model file, or preset.
    #[arg(value_name = "MODEL")]
    model: String,
    /// Folder for NAME.h and NAME.c; files of these names are replaced.
    #[arg(long, value_name = "DIR")]
    c: PathBuf,
    /// What all names in the code begin with: letters, digits and _, beginning with a letter.
    #[arg(long, value_name = "NAME", default_value = "damper")]
    name: String,
    /// Also write test vectors to this file.
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
    let source = CExport::new(&args.name, &model)
        .provenance(format!("From {}.", args.model))
        .provenance(format!("Model hash {hash}, as the node publishes it."))
        .source()
        .map_err(|error| match error {
            ExportError::Name { .. } => NodeError::Usage(error.to_string()),
            other => other.into(),
        })?;
    let mut written = Vec::new();
    let folder_fault =
        |error: std::io::Error| NodeError::File { path: args.c.clone(), message: error.to_string() };
    fs::create_dir_all(&args.c).map_err(folder_fault)?;
    for (ending, text) in [("h", &source.header), ("c", &source.source)] {
        write(&mut written, args.c.join(format!("{}.{ending}", args.name)), text)?;
    }
    if let Some(path) = &args.vectors {
        let readings = vectors::readings(&model, args.vector_count as usize, 1);
        write(&mut written, path.clone(), &vectors::csv(&model, &readings)?)?;
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
