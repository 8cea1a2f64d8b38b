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

use crate::actions::Actions;
use crate::clock::system_now;
use crate::config::RosArgs;
use crate::control::{Control, Loaded};
use crate::desk::Desk;
use crate::error::NodeError;
use crate::far;
use crate::lifecycle::{self, Phase, Transition};
use crate::overseer::SharedHistory;
use crate::parameters::{self, Parameters};
use crate::ros::{Output, Ros, Task};
use crate::types;
use mr_damper_msgs::lifecycle::{
    ChangeState, ChangeStateRequest, ChangeStateResponse, GetAvailableStates, GetAvailableStatesResponse,
    GetAvailableTransitions, GetAvailableTransitionsResponse, GetState, GetStateResponse,
    Transition as TransitionMsg, TransitionEvent,
};
use mr_damper_msgs::rcl::{
    DescribeParameters, DescribeParametersResponse, GetParameterTypes, GetParameterTypesResponse,
    GetParameters, GetParametersResponse, ListParameters, ListParametersResponse, Parameter, ParameterValue,
    SetParameters, SetParametersAtomically, SetParametersAtomicallyResponse, SetParametersResponse,
};
use mr_damper_msgs::srv::{
    LoadModel, LoadModelResponse, Reset, ResetResponse, SetMode, SetModeRequest, SetModeResponse,
};
use mr_damper_msgs::type_description::GetTypeDescription;
use mr_damper_msgs::{Mode, UnknownValue};
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
        let mut offer = Offer(Desk::new(ros, args));
        let changes = Changes { control: Arc::clone(control), parameters: Arc::clone(&parameters) };
        offer.offer_own(control, &changes)?;
        offer.offer_parameters(&parameters)?;
        offer.offer_lifecycle(&manager)?;
        offer.0.offer_with::<GetTypeDescription>(
            "~/get_type_description",
            Some(far::short_type),
            |request| types::describe(&request),
        )?;
        let answering = offer.0.start("ros-services")?;
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
    pub fn announce(&self, transition: Transition, from: Phase, to: Phase) {
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

    fn publish(&self, transition: Transition, from: Phase, to: Phase) {
        let id = from.ways().find(|(way, _)| *way == transition).map_or(0, |(_, id)| id);
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
        let changed = Transition::meant(&request.transition)
            .map_err(NodeError::Failed)
            .and_then(|transition| self.change(transition));
        if let Err(error) = &changed {
            tracing::warn!("change_state refused: {error}");
        }
        ChangeStateResponse { success: changed.is_ok() }
    }
}

/// The node's services while they are set up.
struct Offer<'a>(Desk<'a>);

impl Offer<'_> {
    fn offer_own(&mut self, control: &Arc<Control>, changes: &Changes) -> Result<(), NodeError> {
        let changes = changes.clone();
        let of = changes.clone();
        self.0.offer::<LoadModel>("load_model", move |request| {
            let done = of.load_model(&request.model);
            LoadModelResponse { success: done.is_ok(), message: done.unwrap_or_else(|why| why) }
        })?;
        let changing = Arc::clone(control);
        self.0.offer::<Reset>("reset", move |_| {
            let done = changing.reset();
            let message = done.as_ref().map_or_else(ToString::to_string, |()| String::new());
            ResetResponse { success: done.is_ok(), message }
        })?;
        self.0.offer::<SetMode>("set_mode", move |request| {
            let done = changes.answer_mode(&request);
            SetModeResponse { success: done.is_ok(), message: done.err().unwrap_or_default() }
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
            current_state: of.control.phase().message(),
        })?;
        let of = Arc::clone(manager);
        self.0.offer::<ChangeState>("~/change_state", move |request| of.answer(&request))?;
        self.0.offer::<GetAvailableStates>("~/get_available_states", |_| GetAvailableStatesResponse {
            available_states: Phase::ALL.map(Phase::message).to_vec(),
        })?;
        let of = Arc::clone(manager);
        self.0.offer::<GetAvailableTransitions>("~/get_available_transitions", move |_| {
            GetAvailableTransitionsResponse {
                available_transitions: lifecycle::graph(Some(of.control.phase())),
            }
        })?;
        self.0.offer::<GetAvailableTransitions>("~/get_transition_graph", |_| {
            GetAvailableTransitionsResponse { available_transitions: lifecycle::graph(None) }
        })
    }
}

/// The functions behind `load_model` and `set_mode`, for all interfaces.
#[derive(Clone)]
pub struct Changes {
    control: Arc<Control>,
    parameters: Arc<Parameters>,
}

impl Changes {
    /// Loads the model called `model`, and returns a message that names the new and the previous one.
    ///
    /// # Errors
    /// The reason why it was not loaded; the running model stays.
    pub fn load_model(&self, model: &str) -> Result<String, String> {
        parameters::within_length("the model's name", model)
            .inspect_err(|error| tracing::warn!("load_model refused: {error}"))?;
        match self.control.load_model(model) {
            Ok(Loaded { before, now }) => {
                self.parameters.announce(&["model".to_owned()]);
                Ok(format!("{} is loaded; the previous model was {}", now.free, before.free))
            }
            Err(error) => {
                tracing::warn!(model, "load_model refused: {error}");
                Err(error.to_string())
            }
        }
    }

    /// Fixes the mode `mode` through the parameter `mode`; `auto` releases it.
    ///
    /// # Errors
    /// When the mode does not exist, or it is limited in time.
    pub fn set_mode(&self, mode: &str) -> Result<(), String> {
        if [Mode::ArxCoast, Mode::Hold].map(Mode::name).contains(&mode) {
            return Err(format!(
                "{mode} lasts for a limited time only, so it cannot be requested; request arx, model or fault"
            ));
        }
        let value = ParameterValue {
            r#type: ParameterValue::STRING,
            string_value: mode.to_owned(),
            ..ParameterValue::default()
        };
        let set = self.parameters.set(&[Parameter { name: "mode".to_owned(), value }]);
        if set.successful { Ok(()) } else { Err(set.reason) }
    }

    fn answer_mode(&self, request: &SetModeRequest) -> Result<(), String> {
        let unknown = |UnknownValue { .. }| format!("unknown mode {}", request.mode);
        let mode =
            if request.automatic { "auto" } else { Mode::try_from(request.mode).map_err(unknown)?.name() };
        self.set_mode(mode)
    }
}
