//! Chooses the derivative for the runs: the backward difference, or the slope over a trailing window and its
//! length.
//!
//! A window reduces the noise of velocity and delays it by half its length. A damper's force also lags
//! velocity (coil, compliance of seals and fluid), which a model without memory cannot reproduce. On some
//! rigs a delay of the same size therefore helps as much as a better model would; on others any delay hurts.
//! Candidates are compared on the training runs, by the NMSE that a few restarts reach on the same rows. The
//! criterion is the mean of the runs' own values: pooled errors would let the strongest run at the highest
//! rate decide, and a delay is right only if it suits slow and fast motion.

use super::dataset::Dataset;
use super::{Options, Watch};
use crate::condition::{Conditioning, VelocitySource};
use crate::error::Error;
use crate::sample::Run;

/// Window lengths that are tried besides the backward difference, s.
const WINDOWS_S: [f64; 7] = [0.003, 0.005, 0.007, 0.01, 0.015, 0.02, 0.03];
/// Least relative improvement of NMSE for a longer window, because a delay is not an advantage in itself.
const GAIN: f64 = 0.02;

/// A derivative that was tried, and its result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VelocityTrial {
    /// Source of the velocity.
    pub velocity: VelocitySource,
    /// Length of the window if the source is a slope, s.
    pub slope_window_s: f64,
    /// Mean NMSE of the training runs, on a sample of their rows, after a few restarts.
    pub mean_esr: f64,
}

/// Tries the derivatives on `runs`. Returns the conditioning with the best one, and all trials. `mean_esr` is
/// the error that a model of the requested structure reaches on given datasets.
pub(super) fn choose(
    runs: &[Run],
    options: &Options,
    watch: &Watch,
    mean_esr: impl Fn(&[Dataset]) -> Result<f64, Error>,
) -> Result<(Conditioning, Vec<VelocityTrial>), Error> {
    // A window shorter than two periods of the fastest run is equal to the backward difference.
    let rates = runs.iter().filter_map(|run| run.displacement_m.mean_rate_hz());
    let fastest_hz = options.dataset.rate_hz.unwrap_or_else(|| rates.fold(0.0, f64::max));
    let windows = WINDOWS_S.into_iter().filter(|window_s| window_s * fastest_hz > 1.99);
    let backward = Conditioning { velocity: VelocitySource::Backward, ..options.conditioning };
    let candidates = std::iter::once(backward).chain(windows.map(|slope_window_s| Conditioning {
        velocity: VelocitySource::Slope,
        slope_window_s,
        ..options.conditioning
    }));
    let mut best = (backward, f64::INFINITY);
    let mut trials = Vec::new();
    for conditioning in candidates {
        let mean_esr = mean_esr(&super::datasets(runs, &conditioning, options, watch)?)?;
        let Conditioning { velocity, slope_window_s, .. } = conditioning;
        trials.push(VelocityTrial { velocity, slope_window_s, mean_esr });
        if mean_esr < (1.0 - GAIN) * best.1 {
            best = (conditioning, mean_esr);
        }
    }
    Ok((best.0, trials))
}
