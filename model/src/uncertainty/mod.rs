//! Uncertainty of a model's force: a standard deviation and a 90 % band, from residuals on held-out runs.
//!
//! ```text
//! h(g)     = R(g)_(ceil((n_g + 1) q))                      base half-width of region g
//! H(g,c,a) = sqrt( (G(c) h(g))^2 + A(a)^2 )                half-width: the force lies in Fhat -/+ H
//! G(c)     = the same quantile of |r_c| / h(g),            at least 1
//! A(a)     = the same quantile of sqrt( (r_a^2 - h(g)^2)_+ )
//! ```
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | `R(g)_(k)` | the k-th smallest of the n_g residuals \|measured - predicted\| of region g | N |
//! | `g` | region: \|conditioned velocity\| x drive, edges at quantiles of the held-out rows | - |
//! | `q` | level, .9 or slightly more, see below; separate for h, G and A | 1 |
//! | `c` | time since the newest measured force that seeded the prediction | s |
//! | `a` | age of the drive that the prediction uses | s |
//! | `r_c`, `r_a` | residuals of the model after coasting for c, and with a drive held for a | N |
//!
//! The standard deviation is computed in the same way, with root mean squares instead of quantiles.
//!
//! h is split conformal prediction (Vovk, Gammerman, Shafer 2005; Lei et al. 2018, section 2.2), separately
//! for each region (Mondrian). G and A are conformal too, with the scores given above (locally weighted, Lei
//! et al. 2018, section 5.2): at each calibrated time the coverage is 90 % on average over the regions, for
//! any distribution of the residuals. G and A are linear between two times and constant beyond the last one,
//! where the spread is marked as not calibrated. Regions are independent, so the width is discontinuous at an
//! edge. A region with less than 200 effective rows takes the width of its speed, and a speed with too few
//! takes the width of all rows.
//!
//! **Offset.** Residuals are computed as in live use, with the force offset of the model file. An
//! identification removes the offset of each session, but in live use that offset is unknown, so it
//! contributes to the band.
//!
//! **Runs differ** (temperature, offset, excitation), so the rows of one run are not independent draws, and
//! the pooled .9 quantile of a few runs covers less than 90 % of a new run. The level q is therefore chosen
//! such that the held-out runs, each left out of the table in turn, are covered at 90 % on average over their
//! rows. This treats runs and their rows as two layers, as in Dunn, Wasserman and Ramdas 2022, with the level
//! found by leaving runs out as in CV+ (Barber et al. 2021). The coverage holds on average over new runs of
//! the same kind; it can be higher or lower in a single run.
//!
//! [`crate::calibrate`] computes the table from held-out runs.
//!
//! The two predictors, **free run** (simulation) and **one step** (one-step-ahead prediction), are never
//! mixed; either may be missing. Only the second one coasts. While it coasts, an ageing drive adds the larger
//! of both predictors' contributions, because the combination was not calibrated. Beyond the longest
//! calibrated coasting time, its width is at least the width of the simulation.
//!
//! Source: `[vovk2005]`, `[lei2018]`, `[dunn2022]` and `[barber2021]` in the bibliography (node/docs/guide/bibliography.md).

#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod table;

use crate::elementary::hypot;
use crate::error::{Error, ModelFileError, UncertaintyProblem};
use serde::{Deserialize, Serialize};
use table::UncertaintyTable;

/// Largest number of speed regions.
pub(crate) const SPEEDS: usize = 4;
/// Largest number of drive regions.
pub(crate) const DRIVES: usize = 3;
/// Largest number of times in a [`Growth`].
pub(crate) const TIMES: usize = 8;
/// Ratio of the 90 % band's half-width to the standard deviation for a normal distribution; used without
/// calibration.
pub(crate) const NORMAL_HALF_BAND: f64 = 1.645;

/// Inputs that a prediction uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Predictor {
    /// Simulation: displacement and drive alone.
    FreeRun,
    /// One-step-ahead prediction: also measured force, up to the previous sample or, while coasting, up to an
    /// earlier one.
    OneStep,
}

/// Operating point of a prediction.
///
/// ```
/// use mr_damper_model::calibrate::calibrate;
/// use mr_damper_model::preset;
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
/// use mr_damper_model::uncertainty::{Operating, Predictor};
///
/// let experiment = Experiment::thesis("RP-ICPS").expect("an experiment of the thesis").with_duration_s(30.0);
/// let runs = [1, 2, 3].map(|seed| record(&experiment, &Plant::default(), &Channels::default(), seed));
/// let uncertainty = calibrate(&preset::load(preset::BEST_FUZZY_TANH)?, &runs)?;
/// let fresh = Operating {
///     predictor: Predictor::FreeRun, velocity_m_s: 0.1, drive: 1.2, coast_s: f64::NAN, drive_age_s: 0.002,
/// };
/// let spread = uncertainty.spread(&fresh).expect("the simulation was calibrated");
/// assert!(spread.calibrated && spread.half_band_n > spread.std_dev_n, "{spread:?}");
/// // With a current that is 0.2 s old, the force is less certain.
/// let held = uncertainty.spread(&Operating { drive_age_s: 0.2, ..fresh }).expect("it was calibrated too");
/// assert!(held.half_band_n > spread.half_band_n, "{held:?} {spread:?}");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Operating {
    /// The predictor that made the prediction.
    pub predictor: Predictor,
    /// Conditioned velocity, m/s.
    pub velocity_m_s: f64,
    /// Drive, in the unit of the model's drive; NaN without a drive.
    pub drive: f64,
    /// Time since the stamp of the newest measured force that has no predicted force among the older lags, s.
    /// Used for one-step predictions only.
    pub coast_s: f64,
    /// Time since the stamp of the drive, s; NaN without a drive.
    pub drive_age_s: f64,
}

/// Uncertainty of a prediction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Root mean squared error, N.
    pub std_dev_n: f64,
    /// Half-width of the 90 % band, N.
    pub half_band_n: f64,
    /// False beyond the calibrated coasting time or the calibrated age of the drive.
    pub calibrated: bool,
}

/// Widths of a region, or their increase.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Width {
    pub(crate) std_dev: f64,
    pub(crate) half_band: f64,
}

impl Width {
    fn map(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self { std_dev: f(self.std_dev, other.std_dev), half_band: f(self.half_band, other.half_band) }
    }

    pub(crate) fn max(self, other: Self) -> Self {
        self.map(other, f64::max)
    }
}

/// Edges between regions, in increasing order; a value on an edge belongs to the upper region.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Edges<const N: usize> {
    pub(crate) len: usize,
    pub(crate) at: [f64; N],
}

impl<const N: usize> Edges<N> {
    /// `None` if there are too many edges, or if they do not increase.
    pub(crate) fn new(edges: &[f64]) -> Option<Self> {
        let increase = edges.windows(2).all(|pair| pair[0] < pair[1]);
        if edges.len() > N || !increase || !edges.iter().all(|edge| edge.is_finite()) {
            return None;
        }
        let mut at = [0.0; N];
        at[..edges.len()].copy_from_slice(edges);
        Some(Self { len: edges.len(), at })
    }

    pub(crate) fn as_slice(&self) -> &[f64] {
        &self.at[..self.len]
    }

    #[inline]
    pub(crate) fn region(&self, value: f64) -> usize {
        self.as_slice().iter().filter(|edge| value >= **edge).count()
    }
}

/// Growth of widths with time, linear between calibrated times.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Growth {
    pub(crate) len: usize,
    at_s: [f64; TIMES],
    width: [Width; TIMES],
}

impl Growth {
    /// Tolerance of the last time, as a share of it; later times are not calibrated.
    const SLACK: f64 = 0.25;

    /// `None` if the number of times is 0 or too large.
    pub(crate) fn new(nodes: &[(f64, Width)]) -> Option<Self> {
        if nodes.is_empty() || nodes.len() > TIMES {
            return None;
        }
        let mut growth = Self { len: nodes.len(), at_s: [0.0; TIMES], width: [Width::default(); TIMES] };
        for (k, (at_s, width)) in nodes.iter().enumerate() {
            (growth.at_s[k], growth.width[k]) = (*at_s, *width);
        }
        Some(growth)
    }

    pub(crate) fn first_s(&self) -> f64 {
        self.at_s[0]
    }

    pub(crate) fn last_s(&self) -> f64 {
        self.at_s[self.len - 1]
    }

    #[inline]
    fn was_tried(&self, time_s: f64) -> bool {
        time_s <= self.last_s() * (1.0 + Self::SLACK)
    }

    #[inline]
    pub(crate) fn at(&self, time_s: f64) -> Width {
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

/// Calibration table of one predictor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bands {
    pub(crate) speed_edges_m_s: Edges<{ SPEEDS - 1 }>,
    pub(crate) drive_edges: Edges<{ DRIVES - 1 }>,
    pub(crate) width_n: [[Width; DRIVES]; SPEEDS],
    /// Width that a held drive adds, N, as a root sum of squares; `None` for a model without drive.
    pub(crate) drive_held: Option<Growth>,
}

impl Bands {
    /// The widths of the region at `at`; `None` if velocity or drive is unknown.
    #[inline]
    fn region(&self, at: &Operating) -> Option<Width> {
        if !at.velocity_m_s.is_finite() || (self.drive_held.is_some() && !at.drive.is_finite()) {
            return None;
        }
        Some(self.width_at(at.velocity_m_s.abs(), at.drive))
    }

    #[inline]
    pub(crate) fn width_at(&self, speed_m_s: f64, drive: f64) -> Width {
        // NaN is above no edge, so a model without drive uses the first column.
        self.width_n[self.speed_edges_m_s.region(speed_m_s)][self.drive_edges.region(drive)]
    }

    /// Width that a drive of age `age_s` adds, N, and whether this age is calibrated; `None` if the age is
    /// unknown.
    #[inline]
    fn held(&self, age_s: f64) -> Option<(Width, bool)> {
        match &self.drive_held {
            None => Some((Width::default(), true)),
            Some(_) if !age_s.is_finite() => None,
            Some(held) => Some((held.at(age_s), held.was_tried(age_s))),
        }
    }
}

/// Calibrated uncertainty of a model. It is `Copy` and uses no heap. See the [module](self).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "UncertaintyTable", into = "UncertaintyTable")]
pub struct Uncertainty {
    pub(crate) free_run: Option<Bands>,
    pub(crate) one_step: Option<OneStep>,
}

/// One-step-ahead prediction, and its growth while coasting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct OneStep {
    pub(crate) bands: Bands,
    /// Factors on the widths, by time since the last measured force.
    pub(crate) coasting: Growth,
}

impl Uncertainty {
    /// Largest time, in steps, for which a prediction counts as one step ahead; it allows for jitter of
    /// stamps.
    pub(crate) const ONE_STEP: f64 = 1.5;

    /// The spread of a prediction made at `at`. `None` if a value that it depends on is NaN, or if the
    /// predictor was not calibrated.
    #[inline]
    #[must_use]
    pub fn spread(&self, at: &Operating) -> Option<Spread> {
        let (width, calibrated) = match at.predictor {
            Predictor::FreeRun => self.free_run(at)?,
            Predictor::OneStep => self.one_step(at)?,
        };
        Some(Spread { std_dev_n: width.std_dev, half_band_n: width.half_band, calibrated })
    }

    /// True if `predictor` was calibrated.
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
        Some((free_run.region(at)?.map(added, hypot), calibrated))
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
            return Some((grown.map(added, hypot), calibrated));
        }
        if let Some(free_run) = &self.free_run {
            let (added_free, tried) = free_run.held(at.drive_age_s)?;
            added = added.max(added_free);
            calibrated &= tried;
        }
        let mut width = grown.map(added, hypot);
        if at.coast_s > coasting.last_s()
            && let Some((free_run, _)) = self.free_run(at)
        {
            width = width.max(free_run);
        }
        Some((width, calibrated && coasting.was_tried(at.coast_s)))
    }
}

/// The error of [`crate::model_file`] for an invalid uncertainty table.
fn refused(key: &str, problem: UncertaintyProblem) -> Error {
    ModelFileError::Uncertainty { key: key.to_owned(), problem: Box::new(problem) }.into()
}

#[cfg(test)]
mod tests;
