//! `mr-damper doctor`: checks what would keep the service from working on this machine.

use crate::commands::{context::CliContext, output};
use crate::nodes::checks::{Finding, Level, examine};
use crate::settings::config::{self, UnlistedParameterFlags};
use crate::settings::error::{NodeError, PartError};
use mr_damper_base::shown;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Check what would keep the service from working on this machine: models, domain, multicast, ports, clock, priorities, limits.
///
/// The command takes the arguments of `node`, also each parameter as a flag (`mr-damper node --help` lists them), and tries everything that such a node depends on. It joins the ROS domain and
/// leaves it again, and opens no port that the node would not open. It takes about five seconds. The exit code is 1 if the
/// node would not run or would not be heard.
///
/// Example: mr-damper doctor --ros-args --params-file damper.params.yaml
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Configuration file (TOML), as for `node`.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Write the findings as JSON to a file; without a file name, or with -, print only the JSON to stdout.
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    pub json: Option<PathBuf>,
    /// Parameters as flags, as for `node`.
    #[command(flatten)]
    pub parameters: UnlistedParameterFlags,
}

#[derive(Serialize)]
struct Report<'a> {
    schema: &'static str,
    findings: &'a [Finding],
}

/// Runs all checks, and prints each finding as soon as it is known.
///
/// # Errors
/// When the parameters cannot be read, or something would keep the node from working.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let dampers = config::dampers(args.config.as_deref(), &context.ros_args, &args.parameters.0.given)?;
    let aloud = args.json.as_deref() != Some(Path::new("-"));
    let mut findings = Vec::new();
    examine(&dampers, &context.interrupt, |finding| {
        if aloud {
            println!("{}", shown::lines(&finding.text()));
        }
        findings.push(finding);
    });
    if let Some(path) = &args.json {
        output::json(path, &Report { schema: "mr-damper/doctor/1", findings: &findings })?;
    }
    if context.interrupt.is_raised() {
        return Err(NodeError::Interrupted);
    }
    match findings.iter().filter(|finding| finding.level == Level::Failure).count() {
        0 => Ok(()),
        failures => Err(NotReady { failures }.into()),
    }
}

/// Checks found what would keep the service from working.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{} would keep the service from working: see FAILURE above", things(*failures))]
struct NotReady {
    /// Number of findings of the level failure, at least one.
    failures: usize,
}

impl PartError for NotReady {}

fn things(number: usize) -> String {
    if number == 1 { "one thing".to_owned() } else { format!("{number} things") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_counts_what_it_found() {
        let said = |failures| NotReady { failures }.to_string();
        assert_eq!(said(1), "one thing would keep the service from working: see FAILURE above");
        assert_eq!(said(2), "2 things would keep the service from working: see FAILURE above");
    }
}
