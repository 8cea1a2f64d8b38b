//! Loads the models that a user names, as a preset or a file.

use crate::estimation::wire::ModelNames;
use crate::settings::config::Config;
use crate::settings::error::{NodeError, PartError};
use mr_damper_model::force::ForceModel;
use mr_damper_model::model::Model;
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::pipeline::Models;
use mr_damper_model::preset;
use mr_damper_model::sample::DriveKind;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::Path;
use std::time::{Duration, Instant};

/// The model called `name`: a preset, or the path of a model file.
///
/// # Errors
/// When the preset or file does not exist, or the file is wrong.
pub fn load(name: &str) -> Result<Model, NodeError> {
    Ok(load_whole(name)?.model)
}

/// The model and its provenance (empty for a preset).
///
/// # Errors
/// The same as for [`load`].
pub fn load_whole(name: &str) -> Result<ModelFile, NodeError> {
    if name.starts_with("thesis/") && !Path::new(name).exists() {
        return Ok(ModelFile { model: preset::load(name)?, provenance: Provenance::default() });
    }
    load_file(Path::new(name))
}

/// How long a file must be unchanged before it is read. A partly written model file may parse as a complete one with
/// other numbers.
const SETTLED: Duration = Duration::from_millis(100);
/// How long the reader waits for an unchanged file.
const PATIENCE: Duration = Duration::from_secs(2);

/// The text of a file that is not being written at the moment. If the file is replaced by a rename, the old content is
/// read.
fn settled_text(path: &Path) -> io::Result<String> {
    let mut file = File::open(path)?;
    let deadline = Instant::now() + PATIENCE;
    loop {
        let before = file.metadata()?;
        let mut text = String::new();
        file.read_to_string(&mut text)?;
        // A pipe ends when its writer closes it. Without a modification time, the check is impossible.
        let Some(written) = before.modified().ok().filter(|_| before.is_file()) else { return Ok(text) };
        let is_same = file.metadata()?.modified()? == written && before.len() == text.len() as u64;
        // A time in the future comes from another clock.
        if is_same && written.elapsed().map_or(true, |age| age >= SETTLED) {
            return Ok(text);
        }
        if Instant::now() >= deadline {
            return Err(io::Error::other(
                "the file keeps changing; write it under another name and rename it when it is complete",
            ));
        }
        std::thread::sleep(SETTLED / 4);
        file.rewind()?;
    }
}

/// The model file at `path`, read once it stops changing.
///
/// # Errors
/// When it cannot be read or is wrong; the message names the file, the key and the value.
pub fn load_file(path: &Path) -> Result<ModelFile, NodeError> {
    let in_file = |message: String| NodeError::File { path: path.to_owned(), message };
    let text = settled_text(path).map_err(|e| {
        in_file(format!("{e}; give a model file, or one of the presets that `mr-damper presets` lists"))
    })?;
    ModelFile::from_toml(&text).map_err(|e| in_file(e.to_string()))
}

/// The models that `config` names, with the names for messages.
///
/// # Errors
/// When a model does not load, or the two models do not fit together.
pub fn from_config(config: &Config) -> Result<(Models, ModelNames), NodeError> {
    if config.model.is_empty() {
        return Err(NodeError::Parameter {
            name: "model".to_owned(),
            value: "not set".to_owned(),
            expected: format!(
                "a model file, or a preset such as {} (`mr-damper presets` lists them)",
                preset::BEST_FUZZY_TANH
            ),
        });
    }
    let alone = Models::alone(load(&config.model)?);
    let seeded_name = match config.arx_model.as_str() {
        "none" => None,
        // A thesis preset describes the damper of the thesis, and so does the ARX model of the thesis. For another
        // damper, that ARX model would be a guess.
        // Networks also use measured force, but their one-step-ahead prediction does not beat persistence.
        // An ARX model with effects can only be used for simulation (free run).
        "auto" if matches!(alone.seeded.map(|model| model.force), Some(ForceModel::Arx(_))) => {
            Some(config.model.as_str())
        }
        "auto" if config.model.starts_with("thesis/") => Some(preset::BEST_ARX),
        "auto" => None,
        name => Some(name),
    };
    let models = match seeded_name {
        Some(name) => alone.with_seeded(load(name)?).map_err(NodeError::Settings)?,
        None => Models { seeded: None, ..alone },
    };
    let names = ModelNames {
        free: config.model.clone(),
        seeded: seeded_name.map(str::to_owned),
        hash: hash(&models)?,
    };
    Ok((models, names))
}

/// The names of `model`, called `name`, which runs without an ARX model beside it.
///
/// # Errors
/// When the model cannot be hashed.
pub fn names_alone(name: &str, model: &Model) -> Result<ModelNames, NodeError> {
    let hash = hash(&Models::alone(*model))?;
    Ok(ModelNames { free: name.to_owned(), seeded: None, hash })
}

/// A new model needs another drive than the node's input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "the model needs {needed}, but the node's input is {fed}; load a model that was identified on {fed}, or start another node for \
     this one"
)]
pub struct OtherDrive {
    /// The drive of the new model.
    pub needed: DriveKind,
    /// The drive of the running model.
    pub fed: DriveKind,
}

impl PartError for OtherDrive {}

/// The models after `next` was loaded on a node that runs `running`. If `next` has no ARX model, the running one stays,
/// because the damper is the same.
///
/// # Errors
/// [`OtherDrive`]; when the two models do not fit together.
pub fn succeeding(next: Models, running: &Models) -> Result<Models, NodeError> {
    let drive = |models: &Models| {
        models.free.force.drive().or_else(|| models.seeded.and_then(|seeded| seeded.force.drive()))
    };
    if let (Some(needed), Some(fed)) = (drive(&next), drive(running))
        && needed != fed
    {
        return Err(OtherDrive { needed, fed }.into());
    }
    Ok(match (next.seeded, running.seeded) {
        (None, Some(seeded)) => next.with_seeded(seeded)?,
        _ => next,
    })
}

/// SHA-256 of both models, in hex: of the text of each one's model file without provenance, after the length of that text. Equal models
/// have equal hashes, whatever their files.
///
/// # Errors
/// When a model cannot be written as a model file.
pub(crate) fn hash(models: &Models) -> Result<String, NodeError> {
    let mut hasher = Sha256::new();
    for model in [Some(&models.free), models.seeded.as_ref()] {
        let text = model.map(text_of).transpose()?.unwrap_or_default();
        hasher.update((text.len() as u64).to_le_bytes());
        hasher.update(text);
    }
    Ok(hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The text of the model's file, without provenance.
fn text_of(model: &Model) -> Result<String, NodeError> {
    let file = ModelFile { model: *model, provenance: Provenance::default() };
    Ok(file.to_toml()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hash_of(models: &Models) -> String {
        hash(models).expect("a model file can be written")
    }

    /// A change of this value is a change of the model file's format.
    #[test]
    fn the_hash_is_of_the_models_and_not_of_their_names_in_the_code() {
        let models = Models::alone(preset::load("thesis/sp-passive/rp-icps").expect("a preset"));
        assert_eq!(hash_of(&models), "9f283818f75e940ded78ba38e27639ddcde5f6c7da9e67c4fe2e4ff4eb05f437");
        let file = ModelFile { model: models.free, provenance: Provenance::default() };
        let read = ModelFile::from_toml(&file.to_toml().expect("it writes")).expect("it reads").model;
        assert_eq!(hash_of(&Models::alone(read)), hash_of(&models));
        let force = models.free.force.with_force_offset_n(1e-9);
        let others = [
            Models { free: Model { force, ..models.free }, ..models },
            Models { seeded: Some(models.free), ..models },
        ];
        assert!(others.iter().all(|other| hash_of(other) != hash_of(&models)));
    }
}
