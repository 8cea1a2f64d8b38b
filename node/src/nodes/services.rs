//! The services that a node offers. The client library's own services lack ranges, the lifecycle and type descriptions.
//!
//! | services | type from |
//! |---|---|
//! | `load_model`, `reset`, `set_mode` | `mr_damper_msgs` |
//! | `~/get_parameters` and the five others | `rcl_interfaces` |
//! | `~/get_state`, `~/change_state`, `~/get_available_states`, `~/get_available_transitions`, `~/get_transition_graph` | `lifecycle_msgs` |
//! | `~/get_type_description` | `type_description_interfaces` |
//!
//! One thread answers all of them, one request after the other. It reads files and waits for the estimating thread, so
//! it is not on the path of samples.

use crate::estimation::control::Control;
use crate::estimation::lifecycle::{self, LifecycleState, Transition};
use crate::nodes::actions::Actions;
use crate::ros2::answer_limit;
use crate::ros2::participant::{Output, Ros};
use crate::ros2::service_group::ServiceGroup;
use crate::ros2::types;
use crate::settings::config::RosArgs;
use crate::settings::error::NodeError;
use crate::settings::task::Task;
use crate::streams::changes::Changes;
use crate::streams::parameters::Parameters;
use crate::watchdogs::overseer::SharedHistory;
use mr_damper_base::clock::system_now;
use mr_damper_msgs::lifecycle::{
    ChangeState, ChangeStateRequest, ChangeStateResponse, GetAvailableStates, GetAvailableStatesResponse,
    GetAvailableTransitions, GetAvailableTransitionsResponse, GetState, GetStateResponse,
    Transition as TransitionMsg, TransitionEvent,
};
use mr_damper_msgs::rcl::{
    DescribeParameters, DescribeParametersResponse, GetParameterTypes, GetParameterTypesResponse,
    GetParameters, GetParametersResponse, ListParameters, ListParametersResponse, SetParameters,
    SetParametersAtomically, SetParametersAtomicallyResponse, SetParametersResponse,
};
use mr_damper_msgs::srv::{LoadModel, LoadModelResponse, Reset, ResetResponse, SetMode, SetModeResponse};
use mr_damper_msgs::type_description::GetTypeDescription;
use std::sync::Arc;

/// The running services and actions.
pub struct Services {
    answering: Task,
    actions: Task,
    manager: Arc<Manager>,
    changes: Changes,
}

impl Services {
    /// Offers services and actions, and starts the threads that answer.
    ///
    /// # Errors
    /// When a service cannot be offered or the system cannot start a thread.
    pub fn start(
        ros: &mut Ros,
        args: &RosArgs,
        control: &Arc<Control>,
        history: SharedHistory,
    ) -> Result<Self, NodeError> {
        let parameters = Arc::new(Parameters::start(ros, control, &args.full_name())?);
        let events = ros.publish_seldom(&args.topic("~/transition_event"))?;
        let manager = Arc::new(Manager { control: Arc::clone(control), events });
        let actions = Actions::offer(ros, args, control, &parameters, history)?;
        let mut group = NodeServices(ServiceGroup::new(ros, args));
        let changes = Changes::new(Arc::clone(control), Arc::clone(&parameters));
        group.offer_own(control, &changes)?;
        group.offer_parameters(&parameters)?;
        group.offer_lifecycle(&manager)?;
        group.0.offer_with::<GetTypeDescription>(
            "~/get_type_description",
            Some(answer_limit::short_type),
            |request| types::describe(&request),
        )?;
        let answering = group.0.start("ros-services")?;
        Ok(Self { answering, actions: actions.start()?, manager, changes })
    }

    /// Makes a transition of the node, and publishes it.
    ///
    /// # Errors
    /// The same as for [`Control::change_state`].
    pub fn change_state(&self, transition: Transition) -> Result<(), NodeError> {
        self.manager.change(transition)
    }

    /// The functions behind `load_model` and `set_mode`, for callers over other interfaces.
    #[must_use]
    pub fn changes(&self) -> Changes {
        self.changes.clone()
    }

    /// Publishes a transition that was made before the publisher existed.
    pub fn announce(&self, transition: Transition, from: LifecycleState, to: LifecycleState) {
        self.manager.publish(transition, from, to);
    }

    /// True while the threads run; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.answering.is_alive() && self.actions.is_alive()
    }

    /// Ends the threads. `Err` when one had panicked.
    ///
    /// # Errors
    /// The panic's payload.
    pub fn stop(self) -> std::thread::Result<()> {
        let ended = self.answering.stop();
        ended.and(self.actions.stop())
    }
}

/// Makes transitions and publishes them.
struct Manager {
    control: Arc<Control>,
    events: Output<TransitionEvent>,
}

impl Manager {
    fn change(&self, transition: Transition) -> Result<(), NodeError> {
        let (from, to) = self.control.change_state(transition)?;
        self.publish(transition, from, to);
        Ok(())
    }

    fn publish(&self, transition: Transition, from: LifecycleState, to: LifecycleState) {
        let id = from.transitions().find(|(way, _)| *way == transition).map_or(0, |(_, id)| id);
        let event = TransitionEvent {
            timestamp: u64::try_from(system_now().nanos()).unwrap_or_default(),
            transition: TransitionMsg { id, label: transition.name().to_owned() },
            start_state: from.message(),
            goal_state: to.message(),
        };
        if let Err(error) = self.events.publish(event) {
            tracing::warn!("cannot publish a transition of the node: {error}");
        }
    }

    fn answer(&self, request: &ChangeStateRequest) -> ChangeStateResponse {
        let changed = Transition::requested(&request.transition)
            .map_err(NodeError::from)
            .and_then(|transition| self.change(transition));
        if let Err(error) = &changed {
            tracing::warn!("change_state refused: {error}");
        }
        ChangeStateResponse { success: changed.is_ok() }
    }
}

/// The node's services while they are set up.
struct NodeServices<'a>(ServiceGroup<'a>);

impl NodeServices<'_> {
    fn offer_own(&mut self, control: &Arc<Control>, changes: &Changes) -> Result<(), NodeError> {
        let changes = changes.clone();
        let of = changes.clone();
        self.0.offer::<LoadModel>("load_model", move |request| {
            let done = of.load_model(&request.model);
            LoadModelResponse { success: done.is_ok(), message: done.unwrap_or_else(|why| why.to_string()) }
        })?;
        let changing = Arc::clone(control);
        self.0.offer::<Reset>("reset", move |_| {
            let done = changing.reset();
            let message = done.as_ref().map_or_else(ToString::to_string, |()| String::new());
            ResetResponse { success: done.is_ok(), message }
        })?;
        self.0.offer::<SetMode>("set_mode", move |request| {
            let done = changes.answer_mode(&request);
            let message = done.as_ref().map_or_else(ToString::to_string, |()| String::new());
            SetModeResponse { success: done.is_ok(), message }
        })
    }

    fn offer_parameters(&mut self, parameters: &Arc<Parameters>) -> Result<(), NodeError> {
        let of = Arc::clone(parameters);
        self.0.offer::<GetParameters>("~/get_parameters", move |request| GetParametersResponse {
            values: of.get(&request.names),
        })?;
        let of = Arc::clone(parameters);
        self.0.offer::<GetParameterTypes>("~/get_parameter_types", move |request| {
            GetParameterTypesResponse { types: of.types(&request.names) }
        })?;
        let of = Arc::clone(parameters);
        self.0.offer::<SetParameters>("~/set_parameters", move |request| SetParametersResponse {
            results: request.parameters.chunks(1).map(|one| of.set(one)).collect(),
        })?;
        let of = Arc::clone(parameters);
        self.0.offer::<SetParametersAtomically>("~/set_parameters_atomically", move |request| {
            SetParametersAtomicallyResponse { result: of.set(&request.parameters) }
        })?;
        let of = Arc::clone(parameters);
        self.0.offer::<ListParameters>("~/list_parameters", move |request| ListParametersResponse {
            result: of.list(&request.prefixes, request.depth),
        })?;
        let of = Arc::clone(parameters);
        self.0.offer::<DescribeParameters>("~/describe_parameters", move |request| {
            DescribeParametersResponse { descriptors: of.describe(&request.names) }
        })
    }

    fn offer_lifecycle(&mut self, manager: &Arc<Manager>) -> Result<(), NodeError> {
        let of = Arc::clone(manager);
        self.0.offer::<GetState>("~/get_state", move |_| GetStateResponse {
            current_state: of.control.lifecycle_state().message(),
        })?;
        let of = Arc::clone(manager);
        self.0.offer::<ChangeState>("~/change_state", move |request| of.answer(&request))?;
        self.0.offer::<GetAvailableStates>("~/get_available_states", |_| GetAvailableStatesResponse {
            available_states: LifecycleState::ALL.map(LifecycleState::message).to_vec(),
        })?;
        let of = Arc::clone(manager);
        self.0.offer::<GetAvailableTransitions>("~/get_available_transitions", move |_| {
            GetAvailableTransitionsResponse {
                available_transitions: lifecycle::graph(Some(of.control.lifecycle_state())),
            }
        })?;
        self.0.offer::<GetAvailableTransitions>("~/get_transition_graph", |_| {
            GetAvailableTransitionsResponse { available_transitions: lifecycle::graph(None) }
        })
    }
}
