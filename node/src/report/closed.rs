//! How the demo closed the loop: what was named, and the live error before and after.

use super::Recording;
use super::close::{self, words};
use super::panels::{whole_run, with_breaks};
use super::plot::{Ink, Plot, Series, Shape};
use super::table::table;
use crate::wire::in_seconds;
use maud::{Markup, html};
use mr_damper_model::diagnose::Closing;
use mr_damper_model::metrics::Fit;
use mr_damper_model::sample::DriveKind;
use mr_damper_model::units::N_PER_LBF;
use std::fmt::Write;
use std::path::PathBuf;

/// What closing the loop came to.
#[derive(Debug, Clone)]
pub struct Closed {
    /// The diagnosis.
    pub closing: Closing,
    /// Kind of the drive.
    pub drive: Option<DriveKind>,
    /// How long it took, s.
    pub seconds: f64,
    /// What it was found on, in words.
    pub runs: String,
    /// What had been put into the rig, in words.
    pub truth: String,
    /// The swap; `None` when nothing was named, or the demo was ended before.
    pub swap: Option<Swap>,
}

/// The model with the effect in the running service.
#[derive(Debug, Clone)]
pub struct Swap {
    /// Its file.
    pub model: PathBuf,
    /// Live figures of the model before, and seconds that they are of.
    pub before: (Option<Fit>, f64),
    /// What the service said with the new model in force.
    pub after: Recording,
    /// The same run, stepped without ROS with the model before.
    pub without: Recording,
    /// The swap ended the alarm.
    pub ended_alarm: bool,
}

impl Swap {
    /// The line that runs the new model.
    #[must_use]
    pub fn command(&self) -> String {
        format!("mr-damper node --model {}", self.model.display())
    }

    /// Rows of figures: whose, and the figures.
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

    /// Squared error with the effect over that without it, on the run after the swap.
    #[must_use]
    pub fn ratio(&self) -> Option<f64> {
        let (with, without) = (self.after.evaluation().free_run?, self.without.evaluation().free_run?);
        Some((with.rsse_n / without.rsse_n).powi(2))
    }

    /// The alarm from the swap on, in words.
    fn alarm(&self) -> String {
        let ended = if self.ended_alarm { "the swap ended it" } else { "it did not stand at the swap" };
        match self.after.alarms.iter().find(|change| change.raised) {
            Some(change) => {
                format!("{ended}; raised AGAIN {:.1} s after it", self.after.seconds(change.stamp))
            }
            None => format!("{ended}; none since"),
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
                    "raised {at_s:.2} s into the run (stamp {}): the residual was {:.1} times what the model's \
                     identification promised",
                    in_seconds(change.stamp),
                    change.ratio
                )
            } else {
                format!("ended {at_s:.2} s into the run")
            }
        })
        .collect()
}

/// For a terminal.
#[must_use]
pub fn text(closed: &Closed) -> String {
    // Writing to a string cannot fail.
    let mut text = String::new();
    close::paragraph(&mut text, 0, &format!("{} ({:.1} s)", closed.runs, closed.seconds));
    text += &close::short(&closed.closing, closed.drive);
    close::paragraph(&mut text, 2, &closed.truth);
    let Some(swap) = &closed.swap else { return text };
    let figures = swap.figures();
    let width = figures.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    let _ = writeln!(text, "\n{:<width$} {:>18}  {:>8}", "free run in the running service", "RSSE", "ESR");
    for (name, fit) in figures {
        let cells = fit.map_or_else(
            || "-".to_owned(),
            |f| format!("{:7.2} N {:5.2} lbf  {:8.5}", f.rsse_n, f.rsse_n / N_PER_LBF, f.esr),
        );
        let _ = writeln!(text, "{name:<width$} {cells}");
    }
    if let Some(ratio) = swap.ratio() {
        let _ = writeln!(text, "with the effect {} of the squared error is left", words::percent(ratio));
    }
    let _ = writeln!(text, "alarm: {}", swap.alarm());
    let _ = writeln!(text, "model: {}", swap.model.display());
    let _ = writeln!(text, "  run it with: {}", swap.command());
    text
}

/// For the report.
#[must_use]
pub fn html(closed: &Closed) -> Markup {
    html! {
        p { strong { (words::verdict(&closed.closing)) } " " (words::proof(closed.closing.test.as_ref())) }
        p { "It was " (closed.runs) ", in " (format!("{:.1}", closed.seconds)) " s. " (closed.truth) }
        (close::found(&closed.closing, closed.drive))
        @if let Some(swap) = &closed.swap { (before_and_after(swap)) }
    }
}

fn before_and_after(swap: &Swap) -> Markup {
    let rows: Vec<Vec<String>> = swap
        .figures()
        .into_iter()
        .map(|(name, fit)| {
            let cells = fit.map_or_else(
                || ["–", "–", "–"].map(str::to_owned),
                |f| {
                    [
                        format!("{:.2}", f.rsse_n),
                        format!("{:.2}", f.rsse_n / N_PER_LBF),
                        format!("{:.5}", f.esr),
                    ]
                },
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
        description: "Residual of the free-running model after the swap, with and without the effect"
            .to_owned(),
        x_label: "time since the swap, s".to_owned(),
        y_label: "residual, N".to_owned(),
        x_range: Some(whole_run(&swap.after)),
        series: vec![
            line("without the effect (the model before, offline)", Ink::Before, &swap.without),
            line("with the effect (live)", Ink::After, &swap.after),
        ],
        ..Plot::default()
    };
    html! {
        h3 { "The running service, before and after the swap" }
        (table(&["free run", "#RSSE, N", "#RSSE, lbf", "#ESR"], &rows))
        (plot.figure("Measured force minus free run, on the run that was played after the model was swapped in: as the \
                      service said it, and as it would have been with the model before."))
        p { "Alarm: " (swap.alarm()) ". The new model is " code { (swap.model.display()) } "; run it with "
            code { (swap.command()) } "." }
    }
}
