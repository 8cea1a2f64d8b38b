//! The frame (`frame_id`) of a damper's outputs. It is the frame of the displacement, as the message definitions
//! promise.
//!
//! The rings carry samples as plain numbers, so the frame is shared separately: the source stores the frame of the
//! newest displacement, and each sink reads it when it writes a header. Displacement without a frame (an empty one, or
//! a `Float64`) leaves the sink's own default.

use std::sync::{Arc, PoisonError, RwLock};

/// Longest frame that is accepted, bytes: it is copied into the header of every output.
const LONGEST: usize = 255;

/// The frame of one damper's outputs. Clones share the received frame.
#[derive(Debug, Clone)]
pub struct Frame {
    default: Arc<str>,
    latest: Arc<RwLock<Option<Arc<str>>>>,
}

impl Frame {
    /// The frame `default`, until a displacement has another one.
    #[must_use]
    pub fn new(default: &str) -> Self {
        Self { default: default.into(), latest: Arc::default() }
    }

    /// The same frame with another default.
    #[must_use]
    pub fn with_default(&self, default: &str) -> Self {
        Self { default: default.into(), latest: Arc::clone(&self.latest) }
    }

    /// Takes the frame of a displacement. An empty one, or one of more than 255 bytes, selects the default.
    pub fn observe(&self, frame_id: &str) {
        let new = Some(frame_id).filter(|frame| (1..=LONGEST).contains(&frame.len()));
        // A poisoned lock is harmless: frames are replaced as a whole.
        if self.latest.read().unwrap_or_else(PoisonError::into_inner).as_deref() != new {
            *self.latest.write().unwrap_or_else(PoisonError::into_inner) = new.map(Arc::from);
        }
    }

    /// The frame at present.
    #[must_use]
    pub fn get(&self) -> Arc<str> {
        let latest = self.latest.read().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(latest.as_ref().unwrap_or(&self.default))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_displacement_sets_the_frame_and_an_empty_one_selects_the_default() {
        let frame = Frame::new("front_left");
        let of_mirror = frame.with_default("mr_damper");
        assert_eq!((&*frame.get(), &*of_mirror.get()), ("front_left", "mr_damper"));
        frame.observe("rod");
        assert_eq!((&*frame.get(), &*of_mirror.get()), ("rod", "rod"));
        frame.observe("");
        assert_eq!((&*frame.get(), &*of_mirror.get()), ("front_left", "mr_damper"));
        frame.observe(&"a".repeat(LONGEST + 1));
        assert_eq!(&*frame.get(), "front_left", "an overlong frame selects the default");
    }
}
