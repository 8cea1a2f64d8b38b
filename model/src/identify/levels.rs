//! Membership centres and widths, chosen from the drive in the runs.
//!
//! - A few levels (with noise, and ramps between them): one set per level, sigma half their spacing.
//! - A current that varies freely over 0 to 2.5 A: the thesis' seven sets.
//! - Anything else (a voltage, another range): seven sets evenly over the range, sigma half their spacing.
//!
//! Levels are found greedily. The window of a fixed width that contains the most samples is a level. Its
//! samples are removed, and the search repeats until the fullest window is nearly empty. Neighbours without a
//! valley between them are merged as one noisy level. The drive has levels if a few narrow levels contain
//! nearly all samples; a freely varying drive gives adjacent windows without valleys.

use super::dataset::Dataset;
use crate::error::{Error, IdentifyError};
use crate::force::{FuzzySets, MAX_FUNCTIONS, Membership};
use crate::preset::{CENTRES_A, SIGMA_A};
use crate::sample::DriveKind;

/// Largest number of levels that counts as "a few".
const MAX_LEVELS: usize = 8;
/// Largest number of windows; a noisy level may need several.
const MAX_WINDOWS: usize = 3 * MAX_LEVELS;
/// Half width of a level's window, as a share of the drive's range.
const WINDOW_SHARE: f64 = 0.03;
/// Smallest half width of a window, A or V: drivers and their measurement have more noise than a share of a
/// small range.
const WINDOW_LEAST: f64 = 0.02;
/// Smallest share of all samples in one level.
const LEVEL_SHARE: f64 = 0.02;
/// Smallest share of all samples in the levels together.
const LEVELS_SHARE: f64 = 0.85;
/// Share of samples at either end that is excluded from the range (overshoot, spikes).
const TAIL: f64 = 0.005;
/// Smallest number of rows per parameter.
const ROWS_PER_PARAMETER: usize = 10;
/// Number of sets over a range other than the thesis' range.
const EVEN_SETS: usize = 7;

/// Membership functions over the drive, and their source.
///
/// ```
/// use mr_damper_model::identify::{MembershipSource, Memberships};
/// use mr_damper_model::sample::DriveKind;
///
/// // The current of the run has two levels, so there are two sets. Their width is half the distance.
/// let current_a = (0..1000).map(|k| if k < 500 { 0.0 } else { 1.0 });
/// let found = Memberships::from_drive(DriveKind::CoilCurrent, current_a)?;
/// assert_eq!((found.source, found.sets.centres()), (MembershipSource::Levels, &[0.0, 1.0][..]));
/// assert_eq!(found.sets.sigmas(), [0.5, 0.5]);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Memberships {
    /// The sets.
    pub sets: FuzzySets,
    /// Source of the sets.
    pub source: MembershipSource,
}

/// Source of membership functions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MembershipSource {
    /// Given by the caller.
    Given,
    /// One set for each level in the data.
    Levels,
    /// The thesis' centres and width.
    Thesis,
    /// Spaced evenly over the range of the data.
    Even,
    /// Identified together with the model.
    Identified,
}

impl Memberships {
    /// Refuses data that do not cover each set, which has `per_set` parameters.
    pub(super) fn check_support(&self, datasets: &[Dataset], per_set: usize) -> Result<(), Error> {
        let sets = &self.sets;
        let mut support = vec![0.0; sets.len()];
        let counted = datasets.iter().flat_map(|d| &d.rows).filter(|row| row.counts && row.drive.is_finite());
        for row in counted {
            support.iter_mut().zip(sets.weights(row.drive)).for_each(|(sum, weight)| *sum += weight);
        }
        let least = (per_set * ROWS_PER_PARAMETER) as f64;
        let poor = support.iter().zip(sets.centres()).find(|(support, _)| **support < least);
        let Some((support, centre)) = poor else { return Ok(()) };
        Err(IdentifyError::EmptySet { drive: sets.drive(), centre: *centre, weight: *support, needed: least }
            .into())
    }

    /// Chooses centres and widths for drive values in A or V, in any order; non-finite values are ignored.
    ///
    /// If levels are unequally spaced, sigma is half the mean spacing but at most the smallest spacing, so
    /// that neighbouring sets stay distinct. With one level there is one set, which is valid for any drive.
    ///
    /// # Errors
    /// [`IdentifyError::NoDrive`] without values.
    pub fn from_drive(kind: DriveKind, values: impl IntoIterator<Item = f64>) -> Result<Self, Error> {
        let values = Values::new(kind, values)?;
        let [low, high] = values.range();
        let (centres, sigma, source) = if let Some(levels) = find_levels(&values.sorted, high - low) {
            let sigma = level_sigma(&levels);
            (levels, sigma, MembershipSource::Levels)
        } else if kind == DriveKind::CoilCurrent && fills_thesis_range(low, high) {
            (CENTRES_A.to_vec(), SIGMA_A, MembershipSource::Thesis)
        } else {
            return values.evenly(EVEN_SETS);
        };
        Ok(Self { sets: FuzzySets::new(Membership { drive: kind, sigma }, &centres)?, source })
    }

    /// `count` sets evenly over the range of the drive values in A or V, which may be in any order;
    /// non-finite values are ignored. Sigma is half the spacing.
    ///
    /// # Errors
    /// [`IdentifyError::NoDrive`] without values; [`IdentifyError::ConstantDrive`] if they are constant; [`Error::Length`] for more than
    /// [`MAX_FUNCTIONS`] sets or fewer than two.
    pub fn even(kind: DriveKind, values: impl IntoIterator<Item = f64>, count: usize) -> Result<Self, Error> {
        if !(2..=MAX_FUNCTIONS).contains(&count) {
            return Err(Error::Length {
                name: "sets".to_owned(),
                found: count,
                expected: format!("2 to {MAX_FUNCTIONS}"),
            });
        }
        Values::new(kind, values)?.evenly(count)
    }

    /// Levels of drive values in A or V, in any order; `None` if the drive varies continuously.
    pub(super) fn levels(kind: DriveKind, values: impl IntoIterator<Item = f64>) -> Option<Vec<f64>> {
        let values = Values::new(kind, values).ok()?;
        let [low, high] = values.range();
        find_levels(&values.sorted, high - low)
    }

    /// Uses the given centres; without `sigma`, its value follows the rule for levels.
    ///
    /// # Errors
    /// Without centres or with too many, if they do not increase, or if a number is invalid.
    pub fn given(kind: DriveKind, centres: &[f64], sigma: Option<f64>) -> Result<Self, Error> {
        let name = |j: usize| format!("centres[{j}]");
        if centres.is_empty() || centres.len() > MAX_FUNCTIONS {
            return Err(Error::Length {
                name: "centres".to_owned(),
                found: centres.len(),
                expected: format!("1 to {MAX_FUNCTIONS}"),
            });
        }
        Error::check(&name(0), centres[0], "finite", |_| true)?;
        for (j, pair) in centres.windows(2).enumerate() {
            Error::check(&name(j + 1), pair[1], "greater than the centre before it", |c| c > pair[0])?;
        }
        let sigma = sigma.unwrap_or_else(|| level_sigma(centres));
        Error::check("sigma", sigma, "positive and finite", |s| s > 0.0)?;
        let sets = FuzzySets::new(Membership { drive: kind, sigma }, centres)?;
        Ok(Self { sets, source: MembershipSource::Given })
    }
}

/// Values of a drive.
struct Values {
    kind: DriveKind,
    /// At least one value, all finite.
    sorted: Vec<f64>,
}

impl Values {
    fn new(kind: DriveKind, values: impl IntoIterator<Item = f64>) -> Result<Self, Error> {
        let mut sorted: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
        if sorted.is_empty() {
            return Err(IdentifyError::NoDrive { drive: kind }.into());
        }
        sorted.sort_by(f64::total_cmp);
        Ok(Self { kind, sorted })
    }

    /// Range of the values without outliers.
    fn range(&self) -> [f64; 2] {
        let quantile = |q: f64| self.sorted[((self.sorted.len() - 1) as f64 * q).round() as usize];
        [quantile(TAIL), quantile(1.0 - TAIL)]
    }

    fn evenly(&self, count: usize) -> Result<Memberships, Error> {
        let [low, high] = self.range();
        let spacing = (high - low) / (count - 1) as f64;
        if spacing <= 0.0 {
            return Err(IdentifyError::ConstantDrive { drive: self.kind, value: low }.into());
        }
        let centres: Vec<f64> = (0..count).map(|j| low + spacing * j as f64).collect();
        let membership = Membership { drive: self.kind, sigma: spacing / 2.0 };
        Ok(Memberships { sets: FuzzySets::new(membership, &centres)?, source: MembershipSource::Even })
    }
}

/// True when every set of the thesis gets data: both ends of the range lie within one sigma of the outer
/// centres.
fn fills_thesis_range(low: f64, high: f64) -> bool {
    let (first, last) = (CENTRES_A[0], CENTRES_A[CENTRES_A.len() - 1]);
    (low - first).abs() <= SIGMA_A && (high - last).abs() <= SIGMA_A
}

/// Half the mean spacing, at most the smallest spacing; the thesis' width for a single level, where the width
/// has no effect.
fn level_sigma(levels: &[f64]) -> f64 {
    let spacings = levels.windows(2).map(|pair| pair[1] - pair[0]);
    let smallest = spacings.fold(f64::INFINITY, f64::min);
    match levels {
        [first, .., last] => (0.5 * (last - first) / (levels.len() - 1) as f64).min(smallest),
        _ => SIGMA_A,
    }
}

/// A level and the samples in its window.
struct Level {
    centre: f64,
    /// Centres of its first and last window.
    span: [f64; 2],
    count: usize,
}

/// Levels of sorted `values`, in increasing order; `None` if the drive varies continuously.
fn find_levels(values: &[f64], range: f64) -> Option<Vec<f64>> {
    let half = (WINDOW_SHARE * range).max(WINDOW_LEAST);
    let total = values.len() as f64;
    let mut rest = values.to_vec();
    let mut found: Vec<Level> = Vec::new();
    while found.len() < MAX_WINDOWS {
        let (start, end) = fullest_window(&rest, 2.0 * half);
        if ((end - start).max(1) as f64) < LEVEL_SHARE * total {
            break;
        }
        // The median: ramps that cross the window shift it less than a mean.
        let centre = rest[usize::midpoint(start, end)];
        found.push(Level { centre, span: [centre; 2], count: end - start });
        rest.drain(start..end);
        if rest.is_empty() {
            break;
        }
    }
    if ((values.len() - rest.len()) as f64) < LEVELS_SHARE * total {
        return None;
    }
    found.sort_by(|a, b| a.centre.total_cmp(&b.centre));
    let mut levels: Vec<Level> = Vec::new();
    for level in found {
        match levels.last_mut() {
            // The tail of a noisy level looks like another level next to it, without a valley between them.
            Some(last) if level.centre - last.span[1] < 3.0 * half && !valley(values, last, &level) => {
                if level.count > last.count {
                    last.centre = level.centre;
                }
                last.span[1] = level.centre;
                last.count += level.count;
            }
            _ => levels.push(level),
        }
    }
    let narrow = levels.iter().all(|level| level.span[1] - level.span[0] <= 5.0 * half);
    (narrow && levels.len() <= MAX_LEVELS).then(|| levels.iter().map(|level| level.centre).collect())
}

/// True when the middle half of the interval between two levels is nearly empty.
fn valley(values: &[f64], a: &Level, b: &Level) -> bool {
    let quarter = 0.25 * (b.centre - a.span[1]);
    let below = |limit: f64| values.partition_point(|v| *v < limit);
    let between = below(b.centre - quarter) - below(a.span[1] + quarter);
    between * 20 < a.count.min(b.count)
}

/// The window of at most `width` that contains the most of the sorted `values`, as a range of indices.
fn fullest_window(values: &[f64], width: f64) -> (usize, usize) {
    let (mut best, mut start) = ((0, 0), 0);
    for (k, value) in values.iter().enumerate() {
        while value - values[start] > width {
            start += 1;
        }
        if k + 1 - start > best.1 - best.0 {
            best = (start, k + 1);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    /// `count` values around `level`, uniform noise of half width `noise`.
    fn around(level: f64, noise: f64, count: usize, random: &mut Pcg64Mcg) -> Vec<f64> {
        (0..count).map(|_| level + noise * (2.0 * random.random::<f64>() - 1.0)).collect()
    }

    fn found(kind: DriveKind, values: Vec<f64>) -> Memberships {
        Memberships::from_drive(kind, values).expect("values")
    }

    fn assert_levels(found: &Memberships, levels: &[f64], tolerance: f64) {
        assert_eq!(found.source, MembershipSource::Levels, "{found:?}");
        assert_eq!(found.sets.len(), levels.len(), "{found:?}");
        assert!(
            found.sets.centres().iter().zip(levels).all(|(a, b)| (a - b).abs() <= tolerance),
            "{found:?}"
        );
    }

    #[test]
    fn a_few_levels_are_found_despite_noise_ramps_and_spikes() {
        let mut random = Pcg64Mcg::seed_from_u64(1);
        for noise in [0.0, 0.005, 0.04] {
            for levels in
                [&[0.0, 0.25, 0.5, 0.75, 1.0][..], &[0.0, 2.25], &[0.0, 0.8712, 1.98, 3.2], &[0.0, 0.5]]
            {
                let mut values: Vec<f64> =
                    levels.iter().flat_map(|level| around(*level, noise, 4000, &mut random)).collect();
                // Ramps over the full range, 3 % of all samples, and a few spikes.
                let (top, ramp) = (levels[levels.len() - 1], values.len() * 3 / 100);
                values.extend((0..ramp).map(|_| top * random.random::<f64>()));
                values.extend([top + 1.0, -0.7, 9.0]);
                let found = found(DriveKind::CommandVoltage, values);
                assert_levels(&found, levels, 0.02 + noise);
            }
        }
    }

    #[test]
    fn sigma_is_half_the_mean_spacing_and_at_most_the_smallest() {
        assert!((level_sigma(&[0.0, 0.25, 0.5]) - 0.125).abs() < 1e-12);
        assert!((level_sigma(&[0.0, 0.8712, 1.98, 3.2]) - 3.2 / 6.0).abs() < 1e-12);
        assert!((level_sigma(&[0.0, 0.2, 3.0]) - 0.2).abs() < 1e-12);
    }

    #[test]
    fn levels_of_different_duration_are_found() {
        let mut random = Pcg64Mcg::seed_from_u64(2);
        let mut values = around(0.0, 0.003, 30_000, &mut random);
        values.extend(around(1.2, 0.003, 1000, &mut random));
        values.extend(around(2.0, 0.003, 9000, &mut random));
        assert_levels(&found(DriveKind::CoilCurrent, values), &[0.0, 1.2, 2.0], 0.01);
    }

    #[test]
    fn one_level_gives_one_function() {
        let mut random = Pcg64Mcg::seed_from_u64(3);
        for (level, noise) in [(0.0, 0.0), (0.0, 0.004), (0.5, 0.03), (1.98, 0.001), (2.5, 0.04)] {
            let found = found(DriveKind::CoilCurrent, around(level, noise, 5000, &mut random));
            assert_levels(&found, &[level], noise.max(1e-9));
            assert!(found.sets.sigmas()[0] > 0.0);
        }
    }

    #[test]
    fn a_freely_varying_current_over_the_thesis_range_gets_the_thesis_sets() {
        let mut random = Pcg64Mcg::seed_from_u64(4);
        let uniform: Vec<f64> = (0..20_000).map(|_| 2.5 * random.random::<f64>()).collect();
        let sine: Vec<f64> = (0..20_000).map(|k| 1.25 + 1.25 * (f64::from(k) * 0.01).sin()).collect();
        // Steps of random height, as in an amplitude-modulated random binary signal.
        let steps: Vec<f64> = (0..60)
            .flat_map(|_| {
                let level = 2.5 * random.random::<f64>();
                around(level, 0.002, 300, &mut random)
            })
            .collect();
        for values in [uniform, sine, steps] {
            let found = found(DriveKind::CoilCurrent, values);
            assert_eq!(found.source, MembershipSource::Thesis);
            assert_eq!((found.sets.centres(), found.sets.sigmas()), (&CENTRES_A[..], &[SIGMA_A; 7][..]));
        }
    }

    #[test]
    fn another_range_or_unit_gets_evenly_spaced_sets() {
        let mut random = Pcg64Mcg::seed_from_u64(5);
        for (kind, low, high) in [
            (DriveKind::CommandVoltage, 0.0, 2.5),
            (DriveKind::CommandVoltage, -10.0, 10.0),
            (DriveKind::CoilCurrent, 0.0, 1.0),
            (DriveKind::CoilCurrent, 0.0, 6.0),
            (DriveKind::CoilCurrent, 0.2, 0.5),
        ] {
            let found =
                found(kind, (0..20_000).map(|_| low + (high - low) * random.random::<f64>()).collect());
            assert_eq!((found.source, found.sets.len()), (MembershipSource::Even, EVEN_SETS), "{found:?}");
            let spacing = (high - low) / 6.0;
            for (j, centre) in found.sets.centres().iter().enumerate() {
                assert!((centre - low - spacing * j as f64).abs() < 0.1 * spacing, "{found:?}");
            }
            assert!((found.sets.sigmas()[0] / spacing - 0.5).abs() < 0.01, "{found:?}");
        }
    }

    #[test]
    fn missing_or_constant_values_are_an_error() {
        let error = Memberships::from_drive(DriveKind::CoilCurrent, [f64::NAN]).expect_err("no values");
        assert!(error.to_string().contains("current_a"));
        assert!(Memberships::given(DriveKind::CoilCurrent, &[], None).is_err());
        assert!(Memberships::given(DriveKind::CoilCurrent, &[0.0, 1.0], Some(0.0)).is_err());
        let given = Memberships::given(DriveKind::CoilCurrent, &[0.0, 1.0], None).expect("sets");
        assert_eq!((given.source, given.sets.sigmas()[0]), (MembershipSource::Given, 0.5));
        assert!(Memberships::even(DriveKind::CoilCurrent, [0.5; 9], 3).is_err(), "no range");
        assert!(Memberships::even(DriveKind::CoilCurrent, [0.0, 1.0], 1).is_err());
        let even = Memberships::even(DriveKind::CoilCurrent, [0.0, 1.0], 3).expect("sets");
        assert_eq!((even.sets.centres(), even.sets.sigmas()), (&[0.0, 0.5, 1.0][..], &[0.25; 3][..]));
    }
}
