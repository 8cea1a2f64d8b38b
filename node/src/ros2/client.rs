//! Clients of services and actions, with their endpoints. The endpoints show in the graph whether the server is there.
//!
//! ros2-client's own check (`wait_for_service`) needs its spinner, which this project does not use: see `graph.rs`.

use crate::ros2::graph::Endpoints;
use mr_damper_msgs::{Action, Message, Service};
use ros2_client::Context;
use ros2_client::action::ActionClient;
use ros2_client::service::Client;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::ops::Deref;

/// The request or the response of a service, in the form that the client library needs.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(transparent)]
pub struct RosMessage<M>(pub M);

impl<M: Message> ros2_client::Message for RosMessage<M> {}

type ServiceClient<S> = Client<RosMessage<<S as Service>::Request>, RosMessage<<S as Service>::Response>>;
type OfAction<A> = ActionClient<
    RosMessage<<A as Action>::Goal>,
    RosMessage<<A as Action>::Result>,
    RosMessage<<A as Action>::Feedback>,
>;

/// A client of a service.
pub struct ClientOf<S: Service> {
    client: ServiceClient<S>,
    endpoints: Endpoints,
}

/// A client of an action.
pub struct ActionClientOf<A: Action> {
    client: OfAction<A>,
    endpoints: Endpoints,
}

/// A client that is usable once its endpoints are matched.
pub trait Reaching {
    /// The endpoints that must be matched.
    fn endpoints(&self) -> &Endpoints;
}

impl<S: Service> ClientOf<S> {
    pub(crate) fn new(client: ServiceClient<S>, endpoints: Endpoints) -> Self {
        Self { client, endpoints }
    }
}

impl<S: Service> Deref for ClientOf<S> {
    type Target = ServiceClient<S>;

    fn deref(&self) -> &Self::Target {
        &self.client
    }
}

impl<S: Service> Reaching for ClientOf<S> {
    fn endpoints(&self) -> &Endpoints {
        &self.endpoints
    }
}

impl<A: Action> ActionClientOf<A> {
    pub(crate) fn new(client: OfAction<A>, endpoints: Endpoints) -> Self {
        Self { client, endpoints }
    }
}

impl<A: Action> Deref for ActionClientOf<A> {
    type Target = OfAction<A>;

    fn deref(&self) -> &Self::Target {
        &self.client
    }
}

impl<A: Action> Reaching for ActionClientOf<A> {
    fn endpoints(&self) -> &Endpoints {
        &self.endpoints
    }
}

/// A node's endpoints, as ros2-client serialises them. The library offers no other way to read them.
#[derive(Debug, Default, Deserialize)]
struct OfNode {
    reader_gid_seq: BTreeSet<[u8; 16]>,
    writer_gid_seq: BTreeSet<[u8; 16]>,
}

/// The present endpoints of the node called `node`.
pub(crate) fn endpoints_of(context: &Context, node: &str) -> Endpoints {
    let info = context.participant_entities_info();
    let own = info.nodes().iter().find(|of| of.fully_qualified_name() == node);
    let own = own.and_then(|of| serde_json::to_value(of).ok());
    let OfNode { reader_gid_seq: readers, writer_gid_seq: writers } =
        own.and_then(|of| serde_json::from_value(of).ok()).unwrap_or_default();
    Endpoints { writers, readers }
}
