//! The places in a log that frames come from: buses, and channel groups of an MDF4 file.

use super::frame::Bus;

/// Most buses of one identifier that are kept apart.
const MOST_BUSES: usize = 64;

/// The place of a frame in an MDF4 file. Other logs have one place.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Place {
    /// Number of the channel group.
    pub(super) group: usize,
    /// The source of the group, as an index in the list of their names; `None` if the file names none.
    pub(super) origin: Option<usize>,
    /// True if the group does not name its bus in any way.
    pub(super) is_unnamed: bool,
}

/// A bus that frames were on: its name, and its source in an MDF4 file.
#[derive(Debug, Clone, PartialEq, Eq)]
struct SeenBus {
    name: String,
    /// The name as a number, if the log counts its buses.
    number: Option<u32>,
    origin: Option<usize>,
}

impl SeenBus {
    fn bus(&self) -> Bus<'_> {
        self.number.map_or(Bus::Name(&self.name), Bus::Number)
    }
}

/// True if `wanted` is a name of the bus: its own, the name of its source, or both as `SOURCE/BUS`.
pub(super) fn is_bus(wanted: &str, bus: Bus<'_>, source: Option<&str>) -> bool {
    let of_source = |source: &str| {
        wanted
            .strip_prefix(source)
            .is_some_and(|rest| rest.is_empty() || rest.strip_prefix('/').is_some_and(|own| bus.is(own)))
    };
    bus.is(wanted) || source.is_some_and(of_source)
}

/// Buses that frames of a message were on.
#[derive(Debug, Clone, Default)]
pub(super) struct SeenBuses(Vec<SeenBus>);

impl SeenBuses {
    pub(super) fn add(&mut self, bus: Bus<'_>, origin: Option<usize>) {
        if !self.0.iter().any(|it| it.origin == origin && bus.is(&it.name)) && self.0.len() < MOST_BUSES {
            let number = if let Bus::Number(number) = bus { Some(number) } else { None };
            self.0.push(SeenBus { name: bus.to_string(), number, origin });
        }
    }

    pub(super) fn add_all(&mut self, others: &Self) {
        for other in &others.0 {
            if !self.0.contains(other) && self.0.len() < MOST_BUSES {
                self.0.push(other.clone());
            }
        }
    }

    /// Those that `wanted` names; all without it.
    pub(super) fn named(&self, wanted: Option<&str>, sources: &[String]) -> Self {
        let is_wanted = |it: &&SeenBus| {
            let source = it.origin.and_then(|origin| sources.get(origin)).map(String::as_str);
            wanted.is_none_or(|wanted| is_bus(wanted, it.bus(), source))
        };
        Self(self.0.iter().filter(is_wanted).cloned().collect())
    }

    /// A name for each bus that a map can take. A bus without source may be one of those that have the same name and a source, so it does
    /// not count as another one.
    pub(super) fn names(&self, sources: &[String]) -> Vec<String> {
        let has_source = |name: &str| self.0.iter().any(|it| it.name == name && it.origin.is_some());
        let distinct: Vec<&SeenBus> =
            self.0.iter().filter(|it| it.origin.is_some() || !has_source(&it.name)).collect();
        let name = |it: &&SeenBus| {
            let source = it.origin.and_then(|origin| sources.get(origin));
            let is_single =
                |same: &dyn Fn(&SeenBus) -> bool| distinct.iter().filter(|other| same(other)).count() == 1;
            match source {
                Some(source) if !is_single(&|other| other.name == it.name) => {
                    if is_single(&|other| other.origin == it.origin) {
                        source.clone()
                    } else {
                        format!("{source}/{}", it.name)
                    }
                }
                _ => it.name.clone(),
            }
        };
        distinct.iter().map(name).collect()
    }
}
