//! The cycles of a periodic motion, as on a scotch yoke or a crank.
//!
//! ```text
//! t_k    upward crossings of the middle of the stroke
//! t_k  = t_0 + k P + e_k        t_0 and the period P by least squares
//! angle of a time t             (t - t_0) / P, in turns
//! ```
//!
//! A run is cyclic if the crossings are regular, and if every cycle has the displacement and the drive of the mean cycle. Cycles at the
//! start and the end whose stroke is not the usual one are left out: the machine starts and stops there.

use crate::identify::{Dataset, Row};

/// Least number of whole cycles.
const LEAST_CYCLES: usize = 2;
/// Share of the stroke, to either side of its middle, that the displacement must leave between two crossings. Noise is less.
const HYSTERESIS: f64 = 0.1;
/// Largest root mean square of e_k, as a share of the period.
const REGULAR: f64 = 0.01;
/// Largest difference of a channel from its mean cycle, root mean square, as a share of its own.
const ALIKE: f64 = 0.05;
/// Points of the mean cycle in that comparison.
const POINTS: usize = 64;

/// The cycles of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cycles {
    /// Period, s.
    pub(super) period_s: f64,
    /// Time of the first upward crossing since the first row, s.
    pub(super) start_s: f64,
    /// Number of whole cycles after that.
    pub(super) count: usize,
}

impl Cycles {
    /// The cycles of `run`; `None` if its motion is not periodic.
    pub(super) fn of(run: &Dataset) -> Option<Self> {
        let moving = || run.rows.iter().filter(|row| row.counts);
        let low = moving().map(|row| row.displacement_m).fold(f64::INFINITY, f64::min);
        let high = moving().map(|row| row.displacement_m).fold(f64::NEG_INFINITY, f64::max);
        let middle_m = f64::midpoint(low, high);
        let times_s = crossings(run, middle_m, HYSTERESIS * (high - low));
        let times_s = full_strokes(run, &times_s);
        let count = times_s.len().checked_sub(1).filter(|count| *count >= LEAST_CYCLES)?;
        // Least squares of t_k over k.
        let middle = 0.5 * count as f64;
        let mean_s = times_s.iter().sum::<f64>() / times_s.len() as f64;
        let (mut with_k, mut of_k) = (0.0, 0.0);
        for (k, time_s) in times_s.iter().enumerate() {
            with_k += (k as f64 - middle) * (time_s - mean_s);
            of_k += (k as f64 - middle).powi(2);
        }
        let period_s = with_k / of_k;
        let cycles = Self { period_s, start_s: mean_s - middle * period_s, count };
        let error = |(k, time_s): (usize, &f64)| (time_s - cycles.start_s - k as f64 * period_s).powi(2);
        let errors: f64 = times_s.iter().enumerate().map(error).sum();
        let regular = (errors / times_s.len() as f64).sqrt() <= REGULAR * period_s;
        let repeats = |channel: fn(&Row) -> f64| cycles.repeats(run, channel);
        (regular && repeats(|row| row.displacement_m) && (run.drive.is_none() || repeats(|row| row.drive)))
            .then_some(cycles)
    }

    /// Angle at `time_s` since the first row, in turns since the first crossing.
    pub(super) fn turns(&self, time_s: f64) -> f64 {
        (time_s - self.start_s) / self.period_s
    }

    /// Number of the whole cycle at `time_s`, from 0; `None` outside of the whole cycles.
    pub(super) fn number(&self, time_s: f64) -> Option<usize> {
        let turns = self.turns(time_s);
        (turns >= 0.0 && turns < self.count as f64).then_some(turns as usize)
    }

    /// The mean cycle of a series of times and values, at `POINTS` points.
    pub(super) fn mean<const POINTS: usize>(
        self,
        series: impl Iterator<Item = (f64, f64)>,
    ) -> MeanCycle<POINTS> {
        let mut mean = MeanCycle { cycles: self, values: [0.0; POINTS] };
        let mut counts = [0.0_f64; POINTS];
        for (time_s, value) in series {
            let point = mean.point(time_s);
            mean.values[point] += value;
            counts[point] += 1.0;
        }
        mean.values.iter_mut().zip(counts).for_each(|(sum, count)| *sum /= count.max(1.0));
        mean
    }

    /// True if a channel is the same in all cycles.
    fn repeats(&self, run: &Dataset, channel: fn(&Row) -> f64) -> bool {
        let inside: Vec<(f64, f64)> = times_s(run)
            .zip(run.rows.iter().map(channel))
            .filter(|(time_s, value)| self.number(*time_s).is_some() && value.is_finite())
            .collect();
        let values = || inside.iter().map(|(_, value)| value);
        let mean = values().sum::<f64>() / inside.len().max(1) as f64;
        let cycle: MeanCycle<POINTS> = self.mean(inside.iter().copied());
        let apart: f64 = inside.iter().map(|(time_s, value)| (value - cycle.at(*time_s)).powi(2)).sum();
        let spread: f64 = values().map(|value| (value - mean).powi(2)).sum();
        let size: f64 = values().map(|value| value * value).sum();
        // A constant channel has no spread; its noise is small beside its size.
        !inside.is_empty() && (apart <= ALIKE * ALIKE * spread || apart <= (0.2 * ALIKE).powi(2) * size)
    }
}

/// A series as a function of the crank angle: its mean over the cycles.
pub(super) struct MeanCycle<const POINTS: usize> {
    cycles: Cycles,
    values: [f64; POINTS],
}

impl<const POINTS: usize> MeanCycle<POINTS> {
    /// The value at the angle of `time_s`; zero where the series had no value.
    pub(super) fn at(&self, time_s: f64) -> f64 {
        self.values[self.point(time_s)]
    }

    fn point(&self, time_s: f64) -> usize {
        (self.cycles.turns(time_s).rem_euclid(1.0) * POINTS as f64) as usize % POINTS
    }
}

/// The crossings `times_s` without those before and after cycles whose stroke is not the usual one.
fn full_strokes<'a>(run: &Dataset, times_s: &'a [f64]) -> &'a [f64] {
    let mut ends = vec![(f64::INFINITY, f64::NEG_INFINITY); times_s.len().saturating_sub(1)];
    let mut cycle = 0;
    for (time_s, row) in self::times_s(run).zip(&run.rows) {
        while times_s.get(cycle + 1).is_some_and(|end_s| *end_s <= time_s) {
            cycle += 1;
        }
        if let Some((low, high)) = ends.get_mut(cycle).filter(|_| time_s >= times_s[cycle]) {
            (*low, *high) = (low.min(row.displacement_m), high.max(row.displacement_m));
        }
    }
    let strokes: Vec<f64> = ends.iter().map(|(low, high)| high - low).collect();
    let mut sorted = strokes.clone();
    sorted.sort_by(f64::total_cmp);
    let Some(usual) = sorted.get(sorted.len() / 2) else { return times_s };
    let is_usual = |stroke: &f64| (stroke - usual).abs() <= ALIKE * usual;
    let first = strokes.iter().position(is_usual).unwrap_or(0);
    let last = strokes.iter().rposition(is_usual).unwrap_or(0);
    &times_s[first..=last + 1]
}

/// Time of each row since the first, s.
pub(super) fn times_s(run: &Dataset) -> impl Iterator<Item = f64> {
    run.rows.iter().map(|row| row.stamp.since(run.rows[0].stamp).get())
}

/// Times of the upward crossings of `middle_m` while the damper moves, s since the first row. Between two of them the displacement leaves
/// the band of `band_m` to either side.
fn crossings(run: &Dataset, middle_m: f64, band_m: f64) -> Vec<f64> {
    let mut found = Vec::new();
    let (mut armed, mut candidate, mut before) = (false, None, None);
    for (time_s, row) in times_s(run).zip(&run.rows) {
        let x = row.displacement_m - middle_m;
        if !row.counts || !x.is_finite() {
            (armed, candidate, before) = (false, None, None);
            continue;
        }
        if x < -band_m {
            (armed, candidate) = (true, None);
        }
        if let Some((time_before_s, x_before)) =
            before.filter(|(_, x_before)| armed && *x_before < 0.0 && x >= 0.0)
        {
            let share: f64 = x_before / (x_before - x);
            // The last crossing before the band is left upwards counts.
            candidate = Some(time_before_s + share * (time_s - time_before_s));
        }
        if x > band_m && armed {
            found.extend(candidate.take());
            armed = false;
        }
        before = Some((time_s, x));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::condition::Conditioning;
    use crate::identify::DatasetOptions;
    use crate::rig::{Channels, Experiment, Plant, record};

    fn rows(experiment: &Experiment) -> Dataset {
        let run = record(experiment, &Plant::default(), &Channels::default(), 3);
        Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default()).expect("rows")
    }

    #[test]
    fn a_sine_is_cyclic_and_a_random_motion_is_not() {
        let found = Cycles::of(&rows(&Experiment::sine(0.01, 2.0, 1.2, 6.0))).expect("a sine");
        assert!((found.period_s - 0.5).abs() < 1e-4, "{found:?}");
        assert!((10..=12).contains(&found.count), "{found:?}");
        for name in ["RP-ICPS", "RP-APRBS"] {
            let random = Experiment::thesis(name).expect("an experiment of the thesis").with_duration_s(10.0);
            assert_eq!(Cycles::of(&rows(&random)), None, "{name}");
        }
    }

    #[test]
    fn a_current_that_changes_from_cycle_to_cycle_is_not_cyclic() {
        let mut run = rows(&Experiment::sine(0.01, 2.0, 1.2, 6.0));
        let middle = run.rows.len() / 2;
        run.rows[middle..].iter_mut().for_each(|row| row.drive += 0.5);
        assert_eq!(Cycles::of(&run), None);
    }
}
