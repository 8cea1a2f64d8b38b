//! Terminal view of all dampers: one row per damper, and details of the selected one below.

use super::damper_state::{self, Aged, DamperState, StatusLevel};
use super::damper_view::{ChartPoints, STALE_S};
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
        draw_chart(frame, chart, content.points, state);
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
    let longest = content.states.iter().map(|state| state.name.chars().count()).max().unwrap_or(0);
    let (name_width, columns) = columns(usize::from(area.width), longest);
    let rows = content
        .states
        .iter()
        .enumerate()
        .map(|(index, state)| row(state, index == content.selected, name_width, &columns));
    let head = columns.iter().map(|column| match column.is_number {
        true => format!("{:>width$}", column.head, width = column.width),
        false => column.head.to_owned(),
    });
    let head = Row::new(std::iter::once("damper".to_owned()).chain(head));
    let widths = columns.iter().map(|column| Constraint::Length(column.width as u16));
    let widths = std::iter::once(Constraint::Fill(1)).chain(widths);
    frame.render_widget(Table::new(rows, widths).column_spacing(1).header(head.dim()), area);
}

/// A column of the table, beside the name.
struct Column {
    head: &'static str,
    width: usize,
    is_number: bool,
    /// Columns with a larger rank are left out first in a narrow terminal.
    rank: u8,
    cell: fn(&DamperState, usize) -> Cell<'static>,
}

/// The columns from left to right.
const COLUMNS: [Column; 7] = [
    Column { head: "mode", width: 9, is_number: false, rank: 2, cell: mode_cell },
    Column { head: "validity", width: 13, is_number: false, rank: 0, cell: validity_cell },
    Column { head: "est. N", width: 8, is_number: true, rank: 1, cell: estimate_cell },
    Column { head: "meas. N", width: 8, is_number: true, rank: 5, cell: measured_cell },
    Column { head: "resid. N", width: 8, is_number: true, rank: 3, cell: residual_cell },
    Column { head: "A", width: 6, is_number: true, rank: 6, cell: current_cell },
    Column { head: "Hz", width: 5, is_number: true, rank: 4, cell: rate_cell },
];
/// The columns that are always shown have a smaller rank than this.
const ALWAYS: u8 = 1;
/// Names of this length are shown in full before any column that is not always shown.
const NAME: usize = 20;

/// The width of the names, and the columns that fit beside them: names tell dampers apart, so they come before other columns.
fn columns(width: usize, longest_name: usize) -> (usize, Vec<&'static Column>) {
    // The mark of the selected damper precedes the name.
    let wanted = (longest_name.min(NAME) + 1).max("damper".len());
    let beside = |most: u8| -> Vec<&Column> { COLUMNS.iter().filter(|column| column.rank < most).collect() };
    let left = |columns: &[&Column]| {
        width.saturating_sub(columns.iter().map(|column| column.width + 1).sum::<usize>())
    };
    let most = (ALWAYS..=COLUMNS.len() as u8).rev().find(|most| left(&beside(*most)) >= wanted);
    let columns = beside(most.unwrap_or(ALWAYS));
    (left(&columns), columns)
}

/// `name` in at most `width` characters. The middle is left out, because dampers of a vehicle often differ only at the end.
fn shortened(name: &str, width: usize) -> String {
    let letters: Vec<char> = name.chars().collect();
    if letters.len() <= width {
        return name.to_owned();
    }
    let Some(kept) = width.checked_sub(1) else { return String::new() };
    let tail = kept - kept / 3;
    let part = |letters: &[char]| letters.iter().collect::<String>();
    format!("{}…{}", part(&letters[..kept / 3]), part(&letters[letters.len() - tail..]))
}

/// A damper's row. A stale value is replaced by a dash, so that it cannot be mistaken for a current one.
fn row(state: &DamperState, is_selected: bool, name_width: usize, columns: &[&Column]) -> Row<'static> {
    let style = level_style(state.level);
    let mark = if is_selected { "▶" } else { " " };
    let name = Cell::from(format!("{mark}{}", shortened(&state.name, name_width.saturating_sub(1))));
    let cells = columns.iter().map(|column| (column.cell)(state, column.width));
    Row::new(std::iter::once(name).chain(cells)).style(if is_selected { style.bold() } else { style })
}

fn mode_cell(state: &DamperState, _: usize) -> Cell<'static> {
    let mode =
        fresh(state.estimate.as_ref()).map_or_else(|| "-".to_owned(), |estimate| estimate.mode.clone());
    Cell::from(mode.clone()).style(Style::new().fg(mode_colour(&mode)))
}

fn validity_cell(state: &DamperState, _: usize) -> Cell<'static> {
    if fresh(state.residual.as_ref()).is_some_and(|residual| residual.alarm) {
        return Cell::from("ALARM").style(Style::new().fg(Color::Red).bold());
    }
    Cell::from(
        fresh(state.estimate.as_ref())
            .map_or_else(|| "silent".to_owned(), |estimate| estimate.validity.clone()),
    )
}

fn estimate_cell(state: &DamperState, width: usize) -> Cell<'static> {
    number(fresh(state.estimate.as_ref()).map(|estimate| estimate.force_n), width, 1)
}

fn measured_cell(state: &DamperState, width: usize) -> Cell<'static> {
    number(fresh(state.measured.as_ref()).map(|measured| measured.force_n), width, 1)
}

fn residual_cell(state: &DamperState, width: usize) -> Cell<'static> {
    number(fresh(state.residual.as_ref()).map(|residual| residual.residual_n), width, 1)
}

fn current_cell(state: &DamperState, width: usize) -> Cell<'static> {
    number(fresh(state.command.as_ref()).map(|command| command.current_a), width, 3)
}

fn rate_cell(state: &DamperState, width: usize) -> Cell<'static> {
    number(Some(state.rates_hz.get("force_estimate").copied().unwrap_or(0.0)), width, 0)
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
    let now =
        Paragraph::new(lines.join("\n")).wrap(Wrap { trim: true }).block(Block::bordered().title(" now "));
    frame.render_widget(now, left);
    let changes = state
        .changes
        .iter()
        .map(|change| format!("{:4.0} s ago → {}: {}", change.age_s, change.to, change.reason));
    let changes = Paragraph::new(changes.collect::<Vec<_>>().join("\n"));
    frame.render_widget(changes.block(Block::bordered().title(" changes of mode ")), right);
}

fn draw_chart(frame: &mut Frame<'_>, area: Rect, points: Option<&ChartPoints<'_>>, state: &DamperState) {
    // The newest of the drawn points: a node without displacement still publishes, but repeats its last stamp.
    let drawn = ["estimate", "measured"].iter().filter_map(|line| state.points_age_s.get(line));
    let age_s = drawn.copied().min_by(f64::total_cmp);
    let has_stopped = age_s.is_none_or(|age_s| age_s > STALE_S);
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
    let colours = if has_stopped { [Color::DarkGray; 2] } else { [Color::Gray, Color::Cyan] };
    let set = |data, colour| {
        Dataset::default().marker(Marker::Braille).graph_type(GraphType::Scatter).style(colour).data(data)
    };
    let stopped = age_s.map_or_else(
        || " no estimate yet; force, N: ".to_owned(),
        |age_s| format!(" STOPPED {} ago; force before, N: ", damper_state::span(age_s)),
    );
    let title = Line::from(vec![
        if has_stopped {
            Span::styled(stopped, Style::new().fg(Color::Yellow).bold())
        } else {
            Span::raw(" force, N: ")
        },
        Span::styled("• measured  ", colours[0]),
        Span::styled("• estimate ", colours[1]),
    ]);
    let quiet = Style::new().fg(Color::DarkGray);
    let frame_style = if has_stopped { quiet } else { Style::new() };
    let y_labels = [-bound, 0.0, bound].map(|n| format!("{n:6.0}"));
    let chart = Chart::new(vec![set(&measured, colours[0]), set(&estimate, colours[1])])
        .block(Block::bordered().border_style(frame_style).title(title))
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
