//! Settings of an identification.

use super::dataset::DatasetOptions;
#[cfg(doc)]
use super::{Identified, Memberships};
use crate::condition::Conditioning;

/// Where fuzzy sets over the drive stand; in the free form it is where their centres and widths start from.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Placement {
    /// By the runs ([`Memberships::from_drive`]).
    #[default]
    FromRuns,
    /// So many, evenly over the range of the drive in the runs ([`Memberships::even`]).
    Even(usize),
    /// As given.
    Given {
        /// Centres in the unit of the runs' drive (A or V), increasing.
        centres: Vec<f64>,
        /// Standard deviation of the sets, in the same unit; `None`: half the spacing of the centres.
        sigma: Option<f64>,
    },
}

/// Settings of an identification.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How displacement becomes a model's inputs. It becomes part of the model.
    pub conditioning: Conditioning,
    /// Choose the derivative of a fuzzy-tanh model by what fits the training runs best, in place of
    /// `velocity` and `slope_window_s` of `conditioning`. [`Identified::velocity_trials`] tells what was
    /// tried.
    pub choose_velocity: bool,
    /// How runs become rows: moving rows only, thinning to a rate, gaps.
    pub dataset: DatasetOptions,
    /// Fuzzy sets over the drive, of models that have them.
    pub placement: Placement,
    /// Degree of the polynomials over the drive, of laws of force and lpv, 1 to 4.
    pub degree: usize,
    /// What of the residuals is minimised.
    pub loss: Loss,
    /// Most rows that a nonlinear fit is finished on, and that networks and rules learn from; beyond it a sample of
    /// about that many is taken. `None`: all rows, however many.
    pub most_rows: Option<usize>,
    /// Restarts of a nonlinear fit; at least one is made.
    pub restarts: u32,
    /// Seed of the restarts. The same seed and runs give the same model, on any number of threads.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            conditioning: Conditioning::default(),
            choose_velocity: true,
            dataset: DatasetOptions::default(),
            placement: Placement::FromRuns,
            degree: 2,
            loss: Loss::Squares,
            most_rows: None,
            restarts: 25,
            seed: 0,
        }
    }
}

/// What of the residuals a nonlinear fit minimises.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// Their squares: the fit has the least RSSE.
    Squares,
    /// Huber's loss: squares within the threshold, beyond it growing linearly, so that stray samples count for
    /// little.
    Huber {
        /// The threshold in newtons; a few times the load cell's noise.
        threshold_n: f64,
    },
}
