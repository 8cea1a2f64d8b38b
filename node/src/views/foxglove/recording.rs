//! Plays a recording to the viewers of the Foxglove endpoint, with its own times.

use crate::settings::interrupt::Interrupt;
use crate::streams::player::{Control, Keys, Next, PlaybackOptions, Timing};
use mr_damper_model::sample::Stamp;
use mr_damper_runs::Recording;
use mr_damper_views::foxglove::{ChannelId, Channels};
use std::time::Duration;

/// How often it is checked whether a viewer has subscribed.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// A recording, and its channels.
pub struct PlayedRecording<'a> {
    recording: &'a Recording,
    channels: &'a Channels,
    /// The channel of each topic.
    ids: Vec<ChannelId>,
}

impl<'a> PlayedRecording<'a> {
    /// Adds the topics of `recording` to `channels`.
    #[must_use]
    pub fn new(recording: &'a Recording, channels: &'a Channels) -> Self {
        let ids = recording.topics().iter().map(|(name, of)| channels.add(name, *of)).collect();
        Self { recording, channels, ids }
    }

    /// Plays the part that `options` select, with the recorded times; returns the number of messages. `at` is called with the number of
    /// seconds played so far.
    pub fn play(
        &self,
        options: &PlaybackOptions,
        control: &Control,
        interrupt: &Interrupt,
        keys: Option<&Keys>,
        at: &dyn Fn(f64),
    ) -> u64 {
        let Some((first, last)) = self.recording.range() else { return 0 };
        control.begin(options.rate, (first, last));
        let mut timing = Timing::new(control, options.rate, options.start, interrupt, keys);
        let end_s = options.duration.map_or(f64::INFINITY, |duration| options.start + duration);
        let (mut played, mut told): (u64, Option<Stamp>) = (0, None);
        for message in self.recording.messages() {
            let at_s = message.log_time.since(first).get();
            if at_s < options.start {
                continue;
            }
            // Nobody but the keyboard controls this player, and it has no key that jumps.
            if at_s >= end_s || timing.next(first, at_s, |_, _| LOOK_EVERY) != Next::Play {
                break;
            }
            // A viewer assigns to a message the last time that it received.
            if told != Some(message.log_time) {
                self.channels.publish_time(message.log_time.nanos());
                told = Some(message.log_time);
            }
            self.channels.publish(self.ids[message.topic], message.log_time.nanos(), message.cdr);
            timing.played(at_s);
            played += 1;
            at((at_s - options.start).max(0.0));
        }
        control.end();
        played
    }
}

/// Waits until a viewer has subscribed to a channel; false after `timeout`, or on a signal.
pub fn wait_for_viewer(channels: &Channels, timeout: Option<Duration>, interrupt: &Interrupt) -> bool {
    let deadline = timeout.map(|timeout| std::time::Instant::now() + timeout);
    while channels.subscribers() == 0 {
        if deadline.is_some_and(|at| std::time::Instant::now() >= at)
            || !interrupt.sleep_until(std::time::Instant::now() + LOOK_EVERY)
        {
            return false;
        }
    }
    // A viewer subscribes to its topics one after the other.
    interrupt.sleep_until(std::time::Instant::now() + Duration::from_millis(300))
}
