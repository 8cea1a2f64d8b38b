//! The conversation with one viewer.

use super::channels::{Channels, Viewer};
use super::protocol::{self, Level, Request, RequestError};
use super::queue::{Due, Waiting};
use axum::extract::ws::{Message, WebSocket};
use futures::stream::{SplitSink, SplitStream};
use futures::{SinkExt, StreamExt};
use std::time::{Duration, Instant};

/// Shortest time between two reports of dropped messages.
const REPORT_EVERY: Duration = Duration::from_secs(1);
/// The sentence for which Lichtblick has advice. A viewer gets it once, because PlotJuggler opens a window for each status.
const DROPPED: &str = "Send buffer limit reached";
/// Longest time for the end of a connection.
const CLOSE_WITHIN: Duration = Duration::from_secs(1);

/// Answers the viewer at the other end of `socket` until it leaves.
pub(super) async fn converse(socket: WebSocket, channels: &Channels, viewer: &Viewer) {
    let (mut sink, stream) = socket.split();
    tokio::select! {
        () = answer(stream, channels, viewer) => {}
        () = send(&mut sink, viewer) => {}
    }
    let dropped = viewer.take_dropped();
    if dropped > 0 {
        tracing::warn!(
            viewer = viewer.number(),
            messages = dropped,
            "messages were dropped before the viewer left, because it did not read them"
        );
    }
    // The viewer may have gone already.
    let _ = tokio::time::timeout(CLOSE_WITHIN, sink.close()).await;
}

/// Reads requests until the viewer leaves or sends something that is not a WebSocket message.
async fn answer(mut stream: SplitStream<WebSocket>, channels: &Channels, viewer: &Viewer) {
    while let Some(Ok(message)) = stream.next().await {
        let request = match message {
            Message::Text(text) => Request::read(&text),
            Message::Binary(bytes) => Request::read_binary(&bytes),
            // The library answers these.
            Message::Ping(_) | Message::Pong(_) | Message::Close(_) => continue,
        };
        obey(request, channels, viewer);
    }
}

fn obey(request: Result<Request, RequestError>, channels: &Channels, viewer: &Viewer) {
    match request {
        Ok(Request::Subscribe(subscriptions)) => channels.subscribe(viewer, &subscriptions),
        Ok(Request::Unsubscribe(subscriptions)) => channels.unsubscribe(viewer, &subscriptions),
        Ok(Request::GetParameters(names, id)) if channels.has_parameters() => {
            channels.send_parameters(viewer, &names, id.as_deref());
        }
        Ok(Request::SetParameters(names, id)) => {
            viewer.status(
                Level::Error,
                "parameters are not set: this endpoint is read-only; set them with ros2 param set",
            );
            // With the unchanged values, the viewer shows what is in effect.
            if channels.has_parameters() && !names.is_empty() {
                channels.send_parameters(viewer, &names, id.as_deref());
            }
        }
        Ok(Request::GetParameters(..)) => refuse(viewer, "getParameters"),
        Ok(Request::NotOffered(what)) => refuse(viewer, &what),
        Err(error) => viewer.status(Level::Error, &error.to_string()),
    }
}

fn refuse(viewer: &Viewer, what: &str) {
    viewer.status(Level::Error, &format!("\"{what}\" is not offered: this endpoint is read-only"));
}

/// Sends what waits for the viewer, until it leaves or does not read its replies.
async fn send(sink: &mut SplitSink<WebSocket, Message>, viewer: &Viewer) {
    let number = viewer.number();
    let mut reported: Option<Instant> = None;
    let mut dropped = 0;
    while let Some(Due { replies, messages }) = viewer.due().await {
        let texts = replies.into_iter().map(|text| Message::Text(text.into()));
        for message in texts.chain(messages.into_iter().map(framed)) {
            if sink.feed(message).await.is_err() {
                return;
            }
        }
        if sink.flush().await.is_err() {
            return;
        }
        dropped += viewer.take_dropped();
        if dropped > 0 && reported.is_none_or(|at| at.elapsed() >= REPORT_EVERY) {
            tracing::warn!(
                viewer = number,
                messages = dropped,
                "a viewer reads too slowly: its oldest messages were dropped"
            );
            if reported.is_none() {
                viewer.status(Level::Warning, DROPPED);
            }
            (reported, dropped) = (Some(Instant::now()), 0);
        }
    }
    tracing::warn!(viewer = number, "a viewer does not read its replies and is disconnected");
}

fn framed(waiting: Waiting) -> Message {
    let bytes = match waiting {
        Waiting::Message(subscription, log_time_ns, payload) => {
            protocol::message_data(subscription, log_time_ns, &payload)
        }
        Waiting::Time(now_ns) => protocol::time(now_ns),
    };
    Message::Binary(bytes.into())
}
