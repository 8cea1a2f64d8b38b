//! Folds for runs that hold one level of the drive each.
//!
//! ```text
//! level of a run     median of its drive; the run has one if 96 % of its drive lie within 4 % of the range over all runs
//! fold k             test: all runs of level k         identification: all runs of the other levels
//! ```
//!
//! A model that is identified on a run of one level cannot know how the force depends on the drive, so a comparison of such
//! models says nothing. Leaving out each level in turn gives models that have seen the drive vary, and tests each of them at a
//! level that it has not seen. At the lowest and the highest level this is an extrapolation.
//!
//! Source of the scheme: leave-one-group-out cross-validation, `[hastie2009]` in the bibliography
//! (node/docs/guide/bibliography.md), section 7.10.

use super::{Experiment, Figure, Finished, Replicate, Test};
use crate::identify::Dataset;
use crate::sample::DriveKind;
use std::collections::BTreeMap;

/// Share of a run's drive values that are left out at either end.
const TAIL: f64 = 0.02;
/// Largest deviation within a level, as a share of the range over all runs.
const WITHIN: f64 = 0.04;
/// Name under which the folds of a model are summed up.
pub const ALL_FOLDS: &str = "all folds";

/// A level of the drive, and the runs that hold it.
#[derive(Debug, Clone, PartialEq)]
pub struct Level {
    /// Mean over the runs' medians, A or V.
    pub drive: f64,
    /// The runs: index of the experiment, index of the replicate.
    pub runs: Vec<(usize, usize)>,
}

/// The levels of `experiments`, increasing, if each run holds one level and there are at least two; `None` otherwise.
///
/// Three sines at one current each, which become three folds:
///
/// ```
/// use mr_damper_model::compare::{Experiment, Finished, Replicate, levels, over_folds, with_folds};
/// use mr_damper_model::condition::Conditioning;
/// use mr_damper_model::identify::{Dataset, DatasetOptions};
/// use mr_damper_model::rig::{self, Channels, Plant, record};
///
/// let replicates = [(1, 0.0), (2, 1.2), (3, 2.4)].map(|(number, current_a)| {
///     let run = record(&rig::Experiment::sine(0.01, 2.0, current_a, 2.0), &Plant::default(), &Channels::default(), 1);
///     let data = Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default()).expect("a run");
///     Replicate { number, data }
/// });
/// let sines = Experiment { name: "sines".to_owned(), replicates: replicates.to_vec(), training: 1, held_out: Vec::new() };
/// let found = levels(&[sines.clone()]).expect("one level each");
/// let all = with_folds(vec![sines], &found, "A");
/// assert_eq!((found.len(), all.len(), all[1].is_fold()), (3, 4, true));
///
/// // A model that failed on a fold has no figure there.
/// let cell = Finished {
///     model: "arx".to_owned(),
///     form: "passive".to_owned(),
///     trained_on: all[1].name.clone(),
///     parameters: None,
///     identification: Vec::new(),
///     cross_validation: Vec::new(),
///     warnings: Vec::new(),
///     failure: Some("too few samples".to_owned()),
/// };
/// assert_eq!(over_folds(&[cell], &all)[0].failure.as_deref(), Some("too few samples"));
/// ```
#[must_use]
pub fn levels(experiments: &[Experiment]) -> Option<Vec<Level>> {
    let runs = || {
        experiments.iter().enumerate().flat_map(|(e, experiment)| {
            experiment.replicates.iter().enumerate().map(move |(r, replicate)| ((e, r), replicate))
        })
    };
    let kind = runs().next()?.1.data.drive?;
    let mut medians = Vec::new();
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut widest: f64 = 0.0;
    for (place, replicate) in runs() {
        let [least, median, most] = quantiles(replicate, kind)?;
        (low, high) = (low.min(median), high.max(median));
        widest = widest.max(most - least);
        medians.push((median, place));
    }
    let within = WITHIN * (high - low);
    if widest > within || within <= 0.0 {
        return None;
    }
    medians.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    // Medians of each level with their runs. A level ends where two neighbouring medians are further apart than a level is wide.
    let mut found: Vec<Vec<(f64, (usize, usize))>> = Vec::new();
    for run in medians {
        match found.last_mut().filter(|level| level.last().is_some_and(|(last, _)| run.0 - last <= within)) {
            Some(level) => level.push(run),
            None => found.push(vec![run]),
        }
    }
    let level = |runs: Vec<(f64, (usize, usize))>| Level {
        drive: runs.iter().map(|(median, _)| median).sum::<f64>() / runs.len() as f64,
        runs: runs.into_iter().map(|(_, place)| place).collect(),
    };
    (found.len() > 1).then(|| found.into_iter().map(level).collect())
}

/// Low quantile, median and high quantile of the drive of a run; `None` without a drive of this kind.
fn quantiles(replicate: &Replicate, kind: DriveKind) -> Option<[f64; 3]> {
    let data = &replicate.data;
    if data.drive != Some(kind) {
        return None;
    }
    let counted = data.rows.iter().filter(|row| row.counts).map(|row| row.drive);
    let mut values: Vec<f64> = counted.filter(|drive| drive.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)? as f64;
    Some([TAIL, 0.5, 1.0 - TAIL].map(|share| values[(share * last).round() as usize]))
}

/// `experiments` without training runs of their own, followed by one fold for each of `levels`, which has `unit` in its name.
#[must_use]
pub fn with_folds(mut experiments: Vec<Experiment>, levels: &[Level], unit: &str) -> Vec<Experiment> {
    for experiment in &mut experiments {
        experiment.training = 0;
    }
    experiments.extend(levels.iter().map(|level| Experiment {
        name: format!("without {:.2} {unit}", level.drive),
        replicates: Vec::new(),
        training: 0,
        held_out: level.runs.clone(),
    }));
    experiments
}

impl Experiment {
    /// True if it is a fold: a division of the other experiments' runs into training and test.
    #[must_use]
    pub fn is_fold(&self) -> bool {
        !self.held_out.is_empty()
    }
}

/// The rows of all runs that `fold` does not hold out.
pub(super) fn training_of(fold: &Experiment, experiments: &[Experiment]) -> Vec<Dataset> {
    let all = experiments.iter().enumerate().flat_map(|(e, experiment)| {
        experiment.replicates.iter().enumerate().map(move |(r, replicate)| ((e, r), replicate))
    });
    all.filter(|(place, _)| !fold.held_out.contains(place)).map(|(_, run)| run.data.clone()).collect()
}

/// One result for each model in place of one for each fold, for [`Summary::of`](super::Summary::of): the tests of all folds,
/// named by fold. Tests of a fold that gave no model have no figure, so that a model that fails on a fold has no mean.
#[must_use]
pub fn over_folds(cells: &[Finished], experiments: &[Experiment]) -> Vec<Finished> {
    let mut merged: BTreeMap<usize, Finished> = BTreeMap::new();
    let mut order: Vec<(&str, &str)> = Vec::new();
    for cell in cells {
        let class = (cell.model.as_str(), cell.form.as_str());
        let place = order.iter().position(|known| *known == class).unwrap_or_else(|| {
            order.push(class);
            order.len() - 1
        });
        let whole = merged.entry(place).or_insert_with(|| Finished {
            trained_on: ALL_FOLDS.to_owned(),
            parameters: None,
            identification: Vec::new(),
            cross_validation: Vec::new(),
            warnings: Vec::new(),
            failure: None,
            ..cell.clone()
        });
        whole.parameters = whole.parameters.or(cell.parameters);
        if whole.identification.is_empty() {
            whole.identification.clone_from(&cell.identification);
        }
        for test in &cell.cross_validation {
            whole.cross_validation.push(Test { tested_on: cell.trained_on.clone(), ..test.clone() });
        }
    }
    for cell in cells.iter().filter(|cell| cell.failure.is_some()) {
        let class = (cell.model.as_str(), cell.form.as_str());
        let Some(whole) = order.iter().position(|known| *known == class).and_then(|k| merged.get_mut(&k))
        else {
            continue;
        };
        let fold = experiments.iter().find(|experiment| experiment.name == cell.trained_on);
        let missing: Vec<Figure> = whole
            .identification
            .iter()
            .map(|figure| Figure { rsse_n: None, esr: None, note: cell.failure.clone(), ..figure.clone() })
            .collect();
        if missing.is_empty() {
            // No fold gave a model.
            whole.failure.clone_from(&cell.failure);
        }
        for (e, r) in fold.iter().flat_map(|fold| &fold.held_out) {
            let run = experiments.get(*e).and_then(|experiment| experiment.replicates.get(*r));
            whole.cross_validation.push(Test {
                tested_on: cell.trained_on.clone(),
                replicate: run.map_or(0, |run| run.number),
                figures: missing.clone(),
            });
        }
    }
    merged.into_values().collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Predictor, Summary};
    use super::*;
    use crate::condition::Conditioning;
    use crate::identify::DatasetOptions;
    use crate::rig::{self, Channels, Plant};

    fn run(level_a: f64, seed: u64) -> Replicate {
        let planned = rig::Experiment::sine(0.01, 2.0, level_a, 3.0);
        let run = rig::record(&planned, &Plant::default(), &Channels::default(), seed);
        let data = Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default());
        Replicate { number: 1, data: data.expect("a run") }
    }

    fn experiment(name: &str, levels_a: &[f64]) -> Experiment {
        let replicates = levels_a.iter().enumerate().map(|(seed, level)| run(*level, seed as u64 + 1));
        Experiment {
            name: name.to_owned(),
            replicates: replicates.collect(),
            training: 1,
            held_out: Vec::new(),
        }
    }

    #[test]
    fn runs_of_one_level_each_are_grouped_and_others_are_not() {
        let experiments = [
            experiment("a", &[1.2]),
            experiment("b", &[0.0, 2.4]),
            experiment("c", &[1.2]),
            experiment("d", &[0.0]),
        ];
        let found = levels(&experiments).expect("levels");
        let short: Vec<(i64, Vec<(usize, usize)>)> =
            found.iter().map(|level| ((level.drive * 10.0).round() as i64, level.runs.clone())).collect();
        assert_eq!(short, [(0, vec![(1, 0), (3, 0)]), (12, vec![(0, 0), (2, 0)]), (24, vec![(1, 1)])]);
        assert_eq!(levels(&experiments[..1]), None, "one level");
        // One run whose drive varies.
        let planned = rig::Experiment::thesis("RP-ICPS").expect("an experiment").with_duration_s(5.0);
        let varied = rig::record(&planned, &Plant::default(), &Channels::default(), 1);
        let data =
            Dataset::from_run(&varied, &Conditioning::default(), &DatasetOptions::default()).expect("a run");
        let varied = Experiment {
            name: "v".to_owned(),
            replicates: vec![Replicate { number: 1, data }],
            training: 1,
            held_out: Vec::new(),
        };
        assert_eq!(levels(&[experiments[0].clone(), experiments[1].clone(), varied]), None);
    }

    #[test]
    fn each_fold_is_identified_on_the_other_levels_and_each_run_is_tested_once() {
        let experiments = vec![experiment("a", &[0.0, 1.2]), experiment("b", &[2.4, 1.2])];
        let found = levels(&experiments).expect("levels");
        let all = with_folds(experiments, &found, "A");
        let folds: Vec<&Experiment> = all.iter().filter(|experiment| experiment.is_fold()).collect();
        let names: Vec<&str> = folds.iter().map(|fold| fold.name.as_str()).collect();
        assert_eq!(names.len(), 3);
        assert!(names[1].starts_with("without 1.2"), "{names:?}");
        let mut tested: Vec<(usize, usize)> = folds.iter().flat_map(|fold| fold.held_out.clone()).collect();
        tested.sort_unstable();
        assert_eq!(tested, [(0, 0), (0, 1), (1, 0), (1, 1)]);
        for fold in folds {
            assert_eq!(training_of(fold, &all).len() + fold.held_out.len(), 4);
        }
    }

    #[test]
    fn a_model_that_fails_on_a_fold_has_no_mean() {
        let figure = |rsse_n: f64| Figure {
            predictor: Predictor::FreeRun,
            rsse_n: Some(rsse_n),
            esr: Some(rsse_n / 100.0),
            note: None,
        };
        let cell = |fold: &str, rsse_n: Option<f64>| Finished {
            model: "kwok".to_owned(),
            form: "semi_active".to_owned(),
            trained_on: fold.to_owned(),
            parameters: rsse_n.map(|_| 15),
            identification: rsse_n.into_iter().map(figure).collect(),
            cross_validation: rsse_n
                .into_iter()
                .map(|n| Test { tested_on: "a".to_owned(), replicate: 1, figures: vec![figure(n)] })
                .collect(),
            warnings: Vec::new(),
            failure: rsse_n.is_none().then(|| "too few samples".to_owned()),
        };
        let fold = |name: &str, run| Experiment {
            name: name.to_owned(),
            replicates: Vec::new(),
            training: 0,
            held_out: vec![run],
        };
        let folds = [fold("x", (0, 0)), fold("y", (1, 0)), fold("z", (2, 0))];
        let good = over_folds(&[cell("x", Some(30.0)), cell("y", Some(50.0)), cell("z", Some(40.0))], &folds);
        let summary = &Summary::of(&good)[0];
        let row = summary.best().expect("a mean");
        assert_eq!((row.trained_on.as_str(), row.tests, row.mean_rsse_n), (ALL_FOLDS, 3, Some(40.0)));
        // t(0.975, 2) = 4.302652730; the standard error of 30, 50, 40 is 10/sqrt(3).
        let [low, high] = row.rsse_interval_n.expect("three folds");
        assert!(
            (low - (40.0 - 24.841_377_3)).abs() < 1e-6 && (high - 64.841_377_3).abs() < 1e-6,
            "{low} {high}"
        );
        let bad = over_folds(&[cell("x", Some(30.0)), cell("y", None), cell("z", Some(40.0))], &folds);
        let summary = &Summary::of(&bad)[0];
        assert_eq!((summary.best(), summary.without), (None, 1));
    }
}
