//! The demo's diagnosis: the named effects, and the live error before and after.

use super::Recording;
use super::diagnosis::{self, words};
use super::panels::{whole_run, with_breaks};
use super::plot::{Ink, Plot, Series, Shape};
use super::table::table;
use maud::{Markup, html};
use mr_damper_base::clock::in_seconds;
use mr_damper_model::diagnose::DiagnosisResult;
use mr_damper_model::metrics::Fit;
use mr_damper_model::sample::DriveKind;
use std::fmt::Write;
use std::path::PathBuf;

/// Result of the demo's diagnosis and model augmentation.
#[derive(Debug, Clone)]
pub struct DemoDiagnosis {
    /// The diagnosis.
    pub result: DiagnosisResult,
    /// Kind of the drive.
    pub drive: Option<DriveKind>,
    /// Duration of the diagnosis, s.
    pub seconds: f64,
    /// The runs it used, in words.
    pub runs: String,
    /// The effect that the demo simulated in the rig, in words.
    pub truth: String,
    /// The swap of the model; `None` when no effect was named or the demo ended before it.
    pub swap: Option<ModelSwap>,
}

/// The reason why the demo has no diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoDiagnosis {
    /// The user ended the demo while it played the first run.
    #[error("The demo was ended before the diagnosis.")]
    EndedEarly,
}

/// The swap to the augmented model in the running service.
#[derive(Debug, Clone)]
pub struct ModelSwap {
    /// File of the augmented model.
    pub model: PathBuf,
    /// Live figures of the previous model, and the seconds that they cover.
    pub before: (Option<Fit>, f64),
    /// The service's output with the augmented model loaded.
    pub after: Recording,
    /// The same run, stepped offline (without ROS) with the previous model.
    pub without: Recording,
    /// True when the swap ended the alarm.
    pub ended_alarm: bool,
}

impl ModelSwap {
    /// The command line that runs the new model.
    #[must_use]
    pub fn command(&self) -> String {
        format!("mr-damper node --model {}", self.model.display())
    }

    /// Rows of the table of figures: name and figures.
    fn figures(&self) -> Vec<(String, Option<Fit>)> {
        let length_s = self.after.length_s();
        vec![
            (format!("before: live, {:.0} s", self.before.1), self.before.0),
            (format!("after: live, {length_s:.0} s"), self.after.evaluation().free_run),
            (
                format!("the same {length_s:.0} s without the effect (offline)"),
                self.without.evaluation().free_run,
            ),
        ]
    }

    /// Squared error with the effect divided by the squared error without it, on the run after the swap.
    #[must_use]
    pub fn ratio(&self) -> Option<f64> {
        let (with, without) = (self.after.evaluation().free_run?, self.without.evaluation().free_run?);
        Some((with.rsse_n / without.rsse_n).powi(2))
    }

    /// State of the alarm from the swap on, in words.
    fn alarm(&self) -> String {
        let ended = if self.ended_alarm { "the swap ended it" } else { "it was not raised at the swap" };
        match self.after.alarms.iter().find(|change| change.raised) {
            Some(change) => {
                format!("{ended}; raised AGAIN {:.1} s after it", self.after.seconds(change.stamp))
            }
            None => format!("{ended}; not raised since"),
        }
    }
}

/// The alarms of `recording`, in words.
#[must_use]
pub fn alarms(recording: &Recording) -> Vec<String> {
    recording
        .alarms
        .iter()
        .map(|change| {
            let at_s = recording.seconds(change.stamp);
            if change.raised {
                format!(
                    "raised {at_s:.2} s into the run (stamp {}): the residual's RMSE was {:.1} times the value \
                     expected from the model's identification",
                    in_seconds(change.stamp),
                    change.ratio
                )
            } else {
                format!("ended {at_s:.2} s into the run")
            }
        })
        .collect()
}

/// The result as text for a terminal.
#[must_use]
pub fn text(demo: &DemoDiagnosis) -> String {
    // Writing to a string cannot fail.
    let mut text = String::new();
    diagnosis::paragraph(&mut text, 0, &format!("{} ({:.1} s)", demo.runs, demo.seconds));
    text += &diagnosis::short(&demo.result, demo.drive);
    diagnosis::paragraph(&mut text, 2, &demo.truth);
    let Some(swap) = &demo.swap else { return text };
    let figures = swap.figures();
    let width = figures.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    let _ = writeln!(text, "\n{:<width$} {:>9}  {:>8}", "simulation in the running service", "RMSE", "NMSE");
    for (name, fit) in figures {
        let cells = fit.map_or_else(|| "-".to_owned(), |f| format!("{:7.2} N  {:8.5}", f.rsse_n, f.esr));
        let _ = writeln!(text, "{name:<width$} {cells}");
    }
    if let Some(ratio) = swap.ratio() {
        let _ = writeln!(text, "with the effect, {} of the squared error remains", words::percent(ratio));
    }
    let _ = writeln!(text, "alarm: {}", swap.alarm());
    let _ = writeln!(text, "model: {}", swap.model.display());
    let _ = writeln!(text, "  run it with: {}", swap.command());
    text
}

/// The result as a part of the HTML report.
#[must_use]
pub fn html(demo: &DemoDiagnosis) -> Markup {
    html! {
        p { strong { (words::verdict(&demo.result)) } " " (words::proof(demo.result.test.as_ref())) }
        p { "It was " (demo.runs) ", in " (format!("{:.1}", demo.seconds)) " s. " (demo.truth) }
        (diagnosis::found(&demo.result, demo.drive))
        @if let Some(swap) = &demo.swap { (before_and_after(swap)) }
    }
}

fn before_and_after(swap: &ModelSwap) -> Markup {
    let rows: Vec<Vec<String>> = swap
        .figures()
        .into_iter()
        .map(|(name, fit)| {
            let cells = fit.map_or_else(
                || ["–", "–"].map(str::to_owned),
                |f| [format!("{:.2}", f.rsse_n), format!("{:.5}", f.esr)],
            );
            std::iter::once(name).chain(cells).collect()
        })
        .collect();
    let line = |name: &str, ink: Ink, recording: &Recording| Series {
        name: name.to_owned(),
        ink,
        shape: Shape::Line,
        points: with_breaks(
            &recording
                .residuals
                .iter()
                .map(|r| (recording.seconds(r.stamp), r.residual.get()))
                .collect::<Vec<_>>(),
        ),
    };
    let plot = Plot {
        description: "Residual of the simulation after the swap, with and without the effect".to_owned(),
        x_label: "time since the swap, s".to_owned(),
        y_label: "residual, N".to_owned(),
        x_range: Some(whole_run(&swap.after)),
        series: vec![
            line("without the effect (previous model, offline)", Ink::Before, &swap.without),
            line("with the effect (live)", Ink::After, &swap.after),
        ],
        ..Plot::default()
    };
    html! {
        h3 { "The running service, before and after the swap" }
        (table(&["simulation (free run)", "#RMSE, N", "#NMSE"], &rows))
        (plot.figure("Measured force minus simulated force (free run), on the run that was played after the swap: as the \
                      service published it, and as the previous model gives it offline."))
        p { "Alarm: " (swap.alarm()) ". The new model is " code { (swap.model.display()) } "; run it with "
            code { (swap.command()) } "." }
    }
}
