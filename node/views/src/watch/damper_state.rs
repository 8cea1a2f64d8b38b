//! The values of a damper as sent to readers: SI values, ages, and the status in words.

use super::damper_message::TOPICS;
use super::damper_view::{DamperView, Received};
use mr_damper_base::alarm::ADVICE;
use mr_damper_msgs::{LimitedBy, Mode, Reasons, Validity};
use serde::Serialize;
use std::collections::BTreeMap;

/// A value with its age.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Aged<T> {
    /// Stamp, ns. An estimate has the stamp of the displacement that caused it.
    pub stamp_ns: i64,
    /// Time since it was received, s.
    pub age_s: f64,
    /// True when it is too old to describe the present.
    pub stale: bool,
    /// The value itself.
    #[serde(flatten)]
    pub value: T,
}

/// The newest estimate.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(missing_docs, reason = "same fields as the message ForceEstimate")]
pub struct EstimateReading {
    pub force_n: f64,
    pub std_dev_n: f64,
    pub band_low_n: f64,
    pub band_high_n: f64,
    pub band_calibrated: bool,
    pub mode: String,
    pub validity: String,
    pub reasons: Vec<String>,
    pub input_age_s: f64,
    pub model: String,
}

/// The newest measured force.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(missing_docs, reason = "the field name says it")]
pub struct MeasuredReading {
    pub force_n: f64,
}

/// The newest drive.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DriveReading {
    /// `A` or `V`.
    pub unit: &'static str,
    /// Current or voltage.
    pub value: f64,
}

/// The newest residual.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(missing_docs, reason = "same fields as the message ForceResidual")]
pub struct ResidualReading {
    pub measured_n: f64,
    pub predicted_n: f64,
    pub residual_n: f64,
    pub normalised: f64,
    pub windowed_rsse_n: f64,
    pub windowed_esr: f64,
    pub window_s: f64,
    pub alarm: bool,
}

/// The newest current command.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(missing_docs, reason = "same fields as the message CurrentCommand")]
pub struct CommandReading {
    pub current_a: f64,
    pub force_requested_n: f64,
    pub force_expected_n: f64,
    pub achievable: bool,
    pub dissipative: bool,
    pub limited_by: String,
    pub achievable_min_n: f64,
    pub achievable_max_n: f64,
}

/// A change of mode.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(missing_docs, reason = "same fields as the message ModeChange")]
pub struct PastModeChange {
    pub stamp_ns: i64,
    pub age_s: f64,
    pub from: String,
    pub to: String,
    pub reason: String,
}

/// Condition of a damper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum StatusLevel {
    /// The estimate is VALID, without alarm.
    Good,
    /// The estimate needs attention.
    Warning,
    /// The estimate must not be used.
    Bad,
    /// No estimates are received; the values are old.
    Silent,
}

/// All values of a damper.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DamperState {
    /// Name of the damper.
    pub name: String,
    /// Condition of the damper.
    pub level: StatusLevel,
    /// The condition in words.
    pub status: String,
    /// The newest estimate.
    pub estimate: Option<Aged<EstimateReading>>,
    /// The newest measured force.
    pub measured: Option<Aged<MeasuredReading>>,
    /// The newest drive.
    pub drive: Option<Aged<DriveReading>>,
    /// The newest residual.
    pub residual: Option<Aged<ResidualReading>>,
    /// The newest current command.
    pub command: Option<Aged<CommandReading>>,
    /// The last changes of mode, newest first.
    pub changes: Vec<PastModeChange>,
    /// Messages per second of each topic over the last second, without silent topics.
    pub rates_hz: BTreeMap<&'static str, f64>,
    /// Ages of the newest values of the lines of the charts, s. A line can be older than its reading: a node without displacement
    /// repeats its last stamp.
    pub points_age_s: BTreeMap<&'static str, f64>,
    /// Messages that could not be read.
    pub unreadable: u64,
}

/// The values of `view` at `now_s`.
pub(super) fn of(view: &DamperView, now_s: f64) -> DamperState {
    let (level, status) = words(view, now_s);
    let rates = TOPICS.iter().enumerate().map(|(index, name)| (*name, view.rate_hz(index, now_s)));
    DamperState {
        name: view.name().to_owned(),
        level,
        status,
        estimate: view.estimate.as_ref().map(|received| {
            let estimate = &received.what;
            let value = EstimateReading {
                force_n: estimate.force,
                std_dev_n: estimate.std_dev,
                band_low_n: estimate.band_low,
                band_high_n: estimate.band_high,
                band_calibrated: estimate.band_calibrated,
                mode: mode(estimate.mode),
                validity: validity(estimate.validity),
                reasons: reasons(estimate.reasons),
                input_age_s: estimate.input_age,
                model: estimate.model.clone(),
            };
            aged(received, estimate.header.stamp.as_nanos(), now_s, value)
        }),
        measured: view.measured.as_ref().map(|received| {
            aged(received, received.what.stamp_ns, now_s, MeasuredReading { force_n: received.what.force_n })
        }),
        drive: view.drive.as_ref().map(|received| {
            let unit = if received.what.is_voltage { "V" } else { "A" };
            aged(received, received.what.stamp_ns, now_s, DriveReading { unit, value: received.what.value })
        }),
        residual: view.residual.as_ref().map(|received| {
            let residual = &received.what;
            let value = ResidualReading {
                measured_n: residual.measured,
                predicted_n: residual.predicted,
                residual_n: residual.residual,
                normalised: residual.normalised,
                windowed_rsse_n: residual.windowed_rsse,
                windowed_esr: residual.windowed_esr,
                window_s: residual.window,
                alarm: residual.alarm,
            };
            aged(received, residual.header.stamp.as_nanos(), now_s, value)
        }),
        command: view.command.as_ref().map(|received| {
            let command = &received.what;
            let value = CommandReading {
                current_a: command.current,
                force_requested_n: command.force_requested,
                force_expected_n: command.force_expected,
                achievable: command.achievable,
                dissipative: command.dissipative,
                limited_by: LimitedBy::try_from(command.limited_by)
                    .map_or_else(|unknown| unknown.to_string(), |limit| limit.name().to_owned()),
                achievable_min_n: command.achievable_min,
                achievable_max_n: command.achievable_max,
            };
            aged(received, command.header.stamp.as_nanos(), now_s, value)
        }),
        changes: view.changes.iter().map(|received| change(received, now_s)).collect(),
        rates_hz: rates.filter(|(_, hz)| *hz > 0.0).collect(),
        points_age_s: view.line_ages_s(now_s),
        unreadable: view.unreadable,
    }
}

fn aged<T, U>(received: &Received<T>, stamp_ns: i64, now_s: f64, value: U) -> Aged<U> {
    Aged { stamp_ns, age_s: received.age_s(now_s), stale: received.is_stale(now_s), value }
}

fn change(received: &Received<mr_damper_msgs::ModeChange>, now_s: f64) -> PastModeChange {
    PastModeChange {
        stamp_ns: received.what.header.stamp.as_nanos(),
        age_s: received.age_s(now_s),
        from: mode(received.what.from_mode),
        to: mode(received.what.to_mode),
        reason: received.what.reason.clone(),
    }
}

/// Name of a mode. An unknown number, for example from a newer node, is shown as a number.
fn mode(number: u8) -> String {
    Mode::try_from(number).map_or_else(|unknown| unknown.to_string(), |mode| mode.name().to_owned())
}

fn validity(number: u8) -> String {
    Validity::try_from(number)
        .map_or_else(|unknown| unknown.to_string(), |validity| validity.name().to_owned())
}

fn reasons(reasons: Reasons) -> Vec<String> {
    let mut names: Vec<String> = reasons.names().map(str::to_owned).collect();
    if reasons.unknown_bits() != 0 {
        names.push(format!("{:#x}", reasons.unknown_bits()));
    }
    names
}

/// The condition of the damper, also in words. Silence has priority, because older values then say nothing about the present.
fn words(view: &DamperView, now_s: f64) -> (StatusLevel, String) {
    let moves = view.rate_hz(0, now_s) > 0.0;
    let Some(estimate) = &view.estimate else {
        let why = if moves {
            "displacement is received: is the node active?"
        } else {
            "no displacement either: is the node running, and does a sensor publish?"
        };
        return (StatusLevel::Silent, format!("no estimate received yet; {why}"));
    };
    if estimate.is_stale(now_s) {
        let beside = if moves { "although displacement is received" } else { "and no displacement either" };
        return (StatusLevel::Silent, format!("no estimate for {}, {beside}", span(estimate.age_s(now_s))));
    }
    let message = &estimate.what;
    let mut text = format!("{}, mode {}", validity(message.validity), mode(message.mode));
    let why = reasons(message.reasons);
    if !why.is_empty() {
        text += &format!(": {}", why.join(", ").to_lowercase().replace('_', " "));
    }
    let alarmed =
        view.residual.as_ref().is_some_and(|residual| residual.what.alarm && !residual.is_stale(now_s));
    let level = match Validity::try_from(message.validity) {
        Ok(Validity::Valid) if !alarmed => StatusLevel::Good,
        Ok(Validity::Invalid) | Err(_) => StatusLevel::Bad,
        Ok(_) => StatusLevel::Warning,
    };
    if alarmed {
        text += &format!("; residual alarm: {ADVICE}");
    }
    (level, text)
}

/// A duration as text.
pub(super) fn span(seconds: f64) -> String {
    if seconds < 100.0 { format!("{seconds:.1} s") } else { format!("{:.0} min", seconds / 60.0) }
}
