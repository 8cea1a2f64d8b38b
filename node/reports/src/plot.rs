//! Plots as inline SVG: lines and dots over shaded bands, with axes and a legend.
//!
//! Colours are classes of the page's style sheet, so that a plot follows the reader's light or dark mode. The legend
//! is text of the page rather than part of the drawing, so that it wraps on a phone.

use super::log_axis::log_ticks;
use super::scale::{Scale, range, thin_dots, thin_line, ticks};
use maud::{Markup, PreEscaped, html};
use std::fmt::Write;

/// Width of a plot in SVG units.
const WIDTH: f64 = 640.0;
/// Space for the labels of the y axis, of the x axis and of the title, and at the right edge.
const LEFT: f64 = 64.0;
const BOTTOM: f64 = 48.0;
const TOP: f64 = 30.0;
const RIGHT: f64 = 14.0;
/// Columns to which a line is thinned: finer than a screen shows at this width.
const COLUMNS: usize = 640;
/// Most dots that are drawn of one series.
const DOTS: usize = 1600;

/// Colours, named by their meaning. Any two that appear in the same plot differ in lightness too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ink {
    /// Measured values.
    Measured,
    /// Measured values that were withheld from the service.
    Withheld,
    /// Estimated values.
    Estimate,
    /// Residuals.
    Residual,
    /// A summary of residuals.
    Trend,
    /// Values before a change.
    Before,
    /// Values after it.
    After,
    /// One of four levels, from low (0) to high (3).
    Level(u8),
}

impl Ink {
    /// The class in the style sheet.
    #[must_use]
    pub const fn class(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Withheld => "withheld",
            Self::Estimate => "estimate",
            Self::Residual => "residual",
            Self::Trend => "trend",
            Self::Before => "before",
            Self::After => "after",
            Self::Level(0) => "level0",
            Self::Level(1) => "level1",
            Self::Level(2) => "level2",
            Self::Level(_) => "level3",
        }
    }
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Points in order of x, connected; a point that is not finite breaks the line.
    Line,
    /// A dashed line, otherwise like [`Shape::Line`].
    Dashed,
    /// Points connected in the given order; not thinned, so for few points.
    Loop,
    /// The area enclosed by the points; a point that is not finite starts another area.
    Area,
    /// Unconnected points.
    Dots,
}

impl Shape {
    /// The class in the style sheet.
    const fn class(self) -> &'static str {
        match self {
            Self::Line | Self::Loop => "line",
            Self::Dashed => "line dashed",
            Self::Area => "area",
            Self::Dots => "dots",
        }
    }

    /// The class of the key in the legend.
    const fn key(self) -> &'static str {
        match self {
            Self::Line | Self::Dashed | Self::Loop => "line",
            Self::Area => "area",
            Self::Dots => "dot",
        }
    }
}

/// Points with a name, a colour and a shape.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// The name in the legend; empty for none.
    pub name: String,
    /// The colour.
    pub ink: Ink,
    /// How it is drawn.
    pub shape: Shape,
    /// The points.
    pub points: Vec<(f64, f64)>,
}

/// A shaded span of the x axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// Where it begins.
    pub from: f64,
    /// Where it ends.
    pub to: f64,
    /// The class in the style sheet, without its prefix `band-`.
    pub class: &'static str,
    /// The name in the legend.
    pub name: String,
}

/// A plot.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// Text alternative for screen readers.
    pub description: String,
    /// Label of the x axis, with its unit.
    pub x_label: String,
    /// Label of the y axis, with its unit.
    pub y_label: String,
    /// Range of x; by default the range of the series.
    pub x_range: Option<(f64, f64)>,
    /// Range of y; by default the range of the series.
    pub y_range: Option<(f64, f64)>,
    /// True for a logarithmic x and y axis. Its range is then in decimal logarithms, and values that are not positive
    /// are not drawn.
    pub log: (bool, bool),
    /// Height in SVG units; the width is 640.
    pub height: f64,
    /// Shaded spans, behind everything.
    pub bands: Vec<Band>,
    /// The series, the last one on top.
    pub series: Vec<Series>,
}

impl Default for Plot {
    fn default() -> Self {
        Self {
            description: String::new(),
            x_label: String::new(),
            y_label: String::new(),
            x_range: None,
            y_range: None,
            log: (false, false),
            height: 300.0,
            bands: Vec::new(),
            series: Vec::new(),
        }
    }
}

impl Plot {
    /// The plot with its legend and, below it, `caption`.
    #[must_use]
    pub fn figure(&self, caption: &str) -> Markup {
        html! {
            figure {
                (self.legend())
                (PreEscaped(self.svg()))
                @if !caption.is_empty() { figcaption { (caption) } }
            }
        }
    }

    fn legend(&self) -> Markup {
        let mut bands: Vec<(&str, &str)> = Vec::new();
        for band in &self.bands {
            if !bands.contains(&(band.class, band.name.as_str())) {
                bands.push((band.class, &band.name));
            }
        }
        html! {
            p.legend {
                @for series in self.series.iter().filter(|series| !series.name.is_empty()) {
                    span {
                        i class=(format!("key {} {}", series.shape.key(), series.ink.class())) {}
                        (series.name)
                    }
                }
                @for (class, name) in bands {
                    span { i class=(format!("key band-{class}")) {} (name) }
                }
            }
        }
    }

    /// The drawing as SVG, without legend and caption.
    #[must_use]
    pub fn svg(&self) -> String {
        let series: Vec<Vec<(f64, f64)>> =
            self.series.iter().map(|series| self.on_axes(&series.points)).collect();
        let (x, y) = self.scales(&series);
        let mut svg = String::new();
        let description = html! { (self.description) }.into_string();
        let _ = write!(
            svg,
            "<svg viewBox=\"0 0 {WIDTH} {:.0}\" role=\"img\" aria-label=\"{description}\">",
            self.height
        );
        self.draw_bands(&mut svg, &x, &y);
        self.draw_axes(&mut svg, &x, &y);
        for (series, points) in self.series.iter().zip(&series) {
            let path = match series.shape {
                Shape::Line | Shape::Dashed => line_path(&visible(points, &x), &x, &y),
                Shape::Loop => line_path(points, &x, &y),
                Shape::Area => area_path(points, &x, &y),
                Shape::Dots => dots_path(points, &x, &y),
            };
            let _ =
                write!(svg, "<path class=\"{} {}\" d=\"{path}\"/>", series.shape.class(), series.ink.class());
        }
        svg.push_str("</svg>");
        svg
    }

    /// The points in axis coordinates: decimal logarithms on logarithmic axes, NaN where there is none.
    fn on_axes(&self, points: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let place = |log: bool, value: f64| match log {
            true if value > 0.0 => value.log10(),
            true => f64::NAN,
            false => value,
        };
        points.iter().map(|(x, y)| (place(self.log.0, *x), place(self.log.1, *y))).collect()
    }

    fn scales(&self, series: &[Vec<(f64, f64)>]) -> (Scale, Scale) {
        let points = || series.iter().flatten();
        let tight = |range: (f64, f64)| {
            // A line begins and ends at the edges: remove the 4 % that `range` has added there.
            let pad = (range.1 - range.0) * 0.04 / 1.08;
            (range.0 + pad, range.1 - pad)
        };
        let lines_only = self.series.iter().all(|series| matches!(series.shape, Shape::Line | Shape::Dashed));
        let x_found = range(points().map(|point| point.0));
        let (x_from, x_to) = self.x_range.unwrap_or(if lines_only { tight(x_found) } else { x_found });
        let inside = points().filter(|point| point.0 >= x_from && point.0 <= x_to);
        let (y_from, y_to) = self.y_range.unwrap_or_else(|| range(inside.map(|point| point.1)));
        (
            Scale { from: x_from, to: x_to, place_from: LEFT, place_to: WIDTH - RIGHT },
            Scale { from: y_from, to: y_to, place_from: self.height - BOTTOM, place_to: TOP },
        )
    }

    fn draw_bands(&self, svg: &mut String, x: &Scale, y: &Scale) {
        for band in &self.bands {
            let (from, to) = (x.place(band.from.max(x.from)), x.place(band.to.min(x.to)));
            if to > from {
                let _ = write!(
                    svg,
                    "<rect class=\"band-{}\" x=\"{from:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>",
                    band.class,
                    y.place_to,
                    to - from,
                    y.place_from - y.place_to
                );
            }
        }
    }

    fn draw_axes(&self, svg: &mut String, x: &Scale, y: &Scale) {
        let labelled = |log: bool, scale: &Scale, target: usize| {
            if log {
                return log_ticks(scale);
            }
            let (ticks, decimals) = ticks(scale.from, scale.to, target);
            ticks.into_iter().map(|tick| (tick, number(tick, decimals))).collect()
        };
        let (x_ticks, y_ticks) = (labelled(self.log.0, x, 6), labelled(self.log.1, y, 5));
        let (left, right, bottom) = (x.place_from, x.place_to, y.place_from);
        for (tick, label) in &y_ticks {
            let at = y.place(*tick);
            let class = if *tick == 0.0 && !self.log.1 { "zero" } else { "grid" };
            let _ = write!(
                svg,
                "<path class=\"{class}\" d=\"M{left} {at:.1}H{right}\"/>\
                 <text class=\"end\" x=\"{:.0}\" y=\"{:.1}\">{label}</text>",
                left - 6.0,
                at + 4.5
            );
        }
        for (tick, label) in &x_ticks {
            let at = x.place(*tick);
            let _ = write!(
                svg,
                "<path class=\"grid\" d=\"M{at:.1} {bottom}v5\"/>\
                 <text class=\"mid\" x=\"{at:.1}\" y=\"{:.0}\">{label}</text>",
                bottom + 20.0
            );
        }
        let (x_label, y_label) = (html! { (self.x_label) }, html! { (self.y_label) });
        let _ = write!(
            svg,
            "<path class=\"axis\" d=\"M{left} {bottom}H{right}\"/>\
             <text class=\"label end\" x=\"{right}\" y=\"{:.0}\">{}</text>\
             <text class=\"label\" x=\"4\" y=\"18\">{}</text>",
            self.height - 6.0,
            x_label.into_string(),
            y_label.into_string()
        );
    }
}

/// A number with a typographic minus sign.
fn number(value: f64, decimals: usize) -> String {
    // Adding zero turns -0 into 0.
    format!("{:.decimals$}", value + 0.0).replace('-', "\u{2212}")
}

/// The points within the range of `x`, thinned to [`COLUMNS`].
fn visible(points: &[(f64, f64)], x: &Scale) -> Vec<(f64, f64)> {
    let first = points.partition_point(|point| point.0 < x.from);
    let last = points.partition_point(|point| point.0 <= x.to);
    thin_line(&points[first..last.max(first)], COLUMNS)
}

fn line_path(points: &[(f64, f64)], x: &Scale, y: &Scale) -> String {
    let mut path = String::new();
    let mut pen_up = true;
    for (at, value) in points {
        if !at.is_finite() || !value.is_finite() {
            pen_up = true;
            continue;
        }
        let _ = write!(path, "{}{:.1} {:.1}", if pen_up { 'M' } else { 'L' }, x.place(*at), y.place(*value));
        pen_up = false;
    }
    path
}

/// Closed areas, clamped to the plot.
fn area_path(points: &[(f64, f64)], x: &Scale, y: &Scale) -> String {
    let mut path = String::new();
    for area in points.split(|point| !point.0.is_finite() || !point.1.is_finite()) {
        for (index, (at, value)) in area.iter().enumerate() {
            let (at, value) = (at.clamp(x.from, x.to), value.clamp(y.from, y.to));
            let _ = write!(
                path,
                "{}{:.1} {:.1}",
                if index == 0 { 'M' } else { 'L' },
                x.place(at),
                y.place(value)
            );
        }
        path.push_str(if area.is_empty() { "" } else { "Z" });
    }
    path
}

/// Dots as strokes of zero length with round ends, which take a tenth of the bytes of circles.
fn dots_path(points: &[(f64, f64)], x: &Scale, y: &Scale) -> String {
    let inside: Vec<(f64, f64)> =
        points.iter().filter(|point| x.holds(point.0) && y.holds(point.1)).copied().collect();
    let mut path = String::new();
    for (at, value) in thin_dots(&inside, DOTS) {
        let _ = write!(path, "M{:.1} {:.1}h0", x.place(at), y.place(value));
    }
    path
}

/// Means of y in `bins` equally wide bins of x, placed at the middle of each bin. A bin with fewer than `least` points
/// gives NaN, which breaks the line.
#[must_use]
pub fn binned_mean(points: &[(f64, f64)], bins: usize, least: usize) -> Vec<(f64, f64)> {
    let finite = || points.iter().filter(|point| point.0.is_finite() && point.1.is_finite());
    let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| (a.min(p.0), b.max(p.0)));
    if low >= high || bins == 0 {
        return Vec::new();
    }
    let width = (high - low) / bins as f64;
    let mut sums = vec![(0_usize, 0.0_f64); bins];
    for (at, value) in finite() {
        let (count, sum) = &mut sums[(((at - low) / width) as usize).min(bins - 1)];
        *count += 1;
        *sum += value;
    }
    let middle = |bin: usize| low + (bin as f64 + 0.5) * width;
    sums.iter()
        .enumerate()
        .map(|(bin, (count, sum))| (middle(bin), if *count < least { f64::NAN } else { sum / *count as f64 }))
        .collect()
}

/// A bin of x: its middle, and lower quartile, median and upper quartile of y in it.
pub type Quartiles = (f64, [f64; 3]);

/// Quartiles of y in `bins` equally wide bins over the middle 99 % of x. Bins with fewer than `least` points are left
/// out. Empty when x is constant.
#[must_use]
pub fn binned_quartiles(points: &[(f64, f64)], bins: usize, least: usize) -> Vec<Quartiles> {
    let mut sorted: Vec<(f64, f64)> =
        points.iter().filter(|point| point.0.is_finite() && point.1.is_finite()).copied().collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let outside = sorted.len() / 200;
    let inside = &sorted[outside..sorted.len() - outside];
    let (Some(first), Some(last)) = (inside.first(), inside.last()) else { return Vec::new() };
    let (low, width) = (first.0, (last.0 - first.0) / bins as f64);
    if width <= 0.0 || !width.is_finite() {
        return Vec::new();
    }
    let bin = |x: f64| (((x - low) / width) as usize).min(bins - 1);
    inside
        .chunk_by(|a, b| bin(a.0) == bin(b.0))
        .filter(|group| group.len() >= least.max(1))
        .map(|group| {
            let mut values: Vec<f64> = group.iter().map(|point| point.1).collect();
            values.sort_by(f64::total_cmp);
            let at = |share: f64| values[(share * (values.len() - 1) as f64).round() as usize];
            (low + (bin(group[0].0) as f64 + 0.5) * width, [0.25, 0.5, 0.75].map(at))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot() -> Plot {
        Plot {
            description: "force < limit".to_owned(),
            x_label: "time, s".to_owned(),
            y_label: "force, N".to_owned(),
            height: 200.0,
            bands: vec![Band { from: 1.0, to: 9.0, class: "arx", name: "arx".to_owned() }],
            series: vec![
                Series {
                    name: "measured".to_owned(),
                    ink: Ink::Measured,
                    shape: Shape::Line,
                    points: vec![(0.0, -10.0), (1.0, f64::NAN), (2.0, 10.0), (4.0, 0.0)],
                },
                Series {
                    name: "dots".to_owned(),
                    ink: Ink::Level(2),
                    shape: Shape::Dots,
                    points: vec![(1.0, 1.0), (f64::NAN, 2.0)],
                },
            ],
            x_range: Some((0.0, 4.0)),
            ..Plot::default()
        }
    }

    #[test]
    fn a_plot_is_drawn_as_text() {
        insta::assert_snapshot!(plot().svg().replace('>', ">\n"));
    }

    #[test]
    fn the_legend_names_series_and_bands() {
        let text = plot().figure("what is seen").into_string();
        for word in ["measured", "key dot level2", "band-arx", "what is seen", "force &lt; limit"] {
            assert!(text.contains(word), "{word}: {text}");
        }
    }

    #[test]
    fn an_empty_plot_is_valid_svg() {
        let svg = Plot::default().svg();
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>") && !svg.contains("NaN"), "{svg}");
    }

    #[test]
    fn each_bin_gives_the_mean_of_its_points() {
        let points: Vec<(f64, f64)> = (0..100).map(|k| (f64::from(k), f64::from(k % 2))).collect();
        let means = binned_mean(&points, 10, 5);
        assert_eq!(means.len(), 10);
        assert!(means.iter().all(|(_, mean)| (mean - 0.5).abs() < 1e-12));
        assert!(binned_mean(&[(1.0, 1.0)], 10, 1).is_empty());
    }

    #[test]
    fn each_bin_gives_the_quartiles_of_its_points() {
        // Each of the ten bins holds the values 0 to 100, except for the outermost 0.5 % that are left out at either end.
        let points: Vec<(f64, f64)> = (0..10_100).map(|k| (f64::from(k / 101), f64::from(k % 101))).collect();
        let found = binned_quartiles(&points, 10, 5);
        assert_eq!(found.len(), 10);
        assert!(found.iter().all(|(_, [low, middle, high])| (low - 25.0).abs() < 5.0
            && (middle - 50.0).abs() < 5.0
            && (high - 75.0).abs() < 5.0));
        assert!(binned_quartiles(&[(1.0, 1.0); 50], 10, 1).is_empty(), "x is constant");
        assert!(binned_quartiles(&[], 10, 1).is_empty());
    }

    #[test]
    fn logarithmic_axes_loops_and_areas_are_drawn() {
        let series = |shape, points: &[(f64, f64)]| Series {
            name: "a".to_owned(),
            ink: Ink::After,
            shape,
            points: points.to_vec(),
        };
        let corners =
            [(1.0, 1.0), (10.0, 100.0), (100.0, 1.0), (f64::NAN, 1.0), (2.0, 2.0), (4.0, 2.0), (4.0, 4.0)];
        let plot = Plot {
            x_range: Some((0.0, 2.0)),
            y_range: Some((0.0, 2.0)),
            log: (true, true),
            height: 200.0,
            series: vec![
                series(Shape::Loop, &[(10.0, 1.0), (1.0, 10.0), (10.0, 100.0), (0.0, 5.0), (100.0, 1.0)]),
                series(Shape::Area, &corners),
                series(Shape::Dashed, &[(1.0, 1.0), (100.0, 100.0)]),
            ],
            ..Plot::default()
        };
        insta::assert_snapshot!(plot.svg().replace('>', ">\n"));
    }
}
