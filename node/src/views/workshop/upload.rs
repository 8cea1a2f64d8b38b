//! Uploads: a separate thread writes the data received by the web server to a file.
//!
//! The web server passes the data through a short queue, so memory is bounded and a slow disk slows the sender. A queue that
//! closes without [`UploadPart::End`] means that the upload was cut off; then nothing is kept.

use super::folder::{loader_options, run_name};
use super::{Workshop, catch_panic};
use crate::settings::error::NodeError;
use mr_damper_views::workshop::{
    About, ReadOptions, Refusal, RefusalKind, StoredRun, Upload, UploadPart, UploadProgress,
};
use std::io::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, oneshot};

/// Maximum number of pieces that wait to be written.
const BACKLOG: usize = 8;
/// Maximum number of simultaneous uploads.
const MOST: usize = 2;
/// Interval at which the progress is updated.
const REPORT_EVERY: Duration = Duration::from_millis(200);

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
    /// When the name is not the name of a run, the announced size is too large, too many uploads are running, or the file cannot be
    /// created.
    pub fn take_upload(
        self: &Arc<Self>,
        name: &str,
        options: ReadOptions,
        of: Option<u64>,
    ) -> Result<Upload, Refusal> {
        let name = &run_name(name)?;
        loader_options(&options)?;
        let limit = self.state().upload_limit_bytes;
        if of.is_some_and(|of| of > limit) {
            return Err(too_much(limit));
        }
        let mut file = self.folder.incoming(name)?;
        let (id, name) = (self.next_id(), name.to_owned());
        let progress = UploadProgress { id, name: name.clone(), bytes: 0, of, opening: false };
        self.change(|state| {
            if state.uploads.len() >= MOST {
                let says = format!("{MOST} uploads are running already; wait until one of them has ended");
                return Err(Refusal::new(RefusalKind::Busy, says));
            }
            state.uploads.push(progress);
            Ok(())
        })?;
        let (parts, mut queue) = mpsc::channel(BACKLOG);
        let (keep, kept) = oneshot::channel();
        let workshop = Arc::clone(self);
        let begun = self.spawn(format!("workshop-upload-{id}"), move |_| {
            let taken = catch_panic(|| workshop.receive(id, limit, &mut file, &mut queue));
            let kept = match taken {
                Ok(Received::All) => workshop.open_upload(id, file.into_temp_path(), &name, &options),
                // Dropping the file deletes it.
                Ok(Received::CutOff) => {
                    Err(Refusal::new(RefusalKind::Failed, "the upload was cut off and is not kept"))
                }
                Ok(Received::TooMuch) => Err(too_much(limit)),
                Err(error) => Err(error.into()),
            };
            workshop.change(|state| {
                state.uploads.retain(|upload| upload.id != id);
                if let Ok(about) = &kept {
                    let place = state.runs.partition_point(|run| run.name() < about.name.as_str());
                    state.runs.insert(place, StoredRun::Ready(Box::new(about.clone())));
                }
            });
            // The sender may have disconnected.
            let _ = keep.send(kept);
        });
        begun.inspect_err(|_| self.change(|state| state.uploads.retain(|upload| upload.id != id)))?;
        Ok(Upload { parts, kept })
    }

    /// Writes the received data to the file.
    fn receive(
        &self,
        id: u64,
        limit: u64,
        file: &mut impl Write,
        queue: &mut mpsc::Receiver<UploadPart>,
    ) -> Result<Received, NodeError> {
        let (mut bytes, mut reported) = (0_u64, Instant::now());
        while let Some(part) = queue.blocking_recv() {
            let UploadPart::Bytes(part) = part else {
                file.flush().map_err(NodeError::io("writing the upload"))?;
                self.change_upload(id, |upload| upload.bytes = bytes);
                return Ok(Received::All);
            };
            bytes += part.len() as u64;
            if bytes > limit {
                return Ok(Received::TooMuch);
            }
            file.write_all(&part).map_err(NodeError::io("writing the upload; is there room on the disk?"))?;
            if reported.elapsed() >= REPORT_EVERY {
                reported = Instant::now();
                self.change_upload(id, |upload| upload.bytes = bytes);
            }
        }
        Ok(Received::CutOff)
    }

    fn open_upload(
        &self,
        id: u64,
        path: tempfile::TempPath,
        name: &str,
        options: &ReadOptions,
    ) -> Result<About, Refusal> {
        self.change_upload(id, |upload| upload.opening = true);
        let mut kept = None;
        // Panics are caught, because the loader reads arbitrary data here.
        catch_panic(|| {
            kept = Some(self.folder.keep(path, name, options));
            Ok(())
        })?;
        kept.unwrap_or_else(|| Err(Refusal::new(RefusalKind::Failed, "the run was not opened")))
    }

    fn change_upload(&self, id: u64, how: impl FnOnce(&mut UploadProgress)) {
        self.change(|state| {
            if let Some(upload) = state.uploads.iter_mut().find(|upload| upload.id == id) {
                how(upload);
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
    Refusal::new(RefusalKind::TooMuch, says)
}
