//! Reports of the MR damper force service: figures, text and JSON. An HTML report is one self-contained file that needs no network.
//!
//! [`plot`], [`box_plot`] and [`scatter`] draw, [`page`] makes the page and [`table`] its tables; these modules know nothing
//! about dampers. One module per report combines them: [`demo`], [`identify`], [`compare`], [`inverse`],
//! [`reproduction`], [`diagnosis`]. [`augmented_file`] makes the model file of a diagnosis.
//!
//! This crate knows neither files nor ROS nor Zenoh: it takes results as arguments and returns text.

pub mod augmented_file;
pub mod box_plot;
pub mod compare;
pub mod correlate;
pub mod demo;
pub mod demo_diagnosis;
pub mod design;
pub mod diagnosis;
pub mod diagnosis_summary;
pub mod evaluate;
pub mod identify;
pub mod inverse;
mod log_axis;
pub mod open_questions;
pub mod page;
mod panels;
pub mod plot;
pub mod recording;
pub mod reproduction;
mod row_plot;
mod scale;
pub mod scatter;
pub mod summary;
pub mod swept;
pub mod table;

pub use demo::{Agreement, DemoOutcome, Figure};
pub use recording::{Period, Recording};

#[cfg(test)]
mod tests;
