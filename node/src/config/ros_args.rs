//! Arguments after `--ros-args`, as any ROS 2 node takes them.
//!
//! | argument | does |
//! |---|---|
//! | `-r from:=to`, `--remap` | renames a topic; `__ns:=/front_left` and `__node:=name` name the node |
//! | `-p name:=value`, `--param` | sets a parameter |
//! | `--params-file FILE` | sets parameters from a YAML file (`/**`, node name, or fully qualified name) |
//! | `--log-level LEVEL` | `debug`, `info`, `warn`, `error`, `fatal` |
//!
//! Unknown arguments are an error. A bare `--` ends the ROS arguments.

use super::{Assignment, Value};
use crate::error::NodeError;
use std::path::{Path, PathBuf};

/// What `--ros-args` said.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RosArgs {
    /// Namespace of the node, from `__ns`.
    pub namespace: Option<String>,
    /// Name of the node, from `__node`.
    pub node: Option<String>,
    /// Topic renamings, from and to, in the order given.
    pub remaps: Vec<(String, String)>,
    /// Parameter settings, in the order given; files stand where they were named.
    pub parameters: Vec<ParameterSource>,
    /// Log level.
    pub log_level: Option<String>,
}

/// One source of ROS parameters.
#[derive(Debug, Clone, PartialEq)]
pub enum ParameterSource {
    /// `-p name:=value`.
    Given(String, Value),
    /// `--params-file`.
    File(PathBuf),
}

impl RosArgs {
    /// Splits the ROS arguments off a command line: returns what is left, and what was understood.
    ///
    /// # Errors
    /// [`NodeError::RosArgs`] naming the argument.
    pub fn split(arguments: impl IntoIterator<Item = String>) -> Result<(Vec<String>, Self), NodeError> {
        let mut plain = Vec::new();
        let mut ros = Self::default();
        let mut arguments = arguments.into_iter();
        let mut inside = false;
        while let Some(argument) = arguments.next() {
            match argument.as_str() {
                "--ros-args" => inside = true,
                "--" if inside => inside = false,
                _ if !inside => plain.push(argument),
                _ => ros.take(&argument, &mut arguments)?,
            }
        }
        Ok((plain, ros))
    }

    fn take(&mut self, argument: &str, rest: &mut impl Iterator<Item = String>) -> Result<(), NodeError> {
        let mut value = |what: &str| {
            rest.next().ok_or_else(|| NodeError::RosArgs(format!("{argument} wants {what} behind it")))
        };
        match argument {
            "-r" | "--remap" => {
                let rule = value("from:=to")?;
                let (from, to) = assignment(argument, &rule)?;
                // `node:from` restricts a rule to one node of the process; there is one here.
                match from.rsplit(':').next().unwrap_or(from) {
                    "__ns" => self.namespace = Some(to.to_owned()),
                    "__node" | "__name" => self.node = Some(to.to_owned()),
                    topic => self.remaps.push((topic.to_owned(), to.to_owned())),
                }
            }
            "-p" | "--param" => {
                let rule = value("name:=value")?;
                let (name, text) = assignment(argument, &rule)?;
                let name = name.rsplit(':').next().unwrap_or(name);
                self.parameters.push(ParameterSource::Given(name.to_owned(), Value::parse(text)));
            }
            "--params-file" => self.parameters.push(ParameterSource::File(value("a file")?.into())),
            "--log-level" => {
                let level = value("a level")?;
                // `logger:=level` sets one logger; the node has one.
                let level = level.rsplit(":=").next().unwrap_or(&level).to_lowercase();
                if !["debug", "info", "warn", "error", "fatal"].contains(&level.as_str()) {
                    return Err(NodeError::RosArgs(format!(
                        "--log-level is {level}; use debug, info, warn, error or fatal"
                    )));
                }
                self.log_level = Some(if level == "fatal" { "error".to_owned() } else { level });
            }
            "--log-config-file" => {
                return Err(NodeError::RosArgs(
                    "--log-config-file is for rcl's logger, which is not in here; use --log-level or RUST_LOG"
                        .to_owned(),
                ));
            }
            "--enable-rosout-logs"
            | "--disable-rosout-logs"
            | "--enable-stdout-logs"
            | "--disable-stdout-logs"
            | "--enable-external-lib-logs"
            | "--disable-external-lib-logs" => {}
            _ => {
                return Err(NodeError::RosArgs(format!(
                    "{argument} is unknown; known are -r, -p, --params-file, --log-level"
                )));
            }
        }
        Ok(())
    }

    /// Namespace of the node, starting with a slash.
    #[must_use]
    pub fn namespace(&self) -> String {
        let namespace = self.namespace.as_deref().unwrap_or("/").trim_end_matches('/');
        if namespace.starts_with('/') { namespace.to_owned() } else { format!("/{namespace}") }
    }

    /// Name of the node.
    #[must_use]
    pub fn node_name(&self) -> &str {
        self.node.as_deref().unwrap_or("mr_damper")
    }

    /// Fully qualified name of the node.
    #[must_use]
    pub fn full_name(&self) -> String {
        format!("{}/{}", self.namespace().trim_end_matches('/'), self.node_name())
    }

    /// Name of the damper: the node's namespace without slashes around it, or the node's name where there is none.
    #[must_use]
    pub fn damper(&self) -> &str {
        match self.namespace.as_deref().unwrap_or_default().trim_matches('/') {
            "" => self.node_name(),
            namespace => namespace,
        }
    }

    /// Fully qualified name of the topic that the node calls `name`.
    #[must_use]
    pub fn topic(&self, name: &str) -> String {
        let qualify = |name: &str| {
            if name.starts_with('/') {
                name.to_owned()
            } else {
                format!("{}/{name}", self.namespace().trim_end_matches('/'))
            }
        };
        let full = qualify(name);
        self.remaps
            .iter()
            .find(|(from, _)| *from == name || qualify(from) == full)
            .map_or(full, |(_, to)| qualify(to))
    }

    /// Sets the parameters on `config`, in the order given.
    ///
    /// # Errors
    /// When a file does not load, or a parameter does not fit.
    pub fn apply(&self, config: &mut super::Config) -> Result<(), NodeError> {
        self.assignments()?.iter().try_for_each(|assignment| assignment.apply(config))
    }

    /// The parameters, in the order given; of files, those that are meant for this node.
    ///
    /// # Errors
    /// When a file does not load.
    pub fn assignments(&self) -> Result<Vec<Assignment>, NodeError> {
        let mut all = Vec::new();
        for source in &self.parameters {
            match source {
                ParameterSource::Given(name, value) => {
                    all.push(Assignment { name: name.clone(), value: value.clone(), origin: None });
                }
                ParameterSource::File(path) => all.extend(self.of_file(path)?),
            }
        }
        Ok(all)
    }

    fn of_file(&self, path: &Path) -> Result<Vec<Assignment>, NodeError> {
        let in_file = |message: String| NodeError::File { path: path.to_owned(), message };
        let text = std::fs::read_to_string(path).map_err(|e| in_file(e.to_string()))?;
        let sections: std::collections::BTreeMap<String, serde_json::Value> =
            serde_saphyr::from_str(&text).map_err(|e| in_file(e.to_string()))?;
        let full = self.full_name();
        // Wildcards first: what names the node is stronger, whatever the order in the file.
        let mut matching: Vec<_> =
            sections.iter().filter(|(section, _)| matches_node(section, &full, self.node_name())).collect();
        matching.sort_by_key(|(section, _)| !section.contains('*'));
        let mut all = Vec::new();
        for (section, body) in matching {
            let parameters = body
                .get("ros__parameters")
                .and_then(serde_json::Value::as_object)
                .ok_or_else(|| in_file(format!("{section} holds no ros__parameters")))?;
            let mut values = Vec::new();
            flatten("", parameters, &mut values).map_err(in_file)?;
            let origin = Some((path.to_owned(), Some(section.clone())));
            all.extend(values.into_iter().map(|(name, value)| Assignment {
                name,
                value,
                origin: origin.clone(),
            }));
        }
        Ok(all)
    }
}

fn assignment<'a>(argument: &str, rule: &'a str) -> Result<(&'a str, &'a str), NodeError> {
    rule.split_once(":=").ok_or_else(|| {
        NodeError::RosArgs(format!("{argument} {rule}: there is no := between name and value"))
    })
}

fn matches_node(section: &str, full: &str, name: &str) -> bool {
    match section {
        "/**" | "/*" | "*" | "**" => true,
        _ => section == full || section == name || section.strip_prefix("/**/") == Some(name),
    }
}

fn flatten(
    prefix: &str,
    map: &serde_json::Map<String, serde_json::Value>,
    out: &mut Vec<(String, Value)>,
) -> Result<(), String> {
    for (key, value) in map {
        let name = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
        match value {
            serde_json::Value::Object(inner) => flatten(&name, inner, out)?,
            serde_json::Value::Bool(b) => out.push((name, Value::Bool(*b))),
            serde_json::Value::String(text) => out.push((name, Value::Text(text.clone()))),
            serde_json::Value::Number(n) => {
                let value = n.as_i64().map(Value::Integer).or_else(|| n.as_f64().map(Value::Double));
                out.push((name, value.ok_or("a number is out of range")?));
            }
            serde_json::Value::Array(items) => {
                let texts: Option<Vec<String>> =
                    items.iter().map(|item| item.as_str().map(str::to_owned)).collect();
                out.push((
                    name.clone(),
                    Value::TextList(texts.ok_or(format!("{name} must be a list of texts"))?),
                ));
            }
            serde_json::Value::Null => return Err(format!("{name} has no value")),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::Config;
    use super::*;

    fn split(line: &str) -> Result<(Vec<String>, RosArgs), NodeError> {
        RosArgs::split(line.split_whitespace().map(str::to_owned))
    }

    #[test]
    fn ros_arguments_are_split_off() {
        let (plain, ros) = split(
            "--quiet --ros-args -r __ns:=/front_left -r displacement:=/lvdt/x -p coast_s:=0.5 --log-level debug -- --model m",
        )
        .expect("good arguments");
        assert_eq!(plain, ["--quiet", "--model", "m"]);
        assert_eq!(ros.namespace(), "/front_left");
        assert_eq!(ros.topic("displacement"), "/lvdt/x");
        assert_eq!(ros.topic("force_estimate"), "/front_left/force_estimate");
        let mut config = Config::default();
        ros.apply(&mut config).expect("good parameters");
        assert_eq!(config.settings.coast_s, 0.5);
        assert_eq!(ros.log_level.as_deref(), Some("debug"));
    }

    #[test]
    fn what_is_not_understood_is_said() {
        for (line, expected) in [
            ("--ros-args --frobnicate", "--frobnicate is unknown"),
            ("--ros-args -p", "-p wants name:=value"),
            ("--ros-args -p coast_s=1", "no :="),
            ("--ros-args --log-level loud", "--log-level is loud"),
            ("--ros-args --log-config-file x", "use --log-level"),
        ] {
            let message = split(line).expect_err("bad arguments").to_string();
            assert!(message.contains(expected), "{line}: {message}");
        }
    }

    #[test]
    fn a_parameter_file_matches_by_wildcard_and_by_name() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let path = dir.path().join("params.yaml");
        let text = "/front_left/mr_damper:\n  ros__parameters:\n    coast_s: 2.0\n\
                    /**:\n  ros__parameters:\n    coast_s: 1.0\n    zenoh:\n      web_rate_hz: 20\n\
                    /rear/mr_damper:\n  ros__parameters:\n    coast_s: 9.0\n";
        std::fs::write(&path, text).expect("writes");
        let line = format!("--ros-args -r __ns:=/front_left --params-file {}", path.display());
        let mut config = Config::default();
        split(&line).expect("good arguments").1.apply(&mut config).expect("a good file");
        assert_eq!((config.settings.coast_s, config.zenoh.web_rate_hz), (2.0, 20.0));
    }
}
