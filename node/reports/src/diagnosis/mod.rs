//! Result of a diagnosis (`mr-damper close`) as JSON, as text for a terminal and as one HTML file.

pub mod json;
mod page;
pub(crate) mod pictures;
mod plots;
mod terms;
mod text;
mod traces;
pub mod words;

pub(crate) use page::found;
pub use page::{DiagnosisOutcome, html};
pub(crate) use text::paragraph;
pub use text::{short, text};
pub use traces::{RunTrace, TracePoint};

#[cfg(test)]
mod tests;
