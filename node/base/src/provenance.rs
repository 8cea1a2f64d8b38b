//! Provenance in files and reports: tool, date, expected error.

use mr_damper_model::evaluate::Evaluation;
use mr_damper_model::model::Expected;
use std::time::SystemTime;

/// The program and its version.
pub const TOOL: &str = concat!("mr-damper ", env!("CARGO_PKG_VERSION"));

/// The present time in UTC, to the second (RFC 3339).
#[must_use]
pub fn date() -> String {
    chrono::DateTime::<chrono::Utc>::from(SystemTime::now())
        .to_rfc3339_opts(chrono::SecondsFormat::Secs, true)
}

/// Sets the expected error to the error on held-out runs, where it is known.
pub fn expect(expected: &mut Expected, held_out: &Evaluation) {
    let rsse_n = |fit: &Option<mr_damper_model::metrics::Fit>| fit.as_ref().map(|fit| fit.rsse_n);
    expected.free_run_rsse_n = rsse_n(&held_out.free_run).or(expected.free_run_rsse_n);
    expected.one_step_rsse_n = rsse_n(&held_out.one_step).or(expected.one_step_rsse_n);
}
