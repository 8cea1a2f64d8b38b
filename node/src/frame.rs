//! The frame of a damper's outputs. It is the frame of the displacement, as the messages promise.
//!
//! Samples are plain numbers on their way through the rings, so the frame goes beside them: the source says what the
//! newest displacement bears, and each sink reads it when it writes a header. Displacement without a frame (an empty
//! one, or a `Float64`) leaves the sink's own default.

use std::sync::{Arc, PoisonError, RwLock};

/// Longest frame that is taken over, in bytes: it is copied into the header of every output.
const LONGEST: usize = 255;

/// The frame of one damper's outputs. Clones share what the source has heard.
#[derive(Debug, Clone)]
pub struct Frame {
    default: Arc<str>,
    heard: Arc<RwLock<Option<Arc<str>>>>,
}

impl Frame {
    /// The frame `default`, until displacement bears another.
    #[must_use]
    pub fn new(default: &str) -> Self {
        Self { default: default.into(), heard: Arc::default() }
    }

    /// The same frame with another default.
    #[must_use]
    pub fn with_default(&self, default: &str) -> Self {
        Self { default: default.into(), heard: Arc::clone(&self.heard) }
    }

    /// Takes over the frame of a displacement. An empty one means the default, and so does one of more than 255 bytes.
    pub fn hear(&self, frame_id: &str) {
        let new = Some(frame_id).filter(|frame| (1..=LONGEST).contains(&frame.len()));
        // A poisoned lock only means that a thread panicked between two whole frames.
        if self.heard.read().unwrap_or_else(PoisonError::into_inner).as_deref() != new {
            *self.heard.write().unwrap_or_else(PoisonError::into_inner) = new.map(Arc::from);
        }
    }

    /// The frame at present.
    #[must_use]
    pub fn get(&self) -> Arc<str> {
        let heard = self.heard.read().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(heard.as_ref().unwrap_or(&self.default))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_displacement_says_the_frame_and_an_empty_one_leaves_the_default() {
        let frame = Frame::new("front_left");
        let of_mirror = frame.with_default("mr_damper");
        assert_eq!((&*frame.get(), &*of_mirror.get()), ("front_left", "mr_damper"));
        frame.hear("rod");
        assert_eq!((&*frame.get(), &*of_mirror.get()), ("rod", "rod"));
        frame.hear("");
        assert_eq!((&*frame.get(), &*of_mirror.get()), ("front_left", "mr_damper"));
        frame.hear(&"a".repeat(LONGEST + 1));
        assert_eq!(&*frame.get(), "front_left", "a header does not grow without end");
    }
}
