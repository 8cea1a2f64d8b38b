//! Checks what would keep the service from working on this machine, before it is started. Each check does what the service
//! would do.
//!
//! ```text
//! configuration ─→ model, CAN bus, network (domain, ports, multicast, others, Zenoh), system (clock, timer, priority, files) ─→ findings
//! ```

mod network;
mod system;

use crate::estimation::models;
use crate::process::hardened;
use crate::settings::config::{Config, Damper};
use crate::settings::interrupt::Interrupt;
use crate::streams::can::CanSetup;
use crate::streams::source::TOPICS;
use serde::Serialize;

/// Severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// No problem was found.
    Ok,
    /// The service runs, but with a limitation.
    Warning,
    /// The service does not run, or other nodes do not receive its messages.
    Failure,
}

impl Level {
    /// The mark at the beginning of a line.
    #[must_use]
    pub const fn mark(self) -> &'static str {
        match self {
            Self::Ok => "ok     ",
            Self::Warning => "WARNING",
            Self::Failure => "FAILURE",
        }
    }
}

/// Result of one check.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// Short name of the check.
    pub what: String,
    /// Severity.
    pub level: Level,
    /// The result, with its figures.
    pub found: String,
    /// Advice, if the user should do something.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub advice: Option<String>,
}

impl Finding {
    fn ok(what: &str, found: impl Into<String>) -> Self {
        Self { what: what.to_owned(), level: Level::Ok, found: found.into(), advice: None }
    }

    fn warning(what: &str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { level: Level::Warning, advice: Some(advice.into()), ..Self::ok(what, found) }
    }

    /// A failure without separate advice: the service's own errors contain their advice.
    fn failure(what: &str, found: impl Into<String>) -> Self {
        Self { level: Level::Failure, ..Self::ok(what, found) }
    }

    /// The finding as one or two lines.
    #[must_use]
    pub fn text(&self) -> String {
        let advice = self.advice.as_ref().map(|advice| format!("\n          {advice}")).unwrap_or_default();
        format!("{}  {}: {}{advice}", self.level.mark(), self.what, self.found)
    }
}

/// Checks everything that a service of these dampers depends on, and passes each finding to `report` as soon as it is known.
/// Ends early when interrupted.
pub fn examine(dampers: &[Damper], interrupt: &Interrupt, mut report: impl FnMut(Finding)) {
    // There is at least one damper, and the settings of the process are the same for all dampers.
    let Some(Damper { config, args }) = dampers.first() else { return };
    report(libraries());
    dampers.iter().for_each(|damper| report(model(damper)));
    dampers.iter().filter_map(can).for_each(&mut report);
    network::domain(config).into_iter().for_each(&mut report);
    network::environment(config).into_iter().for_each(&mut report);
    report(network::multicast(config));
    if interrupt.is_raised() {
        return;
    }
    report(network::others(config, interrupt));
    report(network::join(config, args.enclave.as_deref()));
    report(network::zenoh(config));
    report(system::clock(config));
    report(system::timer());
    report(system::priority(config));
    report(system::files(dampers.len()));
}

/// The DDS libraries that this program was built with.
fn libraries() -> Finding {
    const WHAT: &str = "DDS libraries";
    match hardened::EDITS {
        Some(edits) => Finding::ok(WHAT, format!("hardened: {edits}")),
        None => {
            let lacks: Vec<_> =
                hardened::LACKS.iter().map(|(name, lack)| format!("{name}: {lack}")).collect();
            let advice = "node/hardened/build makes a build without these limits";
            Finding {
                advice: Some(advice.to_owned()),
                ..Finding::ok(WHAT, format!("as released, with these limits: {}", lacks.join("; ")))
            }
        }
    }
}

/// The models that the parameters name.
fn model(Damper { config, args }: &Damper) -> Finding {
    let of = args.full_name();
    let what = format!("model of {of}");
    if config.model.is_empty() {
        return Finding::warning(
            &what,
            "no model is given",
            "give it as for the node: --ros-args -p model:=thesis/fuzzy-tanh/rp3-cs, or --config FILE",
        );
    }
    match models::from_config(config) {
        Ok((_, names)) => {
            let seeded = names.seeded.as_deref().unwrap_or("none");
            Finding::ok(&what, format!("{} loads; ARX model: {seeded}", names.free))
        }
        Err(error) => Finding::failure(&what, error.to_string()),
    }
}

/// The CAN bus of a damper, if it has one. Nothing is sent to it.
fn can(Damper { config, args }: &Damper) -> Option<Finding> {
    let what = format!("CAN bus of {}", args.full_name());
    let opened = CanSetup::of(config, &TOPICS, None).and_then(|setup| {
        let Some(setup) = setup else { return Ok(None) };
        let inputs = setup.inputs.filters();
        setup.bus.receiver(&inputs)?;
        let outputs =
            [&setup.estimate, &setup.command].into_iter().flatten().map(|message| message.name().to_owned());
        let outputs: Vec<String> = outputs.collect();
        let sent = if outputs.is_empty() { "nothing".to_owned() } else { outputs.join(", ") };
        Ok(Some(format!("{} opens; {} messages of inputs; it sends {sent}", setup.interface, inputs.len())))
    });
    match opened {
        Ok(found) => found.map(|found| Finding::ok(&what, found)),
        Err(error) => Some(Finding::failure(&what, error.to_string())),
    }
}

/// True if other machines may take part in the domain.
fn leaves_this_machine(config: &Config) -> bool {
    !crate::ros2::participant::is_loopback_only(config)
}
