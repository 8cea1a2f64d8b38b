//! The live view on a terminal.
//!
//! ```text
//! title, progress
//! now | rates | transport
//! force: measured, and the estimate in the colour of its mode
//! residual
//! modes over the whole run, the last change
//! endpoints for other programs
//! ```

use super::live_summary::{CHART_S, LiveSummary, Point};
use mr_damper_model::pipeline::{Mode, Validity};
use mr_damper_model::sample::Channel;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style, Stylize};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Axis, Block, Chart, Dataset, GraphType, LineGauge, Paragraph};
use std::collections::VecDeque;

/// The modes in the legend. The other modes are drawn with the same symbols, but are rare.
const LEGEND: [Mode; 3] = [Mode::Arx, Mode::ArxCoast, Mode::Model];

/// Draws the summary over the whole frame.
pub fn draw(frame: &mut Frame<'_>, summary: &LiveSummary) {
    let area = frame.area();
    let residual_height = if area.height >= 30 { 7 } else { 0 };
    let [top, numbers, force, residual, modes, foot] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(7),
        Constraint::Min(6),
        Constraint::Length(residual_height),
        Constraint::Length(2),
        Constraint::Length(1),
    ])
    .areas(area);
    draw_top(frame, top, summary);
    draw_numbers(frame, numbers, summary);
    draw_force(frame, force, summary);
    if residual_height > 0 {
        draw_residual(frame, residual, summary);
    }
    draw_modes(frame, modes, summary);
    draw_foot(frame, foot, summary);
}

fn draw_top(frame: &mut Frame<'_>, area: Rect, summary: &LiveSummary) {
    let title = format!(" {} ", summary.info.title);
    let [left, right] =
        Layout::horizontal([Constraint::Length(title.chars().count() as u16), Constraint::Fill(1)])
            .areas(area);
    frame.render_widget(Line::from(title).bold().reversed(), left);
    let length_s = summary.info.length_s.max(1e-9);
    let ratio = (summary.played_s / length_s).clamp(0.0, 1.0);
    let left_s = (length_s - summary.played_s).max(0.0);
    let label = format!(" {:.1} of {length_s:.0} s, {left_s:.0} s left", summary.played_s);
    let gauge = LineGauge::default().ratio(ratio).label(label).filled_style(Color::Cyan);
    frame.render_widget(gauge.unfilled_style(Color::DarkGray), right);
}

fn draw_numbers(frame: &mut Frame<'_>, area: Rect, summary: &LiveSummary) {
    let [now, rates, transport] =
        Layout::horizontal([Constraint::Fill(5), Constraint::Fill(4), Constraint::Fill(5)]).areas(area);
    frame.render_widget(Paragraph::new(now_lines(summary)).block(Block::bordered().title(" now ")), now);
    frame.render_widget(Paragraph::new(rate_lines(summary)).block(Block::bordered().title(" rates ")), rates);
    let block = Block::bordered().title(" transport, from the stamp ");
    frame.render_widget(Paragraph::new(transport_lines(summary)).block(block), transport);
}

fn now_lines(summary: &LiveSummary) -> Vec<Line<'static>> {
    let Some(estimate) = &summary.estimate else { return vec![Line::from("waiting for the first sample")] };
    let newton = |value: Option<f64>| value.map_or("      -".to_owned(), |n| format!("{n:+7.1}"));
    let fresh = summary.residual.filter(|_| summary.residual_is_fresh());
    let mut lines = vec![
        Line::from(vec![
            Span::styled(format!("{:<10}", estimate.mode.name()), mode_style(estimate.mode).bold()),
            Span::styled(estimate.validity.name(), validity_style(estimate.validity)),
        ]),
        Line::from(format!("estimate {} N", newton(Some(estimate.force.get())))),
        Line::from(format!(
            "measured {} N  residual {} N",
            newton(summary.measured_n()),
            newton(fresh.map(|r| r.residual.get()))
        )),
    ];
    if let Some(residual) = &summary.residual {
        lines.push(Line::from(format!(
            "simulation, {:.0} s: {:.1} N, NMSE {:.3}",
            residual.window.get(),
            residual.windowed_rsse.get(),
            residual.windowed_esr
        )));
    }
    let reasons = estimate.reasons.names().collect::<Vec<_>>().join(" ");
    lines.push(Line::styled(reasons, validity_style(estimate.validity)));
    lines
}

fn rate_lines(summary: &LiveSummary) -> Vec<Line<'static>> {
    let line = |arrow: &str, name: &str, hz: f64| Line::from(format!("{arrow} {name:<16} {hz:4.0} Hz"));
    vec![
        line("→", "displacement", summary.input_hz(Channel::Displacement)),
        line("→", "coil_current", summary.input_hz(Channel::Drive)),
        line("→", "measured_force", summary.input_hz(Channel::Force)),
        line("←", "force_estimate", summary.estimate_hz()),
        line("←", "force_residual", summary.residual_hz()),
    ]
}

fn transport_lines(summary: &LiveSummary) -> Vec<Line<'static>> {
    let latency = |name: &str, histogram: &super::Histogram| {
        let (median, p99) = (histogram.quantile_s(0.5), histogram.quantile_s(0.99));
        Line::from(match (median, p99) {
            (Some(median), Some(p99)) => format!("{name:<11}{:5.2} ms, p99 {:5.2}", median * 1e3, p99 * 1e3),
            _ => format!("{name:<11}    -"),
        })
    };
    let counts = &summary.counts;
    let trouble = |n: u64| if n == 0 { Style::new() } else { Style::new().fg(Color::Red).bold() };
    vec![
        latency("to the node", &summary.to_node),
        latency("round trip", &summary.round_trip),
        Line::from(format!("samples    {:>6} of {} taken", counts.taken, counts.sent)),
        Line::from(format!("estimates  {:>6} of {} received", counts.received, counts.estimates)),
        Line::from(vec![
            Span::styled(format!("refused {}", counts.refused), trouble(counts.refused)),
            Span::raw("   "),
            Span::styled(format!("lost {}", counts.lost), trouble(counts.lost)),
        ]),
    ]
}

fn draw_force(frame: &mut Frame<'_>, area: Rect, summary: &LiveSummary) {
    let end_s = summary.at_s().max(CHART_S);
    let measured = points(&summary.measured, |_| true);
    let by_mode: Vec<_> = LEGEND
        .iter()
        .map(|mode| (*mode, points(&summary.estimated, |p| same_colour(p.mode, *mode))))
        .collect();
    // Dots, not lines: a line would connect points across times with another mode.
    let mut sets = vec![dataset(&measured, Color::Gray)];
    sets.extend(by_mode.iter().map(|(mode, points)| dataset(points, mode_colour(*mode))));
    let mut title =
        vec![Span::raw(" force, N: "), Span::styled("• measured  ", Color::Gray), Span::raw("estimate by ")];
    title.extend(LEGEND.iter().map(|mode| Span::styled(format!("• {} ", mode.name()), mode_style(*mode))));
    let bound =
        summary.measured.iter().chain(&summary.estimated).map(|p| p.value.abs()).fold(100.0, finite_max);
    draw_chart(frame, area, Line::from(title), sets, end_s, bound);
}

fn draw_residual(frame: &mut Frame<'_>, area: Rect, summary: &LiveSummary) {
    let end_s = summary.at_s().max(CHART_S);
    let points = points(&summary.residual_points, |p| end_s - p.at_s <= CHART_S);
    let bound = points.iter().map(|p| p.1.abs()).fold(50.0, finite_max);
    let title = Line::from(" residual, N: measured minus simulation ");
    draw_chart(frame, area, title, vec![dataset(&points, Color::LightBlue)], end_s, bound);
}

fn draw_chart(
    frame: &mut Frame<'_>,
    area: Rect,
    title: Line<'_>,
    sets: Vec<Dataset<'_>>,
    end_s: f64,
    bound: f64,
) {
    let bound = nice_bound(bound);
    let start_s = end_s - CHART_S;
    let quiet = Style::new().fg(Color::DarkGray);
    let x_labels = [start_s, start_s + 0.5 * CHART_S, end_s].map(|s| format!("{s:.1} s"));
    let y_labels = [-bound, 0.0, bound].map(|n| format!("{n:5.0}"));
    let chart = Chart::new(sets)
        .block(Block::bordered().title(title))
        .legend_position(None)
        .x_axis(Axis::default().style(quiet).bounds([start_s, end_s]).labels(x_labels))
        .y_axis(Axis::default().style(quiet).bounds([-bound, bound]).labels(y_labels));
    frame.render_widget(chart, area);
}

fn draw_modes(frame: &mut Frame<'_>, area: Rect, summary: &LiveSummary) {
    let [strip, last] = Layout::vertical([Constraint::Length(1); 2]).areas(area);
    let label = "modes ";
    let cells = strip.width.saturating_sub(label.len() as u16);
    let mut spans = vec![Span::raw(label)];
    spans.extend((0..cells).map(|cell| {
        let from_s = f64::from(cell) / f64::from(cells) * summary.info.length_s;
        let to_s = f64::from(cell + 1) / f64::from(cells) * summary.info.length_s;
        match mode_in(summary, from_s, to_s) {
            Some(mode) => Span::styled("█", mode_style(mode)),
            None => Span::styled("░", Color::DarkGray),
        }
    }));
    frame.render_widget(Line::from(spans), strip);
    if let Some(change) = summary.changes.last() {
        let to = change.transition.to;
        let text = vec![
            Span::raw(format!("{:5.1} s  {} → ", change.at_s, change.transition.from.name())),
            Span::styled(to.name(), mode_style(to).bold()),
            Span::raw(format!(": {}", change.transition.cause.text())),
        ];
        frame.render_widget(Line::from(text), last);
    }
    if let Some(alarm) = &summary.alarm {
        let text =
            format!(" ALARM since {:.1} s: {:.1} times the expected error", alarm.at_s, alarm.change.ratio);
        let [_, right] =
            Layout::horizontal([Constraint::Fill(1), Constraint::Length(text.chars().count() as u16)])
                .areas(last);
        frame.render_widget(Line::from(text).fg(Color::Red).bold(), right);
    }
}

/// The mode for a cell of the strip: the mode entered within it, otherwise the mode before it. `None` for times that
/// the run has not reached.
fn mode_in(summary: &LiveSummary, from_s: f64, to_s: f64) -> Option<Mode> {
    if summary.estimate.is_none() || from_s > summary.at_s() {
        return None;
    }
    let mut entered = summary.changes.iter().filter(|change| change.at_s < to_s);
    // A short mode (coasting) must stay visible between two long ones.
    let short = entered.clone().filter(|change| change.at_s >= from_s).map(|change| change.transition.to);
    short
        .min_by_key(|mode| u8::from(*mode != Mode::ArxCoast))
        .or_else(|| entered.next_back().map(|change| change.transition.to))
}

fn draw_foot(frame: &mut Frame<'_>, area: Rect, summary: &LiveSummary) {
    let head = &summary.info;
    let mut parts = vec![format!("ROS 2 {}", head.reach)];
    if !head.zenoh.is_empty() {
        parts.push(format!("Zenoh {}", head.zenoh));
    }
    parts.push(head.free_model.clone());
    parts.push("q ends".to_owned());
    frame.render_widget(Line::from(parts.join(" · ")).add_modifier(Modifier::DIM), area);
}

fn points(points: &VecDeque<Point>, keep: impl Fn(&Point) -> bool) -> Vec<(f64, f64)> {
    points.iter().filter(|point| keep(point)).map(|point| (point.at_s, point.value)).collect()
}

fn dataset(points: &[(f64, f64)], colour: Color) -> Dataset<'_> {
    Dataset::default().marker(Marker::Braille).graph_type(GraphType::Scatter).style(colour).data(points)
}

/// Rounds a bound up to 1, 1.5, 2, 3, 5 or 10 times a power of ten.
fn nice_bound(bound: f64) -> f64 {
    let decade = 10.0_f64.powf(bound.log10().floor());
    [1.0, 1.5, 2.0, 3.0, 5.0]
        .iter()
        .map(|step| step * decade)
        .find(|nice| *nice >= bound)
        .unwrap_or(10.0 * decade)
}

fn finite_max(a: f64, b: f64) -> f64 {
    if b.is_finite() { a.max(b) } else { a }
}

fn same_colour(mode: Mode, shown: Mode) -> bool {
    mode == shown || (shown == Mode::Model && matches!(mode, Mode::Hold | Mode::Fault))
}

const fn mode_colour(mode: Mode) -> Color {
    match mode {
        Mode::Arx => Color::Green,
        Mode::ArxCoast => Color::Yellow,
        Mode::Model => Color::Magenta,
        Mode::Hold => Color::Gray,
        Mode::Fault => Color::Red,
    }
}

fn mode_style(mode: Mode) -> Style {
    Style::new().fg(mode_colour(mode))
}

fn validity_style(validity: Validity) -> Style {
    Style::new().fg(match validity {
        Validity::Valid => Color::Green,
        Validity::Degraded | Validity::Extrapolating => Color::Yellow,
        Validity::Stale | Validity::Invalid => Color::Red,
    })
}
