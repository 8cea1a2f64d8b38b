//! `mr-damper fis`: converts MATLAB's FIS files to model files, and back.

use crate::commands::{context::CliContext, number};
use crate::estimation::models;
use crate::settings::error::{NodeError, PartError};
use mr_damper_base::shown;
use mr_damper_model::condition::Conditioning;
use mr_damper_model::effect::Effects;
use mr_damper_model::fis::{Fis, Scaling};
use mr_damper_model::force::{ForceModel, OutputScale, Tsk, TskKind};
use mr_damper_model::identify::Structure;
use mr_damper_model::model::{Expected, Model};
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_runs::write_text;
use std::fs;
use std::path::{Path, PathBuf};

/// Convert FIS files of MATLAB to model files, and models of fuzzy rules to FIS files.
///
/// A FIS file (.fis) holds fuzzy sets and rules, but no units, no normalisation, no filter and no sample rate. --like takes
/// these from a model. Without --like, the inputs and the force are SI values (m, m/s, A or V, N), and the names of the inputs
/// must be displacement, velocity, acceleration, current or voltage. The model file has a line for each of these values,
/// so they can be corrected there. A FIS file that a model cannot represent is refused with its line: the system must be
/// of type sugeno, with memberships gaussmf, gauss2mf, gbellmf, trimf or trapmf and one rule for each combination of them.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// FIS files, whose names end in .fis, to convert to model files; model files and presets (anfis, tsk-...) to convert to
    /// FIS files.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<String>,
    /// Folder for the written files. NAME.fis becomes NAME.toml; a model file NAME.toml or preset thesis/anfis/NAME becomes
    /// NAME.fis. Existing files are not replaced.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// What a FIS file does not hold.
    #[command(flatten)]
    pub scale: ScaleArgs,
}

/// What a FIS file does not hold.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct ScaleArgs {
    /// Take normalisation, filter, derivative and sample rate from this model of fuzzy rules, a file or preset. It must have
    /// the inputs of the FIS file, in the same order.
    #[arg(long, value_name = "MODEL")]
    pub like: Option<String>,
    /// Sample rate of the data that a FIS file was trained on, Hz; needed without --like.
    #[arg(long, value_name = "HZ", conflicts_with = "like", value_parser = number::hertz)]
    pub rate: Option<f64>,
}

/// True if the name of the file at `path` ends in .fis.
#[must_use]
pub fn is_fis(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("fis"))
}

/// Converts the files. Nothing is written if one of them cannot be converted.
///
/// # Errors
/// When a file does not load, is not a system or model that the other format can represent, or cannot be written.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let mut converted: Vec<(PathBuf, String)> = Vec::with_capacity(args.files.len());
    for file in &args.files {
        let path = Path::new(file);
        let (extension, text) =
            if is_fis(path) { ("toml", model_text(path, &args.scale)?) } else { ("fis", fis_text(file)?) };
        let target = args.out.join(path.with_extension(extension).file_name().unwrap_or_default());
        if target.exists() || converted.iter().any(|(other, _)| *other == target) {
            return Err(NodeError::File {
                path: target,
                message: format!("{file} would replace this file; give another --out"),
            });
        }
        converted.push((target, text));
    }
    fs::create_dir_all(&args.out)
        .map_err(|error| NodeError::File { path: args.out.clone(), message: error.to_string() })?;
    for ((target, text), file) in converted.iter().zip(&args.files) {
        write_text(target, text)?;
        if !context.quiet {
            eprintln!("{}", shown::line(&format!("{file}: written to {}", target.display())));
        }
    }
    Ok(())
}

/// The text of the model file for the FIS file at `path`.
pub(super) fn model_text(path: &Path, args: &ScaleArgs) -> Result<String, NodeError> {
    let in_file = |message: String| NodeError::File { path: path.to_owned(), message };
    let text = fs::read_to_string(path).map_err(|error| in_file(error.to_string()))?;
    let fis = Fis::parse(&text).map_err(|error| in_file(error.to_string()))?;
    let (scaling, conditioning, rate_hz) = match (&args.like, args.rate) {
        (Some(name), _) => {
            let (model, rules) = rule_model(name)?;
            (
                scaling_like(&fis, name, &rules).map_err(|error| in_file(error.to_string()))?,
                model.conditioning,
                model.rate_hz,
            )
        }
        (None, Some(rate_hz)) => {
            (si_scaling(&fis).map_err(|error| in_file(error.to_string()))?, Conditioning::default(), rate_hz)
        }
        (None, None) => {
            return Err(NodeError::Usage(format!(
                "{}: a FIS file has no sample rate; give --rate HZ, or --like MODEL",
                path.display()
            )));
        }
    };
    let rules = fis.model(TskKind::Anfis, &scaling).map_err(|error| in_file(error.to_string()))?;
    let model = Model {
        force: ForceModel::Tsk(rules),
        effects: Effects::NONE,
        conditioning,
        rate_hz,
        envelope: fis.envelope(&scaling),
        expected: Expected::default(),
        inverse: None,
    };
    let tool = format!("mr-damper {}, FIS file {}", env!("CARGO_PKG_VERSION"), path.display());
    let file = ModelFile { model, provenance: Provenance { tool, ..Provenance::default() } };
    Ok(file.to_toml()?)
}

/// Reasons why the inputs of a FIS file have no scaling.
#[derive(Debug, thiserror::Error)]
enum ScalingError {
    #[error("the system has {found} inputs, but {like} has {given}; give another model to --like")]
    Number { found: usize, like: String, given: usize },
    #[error(
        "[Input{number}] has the name \"{name}\", but this input of {like} is {signal} ({unit}); give another model to --like, or \
         correct the name"
    )]
    OtherSignal { number: usize, name: String, like: String, signal: &'static str, unit: &'static str },
    #[error(
        "[Input{number}] has the name \"{name}\", which is not a signal; rename it to displacement, velocity, acceleration, \
         current or voltage, or give --like MODEL"
    )]
    NoSignal { number: usize, name: String },
}

/// The scaling of the model `name`, if the system can have the same inputs.
fn scaling_like(fis: &Fis, name: &str, rules: &Tsk) -> Result<Scaling, ScalingError> {
    let (found, given) = (fis.inputs.len(), rules.inputs().len());
    if found != given {
        return Err(ScalingError::Number { found, like: name.to_owned(), given });
    }
    for (index, (input, like)) in fis.inputs.iter().zip(rules.inputs()).enumerate() {
        // A name that is not a signal may be any of them.
        if input.signal().is_some_and(|signal| signal != like.signal()) {
            return Err(ScalingError::OtherSignal {
                number: index + 1,
                name: input.name.clone(),
                like: name.to_owned(),
                signal: like.signal().name(),
                unit: like.signal().unit_suffix(),
            });
        }
    }
    Ok(Scaling::of(rules))
}

/// The scaling of a system on SI values.
fn si_scaling(fis: &Fis) -> Result<Scaling, ScalingError> {
    let inputs = fis.inputs.iter().enumerate().map(|(index, input)| match input.signal() {
        Some(signal) => Ok((signal, 0.0, 1.0)),
        None => Err(ScalingError::NoSignal { number: index + 1, name: input.name.clone() }),
    });
    let output = OutputScale { mean_n: 0.0, std_dev_n: 1.0 };
    Ok(Scaling { inputs: inputs.collect::<Result<_, ScalingError>>()?, output, force_offset_n: 0.0 })
}

/// Reasons why a model cannot be a FIS file, or give one its scaling.
#[derive(Debug, thiserror::Error)]
enum FisError {
    #[error("{name} has effects, which a FIS file cannot hold; give the model without them")]
    HasEffects { name: String },
    #[error("{name} is a model {kind}, which has no fuzzy rules; FIS files are for anfis and tsk-... only")]
    NoRules { name: String, kind: &'static str },
    #[error("--fis: a model {kind} has no fuzzy rules; FIS files are for anfis and tsk-... only")]
    NoRulesToWrite { kind: &'static str },
    #[error("a FIS file cannot hold the surface of {name}: {why}")]
    OtherSurface { name: String, why: mr_damper_model::Error },
}

impl PartError for FisError {}

/// The text of the FIS file for the model `name`, a file or preset.
pub(super) fn fis_text(name: &str) -> Result<String, NodeError> {
    text_of(&models::load(name)?, name)
}

/// The text of the FIS file for `model`, which is called `name`. It reads back as a system with the same surface.
///
/// # Errors
/// When the model has no fuzzy rules, or a FIS file cannot hold it.
pub fn text_of(model: &Model, name: &str) -> Result<String, NodeError> {
    let rules = rules_of(model, name)?;
    if !model.effects.is_empty() {
        return Err(FisError::HasEffects { name: name.to_owned() }.into());
    }
    let stem = Path::new(name).file_stem().unwrap_or_default().to_string_lossy();
    let text = Fis::of(&rules, &stem).with_ranges(&model.envelope, &Scaling::of(&rules)).to_text();
    match Fis::parse(&text) {
        Ok(_) => Ok(text),
        Err(why) => Err(FisError::OtherSurface { name: name.to_owned(), why }.into()),
    }
}

/// Refuses a structure whose models cannot be FIS files.
pub(super) fn check_rules(structure: Structure) -> Result<(), NodeError> {
    match structure {
        Structure::Tsk(_) => Ok(()),
        other => Err(FisError::NoRulesToWrite { kind: other.name() }.into()),
    }
}

/// The model `name` and its fuzzy rules.
fn rule_model(name: &str) -> Result<(Model, Tsk), NodeError> {
    let model = models::load(name)?;
    Ok((model, rules_of(&model, name)?))
}

/// The fuzzy rules of `model`, which is called `name`.
fn rules_of(model: &Model, name: &str) -> Result<Tsk, NodeError> {
    match model.force {
        ForceModel::Tsk(rules) => Ok(rules),
        other => Err(FisError::NoRules { name: name.to_owned(), kind: other.name() }.into()),
    }
}
