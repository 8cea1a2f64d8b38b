//! Recordings as messages: all topics of a bag as they were recorded, or the columns of a run as the messages that a bag would hold.
//!
//! [`load`](crate::load) reads the channels of one damper out of a bag. This keeps every message, also estimates, for viewers that show
//! them.

use super::bag_sink::{LogTimeFault, Sink, TopicInfo};
use super::hash::Hash;
use super::names::Namer;
use super::pack::{MessageUnpacker, is_packed};
use super::storage::read;
use super::wire::Encoder;
use super::{Note, RunError, Storage, columns_of, metadata};
use mr_damper_model::sample::{Run, Stamp, Trace};
use mr_damper_msgs::{Descriptor, MESSAGES};
use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// All messages of a recording, in the order of their log times.
#[derive(Debug, Clone, Default)]
pub struct Recording {
    /// Topics: full names and types.
    topics: Vec<(String, Descriptor)>,
    messages: Vec<Place>,
    /// The payloads, one after the other.
    payloads: Vec<u8>,
}

/// Where a message is.
#[derive(Debug, Clone)]
struct Place {
    topic: usize,
    log_time: Stamp,
    payload: Range<usize>,
}

/// A message of a [`Recording`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecordedMessage<'a> {
    /// Index of its topic.
    pub topic: usize,
    /// When it was recorded. In a run without log times, it is the stamp of the sample.
    pub log_time: Stamp,
    /// CDR with the 4-byte header.
    pub cdr: &'a [u8],
}

/// True if there is a bag at `path`: a directory, or a file with a bag's name.
#[must_use]
pub fn is_bag(path: &Path) -> bool {
    path.is_dir() || Storage::of_file(path).is_some()
}

impl Recording {
    /// Reads all messages of the bag at `path` whose types this project knows. `notes` say which topics were left out.
    ///
    /// # Errors
    /// When the path is not a bag or cannot be read, or no message is left. A bag that ends early or is damaged is not an error.
    pub fn of_bag(path: &Path, notes: &mut Vec<Note>) -> Result<Self, RunError> {
        let files = if path.is_dir() { metadata::files(path, notes)? } else { vec![path.to_owned()] };
        let mut collected = Collected::new();
        let (mut hash, mut left) = (Hash::default(), None);
        for file in &files {
            match read(file, &mut collected, notes, &mut hash) {
                // A recorder that is killed while it starts another file leaves a file that is not a valid bag file yet.
                Err(error @ RunError::NotABag { .. }) if files.len() > 1 => {
                    notes.push(Note::FileLeft { why: error.to_string() });
                    left.get_or_insert(error);
                }
                other => other?,
            }
        }
        if let Some(error) = left.filter(|_| collected.recording.messages.is_empty()) {
            return Err(error);
        }
        collected.finish(path, notes)
    }

    /// The columns of `run` as messages, one topic for each, as a bag of the run would hold them; `path` is the path of the run. Topics are
    /// in the root namespace, and the times are the stamps.
    ///
    /// # Errors
    /// When the run cannot be written as a bag: displacement is missing, or a stamp is before 1970 or after 2038.
    pub fn of_run(run: &Run, path: &Path) -> Result<Self, RunError> {
        let mut namer = Namer::new("");
        let mut recording = Self::default();
        // Among equal stamps displacement comes last, because it causes an estimate.
        for (column, trace) in columns_of(run, path)?.into_iter().rev() {
            let (topic, _) = namer.topic_of(column);
            recording.add_column(topic, column, trace, path)?;
        }
        recording.sort();
        Ok(recording)
    }

    fn add_column(
        &mut self,
        topic: String,
        column: &str,
        trace: &Trace,
        path: &Path,
    ) -> Result<(), RunError> {
        let unwritable = |why: String| RunError::Unwritable {
            path: path.to_owned(),
            what: format!("column `{column}`"),
            why,
        };
        let encoder = Encoder::of_column(column);
        let Some(descriptor) = known(encoder.type_name) else {
            return Err(unwritable(format!("type {} is not known", encoder.type_name)));
        };
        let index = self.topics.len();
        self.topics.push((topic, descriptor));
        let mut cdr = Vec::new();
        for (&stamp, &value) in trace.stamps.iter().zip(&trace.values) {
            if stamp.nanos() < 0 {
                let at = super::seconds_text(stamp);
                return Err(unwritable(format!(
                    "time {at} s is negative, and messages count from 1970 on: shift the run's times"
                )));
            }
            (encoder.encode)(stamp, value, &mut cdr).map_err(|error| unwritable(error.to_string()))?;
            self.push(index, stamp, &cdr);
        }
        Ok(())
    }

    fn push(&mut self, topic: usize, log_time: Stamp, cdr: &[u8]) {
        let start = self.payloads.len();
        self.payloads.extend_from_slice(cdr);
        self.messages.push(Place { topic, log_time, payload: start..self.payloads.len() });
    }

    /// Sorts the messages by log time. Messages of one time keep their order.
    fn sort(&mut self) {
        self.messages.sort_by_key(|place| place.log_time);
    }

    /// Full names and types of the topics.
    #[must_use]
    pub fn topics(&self) -> &[(String, Descriptor)] {
        &self.topics
    }

    /// The messages, in the order of their log times.
    pub fn messages(&self) -> impl ExactSizeIterator<Item = RecordedMessage<'_>> {
        self.messages.iter().map(|place| RecordedMessage {
            topic: place.topic,
            log_time: place.log_time,
            cdr: &self.payloads[place.payload.clone()],
        })
    }

    /// First and last log time; `None` without messages.
    #[must_use]
    pub fn range(&self) -> Option<(Stamp, Stamp)> {
        Some((self.messages.first()?.log_time, self.messages.last()?.log_time))
    }
}

/// The type called `name`, if this project knows it.
fn known(name: &str) -> Option<Descriptor> {
    MESSAGES.iter().copied().find(|of| of.type_name == name)
}

/// A bag while it is read.
struct Collected {
    recording: Recording,
    /// Indices of the topics by their ids in the current file; `None` for topics that are left out.
    of_file: HashMap<i64, Option<usize>>,
    /// Topics that are left out, with their types and encodings.
    left_out: Vec<(String, String)>,
    undecodable: HashMap<usize, (u64, String)>,
    unpacker: MessageUnpacker,
}

impl Collected {
    fn new() -> Self {
        Self {
            recording: Recording::default(),
            of_file: HashMap::new(),
            left_out: Vec::new(),
            undecodable: HashMap::new(),
            unpacker: MessageUnpacker::new(),
        }
    }

    fn finish(mut self, path: &Path, notes: &mut Vec<Note>) -> Result<Recording, RunError> {
        for (topic, kind) in self.left_out {
            notes.push(Note::TypeUnknown { topic, kind });
        }
        for (topic, (count, first)) in self.undecodable {
            let topic = self.recording.topics[topic].0.clone();
            notes.push(Note::Undecodable { topic, count, first });
        }
        if self.recording.messages.is_empty() {
            return Err(RunError::NoMessages { path: PathBuf::from(path) });
        }
        self.recording.sort();
        Ok(self.recording)
    }
}

impl Sink for Collected {
    fn begin_file(&mut self) {
        self.of_file.clear();
    }

    fn topic(&mut self, id: i64, info: TopicInfo) {
        let topics = &mut self.recording.topics;
        let found = topics.iter().position(|(name, of)| *name == info.name && of.type_name == info.type_name);
        let index = match (found, known(&info.type_name).filter(|_| info.encoding == "cdr")) {
            (Some(found), _) => Some(found),
            (None, Some(descriptor)) => {
                topics.push((info.name, descriptor));
                Some(topics.len() - 1)
            }
            (None, None) => {
                let kind = format!("{} ({})", info.type_name, info.encoding);
                if !self.left_out.iter().any(|(name, _)| *name == info.name) {
                    self.left_out.push((info.name, kind));
                }
                None
            }
        };
        self.of_file.insert(id, index);
    }

    fn message(&mut self, topic: i64, log_time: Result<i64, LogTimeFault>, data: &[u8]) {
        let Some(topic) = self.of_file.get(&topic).copied().flatten() else { return };
        let mut note = |fault: String| self.undecodable.entry(topic).or_insert((0, fault)).0 += 1;
        let log_time = match log_time {
            Ok(log_time) if log_time >= 0 => log_time,
            Ok(log_time) => return note(format!("log time {log_time} ns is before 1970")),
            Err(fault) => return note(fault.to_string()),
        };
        if is_packed(data) {
            match self.unpacker.unpack(data) {
                Ok(cdr) => self.recording.push(topic, Stamp::from_nanos(log_time), cdr),
                Err(fault) => note(fault.to_string()),
            }
        } else {
            self.recording.push(topic, Stamp::from_nanos(log_time), data);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SaveOptions, save};
    use mr_damper_model::rig::{Channels, Experiment, Plant, record};

    fn run() -> Run {
        let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(0.5);
        record(&experiment, &Plant::default(), &Channels::default(), 5)
    }

    /// Topic, time and payload of each message.
    fn content(recording: &Recording) -> Vec<(&str, i64, &[u8])> {
        let topic = |index: usize| recording.topics()[index].0.as_str();
        recording.messages().map(|of| (topic(of.topic), of.log_time.nanos(), of.cdr)).collect()
    }

    #[test]
    fn a_run_has_the_messages_of_its_bag() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let recording = Recording::of_run(&run(), Path::new("run")).expect("a run");
        for name in ["bag", "bare.mcap", "bare.db3"] {
            let path = dir.path().join(name);
            save(&run(), &path, &SaveOptions::default()).expect("written");
            let mut notes = Vec::new();
            let of_bag = Recording::of_bag(&path, &mut notes).expect("a bag");
            assert!(content(&of_bag) == content(&recording), "{name}: other messages");
            assert_eq!(of_bag.range(), recording.range());
            assert!(notes.is_empty(), "{notes:?}");
        }
    }

    #[test]
    fn unsuitable_recordings_are_errors() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let path = dir.path().join("text.mcap");
        std::fs::write(&path, "time_s,displacement_m\n").expect("written");
        let says = Recording::of_bag(&path, &mut Vec::new()).expect_err("refused").to_string();
        assert!(says.contains("text.mcap"), "{says}");
        let mut early = run();
        early.displacement_m.stamps[0] = Stamp::from_nanos(-1_500_000_000);
        let says = Recording::of_run(&early, Path::new("early.csv")).expect_err("refused").to_string();
        assert!(says.contains("early.csv") && says.contains("time -1.5 s is negative"), "{says}");
    }
}
