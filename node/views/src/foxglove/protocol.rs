//! The messages of the Foxglove WebSocket protocol, version 1, as far as this endpoint uses them.
//!
//! The specification is `docs/spec.md` of <https://github.com/foxglove/ws-protocol>. Text messages are JSON objects whose field `op` names
//! their kind; binary messages begin with a byte that does. The subprotocols `foxglove.websocket.v1` and `foxglove.sdk.v1` are two names
//! of the same messages.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::borrow::Cow;

/// Names of the subprotocol. Servers of Foxglove's SDK accept only the first one; viewers of before 2025 offer only the second one.
pub(super) const SUBPROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Number of bytes in front of the payload of a message: opcode, subscription, time.
const DATA_HEAD: usize = 1 + 4 + 8;
/// Opcodes of binary messages from the server.
const MESSAGE_DATA: u8 = 1;
const TIME: u8 = 2;
/// A message that a viewer sent is cut to this many characters before it is shown.
const SHOWN: usize = 80;

/// A request of a viewer.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Request {
    /// Messages of channels.
    Subscribe(Vec<Subscription>),
    /// No more messages of these subscriptions.
    Unsubscribe(Vec<u32>),
    /// Values of parameters; of all if the list of names is empty.
    GetParameters(Vec<String>, Option<String>),
    /// A change of parameters, with the id of the request, and their names.
    SetParameters(Vec<String>, Option<String>),
    /// Something that this endpoint does not offer, with its name.
    NotOffered(String),
}

/// A subscription: a number that the viewer chooses, and the channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Subscription {
    pub(super) id: u32,
    pub(super) channel_id: u32,
}

/// Why a viewer's message cannot be read.
#[derive(Debug, thiserror::Error)]
pub(super) enum RequestError {
    #[error(
        "message \"{shown}\" is not a JSON object with a field \"op\": {source}; send one of the protocol's messages"
    )]
    NotAnOp { shown: String, source: serde_json::Error },
    #[error(
        "message \"{op}\" cannot be read: {source}; send it as the protocol's specification describes it"
    )]
    Fields { op: String, source: serde_json::Error },
    #[error("a binary message without content: send an opcode and its fields")]
    Empty,
}

#[derive(Deserialize)]
struct Op<'a> {
    #[serde(borrow)]
    op: Cow<'a, str>,
}

#[derive(Deserialize)]
struct Subscribe {
    subscriptions: Vec<Subscription>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Unsubscribe {
    subscription_ids: Vec<u32>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct GetParameters {
    #[serde(default)]
    parameter_names: Vec<String>,
    id: Option<String>,
}

#[derive(Deserialize)]
struct SetParameters {
    #[serde(default)]
    parameters: Vec<Named>,
    id: Option<String>,
}

#[derive(Deserialize)]
struct Named {
    name: String,
}

impl Request {
    /// Reads a text message.
    pub(super) fn read(text: &str) -> Result<Self, RequestError> {
        let Op { op } = serde_json::from_str(text)
            .map_err(|source| RequestError::NotAnOp { shown: cut(text), source })?;
        let fields = |source| RequestError::Fields { op: cut(&op), source };
        Ok(match &*op {
            "subscribe" => {
                let Subscribe { subscriptions } = serde_json::from_str(text).map_err(fields)?;
                Self::Subscribe(subscriptions)
            }
            "unsubscribe" => {
                let Unsubscribe { subscription_ids } = serde_json::from_str(text).map_err(fields)?;
                Self::Unsubscribe(subscription_ids)
            }
            "getParameters" => {
                let GetParameters { parameter_names, id } = serde_json::from_str(text).map_err(fields)?;
                Self::GetParameters(parameter_names, id)
            }
            "setParameters" => {
                let SetParameters { parameters, id } = serde_json::from_str(text).map_err(fields)?;
                Self::SetParameters(parameters.into_iter().map(|named| named.name).collect(), id)
            }
            other => Self::NotOffered(cut(other)),
        })
    }

    /// Reads a binary message. This endpoint offers none of them.
    pub(super) fn read_binary(bytes: &[u8]) -> Result<Self, RequestError> {
        match bytes.first() {
            None => Err(RequestError::Empty),
            Some(1) => Ok(Self::NotOffered("message data".to_owned())),
            Some(2) => Ok(Self::NotOffered("service call".to_owned())),
            Some(3) => Ok(Self::NotOffered("playback control".to_owned())),
            Some(other) => Ok(Self::NotOffered(format!("binary opcode {other}"))),
        }
    }
}

/// The beginning of a text that a viewer sent, without control characters.
fn cut(text: &str) -> String {
    text.chars().take(SHOWN).map(|c| if c.is_control() { ' ' } else { c }).collect()
}

/// A text message to a viewer.
#[derive(Debug, Clone, Serialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
pub(super) enum Reply<'a> {
    /// The first message of a connection.
    ServerInfo { name: &'a str, capabilities: &'a [&'a str], session_id: &'a str },
    /// New channels.
    Advertise { channels: Vec<Advertised<'a>> },
    /// A sentence for the viewer's user.
    Status { level: Level, message: &'a str },
    /// Values of parameters.
    ParameterValues {
        parameters: Vec<ParameterValue>,
        #[serde(skip_serializing_if = "Option::is_none")]
        id: Option<&'a str>,
    },
}

/// A channel, as viewers get it.
#[derive(Debug, Clone, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Advertised<'a> {
    pub(super) id: u32,
    pub(super) topic: &'a str,
    pub(super) encoding: &'static str,
    pub(super) schema_name: &'a str,
    pub(super) schema: &'a str,
    pub(super) schema_encoding: &'static str,
}

/// Severity of a status.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Level {
    Warning = 1,
    Error = 2,
}

impl Serialize for Level {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u8(*self as u8)
    }
}

/// A parameter with its value.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct ParameterValue {
    pub(super) name: String,
    /// Absent for a parameter without a value, and for numbers that JSON does not have.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) value: Option<Value>,
    /// Distinguishes 2.0 from 2.
    #[serde(rename = "type", skip_serializing_if = "Option::is_none")]
    pub(super) kind: Option<&'static str>,
}

impl Reply<'_> {
    pub(super) fn text(&self) -> String {
        crate::watch::json(self)
    }
}

/// The binary message that carries a message of a channel.
pub(super) fn message_data(subscription: u32, log_time_ns: u64, payload: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(DATA_HEAD + payload.len());
    bytes.push(MESSAGE_DATA);
    bytes.extend_from_slice(&subscription.to_le_bytes());
    bytes.extend_from_slice(&log_time_ns.to_le_bytes());
    bytes.extend_from_slice(payload);
    bytes
}

/// The binary message that carries the server's time.
pub(super) fn time(now_ns: u64) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(1 + 8);
    bytes.push(TIME);
    bytes.extend_from_slice(&now_ns.to_le_bytes());
    bytes
}
