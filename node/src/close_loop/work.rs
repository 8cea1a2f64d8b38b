//! What a goal of `close_loop` is: a diagnosis of the running model on what the service remembers.

use crate::closing::{TOOL, model_file, rows};
use crate::error::NodeError;
use crate::report::close::json::{self, SCHEMA};
use mr_damper_model::diagnose::{self, Closing, Runs, Settings, Stage};
use mr_damper_model::identify::Watch;
use mr_damper_model::model::Model;
use mr_damper_model::model_file::Role;
use mr_damper_model::sample::{Run, Stamp};
use serde::Serialize;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Shares of the history, by time: effects are found on the first, confirmed on the second, proved on the rest.
const SHARES: [(Role, f64); 3] = [(Role::Estimate, 0.6), (Role::Confirm, 0.2), (Role::Test, 0.2)];
/// Seed of sign flips and bootstrap.
const SEED: u64 = 0;
/// What a reader of the report has to know of the runs.
const NOTE: &str = "the runs are parts of one recording: first 60 % estimate, next 20 % confirm, last 20 % test. Parts of one \
                    session share what a session has; runs recorded apart (`mr-damper close`) prove more";

/// What a diagnosis needs, taken when the goal is accepted.
pub(super) struct Job {
    /// The running free model, conditioned as it runs.
    pub(super) base: Model,
    /// The history, oldest first.
    pub(super) runs: Vec<Run>,
    /// Directory of the model file.
    pub(super) out: PathBuf,
}

/// What came out.
pub(super) struct Done {
    closing: Closing,
    runs: Vec<RunRow>,
    seconds: f64,
    /// The augmented model; `None` when nothing was named.
    pub(super) model: Option<PathBuf>,
}

/// The report: that of `mr-damper close`, and what is special here.
#[derive(Debug, Serialize)]
struct Written<'a> {
    #[serde(flatten)]
    report: json::Report<'a>,
    tool: &'static str,
    seed: u64,
    seconds: f64,
    note: &'static str,
    runs: &'a [RunRow],
    model_file: Option<String>,
    /// The model runs already.
    loaded: bool,
    /// Why it does not, though `close_loop.auto_load` asks for it.
    load_error: Option<String>,
}

#[derive(Debug, Serialize)]
struct RunRow {
    role: Role,
    run: String,
    seconds: f64,
}

impl Done {
    /// The report as JSON. `loaded`: whether the model was swapped in, and why not.
    pub(super) fn json(&self, loaded: &Result<bool, String>) -> Result<String, NodeError> {
        let written = Written {
            report: json::Report::of(&self.closing),
            tool: TOOL,
            seed: SEED,
            seconds: self.seconds,
            note: NOTE,
            runs: &self.runs,
            model_file: self.model.as_ref().map(|path| path.display().to_string()),
            loaded: *loaded.as_ref().unwrap_or(&false),
            load_error: loaded.as_ref().err().cloned(),
        };
        serde_json::to_string(&written)
            .map_err(|error| NodeError::Failed(format!("the report cannot be written as JSON: {error}")))
    }

    /// The verdict and what was named, for the log.
    pub(super) fn in_short(&self) -> String {
        let named: Vec<_> = self.closing.effects.iter().map(|named| named.effect.effect().title()).collect();
        format!(
            "{}: {}",
            self.closing.verdict.name(),
            if named.is_empty() { "nothing named".to_owned() } else { named.join(", ") }
        )
    }
}

/// The report of a goal that came to nothing.
pub(super) fn error_json(error: &NodeError) -> String {
    serde_json::json!({ "schema": SCHEMA, "error": error.to_string() }).to_string()
}

/// Diagnoses, and writes the model file when an effect was named.
///
/// # Errors
/// When the history is too short or lacks a channel, or the file cannot be written; [`NodeError::Interrupted`].
pub(super) fn work(job: &Job, cancel: &AtomicBool, say: &dyn Fn(Stage)) -> Result<Done, NodeError> {
    let started = Instant::now();
    let parts = split(&job.runs)?;
    let of = |role: Role| -> Result<_, NodeError> {
        let runs: Vec<Run> = parts.iter().filter(|part| part.0 == role).map(|part| part.1.clone()).collect();
        Ok(rows(&runs, &job.base)?)
    };
    let (estimate, confirm, test) = (of(Role::Estimate)?, of(Role::Confirm)?, of(Role::Test)?);
    let runs = Runs { estimate: &estimate, confirm: &confirm, test: &test, ..Runs::default() };
    let settings = Settings { seed: SEED, ..Settings::default() };
    let watch = Watch { cancel: Some(cancel), progress: None };
    let closing = diagnose::close(&job.base, &runs, &settings, &watch, say)?;
    let mut model = None;
    if !closing.effects.is_empty() {
        let path = job.out.join(format!("mr-damper-close-{}.toml", end(&job.runs).nanos() / 1_000_000));
        let text = model_file(&closing, &runs, SEED).to_toml()?;
        std::fs::write(&path, text).map_err(NodeError::io(format!("writing {}", path.display())))?;
        model = Some(path);
    }
    let runs = parts
        .iter()
        .map(|(role, run)| RunRow { role: *role, run: run.name.clone(), seconds: run.duration().get() })
        .collect();
    Ok(Done { closing, runs, seconds: started.elapsed().as_secs_f64(), model })
}

fn end(runs: &[Run]) -> Stamp {
    runs.last().and_then(|run| run.displacement_m.stamps.last()).copied().unwrap_or_default()
}

/// The runs, cut where the time that they hold together reaches each share.
fn split(runs: &[Run]) -> Result<Vec<(Role, Run)>, NodeError> {
    /// Shorter pieces, s, hold no row that counts.
    const LEAST_S: f64 = 0.5;
    /// A cut nearer to the end of a piece than this is at its end: seconds are not whole in binary.
    const SAME_S: f64 = 1e-6;
    let total_s: f64 = runs.iter().map(|run| run.duration().get()).sum();
    if total_s <= 0.0 {
        return Err(NodeError::Failed(
            "there is no history yet: the node keeps displacement, drive and force as they come, for \
             history.duration_s"
                .to_owned(),
        ));
    }
    let mut parts = Vec::new();
    let (mut shares, mut begun_s) = (SHARES.iter(), 0.0);
    let mut current = shares.next().map(|(role, share)| (*role, share * total_s));
    for run in runs {
        let Some(first) = run.displacement_m.stamps.first() else { continue };
        let length_s = run.duration().get();
        let mut from_s = 0.0;
        while let Some((role, until_s)) = current {
            let here_s = until_s - begun_s;
            let is_last = shares.as_slice().is_empty();
            let to_s = if is_last || here_s >= length_s - SAME_S { length_s } else { here_s };
            if to_s - from_s >= LEAST_S {
                let at = |s: f64| first.shifted((s * 1e9) as i64);
                // The end of the run belongs to it.
                let to = if to_s == length_s { at(length_s).shifted(1_000) } else { at(to_s) };
                let mut part = run.between(at(from_s), to);
                part.name = format!("{}, {from_s:.1} to {to_s:.1} s", run.name);
                parts.push((role, part));
            }
            if is_last || here_s > length_s + SAME_S {
                break;
            }
            from_s = to_s;
            current = shares.next().map(|(role, share)| (*role, until_s + share * total_s));
        }
        begun_s += length_s;
    }
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_model::sample::Trace;

    /// A run from `from_s` on, of `seconds`, at 100 Hz.
    fn run(from_s: i64, seconds: i64) -> Run {
        let stamps: Vec<Stamp> =
            (0..=100 * seconds).map(|k| Stamp::from_nanos(from_s * 1_000_000_000 + k * 10_000_000)).collect();
        let values = vec![0.0; stamps.len()];
        Run { name: format!("at {from_s}"), displacement_m: Trace { stamps, values }, ..Run::default() }
    }

    fn parts(runs: &[Run]) -> Vec<(Role, usize)> {
        split(runs)
            .expect("there is something")
            .iter()
            .map(|(r, run)| (*r, run.displacement_m.len()))
            .collect()
    }

    #[test]
    fn a_history_is_split_by_time_and_no_sample_serves_twice() {
        use Role::{Confirm, Estimate, Test};
        assert_eq!(parts(&[run(0, 100)]), [(Estimate, 6000), (Confirm, 2000), (Test, 2001)]);
        // A gap: the first piece holds 30 s of 100 s.
        let pieces = [run(0, 30), run(50, 70)];
        assert_eq!(parts(&pieces), [(Estimate, 3001), (Estimate, 3000), (Confirm, 2000), (Test, 2001)]);
        // The cut falls on the gap.
        let pieces = [run(0, 60), run(80, 40)];
        assert_eq!(parts(&pieces), [(Estimate, 6001), (Confirm, 2000), (Test, 2001)]);
        assert!(split(&[]).is_err());
    }
}
