//! Stamps for samples that arrive without one: a `Float64`, or a zero in the header. They get the time of sending.
//!
//! The middleware transmits that time with each message (`INFO_TS` in DDS, the attachment on rmw_zenoh). The time at
//! which the node polls for messages cannot be used: all messages of one poll would get the same stamp, and the
//! pipeline refuses repeated stamps.
//!
//! | the node's clock | the stamp of a sample |
//! |---|---|
//! | the system's | the time of sending |
//! | simulated | the previous stamp, plus the time between the two sendings at the rate of the simulation; near `/clock` |
//! | simulated, before the first `/clock` | none: the sample has no time, so it cannot be used |
//!
//! The time of sending is the one given by the publisher's middleware. If it is missing, or off by more than
//! [`CLOCK_OFF_S`] (a computer whose clock was never set), the time of reception is used instead. A smaller offset is
//! accepted, as for stamps in headers: samples from the past are flagged as late.
//!
//! Stamps of one channel never repeat as long as its publisher's clock does not go back: an equal stamp becomes one
//! nanosecond later.

use crate::ros2::graph::Writer;
use mr_damper_model::sample::Stamp;

/// Largest accepted offset of a publisher's clock, s. No network delays a sample for so long.
const CLOCK_OFF_S: f64 = 60.0;

/// Longest tick of `/clock`, ns. A longer one means that the time was set.
const LONGEST_TICK_NS: i64 = 10_000_000_000;
/// Assumed length of the first tick, ns.
const FIRST_TICK_NS: i64 = 100_000_000;
/// Number of ticks that a stamp may be ahead of `/clock`: on a busy computer, samples and ticks arrive unevenly.
const AHEAD: i64 = 3;
/// Number of ticks that a stamp may be behind: the node may have been unable to take waiting samples.
const BEHIND: i64 = 100;
/// Weight of a new tick in the estimated rate of the simulation.
const NEWEST: f64 = 0.2;
/// Divisor of the correction towards a new tick: a stamp moves by 1/8 of its distance. The correction is small, because
/// messages and ticks can arrive in either order.
const DRAWN: i64 = 8;

/// Data of the middleware about a message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SampleOrigin {
    /// The message's publisher.
    pub(super) writer: Writer,
    /// Time of sending by the publisher's clock, ns.
    pub(super) sent_ns: Option<i64>,
    /// Time of reception by this host's middleware, ns.
    pub(super) arrived_ns: i64,
}

/// The time of one polling round by both clocks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Times {
    /// By the system's clock.
    pub(super) wall: Stamp,
    /// By the node's clock.
    pub(super) node: NodeTime,
}

/// The time of the node's clock.
#[derive(Debug, Clone, Copy)]
pub(super) enum NodeTime {
    /// The node uses the system's clock.
    System,
    /// The node follows `/clock`, on which nothing has arrived yet.
    Awaited,
    /// The time of `/clock`.
    Simulated(Simulated),
}

/// Simulated time and its rate.
#[derive(Debug, Clone, Copy)]
pub(super) struct Simulated {
    now: Stamp,
    /// Number of times that the time was set or went back.
    epoch: u64,
    /// Length of the last tick, ns; `None` if the time was set.
    step_ns: Option<i64>,
    /// Simulated seconds per second of the system's time.
    rate: f64,
}

impl Simulated {
    /// A time without a preceding tick.
    const fn set(now: Stamp, epoch: u64) -> Self {
        Self { now, epoch, step_ns: None, rate: 1.0 }
    }
}

/// The ticks of `/clock`.
#[derive(Debug, Default)]
pub(super) struct Ticks {
    last: Option<(Simulated, i64)>,
    epoch: u64,
}

impl Ticks {
    /// Takes a tick that was sent at `sent_ns` of the system's time.
    pub(super) fn observe(&mut self, now: Stamp, sent_ns: i64) {
        if self.last.is_some_and(|(before, _)| before.now == now) {
            return;
        }
        let tick = self.last.and_then(|(before, before_ns)| {
            let step_ns = now.nanos().checked_sub(before.now.nanos())?;
            let passed_ns = sent_ns.saturating_sub(before_ns).max(1);
            let rate = step_ns as f64 / passed_ns as f64;
            let rate = before.step_ns.map_or(rate, |_| before.rate + NEWEST * (rate - before.rate));
            let tick = Simulated { now, epoch: self.epoch, step_ns: Some(step_ns), rate };
            (1..=LONGEST_TICK_NS).contains(&step_ns).then_some(tick)
        });
        if tick.is_none() {
            self.epoch += 1;
        }
        self.last = Some((tick.unwrap_or(Simulated::set(now, self.epoch)), sent_ns));
    }

    /// Simulated time and its rate at `now`, the last tick.
    pub(super) fn at(&self, now: Stamp) -> Simulated {
        let of_now = self.last.map(|(tick, _)| tick).filter(|tick| tick.now == now);
        of_now.unwrap_or(Simulated::set(now, self.epoch))
    }
}

/// Stamps the samples of one channel.
#[derive(Debug, Default)]
pub(super) struct Stamper {
    /// Time of sending of the last sample, ns, and the stamp that it got.
    last: Option<(i64, Stamp)>,
    /// The epoch and the tick of simulated time at which it was received.
    tick: Option<(u64, Stamp)>,
    /// True once the log says that the publisher's clock is off.
    said_off: bool,
}

impl Stamper {
    /// The stamp for a sample of `topic` that arrived without one. `None` before the first `/clock`.
    pub(super) fn stamp(&mut self, topic: &str, origin: &SampleOrigin, times: &Times) -> Option<Stamp> {
        let sent_ns = self.sent_ns(topic, origin, times.wall);
        let stamp = match times.node {
            NodeTime::Awaited => return None,
            NodeTime::Simulated(simulated) => self.near_tick(sent_ns, simulated),
            NodeTime::System => {
                if self.tick.take().is_some() {
                    self.last = None;
                }
                Stamp::from_nanos(sent_ns)
            }
        };
        let stamp = match self.last {
            Some((before_ns, last)) if stamp <= last && sent_ns >= before_ns => last.shifted(1),
            _ => stamp,
        };
        self.last = Some((sent_ns, stamp));
        Some(stamp)
    }

    /// The time of sending of a sample, ns, or the time of reception if the former is not credible.
    fn sent_ns(&mut self, topic: &str, origin: &SampleOrigin, wall: Stamp) -> i64 {
        let Some(sent_ns) = origin.sent_ns else { return origin.arrived_ns };
        let off_s = wall.since(Stamp::from_nanos(sent_ns)).get();
        if off_s.abs() <= CLOCK_OFF_S {
            self.said_off = false;
            return sent_ns;
        }
        if !self.said_off {
            self.said_off = true;
            tracing::warn!(
                topic,
                off_s,
                "the clock of its publisher is off, so its samples are stamped on arrival; set that computer's clock (NTP, PTP)"
            );
        }
        origin.arrived_ns
    }

    fn near_tick(&mut self, sent_ns: i64, simulated: Simulated) -> Stamp {
        let Simulated { now, epoch, step_ns, rate } = simulated;
        let before = self.tick.replace((epoch, now));
        if before.is_none_or(|(of, _)| of != epoch) {
            // Earlier samples are useless after the time went back or was set.
            self.last = None;
        }
        let Some((before_ns, last)) = self.last else { return now };
        let passed_ns = sent_ns.saturating_sub(before_ns) as f64 * rate;
        let mut stamp = last.shifted(passed_ns as i64);
        if before != Some((epoch, now)) {
            stamp = stamp.shifted(now.nanos().saturating_sub(stamp.nanos()) / DRAWN);
        }
        let step_ns = step_ns.unwrap_or(FIRST_TICK_NS);
        stamp.clamp(now.shifted(-BEHIND * step_ns), now.shifted(AHEAD * step_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW_NS: i64 = 1_700_000_000_000_000_000;

    fn origin(sent_ns: Option<i64>, arrived_ns: i64) -> SampleOrigin {
        SampleOrigin { writer: [1; 16], sent_ns, arrived_ns }
    }

    /// The stamps of samples with these times of sending and reception, polled at one time; in ns after `NOW_NS`.
    fn stamps(samples: &[(Option<i64>, i64)]) -> Vec<i64> {
        let mut stamper = Stamper::default();
        let times = Times { wall: Stamp::from_nanos(NOW_NS + 5_000_000), node: NodeTime::System };
        let stamp = |(sent, arrived): &(Option<i64>, i64)| {
            let origin = origin(sent.map(|ns| NOW_NS + ns), NOW_NS + arrived);
            stamper.stamp("displacement", &origin, &times).expect("a stamp").nanos() - NOW_NS
        };
        samples.iter().map(stamp).collect()
    }

    #[test]
    fn a_sample_is_stamped_when_it_was_sent() {
        assert_eq!(stamps(&[(Some(10), 900), (Some(2_000), 901), (Some(3_000), 4_000)]), [10, 2_000, 3_000]);
    }

    #[test]
    fn stamps_do_not_repeat_if_the_senders_clock_is_coarse() {
        assert_eq!(
            stamps(&[(Some(0), 1), (Some(0), 2), (Some(0), 3), (Some(1), 4), (Some(9), 5)]),
            [0, 1, 2, 3, 9]
        );
    }

    #[test]
    fn stamps_follow_a_senders_clock_that_goes_back() {
        assert_eq!(stamps(&[(Some(1_000), 1), (Some(500), 2), (Some(600), 3)]), [1_000, 500, 600]);
    }

    #[test]
    fn a_sample_without_a_time_of_sending_gets_the_time_of_reception() {
        assert_eq!(stamps(&[(None, 10), (None, 10), (None, 25)]), [10, 11, 25]);
    }

    #[test]
    fn a_clock_that_was_never_set_is_not_used_but_a_late_one_is() {
        const MINUTE_NS: i64 = 60_000_000_000;
        let [before, after] = [-NOW_NS + 7, 2 * MINUTE_NS];
        assert_eq!(
            stamps(&[(Some(before), 10), (Some(before + 1), 20)]),
            [10, 20],
            "since the computer was switched on"
        );
        assert_eq!(stamps(&[(Some(after), 10), (Some(after + 5), 20)]), [10, 20], "in the future");
        assert_eq!(stamps(&[(Some(-MINUTE_NS / 2), 10)]), [-MINUTE_NS / 2]);
    }

    /// Stamps of samples, one each millisecond, during three ticks of `step_ms` every `every_ms`; in ms after the first
    /// tick.
    fn in_ticks(step_ms: i64, every_ms: i64) -> Vec<f64> {
        let (mut ticks, mut stamper) = (Ticks::default(), Stamper::default());
        let at = |ms: i64| NOW_NS + ms * 1_000_000;
        ticks.observe(Stamp::from_nanos(1_000_000_000 - step_ms * 1_000_000), at(-every_ms));
        let mut stamps = Vec::new();
        for ms in 0..3 * every_ms {
            if ms % every_ms == 0 {
                let tick = Stamp::from_nanos(1_000_000_000 + ms / every_ms * step_ms * 1_000_000);
                ticks.observe(tick, at(ms));
            }
            let now = Stamp::from_nanos(1_000_000_000 + ms / every_ms * step_ms * 1_000_000);
            let times =
                Times { wall: Stamp::from_nanos(at(ms + 1)), node: NodeTime::Simulated(ticks.at(now)) };
            let stamp =
                stamper.stamp("displacement", &origin(Some(at(ms)), at(ms)), &times).expect("a stamp");
            stamps.push((stamp.nanos() - 1_000_000_000) as f64 * 1e-6);
        }
        stamps
    }

    #[test]
    fn samples_within_a_tick_of_simulated_time_are_spread_at_its_rate() {
        let whole: Vec<f64> = (0..12).map(f64::from).collect();
        assert_eq!(in_ticks(4, 4), whole);
        let half: Vec<f64> = whole.iter().map(|ms| ms * 0.5).collect();
        assert_eq!(in_ticks(2, 4), half);
        let double: Vec<f64> = whole.iter().map(|ms| ms * 2.0).collect();
        assert_eq!(in_ticks(8, 4), double);
    }

    #[test]
    fn a_sample_before_the_first_simulated_time_has_no_stamp_and_leaves_no_trace() {
        let mut stamper = Stamper::default();
        let mut stamp = |ms: i64, node| {
            let sent_ns = NOW_NS + ms * 1_000_000;
            let times = Times { wall: Stamp::from_nanos(sent_ns), node };
            stamper.stamp("displacement", &origin(Some(sent_ns), sent_ns), &times)
        };
        assert_eq!(stamp(0, NodeTime::Awaited), None);
        let mut ticks = Ticks::default();
        ticks.observe(Stamp::from_nanos(0), NOW_NS + 500_000);
        let tick = NodeTime::Simulated(ticks.at(Stamp::from_nanos(0)));
        assert_eq!(stamp(1, tick), Some(Stamp::from_nanos(0)));
        assert_eq!(stamp(2, tick), Some(Stamp::from_nanos(1_000_000)));
    }

    #[test]
    fn no_sample_is_lost_when_simulated_time_stands_still_or_goes_back() {
        let mut stamper = Stamper::default();
        let tick = |s: i64| Stamp::from_nanos(s * 1_000_000_000);
        let mut ticks = Ticks::default();
        ticks.observe(tick(9), NOW_NS);
        ticks.observe(tick(10), NOW_NS + 1_000_000_000);
        let mut stamp = |now: Stamp, ms: i64, ticks: &Ticks| {
            let sent_ns = NOW_NS + ms * 1_000_000;
            let times = Times { wall: Stamp::from_nanos(sent_ns), node: NodeTime::Simulated(ticks.at(now)) };
            stamper.stamp("displacement", &origin(Some(sent_ns), sent_ns), &times).expect("a stamp")
        };
        let stood: Vec<Stamp> = (0..5).map(|s| stamp(tick(10), 1000 + s * 1000, &ticks)).collect();
        assert!(stood.is_sorted_by(|a, b| a < b), "{stood:?}");
        assert_eq!(stood[1..], [tick(11), tick(12), tick(13), tick(13).shifted(1)]);
        ticks.observe(tick(1), NOW_NS + 7_000_000_000);
        assert_eq!(stamp(tick(1), 7001, &ticks), tick(1), "time went back");
        ticks.observe(tick(2), NOW_NS + 8_000_000_000);
        ticks.observe(tick(1), NOW_NS + 9_000_000_000);
        assert_eq!(
            stamp(tick(1), 9001, &ticks),
            tick(1),
            "and once more, to exactly the tick of the previous sample"
        );
    }
}
