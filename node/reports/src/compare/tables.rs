//! Tables of a comparison. Figures of different predictors never share a column.

use super::super::table::table;
use super::CompareOutcome;
use super::order;
use super::published::Figures;
use maud::{Markup, html};
use mr_damper_model::compare::{Class, Figure, Finished, Predictor, Summary};
use mr_damper_model::units::N_PER_LBF;

/// Text of a cell without a figure.
const NONE: &str = "–";

/// The predictors with their headings.
const PREDICTORS: [(Predictor, &str); 3] = [
    (Predictor::FreeRun, "Simulation (free run) from displacement and drive"),
    (Predictor::OneStep, "One-step-ahead prediction from measured force, compared with persistence"),
    (
        Predictor::SameInstant,
        "Given the measured force at the same instant: tests a relation, predicts nothing",
    ),
];

pub(super) fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or(NONE.to_owned(), |value| format!("{value:.decimals$}"))
}

/// An RMSE in newtons; in pounds-force too if there are published figures, which are in pounds-force.
fn rsse(rsse_n: Option<f64>, published: bool) -> String {
    match rsse_n {
        None => NONE.to_owned(),
        Some(n) if published => format!("{n:.1} ({:.2})", n / N_PER_LBF),
        Some(n) => format!("{n:.1}"),
    }
}

/// The models, ordered by their best training experiment.
pub(super) fn best(outcome: &CompareOutcome<'_>) -> Markup {
    let published = outcome.published.is_some();
    let row = |(place, summary): (usize, &Summary)| {
        let (class, best) = (&summary.class, summary.best());
        vec![
            (place + 1).to_string(),
            class.model.clone(),
            class.form.replace('_', "-"),
            if summary.rows.is_empty() { NONE.to_owned() } else { summary.parameters.to_string() },
            best.map_or(NONE.to_owned(), |row| row.trained_on.clone()),
            number(best.and_then(|row| row.mean_esr), 4),
            rsse(best.and_then(|row| row.mean_rsse_n), published),
            best.and_then(|row| row.rsse_interval_n)
                .map_or(NONE.to_owned(), |[low, high]| format!("{:.1} to {high:.1}", low.max(0.0))),
            number(summary.median_esr(), 4),
            (summary.without + summary.failures.len()).to_string(),
            number(outcome.ns_per_step(&class.model, &class.form), 0),
        ]
    };
    let columns = [
        "#",
        "=model",
        "=form",
        "#para\u{ad}meters",
        "=best on",
        "#mean NMSE",
        if published { "#mean RMSE, N (lbf)" } else { "#mean RMSE, N" },
        "#its 95 %",
        "#median NMSE",
        "#without figure",
        "#ns per step",
    ];
    html! {
        @for (predictor, heading) in PREDICTORS {
            @let of = outcome.summaries.iter().filter(|s| s.class.predictor == predictor);
            @let rows: Vec<_> = of.enumerate().map(row).collect();
            @if !rows.is_empty() {
                h3 { (heading) }
                (table(&columns, &rows))
                @if predictor == Predictor::OneStep { (persistence(outcome)) }
            }
        }
        p { em { "Best on" } " is the training experiment with the lowest mean NMSE; both means are of this experiment, and the median "
            "is over all training experiments. Means are over all tests: every replicate of every experiment except the "
            "training run. A model has no mean "
            "when a test has no figure because the simulation diverged. The 95 % interval is from the scatter of the means by tested \
             experiment or fold (Student's t). "
            em { "Without figure" } " counts such tests, and training runs that gave no model. The model keeps the force offset of its "
            "training run. RMSE is the root mean squared error (RSSE in the thesis); NMSE is its square over the variance of the \
             measured force (ESR in the thesis)." }
        (failures(outcome))
    }
}

fn persistence(outcome: &CompareOutcome<'_>) -> Markup {
    html! {
        @if let Some((esr, rsse_n)) = outcome.persistence_means() {
            p { "Persistence (the measured force of the previous sample), mean over all runs: NMSE "
                strong { (format!("{esr:.4}")) } ", RMSE " (rsse(Some(rsse_n), outcome.published.is_some())) " N"
                ". A one-step-ahead model with a larger error is worse than persistence." }
        }
    }
}

fn failures(outcome: &CompareOutcome<'_>) -> Markup {
    let all =
        outcome.summaries.iter().flat_map(|s| s.failures.iter().map(move |(on, why)| (&s.class, on, why)));
    let rows: Vec<Vec<String>> =
        all.map(|(class, on, why)| vec![order::name(class), on.clone(), why.clone()]).collect();
    let warnings =
        outcome.cells.iter().flat_map(|cell| cell.warnings.iter().map(move |warning| (cell, warning)));
    let remarks: Vec<Vec<String>> = warnings
        .map(|(cell, warning)| {
            let model = format!("{} ({})", cell.model, cell.form.replace('_', "-"));
            vec![model, cell.trained_on.clone(), warning.clone()]
        })
        .collect();
    html! {
        @if !rows.is_empty() {
            h3 { "Models that could not be identified" }
            (table(&["=model", "=on", "because"], &rows))
        }
        @if !remarks.is_empty() {
            h3 { "Remarks on identifications" }
            (table(&["=model", "=on", "=remark"], &remarks))
        }
    }
}

/// Training experiments, in the order of the cells.
fn experiments<'a>(outcome: &CompareOutcome<'a>) -> Vec<&'a str> {
    let mut names: Vec<&str> = Vec::new();
    for cell in outcome.cells {
        if !names.contains(&cell.trained_on.as_str()) {
            names.push(&cell.trained_on);
        }
    }
    // Over folds a summary has one row for all of them.
    let rows = outcome.summaries.iter().flat_map(|summary| &summary.rows);
    match rows.map(|row| row.trained_on.as_str()).find(|name| !names.contains(name)) {
        Some(all_folds) => vec![all_folds],
        None => names,
    }
}

/// Means over all tests by model and training experiment, like tables 5.1 and 5.2 of the thesis.
pub(super) fn cross_validation(outcome: &CompareOutcome<'_>) -> Markup {
    let experiments = experiments(outcome);
    let numbered: Vec<String> = experiments.iter().map(|name| format!("#{name}")).collect();
    let mut columns = vec!["=model"];
    columns.extend(numbered.iter().map(String::as_str));
    let rows = |predictor: Predictor, show: fn(Option<Figures>) -> String| {
        let mut rows = Vec::new();
        for summary in outcome.summaries.iter().filter(|s| s.class.predictor == predictor) {
            let here = |on: &&str| {
                let row = summary.rows.iter().find(|row| row.trained_on == *on);
                let mean = row.and_then(|row| Some(Figures { rsse_n: row.mean_rsse_n?, esr: row.mean_esr? }));
                match row {
                    Some(row) if row.without > 0 => format!("{} of {} failed", row.without, row.tests),
                    _ => show(mean),
                }
            };
            let name = order::name(&summary.class);
            rows.push(std::iter::once(name).chain(experiments.iter().map(here)).collect::<Vec<_>>());
            let thesis = |on: &&str| outcome.published?.row(&summary.class, on)?.cross_validation;
            if experiments.iter().any(|on| thesis(on).is_some()) {
                let cells = experiments.iter().map(|on| show(thesis(on)));
                rows.push(std::iter::once("\u{2003}thesis".to_owned()).chain(cells).collect());
            }
        }
        rows
    };
    let published = outcome.published.is_some();
    let in_newton: fn(Option<Figures>) -> String = if published {
        |figures| rsse(figures.map(|f| f.rsse_n), true)
    } else {
        |figures| rsse(figures.map(|f| f.rsse_n), false)
    };
    html! {
        p { "Mean over all tests by training experiment (columns)." }
        @for (predictor, heading) in PREDICTORS {
            @let in_newton = rows(predictor, in_newton);
            @if !in_newton.is_empty() {
                h3 { (heading) (if published { ": RMSE, N (lbf)" } else { ": RMSE, N" }) }
                (table(&columns, &in_newton))
                h3 { (heading) ": NMSE" }
                (table(&columns, &rows(predictor, |f| number(f.map(|f| f.esr), 4))))
                @if predictor == Predictor::OneStep { (persistence(outcome)) }
            }
        }
    }
}

/// Figures on the training runs, one table per model, like tables 4.1 to 4.7 of the thesis.
pub(super) fn identification(outcome: &CompareOutcome<'_>) -> Markup {
    let mut models: Vec<(&str, &str)> = Vec::new();
    for cell in outcome.cells {
        let key = (cell.model.as_str(), cell.form.as_str());
        if !models.contains(&key) {
            models.push(key);
        }
    }
    html! {
        p { "Errors of each model on its training run." }
        @for key in models {
            @let cells: Vec<&Finished> = outcome.cells.iter().filter(|c| (c.model.as_str(), c.form.as_str()) == key).collect();
            @for (predictor, _) in PREDICTORS {
                @let class = Class { predictor, model: key.0.to_owned(), form: key.1.to_owned() };
                @let any = cells.iter().any(|c| c.identification.iter().any(|f| f.predictor == predictor));
                @if any { (one_model(outcome, &class, &cells)) }
            }
        }
    }
}

fn one_model(outcome: &CompareOutcome<'_>, class: &Class, cells: &[&Finished]) -> Markup {
    let one_step = class.predictor == Predictor::OneStep;
    let thesis = |cell: &Finished| outcome.published?.row(class, &cell.trained_on)?.identification;
    let published = cells.iter().any(|cell| thesis(cell).is_some());
    let mut columns = vec!["=experiment", "#RMSE, N", "#NMSE"];
    if one_step {
        columns.push("#NMSE of persistence");
    }
    if published {
        columns.extend(["#thesis: RMSE, N", "#lbf", "#NMSE"]);
    }
    let row = |cell: &&Finished| {
        let figure: Option<&Figure> = cell.identification.iter().find(|f| f.predictor == class.predictor);
        let rsse_n = figure.and_then(|f| f.rsse_n);
        let why = figure.and_then(|f| f.note.clone()).or(cell.failure.as_ref().map(|_| "failed".to_owned()));
        let esr = figure.and_then(|f| f.esr);
        let mut row = vec![
            cell.trained_on.clone(),
            number(rsse_n, 1),
            if let (None, Some(why)) = (esr, why) { why } else { number(esr, 4) },
        ];
        if one_step {
            let still = outcome.persistence.iter().find(|p| p.experiment == cell.trained_on);
            row.push(number(still.and_then(|p| p.esr), 4));
        }
        if published {
            let found = thesis(cell);
            row.push(number(found.map(|f| f.rsse_n), 1));
            row.push(number(found.map(|f| f.rsse_n / N_PER_LBF), 2));
            row.push(number(found.map(|f| f.esr), 4));
        }
        row
    };
    let parameters = cells.iter().find_map(|cell| cell.parameters);
    let how = if one_step { "one-step-ahead prediction" } else { "in simulation" };
    html! {
        details open[published] {
            summary {
                (class.model) " (" (class.form.replace('_', "-")) "), " (how)
                @if let Some(n) = parameters { ", " (n) " parameters" }
            }
            (table(&columns, &cells.iter().map(row).collect::<Vec<_>>()))
        }
    }
}
