//! Reads the open questions of a diagnosis from its JSON report.

use crate::settings::error::NodeError;
use mr_damper_model::diagnose::design::Question;
use mr_damper_reports::diagnosis::json::SCHEMA;
use serde::Deserialize;
use std::path::Path;

/// The parts of a report that a design needs.
#[derive(Debug, Deserialize)]
struct Report {
    schema: String,
    #[serde(default)]
    effects: Vec<Named>,
    #[serde(default)]
    refused: Vec<Refused>,
    #[serde(default)]
    untestable: Vec<Refused>,
    #[serde(default)]
    terms: Vec<serde_json::Value>,
    #[serde(default)]
    noise_floor: Floor,
}

#[derive(Debug, Default, Deserialize)]
struct Floor {
    /// Root mean square, N; `None` if it is unknown.
    rsse_n: Option<f64>,
}

/// The open questions of a report.
pub(super) struct Open {
    pub(super) question: Question,
    /// Noise floor of the diagnosis, N.
    pub(super) noise_n: Option<f64>,
    /// Remarks, one sentence each.
    pub(super) notes: Vec<String>,
}

#[derive(Debug, Deserialize)]
struct Named {
    class: Vec<String>,
}

#[derive(Debug, Deserialize)]
struct Refused {
    id: String,
    reason: Reason,
}

#[derive(Debug, Deserialize)]
struct Reason {
    code: String,
    /// Title of the other effect, with the code `other_removes_more`.
    other: Option<String>,
}

/// Reads the open questions of the report at `path`.
///
/// # Errors
/// When the file is not a report of a diagnosis, or the report leaves nothing open that a run could decide.
pub(super) fn read(path: &Path) -> Result<Open, NodeError> {
    let refuse = |message: String| NodeError::File { path: path.to_owned(), message };
    let text = std::fs::read_to_string(path).map_err(|error| refuse(error.to_string()))?;
    let report: Report = serde_json::from_str(&text).map_err(|error| {
        refuse(format!(
            "is not a report of mr-damper close ({error}): give the file that close wrote with --json"
        ))
    })?;
    if report.schema != SCHEMA {
        return Err(refuse(format!(
            "has the schema {}, not {SCHEMA}: give the file of close --json",
            report.schema
        )));
    }
    let Some((groups, notes)) = open(&report) else {
        return Err(refuse(
            "leaves nothing open that a run could decide: every named effect is alone in its class, and none is untestable; give --for"
                .to_owned(),
        ));
    };
    let noise_n = report.noise_floor.rsse_n.filter(|noise_n| *noise_n > 0.0);
    Ok(Open { question: Question::new(&groups)?, noise_n, notes })
}

/// The groups of effects that are open, with remarks: classes first, else refused effects with the effect that removes more, else
/// effects that the runs could neither show nor exclude.
fn open(report: &Report) -> Option<(Vec<Vec<String>>, Vec<String>)> {
    let mut notes = Vec::new();
    if !report.terms.is_empty() {
        notes.push("The report has discovered terms; a design does not separate these.".to_owned());
    }
    let classes: Vec<Vec<String>> =
        report.effects.iter().map(|named| &named.class).filter(|class| class.len() > 1).cloned().collect();
    let id = |title: &str| title.split(' ').next().unwrap_or_default().to_owned();
    let refused: Vec<Vec<String>> = report
        .refused
        .iter()
        .filter(|refused| refused.reason.code == "other_removes_more")
        .filter_map(|refused| Some(vec![id(refused.reason.other.as_deref()?), refused.id.clone()]))
        .filter(|pair| pair[0] != pair[1])
        .collect();
    let tested = ["not_excited", "not_identifiable", "too_few_blocks"];
    let untestable: Vec<Vec<String>> = report
        .untestable
        .iter()
        .filter(|refused| tested.contains(&refused.reason.code.as_str()))
        .map(|refused| vec![refused.id.clone()])
        .collect();
    let names =
        |groups: &[Vec<String>]| groups.iter().map(|ids| ids.join("|")).collect::<Vec<_>>().join(", ");
    let (what, groups, rest) = if !classes.is_empty() {
        ("the classes that the runs could not separate", classes, [refused, untestable].concat())
    } else if !refused.is_empty() {
        ("refused effects with the effect that removed more", refused, untestable)
    } else {
        ("effects that the runs could neither show nor exclude", untestable, Vec::new())
    };
    if groups.is_empty() {
        return None;
    }
    notes.push(format!("From the report: {what}."));
    if !rest.is_empty() {
        notes.push(format!(
            "The report also leaves open: {}. Give them with --for in another run.",
            names(&rest)
        ));
    }
    Some((groups, notes))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn groups(json: &str) -> Option<Vec<Vec<String>>> {
        open(&serde_json::from_str(json).expect("a report")).map(|(groups, _)| groups)
    }

    #[test]
    fn classes_come_before_refused_and_untestable_effects() {
        let of = |effects: &str, refused: &str, untestable: &str| {
            groups(&format!(
                r#"{{"schema": "{SCHEMA}", "effects": [{effects}], "refused": [{refused}], "untestable": [{untestable}]}}"#
            ))
        };
        let class = r#"{"id": "friction", "class": ["friction", "gas_spring"]}"#;
        let alone = r#"{"id": "friction", "class": ["friction"]}"#;
        let refused = r#"{"id": "inertia", "why": "", "reason": {"code": "other_removes_more", "other": "coil_lag (one_tau)", "share": 0.1}}"#;
        let small = r#"{"id": "inertia", "why": "", "reason": {"code": "too_small", "share": 0.1}}"#;
        let untestable =
            r#"{"id": "end_stop", "why": "", "reason": {"code": "not_excited", "change_n": 0.0}}"#;
        let excluded = r#"{"id": "end_stop", "why": "", "reason": {"code": "excluded"}}"#;
        assert_eq!(of(class, refused, untestable), Some(vec![vec!["friction".into(), "gas_spring".into()]]));
        assert_eq!(of(alone, refused, untestable), Some(vec![vec!["coil_lag".into(), "inertia".into()]]));
        assert_eq!(of(alone, small, untestable), Some(vec![vec!["end_stop".into()]]));
        assert_eq!(of(alone, small, excluded), None);
    }
}
