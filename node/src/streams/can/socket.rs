//! An interface of the kernel, by SocketCAN.
//!
//! Each thread has a socket of its own. A filter in the kernel passes to the receiving socket the wanted frames only, and the error
//! frames about the state of the controller. The kernel stamps each frame on reception (`SO_TIMESTAMPNS`, on `CLOCK_REALTIME`, which is
//! the clock of the node). The sending sockets receive nothing and never block. Other programs on this machine see the sent frames, as
//! usual.
//!
//! The machines that the project is tested on have no CAN in their kernels: only the error for that is tested there.

use super::{Arrival, BusFault, CanBus, CanError, Frame, FrameReceiver, FrameSender, SendFault};
use mr_damper_base::clock::system_now;
use mr_damper_model::sample::Stamp;
use mr_damper_runs::bus::{CanId, FrameFilter};
use socketcan::{
    CanAnyFrame, CanError as ControllerError, CanFdFrame, CanFdSocket, CanFilter, CanFrame, CanSocket,
    EmbeddedFrame, ExtendedId, Id, Socket, SocketOptions, StandardId,
};
use std::io::{Error, ErrorKind, Result};
use std::time::{Duration, Instant, UNIX_EPOCH};

/// Masks of error frames (`linux/can/error.h`): state of the controller, bus-off, restarted.
const ERRORS: u32 = 0x4 | 0x40 | 0x100;
/// Identifier bits of `struct can_filter`: 29 bits, and the flags for extended and remote frames.
const EXTENDED: u32 = 1 << 31;
const REMOTE: u32 = 1 << 30;
/// Error numbers of Linux.
const ENODEV: i32 = 19;
const ENXIO: i32 = 6;
const EPROTONOSUPPORT: i32 = 93;
const EAFNOSUPPORT: i32 = 97;
const ENETDOWN: i32 = 100;
const ENOBUFS: i32 = 105;
/// Time between two attempts to open an interface that has gone.
const RETRY: Duration = Duration::from_secs(1);

/// An interface, by its name.
pub(super) struct KernelBus {
    interface: String,
}

impl KernelBus {
    pub(super) fn new(interface: &str) -> Self {
        Self { interface: interface.to_owned() }
    }

    /// The error for an interface that cannot be opened.
    fn error(&self, why: Error) -> CanError {
        let interface = self.interface.clone();
        // A socket that is bound to no interface fails only if the kernel lacks the protocol.
        match CanSocket::open_iface(0) {
            Err(why) if matches!(why.raw_os_error(), Some(EAFNOSUPPORT | EPROTONOSUPPORT)) => {
                CanError::NoCan { interface, why }
            }
            _ => CanError::Interface { interface, why },
        }
    }
}

impl CanBus for KernelBus {
    fn receiver(&self, wanted: &[FrameFilter]) -> std::result::Result<Box<dyn FrameReceiver>, CanError> {
        let filters: Vec<CanFilter> = wanted.iter().map(filter).collect();
        let socket = open(&self.interface, &filters).map_err(|why| self.error(why))?;
        let interface = self.interface.clone();
        Ok(Box::new(SocketReceiver {
            interface,
            filters,
            socket: Some(socket),
            timeout: None,
            tried: Instant::now(),
        }))
    }

    fn sender(&self) -> std::result::Result<Box<dyn FrameSender>, CanError> {
        let interface = self.interface.clone();
        let socket = open_sending(&interface).map_err(|why| self.error(why))?;
        Ok(Box::new(SocketSender { interface, socket: Some(socket), tried: Instant::now() }))
    }
}

/// The filter of the kernel for the frames of one message.
fn filter(wanted: &FrameFilter) -> CanFilter {
    let FrameFilter { id, mask } = wanted;
    let (value, bits) = if id.extended { (id.value | EXTENDED, 0x1fff_ffff) } else { (id.value, 0x7ff) };
    CanFilter::new(value, bits & mask | EXTENDED | REMOTE)
}

fn open(interface: &str, filters: &[CanFilter]) -> Result<CanFdSocket> {
    let socket = CanFdSocket::open(interface)?;
    if filters.is_empty() {
        socket.set_filter_drop_all()?;
    } else {
        socket.set_filters(filters)?;
    }
    socket.set_error_filter(ERRORS)?;
    socket.set_recv_timestamp(true)?;
    Ok(socket)
}

fn open_sending(interface: &str) -> Result<CanFdSocket> {
    let socket = CanFdSocket::open(interface)?;
    socket.set_filter_drop_all()?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

/// True if the interface of a socket has gone, so that the socket is of no more use.
fn has_gone(error: &Error) -> bool {
    matches!(error.raw_os_error(), Some(ENODEV | ENXIO))
}

struct SocketReceiver {
    interface: String,
    filters: Vec<CanFilter>,
    /// `None` while the interface is gone.
    socket: Option<CanFdSocket>,
    /// The read timeout that the socket has.
    timeout: Option<Duration>,
    tried: Instant,
}

impl FrameReceiver for SocketReceiver {
    fn receive(&mut self, timeout: Duration) -> Option<Arrival> {
        if self.socket.is_none() && self.tried.elapsed() >= RETRY {
            self.tried = Instant::now();
            self.timeout = None;
            self.socket = open(&self.interface, &self.filters).ok();
        }
        let Some(socket) = &self.socket else {
            std::thread::sleep(timeout);
            return None;
        };
        let read = set_timeout(socket, &mut self.timeout, timeout)
            .and_then(|()| socket.read_frame_with_timestamps());
        match read {
            Ok((frame, stamps)) => {
                let stamp = stamps.socket.and_then(|at| at.duration_since(UNIX_EPOCH).ok());
                let stamp = stamp.and_then(|since| i64::try_from(since.as_nanos()).ok());
                arrival(frame, stamp.map_or_else(system_now, Stamp::from_nanos))
            }
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::Interrupted | ErrorKind::TimedOut
                ) =>
            {
                None
            }
            Err(error) => {
                let fault = if has_gone(&error) || error.raw_os_error() == Some(ENETDOWN) {
                    BusFault::Down
                } else {
                    BusFault::Failed(error.to_string())
                };
                if has_gone(&error) {
                    self.socket = None;
                    self.tried = Instant::now();
                }
                // A socket that fails at once must not keep the processor busy.
                std::thread::sleep(timeout);
                Some(Arrival::Fault(fault))
            }
        }
    }
}

/// Sets the socket's read timeout, if it has another one.
fn set_timeout(socket: &CanFdSocket, known: &mut Option<Duration>, timeout: Duration) -> Result<()> {
    if *known != Some(timeout) {
        socket.set_read_timeout(timeout)?;
        *known = Some(timeout);
    }
    Ok(())
}

/// The meaning of a frame of the kernel; `None` for a remote frame.
fn arrival(frame: CanAnyFrame, stamp: Stamp) -> Option<Arrival> {
    match frame {
        CanAnyFrame::Normal(frame) => data_frame(frame.id(), stamp, frame.data()),
        CanAnyFrame::Fd(frame) => data_frame(frame.id(), stamp, frame.data()),
        CanAnyFrame::Remote(_) => None,
        CanAnyFrame::Error(frame) => {
            let error: ControllerError = frame.into_error();
            Some(Arrival::Fault(if error.is_bus_off() {
                BusFault::Off
            } else if error.is_restarted() {
                BusFault::Restarted
            } else {
                BusFault::Error
            }))
        }
    }
}

fn data_frame(id: Id, stamp: Stamp, data: &[u8]) -> Option<Arrival> {
    let id = match id {
        Id::Standard(id) => CanId::new(u32::from(id.as_raw()), false),
        Id::Extended(id) => CanId::new(id.as_raw(), true),
    };
    Frame::new(id?, stamp, data).map(Arrival::Frame)
}

struct SocketSender {
    interface: String,
    /// `None` while the interface is gone.
    socket: Option<CanFdSocket>,
    tried: Instant,
}

impl FrameSender for SocketSender {
    fn send(&mut self, id: CanId, data: &[u8]) -> std::result::Result<(), SendFault> {
        if self.socket.is_none() && self.tried.elapsed() >= RETRY {
            self.tried = Instant::now();
            self.socket = open_sending(&self.interface).ok();
        }
        let socket = self.socket.as_ref().ok_or(SendFault::Down)?;
        let frame = kernel_frame(id, data).ok_or(SendFault::Failed)?;
        socket.write_frame(&frame).map_err(|error| {
            if has_gone(&error) {
                self.socket = None;
                self.tried = Instant::now();
                return SendFault::Down;
            }
            match error.raw_os_error() {
                Some(ENOBUFS) => SendFault::Full,
                Some(ENETDOWN) => SendFault::Down,
                _ if error.kind() == ErrorKind::WouldBlock => SendFault::Full,
                _ => SendFault::Failed,
            }
        })
    }
}

/// The frame for the kernel: one of CAN FD if it has more than 8 bytes.
fn kernel_frame(id: CanId, data: &[u8]) -> Option<CanAnyFrame> {
    let id = if id.extended {
        Id::Extended(ExtendedId::new(id.value)?)
    } else {
        Id::Standard(StandardId::new(u16::try_from(id.value).ok()?)?)
    };
    if data.len() > 8 {
        CanFdFrame::new(id, data).map(CanAnyFrame::from)
    } else {
        CanFrame::new(id, data).map(CanAnyFrame::from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_both_kinds_keep_identifier_and_data_on_the_way_through_the_kernels_form() {
        let stamp = Stamp::from_nanos(5);
        for (value, extended, bytes) in [
            (0x123, false, 8),
            (0x123, true, 8),
            (0x7ff, false, 0),
            (0x1fff_ffff, true, 64),
            (0x18, false, 12),
        ] {
            let id = CanId::new(value, extended).expect("in range");
            let data: Vec<u8> = (0..bytes).collect();
            let frame = kernel_frame(id, &data).expect("a frame");
            assert_eq!(matches!(frame, CanAnyFrame::Fd(_)), bytes > 8);
            let expected = Frame::new(id, stamp, &data).map(Arrival::Frame);
            assert_eq!(arrival(frame, stamp), expected, "{id}");
        }
    }

    #[test]
    fn error_frames_say_how_the_controller_does() {
        for (bits, fault) in [(0x40, BusFault::Off), (0x100, BusFault::Restarted), (0x4, BusFault::Error)] {
            let frame = socketcan::CanErrorFrame::new_error(bits, &[0; 8]).expect("an error frame");
            let found = arrival(CanAnyFrame::Error(frame), Stamp::from_nanos(0));
            assert_eq!(found, Some(Arrival::Fault(fault)));
        }
    }
}
