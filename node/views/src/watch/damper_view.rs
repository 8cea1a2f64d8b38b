//! The known data of one damper: the newest value of each topic with its age, rates, changes of mode, and points for charts.
//!
//! Plain data without a clock: `now_s` is always an argument, in seconds on the caller's clock. All lists are bounded.

use super::damper_message::{DamperMessage, TOPICS};
use super::damper_state::{self, DamperState};
use super::history::{BUCKET_S, Bucket, History};
use super::point_buffer::{ChartPoint, PointBuffer};
use super::slope::Slope;
use crate::live::RateMeter;
use mr_damper_model::sample::Stamp;
use mr_damper_msgs::{CurrentCommand, ForceEstimate, ForceResidual, ModeChange};
use serde::Serialize;
use std::collections::{BTreeMap, VecDeque};

/// Age from which a value is stale, s.
pub const STALE_S: f64 = 1.0;
/// A stamp that is older than the newest one by more than this, in seconds, means that time was set back; otherwise the message is
/// late.
const SET_BACK_S: f64 = 1.0;
/// Number of changes of mode that are kept.
const CHANGES: usize = 8;

/// A received value with its time of arrival, s.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Received<T> {
    pub(super) what: T,
    pub(super) at_s: f64,
}

impl<T> Received<T> {
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
pub(super) struct LatestForce {
    pub(super) stamp_ns: i64,
    pub(super) force_n: f64,
}

/// The newest drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LatestDrive {
    pub(super) stamp_ns: i64,
    pub(super) value: f64,
    /// True for volts, false for amperes.
    pub(super) is_voltage: bool,
}

/// The points of the charts. Times are in seconds since the first sample.
#[derive(Debug, Clone, Default, PartialEq)]
struct Lines {
    /// Force, lower and upper end of its band, number of its mode.
    estimate: Line<4>,
    measured: Line<1>,
    residual: Line<1>,
    velocity: Line<1>,
    /// Requested force, expected force, commanded current.
    command: Line<3>,
    displacement: Line<1>,
    drive: Line<1>,
}

/// A line of a chart: its last seconds as points, and its last minutes as extremes.
#[derive(Debug, Clone, Default, PartialEq)]
struct Line<const N: usize> {
    points: PointBuffer<N>,
    history: History<N>,
    /// Time of the newest value, s since the first sample, and its time of arrival, s.
    newest: Option<(f64, f64)>,
}

impl<const N: usize> Line<N> {
    /// Adds `values` at `at_s`, received at `now_s`.
    fn push(&mut self, at_s: f64, values: [f64; N], now_s: f64) {
        self.points.push(at_s, values);
        self.history.push(at_s, values);
        // A node without displacement repeats the stamp of its last estimate: such messages do not continue the line.
        if self.newest.is_none_or(|(newest_s, _)| at_s > newest_s) {
            self.newest = Some((at_s, now_s));
        }
    }

    /// Time since the newest value was received, s; `None` without values.
    fn age_s(&self, now_s: f64) -> Option<f64> {
        self.newest.map(|(_, received_s)| (now_s - received_s).max(0.0))
    }

    fn clear(&mut self) {
        // The points keep their count, from which readers continue.
        self.points.clear();
        self.history.clear();
        self.newest = None;
    }
}

/// A reader's position in the points of a damper.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ChartCursor([u64; 7]);

/// Points that are new to a reader. Each begins with its time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChartPoints<'a> {
    /// Name of the damper.
    pub name: &'a str,
    /// Number of times that time was set back. Points of different eras cannot be combined.
    pub era: u32,
    /// Stamp at which the times of the points are zero, ns. It differs after a restart of the server.
    pub zero_ns: Option<i64>,
    /// Estimated force and lower and upper end of its band, N, and the number of the mode.
    pub estimate: Vec<ChartPoint<4>>,
    /// Measured force, N.
    pub measured: Vec<ChartPoint<1>>,
    /// Measured minus simulated force (free run), N.
    pub residual: Vec<ChartPoint<1>>,
    /// Velocity, m/s, from displacement.
    pub velocity: Vec<ChartPoint<1>>,
    /// Requested and expected force, N, and commanded current, A.
    pub command: Vec<ChartPoint<3>>,
    /// Displacement, m.
    pub displacement: Vec<ChartPoint<1>>,
    /// Measured drive, A or V; [`DamperState::drive`] has the unit.
    pub drive: Vec<ChartPoint<1>>,
}

/// The last minutes of a damper as extremes over buckets of [`BUCKET_S`]. It has the same values as [`ChartPoints`].
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(missing_docs, reason = "same fields as ChartPoints")]
pub struct ChartHistory {
    pub name: String,
    pub era: u32,
    pub zero_ns: Option<i64>,
    /// Length of a bucket, s.
    pub bucket_s: f64,
    pub estimate: Vec<Bucket<4>>,
    pub measured: Vec<Bucket<1>>,
    pub residual: Vec<Bucket<1>>,
    pub velocity: Vec<Bucket<1>>,
    pub command: Vec<Bucket<3>>,
    pub displacement: Vec<Bucket<1>>,
    pub drive: Vec<Bucket<1>>,
}

/// The view of one damper.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DamperView {
    name: String,
    /// The stamp at which the times of the points are zero.
    zero: Option<Stamp>,
    newest: Option<Stamp>,
    era: u32,
    pub(super) estimate: Option<Received<ForceEstimate>>,
    pub(super) measured: Option<Received<LatestForce>>,
    pub(super) drive: Option<Received<LatestDrive>>,
    pub(super) residual: Option<Received<ForceResidual>>,
    pub(super) command: Option<Received<CurrentCommand>>,
    pub(super) changes: VecDeque<Received<ModeChange>>,
    pub(super) unreadable: u64,
    rates: [RateMeter; TOPICS.len()],
    lines: Lines,
    slope: Slope,
}

impl DamperView {
    /// An empty view of the damper named `name`.
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
    pub fn take(&mut self, message: DamperMessage, now_s: f64) {
        self.rates[message.topic()].note(now_s);
        let stamp = Stamp::from_nanos(message.header().stamp.as_nanos());
        let stamp_ns = stamp.nanos();
        match message {
            DamperMessage::Displacement(message) => {
                self.follow(stamp);
                let at_s = self.seconds(stamp);
                self.lines.displacement.push(at_s, [message.displacement], now_s);
                if let Some((at_s, velocity)) = self.slope.take(at_s, message.displacement) {
                    self.lines.velocity.push(at_s, [velocity], now_s);
                }
            }
            DamperMessage::CoilCurrent(message) => {
                let what = LatestDrive { stamp_ns, value: message.current, is_voltage: false };
                self.take_drive(stamp, what, now_s);
            }
            DamperMessage::CommandVoltage(message) => {
                let what = LatestDrive { stamp_ns, value: message.voltage, is_voltage: true };
                self.take_drive(stamp, what, now_s);
            }
            // The published value, before the node's sign and offset: used only if the node does not report the force.
            DamperMessage::MeasuredForce(message) => {
                if self.residual.as_ref().is_none_or(|residual| residual.is_stale(now_s)) {
                    self.take_measured(stamp, message.force, now_s);
                }
            }
            DamperMessage::Estimate(message) => {
                self.follow(stamp);
                let at_s = self.seconds(stamp);
                let values = [message.force, message.band_low, message.band_high, f64::from(message.mode)];
                self.lines.estimate.push(at_s, values, now_s);
                self.estimate = Some(Received { what: message, at_s: now_s });
            }
            DamperMessage::Residual(message) => {
                self.take_measured(stamp, message.measured, now_s);
                let at_s = self.seconds(stamp);
                self.lines.residual.push(at_s, [message.residual], now_s);
                self.residual = Some(Received { what: message, at_s: now_s });
            }
            DamperMessage::Command(message) => {
                let at_s = self.seconds(stamp);
                self.lines.command.push(
                    at_s,
                    [message.force_requested, message.force_expected, message.current],
                    now_s,
                );
                self.command = Some(Received { what: message, at_s: now_s });
            }
            DamperMessage::Mode(message) => {
                self.changes.push_front(Received { what: message, at_s: now_s });
                self.changes.truncate(CHANGES);
            }
            DamperMessage::Velocity(_)
            | DamperMessage::CaseTemperature(_)
            | DamperMessage::ForceRequest(_)
            | DamperMessage::BodyVelocity(_) => {}
        }
    }

    /// Counts a message that could not be read.
    pub fn note_unreadable(&mut self) {
        self.unreadable += 1;
    }

    fn take_measured(&mut self, stamp: Stamp, force_n: f64, now_s: f64) {
        let at_s = self.seconds(stamp);
        self.lines.measured.push(at_s, [force_n], now_s);
        self.measured =
            Some(Received { what: LatestForce { stamp_ns: stamp.nanos(), force_n }, at_s: now_s });
    }

    fn take_drive(&mut self, stamp: Stamp, what: LatestDrive, now_s: f64) {
        // The line would otherwise join volts and amperes.
        if self.drive.as_ref().is_some_and(|before| before.what.is_voltage != what.is_voltage) {
            self.lines.drive.clear();
        }
        let at_s = self.seconds(stamp);
        self.lines.drive.push(at_s, [what.value], now_s);
        self.drive = Some(Received { what, at_s: now_s });
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
        let Lines { estimate, measured, residual, velocity, command, displacement, drive } = &mut self.lines;
        estimate.clear();
        measured.clear();
        residual.clear();
        velocity.clear();
        command.clear();
        displacement.clear();
        drive.clear();
    }

    /// Messages per second on a topic, over the last second.
    #[must_use]
    pub fn rate_hz(&self, topic: usize, now_s: f64) -> f64 {
        self.rates[topic].hz(now_s)
    }

    /// Ages of the newest values of the lines of the charts, s, by their names in [`ChartPoints`]; lines without values are left out.
    pub(super) fn line_ages_s(&self, now_s: f64) -> BTreeMap<&'static str, f64> {
        let lines = &self.lines;
        let ages = [
            ("estimate", lines.estimate.age_s(now_s)),
            ("measured", lines.measured.age_s(now_s)),
            ("residual", lines.residual.age_s(now_s)),
            ("velocity", lines.velocity.age_s(now_s)),
            ("command", lines.command.age_s(now_s)),
            ("displacement", lines.displacement.age_s(now_s)),
            ("drive", lines.drive.age_s(now_s)),
        ];
        ages.into_iter().filter_map(|(name, age_s)| Some((name, age_s?))).collect()
    }

    /// The values at `now_s`.
    #[must_use]
    pub fn state(&self, now_s: f64) -> DamperState {
        damper_state::of(self, now_s)
    }

    /// The points that are new since `cursor`, which is advanced; `None` without new points.
    pub fn points(&self, cursor: &mut ChartCursor) -> Option<ChartPoints<'_>> {
        let before = cursor.clone();
        let [estimate, measured, residual, velocity, command, displacement, drive] = &mut cursor.0;
        let points = ChartPoints {
            name: &self.name,
            era: self.era,
            zero_ns: self.zero.map(Stamp::nanos),
            estimate: self.lines.estimate.points.since(estimate),
            measured: self.lines.measured.points.since(measured),
            residual: self.lines.residual.points.since(residual),
            velocity: self.lines.velocity.points.since(velocity),
            command: self.lines.command.points.since(command),
            displacement: self.lines.displacement.points.since(displacement),
            drive: self.lines.drive.points.since(drive),
        };
        (*cursor != before).then_some(points)
    }

    /// The last minutes from `from_s` on, in seconds since the first sample.
    #[must_use]
    pub fn history(&self, from_s: f64) -> ChartHistory {
        ChartHistory {
            name: self.name.clone(),
            era: self.era,
            zero_ns: self.zero.map(Stamp::nanos),
            bucket_s: BUCKET_S,
            estimate: self.lines.estimate.history.since(from_s),
            measured: self.lines.measured.history.since(from_s),
            residual: self.lines.residual.history.since(from_s),
            velocity: self.lines.velocity.history.since(from_s),
            command: self.lines.command.history.since(from_s),
            displacement: self.lines.displacement.history.since(from_s),
            drive: self.lines.drive.history.since(from_s),
        }
    }
}
