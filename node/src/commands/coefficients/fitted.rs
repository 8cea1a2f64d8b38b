//! The coefficients of an identified model with their errors.

use super::{Coefficient, Scatter, of_model};
use crate::settings::error::NodeError;
use mr_damper_base::shown;
use mr_damper_model::identify::Identified;

/// Fewest runs that a bootstrap draws from. With two, a draw that holds both is always the fit itself.
pub(in crate::commands) const FEWEST_RUNS: usize = 3;

/// Fits to resampled runs.
#[derive(Debug, Default)]
pub(in crate::commands) struct Draws {
    /// The coefficients of each fit.
    pub(in crate::commands) fitted: Vec<Vec<Coefficient>>,
    /// Number of draws that could not be fitted.
    pub(in crate::commands) failed: usize,
    /// Reason of the first of them.
    pub(in crate::commands) first_failure: Option<String>,
}

/// The coefficients of `found`, which was identified from `runs` runs, and notes that say what their errors cover.
///
/// # Errors
/// When the model cannot be written as a model file.
pub(in crate::commands) fn rows(
    found: &Identified,
    runs: usize,
    draws: Option<Draws>,
) -> Result<(Vec<Coefficient>, Vec<String>), NodeError> {
    let mut rows = of_model(&found.model)?;
    for row in &mut rows {
        let estimate = found.parameters.iter().find(|estimate| is_same(&estimate.name, &row.name));
        row.standard_error = estimate.map(|it| it.standard_error).filter(|error| error.is_finite());
        if let Some(draws) = &draws {
            let of_draw = |draw: &Vec<Coefficient>| {
                draw.iter().find(|other| other.name == row.name).map(|other| other.value)
            };
            let values: Vec<f64> = draws.fitted.iter().filter_map(of_draw).collect();
            // Settings that the draws keep, such as the centres of sets, are no estimates.
            let is_estimate = values.iter().any(|value| *value != row.value);
            row.bootstrap = is_estimate.then(|| Scatter::of(values)).flatten();
        }
    }
    let mut notes = Vec::new();
    if rows.iter().any(|row| row.standard_error.is_some()) {
        notes.push(format!(
            "standard error: of this one fit, from the scatter of the gradient over blocks of one second within {}; it does not \
             cover differences between runs, sessions or dampers",
            shown::count(runs, "run")
        ));
    } else {
        notes.push("the fit of this model gives no standard errors".to_owned());
    }
    match &draws {
        None => notes.push(
            "--bootstrap N adds the scatter over runs, which is usually larger than the standard error"
                .to_owned(),
        ),
        Some(draws) => {
            notes.push(format!(
                "bootstrap: {} to {} that were drawn with replacement; the interval is from the 2.5 % to the 97.5 % quantile",
                shown::count(draws.fitted.len(), "fit"),
                shown::count(runs, "run"),
            ));
            if draws.failed > 0 {
                notes.push(format!(
                    "{} could not be fitted and left out; the first: {}",
                    shown::count(draws.failed, "draw"),
                    draws.first_failure.as_deref().unwrap_or_default()
                ));
            }
        }
    }
    Ok((rows, notes))
}

/// True if the fit's name `estimate` means the coefficient `row`. A fit counts from `[0]` also where the model file has one number.
fn is_same(estimate: &str, row: &str) -> bool {
    estimate == row || estimate.strip_suffix("[0]") == Some(row)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_a_fit_and_of_a_model_file_are_matched() {
        assert!(is_same("stiffness_n_m[0]", "stiffness_n_m") && is_same("a[1]", "a[1]"));
        assert!(!is_same("stiffness_n_m[1]", "stiffness_n_m") && !is_same("a[0]", "a[1]"));
    }
}
