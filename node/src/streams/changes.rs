//! Changes of model and mode that a peer requests, by a ROS service or over Zenoh.

use crate::estimation::control::{Control, Loaded};
use crate::settings::error::{NodeError, RequestError};
use crate::streams::parameters::{self, Parameters};
use mr_damper_msgs::rcl::{Parameter, ParameterValue};
use mr_damper_msgs::srv::SetModeRequest;
use mr_damper_msgs::{Mode, UnknownValue};
use std::sync::Arc;

/// The functions behind `load_model` and `set_mode`, for all interfaces.
#[derive(Clone)]
pub struct Changes {
    control: Arc<Control>,
    parameters: Arc<Parameters>,
}

impl Changes {
    /// Changes through `control`, announced by `parameters`.
    #[must_use]
    pub const fn new(control: Arc<Control>, parameters: Arc<Parameters>) -> Self {
        Self { control, parameters }
    }

    /// Loads the model called `model`, and returns a message that names the new and the previous one.
    ///
    /// # Errors
    /// [`RequestError::TooLong`]; the errors of [`Control::load_model`]. The running model stays.
    pub fn load_model(&self, model: &str) -> Result<String, NodeError> {
        parameters::within_length("the model's name", model)
            .inspect_err(|error| tracing::warn!("load_model refused: {error}"))?;
        let loaded = self.control.load_model(model);
        let Loaded { before, now } =
            loaded.inspect_err(|error| tracing::warn!(model, "load_model refused: {error}"))?;
        self.parameters.announce(&["model".to_owned()]);
        Ok(format!("{} is loaded; the previous model was {}", now.free, before.free))
    }

    /// Fixes the mode `mode` through the parameter `mode`; `auto` releases it.
    ///
    /// # Errors
    /// [`RequestError::TemporaryMode`]; [`NodeError::Parameter`] when the mode does not exist.
    pub fn set_mode(&self, mode: &str) -> Result<(), NodeError> {
        if [Mode::ArxCoast, Mode::Hold].map(Mode::name).contains(&mode) {
            return Err(RequestError::TemporaryMode { mode: mode.to_owned() }.into());
        }
        let value = ParameterValue {
            r#type: ParameterValue::STRING,
            string_value: mode.to_owned(),
            ..ParameterValue::default()
        };
        self.parameters.change(&[Parameter { name: "mode".to_owned(), value }])
    }

    /// Sets the mode that `request` asks for.
    ///
    /// # Errors
    /// [`RequestError::UnknownMode`]; the errors of [`Changes::set_mode`].
    pub fn answer_mode(&self, request: &SetModeRequest) -> Result<(), NodeError> {
        let unknown = |UnknownValue { .. }| RequestError::UnknownMode { number: request.mode };
        let mode =
            if request.automatic { "auto" } else { Mode::try_from(request.mode).map_err(unknown)?.name() };
        self.set_mode(mode)
    }
}
