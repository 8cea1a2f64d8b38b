//! Options of the Foxglove endpoint, shared by the commands that have it.

use mr_damper_views::ServeError;
use mr_damper_views::foxglove::{Channels, FoxgloveServer, require_loopback_for_viewers};
use mr_damper_views::serve::AllowedOrigin;
use std::io::Write;
use std::net::SocketAddr;
use std::sync::Arc;

/// Whether there is an endpoint for viewers, and where.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct FoxgloveArgs {
    /// Serve Foxglove, Lichtblick and PlotJuggler, which connect to this address as a Foxglove WebSocket. Without an address it is
    /// 127.0.0.1:8765, which they propose; port 0 selects a free port. They only read.
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, require_equals = true, default_missing_value = "127.0.0.1:8765")]
    pub foxglove: Option<SocketAddr>,
}

impl FoxgloveArgs {
    /// Checks that the endpoint is on loopback, unless `any_host` allows other addresses.
    ///
    /// # Errors
    /// [`ServeError::ViewersBeyondLoopback`].
    pub fn check(&self, any_host: bool) -> Result<(), ServeError> {
        self.foxglove.map_or(Ok(()), |listen| require_loopback_for_viewers(listen, any_host))
    }

    /// Starts the endpoint, if there is one.
    ///
    /// # Errors
    /// Errors of [`FoxgloveServer::start`].
    pub fn start(
        &self,
        any_host: bool,
        allowed_origins: &[AllowedOrigin],
        channels: &Arc<Channels>,
    ) -> Result<Option<FoxgloveServer>, ServeError> {
        let Some(listen) = self.foxglove else { return Ok(None) };
        let server = FoxgloveServer::start(listen, any_host, allowed_origins, Arc::clone(channels))?;
        if !server.address().ip().is_loopback() {
            tracing::warn!(listen = %server.address(), "anyone who can reach this machine can watch, without password or encryption");
        }
        Ok(Some(server))
    }
}

/// Prints the address of the endpoint. A closed stdout (`| head`) is no error.
pub fn print_address(server: &FoxgloveServer) {
    let mut stdout = std::io::stdout();
    let _ = writeln!(stdout, "ws://{}", server.address()).and_then(|()| stdout.flush());
}
