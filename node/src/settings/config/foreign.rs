//! Reports parameters of other nodes in a shared section of a parameter file.

use super::{Assignment, Config, find, is_known};
use crate::settings::error::NodeError;
use std::collections::BTreeMap;
use std::path::Path;

/// From this similarity on, a name may be a misspelt parameter. It is higher than for an error, because the section holds
/// parameters of other nodes, which may have similar names.
const ALIKE: f64 = 0.93;

/// The unknown parameters in `assignments`, which belong to other nodes, by file and section. `dampers` are the names
/// of this process's dampers; `configs` are their configurations after the assignments.
fn foreign<'a>(
    assignments: impl IntoIterator<Item = &'a Assignment>,
    dampers: &[String],
    configs: &[Config],
) -> BTreeMap<(&'a Path, &'a str), Vec<&'a str>> {
    let mut found: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for assignment in assignments.into_iter().filter(|assignment| assignment.is_shared()) {
        let Some((path, Some(section))) = &assignment.origin else { continue };
        let name = assignment.name.as_str();
        let own = match name.split_once('.') {
            Some((damper, rest)) if dampers.iter().any(|known| known == damper) => rest,
            _ => name,
        };
        let names = found.entry((path.as_path(), section.as_str())).or_default();
        let is_ours = is_known(own) || configs.iter().any(|config| config.qos.get(own).is_some());
        if !is_ours && !names.contains(&name) {
            names.push(name);
        }
    }
    found.retain(|_, names| !names.is_empty());
    found
}

/// Logs the ignored parameters, one line per section, and warns about those that may be misspelt.
pub(super) fn say<'a>(
    assignments: impl IntoIterator<Item = &'a Assignment>,
    dampers: &[String],
    configs: &[Config],
) {
    for ((path, section), names) in foreign(assignments, dampers, configs) {
        let path = path.display();
        for name in &names {
            if let Some(nearest) = misspelt(name) {
                tracing::warn!(
                    "{path}: {section}: this node does not have the parameter {name} and ignores it; did you mean {nearest}?"
                );
            }
        }
        tracing::info!("{path}: {section}: ignored as parameters of other nodes: {}", names.join(", "));
    }
}

/// The parameter that `name` may be a misspelling of.
fn misspelt(name: &str) -> Option<String> {
    match find(name) {
        Err(NodeError::UnknownParameter { nearest, .. }) => {
            nearest.filter(|nearest| strsim::jaro_winkler(name, nearest) >= ALIKE)
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelt_parameter_is_distinguished_from_a_foreign_one() {
        assert_eq!(misspelt("coast").as_deref(), Some("coast_s"));
        assert_eq!(misspelt("force_timeouts").as_deref(), Some("force_timeout_s"));
        for other in ["publish_rate", "frame_id", "camera.exposure_ms", "robot_description"] {
            assert_eq!(misspelt(other), None, "{other}");
        }
    }
}
