//! Which derivative suits the runs: backward difference, or the slope over a trailing window, and how long a
//! one.
//!
//! A window takes noise out of velocity and delays it by half its length. A damper's force lags velocity too
//! (coil, compliance of seals and fluid), and a model without memory cannot: on some rigs a delay of the same
//! size helps as much as the better model would, on others any delay hurts. So candidates are compared on the
//! training runs, by the ESR that a few restarts reach on the same rows. It is the mean of the runs' own:
//! pooled, the strongest run at the highest rate would choose for all, and a delay is right only when it
//! suits slow and fast motion alike.

use super::dataset::Dataset;
use super::{Options, Watch};
use crate::condition::{Conditioning, VelocitySource};
use crate::error::Error;
use crate::sample::Run;

/// Windows that are tried besides the backward difference, s.
const WINDOWS_S: [f64; 7] = [0.003, 0.005, 0.007, 0.01, 0.015, 0.02, 0.03];
/// A longer window must better the ESR of a shorter one by this share: delay is no good in itself.
const GAIN: f64 = 0.02;

/// A derivative that was tried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VelocityTrial {
    /// Where velocity came from.
    pub velocity: VelocitySource,
    /// Length of the window when that is a slope, s.
    pub slope_window_s: f64,
    /// Mean ESR of the training runs, on a sample of their rows, after a few restarts.
    pub mean_esr: f64,
}

/// Tries the derivatives on `runs` and returns the conditioning with the best one, and all that were tried.
/// `mean_esr` tells how well a model of the wanted structure can do on some datasets.
pub(super) fn choose(
    runs: &[Run],
    options: &Options,
    watch: &Watch,
    mean_esr: impl Fn(&[Dataset]) -> Result<f64, Error>,
) -> Result<(Conditioning, Vec<VelocityTrial>), Error> {
    // Of a window shorter than two periods of the fastest run nothing is left but the backward difference.
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
