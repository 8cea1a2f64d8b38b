//! What a closing of the loop found: JSON, text for a terminal, one HTML file.

pub mod json;
mod page;
mod pictures;
mod text;
mod traces;
pub mod words;

pub(in crate::report) use page::found;
pub use page::{Outcome, html};
pub(in crate::report) use text::paragraph;
pub use text::{short, text};
pub use traces::{Point, RunTrace};

#[cfg(test)]
mod tests;
