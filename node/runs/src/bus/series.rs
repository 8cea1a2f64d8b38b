//! One channel of a run while a log is read: its samples, and the frames or records that gave none.

use super::channels::Source;
use super::frame::Unusable;
use super::j1939::{Sender, listed};
use super::places::Place;
use crate::Note;
use crate::column::Quantity;
use crate::error::MapFault;
use crate::map::Convert;
use mr_damper_model::sample::{Stamp, Trace};
use std::collections::BTreeMap;

/// One channel while it is read.
pub(super) struct Series {
    pub(super) quantity: Quantity,
    /// Its name in messages, as in the map.
    pub(super) name: String,
    pub(super) source: Source,
    pub(super) convert: Convert,
    pub(super) samples: Samples,
    /// Those of each sender of a J1939 message, until the log is read and one is chosen.
    pub(super) by_sender: BTreeMap<Sender, Samples>,
}

/// The samples of a channel.
#[derive(Debug, Default)]
pub(super) struct Samples {
    /// One part for each channel group of an MDF4 file that has frames of the message, in the order of their first samples. The times of a
    /// part increase.
    parts: Vec<(Place, Trace)>,
    pub(super) counts: Counts,
}

/// What became of the frames or records of a channel.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counts {
    /// Frames of its message, or records of its channel.
    pub(super) frames: u64,
    /// Whose multiplexer selects other signals.
    pub(super) absent: u64,
    pub(super) short: u64,
    pub(super) not_finite: u64,
    /// Whose time is not after the one before, in the same channel group.
    pub(super) not_increasing: u64,
    /// That have the time of a sample in another channel group.
    pub(super) same_time: u64,
    /// With a value that the DBC file does not allow.
    pub(super) out_of_range: u64,
    /// Without a usable time.
    pub(super) timeless: u64,
}

impl Samples {
    pub(super) fn push(&mut self, place: Place, nanos: i64, value: f64) {
        let stamp = Stamp::from_nanos(nanos);
        if !value.is_finite() {
            self.counts.not_finite += 1;
            return;
        }
        let known = self.parts.iter().rposition(|(part, _)| part.group == place.group);
        let part = known.unwrap_or_else(|| {
            self.parts.push((place, Trace::default()));
            self.parts.len() - 1
        });
        let trace = &mut self.parts[part].1;
        if trace.stamps.last().is_some_and(|&last| stamp <= last) {
            self.counts.not_increasing += 1;
        } else {
            trace.stamps.push(stamp);
            trace.values.push(value);
        }
    }

    /// Number of channel groups that gave samples and do not name their bus.
    pub(super) fn unnamed_groups(&self) -> usize {
        self.parts.iter().filter(|(place, _)| place.is_unnamed).count()
    }

    /// Merges the parts in order of time. If several parts have a sample at one time, the first part's sample stays.
    pub(super) fn merge(&mut self) {
        if self.parts.len() < 2 {
            return;
        }
        let place = self.parts[0].0;
        let mut all: Vec<(Stamp, f64)> = Vec::new();
        for (_, Trace { stamps, values, .. }) in self.parts.drain(..) {
            all.extend(stamps.into_iter().zip(values));
        }
        // The order of equal times stays; sorted parts are merged in linear time.
        all.sort_by_key(|(stamp, _)| *stamp);
        let count = all.len();
        all.dedup_by_key(|(stamp, _)| *stamp);
        self.counts.same_time += (count - all.len()) as u64;
        let (stamps, values) = all.into_iter().unzip();
        self.parts.push((place, Trace { stamps, values }));
    }

    /// The samples, after [`merge`](Self::merge).
    pub(super) fn trace(&self) -> Option<&Trace> {
        self.parts.first().map(|(_, trace)| trace)
    }

    pub(super) fn into_trace(self) -> Trace {
        self.parts.into_iter().next().map(|(_, trace)| trace).unwrap_or_default()
    }
}

impl Series {
    pub(super) fn new(quantity: Quantity, name: String, source: Source, convert: Convert) -> Self {
        Self { quantity, name, source, convert, samples: Samples::default(), by_sender: BTreeMap::new() }
    }

    /// Chooses the sender of a J1939 message if the map names none: the sender in the DBC file, `own`, or the only one.
    pub(super) fn choose_sender(&mut self, own: Sender) -> Result<Option<Note>, MapFault> {
        let mut all = std::mem::take(&mut self.by_sender);
        let used =
            if all.contains_key(&own) || all.len() != 1 { own } else { *all.keys().next().unwrap_or(&own) };
        let samples = all.remove(&used);
        let found = || listed(&all.keys().copied().collect());
        match samples {
            None if all.is_empty() => return Ok(None),
            None => {
                let found = found();
                let first = &found[0];
                let Source::Signal { bus, .. } = &self.source else { return Ok(None) };
                let bus = bus.as_ref().map(|bus| format!(":{bus}")).unwrap_or_default();
                let name = self.name.strip_suffix(&bus).unwrap_or(&self.name);
                // A map may name the source address alone.
                let name = name.rsplit_once('@').map_or(name, |(name, _)| name);
                let example = format!("{name}@{first}{bus}");
                return Err(MapFault::SeveralSenders { found, own: own.to_string(), example });
            }
            Some(samples) => self.samples = samples,
        }
        if let Source::Signal { sender, .. } = &mut self.source {
            *sender = Some(used);
        }
        let (signal, used) = (self.name.clone(), used.to_string());
        Ok((!all.is_empty()).then(|| Note::OtherSenders { signal, used, others: found() }))
    }

    /// Takes a value in the unit of the source, from a record of a plain channel.
    pub(super) fn push(&mut self, nanos: i64, raw: f64) {
        self.samples.push(Place::default(), nanos, self.convert.apply(raw));
    }

    /// Counts a record of its source, whether or not it has a value.
    pub(super) fn count(&mut self) {
        self.samples.counts.frames += 1;
    }

    /// Counts a record of its source without a usable time.
    pub(super) fn count_timeless(&mut self) {
        self.samples.counts.frames += 1;
        self.samples.counts.timeless += 1;
    }

    pub(super) fn notes(&self, notes: &mut Vec<Note>) {
        let signal = || self.name.clone();
        let Counts { not_finite, short, out_of_range, timeless, not_increasing, same_time, .. } =
            self.samples.counts;
        let counts = [
            (not_finite, "NaN or infinite values"),
            (short, "too few data bytes for it"),
            (out_of_range, "a value outside of its range in the DBC file"),
            (timeless, Unusable::Time.in_words()),
        ];
        for (count, what) in counts.into_iter().filter(|(count, _)| *count > 0) {
            notes.push(Note::SignalDropped { signal: signal(), count, what });
        }
        let count = not_increasing + same_time;
        if count > 0 {
            notes.push(Note::SignalNotIncreasing { signal: signal(), count });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_merged_in_order_of_time_and_the_first_part_has_priority() {
        let mut samples = Samples::default();
        let place = |group| Place { group, is_unnamed: group > 0, ..Place::default() };
        for (group, nanos, value) in
            [(1, 5, 1.0), (1, 9, 2.0), (0, 1, 3.0), (0, 5, 4.0), (1, 7, 5.0), (2, 6, 6.0)]
        {
            samples.push(place(group), nanos, value);
        }
        samples.push(place(0), 6, f64::NAN);
        assert_eq!((samples.unnamed_groups(), samples.counts.not_increasing), (2, 1));
        samples.merge();
        let Counts { not_increasing, same_time, not_finite, .. } = samples.counts;
        assert_eq!((not_increasing, same_time, not_finite), (1, 1, 1));
        let trace = samples.into_trace();
        assert_eq!(trace.stamps.iter().map(|it| it.nanos()).collect::<Vec<_>>(), [1, 5, 6, 9]);
        assert_eq!(trace.values, [3.0, 1.0, 6.0, 2.0]);
    }
}
