//! Discovery between a peer of a test and the node under test.

use crate::wait::wait_until;
use mr_damper_model::pipeline::Event;
use mr_damper_model::sample::{Reading, Sample};
use mr_damper_msgs::Velocity;
use mr_damper_node::estimation::estimator::EventReceiver;
use mr_damper_node::ros2::participant::Ros;
use rustdds::GUID;

/// Waits until the node receives what `ros` publishes with `publishers`, so that no sample is lost from then on.
///
/// The peer sees a match before the node does, so a reader of each publisher is not enough. A sample of one more
/// publisher must arrive: discovery announces publishers in the order of their creation, so the node then knows the
/// earlier ones too. The sample is a velocity of the body, which no estimate depends on.
pub(crate) fn wait_for_discovery(ros: &mut Ros, publishers: &[GUID], receiver: &mut EventReceiver) {
    wait_until("readers of the inputs", || publishers.iter().all(|publisher| ros.readers_of(*publisher) > 0));
    let last = ros.publish("/body_velocity").expect("a topic");
    let (mut sent, mut received) = (0.0, None);
    let mut receive = || {
        while let Ok(event) = receiver.events.pop() {
            if let Event::Input(Sample { reading: Reading::BodyVelocity(velocity), .. }) = event {
                received = Some(velocity.get());
            }
        }
        received
    };
    wait_until("a sample of the last publisher", || {
        sent += 1e-6;
        last.publish(Velocity { velocity: sent, ..Velocity::default() }).expect("sent");
        receive().is_some()
    });
    // No sample is under way when the test begins.
    wait_until("the newest sample of the last publisher", || receive() == Some(sent));
}
