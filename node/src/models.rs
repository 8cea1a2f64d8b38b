//! From what a user names (preset or file) to models that run.

use crate::config::Config;
use crate::error::NodeError;
use crate::wire::ModelNames;
use mr_damper_model::force::ForceModel;
use mr_damper_model::model::Model;
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::pipeline::Models;
use mr_damper_model::preset;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::Path;
use std::time::{Duration, Instant};

/// The model called `name`: a preset, or the path of a model file.
///
/// # Errors
/// When there is no such preset or file, or the file is wrong.
pub fn load(name: &str) -> Result<Model, NodeError> {
    Ok(load_whole(name)?.model)
}

/// The same with how it came about, of which a preset says nothing.
///
/// # Errors
/// Those of [`load`].
pub fn load_whole(name: &str) -> Result<ModelFile, NodeError> {
    if name.starts_with("thesis/") && !Path::new(name).exists() {
        return Ok(ModelFile { model: preset::load(name)?, provenance: Provenance::default() });
    }
    load_file(Path::new(name))
}

/// How long a file must not have been written to: half a model may read as a whole one, of other numbers.
const SETTLED: Duration = Duration::from_millis(100);
/// How long that is waited for.
const PATIENCE: Duration = Duration::from_secs(2);

/// The text of a file that nobody is writing at the moment. One that is renamed into its place is read from the place it had.
fn settled_text(path: &Path) -> io::Result<String> {
    let mut file = File::open(path)?;
    let deadline = Instant::now() + PATIENCE;
    loop {
        let before = file.metadata()?;
        let mut text = String::new();
        file.read_to_string(&mut text)?;
        // A pipe is at its end when its writer is; and where there are no such times, there is nothing to go by.
        let Some(written) = before.modified().ok().filter(|_| before.is_file()) else { return Ok(text) };
        let is_same = file.metadata()?.modified()? == written && before.len() == text.len() as u64;
        // A time that is yet to come is another clock's.
        if is_same && written.elapsed().map_or(true, |age| age >= SETTLED) {
            return Ok(text);
        }
        if Instant::now() >= deadline {
            return Err(io::Error::other(
                "it is being written all the time; write it under another name and rename it when it is whole",
            ));
        }
        std::thread::sleep(SETTLED / 4);
        file.rewind()?;
    }
}

/// The model file at `path`, once nobody is writing it.
///
/// # Errors
/// When it cannot be read or is wrong; the message names file, key and value.
pub fn load_file(path: &Path) -> Result<ModelFile, NodeError> {
    let in_file = |message: String| NodeError::File { path: path.to_owned(), message };
    let text = settled_text(path).map_err(|e| {
        in_file(format!("{e}; give a model file, or one of the presets that `mr-damper presets` lists"))
    })?;
    ModelFile::from_toml(&text).map_err(|e| in_file(e.to_string()))
}

/// The models that `config` asks for, with the names that messages carry.
///
/// # Errors
/// When a model does not load, or the two do not go together.
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
        // A thesis preset describes the thesis' damper, and so does the thesis' ARX. For another damper it
        // would be a guess.
        // Networks feed on force as well, but one step ahead they are no better than persistence.
        // With effects around it, ARX runs free only.
        "auto" if matches!(alone.seeded.map(|model| model.force), Some(ForceModel::Arx(_))) => {
            Some(config.model.as_str())
        }
        "auto" if config.model.starts_with("thesis/") => Some(preset::BEST_ARX),
        "auto" => None,
        name => Some(name),
    };
    let models = match seeded_name {
        Some(name) => alone.with_seeded(load(name)?)?,
        None => Models { seeded: None, ..alone },
    };
    let names = ModelNames {
        free: config.model.clone(),
        seeded: seeded_name.map(str::to_owned),
        hash: hash(&models),
    };
    Ok((models, names))
}

/// `next` as it follows `running` on a node that goes on: an ARX that runs stays where `next` has none, because the damper
/// is the same.
///
/// # Errors
/// When `next` wants another drive than the node is fed with.
pub fn succeeding(next: Models, running: &Models) -> Result<Models, NodeError> {
    let drive = |models: &Models| {
        models.free.force.drive().or_else(|| models.seeded.and_then(|seeded| seeded.force.drive()))
    };
    if let (Some(wanted), Some(fed)) = (drive(&next), drive(running))
        && wanted != fed
    {
        return Err(NodeError::Failed(format!(
            "the model wants {wanted}, but the node is fed with {fed}; load a model that was identified on {fed}, or \
             start another node for this one"
        )));
    }
    Ok(match (next.seeded, running.seeded) {
        (None, Some(seeded)) => next.with_seeded(seeded)?,
        _ => next,
    })
}

/// SHA-256 over both models' parameters, in hex: equal models have equal hashes whatever their file.
pub(crate) fn hash(models: &Models) -> String {
    let mut hasher = Sha256::new();
    hasher.update(format!("{models:?}"));
    hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}
