//! Closing the loop: names the physical effect that a model lacks, adds it, and says what it mends.
//!
//! ```text
//! estimate runs ─→ base refitted, free run ─→ residual r over the noise floor?         no → nothing to explain
//!                   │                         scores g = dM/d(effect), projected off dM/d(base)
//!                   │                         block sums of g r, corrected for many tests → significant
//!                   │                         joint refit of the best → the largest drop of squared error
//! confirm runs  ─→ helps on every one? in its physical range? interval without "absent"? specific? → named
//!                   └── up to three times, then backwards: what is not needed goes
//! another base  ─→ does it do better without any effect?                               then the base is at fault, no name
//! sealed runs   ─→ read once: error before and after
//! ```
//!
//! The residual is always that of the model **running free**: one step ahead of measured force every effect is in the
//! model's input already. Scores go through the whole simulator, filters and all. What the base could absorb by other
//! coefficients is no evidence, hence the projection; samples are no independent evidence, hence the blocks; a name
//! that does not help on runs it was not found on is none. Effects that the data cannot tell apart come as a class.
//!
//! Everything is deterministic for a seed, on any number of threads.

mod basis;
mod blocks;
mod check;
mod closing;
mod finding;
mod floor;
mod joint;
mod known;
mod left_over;
mod paired;
mod rival;
mod round;
mod rows;
mod score;
mod sealed;
mod sought;
mod space;

pub use finding::{
    Candidate, Change, Closing, Correlation, FloorSource, Found, LeftOver, Mode, Named, NoiseFloor, Refused,
    Sealed, Verdict,
};
pub use paired::reference_force_n;
pub use sought::Sought;

use crate::error::Error;
use crate::identify::{Dataset, Watch};
use crate::model::Model;

/// The runs of a closing, by what they are for. Each is conditioned as the base is. No run may serve twice.
#[derive(Debug, Clone, Copy, Default)]
pub struct Runs<'a> {
    /// What effects are found on.
    pub estimate: &'a [Dataset],
    /// What decides whether a finding holds; at least one.
    pub confirm: &'a [Dataset],
    /// Read once, at the end; may be empty, and then nothing is proved.
    pub test: &'a [Dataset],
    /// Healthy runs for paired mode, in the order of `estimate`, `confirm`, `test`: the run of the same excitation for each.
    pub reference: &'a [Dataset],
    /// Runs of one pattern, for the noise floor.
    pub replicates: &'a [Dataset],
}

/// Settings of a closing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Noise floor that the user knows, N root mean square.
    pub noise_floor_n: Option<f64>,
    /// Probability, at most, that any effect is named by chance where none is.
    pub significance: f64,
    /// Most effects to name, 1 to 3.
    pub most_effects: usize,
    /// Effects that may be named.
    pub sought: Sought,
    /// Least length of a block, s. At the default of 3 s a null of coloured noise was named in none of a hundred trials, with
    /// blocks of a quarter of a second in one of six: shorten it only where the data are too few for anything else, and say so.
    pub block_s: f64,
    /// Most rows that sums are taken over; of longer runs every n-th.
    pub most_rows: usize,
    /// Seed of sign flips and bootstrap.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            noise_floor_n: None,
            significance: 0.05,
            block_s: 3.0,
            most_effects: 3,
            sought: Sought::ALL,
            most_rows: 60_000,
            seed: 0,
        }
    }
}

/// Stages of a closing, for who watches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The base is refitted on the estimate runs.
    Base,
    /// Scores of round so many are taken.
    Scores(usize),
    /// Candidates of round so many are refitted together with the base.
    Refits(usize),
    /// Effects that are not needed are sought.
    Pruning,
    /// Another base is tried, to see whether the given one is at fault.
    Rival,
    /// The sealed runs are read.
    Sealed,
}

/// Closes the loop around `base`.
///
/// `stage` is called as the work goes on.
///
/// # Errors
/// [`Error::Data`] when runs are too few, too short for the blocks, given twice, conditioned unlike the base, or without their
/// reference in paired mode; and for a base that has no parameters to project off (in absolute mode).
/// [`Error::MissingChannel`], [`Error::WrongDrive`] for runs that the base cannot run on; [`Error::Cancelled`].
pub fn close(
    base: &Model,
    runs: &Runs,
    settings: &Settings,
    watch: &Watch,
    stage: &dyn Fn(Stage),
) -> Result<Closing, Error> {
    check::check(base, runs, settings)?;
    closing::Desk::new(base, runs, settings, watch)?.close(stage)
}
