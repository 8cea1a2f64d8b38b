//! An upload: from the web server's thread to a file, by a thread of its own.
//!
//! The web server hands over pieces through a short queue, so memory is bounded and a slow disk slows the sender. A queue that ends
//! without saying so was cut off, and leaves nothing.

use super::folder::Reading;
use super::refusal::{Kind, Refusal};
use super::state::{Incoming, Shelved};
use super::{About, Workshop, guarded};
use crate::error::NodeError;
use axum::body::Bytes;
use std::io::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, oneshot};

/// Pieces that wait for the disk.
const BACKLOG: usize = 8;
/// Uploads at a time.
const MOST: usize = 2;
/// How often it is said how far an upload has come.
const SAY_EVERY: Duration = Duration::from_millis(200);

/// What comes of an upload.
#[derive(Debug)]
pub enum Part {
    /// Some of it.
    Bytes(Bytes),
    /// That was all.
    End,
}

/// The sending end of an upload.
#[derive(Debug)]
pub struct Upload {
    /// Takes its parts.
    pub parts: mpsc::Sender<Part>,
    /// What became of it.
    pub kept: oneshot::Receiver<Result<About, Refusal>>,
}

/// How an upload ended.
enum Received {
    All,
    CutOff,
    TooMuch,
}

impl Workshop {
    /// Begins to take an upload that will be the run called `name`, of so many bytes where that was announced.
    ///
    /// # Errors
    /// When it announces too much, too many come in already, or no file can be made.
    pub fn take_upload(
        self: &Arc<Self>,
        name: &str,
        reading: Reading,
        of: Option<u64>,
    ) -> Result<Upload, Refusal> {
        reading.options()?;
        let limit = self.state().upload_limit_bytes;
        if of.is_some_and(|of| of > limit) {
            return Err(too_much(limit));
        }
        let mut file = self.folder.incoming(name)?;
        let (id, name) = (self.next_id(), name.to_owned());
        let incoming = Incoming { id, name: name.clone(), bytes: 0, of, opening: false };
        self.change(|state| {
            if state.uploads.len() >= MOST {
                let says = format!("{MOST} uploads come in already; wait for one of them");
                return Err(Refusal::new(Kind::Busy, says));
            }
            state.uploads.push(incoming);
            Ok(())
        })?;
        let (parts, mut queue) = mpsc::channel(BACKLOG);
        let (keep, kept) = oneshot::channel();
        let shop = Arc::clone(self);
        let begun = self.work(format!("workshop-upload-{id}"), move |_| {
            let taken = guarded(|| shop.receive(id, limit, &mut file, &mut queue));
            let kept = match taken {
                Ok(Received::All) => shop.open_upload(id, file.into_temp_path(), &name, &reading),
                // Dropped, the file is gone.
                Ok(Received::CutOff) => {
                    Err(Refusal::new(Kind::Failed, "the upload was cut off; nothing of it is kept"))
                }
                Ok(Received::TooMuch) => Err(too_much(limit)),
                Err(error) => Err(error.into()),
            };
            shop.change(|state| {
                state.uploads.retain(|incoming| incoming.id != id);
                if let Ok(about) = &kept {
                    let place = state.runs.partition_point(|run| run.name() < about.name.as_str());
                    state.runs.insert(place, Shelved::Ready(Box::new(about.clone())));
                }
            });
            // Whoever sent it may be gone.
            let _ = keep.send(kept);
        });
        begun.inspect_err(|_| self.change(|state| state.uploads.retain(|incoming| incoming.id != id)))?;
        Ok(Upload { parts, kept })
    }

    /// Writes what comes.
    fn receive(
        &self,
        id: u64,
        limit: u64,
        file: &mut impl Write,
        queue: &mut mpsc::Receiver<Part>,
    ) -> Result<Received, NodeError> {
        let (mut bytes, mut said) = (0_u64, Instant::now());
        while let Some(part) = queue.blocking_recv() {
            let Part::Bytes(part) = part else {
                file.flush().map_err(NodeError::io("writing the upload"))?;
                self.change_upload(id, |incoming| incoming.bytes = bytes);
                return Ok(Received::All);
            };
            bytes += part.len() as u64;
            if bytes > limit {
                return Ok(Received::TooMuch);
            }
            file.write_all(&part).map_err(NodeError::io("writing the upload; is there room on the disk?"))?;
            if said.elapsed() >= SAY_EVERY {
                said = Instant::now();
                self.change_upload(id, |incoming| incoming.bytes = bytes);
            }
        }
        Ok(Received::CutOff)
    }

    fn open_upload(
        &self,
        id: u64,
        path: tempfile::TempPath,
        name: &str,
        reading: &Reading,
    ) -> Result<About, Refusal> {
        self.change_upload(id, |incoming| incoming.opening = true);
        let mut kept = None;
        // The loader is given whatever somebody sends.
        guarded(|| {
            kept = Some(self.folder.keep(path, name, reading));
            Ok(())
        })?;
        kept.unwrap_or_else(|| Err(Refusal::new(Kind::Failed, "the run was not opened")))
    }

    fn change_upload(&self, id: u64, how: impl FnOnce(&mut Incoming)) {
        self.change(|state| {
            if let Some(incoming) = state.uploads.iter_mut().find(|incoming| incoming.id == id) {
                how(incoming);
            }
        });
    }
}

fn too_much(limit: u64) -> Refusal {
    let says = format!(
        "the upload is larger than {} MB, which is the most that is taken; start with a larger --upload-limit-mb, or cut the run: \
         mr-damper convert",
        limit >> 20
    );
    Refusal::new(Kind::TooMuch, says)
}
