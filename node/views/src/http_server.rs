//! An HTTP server on a thread of its own, for the live page and for the Foxglove endpoint.
//!
//! axum's own loop is not used, because it buffers 400 kB for a stalled reader and has no time limit for the head of a request. The
//! tokio runtime ends with the thread and takes all connections with it, so that stopping the server waits for nobody.

use crate::error::ServeError;
use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use socket2::{SockRef, TcpKeepalive};
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::sync::{Semaphore, oneshot};

/// A client that receives nothing for this long is disconnected, so that others can connect. So is one that answers no probe for this long,
/// because its machine is gone.
pub(crate) const PATIENCE: Duration = Duration::from_secs(20);
/// Time limit for a client to send the head of a request.
const HEAD_WITHIN: Duration = Duration::from_secs(10);

/// Limits of a server.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    /// Maximum number of simultaneous connections; further ones wait. A WebSocket counts only until its handshake is over.
    pub(crate) connections: usize,
    /// Bytes that the system buffers for a client.
    pub(crate) system_buffer: usize,
    /// Bytes that this server buffers in addition. They do not apply to a WebSocket.
    pub(crate) own_buffer: usize,
}

/// The running server.
#[derive(Debug)]
pub(crate) struct HttpServer {
    address: SocketAddr,
    stop: oneshot::Sender<()>,
    thread: JoinHandle<io::Result<()>>,
}

/// Listens on `address`; returns the address with the port that the system chose, if `address` has port 0.
///
/// # Errors
/// The system's error, for example because the port is in use.
pub(crate) fn listen(address: SocketAddr) -> io::Result<(TcpListener, SocketAddr)> {
    let listener = TcpListener::bind(address)?;
    listener.set_nonblocking(true)?;
    let address = listener.local_addr()?;
    Ok((listener, address))
}

impl HttpServer {
    /// Serves `router` on `listener`, whose address is `address`, from a thread called `name`.
    ///
    /// # Errors
    /// When the system provides no thread.
    pub(crate) fn start(
        name: &'static str,
        listener: TcpListener,
        address: SocketAddr,
        limits: Limits,
        router: Router,
    ) -> Result<Self, ServeError> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(ServeError::io("starting a web server"))?;
        let (stop, stopped) = oneshot::channel();
        let thread = std::thread::Builder::new()
            .name(name.to_owned())
            .spawn(move || {
                runtime.block_on(async {
                    let listener = tokio::net::TcpListener::from_std(listener)?;
                    tokio::select! {
                        () = accept(listener, limits, router) => Ok(()),
                        _ = stopped => Ok(()),
                    }
                })
            })
            .map_err(ServeError::io("starting the thread of a web server"))?;
        Ok(Self { address, stop, thread })
    }

    /// The address on which the server listens.
    pub(crate) fn address(&self) -> SocketAddr {
        self.address
    }

    /// True while the server runs.
    pub(crate) fn is_alive(&self) -> bool {
        !self.thread.is_finished()
    }

    /// Stops the server and ends all connections.
    ///
    /// # Errors
    /// The error that ended the server before, if any.
    pub(crate) fn stop(self) -> Result<(), ServeError> {
        // Sending fails if the thread has ended already; joining it returns the reason.
        let _ = self.stop.send(());
        match self.thread.join() {
            Ok(ended) => ended.map_err(ServeError::io("serving")),
            Err(_) => Err(ServeError::Panicked),
        }
    }
}

/// Accepts connections forever.
async fn accept(listener: tokio::net::TcpListener, limits: Limits, router: Router) {
    let places = Arc::new(Semaphore::new(limits.connections));
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(HEAD_WITHIN).max_buf_size(limits.own_buffer);
    // The semaphore is never closed.
    while let Ok(place) = Arc::clone(&places).acquire_owned().await {
        match listener.accept().await {
            Ok((stream, _)) => {
                tune(&stream, limits);
                let serving = http
                    .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router.clone()))
                    .with_upgrades();
                tokio::spawn(async move {
                    let _place = place;
                    if let Err(error) = serving.await {
                        tracing::debug!(%error, "a connection has ended");
                    }
                });
            }
            // The client has disconnected already, or there are too many open files. Other connections continue meanwhile.
            Err(error) => {
                tracing::debug!(%error, "cannot accept a connection");
                tokio::time::sleep(Duration::from_millis(100)).await;
            }
        }
    }
}

/// Sets the socket options of a connection.
fn tune(stream: &TcpStream, limits: Limits) {
    let socket = SockRef::from(stream);
    let probes = TcpKeepalive::new().with_time(PATIENCE / 2).with_interval(PATIENCE / 4);
    let tuned = socket
        .set_send_buffer_size(limits.system_buffer)
        .and_then(|()| socket.set_tcp_nodelay(true))
        .and_then(|()| socket.set_tcp_keepalive(&probes));
    #[cfg(target_os = "linux")]
    let tuned = tuned.and_then(|()| socket.set_tcp_user_timeout(Some(PATIENCE)));
    if let Err(error) = tuned {
        tracing::debug!(%error, "cannot set the options of a connection");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without probes, a viewer that asks for nothing and whose machine is gone would keep its place.
    #[tokio::test]
    async fn a_silent_connection_is_probed() {
        let (listener, address) = listen(SocketAddr::from(([127, 0, 0, 1], 0))).expect("a port");
        let listener = tokio::net::TcpListener::from_std(listener).expect("a listener");
        let (_client, accepted) = tokio::join!(TcpStream::connect(address), listener.accept());
        let (stream, _) = accepted.expect("a connection");
        tune(&stream, Limits { connections: 1, system_buffer: 64 << 10, own_buffer: 16 << 10 });
        let socket = SockRef::from(&stream);
        assert!(socket.keepalive().expect("an option"));
        assert!(socket.tcp_keepalive_time().expect("an option") <= PATIENCE);
    }
}
