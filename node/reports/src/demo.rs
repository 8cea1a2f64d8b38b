//! The demo's HTML report: the service's output for one run.

use super::correlate;
use super::demo_diagnosis::{self, DemoDiagnosis, NoDiagnosis};
use super::page::{capital, page, section};
use super::panels::{force_over_velocity, residual_panels, whole_run, with_breaks};
use super::plot::{Band, Ink, Plot, Series, Shape};
use super::recording::Recording;
use super::table::{facts, table};
use maud::{Markup, html};
use mr_damper_model::metrics::Fit;
use mr_damper_model::sample::{Channel, DriveKind};

/// One line of the table of figures.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// The predicted quantity and the kind of prediction.
    pub name: String,
    /// Errors computed from the received events.
    pub live: Option<Fit>,
    /// Errors on the same run, stepped offline (without ROS).
    pub offline: Option<Fit>,
}

/// Whether the live figures equal the offline figures (computed without ROS).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Agreement {
    /// They agree; the largest relative difference is this, below the limit.
    Same(f64),
    /// They differ by this relative amount, above the limit.
    Differs(f64),
    /// Samples were lost or delivered late in the live run; the figures differ by this relative amount.
    Disturbed(f64),
    /// There is nothing to compare, because the run was cut short.
    NotCompared,
}

impl Agreement {
    /// The comparison as a sentence.
    #[must_use]
    pub fn text(self) -> String {
        match self {
            Self::Same(0.0) => "live and offline figures are bit-identical".to_owned(),
            Self::Same(by) => format!("live and offline figures agree (relative difference {by:.1e})"),
            Self::Differs(by) => format!("live and offline figures DIFFER (relative difference {by:.1e})"),
            Self::Disturbed(by) => format!(
                "samples were lost or delayed in transit, so live and offline figures differ (relative difference {by:.1e})"
            ),
            Self::NotCompared => "the run was cut short: live figures of the played part only".to_owned(),
        }
    }
}

/// Everything the report shows.
#[derive(Debug, Clone, Default)]
pub struct DemoOutcome {
    /// The run and the models, in a sentence or two.
    pub what: String,
    /// The service's output.
    pub recording: Recording,
    /// Measured force that the service was not given: time since the first sample, s, and force, N.
    pub withheld: Vec<(f64, f64)>,
    /// The figures.
    pub figures: Vec<Figure>,
    /// Whether live and offline figures agree.
    pub agreement: Option<Agreement>,
    /// Result of the diagnosis, or why there was none.
    pub diagnosis: Option<Result<DemoDiagnosis, NoDiagnosis>>,
    /// Remarks below the figures.
    pub notes: Vec<String>,
    /// Names and values of the message counters.
    pub counts: Vec<(String, String)>,
    /// Settings of the service.
    pub settings: Vec<(String, String)>,
    /// Names and values that say how the report was made (tool version, seed, files).
    pub provenance: Vec<(String, String)>,
}

/// Name of the figure for the estimates published while measured force was withheld.
pub const WITHOUT_FORCE: &str = "estimate without measured force";

/// The report as one HTML file.
#[must_use]
pub fn html(outcome: &DemoOutcome) -> String {
    let points = correlate::residual_points(&outcome.recording);
    let body = html! {
        @if let Some(agreement) = outcome.agreement {
            p.verdict.bad[!matches!(agreement, Agreement::Same(_))] { (capital(&agreement.text())) "." }
        }
        (section("Figures", &figures(outcome)))
        @if let Some(diagnosis) = &outcome.diagnosis {
            @let body = match diagnosis {
                Ok(diagnosis) => demo_diagnosis::html(diagnosis),
                Err(why) => html! { p { (why) } },
            };
            (section("Diagnosis and model augmentation", &body))
        }
        (section("Force over time", &force_over_time(outcome)))
        (section("Residual over time", &residual_over_time(outcome)))
        (section("Force over velocity", &force_over_velocity(&points, DriveKind::CoilCurrent)))
        (section("Remaining residual", &residual_panels(&points, DriveKind::CoilCurrent)))
        (section("Modes", &modes(&outcome.recording)))
        (section("Traffic", &facts(&outcome.counts)))
        (section("Settings", &facts(&outcome.settings)))
        (section("Provenance", &facts(&outcome.provenance)))
    };
    page("MR damper force service: demo", &outcome.what, &body)
}

fn figures(outcome: &DemoOutcome) -> Markup {
    let cells = |fit: Option<Fit>| match fit {
        Some(fit) => [format!("{:.2}", fit.rsse_n), format!("{:.5}", fit.esr), fit.samples.to_string()],
        None => ["–", "–", "–"].map(str::to_owned),
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
        (table(&["", "#RMSE, N", "#NMSE", "#samples", "#NMSE offline"], &rows))
        p { "RMSE is the root mean squared error (RSSE in the thesis). NMSE is the normalised one (ESR in the thesis): the squared RMSE over the "
            "variance of the measured force; 0 is perfect, 1 is as good as the mean. " em { "Simulation (free run)" } " uses displacement and \
            current only; "
            em { "one step ahead" } " is a prediction that also knows the measured force up to the previous sample. Its baseline is "
            em { "persistence" } ", the previous measured force repeated. Do not compare simulation and prediction errors." }
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

fn force_over_time(outcome: &DemoOutcome) -> Markup {
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
        // A band outside the picture would appear in the legend only.
        zoom.bands.retain(|band| band.to > range.0 && band.from < range.1);
        zoom
    });
    html! {
        (whole.figure("The whole run. The service does not receive the force drawn as a dashed line."))
        @if let Some(zoom) = zoom {
            (zoom.figure("Two seconds around the loss of measured force: ARX seeded with measured force, then ARX coasting, \
                          then the simulated model."))
        }
    }
}

fn residual_over_time(outcome: &DemoOutcome) -> Markup {
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
        description: "Residual of the simulation over time".to_owned(),
        x_label: "time, s".to_owned(),
        y_label: "residual, N".to_owned(),
        x_range: Some(whole_run(recording)),
        height: 240.0,
        bands: away,
        series: vec![
            Series {
                name: "measured minus simulation".to_owned(),
                ink: Ink::Residual,
                shape: Shape::Line,
                points: of(|r| r.residual.get()),
            },
            Series {
                name: format!("RMSE with exponential forgetting over {window_s:.0} s"),
                ink: Ink::Trend,
                shape: Shape::Line,
                points: of(|r| r.windowed_rsse.get()),
            },
        ],
        ..Plot::default()
    };
    let alarms = demo_diagnosis::alarms(recording);
    html! {
        (plot.figure("The residual is measured force minus simulated force (free run). An estimate seeded with measured force would hide it."))
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
