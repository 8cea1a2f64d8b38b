//! The inverse methods of a comparison: the best of each, and their errors by training experiment.

use super::super::table::table;
use super::CompareOutcome;
use maud::{Markup, html};
use mr_damper_model::compare::{CurrentFigure, FinishedInverse, InverseRow};

/// Text of a cell without a figure.
const NONE: &str = "–";

/// Both tables, and what the figures mean.
pub(super) fn section(outcome: &CompareOutcome<'_>) -> Markup {
    let best: Vec<Vec<String>> = outcome.inverse_ranking.iter().map(best_row).collect();
    let all: Vec<Vec<String>> = outcome.inverses.iter().map(training_row).collect();
    html! {
        p {
            "An inverse gets the motion and the measured force of a run, and the current that it finds is compared with the recorded one. "
            "Samples count if the damper is faster than the speed below which the inverse controller holds its current. search, polynomial "
            "and fuzzy invert the fuzzy-tanh model of the same training runs, within the controller's limits; chen, wang-liao and wang-hu "
            "are identified from these runs."
        }
        (table(&["=method", "=best on", "#mean RMSE, A", "#mean NMSE", "#tests"], &best))
        h3 { "By training experiment" }
        (table(
            &["=method", "=trained on", "#training RMSE, A", "#NMSE", "#mean test RMSE, A", "#largest", "=remark"],
            &all,
        ))
    }
}

fn best_row(row: &InverseRow) -> Vec<String> {
    vec![
        row.method.clone(),
        row.trained_on.clone(),
        format!("{:.3}", row.mean_rmse_a),
        number(row.mean_nmse, 4),
        row.tests.to_string(),
    ]
}

fn training_row(inverse: &FinishedInverse) -> Vec<String> {
    let training = inverse.identification.as_ref();
    let tests: Vec<&CurrentFigure> = inverse.cross_validation.iter().map(|test| &test.figure).collect();
    let rmse_a: Option<Vec<f64>> = tests.iter().map(|figure| figure.rmse_a).collect();
    let rmse_a = rmse_a.filter(|values| !values.is_empty());
    let missing = tests.iter().filter(|figure| figure.rmse_a.is_none()).count();
    let remark = match (&inverse.failure, missing) {
        (Some(why), _) => why.clone(),
        (None, 0) => String::new(),
        (None, missing) => format!("{missing} of {} tests have no figure", tests.len()),
    };
    vec![
        inverse.method.clone(),
        inverse.trained_on.clone(),
        number(training.and_then(|figure| figure.rmse_a), 3),
        number(training.and_then(|figure| figure.nmse), 4),
        number(rmse_a.as_ref().map(|values| values.iter().sum::<f64>() / values.len() as f64), 3),
        number(rmse_a.and_then(|values| values.into_iter().reduce(f64::max)), 3),
        remark,
    ]
}

fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or(NONE.to_owned(), |value| format!("{value:.decimals$}"))
}
