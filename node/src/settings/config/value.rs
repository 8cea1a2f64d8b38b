//! Values of parameters, common to the configuration file, ROS parameters and flags.

/// A parameter's value.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// A truth value.
    Bool(bool),
    /// A whole number.
    Integer(i64),
    /// A number.
    Double(f64),
    /// A text.
    Text(String),
    /// A list of texts.
    TextList(Vec<String>),
    /// A list of numbers, with one at least. An empty list is a [`Value::TextList`].
    DoubleList(Vec<f64>),
}

impl Value {
    /// Parses the value of `-p name:=value` as YAML. A text that is not YAML or that no parameter can have, such as
    /// `null` or a mapping, stays the text that it is. So do `off`, `no` and other words for truth values: `off` is a
    /// control law.
    #[must_use]
    pub fn parse(text: &str) -> Self {
        let options = serde_saphyr::options! { strict_booleans: true };
        let yaml = serde_saphyr::from_str_with_options::<serde_json::Value>(text, options).ok();
        let value = yaml.and_then(|yaml| Self::try_from(yaml).ok());
        value.unwrap_or_else(|| Self::Text(text.trim().to_owned()))
    }

    /// The type's name, for messages.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Bool(_) => "a truth value",
            Self::Integer(_) => "a whole number",
            Self::Double(_) => "a number",
            Self::Text(_) => "a text",
            Self::TextList(_) => "a list of texts",
            Self::DoubleList(_) => "a list of numbers",
        }
    }
}

/// A YAML value that no parameter can have.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum UnsuitableValue {
    /// Nothing, or a mapping.
    #[error("has no value")]
    Empty,
    /// An integer or a number outside of the range of 64 bits.
    #[error("is a number out of range")]
    Range,
    /// A list of items that are neither all texts nor all numbers.
    #[error("must be a list of texts or of numbers")]
    Item,
    /// A date.
    #[error("is the date {date}, but parameters cannot be dates")]
    Date {
        /// The date, as written.
        date: String,
    },
}

/// A parameter with a value that no parameter can have.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name} {why}")]
pub(super) struct UnsuitableParameter {
    pub(super) name: String,
    pub(super) why: UnsuitableValue,
}

impl TryFrom<serde_json::Value> for Value {
    type Error = UnsuitableValue;

    fn try_from(value: serde_json::Value) -> Result<Self, UnsuitableValue> {
        use serde_json::Value as Yaml;
        match value {
            Yaml::Bool(value) => Ok(Self::Bool(value)),
            Yaml::String(text) => Ok(Self::Text(text)),
            Yaml::Number(number) => {
                let value = number.as_i64().map(Self::Integer).or_else(|| number.as_f64().map(Self::Double));
                value.ok_or(UnsuitableValue::Range)
            }
            Yaml::Array(items) => {
                if let Some(first) = items.first()
                    && first.is_number()
                {
                    let number = |item: &Yaml| item.as_f64().ok_or(UnsuitableValue::Item);
                    return items.iter().map(number).collect::<Result<_, _>>().map(Self::DoubleList);
                }
                let text = |item| match item {
                    Yaml::String(text) => Ok(text),
                    _ => Err(UnsuitableValue::Item),
                };
                items.into_iter().map(text).collect::<Result<_, _>>().map(Self::TextList)
            }
            Yaml::Null | Yaml::Object(_) => Err(UnsuitableValue::Empty),
        }
    }
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Bool(value) => write!(f, "{value}"),
            Self::Integer(value) => write!(f, "{value}"),
            Self::Double(value) => write!(f, "{value}"),
            Self::Text(value) => write!(f, "\"{value}\""),
            Self::TextList(values) => write!(f, "{values:?}"),
            Self::DoubleList(values) => write!(f, "{values:?}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_parsed_like_ros_arguments() {
        for (text, value) in [
            ("0.5", Value::Double(0.5)),
            ("-3", Value::Integer(-3)),
            ("1e-3", Value::Double(1e-3)),
            ("true", Value::Bool(true)),
            ("auto", Value::Text("auto".into())),
            ("\"7\"", Value::Text("7".into())),
            ("thesis/fuzzy-tanh/rp3-cs", Value::Text("thesis/fuzzy-tanh/rp3-cs".into())),
            ("['tcp/127.0.0.1:7447', b]", Value::TextList(vec!["tcp/127.0.0.1:7447".into(), "b".into()])),
            ("[]", Value::TextList(vec![])),
            ("['a,b', \"c d\"]", Value::TextList(vec!["a,b".into(), "c d".into()])),
            ("[7]", Value::DoubleList(vec![7.0])),
            ("[1500.0, 9e2, 3]", Value::DoubleList(vec![1500.0, 900.0, 3.0])),
            ("[7, b]", Value::Text("[7, b]".into())),
            ("a, b", Value::Text("a, b".into())),
            ("/fl: 1", Value::Text("/fl: 1".into())),
            ("[a, b", Value::Text("[a, b".into())),
            ("~", Value::Text("~".into())),
            ("", Value::Text(String::new())),
            ("off", Value::Text("off".into())),
            ("inf", Value::Text("inf".into())),
            ("99999999999999999999", Value::Double(1e20)),
        ] {
            assert_eq!(Value::parse(text), value, "{text}");
        }
    }
}
