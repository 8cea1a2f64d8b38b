//! The web server of the live page: serves files that are compiled in, and an event stream.
//!
//! ```text
//! watch/ ─→ LiveData ─┬→ GET /snapshot       all values as JSON
//!                     ├→ GET /events         server-sent events: start, then a batch every 20 ms
//!                     └→ GET /history        the last minutes of a damper: ?damper=NAME&from_s=SECONDS
//!               page/ ──→ GET /              the page, its style and its scripts
//! workshop/ ←─────────→ workshop_routes.rs   only with --workshop: diagnoses, uploads, replays; changes are POST requests
//! ```
//!
//! Without `--workshop` the server is read-only: no request of a browser reaches a damper, and only GET and HEAD are served. The
//! server listens on loopback by default and checks the host and origin of requests (`request_check.rs`). A reader that does not
//! keep up loses batches and gets their number; nothing waits for it.

mod events;
mod request_check;
mod token;
mod workshop_routes;

pub use request_check::{AllowedOrigin, Hosts, require_loopback, require_loopback_for_workshop};
pub use token::Token;

use crate::error::ServeError;
use crate::http_server::{HttpServer, Limits, listen};
use crate::watch::{DamperRegistry, DataOrigin, SharedRegistry, Snapshot, json};
use crate::workshop::{WorkshopRequests, WorkshopState};
use axum::Router;
use axum::extract::{Query, State};
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use serde::{Deserialize, Serialize};
use std::net::SocketAddr;
use std::sync::{Arc, MutexGuard};
use tokio::sync::{Semaphore, broadcast};

/// Maximum number of simultaneous event streams.
pub const MOST_STREAMS: usize = 16;
/// Batches that are queued for a reader, more than a second of them.
const BACKLOG: usize = 64;
/// The server's buffers are small, because old batches are useless to a reader: beyond the buffers its batches are skipped.
const LIMITS: Limits = Limits { connections: 64, system_buffer: 32 << 10, own_buffer: 16 << 10 };

/// The served data: the registry of all dampers, and the batches made from it.
#[derive(Debug)]
pub struct LiveData {
    registry: Arc<SharedRegistry>,
    batches: broadcast::Sender<Batch>,
}

/// A batch for all streams.
#[derive(Debug, Clone)]
struct Batch {
    number: u64,
    json: Arc<str>,
}

impl LiveData {
    /// An empty registry for data from `origin`.
    #[must_use]
    pub fn of(origin: DataOrigin) -> Self {
        Self { registry: Arc::new(SharedRegistry::of(origin)), batches: broadcast::channel(BACKLOG).0 }
    }

    /// The shared registry with its clock, for other writers.
    #[must_use]
    pub fn shared_registry(&self) -> Arc<SharedRegistry> {
        Arc::clone(&self.registry)
    }

    /// Seconds since this was created, the clock of all data in the registry.
    #[must_use]
    pub fn now_s(&self) -> f64 {
        self.registry.now_s()
    }

    /// Locks the registry. Hold it only briefly.
    pub fn registry(&self) -> MutexGuard<'_, DamperRegistry> {
        self.registry.lock()
    }

    /// Makes a batch and sends it to all streams. Without streams it does nothing; the next stream begins with all points.
    pub fn send_batch(&self) {
        if self.batches.receiver_count() == 0 {
            return;
        }
        let (number, json) = self.registry().batch(self.now_s());
        // An error means that the last stream has just ended.
        let _ = self.batches.send(Batch { number, json: json.into() });
    }
}

/// State that all request handlers share.
#[derive(Debug)]
struct Shared {
    live: Arc<LiveData>,
    hosts: Hosts,
    allowed_origins: Vec<AllowedOrigin>,
    places: Arc<Semaphore>,
    /// The workshop, if enabled, and the token that its page must send.
    workshop: Option<(Arc<dyn WorkshopRequests>, Token)>,
}

/// The running server.
#[derive(Debug)]
pub struct Server(HttpServer);

impl Server {
    /// Listens on `address` and serves `live` from a separate thread, also to the origins
    /// `allowed_origins`, and the workshop if there is one.
    ///
    /// # Errors
    /// When the server cannot listen on the address (for example because the port is in use), or the system provides no thread or no
    /// randomness.
    pub fn start(
        address: SocketAddr,
        any_host: bool,
        allowed_origins: &[AllowedOrigin],
        live: Arc<LiveData>,
        workshop: Option<Arc<dyn WorkshopRequests>>,
    ) -> Result<Self, ServeError> {
        let workshop = workshop.map(|workshop| Token::new().map(|token| (workshop, token))).transpose()?;
        let (listener, address) =
            listen(address).map_err(|source| ServeError::Listen { option: "--listen", address, source })?;
        let shared = Arc::new(Shared {
            live,
            hosts: Hosts::new(address, any_host),
            allowed_origins: allowed_origins.to_vec(),
            places: Arc::new(Semaphore::new(MOST_STREAMS)),
            workshop,
        });
        HttpServer::start("web-server", listener, address, LIMITS, routes(shared)).map(Self)
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

    /// Stops the server and all streams.
    ///
    /// # Errors
    /// The error that ended the server before, if any.
    pub fn stop(self) -> Result<(), ServeError> {
        self.0.stop()
    }
}

/// The page. Its comments `WORKSHOP HEAD` and `WORKSHOP BODY` mark where the parts of the workshop are inserted.
const PAGE: &str = include_str!("page/page.html");
/// The inserted parts when the workshop is enabled: in the head, and after the dampers.
const WORKSHOP_HEAD: &str = "<meta name=\"mr-damper-token\" content=\"TOKEN\">\n<link rel=\"stylesheet\" href=\"/workshop.css\">\n\
                         <script type=\"module\" src=\"/workshop.js\"></script>";
const WORKSHOP_BODY: &str = include_str!("page/workshop.html");

/// Content types of the page's files.
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// The page's other files: path, content type, content.
const PAGE_FILES: [StaticFile; 9] = [
    ("/page.css", CSS, include_str!("page/page.css")),
    ("/page.js", SCRIPT, include_str!("page/page.js")),
    ("/overview.js", SCRIPT, include_str!("page/overview.js")),
    ("/detail.js", SCRIPT, include_str!("page/detail.js")),
    ("/range.js", SCRIPT, include_str!("page/range.js")),
    ("/charts.js", SCRIPT, include_str!("page/charts.js")),
    ("/trails.js", SCRIPT, include_str!("page/trails.js")),
    ("/export.js", SCRIPT, include_str!("page/export.js")),
    ("/words.js", SCRIPT, include_str!("page/words.js")),
];
/// Additional files of the workshop.
const WORKSHOP_FILES: [StaticFile; 2] = [
    ("/workshop.css", CSS, include_str!("page/workshop.css")),
    ("/workshop.js", SCRIPT, include_str!("page/workshop.js")),
];

type StaticFile = (&'static str, &'static str, &'static str);

/// The page as sent, with the workshop if there is a token.
fn page(token: Option<&Token>) -> String {
    let (head, body) = match token {
        Some(token) => (WORKSHOP_HEAD.replace("TOKEN", token.text()), WORKSHOP_BODY),
        None => (String::new(), ""),
    };
    PAGE.replace("<!-- WORKSHOP HEAD -->\n", &format!("{head}\n").replace("\n\n", "\n"))
        .replace("<!-- WORKSHOP BODY -->\n", body)
}

fn routes(shared: Arc<Shared>) -> Router {
    let mut router = Router::new()
        .route("/snapshot", get(snapshot))
        .route("/history", get(history))
        .route("/events", get(events::stream));
    let whole: Arc<str> = page(shared.workshop.as_ref().map(|(_, token)| token)).into();
    let html = [(header::CONTENT_TYPE, "text/html; charset=utf-8")];
    router = router.route("/", get(move || async move { (html, String::from(&*whole)) }));
    let files = PAGE_FILES.into_iter().chain(shared.workshop.iter().flat_map(|_| WORKSHOP_FILES));
    for (path, kind, content) in files {
        router = router.route(path, get(move || async move { ([(header::CONTENT_TYPE, kind)], content) }));
    }
    router = match &shared.workshop {
        Some(workshop) => router.merge(workshop_routes::routes(workshop)),
        None => workshop_routes::disabled(router),
    };
    router
        .fallback(|| async {
            (StatusCode::NOT_FOUND, "not found; available are /, /events, /history and /snapshot\n")
        })
        .method_not_allowed_fallback(only_get)
        .layer(from_fn_with_state(Arc::clone(&shared), request_check::check))
        .with_state(shared)
}

async fn only_get(State(shared): State<Arc<Shared>>, method: Method) -> Response {
    if shared.workshop.is_some() {
        // axum adds the allowed methods.
        return (StatusCode::METHOD_NOT_ALLOWED, format!("{method} is not served here\n")).into_response();
    }
    let says = format!(
        "{method} is not served: this page is read-only. Start the server with --workshop DIR to enable more\n"
    );
    (StatusCode::METHOD_NOT_ALLOWED, [(header::ALLOW, "GET, HEAD")], says).into_response()
}

/// The response of `/snapshot`.
#[derive(Serialize)]
struct Everything<'a> {
    #[serde(flatten)]
    snapshot: Snapshot<'a>,
    #[serde(skip_serializing_if = "Option::is_none")]
    workshop: Option<WorkshopState>,
}

impl Shared {
    /// The workshop for a request with these headers; `None` without a workshop, and for other allowed origins.
    fn workshop_for(&self, headers: &HeaderMap) -> Option<&Arc<dyn WorkshopRequests>> {
        let (workshop, _) = self.workshop.as_ref()?;
        request_check::allowed_origin(&self.allowed_origins, headers).is_none().then_some(workshop)
    }
}

async fn snapshot(State(shared): State<Arc<Shared>>, headers: HeaderMap) -> Response {
    let live = &shared.live;
    let workshop = shared.workshop_for(&headers).map(|workshop| workshop.state());
    let text = json(&Everything { snapshot: live.registry().snapshot(live.now_s()), workshop });
    ([(header::CONTENT_TYPE, "application/json")], text).into_response()
}

/// The query of `/history`.
#[derive(Debug, Deserialize)]
struct HistoryQuery {
    /// Name of the damper.
    damper: String,
    /// First time, s since the damper's first sample; by default everything that is kept.
    from_s: Option<f64>,
}

async fn history(State(shared): State<Arc<Shared>>, Query(query): Query<HistoryQuery>) -> Response {
    let found = shared.live.registry().history(&query.damper, query.from_s.unwrap_or(f64::NEG_INFINITY));
    // The registry is not locked while the JSON is made.
    match found {
        Some(found) => ([(header::CONTENT_TYPE, "application/json")], json(&found)).into_response(),
        None => (StatusCode::NOT_FOUND, format!("no damper named \"{}\" is watched\n", query.damper))
            .into_response(),
    }
}
