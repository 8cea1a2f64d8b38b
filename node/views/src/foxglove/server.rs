//! The server of the endpoint: the handshake, and which requests are answered.
//!
//! A web page may open a WebSocket to any address, also to 127.0.0.1, and the browser does not keep it from reading. So the origin
//! decides. Programs other than browsers state none. Viewers in a browser are allowed if they were loaded from this machine, and any other
//! page only if the user names its origin.

use super::channels::Channels;
use super::protocol::SUBPROTOCOLS;
use super::viewer::converse;
use crate::error::ServeError;
use crate::http_server::{HttpServer, Limits, listen};
use crate::serve::{AllowedOrigin, Hosts};
use axum::Router;
use axum::extract::State;
use axum::extract::ws::{WebSocketUpgrade, rejection::WebSocketUpgradeRejection};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use tokio::sync::Semaphore;

/// Maximum number of simultaneous viewers.
const MOST_VIEWERS: usize = 16;
/// The system buffers a tenth of a second of sixteen dampers at 1 kHz. What does not fit waits in the viewer's queue.
const LIMITS: Limits = Limits { connections: 64, system_buffer: 256 << 10, own_buffer: 16 << 10 };
/// Bytes of a request. A viewer subscribes to all channels in one.
const LONGEST_REQUEST: usize = 256 << 10;
/// Bytes that are written to the socket at once.
const WRITE_BUFFER: usize = 32 << 10;
/// Name of the server, which viewers show.
const NAME: &str = concat!("mr-damper ", env!("CARGO_PKG_VERSION"));

/// The running endpoint.
#[derive(Debug)]
pub struct FoxgloveServer(HttpServer);

/// State of all connections.
#[derive(Debug)]
struct Shared {
    channels: Arc<Channels>,
    hosts: Hosts,
    address: SocketAddr,
    allowed_origins: Vec<AllowedOrigin>,
    places: Arc<Semaphore>,
}

/// Refuses an address beyond loopback without `--any-host`.
///
/// # Errors
/// [`ServeError::ViewersBeyondLoopback`], which names the alternatives.
pub fn require_loopback_for_viewers(listen: SocketAddr, any_host: bool) -> Result<(), ServeError> {
    if listen.ip().is_loopback() || any_host {
        return Ok(());
    }
    Err(ServeError::ViewersBeyondLoopback { listen })
}

impl FoxgloveServer {
    /// Listens on `address` and serves `channels` from a separate thread, in a browser also to pages of the origins `allowed_origins`.
    ///
    /// # Errors
    /// When the server cannot listen on the address (for example because the port is in use), or the system provides no thread.
    pub fn start(
        address: SocketAddr,
        any_host: bool,
        allowed_origins: &[AllowedOrigin],
        channels: Arc<Channels>,
    ) -> Result<Self, ServeError> {
        let (listener, address) =
            listen(address).map_err(|source| ServeError::Listen { option: "--foxglove", address, source })?;
        let shared = Arc::new(Shared {
            channels,
            hosts: Hosts::new(address, any_host),
            address,
            allowed_origins: allowed_origins.to_vec(),
            places: Arc::new(Semaphore::new(MOST_VIEWERS)),
        });
        let router = Router::new().fallback(connect).with_state(shared);
        HttpServer::start("foxglove-server", listener, address, LIMITS, router).map(Self)
    }

    /// The address on which the server listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.0.address()
    }

    /// True while the server runs.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.0.is_alive()
    }

    /// Stops the server and disconnects all viewers.
    ///
    /// # Errors
    /// The error that ended the server before, if any.
    pub fn stop(self) -> Result<(), ServeError> {
        self.0.stop()
    }
}

/// The handshake. Viewers use any path.
async fn connect(
    State(shared): State<Arc<Shared>>,
    headers: HeaderMap,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    if let Some(refusal) = shared.refusal(&headers) {
        return refusal;
    }
    let address = shared.address;
    let Ok(upgrade) = upgrade else {
        let says = format!(
            "this is the endpoint for Foxglove, Lichtblick and PlotJuggler; open ws://{address} there, as a Foxglove WebSocket\n"
        );
        return (StatusCode::UPGRADE_REQUIRED, [(header::UPGRADE, "websocket")], says).into_response();
    };
    let upgrade = upgrade
        .protocols(SUBPROTOCOLS)
        .max_message_size(LONGEST_REQUEST)
        .max_frame_size(LONGEST_REQUEST)
        .write_buffer_size(WRITE_BUFFER);
    if upgrade.selected_protocol().is_none() {
        let says = format!(
            "the subprotocol {} is missing: name one of them in Sec-WebSocket-Protocol\n",
            SUBPROTOCOLS.join(" or ")
        );
        return (StatusCode::BAD_REQUEST, says).into_response();
    }
    let Ok(place) = Arc::clone(&shared.places).try_acquire_owned() else {
        let says = format!("{MOST_VIEWERS} viewers are connected already; close one of them\n");
        return (StatusCode::SERVICE_UNAVAILABLE, says).into_response();
    };
    upgrade.on_upgrade(move |socket| async move {
        let viewer = shared.channels.connect(NAME);
        tracing::info!(viewer = viewer.number(), "a viewer has connected");
        converse(socket, &shared.channels, &viewer).await;
        shared.channels.disconnect(&viewer);
        tracing::info!(viewer = viewer.number(), "a viewer has left");
        drop(place);
    })
}

impl Shared {
    /// The answer to a request that is not meant for this server or comes from a page that may not read it.
    fn refusal(&self, headers: &HeaderMap) -> Option<Response> {
        let text = |name: header::HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
        let host = text(header::HOST).unwrap_or_default();
        if !self.hosts.allows(host) {
            let says = format!(
                "this server is not \"{host}\"; open it by IP address or as localhost: ws://{}\n",
                self.address
            );
            return Some((StatusCode::MISDIRECTED_REQUEST, says).into_response());
        }
        let origin = text(header::ORIGIN)?;
        if is_local(origin) || self.allowed_origins.iter().any(|allowed| allowed.is(origin)) {
            return None;
        }
        // The browser does not show the answer to the user, so the log says it, too.
        tracing::warn!(
            origin,
            "a page of this origin may not connect; allow it with --allow-origin {origin}"
        );
        let says = format!("pages of {origin} may not connect; allow them with --allow-origin {origin}\n");
        Some((StatusCode::FORBIDDEN, says).into_response())
    }
}

/// True if a page of this origin was loaded from this machine: from a server on loopback, or from a file, as in desktop programs that
/// contain a browser. An origin `null` is not enough, because any page can make one.
pub(super) fn is_local(origin: &str) -> bool {
    if origin.is_empty() || origin == "file://" {
        return true;
    }
    let rest = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
    let Some(authority) = rest.and_then(|rest| rest.parse::<Authority>().ok()) else { return false };
    let host = authority.host();
    let number = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
    let is_loopback = number.parse::<IpAddr>().is_ok_and(|number| number.is_loopback());
    !rest.is_some_and(|rest| rest.contains('@')) && (is_loopback || host.eq_ignore_ascii_case("localhost"))
}
