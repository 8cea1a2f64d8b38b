//! Uploads: a separate thread writes the data received by the web server to a file.
//!
//! The web server passes the data through a short queue, so memory is bounded and a slow disk slows the sender. A queue that
//! closes without [`Part::End`] means that the upload was cut off; then nothing is kept.

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

/// Maximum number of pieces that wait to be written.
const BACKLOG: usize = 8;
/// Maximum number of simultaneous uploads.
const MOST: usize = 2;
/// Interval at which the progress is updated.
const SAY_EVERY: Duration = Duration::from_millis(200);

/// A part of an upload.
#[derive(Debug)]
pub enum Part {
    /// The next bytes.
    Bytes(Bytes),
    /// The end of the upload.
    End,
}

/// The sending end of an upload.
#[derive(Debug)]
pub struct Upload {
    /// Queue for the parts of the upload.
    pub parts: mpsc::Sender<Part>,
    /// Result of the upload.
    pub kept: oneshot::Receiver<Result<About, Refusal>>,
}

/// How receiving an upload ended.
enum Received {
    All,
    CutOff,
    TooMuch,
}

impl Workshop {
    /// Starts an upload that will become the run named `name`. `of` is its announced size in bytes, if known.
    ///
    /// # Errors
    /// When the announced size is too large, too many uploads are running, or the file cannot be created.
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
                let says = format!("{MOST} uploads are running already; wait until one of them has ended");
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
                // Dropping the file deletes it.
                Ok(Received::CutOff) => {
                    Err(Refusal::new(Kind::Failed, "the upload was cut off and is not kept"))
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
            // The sender may have disconnected.
            let _ = keep.send(kept);
        });
        begun.inspect_err(|_| self.change(|state| state.uploads.retain(|incoming| incoming.id != id)))?;
        Ok(Upload { parts, kept })
    }

    /// Writes the received data to the file.
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
        // Guarded, because the loader reads arbitrary data here.
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
        "the upload is larger than the limit of {} MB; restart the server with a larger --upload-limit-mb, or shorten the run \
         (mr-damper convert)",
        limit >> 20
    );
    Refusal::new(Kind::TooMuch, says)
}
