//! Marks of signals that multiplexers select: `M`, `m1` and `m1M`.

use super::Message;
use crate::bus::signal::{Presence, Signal};

/// How a signal is marked in its own line: `M`, `m1` or `m1M`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Mark {
    pub(super) is_multiplexer: bool,
    /// The value of the multiplexer that selects it.
    pub(super) value: Option<i128>,
    pub(super) is_selected: bool,
}

/// The mark of a signal; `None` if the word is none.
pub(super) fn mark_of(word: &str) -> Option<Mark> {
    let (rest, is_multiplexer) = word.strip_suffix('M').map_or((word, false), |rest| (rest, true));
    if rest.is_empty() {
        return is_multiplexer.then_some(Mark { is_multiplexer, ..Mark::default() });
    }
    let digits = rest.strip_prefix('m')?;
    let value = digits.parse::<u64>().ok().map(i128::from);
    (value.is_some() || digits.is_empty()).then_some(Mark { is_multiplexer, value, is_selected: true })
}

/// The marks say which multiplexer selects a signal if the message has only one.
pub(super) fn select_by_marks(message: &mut Message, marks: &[Mark]) {
    let mut multiplexers = marks.iter().enumerate().filter(|(_, mark)| mark.is_multiplexer);
    let (Some((multiplexer, _)), None) = (multiplexers.next(), multiplexers.next()) else { return };
    for (at, (signal, mark)) in message.signals.iter_mut().zip(marks).enumerate() {
        if at == multiplexer {
            signal.presence = Presence::Always;
        } else if let Some(value) = mark.value {
            signal.presence = Presence::When { multiplexer, values: vec![value..=value] };
        }
    }
}

/// Some tools mark a multiplexer with `m` alone. It is always present if the extended statement names it as a multiplexer.
pub(super) fn keep_named_multiplexers(message: &mut Message, marks: &[Mark]) {
    for (at, mark) in marks.iter().enumerate().filter(|(_, mark)| mark.is_selected && mark.value.is_none()) {
        let is_it =
            |it: &Signal| matches!(it.presence, Presence::When { multiplexer, .. } if multiplexer == at);
        if !mark.is_multiplexer
            && message.signals[at].presence == Presence::Unknown
            && message.signals.iter().any(is_it)
        {
            message.signals[at].presence = Presence::Always;
        }
    }
}
