//! Logging. Log lines go to stderr, because stdout is for results.

use crate::ros2::rosout::ToRosout;
use clap::ValueEnum;
use mr_damper_base::shown::OneLine;
use mr_damper_views::live::held_log;
use std::ffi::OsStr;
use std::fmt::{self as text, Write};
use tracing::field::Field;
use tracing_subscriber::field::MakeExt;
use tracing_subscriber::fmt::format::{self, Writer};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer, fmt};

/// Format of log lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum LogFormat {
    /// Readable text.
    #[default]
    Text,
    /// One JSON object per line.
    Json,
}

/// The enabled outputs of log lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outputs {
    /// To standard error.
    pub stderr: bool,
    /// To the topic `/rosout`, once a node is running.
    pub rosout: bool,
}

/// Starts logging at `level` (`RUST_LOG` overrides it). Call it once, before anything is logged.
pub fn start(format: LogFormat, level: &str, outputs: Outputs) {
    // The middlewares log much. This project's own counters and messages report what matters; the middlewares' errors
    // are still shown. Four errors are hidden, because they are meaningless: a missing ROS_DISTRO, a publisher without
    // readers, leaving a multicast group that loopback never joined, and /clock with the type that the client library
    // expects.
    let default = format!(
        "{level},rustdds=error,rustdds::network::udp_listener=off,rustdds::discovery::discovery_db=off,ros2_client=error,ros2_client::distributions=off,ros2_client::node=off,zenoh=error"
    );
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default));
    let is_terminal = std::io::IsTerminal::is_terminal(&std::io::stderr());
    let colour = is_coloured(is_terminal, std::env::var_os("NO_COLOR").as_deref());
    let lines = fmt::layer().with_writer(|| held_log::Writer).with_target(false).with_ansi(colour);
    let lines = match (outputs.stderr, format) {
        (false, _) => None,
        (true, LogFormat::Text) => Some(lines.fmt_fields(format::debug_fn(field).delimited(" ")).boxed()),
        (true, LogFormat::Json) => Some(lines.json().with_ansi(false).boxed()),
    };
    let rosout = outputs.rosout.then_some(ToRosout);
    // A second call (in tests) keeps the first configuration.
    let _ = tracing_subscriber::registry().with(filter).with(lines).with(rosout).try_init();
}

/// True if log lines are coloured: on a terminal, unless NO_COLOR is set (<https://no-color.org>).
fn is_coloured(is_terminal: bool, no_color: Option<&OsStr>) -> bool {
    is_terminal && no_color.is_none_or(OsStr::is_empty)
}

/// Writes one field of a log line, or its message. Control characters in the value are escaped, because the value may
/// come from others: an event stays one line, and the terminal executes no escape sequence.
fn field(writer: &mut Writer<'_>, field: &Field, value: &dyn text::Debug) -> text::Result {
    let is_coloured = writer.has_ansi_escapes();
    match field.name() {
        "message" => {}
        // Origin of a line of the `log` crate.
        name if name.starts_with("log.") => return Ok(()),
        // Italic and dimmed, as the library writes it.
        name if is_coloured => write!(writer, "\u{1b}[3m{name}\u{1b}[0m\u{1b}[2m=\u{1b}[0m")?,
        name => write!(writer, "{name}=")?,
    }
    write!(OneLine(writer), "{value:?}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::{Arc, Mutex, PoisonError};

    #[derive(Clone, Default)]
    struct Kept(Arc<Mutex<Vec<u8>>>);

    impl std::io::Write for Kept {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_log_line_is_one_line_without_escape_sequences() {
        let kept = Kept::default();
        let into = kept.clone();
        let lines = fmt::layer().with_writer(move || into.clone()).with_ansi(false).without_time();
        let lines = lines.fmt_fields(format::debug_fn(field).delimited(" "));
        tracing::subscriber::with_default(tracing_subscriber::registry().with(lines), || {
            let name = "a\u{1b}[31m\r\nERROR b.csv";
            tracing::info!(run = %name, frame = name, "cannot read {name}");
        });
        let bytes = kept.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let text = String::from_utf8(bytes).expect("UTF-8");
        let shown = "a\\u{1b}[31m\\r\\nERROR b.csv";
        let expected = format!("cannot read {shown} run={shown} frame=\"{shown}\"\n");
        assert!(text.ends_with(&expected) && !text.trim_end().contains(char::is_control), "{text:?}");
    }

    #[test]
    fn colours_are_for_terminals_and_not_where_no_color_is_set() {
        assert!(is_coloured(true, None) && is_coloured(true, Some(OsStr::new(""))));
        assert!(!is_coloured(true, Some(OsStr::new("1"))) && !is_coloured(false, None));
    }
}
