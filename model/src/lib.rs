//! Force models of magneto-rheological (MR) dampers.

pub mod calibrate;
pub mod compare;
pub mod condition;
pub mod diagnose;
mod edit_distance;
pub mod effect;
pub mod error;
pub mod evaluate;
pub mod fis;
pub mod force;
pub mod identify;
pub mod inverse;
pub mod metrics;
pub mod model;
pub mod model_file;
pub mod pipeline;
pub mod preset;
pub mod rig;
pub mod sample;
pub mod statistics;
pub mod uncertainty;
pub mod units;

pub use error::Error;
