//! Runs whose truth is known, to try the diagnosis on: the catalogue of cases, one judgement a case, and rates.
//!
//! A test of a few and a long run of many (`examples/closing_rates.rs`) share it. All runs come from the virtual rig,
//! which shares no code with effects, models and diagnosis.

#![allow(dead_code, reason = "the test and the example each use their share")]

pub(crate) mod cases;
pub(crate) mod judge;
pub(crate) mod rates;
