//! The pictures of all dampers, and the JSON of them that readers get.
//!
//! ```text
//! news ─→ Wall ─┬→ snapshot   all figures, once
//!               ├→ start      the same with all points: what a reader begins with
//!               └→ batch      the points since the batch before, and now and then the figures
//! ```

use super::news::News;
use super::picture::{Cursor, Picture, Points};
use super::state::State;
use serde::Serialize;

/// What the JSON calls itself.
pub const SCHEMA: &str = "mr-damper/serve/1";
/// Figures go with every so many batches: nobody reads faster.
const FIGURES_EVERY: u64 = 5;
/// Dampers at most: two vehicles of eight.
pub const MOST_DAMPERS: usize = 16;

/// Where news come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Origin {
    /// From ROS topics: all there is.
    #[default]
    Ros,
    /// From the Zenoh mirror, thinned for pages.
    Zenoh,
}

/// All figures of all dampers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Snapshot<'a> {
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// Where they come from.
    pub source: Origin,
    /// Seconds since the watch began.
    pub now_s: f64,
    /// Batches made so far.
    pub batch: u64,
    /// The dampers, by name.
    pub dampers: Vec<State>,
    /// The points of their charts, where they are asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<Points<'a>>,
}

/// What is new.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Batch<'a> {
    now_s: f64,
    batch: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    dampers: Option<Vec<State>>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    points: Vec<Points<'a>>,
}

/// The pictures, in the order of their names.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Wall {
    origin: Origin,
    pictures: Vec<(Picture, Cursor)>,
    batches: u64,
}

impl Wall {
    /// An empty wall for news from `origin`.
    #[must_use]
    pub fn of(origin: Origin) -> Self {
        Self { origin, ..Self::default() }
    }

    /// Pictures on the wall.
    #[must_use]
    pub fn len(&self) -> usize {
        self.pictures.len()
    }

    /// True while there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pictures.is_empty()
    }

    /// Hangs up an empty picture for the damper called `name`, unless there is one.
    pub fn add(&mut self, name: &str) {
        if let Err(place) = self.place(name) {
            self.pictures.insert(place, (Picture::new(name), Cursor::default()));
        }
    }

    /// Takes the picture of the damper called `name` down, if there is one.
    pub fn remove(&mut self, name: &str) {
        if let Ok(place) = self.place(name) {
            self.pictures.remove(place);
        }
    }

    /// Takes what was heard of the damper called `name` at `now_s`; of one that has no picture it is dropped.
    pub fn take(&mut self, name: &str, news: News, now_s: f64) {
        if let Some(picture) = self.picture(name) {
            picture.take(news, now_s);
        }
    }

    /// The picture of the damper called `name`.
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

    /// All figures as they are at `now_s`.
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

    /// The same with all points. The batches behind [`Snapshot::batch`] go on from it; the first may repeat the newest points,
    /// which a reader knows by their times.
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
    // Its keys are texts and its values numbers, texts and lists of them: nothing that JSON has not.
    serde_json::to_string(value).expect("figures go into JSON")
}
