//! Plots of the report: the force of a few models and the measured force, over time and over velocity.

use super::drawn::Drawn;
use mr_damper_model::compare::{ALL_FOLDS, Experiment, Predictor, Replicate, Summary};
use mr_damper_model::effect::Augmented;
use mr_damper_model::identify::{
    Dataset, Form, MembershipSource, Memberships, ModelSpec, Row, sum_of_free_run,
};
use mr_damper_model::model::Model;
use mr_damper_reports::compare::order::name;
use mr_damper_reports::compare::{Curve, ForcePlot, StepTime};
use mr_damper_reports::plot::binned_mean;
use std::hint::black_box;
use std::time::Instant;

/// Number of models in a plot.
pub(super) const MODELS: usize = 3;
/// Length of a plot over time, s.
const TIME_S: f64 = 2.0;
/// Number of currents for which force is plotted over velocity.
const CURRENTS: usize = 6;
/// Maximum number of measured points in a plot over velocity.
const DOTS: usize = 700;
/// Number of velocity bins of a model's line.
const BINS: usize = 40;
/// Minimum number of points in a bin.
const PER_BIN: usize = 5;
/// Maximum number of rows over which a step is timed.
const TIMED_ROWS: usize = 20_480;
/// Number of timing passes; their median counts.
const PASSES: usize = 7;

/// A model to draw, and how: `NAME`, or `NAME:one-step`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// The model's name with its variant.
    model: String,
    one_step: bool,
}

impl std::str::FromStr for Picture {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (model, one_step) = match text.strip_suffix(":one-step") {
            Some(model) => (model, true),
            None => (text, false),
        };
        Ok(Self { model: model.to_owned(), one_step })
    }
}

impl std::fmt::Display for Picture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}{}", self.model, if self.one_step { ":one-step" } else { "" })
    }
}

impl Picture {
    /// True if `spec` can be drawn so.
    pub(super) fn is_of(&self, spec: ModelSpec) -> bool {
        spec.label() == self.model && (!self.one_step || spec.feeds_on_force())
    }

    /// The way in which the model computes force.
    fn predictor(&self) -> Predictor {
        match self.model.as_str() {
            "p" => Predictor::SameInstant,
            _ if self.one_step => Predictor::OneStep,
            _ => Predictor::FreeRun,
        }
    }
}

/// The models that `pictures` names, each in its best form and as identified on its best experiment. `find` returns a model by name,
/// form and training experiment; `degree` is that of the polynomials of p. A model without a finished test on all runs is left out.
pub(super) fn named(
    pictures: &[Picture],
    summaries: &[Summary],
    (experiments, degree): (&[Experiment], usize),
    find: impl Fn(&str, &str, &str) -> Option<Model>,
) -> Vec<Drawn> {
    let one = |picture: &Picture| {
        let predictor = picture.predictor();
        let mut of =
            summaries.iter().filter(|s| s.class.predictor == predictor && s.class.model == picture.model);
        let (class, row) = of.find_map(|summary| Some((&summary.class, summary.best()?)))?;
        let name = format!("{}, trained on {}", name(class), training_name(&row.trained_on));
        if predictor == Predictor::SameInstant {
            let training = &experiments.iter().find(|e| e.name == row.trained_on)?.replicates.first()?.data;
            let drive = training.drive.filter(|_| class.form != Form::Passive.name());
            return Drawn::identified_relation(name, training, drive, degree);
        }
        let model = find(&class.model, &class.form, &row.trained_on)?;
        let one_step = predictor == Predictor::OneStep;
        Some(if one_step { Drawn::one_step(name, model) } else { Drawn::simulated(name, model) })
    };
    pictures.iter().filter_map(one).collect()
}

/// Name of the training runs for a legend. Over folds there is a model for each fold, and the first one is drawn.
fn training_name(trained_on: &str) -> &str {
    if trained_on == ALL_FOLDS { "the first fold" } else { trained_on }
}

/// The best models in simulation, each as identified on its best experiment. `find` returns a model by name, form and
/// training experiment.
pub(super) fn best(summaries: &[Summary], find: impl Fn(&str, &str, &str) -> Option<Model>) -> Vec<Drawn> {
    let free = summaries.iter().filter(|s| s.class.predictor == Predictor::FreeRun);
    let mut seen: Vec<&str> = Vec::new();
    let drawn = free.filter_map(|summary| {
        let (class, row) = (&summary.class, summary.best()?);
        let model = find(&class.model, &class.form, &row.trained_on)?;
        // Only one form of each model: the curves of the others would cover it.
        if seen.contains(&class.model.as_str()) {
            return None;
        }
        seen.push(&class.model);
        Some(Drawn::simulated(
            format!("{}, trained on {}", name(class), training_name(&row.trained_on)),
            model,
        ))
    });
    drawn.take(MODELS).collect()
}

/// Two seconds from the middle of the last replicate of the first and of the last experiment.
pub(in crate::commands) fn force_time(experiments: &[Experiment], drawn: &[Drawn]) -> Vec<ForcePlot> {
    let mut chosen: Vec<&Experiment> = experiments.first().into_iter().chain(experiments.last()).collect();
    chosen.dedup_by(|a, b| a.name == b.name);
    let pictures = chosen.into_iter().filter_map(|experiment| {
        let replicate = experiment.replicates.last()?;
        let rows = &replicate.data.rows;
        let (start, middle) = (rows.first()?.stamp, rows[rows.len() / 2].stamp);
        let inside = |row: &Row| row.stamp.since(middle).get().abs() <= TIME_S / 2.0;
        let seconds = |row: &Row| row.stamp.since(start).get();
        let measured = rows.iter().filter(|row| inside(row)).map(|row| (seconds(row), row.force_n)).collect();
        let curve = |drawn: &Drawn| Curve {
            name: drawn.name().to_owned(),
            lines: vec![
                drawn.points(&replicate.data, |row, force_n| inside(row).then(|| (seconds(row), force_n))),
            ],
        };
        let title = format!("{}, replicate {}", experiment.name, replicate.number);
        Some(ForcePlot { title, measured, models: drawn.iter().map(curve).collect() })
    });
    if drawn.is_empty() { Vec::new() } else { pictures.collect() }
}

/// Force over velocity at up to six currents, and a caption. The currents are the levels of the experiment with the most
/// current levels, or ranges of the current if no experiment has at least three levels.
pub(in crate::commands) fn force_velocity(
    experiments: &[Experiment],
    drawn: &[Drawn],
) -> (Vec<ForcePlot>, String) {
    let Some((experiment, replicate, ranges, stepped)) = currents(experiments) else {
        return (Vec::new(), String::new());
    };
    let unit = replicate.data.drive.map_or(String::new(), |kind| kind.unit_suffix().to_uppercase());
    let picture = |[low, high]: &[f64; 2]| {
        let inside = |row: &Row| row.counts && (*low..=*high).contains(&row.drive);
        let rows: Vec<&Row> = replicate.data.rows.iter().filter(|row| inside(row)).collect();
        let every = rows.len().div_ceil(DOTS).max(1);
        let measured = rows.iter().step_by(every).map(|row| (row.velocity_m_s, row.force_n)).collect();
        let curve = |drawn: &Drawn| {
            let branch = |sign: f64| {
                let points = drawn.points(&replicate.data, |row, force_n| {
                    (inside(row) && sign * row.acceleration_m_s2 > 0.0).then_some((row.velocity_m_s, force_n))
                });
                binned_mean(&points, BINS, PER_BIN)
            };
            Curve { name: drawn.name().to_owned(), lines: vec![branch(1.0), branch(-1.0)] }
        };
        let title = if stepped {
            format!("{:.1} {unit}", 0.5 * (low + high))
        } else {
            format!("{low:.2} to {high:.2} {unit}")
        };
        ForcePlot { title, measured, models: drawn.iter().map(curve).collect() }
    };
    let at = match ranges.len() {
        levels if stepped => format!("at {levels} levels of its drive"),
        _ => "in equal ranges of its drive (which has no levels)".to_owned(),
    };
    let caption = format!(
        "{}, replicate {}, {at}. Dots are measured. Each model has two lines: its mean force while velocity rises and while \
         it falls; the gap between the lines is the hysteresis.",
        experiment.name, replicate.number,
    );
    (ranges.iter().map(picture).collect(), caption)
}

type Currents<'a> = (&'a Experiment, &'a Replicate, Vec<[f64; 2]>, bool);

/// The run for the plots of force over velocity, and the ranges of its drive.
fn currents(experiments: &[Experiment]) -> Option<Currents<'_>> {
    let counted =
        |data: &Dataset| data.rows.iter().filter(|row| row.counts).map(|row| row.drive).collect::<Vec<_>>();
    let mut stepped: Option<(usize, &Experiment, Memberships)> = None;
    for experiment in experiments {
        let Some(first) = experiment.replicates.first() else { continue };
        let Some(kind) = first.data.drive else { continue };
        let Ok(found) = Memberships::from_drive(kind, counted(&first.data)) else { continue };
        let levels = if found.source == MembershipSource::Levels { found.sets.len() } else { 0 };
        if levels > stepped.as_ref().map_or(2, |best| best.0) {
            stepped = Some((levels, experiment, found));
        }
    }
    if let Some((levels, experiment, found)) = stepped {
        let gap = found.sets.centres().windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
        let of = levels.min(CURRENTS);
        // Of seven levels, six are taken: the middle one is left out.
        let pick = |k: usize| found.sets.centres()[(k * (levels - 1) + (of - 1) / 2) / (of - 1).max(1)];
        let ranges = (0..of).map(|k| [pick(k) - 0.25 * gap, pick(k) + 0.25 * gap]).collect();
        return Some((experiment, experiment.replicates.first()?, ranges, true));
    }
    let with_drive = |e: &&Experiment| e.replicates.first().is_some_and(|r| r.data.envelope.drive.is_some());
    let longest = experiments
        .iter()
        .filter(with_drive)
        .max_by_key(|e| e.replicates.first().map(|r| r.data.rows.len()))?;
    let first = longest.replicates.first()?;
    let [low, high] = first.data.envelope.drive?;
    let width = (high - low) / CURRENTS as f64;
    let ranges = if width > 1e-3 * high.abs() {
        (0..CURRENTS).map(|k| [low + k as f64 * width, low + (k + 1) as f64 * width]).collect()
    } else {
        vec![[low, high]]
    };
    Some((longest, first, ranges, false))
}

/// Time per step of each model in simulation, ns, on this thread: the median of several passes over the same rows.
pub(super) fn step_times<'a>(
    models: impl Iterator<Item = (&'a str, &'a str, &'a Model)>,
    data: &Dataset,
) -> Vec<StepTime> {
    let rows = &data.rows[..data.rows.len().min(TIMED_ROWS)];
    let time = |model: &Augmented| {
        let start = Instant::now();
        black_box(sum_of_free_run(black_box(model), rows));
        start.elapsed().as_secs_f64() * 1e9 / rows.len().max(1) as f64
    };
    let median = |model: &Augmented| {
        let mut passes: Vec<f64> = (0..PASSES).map(|_| time(model)).collect();
        passes.sort_by(f64::total_cmp);
        passes[PASSES / 2]
    };
    models
        .map(|(model, form, found)| StepTime {
            model: model.to_owned(),
            form: form.to_owned(),
            ns_per_step: median(&found.augmented()),
        })
        .collect()
}
