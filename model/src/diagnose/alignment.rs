//! A reference run placed on a run of the same excitation.
//!
//! ```text
//! cyclic motion   t = t0 + (k + a) P,   t' = t0' + (k mod n' + a) P' + tau       k: cycle, a: crank angle in turns, P: period
//! other motion    t' = t + tau
//! force           F'(t'), straight between the samples of the reference          '  of the reference, which has n' cycles
//! ```
//!
//! tau minimises the difference of the displacements, each with its mean removed: the displacement sensors of two sessions have different
//! zeros, and recordings begin at different instants. An error of 10 ms would be a change of phase, which looks like friction. Of a motion
//! that is not cyclic, tau is first searched in steps over 10 s.
//!
//! The runs have one excitation if the displacements differ by at most 5 % then, and the drives by at most 10 %, root mean square. The
//! periods of cyclic motions may differ by 2 %.

use super::cycle::{Cycles, times_s};
use crate::identify::{Dataset, Row};

/// Largest difference between the displacements, root mean square, as a share of the displacement.
pub(super) const ALIKE: f64 = 0.05;
/// The same for the drives.
const ALIKE_DRIVE: f64 = 0.1;
/// Largest relative difference between the periods of two cyclic motions. A machine that runs faster makes the same displacement at each
/// crank angle, but another velocity.
const SAME_PERIOD: f64 = 0.02;
/// Largest difference in time that is searched, s.
const REACH_S: f64 = 10.0;
/// Step of that search, s.
const STEP_S: f64 = 0.04;
/// Least share of the shorter of the two that must have the other.
const LEAST_COVER: f64 = 0.5;
/// Steps of Gauss-Newton that refine tau.
const REFINEMENTS: usize = 4;
/// A time this near to a sample, as a share of the step, takes that sample: a mean of two samples has less noise than one.
const AT_SAMPLE: f64 = 0.02;

/// How a reference run was placed on a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// Name of the run.
    pub run: String,
    /// Name of the reference run.
    pub reference: String,
    /// Period of the motion if the runs were aligned by crank angle, s; `None` if they were aligned by time.
    pub period_s: Option<f64>,
    /// Time of the reference minus time of the run at the run's first row, each counted from its own first row, s.
    pub lag_s: f64,
    /// Mean displacement of the run minus mean displacement of the reference, m: the zeros of their sensors differ by this.
    pub offset_m: f64,
    /// Difference between the displacements that is left, root mean square, as a share of the displacement.
    pub difference: f64,
}

/// A reference run on the rows of a run.
pub(super) struct Aligned {
    pub(super) alignment: Alignment,
    /// The reference at each row of the run; `None` where it has no rows.
    pub(super) at: Vec<Option<Between>>,
    /// The cycles of the run, if its motion is cyclic.
    pub(super) cycles: Option<Cycles>,
}

/// A time between two rows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Between {
    /// The row after it.
    after: usize,
    /// Weight of the row after it; the row before has the rest.
    weight: f64,
}

impl Between {
    /// The value of a channel of `run` there; not finite if it is not known.
    pub(super) fn of(self, run: &Dataset, channel: impl Fn(&Row) -> f64) -> f64 {
        self.interpolated(|k| channel(&run.rows[k]))
    }

    /// The value of a series with one value for each row.
    pub(super) fn of_series(self, series: &[f64]) -> f64 {
        self.interpolated(|k| series[k])
    }

    /// Between the values of two rows, given by their indices.
    fn interpolated(self, value: impl Fn(usize) -> f64) -> f64 {
        let after = value(self.after);
        if self.weight == 1.0 {
            return after;
        }
        let before = value(self.after - 1);
        before + self.weight * (after - before)
    }
}

/// The time of the reference for each time of the run, both counted from the first row.
#[derive(Debug, Clone, Copy)]
struct Clock {
    /// The cycles of run and reference, if both motions are cyclic.
    cycles: Option<[Cycles; 2]>,
    offset_s: f64,
}

impl Clock {
    /// `None` outside of the whole cycles of a cyclic motion: before and after them the machine starts and stops.
    fn there_s(&self, time_s: f64) -> Option<f64> {
        let Some([ours, theirs]) = &self.cycles else { return Some(time_s + self.offset_s) };
        let number = ours.number(time_s)?;
        let turns = ours.turns(time_s) - number as f64 + (number % theirs.count) as f64;
        Some(theirs.start_s + turns * theirs.period_s + self.offset_s)
    }

    /// Time of the reference at the first row of the run.
    fn lag_s(&self) -> f64 {
        let cyclic = |[ours, theirs]: [Cycles; 2]| theirs.start_s + ours.turns(0.0) * theirs.period_s;
        self.cycles.map_or(0.0, cyclic) + self.offset_s
    }
}

/// Places `reference` on `run`; `None` if they do not have one excitation.
pub(super) fn align(run: &Dataset, reference: &Dataset) -> Option<Aligned> {
    let times: Vec<f64> = times_s(run).collect();
    let of_reference: Vec<f64> = times_s(reference).collect();
    let cycles = Cycles::of(run).zip(Cycles::of(reference)).map(|(ours, theirs)| [ours, theirs]);
    let offset_s = match cycles {
        Some([ours, theirs]) if (theirs.period_s / ours.period_s - 1.0).abs() > SAME_PERIOD => return None,
        Some(_) => 0.0,
        None => coarse_lag_s(run, &times, reference, &of_reference)?,
    };
    let mut clock = Clock { cycles, offset_s };
    let places = |clock: Clock| {
        let place = |time_s: &f64| place(clock.there_s(*time_s)?, &of_reference, reference);
        times.iter().map(place).collect::<Vec<_>>()
    };
    for _ in 0..REFINEMENTS {
        clock.offset_s += correction_s(run, reference, &places(clock))?;
    }
    let at = places(clock);
    let displacement = Difference::between(pairs(run, &at), reference, |row| row.displacement_m);
    let drive_alike = run.drive.is_none()
        || Difference::between(pairs(run, &at), reference, |row| row.drive).of_size() <= ALIKE_DRIVE;
    let shorter = run.counted().min(reference.counted()) as f64;
    let alike =
        displacement.rows >= LEAST_COVER * shorter && displacement.of_spread() <= ALIKE && drive_alike;
    alike.then(|| Aligned {
        alignment: Alignment {
            run: run.name.clone(),
            reference: reference.name.clone(),
            period_s: cycles.map(|[ours, _]| ours.period_s),
            lag_s: clock.lag_s(),
            offset_m: displacement.mean,
            difference: displacement.of_spread(),
        },
        at,
        cycles: cycles.map(|[ours, _]| ours),
    })
}

/// The rows of `reference`, which are at `of_reference`, around the time `there_s`.
fn place(there_s: f64, of_reference: &[f64], reference: &Dataset) -> Option<Between> {
    let after = of_reference.partition_point(|time_s| *time_s < there_s);
    let (Some(next_s), Some(last)) = (of_reference.get(after), after.checked_sub(1)) else {
        // At the ends, a sample counts if it is at this time.
        let step_s = 1.0 / reference.rate_hz.max(1.0);
        let end = after.min(of_reference.len().checked_sub(1)?);
        let near = (of_reference[end] - there_s).abs() <= AT_SAMPLE * step_s;
        return near.then_some(Between { after: end, weight: 1.0 });
    };
    let weight = (there_s - of_reference[last]) / (next_s - of_reference[last]);
    if weight >= 1.0 - AT_SAMPLE {
        return Some(Between { after, weight: 1.0 });
    }
    if weight <= AT_SAMPLE {
        return Some(Between { after: last, weight: 1.0 });
    }
    // Nothing is known within a gap.
    reference.rows[after].dt_s.is_some().then_some(Between { after, weight })
}

/// Time of the reference minus time of the run, s, at which displacement and drive differ least; `None` if they have no common time.
fn coarse_lag_s(run: &Dataset, times: &[f64], reference: &Dataset, of_reference: &[f64]) -> Option<f64> {
    let end_s = of_reference.last()?;
    let grid: Vec<f64> = (0..=(end_s / STEP_S) as usize).map(|k| k as f64 * STEP_S).collect();
    let coarse: Vec<Option<Between>> =
        grid.iter().map(|time_s| place(*time_s, of_reference, reference)).collect();
    // One row of the run in each step, with the number of the step.
    let mut step = i64::MIN;
    let rows: Vec<(i64, usize)> = times
        .iter()
        .enumerate()
        .filter(|(k, _)| run.rows[*k].counts)
        .map(|(k, time_s)| ((time_s / STEP_S).round() as i64, k))
        .filter(|(here, _)| std::mem::replace(&mut step, *here) != *here)
        .collect();
    let reach = (REACH_S / STEP_S) as i64;
    let difference = |lag: i64| {
        let of_rows = rows.iter().filter_map(|(step, k)| {
            let there = usize::try_from(step + lag).ok()?;
            Some((&run.rows[*k], (*coarse.get(there)?)?))
        });
        let displacement = Difference::between(of_rows.clone(), reference, |row| row.displacement_m);
        if displacement.rows < LEAST_COVER * rows.len().min(coarse.len()) as f64 {
            return None;
        }
        let drive = match run.drive {
            Some(_) => Difference::between(of_rows, reference, |row| row.drive).of_size(),
            None => 0.0,
        };
        Some((lag, displacement.of_spread().powi(2) + drive * drive))
    };
    let found = (-reach..=reach).filter_map(difference).min_by(|(_, a), (_, b)| a.total_cmp(b));
    found.map(|(lag, _)| lag as f64 * STEP_S)
}

/// The change of the reference's time that brings the displacements closer, s: one step of Gauss-Newton.
fn correction_s(run: &Dataset, reference: &Dataset, at: &[Option<Between>]) -> Option<f64> {
    let mean_m = Difference::between(pairs(run, at), reference, |row| row.displacement_m).mean;
    let (mut with_speed, mut of_speed) = (0.0, 0.0);
    for (row, at) in pairs(run, at) {
        let apart_m = row.displacement_m - at.of(reference, |row| row.displacement_m) - mean_m;
        let velocity_m_s = at.of(reference, |row| row.velocity_m_s);
        if (apart_m * velocity_m_s).is_finite() {
            with_speed += apart_m * velocity_m_s;
            of_speed += velocity_m_s * velocity_m_s;
        }
    }
    (of_speed > 0.0).then_some(with_speed / of_speed)
}

/// Rows of the run that count, each with its place in the reference.
fn pairs<'a>(
    run: &'a Dataset,
    at: &'a [Option<Between>],
) -> impl Iterator<Item = (&'a Row, Between)> + Clone {
    run.rows.iter().zip(at).filter(|(row, _)| row.counts).filter_map(|(row, at)| Some((row, (*at)?)))
}

/// The difference of a channel between a run and its reference, where both are known.
struct Difference {
    /// Number of rows.
    rows: f64,
    /// Mean of run minus reference.
    mean: f64,
    /// Sum of the squared difference, and without its mean.
    squares: f64,
    apart: f64,
    /// Sum of the run's squares, and without their mean.
    size: f64,
    spread: f64,
}

impl Difference {
    fn between<'a>(
        pairs: impl Iterator<Item = (&'a Row, Between)> + Clone,
        reference: &Dataset,
        channel: impl Fn(&Row) -> f64,
    ) -> Self {
        let values = pairs
            .map(|(row, at)| (channel(row), channel(row) - at.of(reference, &channel)))
            .filter(|(value, apart)| value.is_finite() && apart.is_finite());
        let (mut rows, mut sum, mut sum_apart) = (0.0_f64, 0.0, 0.0);
        for (value, apart) in values.clone() {
            rows += 1.0;
            sum += value;
            sum_apart += apart;
        }
        let (middle, mean) = (sum / rows.max(1.0), sum_apart / rows.max(1.0));
        let zero = Self { rows, mean, squares: 0.0, apart: 0.0, size: 0.0, spread: 0.0 };
        values.fold(zero, |sums, (value, apart)| Self {
            squares: sums.squares + apart * apart,
            apart: sums.apart + (apart - mean).powi(2),
            size: sums.size + value * value,
            spread: sums.spread + (value - middle).powi(2),
            ..sums
        })
    }

    /// Root mean square without its mean, as a share of the run's.
    fn of_spread(&self) -> f64 {
        ratio(self.apart, self.spread)
    }

    /// Root mean square as a share of the run's; zero if both are zero.
    fn of_size(&self) -> f64 {
        ratio(self.squares, self.size)
    }
}

/// Root of the ratio; zero without any difference.
fn ratio(squares: f64, of: f64) -> f64 {
    if squares == 0.0 { 0.0 } else { (squares / of).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::condition::Conditioning;
    use crate::identify::DatasetOptions;
    use crate::rig::{Channels, Experiment, Plant, record};

    /// Rows of `experiment`, from row `from` on, with the displacement shifted.
    fn rows(experiment: &Experiment, seed: u64, from: usize, shift_m: f64) -> Dataset {
        let run = record(experiment, &Plant::default(), &Channels::default(), seed);
        let mut rows =
            Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default()).expect("rows");
        rows.rows.drain(..from);
        rows.rows[0].dt_s = None;
        rows.rows.iter_mut().for_each(|row| row.displacement_m += shift_m);
        rows
    }

    fn thesis(name: &str) -> Experiment {
        Experiment::thesis(name).expect("an experiment of the thesis").with_duration_s(20.0)
    }

    /// Root mean square of the force's difference, N.
    fn apart_n(run: &Dataset, reference: &Dataset, found: &Aligned) -> f64 {
        let force = Difference::between(pairs(run, &found.at), reference, |row| row.force_n);
        (force.apart / force.rows).sqrt()
    }

    #[test]
    fn recordings_that_begin_at_different_instants_are_aligned_by_time() {
        let (run, reference) = (rows(&thesis("RP-ICPS"), 1, 0, 0.0), rows(&thesis("RP-ICPS"), 1, 700, 0.002));
        let found = align(&run, &reference).expect("one excitation");
        let Alignment { period_s, lag_s, offset_m, difference, .. } = found.alignment;
        assert_eq!(period_s, None);
        assert!((lag_s + 700.0 / 512.0).abs() < 1e-4, "{lag_s} s");
        assert!((offset_m + 0.002).abs() < 1e-5 && difference < 1e-3, "{offset_m} m, {difference}");
        assert!(found.at[..600].iter().all(Option::is_none), "the reference begins later");
        assert!(apart_n(&run, &reference, &found) < 1e-6, "the samples are the same");
    }

    #[test]
    fn cyclic_runs_are_aligned_by_crank_angle() {
        // The reference is a little slower, and begins at another angle.
        let sine = |frequency_hz| Experiment::sine(0.01, frequency_hz, 1.2, 12.0);
        let (run, reference) = (rows(&sine(2.0), 1, 0, 0.0), rows(&sine(1.99), 2, 333, 0.002));
        let found = align(&run, &reference).expect("one excitation");
        assert!((found.alignment.period_s.expect("cyclic") - 0.5).abs() < 1e-3);
        assert!(found.alignment.difference < 0.01, "{:?}", found.alignment);
        // By time they would be apart by a third of a turn at the end.
        assert!(apart_n(&run, &reference, &found) < 40.0, "{} N", apart_n(&run, &reference, &found));
    }

    #[test]
    fn a_reference_with_fewer_cycles_is_used_again() {
        let sine = |duration_s, seed| rows(&Experiment::sine(0.01, 2.0, 1.2, duration_s), seed, 0, 0.0);
        let (run, reference) = (sine(20.0, 1), sine(5.0, 2));
        let found = align(&run, &reference).expect("one excitation");
        let with_reference = found.at.iter().flatten().count() as f64;
        assert!(with_reference > 0.9 * run.rows.len() as f64, "{with_reference} of {}", run.rows.len());
        assert!(apart_n(&run, &reference, &found) < 40.0, "{} N", apart_n(&run, &reference, &found));
    }

    #[test]
    fn another_motion_or_another_current_is_not_aligned() {
        let sine =
            |amplitude_m, current_a| rows(&Experiment::sine(amplitude_m, 2.0, current_a, 6.0), 1, 0, 0.0);
        let run = sine(0.01, 1.2);
        assert!(align(&run, &sine(0.01, 1.2)).is_some());
        assert!(align(&run, &sine(0.012, 1.2)).is_none(), "a larger stroke");
        assert!(align(&run, &sine(0.01, 1.6)).is_none(), "a larger current");
        let faster = rows(&Experiment::sine(0.01, 3.0, 1.2, 6.0), 1, 0, 0.0);
        assert!(align(&run, &faster).is_none(), "the same at each crank angle, but faster");
        assert!(align(&rows(&thesis("RP-ICPS"), 1, 0, 0.0), &rows(&thesis("RP-APRBS"), 1, 0, 0.0)).is_none());
    }
}
