//! Runs from rosbag2 bags: topics become channels of one damper, in one pass over the files.

use super::column::{Column, Quantity};
use super::csv::settle_drive;
use super::hash::Hash;
use super::names::{Role, normal_namespace, role_of};
use super::pack::{MessageUnpacker, is_packed};
use super::storage::{Sink, TopicInfo, read};
use super::wire::{Decoder, Fault};
use super::{LoadOptions, Note, RunError};
use mr_damper_model::sample::{Run, Stamp, Trace};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Reads the run in files that follow each other; `path` names the whole.
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
            // A recorder that is killed as it begins another file leaves one that is not yet a bag's. The others
            // are worth reading all the same.
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

/// One channel of the run to be, as far as it is read.
struct Series {
    role: Role,
    trace: Trace,
}

/// A topic that may belong to the run.
struct Topic {
    name: String,
    namespace: String,
    type_name: String,
    encoding: String,
    /// `None` when the type cannot stand for the topic's role.
    decoder: Option<Decoder>,
    series: Vec<Series>,
    messages: u64,
    undecodable: (u64, Option<String>),
    not_finite: u64,
    not_increasing: u64,
    unstamped: u64,
}

impl Topic {
    fn trace(&self, quantity: Quantity) -> Option<&Trace> {
        let series = self.series.iter().find(|series| series.role == Role::Known(quantity))?;
        (!series.trace.is_empty()).then_some(&series.trace)
    }

    fn message(&mut self, log_time: Result<i64, String>, data: &[u8], unpacker: &mut MessageUnpacker) {
        self.messages += 1;
        let Some(decoder) = &self.decoder else { return };
        let cdr = if is_packed(data) { unpacker.unpack(data) } else { Ok(data) };
        let decoded = cdr.and_then(|cdr| decoder.decode(cdr).map_err(|Fault(fault)| fault));
        let (decoded, log_time) = match (decoded, log_time) {
            (Ok(decoded), Ok(log_time)) => (decoded, log_time),
            (Err(fault), _) | (_, Err(fault)) => {
                self.undecodable.0 += 1;
                self.undecodable.1.get_or_insert(fault);
                return;
            }
        };
        // A stamp of zero is how publishers say that they did not set it.
        let unset = decoded.stamp == Some(0) && log_time != 0;
        self.unstamped += u64::from(unset);
        let stamp = Stamp::from_nanos(decoded.stamp.filter(|_| !unset).unwrap_or(log_time));
        for (series, value) in self.series.iter_mut().zip(decoded.values) {
            let Some(value) = value else { continue };
            if !value.is_finite() {
                self.not_finite += 1;
            } else if series.trace.stamps.last().is_some_and(|&last| stamp <= last) {
                self.not_increasing += 1;
            } else {
                series.trace.stamps.push(stamp);
                series.trace.values.push(value);
            }
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

/// A bag while it is read: every namespace is collected, because which one is meant is known at the end only.
struct Bag<'a> {
    options: &'a LoadOptions,
    topics: Vec<Topic>,
    /// The topics by the ids of the file at hand.
    of_file: HashMap<i64, usize>,
    /// Messages of topics whose description was lost to damage.
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

    fn message(&mut self, topic: i64, log_time: Result<i64, String>, data: &[u8]) {
        match self.of_file.get(&topic) {
            Some(&index) => self.topics[index].message(log_time, data, &mut self.unpacker),
            None => self.stray += 1,
        }
    }
}

fn new_topic(info: TopicInfo, options: &LoadOptions) -> Topic {
    let (namespace, role) = match role_of(&info.name) {
        Some((namespace, Role::Other(name))) => {
            let column = info.column.clone().unwrap_or(name);
            // A bag of somebody else may call it `force_n`, which it would be after one conversion.
            (namespace, Column::is_carried(&column).then_some(Role::Other(column)))
        }
        Some((namespace, role)) => (namespace, Some(role)),
        None => ("", None),
    };
    let cdr = info.encoding == "cdr";
    let decoder = role
        .as_ref()
        .filter(|_| cdr)
        .and_then(|role| Decoder::new(role, &info.type_name, options.joint.as_deref()));
    let roles = match (role, &decoder) {
        (_, None) => vec![],
        (Some(Role::Joints), _) => {
            [Quantity::Displacement, Quantity::Velocity, Quantity::Force].map(Role::Known).into()
        }
        (role, _) => role.into_iter().collect(),
    };
    Topic {
        namespace: namespace.to_owned(),
        name: info.name,
        type_name: info.type_name,
        encoding: info.encoding,
        decoder,
        series: roles.into_iter().map(|role| Series { role, trace: Trace::default() }).collect(),
        messages: 0,
        undecodable: (0, None),
        not_finite: 0,
        not_increasing: 0,
        unstamped: 0,
    }
}

impl Bag<'_> {
    fn into_run(mut self, path: &Path, notes: &mut Vec<Note>) -> Result<Run, RunError> {
        let namespace = self.choose_namespace(path)?;
        let options = self.options;
        let mut run = Run { name: path.display().to_string(), ..Run::default() };
        // Topics of a quantity's own name come before joint states; the sort is stable.
        self.topics.sort_by_key(|topic| role_of(&topic.name).is_some_and(|(_, role)| role == Role::Joints));
        let take = |quantity| {
            let topic =
                self.topics.iter().find(|t| t.namespace == namespace && t.trace(quantity).is_some())?;
            Some((topic.name.clone(), topic.trace(quantity)?.clone()))
        };
        let plain = |taken: Option<(String, Trace)>| taken.map(|(_, trace)| trace);
        run.displacement_m = plain(take(Quantity::Displacement)).unwrap_or_default();
        run.velocity_m_s = plain(take(Quantity::Velocity));
        run.force_n = plain(take(Quantity::Force));
        run.case_temp_c = plain(take(Quantity::CaseTemperature));
        run.body_velocity_m_s = plain(take(Quantity::BodyVelocity));
        run.force_request_n = plain(take(Quantity::ForceRequest));
        let drives = [take(Quantity::Current), take(Quantity::Command)];
        let mut left = Vec::new();
        for mut topic in self.topics {
            if topic.namespace != namespace || topic.decoder.is_none() {
                left.push(format!("{} ({}, {} messages)", topic.name, topic.type_name, topic.messages));
                continue;
            }
            topic.notes(notes);
            for Series { role, trace } in topic.series {
                let name = match role {
                    Role::Known(Quantity::AmbientTemperature) => {
                        Quantity::AmbientTemperature.si_name().to_owned()
                    }
                    Role::Other(name) => name,
                    _ => continue,
                };
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
        if self.stray > 0 {
            let first = "what describes their topic is missing".to_owned();
            notes.push(Note::Undecodable { topic: "(unknown)".into(), count: self.stray, first });
        }
        settle_drive(path, drives, options, &mut run)?;
        Ok(run)
    }

    /// The namespace to read: the one asked for, or the only one with displacement.
    fn choose_namespace(&self, path: &Path) -> Result<String, RunError> {
        let mut found: Vec<&str> = self
            .topics
            .iter()
            .filter(|topic| topic.trace(Quantity::Displacement).is_some())
            .map(|topic| topic.namespace.as_str())
            .collect();
        found.sort_unstable();
        found.dedup();
        let show =
            |namespace: &&str| if namespace.is_empty() { "/".to_owned() } else { (*namespace).to_owned() };
        let asked = self.options.namespace.as_deref().map(normal_namespace);
        match (asked, found.as_slice()) {
            (Some(asked), found) if found.contains(&asked.as_str()) => Ok(asked),
            (None, [only]) => Ok((*only).to_owned()),
            (None, [_, ..]) => {
                Err(RunError::Namespaces { path: path.to_owned(), found: found.iter().map(show).collect() })
            }
            (asked, _) => Err(self.no_displacement(path, asked.as_deref(), found.iter().map(show).collect())),
        }
    }

    /// Why there is no displacement, as exactly as it can be said.
    fn no_displacement(&self, path: &Path, asked: Option<&str>, elsewhere: Vec<String>) -> RunError {
        let path = path.to_owned();
        let displacement = |topic: &&Topic| {
            matches!(role_of(&topic.name), Some((_, Role::Known(Quantity::Displacement))))
                && asked.is_none_or(|asked| topic.namespace == asked)
        };
        if let Some(topic) = self.topics.iter().filter(displacement).find(|topic| topic.decoder.is_none()) {
            let joint = topic.type_name == "sensor_msgs/msg/JointState" && self.options.joint.is_none();
            return RunError::TopicType {
                path,
                topic: topic.name.clone(),
                found: format!("{} in {}", topic.type_name, topic.encoding),
                accepted: "mr_damper_msgs/msg/Displacement, std_msgs/msg/Float64 and \
                           sensor_msgs/msg/JointState",
                hint: if joint { "; name the joint with --joint" } else { "" },
            };
        }
        let hint = if !elsewhere.is_empty() {
            let asked = asked.filter(|asked| !asked.is_empty()).unwrap_or("/");
            format!("namespace {asked} has none, but these have: {}", elsewhere.join(", "))
        } else if let Some(topic) = self.topics.iter().find(displacement) {
            match &topic.undecodable.1 {
                Some(fault) => format!("no message of {} could be decoded: {fault}", topic.name),
                None => format!("topic {} has no message that can be used", topic.name),
            }
        } else if self.topics.is_empty() {
            "the bag names no topic, so it is empty or was cut off before its first chunk".to_owned()
        } else {
            let names: Vec<_> = self.topics.iter().take(20).map(|topic| topic.name.as_str()).collect();
            format!(
                "a run needs a topic that ends in /displacement (or joint_states with --joint); topics are: \
                 {}",
                names.join(", ")
            )
        };
        RunError::NoDisplacement { path, hint }
    }
}
