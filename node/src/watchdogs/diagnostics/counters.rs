//! The counters of all threads of a damper, and the losses that they show.

use crate::estimation::estimator::EstimatorCounters;
use crate::streams::can::CanCounters;
use crate::streams::sink::ros_sink::RosSinkCounters;
use crate::streams::source::ros_source::SourceCounters;
use mr_damper_base::realtime::Scheduling;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Counters of all threads.
#[derive(Clone, Default)]
pub struct Counters {
    /// Of the estimating thread.
    pub estimator: Arc<EstimatorCounters>,
    /// Of the ROS source.
    pub source: Arc<SourceCounters>,
    /// Of the ROS sink.
    pub ros_sink: Arc<RosSinkCounters>,
    /// Of the CAN bus, if there is one.
    pub can: Option<Arc<CanCounters>>,
    /// Events lost because the ring between the estimating thread and a sink was full, by sink.
    pub rings: Vec<(&'static str, Arc<AtomicU64>)>,
    /// Scheduling of the counting threads.
    pub scheduling: Scheduling,
}

impl Counters {
    /// Everything lost in the node, by name: samples, events, and messages.
    #[must_use]
    pub fn losses(&self) -> Vec<(String, u64)> {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let rings = self.rings.iter().map(|(sink, lost)| (format!("lost_{sink}"), read(lost)));
        let others = [
            ("dropped", &self.estimator.overflow),
            ("not_published", &self.ros_sink.failed),
            ("late_commands", &self.ros_sink.late_commands),
        ];
        let others = others.into_iter().map(|(name, count)| (name.to_owned(), read(count)));
        let can = self.can.iter().flat_map(|can| can.losses());
        let can = can.map(|(name, count)| (format!("can_{name}"), count));
        others.chain(can).chain(rings).collect()
    }

    /// The sum of all losses.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.losses().iter().map(|(_, count)| count).sum()
    }

    /// The losses as `name=count`; `none` without losses.
    #[must_use]
    pub fn losses_in_words(&self) -> String {
        let losses = self.losses().into_iter().filter(|(_, count)| *count > 0);
        let words: Vec<_> = losses.map(|(name, count)| format!("{name}={count}")).collect();
        if words.is_empty() { "none".to_owned() } else { words.join(" ") }
    }
}
