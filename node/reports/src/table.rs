//! Tables of a report.

use maud::{Markup, html};

/// A table. A column whose name starts with `#` holds numbers and is right-aligned; the cells of a column whose name
/// starts with `=` do not wrap.
#[must_use]
pub fn table(columns: &[&str], rows: &[Vec<String>]) -> Markup {
    let class = |name: &&str| match name.chars().next() {
        Some('#') => Some("num"),
        Some('=') => Some("keep"),
        _ => None,
    };
    let classes: Vec<Option<&str>> = columns.iter().map(class).collect();
    html! {
        div.scroll {
            table {
                thead { tr { @for (name, class) in columns.iter().zip(&classes) {
                    th class=[class] { (name.trim_start_matches(['#', '='])) }
                } } }
                tbody { @for row in rows {
                    tr { @for (cell, class) in row.iter().zip(&classes) { td class=[class] { (cell) } } }
                } }
            }
        }
    }
}

/// A list of names and values, one per line.
#[must_use]
pub fn facts(rows: &[(String, String)]) -> Markup {
    html! {
        dl { @for (name, value) in rows { dt { (name) } dd { (value) } } }
    }
}

/// A table of values between -1 and 1, each with a bar that starts in the middle.
#[must_use]
pub fn bars(column: &str, value: &str, rows: &[(String, f64)]) -> Markup {
    html! {
        table.bars {
            thead { tr { th { (column) } th.num { (value) } th {} } }
            tbody { @for (name, r) in rows {
                tr {
                    td { (name) }
                    td.num { (format!("{r:+.3}")) }
                    td.bar { (bar(*r)) }
                }
            } }
        }
    }
}

fn bar(r: f64) -> Markup {
    let length = 50.0 * r.abs().min(1.0);
    let start = if r < 0.0 { 50.0 - length } else { 50.0 };
    html! { div.track { div.fill style=(format!("left:{start:.1}%;width:{length:.1}%")) {} } }
}
