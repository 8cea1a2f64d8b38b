//! Tables on the terminal. Each predictor has its own tables.

use super::output::ComparisonResult;
use crate::commands::units::Units;
use mr_damper_base::shown;
use mr_damper_model::compare::{Class, FinishedInverse, Predictor, Summary};
use mr_damper_model::inverse::Method;
use mr_damper_reports::compare::StepTime;
use std::fmt::Write;

/// The numbers of models, experiments and runs, in one line.
pub(super) fn headline(models: usize, experiments: usize, runs: usize) -> String {
    let (models, experiments) = (shown::count(models, "model"), shown::count(experiments, "experiment"));
    format!("{models} on {experiments}, {}", shown::count(runs, "run"))
}

/// All tables.
pub(super) fn text(done: &ComparisonResult, times: &[StepTime], units: Units) -> String {
    let mut text = done.design.as_ref().map(|design| format!("{design}\n")).unwrap_or_default();
    for (predictor, heading) in [
        (Predictor::FreeRun, "simulation (free run)"),
        (Predictor::OneStep, "one step ahead, from measured force"),
        (Predictor::SameInstant, "from the measured force of the same instant (no prediction)"),
    ] {
        if done.cells.iter().any(|c| c.identification.iter().any(|f| f.predictor == predictor)) {
            let _ = writeln!(text, "\nIdentification, {heading}");
            identification(&mut text, done, predictor, units);
            let _ = writeln!(text, "\nCross-validation, {heading}, best first");
            cross_validation(&mut text, done, predictor, times, units);
        }
    }
    inverses(&mut text, done);
    reasons(&mut text, done);
    let _ = writeln!(text, "\n{:.1} s", done.seconds);
    text
}

/// The inverse methods, best first.
fn inverses(text: &mut String, done: &ComparisonResult) {
    if done.inverses.is_empty() {
        return;
    }
    let _ = writeln!(text, "\nInverse methods: error of the current found for a measured force, best first");
    let _ = writeln!(
        text,
        "  {:<12} {:<12} {:>11} {:>9} {:>6}",
        "method", "best on", "mean RMSE A", "mean NMSE", "tests"
    );
    for row in &done.inverse_ranking {
        let _ = writeln!(
            text,
            "  {:<12} {:<12} {:11.3} {} {:6}",
            row.method,
            row.trained_on,
            row.mean_rmse_a,
            cell(row.mean_nmse, 9, 4),
            row.tests
        );
    }
    for method in Method::ALL.map(Method::name) {
        let failed = |inverse: &&FinishedInverse| inverse.method == method && inverse.failure.is_some();
        let mut failures = done.inverses.iter().filter(failed);
        let Some(first) = failures.next() else { continue };
        let more = failures.count();
        let more = if more > 0 { format!(", and {more} more") } else { String::new() };
        let why = first.failure.as_deref().unwrap_or_default();
        let _ = writeln!(text, "inverse {method} on {}{more}: {why}", first.trained_on);
    }
}

/// Warnings and reasons, one line for each model: many experiments often have the same.
fn reasons(text: &mut String, done: &ComparisonResult) {
    let mut lines: Vec<(&str, &str, &str, &str, usize)> = Vec::new();
    for cell in &done.cells {
        for why in cell.warnings.iter().chain(&cell.failure) {
            // Reasons of one kind differ in their numbers and in the names of runs.
            let alike = |line: &&mut (&str, &str, &str, &str, usize)| {
                (line.0, line.1) == (&cell.model, &cell.form) && kind_of(line.3) == kind_of(why)
            };
            match lines.iter_mut().find(alike) {
                Some(line) => line.4 += 1,
                None => lines.push((&cell.model, &cell.form, &cell.trained_on, why, 1)),
            }
        }
    }
    for (model, form, on, why, count) in lines {
        let more = if count > 1 { format!(", and {} more", count - 1) } else { String::new() };
        let _ = writeln!(text, "{model} ({form}) on {on}{more}: {why}");
    }
}

/// The words of a reason without numbers, paths and names of runs.
fn kind_of(why: &str) -> String {
    let words = why
        .split_whitespace()
        .filter(|word| word.chars().all(|c| c.is_ascii_alphabetic() || ",;:()".contains(c)));
    words.collect::<Vec<_>>().join(" ")
}

fn cell(value: Option<f64>, width: usize, decimals: usize) -> String {
    value.map_or(format!("{:>width$}", "-"), |value| format!("{value:width$.decimals$}"))
}

fn identification(text: &mut String, done: &ComparisonResult, predictor: Predictor, units: Units) {
    let one_step = predictor == Predictor::OneStep;
    let _ = write!(
        text,
        "  {:<24} {:<12} {:<12} {:>9} {:>8}",
        "model",
        "form",
        "experiment",
        format!("RMSE {}", units.symbol()),
        "NMSE"
    );
    let _ = write!(text, "{}", if one_step { "  persistence" } else { "" });
    let published = done.published.is_some();
    let _ = writeln!(
        text,
        "{}",
        if published {
            format!("  {:>9} {:>8}", format!("thesis {}", units.symbol()), "NMSE")
        } else {
            String::new()
        }
    );
    for finished in &done.cells {
        for figure in finished.identification.iter().filter(|f| f.predictor == predictor) {
            let _ = write!(
                text,
                "  {:<24} {:<12} {:<12} {} {}",
                finished.model,
                finished.form,
                finished.trained_on,
                cell(figure.rsse_n.map(|n| units.of_n(n)), 9, 2),
                cell(figure.esr, 8, 4)
            );
            if one_step {
                let still = done.persistence.iter().find(|p| p.experiment == finished.trained_on);
                let _ = write!(text, " {}", cell(still.and_then(|p| p.esr), 12, 4));
            }
            if let Some(published) = &done.published {
                let class = Class { predictor, model: finished.model.clone(), form: finished.form.clone() };
                let found = published.row(&class, &finished.trained_on).and_then(|row| row.identification);
                let rsse_n = found.map(|f| f.rsse_n);
                let _ = write!(
                    text,
                    "  {} {}",
                    cell(rsse_n.map(|n| units.of_n(n)), 9, 2),
                    cell(found.map(|f| f.esr), 8, 4)
                );
            }
            let _ = writeln!(
                text,
                "{}",
                figure.note.as_deref().map_or(String::new(), |note| format!("  {note}"))
            );
        }
    }
}

fn cross_validation(
    text: &mut String,
    done: &ComparisonResult,
    predictor: Predictor,
    times: &[StepTime],
    units: Units,
) {
    let _ = write!(
        text,
        "  {:<24} {:<12} {:<12} {:>9} {:>9} {:>17} {:>11} {:>8}",
        "model",
        "form",
        if done.design.is_some() { "over" } else { "best on" },
        "mean NMSE",
        format!("RMSE {}", units.symbol()),
        "its 95 % interval",
        "median NMSE",
        "ns/step"
    );
    let published = done.published.is_some();
    let _ = writeln!(text, "{}", if published { "  thesis NMSE (its best)" } else { "" });
    for summary in done.summaries.iter().filter(|s| s.class.predictor == predictor && !s.rows.is_empty()) {
        let _ = writeln!(text, "{}", cross_validation_line(summary, done, times, units));
    }
    if predictor == Predictor::OneStep {
        let mean = |pick: fn(&mr_damper_model::compare::Persistence) -> Option<f64>| {
            let values: Vec<f64> = done.persistence.iter().filter_map(pick).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        };
        let rsse_n = mean(|p| p.rsse_n);
        let _ = writeln!(
            text,
            "  {:<24} {:<12} {:<12} {} {}",
            "persistence",
            "",
            "",
            cell(mean(|p| p.esr), 9, 4),
            cell(rsse_n.map(|n| units.of_n(n)), 9, 2)
        );
    }
}

fn cross_validation_line(
    summary: &Summary,
    done: &ComparisonResult,
    times: &[StepTime],
    units: Units,
) -> String {
    let (class, best) = (&summary.class, summary.best());
    let rsse_n = best.and_then(|row| row.mean_rsse_n);
    let time = times.iter().find(|t| t.model == class.model && t.form == class.form);
    let mut line = format!(
        "  {:<24} {:<12} {:<12} {} {} {:>17} {} {}",
        class.model,
        class.form,
        best.map_or("-", |row| &row.trained_on),
        cell(best.and_then(|row| row.mean_esr), 9, 4),
        cell(rsse_n.map(|n| units.of_n(n)), 9, 2),
        best.and_then(|row| row.rsse_interval_n).map_or("-".to_owned(), |[low, high]| {
            // An error is not negative; the interval of few values may reach below zero.
            format!("{:.1} to {:.1}", units.of_n(low.max(0.0)), units.of_n(high))
        }),
        cell(summary.median_esr(), 11, 4),
        cell(time.map(|t| t.ns_per_step), 8, 0)
    );
    if let Some((on, esr)) = done.published.as_ref().and_then(|published| published.best(class)) {
        let _ = write!(line, "  {esr:.4} ({on})");
    }
    if summary.without > 0 {
        let _ = write!(
            line,
            "  {} of {} tests have no figure",
            summary.without,
            summary.without + summary.esr.len()
        );
    }
    line
}
