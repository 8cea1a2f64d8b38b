//! A log of frames that is played as a bus: `file:drive.log[,bus=can1][,out=sent.log]`.
//!
//! Frames arrive with the spacing that they have in the log, and their stamps have exactly this spacing, so estimates equal the
//! offline ones. Sent frames are written to the log `out`, as candump writes them. A thread reads the log ahead, so it may be of any length.

use super::{Arrival, BusFault, CanBus, CanError, Frame, FrameReceiver, FrameSender, SendFault};
use mr_damper_base::clock::system_now;
use mr_damper_model::sample::Stamp;
use mr_damper_runs::bus::{CanId, candump_line, read_log};
use std::fs::File;
use std::io::Write;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Frames that are read ahead.
const AHEAD: usize = 1024;

/// A log to play, and a log to write.
pub(super) struct LogBus {
    interface: String,
    path: PathBuf,
    bus: Option<String>,
    /// Path of the log of sent frames.
    out: Option<String>,
    /// That log, once the first sender has created it.
    created: Mutex<Option<Arc<Mutex<File>>>>,
}

impl LogBus {
    /// The log that `text` names: a path and options.
    ///
    /// # Errors
    /// When the text has another form, or the log does not exist.
    pub(super) fn new(interface: &str, text: &str) -> Result<Self, CanError> {
        let form = || CanError::Form { interface: interface.to_owned() };
        let mut parts = text.split(',');
        let path = parts.next().filter(|path| !path.is_empty()).ok_or_else(form)?;
        let (mut bus, mut out) = (None, None);
        for part in parts {
            match part.split_once('=') {
                Some(("bus", name)) if bus.is_none() => bus = Some(name.to_owned()),
                Some(("out", path)) if out.is_none() && !path.is_empty() => out = Some(path),
                _ => return Err(form()),
            }
        }
        File::open(path).map_err(|why| CanError::Log { interface: interface.to_owned(), why })?;
        let out = out.map(str::to_owned);
        Ok(Self { interface: interface.to_owned(), path: path.into(), bus, out, created: Mutex::default() })
    }
}

impl CanBus for LogBus {
    fn receiver(&self, wanted: &[CanId]) -> Result<Box<dyn FrameReceiver>, CanError> {
        let (sender, frames) = sync_channel(AHEAD);
        let (path, bus, wanted) = (self.path.clone(), self.bus.clone(), wanted.to_vec());
        let read = move || {
            let mut first = None;
            let done = read_log(&path, bus.as_deref(), |frame| {
                // The first frame of the log is its start, whatever message it is.
                let start = *first.get_or_insert(frame.nanos);
                if wanted.contains(&frame.id)
                    && let Some(frame) =
                        Frame::new(frame.id, Stamp::from_nanos(frame.nanos.saturating_sub(start)), frame.data)
                {
                    // Without a receiver, the node has ended.
                    let _ = sender.send(Arrival::Frame(frame));
                }
            });
            let end = done.err().map_or(BusFault::Ended, |why| BusFault::Failed(why.to_string()));
            let _ = sender.send(Arrival::Fault(end));
        };
        std::thread::Builder::new()
            .name("can-log".to_owned())
            .spawn(read)
            .map_err(|why| CanError::Log { interface: self.interface.clone(), why })?;
        Ok(Box::new(LogReceiver { frames, start: None, next: None }))
    }

    fn sender(&self) -> Result<Box<dyn FrameSender>, CanError> {
        let path = self.out.clone().ok_or_else(|| CanError::NoOut { interface: self.interface.clone() })?;
        // A poisoned lock is harmless: the file is there or not.
        let mut created = self.created.lock().unwrap_or_else(PoisonError::into_inner);
        let out = match &*created {
            Some(out) => Arc::clone(out),
            None => {
                // An existing file is never overwritten.
                let file = File::create_new(&path).map_err(|why| CanError::Out { path, why })?;
                Arc::clone(created.insert(Arc::new(Mutex::new(file))))
            }
        };
        Ok(Box::new(LogSender { out }))
    }
}

/// Delivers frames when they are due. Until then, their stamps are times since the start of the log.
struct LogReceiver {
    frames: Receiver<Arrival>,
    /// When the first frame was asked for.
    start: Option<(Instant, Stamp)>,
    /// A frame that is not due yet.
    next: Option<Frame>,
}

impl FrameReceiver for LogReceiver {
    fn receive(&mut self, timeout: Duration) -> Option<Arrival> {
        let (began, start) = *self.start.get_or_insert_with(|| (Instant::now(), system_now()));
        let frame = match self.next.take() {
            Some(frame) => frame,
            None => match self.frames.recv_timeout(timeout) {
                Ok(Arrival::Frame(frame)) => frame,
                Ok(fault) => return Some(fault),
                Err(RecvTimeoutError::Timeout) => return None,
                Err(RecvTimeoutError::Disconnected) => {
                    std::thread::sleep(timeout);
                    return None;
                }
            },
        };
        // A frame whose time goes back is due at once.
        let due = began + Duration::from_nanos(frame.stamp.nanos().try_into().unwrap_or_default());
        let left = due.saturating_duration_since(Instant::now());
        std::thread::sleep(left.min(timeout));
        if left > timeout {
            self.next = Some(frame);
            return None;
        }
        Some(Arrival::Frame(Frame { stamp: start.shifted(frame.stamp.nanos()), ..frame }))
    }
}

/// Appends sent frames to a log.
struct LogSender {
    out: Arc<Mutex<File>>,
}

impl FrameSender for LogSender {
    fn send(&mut self, id: CanId, data: &[u8]) -> Result<(), SendFault> {
        let line = candump_line(system_now().nanos(), "out", id, data);
        // A poisoned lock is harmless: lines are written as a whole.
        let mut out = self.out.lock().unwrap_or_else(PoisonError::into_inner);
        out.write_all(line.as_bytes()).map_err(|_| SendFault::Failed)
    }
}
