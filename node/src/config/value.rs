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
}

impl Value {
    /// Parses a value like YAML in `-p name:=value`: numbers, `true`, lists in brackets, everything else as text.
    #[must_use]
    pub fn parse(text: &str) -> Self {
        let text = text.trim();
        if let Some(inner) = text.strip_prefix('[').and_then(|t| t.strip_suffix(']')) {
            let items = inner.split(',').map(|item| unquoted(item).to_owned());
            return Self::TextList(items.filter(|item| !item.is_empty()).collect());
        }
        if unquoted(text).len() < text.len() {
            return Self::Text(unquoted(text).to_owned());
        }
        match text {
            "true" | "True" | "TRUE" => Self::Bool(true),
            "false" | "False" | "FALSE" => Self::Bool(false),
            _ => {
                if let Ok(whole) = text.parse() {
                    Self::Integer(whole)
                } else if let Ok(number) = text.parse() {
                    Self::Double(number)
                } else {
                    Self::Text(text.to_owned())
                }
            }
        }
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
        }
    }
}

fn unquoted(text: &str) -> &str {
    let text = text.trim();
    for quote in ['\'', '"'] {
        if text.len() >= 2
            && let Some(inner) = text.strip_prefix(quote).and_then(|t| t.strip_suffix(quote))
        {
            return inner;
        }
    }
    text
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Bool(value) => write!(f, "{value}"),
            Self::Integer(value) => write!(f, "{value}"),
            Self::Double(value) => write!(f, "{value}"),
            Self::Text(value) => write!(f, "\"{value}\""),
            Self::TextList(values) => write!(f, "{values:?}"),
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
        ] {
            assert_eq!(Value::parse(text), value, "{text}");
        }
    }
}
