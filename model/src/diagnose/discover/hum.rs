//! A hum: a sine in what the model leaves of the measured force, at a frequency that neither motion nor drive has.
//!
//! ```text
//! X(f) = sum of w(t) e(t) exp(-2 pi i f t)          e: measured minus simulated force,  w: Hann window
//! P(f) = sum over the runs of |X(f)|²
//! line = the largest P over its median nearby, on the training runs, where the simulated force has no line
//! p    = probability of P(line) on the validation runs, if P is exponential there with that median
//! ```
//!
//! Its phase is another one in every run, so it cannot be a term of the model: only frequency and amplitude are said. Where the conditioning
//! filters the measured force, the amplitude is that before the filter.

use super::{Hypothesis, Search};
use crate::condition::{ApplyTo, Conditioning};
use crate::diagnose::joint::Fitted;
use crate::diagnose::rows::{Rows, RunRows, dot};
use crate::effect::Augmented;
use crate::statistics::fourier::transform;
use realfft::RealFftPlanner;
use realfft::num_complex::Complex;
use std::f64::consts::{LN_2, PI, TAU};

/// Lowest frequency, Hz, and in periods per run: slower changes are drift.
const LOWEST_HZ: f64 = 2.0;
const LEAST_PERIODS: f64 = 20.0;
/// Highest frequency as a share of the rate.
const OF_RATE: f64 = 0.45;
/// Frequencies on each side from which the median is taken.
const NEARBY: usize = 48;
/// Mean square of the amplitude of noise alone in a Hann window, in units of its variance over the number of samples.
const OF_NOISE: f64 = 6.0;
/// Steps of the search for the frequency within one step of the grid.
const REFINED: usize = 24;

/// A hum.
///
/// ```
/// use mr_damper_model::diagnose::discover::Hum;
///
/// let hum = Hum { frequency_hz: 50.01, frequency_ci95_hz: [50.0, 50.02], amplitude_n: 30.2, amplitude_ci95_n: [29.0, 31.4], p: 1e-9, share: 0.4 };
/// assert_eq!(hum.sentence(), "The measured force has a hum of 30.2 N (29.0 to 31.4 N) at 50.01 Hz (50.00 to 50.02 Hz).");
/// assert!(hum.hypothesis().cause.starts_with("the mains"));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hum {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Its 95 % interval.
    pub frequency_ci95_hz: [f64; 2],
    /// Amplitude, N: root mean square over the runs, times the square root of two.
    pub amplitude_n: f64,
    /// Its 95 % interval.
    pub amplitude_ci95_n: [f64; 2],
    /// Probability of a line like this on the validation runs by chance.
    pub p: f64,
    /// Share of the squared error on the validation runs that it is.
    pub share: f64,
}

impl Hum {
    /// A sentence with its numbers.
    #[must_use]
    pub fn sentence(&self) -> String {
        let ([low_n, high_n], [low_hz, high_hz]) = (self.amplitude_ci95_n, self.frequency_ci95_hz);
        format!(
            "The measured force has a hum of {:.1} N ({low_n:.1} to {high_n:.1} N) at {:.2} Hz ({low_hz:.2} to {high_hz:.2} Hz).",
            self.amplitude_n, self.frequency_hz
        )
    }

    /// Its likely cause, with what would tell.
    #[must_use]
    pub fn hypothesis(&self) -> Hypothesis {
        let near = |mains_hz: f64| (self.frequency_hz / mains_hz - 1.0).abs() < 0.005;
        let (cause, test) = match [50.0, 60.0, 100.0, 120.0].into_iter().any(near) {
            true => (
                "the mains, in the load cell, its cable or its amplifier",
                "the reading at rest, with the actuator off",
            ),
            false => (
                "a machine nearby, a pump or a fan, or an electrical source",
                "the reading at rest, with each of them off in turn",
            ),
        };
        Hypothesis { cause, test }
    }
}

/// The strongest hum in what `model` leaves; `None` if there is none.
pub(super) fn find(search: &Search, model: &Augmented) -> Option<Hum> {
    let [train, confirm] =
        [search.runs.estimate, search.runs.confirm].map(|runs| Rows::new(runs, usize::MAX));
    let train = Spectrum::new(&train, model)?;
    let confirm = Spectrum::new(&confirm, model)?;
    let thresholds = &search.settings.thresholds;
    let coarse_hz = train.line(thresholds.hum_in_force)?;
    let at = |j: usize| coarse_hz + train.step_hz * (2.0 * j as f64 / REFINED as f64 - 1.0);
    let power = |hz: &f64| train.power(*hz);
    let frequency_hz = (0..=REFINED).map(at).max_by(|a, b| power(a).total_cmp(&power(b)))?;
    let (p, share) = (confirm.p(frequency_hz)?, confirm.share(frequency_hz));
    if p > thresholds.hum_p || share.is_nan() || share < thresholds.hum_least_share {
        return None;
    }
    // Each run has its own phase. The squared amplitude of noise alone is taken off.
    let runs: Vec<&Series> = train.runs.iter().chain(&confirm.runs).collect();
    let samples: f64 = runs.iter().map(|run| run.error_n.len() as f64).sum();
    let noise = f64::midpoint(train.noise(frequency_hz)?, confirm.noise(frequency_hz)?);
    let square: f64 =
        runs.iter().map(|run| run.amplitude(frequency_hz).powi(2) * run.error_n.len() as f64).sum();
    let amplitude = (square / samples - OF_NOISE * noise * runs.len() as f64 / samples).max(0.0).sqrt();
    let gain = train.gain(frequency_hz);
    let margin_n = 1.96 * (2.0 * noise / samples).sqrt() / gain;
    let spread: f64 = runs.iter().map(|run| run.error_n.len() as f64 * run.span_s().powi(2)).sum();
    let margin_hz = 1.96 * (6.0 * noise / spread).sqrt() / (PI * amplitude);
    let amplitude_n = amplitude / gain;
    Some(Hum {
        frequency_hz,
        frequency_ci95_hz: [frequency_hz - margin_hz, frequency_hz + margin_hz],
        amplitude_n,
        amplitude_ci95_n: [(amplitude_n - margin_n).max(0.0), amplitude_n + margin_n],
        p,
        share,
    })
}

/// One run.
struct Series {
    times_s: Vec<f64>,
    error_n: Vec<f64>,
    force_n: Vec<f64>,
}

impl Series {
    fn span_s(&self) -> f64 {
        self.times_s.last().copied().unwrap_or(0.0)
    }

    /// Hann window.
    fn window(&self, t_s: f64) -> f64 {
        0.5 - 0.5 * (TAU * t_s / self.span_s()).cos()
    }

    /// |X|².
    fn power(&self, hz: f64) -> f64 {
        let sum: Complex<f64> = self
            .times_s
            .iter()
            .zip(&self.error_n)
            .map(|(t_s, e)| Complex::from_polar(self.window(*t_s) * e, -TAU * hz * t_s))
            .sum();
        sum.norm_sqr()
    }

    /// Amplitude of the sine that fits best.
    fn amplitude(&self, hz: f64) -> f64 {
        let weights: f64 = self.times_s.iter().map(|t_s| self.window(*t_s)).sum();
        2.0 * self.power(hz).sqrt() / weights
    }
}

/// The spectra of some runs at one rate.
struct Spectrum {
    runs: Vec<Series>,
    conditioning: Conditioning,
    step_hz: f64,
    /// First and last frequency of the search, in steps.
    band: [usize; 2],
    error: Vec<f64>,
    force: Vec<f64>,
    /// Sum of the squared windows.
    windows: f64,
}

impl Spectrum {
    /// The spectra of what `model` leaves on the `rows` of the runs with the rate of the first one.
    fn new(rows: &Rows, model: &Augmented) -> Option<Self> {
        let fitted = Fitted::as_is(*model, rows)?;
        let first = rows.runs().first()?;
        let (rate_hz, conditioning) = (first.dataset.rate_hz, first.dataset.conditioning);
        let same = |run: &&RunRows| {
            (run.dataset.rate_hz / rate_hz - 1.0).abs() < 1e-3 && run.range.len() > 2 * NEARBY
        };
        let mut force_n = fitted.predicted_n;
        rows.centre(&mut force_n);
        let series = |run: &RunRows| {
            let times_s: Vec<f64> = run.times_s().collect();
            let start_s = times_s.first().copied().unwrap_or(0.0);
            Series {
                times_s: times_s.into_iter().map(|t_s| t_s - start_s).collect(),
                error_n: fitted.residual_n[run.range.clone()].to_vec(),
                force_n: force_n[run.range.clone()].to_vec(),
            }
        };
        let runs: Vec<Series> = rows.runs().iter().filter(same).map(series).collect();
        let longest_s = runs.iter().map(Series::span_s).fold(0.0, f64::max);
        if longest_s <= 0.0 {
            return None;
        }
        let length = (2.0 * longest_s * rate_hz).ceil() as usize;
        let length = length.next_power_of_two();
        let step_hz = rate_hz / length as f64;
        let plan = RealFftPlanner::<f64>::new().plan_fft_forward(length);
        let powers = |of: fn(&Series) -> &[f64]| {
            let mut sums = vec![0.0; length / 2 + 1];
            for run in &runs {
                let mut input = vec![0.0; length];
                for (t_s, value) in run.times_s.iter().zip(of(run)) {
                    let place = (t_s * rate_hz).round() as usize;
                    if let Some(place) = input.get_mut(place) {
                        *place += run.window(*t_s) * value;
                    }
                }
                let output = transform(&*plan, &input);
                sums.iter_mut().zip(&output).for_each(|(sum, x)| *sum += x.norm_sqr());
            }
            sums
        };
        let (error, force) = (powers(|run| &run.error_n), powers(|run| &run.force_n));
        let lowest_hz = LOWEST_HZ.max(LEAST_PERIODS / longest_s);
        let band = [lowest_hz, OF_RATE * rate_hz].map(|hz| (hz / step_hz) as usize);
        let windows =
            runs.iter().flat_map(|run| run.times_s.iter().map(|t_s| run.window(*t_s).powi(2))).sum();
        Some(Self { runs, conditioning, step_hz, band, error, force, windows })
    }

    /// Median of `powers` near the frequency with this index.
    fn median(powers: &[f64], index: usize) -> f64 {
        let range = index.saturating_sub(NEARBY).max(1)..(index + NEARBY + 1).min(powers.len());
        let mut near: Vec<f64> = powers[range].to_vec();
        near.sort_by(f64::total_cmp);
        near.get(near.len() / 2).copied().unwrap_or(f64::NAN)
    }

    /// Frequency of the highest line that the simulated force does not have, Hz.
    fn line(&self, most_in_force: f64) -> Option<f64> {
        let [first, last] = self.band;
        let over = |powers: &[f64], index| powers[index] / Self::median(powers, index);
        let own = |index: &usize| over(&self.force, *index) < most_in_force;
        let lines = (first..last.min(self.error.len())).map(|index| (index, over(&self.error, index)));
        let mut lines: Vec<(usize, f64)> = lines.filter(|(_, ratio)| ratio.is_finite()).collect();
        lines.sort_by(|(_, a), (_, b)| b.total_cmp(a));
        lines.iter().map(|(index, _)| *index).take(NEARBY).find(own).map(|index| index as f64 * self.step_hz)
    }

    fn power(&self, hz: f64) -> f64 {
        self.runs.iter().map(|run| run.power(hz)).sum()
    }

    /// Variance per sample of white noise with the level near `hz`, N².
    fn noise(&self, hz: f64) -> Option<f64> {
        let index = (hz / self.step_hz).round() as usize;
        let median = (index < self.error.len()).then(|| Self::median(&self.error, index))?;
        Some(median / (self.middle() * self.windows / self.runs.len() as f64))
    }

    /// Median of the sum of the runs' powers, in units of the mean of one.
    fn middle(&self) -> f64 {
        match self.runs.len() {
            1 => LN_2,
            runs => runs as f64 - 1.0 / 3.0 + 0.02 / runs as f64,
        }
    }

    /// Probability of the power at `hz` by chance.
    fn p(&self, hz: f64) -> Option<f64> {
        let mean = self.noise(hz)? * self.windows / self.runs.len() as f64;
        let x = self.power(hz) / mean;
        let mut term = 1.0;
        let mut sum = 1.0;
        for run in 1..self.runs.len() {
            term *= x / run as f64;
            sum += term;
        }
        Some(sum * (-x).exp())
    }

    /// Share of the squared error that the sine at `hz` is.
    fn share(&self, hz: f64) -> f64 {
        let squares = |run: &Series| dot(&run.error_n, &run.error_n);
        let whole: f64 = self.runs.iter().map(squares).sum();
        let own: f64 =
            self.runs.iter().map(|run| 0.5 * run.amplitude(hz).powi(2) * run.error_n.len() as f64).sum();
        own / whole
    }

    /// Gain of the filter of the measured force at `hz`.
    fn gain(&self, hz: f64) -> f64 {
        match self.conditioning.apply_to {
            ApplyTo::Output => 1.0 / (1.0 + (TAU * hz * self.conditioning.low_pass().tau_s()).powi(2)),
            _ => 1.0,
        }
    }
}
