//! The demo's report: what the service made of one run.

use super::closed::{self, Closed};
use super::correlate;
use super::page::{capital, page, section};
use super::panels::{force_over_velocity, what_is_left_over, whole_run, with_breaks};
use super::plot::{Band, Ink, Plot, Series, Shape};
use super::recording::Recording;
use super::table::{facts, table};
use maud::{Markup, html};
use mr_damper_model::metrics::Fit;
use mr_damper_model::sample::{Channel, DriveKind};
use mr_damper_model::units::N_PER_LBF;

/// One line of the table of figures.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// What was predicted, and how.
    pub name: String,
    /// From the events that were received.
    pub live: Option<Fit>,
    /// From the same run, stepped without ROS.
    pub offline: Option<Fit>,
}

/// Whether the live figures are those of an evaluation without ROS.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Agreement {
    /// Equal to this relative difference, which is below the limit.
    Same(f64),
    /// They differ by this share, more than the limit.
    Differs(f64),
    /// The live run was disturbed (samples lost, a late delivery), and the figures differ by this share.
    Disturbed(f64),
    /// Nothing to compare: the run was cut short.
    NotCompared,
}

impl Agreement {
    /// In words.
    #[must_use]
    pub fn text(self) -> String {
        match self {
            Self::Same(0.0) => "live and offline figures are the same to the last bit".to_owned(),
            Self::Same(by) => format!("live and offline agree (largest relative difference {by:.1e})"),
            Self::Differs(by) => format!("live and offline DIFFER, by {by:.1e} of the figure"),
            Self::Disturbed(by) => format!(
                "samples were lost or delayed on the way, so live and offline differ, by {by:.1e} of the figure"
            ),
            Self::NotCompared => "the run was cut short: live figures alone, of what was played".to_owned(),
        }
    }
}

/// All that the report tells.
#[derive(Debug, Clone, Default)]
pub struct Outcome {
    /// What was run, in a sentence or two.
    pub what: String,
    /// What the service said.
    pub recording: Recording,
    /// Force that the load cell had but the service was not given: s since the first sample, N.
    pub withheld: Vec<(f64, f64)>,
    /// The figures.
    pub figures: Vec<Figure>,
    /// Whether they agree.
    pub agreement: Option<Agreement>,
    /// How the loop was closed, or why it was not.
    pub closed: Option<Result<Closed, String>>,
    /// Remarks below the figures.
    pub notes: Vec<String>,
    /// Counts of what went in and out.
    pub counts: Vec<(String, String)>,
    /// Settings of the service.
    pub settings: Vec<(String, String)>,
    /// Where all of it comes from.
    pub provenance: Vec<(String, String)>,
}

/// Name of the figure of the published estimates in the time without measured force.
pub const WITHOUT_FORCE: &str = "estimate while measured force was away";

/// The report as one HTML file.
#[must_use]
pub fn html(outcome: &Outcome) -> String {
    let points = correlate::left_over(&outcome.recording);
    let body = html! {
        @if let Some(agreement) = outcome.agreement {
            p.verdict.bad[!matches!(agreement, Agreement::Same(_))] { (capital(&agreement.text())) "." }
        }
        (section("Figures", &figures(outcome)))
        @if let Some(closed) = &outcome.closed {
            @let body = match closed {
                Ok(closed) => closed::html(closed),
                Err(why) => html! { p { (why) } },
            };
            (section("Closing the loop", &body))
        }
        (section("Force over time", &force_over_time(outcome)))
        (section("Residual over time", &residual_over_time(outcome)))
        (section("Force over velocity", &force_over_velocity(&points, DriveKind::CoilCurrent)))
        (section("What is left over", &what_is_left_over(&points, DriveKind::CoilCurrent)))
        (section("Modes", &modes(&outcome.recording)))
        (section("Traffic", &facts(&outcome.counts)))
        (section("Settings", &facts(&outcome.settings)))
        (section("Provenance", &facts(&outcome.provenance)))
    };
    page("MR damper force service: demo", &outcome.what, &body)
}

fn figures(outcome: &Outcome) -> Markup {
    let cells = |fit: Option<Fit>| match fit {
        Some(fit) => [
            format!("{:.2}", fit.rsse_n),
            format!("{:.2}", fit.rsse_n / N_PER_LBF),
            format!("{:.5}", fit.esr),
            fit.samples.to_string(),
        ],
        None => ["–", "–", "–", "–"].map(str::to_owned),
    };
    let rows: Vec<Vec<String>> = outcome
        .figures
        .iter()
        .map(|figure| {
            let offline = figure.offline.map_or("–".to_owned(), |fit| format!("{:.5}", fit.esr));
            let mut row = vec![figure.name.clone()];
            row.extend(cells(figure.live));
            row.push(offline);
            row
        })
        .collect();
    html! {
        (table(&["", "#RSSE, N", "#RSSE, lbf", "#ESR", "#samples", "#ESR offline"], &rows))
        p { "RSSE is the root mean squared error; ESR is its square over the variance of the measured force, so 0 is "
            "perfect and 1 is no better than the mean. " em { "Free run" } " knows displacement and current alone; "
            em { "one step" } " is given the measured force up to the sample before, and " em { "persistence" }
            " (the force stays what it was) is its yardstick. The two are different tasks: do not compare them." }
        @for note in &outcome.notes { p { (note) } }
    }
}

fn mode_bands(recording: &Recording) -> Vec<Band> {
    recording
        .periods()
        .iter()
        .map(|period| Band {
            from: period.span_s.0,
            to: period.span_s.1,
            class: period.mode.name(),
            name: format!("mode {}", period.mode.name()),
        })
        .collect()
}

fn force_over_time(outcome: &Outcome) -> Markup {
    let recording = &outcome.recording;
    let estimate = recording.estimates.iter().map(|e| (recording.seconds(e.stamp), e.force.get())).collect();
    let measured = with_breaks(&recording.points(Channel::Force));
    let line = |name: &str, ink: Ink, points: Vec<(f64, f64)>| Series {
        name: name.to_owned(),
        ink,
        shape: Shape::Line,
        points,
    };
    let whole = Plot {
        description: "Measured force and published estimate over the whole run".to_owned(),
        x_label: "time, s".to_owned(),
        y_label: "force, N".to_owned(),
        x_range: Some(whole_run(recording)),
        bands: mode_bands(recording),
        series: vec![
            line("measured", Ink::Measured, measured),
            line("measured, withheld", Ink::Withheld, outcome.withheld.clone()),
            line("estimate as published", Ink::Estimate, estimate),
        ],
        ..Plot::default()
    };
    let zoom = outcome.withheld.first().map(|first| {
        let range = (first.0 - 0.5, first.0 + 1.5);
        let mut zoom = Plot {
            description: "Two seconds around the loss of measured force".to_owned(),
            x_range: Some(range),
            ..whole.clone()
        };
        // A band outside the picture would only be in its legend.
        zoom.bands.retain(|band| band.to > range.0 && band.from < range.1);
        zoom
    });
    html! {
        (whole.figure("The whole run. While measured force is away the service does not see the dashed line."))
        @if let Some(zoom) = zoom {
            (zoom.figure("Two seconds around the loss of measured force: ARX seeded with it, then coasting, then the \
                          free-running model."))
        }
    }
}

fn residual_over_time(outcome: &Outcome) -> Markup {
    let recording = &outcome.recording;
    let of = |pick: fn(&mr_damper_model::pipeline::Residual) -> f64| -> Vec<(f64, f64)> {
        with_breaks(
            &recording.residuals.iter().map(|r| (recording.seconds(r.stamp), pick(r))).collect::<Vec<_>>(),
        )
    };
    let away = match (outcome.withheld.first(), outcome.withheld.last()) {
        (Some(first), Some(last)) => {
            vec![Band { from: first.0, to: last.0, class: "away", name: "no measured force".to_owned() }]
        }
        _ => Vec::new(),
    };
    let window_s = recording.residuals.last().map_or(0.0, |residual| residual.window.get());
    let plot = Plot {
        description: "Residual of the free-running model over time".to_owned(),
        x_label: "time, s".to_owned(),
        y_label: "residual, N".to_owned(),
        x_range: Some(whole_run(recording)),
        height: 240.0,
        bands: away,
        series: vec![
            Series {
                name: "measured minus free run".to_owned(),
                ink: Ink::Residual,
                shape: Shape::Line,
                points: of(|r| r.residual.get()),
            },
            Series {
                name: format!("RSSE, forgetting over {window_s:.0} s"),
                ink: Ink::Trend,
                shape: Shape::Line,
                points: of(|r| r.windowed_rsse.get()),
            },
        ],
        ..Plot::default()
    };
    let alarms = closed::alarms(recording);
    html! {
        (plot.figure("The residual is always the free-running model's: an estimate seeded with measured force would hide it."))
        @for alarm in &alarms { p { "Alarm: " (alarm) "." } }
        @if alarms.is_empty() { p { "There was no alarm." } }
    }
}

fn modes(recording: &Recording) -> Markup {
    let rows: Vec<Vec<String>> = recording
        .periods()
        .iter()
        .map(|period| {
            vec![
                format!("{:.2}", period.span_s.0),
                format!("{:.2}", period.span_s.1),
                period.mode.name().to_owned(),
                period.cause.to_owned(),
                period.worst.name().to_owned(),
                period.reasons.names().collect::<Vec<_>>().join(", "),
                period.estimates.to_string(),
            ]
        })
        .collect();
    let columns = ["#from, s", "#to, s", "mode", "why", "worst validity", "reasons given", "#estimates"];
    table(&columns, &rows)
}
