//! HTTP routes of the workshop (uploads, replays, diagnoses), and the check of who may use them.
//!
//! | request | does |
//! |---|---|
//! | `GET /runs`, `GET /workshop` | lists the runs; returns the whole state of the workshop |
//! | `GET /reports/NAME` | returns a report, as page or JSON |
//! | `POST /runs?name=NAME` | uploads the body as a run; `thesis_txt`, `skip_bad_rows`, `drive`, `namespace`, `joint` say how it is read |
//! | `POST /runs/delete` `{run}` | deletes a run |
//! | `POST /replay` `{run, model, rate}` | replays a run through a separate node |
//! | `POST /replay/turn` `{turn, rate}` | `pause`, `resume`, `stop`, `rate` |
//! | `POST /closing` `{damper, history_s}` | asks a damper's node for a diagnosis |
//! | `POST /closing/cancel` `{damper}` | cancels the diagnosis |
//!
//! A POST must come from this server's own page; its origin and its token are checked. Without `--workshop` these paths answer
//! 404. Work runs on separate threads, so that the server's thread never waits for it.

use super::Shared;
use super::token::{HEADER, Token};
use crate::http_server::PATIENCE;
use crate::watch::json;
use crate::workshop::{
    ReadOptions, Refusal, RefusalKind, ReplayCommand, Upload, UploadPart, WorkshopRequests,
};
use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{DefaultBodyLimit, Path, Query, Request, State};
use axum::http::{HeaderMap, HeaderName, StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{any, get, post};
use futures::StreamExt;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::sync::Arc;
use tokio::sync::oneshot;

/// Maximum size of a request that is not an upload, bytes.
const MOST_WORDS: usize = 16 << 10;
/// Content security policy of a report: it may show its text and style, but run no scripts.
const REPORT_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox; base-uri 'none'; \
                             form-action 'none'; frame-ancestors 'none'";
/// The paths that exist only with `--workshop`.
const PATHS: [&str; 10] = [
    "/workshop",
    "/workshop.js",
    "/workshop.css",
    "/runs",
    "/runs/delete",
    "/replay",
    "/replay/turn",
    "/closing",
    "/closing/cancel",
    "/reports/{name}",
];

/// The routes of the workshop.
pub(super) fn routes(workshop: &(Arc<dyn WorkshopRequests>, Token)) -> Router<Arc<Shared>> {
    let own = from_fn_with_state(workshop.1.clone(), from_own_page);
    Router::new()
        .route("/runs/delete", post(delete_run))
        .route("/replay", post(start_replay))
        .route("/replay/turn", post(control_replay))
        .route("/closing", post(start_diagnosis))
        .route("/closing/cancel", post(cancel_diagnosis))
        .layer(DefaultBodyLimit::max(MOST_WORDS))
        // The body of an upload is streamed; its size is limited while it is received.
        .route("/runs", get(runs).post(upload))
        .route_layer(own)
        .route("/workshop", get(whole))
        .route("/reports/{name}", get(report))
        .with_state(Arc::clone(&workshop.0))
}

/// The same paths without a workshop: they answer how to enable it.
pub(super) fn disabled(router: Router<Arc<Shared>>) -> Router<Arc<Shared>> {
    let says = "the workshop is not enabled: this page is read-only. Start mr-damper serve --workshop DIR to enable it\n";
    PATHS.into_iter().fold(router, |router, path| {
        router.route(path, any(move || async move { (StatusCode::NOT_FOUND, says) }))
    })
}

/// Passes on read-only requests, and other requests only from this server's own page.
async fn from_own_page(State(token): State<Token>, request: Request, next: Next) -> Response {
    if request.method().is_safe() {
        return next.run(request).await;
    }
    match foreign(request.headers(), &token) {
        Some(why) => (StatusCode::FORBIDDEN, format!("{why}\n")).into_response(),
        None => next.run(request).await,
    }
}

/// Why a request does not come from this server's own page; `None` when it does.
fn foreign(headers: &HeaderMap, token: &Token) -> Option<String> {
    let text = |name: &HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or_default());
    let host = text(&header::HOST).unwrap_or_default();
    let site = text(&HeaderName::from_static("sec-fetch-site"));
    // A browser sends at least one of these headers, and a page cannot change them.
    match (text(&header::ORIGIN), site) {
        (None, None) => {
            return Some(format!(
                "a request that changes something needs the header Origin: http://{host}, which shows that it comes from this page"
            ));
        }
        (Some(origin), _) if origin != format!("http://{host}") => {
            return Some(format!(
                "{origin} may not change anything here; only the page of http://{host} may"
            ));
        }
        (_, Some(site)) if site != "same-origin" => {
            return Some(format!(
                "a {site} request may not change anything here; only the page of http://{host} may"
            ));
        }
        _ => {}
    }
    let given = text(&HeaderName::from_static(HEADER)).unwrap_or_default();
    (!token.is(given)).then(|| {
        format!(
            "the header {HEADER} is {}: it must be the content of the page's meta element mr-damper-token; reload the page if this \
             server was restarted",
            if given.is_empty() { "missing" } else { "not the token of this server" }
        )
    })
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let status = match self.kind {
            RefusalKind::Wrong => StatusCode::BAD_REQUEST,
            RefusalKind::Missing => StatusCode::NOT_FOUND,
            RefusalKind::Busy => StatusCode::CONFLICT,
            RefusalKind::TooMuch => StatusCode::PAYLOAD_TOO_LARGE,
            RefusalKind::Failed => StatusCode::INTERNAL_SERVER_ERROR,
        };
        (status, format!("{}\n", self.says)).into_response()
    }
}

/// A JSON response.
fn answer(text: String) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], text).into_response()
}

/// Runs `work` on a separate thread and returns its result.
async fn on_thread<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, Refusal> + Send + 'static,
) -> Result<T, Refusal> {
    let (done, doing) = oneshot::channel();
    let begun = std::thread::Builder::new().name("workshop-request".to_owned()).spawn(move || {
        // The client may have disconnected.
        let _ = done.send(work());
    });
    begun.map_err(|error| Refusal::new(RefusalKind::Failed, format!("cannot start a thread: {error}")))?;
    doing
        .await
        .unwrap_or_else(|_| Err(Refusal::new(RefusalKind::Failed, "a panic occurred; see the server's log")))
}

/// Parses the JSON body of a request.
fn parse_body<T: DeserializeOwned>(body: &Bytes) -> Result<T, Refusal> {
    serde_json::from_slice(body).map_err(|error| {
        Refusal::new(RefusalKind::Wrong, format!("the request's body is not the expected JSON: {error}"))
    })
}

/// Runs the work of a request, and responds with its message.
async fn finished(
    work: impl FnOnce() -> Result<String, Refusal> + Send + 'static,
) -> Result<Response, Refusal> {
    on_thread(work).await.map(|says| answer(json(&serde_json::json!({ "says": says }))))
}

async fn whole(State(workshop): State<Arc<dyn WorkshopRequests>>) -> Response {
    answer(json(&workshop.state()))
}

async fn runs(State(workshop): State<Arc<dyn WorkshopRequests>>) -> Response {
    answer(json(&workshop.state().runs))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RunRequest {
    run: String,
}

async fn delete_run(
    State(workshop): State<Arc<dyn WorkshopRequests>>,
    body: Bytes,
) -> Result<Response, Refusal> {
    let RunRequest { run } = parse_body(&body)?;
    finished(move || workshop.delete_run(&run)).await
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ReplayRequest {
    run: String,
    model: String,
    rate: Option<f64>,
}

async fn start_replay(
    State(workshop): State<Arc<dyn WorkshopRequests>>,
    body: Bytes,
) -> Result<Response, Refusal> {
    let ReplayRequest { run, model, rate } = parse_body(&body)?;
    finished(move || workshop.start_replay(&run, &model, rate.unwrap_or(1.0))).await
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case", tag = "turn", deny_unknown_fields)]
enum ReplayCommandRequest {
    Pause,
    Resume,
    Stop,
    Rate { rate: f64 },
}

async fn control_replay(
    State(workshop): State<Arc<dyn WorkshopRequests>>,
    body: Bytes,
) -> Result<Response, Refusal> {
    let command = match parse_body(&body)? {
        ReplayCommandRequest::Pause => ReplayCommand::Pause,
        ReplayCommandRequest::Resume => ReplayCommand::Resume,
        ReplayCommandRequest::Stop => ReplayCommand::Stop,
        ReplayCommandRequest::Rate { rate } => ReplayCommand::Rate(rate),
    };
    finished(move || workshop.control_replay(command)).await
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DiagnosisRequest {
    damper: String,
    history_s: Option<f64>,
}

async fn start_diagnosis(
    State(workshop): State<Arc<dyn WorkshopRequests>>,
    body: Bytes,
) -> Result<Response, Refusal> {
    let DiagnosisRequest { damper, history_s } = parse_body(&body)?;
    finished(move || workshop.start_diagnosis(&damper, history_s)).await
}

async fn cancel_diagnosis(
    State(workshop): State<Arc<dyn WorkshopRequests>>,
    body: Bytes,
) -> Result<Response, Refusal> {
    let DiagnosisRequest { damper, .. } = parse_body(&body)?;
    finished(move || workshop.cancel_diagnosis(&damper)).await
}

async fn report(
    State(workshop): State<Arc<dyn WorkshopRequests>>,
    Path(name): Path<String>,
) -> Result<Response, Refusal> {
    let kind = if name.ends_with(".json") { "application/json" } else { "text/html; charset=utf-8" };
    let text = on_thread(move || workshop.report(&name)).await?;
    Ok(([(header::CONTENT_TYPE, kind), (header::CONTENT_SECURITY_POLICY, REPORT_POLICY)], text)
        .into_response())
}

/// Name of an upload, and how it is read.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct UploadQuery {
    #[serde(default)]
    name: String,
    #[serde(default)]
    thesis_txt: bool,
    #[serde(default)]
    skip_bad_rows: bool,
    drive: Option<String>,
    namespace: Option<String>,
    joint: Option<String>,
}

async fn upload(
    State(workshop): State<Arc<dyn WorkshopRequests>>,
    Query(of): Query<UploadQuery>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Refusal> {
    let UploadQuery { name, thesis_txt, skip_bad_rows, drive, namespace, joint } = of;
    let options = ReadOptions { thesis_txt, skip_bad_rows, drive, namespace, joint };
    let length = headers.get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok()?.parse().ok());
    let Upload { parts, kept } = on_thread(move || workshop.take_upload(&name, options, length)).await?;
    let mut pieces = body.into_data_stream();
    loop {
        let piece = tokio::time::timeout(PATIENCE, pieces.next()).await;
        let part = match piece {
            Ok(Some(Ok(bytes))) => UploadPart::Bytes(bytes),
            Ok(None) => UploadPart::End,
            // Dropping the queue marks the upload as cut off.
            Ok(Some(Err(error))) => {
                return Err(Refusal::new(
                    RefusalKind::Wrong,
                    format!("the upload was cut off and is not kept: {error}"),
                ));
            }
            Err(_) => {
                let says =
                    format!("no data was received for {} s; the upload is not kept", PATIENCE.as_secs());
                return Err(Refusal::new(RefusalKind::Wrong, says));
            }
        };
        let was_last = matches!(part, UploadPart::End);
        // If the receiver has ended (size limit, full disk), the result below says why.
        if parts.send(part).await.is_err() || was_last {
            break;
        }
    }
    let about = kept.await.unwrap_or_else(|_| {
        Err(Refusal::new(
            RefusalKind::Failed,
            "the server or the upload's thread has ended; the upload is not kept",
        ))
    })?;
    Ok(answer(json(&about)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        let value = |text: &str| text.parse().expect("a value");
        pairs.iter().map(|(name, text)| (HeaderName::from_static(name), value(text))).collect()
    }

    #[test]
    fn only_the_servers_own_page_may_change_anything() {
        let token = Token::new().expect("randomness");
        let (host, own) = ("127.0.0.1:8330", token.text());
        let refusal =
            |pairs: &[(&'static str, &str)]| foreign(&headers(&[&[("host", host)], pairs].concat()), &token);
        for good in [
            &[("origin", "http://127.0.0.1:8330"), (HEADER, own)][..],
            &[("sec-fetch-site", "same-origin"), (HEADER, own)],
            &[("origin", "http://127.0.0.1:8330"), ("sec-fetch-site", "same-origin"), (HEADER, own)],
        ] {
            assert_eq!(refusal(good), None, "{good:?}");
        }
        for (bad, says) in [
            (&[][..], "needs the header Origin"),
            (&[(HEADER, own)], "needs the header Origin"),
            (&[("origin", "http://127.0.0.1:8330")], "is missing"),
            (&[("origin", "http://127.0.0.1:8330"), (HEADER, "0123")], "is not the token of this server"),
            (&[("origin", "http://evil.example"), (HEADER, own)], "http://evil.example may not"),
            (&[("origin", "http://127.0.0.1:8331"), (HEADER, own)], "http://127.0.0.1:8331 may not"),
            (&[("origin", "https://127.0.0.1:8330"), (HEADER, own)], "may not"),
            (&[("origin", "null"), (HEADER, own)], "null may not"),
            (&[("origin", ""), (HEADER, own)], "may not"),
            (&[("sec-fetch-site", "same-site"), (HEADER, own)], "a same-site request"),
            (&[("sec-fetch-site", "none"), (HEADER, own)], "a none request"),
            (
                &[("origin", "http://127.0.0.1:8330"), ("sec-fetch-site", "cross-site"), (HEADER, own)],
                "a cross-site request",
            ),
        ] {
            let refused = refusal(bad);
            assert!(refused.as_ref().is_some_and(|why| why.contains(says)), "{bad:?}: {refused:?}");
        }
    }

    #[test]
    fn malformed_bodies_are_refused() {
        assert!(parse_body::<RunRequest>(&Bytes::from_static(b"{\"run\": \"a\"}")).is_ok());
        for bad in ["", "{}", "{\"run\": 1}", "{\"run\": \"a\", \"path\": \"/\"}"] {
            let refused = parse_body::<RunRequest>(&Bytes::from(bad)).map(|of| of.run).expect_err(bad);
            assert_eq!(refused.kind, RefusalKind::Wrong);
        }
        for (body, good) in [
            ("{\"turn\": \"pause\"}", true),
            ("{\"turn\": \"rate\", \"rate\": 2}", true),
            ("{\"turn\": \"rate\"}", false),
            ("{\"turn\": \"jump\"}", false),
        ] {
            assert_eq!(parse_body::<ReplayCommandRequest>(&Bytes::from(body)).is_ok(), good, "{body}");
        }
    }
}
