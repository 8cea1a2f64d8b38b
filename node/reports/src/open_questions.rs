//! The questions that a diagnosis left open, from its JSON report.

use crate::diagnosis::json::SCHEMA;
use mr_damper_model::diagnose::design::Question;
use serde::Deserialize;

/// Reasons why a text has no open questions.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenQuestionsError {
    /// The text is not the JSON of a report.
    #[error("is not a report of mr-damper close ({0}): give what close wrote with --json")]
    NotAReport(#[source] serde_json::Error),
    /// The report has another schema.
    #[error("has the schema {found}, not {SCHEMA}: give what close wrote with --json")]
    Schema {
        /// Its schema.
        found: String,
    },
    /// The report leaves nothing open.
    #[error(
        "leaves nothing open that a run could decide: every named effect is alone in its class, and none is untestable; name the effects to \
         tell apart"
    )]
    NothingOpen,
    /// A name in the report is none of an effect.
    #[error(transparent)]
    Question(#[from] mr_damper_model::Error),
}

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
#[derive(Debug, Clone)]
pub struct OpenQuestions {
    /// The groups of effects that are open.
    pub question: Question,
    /// Noise floor of the diagnosis, N (root mean square); `None` if it is unknown.
    pub noise_n: Option<f64>,
    /// Remarks, one sentence each.
    pub notes: Vec<String>,
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

impl OpenQuestions {
    /// Those of the report with this JSON.
    ///
    /// # Errors
    /// When `text` is not a report of a diagnosis, or the report leaves nothing open that a run could decide.
    pub fn of_report(text: &str) -> Result<Self, OpenQuestionsError> {
        let report: Report = serde_json::from_str(text).map_err(OpenQuestionsError::NotAReport)?;
        if report.schema != SCHEMA {
            return Err(OpenQuestionsError::Schema { found: report.schema });
        }
        let (groups, notes) = open(&report).ok_or(OpenQuestionsError::NothingOpen)?;
        let noise_n = report.noise_floor.rsse_n.filter(|noise_n| *noise_n > 0.0);
        Ok(Self { question: Question::new(&groups)?, noise_n, notes })
    }

    /// `question`, asked without a report.
    #[must_use]
    pub const fn asked(question: Question) -> Self {
        Self { question, noise_n: None, notes: Vec::new() }
    }

    /// The noise for a design, N: `given`, or else the noise floor of the report, which is then noted.
    pub fn noise(&mut self, given: Option<f64>) -> Option<f64> {
        if let (None, Some(noise_n)) = (given, self.noise_n) {
            self.notes.push(format!("Noise: the noise floor of the report, {noise_n:.2} N."));
        }
        given.or(self.noise_n)
    }
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
