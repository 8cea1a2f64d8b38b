//! Watches dampers over the Zenoh mirror: subscribes to `mr_damper/<damper>/web/<topic>`, which is JSON at a reduced rate.
//!
//! Rates are limited by the mirror (`zenoh.web_rate_hz`) and are not the node's rates. Dampers are found by their keys.

use super::source::Seen;
use crate::settings::config::RosArgs;
use crate::settings::error::{NodeError, PartError};
use crate::zenoh::session::{Link, ZenohConfig};
use mr_damper_model::sample::Stamp;
use mr_damper_msgs::standard::Temperature;
use mr_damper_msgs::{
    CoilCurrent, CommandVoltage, CurrentCommand, Displacement, Force, ForceEstimate, ForceResidual,
    LimitedBy, Mode, ModeChange, Reasons, Validity, Velocity,
};
use mr_damper_views::watch::{DamperMessage, DamperRegistry, MOST_DAMPERS, TOPICS};
use serde::Deserialize;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use zenoh::Wait;

/// Keys of all dampers. A damper's name may contain `/`.
const KEYS: &str = "mr_damper/**/web/*";
/// Maximum number of queued samples: more than a second of sixteen dampers.
const BACKLOG: usize = 16_384;
/// Interval at which connections are counted, s.
const CHECK_EVERY_S: f64 = 1.0;
/// Time without connection after which a warning is logged, s.
const PATIENCE_S: f64 = 3.0;
/// Number for unknown names, which the interface does not use.
const UNKNOWN: u8 = u8::MAX;

/// A received sample: key and payload.
type Raw = (String, Vec<u8>);

/// Reasons why a mirror cannot be watched.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ZenohWatchError {
    /// The session was closed before the subscription.
    #[error("opening a Zenoh session to {endpoint}: it was closed")]
    Closed {
        /// The address of the mirror.
        endpoint: String,
    },
    /// Zenoh refuses the subscription.
    #[error("opening a Zenoh session to {endpoint}: {why}")]
    Refused {
        /// The address of the mirror.
        endpoint: String,
        /// Zenoh's reason.
        why: zenoh::Error,
    },
}

impl PartError for ZenohWatchError {}

/// A subscription to the mirror of all dampers.
pub struct ZenohWatcher {
    link: Link,
    endpoint: String,
    samples: Receiver<Raw>,
    lost: Arc<AtomicU64>,
    names: Vec<String>,
    checked_s: f64,
    /// True after a warning that there was no connection yet.
    is_alone: bool,
    connected: Option<usize>,
}

impl ZenohWatcher {
    /// Connects to the mirror at `endpoint`, now or as soon as it is available, with the users and certificates of the Zenoh
    /// configuration `file`. If `names` is not empty, only these dampers are watched.
    ///
    /// # Errors
    /// When the endpoint is invalid, the file cannot be used, or Zenoh cannot open a session.
    pub fn start(endpoint: &str, file: Option<&Path>, names: &[String]) -> Result<Self, NodeError> {
        // The user gave the address explicitly, so it need not be on loopback.
        let config = ZenohConfig {
            file: file.map(Path::to_owned),
            connect: vec![endpoint.to_owned()],
            allow_non_loopback: true,
            ..ZenohConfig::default()
        };
        config.validate().map_err(|error| NodeError::Usage(format!("--zenoh: {error}")))?;
        let link = Link::open(&config)?;
        let session =
            link.session().ok_or_else(|| ZenohWatchError::Closed { endpoint: endpoint.to_owned() })?;
        let (sender, samples) = sync_channel(BACKLOG);
        let lost = Arc::new(AtomicU64::new(0));
        let dropped = Arc::clone(&lost);
        session
            .declare_subscriber(KEYS)
            .callback(move |sample| {
                let raw = (sample.key_expr().as_str().to_owned(), sample.payload().to_bytes().into_owned());
                // Zenoh's threads must not wait for this queue.
                if sender.try_send(raw).is_err() {
                    dropped.fetch_add(1, Ordering::Relaxed);
                }
            })
            .background()
            .wait()
            .map_err(|why| ZenohWatchError::Refused { endpoint: endpoint.to_owned(), why })?;
        let names = names.iter().map(|name| name.trim_matches('/').to_owned()).collect();
        Ok(Self {
            link,
            endpoint: endpoint.to_owned(),
            samples,
            lost,
            names,
            checked_s: f64::NEG_INFINITY,
            is_alone: false,
            connected: None,
        })
    }

    /// Adds the dampers given by name to `registry`, and logs when the connection to the mirror is missing or lost. Once a second.
    pub fn check_connection(&mut self, registry: &mut DamperRegistry, now_s: f64) {
        if now_s - self.checked_s < CHECK_EVERY_S {
            return;
        }
        self.checked_s = now_s;
        self.names.iter().for_each(|name| registry.add(name));
        let connected = self.link.connected();
        let before = self.connected.replace(connected);
        match (before, connected) {
            // On the first checks it is too early for a warning.
            (None, 0) => {
                self.connected = None;
                if now_s > PATIENCE_S && !self.is_alone {
                    self.is_alone = true;
                    tracing::warn!(
                        "cannot connect to a Zenoh mirror or router at {}, retrying: is it running, and does it require a user or a \
                         certificate (--zenoh-config)?",
                        self.endpoint
                    );
                }
            }
            (None, _) => {}
            (Some(before), now) if before == now => {}
            (Some(_), 0) => tracing::warn!("lost the connection to {}, retrying", self.endpoint),
            (Some(_), _) => {}
        }
        let lost = self.lost.swap(0, Ordering::Relaxed);
        if lost > 0 {
            tracing::warn!(
                samples = lost,
                "samples arrived faster than they were processed, and were dropped"
            );
        }
    }

    /// Records all received samples in `registry`, and shows each to `seen`, with the full name that its topic has in ROS.
    pub fn drain(&self, registry: &mut DamperRegistry, now_s: f64, seen: Seen<'_>) {
        while let Ok((key, payload)) = self.samples.try_recv() {
            let Some((damper, topic)) = parts(&key) else { continue };
            if !self.names.is_empty() && self.names.iter().all(|name| name != damper) {
                continue;
            }
            if registry.view(damper).is_none() && registry.len() < MOST_DAMPERS {
                tracing::info!(damper, key, "watching");
                registry.add(damper);
            }
            let Some(view) = registry.view(damper) else { continue };
            match decode(topic, &payload) {
                Ok(Some(message)) => {
                    seen(&ros_topic(damper, topic), &message);
                    view.take(message, now_s);
                }
                Ok(None) => {}
                Err(error) => {
                    tracing::debug!(key, %error, "cannot read a sample");
                    view.note_unreadable();
                }
            }
        }
    }

    /// Closes the session.
    pub fn stop(self) {
        self.link.close();
    }
}

/// Damper and topic of a key.
fn parts(key: &str) -> Option<(&str, &str)> {
    key.strip_prefix("mr_damper/")?.rsplit_once("/web/")
}

/// The full name of a topic in ROS. A damper in the root namespace has the name of its node on Zenoh.
fn ros_topic(damper: &str, topic: &str) -> String {
    if damper == RosArgs::default().node_name() { format!("/{topic}") } else { format!("/{damper}/{topic}") }
}

/// A payload of any topic. Fields that are missing or null are `None`.
#[derive(Debug, Deserialize)]
struct Payload {
    stamp_ns: i64,
    displacement_m: Option<f64>,
    velocity_m_s: Option<f64>,
    current_a: Option<f64>,
    command_v: Option<f64>,
    force_n: Option<f64>,
    case_temp_c: Option<f64>,
    std_dev_n: Option<f64>,
    model: Option<String>,
    mode: Option<String>,
    validity: Option<String>,
    reasons: Option<Vec<String>>,
    input_age_s: Option<f64>,
    band_low_n: Option<f64>,
    band_high_n: Option<f64>,
    band_calibrated: Option<bool>,
    measured_n: Option<f64>,
    predicted_n: Option<f64>,
    residual_n: Option<f64>,
    normalised: Option<f64>,
    windowed_rsse_n: Option<f64>,
    windowed_esr: Option<f64>,
    window_s: Option<f64>,
    alarm: Option<bool>,
    force_requested_n: Option<f64>,
    force_expected_n: Option<f64>,
    achievable: Option<bool>,
    dissipative: Option<bool>,
    limited_by: Option<String>,
    achievable_min_n: Option<f64>,
    achievable_max_n: Option<f64>,
    from_mode: Option<String>,
    to_mode: Option<String>,
    reason: Option<String>,
}

/// Converts a sample of `topic`, the JSON of the mirror's `web/` keys, to a message. `None` for topics that the view does not use.
///
/// # Errors
/// When the payload is not a payload of the mirror.
pub fn decode(topic: &str, payload: &[u8]) -> Result<Option<DamperMessage>, serde_json::Error> {
    if !TOPICS.contains(&topic) {
        return Ok(None);
    }
    let p: Payload = serde_json::from_slice(payload)?;
    let header = crate::estimation::wire::header(Stamp::from_nanos(p.stamp_ns), "");
    let number = |value: Option<f64>| value.unwrap_or(f64::NAN);
    let variance = f64::NAN;
    Ok(Some(match topic {
        "displacement" => DamperMessage::Displacement(Displacement {
            header,
            displacement: number(p.displacement_m),
            variance,
        }),
        "velocity" => {
            DamperMessage::Velocity(Velocity { header, velocity: number(p.velocity_m_s), variance })
        }
        "body_velocity" => {
            DamperMessage::BodyVelocity(Velocity { header, velocity: number(p.velocity_m_s), variance })
        }
        "coil_current" => {
            DamperMessage::CoilCurrent(CoilCurrent { header, current: number(p.current_a), variance })
        }
        "command_voltage" => {
            DamperMessage::CommandVoltage(CommandVoltage { header, voltage: number(p.command_v), variance })
        }
        "measured_force" => {
            DamperMessage::MeasuredForce(Force { header, force: number(p.force_n), variance })
        }
        "force_request" => DamperMessage::ForceRequest(Force { header, force: number(p.force_n), variance }),
        "case_temperature" => DamperMessage::CaseTemperature(Temperature {
            header,
            temperature: number(p.case_temp_c),
            variance,
        }),
        "force_estimate" => DamperMessage::Estimate(ForceEstimate {
            header,
            force: number(p.force_n),
            std_dev: number(p.std_dev_n),
            model: p.model.unwrap_or_default(),
            mode: mode(p.mode.as_deref()),
            validity: find(Validity::ALL, Validity::name, p.validity.as_deref()),
            reasons: reasons(&p.reasons.unwrap_or_default()),
            input_age: number(p.input_age_s),
            band_low: number(p.band_low_n),
            band_high: number(p.band_high_n),
            band_calibrated: p.band_calibrated.unwrap_or(false),
        }),
        "force_residual" => DamperMessage::Residual(ForceResidual {
            header,
            measured: number(p.measured_n),
            predicted: number(p.predicted_n),
            residual: number(p.residual_n),
            normalised: number(p.normalised),
            windowed_rsse: number(p.windowed_rsse_n),
            windowed_esr: number(p.windowed_esr),
            window: number(p.window_s),
            alarm: p.alarm.unwrap_or(false),
        }),
        "current_command" => DamperMessage::Command(CurrentCommand {
            header,
            current: number(p.current_a),
            force_requested: number(p.force_requested_n),
            force_expected: number(p.force_expected_n),
            achievable: p.achievable.unwrap_or(false),
            dissipative: p.dissipative.unwrap_or(false),
            limited_by: find(LimitedBy::ALL, LimitedBy::name, p.limited_by.as_deref()),
            achievable_min: number(p.achievable_min_n),
            achievable_max: number(p.achievable_max_n),
        }),
        _ => DamperMessage::Mode(ModeChange {
            header,
            from_mode: mode(p.from_mode.as_deref()),
            to_mode: mode(p.to_mode.as_deref()),
            reason: p.reason.unwrap_or_default(),
        }),
    }))
}

fn mode(name: Option<&str>) -> u8 {
    find(Mode::ALL, Mode::name, name)
}

/// The number of a name, ignoring case; [`UNKNOWN`] for an unknown name.
fn find<T: Copy + Into<u8>>(all: &[T], name_of: fn(T) -> &'static str, name: Option<&str>) -> u8 {
    let is_it = |value: &&T| name.is_some_and(|name| name_of(**value).eq_ignore_ascii_case(name));
    all.iter().find(is_it).map_or(UNKNOWN, |value| (*value).into())
}

/// The bits of names. An unknown name gives a bit that is unknown too.
fn reasons(names: &[String]) -> Reasons {
    let bit = |name: &String| {
        let known = Reasons::ALL.iter().find(|(known, _)| known == name);
        known.map_or(Reasons::from_bits(1 << 31), |(_, reason)| *reason)
    };
    names.iter().map(bit).fold(Reasons::NONE, |all, reason| all | reason)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(topic: &str, payload: &str) -> DamperMessage {
        decode(topic, payload.as_bytes()).expect("it is read").expect("a known topic")
    }

    #[test]
    fn payloads_are_converted_back_to_their_messages() {
        let estimate = r#"{"seq": 1, "stamp_ns": 7, "validity": "EXTRAPOLATING", "force_n": 119.0, "std_dev_n": null,
            "model": "m", "mode": "arx_coast", "reasons": ["OUTSIDE_ENVELOPE", "OF_A_NEWER_NODE"], "input_age_s": 0.002,
            "band_low_n": 1.0, "band_high_n": 2.0, "band_calibrated": true}"#;
        let DamperMessage::Estimate(estimate) = read("force_estimate", estimate) else {
            panic!("an estimate")
        };
        assert_eq!((estimate.header.stamp.as_nanos(), estimate.force), (7, 119.0));
        assert!(estimate.std_dev.is_nan());
        assert_eq!(
            (estimate.mode, estimate.validity),
            (Mode::ArxCoast.into(), Validity::Extrapolating.into())
        );
        assert_eq!(estimate.reasons.names().collect::<Vec<_>>(), ["OUTSIDE_ENVELOPE"]);
        assert_ne!(estimate.reasons.unknown_bits(), 0);
        assert_eq!((estimate.band_low, estimate.band_high, estimate.band_calibrated), (1.0, 2.0, true));

        let command = r#"{"seq": 1, "stamp_ns": 14, "validity": "DEGRADED", "current_a": 2.5, "force_requested_n": 900.0,
            "force_expected_n": 700.0, "achievable": false, "dissipative": true, "limited_by": "CURRENT_MAX",
            "achievable_min_n": 80.0, "achievable_max_n": 700.0}"#;
        let DamperMessage::Command(command) = read("current_command", command) else { panic!("a command") };
        assert_eq!((command.current, command.limited_by), (2.5, LimitedBy::CurrentMax.into()));
        assert_eq!((command.achievable_min, command.force_requested), (80.0, 900.0));

        let residual = r#"{"seq": 1, "stamp_ns": 1, "validity": "VALID", "measured_n": 3.0, "predicted_n": 1.0,
            "residual_n": 2.0, "normalised": 0.5, "windowed_rsse_n": 4.0, "windowed_esr": 0.25, "window_s": 5.0, "alarm": true}"#;
        let DamperMessage::Residual(residual) = read("force_residual", residual) else {
            panic!("a residual")
        };
        assert_eq!((residual.residual, residual.windowed_esr, residual.alarm), (2.0, 0.25, true));

        let mode = r#"{"seq": 1, "stamp_ns": 1, "validity": "VALID", "from_mode": "model", "to_mode": "dream", "reason": "r"}"#;
        let DamperMessage::Mode(mode) = read("mode", mode) else { panic!("a change of mode") };
        assert_eq!((mode.from_mode, mode.to_mode), (Mode::Model.into(), UNKNOWN));
        for (topic, field) in [
            ("displacement", "displacement_m"),
            ("velocity", "velocity_m_s"),
            ("coil_current", "current_a"),
            ("command_voltage", "command_v"),
            ("measured_force", "force_n"),
            ("case_temperature", "case_temp_c"),
            ("force_request", "force_n"),
            ("body_velocity", "velocity_m_s"),
        ] {
            let input =
                read(topic, &format!(r#"{{"seq": 1, "stamp_ns": 5, "validity": "VALID", "{field}": 1.5}}"#));
            assert_eq!(TOPICS[input.topic()], topic);
            assert!(format!("{input:?}").contains("1.5"), "{input:?}");
        }
    }

    #[test]
    fn other_topics_are_ignored_and_invalid_payloads_are_errors() {
        assert!(matches!(decode("refused", b"{"), Ok(None)));
        assert!(decode("displacement", b"{}").is_err() && decode("mode", b"\xff").is_err());
        assert_eq!(parts("mr_damper/front/left/web/mode"), Some(("front/left", "mode")));
        assert_eq!(parts("mr_damper/left/state/mode"), None);
        assert_eq!(ros_topic("front/left", "mode"), "/front/left/mode");
        assert_eq!(ros_topic("mr_damper", "mode"), "/mode", "the name of a damper in the root namespace");
    }
}
