//! The workshop's way in: what a page may ask for, and who may.
//!
//! | request | does |
//! |---|---|
//! | `GET /runs`, `GET /workshop` | the runs; all that the workshop shows |
//! | `GET /reports/NAME` | a report, its page or its JSON |
//! | `POST /runs?name=NAME` | takes the body as a run; `thesis_txt`, `skip_bad_rows`, `drive`, `namespace`, `joint` say how it is read |
//! | `POST /runs/delete` `{run}` | deletes a run |
//! | `POST /replay` `{run, model, rate}` | replays a run through a node of the workshop's own |
//! | `POST /replay/turn` `{turn, rate}` | `pause`, `resume`, `stop`, `rate` |
//! | `POST /closing` `{damper, history_s}` | has a damper's node close its loop |
//! | `POST /closing/cancel` `{damper}` | gives that up |
//!
//! Whatever is POST has to come from this server's own page: by its origin, and by its token. Without a workshop none of these paths
//! answers. Work is done on threads of its own, so the server's is never waited for.

use super::token::{HEADER, Token};
use super::{PATIENCE, Shared};
use crate::watch::json;
use crate::workshop::{Kind, Part, Reading, Refusal, Turn, Upload, Workshop, run_name};
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

/// Bytes of a request that is no upload.
const MOST_WORDS: usize = 16 << 10;
/// What a report may do in a browser: show itself, with its own style. Its scripts, if it had any, stay dead.
const REPORT_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox; base-uri 'none'; \
                             form-action 'none'; frame-ancestors 'none'";
/// Where there is nothing without a workshop.
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

/// The paths of a workshop.
pub(super) fn routes(shop: &(Arc<Workshop>, Token)) -> Router<Arc<Shared>> {
    let own = from_fn_with_state(shop.1.clone(), from_own_page);
    Router::new()
        .route("/runs/delete", post(delete_run))
        .route("/replay", post(start_replay))
        .route("/replay/turn", post(turn_replay))
        .route("/closing", post(start_closing))
        .route("/closing/cancel", post(cancel_closing))
        .layer(DefaultBodyLimit::max(MOST_WORDS))
        // The body of an upload is not extracted; its limit is counted as it comes.
        .route("/runs", get(runs).post(upload))
        .route_layer(own)
        .route("/workshop", get(whole))
        .route("/reports/{name}", get(report))
        .with_state(Arc::clone(&shop.0))
}

/// The same paths where there is no workshop: they say how there would be one.
pub(super) fn closed(router: Router<Arc<Shared>>) -> Router<Arc<Shared>> {
    let says = "there is no workshop: this page only shows. mr-damper serve --workshop DIR opens one\n";
    PATHS.into_iter().fold(router, |router, path| {
        router.route(path, any(move || async move { (StatusCode::NOT_FOUND, says) }))
    })
}

/// Lets requests through that change nothing, and those of this server's own page.
async fn from_own_page(State(token): State<Token>, request: Request, next: Next) -> Response {
    if request.method().is_safe() {
        return next.run(request).await;
    }
    match stranger(request.headers(), &token) {
        Some(why) => (StatusCode::FORBIDDEN, format!("{why}\n")).into_response(),
        None => next.run(request).await,
    }
}

/// Why a request is not that of this server's own page; `None` when it is.
fn stranger(headers: &HeaderMap, token: &Token) -> Option<String> {
    let text = |name: &HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or_default());
    let host = text(&header::HOST).unwrap_or_default();
    let site = text(&HeaderName::from_static("sec-fetch-site"));
    // A browser says at least one of them, and no page can choose what it says.
    match (text(&header::ORIGIN), site) {
        (None, None) => {
            return Some(format!(
                "this changes something, so it has to say that it comes from here: Origin: http://{host}"
            ));
        }
        (Some(origin), _) if origin != format!("http://{host}") => {
            return Some(format!("{origin} may not change anything here; the page of http://{host} may"));
        }
        (_, Some(site)) if site != "same-origin" => {
            return Some(format!(
                "a {site} request may not change anything here; the page of http://{host} may"
            ));
        }
        _ => {}
    }
    let given = text(&HeaderName::from_static(HEADER)).unwrap_or_default();
    (!token.is(given)).then(|| {
        format!(
            "the header {HEADER} is {}: it has to be what the page's meta element mr-damper-token holds; reload the page if this \
             server was started anew",
            if given.is_empty() { "missing" } else { "not that of this server" }
        )
    })
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let status = match self.kind {
            Kind::Wrong => StatusCode::BAD_REQUEST,
            Kind::Missing => StatusCode::NOT_FOUND,
            Kind::Busy => StatusCode::CONFLICT,
            Kind::TooMuch => StatusCode::PAYLOAD_TOO_LARGE,
            Kind::Failed => StatusCode::INTERNAL_SERVER_ERROR,
        };
        (status, format!("{}\n", self.says)).into_response()
    }
}

/// An answer in JSON.
fn answer(text: String) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], text).into_response()
}

/// What `work` comes to, on a thread of its own.
async fn aside<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, Refusal> + Send + 'static,
) -> Result<T, Refusal> {
    let (done, doing) = oneshot::channel();
    let begun = std::thread::Builder::new().name("workshop-request".to_owned()).spawn(move || {
        // Whoever asked may have gone.
        let _ = done.send(work());
    });
    begun.map_err(|error| Refusal::new(Kind::Failed, format!("the system gives no thread: {error}")))?;
    doing
        .await
        .unwrap_or_else(|_| Err(Refusal::new(Kind::Failed, "it panicked; the server's log says where")))
}

/// What the body of a request says.
fn said<T: DeserializeOwned>(body: &Bytes) -> Result<T, Refusal> {
    serde_json::from_slice(body).map_err(|error| {
        Refusal::new(Kind::Wrong, format!("the request's body is not the JSON that is wanted: {error}"))
    })
}

/// Does something that a request asks for, and answers in words.
async fn done(work: impl FnOnce() -> Result<String, Refusal> + Send + 'static) -> Result<Response, Refusal> {
    aside(work).await.map(|says| answer(json(&serde_json::json!({ "says": says }))))
}

async fn whole(State(shop): State<Arc<Workshop>>) -> Response {
    answer(json(&*shop.state()))
}

async fn runs(State(shop): State<Arc<Workshop>>) -> Response {
    answer(json(&shop.state().runs))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OfRun {
    run: String,
}

async fn delete_run(State(shop): State<Arc<Workshop>>, body: Bytes) -> Result<Response, Refusal> {
    let OfRun { run } = said(&body)?;
    done(move || shop.delete_run(&run)).await
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OfReplay {
    run: String,
    model: String,
    rate: Option<f64>,
}

async fn start_replay(State(shop): State<Arc<Workshop>>, body: Bytes) -> Result<Response, Refusal> {
    let OfReplay { run, model, rate } = said(&body)?;
    done(move || shop.start_replay(&run, &model, rate.unwrap_or(1.0))).await
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case", tag = "turn", deny_unknown_fields)]
enum OfTurn {
    Pause,
    Resume,
    Stop,
    Rate { rate: f64 },
}

async fn turn_replay(State(shop): State<Arc<Workshop>>, body: Bytes) -> Result<Response, Refusal> {
    let turn = match said(&body)? {
        OfTurn::Pause => Turn::Pause,
        OfTurn::Resume => Turn::Resume,
        OfTurn::Stop => Turn::Stop,
        OfTurn::Rate { rate } => Turn::Rate(rate),
    };
    done(move || shop.turn_replay(turn)).await
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OfClosing {
    damper: String,
    history_s: Option<f64>,
}

async fn start_closing(State(shop): State<Arc<Workshop>>, body: Bytes) -> Result<Response, Refusal> {
    let OfClosing { damper, history_s } = said(&body)?;
    done(move || shop.start_closing(&damper, history_s)).await
}

async fn cancel_closing(State(shop): State<Arc<Workshop>>, body: Bytes) -> Result<Response, Refusal> {
    let OfClosing { damper, .. } = said(&body)?;
    done(move || shop.cancel_closing(&damper)).await
}

async fn report(State(shop): State<Arc<Workshop>>, Path(name): Path<String>) -> Result<Response, Refusal> {
    let kind = if name.ends_with(".json") { "application/json" } else { "text/html; charset=utf-8" };
    let text = aside(move || shop.report(&name)).await?;
    Ok(([(header::CONTENT_TYPE, kind), (header::CONTENT_SECURITY_POLICY, REPORT_POLICY)], text)
        .into_response())
}

/// How an upload is called and read.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OfUpload {
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
    State(shop): State<Arc<Workshop>>,
    Query(of): Query<OfUpload>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Refusal> {
    let name = run_name(&of.name)?;
    let OfUpload { thesis_txt, skip_bad_rows, drive, namespace, joint, .. } = of;
    let reading = Reading { thesis_txt, skip_bad_rows, drive, namespace, joint };
    let length = headers.get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok()?.parse().ok());
    let Upload { parts, kept } = aside(move || shop.take_upload(&name, reading, length)).await?;
    let mut pieces = body.into_data_stream();
    loop {
        let piece = tokio::time::timeout(PATIENCE, pieces.next()).await;
        let part = match piece {
            Ok(Some(Ok(bytes))) => Part::Bytes(bytes),
            Ok(None) => Part::End,
            // Dropped, the queue says that it was cut off.
            Ok(Some(Err(error))) => {
                return Err(Refusal::new(
                    Kind::Wrong,
                    format!("the upload was cut off: {error}; nothing of it is kept"),
                ));
            }
            Err(_) => {
                let says =
                    format!("nothing came for {} s; nothing of the upload is kept", PATIENCE.as_secs());
                return Err(Refusal::new(Kind::Wrong, says));
            }
        };
        let was_last = matches!(part, Part::End);
        // A file that takes no more, for its limit or the disk's, says why below.
        if parts.send(part).await.is_err() || was_last {
            break;
        }
    }
    let about = kept.await.unwrap_or_else(|_| {
        Err(Refusal::new(Kind::Failed, "the server ended, or the upload's thread did; nothing is kept"))
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
    fn only_its_own_page_changes_anything() {
        let token = Token::new().expect("randomness");
        let (host, own) = ("127.0.0.1:8330", token.text());
        let asked =
            |pairs: &[(&'static str, &str)]| stranger(&headers(&[&[("host", host)], pairs].concat()), &token);
        for good in [
            &[("origin", "http://127.0.0.1:8330"), (HEADER, own)][..],
            &[("sec-fetch-site", "same-origin"), (HEADER, own)],
            &[("origin", "http://127.0.0.1:8330"), ("sec-fetch-site", "same-origin"), (HEADER, own)],
        ] {
            assert_eq!(asked(good), None, "{good:?}");
        }
        for (bad, says) in [
            (&[][..], "has to say that it comes from here"),
            (&[(HEADER, own)], "has to say that it comes from here"),
            (&[("origin", "http://127.0.0.1:8330")], "is missing"),
            (&[("origin", "http://127.0.0.1:8330"), (HEADER, "0123")], "is not that of this server"),
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
            let refused = asked(bad);
            assert!(refused.as_ref().is_some_and(|why| why.contains(says)), "{bad:?}: {refused:?}");
        }
    }

    #[test]
    fn bodies_say_what_is_wrong_with_them() {
        assert!(said::<OfRun>(&Bytes::from_static(b"{\"run\": \"a\"}")).is_ok());
        for bad in ["", "{}", "{\"run\": 1}", "{\"run\": \"a\", \"path\": \"/\"}"] {
            let refused = said::<OfRun>(&Bytes::from(bad)).map(|of| of.run).expect_err(bad);
            assert_eq!(refused.kind, Kind::Wrong);
        }
        for (body, good) in [
            ("{\"turn\": \"pause\"}", true),
            ("{\"turn\": \"rate\", \"rate\": 2}", true),
            ("{\"turn\": \"rate\"}", false),
            ("{\"turn\": \"jump\"}", false),
        ] {
            assert_eq!(said::<OfTurn>(&Bytes::from(body)).is_ok(), good, "{body}");
        }
    }
}
