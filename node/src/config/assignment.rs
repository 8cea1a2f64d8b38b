//! One parameter as a source has it, before it is known whose it is.

use super::{Config, Value, params_file};
use crate::error::NodeError;
use std::path::PathBuf;

/// A name, a value, and where they stand.
#[derive(Debug, Clone, PartialEq)]
pub struct Assignment {
    /// The parameter; below the name of a damper where it is that one's alone.
    pub name: String,
    /// What it is to be.
    pub value: Value,
    /// The file, and its section where it has such.
    pub origin: Option<(PathBuf, Option<String>)>,
}

impl Assignment {
    /// True where it stands in a section for several nodes, as `/**`: what this node does not know there is another node's.
    #[must_use]
    pub fn is_shared(&self) -> bool {
        matches!(&self.origin, Some((_, Some(section))) if params_file::is_shared(section))
    }

    /// Sets it on `config`, as the parameter called `name`; not where it is another node's.
    ///
    /// # Errors
    /// Those of [`Config::set`], with the file.
    pub fn apply_as(&self, name: &str, config: &mut Config) -> Result<(), NodeError> {
        match config.set(name, &self.value) {
            Err(NodeError::UnknownParameter { .. }) if self.is_shared() => Ok(()),
            done => done.map_err(|error| self.placed(error)),
        }
    }

    /// Sets it on `config`.
    ///
    /// # Errors
    /// Those of [`Config::set`], with the file.
    pub fn apply(&self, config: &mut Config) -> Result<(), NodeError> {
        self.apply_as(&self.name, config)
    }

    fn placed(&self, error: NodeError) -> NodeError {
        match &self.origin {
            None => error,
            Some((path, None)) => NodeError::File { path: path.clone(), message: error.to_string() },
            Some((path, Some(section))) => {
                NodeError::File { path: path.clone(), message: format!("{section}: {error}") }
            }
        }
    }
}
