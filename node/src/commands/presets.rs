//! `mr-damper presets`: lists the built-in models.

use crate::settings::error::NodeError;
use mr_damper_model::force::ForceModel;
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::preset;
use std::io::Write;

/// List the built-in models, or print one as a model file.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Preset to print as a model file, e.g. thesis/fuzzy-tanh/rp3-cs.
    name: Option<String>,
}

/// Prints the list, or one preset as a model file, to stdout.
///
/// # Errors
/// When the preset is unknown or stdout cannot be written.
pub fn run(args: &Args) -> Result<(), NodeError> {
    let mut out = std::io::stdout().lock();
    let written = match &args.name {
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
    Ok(Ok(()))
}
