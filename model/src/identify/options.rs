//! Settings of an identification.

use super::dataset::DatasetOptions;
#[cfg(doc)]
use super::{Identified, Memberships};
use crate::condition::Conditioning;

/// Centres of the fuzzy sets over the drive; in the free form these are the starting values.
///
/// ```
/// use mr_damper_model::identify::{ModelSpec, Options, Placement, Watch, identify};
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let experiment = Experiment::thesis("RP-ICPS").expect("an experiment of the thesis").with_duration_s(10.0);
/// let run = record(&experiment, &Plant::default(), &Channels::default(), 1);
/// let placement = Placement::Given { centres: vec![0.0, 1.2, 2.5], sigma: None };
/// let options = Options { placement, choose_velocity: false, restarts: 1, ..Options::default() };
/// let found = identify(ModelSpec::FUZZY_TANH, &[run], &options, &Watch::none())?;
/// // Half of the mean distance of the centres
/// let sets = found.memberships.expect("fuzzy-tanh has sets").sets;
/// assert_eq!((sets.centres(), sets.sigmas()[0]), (&[0.0, 1.2, 2.5][..], 0.625));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Placement {
    /// Chosen from the runs ([`Memberships::from_drive`]).
    #[default]
    FromRuns,
    /// This number of sets, evenly over the range of the drive in the runs ([`Memberships::even`]).
    Even(usize),
    /// Given by the caller.
    Given {
        /// Centres in the unit of the runs' drive (A or V), increasing.
        centres: Vec<f64>,
        /// Standard deviation of the sets, in the same unit; `None` means half the spacing of the centres.
        sigma: Option<f64>,
    },
}

/// Settings of an identification.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How displacement becomes the model's inputs. It is stored in the model.
    pub conditioning: Conditioning,
    /// Choose the derivative of a fuzzy-tanh model by the best fit to the training runs, instead of
    /// `velocity` and `slope_window_s` of `conditioning`. [`Identified::velocity_trials`] lists the trials.
    pub choose_velocity: bool,
    /// How runs become rows: moving rows only, thinning to a rate, gaps.
    pub dataset: DatasetOptions,
    /// Fuzzy sets over the drive, for models that have them.
    pub placement: Placement,
    /// Degree of the polynomials over the drive, for force laws and lpv, 1 to 5.
    pub degree: usize,
    /// The loss that is minimised.
    pub loss: Loss,
    /// Most rows for the final stage of a nonlinear fit, and for the training of networks and fuzzy rules. If
    /// there are more, a sample of about this size is used. `None` uses all rows.
    pub most_rows: Option<usize>,
    /// Restarts of a nonlinear fit; at least one.
    pub restarts: u32,
    /// Seed of the restarts. The same seed and runs give the same model on any number of threads.
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

/// The loss that a nonlinear fit minimises.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// Squared residuals: the fit has the lowest RMSE.
    Squares,
    /// Huber's loss: quadratic up to the threshold and linear beyond it, so that outliers have little
    /// influence.
    Huber {
        /// The threshold, N; a few times the noise of the load cell.
        threshold_n: f64,
    },
}

/// Reweighting iterations for a robust loss.
pub(super) const REWEIGHTINGS: usize = 8;

impl Loss {
    /// The value that minimises the loss of its differences to `residuals`: their mean or, for Huber's loss, a mean that
    /// is reweighted.
    pub(super) fn centre(self, residuals: &[f64]) -> f64 {
        let mut centre = residuals.iter().sum::<f64>() / residuals.len().max(1) as f64;
        if let Self::Huber { threshold_n } = self {
            for _ in 0..REWEIGHTINGS {
                let weighed = |residual: &f64| {
                    let weight = (threshold_n / (residual - centre).abs()).min(1.0);
                    (weight, weight * residual)
                };
                let (weight, sum) =
                    residuals.iter().map(weighed).fold((0.0, 0.0), |(a, b), (c, d)| (a + c, b + d));
                centre = sum / weight;
            }
        }
        centre
    }

    /// The loss of one residual, N²: r² or, beyond Huber's threshold t, t (2 |r| - t).
    pub(super) fn of(self, residual_n: f64) -> f64 {
        let squared = residual_n * residual_n;
        match self {
            Self::Huber { threshold_n } if residual_n.abs() > threshold_n => {
                threshold_n * (2.0 * residual_n.abs() - threshold_n)
            }
            Self::Squares | Self::Huber { .. } => squared,
        }
    }
}
