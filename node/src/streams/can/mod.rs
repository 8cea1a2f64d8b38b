//! CAN buses: frames in and out.
//!
//! ```text
//! interface ─→ FrameReceiver ─→ [can-source] ─→ queue ─→ source thread ─→ ring ─→ estimating thread
//! estimating thread ─→ ring ─→ [can-commands] ─→ FrameSender ─→ interface
//!                   └→ ring ─→ [can-sink] ─────→ FrameSender ─→ interface
//! ```
//!
//! The threads are in `source/can.rs` and `sink/can.rs`. They know a bus only through the traits below, which three modules implement:
//!
//! | interface | module |
//! |---|---|
//! | `can0`, or any other interface of the kernel | `socket.rs` |
//! | `file:drive.log`, a log that is played in real time | `log.rs` |
//! | memory, for tests | `memory.rs` |
//!
//! No thread of a bus logs: a broken bus can cause thousands of faults a second. They are counted (`counters.rs`), and the overseer logs
//! what is new once a second.

mod counters;
mod log;
mod memory;
mod setup;
mod socket;

pub use counters::{CanCounters, CanNews};
pub use memory::MemoryBus;
pub use setup::CanSetup;

use crate::settings::error::PartError;
use mr_damper_model::sample::Stamp;
use mr_damper_runs::bus::{BusError, CanId, FrameFilter, MOST_BYTES};
use std::sync::Arc;
use std::time::Duration;

/// A data frame, classic or CAN FD.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// Its identifier.
    pub id: CanId,
    /// When it was received, by the system's clock: the kernel's stamp, if there is one.
    pub stamp: Stamp,
    bytes: usize,
    data: [u8; MOST_BYTES],
}

impl Frame {
    /// A frame with at most [`MOST_BYTES`] bytes of `data`; `None` with more.
    #[must_use]
    pub fn new(id: CanId, stamp: Stamp, data: &[u8]) -> Option<Self> {
        let mut all = [0; MOST_BYTES];
        all.get_mut(..data.len())?.copy_from_slice(data);
        Some(Self { id, stamp, bytes: data.len(), data: all })
    }

    /// The data bytes.
    #[must_use]
    pub fn data(&self) -> &[u8] {
        &self.data[..self.bytes]
    }
}

/// A frame or a fault that comes from a bus.
#[derive(Debug, Clone, PartialEq)]
pub enum Arrival {
    /// A data frame.
    Frame(Frame),
    /// A fault, or the end of one.
    Fault(BusFault),
}

/// A fault of a bus or its interface, or the end of one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum BusFault {
    /// The controller reported an error.
    Error,
    /// The controller has left the bus after too many errors; it neither sends nor receives.
    Off,
    /// The controller has joined the bus again.
    Restarted,
    /// The interface is down or gone.
    Down,
    /// The log that is played has ended.
    Ended,
    /// Receiving failed, for the reason given.
    Failed(String),
}

/// Why a frame was not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SendFault {
    /// The queue of the interface is full: the bus is too busy, or nobody acknowledges.
    Full,
    /// The interface is down or gone.
    Down,
    /// Anything else.
    Failed,
}

/// Receives the frames of a bus.
pub trait FrameReceiver: Send {
    /// The next arrival; `None` if there is none within `timeout`.
    fn receive(&mut self, timeout: Duration) -> Option<Arrival>;
}

/// Sends frames to a bus.
pub trait FrameSender: Send {
    /// Passes a frame to the interface, without waiting.
    ///
    /// # Errors
    /// When the interface does not accept it. The frame is then lost.
    fn send(&mut self, id: CanId, data: &[u8]) -> Result<(), SendFault>;
}

/// A bus, or an interface to it.
pub trait CanBus: Send + Sync {
    /// A receiver of the frames that pass one of the filters `wanted`, and of the faults of the bus.
    ///
    /// # Errors
    /// When the interface cannot be opened.
    fn receiver(&self, wanted: &[FrameFilter]) -> Result<Box<dyn FrameReceiver>, CanError>;

    /// A sender.
    ///
    /// # Errors
    /// When the interface cannot be opened, or nothing can be sent to it.
    fn sender(&self) -> Result<Box<dyn FrameSender>, CanError>;
}

/// The bus behind `interface`: an interface of the kernel, or `file:LOG[,bus=NAME][,out=LOG]`.
fn bus(interface: &str) -> Result<Arc<dyn CanBus>, CanError> {
    match interface.strip_prefix("file:") {
        Some(rest) => Ok(Arc::new(log::LogBus::new(interface, rest)?)),
        None => Ok(Arc::new(socket::KernelBus::new(interface))),
    }
}

impl CanError {
    /// What `parameter` says does not fit, because of `why`.
    fn signals(parameter: &'static str, why: impl Into<BusError>) -> Self {
        Self::Signals { parameter, why: Box::new(why.into()) }
    }
}

/// Why a bus cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CanError {
    /// The kernel has no CAN.
    #[error(
        "can.interface {interface}: this kernel has no CAN sockets ({why}): load the module can_raw (modprobe can_raw), use a kernel that \
         has it, or play a log with can.interface=file:LOG"
    )]
    NoCan {
        /// The interface.
        interface: String,
        /// The system's reason.
        why: std::io::Error,
    },
    /// The interface cannot be opened.
    #[error(
        "can.interface {interface}: {why}; `ip -details link show type can` lists the interfaces, and `ip link set {interface} up type can \
         bitrate 500000` starts one"
    )]
    Interface {
        /// The interface.
        interface: String,
        /// The system's reason.
        why: std::io::Error,
    },
    /// The interface is not written correctly.
    #[error(
        "can.interface is `{interface}`, but must be an interface such as can0, or file:LOG[,bus=NAME][,out=LOG]"
    )]
    Form {
        /// The interface.
        interface: String,
    },
    /// A log is played, and there are outputs without a place.
    #[error(
        "can.interface {interface}: a log that is played takes no frames, and can.out names outputs: add ,out=FILE.log, or leave can.out out"
    )]
    NoOut {
        /// The interface.
        interface: String,
    },
    /// The log of sent frames cannot be written.
    #[error("can.interface: cannot create {path}: {why}; name with out= a log that does not exist yet")]
    Out {
        /// The file.
        path: String,
        /// The system's reason.
        why: std::io::Error,
    },
    /// A log cannot be played.
    #[error("can.interface {interface}: cannot play the log: {why}")]
    Log {
        /// The interface.
        interface: String,
        /// The system's reason.
        why: std::io::Error,
    },
    /// Parameters need others.
    #[error("{given} is set, but {missing} is not: {advice}")]
    Missing {
        /// The parameter that is set.
        given: &'static str,
        /// The parameter that is not.
        missing: &'static str,
        /// What to do.
        advice: &'static str,
    },
    /// A topic is sent twice.
    #[error("can.out names {topic} twice; leave one out")]
    TwoOutputs {
        /// The topic.
        topic: &'static str,
    },
    /// Mappings, checks or outputs cannot be used.
    #[error("{parameter}: {why}")]
    Signals {
        /// The parameter.
        parameter: &'static str,
        /// The reason.
        why: Box<BusError>,
    },
}

impl PartError for CanError {
    fn is_wrong_usage(&self) -> bool {
        match self {
            Self::Form { .. } | Self::NoOut { .. } | Self::Missing { .. } | Self::TwoOutputs { .. } => true,
            Self::Signals { why, .. } => !matches!(**why, BusError::Dbc(_)),
            Self::NoCan { .. } | Self::Interface { .. } | Self::Out { .. } | Self::Log { .. } => false,
        }
    }
}
