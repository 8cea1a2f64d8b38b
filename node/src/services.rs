//! The node's own ROS services: `load_model`. And what they share with its action, `close_loop`.
//!
//! One thread answers them one after the other. It reads files and waits for the estimating thread, so it is none of
//! those that samples pass.

use crate::close_loop;
use crate::config::RosArgs;
use crate::control::{Control, Loaded};
use crate::error::NodeError;
use crate::overseer::SharedHistory;
use crate::ros::{Part, Ros, ServerOf, Task};
use futures::channel::oneshot;
use futures::future::{Either, select};
use mr_damper_msgs::srv::{LoadModel, LoadModelRequest, LoadModelResponse};
use ros2_client::{Node, ParameterValue};
use std::pin::pin;
use std::sync::Arc;

/// The running services.
pub struct Services {
    answering: Task,
    close_loop: Task,
}

impl Services {
    /// Offers services and action, and starts the threads that answer. Nothing can be created on the node from then on.
    ///
    /// # Errors
    /// When a service cannot be offered or the system starts no thread.
    pub fn start(
        ros: &mut Ros,
        args: &RosArgs,
        control: &Arc<Control>,
        history: SharedHistory,
    ) -> Result<Self, NodeError> {
        let action = close_loop::offer(ros, args)?;
        let load_model = ros.serve::<LoadModel>(&args.topic("load_model"))?;
        let answering = Answering { load_model, control: Arc::clone(control), node: ros.share() };
        let answering = Task::start("ros-services", |stopped| answering.run(stopped))?;
        let close_loop = close_loop::start(action, ros, args, control, history)?;
        Ok(Self { answering, close_loop })
    }

    /// True while the threads run; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.answering.is_alive() && self.close_loop.is_alive()
    }

    /// Ends the threads. `Err` when one had panicked.
    ///
    /// # Errors
    /// The panic's payload.
    pub fn stop(self) -> std::thread::Result<()> {
        let ended = self.answering.stop();
        ended.and(self.close_loop.stop())
    }
}

struct Answering {
    load_model: ServerOf<LoadModel>,
    control: Arc<Control>,
    node: Arc<Node>,
}

impl Answering {
    async fn run(self, mut stopped: oneshot::Receiver<()>) {
        loop {
            let (id, Part(request)) =
                match select(pin!(self.load_model.async_receive_request()), &mut stopped).await {
                    Either::Left((Ok(request), _)) => request,
                    Either::Left((Err(error), _)) => {
                        tracing::warn!(%error, "a request to load_model cannot be read");
                        continue;
                    }
                    Either::Right(_) => return,
                };
            let response = self.load_model(&request);
            if let Err(error) = self.load_model.async_send_response(id, Part(response)).await {
                tracing::warn!(%error, "the answer of load_model was not sent");
            }
        }
    }

    fn load_model(&self, request: &LoadModelRequest) -> LoadModelResponse {
        match self.control.load_model(&request.model) {
            Ok(loaded) => {
                tell(&loaded, &self.node);
                let Loaded { before, now } = loaded;
                let message = format!("{} is in force; before it was {}", now.free, before.free);
                LoadModelResponse { success: true, message }
            }
            Err(error) => {
                tracing::warn!(model = request.model, "load_model refused: {error}");
                LoadModelResponse { success: false, message: error.to_string() }
            }
        }
    }
}

/// Says in the log and by the parameter `model` that another model is in force.
pub(crate) fn tell(loaded: &Loaded, node: &Node) {
    let (before, now) = (&loaded.before.free, &loaded.now.free);
    tracing::info!(model = now, before, hash = loaded.now.hash, "another model is in force");
    // The value is the one that the configuration has by now, so this only tells those who listen.
    if let Err(error) = node.set_parameter("model", ParameterValue::String(now.clone())) {
        tracing::warn!(error, "the parameter model does not say what runs");
    }
}
