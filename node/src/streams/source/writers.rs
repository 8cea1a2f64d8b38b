//! Tracks the publishers of an input, and detects whether samples of two publishers arrive mixed.
//!
//! When one publisher ends and another begins, this is a restart: the first does not send again. Two simultaneous
//! publishers alternate: a sample of the first, then of the second, then of the first again, all within [`TOGETHER`].

use crate::ros2::graph::Writer;
use std::time::{Duration, Instant};

/// Two publishers that alternate within this time publish simultaneously. The finding stays valid for the same time
/// after the last such sample.
const TOGETHER: Duration = Duration::from_millis(500);
/// Number of publishers that are remembered.
const REMEMBERED: usize = 4;

/// The publishers of one input, as its samples show.
#[derive(Debug, Clone, Copy, Default)]
pub struct Writers {
    /// The newest first, each with the time of its last sample.
    seen: [Option<(Writer, Instant)>; REMEMBERED],
    /// Time of the last alternation between two publishers.
    mixed: Option<Instant>,
}

impl Writers {
    /// Notes a sample of `writer` that arrived at `now`.
    pub(super) fn note(&mut self, writer: Writer, now: Instant) {
        let place = self.seen.iter().position(|seen| seen.is_some_and(|(known, _)| known == writer));
        if let Some((place, (_, last))) = place.and_then(|place| Some((place, self.seen[place]?)))
            && place > 0
            && now.saturating_duration_since(last) <= TOGETHER
        {
            self.mixed = Some(now);
        }
        self.seen[..=place.unwrap_or(REMEMBERED - 1)].rotate_right(1);
        self.seen[0] = Some((writer, now));
    }

    /// True while samples of two publishers arrive mixed.
    #[must_use]
    pub fn are_mixed(&self, now: Instant) -> bool {
        self.mixed.is_some_and(|at| now.saturating_duration_since(at) <= TOGETHER)
    }

    /// The publishers whose samples arrive mixed.
    pub fn mixed(&self, now: Instant) -> impl Iterator<Item = Writer> {
        let seen = self.seen.iter().flatten().filter(move |_| self.are_mixed(now));
        seen.filter(|(writer, _)| !self.is_followed(writer)).map(|(writer, _)| *writer)
    }

    /// The publishers that are present at `now`. `listed` are the publishers in discovery, with the names of their
    /// nodes. Discovery lists a killed publisher for up to a minute. Such a publisher is left out if it is silent while
    /// another publishes, or while a node with the same name exists again.
    #[must_use]
    pub fn present(&self, listed: Vec<(Writer, String)>, now: Instant) -> Vec<(Writer, String)> {
        let is_gone = |(writer, node): &(Writer, String)| {
            let is_back = listed.iter().any(|(other, of)| other != writer && of == node);
            self.is_followed(writer) || (is_back && self.is_silent(writer, now))
        };
        listed.iter().filter(|entry| !is_gone(entry)).cloned().collect()
    }

    /// True if a publisher fell silent while another continued.
    fn is_followed(&self, writer: &Writer) -> bool {
        self.seen[0].is_some_and(|(_, newest)| self.is_silent(writer, newest))
    }

    /// True if a publisher has sent something, but nothing lately.
    fn is_silent(&self, writer: &Writer, now: Instant) -> bool {
        let last = self.seen.iter().flatten().find(|(known, _)| known == writer);
        last.is_some_and(|(_, last)| now.saturating_duration_since(*last) > TOGETHER)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Feeds samples such as "a0 b10" (publisher and time in ms). Returns for each whether samples are mixed by then.
    fn story(samples: &str) -> (String, Writers, Instant) {
        let (start, mut writers) = (Instant::now(), Writers::default());
        let at = |sample: &str| start + Duration::from_millis(sample[1..].parse().expect("a number"));
        let mut marks = String::new();
        for sample in samples.split(' ') {
            writers.note([sample.as_bytes()[0]; 16], at(sample));
            marks.push(if writers.are_mixed(at(sample)) { 'M' } else { '-' });
        }
        (marks, writers, start)
    }

    #[test]
    fn two_alternating_publishers_are_mixed_and_a_restart_is_not() {
        assert_eq!(story("a0 a2 a4 b10 b12 b14 b16").0, "-------", "a restart");
        assert_eq!(story("a0 b1 a2 b3 a4").0, "--MMM");
        assert_eq!(story("a0 b1 c2 a3").0, "---M");
        assert_eq!(
            story("a0 b1 a2 b3 b400 b504 b600").0,
            "--MMM--",
            "for half a second after the last alternation"
        );
        assert_eq!(story("a0 b1 b600 a601 a1200 b1201").0, "------", "taking over from each other");
        assert_eq!(story("a0 b1 c2 d3 e4 f5").0, "------", "more than are remembered");
    }

    #[test]
    fn a_killed_publisher_is_replaced_by_its_successor() {
        let (_, writers, start) = story("a0 a2 b300 b400 b503");
        assert!(writers.is_followed(&[b'a'; 16]) && !writers.is_followed(&[b'b'; 16]));
        assert!(!writers.is_followed(&[b'c'; 16]), "a publisher that has sent nothing cannot be replaced");
        let present = |of: &[(u8, &str)], ms: u64| {
            let listed = of.iter().map(|(writer, node)| ([*writer; 16], (*node).to_owned())).collect();
            let there = writers.present(listed, start + Duration::from_millis(ms));
            there.iter().map(|(writer, _)| char::from(writer[0])).collect::<String>()
        };
        assert_eq!(present(&[(b'a', "/one"), (b'b', "/two"), (b'c', "/three")], 503), "bc");
        assert_eq!(present(&[(b'b', "/two"), (b'c', "/two")], 900), "bc");
        assert_eq!(
            present(&[(b'b', "/two"), (b'c', "/two")], 1100),
            "c",
            "killed, and its successor has not sent yet"
        );
        assert_eq!(
            present(&[(b'b', "/two"), (b'c', "/three")], 1100),
            "bc",
            "two different nodes, both present"
        );
        assert_eq!(writers.mixed(start + Duration::from_millis(503)).count(), 0);
        let (_, writers, start) = story("a0 b1 a2 b3");
        let mixed: Vec<_> = writers.mixed(start + Duration::from_millis(3)).collect();
        assert_eq!(mixed, [[b'b'; 16], [b'a'; 16]]);
        assert_eq!(writers.mixed(start + Duration::from_secs(3)).count(), 0);
    }
}
