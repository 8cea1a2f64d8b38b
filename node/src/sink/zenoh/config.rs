//! Settings of the mirror, their check, and what they mean to Zenoh.

use super::error::ZenohError;
use serde::{Deserialize, Serialize};
use std::net::{IpAddr, SocketAddr};
use zenoh::config::{EndPoint, WhatAmI};

/// How the process takes part in the Zenoh network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SessionMode {
    /// Listens, connects, or both.
    #[default]
    Peer,
    /// Connects to one router, through which everything goes.
    Client,
}

/// Encoding of the payloads under `state/`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Encoding {
    /// CBOR maps, `application/cbor`.
    #[default]
    Cbor,
    /// JSON objects, `application/json`.
    Json,
    /// The bytes of the ROS message with their four header bytes, `application/cdr`; `seq`, stamp and
    /// validity travel in the attachment.
    Cdr,
}

impl Encoding {
    /// The name, as in the configuration.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Cbor => "cbor",
            Self::Json => "json",
            Self::Cdr => "cdr",
        }
    }

    /// The media type, as Zenoh names the encoding.
    #[must_use]
    pub const fn media_type(self) -> &'static str {
        match self {
            Self::Cbor => "application/cbor",
            Self::Json => "application/json",
            Self::Cdr => "application/cdr",
        }
    }

    pub(super) const fn zenoh(self) -> zenoh::bytes::Encoding {
        match self {
            Self::Cbor => zenoh::bytes::Encoding::APPLICATION_CBOR,
            Self::Json => zenoh::bytes::Encoding::APPLICATION_JSON,
            Self::Cdr => zenoh::bytes::Encoding::APPLICATION_CDR,
        }
    }
}

/// Settings of the mirror. The default has no endpoint, which is an error: nothing listens unasked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ZenohConfig {
    /// Addresses to wait at, `tcp/ADDRESS:PORT`.
    pub listen: Vec<String>,
    /// Addresses of routers or peers, `tcp/ADDRESS:PORT`; tried again for as long as it takes.
    pub connect: Vec<String>,
    /// How to take part in the network.
    pub mode: SessionMode,
    /// Encoding of the payloads under `state/`.
    pub encoding: Encoding,
    /// Rate of each topic under `web/` at most, 20 to 50 Hz.
    pub web_rate_hz: f64,
    /// Length of the history that can be asked for, 0 to 600 s.
    pub history_s: f64,
    /// Allows endpoints that other machines can reach.
    pub allow_non_loopback: bool,
}

impl Default for ZenohConfig {
    fn default() -> Self {
        Self {
            listen: Vec::new(),
            connect: Vec::new(),
            mode: SessionMode::Peer,
            encoding: Encoding::Cbor,
            web_rate_hz: 30.0,
            history_s: 10.0,
            allow_non_loopback: false,
        }
    }
}

impl ZenohConfig {
    /// Checks the settings without opening anything.
    ///
    /// # Errors
    /// The first setting that cannot be used.
    pub fn validate(&self) -> Result<(), ZenohError> {
        if self.listen.is_empty() && self.connect.is_empty() {
            return Err(ZenohError::NoEndpoint);
        }
        if self.mode == SessionMode::Client {
            if !self.listen.is_empty() {
                return Err(ZenohError::ClientListens { listen: self.listen.clone() });
            }
            if self.connect.is_empty() {
                return Err(ZenohError::ClientWithoutConnect);
            }
        }
        in_range("web_rate_hz", self.web_rate_hz, 20.0..=50.0, "20 to 50 Hz")?;
        in_range("history_s", self.history_s, 0.0..=600.0, "0 (off) to 600 s")?;
        for endpoint in self.listen.iter().chain(&self.connect) {
            let loopback = is_loopback(endpoint)?;
            if !loopback && !self.allow_non_loopback {
                return Err(ZenohError::NotLoopback { endpoint: endpoint.clone() });
            }
        }
        Ok(())
    }

    /// All endpoints, for messages.
    pub(super) fn endpoints(&self) -> String {
        let all: Vec<&str> = self.listen.iter().chain(&self.connect).map(String::as_str).collect();
        all.join(", ")
    }

    /// Zenoh's own configuration. Starts from Zenoh's defaults, never from a file or the environment.
    pub(super) fn to_zenoh(&self) -> Result<zenoh::Config, ZenohError> {
        self.validate()?;
        let client = self.mode == SessionMode::Client;
        let mode = if client { WhatAmI::Client } else { WhatAmI::Peer };
        let settings = [
            ("mode", format!("\"{mode}\"")),
            // An empty list too must be said: unsaid, a peer listens on all interfaces.
            ("listen/endpoints", json_list(&self.listen)),
            ("connect/endpoints", json_list(&self.connect)),
            // A client's open blocks until it is connected, and is repeated by `Link`; a peer's does not.
            ("connect/timeout_ms", if client { "5000" } else { "-1" }.to_owned()),
            ("connect/exit_on_failure", client.to_string()),
            ("connect/retry", "{period_init_ms: 100, period_max_ms: 1000}".to_owned()),
            ("listen/timeout_ms", "0".to_owned()),
            ("listen/exit_on_failure", "true".to_owned()),
            ("scouting/multicast/enabled", "false".to_owned()),
            ("scouting/gossip/enabled", "false".to_owned()),
            // Without this, open waits half a second for a peer that may not be there.
            ("open/return_conditions/connect_scouted", "false".to_owned()),
            // Declarations and answers block on a consumer that does not read; a second, not five, is enough
            // to know it. Samples never block.
            ("transport/link/tx/queue/congestion_control/block/wait_before_close", "1000000".to_owned()),
        ];
        let mut config = zenoh::Config::default();
        for (key, value) in settings {
            config.insert_json5(key, &value).map_err(|error| ZenohError::Open {
                endpoints: self.endpoints(),
                reason: format!("{key} = {value}: {error}"),
            })?;
        }
        Ok(config)
    }

    /// The listen endpoint whose address is taken, if there is one.
    pub(super) fn taken_port(&self) -> Option<&str> {
        let taken = |endpoint: &&String| {
            let Some(address) = endpoint.strip_prefix("tcp/").and_then(|rest| rest.split(['?', '#']).next())
            else {
                return false;
            };
            std::net::TcpListener::bind(address)
                .is_err_and(|error| error.kind() == std::io::ErrorKind::AddrInUse)
        };
        self.listen.iter().find(taken).map(String::as_str)
    }
}

fn in_range(
    setting: &'static str,
    value: f64,
    range: std::ops::RangeInclusive<f64>,
    allowed: &'static str,
) -> Result<(), ZenohError> {
    if range.contains(&value) { Ok(()) } else { Err(ZenohError::Setting { setting, value, allowed }) }
}

fn json_list(endpoints: &[String]) -> String {
    serde_json::to_string(endpoints).expect("strings are always JSON")
}

/// True when only this machine can reach the endpoint.
fn is_loopback(endpoint: &str) -> Result<bool, ZenohError> {
    let refuse = |why: &str| ZenohError::Endpoint { endpoint: endpoint.to_owned(), why: why.to_owned() };
    let parsed: EndPoint = endpoint.parse().map_err(|error| refuse(&format!("{error}")))?;
    if parsed.protocol().as_str() != "tcp" {
        return Err(refuse("only tcp is built in"));
    }
    let address = parsed.address();
    let address = address.as_str();
    if let Ok(socket) = address.parse::<SocketAddr>() {
        return Ok(socket.ip().to_canonical().is_loopback());
    }
    let Some((host, port)) = address.rsplit_once(':') else { return Err(refuse("the port is missing")) };
    if port.parse::<u16>().is_err() {
        return Err(refuse("the port is not a number up to 65535"));
    }
    if host.is_empty() {
        return Err(refuse("the address is missing"));
    }
    // Any other name may resolve to anything.
    Ok(host == "localhost" || host.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn listening(endpoint: &str) -> ZenohConfig {
        ZenohConfig { listen: vec![endpoint.to_owned()], ..ZenohConfig::default() }
    }

    fn refusal(config: &ZenohConfig) -> String {
        config.validate().expect_err("these settings are wrong").to_string()
    }

    #[test]
    fn only_loopback_passes_without_leave() {
        for endpoint in ["tcp/127.0.0.1:7447", "tcp/127.8.9.1:1", "tcp/[::1]:7447", "tcp/localhost:7447"] {
            assert!(listening(endpoint).validate().is_ok(), "{endpoint}");
        }
        for endpoint in ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/192.168.1.4:7447", "tcp/router.local:7447"]
        {
            let config = listening(endpoint);
            assert!(refusal(&config).contains(endpoint), "{endpoint}");
            assert!(refusal(&config).contains("allow_non_loopback"));
            assert!(ZenohConfig { allow_non_loopback: true, ..config }.validate().is_ok(), "{endpoint}");
            let connect = ZenohConfig { connect: vec![endpoint.into()], ..ZenohConfig::default() };
            assert!(refusal(&connect).contains(endpoint), "{endpoint}");
        }
    }

    #[test]
    fn bad_settings_are_named() {
        for (config, word) in [
            (ZenohConfig::default(), "no endpoint"),
            (listening("udp/127.0.0.1:7447"), "only tcp"),
            (listening("127.0.0.1:7447"), "127.0.0.1:7447"),
            (listening("tcp/127.0.0.1"), "port is missing"),
            (listening("tcp/localhost:http"), "port is not a number"),
            (ZenohConfig { web_rate_hz: 100.0, ..listening("tcp/127.0.0.1:1") }, "web_rate_hz = 100"),
            (ZenohConfig { web_rate_hz: f64::NAN, ..listening("tcp/127.0.0.1:1") }, "web_rate_hz = NaN"),
            (ZenohConfig { history_s: -1.0, ..listening("tcp/127.0.0.1:1") }, "history_s = -1"),
            (ZenohConfig { mode: SessionMode::Client, ..listening("tcp/127.0.0.1:1") }, "only connects"),
        ] {
            let message = refusal(&config);
            assert!(message.contains(word), "{message}");
        }
    }
}
