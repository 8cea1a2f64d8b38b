//! The player's services, named and typed as those of `ros2 bag play`, so that its tools work on ours.
//!
//! One thread answers them one after the other; a burst is answered when it is over.

use super::Rate;
use super::control::Control;
use crate::config::RosArgs;
use crate::error::NodeError;
use crate::ros::{Part, Ros, ServerOf, Task};
use futures::future::{join_all, select};
use mr_damper_model::sample::Stamp;
use mr_damper_msgs::Service;
use mr_damper_msgs::rosbag2::{
    Burst, BurstResponse, GetRate, GetRateResponse, IsPaused, IsPausedResponse, Pause, PauseResponse,
    PlayNext, PlayNextResponse, Resume, ResumeResponse, Seek, SeekResponse, SetRate, SetRateResponse,
    TogglePaused, TogglePausedResponse,
};
use std::pin::{Pin, pin};
use std::sync::Arc;

/// The services of one player, while they are put together.
struct Offer<'a> {
    ros: &'a mut Ros,
    args: &'a RosArgs,
    /// Full name of the node.
    node: String,
    control: &'a Arc<Control>,
    answering: Vec<Pin<Box<dyn Future<Output = ()> + Send>>>,
}

impl Offer<'_> {
    /// Offers `~/name`, answered by `act`.
    fn add<S: Service<Request: Sync, Response: Sync> + 'static>(
        &mut self,
        name: &str,
        act: fn(&Control, S::Request) -> S::Response,
    ) -> Result<(), NodeError> {
        let full = self.args.service(&format!("{}/{name}", self.node));
        let server = self.ros.serve::<S>(&full)?;
        self.answering.push(Box::pin(answer::<S>(server, Arc::clone(self.control), act)));
        Ok(())
    }
}

/// Offers the services below the node called `node`, and starts the thread that answers.
pub(super) fn offer(
    ros: &mut Ros,
    args: &RosArgs,
    node: &str,
    control: &Arc<Control>,
) -> Result<Task, NodeError> {
    let node = format!("{}/{node}", args.namespace().trim_end_matches('/'));
    let mut offer = Offer { ros, args, node, control, answering: Vec::new() };
    offer.add::<Pause>("pause", |control, _| {
        control.pause();
        PauseResponse::default()
    })?;
    offer.add::<Resume>("resume", |control, _| {
        control.resume();
        ResumeResponse::default()
    })?;
    offer.add::<TogglePaused>("toggle_paused", |control, _| {
        control.toggle_paused();
        TogglePausedResponse::default()
    })?;
    offer.add::<IsPaused>("is_paused", |control, _| IsPausedResponse { paused: control.is_paused() })?;
    offer.add::<GetRate>("get_rate", |control, _| {
        let rate = match control.rate() {
            Rate::Times(rate) => rate,
            Rate::Max => f64::INFINITY,
        };
        GetRateResponse { rate }
    })?;
    offer.add::<SetRate>("set_rate", |control, asked| SetRateResponse {
        success: control.set_rate(asked.rate),
    })?;
    offer.add::<PlayNext>("play_next", |control, _| PlayNextResponse { success: control.step(1) == 1 })?;
    offer.add::<Burst>("burst", |control, asked| BurstResponse {
        actually_burst: control.step(asked.num_messages),
    })?;
    offer.add::<Seek>("seek", |control, asked| SeekResponse {
        success: control.seek(Stamp::from_nanos(asked.time.as_nanos())),
    })?;
    let answering = offer.answering;
    Task::start("replay-services", |stopped| async move {
        select(pin!(join_all(answering)), stopped).await;
    })
}

async fn answer<S: Service<Request: Sync, Response: Sync>>(
    server: ServerOf<S>,
    control: Arc<Control>,
    act: fn(&Control, S::Request) -> S::Response,
) {
    loop {
        match server.async_receive_request().await {
            Ok((id, Part(request))) => {
                let response = Part(act(&control, request));
                if let Err(error) = server.async_send_response(id, response).await {
                    tracing::warn!(%error, service = S::TYPE, "an answer was not sent");
                }
            }
            Err(error) => tracing::warn!(%error, service = S::TYPE, "a request cannot be read"),
        }
    }
}
