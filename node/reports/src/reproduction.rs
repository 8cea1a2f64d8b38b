//! The report of `mr-damper reproduce`: every table and figure of a publication, reproduced, beside its published numbers.
//!
//! ```text
//! difference = here - published          of a table's figure, in the unit of the publication
//! ```
//!
//! Another damper made the runs than in the publication, so differences are expected. The report shows them and does not judge.

use super::box_plot::{self, BoxRow};
use super::page::{page, section};
use super::plot::Plot;
use super::table::{facts, table};
use maud::{Markup, PreEscaped, html};
use serde::Serialize;

/// All that the report shows.
#[derive(Debug, Clone, Default)]
pub struct Reproduction {
    /// The report in a sentence.
    pub lead: String,
    /// Names and values that say how it was made.
    pub facts: Vec<(String, String)>,
    /// The publications, each with its tables and figures.
    pub chapters: Vec<Chapter>,
}

/// The items of one publication, or of one of its chapters.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Chapter {
    /// The heading.
    pub title: String,
    /// A remark on all its items.
    pub remark: String,
    /// Tables and figures in the order of the publication.
    pub items: Vec<Item>,
}

/// A reproduced table or figure of the publication.
#[derive(Debug, Clone, PartialEq)]
pub struct Item {
    /// Its number in the publication, as in `Table 4.1`.
    pub number: String,
    /// Its subject.
    pub title: String,
    /// How it was made, and how it deviates from the publication; empty for nothing to say.
    pub remark: String,
    /// The reproduction, in one or several parts.
    pub parts: Vec<Part>,
}

/// A part of an item.
#[derive(Debug, Clone, PartialEq)]
pub enum Part {
    /// Figures beside the published ones.
    Figures {
        /// The quantity; empty if the title names it.
        what: &'static str,
        /// The unit of all figures; empty for shares.
        unit: &'static str,
        /// Number of decimals.
        decimals: usize,
        /// Names of the columns of labels.
        labels: Vec<&'static str>,
        /// The figures.
        rows: Vec<ComparedFigure>,
    },
    /// Box plots with one axis.
    Boxes {
        /// The label of the axis, with the unit.
        axis: String,
        /// One box each.
        rows: Vec<BoxRow>,
    },
    /// Plots, each with a caption, side by side in pairs if there are several.
    Plots(Vec<(String, Plot)>),
}

/// A figure beside the published one.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ComparedFigure {
    /// What it is the figure of: as many words as the item has label columns.
    pub of: Vec<String>,
    /// The published figure; `None` if there is none.
    pub published: Option<f64>,
    /// The figure of this reproduction; `None` if there is none, for example after a divergence.
    pub here: Option<f64>,
}

impl ComparedFigure {
    /// The difference of this reproduction from the publication.
    #[must_use]
    pub fn difference(&self) -> Option<f64> {
        Some(self.here? - self.published?)
    }
}

impl Item {
    /// A figure of box plots.
    #[must_use]
    pub fn boxes(number: &str, title: String, axis: &str, rows: Vec<BoxRow>) -> Self {
        let parts = vec![Part::Boxes { axis: axis.to_owned(), rows }];
        Self { number: number.to_owned(), title, remark: String::new(), parts }
    }

    /// The anchor of the item in the page: letters, digits and hyphens.
    fn anchor(&self, chapter: usize) -> String {
        let word = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' };
        format!("c{chapter}-{}", self.number.chars().map(word).collect::<String>())
    }
}

/// The report as one HTML file.
#[must_use]
pub fn html(report: &Reproduction) -> String {
    let chapters = || report.chapters.iter().enumerate();
    let body = html! {
        (section("How it was made", &facts(&report.facts)))
        (section("Contents", &html! {
            @for (index, chapter) in chapters() {
                h3 { (chapter.title) }
                ul { @for item in &chapter.items {
                    li { a href=(format!("#{}", item.anchor(index))) { (item.number) } ": " (item.title) }
                } }
            }
        }))
        @for (index, chapter) in chapters() {
            (section(&chapter.title, &html! {
                @if !chapter.remark.is_empty() { p { (chapter.remark) } }
                @for item in &chapter.items { (item_html(item, index)) }
            }))
        }
    };
    page("Reproduction of the thesis", &report.lead, &body)
}

fn item_html(item: &Item, chapter: usize) -> Markup {
    html! {
        h3 id=(item.anchor(chapter)) { (item.number) ": " (item.title) }
        @if !item.remark.is_empty() { p { (item.remark) } }
        @if let [Part::Figures { .. }, Part::Figures { .. }] = item.parts.as_slice() {
            div.pair { @for part in &item.parts { div { (part_html(part, item)) } } }
        } @else {
            @for part in &item.parts { (part_html(part, item)) }
        }
    }
}

fn part_html(part: &Part, item: &Item) -> Markup {
    let description = || format!("{}: {}", item.number, item.title);
    html! { @match part {
        Part::Figures { what, unit, decimals, labels, rows } => {
            @if !what.is_empty() { p { (what) } }
            (figures(unit, *decimals, labels, rows))
        }
        Part::Boxes { axis, rows } => {
            figure { (PreEscaped(box_plot::svg(&description(), axis, rows, box_plot::values(rows)))) }
        }
        Part::Plots(plots) => {
            @for pair in plots.chunks(2) {
                @if let [(caption, plot)] = pair { (plot.figure(caption)) }
                @else { div.pair { @for (caption, plot) in pair { (plot.figure(caption)) } } }
            }
        }
    } }
}

fn figures(unit: &str, decimals: usize, labels: &[&str], rows: &[ComparedFigure]) -> Markup {
    let number = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.decimals$}"));
    let signed = |value: Option<f64>| {
        let text = value.map_or("–".to_owned(), |value| format!("{value:+.decimals$}"));
        // A difference that the decimals do not show has no sign.
        match text.trim_start_matches(['+', '-']) {
            zero if zero.chars().all(|c| matches!(c, '0' | '.')) => zero.to_owned(),
            _ => text.replace('-', "\u{2212}"),
        }
    };
    if let [down, across] = labels {
        return matrix(
            unit,
            (down, across),
            rows,
            &[
                ("published", &|row| number(row.published)),
                ("here", &|row| number(row.here)),
                ("difference", &|row| signed(row.difference())),
            ],
        );
    }
    let with_unit =
        |name: &str| if unit.is_empty() { format!("#{name}") } else { format!("#{name}, {unit}") };
    let heads: Vec<String> = labels
        .iter()
        .map(|label| format!("={label}"))
        .chain(["published", "here", "difference"].map(with_unit))
        .collect();
    let cells = |row: &ComparedFigure| {
        let figures = [number(row.published), number(row.here), signed(row.difference())];
        row.of.iter().cloned().chain(figures).collect::<Vec<String>>()
    };
    let heads: Vec<&str> = heads.iter().map(String::as_str).collect();
    table(&heads, &rows.iter().map(cells).collect::<Vec<_>>())
}

/// How a figure is shown in one kind of line, with the name of that kind.
type Line<'a> = (&'static str, &'a dyn Fn(&ComparedFigure) -> String);

/// A table with the first label down and the second across, and one line of each kind for each first label.
fn matrix(unit: &str, (down, across): (&str, &str), rows: &[ComparedFigure], lines: &[Line<'_>]) -> Markup {
    let label = |row: &ComparedFigure, which: usize| row.of.get(which).cloned().unwrap_or_default();
    let distinct = |which: usize| {
        let mut all: Vec<String> = Vec::new();
        for row in rows {
            let name = label(row, which);
            if !all.contains(&name) {
                all.push(name);
            }
        }
        all
    };
    let columns = distinct(1);
    let mut heads = vec![format!("={down}"), format!("={across}")];
    heads.extend(columns.iter().map(|name| format!("#{name}")));
    let mut body = Vec::new();
    for name in distinct(0) {
        for (index, (kind, show)) in lines.iter().enumerate() {
            let mut cells = vec![if index == 0 { name.clone() } else { String::new() }, (*kind).to_owned()];
            for column in &columns {
                let found = rows.iter().find(|row| label(row, 0) == name && label(row, 1) == *column);
                cells.push(found.map_or_else(String::new, show));
            }
            body.push(cells);
        }
    }
    let heads: Vec<&str> = heads.iter().map(String::as_str).collect();
    html! {
        @if !unit.is_empty() { p { "Figures in " (unit) "." } }
        (table(&heads, &body))
    }
}

/// The figures of all tables as they are written to JSON.
#[derive(Debug, Serialize)]
pub struct TableFigures<'a> {
    /// Heading of the chapter.
    pub chapter: &'a str,
    /// Number of the table in the publication.
    pub table: &'a str,
    /// The quantity; empty if the table has no other.
    pub what: &'a str,
    /// Unit of the figures; empty for shares.
    pub unit: &'a str,
    /// The figures.
    pub figures: Vec<FigureRow<'a>>,
}

/// A figure with its difference.
#[derive(Debug, Serialize)]
pub struct FigureRow<'a> {
    /// The figure.
    #[serde(flatten)]
    pub figure: &'a ComparedFigure,
    /// This reproduction less the publication.
    pub difference: Option<f64>,
}

/// The figures of all tables of `report`.
#[must_use]
pub fn table_figures(report: &Reproduction) -> Vec<TableFigures<'_>> {
    let mut all = Vec::new();
    for chapter in &report.chapters {
        for item in &chapter.items {
            for part in &item.parts {
                let Part::Figures { what, unit, rows, .. } = part else { continue };
                let figures = rows.iter().map(|figure| FigureRow { figure, difference: figure.difference() });
                all.push(TableFigures {
                    chapter: &chapter.title,
                    table: &item.number,
                    what,
                    unit,
                    figures: figures.collect(),
                });
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report() -> Reproduction {
        let row = |of: &str, published, here| ComparedFigure { of: vec![of.to_owned()], published, here };
        let rows = vec![row("RP-ICPS", Some(11.19), Some(10.0)), row("RP1-CS", Some(0.84), None)];
        let part = Part::Figures { what: "RSSE", unit: "lbf", decimals: 2, labels: vec!["trained on"], rows };
        let item = Item {
            number: "Table 4.1".to_owned(),
            title: "RMSE of passive ARX".to_owned(),
            remark: String::new(),
            parts: vec![part],
        };
        let chapter = Chapter { title: "Chapter 4".to_owned(), items: vec![item], ..Chapter::default() };
        Reproduction { chapters: vec![chapter], ..Reproduction::default() }
    }

    #[test]
    fn each_figure_stands_beside_the_published_one_with_its_difference() {
        let page = html(&report());
        for text in
            ["href=\"#c0-table-4-1\"", "id=\"c0-table-4-1\"", "published, lbf", "11.19", "\u{2212}1.19"]
        {
            assert!(page.contains(text), "{text}: {page}");
        }
        let json = serde_json::to_value(table_figures(&report())).expect("figures");
        assert_eq!(json[0]["table"], "Table 4.1");
        assert!((json[0]["figures"][0]["difference"].as_f64().expect("a number") + 1.19).abs() < 1e-9);
        assert!(json[0]["figures"][1]["difference"].is_null());
    }

    #[test]
    fn figures_with_two_labels_are_a_matrix() {
        let row = |model: &str, on: &str, published, here| ComparedFigure {
            of: vec![model.to_owned(), on.to_owned()],
            published: Some(published),
            here: Some(here),
        };
        let rows = [row("S-P", "1", 52.0, 50.0), row("S-P", "2", 51.0, 50.96), row("P", "2", 13.0, 13.5)];
        let page = figures("%", 1, &["model", "experiment"], &rows).into_string();
        let cells: Vec<&str> =
            page.split("<td").skip(1).filter_map(|cell| cell.split(['>', '<']).nth(1)).collect();
        let expected = [
            "S-P",
            "published",
            "52.0",
            "51.0",
            "",
            "here",
            "50.0",
            "51.0",
            "",
            "difference",
            "\u{2212}2.0",
            // −0.04
            "0.0",
            "P",
            "published",
            "",
            "13.0",
            "",
            "here",
            "",
            "13.5",
            "",
            "difference",
            "",
            "+0.5",
        ];
        assert_eq!(cells, expected);
    }
}
