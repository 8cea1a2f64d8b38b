//! `mr-damper presets`: lists the built-in models.

use crate::settings::error::{NodeError, PartError};
use mr_damper_model::force::{ForceModel, PHASE_NAMES, PHASE_PARAMETERS, Phase};
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::preset;
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::Write;

/// List the built-in models, or print one as a model file.
///
/// The relations p (thesis/p-passive/..., thesis/p-semi-active/...) explain measured force by itself and cannot run as
/// models. They are printed as tables of coefficients; `mr-damper evaluate` says how well one holds on runs.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Preset to print, e.g. thesis/fuzzy-tanh/rp3-cs.
    name: Option<String>,
}

/// Prints the list, or one preset as a model file, to stdout.
///
/// # Errors
/// When the preset is unknown or stdout cannot be written.
pub fn run(args: &Args) -> Result<(), NodeError> {
    let mut out = std::io::stdout().lock();
    let written = match &args.name {
        Some(name) if preset::phase_names().contains(name) => {
            out.write_all(relation(name, &preset::phase(name)?)?.as_bytes())
        }
        Some(name) => {
            let provenance = Provenance {
                tool: format!("mr-damper {}, preset {name}", env!("CARGO_PKG_VERSION")),
                ..Provenance::default()
            };
            let file = ModelFile { model: preset::load(name)?, provenance };
            out.write_all(file.to_toml()?.as_bytes())
        }
        None => list(&mut out)?,
    };
    // A closed pipe (`| head`) is not an error.
    match written {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(NodeError::io("writing to stdout")(error))
        }
        _ => Ok(()),
    }
}

fn list(out: &mut impl Write) -> Result<std::io::Result<()>, NodeError> {
    for name in preset::names() {
        let model = preset::load(&name)?;
        let expected = match (model.expected.free_run_rsse_n, model.expected.one_step_rsse_n) {
            (Some(rsse), _) => format!("simulation {rsse:.0} N"),
            (None, Some(rsse)) => format!("one step {rsse:.0} N"),
            (None, None) => String::new(),
        };
        let remark = match model.force {
            ForceModel::Arx(arx) if !arx.dc_is_meaningful() => "static gain uncertain: one step ahead only",
            _ => "",
        };
        let line = writeln!(out, "{name:<34} {expected:<16} {remark}");
        if line.is_err() {
            return Ok(line);
        }
    }
    for name in preset::phase_names() {
        let line = writeln!(out, "{name:<34} {:<16} relation p: not a model that runs", "");
        if line.is_err() {
            return Ok(line);
        }
    }
    Ok(Ok(()))
}

/// A relation p as a table of its coefficients in SI units.
#[derive(Debug, Serialize)]
struct RelationTable {
    schema: &'static str,
    relation: &'static str,
    equation: &'static str,
    /// Unit-suffixed name of the drive.
    #[serde(skip_serializing_if = "Option::is_none")]
    drive: Option<&'static str>,
    /// Coefficients of 1, drive, drive² of each parameter.
    parameters: BTreeMap<&'static str, Vec<f64>>,
}

/// The table cannot be serialised.
#[derive(Debug, thiserror::Error)]
#[error("the relation cannot be written as TOML: {0}")]
struct UnwritableRelation(#[source] toml::ser::Error);

impl PartError for UnwritableRelation {}

/// The relation called `name` as TOML.
fn relation(name: &str, phase: &Phase) -> Result<String, NodeError> {
    let (copies, _) = phase.coefficients().as_chunks::<PHASE_PARAMETERS>();
    let table = RelationTable {
        schema: "mr-damper/relation/1",
        relation: "p",
        equation: "F = p1 v + p2 F' + p3 F'' + p4 F^3 + p5 F^5",
        drive: phase.drive().map(|drive| drive.name()),
        parameters: (0..PHASE_PARAMETERS)
            .map(|j| (PHASE_NAMES[j], copies.iter().map(|copy| copy[j]).collect()))
            .collect(),
    };
    let text = toml::to_string(&table).map_err(UnwritableRelation)?;
    Ok(format!(
        "# {name}: a relation, which cannot run as a model. Parameters p1 to p5 in this order: {}.\n{text}",
        PHASE_NAMES.join(", ")
    ))
}
