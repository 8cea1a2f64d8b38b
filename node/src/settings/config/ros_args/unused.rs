//! Refuses ROS arguments that a command would ignore, so that the user notices them.

use super::{Named, ParameterSource, RosArgs, Rule};
use crate::settings::error::NodeError;

impl RosArgs {
    /// Refuses arguments for a ROS node, because `command` starts none.
    ///
    /// # Errors
    /// [`NodeError::Usage`] naming the argument.
    pub fn refuse_for_no_node(&self, command: &str) -> Result<(), NodeError> {
        let (argument, advice) = if let Some(rule) = self.rules.first() {
            (rule.text(), rule.as_map())
        } else if let Some(source) = self.parameters.first() {
            (source.text(), String::new())
        } else if let Some(enclave) = &self.enclave {
            (format!("--enclave {enclave}"), String::new())
        } else {
            return Ok(());
        };
        Err(NodeError::Usage(format!(
            "`{command}` starts no ROS node, so {argument} would change nothing: leave it out{advice}"
        )))
    }

    /// Refuses parameters, because the node of `command` does not have any. A file may be for other nodes, so it only causes a
    /// warning that it is ignored.
    ///
    /// # Errors
    /// [`NodeError::Usage`] naming the parameter.
    pub fn refuse_parameters(&self, command: &str) -> Result<(), NodeError> {
        for source in &self.parameters {
            match source {
                ParameterSource::Given { .. } => {
                    return Err(NodeError::Usage(format!(
                        "the node of `{command}` has no parameters, so {} would change nothing: use its flags (mr-damper \
                         {command} --help)",
                        source.text()
                    )));
                }
                ParameterSource::File(path) => {
                    tracing::warn!(file = %path.display(), "the node of `{command}` has no parameters: the file is ignored");
                }
            }
        }
        Ok(())
    }

    /// Refuses rules for names that the node called `node` does not have. `topics` and `services` are its names.
    ///
    /// # Errors
    /// [`NodeError::Usage`] naming the rule.
    pub fn refuse_stray_rules(
        &self,
        node: &str,
        topics: &[&str],
        services: &[&str],
    ) -> Result<(), NodeError> {
        let own = Self { node: self.node.clone().or_else(|| Some(node.to_owned())), ..self.clone() };
        let is_one_of = |rule: &Rule, names: &[&str]| {
            names.iter().any(|name| own.qualified(name) == own.qualified(&rule.from))
        };
        let renames_nothing = |rule: &&Rule| match rule.of {
            Named::Topic => !is_one_of(rule, topics),
            Named::Service => !is_one_of(rule, services),
            Named::Anything => !is_one_of(rule, topics) && !is_one_of(rule, services),
            Named::Namespace | Named::Node => false,
        };
        let Some(stray) = own.rules.iter().find(renames_nothing) else { return Ok(()) };
        Err(NodeError::Usage(format!(
            "{} renames nothing: {} is not among the topics of {node}: {}",
            stray.text(),
            stray.from,
            topics.join(", ")
        )))
    }

    /// Fully qualified name of `name` without any remapping.
    #[must_use]
    pub fn unrenamed(&self, name: &str) -> String {
        self.qualified(name)
    }
}

impl Rule {
    /// The rule as it was given.
    fn text(&self) -> String {
        let node = self.node.as_ref().map(|node| format!("{node}:")).unwrap_or_default();
        let of = match self.of {
            Named::Topic => "rostopic://",
            Named::Service => "rosservice://",
            Named::Anything | Named::Namespace | Named::Node => "",
        };
        format!("-r {node}{of}{}:={}", self.from, self.to)
    }

    /// Advice for a remapped topic: the equivalent `--map` for a bag.
    fn as_map(&self) -> String {
        let channel = self.from.rsplit('/').next().unwrap_or_default();
        let mapping = format!("{channel}={}", self.to);
        if self.to.starts_with('/') && mapping.parse::<mr_damper_runs::Mapping>().is_ok() {
            return format!("; --map {mapping} reads the channel from that topic of a bag");
        }
        String::new()
    }
}

impl ParameterSource {
    /// The source as it was given.
    fn text(&self) -> String {
        match self {
            Self::Given { node, name, .. } => {
                let node = node.as_ref().map(|node| format!("{node}:")).unwrap_or_default();
                format!("-p {node}{name}")
            }
            Self::File(path) => format!("--params-file {}", path.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(line: &str) -> RosArgs {
        let line = format!("--ros-args {line}");
        RosArgs::split(line.split_whitespace().map(str::to_owned)).expect("good arguments").1
    }

    #[test]
    fn arguments_for_a_node_are_refused_without_one() {
        for (line, says) in [
            (
                "-r /fl/displacement:=/susp/pos",
                "so -r /fl/displacement:=/susp/pos would change nothing: leave it out; --map displacement=/susp/pos",
            ),
            ("-r __ns:=/front_left", "-r __ns:=/front_left would change nothing"),
            ("-r other:rostopic://a:=b", "-r other:rostopic://a:=b would"),
            ("-p coast_s:=1", "-p coast_s would"),
            ("--params-file x.yaml", "--params-file x.yaml would"),
            ("--enclave /a", "--enclave /a would"),
        ] {
            let message = args(line).refuse_for_no_node("evaluate").expect_err(line).to_string();
            assert!(
                message.starts_with("`evaluate` starts no ROS node, so ") && message.contains(says),
                "{message}"
            );
        }
        // Arguments that also work without a node are accepted.
        args("--log-level debug --disable-stdout-logs")
            .refuse_for_no_node("evaluate")
            .expect("nothing of a node");
    }

    #[test]
    fn rules_for_unknown_names_and_parameters_are_refused() {
        let (topics, services) = (["displacement", "/clock"], ["~/pause"]);
        let strays = |line: &str| args(line).refuse_stray_rules("mr_damper_replay", &topics, &services);
        for line in [
            "-r displacement:=/x -r /clock:=/bag_clock -r __ns:=/front",
            "-r ~/pause:=/halt -r rosservice:///mr_damper_replay/pause:=/halt",
            "-r rostopic://displacement:=/x",
        ] {
            strays(line).expect(line);
        }
        for line in ["-r displacment:=/x", "-r rosservice://displacement:=/x", "-r rostopic://~/pause:=/x"] {
            let message = strays(line).expect_err(line).to_string();
            assert!(
                message.contains("renames nothing") && message.contains("displacement, /clock"),
                "{message}"
            );
        }
        let message = args("-p rate:=2").refuse_parameters("replay").expect_err("refused").to_string();
        assert!(message.starts_with("the node of `replay` has no parameters, so -p rate would"), "{message}");
    }
}
