//! The data of the live view: a summary of the pipeline's events, limited in size.

use super::meter::{Histogram, RateMeter};
use mr_damper_base::clock::in_seconds;
use mr_damper_model::pipeline::{AlarmChange, Estimate, Event, Mode, Residual, Transition};
use mr_damper_model::sample::{Channel, Stamp};
use std::collections::VecDeque;

/// Length of the force chart, s.
pub(super) const CHART_S: f64 = 4.0;

/// The part that does not change while the view is shown.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RunInfo {
    /// Short description of what runs.
    pub title: String,
    /// Name of the model for simulation (free run).
    pub free_model: String,
    /// Name of the ARX model; empty if there is none.
    pub seeded_model: String,
    /// ROS domain and reach.
    pub reach: String,
    /// Endpoint of the Zenoh mirror; empty if there is none.
    pub zenoh: String,
    /// Length of the run, s.
    pub length_s: f64,
}

/// Counters, copied from their owners.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Samples published onto the input topics.
    pub sent: u64,
    /// Samples that the node received.
    pub taken: u64,
    /// Samples that the pipeline refused.
    pub refused: u64,
    /// Samples and events lost because a queue was full.
    pub lost: u64,
    /// Displacements that were passed on without an input of the same stamp, after waiting for it.
    pub incomplete: u64,
    /// Estimates that the node published.
    pub estimates: u64,
    /// Estimates that a subscriber received.
    pub received: u64,
}

impl Counts {
    /// The differences to `before`.
    #[must_use]
    pub const fn since(&self, before: &Self) -> Self {
        Self {
            sent: self.sent - before.sent,
            taken: self.taken - before.taken,
            refused: self.refused - before.refused,
            lost: self.lost - before.lost,
            incomplete: self.incomplete - before.incomplete,
            estimates: self.estimates - before.estimates,
            received: self.received - before.received,
        }
    }
}

/// An alarm that is active.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alarm {
    /// When it was raised, s since the first sample.
    pub at_s: f64,
    /// The change that raised it.
    pub change: AlarmChange,
}

impl Alarm {
    /// The alarm as one line of text.
    #[must_use]
    pub fn text(&self) -> String {
        format!(
            "{:5.1} s  ALARM (stamp {}): the simulation's residual is {:.1} times the model's expected error",
            self.at_s,
            in_seconds(self.change.stamp),
            self.change.ratio
        )
    }
}

/// A change of mode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModeChange {
    /// Time of the change, s since the first sample.
    pub at_s: f64,
    /// The change.
    pub transition: Transition,
}

/// A point of the chart: time, value, and mode (for estimates).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    pub(super) at_s: f64,
    pub(super) value: f64,
    pub(super) mode: Mode,
}

/// The summary of the events.
#[derive(Debug, Clone, Default)]
pub struct LiveSummary {
    /// The constant part.
    pub info: RunInfo,
    /// Counters, set by their owner.
    pub counts: Counts,
    /// Length of the run played so far, s; set by the player.
    pub played_s: f64,
    /// Time since the start of the view, s; on the clock of `seen_s`.
    pub now_s: f64,
    /// The newest estimate.
    pub estimate: Option<Estimate>,
    /// The newest residual.
    pub residual: Option<Residual>,
    /// Changes of mode, in order.
    pub changes: Vec<ModeChange>,
    /// The alarm, while it is active.
    pub alarm: Option<Alarm>,
    /// Time from a displacement's stamp to its arrival in the node.
    pub to_node: Histogram,
    /// Time from a displacement's stamp to the arrival of its estimate at a subscriber.
    pub round_trip: Histogram,
    zero: Option<Stamp>,
    inputs: [RateMeter; Channel::ALL.len()],
    estimates: RateMeter,
    residuals: RateMeter,
    pub(super) measured: VecDeque<Point>,
    pub(super) estimated: VecDeque<Point>,
    pub(super) residual_points: VecDeque<Point>,
}

impl LiveSummary {
    /// An empty summary.
    #[must_use]
    pub fn new(info: RunInfo) -> Self {
        Self { info, ..Self::default() }
    }

    /// Takes an event that was seen at `seen_s`, s. Any clock can be used, but the same one for all events.
    pub fn take(&mut self, event: &Event, seen_s: f64) {
        self.now_s = self.now_s.max(seen_s);
        match event {
            Event::Input(sample) => {
                let channel = sample.reading.channel();
                self.inputs[channel as usize].note(seen_s);
                let at_s = self.seconds(sample.stamp);
                match channel {
                    Channel::Force => push(&mut self.measured, at_s, sample.reading.get(), Mode::Fault),
                    Channel::Displacement => self.to_node.note(sample.received.since(sample.stamp).get()),
                    _ => {}
                }
            }
            Event::Estimate(estimate) => {
                self.estimates.note(seen_s);
                let at_s = self.seconds(estimate.stamp);
                push(&mut self.estimated, at_s, estimate.force.get(), estimate.mode);
                self.estimate = Some(*estimate);
            }
            Event::Residual(residual) => {
                self.residuals.note(seen_s);
                let at_s = self.seconds(residual.stamp);
                push(&mut self.residual_points, at_s, residual.residual.get(), Mode::Model);
                self.residual = Some(*residual);
            }
            Event::Transition(transition) => {
                let at_s = self.seconds(transition.stamp);
                self.changes.push(ModeChange { at_s, transition: *transition });
            }
            Event::Alarm(change) => {
                let at_s = self.seconds(change.stamp);
                self.alarm = change.raised.then_some(Alarm { at_s, change: *change });
            }
            Event::Refusal(_) | Event::Command(_) => {}
        }
    }

    /// Time from the first sample to `stamp`, s.
    fn seconds(&mut self, stamp: Stamp) -> f64 {
        stamp.since(*self.zero.get_or_insert(stamp)).get()
    }

    /// Time from the first sample to the newest estimate, s; 0 without an estimate.
    #[must_use]
    pub fn at_s(&self) -> f64 {
        match (self.zero, &self.estimate) {
            (Some(zero), Some(estimate)) => estimate.stamp.since(zero).get(),
            _ => 0.0,
        }
    }

    /// Rate of an input, Hz.
    #[must_use]
    pub fn input_hz(&self, channel: Channel) -> f64 {
        self.inputs[channel as usize].hz(self.now_s)
    }

    /// Rate of the estimates, Hz.
    #[must_use]
    pub fn estimate_hz(&self) -> f64 {
        self.estimates.hz(self.now_s)
    }

    /// Rate of the residuals, Hz.
    #[must_use]
    pub fn residual_hz(&self) -> f64 {
        self.residuals.hz(self.now_s)
    }

    /// The newest measured force, N, if it is less than 0.1 s old.
    #[must_use]
    pub fn measured_n(&self) -> Option<f64> {
        let newest = self.measured.back()?;
        (self.at_s() - newest.at_s < 0.1).then_some(newest.value)
    }

    /// True while measured force arrives, so that the residual is current.
    #[must_use]
    pub fn residual_is_fresh(&self) -> bool {
        self.residual_points.back().is_some_and(|newest| self.at_s() - newest.at_s < 0.1)
    }
}

/// Adds a point and drops points older than the chart.
fn push(points: &mut VecDeque<Point>, at_s: f64, value: f64, mode: Mode) {
    points.push_back(Point { at_s, value, mode });
    while points.front().is_some_and(|first| at_s - first.at_s > CHART_S) {
        points.pop_front();
    }
}
