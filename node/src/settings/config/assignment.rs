//! A parameter from one source, not yet assigned to a damper.

use super::{Config, Value, params_file};
use crate::settings::error::NodeError;
use std::path::PathBuf;

/// A name and a value, with their origin.
#[derive(Debug, Clone, PartialEq)]
pub struct Assignment {
    /// The parameter's name; with a damper's name as prefix if it is for this damper only.
    pub name: String,
    /// The value.
    pub value: Value,
    /// The file, and the section if the format has sections.
    pub origin: Option<(PathBuf, Option<String>)>,
}

impl Assignment {
    /// True if it comes from a section for several nodes, such as `/**`. Unknown parameters there belong to other
    /// nodes.
    #[must_use]
    pub fn is_shared(&self) -> bool {
        matches!(&self.origin, Some((_, Some(section))) if params_file::is_shared(section))
    }

    /// Sets it on `config` as the parameter called `name`; does nothing if it belongs to another node.
    ///
    /// # Errors
    /// The same as for [`Config::set`], with the file.
    pub fn apply_as(&self, name: &str, config: &mut Config) -> Result<(), NodeError> {
        match config.set(name, &self.value) {
            Err(NodeError::UnknownParameter { .. }) if self.is_shared() => Ok(()),
            done => done.map_err(|error| self.placed(error)),
        }
    }

    /// Sets it on `config`.
    ///
    /// # Errors
    /// The same as for [`Config::set`], with the file.
    pub fn apply(&self, config: &mut Config) -> Result<(), NodeError> {
        self.apply_as(&self.name, config)
    }

    fn placed(&self, error: NodeError) -> NodeError {
        match &self.origin {
            None => error,
            Some((path, section)) => {
                NodeError::InFile { path: path.clone(), section: section.clone(), why: Box::new(error) }
            }
        }
    }
}
