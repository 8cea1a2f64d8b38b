//! The HTML page around a report: head, style sheet, sections. It is a single file that needs no network and follows
//! the reader's light or dark mode.

use maud::{DOCTYPE, Markup, PreEscaped, html};

/// A whole page.
#[must_use]
pub fn page(title: &str, lead: &str, body: &Markup) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                header {
                    h1 { (title) }
                    p.lead { (lead) }
                }
                main { (body) }
            }
        }
    }
    .into_string()
}

/// A section with the heading `heading`.
#[must_use]
pub fn section(heading: &str, body: &Markup) -> Markup {
    html! { section { h2 { (heading) } (body) } }
}

/// `text` with its first letter in upper case.
pub(super) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

const STYLE: &str = include_str!("style.css");
