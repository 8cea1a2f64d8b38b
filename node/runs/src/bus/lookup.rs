//! Finds the signal that a name means in the messages of DBC files.

use super::dbc::{Database, Message};
use super::j1939::{Sender, pgn};
use super::signal::{Presence, Signal};
use crate::error::MapFault;

impl Database {
    /// The signal that `name` means, as indices of message and signal: `MESSAGE.SIGNAL`, or `SIGNAL` if one message has it. `None` if
    /// there is none.
    ///
    /// # Errors
    /// When several signals have the name, several messages have the identifier, or no frame can hold the signal.
    pub(super) fn find(&self, name: &str) -> Result<Option<(usize, usize)>, MapFault> {
        let all = || self.messages.iter().enumerate();
        let found = |index: usize, of: &Message, wanted: &str| {
            let signals = of.signals.iter().enumerate().filter(|(_, signal)| signal.name == wanted);
            signals.map(|(signal, _)| (index, signal)).collect::<Vec<_>>()
        };
        let mut matches: Vec<(usize, usize)> = match name.split_once('.') {
            Some((message, signal)) => all()
                .filter(|(_, it)| it.name == message)
                .flat_map(|(index, it)| found(index, it, signal))
                .collect(),
            None => Vec::new(),
        };
        if matches.is_empty() {
            matches = all().flat_map(|(index, it)| found(index, it, name)).collect();
        }
        let place = |(message, signal): &(usize, usize)| {
            let of = &self.messages[*message];
            let signal = &of.signals[*signal];
            format!("{}.{} ({}, line {})", of.name, signal.name, self.file(of), signal.line)
        };
        let (message, signal) = match matches.as_slice() {
            [] => return Ok(None),
            [only] => *only,
            several => {
                let places: Vec<String> = several.iter().map(place).collect();
                return Err(MapFault::SignalTwice { signal: name.to_owned(), places: places.join(", ") });
            }
        };
        let of = &self.messages[message];
        self.check_identifier(of)?;
        check_signal(of, &of.signals[signal])?;
        Ok(Some((message, signal)))
    }

    /// The signal that `name` means, as [`find`](Self::find) gives it, and the sender of its J1939 message if `name` ends with its address:
    /// `EEC1.Speed@0x21`.
    ///
    /// # Errors
    /// As for [`find`](Self::find), and when the address does not fit the message.
    pub(super) fn find_sent(&self, name: &str) -> Result<Option<(usize, usize, Option<Sender>)>, MapFault> {
        if let Some((message, signal)) = self.find(name)? {
            return Ok(Some((message, signal, None)));
        }
        let Some((own, address)) = name.rsplit_once('@') else { return Ok(None) };
        let Some((message, signal)) = self.find(own)? else { return Ok(None) };
        let (of, address) = (&self.messages[message], address.to_owned());
        if !of.is_j1939 {
            return Err(MapFault::NotJ1939 { signal: own.to_owned(), message: of.name.clone(), address });
        }
        let sender = Sender::named(&address, of.id).ok_or(MapFault::Address { address })?;
        Ok(Some((message, signal, Some(sender))))
    }

    /// Refuses a message whose identifier another message has, too.
    pub(super) fn check_identifier(&self, of: &Message) -> Result<(), MapFault> {
        let twins: Vec<String> = self
            .messages
            .iter()
            .filter(|other| other.id == of.id)
            .map(|it| format!("{} ({}, line {})", it.name, self.file(it), it.line))
            .collect();
        if twins.len() > 1 {
            return Err(MapFault::MessageTwice { id: of.id.to_string(), places: twins.join(", ") });
        }
        Ok(())
    }
}

/// The identifier of a message, for messages to the user.
pub(super) fn shown_id(message: &Message) -> String {
    if message.is_j1939 {
        format!("{}, J1939 PGN {}", message.id, pgn(message.id.value))
    } else {
        message.id.to_string()
    }
}

/// Refuses a signal that no frame can hold, or whose multiplexer is not known.
pub(super) fn check_signal(message: &Message, signal: &Signal) -> Result<(), MapFault> {
    let name = || format!("{}.{}", message.name, signal.name);
    if !signal.has_good_length() {
        return Err(MapFault::SignalLength { signal: name(), line: signal.line, bits: signal.length });
    }
    if signal.end() > message.bytes {
        let (needed, has) = (signal.end(), message.bytes);
        return Err(MapFault::SignalBeyond { signal: name(), line: signal.line, needed, has });
    }
    if signal.presence == Presence::Unknown {
        return Err(MapFault::NoMultiplexer { signal: name(), line: signal.line });
    }
    Ok(())
}
