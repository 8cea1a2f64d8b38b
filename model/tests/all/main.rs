//! All integration tests of this crate in one binary, except `no_alloc`.
//!
//! A test that needs measured runs is ignored, and its name contains `measured`; `.ci/run` runs these tests where the runs are.

mod common;
mod coverage;
mod diagnosis;
mod identify_support;
mod identify_swept;
mod inverse_support;
mod jitter_support;
mod measured;
#[path = "../../benches/middle/mod.rs"]
mod middle;
#[path = "../oracles/mod.rs"]
mod numbers;

// The running pipeline.
mod alarm;
mod any_float;
mod commands;
mod jitter;
mod learning;
mod pipeline;
mod thresholds;
mod uncertainty;
mod uncertainty_coverage;
mod validity;
mod validity_measured;

// Identification and comparison.
mod compare;
mod identify_arx;
mod identify_dataset;
mod identify_free_sets;
mod identify_fuzzy_tanh;
mod identify_law;
mod identify_lpv;
mod identify_maxwell_slip;
mod identify_measured;
mod identify_minpack;
mod identify_network;
mod identify_tsk;
mod oracles;

// Effects and diagnosis.
mod diagnosis_cases;
mod diagnosis_paired;
mod diagnosis_refusals;
mod discovery;
mod discovery_measured;
mod effects;

// Inverse control.
mod inverse;
mod inverse_learned;
mod inverse_methods;
