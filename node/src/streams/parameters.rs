//! The ROS interface to the node's parameters: the six services of `rcl_interfaces`, and `/parameter_events`.
//!
//! The client library has such services, but without ranges, descriptions and read-only parameters. So this module
//! implements them over the one table of parameters. [`Control`] checks and applies new values.

use crate::estimation::control::Control;
use crate::estimation::wire::header;
use crate::ros2::participant::{Output, Ros};
use crate::settings::config::qos::Overrides;
use crate::settings::config::{Mutability, Parameter, ParameterKind, TABLE, Value, find};
use crate::settings::error::{NodeError, RequestError};
use mr_damper_msgs::rcl;
use mr_damper_msgs::rcl::{
    FloatingPointRange, IntegerRange, ListParametersResult, ParameterDescriptor, ParameterEvent,
    ParameterValue, SetParametersResult,
};
use std::sync::Arc;

/// Separator of the parts of a name.
const SEPARATOR: char = '.';

/// The parameters of a node.
pub struct Parameters {
    control: Arc<Control>,
    events: Output<ParameterEvent>,
    /// The node's full name.
    node: String,
}

impl Parameters {
    /// Publishes parameter events of `node` (its full name). The first event lists all parameters.
    ///
    /// # Errors
    /// When the topic cannot be published.
    pub fn start(ros: &mut Ros, control: &Arc<Control>, node: &str) -> Result<Self, NodeError> {
        let events = ros.publish_seldom("/parameter_events")?;
        let parameters = Self { control: Arc::clone(control), events, node: node.to_owned() };
        let all: Vec<String> = names(&control.config().qos).collect();
        let new_parameters = parameters.present(&all);
        parameters.publish(ParameterEvent { new_parameters, ..ParameterEvent::default() });
        Ok(parameters)
    }

    /// Values in the order of `names`; type "not set" for unknown parameters.
    #[must_use]
    pub fn get(&self, names: &[String]) -> Vec<ParameterValue> {
        let config = self.control.config();
        let value = |name: &String| config.get(name).map(to_ros).unwrap_or_default();
        names.iter().map(value).collect()
    }

    /// Types in the order of `names`.
    #[must_use]
    pub fn types(&self, names: &[String]) -> Vec<u8> {
        self.get(names).into_iter().map(|value| value.r#type).collect()
    }

    /// Descriptions in the order of `names`; without a type for unknown parameters.
    #[must_use]
    pub fn describe(&self, names: &[String]) -> Vec<ParameterDescriptor> {
        describe(names, &self.control.config().qos)
    }

    /// Names below `prefixes`, listed as by every ROS 2 node, down to `depth` levels (separated by dots); 0: no limit.
    #[must_use]
    pub fn list(&self, prefixes: &[String], depth: u64) -> ListParametersResult {
        list(prefixes, depth, &self.control.config().qos)
    }

    /// Sets all parameters or none.
    #[must_use]
    pub fn set(&self, requested: &[rcl::Parameter]) -> SetParametersResult {
        match self.change(requested) {
            Ok(()) => SetParametersResult { successful: true, reason: String::new() },
            Err(error) => SetParametersResult { successful: false, reason: error.to_string() },
        }
    }

    /// Sets all parameters or none, and logs a refusal.
    ///
    /// # Errors
    /// [`NodeError::Request`] for a text that is too long or a type that no parameter has; the errors of
    /// [`Control::set_parameters`].
    pub fn change(&self, requested: &[rcl::Parameter]) -> Result<(), NodeError> {
        self.try_change(requested).inspect_err(|error| tracing::warn!("cannot set a parameter: {error}"))
    }

    fn try_change(&self, requested: &[rcl::Parameter]) -> Result<(), NodeError> {
        for rcl::Parameter { name, value } in requested {
            within_length("a parameter's name", name)?;
            let texts = std::iter::once(&value.string_value).chain(&value.string_array_value);
            texts.into_iter().try_for_each(|text| within_length(name, text))?;
        }
        let named = requested.iter().map(|rcl::Parameter { name, value }| {
            Ok((name.as_str(), from_ros(value).ok_or_else(|| unfit(name, value))?))
        });
        let changed = self.control.set_parameters(&named.collect::<Result<Vec<_>, RequestError>>()?)?;
        self.announce(&changed);
        Ok(())
    }

    /// Publishes the changed values of `names` on `/parameter_events`.
    pub fn announce(&self, names: &[String]) {
        if !names.is_empty() {
            let changed_parameters = self.present(names);
            self.publish(ParameterEvent { changed_parameters, ..ParameterEvent::default() });
        }
    }

    fn present(&self, names: &[String]) -> Vec<rcl::Parameter> {
        let values = self.get(names).into_iter();
        names.iter().cloned().zip(values).map(|(name, value)| rcl::Parameter { name, value }).collect()
    }

    fn publish(&self, event: ParameterEvent) {
        let stamp = header(self.control.clock().now_or_system(), "").stamp;
        let event = ParameterEvent { stamp, node: self.node.clone(), ..event };
        if let Err(error) = self.events.publish(event) {
            tracing::warn!("cannot publish a change of parameters: {error}");
        }
    }
}

/// Names of all parameters: those in the table, and the QoS overrides that are set.
fn names(qos: &Overrides) -> impl Iterator<Item = String> {
    TABLE.iter().map(|parameter| parameter.name.to_owned()).chain(qos.names().collect::<Vec<_>>())
}

/// Descriptions in the order of `names`; without a type for unknown parameters.
fn describe(names: &[String], qos: &Overrides) -> Vec<ParameterDescriptor> {
    let descriptor = |name: &String| match (find(name), qos.get(name)) {
        (_, Some(value)) => ParameterDescriptor {
            name: name.clone(),
            r#type: to_ros(value.clone()).r#type,
            description: "override of a topic's QoS".to_owned(),
            additional_constraints: qos.expected(name).unwrap_or_default().to_owned(),
            read_only: true,
            ..ParameterDescriptor::default()
        },
        (Ok(parameter), None) => descriptor(parameter),
        (Err(_), None) => ParameterDescriptor {
            name: name.chars().take(LONGEST).collect(),
            ..ParameterDescriptor::default()
        },
    };
    names.iter().map(descriptor).collect()
}

/// Names below `prefixes`, listed as by every ROS 2 node, down to `depth` levels (separated by dots); 0: no limit.
fn list(prefixes: &[String], depth: u64, qos: &Overrides) -> ListParametersResult {
    let shallow = |rest: &str| depth == 0 || (rest.matches(SEPARATOR).count() as u64) < depth;
    let below = |name: &str, prefix: &String| {
        let rest = name.strip_prefix(prefix.as_str());
        rest.is_some_and(|rest| rest.is_empty() || rest.strip_prefix(SEPARATOR).is_some_and(shallow))
    };
    let is_meant = |name: &str| {
        if prefixes.is_empty() { shallow(name) } else { prefixes.iter().any(|prefix| below(name, prefix)) }
    };
    let mut found = ListParametersResult::default();
    for name in names(qos).filter(|name| is_meant(name)) {
        found.names.push(name.clone());
        if let Some((prefix, _)) = name.rsplit_once(SEPARATOR)
            && !found.prefixes.iter().any(|known| known == prefix)
        {
            found.prefixes.push(prefix.to_owned());
        }
    }
    found
}

fn descriptor(parameter: &Parameter) -> ParameterDescriptor {
    let (mut floating_point_range, mut integer_range) = (Vec::new(), Vec::new());
    let mut constraints = Vec::new();
    match parameter.kind {
        ParameterKind::Double(from_value, to_value) => {
            floating_point_range.push(FloatingPointRange { from_value, to_value, step: 0.0 });
        }
        ParameterKind::Sign => {
            floating_point_range.push(FloatingPointRange { from_value: -1.0, to_value: 1.0, step: 2.0 });
        }
        ParameterKind::Integer(from_value, to_value) => {
            integer_range.push(IntegerRange { from_value, to_value, step: 1 });
        }
        ParameterKind::Choice(_) => constraints.push(parameter.expected()),
        ParameterKind::DoubleList(..) => constraints.push(parameter.expected()),
        ParameterKind::Bool | ParameterKind::Text | ParameterKind::TextList => {}
    }
    if parameter.mutability == Mutability::Unconfigured {
        constraints.push(format!("set only while the node is unconfigured{}", parameter.instead()));
    }
    ParameterDescriptor {
        name: parameter.name.to_owned(),
        r#type: type_of(parameter.kind),
        description: format!(
            "{} [default: {}]",
            parameter.doc,
            parameter.default_text().as_deref().unwrap_or("empty")
        ),
        additional_constraints: constraints.join("; "),
        read_only: parameter.mutability == Mutability::Never,
        dynamic_typing: false,
        floating_point_range,
        integer_range,
    }
}

const fn type_of(kind: ParameterKind) -> u8 {
    match kind {
        ParameterKind::Bool => ParameterValue::BOOL,
        ParameterKind::Integer(..) => ParameterValue::INTEGER,
        ParameterKind::Double(..) | ParameterKind::Sign => ParameterValue::DOUBLE,
        ParameterKind::Text | ParameterKind::Choice(_) => ParameterValue::STRING,
        ParameterKind::TextList => ParameterValue::STRING_ARRAY,
        ParameterKind::DoubleList(..) => ParameterValue::DOUBLE_ARRAY,
    }
}

fn to_ros(value: Value) -> ParameterValue {
    let unset = ParameterValue::default();
    match value {
        Value::Bool(bool_value) => ParameterValue { r#type: ParameterValue::BOOL, bool_value, ..unset },
        Value::Integer(integer_value) => {
            ParameterValue { r#type: ParameterValue::INTEGER, integer_value, ..unset }
        }
        Value::Double(double_value) => {
            ParameterValue { r#type: ParameterValue::DOUBLE, double_value, ..unset }
        }
        Value::Text(string_value) => ParameterValue { r#type: ParameterValue::STRING, string_value, ..unset },
        Value::TextList(string_array_value) => {
            ParameterValue { r#type: ParameterValue::STRING_ARRAY, string_array_value, ..unset }
        }
        Value::DoubleList(double_array_value) => {
            ParameterValue { r#type: ParameterValue::DOUBLE_ARRAY, double_array_value, ..unset }
        }
    }
}

fn from_ros(value: &ParameterValue) -> Option<Value> {
    Some(match value.r#type {
        ParameterValue::BOOL => Value::Bool(value.bool_value),
        ParameterValue::INTEGER => Value::Integer(value.integer_value),
        ParameterValue::DOUBLE => Value::Double(value.double_value),
        ParameterValue::STRING => Value::Text(value.string_value.clone()),
        ParameterValue::STRING_ARRAY => Value::TextList(value.string_array_value.clone()),
        // A longer list than any parameter takes is refused later; a peer's megabytes need not be copied for that.
        ParameterValue::DOUBLE_ARRAY => {
            Value::DoubleList(value.double_array_value.iter().take(LONGEST_LIST).copied().collect())
        }
        _ => return None,
    })
}

/// Largest number of items that are read from a list of numbers.
const LONGEST_LIST: usize = 1024;
/// Longest text that a peer may send, bytes: the length of a path.
const LONGEST: usize = 4096;

/// Refuses a text that is too long to be valid. Otherwise the whole text would appear in the log, on `/rosout` and in
/// the answer, whose length is limited too (`docs/decisions/0006-answers-between-hosts.md`).
///
/// # Errors
/// [`RequestError::TooLong`].
pub fn within_length(what: &str, text: &str) -> Result<(), RequestError> {
    if text.len() <= LONGEST {
        return Ok(());
    }
    Err(RequestError::TooLong { what: what.to_owned(), bytes: text.len(), most: LONGEST })
}

fn unfit(name: &str, value: &ParameterValue) -> RequestError {
    let name = name.to_owned();
    match value.r#type {
        ParameterValue::NOT_SET => RequestError::Undeclare { name },
        kind => RequestError::UnusedType { name, kind },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_parameter_is_described_whole() {
        for parameter in TABLE.iter() {
            let [described] = &describe(&[parameter.name.to_owned()], &Overrides::default())[..] else {
                panic!("one")
            };
            assert_ne!(described.r#type, ParameterValue::NOT_SET, "{}", parameter.name);
            assert!(!described.description.is_empty(), "{}", parameter.name);
            let default = to_ros((parameter.get)(&crate::settings::config::Config::default()));
            assert_eq!(default.r#type, described.r#type, "{}", parameter.name);
            assert_eq!(
                from_ros(&default),
                Some((parameter.get)(&crate::settings::config::Config::default()))
            );
        }
        let names = ["coast_s", "domain_id", "law", "displacement.sign", "model", "coats"].map(str::to_owned);
        let described: Vec<_> =
            describe(&names, &Overrides::default()).iter().map(|d| format!("{d:?}")).collect();
        insta::assert_snapshot!(described.join("\n"));
    }

    #[test]
    fn a_text_of_megabytes_is_refused() {
        let long = "x".repeat(3 << 20);
        assert_eq!(within_length("model", &long[..LONGEST]), Ok(()));
        let said = within_length("model", &long).expect_err("too long");
        assert_eq!(said.to_string(), "model has 3145728 bytes; texts have at most 4096");
        // It is not compared with all names to find the nearest (which would take minutes), nor sent back whole.
        let described = describe(&[long], &Overrides::default());
        assert_eq!((described.len(), described[0].name.len()), (1, LONGEST));
    }

    #[test]
    fn names_are_listed_by_prefix_and_depth() {
        let listed = |prefixes: &[&str], depth| {
            let prefixes: Vec<String> = prefixes.iter().map(|text| (*text).to_owned()).collect();
            list(&prefixes, depth, &Overrides::default())
        };
        assert_eq!(listed(&[], 0).names.len(), TABLE.len());
        let shallow = listed(&[], 1);
        assert!(shallow.names.iter().all(|name| !name.contains('.')) && shallow.prefixes.is_empty());
        let skyhook = listed(&["skyhook"], 1);
        assert_eq!(
            (skyhook.names, skyhook.prefixes),
            (
                ["damping_n_s_m", "gains_n_s_m", "centres_a"].map(|name| format!("skyhook.{name}")).to_vec(),
                vec!["skyhook".to_owned()]
            )
        );
        assert_eq!(listed(&["sky"], 0), ListParametersResult::default());
        assert_eq!(listed(&["coast_s"], 7).names, ["coast_s"]);
    }

    #[test]
    fn overrides_of_qos_are_listed_and_described_as_read_only() {
        let mut qos = Overrides::default();
        let name = "qos_overrides./mode.publisher.depth";
        qos.set(name, &Value::Integer(5)).expect("allowed");
        let listed = list(&["qos_overrides".to_owned()], 0, &qos);
        assert_eq!(
            (listed.names, listed.prefixes),
            (vec![name.to_owned()], vec!["qos_overrides./mode.publisher".to_owned()])
        );
        let [described] = &describe(&[name.to_owned()], &qos)[..] else { panic!("one") };
        assert!(described.read_only && described.r#type == ParameterValue::INTEGER, "{described:?}");
        assert!(described.additional_constraints.contains("1 to 65536"), "{described:?}");
    }
}
