//! The player's services. They have the names and types of the services of `ros2 bag play`, so that its tools work here.
//!
//! One thread answers the requests one after the other; a burst is answered when it is over.

use super::Rate;
use super::control::Control;
use crate::config::RosArgs;
use crate::desk::Desk;
use crate::error::NodeError;
use crate::ros::{Ros, Task};
use mr_damper_model::sample::Stamp;
use mr_damper_msgs::Service;
use mr_damper_msgs::rosbag2::{
    Burst, BurstResponse, GetRate, GetRateResponse, IsPaused, IsPausedResponse, Pause, PauseResponse,
    PlayNext, PlayNextResponse, Resume, ResumeResponse, Seek, SeekResponse, SetRate, SetRateResponse,
    TogglePaused, TogglePausedResponse,
};
use std::sync::Arc;

/// The services of one player, while they are set up.
struct Offer<'a> {
    desk: Desk<'a>,
    /// Full name of the node.
    node: String,
    player: &'a Arc<Control>,
}

impl Offer<'_> {
    /// Offers the service `~/name`; `act` computes the answer.
    fn add<S: Service<Request: Sync, Response: Sync> + 'static>(
        &mut self,
        name: &str,
        act: fn(&Control, S::Request) -> S::Response,
    ) -> Result<(), NodeError> {
        let player = Arc::clone(self.player);
        self.desk.offer::<S>(&format!("{}/{name}", self.node), move |request| act(&player, request))
    }
}

/// Offers the services below the node `node`, and starts the thread that answers requests.
pub(super) fn offer(
    ros: &mut Ros,
    args: &RosArgs,
    node: &str,
    player: &Arc<Control>,
) -> Result<Task, NodeError> {
    let node = format!("{}/{node}", args.namespace().trim_end_matches('/'));
    let mut offer = Offer { desk: Desk::new(ros, args), node, player };
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
    offer.desk.start("replay-services")
}
