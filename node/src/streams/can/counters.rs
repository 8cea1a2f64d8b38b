//! Counters of a CAN bus: what came, what was sent, and what was lost and why.

use super::{BusFault, SendFault};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

macro_rules! counters {
    ($($(#[doc = $doc:literal])+ $name:ident: $kind:ident, $fault:literal;)+) => {
        /// Counters of a damper's bus.
        #[derive(Debug, Default)]
        pub struct CanCounters {
            $($(#[doc = $doc])+ pub $name: AtomicU64,)+
            /// True from bus-off until the controller has restarted.
            off: AtomicBool,
            /// Why receiving failed last.
            failure: Mutex<Option<String>>,
        }

        impl CanCounters {
            /// All counters by name, with their kinds and what to do about a fault.
            fn all(&self) -> Vec<(&'static str, Kind, &'static str, u64)> {
                vec![$((stringify!($name), Kind::$kind, $fault, self.$name.load(Ordering::Relaxed))),+]
            }
        }
    };
}

/// Kinds of counters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Work that was done.
    Work,
    /// A fault of the bus or of another node.
    Fault,
    /// An output of this node that was not sent.
    Loss,
}

counters! {
    /// Frames received of messages that hold inputs.
    frames: Work, "";
    /// Values passed on.
    values: Work, "";
    /// Estimates sent.
    estimates: Work, "";
    /// Commands sent.
    commands: Work, "";
    /// Frames of other messages.
    other: Work, "";
    /// Frames or signals with too few bytes.
    short: Fault, "frames are shorter than their messages in the DBC file: give the DBC file of this bus";
    /// Frames with a wrong checksum.
    bad_checksum: Fault, "frames have a wrong checksum and were not used: check data_id, and the wiring";
    /// Frames whose alive counter stands still, or has a value that it cannot have.
    bad_counter: Fault, "frames repeat their alive counter and were not used: their sender hangs, or two nodes send the message";
    /// Frames of J1939 messages that several senders send, none of which the map or the DBC file names.
    several_senders: Fault, "frames of a J1939 message come from several source addresses and were not used: name one in can.map, as in MESSAGE.SIGNAL@0x21";
    /// Frames that are missing, according to the alive counter.
    missing: Fault, "frames are missing, according to their alive counter";
    /// Values that the DBC file does not allow.
    out_of_range: Fault, "values are outside of the range in the DBC file and were not used: check the sensor";
    /// Values lost because the queue to the source thread was full.
    overflow: Fault, "values were lost because the node does not keep up: free the processor";
    /// Errors that the controller reported.
    errors: Fault, "errors on the bus: check bit rate, wiring and termination";
    /// Times that the controller left the bus.
    bus_off: Fault, "the controller is off the bus after too many errors: check bit rate and wiring; `restart-ms` of `ip link` restarts it";
    /// Times that the interface was found down.
    down: Fault, "the interface is down: `ip link set INTERFACE up`";
    /// Times that receiving failed.
    failed: Fault, "receiving failed";
    /// Ends of the played log.
    ended: Work, "";
    /// Commands that were not sent because they were late.
    late_commands: Loss, "commands that missed deadline_s were not sent; free the processor or raise realtime_priority";
    /// Estimates that were not sent because they were late.
    late_estimates: Loss, "estimates that missed deadline_s were not sent; free the processor or raise realtime_priority";
    /// Frames that were not sent because the queue of the interface was full.
    queue_full: Loss, "frames were not sent, because the queue of the interface is full: lower the bus load, and check that another node acknowledges";
    /// Frames that were not sent because the interface is down, the controller is off the bus, or the system refused them.
    not_sent: Loss, "frames were not sent, because the interface is down, off the bus, or refused them";
    /// Forces and currents that their signal cannot carry; a force was sent as not available, a command was not sent.
    not_representable: Loss, "forces or currents do not fit the range of their signal: widen it in the DBC file";
}

/// The counts that the log has reported.
#[derive(Debug, Default)]
pub struct CanNews {
    seen: Vec<u64>,
}

impl CanNews {
    /// The sentences about faults and losses since the last call.
    pub fn since_last(&mut self, counters: &CanCounters) -> Vec<String> {
        let all = counters.all();
        self.seen.resize(all.len(), 0);
        let mut sentences = Vec::new();
        for (seen, (name, kind, fault, count)) in self.seen.iter_mut().zip(all) {
            let new = count.saturating_sub(std::mem::replace(seen, count));
            if new == 0 {
                continue;
            }
            match (name, kind) {
                ("failed", _) => {
                    let why = counters.failure().unwrap_or_default();
                    sentences.push(format!("{fault}, {new} times: {why}"));
                }
                ("ended", _) => sentences.push("the log that is played as a bus has ended".to_owned()),
                (_, Kind::Work) => {}
                (_, Kind::Fault | Kind::Loss) => sentences.push(format!("{new} more {name}: {fault}")),
            }
        }
        sentences
    }
}

impl CanCounters {
    /// Adds one to a counter of this struct.
    pub(in crate::streams) fn add(count: &AtomicU64, number: u64) {
        if number > 0 {
            count.fetch_add(number, Ordering::Relaxed);
        }
    }

    /// Counts a fault of the bus.
    pub(in crate::streams) fn note(&self, fault: BusFault) {
        match fault {
            BusFault::Error => Self::add(&self.errors, 1),
            BusFault::Off => {
                if !self.off.swap(true, Ordering::Relaxed) {
                    Self::add(&self.bus_off, 1);
                }
            }
            BusFault::Restarted => self.off.store(false, Ordering::Relaxed),
            BusFault::Down => Self::add(&self.down, 1),
            BusFault::Ended => Self::add(&self.ended, 1),
            BusFault::Failed(why) => {
                *self.failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(why);
                Self::add(&self.failed, 1);
            }
        }
    }

    /// Counts a frame that was not sent.
    pub(in crate::streams) fn not_sent(&self, why: SendFault) {
        match why {
            SendFault::Full => Self::add(&self.queue_full, 1),
            SendFault::Down | SendFault::Failed => Self::add(&self.not_sent, 1),
        }
    }

    /// True while the controller is off the bus. Frames passed to the kernel would wait in its queue and be sent late.
    #[must_use]
    pub fn is_off(&self) -> bool {
        self.off.load(Ordering::Relaxed)
    }

    /// Why receiving failed last.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// All counters, by name.
    #[must_use]
    pub fn values(&self) -> Vec<(&'static str, u64)> {
        self.all().into_iter().map(|(name, .., count)| (name, count)).collect()
    }

    /// The outputs that were not sent, by reason.
    #[must_use]
    pub fn losses(&self) -> Vec<(&'static str, u64)> {
        self.all()
            .into_iter()
            .filter(|(_, kind, ..)| *kind == Kind::Loss)
            .map(|(name, .., count)| (name, count))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_fault_is_told_once_with_its_count_and_advice() {
        let (counters, mut news) = (CanCounters::default(), CanNews::default());
        CanCounters::add(&counters.frames, 7);
        assert_eq!(news.since_last(&counters), Vec::<String>::new());
        for fault in
            [BusFault::Error, BusFault::Error, BusFault::Off, BusFault::Off, BusFault::Failed("ENXIO".into())]
        {
            counters.note(fault);
        }
        let said = news.since_last(&counters);
        assert!(said[0].starts_with("2 more errors: errors on the bus"), "{said:?}");
        assert!(said[1].starts_with("1 more bus_off: "), "{said:?}");
        assert_eq!((said.len(), &*said[2]), (3, "receiving failed, 1 times: ENXIO"));
        assert!(counters.is_off());
        counters.note(BusFault::Restarted);
        assert!(!counters.is_off() && news.since_last(&counters).is_empty());
        counters.not_sent(SendFault::Full);
        counters.not_sent(SendFault::Down);
        let losses: Vec<_> = counters.losses().into_iter().filter(|(_, count)| *count > 0).collect();
        assert_eq!(losses, [("queue_full", 1), ("not_sent", 1)]);
    }
}
