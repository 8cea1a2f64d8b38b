//! Where services are offered and answered: any number of them on one thread, one request of each after the other.

use crate::config::RosArgs;
use crate::error::NodeError;
use crate::far::{Far, Shorten};
use crate::ros::{Part, Ros, Task};
use futures::future::{BoxFuture, join_all, select};
use mr_damper_msgs::Service;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// How long the first answer to a client waits. Its request may be here before DDS has heard of the reader of answers, and
/// what is sent then is lost; other middlewares wait for that reader up to 100 ms.
const ACQUAINTANCE: Duration = Duration::from_millis(50);
/// Bytes of a GUID that are those of its participant.
const PREFIX: usize = 12;
/// Clients of a service that are remembered to be known.
const KNOWN: usize = 64;

/// Services of a node, while they are put together.
pub struct Desk<'a> {
    ros: &'a mut Ros,
    args: &'a RosArgs,
    far: Arc<Far>,
    /// What answers the requests of each service, for ever.
    open: Vec<BoxFuture<'static, ()>>,
}

impl<'a> Desk<'a> {
    /// A desk without services yet.
    #[must_use]
    pub fn new(ros: &'a mut Ros, args: &'a RosArgs) -> Self {
        let far = Arc::new(ros.domain().far());
        Self { ros, args, far, open: Vec::new() }
    }

    /// Offers the service that the node calls `name`, answered by `answer`.
    ///
    /// # Errors
    /// When the name is bad or DDS refuses.
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

    /// The same, for answers that `shorten` makes fit where they are too long over a network address.
    ///
    /// # Errors
    /// When the name is bad or DDS refuses.
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
        let far = Arc::clone(&self.far);
        self.open.push(Box::pin(async move {
            let mut known = VecDeque::with_capacity(KNOWN);
            loop {
                let (id, Part(request)) = match server.async_receive_request().await {
                    Ok(request) => request,
                    Err(error) => {
                        tracing::warn!(service = name, %error, "a request cannot be read");
                        continue;
                    }
                };
                if !known.contains(&id.writer_gid) {
                    known.truncate(KNOWN - 1);
                    known.push_front(id.writer_gid);
                    tokio::time::sleep(ACQUAINTANCE).await;
                }
                let prefix = &id.writer_gid.to_bytes16()[..PREFIX];
                let fit = far.fit(&name, prefix, answer(request), shorten);
                if let Err(error) = server.async_send_response(id, Part(fit)).await {
                    tracing::warn!(service = name, %error, "an answer was not sent");
                }
            }
        }));
        Ok(())
    }

    /// Starts to answer, on a thread called `name`.
    ///
    /// # Errors
    /// When the system starts no thread.
    pub fn start(self, name: &'static str) -> Result<Task, NodeError> {
        let open = self.open;
        Task::start(name, |stopped| async move {
            // The end of the one is that of the other; it is seen between two answers.
            let _ = select(stopped, join_all(open)).await;
        })
    }
}
