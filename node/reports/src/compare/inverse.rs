//! The inverse methods of a comparison: the best of each, and their errors by training experiment.

use super::super::table::table;
use super::CompareOutcome;
use super::tables::number;
use maud::{Markup, html};
use mr_damper_model::compare::{FinishedInverse, InverseRow};

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
    let rmse_a = inverse.cross_validation.iter().map(|test| test.figure.rmse_a);
    let missing = rmse_a.clone().filter(Option::is_none).count();
    let mean_a = InverseRow::of(inverse).map(|row| row.mean_rmse_a);
    // Without a mean, the largest of the others says little.
    let largest_a = mean_a.and_then(|_| rmse_a.flatten().reduce(f64::max));
    let remark = match (&inverse.failure, missing) {
        (Some(why), _) => why.clone(),
        (None, 0) => String::new(),
        (None, missing) => format!("{missing} of {} tests have no figure", inverse.cross_validation.len()),
    };
    vec![
        inverse.method.clone(),
        inverse.trained_on.clone(),
        number(training.and_then(|figure| figure.rmse_a), 3),
        number(training.and_then(|figure| figure.nmse), 4),
        number(mean_a, 3),
        number(largest_a, 3),
        remark,
    ]
}
