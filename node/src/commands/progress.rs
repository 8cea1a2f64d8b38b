//! Progress of a long computation on the terminal.

use crate::commands::context::{CliContext, ProgressSink};
use indicatif::{ProgressBar, ProgressStyle};
use mr_damper_base::shown;
use mr_damper_model::identify::Progress;
use std::time::Duration;

/// A line with the current stage, and with the time left if that is known.
pub(super) struct Working(ProgressBar, Option<ProgressSink>);

impl Working {
    /// A line that is hidden if `quiet`, or if stderr is not a terminal.
    pub(super) fn new(quiet: bool) -> Self {
        Self(if quiet { ProgressBar::hidden() } else { ProgressBar::new(0) }, None)
    }

    /// The same for the call in `context`, whose caller also receives the progress.
    pub(super) fn of(context: &CliContext) -> Self {
        let mut working = Self::new(context.quiet);
        working.1.clone_from(&context.progress);
        working
    }

    /// Starts a stage of unknown length. Without a terminal the stage is logged.
    pub(super) fn stage(&self, what: &str) {
        let style = ProgressStyle::with_template("{spinner} {prefix}, {elapsed}");
        self.0.set_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()));
        self.0.set_prefix(shown::line(what).into_owned());
        self.0.enable_steady_tick(Duration::from_millis(100));
        if let Some(sink) = &self.1 {
            sink(what, 0, 0);
        }
        if self.0.is_hidden() {
            tracing::info!("{what}");
        }
    }

    /// Shows the progress within the stage.
    pub(super) fn progress(&self, progress: Progress) {
        let (message, done, of) = match progress {
            Progress::Conditioning { runs } => ("conditioning runs", 0, runs),
            Progress::Restart { done, of } => ("restarts", done, of),
            Progress::Epoch { done, of } => ("learning", done, of),
            Progress::Polish { done, of } => ("final fit of the best", done, of),
        };
        self.done(message, u64::from(done), u64::from(of));
    }

    /// Shows a bar: `done` of `of` steps.
    pub(super) fn done(&self, message: &'static str, done: u64, of: u64) {
        let style = ProgressStyle::with_template("{prefix}{msg} [{bar:40}] {pos}/{len}, {eta} left");
        self.0.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        if let Some(sink) = &self.1 {
            sink(message, done, of);
        }
        let stage = self.0.prefix();
        let colon = if stage.is_empty() || stage.ends_with(": ") { "" } else { ": " };
        self.0.set_prefix(format!("{stage}{colon}"));
        self.0.set_message(message);
        self.0.set_length(of);
        self.0.set_position(done);
    }
}

impl Drop for Working {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
