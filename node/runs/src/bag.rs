//! Reads runs from rosbag2 bags: topics become channels of one damper, in one pass over the files.

use super::bag_sink::{LogTimeFault, Sink, TopicInfo};
use super::column::{Column, Quantity, same};
use super::csv::settle_drive;
use super::error::MapFault;
use super::hash::Hash;
use super::map::{Channel, Convert, Mapping};
use super::names::{Role, normal_namespace, role_of, topic_of};
use super::pack::{MessageUnpacker, is_packed};
use super::storage::read;
use super::suggest::{self, FoundTopic};
use super::{LoadOptions, Note, RunError};
use crate::extract::{Dimension, Extractor, MessagePart};
use mr_damper_base::shown::count;
use mr_damper_model::sample::{Run, Stamp, Trace};
use mr_damper_msgs::standard::{Float32, Float64, JointState};
use mr_damper_msgs::{Message, cdr};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Reads the run in the files of a bag, in order; `path` is the path of the bag.
pub(super) fn load(
    path: &Path,
    files: &[PathBuf],
    options: &LoadOptions,
    notes: &mut Vec<Note>,
    hash: &mut Hash,
) -> Result<Run, RunError> {
    let unpacker = MessageUnpacker::new();
    let mut bag = Bag { options, topics: Vec::new(), of_file: HashMap::new(), stray: 0, unpacker };
    let mut left = None;
    for file in files {
        match read(file, &mut bag, notes, hash) {
            // A recorder that is killed while it starts another file leaves a file that is not a valid bag file yet. The
            // other files are still read.
            Err(error @ RunError::NotABag { .. }) if files.len() > 1 => {
                notes.push(Note::FileLeft { why: error.to_string() });
                left.get_or_insert(error);
            }
            other => other?,
        }
    }
    if let Some(error) = left.filter(|_| bag.topics.is_empty()) {
        return Err(error);
    }
    bag.into_run(path, notes)
}

/// One channel of the run, while it is read.
struct Series {
    role: Role,
    /// True if the map selects this channel, false if the topic's name does.
    mapped: bool,
    extractor: Extractor,
    convert: Convert,
    trace: Trace,
}

impl Series {
    fn is(&self, quantity: Quantity, mapped: bool) -> bool {
        self.role == Role::Known(quantity) && self.mapped == mapped
    }
}

/// A topic that may belong to the run.
struct Topic {
    name: String,
    namespace: String,
    /// Its content according to its name, or to its original name if the recorder remapped it.
    role: Option<Role>,
    type_name: String,
    encoding: String,
    /// Empty if the topic holds no channel of a run, or its type does not fit its role.
    series: Vec<Series>,
    /// The first message of joint states.
    joints: Option<JointState>,
    messages: u64,
    undecodable: (u64, Option<String>),
    not_finite: u64,
    not_increasing: u64,
    unstamped: u64,
}

impl Topic {
    fn trace(&self, quantity: Quantity, mapped: bool) -> Option<&Trace> {
        let series = self.series.iter().find(|series| series.is(quantity, mapped))?;
        (!series.trace.is_empty()).then_some(&series.trace)
    }

    /// The same without its samples in the topic afterwards: a long run is in memory once.
    fn take_trace(&mut self, quantity: Quantity, mapped: bool) -> Option<Trace> {
        let series = self.series.iter_mut().find(|series| series.is(quantity, mapped))?;
        (!series.trace.is_empty()).then(|| std::mem::take(&mut series.trace))
    }

    fn message(&mut self, log_time: Result<i64, LogTimeFault>, data: &[u8], unpacker: &mut MessageUnpacker) {
        self.messages += 1;
        let names_joints = self.joints.is_none() && self.type_name == JointState::TYPE;
        if self.series.is_empty() && !names_joints {
            return;
        }
        let cdr = if is_packed(data) { unpacker.unpack(data) } else { Ok(data) };
        if let (true, Ok(cdr)) = (names_joints, &cdr) {
            self.joints = cdr::from_slice(cdr).ok();
        }
        match (cdr, log_time) {
            _ if self.series.is_empty() => {}
            (Ok(cdr), Ok(log_time)) => self.take(log_time, cdr),
            (Err(fault), _) => self.note_undecodable(fault.to_string()),
            (_, Err(fault)) => self.note_undecodable(fault.to_string()),
        }
    }

    fn note_undecodable(&mut self, fault: String) {
        self.undecodable.0 += 1;
        self.undecodable.1.get_or_insert(fault);
    }

    fn take(&mut self, log_time: i64, cdr: &[u8]) {
        let (mut fault, mut is_unset) = (None, false);
        for series in &mut self.series {
            let taken = match series.extractor.read(cdr) {
                Ok(taken) => taken,
                Err(error) => {
                    fault.get_or_insert_with(|| error.to_string());
                    continue;
                }
            };
            // A stamp of zero means that the publisher did not set it.
            let unset = taken.stamp_ns == Some(0) && log_time != 0;
            is_unset |= unset;
            let stamp = Stamp::from_nanos(taken.stamp_ns.filter(|_| !unset).unwrap_or(log_time));
            let Some(value) = taken.value.map(|raw| series.convert.apply(raw)) else { continue };
            if !value.is_finite() {
                self.not_finite += 1;
            } else if series.trace.stamps.last().is_some_and(|&last| stamp <= last) {
                self.not_increasing += 1;
            } else {
                series.trace.stamps.push(stamp);
                series.trace.values.push(value);
            }
        }
        self.unstamped += u64::from(is_unset);
        if let Some(fault) = fault {
            self.note_undecodable(fault);
        }
    }

    fn seen(&self) -> FoundTopic<'_> {
        FoundTopic {
            name: &self.name,
            type_name: &self.type_name,
            encoding: &self.encoding,
            messages: self.messages,
            joints: self.joints.as_ref(),
        }
    }

    fn notes(&mut self, notes: &mut Vec<Note>) {
        let topic = || self.name.clone();
        if let (count, Some(first)) = (self.undecodable.0, self.undecodable.1.take()) {
            notes.push(Note::Undecodable { topic: topic(), count, first });
        }
        if self.not_finite > 0 {
            notes.push(Note::NotFinite { topic: topic(), count: self.not_finite });
        }
        if self.not_increasing > 0 {
            notes.push(Note::NotIncreasing { topic: topic(), count: self.not_increasing });
        }
        if self.unstamped > 0 {
            notes.push(Note::Unstamped { topic: topic(), count: self.unstamped });
        }
    }
}

/// A bag while it is read. All namespaces are collected, because the namespace of the run is known only at the end.
struct Bag<'a> {
    options: &'a LoadOptions,
    topics: Vec<Topic>,
    /// Indices of the topics, by their ids in the current file.
    of_file: HashMap<i64, usize>,
    /// Number of messages whose topic has no description, because of damage.
    stray: u64,
    unpacker: MessageUnpacker,
}

impl Sink for Bag<'_> {
    fn begin_file(&mut self) {
        self.of_file.clear();
    }

    fn topic(&mut self, id: i64, info: TopicInfo) {
        let known =
            self.topics.iter().position(|topic| topic.name == info.name && topic.type_name == info.type_name);
        let index = known.unwrap_or_else(|| {
            self.topics.push(new_topic(info, self.options));
            self.topics.len() - 1
        });
        self.of_file.insert(id, index);
    }

    fn message(&mut self, topic: i64, log_time: Result<i64, LogTimeFault>, data: &[u8]) {
        match self.of_file.get(&topic) {
            Some(&index) => self.topics[index].message(log_time, data, &mut self.unpacker),
            None => self.stray += 1,
        }
    }
}

fn new_topic(info: TopicInfo, options: &LoadOptions) -> Topic {
    // The original name that a recorder stored is used only if it names a known channel.
    let noted = info.stands_for.as_deref().filter(|name| matches!(role_of(name), Some((_, Role::Known(_)))));
    let (namespace, role) = match role_of(noted.unwrap_or(&info.name)) {
        Some((namespace, Role::Other(name))) => {
            let column = info.column.clone().unwrap_or(name);
            // A foreign bag may have a topic `other/force_n`. After one conversion it would be read as the force.
            (namespace, Column::is_carried(&column).then_some(Role::Other(column)))
        }
        Some((namespace, role)) => (namespace, Some(role)),
        None => ("", None),
    };
    let namespace = namespace.to_owned();
    let mut series = Vec::new();
    if info.encoding == "cdr" {
        series.extend(options.map.all().iter().filter_map(|mapping| mapped_series(mapping, &info)));
        // A mapped topic is not also carried through.
        let by_name = role.as_ref().filter(|role| series.is_empty() || !matches!(role, Role::Other(_)));
        series.extend(by_name.into_iter().flat_map(|role| series_by_name(role, &info, options)));
    }
    Topic {
        namespace,
        role,
        name: info.name,
        type_name: info.type_name,
        encoding: info.encoding,
        series,
        joints: None,
        messages: 0,
        undecodable: (0, None),
        not_finite: 0,
        not_increasing: 0,
        unstamped: 0,
    }
}

/// The series that `mapping` reads from the topic; `None` if it names another topic, or the topic's type does not fit.
fn mapped_series(mapping: &Mapping, info: &TopicInfo) -> Option<Series> {
    let (Channel::Known(quantity, _), Some((topic, part))) = (mapping.channel, mapping.topic()) else {
        return None;
    };
    if topic != info.name {
        return None;
    }
    let extractor = Extractor::new(quantity.dimension(), topic, &info.type_name, part).ok()?;
    let (role, convert) = (Role::Known(quantity), mapping.convert(same));
    Some(Series { role, mapped: true, extractor, convert, trace: Trace::default() })
}

/// The series that the topic holds according to its name.
fn series_by_name(role: &Role, info: &TopicInfo, options: &LoadOptions) -> Vec<Series> {
    let is_joints = info.type_name == JointState::TYPE;
    let joint = options.joint.as_deref().filter(|_| is_joints);
    let series = |role: Role, dimension: Dimension| {
        let extractor = Extractor::new(dimension, &info.name, &info.type_name, joint).ok()?;
        let series =
            Series { role, mapped: false, extractor, convert: Convert::plain(same), trace: Trace::default() };
        // A topic's name does not say which axis to read.
        (!matches!(series.extractor.part, MessagePart::Axis(_))).then_some(series)
    };
    let known = |quantity: Quantity| series(Role::Known(quantity), quantity.dimension());
    match role {
        Role::Known(quantity) => known(*quantity).into_iter().collect(),
        Role::Joints if is_joints => [Quantity::Displacement, Quantity::Velocity, Quantity::Force]
            .into_iter()
            .filter_map(known)
            .collect(),
        Role::Other(_) if matches!(&*info.type_name, Float64::TYPE | Float32::TYPE) => {
            // A plain number fits any dimension.
            series(role.clone(), Dimension::Length).into_iter().collect()
        }
        Role::Joints | Role::Other(_) => Vec::new(),
    }
}

impl Bag<'_> {
    fn into_run(mut self, path: &Path, notes: &mut Vec<Note>) -> Result<Run, RunError> {
        self.check_map(path)?;
        let namespace = self.choose_namespace(path)?;
        let options = self.options;
        let mut run = Run { name: path.display().to_string(), ..Run::default() };
        // A topic with the name of a quantity has priority over joint states; the sort is stable.
        self.topics.sort_by_key(|topic| topic.role == Some(Role::Joints));
        let mut by_name = Vec::new();
        let mut take = |quantity| {
            let mapped = options.map.of(quantity).is_some();
            let mut topics = self.topics.iter_mut().filter(|topic| mapped || topic.namespace == namespace);
            let (name, trace) = topics.find_map(|topic| {
                let trace = topic.take_trace(quantity, mapped)?;
                Some((topic.name.clone(), trace))
            })?;
            if !mapped {
                by_name.push(format!("{name} as {}", topic_of(quantity)));
            }
            Some((name, trace))
        };
        let plain = |taken: Option<(String, Trace)>| taken.map(|(_, trace)| trace);
        run.displacement_m = plain(take(Quantity::Displacement)).unwrap_or_default();
        run.velocity_m_s = plain(take(Quantity::Velocity));
        run.force_n = plain(take(Quantity::Force));
        run.case_temp_c = plain(take(Quantity::CaseTemperature));
        run.body_velocity_m_s = plain(take(Quantity::BodyVelocity));
        run.force_request_n = plain(take(Quantity::ForceRequest));
        let drives = [take(Quantity::Current), take(Quantity::Command)];
        if options.map.of(Quantity::Displacement).is_some() && !by_name.is_empty() {
            notes.push(Note::TakenByName { topics: by_name });
        }
        self.note_axes(notes);
        let could_serve = self.could_serve(&run, drives.iter().all(Option::is_none), &namespace);
        let (mut left, mut outputs) = (Vec::new(), Vec::new());
        for mut topic in self.topics {
            if !is_used(&topic, &namespace, options) {
                if is_output(&topic.type_name) {
                    outputs.push(topic.name);
                    continue;
                }
                left.push(format!(
                    "{} ({}, {})",
                    topic.name,
                    topic.type_name,
                    count(topic.messages, "message")
                ));
                continue;
            }
            topic.notes(notes);
            for Series { role, mapped, trace, .. } in topic.series {
                let Some(name) = carried_name(&role, mapped, options) else { continue };
                if run.other.iter().any(|(other, _)| *other == name) {
                    left.push(format!("{} (a second {name})", topic.name));
                } else {
                    run.other.push((name, trace));
                }
            }
        }
        if !left.is_empty() {
            notes.push(Note::TopicsLeft { topics: left });
        }
        if !outputs.is_empty() {
            notes.push(Note::OutputsLeft { topics: outputs });
        }
        notes.extend(could_serve);
        if self.stray > 0 {
            let first = "the description of their topic is missing".to_owned();
            notes.push(Note::Undecodable { topic: "(unknown)".into(), count: self.stray, first });
        }
        settle_drive(path, drives, options, &mut run)?;
        Ok(run)
    }

    fn seen(&self) -> Vec<FoundTopic<'_>> {
        self.topics.iter().map(Topic::seen).collect()
    }

    /// Refuses a map if one of its channels has no sample.
    fn check_map(&self, path: &Path) -> Result<(), RunError> {
        for mapping in self.options.map.all() {
            if let Err(why) = self.check_mapping(mapping) {
                return Err(RunError::Map {
                    path: path.to_owned(),
                    map: mapping.to_string(),
                    why: Box::new(why),
                });
            }
        }
        Ok(())
    }

    fn check_mapping(&self, mapping: &Mapping) -> Result<(), MapFault> {
        let Channel::Known(quantity, _) = mapping.channel else { return Err(MapFault::TimeOfBag) };
        let names = || self.topics.iter().map(|topic| topic.name.as_str());
        let listing = || suggest::listing(quantity, &self.seen());
        let Some((name, part)) = mapping.topic() else {
            return Err(MapFault::ColumnOfBag { column: mapping.source.clone(), topics: listing() });
        };
        let of_name = || self.topics.iter().filter(|topic| topic.name == name);
        if of_name().any(|topic| topic.trace(quantity, true).is_some()) {
            return Ok(());
        }
        let Some(topic) = of_name().max_by_key(|topic| topic.series.iter().any(|series| series.mapped))
        else {
            let nearest = suggest::nearest(name, names()).map(str::to_owned);
            return Err(MapFault::NoTopic { topic: name.to_owned(), nearest, topics: listing() });
        };
        if topic.encoding != "cdr" {
            return Err(MapFault::Encoding { encoding: topic.encoding.clone() });
        }
        let extractor =
            Extractor::new(quantity.dimension(), name, &topic.type_name, part).map_err(|unfit| {
                let instead = suggest::line_for(quantity, &self.seen());
                MapFault::Unfit { unfit, instead }
            })?;
        if topic.messages == 0 {
            return Err(MapFault::NoMessage { topic: name.to_owned() });
        }
        match (&extractor.part, &topic.joints, &topic.undecodable.1) {
            (MessagePart::Joint(joint, _), Some(first), _) if !first.name.contains(joint) => {
                let nearest =
                    suggest::nearest(joint, first.name.iter().map(String::as_str)).map(str::to_owned);
                Err(MapFault::NoJoint { joint: joint.clone(), nearest, joints: first.name.clone() })
            }
            (_, _, Some(fault)) => {
                Err(MapFault::Undecodable { topic: name.to_owned(), fault: fault.clone() })
            }
            _ => Err(MapFault::NoValue { topic: name.to_owned(), messages: topic.messages }),
        }
    }

    /// Notes which axis was read if the map names none.
    fn note_axes(&self, notes: &mut Vec<Note>) {
        let unnamed = |mapping: &&Mapping| matches!(mapping.topic(), Some((_, None | Some(""))));
        for mapping in self.options.map.all().iter().filter(unnamed) {
            let topics = self.topics.iter().filter(|topic| Some((&*topic.name, None)) == mapping.topic());
            let axis = |series: &Series| match series.extractor.part {
                MessagePart::Axis(axis) if series.mapped => Some(axis),
                _ => None,
            };
            if let Some(axis) = topics.flat_map(|topic| &topic.series).find_map(axis) {
                notes.push(Note::AxisTaken { topic: mapping.source.clone(), axis: axis.to_string() });
            }
        }
    }

    /// A note with unused topics that may hold the force or the drive, if these are missing in the run.
    fn could_serve(&self, run: &Run, no_drive: bool, namespace: &str) -> Option<Note> {
        let left: Vec<FoundTopic<'_>> = self
            .topics
            .iter()
            .filter(|topic| !is_used(topic, namespace, self.options))
            .map(Topic::seen)
            .collect();
        let missing = [(run.force_n.is_none(), Quantity::Force), (no_drive, Quantity::Current)];
        let lines = missing.into_iter().filter(|(missing, _)| *missing);
        let lines: Vec<_> =
            lines.filter_map(|(_, quantity)| suggest::likely_line_for(quantity, &left)).collect();
        (!lines.is_empty()).then_some(Note::CouldServe { lines })
    }

    /// The namespace to read: the requested one, or the only one with displacement. If displacement is mapped, the only one
    /// with a channel that is not mapped.
    fn choose_namespace(&self, path: &Path) -> Result<String, RunError> {
        let map = &self.options.map;
        let displacement_is_mapped = map.of(Quantity::Displacement).is_some();
        let is_wanted = |quantity: &Quantity| {
            map.of(*quantity).is_none() && (displacement_is_mapped || *quantity == Quantity::Displacement)
        };
        let missing: Vec<Quantity> = Quantity::ALL.into_iter().filter(is_wanted).collect();
        let mut found: Vec<&str> = self
            .topics
            .iter()
            .filter(|topic| missing.iter().any(|quantity| topic.trace(*quantity, false).is_some()))
            .map(|topic| topic.namespace.as_str())
            .collect();
        found.sort_unstable();
        found.dedup();
        let show =
            |namespace: &&str| if namespace.is_empty() { "/".to_owned() } else { (*namespace).to_owned() };
        let requested = self.options.namespace.as_deref().map(normal_namespace);
        match (requested, found.as_slice()) {
            (Some(requested), _) if displacement_is_mapped => Ok(requested),
            (Some(requested), found) if found.contains(&requested.as_str()) => Ok(requested),
            (None, [only]) => Ok((*only).to_owned()),
            (None, []) if displacement_is_mapped => Ok(String::new()),
            (None, [_, ..]) => {
                let what = if displacement_is_mapped {
                    "several namespaces have channels that are not mapped"
                } else {
                    "displacement of several dampers is recorded"
                };
                let found = found.iter().map(show).collect();
                Err(RunError::Namespaces { path: path.to_owned(), what, found })
            }
            (requested, _) => {
                Err(self.no_displacement(path, requested.as_deref(), found.iter().map(show).collect()))
            }
        }
    }

    /// The error for a missing displacement, with the most specific reason.
    fn no_displacement(&self, path: &Path, requested: Option<&str>, elsewhere: Vec<String>) -> RunError {
        let path = path.to_owned();
        let displacement = |topic: &&Topic| {
            topic.role == Some(Role::Known(Quantity::Displacement))
                && requested.is_none_or(|requested| topic.namespace == requested)
        };
        let instead = suggest::line_for(Quantity::Displacement, &self.seen());
        if let Some(topic) = self.topics.iter().filter(displacement).find(|topic| topic.series.is_empty()) {
            return RunError::TopicType {
                path,
                topic: topic.name.clone(),
                found: format!("{} in {}", topic.type_name, topic.encoding),
                accepted: Quantity::Displacement.dimension().accepted().into(),
                instead,
            };
        }
        let hint = if !elsewhere.is_empty() {
            let requested = requested.filter(|requested| !requested.is_empty()).unwrap_or("/");
            format!("namespace {requested} has none, but these have: {}", elsewhere.join(", "))
        } else if let Some(topic) = self.topics.iter().find(displacement) {
            match &topic.undecodable.1 {
                Some(fault) => format!("no message of {} could be decoded: {fault}", topic.name),
                None => format!("topic {} has no message that can be used", topic.name),
            }
        } else if self.topics.is_empty() {
            "the bag names no topic, so it is empty or was cut off before its first chunk".to_owned()
        } else {
            let listing = suggest::listing(Quantity::Displacement, &self.seen());
            match instead {
                Some(line) => format!(
                    "no topic is called displacement. Say which one holds it, for example {line}; {listing}"
                ),
                None => format!(
                    "no topic is called displacement, and no topic's type can hold it (types that can are {}); {listing}",
                    Quantity::Displacement.dimension().accepted()
                ),
            }
        };
        RunError::NoDisplacement { path, hint }
    }
}

/// True for the types of messages that a node publishes; `mr-damper record` records them beside the node's inputs.
fn is_output(type_name: &str) -> bool {
    [
        "mr_damper_msgs/msg/ForceEstimate",
        "mr_damper_msgs/msg/ForceResidual",
        "mr_damper_msgs/msg/CurrentCommand",
        "mr_damper_msgs/msg/ModeChange",
        "mr_damper_msgs/msg/EffectValue",
        "diagnostic_msgs/msg/DiagnosticArray",
        "rcl_interfaces/msg/Log",
        "rcl_interfaces/msg/ParameterEvent",
    ]
    .contains(&type_name)
}

/// True if the run uses the topic, or carries it through.
fn is_used(topic: &Topic, namespace: &str, options: &LoadOptions) -> bool {
    topic.series.iter().any(|series| {
        series.mapped || (topic.namespace == namespace && !is_mapped_elsewhere(&series.role, options))
    })
}

/// True if the map has a source for the channel with this role.
fn is_mapped_elsewhere(role: &Role, options: &LoadOptions) -> bool {
    let quantity = match role {
        Role::Known(quantity) => Some(*quantity),
        Role::Other(name) => Quantity::of_si_name(name),
        Role::Joints => None,
    };
    quantity.is_some_and(|quantity| options.map.of(quantity).is_some())
}

/// The name under which a run carries a series through; `None` for a channel of the run, or if the map has another source
/// for it.
fn carried_name(role: &Role, mapped: bool, options: &LoadOptions) -> Option<String> {
    if !mapped && is_mapped_elsewhere(role, options) {
        return None;
    }
    match role {
        Role::Known(quantity @ (Quantity::AmbientTemperature | Quantity::Setpoint)) => {
            Some(quantity.si_name().to_owned())
        }
        Role::Other(name) => Some(name.clone()),
        Role::Known(_) | Role::Joints => None,
    }
}
