//! What would keep the service from working on this machine, found before it matters: each thing is tried, as the service would do it.
//!
//! ```text
//! configuration ─→ model, network (domain, ports, multicast, others, Zenoh), system (clock, timer, priority, files) ─→ findings
//! ```

mod network;
mod system;

use crate::config::{Config, Damper};
use crate::hardened;
use crate::interrupt::Interrupt;
use crate::models;
use serde::Serialize;

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// As it should be.
    Ok,
    /// The service runs, and not as well as it might.
    Warning,
    /// The service does not run, or is not heard.
    Failure,
}

impl Level {
    /// As it stands at the beginning of a line.
    #[must_use]
    pub const fn mark(self) -> &'static str {
        match self {
            Self::Ok => "ok     ",
            Self::Warning => "WARNING",
            Self::Failure => "FAILURE",
        }
    }
}

/// What came of one thing that was tried.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// What was tried, in a word or two.
    pub what: String,
    /// How bad it is.
    pub level: Level,
    /// What was found, with its figures.
    pub found: String,
    /// What to do, where there is something to do.
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

    /// An error of the service's own says what to do by itself.
    fn failure(what: &str, found: impl Into<String>) -> Self {
        Self { level: Level::Failure, ..Self::ok(what, found) }
    }

    /// As a line, or two.
    #[must_use]
    pub fn text(&self) -> String {
        let advice = self.advice.as_ref().map(|advice| format!("\n          {advice}")).unwrap_or_default();
        format!("{}  {}: {}{advice}", self.level.mark(), self.what, self.found)
    }
}

/// Tries all things that a service of these dampers rests on, and tells each finding as it comes. Ends early when interrupted.
pub fn examine(dampers: &[Damper], interrupt: &Interrupt, mut tell: impl FnMut(Finding)) {
    // What is the process's is the same in all of them, of whom there is at least one.
    let Some(Damper { config, args }) = dampers.first() else { return };
    tell(libraries());
    dampers.iter().for_each(|damper| tell(model(damper)));
    network::domain(config).into_iter().for_each(&mut tell);
    network::environment(config).into_iter().for_each(&mut tell);
    tell(network::multicast(config));
    if interrupt.is_raised() {
        return;
    }
    tell(network::others(config, interrupt));
    tell(network::join(config, args.enclave.as_deref()));
    tell(network::zenoh(config));
    tell(system::clock(config));
    tell(system::timer());
    tell(system::priority(config));
    tell(system::files(dampers.len()));
}

/// Which DDS libraries this program was built with.
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
                ..Finding::ok(WHAT, format!("as released, so {}", lacks.join("; ")))
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
            "none is named",
            "name it as for the node: --ros-args -p model:=thesis/fuzzy-tanh/rp3-cs, or --config FILE",
        );
    }
    match models::from_config(config) {
        Ok((_, names)) => {
            let seeded = names.seeded.as_deref().unwrap_or("none");
            Finding::ok(&what, format!("{} loads, ARX beside it: {seeded}", names.free))
        }
        Err(error) => Finding::failure(&what, error.to_string()),
    }
}

/// True when other machines may take part.
fn leaves_this_machine(config: &Config) -> bool {
    !crate::ros::is_loopback_only(config)
}
