//! Samples that another thread has received: they pass through a bounded queue to the source thread, which sorts them among the samples
//! of all inputs.

use super::input::Number;
use super::stamp::SampleOrigin;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// Samples that can wait for the source thread: a second of four inputs at 1 kHz. Further samples are refused and
/// counted.
const WAITING: usize = 4096;

/// A number that arrived for an input.
#[derive(Debug, Clone, PartialEq)]
pub struct QueuedInput {
    /// Index of the input topic.
    pub(super) input: usize,
    pub(super) number: Number,
    pub(super) origin: SampleOrigin,
}

/// A queue to the source thread. Each thread that receives samples has one of its own.
#[must_use]
pub fn queue() -> (SyncSender<QueuedInput>, Receiver<QueuedInput>) {
    sync_channel(WAITING)
}
