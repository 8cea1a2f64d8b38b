//! Publishes the log on `/rosout`: traced lines also go to the topic, under the name of the node that logged them.
//!
//! ```text
//! tracing ─→ ToRosout (a layer beside that for stderr) ─→ one bounded queue per node ─→ overseer ─→ /rosout
//! ```
//!
//! In a process with several dampers, the threads of each damper work inside a span called `damper` ([`span`]). A line
//! outside of such a span goes to the first node. Only lines of this project are published, at the level of the log.
//! Lines of the middlewares are not, because publishing them would create new ones.

use crate::estimation::wire::header;
use crate::ros2::participant::{Output, Ros};
use crate::settings::error::NodeError;
use mr_damper_base::clock::Clock;
use mr_damper_msgs::rcl::Log;
use std::fmt::Write as _;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id};
use tracing::{Event, Level, Span, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;
use tracing_subscriber::registry::LookupSpan;

/// Lines that can wait for the overseer; further lines are dropped and counted.
const WAITING: usize = 256;
/// Name of the spans that give the node of a line.
const SPAN: &str = "damper";

/// The nodes that receive lines.
static NODES: Mutex<Vec<Hearer>> = Mutex::new(Vec::new());

struct Hearer {
    /// The node's full name.
    node: String,
    lines: SyncSender<Line>,
    dropped: Arc<AtomicU64>,
}

/// A line of the log.
#[derive(Debug)]
struct Line {
    level: u8,
    text: String,
    file: &'static str,
    module: &'static str,
    line: u32,
}

/// The span for the threads of `node` (its full name), if a process has several nodes.
#[must_use]
pub fn span(node: &str) -> Span {
    // At the highest level, so that no level filter removes it.
    tracing::error_span!("damper", node)
}

/// The layer that passes lines to the nodes.
#[derive(Debug, Clone, Copy, Default)]
pub struct ToRosout;

/// The node of a span.
struct Of(String);

impl<S: Subscriber + for<'a> LookupSpan<'a>> Layer<S> for ToRosout {
    fn on_new_span(&self, attributes: &Attributes<'_>, id: &Id, context: Context<'_, S>) {
        if attributes.metadata().name() != SPAN {
            return;
        }
        let mut text = Text::default();
        attributes.record(&mut text);
        if let (Some(node), Some(span)) = (text.node, context.span(id)) {
            span.extensions_mut().insert(Of(node));
        }
    }

    fn on_event(&self, event: &Event<'_>, context: Context<'_, S>) {
        let about = event.metadata();
        if !about.target().starts_with("mr_damper") {
            return;
        }
        let mut scope = context.event_scope(event).into_iter().flatten();
        let of = scope.find_map(|span| span.extensions().get::<Of>().map(|of| of.0.clone()));
        let nodes = NODES.lock().unwrap_or_else(PoisonError::into_inner);
        let own = nodes.iter().find(|hearer| of.as_deref() == Some(hearer.node.as_str()));
        let Some(hearer) = own.or_else(|| nodes.first()) else { return };
        let mut text = Text::default();
        event.record(&mut text);
        let line = Line {
            level: level(*about.level()),
            text: text.message + &text.fields,
            file: about.file().unwrap_or_default(),
            module: about.module_path().unwrap_or_default(),
            line: about.line().unwrap_or_default(),
        };
        if hearer.lines.try_send(line).is_err() {
            hearer.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

fn level(level: Level) -> u8 {
    match level {
        Level::ERROR => Log::ERROR,
        Level::WARN => Log::WARN,
        Level::INFO => Log::INFO,
        Level::DEBUG | Level::TRACE => Log::DEBUG,
    }
}

/// A recorded line: the message, then its fields as `name=value`.
#[derive(Default)]
struct Text {
    message: String,
    fields: String,
    node: Option<String>,
}

impl Visit for Text {
    fn record_str(&mut self, field: &Field, value: &str) {
        if field.name() == "node" {
            self.node = Some(value.to_owned());
        }
        self.record_debug(field, &format_args!("{value}"));
    }

    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        // Writing to a string cannot fail.
        let _ = if field.name() == "message" {
            write!(self.message, "{value:?}")
        } else {
            write!(self.fields, " {}={value:?}", field.name())
        };
    }
}

/// One node's log, published on `/rosout`.
pub struct Rosout {
    publisher: Output<Log>,
    /// The node's full name; `logger` is the same in the form of logger names.
    node: String,
    logger: String,
    lines: Receiver<Line>,
    dropped: Arc<AtomicU64>,
}

impl Rosout {
    /// Publishes what `node` (its full name) logs from now on, until the value is dropped.
    ///
    /// # Errors
    /// When the topic cannot be published.
    pub fn start(ros: &mut Ros, node: &str) -> Result<Self, NodeError> {
        let publisher = ros.publish_log("/rosout")?;
        let (sender, lines) = sync_channel(WAITING);
        let dropped = Arc::new(AtomicU64::new(0));
        let hearer = Hearer { node: node.to_owned(), lines: sender, dropped: Arc::clone(&dropped) };
        NODES.lock().unwrap_or_else(PoisonError::into_inner).push(hearer);
        let logger = node.trim_matches('/').replace('/', ".");
        Ok(Self { publisher, node: node.to_owned(), logger, lines, dropped })
    }

    /// Publishes the lines logged so far. A line that the middleware refuses is lost on the topic but is still on
    /// stderr.
    pub fn drain(&mut self, clock: &Clock) {
        let dropped = self.dropped.swap(0, Ordering::Relaxed);
        let missing = (dropped > 0).then(|| Line {
            level: Log::WARN,
            text: format!("{dropped} lines are missing on /rosout: too many at once; see the node's stderr"),
            file: file!(),
            module: module_path!(),
            line: line!(),
        });
        for line in self.lines.try_iter().chain(missing) {
            let Line { level, text, file, module, line } = line;
            let log = Log {
                stamp: header(clock.now_or_system(), "").stamp,
                level,
                name: self.logger.clone(),
                msg: text,
                file: file.to_owned(),
                function: module.to_owned(),
                line,
            };
            // An error is not logged, because the log line would come back here.
            let _ = self.publisher.publish(log);
        }
    }
}

impl Drop for Rosout {
    fn drop(&mut self) {
        NODES.lock().unwrap_or_else(PoisonError::into_inner).retain(|hearer| hearer.node != self.node);
    }
}
