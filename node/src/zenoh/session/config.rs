//! Settings of the session and of the mirrors.

use super::error::ZenohError;
use super::session_config::{SessionConfig, plain};
use serde::{Deserialize, Serialize};
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use zenoh::config::EndPoint;

/// Role of the process in the Zenoh network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SessionMode {
    /// Listens, connects, or both.
    #[default]
    Peer,
    /// Connects to one router, which carries all traffic.
    Client,
    /// Is a router: forwards traffic between all connected sessions.
    Router,
}

impl SessionMode {
    /// The name used in the configuration.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Peer => "peer",
            Self::Client => "client",
            Self::Router => "router",
        }
    }

    /// The mode with this name; `None` when it is unknown.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        [Self::Peer, Self::Client, Self::Router].into_iter().find(|mode| mode.name() == name)
    }
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
    /// The ROS message as CDR, including its four header bytes, `application/cdr`; `seq`, stamp and validity are in the
    /// attachment.
    Cdr,
}

impl Encoding {
    /// The name used in the configuration.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Cbor => "cbor",
            Self::Json => "json",
            Self::Cdr => "cdr",
        }
    }

    /// The media type, which is Zenoh's name of the encoding.
    #[must_use]
    pub const fn media_type(self) -> &'static str {
        match self {
            Self::Cbor => "application/cbor",
            Self::Json => "application/json",
            Self::Cdr => "application/cdr",
        }
    }

    pub(crate) const fn zenoh(self) -> zenoh::bytes::Encoding {
        match self {
            Self::Cbor => zenoh::bytes::Encoding::APPLICATION_CBOR,
            Self::Json => zenoh::bytes::Encoding::APPLICATION_JSON,
            Self::Cdr => zenoh::bytes::Encoding::APPLICATION_CDR,
        }
    }
}

/// The part of the dampers that nodes on rmw_zenoh see.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rmw {
    /// Nothing.
    #[default]
    Off,
    /// The node and its outputs.
    Publish,
    /// The node, its outputs and its inputs; messages published on the inputs are used.
    Both,
}

impl Rmw {
    /// The names used in the configuration.
    pub const NAMES: [&str; 3] = ["off", "publish", "both"];

    /// The value with this name; `None` when it is unknown.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let index = Self::NAMES.iter().position(|known| *known == name)?;
        Some([Self::Off, Self::Publish, Self::Both][index])
    }
}

/// Settings of the process's Zenoh session and its mirrors. The default has no endpoint, which is an error, so that nothing
/// listens unless it is configured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ZenohConfig {
    /// A Zenoh configuration file (JSON5) for all other settings: TLS, users, access control, downsampling.
    pub file: Option<PathBuf>,
    /// Addresses to listen on, `tcp/ADDRESS:PORT` or `tls/ADDRESS:PORT`. If empty, the file's addresses are used.
    pub listen: Vec<String>,
    /// Addresses of routers or peers in the same form; connecting is retried until it succeeds. If empty, the file's
    /// addresses are used.
    pub connect: Vec<String>,
    /// Role in the network. `None`: the file's mode, or peer if the file does not set it.
    pub mode: Option<SessionMode>,
    /// Encoding of the payloads under `state/`.
    pub encoding: Encoding,
    /// Maximum rate of each topic under `web/`, 20 to 50 Hz.
    pub web_rate_hz: f64,
    /// Length of the history that can be queried, 0 to 600 s.
    pub history_s: f64,
    /// Allows endpoints that other machines can reach.
    pub allow_non_loopback: bool,
    /// Names of the commands that are accepted under `cmd/`. If empty, no command is accepted over Zenoh.
    pub commands: Vec<String>,
    /// The part of the dampers that nodes on rmw_zenoh see.
    pub rmw: Rmw,
}

impl Default for ZenohConfig {
    fn default() -> Self {
        Self {
            file: None,
            listen: Vec::new(),
            connect: Vec::new(),
            mode: None,
            encoding: Encoding::Cbor,
            web_rate_hz: 30.0,
            history_s: 10.0,
            allow_non_loopback: false,
            commands: Vec::new(),
            rmw: Rmw::Off,
        }
    }
}

impl ZenohConfig {
    /// Checks the settings and the file without opening a session.
    ///
    /// # Errors
    /// The first setting that is invalid.
    pub fn validate(&self) -> Result<(), ZenohError> {
        self.session_config().map(drop)
    }

    /// The checked settings, combined with the file's settings.
    pub(super) fn session_config(&self) -> Result<SessionConfig, ZenohError> {
        in_range("web_rate_hz", self.web_rate_hz, 20.0..=50.0, "20 to 50 Hz")?;
        in_range("history_s", self.history_s, 0.0..=600.0, "0 (off) to 600 s")?;
        SessionConfig::of(self)
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

/// True when only this machine can reach the endpoint.
pub(super) fn is_loopback(endpoint: &str) -> Result<bool, ZenohError> {
    let refuse = |why: &str| ZenohError::Endpoint { endpoint: endpoint.to_owned(), why: why.to_owned() };
    let parsed = endpoint.parse::<EndPoint>().map_err(|error| refuse(&plain(&error)))?;
    if !matches!(parsed.protocol().as_str(), "tcp" | "tls") {
        return Err(refuse("only tcp and tls are built in"));
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
    // Any other name may resolve to any address.
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
    fn only_loopback_is_allowed_by_default() {
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
            (listening("udp/127.0.0.1:7447"), "only tcp and tls"),
            (listening("127.0.0.1:7447"), "127.0.0.1:7447"),
            (listening("tcp/127.0.0.1"), "port is missing"),
            (listening("tcp/localhost:http"), "port is not a number"),
            (ZenohConfig { web_rate_hz: 100.0, ..listening("tcp/127.0.0.1:1") }, "web_rate_hz = 100"),
            (ZenohConfig { web_rate_hz: f64::NAN, ..listening("tcp/127.0.0.1:1") }, "web_rate_hz = NaN"),
            (ZenohConfig { history_s: -1.0, ..listening("tcp/127.0.0.1:1") }, "history_s = -1"),
            (
                ZenohConfig { mode: Some(SessionMode::Client), ..listening("tcp/127.0.0.1:1") },
                "only connects",
            ),
        ] {
            let message = refusal(&config);
            assert!(message.contains(word), "{message}");
        }
    }

    #[test]
    fn a_bad_endpoint_is_refused_without_the_source_line_of_the_library() {
        let message = refusal(&listening("foo"));
        assert!(message.starts_with("invalid Zenoh endpoint `foo`: "), "{message}");
        assert!(
            message.contains(": foo; write it as tcp/ADDRESS:PORT") && !message.contains(".rs"),
            "{message}"
        );
    }

    #[test]
    fn refusals_use_the_full_names_of_the_parameters() {
        let client = ZenohConfig { mode: Some(SessionMode::Client), ..listening("tcp/127.0.0.1:1") };
        for (config, name) in [
            (ZenohConfig::default(), "set zenoh.connect"),
            (ZenohConfig::default(), "zenoh.listen to"),
            (client, "zenoh.listen"),
            (listening("tcp/0.0.0.0:7450"), "set zenoh.allow_non_loopback to true"),
            (ZenohConfig { history_s: -1.0, ..listening("tcp/127.0.0.1:1") }, "zenoh.history_s = -1"),
        ] {
            let message = refusal(&config);
            assert!(message.contains(name), "{message}");
        }
    }
}
