//! Membership centres and width, from the drive that the runs hold.
//!
//! - A few levels (with noise, and ramps between them): a set at each level, sigma half their spacing.
//! - A current that roams over 0 to 2.5 A: the thesis' seven sets.
//! - Anything else (a voltage, another range): seven sets evenly over the range, sigma half their spacing.
//!
//! Levels are found greedily. The window of a fixed width that holds the most samples is a level; its samples
//! are taken out; and so on until a window holds next to nothing. Neighbours without a valley between them
//! are one noisy level. When nearly all samples are held by a few narrow levels, the drive has levels; a
//! drive that roams has windows side by side without valleys.

use super::dataset::Dataset;
use crate::error::Error;
use crate::force::{FuzzySets, MAX_FUNCTIONS, Membership};
use crate::preset::{CENTRES_A, SIGMA_A};
use crate::sample::DriveKind;

/// The most levels that pass for "a few".
const MAX_LEVELS: usize = 8;
/// The most windows to look at: a noisy level may take several.
const MAX_WINDOWS: usize = 3 * MAX_LEVELS;
/// Half width of a level's window as a share of the drive's range.
const WINDOW_SHARE: f64 = 0.03;
/// Least half width of a window, A or V: drivers and their measurement are noisier than a share of a small
/// range.
const WINDOW_LEAST: f64 = 0.02;
/// Share of all samples that a level must hold.
const LEVEL_SHARE: f64 = 0.02;
/// Share of all samples that levels must hold together.
const LEVELS_SHARE: f64 = 0.85;
/// Samples beyond these quantiles at either end (overshoot, spikes) do not make the range.
const TAIL: f64 = 0.005;
/// Rows that a parameter wants at least.
const ROWS_PER_PARAMETER: usize = 10;
/// Sets over a range that is not the thesis'.
const EVEN_SETS: usize = 7;

/// Membership functions over the drive, and how they came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Memberships {
    /// The sets.
    pub sets: FuzzySets,
    /// Where they come from.
    pub source: MembershipSource,
}

/// Where membership functions come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MembershipSource {
    /// Given by the caller.
    Given,
    /// The levels that the data hold.
    Levels,
    /// The thesis' centres and width.
    Thesis,
    /// Evenly over the range of the data.
    Even,
    /// Sought together with the model.
    Identified,
}

impl Memberships {
    /// Refuses data that some set, with `per_set` parameters under it, hardly sees.
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
        Err(Error::Data {
            message: format!(
                "too few samples near {} = {centre:.3}: they weigh {support:.1}, but a function needs {least}; add \
                 runs, or choose membership centres that the runs reach",
                sets.drive()
            ),
        })
    }

    /// Chooses centres and width for drive values in A or V, in any order; those not finite are left out.
    ///
    /// With levels of unequal spacing sigma is half the mean spacing, but never more than the smallest one,
    /// so that the sets of neighbours stay distinct. With one level there is one set, which holds for any
    /// drive.
    ///
    /// # Errors
    /// [`Error::Data`] when there are no values.
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

    /// `count` sets evenly over the range of drive values in A or V, in any order; those not finite are left out.
    /// Sigma is half the spacing.
    ///
    /// # Errors
    /// [`Error::Data`] when there are no values, or they do not vary; [`Error::Length`] for more than
    /// [`MAX_FUNCTIONS`] sets, or fewer than two.
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

    /// Levels that drive values in A or V take on, in any order; `None` when they roam.
    pub(super) fn levels(kind: DriveKind, values: impl IntoIterator<Item = f64>) -> Option<Vec<f64>> {
        let values = Values::new(kind, values).ok()?;
        let [low, high] = values.range();
        find_levels(&values.sorted, high - low)
    }

    /// Takes centres as given; without `sigma`, by the rule for levels.
    ///
    /// # Errors
    /// When there are no centres or too many, when they do not increase, or when a number means nothing.
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
    /// At least one, all finite.
    sorted: Vec<f64>,
}

impl Values {
    fn new(kind: DriveKind, values: impl IntoIterator<Item = f64>) -> Result<Self, Error> {
        let mut sorted: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
        if sorted.is_empty() {
            return Err(Error::Data {
                message: format!("there are no {kind} values to place memberships by"),
            });
        }
        sorted.sort_by(f64::total_cmp);
        Ok(Self { kind, sorted })
    }

    /// Ends of the values, strays left out.
    fn range(&self) -> [f64; 2] {
        let quantile = |q: f64| self.sorted[((self.sorted.len() - 1) as f64 * q).round() as usize];
        [quantile(TAIL), quantile(1.0 - TAIL)]
    }

    fn evenly(&self, count: usize) -> Result<Memberships, Error> {
        let [low, high] = self.range();
        let spacing = (high - low) / (count - 1) as f64;
        if spacing <= 0.0 {
            return Err(Error::Data {
                message: format!(
                    "{} stays at {low}: {count} sets cannot stand side by side; add runs at other levels",
                    self.kind
                ),
            });
        }
        let centres: Vec<f64> = (0..count).map(|j| low + spacing * j as f64).collect();
        let membership = Membership { drive: self.kind, sigma: spacing / 2.0 };
        Ok(Memberships { sets: FuzzySets::new(membership, &centres)?, source: MembershipSource::Even })
    }
}

/// True when every set of the thesis sees data: the range reaches within a sigma of both outer centres, and
/// leaves them by no more.
fn fills_thesis_range(low: f64, high: f64) -> bool {
    let (first, last) = (CENTRES_A[0], CENTRES_A[CENTRES_A.len() - 1]);
    (low - first).abs() <= SIGMA_A && (high - last).abs() <= SIGMA_A
}

/// Half the mean spacing, not more than the smallest; the thesis' for a single level, where it does not
/// matter.
fn level_sigma(levels: &[f64]) -> f64 {
    let spacings = levels.windows(2).map(|pair| pair[1] - pair[0]);
    let smallest = spacings.fold(f64::INFINITY, f64::min);
    match levels {
        [first, .., last] => (0.5 * (last - first) / (levels.len() - 1) as f64).min(smallest),
        _ => SIGMA_A,
    }
}

/// A level and the samples that its window held.
struct Level {
    centre: f64,
    /// Centres of the first and the last window that make it up.
    span: [f64; 2],
    count: usize,
}

/// Levels of sorted `values`, increasing; `None` when they roam.
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
        // The median: ramps that pass through the window pull it less than a mean.
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
            // The tail of a noisy level passes for a level of its own, next to it and with no valley between.
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

/// True when the middle half of the way between two levels is nearly empty.
fn valley(values: &[f64], a: &Level, b: &Level) -> bool {
    let quarter = 0.25 * (b.centre - a.span[1]);
    let below = |limit: f64| values.partition_point(|v| *v < limit);
    let between = below(b.centre - quarter) - below(a.span[1] + quarter);
    between * 20 < a.count.min(b.count)
}

/// The window no wider than `width` that holds the most of sorted `values`, as a range of indices.
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
    fn a_few_levels_are_found_through_noise_ramps_and_spikes() {
        let mut random = Pcg64Mcg::seed_from_u64(1);
        for noise in [0.0, 0.005, 0.04] {
            for levels in
                [&[0.0, 0.25, 0.5, 0.75, 1.0][..], &[0.0, 2.25], &[0.0, 0.8712, 1.98, 3.2], &[0.0, 0.5]]
            {
                let mut values: Vec<f64> =
                    levels.iter().flat_map(|level| around(*level, noise, 4000, &mut random)).collect();
                // Ramps from end to end, 3 % of all, and a few spikes.
                let (top, ramp) = (levels[levels.len() - 1], values.len() * 3 / 100);
                values.extend((0..ramp).map(|_| top * random.random::<f64>()));
                values.extend([top + 1.0, -0.7, 9.0]);
                let found = found(DriveKind::CommandVoltage, values);
                assert_levels(&found, levels, 0.02 + noise);
            }
        }
    }

    #[test]
    fn sigma_is_half_the_spacing_but_never_more_than_the_smallest() {
        assert!((level_sigma(&[0.0, 0.25, 0.5]) - 0.125).abs() < 1e-12);
        assert!((level_sigma(&[0.0, 0.8712, 1.98, 3.2]) - 3.2 / 6.0).abs() < 1e-12);
        assert!((level_sigma(&[0.0, 0.2, 3.0]) - 0.2).abs() < 1e-12);
    }

    #[test]
    fn levels_of_unlike_length_count() {
        let mut random = Pcg64Mcg::seed_from_u64(2);
        let mut values = around(0.0, 0.003, 30_000, &mut random);
        values.extend(around(1.2, 0.003, 1000, &mut random));
        values.extend(around(2.0, 0.003, 9000, &mut random));
        assert_levels(&found(DriveKind::CoilCurrent, values), &[0.0, 1.2, 2.0], 0.01);
    }

    #[test]
    fn one_level_is_one_function() {
        let mut random = Pcg64Mcg::seed_from_u64(3);
        for (level, noise) in [(0.0, 0.0), (0.0, 0.004), (0.5, 0.03), (1.98, 0.001), (2.5, 0.04)] {
            let found = found(DriveKind::CoilCurrent, around(level, noise, 5000, &mut random));
            assert_levels(&found, &[level], noise.max(1e-9));
            assert!(found.sets.sigmas()[0] > 0.0);
        }
    }

    #[test]
    fn a_roaming_current_over_the_thesis_range_has_the_thesis_sets() {
        let mut random = Pcg64Mcg::seed_from_u64(4);
        let uniform: Vec<f64> = (0..20_000).map(|_| 2.5 * random.random::<f64>()).collect();
        let sine: Vec<f64> = (0..20_000).map(|k| 1.25 + 1.25 * (f64::from(k) * 0.01).sin()).collect();
        // Steps of random height, as an amplitude-modulated random binary signal has them.
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
    fn another_range_or_unit_is_covered_evenly() {
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
    fn nothing_to_go_by_is_an_error() {
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
