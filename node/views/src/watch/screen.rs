//! Terminal view of all dampers: one row per damper, and details of the selected one below.

use super::damper_state::{Aged, DamperState, StatusLevel};
use super::damper_view::ChartPoints;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style, Stylize};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Axis, Block, Cell, Chart, Dataset, GraphType, Paragraph, Row, Table, Wrap};

/// Time span of the chart of force, s.
const CHART_S: f64 = 5.0;

/// Contents of the screen.
#[derive(Debug)]
pub struct ScreenContent<'a> {
    /// All dampers.
    pub states: &'a [DamperState],
    /// Index of the selected damper.
    pub selected: usize,
    /// The points of the selected damper's chart.
    pub points: Option<&'a ChartPoints<'a>>,
    /// Seconds since the screen was frozen; `None` when it is live.
    pub frozen_s: Option<f64>,
    /// Origin of the data, as text.
    pub origin: &'a str,
}

/// Draws the content over the whole frame.
pub fn draw(frame: &mut Frame<'_>, content: &ScreenContent<'_>) {
    let rows = u16::try_from(content.states.len()).unwrap_or(u16::MAX).saturating_add(1);
    let [top, table, status, detail, chart, foot] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(rows.clamp(2, 17)),
        Constraint::Length(3),
        Constraint::Length(7),
        Constraint::Min(5),
        Constraint::Length(1),
    ])
    .areas(frame.area());
    draw_top(frame, top, content);
    draw_table(frame, table, content);
    if let Some(state) = content.states.get(content.selected) {
        let words = format!("{}: {}", state.name, state.status);
        let words = Paragraph::new(words).wrap(Wrap { trim: true }).style(level_style(state.level));
        frame.render_widget(words, status);
        draw_detail(frame, detail, state);
        draw_chart(frame, chart, content.points, state.level == StatusLevel::Silent);
    }
    let keys = "↑ ↓ or 1 to 9 select · space freezes · q ends";
    frame.render_widget(Line::from(keys).add_modifier(Modifier::DIM), foot);
}

fn draw_top(frame: &mut Frame<'_>, area: Rect, content: &ScreenContent<'_>) {
    let mut spans =
        vec![Span::from(" mr-damper top ").bold().reversed(), Span::from(format!(" {}", content.origin))];
    if let Some(frozen_s) = content.frozen_s {
        let text = format!("  FROZEN {frozen_s:.0} s ago: values are from that time ");
        spans.push(Span::from(text).fg(Color::Black).bg(Color::Yellow));
    }
    frame.render_widget(Line::from(spans), area);
}

fn draw_table(frame: &mut Frame<'_>, area: Rect, content: &ScreenContent<'_>) {
    if content.states.is_empty() {
        frame.render_widget(Line::from("no damper found yet: force_estimate is not published"), area);
        return;
    }
    let rows = content.states.iter().enumerate().map(|(index, state)| row(state, index == content.selected));
    let numbers = ["est. N", "meas. N", "resid. N"].map(|name| format!("{name:>8}"));
    let head = ["damper".into(), "mode".into(), "validity".into()].into_iter().chain(numbers);
    let head = head.chain([format!("{:>6}", "A"), format!("{:>5}", "Hz")]);
    let widths = [
        Constraint::Fill(1),
        Constraint::Length(9),
        Constraint::Length(13),
        Constraint::Length(8),
        Constraint::Length(8),
        Constraint::Length(8),
        Constraint::Length(6),
        Constraint::Length(5),
    ];
    let table = Table::new(rows, widths).column_spacing(1).header(Row::new(head).dim());
    frame.render_widget(table, area);
}

/// A damper's row. A stale value is replaced by a dash, so that it cannot be mistaken for a current one.
fn row(state: &DamperState, is_selected: bool) -> Row<'static> {
    let style = level_style(state.level);
    let estimate = state.estimate.as_ref().filter(|estimate| !estimate.stale).map(|estimate| &estimate.value);
    let measured = fresh(state.measured.as_ref()).map(|measured| measured.force_n);
    let residual = fresh(state.residual.as_ref());
    let alarm = residual.is_some_and(|residual| residual.alarm);
    let mode = estimate.map_or("-".to_owned(), |estimate| estimate.mode.clone());
    let validity = match estimate {
        _ if alarm => Cell::from("ALARM").style(Style::new().fg(Color::Red).bold()),
        Some(estimate) => Cell::from(estimate.validity.clone()),
        None => Cell::from("silent"),
    };
    let mark = if is_selected { "▶" } else { " " };
    let hz = state.rates_hz.get("force_estimate").copied().unwrap_or(0.0);
    Row::new([
        Cell::from(format!("{mark}{}", state.name)),
        Cell::from(mode.clone()).style(Style::new().fg(mode_colour(&mode))),
        validity,
        number(estimate.map(|estimate| estimate.force_n), 8, 1),
        number(measured, 8, 1),
        number(residual.map(|residual| residual.residual_n), 8, 1),
        number(fresh(state.command.as_ref()).map(|command| command.current_a), 6, 3),
        Cell::from(format!("{hz:5.0}")),
    ])
    .style(if is_selected { style.bold() } else { style })
}

fn fresh<T>(reading: Option<&Aged<T>>) -> Option<&T> {
    reading.filter(|reading| !reading.stale).map(|reading| &reading.value)
}

fn number(value: Option<f64>, width: usize, digits: usize) -> Cell<'static> {
    Cell::from(format!("{:>width$}", figure(value, digits)))
}

fn figure(value: Option<f64>, digits: usize) -> String {
    value.filter(|value| value.is_finite()).map_or("-".to_owned(), |value| format!("{value:.digits$}"))
}

fn draw_detail(frame: &mut Frame<'_>, area: Rect, state: &DamperState) {
    let [left, right] = Layout::horizontal([Constraint::Fill(1), Constraint::Fill(1)]).areas(area);
    let mut lines = Vec::new();
    if let Some(estimate) = fresh(state.estimate.as_ref()) {
        let calibrated = if estimate.band_calibrated { "" } else { ", not calibrated" };
        let band = [estimate.band_low_n, estimate.band_high_n].map(|end| figure(Some(end), 0));
        lines.push(format!("90 % band {} to {} N{calibrated}", band[0], band[1]));
        lines.push(format!("model {}", estimate.model));
    }
    if let Some(residual) = fresh(state.residual.as_ref()) {
        let [rsse, esr] = [(residual.windowed_rsse_n, 1), (residual.windowed_esr, 3)]
            .map(|(value, digits)| figure(Some(value), digits));
        lines.push(format!("simulated force {} N", figure(Some(residual.predicted_n), 1)));
        lines.push(format!("RMSE {rsse} N, NMSE {esr} over {:.0} s", residual.window_s));
    }
    if let Some(command) = fresh(state.command.as_ref()) {
        let ends = [command.achievable_min_n, command.achievable_max_n].map(|end| figure(Some(end), 0));
        let demanded = figure(Some(command.force_requested_n), 0);
        lines
            .push(format!("demand {demanded} of {} to {} N, limit {}", ends[0], ends[1], command.limited_by));
    }
    let now = Paragraph::new(lines.join("\n")).block(Block::bordered().title(" now "));
    frame.render_widget(now, left);
    let changes = state
        .changes
        .iter()
        .map(|change| format!("{:4.0} s ago → {}: {}", change.age_s, change.to, change.reason));
    let changes = Paragraph::new(changes.collect::<Vec<_>>().join("\n"));
    frame.render_widget(changes.block(Block::bordered().title(" changes of mode ")), right);
}

fn draw_chart(frame: &mut Frame<'_>, area: Rect, points: Option<&ChartPoints<'_>>, is_silent: bool) {
    let series = |is_estimate: bool| -> Vec<(f64, f64)> {
        let Some(points) = points else { return Vec::new() };
        if is_estimate {
            points.estimate.iter().map(|point| (point.at_s, f64::from(point.values[0]))).collect()
        } else {
            points.measured.iter().map(|point| (point.at_s, f64::from(point.values[0]))).collect()
        }
    };
    let (measured, estimate) = (series(false), series(true));
    let all = || measured.iter().chain(&estimate);
    let end_s = all().map(|point| point.0).fold(CHART_S, f64::max);
    let bound = all()
        .filter(|point| end_s - point.0 <= CHART_S && point.1.is_finite())
        .fold(10.0_f64, |bound, point| bound.max(1.1 * point.1.abs()));
    let colours = if is_silent { [Color::DarkGray; 2] } else { [Color::Gray, Color::Cyan] };
    let set = |data, colour| {
        Dataset::default().marker(Marker::Braille).graph_type(GraphType::Scatter).style(colour).data(data)
    };
    let title = Line::from(vec![
        Span::raw(if is_silent { " force before the silence, N: " } else { " force, N: " }),
        Span::styled("• measured  ", colours[0]),
        Span::styled("• estimate ", colours[1]),
    ]);
    let quiet = Style::new().fg(Color::DarkGray);
    let y_labels = [-bound, 0.0, bound].map(|n| format!("{n:6.0}"));
    let chart = Chart::new(vec![set(&measured, colours[0]), set(&estimate, colours[1])])
        .block(Block::bordered().title(title))
        .legend_position(None)
        .x_axis(
            Axis::default()
                .style(quiet)
                .bounds([end_s - CHART_S, end_s])
                .labels([format!("-{CHART_S:.0} s"), "last".to_owned()]),
        )
        .y_axis(Axis::default().style(quiet).bounds([-bound, bound]).labels(y_labels));
    frame.render_widget(chart, area);
}

/// A damper in one line, for output that is not a terminal.
#[must_use]
pub fn line(state: &DamperState) -> String {
    let mut text = format!("{}: {}", state.name, state.status);
    if let Some(estimate) = fresh(state.estimate.as_ref()) {
        text += &format!("; F {} N", figure(Some(estimate.force_n), 1));
    }
    if let Some(measured) = fresh(state.measured.as_ref()) {
        text += &format!(", measured {} N", figure(Some(measured.force_n), 1));
    }
    if let Some(residual) = fresh(state.residual.as_ref()) {
        let (rsse, esr) = (figure(Some(residual.windowed_rsse_n), 1), figure(Some(residual.windowed_esr), 3));
        text += &format!(", RMSE {rsse} N NMSE {esr}");
    }
    if let Some(command) = fresh(state.command.as_ref()) {
        text += &format!(", commanded {} A", figure(Some(command.current_a), 3));
    }
    text + &format!("; {:.0} Hz", state.rates_hz.get("force_estimate").copied().unwrap_or(0.0))
}

const fn level_style(level: StatusLevel) -> Style {
    match level {
        StatusLevel::Good => Style::new(),
        StatusLevel::Warning => Style::new().fg(Color::Yellow),
        StatusLevel::Bad | StatusLevel::Silent => Style::new().fg(Color::Red),
    }
}

fn mode_colour(mode: &str) -> Color {
    match mode {
        "arx" => Color::Green,
        "arx_coast" => Color::Yellow,
        "model" => Color::Magenta,
        "hold" => Color::Gray,
        "fault" => Color::Red,
        _ => Color::Reset,
    }
}
