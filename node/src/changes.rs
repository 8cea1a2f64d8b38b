//! Changes of model and mode that a peer requests, by a ROS service or over Zenoh.

use crate::control::{Control, Loaded};
use crate::parameters::{self, Parameters};
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

    /// Sets the mode that `request` asks for.
    ///
    /// # Errors
    /// The same as for [`Changes::set_mode`].
    pub fn answer_mode(&self, request: &SetModeRequest) -> Result<(), String> {
        let unknown = |UnknownValue { .. }| format!("unknown mode {}", request.mode);
        let mode =
            if request.automatic { "auto" } else { Mode::try_from(request.mode).map_err(unknown)?.name() };
        self.set_mode(mode)
    }
}
