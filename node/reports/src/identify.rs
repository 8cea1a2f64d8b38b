//! The report of an identification: errors, and measured and simulated force of each run.

use super::correlate;
use super::page::{page, section};
use super::panels::{force_over_velocity, residual_panels, with_breaks};
use super::plot::{Ink, Plot, Series, Shape};
use super::recording::Recording;
use super::table::{facts, table};
use maud::{Markup, html};
use mr_damper_model::metrics::Fit;
use mr_damper_model::sample::{Channel, DriveKind};

/// Number of runs that get their own picture.
const PICTURES: usize = 12;
/// Length of the pictured part in the middle of the run, s.
const PICTURED_S: f64 = 4.0;

/// A run that was stepped through the pipeline with the identified model.
#[derive(Debug, Clone)]
pub struct SteppedRun {
    /// Name of the run.
    pub name: String,
    /// True for a validation run, which was held out of the fit.
    pub held_out: bool,
    /// The pipeline's output.
    pub recording: Recording,
}

/// Everything the report shows.
#[derive(Debug, Clone)]
pub struct IdentifyOutcome {
    /// The model, in a sentence.
    pub what: String,
    /// Errors with their names.
    pub figures: Vec<(String, Fit)>,
    /// Remarks below the errors.
    pub notes: Vec<String>,
    /// Kind of drive in the runs.
    pub drive: DriveKind,
    /// The runs: first the training runs, then the held-out runs.
    pub runs: Vec<SteppedRun>,
    /// Names and values that say how the report was made (tool version, seed, files).
    pub provenance: Vec<(String, String)>,
}

/// The report as one HTML file.
#[must_use]
pub fn html(outcome: &IdentifyOutcome) -> String {
    let points: Vec<_> =
        outcome.runs.iter().flat_map(|run| correlate::residual_points(&run.recording)).collect();
    let body = html! {
        (section("Figures", &figures(outcome)))
        (section("Force over velocity", &force_over_velocity(&points, outcome.drive)))
        (section("Remaining residual", &residual_panels(&points, outcome.drive)))
        (section("Runs", &runs(outcome)))
        (section("Provenance", &facts(&outcome.provenance)))
    };
    page("MR damper model: identification", &outcome.what, &body)
}

fn figures(outcome: &IdentifyOutcome) -> Markup {
    let row = |(name, fit): &(String, Fit)| {
        vec![name.clone(), format!("{:.2}", fit.rsse_n), format!("{:.5}", fit.esr), fit.samples.to_string()]
    };
    html! {
        (table(&["", "#RMSE, N", "#NMSE", "#samples"], &outcome.figures.iter().map(row).collect::<Vec<_>>()))
        p { "RMSE is the root mean squared error; NMSE is its square over the variance of the measured force. "
            em { "Simulation (free run)" } " uses displacement and drive only; " em { "one step ahead" } " is a prediction that also "
            "knows the measured force up to the previous sample. Its baseline is " em { "persistence" } ", the previous measured force \
             repeated." }
        @for note in &outcome.notes { p { (note) } }
    }
}

fn runs(outcome: &IdentifyOutcome) -> Markup {
    let row = |run: &SteppedRun| {
        let found = run.recording.evaluation();
        let mut row = vec![run.name.clone(), if run.held_out { "held out" } else { "fitted" }.to_owned()];
        let esr = |fit: Option<Fit>| fit.map_or("–".to_owned(), |fit| format!("{:.5}", fit.esr));
        row.extend([
            esr(found.free_run),
            esr(found.free_run_without_offset),
            esr(found.one_step),
            esr(found.persistence),
        ]);
        row
    };
    let columns = [
        "run",
        "",
        "#NMSE simulation",
        "#simulation without mean error",
        "#one step ahead",
        "#persistence (one step ahead)",
    ];
    // Held-out runs come first, because they matter most.
    let mut pictured: Vec<&SteppedRun> = outcome.runs.iter().collect();
    pictured.sort_by_key(|run| !run.held_out);
    html! {
        (table(&columns, &outcome.runs.iter().map(row).collect::<Vec<_>>()))
        @for run in pictured.iter().take(PICTURES) { (force_over_time(run)) }
        @if pictured.len() > PICTURES {
            p { "Pictures of " (pictured.len() - PICTURES) " more runs are left out." }
        }
    }
}

fn force_over_time(run: &SteppedRun) -> Markup {
    let recording = &run.recording;
    let middle_s = 0.5 * recording.length_s();
    let predicted: Vec<_> =
        recording.residuals.iter().map(|r| (recording.seconds(r.stamp), r.predicted.get())).collect();
    let line = |name: &str, ink: Ink, points: &[(f64, f64)]| Series {
        name: name.to_owned(),
        ink,
        shape: Shape::Line,
        points: with_breaks(points),
    };
    let plot = Plot {
        description: format!("Measured and simulated force of {}", run.name),
        x_label: "time, s".to_owned(),
        y_label: "force, N".to_owned(),
        x_range: Some(((middle_s - 0.5 * PICTURED_S).max(0.0), middle_s + 0.5 * PICTURED_S)),
        height: 220.0,
        series: vec![
            line("measured", Ink::Measured, &recording.points(Channel::Force)),
            line("simulation (free run)", Ink::Estimate, &predicted),
        ],
        ..Plot::default()
    };
    plot.figure(&format!("{}{}", run.name, if run.held_out { ", held out of the fit" } else { "" }))
}
