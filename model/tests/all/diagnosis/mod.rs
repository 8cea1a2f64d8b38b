//! Runs with known truth for testing the diagnosis: the catalogue of cases, the outcome for a case, and detection rates.
//!
//! It is shared by a test with a few cases and by a long evaluation with many (`examples/diagnosis_rates.rs`). All runs come from the
//! virtual rig, which shares no code with effects, models and diagnosis.

#![allow(dead_code, reason = "the tests and the example each use a part of it")]

pub(crate) mod cases;
pub(crate) mod instruments;
pub(crate) mod intervals;
pub(crate) mod outcome;
pub(crate) mod rates;
