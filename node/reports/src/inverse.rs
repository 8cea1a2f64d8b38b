//! Results of force tracking by the inverse controller: JSON, text and page.

use super::page::{capital, page, section};
use super::plot::{Band, Ink, Plot, Series, Shape};
use super::table::table;
use maud::{Markup, html};
use mr_damper_base::provenance::TOOL;
use mr_damper_model::inverse::track::{Figures, Point};
use mr_damper_model::inverse::{Fold, Limits, Method, SurrogateFit};
use serde::Serialize;
use std::fmt::Write;

/// Length of the part that is drawn, s.
const DRAWN_S: f64 = 4.0;

/// The plant that tracks a demanded force, and the control.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackingSetup {
    /// On the model itself.
    Model,
    /// On the virtual rig, with feedforward only.
    Rig,
    /// On the virtual rig, with feedback from its load cell.
    RigWithFeedback,
}

impl TrackingSetup {
    const fn words(self) -> &'static str {
        match self {
            Self::Model => "on the model itself",
            Self::Rig => "on the rig, feedforward",
            Self::RigWithFeedback => "on the rig, with force feedback",
        }
    }
}

/// Result of tracking the demanded force on one setup.
#[derive(Debug, Clone)]
pub struct TrackingResult {
    /// The plant and the control.
    pub setup: TrackingSetup,
    /// Tracking errors.
    pub figures: Figures,
    /// Demand, command and force at each sample.
    pub points: Vec<Point>,
}

/// Everything the report shows.
#[derive(Debug, Clone)]
pub struct InverseOutcome {
    /// Name of the model.
    pub model: String,
    /// Name of the run whose force is the demand.
    pub run: String,
    /// Limits of the command.
    pub limits: Limits,
    /// Where the model's force decreases as the current grows; `None` when it does not.
    pub fold: Option<Fold>,
    /// Method that computes the current.
    pub method: Method,
    /// Accuracy of the surrogate inverse; `None` when the model itself is inverted.
    pub fit: Option<SurrogateFit>,
    /// Results on several setups; the first is on the model.
    pub results: Vec<TrackingResult>,
}

/// The JSON, `mr-damper/inverse/1`. Numbers that are not finite become `null`.
#[derive(Debug, Serialize)]
pub struct InverseReport<'a> {
    schema: &'static str,
    tool: &'static str,
    model: &'a str,
    run: &'a str,
    current_max_a: f64,
    monotone: bool,
    method: &'static str,
    #[serde(flatten)]
    on_model: Option<Row>,
    /// On the rig, feedforward; `null` when it was not run.
    rig: Option<Row>,
    /// On the rig, with force feedback; `null` when it was not run.
    rig_with_feedback: Option<Row>,
}

#[derive(Debug, Serialize)]
struct Row {
    tracking: Tracking,
    infeasible_share: f64,
    dissipative_violations: u64,
    rate_limited: u64,
    /// Commands by the search, because the learned inverse gave no current; 0 for other methods.
    substituted: u64,
}

#[derive(Debug, Serialize)]
struct Tracking {
    rsse_n: f64,
    esr: f64,
    esr_achievable: f64,
    /// RMS of the tracking error divided by the RMS of the demand.
    error: f64,
    error_achievable: f64,
}

impl From<&Figures> for Row {
    fn from(figures: &Figures) -> Self {
        let nan = |fit: Option<mr_damper_model::metrics::Fit>| {
            fit.map_or((f64::NAN, f64::NAN), |f| (f.rsse_n, f.esr))
        };
        let (rsse_n, esr) = nan(figures.tracking);
        let tracking = Tracking {
            rsse_n,
            esr,
            esr_achievable: nan(figures.achievable).1,
            error: figures.error,
            error_achievable: figures.error_achievable,
        };
        Self {
            tracking,
            infeasible_share: figures.infeasible_share,
            dissipative_violations: figures.dissipative_violations,
            rate_limited: figures.rate_limited,
            substituted: figures.substituted,
        }
    }
}

impl InverseOutcome {
    fn row(&self, setup: TrackingSetup) -> Option<Row> {
        self.results.iter().find(|result| result.setup == setup).map(|result| Row::from(&result.figures))
    }

    /// The method that computes the current, and its accuracy.
    fn method_in_words(&self) -> String {
        let method = self.method.name();
        match &self.fit {
            None if self.method.learned().is_some() => format!("currents by the inverse model {method}"),
            None => format!("currents by {method}"),
            Some(fit) => format!(
                "currents by the {method} inverse; its error on motions between the fitted ones is {:.3} A in current and {:.1} % of the \
                 largest force",
                fit.current.get(),
                100.0 * fit.force_share()
            ),
        }
    }

    fn fold_in_words(&self) -> String {
        match self.fold {
            None => "the model's force is monotone in the current on a grid of its envelope".to_owned(),
            Some(fold) => format!(
                "the model's force decreases by {:.0} N beyond {:.2} A (at {:.1} mm, {:.3} m/s): several currents give the same \
                 force, and the one nearest to the previous current was used",
                fold.fall_n,
                fold.current_a,
                1e3 * fold.displacement_m,
                fold.velocity_m_s
            ),
        }
    }
}

/// The JSON report of `outcome`.
#[must_use]
pub fn json(outcome: &InverseOutcome) -> InverseReport<'_> {
    InverseReport {
        schema: "mr-damper/inverse/1",
        tool: TOOL,
        model: &outcome.model,
        run: &outcome.run,
        current_max_a: outcome.limits.current_max_a,
        monotone: outcome.fold.is_none(),
        method: outcome.method.name(),
        on_model: outcome.row(TrackingSetup::Model),
        rig: outcome.row(TrackingSetup::Rig),
        rig_with_feedback: outcome.row(TrackingSetup::RigWithFeedback),
    }
}

/// `outcome` as text for a terminal.
#[must_use]
pub fn text(outcome: &InverseOutcome) -> String {
    let mut text = format!(
        "{}\ndemand: the force of {}; currents from 0 to {} A\n{}\n{}\n\n{:<34}{:>10}{:>22}{:>12}{:>12}\n",
        outcome.model,
        outcome.run,
        outcome.limits.current_max_a,
        outcome.method_in_words(),
        outcome.fold_in_words(),
        "rms error over rms demand",
        "all",
        "achievable part",
        "infeasible",
        "RMSE"
    );
    for TrackingResult { setup, figures, .. } in &outcome.results {
        let rsse_n = figures.tracking.map_or(f64::NAN, |fit| fit.rsse_n);
        let _ = writeln!(
            text,
            "  {:<32}{:>10.4}{:>22.4}{:>10.1} %{:>10.1} N",
            setup.words(),
            figures.error,
            figures.error_achievable,
            100.0 * figures.infeasible_share,
            rsse_n
        );
        if figures.substituted > 0 {
            let _ = writeln!(text, "    {}", substituted_in_words(figures, outcome.method));
        }
        if figures.dissipative_violations > 0 {
            let _ = writeln!(
                text,
                "    {} commands would have driven the rod, which must never happen: please report this as a bug",
                figures.dissipative_violations
            );
        }
    }
    text
}

/// How often the search gave the current in the place of a learned inverse, and why.
fn substituted_in_words(figures: &Figures, method: Method) -> String {
    format!(
        "{} currents by the search, because {} had none: it lacks past samples after a start, a gap or an impossible motion, or the sample \
         rate is not that of its training",
        figures.substituted,
        method.name()
    )
}

/// `outcome` as a page.
#[must_use]
pub fn html(outcome: &InverseOutcome) -> String {
    let rows: Vec<Vec<String>> = outcome
        .results
        .iter()
        .map(|TrackingResult { setup, figures, .. }| {
            let rsse_n = figures.tracking.map_or(f64::NAN, |fit| fit.rsse_n);
            vec![
                setup.words().to_owned(),
                format!("{:.4}", figures.error),
                format!("{:.4}", figures.error_achievable),
                format!("{:.1} %", 100.0 * figures.infeasible_share),
                format!("{rsse_n:.1} N"),
            ]
        })
        .collect();
    let body = html! {
        (section("Tracking error", &html! {
            (table(&["", "error, all", "error, achievable part", "not achievable", "RMSE"], &rows))
            p { "Error: RMS of demanded minus actual force, divided by the RMS of the demand. RMSE is the root mean squared error. \
                 A demand is not achievable when it is below the damper's force without current, above its force at the largest current, or \
                 when it would drive the rod; then the nearest current is commanded. On the rig a command holds until the next sample and \
                 passes a driver and a coil with lag, and the rig's damper differs from the model." }
            p { (capital(&outcome.method_in_words())) ". " (capital(&outcome.fold_in_words())) "." }
        }))
        @for result in outcome.results.iter().filter(|result| result.figures.substituted > 0) {
            p { (capital(result.setup.words())) ": " (substituted_in_words(&result.figures, outcome.method)) "." }
        }
        @for result in &outcome.results { (plots(result, outcome.limits.current_max_a)) }
    };
    page(
        "Tracking of a demanded force",
        &format!("Model {}; the demand is the force of {}.", outcome.model, outcome.run),
        &body,
    )
}

/// Plots of demand, force and current around the largest demand.
fn plots(result: &TrackingResult, current_max_a: f64) -> Markup {
    let points = stretch(&result.points);
    let series = |name: &str, ink, shape, value: fn(&Point) -> f64| Series {
        name: name.to_owned(),
        ink,
        shape,
        points: points.iter().map(|point| (point.time.get(), value(point))).collect(),
    };
    let force = Plot {
        description: format!("Demanded and achieved force over time, {}", result.setup.words()),
        x_label: "time (s)".to_owned(),
        y_label: "force (N)".to_owned(),
        bands: infeasible(points),
        series: vec![
            series("largest achievable force", Ink::Before, Shape::Dashed, |p| p.command.achievable[1].get()),
            series("least", Ink::Before, Shape::Dashed, |p| p.command.achievable[0].get()),
            series("demand", Ink::Measured, Shape::Line, |p| p.command.requested.get()),
            series("force", Ink::Estimate, Shape::Line, |p| p.achieved.get()),
        ],
        ..Plot::default()
    };
    let current = Plot {
        description: format!("Commanded current over time, {}", result.setup.words()),
        x_label: "time (s)".to_owned(),
        y_label: "current (A)".to_owned(),
        y_range: Some((0.0, current_max_a)),
        height: 200.0,
        series: vec![series("command", Ink::Estimate, Shape::Line, |p| p.command.current.get())],
        ..Plot::default()
    };
    section(&capital(result.setup.words()), &html! { (force.figure("")) (current.figure("")) })
}

/// The points within [`DRAWN_S`] around the largest demand.
fn stretch(points: &[Point]) -> &[Point] {
    let size = |point: &Point| point.command.requested.get().abs();
    let most =
        points.iter().filter(|point| size(point).is_finite()).max_by(|a, b| size(a).total_cmp(&size(b)));
    let Some(most) = most else { return &[] };
    let from_s = (most.time.get() - DRAWN_S / 2.0).max(0.0);
    let at = |time_s: f64| points.partition_point(|point| point.time.get() < time_s);
    &points[at(from_s)..at(from_s + DRAWN_S)]
}

/// Bands where the demand is not achievable.
fn infeasible(points: &[Point]) -> Vec<Band> {
    points
        .chunk_by(|a, b| a.command.is_achievable == b.command.is_achievable)
        .filter(|chunk| !chunk[0].command.is_achievable)
        .map(|chunk| Band {
            from: chunk[0].time.get(),
            to: chunk[chunk.len() - 1].time.get(),
            class: "hold",
            name: "not achievable".to_owned(),
        })
        .collect()
}
