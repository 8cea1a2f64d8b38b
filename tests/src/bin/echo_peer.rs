//! The reference for the round trip: the cost of ros2-client without a node in between.
//!
//! Receives `displacement`, publishes a `force_estimate` with the same stamp, and does nothing else: no model, no
//! hand-over between threads. It also receives and discards `coil_current` and `measured_force`, so that a peer has the
//! same work as with the node: a sample without a reader is never sent. It sets DDS up like the node (one participant on
//! loopback, the same QoS), so the ratio of the node's round trip to this one is the cost of the node.
//!
//! Usage: `echo_peer`, with `ROS_DOMAIN_ID` as in any ROS 2 program. It ends on SIGINT and SIGTERM.

use std::net::Ipv4Addr;

use futures::channel::oneshot;
use futures::future::{Either, join3, ready, select};
use futures::{StreamExt, executor::block_on, pin_mut};
use mr_damper_msgs::{CoilCurrent, Displacement, Force, ForceEstimate, Message};
use ros2_client::qos::History;
use ros2_client::{Context, MessageTypeName, Name, NodeName, NodeOptions, QosProfile};
use rustdds::DomainParticipantBuilder;
use signal_hook::consts::{SIGINT, SIGTERM};

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

fn main() -> Outcome<()> {
    let domain = match std::env::var("ROS_DOMAIN_ID") {
        Ok(text) => text.parse().map_err(|_| format!("ROS_DOMAIN_ID is {text:?}, but must be 0 to 232"))?,
        Err(_) => 0,
    };
    let stop = stop_signal()?;

    let participant =
        DomainParticipantBuilder::new(domain).with_only_networks([Ipv4Addr::LOCALHOST]).build()?;
    let context = Context::from_domain_participant(participant)?;
    let mut node = context.new_node(NodeName::new("/", "echo_peer")?, NodeOptions::new())?;
    let spinner = node.spinner()?;
    let spinner = std::thread::spawn(move || block_on(spinner.spin()));

    // The node's QoS: best effort for inputs, so that any publisher matches; reliable for outputs.
    let taking = QosProfile::subscription_default().history(History::KeepLast { depth: 256 });
    let giving = QosProfile::publisher_default().history(History::KeepLast { depth: 10 });
    let topic = |name: &str, message: &str, qos: &QosProfile| {
        node.create_topic(&Name::new("/", name)?, MessageTypeName::new("mr_damper_msgs", message), qos)
            .map_err(Box::<dyn std::error::Error>::from)
    };
    let displacement = topic("displacement", Displacement::NAME, &taking)?;
    let coil_current = topic("coil_current", CoilCurrent::NAME, &taking)?;
    let measured_force = topic("measured_force", Force::NAME, &taking)?;
    let force_estimate = topic("force_estimate", ForceEstimate::NAME, &giving)?;
    let subscription = node.create_subscription::<Displacement>(&displacement, None)?;
    let current = node.create_subscription::<CoilCurrent>(&coil_current, None)?;
    let force = node.create_subscription::<Force>(&measured_force, None)?;
    let publisher = node.create_publisher::<ForceEstimate>(&force_estimate, None)?;

    let mut echoed = 0_u64;
    block_on(async {
        let echo = async {
            let stream = subscription.async_stream();
            pin_mut!(stream);
            while let Some(received) = stream.next().await {
                let answer = match received {
                    Ok((message, _)) => ForceEstimate { header: message.header, ..ForceEstimate::default() },
                    Err(error) => {
                        eprintln!("echo_peer: a displacement could not be read: {error}");
                        continue;
                    }
                };
                match publisher.publish(answer) {
                    Ok(()) => echoed += 1,
                    Err(error) => eprintln!("echo_peer: an estimate was not sent: {error}"),
                }
            }
        };
        let forget_current = current.async_stream().for_each(|_| ready(()));
        let forget_force = force.async_stream().for_each(|_| ready(()));
        let all = join3(echo, forget_current, forget_force);
        pin_mut!(all);
        match select(stop, all).await {
            Either::Left(_) => {}
            Either::Right(_) => eprintln!("echo_peer: the subscription ended unexpectedly"),
        }
    });

    // In this order, and with the spinner joined, peers see the node leave at once.
    drop((publisher, subscription, current, force));
    drop(node);
    if spinner.join().is_err() {
        eprintln!("echo_peer: the spinner panicked");
    }
    drop(context);
    eprintln!("echo_peer: echoed {echoed} messages");
    Ok(())
}

/// Resolves on the first SIGINT or SIGTERM.
fn stop_signal() -> Outcome<oneshot::Receiver<i32>> {
    let (sender, receiver) = oneshot::channel();
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM])?;
    std::thread::spawn(move || {
        if let Some(signal) = signals.forever().next() {
            let _ = sender.send(signal); // the receiver is gone only when we are ending anyway
        }
    });
    Ok(receiver)
}
