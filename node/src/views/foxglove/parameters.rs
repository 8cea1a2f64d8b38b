//! Reads the parameters of dampers' nodes over ROS, for viewers that ask for them.
//!
//! The names come from this project's table, so the nodes need not list them. Values are asked for a few at a time, because longer answers
//! do not arrive from other hosts (`docs/decisions/0006-answers-between-hosts.md`). Nothing here waits: each step is a poll.

use crate::ros2::participant::{ClientOf, Ros, RosMessage};
use crate::settings::config::TABLE;
use crate::settings::error::NodeError;
use mr_damper_msgs::rcl::{
    GetParameters, GetParametersRequest, GetParametersResponse, Parameter, ParameterValue,
};
use mr_damper_views::foxglove::Channels;
use ros2_client::RmwRequestId;
use std::time::{Duration, Instant};

/// Number of parameters in a request. A value takes about 100 bytes, and an answer of 1372 bytes arrives everywhere.
const AT_ONCE: usize = 8;
/// Time after which a request without an answer is given up. The next reading starts with the first parameter.
const PATIENCE: Duration = Duration::from_secs(5);
/// Time between two readings while a viewer that has asked is connected.
const READ_EVERY: Duration = Duration::from_secs(5);

/// Reads the parameters of one node.
pub struct ParameterReader {
    /// Full name of the node.
    node: String,
    client: ClientOf<GetParameters>,
    state: State,
}

enum State {
    /// No reading is under way; the time of the last one.
    Idle(Option<Instant>),
    /// Some values are there, and those behind them are asked for with the next request.
    Asking(Vec<Parameter>),
    /// This request was sent at this time, and its answer is awaited.
    Waiting(Vec<Parameter>, RmwRequestId, Instant),
}

impl ParameterReader {
    /// A reader for the node called `node`, such as `/front_left/mr_damper`.
    ///
    /// # Errors
    /// When DDS refuses the client.
    pub fn new(ros: &mut Ros, node: String) -> Result<Self, NodeError> {
        let client = ros.client::<GetParameters>(&format!("{node}/get_parameters"))?;
        Ok(Self { node, client, state: State::Idle(None) })
    }

    /// Begins a reading, unless one is under way or has just been made.
    pub fn ask(&mut self) {
        if let State::Idle(last) = self.state
            && last.is_none_or(|at| at.elapsed() >= READ_EVERY)
        {
            self.state = State::Asking(Vec::new());
        }
    }

    /// Takes the next step, and passes complete readings to `channels`.
    pub fn poll(&mut self, ros: &Ros, channels: &Channels) {
        self.state = match std::mem::replace(&mut self.state, State::Idle(None)) {
            State::Asking(read) if ros.reaches(&self.client) => self.send(read),
            State::Waiting(read, request, since) => self.receive(read, request, since, channels),
            other => other,
        };
    }

    fn send(&self, read: Vec<Parameter>) -> State {
        let names = TABLE.iter().skip(read.len()).take(AT_ONCE).map(|of| of.name.to_owned()).collect();
        match self.client.send_request(RosMessage(GetParametersRequest { names })) {
            Ok(request) => State::Waiting(read, request, Instant::now()),
            Err(error) => {
                tracing::debug!(node = self.node, %error, "cannot ask for parameters");
                State::Idle(Some(Instant::now()))
            }
        }
    }

    fn receive(
        &self,
        read: Vec<Parameter>,
        request: RmwRequestId,
        since: Instant,
        channels: &Channels,
    ) -> State {
        match self.client.receive_response() {
            Ok(Some((of, RosMessage(response)))) if of == request => self.add(read, response, channels),
            // Answers to other clients arrive, too.
            Ok(Some(_)) => State::Waiting(read, request, since),
            Ok(None) if since.elapsed() < PATIENCE => State::Waiting(read, request, since),
            Ok(None) => {
                tracing::warn!(
                    node = self.node,
                    "the node does not answer a request for its parameters, so viewers do not see them"
                );
                State::Idle(Some(Instant::now()))
            }
            Err(error) => {
                tracing::warn!(node = self.node, %error, "cannot read the parameters of a node");
                State::Idle(Some(Instant::now()))
            }
        }
    }

    /// Adds an answer to the values that were read before it.
    fn add(&self, mut read: Vec<Parameter>, response: GetParametersResponse, channels: &Channels) -> State {
        let names = TABLE.iter().skip(read.len()).take(AT_ONCE).map(|of| of.name.to_owned());
        if response.values.len() != names.len() {
            tracing::warn!(
                node = self.node,
                values = response.values.len(),
                expected = names.len(),
                "the node answers with another number of parameters than it was asked for; is it an mr-damper?"
            );
            return State::Idle(Some(Instant::now()));
        }
        read.extend(names.zip(response.values).map(|(name, value)| Parameter { name, value }));
        if read.len() < TABLE.len() {
            return self.send(read);
        }
        // A node of an earlier version lacks some.
        read.retain(|parameter| parameter.value.r#type != ParameterValue::NOT_SET);
        channels.set_parameters(&self.node, &read);
        State::Idle(Some(Instant::now()))
    }
}
