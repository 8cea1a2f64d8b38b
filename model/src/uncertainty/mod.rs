//! How far a model's force may be off: a standard deviation and a 90 % band, from residuals on held-out runs.
//!
//! ```text
//! h(g)     = R(g)_(ceil((n_g + 1) q))                      base half-width of region g
//! H(g,c,a) = sqrt( (G(c) h(g))^2 + A(a)^2 )                half-width: the force lies in Fhat -/+ H
//! G(c)     = such a quantile of |r_c| / h(g),              not below 1
//! A(a)     = such a quantile of sqrt( (r_a^2 - h(g)^2)_+ )
//! ```
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | `R(g)_(k)` | the k-th smallest of the n_g residuals \|measured - predicted\| of region g | N |
//! | `g` | region: \|conditioned velocity\| x drive, edges at quantiles of the held-out rows | - |
//! | `q` | level, .9 or a little more, see below; h, G and A each have their own | 1 |
//! | `c` | time since the newest measured force that the prediction was seeded with | s |
//! | `a` | age of the drive that the prediction was made from | s |
//! | `r_c`, `r_a` | residuals of the model coasting for c, and on a drive held for a | N |
//!
//! The standard deviation goes the same way, with root mean squares in place of quantiles.
//!
//! h is split conformal prediction (Vovk, Gammerman, Shafer 2005; Lei et al. 2018, section 2.2), region by region
//! (Mondrian). G and A are conformal too, with the scores that stand there (locally weighted, Lei et al. 2018, section
//! 5.2): at each time that was tried, 90 % are covered on average over the regions, whatever the distribution of the
//! residuals. Between two of them G and A are linear, beyond the last they stay, and the spread says that it is not
//! calibrated there. No region borrows from its neighbours: the width steps at an edge. A region with less than 200
//! effective rows takes the width of its speed, and that one of all rows.
//!
//! **Offset.** Residuals are those of the model as it runs live, with the force offset of its own file. A session's
//! own offset, which an identification takes out, is not known live, and so it belongs into the band.
//!
//! **Runs differ** (temperature, offset, excitation), so rows of one run are no independent draws, and the pooled .9
//! quantile of few runs covers less than 90 % of a new one. The level q is therefore the one at which the held-out
//! runs, each left out of the table in turn, are covered at 90 % on average over their rows: two layers, runs and rows in
//! them, as in Dunn, Wasserman and Ramdas 2022, with the level found by leaving out as in CV+ (Barber et al. 2021). What
//! is promised is the share over new runs like these; a single run may have more or less.
//!
//! Two predictors, never mixed: **free run** and **one step**, either of which may be missing. Only the second one
//! coasts. While it does, a drive that ages counts as much as in either of them (the two were not tried together), and
//! beyond the longest coasting that was tried it is no better than running free.

mod calibrate;
mod rows;
mod table;

pub use calibrate::{Calibrator, calibrate};

use crate::error::Error;
use serde::{Deserialize, Serialize};
use table::UncertaintyTable;

/// Regions of speed, at most.
const SPEEDS: usize = 4;
/// Regions of drive, at most.
const DRIVES: usize = 3;
/// Times of a [`Growth`], at most.
const TIMES: usize = 8;
/// Half-width of a 90 % band over the standard deviation, for a normal distribution; used where nothing is calibrated.
pub(crate) const NORMAL_HALF_BAND: f64 = 1.645;

/// What a prediction is made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Predictor {
    /// Displacement and drive alone.
    FreeRun,
    /// Measured force too, up to the sample before or, while coasting, up to a while ago.
    OneStep,
}

/// Where a model is when it predicts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Operating {
    /// Which of the predictors speaks.
    pub predictor: Predictor,
    /// Conditioned velocity, m/s.
    pub velocity_m_s: f64,
    /// Drive, in the unit of the model's drive; NaN where there is none.
    pub drive: f64,
    /// Time since the stamp of the newest measured force that has no predicted ones in the lags behind it, s. Read for
    /// one step only.
    pub coast_s: f64,
    /// Time since the stamp of the drive, s; NaN where there is none.
    pub drive_age_s: f64,
}

/// How far a prediction may be off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Root mean squared error, N.
    pub std_dev_n: f64,
    /// Half-width of the 90 % band, N.
    pub half_band_n: f64,
    /// False beyond the coasting and the drive's age that were tried when it was calibrated.
    pub calibrated: bool,
}

/// Widths of a region, or what is added to them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Width {
    std_dev: f64,
    half_band: f64,
}

impl Width {
    fn map(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self { std_dev: f(self.std_dev, other.std_dev), half_band: f(self.half_band, other.half_band) }
    }

    fn max(self, other: Self) -> Self {
        self.map(other, f64::max)
    }
}

/// Edges between regions, increasing; a value on an edge belongs above it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Edges<const N: usize> {
    len: usize,
    at: [f64; N],
}

impl<const N: usize> Edges<N> {
    /// `None` when there are too many, or they do not increase.
    fn new(edges: &[f64]) -> Option<Self> {
        let increase = edges.windows(2).all(|pair| pair[0] < pair[1]);
        if edges.len() > N || !increase || !edges.iter().all(|edge| edge.is_finite()) {
            return None;
        }
        let mut at = [0.0; N];
        at[..edges.len()].copy_from_slice(edges);
        Some(Self { len: edges.len(), at })
    }

    fn as_slice(&self) -> &[f64] {
        &self.at[..self.len]
    }

    #[inline]
    fn region(&self, value: f64) -> usize {
        self.as_slice().iter().filter(|edge| value >= **edge).count()
    }
}

/// How widths grow with a time, linear between those that were tried.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Growth {
    len: usize,
    at_s: [f64; TIMES],
    width: [Width; TIMES],
}

impl Growth {
    /// Beyond the last time by this share, a time counts as not tried.
    const SLACK: f64 = 0.25;

    /// `None` when there are no times or too many.
    fn new(nodes: &[(f64, Width)]) -> Option<Self> {
        if nodes.is_empty() || nodes.len() > TIMES {
            return None;
        }
        let mut growth = Self { len: nodes.len(), at_s: [0.0; TIMES], width: [Width::default(); TIMES] };
        for (k, (at_s, width)) in nodes.iter().enumerate() {
            (growth.at_s[k], growth.width[k]) = (*at_s, *width);
        }
        Some(growth)
    }

    fn first_s(&self) -> f64 {
        self.at_s[0]
    }

    fn last_s(&self) -> f64 {
        self.at_s[self.len - 1]
    }

    #[inline]
    fn was_tried(&self, time_s: f64) -> bool {
        time_s <= self.last_s() * (1.0 + Self::SLACK)
    }

    #[inline]
    fn at(&self, time_s: f64) -> Width {
        let after = self.at_s[..self.len].iter().filter(|at| time_s >= **at).count();
        if after == 0 {
            return self.width[0];
        }
        let before = after - 1;
        if after == self.len {
            return self.width[before];
        }
        let share = (time_s - self.at_s[before]) / (self.at_s[after] - self.at_s[before]);
        self.width[before].map(self.width[after], |a, b| a + (b - a) * share)
    }
}

/// The table of one predictor.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Bands {
    speed_edges_m_s: Edges<{ SPEEDS - 1 }>,
    drive_edges: Edges<{ DRIVES - 1 }>,
    width_n: [[Width; DRIVES]; SPEEDS],
    /// What a held drive adds, N, root sum squared; `None` for a model without drive.
    drive_held: Option<Growth>,
}

impl Bands {
    /// The widths of the region, or `None` when it is not known where the model is.
    #[inline]
    fn region(&self, at: &Operating) -> Option<Width> {
        if !at.velocity_m_s.is_finite() || (self.drive_held.is_some() && !at.drive.is_finite()) {
            return None;
        }
        Some(self.width_at(at.velocity_m_s.abs(), at.drive))
    }

    #[inline]
    fn width_at(&self, speed_m_s: f64, drive: f64) -> Width {
        // NaN lies above no edge: a model without drive has one column.
        self.width_n[self.speed_edges_m_s.region(speed_m_s)][self.drive_edges.region(drive)]
    }

    /// What a drive of age `age_s` adds, N, and whether that age was tried; `None` when the age is not known.
    #[inline]
    fn held(&self, age_s: f64) -> Option<(Width, bool)> {
        match &self.drive_held {
            None => Some((Width::default(), true)),
            Some(_) if !age_s.is_finite() => None,
            Some(held) => Some((held.at(age_s), held.was_tried(age_s))),
        }
    }
}

/// Calibrated uncertainty of a model. `Copy`, without heap. See the [module](self).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "UncertaintyTable", into = "UncertaintyTable")]
pub struct Uncertainty {
    free_run: Option<Bands>,
    one_step: Option<OneStep>,
}

/// One step, and what coasting makes of it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct OneStep {
    bands: Bands,
    /// Factors on the widths, by time since the last measured force.
    coasting: Growth,
}

impl Uncertainty {
    /// Steps up to which a prediction counts as one step ahead: stamps jitter.
    const ONE_STEP: f64 = 1.5;

    /// The spread of a prediction made at `at`. `None` where something that it depends on is NaN, and for a predictor
    /// that was not calibrated.
    #[inline]
    #[must_use]
    pub fn spread(&self, at: &Operating) -> Option<Spread> {
        let (width, calibrated) = match at.predictor {
            Predictor::FreeRun => self.free_run(at)?,
            Predictor::OneStep => self.one_step(at)?,
        };
        Some(Spread { std_dev_n: width.std_dev, half_band_n: width.half_band, calibrated })
    }

    /// True when `predictor` was calibrated.
    #[must_use]
    pub const fn covers(&self, predictor: Predictor) -> bool {
        match predictor {
            Predictor::FreeRun => self.free_run.is_some(),
            Predictor::OneStep => self.one_step.is_some(),
        }
    }

    #[inline]
    fn free_run(&self, at: &Operating) -> Option<(Width, bool)> {
        let free_run = self.free_run.as_ref()?;
        let (added, calibrated) = free_run.held(at.drive_age_s)?;
        Some((free_run.region(at)?.map(added, f64::hypot), calibrated))
    }

    #[inline]
    fn one_step(&self, at: &Operating) -> Option<(Width, bool)> {
        let OneStep { bands, coasting } = self.one_step.as_ref()?;
        if !at.coast_s.is_finite() {
            return None;
        }
        let (mut added, mut calibrated) = bands.held(at.drive_age_s)?;
        let grown = bands.region(at)?.map(coasting.at(at.coast_s), |width_n, factor| width_n * factor);
        if at.coast_s <= coasting.first_s() * Self::ONE_STEP {
            return Some((grown.map(added, f64::hypot), calibrated));
        }
        if let Some(free_run) = &self.free_run {
            let (added_free, tried) = free_run.held(at.drive_age_s)?;
            added = added.max(added_free);
            calibrated &= tried;
        }
        let mut width = grown.map(added, f64::hypot);
        if at.coast_s > coasting.last_s()
            && let Some((free_run, _)) = self.free_run(at)
        {
            width = width.max(free_run);
        }
        Some((width, calibrated && coasting.was_tried(at.coast_s)))
    }
}

/// What [`crate::model_file`] says of a table that makes no uncertainty.
fn refused(name: &str, what: impl std::fmt::Display) -> Error {
    Error::ModelFile { message: format!("expected.uncertainty.{name} {what}") }
}

#[cfg(test)]
mod tests;
