//! The player's services. They have the names and types of the services of `ros2 bag play`, so that its tools work here.
//!
//! One thread answers the requests one after the other; a burst is answered when it is over.

use super::Rate;
use super::control::Control;
use crate::ros2::participant::Ros;
use crate::ros2::service_group::ServiceGroup;
use crate::settings::config::RosArgs;
use crate::settings::error::NodeError;
use crate::settings::task::Task;
use mr_damper_model::sample::Stamp;
use mr_damper_msgs::Service;
use mr_damper_msgs::rosbag2::{
    Burst, BurstResponse, GetRate, GetRateResponse, IsPaused, IsPausedResponse, Pause, PauseResponse,
    PlayNext, PlayNextResponse, Resume, ResumeResponse, Seek, SeekResponse, SetRate, SetRateResponse,
    TogglePaused, TogglePausedResponse,
};
use std::sync::Arc;

/// The services of one player, while they are set up.
struct ReplayServices<'a> {
    group: ServiceGroup<'a>,
    /// Full name of the node.
    node: String,
    player: &'a Arc<Control>,
}

impl ReplayServices<'_> {
    /// Offers the service `~/name`; `act` computes the answer.
    fn add<S: Service<Request: Sync, Response: Sync> + 'static>(
        &mut self,
        name: &str,
        act: fn(&Control, S::Request) -> S::Response,
    ) -> Result<(), NodeError> {
        let player = Arc::clone(self.player);
        self.group.offer::<S>(&format!("{}/{name}", self.node), move |request| act(&player, request))
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
    let mut services = ReplayServices { group: ServiceGroup::new(ros, args), node, player };
    services.add::<Pause>("pause", |control, _| {
        control.pause();
        PauseResponse::default()
    })?;
    services.add::<Resume>("resume", |control, _| {
        control.resume();
        ResumeResponse::default()
    })?;
    services.add::<TogglePaused>("toggle_paused", |control, _| {
        control.toggle_paused();
        TogglePausedResponse::default()
    })?;
    services.add::<IsPaused>("is_paused", |control, _| IsPausedResponse { paused: control.is_paused() })?;
    services.add::<GetRate>("get_rate", |control, _| {
        let rate = match control.rate() {
            Rate::Times(rate) => rate,
            Rate::Max => f64::INFINITY,
        };
        GetRateResponse { rate }
    })?;
    services.add::<SetRate>("set_rate", |control, request| SetRateResponse {
        success: control.set_rate(request.rate),
    })?;
    services.add::<PlayNext>("play_next", |control, _| PlayNextResponse { success: control.step(1) == 1 })?;
    services.add::<Burst>("burst", |control, request| BurstResponse {
        actually_burst: control.step(request.num_messages),
    })?;
    services.add::<Seek>("seek", |control, request| SeekResponse {
        success: control.seek(Stamp::from_nanos(request.time.as_nanos())),
    })?;
    services.group.start("replay-services")
}
