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
/// Each line of the list has the name, the expected error, and what the model is. The error is that of the thesis: on the
/// training data for ARX and sp, the mean over all experiments for fuzzy-tanh and anfis.
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
            _ if [preset::BEST_ARX, preset::BEST_FUZZY_TANH, preset::BEST_ANFIS].contains(&name.as_str()) => {
                "; the best of its kind in the thesis"
            }
            ForceModel::Arx(arx) if !arx.dc_is_meaningful() => "; static gain uncertain: one step ahead only",
            _ => "",
        };
        let line = writeln!(out, "{name:<34} {expected:<16} {}{remark}", description(&name));
        if line.is_err() {
            return Ok(line);
        }
    }
    for name in preset::phase_names() {
        let line = writeln!(out, "{name:<34} {:<16} {}", "", description(&name));
        if line.is_err() {
            return Ok(line);
        }
    }
    Ok(Ok(()))
}

/// Describes the preset `name` in a few words.
fn description(name: &str) -> String {
    let mut parts = name.split('/').skip(1);
    let (form, experiment, level) =
        (parts.next().unwrap_or_default(), parts.next().unwrap_or_default(), parts.next());
    let what = match (form, level) {
        ("arx-passive", _) => "ARX without current",
        ("arx-semi-active", _) => "ARX with current",
        ("sp-passive", _) => "tanh law without current",
        ("sp-semi-active", _) => "tanh law, polynomials over the current",
        ("fuzzy-tanh", None) => "tanh laws, blended over the current",
        ("fuzzy-tanh", Some(_)) => "one of its tanh laws",
        ("anfis", _) => "27 fuzzy rules",
        ("p-passive", _) => "relation p without current, not a model that runs",
        ("p-semi-active", _) => "relation p, polynomials over the current, not a model that runs",
        _ => "model",
    };
    let level = level.map(|level| format!(", at {} A", level.trim_end_matches('a'))).unwrap_or_default();
    format!("{what}{level}, identified on {}", experiment.to_uppercase())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_says_what_each_preset_is() {
        let mut text = Vec::new();
        list(&mut text).expect("presets").expect("memory");
        let text = String::from_utf8(text).expect("UTF-8");
        assert_eq!(text.lines().count(), preset::names().len() + preset::phase_names().len());
        for line in text.lines() {
            assert!(line.contains(", identified on RP") && line.chars().count() <= 150, "{line}");
            assert!(!line.contains("model, identified"), "{line}: its form has no description");
        }
        let of = |name: &str| text.lines().find(|line| line.starts_with(&format!("{name} "))).expect(name);
        assert!(of(preset::BEST_FUZZY_TANH).ends_with("RP3-CS; the best of its kind in the thesis"));
        assert!(of("thesis/fuzzy-tanh/rp1-cs/0.4a").contains("one of its tanh laws, at 0.4 A"));
        assert!(of("thesis/arx-passive/rp1-cs").contains("static gain uncertain"));
        assert!(of("thesis/p-passive/rp-icps").contains("not a model that runs"));
    }
}
