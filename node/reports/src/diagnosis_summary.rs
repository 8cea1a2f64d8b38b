//! Presents a running node's answer to `close_loop`: figures and an HTML page, made from the answer's JSON alone.

use super::diagnosis::pictures::{self, ParameterPicture, StructurePicture};
use super::diagnosis::words;
use super::page::{capital, page, section};
use super::table::table;
use maud::html;
use mr_damper_model::effect::Effect;
use mr_damper_model::effect::term::ID;
use mr_damper_model::metrics::Fit;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

/// An answer without the fields that a node of this version sends.
#[derive(Debug, thiserror::Error)]
#[error("cannot read the node's report: {0}; does the node have another version than this command?")]
pub struct UnreadableAnswer(serde_json::Error);

/// The fields of an answer that are presented.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct NodeAnswer {
    verdict: String,
    effects: Vec<AnswerEffect>,
    /// Missing in the answer of an older node.
    #[serde(default)]
    terms: Vec<AnswerTerm>,
    /// Missing in the answer of an older node.
    #[serde(default)]
    structures: Vec<AnswerStructure>,
    /// Missing in the answer of an older node.
    noise_floor: Option<AnswerFloor>,
    refused: Vec<AnswerRefusal>,
    untestable: Vec<AnswerRefusal>,
    test: Option<AnswerErrors>,
    confirm: Vec<AnswerErrors>,
    text: String,
    note: Option<String>,
    model_file: Option<String>,
    loaded: bool,
    load_error: Option<String>,
    seconds: f64,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct AnswerEffect {
    id: String,
    form: Option<String>,
    class: Vec<String>,
    parameters: BTreeMap<String, f64>,
    /// 95 % intervals, lower and upper end; an end that is not finite is null.
    ci95: BTreeMap<String, [Option<f64>; 2]>,
    p_adjusted: f64,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct AnswerTerm {
    modulator: String,
    argument: String,
    form: String,
    equation: String,
    sentence: String,
    class: Vec<[String; 2]>,
    p: f64,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct AnswerStructure {
    structure: String,
    given: bool,
    /// `null` for a structure that could not be used.
    alone_rsse_n: Option<f64>,
    rsse_n: Option<f64>,
    chosen: bool,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct AnswerFloor {
    rsse_n: Option<f64>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct AnswerRefusal {
    id: String,
    form: Option<String>,
    why: String,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct AnswerErrors {
    before: Fit,
    after: Fit,
}

/// The result of a diagnosis by a running node, in short.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DiagnosisSummary {
    /// The verdict's name.
    pub verdict: String,
    /// The finding, in sentences.
    pub says: String,
    /// The named effects, and the discovered terms.
    pub effects: Vec<EffectSummary>,
    /// Simulation errors before and after.
    pub errors: Vec<ErrorRow>,
    /// Effects that were refused or that these runs cannot test: title and reason.
    pub refused: Vec<[String; 2]>,
    /// Path of the model file on the node's machine.
    pub model_file: Option<String>,
    /// True when the node already runs the new model.
    pub loaded: bool,
    /// Why the node did not load the model although that was requested.
    pub load_error: Option<String>,
    /// The command line that loads the model; `None` when it is loaded already.
    pub load_line: Option<String>,
    /// A remark about the runs.
    pub note: Option<String>,
    /// The whole result, as `mr-damper close` prints it.
    pub text: String,
    /// Duration of the diagnosis, s.
    pub seconds: f64,
    /// The pictures of the report's page; the live page does not show them.
    #[serde(skip)]
    pictures: Pictures,
}

/// The numbers of the pictures of the report's page.
#[derive(Debug, Clone, Default, PartialEq)]
struct Pictures {
    parameters: Vec<ParameterPicture>,
    structures: Vec<StructurePicture>,
    noise_n: Option<f64>,
}

impl Pictures {
    fn of(answer: &NodeAnswer) -> Self {
        let parameters = |effect: &AnswerEffect| {
            let title = title(&effect.id, effect.form.as_deref());
            let one = |(name, value): (&String, &f64)| {
                let [low, high] = *effect.ci95.get(name)?;
                Some(ParameterPicture {
                    name: format!("{title}: {}", words::quantity(name, None).0),
                    value: *value,
                    // JSON has no infinite numbers: an end of null is open.
                    ci95: [low.unwrap_or(f64::NEG_INFINITY), high.unwrap_or(f64::INFINITY)],
                })
            };
            effect.parameters.iter().filter_map(one).collect::<Vec<_>>()
        };
        let structure = |row: &AnswerStructure| {
            let name = if row.given { format!("{} (given)", row.structure) } else { row.structure.clone() };
            Some(StructurePicture { name, rmse_n: [row.alone_rsse_n?, row.rsse_n?], is_chosen: row.chosen })
        };
        Self {
            parameters: answer.effects.iter().flat_map(parameters).collect(),
            structures: answer.structures.iter().filter_map(structure).collect(),
            noise_n: answer.noise_floor.as_ref().and_then(|floor| floor.rsse_n),
        }
    }
}

/// A named effect with its parameters as text, or a discovered term with its equation and what it does.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(missing_docs, reason = "the field names say it")]
pub struct EffectSummary {
    pub id: String,
    pub title: String,
    pub parameters: Vec<String>,
    pub chance: String,
    /// Ids of the effects that these runs cannot distinguish from it; for a term, its modulators and arguments.
    pub or: Vec<String>,
}

/// Simulation error on some runs before and after, and the share of the squared error that remains.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(missing_docs, reason = "the field names say it")]
pub struct ErrorRow {
    pub runs: &'static str,
    pub before: Fit,
    pub after: Fit,
    pub left: String,
}

impl DiagnosisSummary {
    /// Reads `report`, the JSON of a node's answer. `load_line` is the command line that loads its model.
    ///
    /// # Errors
    /// When the JSON does not have the fields that a node of this version sends.
    pub fn of(report: &Value, load_line: Option<String>) -> Result<Self, UnreadableAnswer> {
        let answer = NodeAnswer::deserialize(report).map_err(UnreadableAnswer)?;
        let test = answer.test.iter().map(|test| row("sealed part", test.before, test.after));
        let confirm = answer.confirm.iter().map(|errors| row("confirm part", errors.before, errors.after));
        let refused = answer.refused.iter().chain(&answer.untestable);
        let pictures = Pictures::of(&answer);
        Ok(Self {
            pictures,
            says: first_paragraphs(&answer.text),
            effects: answer.effects.iter().map(named).chain(answer.terms.iter().map(discovered)).collect(),
            errors: test.chain(confirm).collect(),
            refused: refused
                .map(|refused| [title(&refused.id, refused.form.as_deref()), refused.why.clone()])
                .collect(),
            load_line: load_line.filter(|_| !answer.loaded),
            verdict: answer.verdict,
            model_file: answer.model_file,
            loaded: answer.loaded,
            load_error: answer.load_error,
            note: answer.note,
            text: answer.text,
            seconds: answer.seconds,
        })
    }

    /// The HTML page for the damper named `damper`, made on `date`.
    #[must_use]
    pub fn html(&self, damper: &str, date: &str) -> String {
        let effects: Vec<Vec<String>> = self.effects.iter().map(effect_cells).collect();
        let errors: Vec<Vec<String>> = self.errors.iter().map(error_cells).collect();
        let refused: Vec<Vec<String>> = self.refused.iter().map(|row| row.to_vec()).collect();
        let confounded: Vec<Vec<String>> = self.effects.iter().flat_map(separating).collect();
        let body = html! {
            p { strong { (self.says) } }
            @if !effects.is_empty() {
                (section("Named", &html! {
                    (table(&["=effect", "value and 95 % interval", "=chance", "cannot be distinguished from"], &effects))
                    (pictures::intervals(&self.pictures.parameters))
                }))
            }
            @if !confounded.is_empty() {
                (section("Excitation that separates confounded effects",
                    &table(&["=named", "=effect", "excitation that shows or excludes it"], &confounded)))
            }
            @if !self.pictures.structures.is_empty() {
                (section("Structures of the base", &pictures::ladder(&self.pictures.structures, self.pictures.noise_n)))
            }
            @if !errors.is_empty() {
                (section("Simulation error, without each run's mean",
                    &table(&["=runs", "#RMSE before, N", "#after, N", "#NMSE before", "#after", "#squared error left"], &errors)))
            }
            (section("The model", &html! {
                @match &self.model_file {
                    None => p { "No effect was found, so no model file was written." },
                    Some(path) => {
                        p { "The augmented model, on the node's machine: " code { (path) } }
                        @if self.loaded { p { "The node runs it." } }
                        @if let Some(why) = &self.load_error { p { "The node did not load it: " (why) } }
                        @if let Some(line) = &self.load_line { p { "To load it: " code { (line) } } }
                    },
                }
            }))
            @if !refused.is_empty() {
                (section("Refused, or not testable with these runs", &table(&["=effect", "why"], &refused)))
            }
            (section("Full text", &html! { div.scroll { pre { (self.text) } } }))
            @if let Some(note) = &self.note { p { (capital(note)) "." } }
        };
        let lead = format!("{date}, from the running node's history, in {:.1} s.", self.seconds);
        page(&format!("Diagnosis of the model of {damper}"), &lead, &body)
    }
}

fn row(runs: &'static str, before: Fit, after: Fit) -> ErrorRow {
    ErrorRow { runs, before, after, left: words::percent((after.rsse_n / before.rsse_n).powi(2)) }
}

fn title(id: &str, form: Option<&str>) -> String {
    let name = id.replace('_', " ");
    form.map_or_else(|| name.clone(), |form| format!("{name} ({form})"))
}

fn named(effect: &AnswerEffect) -> EffectSummary {
    let parameters = effect.parameters.iter().map(|(name, value)| {
        let (stem, unit) = match name.strip_suffix("_drive") {
            // The answer does not say which of the two units applies.
            Some(stem) => (stem.replace('_', " "), "A or V, as the drive"),
            None => words::quantity(name, None),
        };
        let value = format!("{stem} = {} {unit}", words::figure(*value));
        match effect.ci95.get(name) {
            Some([low, high]) => {
                let end = |end: &Option<f64>| end.map_or_else(|| "?".to_owned(), words::figure);
                format!("{}, 95 %: {} to {}", value.trim_end(), end(low), end(high))
            }
            None => value.trim_end().to_owned(),
        }
    });
    EffectSummary {
        id: effect.id.clone(),
        title: title(&effect.id, effect.form.as_deref()),
        parameters: parameters.collect(),
        chance: words::chance(effect.p_adjusted),
        or: effect.class.iter().filter(|id| **id != effect.id).cloned().collect(),
    }
}

fn discovered(term: &AnswerTerm) -> EffectSummary {
    EffectSummary {
        id: ID.to_owned(),
        title: format!("{ID} ({}, {}, {})", term.modulator, term.argument, term.form),
        parameters: vec![term.equation.clone(), term.sentence.clone()],
        chance: words::chance(term.p),
        or: term.class.iter().map(|[modulator, argument]| format!("({modulator}, {argument})")).collect(),
    }
}

/// The excitation that shows or excludes an effect, and the same for each effect that these runs cannot distinguish from it.
fn separating(named: &EffectSummary) -> Vec<Vec<String>> {
    if named.or.is_empty() {
        return Vec::new();
    }
    let known = |id: &String| Effect::ALL.into_iter().find(|effect| effect.id() == *id);
    std::iter::once(&named.id)
        .chain(&named.or)
        .filter_map(known)
        .map(|effect| {
            vec![named.title.clone(), effect.id().replace('_', " "), effect.separated_by().to_owned()]
        })
        .collect()
}

fn effect_cells(effect: &EffectSummary) -> Vec<String> {
    let or = if effect.or.is_empty() { "–".to_owned() } else { effect.or.join(", ").replace('_', " ") };
    vec![effect.title.clone(), effect.parameters.join("; "), effect.chance.clone(), or]
}

fn error_cells(row: &ErrorRow) -> Vec<String> {
    let force = |fit: &Fit| format!("{:.2}", fit.rsse_n);
    let esr = |fit: &Fit| words::figure(fit.esr);
    vec![
        row.runs.to_owned(),
        force(&row.before),
        force(&row.after),
        esr(&row.before),
        esr(&row.after),
        row.left.clone(),
    ]
}

/// The text before the first blank line, on one line.
fn first_paragraphs(text: &str) -> String {
    let lead = text.split("\n\n").next().unwrap_or_default();
    lead.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer() -> Value {
        let fit = |rsse_n: f64, esr: f64| serde_json::json!({"rsse_n": rsse_n, "esr": esr, "samples": 100});
        serde_json::json!({
            "schema": "mr-damper/close/1", "verdict": "explained", "seconds": 2.5, "loaded": false, "load_error": null,
            "note": "the runs are parts of one recording", "model_file": "/tmp/new.toml",
            "text": "Explained: coil_lag accounts for\n  nearly all of it.\n\nNamed\n  coil_lag: <b>a lag</b>\n",
            "effects": [{"id": "coil_lag", "class": ["coil_lag", "delay"], "parameters": {"tau_s": 0.0121},
                "ci95": {"tau_s": [0.0119, 0.0123]}, "p_adjusted": 1e-9, "range": {}, "share_removed": 0.97}],
            "refused": [{"id": "inertia", "why": "confirm run 2 got worse"}], "untestable": [],
            "test": {"before": fit(31.0, 0.0063), "after": fit(5.2, 0.00018)}, "confirm": [],
        })
    }

    #[test]
    fn an_answer_is_shown_with_its_figures_and_its_markup_is_escaped() {
        let summary =
            DiagnosisSummary::of(&answer(), Some("ros2 service call".to_owned())).expect("a good answer");
        assert_eq!(summary.says, "Explained: coil_lag accounts for nearly all of it.");
        assert_eq!(summary.effects[0].parameters, ["tau = 0.0121 s, 95 %: 0.0119 to 0.0123"]);
        assert_eq!(
            (summary.effects[0].title.as_str(), summary.effects[0].or.as_slice()),
            ("coil lag", &["delay".to_owned()][..])
        );
        assert_eq!(summary.errors[0].left, "2.8 %");
        assert_eq!(summary.refused, [["inertia".to_owned(), "confirm run 2 got worse".to_owned()]]);
        let page = summary.html("<left>", "today");
        for part in [
            "&lt;left&gt;",
            "tau = 0.0121 s",
            "31.00",
            "ros2 service call",
            "&lt;b&gt;a lag",
            "confirm run 2",
        ] {
            assert!(page.contains(part), "{part} in {page}");
        }
        assert!(!page.contains("<b>") && !page.contains("http"), "{page}");
    }

    #[test]
    fn the_page_has_pictures_and_says_what_would_separate_confounded_effects() {
        let mut whole = answer();
        whole["effects"][0]["class"] = serde_json::json!(["coil_lag", "force_lag"]);
        whole["noise_floor"] = serde_json::json!({"source": "replicates", "rsse_n": 4.0, "esr": 1e-4});
        whole["structures"] = serde_json::json!([
            {"structure": "linear", "given": true, "alone_rsse_n": 60.0, "rsse_n": 40.0, "chosen": false},
            {"structure": "li", "given": false, "alone_rsse_n": 31.0, "rsse_n": 5.2, "chosen": true},
            {"structure": "kwok", "given": false, "alone_rsse_n": null, "rsse_n": null, "chosen": false},
        ]);
        let page = DiagnosisSummary::of(&whole, None).expect("a good answer").html("left", "today");
        for part in [
            ">coil lag: tau<",
            ">linear (given)<",
            "Excitation that separates confounded effects",
            Effect::ForceLag.separated_by(),
        ] {
            assert!(page.contains(part), "{part} in {page}");
        }
        // The structure that failed has no row.
        assert_eq!((page.matches("<svg").count(), page.matches("<circle").count()), (2, 1 + 4));
        let plain = DiagnosisSummary::of(&answer(), None).expect("a good answer").html("left", "today");
        assert!(!plain.contains("Structures of the base"), "an older node sends no structures");
    }

    #[test]
    fn a_term_is_shown_beside_the_effects_and_an_older_node_has_none() {
        let mut with_term = answer();
        with_term["terms"] = serde_json::json!([{
            "modulator": "force", "argument": "time", "form": "step", "amount": -0.126, "equation": "F' = F (1 - 0.126 H(t - 11.5 s))",
            "sentence": "The force falls by 12.6 %.", "class": [["force", "path"]], "p": 0.002,
        }]);
        let of = |answer: &Value| DiagnosisSummary::of(answer, None).expect("a good answer").effects;
        assert_eq!(of(&answer()).len(), 1);
        let [_, term] = &of(&with_term)[..] else { panic!("an effect and a term") };
        assert_eq!(term.title, "term (force, time, step)");
        assert_eq!(term.parameters, ["F' = F (1 - 0.126 H(t - 11.5 s))", "The force falls by 12.6 %."]);
        assert_eq!(
            (term.chance.as_str(), term.or.as_slice()),
            ("p = 0.00200", &["(force, path)".to_owned()][..])
        );
    }

    #[test]
    fn a_loaded_model_has_no_load_line_and_a_malformed_answer_is_an_error() {
        let mut in_force = answer();
        in_force["loaded"] = true.into();
        let summary = DiagnosisSummary::of(&in_force, Some("line".to_owned())).expect("a good answer");
        assert_eq!(summary.load_line, None);
        assert!(summary.html("left", "today").contains("The node runs it."));
        let refused = DiagnosisSummary::of(&serde_json::json!({"verdict": "explained"}), None)
            .expect_err("fields are missing")
            .to_string();
        assert!(refused.contains("missing field") && refused.contains("another version"), "{refused}");
    }
}
