//! Writes a run as a rosbag2 bag: one topic per column, messages in order of time.

use super::bag_types::{BagOptions, Topic};
use super::bag_write::{BagWriter, TopicId};
use super::names::Namer;
use super::whole::write_beside;
use super::wire::Encoder;
use super::{RunError, columns_of, sqlite};
use mr_damper_model::sample::{Run, Stamp, Trace};
use std::path::Path;

/// Messages that a bag holds beside the columns of its run, in order of their stamps.
pub trait BagMessages {
    /// Stamp of the next message; `None` after the last.
    fn next_stamp(&mut self) -> Option<Stamp>;

    /// Writes the next message with its stamp as both times.
    ///
    /// # Errors
    /// The errors of [`BagWriter::write_message`].
    fn write_next(&mut self, writer: &mut BagWriter) -> Result<(), RunError>;
}

/// No messages.
pub(super) struct RunAlone;

impl BagMessages for RunAlone {
    fn next_stamp(&mut self) -> Option<Stamp> {
        None
    }

    fn write_next(&mut self, _: &mut BagWriter) -> Result<(), RunError> {
        Ok(())
    }
}

/// A column that is being written.
struct Channel<'a> {
    topic: String,
    id: TopicId,
    encoder: Encoder,
    trace: &'a Trace,
    next: usize,
}

/// Writes `run` and `more` into the new directory `dir`, with the run's topics below `namespace`. Message times are the stamps of the
/// samples. After an error the directory is removed.
pub(super) fn save(
    run: &Run,
    dir: &Path,
    namespace: &str,
    options: BagOptions,
    more: &mut dyn BagMessages,
) -> Result<(), RunError> {
    // Checked before anything is created, so that a run that cannot be written leaves no files.
    let columns = columns_of(run, dir)?;
    let writer = BagWriter::create(dir, options)?;
    write(writer, dir, &columns, namespace, more).inspect_err(|_| {
        // `create` made this directory, since it refuses an existing one. The first error is the one that is returned.
        let _ = std::fs::remove_dir_all(dir);
    })
}

/// Writes `run` and `more` into one file at `path`, without a directory and without `metadata.yaml`.
pub(super) fn save_file(
    run: &Run,
    path: &Path,
    namespace: &str,
    options: BagOptions,
    more: &mut dyn BagMessages,
) -> Result<(), RunError> {
    let columns = columns_of(run, path)?;
    if options.max_file_bytes.is_some() || options.max_file_duration.is_some() {
        let what = "several files into one".to_owned();
        let why = "only a bag's directory can be split: name one, without extension".to_owned();
        return Err(RunError::Unwritable { path: path.to_owned(), what, why });
    }
    write_beside(path, |part| {
        write(BagWriter::create_file(part, options)?, path, &columns, namespace, more).inspect_err(|_| {
            // A database may have left journals. The first error is the one that is returned.
            for journal in ["-wal", "-shm"] {
                let _ = std::fs::remove_file(sqlite::beside(part, journal));
            }
        })
    })
}

fn write(
    mut writer: BagWriter,
    dir: &Path,
    columns: &[(&str, &Trace)],
    namespace: &str,
    more: &mut dyn BagMessages,
) -> Result<(), RunError> {
    let mut namer = Namer::new(namespace);
    let mut channels = Vec::with_capacity(columns.len());
    for &(column, trace) in columns {
        let (topic, differs) = namer.topic_of(column);
        let encoder = Encoder::of_column(column);
        let id = writer.topic(&Topic {
            name: &topic,
            type_name: encoder.type_name,
            definition: encoder.definition,
            type_hash: encoder.type_hash,
            column: differs.then_some(column),
            stands_for: None,
        })?;
        channels.push(Channel { topic, id, encoder, trace, next: 0 });
    }
    // `min_by_key` takes the first of equals. Displacement is the first column and must come last among equal stamps, so
    // that a player that keeps this order sends all other inputs before the displacement, which triggers an estimate.
    channels.reverse();
    let mut cdr = Vec::new();
    loop {
        let due = channels.iter_mut().filter_map(|c| Some((*c.trace.stamps.get(c.next)?, c)));
        let Some((stamp, channel)) = due.min_by_key(|(stamp, _)| *stamp) else { break };
        // A message of the same stamp follows from the samples, so it comes after them.
        while more.next_stamp().is_some_and(|next| next < stamp) {
            more.write_next(&mut writer)?;
        }
        (channel.encoder.encode)(stamp, channel.trace.values[channel.next], &mut cdr).map_err(|error| {
            RunError::Unwritable {
                path: dir.to_owned(),
                what: format!("topic {}", channel.topic),
                why: error.to_string(),
            }
        })?;
        writer.write(channel.id, stamp.nanos(), stamp.nanos(), &cdr)?;
        channel.next += 1;
    }
    while more.next_stamp().is_some() {
        more.write_next(&mut writer)?;
    }
    writer.finish().map(|_| ())
}
