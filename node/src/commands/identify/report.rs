//! The figures and remarks of an identification: in JSON, as text, and for the page.

use crate::commands::units::Units;
use mr_damper_base::shown;
use mr_damper_model::identify::{CurrentFit, ParameterValue, RunFit, WithoutPrior};
use mr_damper_model::metrics::Fit;
use mr_damper_reports::swept::{SweptFaultReport, SweptReport};
use serde::Serialize;
use std::path::Path;

/// The figures of an identification, as they are written to JSON.
#[derive(Debug, Serialize)]
pub struct Report<'a> {
    pub(super) schema: &'static str,
    pub(super) model: &'a str,
    pub(super) form: &'static str,
    pub(super) parameters: usize,
    pub(super) restarts: u32,
    pub(super) seed: u64,
    pub(super) seconds: f64,
    pub(super) rank: Option<usize>,
    pub(super) velocity: String,
    pub(super) velocity_trials: Vec<VelocityReport>,
    pub(super) training: Scores,
    pub(super) validation: Option<Scores>,
    /// The 90 % band of the estimates is calibrated on the held-out runs.
    pub(super) band_calibrated: bool,
    pub(super) runs: Vec<RunReport<'a>>,
    pub(super) active_bounds: Vec<String>,
    /// The model over the whole range of its runs; absent for a model that uses measured force.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) swept: Option<SweptReport>,
    /// The fit without the weak prior; absent if none was needed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) without_prior: Option<WithoutPriorReport>,
    pub(super) warnings: &'a [String],
    pub(super) estimates: Vec<Estimate<'a>>,
    pub(super) restart_rsse_n: &'a [f64],
    /// The inverse model; absent if none was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) inverse: Option<&'a InverseReport>,
}

/// The identified inverse model and the errors of its current.
#[derive(Debug, Serialize)]
pub(super) struct InverseReport {
    pub(super) kind: &'static str,
    pub(super) parameters: usize,
    pub(super) seconds: f64,
    pub(super) training: Option<CurrentFit>,
    pub(super) validation: Option<CurrentFit>,
    pub(super) warnings: Vec<String>,
}

/// The fit by least squares alone.
#[derive(Debug, Serialize)]
pub(super) struct WithoutPriorReport {
    free_run: Option<Fit>,
    faults: Vec<SweptFaultReport>,
}

impl WithoutPriorReport {
    pub(super) fn of(without: &WithoutPrior) -> Self {
        Self { free_run: without.free_run, faults: without.faults.iter().map(SweptFaultReport::of).collect() }
    }
}

/// A parameter and its standard error, which is `null` if the runs do not determine the parameter.
#[derive(Debug, Serialize)]
pub(super) struct Estimate<'a> {
    pub(super) parameter: &'a str,
    pub(super) value: f64,
    pub(super) standard_error: Option<f64>,
}

impl<'a> Estimate<'a> {
    pub(super) fn of(parameter: &'a ParameterValue) -> Self {
        Self {
            parameter: &parameter.name,
            value: parameter.value,
            standard_error: Some(parameter.standard_error).filter(|error| error.is_finite()),
        }
    }
}

#[derive(Debug, Serialize)]
pub(super) struct VelocityReport {
    pub(super) velocity: String,
    pub(super) mean_esr: f64,
}

#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Scores {
    pub(super) free_run: Option<Fit>,
    pub(super) one_step: Option<Fit>,
    pub(super) persistence: Option<Fit>,
}

#[derive(Debug, Serialize)]
pub(super) struct RunReport<'a> {
    pub(super) run: &'a str,
    pub(super) samples: u64,
    pub(super) rate_hz: f64,
    pub(super) force_offset_n: f64,
    pub(super) free_run: Option<Fit>,
    pub(super) one_step: Option<Fit>,
}

/// The figures of a training run.
pub(super) fn run_report(run: &RunFit) -> RunReport<'_> {
    RunReport {
        run: &run.name,
        samples: run.samples,
        rate_hz: run.rate_hz,
        force_offset_n: run.force_offset_n,
        free_run: run.free_run,
        one_step: run.one_step,
    }
}

/// The figures of a report by name; missing figures are left out.
pub(super) fn figures(report: &Report<'_>) -> Vec<(String, Fit)> {
    let mut figures = Vec::new();
    let mut add = |name: &str, fit: Option<Fit>| figures.extend(fit.map(|fit| (name.to_owned(), fit)));
    add("training, simulation (offsets out)", report.training.free_run);
    add("training, one step ahead", report.training.one_step);
    add("training, persistence", report.training.persistence);
    if let Some(validation) = &report.validation {
        add("validation, simulation", validation.free_run);
        add("validation, one step ahead", validation.one_step);
        add("validation, persistence", validation.persistence);
    }
    figures
}

/// Remarks on a fit, besides its figures.
pub(super) fn remarks(report: &Report<'_>) -> Vec<String> {
    let rank = report.rank.filter(|rank| *rank < report.parameters);
    let mut remarks: Vec<String> = rank
        .map(|rank| {
            let of = report.parameters;
            format!(
                "rank {rank} of {of}: the regressors are collinear, so the runs do not determine every coefficient"
            )
        })
        .into_iter()
        .collect();
    remarks.extend(report.warnings.iter().cloned());
    remarks.extend(report.swept.as_ref().map(|swept| swept.summary().to_owned()));
    remarks.extend(report.inverse.into_iter().flat_map(inverse_remarks));
    if report.band_calibrated {
        remarks.push("the 90 % band of the estimates is calibrated on the held-out runs".to_owned());
    }
    let bounds = report.active_bounds.iter();
    // The remark on the rank covers coefficients without a standard error.
    let vague =
        |e: &&Estimate<'_>| e.standard_error.map_or(rank.is_none(), |error| error > 0.5 * e.value.abs());
    let vague: Vec<&str> = report.estimates.iter().filter(vague).map(|e| e.parameter).collect();
    if !vague.is_empty() {
        remarks.push(format!(
            "poorly determined by these runs, with a standard error above half the value: {} (standard errors: --json)",
            vague.join(", ")
        ));
    }
    remarks.extend(bounds.map(|bound| format!("at its bound: {bound} (the runs do not determine it)")));
    remarks
}

/// The errors of the inverse model, and its warnings.
fn inverse_remarks(inverse: &InverseReport) -> Vec<String> {
    let fits = [("training", inverse.training), ("validation", inverse.validation)];
    let figure = |(what, fit): (&str, Option<CurrentFit>)| {
        fit.map(|fit| format!("{what} RMSE {:.3} A, NMSE {:.3}", fit.rmse_a, fit.nmse))
    };
    let figures: Vec<String> = fits.into_iter().filter_map(figure).collect();
    let InverseReport { kind, parameters, seconds, .. } = inverse;
    let line = format!(
        "inverse model {kind}, {parameters} parameters, {seconds:.1} s: current, {}",
        figures.join("; ")
    );
    std::iter::once(line).chain(inverse.warnings.iter().cloned()).collect()
}

/// One line on the model and its identification.
pub(super) fn headline(report: &Report<'_>) -> String {
    format!(
        "{} ({}), {}, {}, velocity by {}, {:.1} s",
        report.model,
        report.form,
        shown::count(report.parameters, "parameter"),
        shown::count(report.runs.len(), "run"),
        report.velocity,
        report.seconds
    )
}

/// The figures and remarks as text.
pub(super) fn table(report: &Report<'_>, out: &Path, units: Units) -> String {
    let mut text = headline(report) + "\n";
    for (name, fit) in figures(report) {
        let (error, unit) = (units.of_n(fit.rsse_n), units.symbol());
        text += &format!("  {name:<34} RMSE {error:8.2} {unit}   NMSE {:.5}\n", fit.esr);
    }
    for remark in remarks(report) {
        text += &format!("  {remark}\n");
    }
    text + &format!("model file: {}\n", out.display())
}
