//! The event stream of a page: first the current state, then batches.

use super::{Batch, MOST_STREAMS, Shared};
use crate::watch::json;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::sse::{Event, Sse};
use axum::response::{IntoResponse, Response};
use futures::stream::{self, Stream, StreamExt, select};
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::OwnedSemaphorePermit;
use tokio::sync::broadcast::Receiver;
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::watch;

/// Delay after which a disconnected browser reconnects.
const RETRY: Duration = Duration::from_secs(1);

/// `GET /events`: `start` (a snapshot with all points), then `batch` events, and `skipped` with the number of batches that a
/// slow reader missed.
pub(super) async fn stream(State(shared): State<Arc<Shared>>, headers: HeaderMap) -> Response {
    let Ok(place) = Arc::clone(&shared.places).try_acquire_owned() else {
        let says = format!("{MOST_STREAMS} pages are open already; close one of them and reload this page\n");
        return (StatusCode::SERVICE_UNAVAILABLE, says).into_response();
    };
    let live = &shared.live;
    // Subscribe before `start` is made, so that no batch in between is missed.
    let batches = live.batches.subscribe();
    let (from, start) = {
        let registry = live.registry();
        let start = registry.start(live.now_s());
        (start.batch, json(&start))
    };
    let start = Event::default().event("start").retry(RETRY).data(start);
    let states = shared.workshop_for(&headers).map(|workshop| workshop.state_updates());
    let events =
        stream::once(async { start }).chain(select(after(batches, from, place), workshop_events(states)));
    Sse::new(events.map(Ok::<_, Infallible>)).into_response()
}

/// The state of the workshop, now and on every change; nothing without a workshop. This stream never ends, so that it cannot end
/// the whole event stream.
fn workshop_events(states: Option<watch::Receiver<Arc<str>>>) -> impl Stream<Item = Event> {
    stream::unfold((states, true), |(mut states, first)| async move {
        let Some(receiver) = &mut states else { return std::future::pending().await };
        // A slow reader gets several changes as one.
        if !first && receiver.changed().await.is_err() {
            return std::future::pending().await;
        }
        let event = Event::default().event("workshop").data(&**receiver.borrow_and_update());
        Some((event, (states, false)))
    })
}

/// The batches after number `from`. The stream holds the reader's permit `place` until it is dropped.
fn after(batches: Receiver<Batch>, from: u64, place: OwnedSemaphorePermit) -> impl Stream<Item = Event> {
    stream::unfold((batches, place), move |(mut batches, place)| async move {
        loop {
            let event = match batches.recv().await {
                Ok(batch) if batch.number <= from => continue,
                Ok(batch) => Event::default().event("batch").data(&*batch.json),
                Err(RecvError::Lagged(count)) => Event::default().event("skipped").data(count.to_string()),
                Err(RecvError::Closed) => return None,
            };
            return Some((event, (batches, place)));
        }
    })
}
