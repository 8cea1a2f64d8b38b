//! The groups of parameters in `--help`.

use super::Parameter;

/// Titles of the groups, in the order of `--help`, with the parameters of each: whole names, or first parts that end in a dot.
const GROUPS: [(&str, &[&str]); 11] = [
    (
        "Node",
        &[
            "autostart",
            "use_sim_time",
            "dampers",
            "domain_id",
            "discovery_range",
            "discovery_peers",
            "realtime_priority",
        ],
    ),
    ("Models", &["model", "arx_model", "use_measured_force", "observer_tau_s", "boada.", "filter."]),
    (
        "Modes and time limits",
        &[
            "mode",
            "force_timeout_s",
            "coast_s",
            "input_timeout_s",
            "hold_s",
            "bumpless_tau_s",
            "gap_s",
            "align_wait_s",
            "deadline_s",
        ],
    ),
    ("Residual and diagnosis", &["residual.", "history.", "effects.", "fleet.", "close_loop."]),
    (
        "Current command",
        &["law", "inverse.", "skyhook.", "groundhook.", "fixed.", "request_timeout_s", "current."],
    ),
    ("Plausibility", &["plausible."]),
    (
        "Inputs",
        &[
            "displacement.",
            "velocity.",
            "coil_current.",
            "command_voltage.",
            "measured_force.",
            "body_velocity.",
            "force_request.",
        ],
    ),
    ("Outputs as standard messages", &["standard."]),
    ("CAN bus", &["can."]),
    ("Zenoh mirror", &["zenoh."]),
    // A parameter that no group lists. A test asserts that there is none.
    (OTHER, &[]),
];

/// The group of parameters that no other group lists.
const OTHER: &str = "Other";

impl Parameter {
    /// Title of the parameter's group.
    #[must_use]
    pub fn group(&self) -> &'static str {
        let is_in = |entries: &[&str]| {
            entries
                .iter()
                .any(|entry| self.name == *entry || (entry.ends_with('.') && self.name.starts_with(entry)))
        };
        GROUPS.iter().find(|(_, entries)| is_in(entries)).map_or(OTHER, |(title, _)| title)
    }
}

/// Titles of all groups, in the order of `--help`.
pub(in crate::settings::config) fn groups() -> impl Iterator<Item = &'static str> {
    GROUPS.iter().map(|(title, _)| *title)
}

#[cfg(test)]
mod tests {
    use super::super::TABLE;
    use super::*;

    #[test]
    fn every_parameter_is_in_a_group_and_every_entry_names_one() {
        for parameter in TABLE.iter() {
            assert_ne!(parameter.group(), OTHER, "{}: add it to a group", parameter.name);
        }
        for (_, entries) in GROUPS {
            for entry in entries {
                let is_meant =
                    |name: &str| name == *entry || (entry.ends_with('.') && name.starts_with(entry));
                assert!(TABLE.iter().any(|parameter| is_meant(parameter.name)), "{entry} names no parameter");
            }
        }
    }
}
