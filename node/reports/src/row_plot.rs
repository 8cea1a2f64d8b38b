//! Plots with one named row for each thing that is compared: its interval as a line, and its values as dots.

use super::scale::{Scale, ticks};
use maud::{Markup, PreEscaped, html};
use std::fmt::Write;

/// Width in SVG units.
const WIDTH: f64 = 640.0;
/// Space for the names, and at the right edge.
const LEFT: f64 = 236.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 10.0;
const BOTTOM: f64 = 44.0;
/// Height of a row, and of the ends of an interval.
const ROW: f64 = 27.0;
const END: f64 = 9.0;
/// Names are cut to this many letters, which fit the space at the font size used on a phone.
const LETTERS: usize = 26;

/// A dot of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dot {
    /// The value itself.
    Filled,
    /// A value to compare with.
    Open,
}

/// One row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PlotRow {
    /// The name.
    pub(crate) name: String,
    /// Ends of the line; an end that is not finite is drawn to the edge of the plot.
    pub(crate) line: Option<[f64; 2]>,
    /// True if the line is an interval, so that its ends are marked.
    pub(crate) is_interval: bool,
    /// The dots.
    pub(crate) dots: Vec<(f64, Dot)>,
    /// True for the row that was chosen.
    pub(crate) is_strong: bool,
}

/// A plot of rows.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RowPlot {
    /// Text alternative for screen readers.
    pub(crate) description: String,
    /// Label of the axis, with its unit.
    pub(crate) label: String,
    /// The rows, from the top.
    pub(crate) rows: Vec<PlotRow>,
    /// A value that is marked by a dashed line over all rows.
    pub(crate) mark: Option<f64>,
}

impl RowPlot {
    /// The plot with `caption` below it; nothing without rows.
    pub(crate) fn figure(&self, caption: &str) -> Markup {
        html! {
            @if !self.rows.is_empty() {
                figure { (PreEscaped(self.svg())) figcaption { (caption) } }
            }
        }
    }

    /// The axis: from zero, or the smallest value if that is negative, to the largest value.
    fn scale(&self) -> Scale {
        let ends = self.rows.iter().flat_map(|row| {
            row.line.into_iter().flatten().chain(row.dots.iter().map(|dot| dot.0)).chain(self.mark)
        });
        let (low, high) = ends
            .filter(|value| value.is_finite())
            .fold((0.0_f64, 0.0_f64), |(low, high), value| (low.min(value), high.max(value)));
        let high = if high > low { high } else { low + 1.0 };
        let pad = 0.05 * (high - low);
        let from = if low < 0.0 { low - pad } else { 0.0 };
        Scale { from, to: high + pad, place_from: LEFT, place_to: WIDTH - RIGHT }
    }

    fn svg(&self) -> String {
        let scale = self.scale();
        let bottom = TOP + ROW * self.rows.len() as f64;
        let mut svg = String::new();
        let (description, label) = (html! { (self.description) }, html! { (self.label) });
        let _ = write!(
            svg,
            "<svg class=\"rows\" viewBox=\"0 0 {WIDTH} {:.0}\" role=\"img\" aria-label=\"{}\">",
            bottom + BOTTOM,
            description.into_string()
        );
        let (values, decimals) = ticks(scale.from, scale.to, 5);
        for value in values {
            let (x, class) = (scale.place(value), if value == 0.0 { "zero" } else { "grid" });
            // Adding zero turns -0 into 0.
            let text = format!("{:.decimals$}", value + 0.0).replace('-', "\u{2212}");
            let _ = write!(
                svg,
                "<path class=\"{class}\" d=\"M{x:.1} {TOP}V{bottom}\"/><text class=\"mid\" x=\"{x:.1}\" y=\"{:.0}\">{text}</text>",
                bottom + 20.0
            );
        }
        let right = WIDTH - RIGHT;
        let _ = write!(
            svg,
            "<text class=\"label end\" x=\"{right}\" y=\"{:.0}\">{}</text>",
            bottom + 38.0,
            label.into_string()
        );
        if let Some(x) = self.mark.filter(|mark| mark.is_finite()).map(|mark| scale.place(mark)) {
            let _ = write!(svg, "<path class=\"line dashed measured\" d=\"M{x:.1} {TOP}V{bottom}\"/>");
        }
        for (index, row) in self.rows.iter().enumerate() {
            draw(&mut svg, row, TOP + ROW * (index as f64 + 0.5), &scale);
        }
        svg.push_str("</svg>");
        svg
    }
}

fn draw(svg: &mut String, row: &PlotRow, middle: f64, scale: &Scale) {
    let mut name: String = row.name.chars().take(LETTERS).collect();
    if name.len() < row.name.len() {
        name.push('…');
    }
    let class = if row.is_strong { "label end strong" } else { "label end" };
    let _ = write!(
        svg,
        "<text class=\"{class}\" x=\"{:.0}\" y=\"{:.1}\">{}</text>",
        LEFT - 10.0,
        middle + 4.5,
        html! { (name) }.into_string()
    );
    if let Some(line) = row.line.filter(|line| !line.iter().any(|end| end.is_nan())) {
        let [from, to] = line.map(|end| scale.place(end.clamp(scale.from, scale.to)));
        let _ = write!(svg, "<path class=\"span\" d=\"M{from:.1} {middle:.1}H{to:.1}\"/>");
        for (end, x) in line.into_iter().zip([from, to]) {
            if row.is_interval && end.is_finite() {
                let _ = write!(svg, "<path class=\"span\" d=\"M{x:.1} {:.1}v{END}\"/>", middle - 0.5 * END);
            }
        }
    }
    for (value, dot) in row.dots.iter().filter(|dot| dot.0.is_finite()) {
        let class = if *dot == Dot::Filled { "point" } else { "point open" };
        let _ = write!(
            svg,
            "<circle class=\"{class}\" cx=\"{:.1}\" cy=\"{middle:.1}\" r=\"5\"/>",
            scale.place(*value)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot() -> RowPlot {
        let row = |name: &str, line, dots: &[(f64, Dot)]| PlotRow {
            name: name.to_owned(),
            line,
            is_interval: true,
            dots: dots.to_vec(),
            is_strong: false,
        };
        RowPlot {
            description: "a < b".to_owned(),
            label: "share".to_owned(),
            rows: vec![
                row("interval", Some([50.0, 150.0]), &[(100.0, Dot::Filled)]),
                row("open end", Some([f64::NEG_INFINITY, 120.0]), &[(f64::NAN, Dot::Open)]),
                row("a name of more than 26 letters", None, &[(-20.0, Dot::Open)]),
            ],
            mark: Some(100.0),
        }
    }

    #[test]
    fn values_are_placed_on_the_axis() {
        let svg = plot().svg();
        // The axis goes from -28.5 to 158.5: 5 % of the range from -20 to 150 at both ends, over 388 units.
        let x = |value: f64| format!("{:.1}", 236.0 + (value + 28.5) / 187.0 * 388.0);
        assert!(svg.contains(&format!("<circle class=\"point\" cx=\"{}\"", x(100.0))), "{svg}");
        assert!(svg.contains(&format!("<circle class=\"point open\" cx=\"{}\"", x(-20.0))), "{svg}");
        assert!(svg.contains(&format!("M{} 23.5H{}", x(50.0), x(150.0))), "{svg}");
        assert!(svg.contains(&format!("M236.0 50.5H{}", x(120.0))), "an open end reaches the edge: {svg}");
        assert!(svg.contains(&format!("dashed measured\" d=\"M{}", x(100.0))), "{svg}");
        assert_eq!(svg.matches("<circle").count(), 2, "a value that is not finite has no dot: {svg}");
        assert!(svg.contains("a &lt; b") && svg.contains("a name of more than 26 let…"), "{svg}");
    }

    #[test]
    fn a_plot_without_rows_or_values_is_valid() {
        let empty = RowPlot { rows: Vec::new(), mark: None, ..plot() };
        assert_eq!(empty.figure("caption").into_string(), "");
        let bare = PlotRow {
            name: "x".to_owned(),
            line: Some([f64::NAN; 2]),
            is_interval: true,
            dots: vec![(0.0, Dot::Filled)],
            is_strong: true,
        };
        let svg = RowPlot { rows: vec![bare], mark: Some(f64::NAN), ..plot() }.svg();
        assert!(svg.ends_with("</svg>") && !svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}
