//! Errors of the session and of what uses it.

use std::path::PathBuf;

/// Faults of a Zenoh configuration file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileProblem {
    /// The file cannot be read.
    #[error(transparent)]
    Unreadable(#[from] std::io::Error),
    /// The text is not JSON5, or Zenoh does not accept it.
    #[error("{message}")]
    Syntax {
        /// The message of the parser.
        message: String,
    },
    /// The file holds a value that is not an object.
    #[error("it is not an object; begin the file with {{")]
    NotAnObject,
    /// The mode is not known.
    #[error("mode is \"{mode}\"; use peer, client or router")]
    Mode {
        /// The mode.
        mode: String,
    },
    /// The endpoints are not a list.
    #[error("{direction}/endpoints is {found}; write a list of strings")]
    Endpoints {
        /// `listen` or `connect`.
        direction: &'static str,
        /// The value, as JSON.
        found: String,
    },
    /// An endpoint is not a string.
    #[error("{direction}/endpoints has {found}, which is not a string")]
    Endpoint {
        /// `listen` or `connect`.
        direction: &'static str,
        /// The endpoint, as JSON.
        found: String,
    },
    /// Multicast scouting is on, without `zenoh.allow_non_loopback`.
    #[error(
        "scouting/multicast is enabled, which looks for peers on every network; remove it, or set zenoh.allow_non_loopback to true"
    )]
    Scouting,
    /// A file that the configuration names cannot be opened.
    #[error("{key} names {named}: {source}; paths are relative to the working directory")]
    NamedFile {
        /// The key.
        key: &'static str,
        /// The path.
        named: String,
        /// The system's reason.
        source: std::io::Error,
    },
}

impl ZenohError {
    /// True if a parameter or the Zenoh configuration file is wrong; false if the machine or the network is.
    #[must_use]
    pub const fn is_wrong_parameter(&self) -> bool {
        !matches!(
            self,
            Self::File { problem: FileProblem::Unreadable(_) | FileProblem::NamedFile { .. }, .. }
                | Self::PortInUse { .. }
                | Self::Open { .. }
                | Self::Thread { .. }
        )
    }
}

/// Reasons why the mirror cannot start. Every message says what failed, where, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ZenohError {
    /// Neither `zenoh.listen` nor `zenoh.connect` names an endpoint.
    #[error(
        "Zenoh has no endpoint: set zenoh.connect to the address of a router or peer (tcp/127.0.0.1:7447), or \
         zenoh.listen to the address to listen on; the node does not listen by default"
    )]
    NoEndpoint,
    /// A client cannot listen.
    #[error(
        "Zenoh mode client only connects: remove the endpoints in zenoh.listen, or in listen/endpoints of the Zenoh configuration \
         file ({}), or set zenoh.mode to peer",
        listen.join(", ")
    )]
    ClientListens {
        /// The listen endpoints that were given.
        listen: Vec<String>,
    },
    /// A client has no address to connect to.
    #[error("Zenoh mode client needs zenoh.connect: the address of a router, for example tcp/127.0.0.1:7447")]
    ClientWithoutConnect,
    /// The text is not an endpoint, or its transport is not built in.
    #[error("invalid Zenoh endpoint `{endpoint}`: {why}; write it as tcp/ADDRESS:PORT or tls/ADDRESS:PORT")]
    Endpoint {
        /// The endpoint as given.
        endpoint: String,
        /// The fault.
        why: String,
    },
    /// An endpoint that other machines can reach, without `zenoh.allow_non_loopback`.
    #[error(
        "Zenoh endpoint `{endpoint}` is not on loopback, and traffic is neither encrypted nor authenticated; \
         use 127.0.0.1, or set zenoh.allow_non_loopback to true on a network that you trust"
    )]
    NotLoopback {
        /// The endpoint as given.
        endpoint: String,
    },
    /// Commands are accepted beyond loopback without access control: anyone on the network could command the damper.
    #[error(
        "Zenoh endpoint `{endpoint}` is not on loopback and commands are accepted, but there is no access control: set zenoh.config to \
         a file with access_control enabled and default_permission deny (examples are in launch-configs/zenoh/), or leave \
         zenoh.commands empty"
    )]
    AnybodyCommands {
        /// The endpoint as given.
        endpoint: String,
    },
    /// Inputs are accepted beyond loopback without access control: anyone on the network could publish inputs.
    #[error(
        "Zenoh endpoint `{endpoint}` is not on loopback and zenoh.rmw is both, but there is no access control: set zenoh.config to a \
         file with access_control enabled and default_permission deny, or set zenoh.rmw to publish, which accepts no inputs"
    )]
    AnybodyFeeds {
        /// The endpoint as given.
        endpoint: String,
    },
    /// The Zenoh configuration file cannot be used.
    #[error("Zenoh configuration {}: {problem}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The fault.
        problem: FileProblem,
    },
    /// A command is unknown.
    #[error("`{name}` is not a command that can be accepted over Zenoh; use {known}")]
    UnknownCommand {
        /// The name as given.
        name: String,
        /// The known names.
        known: String,
    },
    /// A parameter is out of range.
    #[error("zenoh.{setting} = {value} is out of range: {allowed}")]
    Setting {
        /// Name of the parameter, without `zenoh.`.
        setting: &'static str,
        /// Its value.
        value: f64,
        /// The allowed range.
        allowed: &'static str,
    },
    /// A damper's name cannot be part of a key.
    #[error(
        "`{name}` cannot be a damper's name in Zenoh keys: use letters, digits, `_`, `-`, with `/` \
         between parts"
    )]
    DamperName {
        /// The name as given.
        name: String,
    },
    /// The port of a listen address is in use.
    #[error(
        "Zenoh cannot listen at {endpoint}: another process uses this port; stop it (`ss -ltnp` shows it), \
         or choose another port in zenoh.listen, or put the address into zenoh.connect to use the router that listens there \
         (in a Zenoh configuration file these are listen/endpoints and connect/endpoints)"
    )]
    PortInUse {
        /// The endpoint as given.
        endpoint: String,
    },
    /// Zenoh refused to open a session.
    #[error(
        "cannot open a Zenoh session with {endpoints}: {reason}; check these addresses, which come from zenoh.listen, zenoh.connect, \
         --zenoh or the Zenoh configuration file"
    )]
    Open {
        /// The endpoints as given.
        endpoints: String,
        /// Zenoh's reason.
        reason: String,
    },
    /// A thread could not be started.
    #[error("cannot start the thread {name}: {source}; is a limit on threads reached (`ulimit -u`)?")]
    Thread {
        /// The thread's name.
        name: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
}
