//! Combines the settings with a Zenoh configuration file.
//!
//! Endpoints and mode in the node's parameters override the file; all other settings of the file apply (TLS, users,
//! access control, downsampling). Settings that the file does not contain get safe defaults instead of Zenoh's: no
//! scouting, no listening, and connections are retried within a second.

use super::config::{Rmw, SessionMode, ZenohConfig, is_loopback};
use super::error::{FileProblem, ZenohError};
use serde_json::Value;
use std::path::Path;

/// Configuration keys whose values are file names. They are checked here, because Zenoh does not say which file is missing.
const FILES: [&str; 6] = [
    "/transport/link/tls/root_ca_certificate",
    "/transport/link/tls/listen_certificate",
    "/transport/link/tls/listen_private_key",
    "/transport/link/tls/connect_certificate",
    "/transport/link/tls/connect_private_key",
    "/transport/auth/usrpwd/dictionary_file",
];

/// Checked settings.
#[derive(Debug, Clone)]
pub(super) struct SessionConfig {
    pub(super) mode: SessionMode,
    pub(super) listen: Vec<String>,
    pub(super) connect: Vec<String>,
    /// True when the file enables access control that denies everything it does not allow.
    pub(super) access_control: bool,
    pub(super) zenoh: zenoh::Config,
}

impl SessionConfig {
    /// Reads the file, if there is one, and checks all settings without opening a session.
    ///
    /// # Errors
    /// The first setting that is invalid.
    pub(super) fn of(config: &ZenohConfig) -> Result<Self, ZenohError> {
        let (text, file) = match &config.file {
            Some(path) => read(path)?,
            None => ("{}".to_owned(), Value::Null),
        };
        let refuse = |problem| ZenohError::File { path: config.file.clone().unwrap_or_default(), problem };
        let mode = match (config.mode, file.get("mode").and_then(Value::as_str)) {
            (Some(mode), _) => mode,
            (None, None) => SessionMode::Peer,
            (None, Some(name)) => {
                SessionMode::named(name).ok_or_else(|| refuse(FileProblem::Mode { mode: name.to_owned() }))?
            }
        };
        let endpoints = |given: &[String], direction: &'static str| match given {
            [] => endpoints_of(&file, direction, mode).map_err(refuse),
            given => Ok(given.to_vec()),
        };
        // Checked before Zenoh reads the file, because Zenoh's errors do not name the place.
        let (listen, connect) =
            (endpoints(&config.listen, "listen")?, endpoints(&config.connect, "connect")?);
        let zenoh = zenoh::Config::from_json5(&text)
            .map_err(|error| refuse(FileProblem::Syntax { message: plain(&error) }))?;
        let mut settings = Self { mode, listen, connect, access_control: is_closed(&file), zenoh };
        settings.check(config)?;
        let scouts = file.pointer("/scouting/multicast/enabled") == Some(&Value::Bool(true));
        if scouts && !config.allow_non_loopback {
            return Err(refuse(FileProblem::Scouting));
        }
        for key in FILES {
            let Some(named) = file.pointer(key).and_then(Value::as_str) else { continue };
            if let Err(source) = std::fs::File::open(named) {
                let (key, named) = (key.trim_start_matches('/'), named.to_owned());
                return Err(refuse(FileProblem::NamedFile { key, named, source }));
            }
        }
        settings.complete(&file)?;
        Ok(settings)
    }

    fn check(&self, config: &ZenohConfig) -> Result<(), ZenohError> {
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
        for endpoint in self.listen.iter().chain(&self.connect) {
            if is_loopback(endpoint)? {
                continue;
            }
            if !config.allow_non_loopback {
                return Err(ZenohError::NotLoopback { endpoint: endpoint.clone() });
            }
            if !config.commands.is_empty() && !self.access_control {
                return Err(ZenohError::AnybodyCommands { endpoint: endpoint.clone() });
            }
            if config.rmw == Rmw::Both && !self.access_control {
                return Err(ZenohError::AnybodyFeeds { endpoint: endpoint.clone() });
            }
        }
        Ok(())
    }

    /// Writes the checked settings into the Zenoh configuration, and safe defaults for keys that `file` lacks.
    fn complete(&mut self, file: &Value) -> Result<(), ZenohError> {
        let client = self.mode == SessionMode::Client;
        let settled = [
            ("mode", format!("\"{}\"", self.mode.name())),
            // An empty list must be set explicitly: without it, a peer listens on all interfaces.
            ("listen/endpoints", json_list(&self.listen)),
            ("connect/endpoints", json_list(&self.connect)),
        ];
        let safe = [
            // Opening a client blocks until it is connected and is retried by `Link`; opening others does not block.
            ("connect/timeout_ms", if client { "5000" } else { "-1" }),
            ("connect/exit_on_failure", if client { "true" } else { "false" }),
            ("connect/retry", "{period_init_ms: 100, period_max_ms: 1000}"),
            ("listen/timeout_ms", "0"),
            ("listen/exit_on_failure", "true"),
            ("scouting/multicast/enabled", "false"),
            ("scouting/gossip/enabled", "false"),
            // Otherwise opening waits half a second for a peer that may not exist.
            ("open/return_conditions/connect_scouted", "false"),
            // Declarations and answers block on a consumer that does not read. Close it after 1 s instead of 5 s. Samples
            // never block.
            ("transport/link/tx/queue/congestion_control/block/wait_before_close", "1000000"),
            // Samples have this priority, and Zenoh drops what does not fit into its queue. Two batches (128 kB, the default) overflow if
            // the sending thread waits for the processor while a ring full of events is published. 16 hold about 4000 samples.
            ("transport/link/tx/queue/size/data_high", "16"),
        ];
        let open = safe.into_iter().filter(|(key, _)| file.pointer(&format!("/{key}")).is_none());
        for (key, value) in settled.into_iter().chain(open.map(|(key, value)| (key, value.to_owned()))) {
            self.zenoh.insert_json5(key, &value).map_err(|error| ZenohError::Open {
                endpoints: self.endpoints(),
                reason: format!("{key} = {value}: {}", plain(&error)),
            })?;
        }
        Ok(())
    }

    /// All endpoints, for messages.
    pub(super) fn endpoints(&self) -> String {
        let all: Vec<&str> = self.listen.iter().chain(&self.connect).map(String::as_str).collect();
        all.join(", ")
    }

    /// The listen endpoint whose address is in use, if any.
    pub(super) fn taken_port(&self) -> Option<&str> {
        let taken = |endpoint: &&String| {
            let address = endpoint.split_once('/').and_then(|(_, rest)| rest.split(['?', '#']).next());
            address.is_some_and(|address| {
                std::net::TcpListener::bind(address)
                    .is_err_and(|error| error.kind() == std::io::ErrorKind::AddrInUse)
            })
        };
        self.listen.iter().find(taken).map(String::as_str)
    }
}

/// True when access control is enabled and denies everything that no rule allows. Rules that allow by default do not
/// protect commands and inputs.
fn is_closed(file: &Value) -> bool {
    let allows = file.pointer("/access_control/default_permission").and_then(Value::as_str) == Some("allow");
    file.pointer("/access_control/enabled") == Some(&Value::Bool(true)) && !allows
}

/// The text of a file, and its parsed value.
fn read(path: &Path) -> Result<(String, Value), ZenohError> {
    let refuse = |problem| ZenohError::File { path: path.to_owned(), problem };
    let text = std::fs::read_to_string(path).map_err(|error| refuse(error.into()))?;
    let file: Value =
        json5::from_str(&text).map_err(|error| refuse(FileProblem::Syntax { message: error.to_string() }))?;
    if !file.is_object() {
        return Err(refuse(FileProblem::NotAnObject));
    }
    Ok((text, file))
}

/// Endpoints that a file lists for `mode`. The file has one list, or one per mode.
fn endpoints_of(
    file: &Value,
    direction: &'static str,
    mode: SessionMode,
) -> Result<Vec<String>, FileProblem> {
    let all = match file.pointer(&format!("/{direction}/endpoints")) {
        Some(Value::Object(by_mode)) => by_mode.get(mode.name()).unwrap_or(&Value::Null),
        Some(list) => list,
        None => &Value::Null,
    };
    let text = |endpoint: &Value| endpoint.as_str().map(str::to_owned);
    match all {
        Value::Null => Ok(Vec::new()),
        Value::String(one) => Ok(vec![one.clone()]),
        Value::Array(list) => list
            .iter()
            .map(|endpoint| {
                text(endpoint).ok_or_else(|| FileProblem::Endpoint { direction, found: endpoint.to_string() })
            })
            .collect(),
        other => Err(FileProblem::Endpoints { direction, found: other.to_string() }),
    }
}

/// Zenoh's reason without the source lines that it contains, each as ` at PATH.rs:LINE.`.
pub(super) fn plain(error: &zenoh::Error) -> String {
    let text = error.to_string();
    let mut parts = text.split(" at ");
    let mut plain = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        match part.split_once(".rs:") {
            // A relative path has no spaces; other text before `.rs:` is a part of the reason.
            Some((path, rest)) if path.starts_with('/') || !path.contains(' ') => {
                plain += rest.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.');
            }
            _ => plain = plain + " at " + part,
        }
    }
    plain.trim_end_matches(['.', ' ']).to_owned()
}

fn json_list(endpoints: &[String]) -> String {
    serde_json::to_string(endpoints).expect("strings are always JSON")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn with_file(text: &str) -> (tempfile::NamedTempFile, ZenohConfig) {
        let mut file = tempfile::NamedTempFile::new().expect("a temporary file");
        file.write_all(text.as_bytes()).expect("it takes text");
        let config = ZenohConfig { file: Some(file.path().to_owned()), ..ZenohConfig::default() };
        (file, config)
    }

    fn json(settings: &SessionConfig, key: &str) -> String {
        settings.zenoh.get_json(key).expect("a key of Zenoh's")
    }

    #[test]
    fn settings_of_the_file_apply_and_missing_ones_get_safe_defaults() {
        let (_file, config) = with_file(
            "{ mode: 'router',
               listen: { endpoints: { router: ['tls/127.0.0.1:7447'], peer: ['tcp/0.0.0.0:1'] } } }",
        );
        let settings = SessionConfig::of(&config).expect("the configuration is valid");
        assert_eq!(
            (settings.mode, settings.listen.as_slice()),
            (SessionMode::Router, &["tls/127.0.0.1:7447".to_owned()][..])
        );
        assert!(settings.connect.is_empty() && !settings.access_control);
        assert_eq!(json(&settings, "scouting/multicast/enabled"), "false");
        assert_eq!(json(&settings, "connect/endpoints"), "[]");

        let (_file, config) = with_file(
            "{ connect: { endpoints: ['tcp/localhost:7447'], timeout_ms: 7 }, access_control: { enabled: true,
               default_permission: 'deny' } }",
        );
        let settings = SessionConfig::of(&config).expect("the configuration is valid");
        assert_eq!((settings.mode, settings.access_control), (SessionMode::Peer, true));
        assert_eq!(json(&settings, "connect/timeout_ms"), "7");
        let stronger = ZenohConfig { connect: vec!["tcp/127.0.0.1:9".to_owned()], ..config };
        assert_eq!(
            SessionConfig::of(&stronger).expect("the configuration is valid").connect,
            ["tcp/127.0.0.1:9"]
        );
    }

    #[test]
    fn rules_that_allow_by_default_do_not_protect_commands_and_inputs() {
        for (permission, closed) in [("deny", true), ("allow", false)] {
            let (_file, config) = with_file(&format!(
                "{{ listen: {{ endpoints: ['tcp/0.0.0.0:0'] }},
                   access_control: {{ enabled: true, default_permission: '{permission}' }} }}"
            ));
            let config = ZenohConfig { allow_non_loopback: true, ..config };
            for config in [
                ZenohConfig { commands: vec!["set_mode".to_owned()], ..config.clone() },
                ZenohConfig { rmw: Rmw::Both, ..config.clone() },
            ] {
                assert_eq!(SessionConfig::of(&config).is_ok(), closed, "{permission}");
            }
            assert!(
                SessionConfig::of(&ZenohConfig { rmw: Rmw::Publish, ..config }).is_ok(),
                "no inputs are accepted"
            );
        }
    }

    #[test]
    fn reasons_do_not_contain_source_lines() {
        for (text, expected) in [
            ("No key. at /home/x/src/utils.rs:523. at /home/y.rs:7.", "No key"),
            ("No key. at /a/utils.rs:5 - [::1] at /b.rs:6", "No key. - [::1]"),
            ("No file at /etc/keys", "No file at /etc/keys"),
            ("No form: foo at /root/.cargo/registry/src/x-1.0/src/core/endpoint.rs:615.", "No form: foo"),
            ("No key at io/zenoh-link/src/lib.rs:9. - Caused by x at C:\\y.rs:3.", "No key - Caused by x"),
        ] {
            assert_eq!(plain(&text.into()), expected);
        }
    }

    #[test]
    fn refusals_name_the_file_and_the_fault() {
        for (text, word) in [
            ("{ listen: { endpoints: ['tcp/0.0.0.0:7447'] } }", "allow_non_loopback"),
            (
                "{ listen: { endpoints: ['tcp/127.0.0.1:1'] }, scouting: { multicast: { enabled: true } } }",
                "scouting",
            ),
            ("{ listen: { endpoints: [7] } }", "7, which is not a string"),
            ("{ mode: 'star' }", "\"star\""),
            ("{ listenn: {} }", "listenn"),
            ("[]", "it is not an object"),
            (
                "{ listen: { endpoints: ['tls/127.0.0.1:1'] },
                   transport: { link: { tls: { listen_certificate: 'nowhere.pem' } } } }",
                "tls/listen_certificate names nowhere.pem",
            ),
            ("{ mode: ", "expected"),
        ] {
            let (file, config) = with_file(text);
            let refusal = SessionConfig::of(&config).expect_err(text).to_string();
            assert!(refusal.contains(word), "{text}: {refusal}");
            let named = refusal.contains(&file.path().display().to_string());
            assert!(named || word == "allow_non_loopback", "{refusal}");
        }
        let absent = ZenohConfig { file: Some("/nowhere/zenoh.json5".into()), ..ZenohConfig::default() };
        assert!(SessionConfig::of(&absent).expect_err("absent").to_string().contains("/nowhere/zenoh.json5"));
    }
}
