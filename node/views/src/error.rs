//! Errors of the web server.

use mr_damper_base::disk::advice;
use std::io;
use std::net::SocketAddr;

/// Why the web server does not start, or why it has ended.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServeError {
    /// The page would be reachable from other machines, and the user did not allow that.
    #[error(
        "--listen {listen} is not on loopback: anyone who can reach this machine could watch, without password or encryption. Use a \
         tunnel (ssh -L {port}:127.0.0.1:{port} THIS_MACHINE, then http://localhost:{port}/ there), or allow it with --any-host",
        port = listen.port()
    )]
    PageBeyondLoopback {
        /// The given address.
        listen: SocketAddr,
    },
    /// The workshop would be reachable from other machines.
    #[error(
        "--workshop allows uploads and starts work, but --listen {listen} is not on loopback: anyone who can reach this machine could \
         use it, without password or encryption. This cannot be allowed by a flag; use a tunnel (ssh -L {port}:127.0.0.1:{port} \
         THIS_MACHINE, then http://localhost:{port}/ there)",
        port = listen.port()
    )]
    WorkshopBeyondLoopback {
        /// The given address.
        listen: SocketAddr,
    },
    /// The Foxglove endpoint would be reachable from other machines, and the user did not allow that.
    #[error(
        "--foxglove={listen} is not on loopback: anyone who can reach this machine could watch, without password or encryption. Use a \
         tunnel (ssh -L {port}:127.0.0.1:{port} THIS_MACHINE, then ws://localhost:{port} there), or allow it with --any-host",
        port = listen.port()
    )]
    ViewersBeyondLoopback {
        /// The given address.
        listen: SocketAddr,
    },
    /// The server cannot listen on its address.
    #[error(
        "cannot listen on {address}: {source}; is another mr-damper serve running? To choose another port, use {option}{}{}:{}",
        if *option == "--foxglove" { '=' } else { ' ' },
        address.ip(),
        address.port().wrapping_add(1).max(1024)
    )]
    Listen {
        /// The option that gives the address.
        option: &'static str,
        /// The given address.
        address: SocketAddr,
        /// The system's error.
        source: io::Error,
    },
    /// The system provides no random numbers for the token.
    #[error("the system provides no random numbers: {0}")]
    NoRandomNumbers(getrandom::Error),
    /// An error of the operating system.
    #[error("{what}: {source}{}", advice(source.kind()))]
    Io {
        /// The attempted action.
        what: &'static str,
        /// The system's error.
        source: io::Error,
    },
    /// The server's thread panicked.
    #[error("the web server's thread panicked; the log above shows where. Please report this as a bug")]
    Panicked,
}

impl ServeError {
    /// An error of the operating system while doing `what`.
    pub(crate) fn io(what: &'static str) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io { what, source }
    }
}
