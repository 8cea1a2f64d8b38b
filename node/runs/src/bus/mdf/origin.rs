//! The buses of an MDF4 file's groups of frames, as far as the file names them.
//!
//! `BusChannel` is the number of a bus in each record. The source of acquisition of a group (block `SI`) names the bus or the recorder. A
//! group without both may still have a name of its acquisition. The reader cannot distinguish groups that name nothing.

use super::structure::ChannelGroup;
use super::{Numbered, frame_parts};
use crate::bus::places::Place;

/// The names that a group gives its bus. The default has no name.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct Identity {
    name: String,
    path: String,
    /// The kind of bus, by its number in the standard.
    bus_type: u8,
    acquisition: String,
}

impl Identity {
    fn of(group: &ChannelGroup, has_number: bool) -> Option<Self> {
        if let Some(source) = &group.source {
            let (name, path) = (source.name.clone(), source.path.clone());
            let is_named = !(name.is_empty() && path.is_empty());
            return is_named.then(|| Self {
                name,
                path,
                bus_type: source.bus_type,
                acquisition: String::new(),
            });
        }
        // The name of an acquisition may be the name of a kind of frames, so the number of the bus has priority.
        let acquisition = group.acquisition.clone();
        (!has_number && !acquisition.is_empty()).then(|| Self { acquisition, ..Self::default() })
    }
}

/// The buses of the groups, as the file names them.
pub(super) struct Origins {
    /// The place of each group, by its number.
    pub(super) places: Vec<Place>,
    /// The names of the sources.
    pub(super) sources: Vec<String>,
    /// True if the sources name the buses of the groups without `BusChannel`; if these have one bus, it is number 0.
    pub(super) names_buses: bool,
}

impl Origins {
    /// The name of the bus of a group without `BusChannel`, if it has one.
    pub(super) fn bus(&self, group: usize) -> Option<&str> {
        let origin = self.places.get(group)?.origin.filter(|_| self.names_buses)?;
        self.sources.get(origin).map(String::as_str)
    }
}

/// The buses of the groups, as the file names them.
pub(super) fn origins(groups: &[Numbered<'_>]) -> Origins {
    let mut known: Vec<Identity> = Vec::new();
    // The origins of groups without the number of the bus.
    let mut without_number: Vec<Option<usize>> = Vec::new();
    let mut places = Vec::with_capacity(groups.len());
    for group in groups {
        let Some(parts) = frame_parts(group.group) else {
            places.push(Place::default());
            continue;
        };
        let has_number = parts.bus.is_some();
        let identity = Identity::of(group.group, has_number);
        let origin = identity.map(|identity| {
            known.iter().position(|it| *it == identity).unwrap_or_else(|| {
                known.push(identity);
                known.len() - 1
            })
        });
        if !has_number && !without_number.contains(&origin) {
            without_number.push(origin);
        }
        places.push(Place { group: group.number, origin, is_unnamed: !has_number && origin.is_none() });
    }
    Origins { places, sources: labels(&known), names_buses: without_number.len() > 1 }
}

/// A name for each identity: the first part that tells them apart, or else all parts.
fn labels(known: &[Identity]) -> Vec<String> {
    let distinct = |part: fn(&Identity) -> &str| {
        let labels: Vec<String> = known.iter().map(|it| usable(part(it))).collect();
        let is_good = labels.iter().enumerate().all(|(at, it)| !it.is_empty() && !labels[..at].contains(it));
        is_good.then_some(labels)
    };
    let single = distinct(|it| &it.name).or_else(|| distinct(|it| &it.path));
    if let Some(labels) = single.or_else(|| distinct(|it| &it.acquisition)) {
        return labels;
    }
    let mut labels: Vec<String> = Vec::with_capacity(known.len());
    for it in known {
        let parts = [&*it.name, &*it.path, &*it.acquisition];
        let label = usable(&parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" "));
        let same = labels.iter().filter(|other| **other == label).count();
        labels.push(if same == 0 { label } else { format!("{label} #{}", labels.len()) });
    }
    labels
}

/// The name without characters that have a meaning in a map.
fn usable(name: &str) -> String {
    name.replace([':', '=', ','], "_")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_the_first_part_that_tells_buses_apart() {
        let identity = |name: &str, path: &str, acquisition: &str| Identity {
            name: name.to_owned(),
            path: path.to_owned(),
            bus_type: 2,
            acquisition: acquisition.to_owned(),
        };
        for (known, expected) in [
            (vec![identity("a", "p", ""), identity("b", "p", "")], ["a", "b"]),
            (vec![identity("a", "p,1", ""), identity("a", "q=1:x", "")], ["p_1", "q_1_x"]),
            (vec![identity("", "", "x"), identity("", "", "y")], ["x", "y"]),
            (vec![identity("a", "p", ""), identity("", "", "y")], ["a p", "y"]),
            (vec![identity("a", "p", ""), identity("a", "p", "")], ["a p", "a p #1"]),
        ] {
            assert_eq!(labels(&known), expected);
        }
    }
}
