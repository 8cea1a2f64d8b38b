//! A log of frames that is played as a bus: `file:drive.log[,bus=can1][,out=sent.log]`.
//!
//! Frames arrive with the spacing that they have in the log, and their stamps have exactly this spacing, so estimates equal the
//! offline ones. Sent frames are written to the log `out`, as candump writes them. Dampers of one process may name the same log `out`; it
//! then has the frames of all, line by line. A thread reads the log ahead, so it may be of any length.

use super::{Arrival, BusFault, CanBus, CanError, Frame, FrameReceiver, FrameSender, SendFault};
use mr_damper_base::clock::system_now;
use mr_damper_model::sample::Stamp;
use mr_damper_runs::bus::{CanId, FrameFilter, candump_line, read_log};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};

/// Frames that are read ahead.
const AHEAD: usize = 1024;

/// The logs of sent frames that this process writes, by their absolute paths.
static WRITTEN: Mutex<BTreeMap<PathBuf, Weak<File>>> = Mutex::new(BTreeMap::new());

/// The log of sent frames at `path`: a new file, or the one that another bus of this process has created and still writes.
///
/// # Errors
/// When the file cannot be created. An existing file is never overwritten.
fn written(path: &str) -> io::Result<Arc<File>> {
    let key = std::path::absolute(path)?;
    // A poisoned lock is harmless: an entry is there or not.
    let mut all = WRITTEN.lock().unwrap_or_else(PoisonError::into_inner);
    all.retain(|_, file| file.strong_count() > 0);
    if let Some(file) = all.get(&key).and_then(Weak::upgrade) {
        return Ok(file);
    }
    // The system appends each line as a whole, so senders need no lock.
    let file = Arc::new(File::options().append(true).create_new(true).open(path)?);
    all.insert(key, Arc::downgrade(&file));
    Ok(file)
}

/// A log to play, and a log to write.
pub(super) struct LogBus {
    interface: String,
    path: PathBuf,
    bus: Option<String>,
    /// Path of the log of sent frames.
    out: Option<String>,
    /// That log, once the first sender has created it.
    created: Mutex<Option<Arc<File>>>,
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
    fn receiver(&self, wanted: &[FrameFilter]) -> Result<Box<dyn FrameReceiver>, CanError> {
        let (sender, frames) = sync_channel(AHEAD);
        let (path, bus, wanted) = (self.path.clone(), self.bus.clone(), wanted.to_vec());
        let read = move || {
            let mut first = None;
            let done = read_log(&path, bus.as_deref(), |frame| {
                // The first frame of the log is its start, whatever message it is.
                let start = *first.get_or_insert(frame.nanos);
                if wanted.iter().any(|filter| filter.passes(frame.id))
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
                let file = written(&path).map_err(|why| CanError::Out { path, why })?;
                Arc::clone(created.insert(file))
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
    out: Arc<File>,
}

impl FrameSender for LogSender {
    fn send(&mut self, id: CanId, data: &[u8]) -> Result<(), SendFault> {
        let line = candump_line(system_now().nanos(), "out", id, data);
        (&*self.out).write_all(line.as_bytes()).map_err(|_| SendFault::Failed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_buses_of_a_process_write_one_log_line_by_line() {
        let dir = tempfile::tempdir().expect("a directory");
        let path = |name: &str| dir.path().join(name).display().to_string();
        let (played, out) = (path("drive.log"), path("sent.log"));
        std::fs::write(&played, "(0.000000000) can0 120#00\n").expect("written");
        let bus = |out: &str| LogBus::new("file:x", &format!("{played},out={out}")).expect("a bus");
        // The same file by two spellings.
        let buses = [bus(&out), bus(&path("./sent.log"))];
        let mut senders = buses.each_ref().map(|bus| bus.sender().expect("the log is created or shared"));
        let lines = 500;
        std::thread::scope(|scope| {
            for (sender, id) in senders.iter_mut().zip([0x121, 0x122]) {
                scope.spawn(move || {
                    let id = CanId::new(id, false).expect("in range");
                    (0..lines).for_each(|_| sender.send(id, &[7; 64]).expect("sent"));
                });
            }
        });
        let text = std::fs::read_to_string(&out).expect("sent frames");
        for id in ["121", "122"] {
            let ending = format!(" out {id}##1{}", "07".repeat(64));
            assert_eq!(text.lines().filter(|line| line.ends_with(&ending)).count(), lines, "{id}");
        }
        assert_eq!(text.lines().count(), 2 * lines);
        // A log that nobody writes any more is not continued.
        drop((senders, buses));
        let error = bus(&out).sender().map(drop).expect_err("it exists").to_string();
        assert!(
            error.contains(&format!("cannot create {out}: ")) && error.contains("does not exist yet"),
            "{error}"
        );
        assert_eq!(std::fs::read_to_string(&out).expect("unchanged"), text);
    }
}
