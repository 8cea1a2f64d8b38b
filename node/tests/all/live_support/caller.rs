//! Another node on the domain, which calls services.

use crate::wait::wait_until;
use futures::executor::block_on;
use futures::future::{Either, select};
use mr_damper_msgs::Service;
use mr_damper_node::ros2::participant::{ClientOf, Ros, RosMessage};
use mr_damper_node::settings::config::{Config, RosArgs};
use ros2_client::NodeOptions;
use std::pin::pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Longest time for an answer: a first call can take three seconds.
const ANSWER: Duration = Duration::from_secs(15);

/// The configuration of a node on the domain `domain`.
pub(crate) fn config(domain: i64) -> Config {
    Config { domain_id: domain, align_wait_s: 0.5, ..Config::default() }
}

/// Tells another thread to end when the test ends, also after a failed assertion: a scope waits for its threads.
pub(crate) struct Ended<'a>(pub(crate) &'a AtomicBool);

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// The result of `task`, which must be ready within `limit`.
pub(crate) fn within<T>(limit: Duration, task: impl Future<Output = T>) -> T {
    let (sender, late) = futures::channel::oneshot::channel::<()>();
    std::thread::spawn(move || {
        std::thread::sleep(limit);
        // If the task was ready in time, nobody waits any more.
        let _ = sender.send(());
    });
    match block_on(select(pin!(task), late)) {
        Either::Left((done, _)) => done,
        Either::Right(_) => panic!("not done within {limit:?}"),
    }
}

/// The response of a discovered service.
pub(crate) fn answer<S: Service>(client: &ClientOf<S>, request: S::Request) -> S::Response {
    within(ANSWER, client.async_call_service(RosMessage(request))).expect("an answer that can be read").0
}

/// The calling node.
pub(crate) struct Caller {
    pub(crate) ros: Ros,
}

impl Caller {
    pub(crate) fn new(config: &Config) -> Self {
        let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        let ros = Ros::start(config, &RosArgs::default(), options, "caller").expect("a peer starts");
        Self { ros }
    }

    /// The response of the service `name` below `node`.
    pub(crate) fn call<S: Service>(&mut self, node: &str, name: &str, request: S::Request) -> S::Response {
        let client = self.ros.client::<S>(&format!("{node}/{name}")).expect("a client");
        wait_until(&format!("{node}/{name}"), || self.ros.reaches(&client));
        answer::<S>(&client, request)
    }

    pub(crate) fn stop(self) {
        self.ros.stop();
    }
}
