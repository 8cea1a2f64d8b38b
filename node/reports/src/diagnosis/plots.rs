//! Plots of the residual before and after augmentation.

use super::traces::{RunTrace, TracePoint};
use crate::page::section;
use crate::plot::{Ink, Plot, Series, Shape, binned_quartiles};
use maud::{Markup, html};
use mr_damper_model::sample::DriveKind;
use mr_damper_model::statistics::correlation::{CorrelationFunction, autocorrelation, cross_correlation};
use mr_damper_model::statistics::spectrum::Spectra;

/// Number of runs that get their own plots.
const PLOTTED_RUNS: usize = 4;
/// Length of the part that is shown as force over time, s, and of the part shown as force over velocity, s.
const PART_S: f64 = 3.0;
const LOOP_S: f64 = 1.0;
/// Bins on the x axis of the plots of the residual against a signal.
const BINS: usize = 30;
/// Length of a segment of the spectra, s, and its minimum number of samples.
const SEGMENT_S: f64 = 2.0;
const SHORTEST: usize = 64;
/// Largest lag of the correlation functions, s, and largest lag of the autocorrelations that widen their bands, s.
const REACH_S: f64 = 0.25;
const COLOUR_S: f64 = 1.0;

type Pick = fn(&TracePoint) -> f64;

/// One side of the comparison: its name, colour and residual.
type Side = (&'static str, Ink, Pick);

const BEFORE: Side = ("before", Ink::Before, |point| point.before_n);
const AFTER: Side = ("after", Ink::After, |point| point.after_n);

/// The residuals of some runs. Curves "after" are drawn only when an effect or a term was `named`.
#[derive(Debug, Clone, Copy)]
pub(super) struct ResidualPlots<'a> {
    pub(super) runs: &'a [RunTrace],
    pub(super) named: bool,
}

impl ResidualPlots<'_> {
    /// All plots as sections, or a sentence when there is nothing to draw.
    pub(super) fn sections(&self) -> Markup {
        if self.runs.iter().all(|run| run.points().next().is_none()) {
            return html! { p { "The runs have no residual to draw." } };
        }
        html! {
            (section("Force over time and velocity", &self.forces()))
            (section("Residual over time", &self.over_time()))
            (section("Residual against what might explain it", &self.against()))
            (section("Spectra", &self.spectra()))
            (section("Correlation functions", &self.lags()))
        }
    }

    fn sides(&self) -> Vec<Side> {
        if self.named { vec![BEFORE, AFTER] } else { vec![BEFORE] }
    }

    fn drive(&self) -> (&'static str, &'static str) {
        match self.runs.iter().find_map(|run| run.drive) {
            Some(DriveKind::CommandVoltage) => ("command", "V"),
            _ => ("current", "A"),
        }
    }

    fn forces(&self) -> Markup {
        let part = |run: &RunTrace| -> Option<Markup> {
            let (stretch, middle) = most_mended(run)?;
            let middle_s = stretch[middle].time_s;
            let within = |half_s: f64| {
                let from = stretch.partition_point(|point| point.time_s < middle_s - half_s);
                let to = stretch.partition_point(|point| point.time_s <= middle_s + half_s);
                &stretch[from..to]
            };
            let (part, round) = (within(0.5 * PART_S), within(0.5 * LOOP_S));
            let plot = |points: &[TracePoint], x_label: &str, x: Pick, shape: Shape, height: f64| Plot {
                description: format!("Force of {} over {x_label}: measured, before and after", run.run),
                x_label: x_label.to_owned(),
                y_label: "force, N".to_owned(),
                height,
                series: self.force_series(points, x, shape),
                ..Plot::default()
            };
            Some(html! {
                h3 { (run.run) }
                (plot(part, "time, s", |p| p.time_s, Shape::Line, 240.0).figure(""))
                (plot(round, "velocity, m/s", |p| p.velocity_m_s, Shape::Loop, 340.0).figure(&format!(
                    "The middle second of this part, over velocity ({:.2} to {:.2} s).",
                    round.first().map_or(0.0, |p| p.time_s), round.last().map_or(0.0, |p| p.time_s)
                )))
            })
        };
        html! {
            p.lead { "The part of each run that improved most. The models are simulated, with the run's own offset." }
            @for run in self.runs.iter().take(PLOTTED_RUNS) { @if let Some(part) = part(run) { (part) } }
            (self.left_out())
        }
    }

    fn force_series(&self, points: &[TracePoint], x: Pick, shape: Shape) -> Vec<Series> {
        let measured: Side = ("measured", Ink::Measured, |_| 0.0);
        let all = std::iter::once(measured).chain(self.sides());
        all.map(|(name, ink, residual)| Series {
            name: name.to_owned(),
            ink,
            shape,
            points: points.iter().map(|p| (x(p), p.measured_n - residual(p))).collect(),
        })
        .collect()
    }

    fn left_out(&self) -> Markup {
        html! {
            @if self.runs.len() > PLOTTED_RUNS {
                p { "Pictures of " (self.runs.len() - PLOTTED_RUNS) " more runs are left out; the pictures below combine all runs." }
            }
        }
    }

    fn over_time(&self) -> Markup {
        let plot = |run: &RunTrace| Plot {
            description: format!("Residual of {} over time, before and after", run.run),
            x_label: "time, s".to_owned(),
            y_label: "residual, N".to_owned(),
            height: 220.0,
            series: self
                .sides()
                .into_iter()
                .map(|(name, ink, residual)| Series {
                    name: name.to_owned(),
                    ink,
                    shape: Shape::Line,
                    points: joined(run, |p| (p.time_s, residual(p))),
                })
                .collect(),
            ..Plot::default()
        };
        html! { @for run in self.runs.iter().take(PLOTTED_RUNS) { (plot(run).figure(&run.run)) } }
    }

    fn against(&self) -> Markup {
        let (drive, unit) = self.drive();
        let suspects: [(String, Pick); 8] = [
            ("time, s".to_owned(), |p| p.time_s),
            ("displacement, m".to_owned(), |p| p.displacement_m),
            ("velocity, m/s".to_owned(), |p| p.velocity_m_s),
            ("acceleration, m/s²".to_owned(), |p| p.acceleration_m_s2),
            (format!("{drive}, {unit}"), |p| p.drive),
            (format!("slope of the {drive}, {unit}/s"), |p| p.drive_slope),
            (format!("the same in the direction of motion, {unit}/s"), directed_slope),
            ("case temperature, °C".to_owned(), |p| p.case_temp_c),
        ];
        let plots: Vec<(&str, Option<Plot>)> =
            suspects.iter().map(|(label, pick)| (label.as_str(), self.ribbons(label, *pick))).collect();
        let missing: Vec<&str> =
            plots.iter().filter(|(_, plot)| plot.is_none()).map(|(label, _)| *label).collect();
        html! {
            p.lead { "Lines are medians; areas contain the middle half of the samples. All runs are combined. A correlation "
                "does not prove a cause." }
            div.pair { @for plot in plots.iter().filter_map(|(_, plot)| plot.as_ref()) { (plot.figure("")) } }
            @if !missing.is_empty() { p { "Not recorded in these runs, or constant: " (missing.join("; ")) "." } }
        }
    }

    /// Quartiles of the residual over `pick`; `None` where `pick` is missing or constant.
    fn ribbons(&self, label: &str, pick: Pick) -> Option<Plot> {
        let mut areas = Vec::new();
        let mut lines = Vec::new();
        for (name, ink, residual) in self.sides() {
            let points: Vec<(f64, f64)> =
                self.runs.iter().flat_map(RunTrace::points).map(|p| (pick(p), residual(p))).collect();
            let bins = binned_quartiles(&points, BINS, (points.len() / 2000).max(10));
            if bins.len() < 2 {
                return None;
            }
            let upper = bins.iter().map(|(x, [_, _, high])| (*x, *high));
            let lower = bins.iter().rev().map(|(x, [low, _, _])| (*x, *low));
            let series = |name: &str, shape, points| Series { name: name.to_owned(), ink, shape, points };
            areas.push(series("", Shape::Area, upper.chain(lower).collect()));
            lines.push(series(
                name,
                Shape::Line,
                bins.iter().map(|(x, [_, middle, _])| (*x, *middle)).collect(),
            ));
        }
        areas.append(&mut lines);
        Some(Plot {
            description: format!("Residual over {label}: quartiles before and after"),
            x_label: label.to_owned(),
            y_label: "residual, N".to_owned(),
            height: 360.0,
            series: areas,
            ..Plot::default()
        })
    }

    /// The sample rate of the first run, Hz, and the runs with the same rate.
    fn of_one_rate(&self) -> (f64, Vec<&RunTrace>) {
        let rate_hz = self.runs.first().map_or(0.0, |run| run.rate_hz);
        (rate_hz, self.runs.iter().filter(|run| (run.rate_hz / rate_hz - 1.0).abs() < 0.01).collect())
    }

    /// Pairs of two signals, split into stretches in which both are known.
    fn pairs(runs: &[&RunTrace], first: Pick, second: Pick) -> Vec<Vec<(f64, f64)>> {
        let finite = |pair: &(f64, f64)| pair.0.is_finite() && pair.1.is_finite();
        let stretches = runs.iter().flat_map(|run| &run.stretches);
        stretches
            .flat_map(|stretch| {
                let pairs: Vec<(f64, f64)> = stretch.iter().map(|p| (first(p), second(p))).collect();
                pairs.chunk_by(|a, b| finite(a) && finite(b)).map(<[_]>::to_vec).collect::<Vec<_>>()
            })
            .filter(|pairs| pairs.iter().all(finite))
            .collect()
    }

    fn spectra(&self) -> Markup {
        let (rate_hz, runs) = self.of_one_rate();
        let longest = runs.iter().flat_map(|run| &run.stretches).map(Vec::len).max().unwrap_or(0);
        let samples = ((SEGMENT_S * rate_hz) as usize).min(longest / 4).max(SHORTEST);
        let length = 1_usize << samples.ilog2();
        let of = |first: Pick, second: Pick| Spectra::of(&Self::pairs(&runs, first, second), rate_hz, length);
        let Some(power) = of(BEFORE.2, AFTER.2) else {
            return html! { p { "No stretch has " (length) " samples without a gap, which is the minimum for a spectrum." } };
        };
        let line = |name: &str, ink, hz: &[f64], values: &[f64], shape| Series {
            name: name.to_owned(),
            ink,
            shape,
            points: hz.iter().copied().zip(values.iter().copied()).collect(),
        };
        let densities = [(BEFORE, &power.first), (AFTER, &power.second)];
        let density = Plot {
            description: "Power density of the residual before and after".to_owned(),
            x_label: "frequency, Hz".to_owned(),
            y_label: "residual, N²/Hz".to_owned(),
            log: (true, true),
            height: 300.0,
            series: densities
                .iter()
                .take(self.sides().len())
                .map(|((name, ink, _), values)| line(name, *ink, &power.hz, values, Shape::Line))
                .collect(),
            ..Plot::default()
        };
        let coherence = |label: &str, pick: Pick| -> Option<Plot> {
            let found: Vec<(Side, Spectra)> = self
                .sides()
                .into_iter()
                .map(|side| Some((side, of(pick, side.2)?)))
                .collect::<Option<_>>()?;
            let varies = found.iter().any(|(_, spectra)| spectra.first.iter().any(|power| *power > 1e-18));
            let mut series: Vec<Series> = found
                .iter()
                .map(|((name, ink, _), s)| line(name, *ink, &s.hz, &s.coherence, Shape::Line))
                .collect();
            let (_, first) = found.first()?;
            if let Some(chance) = first.chance() {
                series.push(line("", Ink::Measured, &first.hz, &vec![chance; first.hz.len()], Shape::Dashed));
            }
            varies.then(|| Plot {
                description: format!("Coherence of the residual with {label}"),
                x_label: "frequency, Hz".to_owned(),
                y_label: format!("coherence with {label}"),
                log: (true, false),
                y_range: Some((0.0, 1.0)),
                height: 380.0,
                series,
                ..Plot::default()
            })
        };
        let plots = [coherence("velocity", |p| p.velocity_m_s), coherence(self.drive().0, |p| p.drive)];
        html! {
            (density.figure(&format!(
                "Welch's method: {} segments of {:.2} s that overlap by half, Hann window.",
                power.segments, length as f64 / rate_hz
            )))
            div.pair { @for plot in plots.iter().flatten() { (plot.figure("")) } }
            p.lead { "Dashed: the coherence that two unrelated signals exceed at one frequency in twenty. Coherence shows linear relations "
                "only; an effect that also changes sign with the direction of motion shows in the plots above." }
            @if runs.len() < self.runs.len() {
                p { "Runs with another rate than " (format!("{rate_hz:.0}")) " Hz are not included in the spectra and in the functions below." }
            }
        }
    }

    fn lags(&self) -> Markup {
        let (rate_hz, runs) = self.of_one_rate();
        let reach = ((REACH_S * rate_hz) as usize).max(1);
        let auto = |(name, ink, residual): Side| {
            let values: Vec<Vec<f64>> = runs
                .iter()
                .flat_map(|run| &run.stretches)
                .map(|stretch| stretch.iter().map(residual).collect())
                .collect();
            Some((name, ink, autocorrelation(&values, reach)?))
        };
        let (drive, _) = self.drive();
        let signals: [(String, Pick); 4] = [
            ("velocity".to_owned(), |p| p.velocity_m_s),
            ("acceleration".to_owned(), |p| p.acceleration_m_s2),
            (format!("slope of the {drive}"), |p| p.drive_slope),
            (format!("slope of the {drive}, directed"), directed_slope),
        ];
        let colour = ((COLOUR_S * rate_hz) as usize).max(reach);
        let cross = |label: &str, pick: Pick| {
            let found = self.sides().into_iter().map(|(name, ink, residual)| {
                Some((name, ink, cross_correlation(&Self::pairs(&runs, pick, residual), reach, colour)?))
            });
            let found: Vec<(&str, Ink, CorrelationFunction)> = found.collect::<Option<_>>()?;
            Some(functions(&format!("with {label}"), &found, rate_hz, false))
        };
        let own: Vec<(&str, Ink, CorrelationFunction)> = self.sides().into_iter().filter_map(auto).collect();
        html! {
            (functions("with itself", &own, rate_hz, true).figure(
                "If the residual is only noise of the load cell, it stays between the dashed lines (95 %) at all lags except zero."
            ))
            div.pair { @for (label, pick) in &signals { @if let Some(plot) = cross(label, *pick) { (plot.figure("")) } } }
            p.lead { "At positive lags the residual follows the signal. Dashed: the 95 % band for two unrelated signals with the "
                "measured autocorrelations, in the colours of before and after." }
        }
    }
}

/// The slope of the drive with the sign of the velocity. The residual that a delayed drive causes correlates with it.
fn directed_slope(point: &TracePoint) -> f64 {
    point.drive_slope * point.velocity_m_s.signum()
}

/// A plot of correlation functions with their bands; for an autocorrelation (`own`) only lags from zero.
fn functions(what: &str, found: &[(&str, Ink, CorrelationFunction)], rate_hz: f64, own: bool) -> Plot {
    let mut series = Vec::new();
    for (name, ink, correlation) in found {
        let points: Vec<(f64, f64)> = correlation
            .points()
            .filter(|(lag, _)| !own || *lag >= 0.0)
            .map(|(lag, r)| (lag / rate_hz, r))
            .collect();
        let ends = [points.first(), points.last()].map(|end| end.map_or(0.0, |end| end.0));
        for limit in [correlation.band, -correlation.band] {
            series.push(Series {
                name: String::new(),
                ink: *ink,
                shape: Shape::Dashed,
                points: ends.map(|lag_s| (lag_s, limit)).to_vec(),
            });
        }
        series.push(Series { name: (*name).to_owned(), ink: *ink, shape: Shape::Line, points });
    }
    Plot {
        description: format!("Correlation of the residual {what} over the lag"),
        x_label: "lag, s".to_owned(),
        y_label: format!("correlation {what}"),
        height: if own { 260.0 } else { 380.0 },
        series,
        ..Plot::default()
    }
}

/// The points of all stretches, with breaks between them.
fn joined(run: &RunTrace, pick: impl Fn(&TracePoint) -> (f64, f64)) -> Vec<(f64, f64)> {
    let mut points: Vec<(f64, f64)> = Vec::new();
    for stretch in &run.stretches {
        if let Some(last) = points.last().map(|last| last.0) {
            points.push((last, f64::NAN));
        }
        points.extend(stretch.iter().map(&pick));
    }
    points
}

/// The stretch, and the index of a sample in it, around which one second of the run has the largest reduction of the
/// squared error.
fn most_mended(run: &RunTrace) -> Option<(&[TracePoint], usize)> {
    let block = ((LOOP_S * run.rate_hz) as usize).max(1);
    let mended =
        |points: &[TracePoint]| points.iter().map(|p| p.before_n.powi(2) - p.after_n.powi(2)).sum::<f64>();
    let blocks = run.stretches.iter().flat_map(|stretch| {
        let starts = (0..stretch.len()).step_by(block);
        starts.map(move |start| (stretch, start, (start + block).min(stretch.len())))
    });
    let best = blocks
        .map(|(stretch, from, to)| (mended(&stretch[from..to]), stretch, usize::midpoint(from, to)))
        .max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some((best.1.as_slice(), best.2))
}
