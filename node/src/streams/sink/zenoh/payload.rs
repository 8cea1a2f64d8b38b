//! The published payloads: one serde type per kind of event, with units in the field names.
//!
//! Every payload begins with `seq`, `stamp_ns` and `validity`. A number that is not finite becomes null, because JSON
//! cannot represent NaN. CBOR does the same, so that a consumer need not care which of the two it reads.

use super::topic::Topic;
use crate::estimation::wire::ModelNames;
use mr_damper_model::inverse::LimitedBy;
use mr_damper_model::pipeline::{
    AlarmChange, Estimate, Event, Mode, Reasons, Refusal, Residual, StampedCommand, Transition, Validity,
};
use mr_damper_model::sample::{Drive, Reading, Sample, Stamp};
use mr_damper_model::units::{Ampere, Celsius, Metre, MetrePerSecond, Newton, Volt};
use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

/// An event with its published validity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Item {
    pub(super) event: Event,
    pub(super) validity: Validity,
}

impl Item {
    /// Determines the validity of `event`. A residual has the validity of the estimate with the same stamp, which `of_stamp`
    /// looks up.
    pub(super) fn new(event: Event, of_stamp: impl FnOnce(Stamp) -> Option<Validity>) -> Self {
        let validity = match &event {
            Event::Input(_) => Validity::Valid,
            Event::Refusal(_) => Validity::Invalid,
            Event::Estimate(estimate) => estimate.validity,
            Event::Residual(residual) if !residual.residual.is_finite() => Validity::Invalid,
            Event::Residual(residual) => of_stamp(residual.stamp).unwrap_or(Validity::Degraded),
            Event::Transition(transition) => match transition.to {
                Mode::Arx | Mode::Model => Validity::Valid,
                Mode::ArxCoast => Validity::Degraded,
                Mode::Hold => Validity::Stale,
                Mode::Fault => Validity::Invalid,
            },
            Event::Alarm(alarm) if alarm.raised => Validity::Degraded,
            Event::Alarm(_) => Validity::Valid,
            Event::Command(commanded) => match commanded.command.limited_by {
                LimitedBy::None => Validity::Valid,
                LimitedBy::Safe | LimitedBy::NoInverse => Validity::Stale,
                _ => Validity::Degraded,
            },
        };
        Self { event, validity }
    }

    pub(super) fn topic(&self) -> Topic {
        Topic::of_event(&self.event)
    }

    pub(super) fn stamp(&self) -> Stamp {
        match &self.event {
            Event::Input(sample) => sample.stamp,
            Event::Refusal(refusal) => refusal.sample.stamp,
            Event::Estimate(estimate) => estimate.stamp,
            Event::Residual(residual) => residual.stamp,
            Event::Transition(transition) => transition.stamp,
            Event::Alarm(alarm) => alarm.stamp,
            Event::Command(commanded) => commanded.stamp,
        }
    }

    /// The payload, for any serde format.
    pub(super) fn payload<'a>(&self, seq: u64, names: &'a ModelNames) -> Payload<'a> {
        let head = Head { seq, stamp_ns: self.stamp().nanos(), validity: self.validity.name() };
        match &self.event {
            Event::Input(sample) => Payload::Input(InputPayload { head, sample: *sample }),
            Event::Refusal(refusal) => Payload::Refused(RefusedPayload::new(head, refusal)),
            Event::Estimate(estimate) => Payload::Estimate(EstimatePayload::new(head, estimate, names)),
            Event::Residual(residual) => Payload::Residual(ResidualPayload::new(head, residual)),
            Event::Transition(transition) => Payload::Mode(ModePayload::new(head, transition)),
            Event::Alarm(alarm) => Payload::Alarm(AlarmPayload::new(head, alarm)),
            Event::Command(commanded) => Payload::Command(CommandPayload::new(head, commanded)),
        }
    }
}

/// The value, or `None` (null) unless it is finite.
pub(super) fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// The first fields of every payload.
#[derive(Debug, Clone, Copy)]
pub(super) struct Head {
    seq: u64,
    stamp_ns: i64,
    validity: &'static str,
}

/// A payload. It is untagged, because the key determines its type.
#[derive(Debug, Serialize)]
#[serde(untagged)]
pub(super) enum Payload<'a> {
    Input(InputPayload),
    Estimate(EstimatePayload<'a>),
    Residual(ResidualPayload),
    Mode(ModePayload),
    Refused(RefusedPayload),
    Alarm(AlarmPayload),
    Command(CommandPayload),
}

/// An accepted input. The name of its value field depends on the channel.
#[derive(Debug)]
pub(super) struct InputPayload {
    head: Head,
    sample: Sample,
}

impl Serialize for InputPayload {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(4))?;
        map.serialize_entry("seq", &self.head.seq)?;
        map.serialize_entry("stamp_ns", &self.head.stamp_ns)?;
        map.serialize_entry("validity", self.head.validity)?;
        let field = Topic::of_reading(self.sample.reading).value_field();
        map.serialize_entry(field, &finite(self.sample.reading.get()))?;
        map.end()
    }
}

/// A force estimate.
#[derive(Debug, Serialize)]
pub(super) struct EstimatePayload<'a> {
    seq: u64,
    stamp_ns: i64,
    validity: &'static str,
    force_n: Option<f64>,
    std_dev_n: Option<f64>,
    model: &'a str,
    mode: &'static str,
    #[serde(serialize_with = "reason_names")]
    reasons: Reasons,
    input_age_s: Option<f64>,
    band_low_n: Option<f64>,
    band_high_n: Option<f64>,
    band_calibrated: bool,
}

impl<'a> EstimatePayload<'a> {
    fn new(head: Head, estimate: &Estimate, names: &'a ModelNames) -> Self {
        Self {
            seq: head.seq,
            stamp_ns: head.stamp_ns,
            validity: head.validity,
            force_n: finite(estimate.force.get()),
            std_dev_n: finite(estimate.std_dev.get()),
            model: names.of(estimate.slot),
            mode: estimate.mode.name(),
            reasons: estimate.reasons,
            input_age_s: finite(estimate.input_age.get()),
            band_low_n: finite(estimate.band[0].get()),
            band_high_n: finite(estimate.band[1].get()),
            band_calibrated: estimate.calibrated,
        }
    }
}

fn reason_names<S: Serializer>(reasons: &Reasons, serializer: S) -> Result<S::Ok, S::Error> {
    let names: Vec<&str> = reasons.names().collect();
    names.serialize(serializer)
}

/// A residual.
#[derive(Debug, Serialize)]
pub(super) struct ResidualPayload {
    seq: u64,
    stamp_ns: i64,
    validity: &'static str,
    measured_n: Option<f64>,
    predicted_n: Option<f64>,
    residual_n: Option<f64>,
    normalised: Option<f64>,
    windowed_rsse_n: Option<f64>,
    windowed_esr: Option<f64>,
    window_s: Option<f64>,
    alarm: bool,
}

impl ResidualPayload {
    fn new(head: Head, residual: &Residual) -> Self {
        Self {
            seq: head.seq,
            stamp_ns: head.stamp_ns,
            validity: head.validity,
            measured_n: finite(residual.measured.get()),
            predicted_n: finite(residual.predicted.get()),
            residual_n: finite(residual.residual.get()),
            normalised: finite(residual.normalised),
            windowed_rsse_n: finite(residual.windowed_rsse.get()),
            windowed_esr: finite(residual.windowed_esr),
            window_s: finite(residual.window.get()),
            alarm: residual.alarm,
        }
    }
}

/// A change of mode.
#[derive(Debug, Serialize)]
pub(super) struct ModePayload {
    seq: u64,
    stamp_ns: i64,
    validity: &'static str,
    from_mode: &'static str,
    to_mode: &'static str,
    reason: &'static str,
}

impl ModePayload {
    fn new(head: Head, transition: &Transition) -> Self {
        Self {
            seq: head.seq,
            stamp_ns: head.stamp_ns,
            validity: head.validity,
            from_mode: transition.from.name(),
            to_mode: transition.to.name(),
            reason: transition.cause.text(),
        }
    }
}

/// A refused sample.
#[derive(Debug, Serialize)]
pub(super) struct RefusedPayload {
    seq: u64,
    stamp_ns: i64,
    validity: &'static str,
    topic: &'static str,
    value: Option<f64>,
    unit: &'static str,
    reason: &'static str,
}

impl RefusedPayload {
    fn new(head: Head, refusal: &Refusal) -> Self {
        let reading = refusal.sample.reading;
        Self {
            seq: head.seq,
            stamp_ns: head.stamp_ns,
            validity: head.validity,
            topic: Topic::of_reading(reading).name(),
            value: finite(reading.get()),
            unit: unit_of(reading),
            reason: refusal.why.text(),
        }
    }
}

#[derive(Debug, Serialize)]
pub(super) struct AlarmPayload {
    seq: u64,
    stamp_ns: i64,
    validity: &'static str,
    raised: bool,
    ratio: Option<f64>,
}

impl AlarmPayload {
    fn new(head: Head, alarm: &AlarmChange) -> Self {
        Self {
            seq: head.seq,
            stamp_ns: head.stamp_ns,
            validity: head.validity,
            raised: alarm.raised,
            ratio: finite(alarm.ratio),
        }
    }
}

/// A current command.
#[derive(Debug, Serialize)]
pub(super) struct CommandPayload {
    seq: u64,
    stamp_ns: i64,
    validity: &'static str,
    current_a: f64,
    force_requested_n: Option<f64>,
    force_expected_n: Option<f64>,
    achievable: bool,
    dissipative: bool,
    limited_by: &'static str,
    achievable_min_n: Option<f64>,
    achievable_max_n: Option<f64>,
}

impl CommandPayload {
    fn new(head: Head, commanded: &StampedCommand) -> Self {
        let command = &commanded.command;
        Self {
            seq: head.seq,
            stamp_ns: head.stamp_ns,
            validity: head.validity,
            current_a: command.current.get(),
            force_requested_n: finite(command.requested.get()),
            force_expected_n: finite(command.expected.get()),
            achievable: command.is_achievable,
            dissipative: command.dissipative,
            limited_by: command.limited_by.name(),
            achievable_min_n: finite(command.achievable[0].get()),
            achievable_max_n: finite(command.achievable[1].get()),
        }
    }
}

const fn unit_of(reading: Reading) -> &'static str {
    match reading {
        Reading::Displacement(_) => Metre::SYMBOL,
        Reading::Velocity(_) | Reading::BodyVelocity(_) => MetrePerSecond::SYMBOL,
        Reading::Drive(Drive::CoilCurrent(_)) => Ampere::SYMBOL,
        Reading::Drive(Drive::CommandVoltage(_)) => Volt::SYMBOL,
        Reading::Force(_) | Reading::ForceRequest(_) => Newton::SYMBOL,
        Reading::CaseTemperature(_) => Celsius::SYMBOL,
    }
}

#[cfg(test)]
mod tests {
    use super::super::samples;
    use super::*;

    #[test]
    fn payloads_have_exactly_the_fields_that_meta_lists() {
        let names = samples::names();
        let mut seen = Vec::new();
        for event in samples::one_of_each() {
            let item = Item::new(event, |_| Some(Validity::Valid));
            let value = serde_json::to_value(item.payload(7, &names)).expect("payloads are JSON");
            let object = value.as_object().expect("payloads are objects");
            let mut promised = vec!["seq", "stamp_ns", "validity"];
            promised.extend(item.topic().fields().iter().map(|(name, _, _)| *name));
            promised.sort_unstable();
            let mut keys: Vec<&str> = object.keys().map(String::as_str).collect();
            keys.sort_unstable();
            assert_eq!(keys, promised, "{}", item.topic().name());
            assert_eq!(value["seq"], 7);
            seen.push(item.topic().name());
        }
        seen.sort_unstable();
        let mut all = Topic::ALL.map(Topic::name);
        all.sort_unstable();
        assert_eq!(seen, all, "samples::one_of_each lacks a topic");
    }

    #[test]
    fn values_that_are_not_finite_are_null_in_json_and_cbor() {
        let names = samples::names();
        let Event::Estimate(estimate) = samples::estimate(5, 1.0) else {
            unreachable!("made as an estimate")
        };
        let broken = Estimate {
            force: Newton(f64::NAN),
            std_dev: Newton(f64::INFINITY),
            validity: Validity::Invalid,
            reasons: Reasons(Reasons::DRIVE_MISSING.0 | Reasons::LATE.0),
            ..estimate
        };
        let item = Item::new(Event::Estimate(broken), |_| None);
        let payload = item.payload(1, &names);
        let json = serde_json::to_value(&payload).expect("payloads are JSON");
        assert!(json["force_n"].is_null() && json["std_dev_n"].is_null(), "{json}");
        assert_eq!(json["validity"], "INVALID");
        assert_eq!(json["reasons"], serde_json::json!(["DRIVE_MISSING", "LATE"]));
        let mut bytes = Vec::new();
        ciborium::into_writer(&payload, &mut bytes).expect("payloads are CBOR");
        let cbor: serde_json::Value = ciborium::from_reader(bytes.as_slice()).expect("written just now");
        assert_eq!(cbor, json);
    }

    #[test]
    fn a_residual_shares_the_validity_of_its_estimate() {
        let residual = samples::residual(5, 1.0);
        let validity = |of_stamp: Option<Validity>| Item::new(residual, |_| of_stamp).validity;
        assert_eq!(validity(Some(Validity::Extrapolating)), Validity::Extrapolating);
        assert_eq!(validity(None), Validity::Degraded);
        assert_eq!(
            Item::new(samples::residual(5, f64::NAN), |_| Some(Validity::Valid)).validity,
            Validity::Invalid
        );
    }
}
