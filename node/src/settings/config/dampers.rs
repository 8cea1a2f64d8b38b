//! Several dampers in one process: one configuration, with a namespace and a model for each.
//!
//! ```toml
//! dampers = ["front_left", "rear_left"]
//! force_timeout_s = 0.1          # for all dampers
//! [front_left]
//! model = "fl.toml"              # for one damper
//! [rear_left]
//! model = "rl.toml"
//! current.max_a = 1.5
//! ```
//!
//! The same as ROS parameters: `-p dampers:="[front_left, rear_left]" -p front_left.model:=fl.toml`, or a section
//! `/front_left/mr_damper` of a parameter file. Each damper is a separate node, below the namespace of the process.
//! Within one source, a setting for one damper overrides the setting for all. Domain, discovery, priority and Zenoh
//! endpoints apply to the whole process.

use super::qos::Overrides;
use super::{Assignment, Config, RosArgs, TABLE, Value, file, foreign};
use crate::settings::error::NodeError;
use std::path::Path;

/// A damper of the process.
#[derive(Debug, Clone, PartialEq)]
pub struct Damper {
    /// Its configuration.
    pub config: Config,
    /// The ROS arguments, with the damper's own namespace.
    pub args: RosArgs,
}

impl Damper {
    /// Its name, as used in Zenoh keys.
    #[must_use]
    pub fn name(&self) -> &str {
        self.args.damper()
    }
}

/// The dampers given by the configuration file, the ROS arguments and the flags, in order of increasing precedence.
/// There is at least one.
///
/// # Errors
/// When a source cannot be read, a parameter or a name is invalid, or dampers differ in a setting of the process.
pub fn dampers(
    file: Option<&Path>,
    args: &RosArgs,
    flags: &[(&'static str, Value)],
) -> Result<Vec<Damper>, NodeError> {
    let of_file = file.map(file::read).transpose()?.unwrap_or_default();
    let flag = |(name, value): &(&'static str, Value)| Assignment {
        name: (*name).to_owned(),
        value: value.clone(),
        origin: None,
    };
    let of_flags: Vec<Assignment> = flags.iter().map(flag).collect();
    let sources = |args: &RosArgs| -> Result<_, NodeError> {
        Ok([of_file.clone(), args.assignments()?, of_flags.clone()])
    };

    let own = sources(args)?;
    let names = names(&own)?;
    if names.is_empty() {
        let mut config = Config { qos: Overrides::of_nodes([args]), ..Config::default() };
        own.iter().flatten().try_for_each(|assignment| assignment.apply(&mut config))?;
        config.qos.forget_topics();
        foreign::say(own.iter().flatten(), &names, std::slice::from_ref(&config));
        return Ok(vec![Damper { config, args: args.clone() }]);
    }
    let mut read = own.into_iter().flatten().collect::<Vec<_>>();
    let nodes =
        names.iter().map(|name| args.below(&format!("{}/{name}", args.namespace().trim_end_matches('/'))));
    let nodes: Vec<RosArgs> = nodes.collect();
    let qos = Overrides::of_nodes(&nodes);
    let all = names.iter().zip(&nodes).map(|(name, args)| {
        let (args, sources) = (args.clone(), sources(args)?);
        let mut config = Config { qos: qos.clone(), ..Config::default() };
        config_of(name, &names, &sources, &mut config)?;
        config.qos.forget_topics();
        read.extend(sources.into_iter().flatten());
        Ok(Damper { config, args })
    });
    let all: Vec<Damper> = all.collect::<Result<_, NodeError>>()?;
    let configs: Vec<Config> = all.iter().map(|damper| damper.config.clone()).collect();
    foreign::say(&read, &names, &configs);
    let shared = |config: &Config| {
        let Config { domain_id, discovery_range, discovery_peers, realtime_priority, zenoh, .. } =
            config.clone();
        (domain_id, discovery_range, discovery_peers, realtime_priority, zenoh)
    };
    match all.iter().find(|damper| shared(&damper.config) != shared(&all[0].config)) {
        None => Ok(all),
        Some(other) => Err(NodeError::Usage(format!(
            "{} and {} differ in domain_id, discovery_*, realtime_priority or zenoh.*, which apply to the whole process: set them without a \
             damper's name",
            all[0].name(),
            other.name()
        ))),
    }
}

/// The list `dampers` from the source with the highest precedence.
fn names(sources: &[Vec<Assignment>]) -> Result<Vec<String>, NodeError> {
    let mut config = Config::default();
    for assignment in sources.iter().flatten().filter(|assignment| assignment.name == "dampers") {
        assignment.apply(&mut config)?;
    }
    for (index, name) in config.dampers.iter().enumerate() {
        let refuse = |why: &str| NodeError::Parameter {
            name: "dampers".to_owned(),
            value: format!("{:?}", config.dampers),
            expected: format!("names for namespaces; \"{name}\" {why}"),
        };
        let mut letters = name.chars();
        let begins = letters.next().is_some_and(|c| c.is_ascii_alphabetic() || c == '_');
        if !begins || !letters.all(|c| c.is_ascii_alphanumeric() || c == '_') {
            return Err(refuse("is not made of letters, digits and _, beginning with a letter"));
        }
        if config.dampers[..index].contains(name) {
            return Err(refuse("occurs twice"));
        }
        if TABLE.iter().any(|parameter| parameter.name.split('.').next() == Some(name.as_str())) {
            return Err(refuse("is the name of a parameter"));
        }
    }
    Ok(config.dampers)
}

/// Applies to `config` the settings for the damper called `own`; `names` are all dampers.
fn config_of(
    own: &str,
    names: &[String],
    sources: &[Vec<Assignment>],
    config: &mut Config,
) -> Result<(), NodeError> {
    for source in sources {
        let (mut general, mut special) = (Vec::new(), Vec::new());
        for assignment in source {
            match assignment.name.split_once('.') {
                Some((name, rest)) if name == own => special.push((assignment, rest)),
                Some((name, _)) if names.iter().any(|other| other == name) => {}
                _ => general.push((assignment, assignment.name.as_str())),
            }
        }
        for (assignment, name) in general.into_iter().chain(special) {
            assignment.apply_as(name, config)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(toml: &str, line: &str) -> Result<Vec<Damper>, NodeError> {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let path = dir.path().join("vehicle.toml");
        std::fs::write(&path, toml).expect("written");
        let (_, args) = RosArgs::split(line.split('|').map(str::to_owned))?;
        let args = args.for_node("mr_damper");
        dampers(Some(&path), &args, &[("hold_s", Value::Double(3.0))])
    }

    #[test]
    fn one_damper_is_the_node_itself() {
        let found = parsed("model = \"a.toml\"", "--ros-args|-r|__ns:=/rear").expect("a good file");
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].name(), found[0].config.model.as_str()), ("rear", "a.toml"));
        assert_eq!(found[0].config.settings.hold_s, 3.0);
    }

    #[test]
    fn each_damper_gets_the_common_and_its_own_settings() {
        let toml = "dampers = [\"left\", \"right\"]\nmodel = \"a.toml\"\ncoast_s = 0.3\n[left]\nmodel = \"l.toml\"\n\
                    [right.current]\nmax_a = 1.5\n[zenoh]\nlisten = [\"tcp/127.0.0.1:1\"]\n";
        let line = "--ros-args|-r|__ns:=/front|-p|right.coast_s:=0.5|-p|coast_s:=0.4";
        let found = parsed(toml, line).expect("a good file");
        let text: Vec<String> = found
            .iter()
            .map(|d| {
                let (c, current_a) = (&d.config, d.config.settings.limits.current_max_a);
                let topic = d.args.topic("displacement");
                format!(
                    "{} {} coast {} max {current_a} {topic} {:?}",
                    d.name(),
                    c.model,
                    c.settings.coast_s,
                    c.zenoh.listen
                )
            })
            .collect();
        assert_eq!(
            text,
            [
                "front/left l.toml coast 0.4 max 2.5 /front/left/displacement [\"tcp/127.0.0.1:1\"]",
                "front/right a.toml coast 0.5 max 1.5 /front/right/displacement [\"tcp/127.0.0.1:1\"]",
            ]
        );
    }

    #[test]
    fn the_examples_load() {
        let example = |name: &str| {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../launch-configs").join(name);
            dampers(Some(&path), &RosArgs::default(), &[]).expect(name)
        };
        assert_eq!(example("node.toml").len(), 1);
        let corners = example("vehicle.toml");
        let damping: Vec<f64> = corners.iter().map(|d| d.config.skyhook_n_s_m).collect();
        assert_eq!(damping, [1500.0, 1500.0, 1200.0, 1200.0]);
        assert_eq!(corners[3].config.displacement.sign, -1.0);
        assert!(
            corners
                .iter()
                .all(|d| d.config.settings.limits.rate_max_a_s == 200.0 && d.config.law == "skyhook")
        );
        let of_yaml = |line: &str| {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../launch-configs/vehicle.params.yaml");
            let line = format!("--ros-args --params-file {} {line}", path.display());
            let (_, args) =
                RosArgs::split(line.split_whitespace().map(str::to_owned)).expect("good arguments");
            dampers(None, &args.for_node("mr_damper"), &[]).expect("vehicle.params.yaml")
        };
        let configs = |dampers: &[Damper]| dampers.iter().map(|d| d.config.clone()).collect::<Vec<_>>();
        let in_one_process = of_yaml("");
        assert_eq!(
            configs(&in_one_process).into_iter().map(|c| Config { dampers: vec![], ..c }).collect::<Vec<_>>(),
            configs(&corners).into_iter().map(|c| Config { dampers: vec![], ..c }).collect::<Vec<_>>(),
            "vehicle.params.yaml and vehicle.toml agree"
        );
        for corner in &in_one_process {
            let alone = of_yaml(&format!("-r __ns:=/{}", corner.name()));
            assert_eq!(configs(&alone), configs(std::slice::from_ref(corner)), "{}", corner.name());
        }
    }

    #[test]
    fn parameters_of_other_nodes_in_a_shared_section_are_ignored() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let path = dir.path().join("robot.params.yaml");
        let read = |text: &str| {
            std::fs::write(&path, text).expect("written");
            let line = ["--ros-args", "--params-file", path.to_str().expect("UTF-8")];
            let (_, args) = RosArgs::split(line.map(str::to_owned))?;
            dampers(None, &args.for_node("mr_damper"), &[])
        };
        let shared = "/**:\n  ros__parameters:\n    coast_s: 0.5\n    frame_id: base_link\n    gains: [1.0, 2.0]\n    \
                      unset: null\n    camera: {exposure: {ms: 3}}\n";
        let found = read(shared).expect("a shared file");
        assert_eq!(found[0].config.settings.coast_s, 0.5);
        let fleet = format!("{shared}    dampers: [left, right]\n    left: {{coast_s: 0.7}}\n");
        let found = read(&fleet).expect("a shared file");
        assert_eq!((found.len(), found[0].config.settings.coast_s), (2, 0.7));

        // Invalid values, and unknown names in a section for this node, are still errors.
        for (text, says) in [
            ("/**:\n  ros__parameters:\n    coast_s: -1\n", "/**: parameter coast_s is -1"),
            ("/**:\n  ros__parameters:\n    coast_s: null\n", "/**: coast_s has no value"),
            (
                "mr_damper:\n  ros__parameters:\n    coast: 1\n",
                "mr_damper: unknown parameter coast; did you mean coast_s?",
            ),
            (
                "/**/mr_damper:\n  ros__parameters:\n    gains: [1.0, a]\n",
                "gains must be a list of texts or of numbers",
            ),
        ] {
            let message = read(text).expect_err(text).to_string();
            assert!(message.contains(says), "{text}: {message}");
        }
    }

    #[test]
    fn invalid_settings_are_reported() {
        for (toml, says) in [
            ("dampers = [\"a\", \"a\"]", "\"a\" occurs twice"),
            ("dampers = [\"zenoh\"]", "\"zenoh\" is the name of a parameter"),
            ("dampers = [\"front-left\"]", "\"front-left\" is not made of"),
            ("dampers = [\"\"]", "\"\" is not made of"),
            ("dampers = [\"a\"]\n[b]\nmodel = \"x\"", "unknown parameter b.model"),
            ("dampers = [\"a\"]\n[a]\nmodle = \"x\"", "did you mean model?"),
            ("dampers = [\"a\", \"b\"]\n[a]\ndomain_id = 3", "differ in domain_id"),
            ("dampers = 3", "must be a list of texts"),
        ] {
            let message = parsed(toml, "").expect_err(toml).to_string();
            assert!(message.contains(says), "{toml}: {message}");
        }
    }
}
