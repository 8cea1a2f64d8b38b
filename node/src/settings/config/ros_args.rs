//! Arguments after `--ros-args`, as in any ROS 2 node.
//!
//! | argument | effect |
//! |---|---|
//! | `-r from:=to`, `--remap` | remaps a topic or service; `__ns:=/front_left` and `__node:=name` set the node's namespace and name |
//! | `-p name:=value`, `--param` | sets a parameter |
//! | `--params-file FILE` | sets parameters from a YAML file, from the sections that match the node's name (`params_file.rs`) |
//! | `--log-level LEVEL` | `debug`, `info`, `warn`, `error`, `fatal`; `logger:=LEVEL` for one logger |
//! | `--disable-rosout-logs`, `--disable-stdout-logs` | disables the log on `/rosout`, or on stderr |
//! | `-e`, `--enclave ENCLAVE` | the enclave of the keystore, used if security is enabled |
//!
//! A rule or parameter with the prefix `node:` applies to the node with this name only; `rostopic://` and
//! `rosservice://` limit a rule to topics or services. If several rules match, the first is used. Unknown arguments are
//! an error. A bare `--` ends the ROS arguments.

mod unused;

use super::qos::Overrides;
use super::{Assignment, Config, Value, foreign, params_file};
use crate::settings::error::NodeError;
use std::path::PathBuf;

/// The parsed `--ros-args`.
#[derive(Debug, Clone, PartialEq)]
pub struct RosArgs {
    /// Namespace of the node.
    pub namespace: Option<String>,
    /// Name of the node.
    pub node: Option<String>,
    /// Remapping rules, in the given order.
    rules: Vec<Rule>,
    /// Parameter settings, in the given order; each file at the place where it was named.
    parameters: Vec<ParameterSource>,
    /// Log level.
    pub log_level: Option<String>,
    /// Log lines go to `/rosout`.
    pub rosout_logs: bool,
    /// Log lines go to stderr.
    pub stdout_logs: bool,
    /// Enclave of the keystore.
    pub enclave: Option<String>,
}

impl Default for RosArgs {
    fn default() -> Self {
        Self {
            namespace: None,
            node: None,
            rules: Vec::new(),
            parameters: Vec::new(),
            log_level: None,
            rosout_logs: true,
            stdout_logs: true,
            enclave: None,
        }
    }
}

/// A remapping rule.
#[derive(Debug, Clone, PartialEq)]
struct Rule {
    /// The only node that the rule applies to.
    node: Option<String>,
    of: Named,
    from: String,
    to: String,
}

/// The kind of thing that a name refers to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Named {
    Anything,
    Topic,
    Service,
    Namespace,
    Node,
}

/// One source of ROS parameters.
#[derive(Debug, Clone, PartialEq)]
enum ParameterSource {
    /// `-p node:name:=value`.
    Given { node: Option<String>, name: String, value: Value },
    /// `--params-file`.
    File(PathBuf),
}

impl Named {
    /// True if `name` is valid for this kind.
    fn takes(self, name: &str) -> bool {
        let is_token = |part: &str| {
            part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
                && part.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
        };
        let are_tokens = |path: &str| path.split('/').all(is_token);
        match self {
            Self::Node => is_token(name),
            // A leading or trailing slash makes no difference.
            Self::Namespace => {
                let path = name.strip_prefix('/').unwrap_or(name);
                name == "/" || are_tokens(path.strip_suffix('/').unwrap_or(path))
            }
            Self::Anything | Self::Topic | Self::Service => {
                name == "~" || are_tokens(name.strip_prefix("~/").or(name.strip_prefix('/')).unwrap_or(name))
            }
        }
    }

    /// The kind as the end of a message.
    const fn of_what(self) -> &'static str {
        match self {
            Self::Anything => "",
            Self::Topic => " of a topic",
            Self::Service => " of a service",
            Self::Namespace => " of a namespace",
            Self::Node => " of a node",
        }
    }
}

impl Rule {
    fn parse(argument: &str, rule: &str) -> Result<Self, NodeError> {
        let (from, to) = assignment(argument, rule)?;
        let (node, from) = of_node(from);
        let (of, from) = match from {
            "__ns" => (Named::Namespace, from),
            "__node" | "__name" => (Named::Node, from),
            _ => match (from.strip_prefix("rostopic://"), from.strip_prefix("rosservice://")) {
                (Some(from), _) => (Named::Topic, from),
                (None, Some(from)) => (Named::Service, from),
                (None, None) => (Named::Anything, from),
            },
        };
        if let Some(bad) = [from, to].into_iter().find(|name| !of.takes(name)) {
            return Err(NodeError::RosArgs(format!(
                "{argument} {rule}: \"{bad}\" is not a valid name{}; names consist of letters, digits and _, \
                 begin with a letter, may have / between parts, and begin with ~/ if they are private",
                of.of_what()
            )));
        }
        Ok(Self { node: node.map(str::to_owned), of, from: from.to_owned(), to: to.to_owned() })
    }
}

/// Splits `node:rest` into the node and the rest; without a prefix the node is `None`.
fn of_node(text: &str) -> (Option<&str>, &str) {
    match text.split_once(':') {
        Some((node, rest)) if !rest.starts_with("//") => (Some(node), rest),
        _ => (None, text),
    }
}

impl RosArgs {
    /// Arguments with a namespace only.
    #[must_use]
    pub fn in_namespace(namespace: &str) -> Self {
        Self { namespace: Some(namespace.to_owned()), ..Self::default() }
    }

    /// The same arguments for a node in another namespace.
    #[must_use]
    pub fn below(&self, namespace: &str) -> Self {
        Self { namespace: Some(namespace.to_owned()), ..self.clone() }
    }

    /// Splits the ROS arguments off a command line. Returns the remaining arguments and the parsed ROS arguments.
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
            rest.next().ok_or_else(|| NodeError::RosArgs(format!("{argument} needs {what} after it")))
        };
        match argument {
            "-r" | "--remap" => self.rules.push(Rule::parse(argument, &value("from:=to")?)?),
            "-p" | "--param" => {
                let rule = value("name:=value")?;
                let (name, text) = assignment(argument, &rule)?;
                let (node, name) = of_node(name);
                self.parameters.push(ParameterSource::Given {
                    node: node.map(str::to_owned),
                    name: name.to_owned(),
                    value: Value::parse(text),
                });
            }
            "--params-file" => self.parameters.push(ParameterSource::File(value("a file")?.into())),
            "--log-level" => self.take_level(&value("a level")?)?,
            "-e" | "--enclave" => self.enclave = Some(value("an enclave")?),
            "--log-config-file" | "--log-file-name" => {
                return Err(NodeError::RosArgs(format!(
                    "{argument} is for rcl's logger, which is not used here; use --log-level or RUST_LOG, and send stderr to a file"
                )));
            }
            "--enable-rosout-logs" => self.rosout_logs = true,
            "--disable-rosout-logs" => self.rosout_logs = false,
            "--enable-stdout-logs" => self.stdout_logs = true,
            "--disable-stdout-logs" => self.stdout_logs = false,
            // This program has no external logging library.
            "--enable-external-lib-logs" | "--disable-external-lib-logs" => {}
            _ => {
                return Err(NodeError::RosArgs(format!(
                    "{argument} is unknown; the known arguments are -r, -p, --params-file, --log-level, --enclave, --disable-rosout-logs, \
                     --disable-stdout-logs"
                )));
            }
        }
        Ok(())
    }

    fn take_level(&mut self, given: &str) -> Result<(), NodeError> {
        let (logger, level) =
            given.split_once(":=").map_or((None, given), |(logger, level)| (Some(logger), level));
        let level = level.to_lowercase();
        if !["debug", "info", "warn", "error", "fatal"].contains(&level.as_str()) {
            return Err(NodeError::RosArgs(format!(
                "--log-level is {level}; use debug, info, warn, error or fatal"
            )));
        }
        // The node has one logger, named after the node; the loggers of rcl and rmw do not exist here.
        if logger
            .is_none_or(|logger| logger.rsplit('.').next().is_some_and(|name| name.starts_with("mr_damper")))
        {
            self.log_level = Some(if level == "fatal" { "error".to_owned() } else { level });
        }
        Ok(())
    }

    /// The arguments that apply to the node that its program calls `own`: with its namespace, its name, and its rules.
    #[must_use]
    pub fn for_node(mut self, own: &str) -> Self {
        let is_for = |node: &Option<String>| node.as_deref().is_none_or(|node| node == own);
        self.rules.retain(|rule| is_for(&rule.node));
        self.parameters.retain(|source| match source {
            ParameterSource::Given { node, .. } => is_for(node),
            ParameterSource::File(_) => true,
        });
        let first = |of: Named| self.rules.iter().find(|rule| rule.of == of).map(|rule| rule.to.clone());
        self.namespace = first(Named::Namespace).or(self.namespace);
        self.node = first(Named::Node).or(self.node);
        self
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

    /// Name of the damper: the node's namespace without leading and trailing slash, or the node's name without a
    /// namespace.
    #[must_use]
    pub fn damper(&self) -> &str {
        match self.namespace.as_deref().unwrap_or_default().trim_matches('/') {
            "" => self.node_name(),
            namespace => namespace,
        }
    }

    /// Fully qualified name of the topic that the node calls `name`; `~/name` is private to the node.
    #[must_use]
    pub fn topic(&self, name: &str) -> String {
        self.renamed(name, Named::Topic)
    }

    /// Fully qualified name of the service or action that the node calls `name`; `~/name` is private to the node.
    #[must_use]
    pub fn service(&self, name: &str) -> String {
        self.renamed(name, Named::Service)
    }

    /// The same arguments with further remapping rules `from:=to`, which take precedence over the existing ones. Each
    /// rule must name one of the topics `known`, because a misspelt name would have no effect.
    ///
    /// # Errors
    /// When a rule is malformed, or names another topic.
    pub fn with_topics_renamed(&self, rules: &[String], known: &[&str]) -> Result<Self, NodeError> {
        let mut first = Vec::new();
        for text in rules {
            let rule = Rule::parse("--remap", text)?;
            if !known.iter().any(|name| self.qualified(name) == self.qualified(&rule.from)) {
                let (from, known) = (&rule.from, known.join(", "));
                return Err(NodeError::Usage(format!(
                    "--remap {text}: {from} is not among the topics: {known}"
                )));
            }
            first.push(rule);
        }
        first.extend(self.rules.iter().cloned());
        Ok(Self { rules: first, ..self.clone() })
    }

    fn renamed(&self, name: &str, of: Named) -> String {
        let full = self.qualified(name);
        let rule = self
            .rules
            .iter()
            .filter(|rule| rule.of == Named::Anything || rule.of == of)
            .find(|rule| self.qualified(&rule.from) == full);
        rule.map_or(full, |rule| self.qualified(&rule.to))
    }

    fn qualified(&self, name: &str) -> String {
        if name.starts_with('/') {
            name.to_owned()
        } else if let Some(rest) = name.strip_prefix('~') {
            self.full_name() + rest
        } else {
            format!("{}/{name}", self.namespace().trim_end_matches('/'))
        }
    }

    /// Sets the parameters on `config`, in the order given.
    ///
    /// # Errors
    /// When a file does not load, or a parameter has an invalid value.
    pub fn apply(&self, config: &mut Config) -> Result<(), NodeError> {
        let all = self.assignments()?;
        all.iter().try_for_each(|assignment| assignment.apply(config))?;
        foreign::say(&all, &config.dampers, std::slice::from_ref(config));
        Ok(())
    }

    /// The QoS overrides among the parameters, for programs without other parameters.
    ///
    /// # Errors
    /// When a file does not load, or an override is not supported.
    pub fn qos(&self) -> Result<Overrides, NodeError> {
        let mut config = Config::default();
        if !self.parameters.is_empty() {
            let all = self.assignments()?;
            let meant = all.iter().filter(|assignment| Overrides::are_meant(&assignment.name));
            meant.into_iter().try_for_each(|assignment| assignment.apply(&mut config))?;
        }
        Ok(config.qos)
    }

    /// The parameters in the given order; from files, the sections that match this node.
    ///
    /// # Errors
    /// When a file does not load.
    pub fn assignments(&self) -> Result<Vec<Assignment>, NodeError> {
        let mut all = Vec::new();
        for source in &self.parameters {
            match source {
                ParameterSource::Given { name, value, .. } => {
                    all.push(Assignment { name: name.clone(), value: value.clone(), origin: None });
                }
                ParameterSource::File(path) => all.extend(params_file::read(path, &self.full_name())?),
            }
        }
        Ok(all)
    }
}

fn assignment<'a>(argument: &str, rule: &'a str) -> Result<(&'a str, &'a str), NodeError> {
    rule.split_once(":=").ok_or_else(|| {
        NodeError::RosArgs(format!("{argument} {rule}: := is missing between the name and the value"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn split(line: &str) -> Result<(Vec<String>, RosArgs), NodeError> {
        let (plain, ros) = RosArgs::split(line.split_whitespace().map(str::to_owned))?;
        Ok((plain, ros.for_node("mr_damper")))
    }

    #[test]
    fn further_rules_take_precedence_and_must_name_existing_topics() {
        let (_, ros) =
            split("--ros-args -r __ns:=/front -r coil_current:=/amps -r displacement:=/other").expect("good");
        let ros = ros.for_node("mr_damper_replay");
        let known = ["displacement", "velocity", "coil_current", "measured_force", "/clock"];
        let with = |rules: &[&str]| {
            let rules: Vec<String> = rules.iter().map(|&rule| rule.to_owned()).collect();
            ros.with_topics_renamed(&rules, &known)
        };
        let all =
            with(&["displacement:=/lvdt/x", "/front/velocity:=/v", "/clock:=/bag_clock"]).expect("good");
        for (name, topic) in [
            ("displacement", "/lvdt/x"),
            ("velocity", "/v"),
            ("coil_current", "/amps"),
            ("measured_force", "/front/measured_force"),
            ("/clock", "/bag_clock"),
        ] {
            assert_eq!(all.topic(name), topic);
        }
        for (rule, why) in [
            (
                "displacment:=/x",
                "--remap displacment:=/x: displacment is not among the topics: displacement, velocity",
            ),
            ("displacement", "--remap displacement: := is missing"),
            ("displacement:=", "--remap displacement:=: \"\" is not a valid name"),
        ] {
            let message = with(&[rule]).expect_err("refused").to_string();
            assert!(message.contains(why), "{message}");
        }
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
        let [given] = &ros.assignments().expect("no file")[..] else { panic!("one parameter") };
        assert_eq!((given.name.as_str(), &given.value), ("coast_s", &Value::Double(0.5)));
        assert_eq!(ros.log_level.as_deref(), Some("debug"));
    }

    #[test]
    fn rules_can_be_limited_to_a_node_to_topics_and_to_services() {
        let (_, ros) = split(
            "--ros-args -r other:__node:=x -r mr_damper:__node:=corner -r __ns:=/a -r other:reset:=no -r rostopic://reset:=topic \
             -r rosservice://reset:=/all/reset -r ~/get_state:=state -r /a/load_model:=~/load -p other:coast_s:=1 -p mr_damper:hold_s:=2",
        )
        .expect("good arguments");
        assert_eq!(ros.full_name(), "/a/corner");
        assert_eq!(
            (ros.topic("reset"), ros.service("reset")),
            ("/a/topic".to_owned(), "/all/reset".to_owned())
        );
        assert_eq!(ros.service("~/get_state"), "/a/state");
        assert_eq!(ros.service("load_model"), "/a/corner/load");
        assert_eq!(ros.service("~/change_state"), "/a/corner/change_state");
        let names: Vec<_> = ros.assignments().expect("no file").into_iter().map(|a| a.name).collect();
        assert_eq!(names, ["hold_s"]);
    }

    #[test]
    fn levels_of_other_loggers_are_ignored() {
        let level = |line: &str| split(line).expect("good arguments").1.log_level;
        assert_eq!(level("--ros-args --log-level rcl:=debug"), None);
        assert_eq!(level("--ros-args --log-level front_left.mr_damper:=WARN"), Some("warn".to_owned()));
        assert_eq!(level("--ros-args --log-level fatal"), Some("error".to_owned()));
    }

    #[test]
    fn wrong_arguments_are_reported() {
        for (line, expected) in [
            ("--ros-args --frobnicate", "--frobnicate is unknown"),
            ("--ros-args -p", "-p needs name:=value"),
            ("--ros-args -p coast_s=1", ":= is missing"),
            ("--ros-args -r a:=b-c", "\"b-c\" is not a valid name"),
            ("--ros-args -r :=b", "\"\" is not a valid name"),
            ("--ros-args -r a:=/b//c", "\"/b//c\" is not a valid name"),
            ("--ros-args -r a:=/b/", "\"/b/\" is not a valid name"),
            ("--ros-args -r a:=b~", "\"b~\" is not a valid name"),
            ("--ros-args -r rostopic://a:=1st", "\"1st\" is not a valid name of a topic"),
            ("--ros-args -r __ns:=/front/le~/c", "\"/front/le~/c\" is not a valid name of a namespace"),
            ("--ros-args -r __ns:=//", "\"//\" is not a valid name of a namespace"),
            ("--ros-args -r __node:=a/b", "\"a/b\" is not a valid name of a node"),
            ("--ros-args --log-level loud", "--log-level is loud"),
            ("--ros-args --log-config-file x", "use --log-level"),
        ] {
            let message = split(line).expect_err("bad arguments").to_string();
            assert!(message.contains(expected), "{line}: {message}");
        }
    }
}
