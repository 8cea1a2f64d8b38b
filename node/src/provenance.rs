//! What files and reports say of how they came about.

use mr_damper_model::evaluate::Evaluation;
use mr_damper_model::model::Expected;
use std::time::SystemTime;

/// The program and its version.
pub const TOOL: &str = concat!("mr-damper ", env!("CARGO_PKG_VERSION"));

/// Now, in UTC, to the second (RFC 3339).
#[must_use]
pub fn date() -> String {
    chrono::DateTime::<chrono::Utc>::from(SystemTime::now())
        .to_rfc3339_opts(chrono::SecondsFormat::Secs, true)
}

/// The error to expect becomes that of runs which were held out, where they have one.
pub fn expect(expected: &mut Expected, held_out: &Evaluation) {
    let rsse_n = |fit: &Option<mr_damper_model::metrics::Fit>| fit.as_ref().map(|fit| fit.rsse_n);
    expected.free_run_rsse_n = rsse_n(&held_out.free_run).or(expected.free_run_rsse_n);
    expected.one_step_rsse_n = rsse_n(&held_out.one_step).or(expected.one_step_rsse_n);
}
