//! Why the mirror does not start.

use std::path::PathBuf;

/// Why the mirror does not start. Every message says what, where, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ZenohError {
    /// Neither `listen` nor `connect` names an endpoint.
    #[error(
        "Zenoh has no endpoint: give `connect` the address of a router or peer (tcp/127.0.0.1:7447), or \
         `listen` the address to wait at; nothing listens without being asked"
    )]
    NoEndpoint,
    /// A client cannot listen.
    #[error("Zenoh mode client only connects: remove `listen` ({}), or take mode peer", listen.join(", "))]
    ClientListens {
        /// The listen endpoints that were given.
        listen: Vec<String>,
    },
    /// A client without anything to connect to.
    #[error("Zenoh mode client needs `connect`: the address of a router, for example tcp/127.0.0.1:7447")]
    ClientWithoutConnect,
    /// Text that is no endpoint, or a transport that is not built in.
    #[error(
        "Zenoh endpoint `{endpoint}` cannot be used: {why}; write it as tcp/ADDRESS:PORT or tls/ADDRESS:PORT"
    )]
    Endpoint {
        /// The endpoint as given.
        endpoint: String,
        /// What is wrong with it.
        why: String,
    },
    /// An endpoint that other machines can reach, without leave.
    #[error(
        "Zenoh endpoint `{endpoint}` is not on loopback, and traffic is neither encrypted nor authenticated; \
         use 127.0.0.1, or allow it with allow_non_loopback = true on a network that you trust"
    )]
    NotLoopback {
        /// The endpoint as given.
        endpoint: String,
    },
    /// Anybody on a network could command the damper.
    #[error(
        "Zenoh endpoint `{endpoint}` is not on loopback and commands are taken, but nobody has said from whom: give a \
         configuration file with access_control enabled and default_permission deny (launch-configs/zenoh/ has some), or take no commands"
    )]
    AnybodyCommands {
        /// The endpoint as given.
        endpoint: String,
    },
    /// Anybody on a network could feed the damper.
    #[error(
        "Zenoh endpoint `{endpoint}` is not on loopback and zenoh.rmw is both, but nobody has said whose inputs are taken: give a \
         configuration file with access_control enabled and default_permission deny, or take rmw = publish, which lets nothing in"
    )]
    AnybodyFeeds {
        /// The endpoint as given.
        endpoint: String,
    },
    /// A configuration file of Zenoh's own that cannot be used.
    #[error("Zenoh configuration {}: {why}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// A command that is not known.
    #[error("`{name}` is no command that can be taken from Zenoh; known are {known}")]
    UnknownCommand {
        /// The name as given.
        name: String,
        /// The names that there are.
        known: String,
    },
    /// A setting out of range.
    #[error("Zenoh setting {setting} = {value} is out of range: {allowed}")]
    Setting {
        /// Name of the setting.
        setting: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// A damper's name that is no part of a key.
    #[error(
        "`{name}` cannot be a damper's name in Zenoh keys: use letters, digits, `_`, `-`, with `/` \
         between parts"
    )]
    DamperName {
        /// The name as given.
        name: String,
    },
    /// A listen address that is taken.
    #[error(
        "Zenoh cannot listen at {endpoint}: another process uses this port; stop it (`ss -ltnp` shows it), \
         or choose another port in `listen`, or put the address into `connect` to use the router \
         that is there"
    )]
    PortInUse {
        /// The endpoint as given.
        endpoint: String,
    },
    /// Zenoh refused to open a session.
    #[error(
        "Zenoh did not open a session with {endpoints}: {reason}; check the addresses in `listen` and \
         `connect`"
    )]
    Open {
        /// The endpoints as given.
        endpoints: String,
        /// Zenoh's reason.
        reason: String,
    },
    /// The system gave no thread.
    #[error("cannot start the thread {name}: {source}; is a limit on threads reached (`ulimit -u`)?")]
    Thread {
        /// The thread's name.
        name: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
}
