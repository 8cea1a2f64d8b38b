//! Limits the log lines about messages that cannot be used.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Minimum time between two log lines about one topic, as for samples that the pipeline refuses.
const LOG_EVERY: Duration = Duration::from_secs(1);

/// The messages that could not be used, by topic.
#[derive(Debug, Default)]
pub(super) struct UnusableMessages(BTreeMap<String, TopicCount>);

#[derive(Debug)]
struct TopicCount {
    messages: u64,
    last_line: Instant,
}

impl UnusableMessages {
    /// Counts a message of `topic`. Returns the number of such messages of the topic so far if a log line is due: at the first message, then
    /// at most once per [`LOG_EVERY`].
    pub(super) fn note(&mut self, topic: &str, now: Instant) -> Option<u64> {
        if let Some(count) = self.0.get_mut(topic) {
            count.messages += 1;
            let is_due = now.saturating_duration_since(count.last_line) >= LOG_EVERY;
            return is_due.then(|| {
                count.last_line = now;
                count.messages
            });
        }
        self.0.insert(topic.to_owned(), TopicCount { messages: 1, last_line: now });
        Some(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_message_of_a_topic_is_logged_at_once_then_one_per_second() {
        let start = Instant::now();
        let at = |millis: u64| start + Duration::from_millis(millis);
        let mut unusable = UnusableMessages::default();
        assert_eq!(unusable.note("/displacement", at(0)), Some(1));
        assert_eq!(unusable.note("/displacement", at(1)), None);
        assert_eq!(unusable.note("/velocity", at(2)), Some(1), "each topic has its own count");
        assert_eq!(unusable.note("/displacement", at(999)), None);
        assert_eq!(unusable.note("/displacement", at(1000)), Some(4));
        assert_eq!(unusable.note("/displacement", at(1999)), None);
        assert_eq!(unusable.note("/displacement", at(2000)), Some(6));
    }
}
