//! Coverage: the share of measured forces within the uncertainty bands of a live pipeline.

use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{Event, Mode, Models, Pipeline, Settings};
use mr_damper_model::rig::{Channels, Drift, Experiment, Pattern, Plant, record};
use mr_damper_model::sample::{Channel, Run, Stamp};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::ops::RangeInclusive;

/// Experiments with random motion and a random current.
pub(crate) const RANDOM: [&str; 2] = ["RP-ICPS", "RP-APRBS"];

/// Replicates of both experiments on a rig with drift: each has its own pattern, temperature, strength and offset.
pub(crate) fn generated(replicates: RangeInclusive<u32>, set: u64) -> Vec<Run> {
    let mut runs = Vec::new();
    for name in RANDOM {
        let plan = Experiment::thesis(name).expect("one of the thesis").with_duration_s(30.0);
        for number in replicates.clone() {
            let (experiment, seed) = plan.replicate(number, set, Pattern::New);
            let (plant, channels) = Drift::default().apply(Plant::default(), Channels::default(), seed);
            runs.push(record(&experiment, &plant, &channels, seed));
        }
    }
    runs
}

/// The input that is removed for intervals of random length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Away {
    None,
    Force,
    Drive,
}

/// An estimate compared with the measured force at its stamp.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    pub(crate) mode: Mode,
    pub(crate) inside: bool,
    pub(crate) calibrated: bool,
    pub(crate) error_n: f64,
    pub(crate) std_dev_n: f64,
    /// Width of the band, N. With all inputs present and in one mode, each region has a different width.
    pub(crate) width_n: f64,
    /// Time since the newest force before the force at this stamp, by the run's stamps, s.
    pub(crate) coast_s: f64,
    pub(crate) drive_age_s: f64,
}

/// Intervals without the input, as start and end in s. Each lasts up to 0.3 s (0.33 s if only few fit); between them the input is present
/// for `with_s` to `with_s` + 0.45 s.
fn gone(run: &Run, seed: u64, with_s: f64) -> Vec<(f64, f64)> {
    let longest_s = if with_s > 1.0 { 0.33 } else { 0.3 };
    let mut random = Pcg64Mcg::seed_from_u64(seed ^ 0x5eed);
    // The start is random, so that in periodic runs the losses are not all at one phase.
    let first = if with_s > 1.0 { with_s + random.random::<f64>() } else { 0.45 + with_s };
    let (mut at, mut stretches) = (first, Vec::new());
    while at < run.duration().get() {
        let long = longest_s * random.random::<f64>();
        stretches.push((at, at + long));
        at += long + with_s + 0.45 * random.random::<f64>();
    }
    stretches
}

/// The rows of `run` from a live pipeline: all that have an estimate.
pub(crate) fn cover(model: &Model, run: &Run, away: Away, seed: u64) -> Vec<Row> {
    let first = run.displacement_m.stamps[0];
    // The pipeline does not use a force at once that is lost again within 2 s. Losses are spaced so that each counts as a first loss.
    let stretches = gone(run, seed, if away == Away::Force { 2.1 } else { 0.05 });
    let lost = |stamp: Stamp| {
        let t = stamp.since(first).get();
        stretches.get(stretches.partition_point(|(_, end)| *end <= t)).is_some_and(|(begin, _)| t >= *begin)
    };
    let force = run.force_n.as_ref().expect("force");
    let mut pipeline = Pipeline::new(Models::alone(*model), Settings::default()).expect("a model that runs");
    let (mut rows, mut last_force, mut before) = (Vec::new(), first, first);
    for sample in run.samples() {
        let channel = sample.reading.channel();
        let of = match away {
            Away::None => false,
            Away::Force => channel == Channel::Force,
            Away::Drive => channel == Channel::Drive,
        };
        if of && lost(sample.stamp) {
            continue;
        }
        if channel == Channel::Force {
            (before, last_force) = (last_force, sample.stamp);
        }
        pipeline.step(&sample, &mut |event| {
            let Event::Estimate(e) = event else { return };
            let Ok(at) = force.stamps.binary_search(&e.stamp) else { return };
            if !e.force.is_finite() {
                return;
            }
            let measured_n = force.values[at];
            let seed = if last_force == e.stamp { before } else { last_force };
            rows.push(Row {
                mode: e.mode,
                inside: e.band[0].get() <= measured_n && measured_n <= e.band[1].get(),
                calibrated: e.calibrated,
                error_n: measured_n - e.force.get(),
                std_dev_n: e.std_dev.get(),
                width_n: e.band[1].get() - e.band[0].get(),
                coast_s: e.stamp.since(seed).get(),
                drive_age_s: e.input_age.get(),
            });
        });
    }
    rows
}

/// Counts over the calibrated rows: rows inside their band, and errors in standard deviations.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Tally {
    pub(crate) rows: usize,
    pub(crate) inside: usize,
    pub(crate) squares: f64,
}

impl Tally {
    pub(crate) fn of<'a>(rows: impl Iterator<Item = &'a Row>) -> Self {
        let mut tally = Self::default();
        for row in rows.filter(|row| row.calibrated) {
            tally.rows += 1;
            tally.inside += usize::from(row.inside);
            tally.squares += (row.error_n / row.std_dev_n).powi(2);
        }
        tally
    }

    pub(crate) fn coverage(&self) -> f64 {
        self.inside as f64 / self.rows as f64
    }

    /// Root mean square of the error divided by its standard deviation.
    pub(crate) fn normalised(&self) -> f64 {
        (self.squares / self.rows as f64).sqrt()
    }

    pub(crate) fn text(&self) -> String {
        format!("{:.1} % of {} rows, {:.2} deviations", 100.0 * self.coverage(), self.rows, self.normalised())
    }
}
