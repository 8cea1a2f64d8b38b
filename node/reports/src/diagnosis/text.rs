//! A diagnosis as text for a terminal. Lines have at most 110 columns unless names of runs are long.

use super::{terms, words};
use mr_damper_model::diagnose::discover::FoundTerm;
use mr_damper_model::diagnose::{DiagnosisResult, NamedEffect, Refusal};
use mr_damper_model::effect::Effect;
use mr_damper_model::metrics::Fit;
use mr_damper_model::sample::DriveKind;
use std::fmt::Write;

/// Columns of a line.
const WIDTH: usize = 110;

/// The whole result: what was found and how certain it is, errors, refused effects, and the remaining error.
#[must_use]
pub fn text(result: &DiagnosisResult, drive: Option<DriveKind>) -> String {
    let mut text = short(result, drive);
    structures(&mut text, result);
    if let Some(searched) = words::searched(result) {
        text.push('\n');
        paragraph(&mut text, 0, &searched);
    }
    errors(&mut text, result);
    reasons(&mut text, "Refused", words::refused(result).into_iter().map(|r| (r.effect, &r.why)));
    if let Some(refused) = &result.discovery.refused {
        text += "\nBest term that was not accepted\n";
        paragraph(&mut text, 2, &terms::refused(refused, drive));
    }
    let untestable = words::untestable(result);
    reasons(&mut text, "Not testable with these runs", untestable.into_iter().map(|r| (r.effect, &r.why)));
    let searched = words::not_named(result);
    for (heading, titles) in [(words::NOT_NAMED, searched), (words::EXCLUDED, words::excluded(result))] {
        if !titles.is_empty() {
            let _ = writeln!(text, "\n{heading}");
            paragraph(&mut text, 2, &titles.join(", "));
        }
    }
    remaining_error(&mut text, result);
    if let Some(range) = words::swept_range(result) {
        text.push('\n');
        paragraph(&mut text, 0, &range);
    }
    alignments(&mut text, result);
    text
}

/// The verdict, the proof on the test runs, the named effects, the discovered terms, and a hum.
#[must_use]
pub fn short(result: &DiagnosisResult, drive: Option<DriveKind>) -> String {
    let mut text = String::new();
    paragraph(&mut text, 0, &words::verdict(result));
    words::other_base(result).into_iter().for_each(|remark| paragraph(&mut text, 0, &remark));
    let remarks = [words::next_step(result), words::paired(result.mode)];
    remarks.into_iter().flatten().for_each(|remark| paragraph(&mut text, 0, remark));
    words::mean_shift(result).into_iter().for_each(|shift| paragraph(&mut text, 0, &shift));
    if result.is_augmented() {
        paragraph(&mut text, 0, &words::proof(result.test.as_ref()));
    }
    words::swept_fault(result).into_iter().for_each(|fault| paragraph(&mut text, 0, &fault));
    if !result.effects.is_empty() {
        text += "\nNamed\n";
        for named in &result.effects {
            effect(&mut text, named, drive);
        }
    }
    if !result.discovery.terms.is_empty() {
        let _ = writeln!(text, "\n{}", terms::HEADING);
        for found in &result.discovery.terms {
            term(&mut text, found, drive);
        }
    }
    if let Some(hum) = &result.discovery.hum {
        let _ = writeln!(text, "\n{}", terms::HUM);
        let [what, evidence, hypothesis] = terms::hum(hum);
        paragraph(&mut text, 2, &what);
        paragraph(&mut text, 4, &evidence);
        paragraph(&mut text, 4, &hypothesis);
    }
    text
}

/// Appends `line`, wrapped between words. The first line is indented by `indent`, continuation lines by two more.
pub(crate) fn paragraph(text: &mut String, indent: usize, line: &str) {
    let mut column = 0;
    for word in line.split_whitespace() {
        let length = word.chars().count();
        if column == 0 {
            let _ = write!(text, "{:indent$}{word}", "");
            column = indent + length;
        } else if column + 1 + length <= WIDTH {
            let _ = write!(text, " {word}");
            column += 1 + length;
        } else {
            let _ = write!(text, "\n{:1$}{word}", "", indent + 2);
            column = indent + 2 + length;
        }
    }
    text.push('\n');
}

fn effect(text: &mut String, named: &NamedEffect, drive: Option<DriveKind>) {
    let what = named.effect.effect().what();
    paragraph(text, 2, &format!("{}: {what}", words::title(&named.effect)));
    for found in &named.parameters {
        paragraph(text, 4, &words::parameter(found, drive));
    }
    let line = format!(
        "{}, corrected for all effects that were tried; removes {} of the reducible error on the training runs and {} of the squared error \
         on the validation runs",
        words::chance(named.p_adjusted),
        words::percent(named.share_removed),
        words::percent(named.confirmed)
    );
    paragraph(text, 4, &line);
    words::since_healthy(named, drive).into_iter().for_each(|since| paragraph(text, 4, &since));
    if let Some((others, settles)) = words::class(named) {
        paragraph(
            text,
            4,
            &format!("or one of {others}: these runs cannot distinguish them. Excitation that would:"),
        );
        for (id, excitation) in settles {
            paragraph(text, 6, &format!("{id}: {excitation}"));
        }
    }
}

fn term(text: &mut String, found: &FoundTerm, drive: Option<DriveKind>) {
    let (term, unit) = (&found.term, words::drive_unit(drive));
    paragraph(text, 2, &format!("{}: {}", words::term_title(term), term.equation(unit)));
    paragraph(text, 4, &term.sentence(unit));
    for number in terms::numbers(term, &found.ci95, drive) {
        paragraph(text, 4, &number.in_words());
    }
    for line in
        [terms::confirmed(term, drive), terms::claim(found.claim, term.in_library()), terms::evidence(found)]
    {
        paragraph(text, 4, &line);
    }
    if let Some(others) = terms::class(found) {
        paragraph(text, 4, &format!("or one of {others}: these runs cannot distinguish them"));
    }
    let hypotheses = found.hypotheses();
    if !hypotheses.is_empty() {
        paragraph(text, 4, &format!("{}:", terms::HYPOTHESES));
    }
    for hypothesis in hypotheses {
        paragraph(text, 6, &format!("{}; to test it: {}", hypothesis.cause, hypothesis.test));
    }
}

fn structures(text: &mut String, result: &DiagnosisResult) {
    if result.structures.is_empty() {
        return;
    }
    let _ = writeln!(text, "\n{}", words::STRUCTURES);
    for row in &result.structures {
        paragraph(text, 2, &format!("{} {}", words::structure_name(row), words::structure(row)));
    }
}

fn errors(text: &mut String, result: &DiagnosisResult) {
    let mut rows: Vec<(String, &Fit, &Fit)> = Vec::new();
    if let Some(test) = &result.test {
        rows.push(("test runs".to_owned(), &test.before, &test.after));
        rows.extend(test.runs.iter().map(|c| (format!("  {}", c.run), &c.before, &c.after)));
    }
    let confirm = (1..).zip(&result.confirm);
    rows.extend(confirm.map(|(place, c)| (format!("validation {place}: {}", c.run), &c.before, &c.after)));
    let Some(width) = rows.iter().map(|(name, ..)| name.chars().count()).max() else { return };
    let _ = writeln!(
        text,
        "\nSimulation error without each run's mean: RMSE, NMSE, and the share of the squared error that is left"
    );
    let _ = writeln!(text, "  {:<width$}  {:>30}  {:>30}  {:>7}", "", "before", "after", "left");
    for (name, before, after) in rows {
        let left = words::percent((after.rsse_n / before.rsse_n).powi(2));
        let _ = writeln!(text, "  {name:<width$}  {}  {}  {left:>7}", fit(before), fit(after));
    }
}

fn fit(fit: &Fit) -> String {
    let esr = if fit.esr < 1e-3 { format!("{:8.1e}", fit.esr) } else { format!("{:8.5}", fit.esr) };
    format!("{:>21} {esr}", words::force(fit.rsse_n))
}

fn reasons<'a>(text: &mut String, heading: &str, rows: impl Iterator<Item = (Effect, &'a Refusal)>) {
    let mut rows = rows.peekable();
    if rows.peek().is_some() {
        let _ = writeln!(text, "\n{heading}");
    }
    for (effect, why) in rows {
        paragraph(text, 2, &format!("{}: {why}", effect.title()));
    }
}

fn alignments(text: &mut String, result: &DiagnosisResult) {
    if !result.alignments.is_empty() {
        text.push_str("\nAlignment with the reference runs\n");
    }
    for alignment in &result.alignments {
        paragraph(text, 2, &words::alignment(alignment));
    }
}

fn remaining_error(text: &mut String, result: &DiagnosisResult) {
    let left = &result.remaining;
    text.push_str("\nRemaining error\n");
    let line = format!(
        "lack of fit {} (base alone {}); {}; {} blocks",
        words::figure(left.lof),
        words::figure(left.lof_before),
        words::noise_floor(&result.noise_floor),
        result.blocks
    );
    paragraph(text, 2, &line);
    let with: Vec<String> =
        left.correlates_with.iter().map(|c| format!("{} {:+.2}", c.with, c.coefficient)).collect();
    let line = if with.is_empty() {
        "it correlates with no measured signal beyond chance".to_owned()
    } else {
        format!("it correlates with {}", with.join(", "))
    };
    paragraph(text, 2, &line);
}
