//! The view of all dampers, and its JSON for readers.
//!
//! ```text
//! messages ─→ Wall ─┬→ snapshot   all current values
//!                   ├→ start      the same with all points of the charts, for a new reader
//!                   └→ batch      the points since the previous batch, and from time to time the values
//! ```

use super::news::News;
use super::picture::{Cursor, Picture, Points};
use super::state::State;
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
pub enum Origin {
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
    pub source: Origin,
    /// Current time on the view's clock, s.
    pub now_s: f64,
    /// Number of batches made so far.
    pub batch: u64,
    /// The dampers, sorted by name.
    pub dampers: Vec<State>,
    /// The points of their charts; empty unless requested.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<Points<'a>>,
}

/// The data since the previous batch.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Batch<'a> {
    now_s: f64,
    batch: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    dampers: Option<Vec<State>>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    points: Vec<Points<'a>>,
}

/// The pictures of all dampers, sorted by name.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Wall {
    origin: Origin,
    pictures: Vec<(Picture, Cursor)>,
    batches: u64,
}

impl Wall {
    /// An empty view for data from `origin`.
    #[must_use]
    pub fn of(origin: Origin) -> Self {
        Self { origin, ..Self::default() }
    }

    /// Number of dampers.
    #[must_use]
    pub fn len(&self) -> usize {
        self.pictures.len()
    }

    /// True without dampers.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pictures.is_empty()
    }

    /// Adds an empty picture for the damper named `name`, unless it has one already.
    pub fn add(&mut self, name: &str) {
        if let Err(place) = self.place(name) {
            self.pictures.insert(place, (Picture::new(name), Cursor::default()));
        }
    }

    /// Removes the picture of the damper named `name`, if it has one.
    pub fn remove(&mut self, name: &str) {
        if let Ok(place) = self.place(name) {
            self.pictures.remove(place);
        }
    }

    /// Records a message of the damper named `name`, received at `now_s`. Messages of a damper without picture are dropped.
    pub fn take(&mut self, name: &str, news: News, now_s: f64) {
        if let Some(picture) = self.picture(name) {
            picture.take(news, now_s);
        }
    }

    /// The picture of the damper named `name`.
    pub fn picture(&mut self, name: &str) -> Option<&mut Picture> {
        let place = self.place(name).ok()?;
        Some(&mut self.pictures[place].0)
    }

    /// All pictures.
    pub fn pictures(&self) -> impl Iterator<Item = &Picture> {
        self.pictures.iter().map(|(picture, _)| picture)
    }

    fn place(&self, name: &str) -> Result<usize, usize> {
        self.pictures.binary_search_by(|(picture, _)| picture.name().cmp(name))
    }

    fn states(&self, now_s: f64) -> Vec<State> {
        self.pictures.iter().map(|(picture, _)| picture.state(now_s)).collect()
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

    /// Like [`Wall::snapshot`], with all points. The batches after number [`Snapshot::batch`] continue it. The first of them may
    /// repeat the newest points, which a reader can detect by their times.
    #[must_use]
    pub fn start(&self, now_s: f64) -> Snapshot<'_> {
        let points = self.pictures().filter_map(|picture| picture.points(&mut Cursor::default())).collect();
        Snapshot { points, ..self.snapshot(now_s) }
    }

    /// The next batch as JSON, and its number.
    pub fn batch(&mut self, now_s: f64) -> (u64, String) {
        let dampers = self.batches.is_multiple_of(FIGURES_EVERY).then(|| self.states(now_s));
        self.batches += 1;
        let points = self.pictures.iter_mut().filter_map(|(picture, read)| picture.points(read)).collect();
        (self.batches, json(&Batch { now_s, batch: self.batches, dampers, points }))
    }
}

/// `value` as JSON.
pub fn json(value: &impl Serialize) -> String {
    // This cannot fail: all keys are strings, and all values are numbers, strings and lists of these.
    serde_json::to_string(value).expect("values are valid JSON")
}
