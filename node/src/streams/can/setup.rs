//! The messages that a damper reads and sends, from its parameters.

use super::{CanBus, CanError, bus};
use crate::settings::config::{CanSettings, Config};
use mr_damper_runs::bus::{BusError, InputCheck, Inputs, OutputMapping, OutputMessage, OutputTopic, Signals};
use mr_damper_runs::{Map, Mapping};
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;

/// A damper's use of a bus.
pub struct CanSetup {
    /// The bus.
    pub bus: Arc<dyn CanBus>,
    /// The interface, for messages to the user.
    pub interface: String,
    /// The messages that hold inputs.
    pub inputs: Inputs,
    /// The message that carries estimates, if any.
    pub estimate: Option<OutputMessage>,
    /// The message that carries current commands, if any.
    pub command: Option<OutputMessage>,
    /// Shortest time between two frames of one output.
    pub period: Duration,
}

impl CanSetup {
    /// The use that `config` describes; `None` if it names no interface. `topics` are the inputs of the node. `instead` replaces the
    /// interface, for tests.
    ///
    /// # Errors
    /// When parameters are missing or wrong, or DBC files cannot be read.
    pub fn of(
        config: &Config,
        topics: &[&'static str],
        instead: Option<Arc<dyn CanBus>>,
    ) -> Result<Option<Self>, CanError> {
        let can = &config.can;
        if can.interface.is_empty() {
            return match others(can) {
                None => Ok(None),
                Some(given) => {
                    let advice = "name the interface, such as can0";
                    Err(CanError::Missing { given, missing: "can.interface", advice })
                }
            };
        }
        let missing = |missing, advice| CanError::Missing { given: "can.interface", missing, advice };
        if can.dbc.is_empty() {
            return Err(missing("can.dbc", "name the DBC file of the bus"));
        }
        if can.map.is_empty() && can.out.is_empty() {
            return Err(missing(
                "can.map",
                "name the signal of an input, as in displacement=SUSP_FL.Position, or an output with can.out",
            ));
        }
        let in_dbc = |why: BusError| CanError::signals("can.dbc", why);
        let signals =
            Signals::read(&can.dbc.iter().map(PathBuf::from).collect::<Vec<_>>()).map_err(in_dbc)?;
        let mappings: Vec<Mapping> = parsed("can.map", &can.map)?;
        let map = Map::new(mappings).map_err(|why| CanError::signals("can.map", why))?;
        let checks: Vec<InputCheck> = parsed("can.check", &can.check)?;
        let mut inputs = signals.inputs(&map, topics).map_err(|why| CanError::signals("can.map", why))?;
        for check in &checks {
            inputs.check(check).map_err(|why| CanError::signals("can.check", why))?;
        }
        let outputs: Vec<OutputMapping> = parsed("can.out", &can.out)?;
        for (index, output) in outputs.iter().enumerate() {
            if outputs[..index].iter().any(|other| other.topic == output.topic) {
                return Err(CanError::TwoOutputs { topic: output.topic.name() });
            }
        }
        let outputs = signals.outputs(&outputs, &inputs);
        let mut outputs = outputs.map_err(|why| CanError::signals("can.out", why))?;
        let mut take = |topic: OutputTopic| {
            let place = outputs.iter().position(|message| message.topic() == topic)?;
            Some(outputs.swap_remove(place))
        };
        let (estimate, command) = (take(OutputTopic::ForceEstimate), take(OutputTopic::CurrentCommand));
        Ok(Some(Self {
            bus: instead.map_or_else(|| bus(&can.interface), Ok)?,
            interface: can.interface.clone(),
            inputs,
            estimate,
            command,
            period: Duration::from_secs_f64(can.period_s),
        }))
    }
}

/// A parameter that is set without an interface.
fn others(can: &CanSettings) -> Option<&'static str> {
    let lists =
        [("can.map", &can.map), ("can.out", &can.out), ("can.check", &can.check), ("can.dbc", &can.dbc)];
    lists.into_iter().find(|(_, list)| !list.is_empty()).map(|(name, _)| name)
}

/// Parses the items of a list.
fn parsed<T: FromStr>(parameter: &'static str, items: &[String]) -> Result<Vec<T>, CanError>
where
    BusError: From<T::Err>,
{
    let item = |text: &String| text.parse().map_err(|why: T::Err| CanError::signals(parameter, why));
    items.iter().map(item).collect()
}
