//! The registry of all dampers, and its JSON for readers.
//!
//! ```text
//! messages ─→ DamperRegistry ─┬→ snapshot   all current values
//!                             ├→ history    the last minutes of one damper
//!                             ├→ start      the same with all points of the charts, for a new reader
//!                             └→ batch      the points since the previous batch, and from time to time the values
//! ```

use super::damper_message::DamperMessage;
use super::damper_state::DamperState;
use super::damper_view::{ChartCursor, ChartHistory, ChartPoints, DamperView};
use serde::Serialize;

/// Name of the JSON schema.
pub const SCHEMA: &str = "mr-damper/serve/1";
/// Values are sent with every fifth batch, because nobody reads faster.
const FIGURES_EVERY: u64 = 5;
/// Maximum number of dampers: two vehicles with eight each.
pub const MOST_DAMPERS: usize = 16;

/// Origin of the data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum DataOrigin {
    /// ROS topics, with all messages.
    #[default]
    Ros,
    /// The Zenoh mirror, with a reduced rate.
    Zenoh,
}

/// All values of all dampers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Snapshot<'a> {
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// Origin of the data.
    pub source: DataOrigin,
    /// Current time on the registry's clock, s.
    pub now_s: f64,
    /// Number of batches made so far.
    pub batch: u64,
    /// The dampers, sorted by name.
    pub dampers: Vec<DamperState>,
    /// The points of their charts; empty unless requested.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<ChartPoints<'a>>,
}

/// The data since the previous batch.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Batch<'a> {
    now_s: f64,
    batch: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    dampers: Option<Vec<DamperState>>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    points: Vec<ChartPoints<'a>>,
}

/// The views of all dampers, sorted by name.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DamperRegistry {
    origin: DataOrigin,
    views: Vec<(DamperView, ChartCursor)>,
    batches: u64,
}

impl DamperRegistry {
    /// An empty registry for data from `origin`.
    #[must_use]
    pub fn of(origin: DataOrigin) -> Self {
        Self { origin, ..Self::default() }
    }

    /// Number of dampers.
    #[must_use]
    pub fn len(&self) -> usize {
        self.views.len()
    }

    /// True without dampers.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }

    /// Adds an empty view of the damper named `name`, unless it has one already.
    pub fn add(&mut self, name: &str) {
        if let Err(place) = self.place(name) {
            self.views.insert(place, (DamperView::new(name), ChartCursor::default()));
        }
    }

    /// Removes the view of the damper named `name`, if it has one.
    pub fn remove(&mut self, name: &str) {
        if let Ok(place) = self.place(name) {
            self.views.remove(place);
        }
    }

    /// Records a message of the damper named `name`, received at `now_s`. Messages of a damper without a view are dropped.
    pub fn take(&mut self, name: &str, message: DamperMessage, now_s: f64) {
        if let Some(view) = self.view(name) {
            view.take(message, now_s);
        }
    }

    /// The view of the damper named `name`.
    pub fn view(&mut self, name: &str) -> Option<&mut DamperView> {
        let place = self.place(name).ok()?;
        Some(&mut self.views[place].0)
    }

    /// All views.
    pub fn views(&self) -> impl Iterator<Item = &DamperView> {
        self.views.iter().map(|(view, _)| view)
    }

    fn place(&self, name: &str) -> Result<usize, usize> {
        self.views.binary_search_by(|(view, _)| view.name().cmp(name))
    }

    fn states(&self, now_s: f64) -> Vec<DamperState> {
        self.views.iter().map(|(view, _)| view.state(now_s)).collect()
    }

    /// All values at `now_s`.
    #[must_use]
    pub fn snapshot(&self, now_s: f64) -> Snapshot<'_> {
        Snapshot {
            schema: SCHEMA,
            source: self.origin,
            now_s,
            batch: self.batches,
            dampers: self.states(now_s),
            points: Vec::new(),
        }
    }

    /// Like [`DamperRegistry::snapshot`], with all points. The batches after number [`Snapshot::batch`] continue it. The first of
    /// them may repeat the newest points, which a reader can detect by their times.
    #[must_use]
    pub fn start(&self, now_s: f64) -> Snapshot<'_> {
        let points = self.views().filter_map(|view| view.points(&mut ChartCursor::default())).collect();
        Snapshot { points, ..self.snapshot(now_s) }
    }

    /// The last minutes of the damper named `name`, from `from_s` seconds since its first sample on; `None` if there is no such damper.
    #[must_use]
    pub fn history(&self, name: &str, from_s: f64) -> Option<ChartHistory> {
        let place = self.place(name).ok()?;
        Some(self.views[place].0.history(from_s))
    }

    /// The next batch as JSON, and its number.
    pub fn batch(&mut self, now_s: f64) -> (u64, String) {
        let dampers = self.batches.is_multiple_of(FIGURES_EVERY).then(|| self.states(now_s));
        self.batches += 1;
        let points = self.views.iter_mut().filter_map(|(view, read)| view.points(read)).collect();
        (self.batches, json(&Batch { now_s, batch: self.batches, dampers, points }))
    }
}

/// `value` as JSON.
pub fn json(value: &impl Serialize) -> String {
    // This cannot fail: all keys are strings, and all values are numbers, strings and lists of these.
    serde_json::to_string(value).expect("values are valid JSON")
}
