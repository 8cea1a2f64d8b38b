//! The report of a comparison: error of each model by training experiment, and time per step.

mod inverse;
pub mod order;
pub mod published;
mod tables;

use super::box_plot::{self, BoxRow};
use super::page::{page, section};
use super::plot::{Ink, Plot, Series, Shape};
use super::scatter::{self, NamedPoint};
use super::table::{facts, table};
use maud::{Markup, PreEscaped, html};
use mr_damper_model::compare::{
    BoxPlot, Finished, FinishedInverse, InverseRow, Persistence, Predictor, Summary,
};
use published::Published;
use serde::Serialize;

/// Colours of the models in a picture, best model first.
const INKS: [Ink; 3] = [Ink::Estimate, Ink::Trend, Ink::Level(2)];

/// Style sheet class of the colour for each form of a model, and the form's name in the legend.
const FORM_INKS: [(&str, &str); 3] =
    [("estimate", "with drive"), ("level2", "fuzzy sets over the drive"), ("level0", "passive")];

/// Time that one step of a model takes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StepTime {
    /// Name of the model.
    pub model: String,
    /// How the drive enters it.
    pub form: String,
    /// Time of one simulation step, ns.
    pub ns_per_step: f64,
}

/// Points `(x, y)` of a curve.
pub type CurvePoints = Vec<(f64, f64)>;

/// The simulated curve of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Name of the model.
    pub name: String,
    /// Lines, each in order of x.
    pub lines: Vec<CurvePoints>,
}

/// A picture with the measured curve and the curves of a few models, best first.
#[derive(Debug, Clone, PartialEq)]
pub struct ForcePlot {
    /// Title of the picture.
    pub title: String,
    /// The measured curve.
    pub measured: CurvePoints,
    /// The models.
    pub models: Vec<Curve>,
}

/// Everything the report shows.
#[derive(Debug, Clone, Default)]
pub struct CompareOutcome<'a> {
    /// The comparison in a sentence.
    pub what: String,
    /// Names and values that say how the comparison was run.
    pub facts: Vec<(String, String)>,
    /// Results of each model on each training run.
    pub cells: &'a [Finished],
    /// Summaries of these results, best model first.
    pub summaries: &'a [Summary],
    /// Error of persistence on every run.
    pub persistence: &'a [Persistence],
    /// Published figures to compare with.
    pub published: Option<&'a Published>,
    /// Time per step of each model.
    pub step_times: &'a [StepTime],
    /// Results of each inverse method on each training experiment.
    pub inverses: &'a [FinishedInverse],
    /// The best training experiment of each inverse method, best method first.
    pub inverse_ranking: &'a [InverseRow],
    /// Pictures of force over time.
    pub force_time: Vec<ForcePlot>,
    /// Pictures of force over velocity, one per current.
    pub force_velocity: Vec<ForcePlot>,
    /// Caption of the pictures of force over velocity.
    pub force_velocity_caption: String,
}

impl CompareOutcome<'_> {
    /// Time of one step, ns; `None` when it was not measured.
    #[must_use]
    pub fn ns_per_step(&self, model: &str, form: &str) -> Option<f64> {
        self.step_times.iter().find(|s| s.model == model && s.form == form).map(|s| s.ns_per_step)
    }

    /// Mean NMSE (`esr`) and RMSE (`rsse_n`, N) of persistence over all runs.
    fn persistence_means(&self) -> Option<(f64, f64)> {
        let with: Vec<(f64, f64)> =
            self.persistence.iter().filter_map(|p| Some((p.esr?, p.rsse_n?))).collect();
        let count = with.len() as f64;
        let sum = with.iter().fold((0.0, 0.0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
        (count > 0.0).then(|| (sum.0 / count, sum.1 / count))
    }
}

/// The report as one HTML file.
#[must_use]
pub fn html(outcome: &CompareOutcome<'_>) -> String {
    let body = html! {
        (section("What was run", &facts(&outcome.facts)))
        (section("Best first", &tables::best(outcome)))
        @if let Some(published) = outcome.published {
            (section("Order of the models compared with the thesis", &against(outcome, published)))
        }
        (section("Spread over all tests", &boxes(outcome)))
        (section("Error against time per step", &pareto(outcome)))
        (section("Force over time", &force_time(outcome)))
        @if !outcome.force_velocity.is_empty() { (section("Force over velocity", &force_velocity(outcome))) }
        @if !outcome.inverses.is_empty() { (section("Inverse methods", &inverse::section(outcome))) }
        (section("Cross-validation", &tables::cross_validation(outcome)))
        (section("Identification", &tables::identification(outcome)))
    };
    page("MR damper models: comparison", &outcome.what, &body)
}

fn against(outcome: &CompareOutcome<'_>, published: &Published) -> Markup {
    let Some(orders) = order::orders(outcome.summaries, published, outcome.persistence) else {
        return html! { p { "None of the published models is in this comparison." } };
    };
    let places = {
        let mut here: Vec<f64> = orders.ranked.iter().filter_map(|r| Some(r.here.as_ref()?.1)).collect();
        here.sort_by(f64::total_cmp);
        here
    };
    let row = |(place, r): (usize, &order::Ranked)| {
        let here = r.here.as_ref();
        let own = here.and_then(|(_, esr)| places.iter().position(|p| p == esr)).map(|p| (p + 1).to_string());
        vec![
            (place + 1).to_string(),
            order::name(&r.class),
            format!("{:.4}", r.published.1),
            r.published.0.clone(),
            own.unwrap_or("–".to_owned()),
            here.map_or("–".to_owned(), |(_, esr)| format!("{esr:.4}")),
            here.map_or("–".to_owned(), |(on, _)| on.clone()),
        ]
    };
    let columns = [
        "#place in the thesis",
        "=model",
        "#mean NMSE",
        "trained on",
        "#place here",
        "#mean NMSE",
        "trained on",
    ];
    let rows: Vec<Vec<String>> = orders.ranked.iter().enumerate().map(row).collect();
    let tau = |tau: Option<f64>| {
        tau.map_or("not defined".to_owned(), |tau| format!("{tau:+.2}").replace('-', "\u{2212}"))
    };
    html! {
        (table(&columns, &rows))
        p {
            "Models are ordered by the mean NMSE over all tests of their best training experiment. Each is used as in its publication: "
            "ARX for one-step-ahead prediction, p with the measured force as an input, all others in simulation. Rank correlation of the "
            "two orders (Kendall's tau; 1: equal, 0: unrelated, \u{2212}1: reversed): " strong { (tau(orders.tau)) }
            "; with every model in simulation here: " strong { (tau(orders.tau_free_run)) } "."
        }
        ul { @for remark in &orders.remarks { li { (remark) } } }
    }
}

fn boxes(outcome: &CompareOutcome<'_>) -> Markup {
    let rows = |predictor: Predictor, form: &str| -> Vec<BoxRow> {
        let of = outcome.summaries.iter().filter(|s| s.class.predictor == predictor && s.class.form == form);
        let mut rows: Vec<BoxRow> = of
            .map(|summary| BoxRow {
                name: summary.class.model.clone(),
                numbers: summary.spread(),
                remark: match (summary.without, summary.esr.len()) {
                    (0, 0) => "no figure".to_owned(),
                    (0, _) => String::new(),
                    (n, _) => format!("{n} without figure"),
                },
                yardstick: false,
            })
            .collect();
        if predictor == Predictor::OneStep && !rows.is_empty() {
            rows.push(BoxRow {
                name: "persistence".to_owned(),
                numbers: BoxPlot::of(outcome.persistence.iter().filter_map(|p| p.esr)),
                remark: String::new(),
                yardstick: true,
            });
        }
        rows
    };
    // Pictures of one predictor share their axis, so that forms can be compared.
    let pictures = |predictor: Predictor, label: &str, forms: [(&str, &str); 3]| {
        let all = forms.map(|(form, heading)| (heading, rows(predictor, form)));
        let span: Vec<f64> = all.iter().flat_map(|(_, rows)| box_plot::values(rows)).collect();
        html! {
            @for (heading, rows) in all.iter().filter(|(_, rows)| !rows.is_empty()) {
                h3 { (heading) }
                figure { (PreEscaped(box_plot::svg(heading, label, rows, span.iter().copied()))) }
            }
        }
    };
    html! {
        p { "NMSE of every test of every training experiment. The box spans the lower to the upper quartile, with a line at the median; "
            "whiskers reach the last test within 1.5 box lengths; dots are tests beyond. Quartiles are interpolated "
            "between order statistics. Further left is better; the axis is logarithmic." }
        (pictures(Predictor::FreeRun, "NMSE, simulation", [
            ("semi_active", "Simulation, with drive"),
            ("fuzzy", "Simulation, fuzzy sets over the drive"),
            ("passive", "Simulation, without drive (passive)"),
        ]))
        (pictures(Predictor::OneStep, "NMSE, prediction", [
            ("semi_active", "One-step-ahead prediction, with drive"),
            ("fuzzy", "One-step-ahead prediction, fuzzy sets over the drive"),
            ("passive", "One-step-ahead prediction, without drive (passive)"),
        ]))
    }
}

fn pareto(outcome: &CompareOutcome<'_>) -> Markup {
    let ink = |form: &str| match form {
        "passive" => "level0",
        "fuzzy" => "level2",
        _ => "estimate",
    };
    let point = |summary: &Summary| {
        let class = &summary.class;
        Some(NamedPoint {
            name: class.model.clone(),
            x: outcome.ns_per_step(&class.model, &class.form)?,
            y: summary.median_esr()?,
            ink: ink(&class.form),
        })
    };
    let free = outcome.summaries.iter().filter(|s| s.class.predictor == Predictor::FreeRun);
    let (points, without): (Vec<_>, Vec<_>) = free.map(|s| (s, point(s))).partition(|(_, p)| p.is_some());
    let points: Vec<NamedPoint> = points.into_iter().filter_map(|(_, point)| point).collect();
    let without: Vec<String> = without.iter().map(|(s, _)| order::name(&s.class)).collect();
    html! {
        p.legend {
            @for (class, name) in FORM_INKS {
                @if points.iter().any(|p| p.ink == class) { span { i class=(format!("key dot {class}")) {} (name) } }
            }
        }
        figure {
            (PreEscaped(scatter::svg(
                "Median NMSE of the simulation against time per step",
                "time per step, ns",
                "median NMSE, simulation",
                &points,
            )))
            figcaption {
                "Median over all tests (a test without a figure counts as the worst) against the time of one simulation "
                "step on one thread of this machine. Models on the dashed staircase are not beaten in both by any other. Names that would "
                "overlap are left out; the table lists all models."
            }
        }
        @if !without.is_empty() { p { "Without a median: " (without.join(", ")) "." } }
    }
}

fn series(picture: &ForcePlot, shape: Shape) -> Vec<Series> {
    let measured =
        Series { name: "measured".to_owned(), ink: Ink::Measured, shape, points: picture.measured.clone() };
    let line = |(index, points): (usize, &CurvePoints), curve: &Curve, ink| Series {
        // Only the first line of a curve gets an entry in the legend.
        name: if index == 0 { curve.name.clone() } else { String::new() },
        ink,
        shape: Shape::Line,
        points: points.clone(),
    };
    let models = picture.models.iter().zip(INKS);
    let models =
        models.flat_map(|(curve, ink)| curve.lines.iter().enumerate().map(move |l| line(l, curve, ink)));
    std::iter::once(measured).chain(models).collect()
}

/// The plot of a picture of force over time.
#[must_use]
pub fn force_time_plot(picture: &ForcePlot) -> Plot {
    Plot {
        description: picture.title.clone(),
        x_label: "time, s".to_owned(),
        y_label: "force, N".to_owned(),
        height: 280.0,
        series: series(picture, Shape::Line),
        ..Plot::default()
    }
}

fn force_time(outcome: &CompareOutcome<'_>) -> Markup {
    html! {
        @for picture in &outcome.force_time { (force_time_plot(picture).figure(&picture.title)) }
        @if outcome.force_time.is_empty() { p { "No model could be simulated on these runs." } }
    }
}

/// The plots of pictures of force over velocity, with the same axes, each with its title.
#[must_use]
pub fn force_velocity_plots(pictures: &[ForcePlot]) -> Vec<(String, Plot)> {
    let all = || pictures.iter().flat_map(|p| p.models.iter().flat_map(|m| &m.lines).chain([&p.measured]));
    let bound = |pick: fn(&(f64, f64)) -> f64| {
        all().flatten().map(|p| pick(p).abs()).filter(|v| v.is_finite()).fold(0.0, f64::max) * 1.03
    };
    let (v, f) = (bound(|p| p.0).max(1e-6), bound(|p| p.1).max(1e-6));
    let plot = |picture: &ForcePlot| Plot {
        description: format!("Force over velocity at {}", picture.title),
        x_label: "velocity, m/s".to_owned(),
        y_label: "force, N".to_owned(),
        x_range: Some((-v, v)),
        y_range: Some((-f, f)),
        height: 380.0,
        series: series(picture, Shape::Dots),
        ..Plot::default()
    };
    pictures.iter().map(|picture| (picture.title.clone(), plot(picture))).collect()
}

fn force_velocity(outcome: &CompareOutcome<'_>) -> Markup {
    html! {
        p { (outcome.force_velocity_caption) }
        @for pair in force_velocity_plots(&outcome.force_velocity).chunks(2) {
            div.pair { @for (title, plot) in pair { (plot.figure(title)) } }
        }
    }
}

#[cfg(test)]
mod tests;
