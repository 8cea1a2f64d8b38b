//! Result of a diagnosis (`mr-damper close`) as JSON, as text for a terminal and as one HTML file.

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
