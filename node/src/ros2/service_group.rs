//! A group of services that one thread answers. Each service handles one request at a time.

use crate::ros2::answer_limit::{AnswerLimit, Shorten};
use crate::ros2::participant::{Ros, RosMessage};
use crate::settings::config::RosArgs;
use crate::settings::error::NodeError;
use crate::settings::task::Task;
use futures::future::{BoxFuture, join_all, select};
use mr_damper_msgs::Service;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// Delay before the first answer to a client. The request may arrive before DDS has discovered the client's reader of
/// answers, and an answer sent then is lost. Other middlewares wait up to 100 ms for that reader.
const FIRST_ANSWER_DELAY: Duration = Duration::from_millis(50);
/// Length of the participant's part of a GUID, bytes.
const PREFIX_LENGTH: usize = 12;
/// Number of clients that are remembered per service.
const KNOWN_CLIENTS: usize = 64;

/// A group of services of a node while it is set up.
pub struct ServiceGroup<'a> {
    ros: &'a mut Ros,
    args: &'a RosArgs,
    limit: Arc<AnswerLimit>,
    /// One future per service; it answers requests and never ends.
    answering: Vec<BoxFuture<'static, ()>>,
}

impl<'a> ServiceGroup<'a> {
    /// An empty group of services.
    #[must_use]
    pub fn new(ros: &'a mut Ros, args: &'a RosArgs) -> Self {
        let limit = Arc::new(ros.domain().answer_limit());
        Self { ros, args, limit, answering: Vec::new() }
    }

    /// Offers the service with the node-relative name `name`; `answer` computes the responses.
    ///
    /// # Errors
    /// When the name is invalid or DDS returns an error.
    pub fn offer<S>(
        &mut self,
        name: &str,
        answer: impl Fn(S::Request) -> S::Response + Send + Sync + 'static,
    ) -> Result<(), NodeError>
    where
        S: Service<Request: Sync, Response: Sync> + 'static,
    {
        self.offer_with::<S>(name, None, answer)
    }

    /// Like [`ServiceGroup::offer`]; `shorten` shortens answers that are too long for a network address.
    ///
    /// # Errors
    /// When the name is invalid or DDS returns an error.
    pub fn offer_with<S>(
        &mut self,
        name: &str,
        shorten: Option<Shorten<S::Response>>,
        answer: impl Fn(S::Request) -> S::Response + Send + Sync + 'static,
    ) -> Result<(), NodeError>
    where
        S: Service<Request: Sync, Response: Sync> + 'static,
    {
        let name = self.args.service(name);
        let server = self.ros.serve::<S>(&name)?;
        let limit = Arc::clone(&self.limit);
        self.answering.push(Box::pin(async move {
            let mut known = VecDeque::with_capacity(KNOWN_CLIENTS);
            loop {
                let (id, RosMessage(request)) = match server.async_receive_request().await {
                    Ok(request) => request,
                    Err(error) => {
                        tracing::warn!(service = name, %error, "cannot read a request");
                        continue;
                    }
                };
                if !known.contains(&id.writer_gid) {
                    known.truncate(KNOWN_CLIENTS - 1);
                    known.push_front(id.writer_gid);
                    tokio::time::sleep(FIRST_ANSWER_DELAY).await;
                }
                let prefix = &id.writer_gid.to_bytes16()[..PREFIX_LENGTH];
                let fit = limit.fit(&name, prefix, answer(request), shorten);
                if let Err(error) = server.async_send_response(id, RosMessage(fit)).await {
                    tracing::warn!(service = name, %error, "cannot send an answer");
                }
            }
        }));
        Ok(())
    }

    /// Starts to answer requests, on a thread called `name`.
    ///
    /// # Errors
    /// When the system cannot start the thread.
    pub fn start(self, name: &'static str) -> Result<Task, NodeError> {
        let answering = self.answering;
        Task::start(name, |stopped| async move {
            // `stopped` ends the loop between two answers.
            let _ = select(stopped, join_all(answering)).await;
        })
    }
}
