//! Reads ROS' environment variables for a participant: which machines can find it, and remarks where the result differs
//! from the request.
//!
//! | variable | effect |
//! |---|---|
//! | `ROS_AUTOMATIC_DISCOVERY_RANGE` | `SUBNET`, `LOCALHOST`; `SYSTEM_DEFAULT` is loopback; `OFF` and anything else is refused |
//! | `ROS_LOCALHOST_ONLY` | `1`: loopback, without listed peers; `0`: the subnet, if no range is given; anything else is refused |
//! | `ROS_STATIC_PEERS` | the node announces itself to these hosts, and is reachable from the network (`listed_peers.rs`) |
//! | `RMW_IMPLEMENTATION` | only checked; a remark is logged if it names a middleware other than DDS |
//!
//! Loopback is the default. The network is used only if a variable or a parameter requests it.

use crate::settings::config::Config;
use crate::settings::error::NodeError;

/// Reads a variable; `None` if it is not set.
pub type Variable<'a> = &'a dyn Fn(&str) -> Option<String>;

/// The machines that can find the participant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// Only this machine.
    Loopback,
    /// All machines in the network's reach.
    Network,
}

/// A difference between a variable's request and the result.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Remark {
    /// The variable, and the actual behaviour.
    pub found: String,
    /// What to do.
    pub advice: String,
}

impl Remark {
    fn new(found: impl Into<String>, advice: &str) -> Self {
        Self { found: found.into(), advice: advice.to_owned() }
    }
}

/// The combined request of the environment and the parameters.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NetworkRequest {
    /// The machines that can find the participant.
    pub reach: Reach,
    /// The hosts to which the participant is announced by unicast.
    pub peers: Vec<String>,
    /// The differences between the request and the result.
    pub remarks: Vec<Remark>,
}

/// A supported value of `ROS_AUTOMATIC_DISCOVERY_RANGE`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Range {
    Subnet,
    Localhost,
    SystemDefault,
}

/// The variable `name` of this process.
#[must_use]
pub fn of_process(name: &str) -> Option<String> {
    std::env::var_os(name).map(|value| value.to_string_lossy().into_owned()).filter(|value| !value.is_empty())
}

/// The request of `config` and the environment. A parameter overrides its variable, which is then not read.
///
/// # Errors
/// [`NodeError::Parameter`] for a variable with an invalid or unsupported value.
pub fn requested(config: &Config, variable: Variable<'_>) -> Result<NetworkRequest, NodeError> {
    let mut remarks: Vec<Remark> = middleware(config, variable).into_iter().collect();
    let of_parameter = |reach, peers| (reach, peers, Vec::new());
    let (reach, peers, more) = match (config.discovery_range.as_str(), config.discovery_peers.is_empty()) {
        ("localhost", _) => of_parameter(Reach::Loopback, Vec::new()),
        (_, false) => of_parameter(Reach::Network, config.discovery_peers.clone()),
        ("subnet", true) => of_parameter(Reach::Network, static_peers(variable)),
        _ => of_variables(variable)?,
    };
    remarks.extend(more);
    Ok(NetworkRequest { reach, peers, remarks })
}

/// The request of the variables; used if no parameter decides.
fn of_variables(variable: Variable<'_>) -> Result<(Reach, Vec<String>, Vec<Remark>), NodeError> {
    let (range, localhost_only) = (range(variable)?, localhost_only(variable)?);
    let peers = static_peers(variable);
    Ok(match (localhost_only, range) {
        (Some(true), _) if !peers.is_empty() => {
            let found = "ROS_LOCALHOST_ONLY is 1, so ROS_STATIC_PEERS is ignored and only this machine can find the node";
            let advice = "unset ROS_LOCALHOST_ONLY to announce the node to the listed hosts";
            (Reach::Loopback, Vec::new(), vec![Remark::new(found, advice)])
        }
        (Some(true), _) => (Reach::Loopback, Vec::new(), Vec::new()),
        _ if !peers.is_empty() => (Reach::Network, peers, Vec::new()),
        (_, Some(Range::Subnet)) => (Reach::Network, Vec::new(), Vec::new()),
        (_, Some(Range::SystemDefault)) => {
            let found =
                "ROS_AUTOMATIC_DISCOVERY_RANGE is SYSTEM_DEFAULT, which means this machine only in mr-damper";
            let advice = "set it to SUBNET to let other machines find the node";
            (Reach::Loopback, Vec::new(), vec![Remark::new(found, advice)])
        }
        (Some(false), None) => {
            let found = "ROS_LOCALHOST_ONLY is 0, so other machines on the network can find the node";
            let advice = "the variable is deprecated: set ROS_AUTOMATIC_DISCOVERY_RANGE to SUBNET, or to LOCALHOST for this machine only";
            (Reach::Network, Vec::new(), vec![Remark::new(found, advice)])
        }
        (_, Some(Range::Localhost)) | (None, None) => (Reach::Loopback, Vec::new(), Vec::new()),
    })
}

fn range(variable: Variable<'_>) -> Result<Option<Range>, NodeError> {
    const NAME: &str = "ROS_AUTOMATIC_DISCOVERY_RANGE";
    let Some(text) = variable(NAME) else { return Ok(None) };
    match text.to_ascii_uppercase().as_str() {
        "SUBNET" => Ok(Some(Range::Subnet)),
        "LOCALHOST" => Ok(Some(Range::Localhost)),
        "SYSTEM_DEFAULT" => Ok(Some(Range::SystemDefault)),
        "OFF" => Err(refused(
            NAME,
            &text,
            "SUBNET, LOCALHOST or SYSTEM_DEFAULT (the DDS library of this program cannot switch discovery off; LOCALHOST is the smallest range)",
        )),
        _ => Err(refused(NAME, &text, "SUBNET, LOCALHOST or SYSTEM_DEFAULT, or not set (this machine only)")),
    }
}

fn localhost_only(variable: Variable<'_>) -> Result<Option<bool>, NodeError> {
    const NAME: &str = "ROS_LOCALHOST_ONLY";
    match variable(NAME).as_deref() {
        None => Ok(None),
        Some("0") => Ok(Some(false)),
        Some("1") => Ok(Some(true)),
        Some(other) => {
            Err(refused(NAME, other, "0 or 1 (it is deprecated: use ROS_AUTOMATIC_DISCOVERY_RANGE)"))
        }
    }
}

fn refused(name: &str, value: &str, expected: &str) -> NodeError {
    NodeError::Parameter {
        name: format!("{name} (environment)"),
        value: format!("{value:?}"),
        expected: expected.to_owned(),
    }
}

fn static_peers(variable: Variable<'_>) -> Vec<String> {
    let text = variable("ROS_STATIC_PEERS").unwrap_or_default();
    text.split(';').map(str::trim).filter(|host| !host.is_empty()).map(str::to_owned).collect()
}

/// The remark on `RMW_IMPLEMENTATION`, if it names a middleware that this program does not use.
fn middleware(config: &Config, variable: Variable<'_>) -> Option<Remark> {
    // Middlewares that use DDS on the wire, as this program does without loading any of them.
    const OF_DDS: [&str; 6] = ["fastrtps", "cyclonedds", "connextdds", "connext", "gurumdds", "opensplice"];
    let name = variable("RMW_IMPLEMENTATION")?;
    let kind = name.strip_prefix("rmw_").unwrap_or(&name);
    if OF_DDS.iter().any(|known| kind.starts_with(known)) {
        return None;
    }
    if !kind.starts_with("zenoh") {
        return Some(Remark::new(
            format!(
                "RMW_IMPLEMENTATION is {name:?}, which mr-damper does not know and does not load: it has its own DDS library"
            ),
            "unset it, or use a DDS middleware (rmw_fastrtps_cpp, rmw_cyclonedds_cpp) for the other nodes",
        ));
    }
    // With other values, the node serves these nodes in addition to DDS.
    (config.zenoh.rmw == "off").then(|| {
        Remark::new(
            format!("RMW_IMPLEMENTATION is {name:?}, but mr-damper uses its own DDS library: nodes on rmw_zenoh do not see it"),
            "for `mr-damper node` set -p zenoh.rmw:=both and -p zenoh.connect:=tcp/127.0.0.1:7447 (the router); `mr-damper top` and \
             `serve` take --zenoh",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use Reach::{Loopback, Network};

    fn with(variables: &[(&str, &str)], config: &Config) -> Result<NetworkRequest, String> {
        let read = |name: &str| {
            variables.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).to_owned())
        };
        requested(config, &read).map_err(|error| error.to_string())
    }

    fn config(range: &str) -> Config {
        Config { discovery_range: range.to_owned(), ..Config::default() }
    }

    const RANGE: &str = "ROS_AUTOMATIC_DISCOVERY_RANGE";
    const ONLY: &str = "ROS_LOCALHOST_ONLY";
    const PEERS: &str = "ROS_STATIC_PEERS";

    #[test]
    fn loopback_is_the_default_and_the_network_is_used_on_request() {
        for (variables, reach, peers, remarks) in [
            (&[][..], Loopback, 0, 0),
            (&[(RANGE, "LOCALHOST")], Loopback, 0, 0),
            (&[(RANGE, "subnet")], Network, 0, 0),
            (&[(RANGE, "SYSTEM_DEFAULT")], Loopback, 0, 1),
            (&[(ONLY, "1")], Loopback, 0, 0),
            (&[(ONLY, "1"), (RANGE, "SUBNET")], Loopback, 0, 0),
            (&[(ONLY, "0")], Network, 0, 1),
            (&[(ONLY, "0"), (RANGE, "LOCALHOST")], Loopback, 0, 0),
            (&[(ONLY, "0"), (RANGE, "SUBNET")], Network, 0, 0),
            (&[(PEERS, "a; b;")], Network, 2, 0),
            (&[(PEERS, "a"), (RANGE, "LOCALHOST")], Network, 1, 0),
            (&[(PEERS, "a"), (ONLY, "1")], Loopback, 0, 1),
        ] {
            let requested = with(variables, &config("system_default")).expect("a supported value");
            let counted = (requested.reach, requested.peers.len(), requested.remarks.len());
            assert_eq!(counted, (reach, peers, remarks), "{variables:?}");
        }
    }

    #[test]
    fn invalid_values_are_refused_with_the_allowed_ones() {
        for (name, value, allowed) in [
            (RANGE, "SUBNETS", "SUBNET, LOCALHOST or SYSTEM_DEFAULT"),
            (RANGE, "OFF", "cannot switch discovery off"),
            (ONLY, "true", "0 or 1"),
        ] {
            let message = with(&[(name, value)], &config("system_default")).expect_err(value);
            assert!(message.contains(&format!("{name} (environment) is {value:?}")), "{message}");
            assert!(message.contains(allowed), "{message}");
            // A parameter overrides the variable, which is not read.
            assert!(with(&[(name, value)], &config("localhost")).is_ok());
        }
    }

    #[test]
    fn an_unsupported_middleware_gives_a_remark() {
        let remark_on = |name: &str, config: &Config| {
            let requested = with(&[("RMW_IMPLEMENTATION", name)], config).expect("no refusal");
            requested
                .remarks
                .into_iter()
                .map(|remark| remark.found + "; " + &remark.advice)
                .collect::<String>()
        };
        let plain = config("localhost");
        for spoken in ["rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp", "rmw_cyclonedds_cpp", "rmw_connextdds"]
        {
            assert_eq!(remark_on(spoken, &plain), "");
        }
        assert!(remark_on("rmw_zenoh_cpp", &plain).contains("zenoh.rmw:=both"));
        assert!(
            remark_on("rmw_fastrps_cpp", &plain)
                .contains("\"rmw_fastrps_cpp\", which mr-damper does not know")
        );
        let mut served = plain.clone();
        served.zenoh.rmw = "both".to_owned();
        assert_eq!(remark_on("rmw_zenoh_cpp", &served), "");
    }
}
