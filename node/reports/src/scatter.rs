//! Named points on two logarithmic axes, with the Pareto front: the points that no other point beats on both axes.

use super::log_axis::{log_scale, log_ticks};
use super::scale::Scale;
use maud::html;
use std::fmt::Write;

/// Size in SVG units.
const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 440.0;
const LEFT: f64 = 72.0;
const RIGHT: f64 = 18.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 58.0;
/// Width of a letter and height of a line of a name, at the font size used on a phone.
const LETTER: f64 = 10.5;
const LINE: f64 = 20.0;

/// A point with its name.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPoint {
    /// The name.
    pub name: String,
    /// Horizontal value; smaller is better.
    pub x: f64,
    /// Vertical value; smaller is better.
    pub y: f64,
    /// Class of its colour in the style sheet.
    pub ink: &'static str,
}

/// The drawing as SVG. A name that would cover another one is left out; names on the front are placed first.
#[must_use]
pub fn svg(description: &str, x_label: &str, y_label: &str, points: &[NamedPoint]) -> String {
    let points: Vec<&NamedPoint> =
        points.iter().filter(|p| p.x > 0.0 && p.y > 0.0 && p.x.is_finite() && p.y.is_finite()).collect();
    let x = log_scale(points.iter().map(|p| p.x), LEFT, WIDTH - RIGHT);
    let y = log_scale(points.iter().map(|p| p.y), HEIGHT - BOTTOM, TOP);
    let mut svg = String::new();
    let [description, x_label, y_label] =
        [description, x_label, y_label].map(|text| html! { (text) }.into_string());
    let _ = write!(svg, "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{description}\">");
    axes(&mut svg, &x, &y, &x_label, &y_label);
    let front = front(&points);
    let mut path = String::new();
    for (index, point) in front.iter().enumerate() {
        let (at, up) = (x.place(point.x.log10()), y.place(point.y.log10()));
        // A staircase: between two points of the front the left one is the best known.
        let _ = if index == 0 { write!(path, "M{at:.1} {up:.1}") } else { write!(path, "H{at:.1}V{up:.1}") };
    }
    let _ = write!(svg, "<path class=\"line front\" d=\"{path}\"/>");
    let places: Vec<(f64, f64)> =
        points.iter().map(|p| (x.place(p.x.log10()), y.place(p.y.log10()))).collect();
    for (point, (at, up)) in points.iter().zip(&places) {
        let _ = write!(svg, "<path class=\"dots named {}\" d=\"M{at:.1} {up:.1}h0\"/>", point.ink);
    }
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by_key(|&index| !front.contains(&points[index]));
    let mut taken: Vec<[f64; 4]> = places.iter().map(|(x, y)| [x - 4.0, y - 4.0, x + 4.0, y + 4.0]).collect();
    for index in order {
        if let Some((class, at, up, area)) = free_place(&points[index].name, places[index], &taken) {
            taken.push(area);
            let name = html! { (points[index].name) }.into_string();
            let _ =
                write!(svg, "<text class=\"label halo {class}\" x=\"{at:.1}\" y=\"{up:.1}\">{name}</text>");
        }
    }
    svg.push_str("</svg>");
    svg
}

/// The Pareto front (no other point is smaller in both values), sorted by x.
fn front<'a>(points: &[&'a NamedPoint]) -> Vec<&'a NamedPoint> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let mut best = f64::INFINITY;
    sorted.retain(|point| {
        let better = point.y < best;
        best = best.min(point.y);
        better
    });
    sorted
}

/// A free place for the label `name` next to `(x, y)`: its class, x, y and area. `None` when all places
/// overlap `taken` or are outside.
fn free_place(
    name: &str,
    (x, y): (f64, f64),
    taken: &[[f64; 4]],
) -> Option<(&'static str, f64, f64, [f64; 4])> {
    let width = LETTER * name.chars().count() as f64;
    let right = ("", x + 8.0, y + 5.0, x + 8.0, y - 0.5 * LINE);
    let left = ("end", x - 8.0, y + 5.0, x - 8.0 - width, y - 0.5 * LINE);
    let above = ("mid", x, y - 9.0, x - 0.5 * width, y - 9.0 - 0.8 * LINE);
    let below = ("mid", x, y + 22.0, x - 0.5 * width, y + 6.0);
    let inside =
        |a: &[f64; 4]| a[0] > LEFT && a[2] < WIDTH - 2.0 && a[1] > TOP - 12.0 && a[3] < HEIGHT - BOTTOM;
    let meets = |a: &[f64; 4], b: &[f64; 4]| a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
    [right, left, above, below].into_iter().find_map(|(class, at, up, from, top)| {
        let area = [from, top, from + width, top + LINE];
        (inside(&area) && !taken.iter().any(|other| meets(&area, other))).then_some((class, at, up, area))
    })
}

fn axes(svg: &mut String, x: &Scale, y: &Scale, x_label: &str, y_label: &str) {
    for (at, text) in log_ticks(x) {
        let at = x.place(at);
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"M{at:.1} {}v5\"/><text class=\"mid\" x=\"{at:.1}\" y=\"{:.0}\">{text}</text>",
            y.place_from,
            y.place_from + 23.0
        );
    }
    for (up, text) in log_ticks(y) {
        let up = y.place(up);
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"M{LEFT} {up:.1}H{}\"/><text class=\"end\" x=\"{:.0}\" y=\"{:.1}\">{text}</text>",
            WIDTH - RIGHT,
            LEFT - 6.0,
            up + 5.0
        );
    }
    let _ = write!(
        svg,
        "<path class=\"axis\" d=\"M{LEFT} {}H{}\"/><text class=\"label end\" x=\"{1}\" y=\"{:.0}\">{x_label}</text>\
         <text class=\"label\" x=\"4\" y=\"18\">{y_label}</text>",
        y.place_from,
        WIDTH - RIGHT,
        HEIGHT - 10.0
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(name: &str, x: f64, y: f64) -> NamedPoint {
        NamedPoint { name: name.to_owned(), x, y, ink: "level2" }
    }

    #[test]
    fn the_front_holds_the_points_that_no_other_beats() {
        let all = [named("a", 10.0, 0.3), named("b", 20.0, 0.4), named("c", 30.0, 0.1), named("d", 5.0, 0.9)];
        let names: Vec<&str> =
            front(&all.iter().collect::<Vec<_>>()).iter().map(|p| p.name.as_str()).collect();
        assert_eq!(names, ["d", "a", "c"]);
    }

    #[test]
    fn points_are_drawn_as_text() {
        let all = [named("a", 10.0, 0.3), named("b < c", 2000.0, 0.05), named("off", 1.0, f64::INFINITY)];
        insta::assert_snapshot!(svg("error over time", "ns a step", "NMSE", &all).replace('>', ">\n"));
    }

    #[test]
    fn names_do_not_cover_each_other() {
        let all: Vec<NamedPoint> =
            (0..30).map(|k| named(&format!("model-{k}"), 10.0 + f64::from(k), 0.1)).collect();
        let svg = svg("", "x", "y", &all);
        let labels = svg.matches("model-").count();
        assert!((3..30).contains(&labels), "{labels}");
        assert_eq!(svg.matches("h0").count(), 30, "every point is drawn");
    }
}
