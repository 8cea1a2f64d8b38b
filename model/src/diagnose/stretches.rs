//! Stretches of long runs, on which a diagnosis searches.
//!
//! ```text
//! length         of a stretch: 16 s, less if there are many runs, at least 4 s
//! count          number of stretches of a run: its share of most samples / (length + 4 s), at least one
//! stretch        one in each of count groups of the run's samples that count, and 4 s before; its place in the group moves on by the golden ratio
//! ```
//!
//! A search simulates its runs thousands of times. If there are more samples than [`Settings::most_samples`], it therefore uses stretches from all
//! over the runs. Base and model are fitted to all samples afterwards ([`super::completion`]). The time before a stretch is simulated and not
//! counted: lags and hysteresis settle in it. With 1 s in place of 4 s, the error of a Bouc-Wen model on runs of a test bench is a tenth too
//! large.
//!
//! Time, path, energy and the rise of the temperature count from the start of a run. They are known where a stretch begins ([`Past`]); the energy
//! is computed from the measured force. Between stretches nothing is known, so no term is searched that changes and changes back there.
//!
//! The places in the groups differ because a test programme may repeat with the period of the groups.
//!
//! [`Past`]: crate::effect::term::Past

use super::completion::Completion;
use super::{DiagnosisResult, Runs, Settings, Stage};
use crate::effect::term::Signals;
use crate::error::Error;
use crate::identify::{Dataset, Row, Watch};
use std::borrow::Cow;

/// Length of a stretch, s: the least if there are many runs, and the most.
const LENGTH_S: [f64; 2] = [4.0, 16.0];
/// Time before it that is simulated too, s.
const SETTLING_S: f64 = 4.0;
/// Step of the places in the groups: the golden ratio.
const PLACE: f64 = 0.618_033_988_749_895;

/// Runs by purpose, with stretches of those that are too long for a search.
pub(super) struct Stretches<'a> {
    runs: Runs<'a>,
    /// Training, validation and healthy runs.
    short: [Cow<'a, [Dataset]>; 3],
}

/// The part of the training runs that a search used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Searched {
    /// Time that counts in the stretches, s.
    pub used_s: f64,
    /// The same of all training runs, s.
    pub of_s: f64,
}

impl<'a> Stretches<'a> {
    /// `runs` with at most about `most` samples of each purpose.
    pub(super) fn new(runs: &Runs<'a>, most: usize) -> Self {
        Self {
            runs: *runs,
            short: [runs.estimate, runs.confirm, runs.healthy].map(|all| shortened(all, most)),
        }
    }

    /// True if no run is too long.
    pub(super) fn are_whole_runs(&self) -> bool {
        self.short.iter().all(|runs| matches!(runs, Cow::Borrowed(_)))
    }

    /// The runs of the search. If some are stretches, they have no test runs: these are read after the completion.
    pub(super) fn runs(&self) -> Runs<'_> {
        let [estimate, confirm, healthy] = &self.short;
        let test = if self.are_whole_runs() { self.runs.test } else { &[] };
        Runs { estimate, confirm, healthy, test, ..self.runs }
    }

    /// `found`, which was searched on [`Stretches::runs`], on all runs.
    pub(super) fn complete(
        &self,
        found: DiagnosisResult,
        settings: &Settings,
        watch: &Watch,
        stage: &dyn Fn(Stage),
    ) -> Result<DiagnosisResult, Error> {
        if self.are_whole_runs() {
            return Ok(found);
        }
        stage(Stage::Completion);
        let completed = Completion::new(&self.runs, settings, watch)?.on_all(found)?;
        Ok(DiagnosisResult { searched: Some(self.searched()), ..completed })
    }

    /// The part of the training runs that the search uses.
    fn searched(&self) -> Searched {
        let counted_s = |runs: &[Dataset]| -> f64 {
            runs.iter().filter(|run| run.rate_hz > 0.0).map(|run| run.counted() as f64 / run.rate_hz).sum()
        };
        Searched { used_s: counted_s(&self.short[0]), of_s: counted_s(self.runs.estimate) }
    }
}

/// `runs`, or stretches of each of them if they have more than `most` samples.
fn shortened(runs: &[Dataset], most: usize) -> Cow<'_, [Dataset]> {
    let seconds = |run: &Dataset| if run.rate_hz > 0.0 { run.rows.len() as f64 / run.rate_hz } else { 0.0 };
    let samples: usize = runs.iter().map(|run| run.rows.len()).sum();
    let all_s: f64 = runs.iter().map(seconds).sum();
    if samples <= most || all_s == 0.0 {
        return Cow::Borrowed(runs);
    }
    let most_s = all_s * most as f64 / samples as f64;
    let [least_s, longest_s] = LENGTH_S;
    let length_s = (most_s / runs.len() as f64 - SETTLING_S).clamp(least_s, longest_s);
    let mut number = 0;
    let short = runs.iter().map(|run| {
        let [length, settling] = [length_s, SETTLING_S].map(|time_s| (time_s * run.rate_hz) as usize);
        let count = (most_s / (length_s + SETTLING_S) * seconds(run) / all_s).round().max(1.0) as usize;
        let last = run.counted().saturating_sub(length) as f64;
        let group = run.counted() as f64 / count as f64;
        let first = |k: usize| {
            let place = ((number + k) as f64 * PLACE).fract();
            (k as f64 * group + place * (group - length as f64).max(0.0)).min(last) as usize
        };
        let firsts: Vec<usize> = (0..count).map(first).collect();
        number += count;
        cut(run, &firsts, length, settling)
    });
    Cow::Owned(short.collect())
}

/// The stretches of `run` that begin with the counted samples of these numbers, in order, and have `length` of them.
fn cut(run: &Dataset, firsts: &[usize], length: usize, settling: usize) -> Dataset {
    let counted: Vec<usize> = (0..run.rows.len()).filter(|k| run.rows[*k].counts).collect();
    let mut firsts = firsts.iter().copied().peekable();
    let (mut signals, mut rows, mut pasts) = (Signals::default(), Vec::<Row>::new(), Vec::new());
    // The end of the stretch before.
    let mut done = 0;
    for (k, row) in run.rows.iter().enumerate() {
        let inputs = row.inputs();
        signals.before_force(&inputs);
        if row.raw_force_n.is_finite() {
            signals.after_force(&inputs, row.raw_force_n);
        }
        let begins =
            |first: &usize| counted.get(*first).is_some_and(|from| k + settling >= *from && k >= done);
        let Some(first) = firsts.next_if(begins) else { continue };
        let from = counted[first];
        // Rest within a stretch makes it longer, but not without limit.
        let to = counted.get(first + length).map_or(run.rows.len(), |to| (*to).min(from + 2 * length)).max(k);
        let start = rows.len();
        let counts = |(n, row): (usize, &Row)| Row { counts: row.counts && k + n >= from, ..*row };
        rows.extend(run.rows[k..to].iter().enumerate().map(counts));
        // Otherwise it continues the stretch before, or begins with the run.
        if k > done && to > k {
            rows[start].dt_s = None;
            pasts.push((row.stamp, signals.past()));
        }
        done = to;
    }
    Dataset { pasts, ..run.with_rows(rows) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::blocks::Blocks;
    use crate::diagnose::joint::{Fitted, Joint};
    use crate::diagnose::ranges::Ranges;
    use crate::diagnose::rows::Rows;
    use crate::effect::term::{Argument, Form, Modulator, Term, Terms};
    use crate::effect::{Augmented, Effect, EffectModel, Effects};
    use crate::identify::{DatasetOptions, Scales};
    use crate::preset;
    use crate::rig::{Channels, Experiment, Plant, record};
    use std::collections::HashMap;

    const RATE_HZ: f64 = 128.0;

    fn dataset(seconds: f64, seed: u64) -> Dataset {
        let experiment = Experiment::thesis("RP-APRBS").expect("an experiment").with_duration_s(seconds);
        let run = record(&experiment, &Plant::default(), &Channels::default(), seed);
        let options = DatasetOptions { rate_hz: Some(RATE_HZ), ..DatasetOptions::default() };
        Dataset::from_run(&run, &Default::default(), &options).expect("rows")
    }

    fn seconds(count: f64) -> usize {
        (count * RATE_HZ) as usize
    }

    #[test]
    fn short_runs_stay_whole() {
        let runs = [dataset(20.0, 1), dataset(20.0, 2)];
        assert!(matches!(shortened(&runs, seconds(40.0)), Cow::Borrowed(_)));
        assert!(matches!(shortened(&runs, seconds(30.0)), Cow::Owned(_)));
    }

    #[test]
    fn a_long_run_gives_stretches_from_all_over_it() {
        let runs = [dataset(200.0, 1)];
        let short = shortened(&runs, seconds(80.0));
        let [run] = &short[..] else { panic!("one run") };
        assert!(run.rows.len() <= seconds(80.0) + 4 && run.counted() + 4 >= seconds(4.0 * 16.0));
        let begins = || run.rows.iter().filter(|row| row.dt_s.is_none());
        let starts_s: Vec<f64> = begins().map(|row| run.past(row).map_or(0.0, |past| past.time_s)).collect();
        let first = runs[0].rows[0].stamp;
        for (row, start_s) in begins().zip(&starts_s) {
            assert!((row.stamp.since(first).get() - start_s).abs() < 1e-9);
        }
        assert_eq!(starts_s.len(), 4);
        assert!(
            starts_s.windows(2).all(|pair| pair[1] - pair[0] > 16.0) && starts_s[3] > 140.0,
            "{starts_s:?}"
        );
        // No block is empty, and none holds two.
        let rows = Rows::new(&short, usize::MAX);
        let blocks = Blocks::new(&rows, 2.0);
        let in_block = |block: usize| blocks.of_row().iter().filter(|of| **of == block).count();
        assert!(blocks.count().abs_diff(32) <= 1, "{}", blocks.count());
        assert!((0..blocks.count()).all(|block| in_block(block).abs_diff(seconds(2.0)) < seconds(0.2)));
    }

    #[test]
    fn each_of_many_runs_has_a_stretch() {
        let runs: Vec<Dataset> = (0..10).map(|seed| dataset(18.0, seed)).collect();
        for (most_s, each_s) in [(60.0, 4.0), (100.0, 6.0)] {
            let short = shortened(&runs, seconds(most_s));
            assert_eq!(short.len(), 10);
            let counted = |run: &Dataset| run.counted().abs_diff(seconds(each_s)) < seconds(0.5);
            assert!(
                short.iter().all(counted),
                "{:?}",
                short.iter().map(Dataset::counted).collect::<Vec<_>>()
            );
        }
    }

    #[test]
    fn a_simulation_that_begins_within_a_run_knows_what_lies_before() {
        let whole = [dataset(120.0, 3)];
        let short = shortened(&whole, seconds(60.0));
        let force = preset::load(preset::BEST_FUZZY_TANH).expect("a preset").force;
        let term = |kind, amount| Term::new(kind, amount, &[], [0.0, 1e9]).expect("a term");
        for argument in [Argument::Time, Argument::Path, Argument::TemperatureRise] {
            let terms = [term((Modulator::One, argument, Form::Linear), 3.0)];
            let drift = EffectModel::new(Effect::LoadCellDrift, &[0.2]).expect("in its range");
            let effects = Effects::new(&[drift]).expect("one").with_terms(Terms::new(&terms).expect("one"));
            let model = Augmented::new(force, effects).expect("a model");
            let predict = |runs: &[Dataset]| {
                let rows = Rows::new(runs, usize::MAX);
                let force_n = rows.predict(&model).expect("it is finite");
                let run = &rows.runs()[0];
                let stamps = run.indices.iter().map(|k| run.dataset.rows[*k].stamp);
                stamps.zip(force_n).collect::<Vec<_>>()
            };
            let all: HashMap<_, _> = predict(&whole).into_iter().collect();
            let some = predict(&short);
            assert!(some.len() > seconds(40.0));
            for (stamp, force_n) in some {
                // The filter of the output has settled to this.
                assert!((force_n - all[&stamp]).abs() < 1e-6, "{argument:?}: {force_n} and {}", all[&stamp]);
            }
            let rows = Rows::new(&short, usize::MAX);
            let joint = Joint {
                rows: &rows,
                scales: Scales::of(&short).expect("scales"),
                ranges: Ranges::default(),
                base_moves: true,
                watch: &Watch::default(),
            };
            let fitted = Fitted::as_is(model, &rows).expect("it is finite");
            let (columns, of_base) = joint.jacobian(&fitted).expect("not cancelled");
            let [by_drift, by_term] = &columns[of_base..] else { panic!("two numbers beside the base") };
            // Both are linear in their number, and the drift alone is the change since the start.
            let mut time_s: Vec<f64> = rows.runs()[0].times_s().collect();
            rows.centre(&mut time_s);
            assert!(by_drift.iter().zip(&time_s).all(|(by, time_s)| (by - time_s).abs() < 1e-6));
            let without = Augmented::new(force, Effects::new(&[drift]).expect("one")).expect("a model");
            let change = rows.difference(&without, &fitted.predicted_n, -3.0).expect("it is finite");
            let change = rows.derivative(change);
            assert!(by_term.iter().zip(&change).all(|(by, change)| (by - change).abs() < 1e-6));
        }
    }
}
