//! Status of the node's work: rates and ages of inputs and outputs, losses, latencies.

use super::{Counters, StatusContext, publishers_advice, value};
use crate::estimation::lifecycle::LifecycleState;
use mr_damper_base::realtime::{ADVICE, Scheduling};
use mr_damper_model::pipeline::{Estimate, Event, Refused, Validity};
use mr_damper_model::sample::Channel;
use mr_damper_msgs::standard::{DiagnosticStatus, KeyValue};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Estimates older than this count as missing.
const SILENCE: Duration = Duration::from_secs(2);

/// Messages of one input or output.
#[derive(Debug, Clone, Copy, Default)]
struct Flow {
    since_look: u64,
    last: Option<Instant>,
}

impl Flow {
    fn note(&mut self, at: Instant) {
        self.since_look += 1;
        self.last = Some(at);
    }
}

/// Observations of the node's work. When all queues are empty, received = used + refused + unreadable + dropped + idle.
#[derive(Debug, Clone, Default)]
pub struct NodeStatus {
    inputs: [Flow; INPUTS.len()],
    estimates: Flow,
    commands: Flow,
    /// Commands since the last status: all, and those that the search gave in the place of a learned inverse.
    commanded: [u64; 2],
    estimate: Option<Estimate>,
    looked: Option<Instant>,
    /// Deadlines missed up to the last status.
    missed: u64,
    /// Losses up to the last status, as returned by [`Counters::losses`].
    lost: Vec<(String, u64)>,
    /// Samples that the pipeline refused, by reason, in the order of [`Refused::ALL`].
    refused: [u64; Refused::ALL.len()],
}

/// The reported input channels, with their names.
const INPUTS: [(Channel, &str); 6] = [
    (Channel::Displacement, "displacement"),
    (Channel::Drive, "drive"),
    (Channel::Force, "measured_force"),
    (Channel::CaseTemperature, "case_temperature"),
    (Channel::BodyVelocity, "body_velocity"),
    (Channel::ForceRequest, "force_request"),
];

/// The sentence for a node whose estimates another process publishes too.
#[must_use]
pub fn twin_advice(topic: &str) -> String {
    format!(
        "{topic} has another publisher, so its subscribers get the estimates of both mixed: stop the other node of this name, or \
         give one another namespace (-r __ns:=/front_left). A killed publisher stays listed for up to a minute"
    )
}

/// The sentence for a node in which the search gave `substituted` of `all` currents, if that is more than half.
fn substituted_advice([all, substituted]: [u64; 2]) -> Option<String> {
    (2 * substituted > all).then(|| {
        format!(
            "the search on the model found {substituted} of {all} currents, because the inverse model of inverse.method lacks past samples: \
             send displacement without gaps, at the rate of its training (1/sample_period_s of inverse_model in the model file)"
        )
    })
}

/// The sentence for a node that waits for simulated time.
pub const CLOCK_ADVICE: &str = "use_sim_time is true, but no message arrives on /clock: start the simulation (or `mr-damper replay --clock`), \
     check that it has the domain of this node, or set use_sim_time to false";

impl NodeStatus {
    /// Takes an event that happened `at`.
    pub fn take(&mut self, event: &Event, at: Instant) {
        match event {
            Event::Input(sample) => {
                let channel = sample.reading.channel();
                if let Some(index) = INPUTS.iter().position(|(known, _)| *known == channel) {
                    self.inputs[index].note(at);
                }
            }
            Event::Estimate(estimate) => {
                self.estimates.note(at);
                self.estimate = Some(*estimate);
            }
            Event::Command(commanded) => {
                self.commands.note(at);
                self.commanded[0] += 1;
                self.commanded[1] += u64::from(commanded.command.substituted);
            }
            Event::Refusal(refusal) => {
                let reasons = Refused::ALL.iter().zip(&mut self.refused);
                reasons.filter(|(why, _)| **why == refusal.why).for_each(|(_, count)| *count += 1);
            }
            Event::Residual(_) | Event::Transition(_) | Event::Alarm(_) => {}
        }
    }

    /// The status at `now`; restarts the counts for the rates.
    pub fn status(
        &mut self,
        now: Instant,
        context: &StatusContext<'_>,
        lifecycle: LifecycleState,
        counters: &Counters,
    ) -> DiagnosticStatus {
        let missed = counters.ros_sink.missed.load(Ordering::Relaxed);
        let late = missed - std::mem::replace(&mut self.missed, missed);
        let (mut level, mut message) = in_time(self.verdict(now, lifecycle), late, &counters.scheduling);
        let losses = counters.losses();
        for what in self.newly_lost(&losses) {
            level = level.max(DiagnosticStatus::WARN);
            message += &what;
        }
        if counters.can.as_ref().is_some_and(|can| can.is_off()) {
            level = level.max(DiagnosticStatus::ERROR);
            message += "; the controller is off the CAN bus: no inputs arrive from it, and no commands are sent to it";
        }
        if let Some(advice) = substituted_advice(std::mem::take(&mut self.commanded)) {
            level = level.max(DiagnosticStatus::WARN);
            message += &format!("; {advice}");
        }
        let (topic, others) = context.estimates;
        if others > 0 {
            level = level.max(DiagnosticStatus::WARN);
            message += &format!("; {}", twin_advice(topic));
        }
        for publishers in context.publishers {
            level = level.max(DiagnosticStatus::WARN);
            message += &format!("; {}", publishers_advice(publishers));
        }
        if context.clock_missing {
            level = level.max(DiagnosticStatus::WARN);
            message += &format!("; {CLOCK_ADVICE}");
        }
        let mut values = vec![
            value("state", lifecycle.name()),
            value("model", &context.names.free),
            value("arx_model", context.names.seeded.as_deref().unwrap_or("none")),
            value("model_hash", &context.names.hash),
        ];
        if let Some(estimate) = self.estimate.filter(|_| lifecycle == LifecycleState::Active) {
            values.push(value("mode", estimate.mode.name()));
            values.push(value("validity", estimate.validity.name()));
        }
        self.push_flows(now, &mut values);
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let (estimator, source, sink) = (&counters.estimator, &counters.source, &counters.ros_sink);
        for (name, count) in [
            ("received", read(&source.messages)),
            ("unreadable", read(&source.unreadable)),
            ("incomplete", read(&source.incomplete)),
            ("idle", read(&estimator.idle)),
            ("used", read(&estimator.used)),
            ("refused", read(&estimator.refused)),
            ("estimates", read(&sink.estimates)),
            ("commands", read(&sink.commands)),
            ("missed_deadlines", missed),
            ("other_publishers", others as u64),
        ] {
            values.push(value(name, count));
        }
        for publishers in context.publishers {
            let name = publishers.topic.rsplit('/').next().unwrap_or_default();
            values.push(value(&format!("publishers_of_{name}"), publishers.nodes.join(", ")));
        }
        values.extend(losses.iter().map(|(name, count)| value(name, count)));
        if let Some(can) = &counters.can {
            let others = can.values().into_iter().map(|(name, count)| (format!("can_{name}"), count));
            let others = others.filter(|(name, _)| !losses.iter().any(|(loss, _)| loss == name));
            values.extend(others.map(|(name, count)| value(&name, count)));
        }
        self.lost = losses;
        for (why, count) in Refused::ALL.iter().zip(self.refused).filter(|(_, count)| *count > 0) {
            values.push(value(&format!("refused_{}", why.name()), count));
        }
        values.push(value("realtime_priority", &counters.scheduling));
        for (stage, latency) in [
            ("latency", &sink.latency),
            ("waiting", &estimator.waiting),
            ("stepping", &estimator.stepping),
            ("publishing", &sink.publishing),
        ] {
            let Some(took) = latency.take() else { continue };
            for (name, seconds) in [("median", took.median_s), ("p99", took.p99_s), ("worst", took.worst_s)] {
                values.push(value(&format!("{stage}_{name}_ms"), format_args!("{:.4}", seconds * 1e3)));
            }
        }
        DiagnosticStatus {
            level,
            name: format!("{}: node", context.node),
            message,
            hardware_id: context.damper.to_owned(),
            values,
        }
    }

    /// The losses since the last status, each with its cause, as parts of a message.
    fn newly_lost(&self, losses: &[(String, u64)]) -> Vec<String> {
        let before =
            |name: &str| self.lost.iter().find(|(known, _)| known == name).map_or(0, |(_, count)| *count);
        let new =
            losses.iter().map(|(name, count)| (name, count - before(name))).filter(|(_, count)| *count > 0);
        new.map(|(name, count)| format!("; {count} more {name}: {}", why_lost(name))).collect()
    }

    /// Adds the rates since the last status, and the ages.
    fn push_flows(&mut self, now: Instant, values: &mut Vec<KeyValue>) {
        let seconds = self.looked.map(|at| now.saturating_duration_since(at).as_secs_f64());
        self.looked = Some(now);
        let inputs = self.inputs.iter_mut().zip(INPUTS).map(|(flow, (_, name))| (name, flow));
        let outputs = [("estimate", &mut self.estimates), ("command", &mut self.commands)];
        for (name, flow) in inputs.chain(outputs) {
            let count = std::mem::take(&mut flow.since_look);
            let Some(last) = flow.last else { continue };
            if let Some(seconds) = seconds.filter(|seconds| *seconds > 0.0) {
                values.push(value(&format!("{name}_hz"), format_args!("{:.1}", count as f64 / seconds)));
            }
            let age_s = now.saturating_duration_since(last).as_secs_f64();
            values.push(value(&format!("{name}_age_s"), format_args!("{age_s:.2}")));
        }
    }

    fn verdict(&self, now: Instant, lifecycle: LifecycleState) -> (u8, String) {
        if lifecycle != LifecycleState::Active {
            let advice = match lifecycle {
                LifecycleState::Unconfigured => "; change_state configures it",
                LifecycleState::Inactive => "; change_state activates it",
                LifecycleState::Active | LifecycleState::Finalized => "",
            };
            return (DiagnosticStatus::OK, format!("the node is {}{advice}", lifecycle.name()));
        }
        let fresh = self.estimates.last.is_some_and(|at| now.saturating_duration_since(at) <= SILENCE);
        let Some(estimate) = self.estimate.filter(|_| fresh) else {
            let message = "no estimates: no displacement arrives; check that it is published, with the QoS and domain of this node";
            return (DiagnosticStatus::STALE, message.to_owned());
        };
        let reasons: Vec<&str> = estimate.reasons.names().collect();
        let why = if reasons.is_empty() { String::new() } else { format!(": {}", reasons.join(", ")) };
        let message =
            format!("estimates in mode {} are {}{why}", estimate.mode.name(), estimate.validity.name());
        let level = match estimate.validity {
            Validity::Valid => DiagnosticStatus::OK,
            Validity::Degraded | Validity::Extrapolating => DiagnosticStatus::WARN,
            Validity::Stale | Validity::Invalid => DiagnosticStatus::ERROR,
        };
        (level, message)
    }
}

/// Cause of a count of [`Counters::losses`], and advice.
fn why_lost(name: &str) -> &'static str {
    match name {
        "dropped" => "samples arrived too fast to be processed; lower their rate or free the processor",
        "not_published" => {
            "the DDS library accepted no more messages; check whether a network or a subscriber is overloaded"
        }
        "late_commands" => {
            "commands that missed deadline_s were not sent; free the processor or raise realtime_priority"
        }
        "lost_commands" | "lost_reports" => {
            "the thread that publishes was delayed; free the processor or raise realtime_priority"
        }
        "lost_mirror" => "the Zenoh mirror was delayed; see its status",
        "can_late_commands" | "can_late_estimates" => {
            "what missed deadline_s was not sent to the CAN bus; free the processor or raise realtime_priority"
        }
        "can_queue_full" | "can_not_sent" => "frames were not sent to the CAN bus; see the log",
        "can_not_representable" => {
            "forces or currents do not fit the range of their CAN signal; widen it in the DBC file"
        }
        "lost_can" | "lost_can_commands" => {
            "the thread that sends to the CAN bus was delayed; free the processor"
        }
        "lost_history" => "the history and the log have a gap; free the processor",
        _ => "a thread that reads the node's events was delayed",
    }
}

/// Extends a verdict: with the deadlines missed since the last status, and with a refused real-time priority.
fn in_time((level, mut message): (u8, String), late: u64, scheduling: &Scheduling) -> (u8, String) {
    if late > 0 {
        message += &format!("; {late} estimates have missed their deadline since the last status");
    }
    let refused = matches!(scheduling, Scheduling::Refused { .. });
    if refused {
        message += &format!("; real-time priority was refused: {ADVICE}");
    }
    (if late > 0 || refused { level.max(DiagnosticStatus::WARN) } else { level }, message)
}

#[cfg(test)]
mod tests {
    use super::super::{Publishers, context};
    use super::*;
    use crate::estimation::wire::ModelNames;
    use mr_damper_model::inverse::{CurrentCommand, Demand, InverseController, Limits};
    use mr_damper_model::pipeline::{Reasons, Refusal, StampedCommand};
    use mr_damper_model::sample::{Reading, Sample, Stamp};
    use mr_damper_model::units::Metre;
    use std::fmt::Write;
    use std::sync::Arc;

    #[test]
    fn currents_by_the_search_are_reported_if_they_are_most() {
        let of = |substituted| {
            let mut status = NodeStatus::default();
            for k in 0..10 {
                let command = CurrentCommand { substituted: k < substituted, ..command() };
                let stamp = Stamp::from_nanos(k);
                status.take(
                    &Event::Command(StampedCommand { stamp, known_at: stamp, command }),
                    Instant::now(),
                );
            }
            let names = ModelNames::default();
            let mut look = || {
                status
                    .status(Instant::now(), &context(&names), LifecycleState::Active, &Counters::default())
                    .message
            };
            (look(), look())
        };
        let says = "the search on the model found 6 of 10 currents";
        let (first, second) = of(6);
        assert!(first.contains(says) && !second.contains("the search"), "{first}\n{second}");
        assert!(!of(5).0.contains("the search"));
    }

    fn command() -> CurrentCommand {
        let limits = Limits::default();
        let mut controller = InverseController::without_inverse(limits).expect("valid limits");
        controller.idle(Demand::None, 0.0)
    }

    #[test]
    fn statuses_as_text() {
        let free = "thesis/fuzzy-tanh/rp3-cs".to_owned();
        let names = ModelNames { free, seeded: None, hash: "abc".to_owned() };
        let (context, nameless) = (context(&names), ModelNames::default());
        let unconfigured = StatusContext { names: &nameless, ..context };
        let mut counters = Counters::default();
        let mut text = String::new();
        let mut say = |what: &str, status: &DiagnosticStatus| {
            let values: Vec<_> = status.values.iter().map(|v| format!("{}={}", v.key, v.value)).collect();
            writeln!(text, "{what}: {} {}\n    {}", status.level, status.message, values.join(" "))
                .expect("a text");
        };
        let (mut status, begin) = (NodeStatus::default(), Instant::now());
        let at = |s: u64| begin + Duration::from_secs(s);
        say("not configured", &status.status(at(0), &unconfigured, LifecycleState::Unconfigured, &counters));
        say("active, without input", &status.status(at(1), &context, LifecycleState::Active, &counters));
        for k in 0..100 {
            let stamp = Stamp::from_nanos(k * 10_000_000);
            let sample = Sample { stamp, received: stamp, reading: Reading::Displacement(Metre(0.0)) };
            status.take(&Event::Input(sample), at(2));
            let (mode, validity) = (mr_damper_model::pipeline::Mode::Model, Validity::Degraded);
            let estimate = Estimate { mode, validity, reasons: Reasons::DRIVE_STALE, ..estimate(stamp) };
            status.take(&Event::Estimate(estimate), at(2));
            counters.ros_sink.latency.add(Duration::from_micros(80));
        }
        say("with an old drive", &status.status(at(2), &context, LifecycleState::Active, &counters));
        counters.rings = vec![("commands", Arc::new(AtomicU64::new(7))), ("reports", Arc::default())];
        counters.ros_sink.late_commands.store(2, Ordering::Relaxed);
        say(
            "with a ring that was full, and late commands",
            &status.status(at(2), &context, LifecycleState::Active, &counters),
        );
        let sample = Sample {
            stamp: Stamp::from_nanos(0),
            received: Stamp::from_nanos(0),
            reading: Reading::Displacement(Metre(0.0)),
        };
        status.take(&Event::Refusal(Refusal { sample, why: Refused::TimeBack }), at(2));
        counters.ros_sink.missed.store(3, Ordering::Relaxed);
        say("some of them late", &status.status(at(2), &context, LifecycleState::Active, &counters));
        counters.scheduling = Scheduling::Refused { priority: 50, why: "Operation not permitted".to_owned() };
        say("no real-time priority", &status.status(at(2), &context, LifecycleState::Active, &counters));
        let twin = StatusContext { estimates: ("/front_left/force_estimate", 1), ..context };
        say("with another node of its name", &status.status(at(3), &twin, LifecycleState::Active, &counters));
        let nodes = vec!["/left_sensor".to_owned(), "/right_sensor".to_owned()];
        let two = Publishers {
            topic: "/front_left/displacement".to_owned(),
            nodes,
            mixed: false,
            is_estimated_from: true,
        };
        let mixed = Publishers { mixed: true, ..two.clone() };
        for (what, publishers) in
            [("with two publishers of displacement", two), ("whose samples arrive mixed", mixed)]
        {
            let crowded = StatusContext { publishers: &[publishers], ..context };
            say(what, &status.status(at(3), &crowded, LifecycleState::Active, &counters));
        }
        let timeless = StatusContext { clock_missing: true, ..context };
        say("without simulated time", &status.status(at(3), &timeless, LifecycleState::Active, &counters));
        say("silence", &status.status(at(9), &context, LifecycleState::Active, &counters));
        insta::assert_snapshot!(text);
    }

    fn estimate(stamp: Stamp) -> Estimate {
        use mr_damper_model::pipeline::{Mode, Slot};
        use mr_damper_model::units::{Newton, Second};
        Estimate {
            stamp,
            received: Some(stamp),
            force: Newton(1.0),
            smoothing: Newton(0.0),
            std_dev: Newton(1.0),
            band: [Newton(0.0), Newton(2.0)],
            calibrated: false,
            slot: Slot::Free,
            mode: Mode::Model,
            validity: Validity::Valid,
            reasons: Reasons::NONE,
            input_age: Second(0.0),
        }
    }
}
