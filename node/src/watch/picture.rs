//! The known data of one damper: the newest value of each topic with its age, rates, changes of mode, and points for charts.
//!
//! Plain data without a clock: `now_s` is always an argument, in seconds on the caller's clock. All lists are bounded.

use super::news::{News, TOPICS};
use super::slope::Slope;
use super::state::{self, State};
use super::trail::{Point, Trail};
use crate::live::RateMeter;
use mr_damper_model::sample::Stamp;
use mr_damper_msgs::{CurrentCommand, ForceEstimate, ForceResidual, ModeChange};
use serde::Serialize;
use std::collections::VecDeque;

/// Age from which a value is stale, s.
pub const STALE_S: f64 = 1.0;
/// A stamp that is older than the newest one by more than this, in seconds, means that time was set back; otherwise the message is
/// late.
const SET_BACK_S: f64 = 1.0;
/// Number of changes of mode that are kept.
const CHANGES: usize = 8;

/// A received value with its time of arrival, s.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Heard<T> {
    pub(super) what: T,
    pub(super) at_s: f64,
}

impl<T> Heard<T> {
    /// Age, s.
    pub(super) fn age_s(&self, now_s: f64) -> f64 {
        (now_s - self.at_s).max(0.0)
    }

    /// True when the value is too old to describe the present.
    pub(super) fn is_stale(&self, now_s: f64) -> bool {
        self.age_s(now_s) > STALE_S
    }
}

/// Measured force as the node uses it, or as published on its topic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measured {
    pub(super) stamp_ns: i64,
    pub(super) force_n: f64,
}

/// The newest drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Drive {
    pub(super) stamp_ns: i64,
    pub(super) value: f64,
    /// True for volts, false for amperes.
    pub(super) is_voltage: bool,
}

/// The points of the charts. Times are in seconds since the first sample.
#[derive(Debug, Clone, Default, PartialEq)]
struct Trails {
    /// Force, lower and upper end of its band, number of its mode.
    estimate: Trail<4>,
    measured: Trail<1>,
    residual: Trail<1>,
    velocity: Trail<1>,
    /// Requested force, expected force.
    command: Trail<2>,
}

/// A reader's position in the points of a picture.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Cursor([u64; 5]);

/// Points that are new to a reader. Each begins with its time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Points<'a> {
    /// Name of the damper.
    pub name: &'a str,
    /// Number of times that time was set back. Points of different eras cannot be combined.
    pub era: u32,
    /// Estimated force and lower and upper end of its band, N, and the number of the mode.
    pub estimate: Vec<Point<4>>,
    /// Measured force, N.
    pub measured: Vec<Point<1>>,
    /// Measured minus simulated force (free run), N.
    pub residual: Vec<Point<1>>,
    /// Velocity, m/s, from displacement.
    pub velocity: Vec<Point<1>>,
    /// Requested and expected force, N.
    pub command: Vec<Point<2>>,
}

/// The picture of one damper.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Picture {
    name: String,
    /// The stamp at which the times of the points are zero.
    zero: Option<Stamp>,
    newest: Option<Stamp>,
    era: u32,
    pub(super) estimate: Option<Heard<ForceEstimate>>,
    pub(super) measured: Option<Heard<Measured>>,
    pub(super) drive: Option<Heard<Drive>>,
    pub(super) residual: Option<Heard<ForceResidual>>,
    pub(super) command: Option<Heard<CurrentCommand>>,
    pub(super) changes: VecDeque<Heard<ModeChange>>,
    pub(super) unreadable: u64,
    rates: [RateMeter; TOPICS.len()],
    trails: Trails,
    slope: Slope,
}

impl Picture {
    /// An empty picture of the damper named `name`.
    #[must_use]
    pub fn new(name: &str) -> Self {
        Self { name: name.to_owned(), ..Self::default() }
    }

    /// Name of the damper.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Records a message received at `now_s`.
    pub fn take(&mut self, news: News, now_s: f64) {
        self.rates[news.topic()].note(now_s);
        let stamp = Stamp::from_nanos(news.header().stamp.as_nanos());
        let stamp_ns = stamp.nanos();
        match news {
            News::Displacement(message) => {
                self.follow(stamp);
                let at_s = self.seconds(stamp);
                if let Some((at_s, velocity)) = self.slope.take(at_s, message.displacement) {
                    self.trails.velocity.push(at_s, [velocity]);
                }
            }
            News::CoilCurrent(message) => {
                let what = Drive { stamp_ns, value: message.current, is_voltage: false };
                self.drive = Some(Heard { what, at_s: now_s });
            }
            News::CommandVoltage(message) => {
                let what = Drive { stamp_ns, value: message.voltage, is_voltage: true };
                self.drive = Some(Heard { what, at_s: now_s });
            }
            // The published value, before the node's sign and offset: used only if the node does not report the force.
            News::MeasuredForce(message) => {
                if self.residual.as_ref().is_none_or(|residual| residual.is_stale(now_s)) {
                    self.take_measured(stamp, message.force, now_s);
                }
            }
            News::Estimate(message) => {
                self.follow(stamp);
                let at_s = self.seconds(stamp);
                let values = [message.force, message.band_low, message.band_high, f64::from(message.mode)];
                self.trails.estimate.push(at_s, values);
                self.estimate = Some(Heard { what: message, at_s: now_s });
            }
            News::Residual(message) => {
                self.take_measured(stamp, message.measured, now_s);
                let at_s = self.seconds(stamp);
                self.trails.residual.push(at_s, [message.residual]);
                self.residual = Some(Heard { what: message, at_s: now_s });
            }
            News::Command(message) => {
                let at_s = self.seconds(stamp);
                self.trails.command.push(at_s, [message.force_requested, message.force_expected]);
                self.command = Some(Heard { what: message, at_s: now_s });
            }
            News::Mode(message) => {
                self.changes.push_front(Heard { what: message, at_s: now_s });
                self.changes.truncate(CHANGES);
            }
            News::Velocity(_) | News::CaseTemperature(_) | News::ForceRequest(_) | News::BodyVelocity(_) => {}
        }
    }

    /// Counts a message that could not be read.
    pub fn note_unreadable(&mut self) {
        self.unreadable += 1;
    }

    fn take_measured(&mut self, stamp: Stamp, force_n: f64, now_s: f64) {
        let at_s = self.seconds(stamp);
        self.trails.measured.push(at_s, [force_n]);
        self.measured = Some(Heard { what: Measured { stamp_ns: stamp.nanos(), force_n }, at_s: now_s });
    }

    /// Seconds from the first sample to `stamp`.
    fn seconds(&mut self, stamp: Stamp) -> f64 {
        stamp.since(*self.zero.get_or_insert(stamp)).get()
    }

    /// Follows the node's time, which is the time of displacement. If it was set back, all points are cleared, because their times
    /// must increase.
    fn follow(&mut self, stamp: Stamp) {
        let newest = *self.newest.get_or_insert(stamp);
        if newest.since(stamp).get() <= SET_BACK_S {
            self.newest = Some(newest.max(stamp));
            return;
        }
        self.era += 1;
        (self.zero, self.newest) = (None, Some(stamp));
        self.slope = Slope::default();
        let Trails { estimate, measured, residual, velocity, command } = &mut self.trails;
        estimate.clear();
        measured.clear();
        residual.clear();
        velocity.clear();
        command.clear();
    }

    /// Messages per second on a topic, over the last second.
    #[must_use]
    pub fn rate_hz(&self, topic: usize, now_s: f64) -> f64 {
        self.rates[topic].hz(now_s)
    }

    /// The values at `now_s`.
    #[must_use]
    pub fn state(&self, now_s: f64) -> State {
        state::of(self, now_s)
    }

    /// The points that are new since `cursor`, which is advanced; `None` without new points.
    pub fn points(&self, cursor: &mut Cursor) -> Option<Points<'_>> {
        let before = cursor.clone();
        let [estimate, measured, residual, velocity, command] = &mut cursor.0;
        let points = Points {
            name: &self.name,
            era: self.era,
            estimate: self.trails.estimate.since(estimate),
            measured: self.trails.measured.since(measured),
            residual: self.trails.residual.since(residual),
            velocity: self.trails.velocity.since(velocity),
            command: self.trails.command.since(command),
        };
        (*cursor != before).then_some(points)
    }
}
