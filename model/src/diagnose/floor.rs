//! The noise floor: the error that no model can remove.
//!
//! ```text
//! replicates   s^2 = mean over rows of the variance between runs of one pattern, each run's mean removed
//! estimated    s^2 = m_1^2 - (m_2^2 - m_1^2) / (g - 1), times the gain of the output filter;  m_1^2 if m_2 <= m_1
//!              g   = (m_4^2 - m_2^2) / (m_2^2 - m_1^2), at least 2 and at most 4
//!              m_k = median |difference of the force, of order p, over k samples| / (.6745 sqrt binomial(2 p, p))
//!              the largest s of p = 3, 4, 5;  unknown if s^2 <= 0 or s^2 > .05 of the variance of the force
//! inputs       q^2 = mean over rows of (M(x + e, i + u) - M(x, i))^2,   e, u drawn with the white noise of the channels
//! floor        s^2 + q^2, or the declared value                  LOF = 1 - N floor / sum r^2
//! ```
//!
//! Displacement noise becomes velocity noise, and through the model force noise, which a better model would not remove either.
//! It is therefore drawn, passed through conditioning and model, and added to the floor.
//!
//! A difference of high order removes the part that is smooth from sample to sample and leaves white noise times a known factor. The
//! median ignores the few rows on which the force jumps. The square of white noise is the same over 1, 2 and 4 samples. The rest of the
//! force itself, c_k, grows with the time between the samples: c_2 is 2 c_1 for jumps and 64 c_1 for a smooth force at order 3. The
//! growth gets less as the samples get coarser, so g is at most c_2 / c_1, and c_1 is at most (m_2^2 - m_1^2) / (g - 1).
//! Without it s is a lower bound. Jumps give the lower limit of g. The upper limit leaves a margin for a force without noise.
//!
//! If the force changes too fast for its sample rate, m_1 cannot be separated from the force itself. Then the floor is unknown, and
//! no part of the error counts as noise. The bound on the variance excludes signals that change so fast that all differences are alike.

use super::Settings;
use super::finding::{FloorSource, NoiseFloor};
use super::rows::{Rows, dot};
use crate::condition::{ApplyTo, Conditioning, LowPassState, MotionState};
use crate::effect::Augmented;
use crate::error::{DiagnosisError, Error};
use crate::identify::{Dataset, Row};
use crate::sample::Stamp;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Standard deviation of a normal variable over the median of its absolute value.
const OF_MEDIAN: f64 = 1.0 / 0.674_489_750_196_081_7;
/// Weights of the differences of order 3, 4 and 5. The squares of a row add up to binomial(2 p, p).
const DIFFERENCES: [&[f64]; 3] =
    [&[1.0, -3.0, 3.0, -1.0], &[1.0, -4.0, 6.0, -4.0, 1.0], &[1.0, -5.0, 10.0, -10.0, 5.0, -1.0]];
/// Least growth of the square of a signal's difference over twice the time, which jumps have.
const SLOWEST_GROWTH: f64 = 2.0;
/// Largest growth that an estimate relies on. A smooth signal has more.
const FASTEST_GROWTH: f64 = 4.0;
/// Largest share of a channel's variance that an estimate may call noise.
const NOISY: f64 = 0.05;
/// Samples of a filter's impulse response that its noise gain is computed from.
const RESPONSE: usize = 4096;

/// The noise floor of `rows` for `model`. Replicates take precedence over a declared value, and that over an estimate.
///
/// # Errors
/// [`Error::Diagnosis`] for replicates that do not match; [`Error::OutOfRange`] for a declared value that is not positive.
pub(super) fn noise_floor(
    rows: &Rows,
    model: &Augmented,
    replicates: &[Dataset],
    settings: &Settings,
) -> Result<NoiseFloor, Error> {
    let variance = rows.spread() / rows.len().max(1) as f64;
    let floor = |source, rsse_n: f64| NoiseFloor { source, rsse_n, esr: rsse_n * rsse_n / variance };
    let with_inputs = |rsse_n: f64| (rsse_n * rsse_n + of_inputs(rows, model, settings.seed)).sqrt();
    if !replicates.is_empty() {
        return Ok(floor(FloorSource::Replicates, with_inputs(of_replicates(replicates)?)));
    }
    if let Some(rsse_n) = settings.noise_floor_n {
        let rsse_n = Error::check("noise_floor", rsse_n, "positive and finite, in N", |n| n > 0.0)?;
        return Ok(floor(FloorSource::Declared, rsse_n));
    }
    let squares = rows.runs().iter().map(|run| {
        let dataset = run.dataset;
        let rsse_n =
            white_noise(dataset, |row| row.raw_force_n) * gain(&dataset.conditioning, dataset.rate_hz);
        rsse_n * rsse_n * run.indices.len() as f64
    });
    let squares = squares.sum::<f64>();
    // Runs that do not show their noise count as free of noise, so the sum stays a lower bound.
    if squares <= 0.0 {
        return Ok(NoiseFloor::UNKNOWN);
    }
    Ok(floor(FloorSource::Estimated, with_inputs((squares / rows.len().max(1) as f64).sqrt())))
}

/// Square root of the mean variance between runs of one pattern, N.
fn of_replicates(replicates: &[Dataset]) -> Result<f64, Error> {
    let [first, others @ ..] = replicates else { return Ok(0.0) };
    if others.is_empty() {
        return Err(DiagnosisError::OneReplicate { run: first.name.clone() }.into());
    }
    let aligned: Vec<Vec<Option<f64>>> =
        others.iter().map(|other| forces_at(first, other)).collect::<Result<_, _>>()?;
    let forces = |k: usize| {
        let others = aligned.iter().map(move |forces| forces[k]);
        std::iter::once(Some(first.rows[k].force_n).filter(|f| f.is_finite()))
            .chain(others)
            .collect::<Option<Vec<f64>>>()
    };
    let common: Vec<Vec<f64>> =
        (0..first.rows.len()).filter(|&k| first.rows[k].counts).filter_map(forces).collect();
    if common.is_empty() {
        return Err(DiagnosisError::NoCommonRow { run: first.name.clone() }.into());
    }
    let (rows, runs) = (common.len() as f64, replicates.len() as f64);
    let means: Vec<f64> =
        (0..replicates.len()).map(|run| common.iter().map(|row| row[run]).sum::<f64>() / rows).collect();
    let variance = |row: &Vec<f64>| {
        let own: Vec<f64> = row.iter().zip(&means).map(|(force, mean)| force - mean).collect();
        let mean = own.iter().sum::<f64>() / runs;
        own.iter().map(|force| (force - mean) * (force - mean)).sum::<f64>() / (runs - 1.0)
    };
    Ok((common.iter().map(variance).sum::<f64>() / rows).sqrt())
}

/// Force of `other` at the rows of `like`, matched by time since the first row; `None` where `other` has no force.
///
/// # Errors
/// [`DiagnosisError::DifferentMotion`].
pub(super) fn forces_at(like: &Dataset, other: &Dataset) -> Result<Vec<Option<f64>>, Error> {
    let start = |d: &Dataset| d.rows.first().map_or(Stamp::default(), |row| row.stamp);
    let (ours, theirs) = (start(like), start(other));
    let half_s = 0.5 / like.rate_hz.max(1.0);
    let (mut forces, mut at) = (Vec::with_capacity(like.rows.len()), 0);
    let (mut apart, mut spread, mut rows) = (0.0, 0.0, 0_u32);
    for row in &like.rows {
        let time_s = row.stamp.since(ours).get();
        let time_at = |k: usize| other.rows[k].stamp.since(theirs).get();
        while at < other.rows.len() && time_at(at) < time_s - half_s {
            at += 1;
        }
        let met = other.rows.get(at).filter(|_| (time_at(at) - time_s).abs() <= half_s);
        if let (Some(met), true) = (met, row.counts) {
            apart += (met.displacement_m - row.displacement_m).powi(2);
            spread += row.displacement_m.powi(2);
            rows += 1;
        }
        forces.push(met.map(|met| met.force_n).filter(|force| force.is_finite()));
    }
    if rows == 0 || apart > ALIKE * ALIKE * spread {
        return Err(DiagnosisError::DifferentMotion {
            runs: [like.name.clone(), other.name.clone()],
            difference: (apart / spread).sqrt(),
            most: ALIKE,
        }
        .into());
    }
    Ok(forces)
}

/// Largest difference between the displacements of runs of one pattern, root mean square, as a share of the displacement.
pub(super) const ALIKE: f64 = 0.1;

/// Mean squared change of the simulation of `model` when noise of the size that the inputs already have is added to them, N².
fn of_inputs(rows: &Rows, model: &Augmented, seed: u64) -> f64 {
    let noisy: Vec<Dataset> = rows
        .runs()
        .iter()
        .zip(0..)
        .map(|(run, stream)| with_noise(run.dataset, Pcg64Mcg::seed_from_u64(seed ^ stream)))
        .collect();
    let Some(plain_n) = rows.predict(model) else { return 0.0 };
    let squares = rows.runs().iter().zip(&noisy).filter_map(|(run, noisy)| {
        let moved_n = run.predict_on(model, noisy)?;
        let mut change: Vec<f64> =
            moved_n.iter().zip(&plain_n[run.range.clone()]).map(|(moved, plain)| moved - plain).collect();
        let mean = change.iter().sum::<f64>() / change.len().max(1) as f64;
        change.iter_mut().for_each(|value| *value -= mean);
        Some(dot(&change, &change))
    });
    squares.sum::<f64>() / rows.len().max(1) as f64
}

/// The run with white noise added to displacement and drive, of the size that each already has.
fn with_noise(dataset: &Dataset, mut random: Pcg64Mcg) -> Dataset {
    let (motion_m, drive) =
        (white_noise(dataset, |row| row.displacement_m), white_noise(dataset, |row| row.drive));
    // The sum of twelve uniform numbers has variance 1 and is close enough to normal.
    let mut normal = || (0..12).map(|_| random.random_range(-0.5..0.5)).sum::<f64>();
    let (filter, mut state) = (dataset.conditioning.low_pass(), MotionState::default());
    // If the inputs are filtered, the rows and the noise measured from them are behind the filter already.
    let conditioning = match dataset.conditioning.apply_to {
        ApplyTo::Inputs => Conditioning { apply_to: ApplyTo::None, ..dataset.conditioning },
        ApplyTo::Output | ApplyTo::None => dataset.conditioning,
    };
    let mut noisy = dataset.clone();
    for row in &mut noisy.rows {
        let error_m = motion_m * normal();
        // Conditioning is linear, so the error can be conditioned by itself. The error of a segment's first row has no velocity.
        if let Some(error) = conditioning.step(&filter, &mut state, row.dt_s, error_m, Some(0.0)) {
            row.velocity_m_s += error.velocity_m_s;
            let acceleration = error.acceleration_m_s2;
            row.acceleration_m_s2 += if acceleration.is_finite() { acceleration } else { 0.0 };
        }
        row.displacement_m += error_m;
        row.drive += drive * normal();
    }
    noisy
}

/// Lower bound of the white noise of a channel of a run, root mean square, in the channel's unit; 0 if the run shows none.
fn white_noise(dataset: &Dataset, channel: impl Fn(&Row) -> f64) -> f64 {
    let rows = &dataset.rows;
    let values: Vec<f64> =
        rows.iter().filter(|row| row.counts).map(&channel).filter(|v| v.is_finite()).collect();
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / values.len().max(1) as f64;
    let bound = |weights: &&[f64]| {
        let [one, two, four] = [1, 2, 4].map(|over| jitter(rows, &channel, weights, over).powi(2));
        let (first, second) = (two - one, four - two);
        let growth = (second / first).clamp(SLOWEST_GROWTH, FASTEST_GROWTH);
        if first > 0.0 { one - first / (growth - 1.0) } else { one }
    };
    let square = DIFFERENCES.iter().map(bound).fold(0.0, f64::max);
    if square > 0.0 && square <= NOISY * variance { square.sqrt() } else { 0.0 }
}

/// Median size of the difference of a channel with these weights, one every `over` samples, as the root mean square of the white noise
/// that causes it.
fn jitter(rows: &[Row], channel: impl Fn(&Row) -> f64, weights: &[f64], over: usize) -> f64 {
    let span = (weights.len() - 1) * over;
    let difference = |k: usize| {
        let sum =
            weights.iter().enumerate().map(|(n, weight)| weight * channel(&rows[k + n * over])).sum::<f64>();
        let within = (1..=span).all(|n| rows[k + n].dt_s.is_some()) && rows[k].counts;
        Some(sum.abs()).filter(|d| within && d.is_finite())
    };
    let mut differences: Vec<f64> = (0..rows.len().saturating_sub(span)).filter_map(difference).collect();
    if differences.is_empty() {
        return 0.0;
    }
    let middle = differences.len() / 2;
    let (_, median, _) = differences.select_nth_unstable_by(middle, f64::total_cmp);
    *median * OF_MEDIAN / dot(weights, weights).sqrt()
}

/// Share of white noise that the output filter lets through, root mean square; 1 without a filter.
fn gain(conditioning: &Conditioning, rate_hz: f64) -> f64 {
    if conditioning.apply_to != ApplyTo::Output || rate_hz <= 0.0 {
        return 1.0;
    }
    let (filter, mut state) = (conditioning.low_pass(), LowPassState::default());
    filter.step(&mut state, None, 0.0);
    let response =
        (0..RESPONSE).map(|k| filter.step(&mut state, Some(1.0 / rate_hz), if k == 0 { 1.0 } else { 0.0 }));
    response.map(|h| h * h).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::DatasetOptions;
    use crate::rig::{Channels, Experiment, Plant, record};

    /// A run of 20 s on the rig, in which only the force has noise, as rows at `rate_hz`.
    fn rows(experiment: &str, plant: &Plant, force_noise_n: f64, rate_hz: f64, seed: u64) -> Dataset {
        let experiment = Experiment::thesis(experiment).expect("a thesis experiment").with_duration_s(20.0);
        let channels = Channels { force_noise_n, ..Channels::PERFECT };
        let run = record(&experiment, plant, &channels, seed);
        let options = DatasetOptions { rate_hz: Some(rate_hz), ..DatasetOptions::default() };
        Dataset::from_run(&run, &Conditioning::default(), &options).expect("rows")
    }

    const EXPERIMENTS: [&str; 3] = ["RP-ICPS", "RP-APRBS", "RP3-CS"];
    const RATES_HZ: [f64; 5] = [512.0, 256.0, 128.0, 64.0, 32.0];

    /// Prints the estimate of each kind of run at each rate, and runs `check` on it.
    fn each(force_noise_n: f64, check: impl Fn(f64, f64, &str)) {
        for (plant, name) in [(Plant::plain(), "Bouc-Wen"), (Plant::quasi_static(), "quasi-static")] {
            for experiment in EXPERIMENTS {
                for rate_hz in RATES_HZ {
                    for seed in 0..2 {
                        let rows = rows(experiment, &plant, force_noise_n, rate_hz, seed);
                        let found = white_noise(&rows, |row| row.raw_force_n);
                        println!("{force_noise_n} N, {name} {experiment} {rate_hz} Hz: {found:.3} N");
                        check(found, rate_hz, &format!("{name} {experiment} {rate_hz} Hz {seed}: {found} N"));
                    }
                }
            }
        }
    }

    #[test]
    fn a_run_without_noise_shows_no_noise_at_any_rate() {
        each(0.0, |found, _, what| assert!(found == 0.0, "{what}"));
    }

    #[test]
    fn the_estimate_is_a_lower_bound_of_known_noise_at_any_rate() {
        for noise_n in [3.0, 30.0] {
            each(noise_n, |found, rate_hz, what| {
                assert!(found <= 1.08 * noise_n, "{what}, {noise_n} N of noise");
                assert!(rate_hz < 512.0 || found >= 0.88 * noise_n, "{what}, {noise_n} N of noise");
            });
        }
    }
}
