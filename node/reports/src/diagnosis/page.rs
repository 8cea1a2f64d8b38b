//! The report of a diagnosis as one HTML file.

use super::pictures::{self, ParameterPicture, StructurePicture};
use super::plots::ResidualPlots;
use super::traces::RunTrace;
use super::{terms, words};
use crate::page::{capital, page, section};
use crate::table::{bars, facts, table};
use maud::{Markup, html};
use mr_damper_model::diagnose::{
    Candidate, DiagnosisResult, FoundParameter, NamedEffect, RefusedEffect, Settings, StructureRow,
    TestResult, Verdict,
};
use mr_damper_model::metrics::Fit;
use mr_damper_model::sample::DriveKind;

/// Everything the report shows.
#[derive(Debug, Clone)]
pub struct DiagnosisOutcome<'a> {
    /// Base model and runs, in a sentence.
    pub what: String,
    /// The result of the diagnosis.
    pub result: &'a DiagnosisResult,
    /// Kind of drive in the runs.
    pub drive: Option<DriveKind>,
    /// Residuals of the test runs before and after; without test runs, of the validation runs (`--confirm`).
    pub traces: Vec<RunTrace>,
    /// Names and values that say how the report was made (tool version, seed, files).
    pub provenance: Vec<(String, String)>,
}

/// The report as one HTML file.
#[must_use]
pub fn html(outcome: &DiagnosisOutcome<'_>) -> String {
    let result = outcome.result;
    let plots = ResidualPlots { runs: &outcome.traces, named: result.is_augmented() };
    let body = html! {
        (summary(result))
        (section("What was found", &found(result, outcome.drive)))
        @if let Some(confounded) = confounded(result) { (section("Excitation that separates confounded effects", &confounded)) }
        @if !result.structures.is_empty() { (section("Structures of the base", &structures(result))) }
        (section("Error before and after", &errors(result)))
        (section("What each effect explains", &rounds(result)))
        (section("Refused, and not testable", &reasons(result, outcome.drive)))
        (section("Remaining error", &remaining_error(result)))
        @if let Some(range) = words::swept_range(result) { (section("Beyond the runs", &html! { p { (range) } })) }
        @if !result.alignments.is_empty() {
            (section("Alignment with the reference runs", &html! {
                ul { @for alignment in &result.alignments { li { (words::alignment(alignment)) } } }
            }))
        }
        @if result.test.is_none() {
            p.verdict.bad { "Without test runs the pictures below are of the confirm runs (validation runs), which decided on the effects." }
        }
        (plots.sections())
        (section("Provenance", &facts(&outcome.provenance)))
    };
    page("MR damper: diagnosis of the model", &outcome.what, &body)
}

fn summary(result: &DiagnosisResult) -> Markup {
    let proved = result.test.as_ref().is_some_and(TestResult::proves);
    let settled = matches!(result.verdict, Verdict::NothingToExplain | Verdict::Explained);
    html! {
        p.verdict.bad[!settled] {
            (words::verdict(result))
            @if let Some(other) = words::other_base(result) { " " (other) }
            @if let Some(next) = words::next_step(result) { " " (next) }
        }
        @if let Some(paired) = words::paired(result.mode) {
            p { (paired) " In the pictures " em { "before" } " is the healthy run's force, and " em { "after" } " is that force with the effects." }
        }
        @if let Some(shift) = words::mean_shift(result) { p { (shift) } }
        @if result.is_augmented() { p.verdict.bad[!proved] { (words::proof(result.test.as_ref())) } }
        @if let Some(fault) = words::swept_fault(result) { p.verdict.bad { (fault) } }
    }
}

pub(crate) fn found(result: &DiagnosisResult, drive: Option<DriveKind>) -> Markup {
    let columns = [
        "effect",
        "=parameter",
        "#95 %",
        "#physical range",
        "#p",
        "#removed, training",
        "#removed, validation",
    ];
    let rows: Vec<Vec<String>> = result.effects.iter().flat_map(|named| parameters(named, drive)).collect();
    html! {
        @if result.effects.is_empty() {
            p { "No effect of the library was named." }
        } @else {
            div.named { (table(&columns, &rows)) }
            (pictures::intervals(&intervals(result, drive)))
            ul { @for named in &result.effects { li { (sentence(named, drive)) } } }
            p.lead { "Intervals come from blocks of seconds that are left out in turn, because neighbouring samples are not independent; p is "
                "corrected for all effects that were tried. " em { "Removed, training" } " is the share of the reducible error (above the noise "
                "floor) on the training runs, " em { "removed, validation" } " the mean share of the squared error on the validation runs." }
        }
        (terms::markup(&result.discovery, drive))
    }
}

fn intervals(result: &DiagnosisResult, drive: Option<DriveKind>) -> Vec<ParameterPicture> {
    let of = |named: &NamedEffect| {
        let title = words::title(&named.effect);
        let one = |found: &FoundParameter| {
            let (name, _) = words::quantity(found.name, drive);
            ParameterPicture { name: format!("{title}: {name}"), value: found.value, ci95: found.ci95 }
        };
        named.parameters.iter().map(one).collect::<Vec<_>>()
    };
    result.effects.iter().flat_map(of).collect()
}

/// One row per parameter; cells that belong to the effect as a whole are filled in its first row only.
fn parameters(named: &NamedEffect, drive: Option<DriveKind>) -> Vec<Vec<String>> {
    let row = |(index, found): (usize, &FoundParameter)| {
        let (name, unit) = words::quantity(found.name, drive);
        let [low, high] = found.ci95.map(words::figure);
        let [from, to] = found.range.map(words::round);
        let once = |text: String| if index == 0 { text } else { String::new() };
        vec![
            once(words::title(&named.effect)),
            format!("{name} = {} {unit}", words::figure(found.value)),
            format!("{low} to {high}"),
            format!("{from} to {to}"),
            once(words::p_value(named.p_adjusted)),
            once(words::percent(named.share_removed)),
            once(words::percent(named.confirmed)),
        ]
    };
    named.parameters.iter().enumerate().map(row).collect()
}

/// Describes the effect, says whether it is new, and names the effects that the runs cannot distinguish from it.
fn sentence(named: &NamedEffect, drive: Option<DriveKind>) -> Markup {
    html! {
        b { (words::title(&named.effect)) } ": " (named.effect.effect().what()) "."
        @if let Some(since) = words::since_healthy(named, drive) { " " (capital(&since)) "." }
        @if let Some((others, _)) = words::class(named) {
            " These runs cannot tell it from " (others) "; the section below says which excitation would."
        }
    }
}

/// The excitation that separates effects that these runs cannot distinguish; `None` without such effects.
fn confounded(result: &DiagnosisResult) -> Option<Markup> {
    let of = |named: &NamedEffect| {
        let (others, settles) = words::class(named)?;
        let title = words::title(&named.effect);
        let row = |(index, (id, excitation)): (usize, (String, &str))| {
            let once = |text: &str| if index == 0 { text.to_owned() } else { String::new() };
            vec![once(&title), once(&others), id, excitation.to_owned()]
        };
        Some(settles.into_iter().enumerate().map(row).collect::<Vec<_>>())
    };
    let rows: Vec<Vec<String>> = result.effects.iter().filter_map(of).flatten().collect();
    (!rows.is_empty()).then(|| {
        html! {
            p { "Each group of effects leaves the same trace in these runs. Record a run with the excitation in the last column, and "
                "diagnose again with it." }
            (table(&["named", "cannot be told from", "=effect", "excitation that shows or excludes it"], &rows))
        }
    })
}

fn structures(result: &DiagnosisResult) -> Markup {
    let columns = ["structure", "result"];
    let rows: Vec<Vec<String>> =
        result.structures.iter().map(|row| vec![words::structure_name(row), words::structure(row)]).collect();
    html! {
        p { (words::STRUCTURES) "." }
        (pictures::ladder(&ladder(result), result.noise_floor.is_known().then_some(result.noise_floor.rsse_n)))
        (table(&columns, &rows))
    }
}

fn ladder(result: &DiagnosisResult) -> Vec<StructurePicture> {
    let of = |row: &StructureRow| {
        let fit = row.outcome.as_ref().ok()?;
        Some(StructurePicture {
            name: words::structure_name(row),
            rmse_n: [fit.alone_rsse_n, fit.rsse_n],
            is_chosen: fit.chosen,
        })
    };
    result.structures.iter().filter_map(of).collect()
}

fn errors(result: &DiagnosisResult) -> Markup {
    let row = |name: &str, role: &str, before: &Fit, after: &Fit, interval: String| {
        let left = words::percent((after.rsse_n / before.rsse_n).powi(2));
        let mut row = vec![words::file_name(name), role.to_owned(), left, interval];
        for fit in [before, after] {
            row.push(format!("{:.2}", fit.rsse_n));
            row.push(words::figure(fit.esr));
        }
        row
    };
    let mut rows = Vec::new();
    if let Some(test) = &result.test {
        let interval = test.ratio_ci95.map_or_else(|_| "none".to_owned(), words::percents);
        rows.push(row("all test runs", "sealed", &test.before, &test.after, interval));
        rows.extend(test.runs.iter().map(|c| row(&c.run, "sealed", &c.before, &c.after, String::new())));
    }
    rows.extend(result.confirm.iter().map(|c| row(&c.run, "confirm", &c.before, &c.after, String::new())));
    let columns =
        ["run", "", "#squared error left", "#95 %", "#before: RMSE, N", "#NMSE", "#after: RMSE, N", "#NMSE"];
    html! {
        (table(&columns, &rows))
        p { "Roles: \"sealed\" is a test run (--test, read once), \"confirm\" a validation run. The models are simulated from displacement and "
            "drive, without the measured force; each run's mean error is subtracted. RMSE is the root mean squared error; NMSE is its "
            "square over the variance of the measured force. The interval is from a t test \
             on sums over blocks." }
        p { (capital(&words::noise_floor(&result.noise_floor))) "." }
        @if let Some(searched) = words::searched(result) { p { (searched) } }
    }
}

fn rounds(result: &DiagnosisResult) -> Markup {
    let last = result.candidates.iter().map(|candidate| candidate.round).max().unwrap_or(0);
    let of = |round: usize| {
        let mut all: Vec<&Candidate> = result.candidates.iter().filter(|c| c.round == round).collect();
        let explains = |c: &Candidate| c.removes.unwrap_or(f64::NEG_INFINITY).max(c.promises);
        all.sort_by(|a, b| explains(b).total_cmp(&explains(a)));
        all
    };
    html! {
        @if last == 0 {
            p { "No effect was tried." }
        } @else {
            p { "Shares of the reducible error (above the noise floor). " em { "Promises" } ": predicted from the effect's score, linearised; "
                em { "removes" } ": found by a joint refit of base and effect. " em { "Identifiable share" } ": the part of the effect's score "
                "that neither the base nor the effects already in the model can reproduce." }
            p.legend {
                span { i.key style="background:var(--soft);opacity:.55" {} "promises" }
                span { i.key style="background:var(--estimate)" {} "removes" }
            }
            @for round in 1..=last { h3 { "Round " (round) } (one_round(&of(round), result)) }
        }
    }
}

/// The candidates of a round: the significant ones, and the others in a collapsed section.
fn one_round(all: &[&Candidate], result: &DiagnosisResult) -> Markup {
    let (significant, others): (Vec<&Candidate>, Vec<&Candidate>) =
        all.iter().partition(|c| is_significant(c));
    html! {
        @if significant.is_empty() { p { "No effect has a significant score." } } @else { (candidates(&significant, result)) }
        @if !others.is_empty() {
            details {
                summary { (others.len()) " more that may be chance" }
                (candidates(&others, result))
            }
        }
    }
}

fn is_significant(candidate: &Candidate) -> bool {
    candidate.p_adjusted <= Settings::default().significance
}

fn candidates(all: &[&Candidate], result: &DiagnosisResult) -> Markup {
    html! {
        div.scroll { table.shares {
            thead { tr {
                th { "effect" } th.num { "identifiable share" } th.num { "p" } th.num { "promises" } th.num { "removes" } th {} th { "outcome" }
            } }
            tbody { @for candidate in all { tr {
                td.keep { (candidate.effect.title()) }
                td.num { (words::percent(candidate.identifiable)) }
                td.num { (words::p_value(candidate.p_adjusted)) }
                td.num { (words::percent(candidate.promises)) }
                td.num { (candidate.removes.map_or("–".to_owned(), words::percent)) }
                td.bar {
                    (share("promise", candidate.promises))
                    (share("remove", candidate.removes.unwrap_or(0.0)))
                }
                td.keep { (became(candidate, result)) }
            } } }
        } }
    }
}

fn share(class: &str, share: f64) -> Markup {
    let width = 100.0 * if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
    html! { div.share { i class=(class) style=(format!("width:{width:.1}%")) {} } }
}

/// Outcome for a candidate in its round.
fn became(candidate: &Candidate, result: &DiagnosisResult) -> &'static str {
    let forms = [Some(candidate.effect), candidate.effect.refined()];
    let named = result.effects.iter().any(|named| forms.contains(&Some(named.effect.effect())));
    // An effect that is in the model is not a candidate in later rounds.
    let again = result.candidates.iter().any(|c| c.effect == candidate.effect && c.round > candidate.round);
    match (named, again, candidate.removes) {
        (true, false, _) => "named",
        _ if !is_significant(candidate) => "may be chance",
        (true, true, _) => "named later",
        (false, _, Some(_)) => "refused",
        (false, _, None) => "another promises more",
    }
}

fn reasons(result: &DiagnosisResult, drive: Option<DriveKind>) -> Markup {
    let (refused, untestable) = (words::refused(result), words::untestable(result));
    let others = [
        (words::NOT_NAMED, words::not_named(result)),
        ("Not searched, because the settings exclude them", words::excluded(result)),
    ];
    let list = |all: &[&RefusedEffect]| {
        html! { ul { @for refused in all { li { b { (refused.effect.title()) } ": " (refused.why) } } } }
    };
    html! {
        @if refused.is_empty() {
            p { "No candidate was refused." }
        } @else {
            p { "Candidates that were refused:" } (list(&refused))
        }
        @if let Some(refused) = &result.discovery.refused {
            p { "The best term that was not accepted:" }
            ul { li { (terms::refused(refused, drive)) } }
        }
        @if result.untestable.is_empty() {
            p { "Every effect of the library could be tested." }
        }
        @if !untestable.is_empty() {
            p { "These runs cannot test these effects:" } (list(&untestable))
        }
        @for (heading, titles) in others.iter().filter(|(_, titles)| !titles.is_empty()) {
            p { (heading) ": " (titles.join(", ")) "." }
        }
    }
}

fn remaining_error(result: &DiagnosisResult) -> Markup {
    let left = &result.remaining;
    let with: Vec<(String, f64)> =
        left.correlates_with.iter().map(|c| (c.with.to_owned(), c.coefficient)).collect();
    html! {
        p { "Lack of fit (the share of the squared residual that is not noise) is "
            (words::figure(left.lof)) " with the effects, " (words::figure(left.lof_before)) " with the base alone; "
            (words::percent(left.share)) " of the reducible error (above the noise floor) remains. Sums were taken over "
            (result.blocks) " blocks." }
        @if with.is_empty() {
            p { "The remaining residual correlates with no measured signal beyond chance." }
        } @else {
            p { "The remaining residual correlates beyond chance with:" }
            (bars("residual and", "correlation", &with))
        }
    }
}
