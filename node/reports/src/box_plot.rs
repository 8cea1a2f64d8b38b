//! Horizontal box plots on a logarithmic axis, one row per name.

use super::log_axis::{log_scale, log_ticks};
use maud::html;
use mr_damper_model::compare::BoxPlot;
use std::fmt::Write;

/// Width in SVG units.
const WIDTH: f64 = 640.0;
/// Space for the names: fourteen letters at the font size used on a phone.
const LEFT: f64 = 168.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 10.0;
const BOTTOM: f64 = 58.0;
/// Height of a row and of its box.
const ROW: f64 = 27.0;
const BOX: f64 = 15.0;

/// One row: a name and its box, or a remark that says why the box is missing.
#[derive(Debug, Clone, PartialEq)]
pub struct BoxRow {
    /// The name.
    pub name: String,
    /// The numbers of the box; `None` for no box.
    pub numbers: Option<BoxPlot>,
    /// A remark at the right end; empty for none.
    pub remark: String,
    /// True for a baseline, which is drawn in another style than the models.
    pub yardstick: bool,
}

/// All values that `rows` show. Use it to give several drawings the same axis.
pub fn values(rows: &[BoxRow]) -> impl Iterator<Item = f64> {
    rows.iter().filter_map(|row| row.numbers.as_ref()).flat_map(|numbers| {
        let ends = [numbers.lower_whisker, numbers.upper_whisker];
        ends.into_iter().chain(numbers.outliers.iter().copied())
    })
}

/// The drawing of `rows` as SVG. The axis is labelled `label` and covers the values `span`.
#[must_use]
pub fn svg(description: &str, label: &str, rows: &[BoxRow], span: impl Iterator<Item = f64>) -> String {
    let scale = log_scale(span, LEFT, WIDTH - RIGHT);
    let bottom = TOP + ROW * rows.len() as f64;
    let mut svg = String::new();
    let (description, label) = (html! { (description) }.into_string(), html! { (label) }.into_string());
    let _ = write!(
        svg,
        "<svg viewBox=\"0 0 {WIDTH} {:.0}\" role=\"img\" aria-label=\"{description}\">",
        bottom + BOTTOM
    );
    for (at, text) in log_ticks(&scale) {
        let x = scale.place(at);
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"M{x:.1} {TOP}V{bottom}\"/><text class=\"mid\" x=\"{x:.1}\" y=\"{:.0}\">{text}</text>",
            bottom + 22.0
        );
    }
    let _ = write!(
        svg,
        "<path class=\"axis\" d=\"M{LEFT} {bottom}H{}\"/><text class=\"label end\" x=\"{0}\" y=\"{:.0}\">{label}</text>",
        WIDTH - RIGHT,
        bottom + 48.0
    );
    let place = |value: f64| scale.place(value.log10());
    for (index, row) in rows.iter().enumerate() {
        let middle = TOP + ROW * (index as f64 + 0.5);
        let name = html! { (row.name) }.into_string();
        let _ = write!(
            svg,
            "<text class=\"label end\" x=\"{:.0}\" y=\"{:.1}\">{name}</text>",
            LEFT - 8.0,
            middle + 5.0
        );
        if let Some(numbers) = &row.numbers {
            draw(&mut svg, numbers, middle, row.yardstick, place);
        }
        if !row.remark.is_empty() {
            let remark = html! { (row.remark) }.into_string();
            let x = WIDTH - RIGHT;
            let _ =
                write!(svg, "<text class=\"end remark\" x=\"{x}\" y=\"{:.1}\">{remark}</text>", middle + 5.0);
        }
    }
    svg.push_str("</svg>");
    svg
}

fn draw(svg: &mut String, numbers: &BoxPlot, middle: f64, yardstick: bool, place: impl Fn(f64) -> f64) {
    let class = if yardstick { "box yardstick" } else { "box" };
    let [low, q1, median, q3, high] = [
        numbers.lower_whisker,
        numbers.lower_quartile,
        numbers.median,
        numbers.upper_quartile,
        numbers.upper_whisker,
    ]
    .map(&place);
    let (top, half) = (middle - BOX / 2.0, BOX / 4.0);
    let _ = write!(
        svg,
        "<path class=\"whisker\" d=\"M{low:.1} {middle:.1}H{q1:.1}M{q3:.1} {middle:.1}H{high:.1}\
         M{low:.1} {:.1}V{:.1}M{high:.1} {:.1}V{:.1}\"/>\
         <rect class=\"{class}\" x=\"{q1:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{BOX}\"/>\
         <path class=\"median\" d=\"M{median:.1} {top:.1}v{BOX}\"/>",
        middle - half,
        middle + half,
        middle - half,
        middle + half,
        (q3 - q1).max(0.5)
    );
    let mut dots = String::new();
    for outlier in numbers.outliers.iter().filter(|value| **value > 0.0) {
        let _ = write!(dots, "M{:.1} {middle:.1}h0", place(*outlier));
    }
    if !dots.is_empty() {
        let _ = write!(svg, "<path class=\"dots outlier\" d=\"{dots}\"/>");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_drawn_as_text() {
        let row = |name: &str, values: &[f64]| BoxRow {
            name: name.to_owned(),
            numbers: BoxPlot::of(values.iter().copied()),
            remark: if values.is_empty() { "diverged".to_owned() } else { String::new() },
            yardstick: name == "persistence",
        };
        let rows = [
            row("fuzzy-tanh", &[0.02, 0.03, 0.04, 0.05, 0.4]),
            row("persistence", &[0.01, 0.012, 0.013]),
            row("a < b", &[]),
        ];
        insta::assert_snapshot!(svg("NMSE of two models", "NMSE", &rows, values(&rows)).replace('>', ">\n"));
    }

    #[test]
    fn a_drawing_without_rows_is_valid() {
        let svg = svg("", "NMSE", &[], std::iter::empty());
        assert!(svg.ends_with("</svg>") && !svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}
