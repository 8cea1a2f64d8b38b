//! The live page: a server of some files and a stream, all of them compiled in or made here.
//!
//! ```text
//! watch/ ─→ Live ─┬→ GET /snapshot   all figures as JSON
//!                 └→ GET /events     server-sent events: start, then a batch every 20 ms
//!           page/ ──→ GET /          the page, its style and its scripts
//! workshop/ ←─────→ bench.rs         with --workshop alone: closings, uploads, replays; what changes something is POST
//! ```
//!
//! Read-only unless a workshop is open: without one nothing that a browser sends reaches a damper, and there is no other method than
//! GET (and HEAD). The server listens on loopback unless it is told otherwise, and answers only whom it was meant for (`guard.rs`). A
//! reader that does not keep up loses batches, and is told how many; nobody waits for it.

mod bench;
mod events;
mod guard;
mod token;

pub use guard::{Guest, Hosts, require_loopback, require_loopback_for_workshop};
pub use token::Token;

use crate::error::NodeError;
use crate::watch::{Hall, Origin, Snapshot, Wall, json};
use crate::workshop::{State as Shop, Workshop};
use axum::Router;
use axum::extract::State;
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use serde::Serialize;
use socket2::SockRef;
use std::net::{SocketAddr, TcpListener};
use std::sync::{Arc, MutexGuard};
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::sync::{Semaphore, broadcast, oneshot};

/// Streams at a time.
pub const MOST_STREAMS: usize = 16;
/// Batches that wait for a reader: more than a second of them.
const BACKLOG: usize = 64;
/// Connections at a time; others wait to be let in.
const MOST_CONNECTIONS: usize = 64;
/// Bytes that the system keeps for a reader, and that we keep besides. Beyond, its batches are skipped: old ones are no use to it.
const SYSTEM_BUFFER: usize = 32 << 10;
const OWN_BUFFER: usize = 16 << 10;
/// A reader that takes nothing for this long is cut off, so that its place is free for another.
const PATIENCE: Duration = Duration::from_secs(20);
/// So is one that does not say what it wants.
const HEAD_WITHIN: Duration = Duration::from_secs(10);

/// What is served: the wall, and the batches that are made of it.
#[derive(Debug)]
pub struct Live {
    hall: Arc<Hall>,
    batches: broadcast::Sender<Batch>,
}

/// A batch for all streams.
#[derive(Debug, Clone)]
struct Batch {
    number: u64,
    json: Arc<str>,
}

impl Live {
    /// Nothing yet, from `origin`.
    #[must_use]
    pub fn of(origin: Origin) -> Self {
        Self { hall: Arc::new(Hall::of(origin)), batches: broadcast::channel(BACKLOG).0 }
    }

    /// The wall and its clock, for others who hang something there.
    #[must_use]
    pub fn hall(&self) -> Arc<Hall> {
        Arc::clone(&self.hall)
    }

    /// Seconds since it was made: the clock of everything on the wall.
    #[must_use]
    pub fn now_s(&self) -> f64 {
        self.hall.now_s()
    }

    /// The wall, for a moment.
    pub fn wall(&self) -> MutexGuard<'_, Wall> {
        self.hall.wall()
    }

    /// Makes a batch and offers it to all streams, if there are any. What is not sent then is in the start of the next one.
    pub fn send_batch(&self) {
        if self.batches.receiver_count() == 0 {
            return;
        }
        let (number, json) = self.wall().batch(self.now_s());
        // An error says that nobody listens any more.
        let _ = self.batches.send(Batch { number, json: json.into() });
    }
}

/// What requests are answered from.
#[derive(Debug)]
struct Shared {
    live: Arc<Live>,
    hosts: Hosts,
    guests: Vec<Guest>,
    places: Arc<Semaphore>,
    /// The workshop, where one is open, and what its page shows to be it.
    shop: Option<(Arc<Workshop>, Token)>,
}

/// The running server.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    stop: oneshot::Sender<()>,
    thread: JoinHandle<std::io::Result<()>>,
}

impl Server {
    /// Listens on `address` and serves `live` from a thread of its own, to `guests` too; and what the workshop does, where there is one.
    ///
    /// # Errors
    /// When the address cannot be listened on, as when the port is taken, or the system gives no thread or no randomness.
    pub fn start(
        address: SocketAddr,
        any_host: bool,
        guests: &[Guest],
        live: Arc<Live>,
        workshop: Option<Arc<Workshop>>,
    ) -> Result<Self, NodeError> {
        let shop = workshop.map(|workshop| Token::new().map(|token| (workshop, token))).transpose()?;
        let listening = |error: std::io::Error| {
            NodeError::Failed(format!(
                "listening on {address}: {error}; is there another mr-damper serve? Choose another port with --listen {}:{}",
                address.ip(),
                address.port().wrapping_add(1).max(1024)
            ))
        };
        let listener = TcpListener::bind(address).map_err(listening)?;
        listener.set_nonblocking(true).map_err(listening)?;
        let address = listener.local_addr().map_err(listening)?;
        let shared = Arc::new(Shared {
            live,
            hosts: Hosts::new(address, any_host),
            guests: guests.to_vec(),
            places: Arc::new(Semaphore::new(MOST_STREAMS)),
            shop,
        });
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(NodeError::io("starting the web server"))?;
        let (stop, stopped) = oneshot::channel();
        let thread = std::thread::Builder::new()
            .name("web-server".to_owned())
            .spawn(move || {
                runtime.block_on(async {
                    let listener = tokio::net::TcpListener::from_std(listener)?;
                    tokio::select! {
                        () = accept(listener, routes(shared)) => Ok(()),
                        // The runtime goes with this thread, and with it all streams: nobody is waited for.
                        _ = stopped => Ok(()),
                    }
                })
            })
            .map_err(NodeError::io("starting the thread of the web server"))?;
        Ok(Self { address, stop, thread })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// True while it serves.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        !self.thread.is_finished()
    }

    /// Ends it, and all streams with it.
    ///
    /// # Errors
    /// What ended it before, if something did.
    pub fn stop(self) -> Result<(), NodeError> {
        // A thread that has ended does not listen any more; why it has comes next.
        let _ = self.stop.send(());
        match self.thread.join() {
            Ok(ended) => ended.map_err(NodeError::io("serving the page")),
            Err(_) => Err(NodeError::Failed(
                "the web server's thread panicked; the log above says where. Please report it".to_owned(),
            )),
        }
    }
}

/// Lets readers in, for ever. Not by axum's own loop: that keeps 400 kB for a reader that has stalled, and waits for heads without end.
async fn accept(listener: tokio::net::TcpListener, router: Router) {
    let places = Arc::new(Semaphore::new(MOST_CONNECTIONS));
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(HEAD_WITHIN).max_buf_size(OWN_BUFFER);
    // The semaphore is never closed.
    while let Ok(place) = Arc::clone(&places).acquire_owned().await {
        match listener.accept().await {
            Ok((stream, _)) => {
                tune(&stream);
                let serving =
                    http.serve_connection(TokioIo::new(stream), TowerToHyperService::new(router.clone()));
                tokio::spawn(async move {
                    let _place = place;
                    if let Err(error) = serving.await {
                        tracing::debug!(%error, "a connection has ended");
                    }
                });
            }
            // That of a reader which has gone already, or no open file left: others go on meanwhile.
            Err(error) => {
                tracing::debug!(%error, "a reader could not be let in");
                tokio::time::sleep(Duration::from_millis(100)).await;
            }
        }
    }
}

/// Sets up the connection to a reader.
fn tune(stream: &TcpStream) {
    let socket = SockRef::from(stream);
    let tuned = socket.set_send_buffer_size(SYSTEM_BUFFER).and_then(|()| socket.set_tcp_nodelay(true));
    #[cfg(target_os = "linux")]
    let tuned = tuned.and_then(|()| socket.set_tcp_user_timeout(Some(PATIENCE)));
    if let Err(error) = tuned {
        tracing::debug!(%error, "a connection stays as the system makes it");
    }
}

/// The page itself. Its comment `WORKSHOP` marks make place for the workshop.
const PAGE: &str = include_str!("page/page.html");
/// What stands there when a workshop is open: in the head, and after the dampers.
const SHOP_HEAD: &str = "<meta name=\"mr-damper-token\" content=\"TOKEN\">\n<link rel=\"stylesheet\" href=\"/workshop.css\">\n\
                         <script type=\"module\" src=\"/workshop.js\"></script>";
const SHOP_BODY: &str = include_str!("page/workshop.html");

/// The page's other parts: path, kind, content.
const PARTS: [Piece; 3] = [
    ("/page.css", "text/css; charset=utf-8", include_str!("page/page.css")),
    ("/page.js", "text/javascript; charset=utf-8", include_str!("page/page.js")),
    ("/charts.js", "text/javascript; charset=utf-8", include_str!("page/charts.js")),
];
/// Those of the workshop.
const SHOP_PARTS: [Piece; 2] = [
    ("/workshop.css", "text/css; charset=utf-8", include_str!("page/workshop.css")),
    ("/workshop.js", "text/javascript; charset=utf-8", include_str!("page/workshop.js")),
];

type Piece = (&'static str, &'static str, &'static str);

/// The page as it is sent.
fn page(token: Option<&Token>) -> String {
    let (head, body) = match token {
        Some(token) => (SHOP_HEAD.replace("TOKEN", token.text()), SHOP_BODY),
        None => (String::new(), ""),
    };
    PAGE.replace("<!-- WORKSHOP HEAD -->\n", &format!("{head}\n").replace("\n\n", "\n"))
        .replace("<!-- WORKSHOP BODY -->\n", body)
}

fn routes(shared: Arc<Shared>) -> Router {
    let mut router = Router::new().route("/snapshot", get(snapshot)).route("/events", get(events::stream));
    let whole: Arc<str> = page(shared.shop.as_ref().map(|(_, token)| token)).into();
    let html = [(header::CONTENT_TYPE, "text/html; charset=utf-8")];
    router = router.route("/", get(move || async move { (html, String::from(&*whole)) }));
    let parts = PARTS.into_iter().chain(shared.shop.iter().flat_map(|_| SHOP_PARTS));
    for (path, kind, content) in parts {
        router = router.route(path, get(move || async move { ([(header::CONTENT_TYPE, kind)], content) }));
    }
    router = match &shared.shop {
        Some(shop) => router.merge(bench::routes(shop)),
        None => bench::closed(router),
    };
    router
        .fallback(|| async { (StatusCode::NOT_FOUND, "there are /, /events and /snapshot\n") })
        .method_not_allowed_fallback(only_get)
        .layer(from_fn_with_state(Arc::clone(&shared), guard::watch))
        .with_state(shared)
}

async fn only_get(State(shared): State<Arc<Shared>>, method: Method) -> Response {
    if shared.shop.is_some() {
        // axum knows which methods there are.
        return (StatusCode::METHOD_NOT_ALLOWED, format!("{method} is not served here\n")).into_response();
    }
    let says = format!("{method} is not served: this page only shows. With --workshop DIR it does more\n");
    (StatusCode::METHOD_NOT_ALLOWED, [(header::ALLOW, "GET, HEAD")], says).into_response()
}

/// All there is, once.
#[derive(Serialize)]
struct Everything<'a> {
    #[serde(flatten)]
    snapshot: Snapshot<'a>,
    #[serde(skip_serializing_if = "Option::is_none")]
    workshop: Option<Shop>,
}

impl Shared {
    /// The workshop, as far as whoever asks with these headers may see it: guests see none.
    fn workshop_for(&self, headers: &HeaderMap) -> Option<&Arc<Workshop>> {
        let (workshop, _) = self.shop.as_ref()?;
        guard::guest(&self.guests, headers).is_none().then_some(workshop)
    }
}

async fn snapshot(State(shared): State<Arc<Shared>>, headers: HeaderMap) -> Response {
    let live = &shared.live;
    let workshop = shared.workshop_for(&headers).map(|workshop| workshop.state().clone());
    let text = json(&Everything { snapshot: live.wall().snapshot(live.now_s()), workshop });
    ([(header::CONTENT_TYPE, "application/json")], text).into_response()
}
