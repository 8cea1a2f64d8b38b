//! The first paper: ARX (NARX there), S-P and P on ten experiments.
//!
//! The paper prints errors of current-dependent models for experiments 1 to 5 only. In experiments 6 to 10 a run has one current, on which
//! such a model cannot be identified. The paper must therefore have fitted each run separately. This is done here too: each model is
//! identified on each run, and its error is computed on the same run.

use super::thesis_tables::BOXES;
use super::{Args, P, SP, ThesisModel, rig_runs};
use crate::commands::compare::bar;
use crate::commands::compare::drawn::Drawn;
use crate::commands::compare::pictures;
use crate::commands::compare::work::{in_parallel, threads};
use crate::commands::context::CliContext;
use crate::settings::error::NodeError;
use mr_damper_model::Error;
use mr_damper_model::compare::{BoxPlot, Experiment, Predictor, Replicate};
use mr_damper_model::force::Form;
use mr_damper_model::identify::{
    Dataset, Identified, ModelSpec, Options, PhaseOptions, Structure, Watch, identify_datasets,
    identify_phase,
};
use mr_damper_model::preset::published;
use mr_damper_reports::box_plot::BoxRow;
use mr_damper_reports::compare::{force_time_plot, force_velocity_plots};
use mr_damper_reports::reproduction::{Chapter, ComparedFigure, Item, Part};

/// A run of an experiment, numbered from 1.
pub(super) struct PaperRun {
    pub(super) experiment: usize,
    pub(super) data: Dataset,
}

/// Its inputs begin one sample back, as in equation 5 of the paper.
const NARX: ThesisModel =
    ThesisModel { name: "arx-delayed", structure: Structure::ArxDelayed, predictor: Predictor::OneStep };
const MODELS: [(ThesisModel, &str); 3] = [(NARX, "NARX"), (SP, "S-P"), (P, "P")];

/// Experiments on which the current varies within a run: the first five.
const VARYING: usize = 5;
const EXPERIMENTS: usize = 10;
/// The experiment of figure 7, and the experiment of figures 8 and 9.
const OVER_TIME: usize = 5;
const OVER_VELOCITY: usize = 4;

/// NMSE of a model on one run.
struct Fitted {
    model: &'static str,
    form: Form,
    experiment: usize,
    esr: Option<f64>,
}

/// The chapter.
///
/// # Errors
/// When interrupted.
pub(super) fn chapter(args: &Args, context: &CliContext) -> Result<Chapter, NodeError> {
    let options = args.options();
    let runs = rig_runs::of_first_paper(args.seed, args.duration, &options, context)?;
    let fits = fitted(&runs, &options, context)?;
    let mut items = vec![
        table(&fits, "Table III", Form::Passive, EXPERIMENTS),
        table(&fits, "Table IV", Form::SemiActive, VARYING),
        boxes(&fits, "Figure 3", NARX, Form::Passive, EXPERIMENTS),
        boxes(&fits, "Figure 4", NARX, Form::SemiActive, VARYING),
        boxes(&fits, "Figure 5", SP, Form::SemiActive, VARYING),
        boxes(&fits, "Figure 6", P, Form::SemiActive, VARYING),
    ];
    items.extend(figures(&runs, &options, context)?);
    Ok(Chapter {
        title: "First paper: ten experiments up to 4 A".to_owned(),
        remark: "Each model is identified on each run, and its error is that on the same run: the current-dependent forms exist only where \
                 the current varies within a run, as in the paper's tables. NARX predicts one step ahead, P explains each measured force \
                 by itself. The rig is calibrated up to 2.5 A and extrapolates beyond. "
            .to_owned()
            + BOXES,
        items,
    })
}

/// Fits each model in each form to each run that it can be identified on.
fn fitted(runs: &[PaperRun], options: &Options, context: &CliContext) -> Result<Vec<Fitted>, NodeError> {
    let mut work = Vec::new();
    for run in runs {
        for (model, _) in MODELS {
            for form in [Form::Passive, Form::SemiActive] {
                if form == Form::Passive || run.experiment <= VARYING {
                    work.push((run, model, form));
                }
            }
        }
    }
    let bar = bar(context, work.len(), "fitting the first paper's models [{bar:40}] {pos}/{len}");
    let one = |index: usize| -> Result<Fitted, NodeError> {
        let (run, model, form) = work[index];
        let fitted = |esr| Fitted { model: model.name, form, experiment: run.experiment, esr };
        let esr = match fit(&run.data, model, form, options, context) {
            Ok(fit) => fit.esr(model.predictor),
            Err(Error::Cancelled) => return Err(NodeError::Interrupted),
            Err(error) => {
                tracing::warn!(model = model.name, form = form.name(), experiment = run.experiment, %error, "not identified");
                None
            }
        };
        bar.inc(1);
        Ok(fitted(esr))
    };
    let fits = in_parallel(work.len(), threads(), one).into_iter().collect();
    bar.finish_and_clear();
    fits
}

/// A model that is identified on one run.
enum OneFit {
    Model(Box<Identified>),
    Relation(Box<mr_damper_model::identify::IdentifiedPhase>),
}

impl OneFit {
    fn esr(&self, predictor: Predictor) -> Option<f64> {
        match self {
            Self::Model(found) if predictor == Predictor::OneStep => found.one_step.map(|fit| fit.esr),
            Self::Model(found) => found.free_run.map(|fit| fit.esr),
            Self::Relation(found) => Some(found.same_instant.esr),
        }
    }

    fn drawn(self, predictor: Predictor, name: String) -> Drawn {
        match self {
            Self::Model(found) if predictor == Predictor::OneStep => Drawn::one_step(name, found.model),
            Self::Model(found) => Drawn::simulated(name, found.model),
            Self::Relation(found) => Drawn::explained(name, found.phase),
        }
    }
}

fn fit(
    data: &Dataset,
    model: ThesisModel,
    form: Form,
    options: &Options,
    context: &CliContext,
) -> Result<OneFit, Error> {
    let watch = Watch { cancel: Some(context.interrupt.flag()), progress: None };
    let data = std::slice::from_ref(data);
    if model.structure.can_run() {
        let found = identify_datasets(ModelSpec::new(model.structure, form)?, data, options, &watch)?;
        return Ok(OneFit::Model(Box::new(found)));
    }
    let drive = data[0].drive.filter(|_| form == Form::SemiActive);
    let found = identify_phase(data, &PhaseOptions { drive, ..PhaseOptions::default() }, &watch)?;
    Ok(OneFit::Relation(Box::new(found)))
}

/// NMSE of a model on the runs of an experiment, %.
fn percent(fits: &[Fitted], model: &str, form: Form, experiment: usize) -> Vec<f64> {
    let of = fits.iter().filter(|fit| fit.model == model && fit.form == form && fit.experiment == experiment);
    of.filter_map(|fit| Some(100.0 * fit.esr?)).collect()
}

/// The name of a model among the published figures.
const fn published_name(model: ThesisModel) -> &'static str {
    match model.structure {
        Structure::ArxDelayed => "arx",
        _ => model.name,
    }
}

fn table(fits: &[Fitted], number: &str, form: Form, experiments: usize) -> Item {
    let mut rows = Vec::new();
    for (model, words) in MODELS {
        for experiment in 1..=experiments {
            let here = percent(fits, model.name, form, experiment);
            rows.push(ComparedFigure {
                of: vec![words.to_owned(), experiment.to_string()],
                published: published::first_paper_esr(published_name(model), form, experiment)
                    // The tables print tenths of a per cent.
                    .map(|esr| (1e3 * esr).round() / 10.0),
                here: (!here.is_empty()).then(|| here.iter().sum::<f64>() / here.len() as f64),
            });
        }
    }
    let what = if form == Form::Passive { "without" } else { "with" };
    Item {
        number: number.to_owned(),
        title: format!("mean NMSE of the models {what} the current, by experiment"),
        remark: String::new(),
        parts: vec![Part::Figures {
            what: "",
            unit: "%",
            // Tenths are published; NARX is below them here.
            decimals: 2,
            labels: vec!["model", "experiment"],
            rows,
        }],
    }
}

fn boxes(fits: &[Fitted], number: &str, model: ThesisModel, form: Form, experiments: usize) -> Item {
    let row = |experiment: usize| BoxRow {
        name: format!("experiment {experiment}"),
        numbers: BoxPlot::of(percent(fits, model.name, form, experiment)),
        remark: String::new(),
        yardstick: false,
    };
    let words =
        MODELS.iter().find(|(known, _)| known.name == model.name).map_or(model.name, |(_, words)| words);
    let what = if form == Form::Passive { "without" } else { "with" };
    let title = format!("NMSE of {words} {what} the current, by experiment");
    Item::boxes(number, title, "NMSE, %", (1..=experiments).map(row).collect())
}

/// Figures 7 to 9: force over time of all models, and force over velocity of two.
fn figures(runs: &[PaperRun], options: &Options, context: &CliContext) -> Result<Vec<Item>, NodeError> {
    let first = |experiment: usize| runs.iter().find(|run| run.experiment == experiment);
    let alone = |run: &PaperRun| Experiment {
        name: format!("Experiment {}", run.experiment),
        replicates: vec![Replicate { number: 1, data: run.data.clone() }],
        training: 1,
        held_out: Vec::new(),
    };
    let drawn = |run: &PaperRun, model: ThesisModel, words: &str| -> Result<Option<Drawn>, NodeError> {
        match fit(&run.data, model, Form::SemiActive, options, context) {
            Ok(found) => Ok(Some(found.drawn(model.predictor, words.to_owned()))),
            Err(Error::Cancelled) => Err(NodeError::Interrupted),
            // The tables have the reason.
            Err(_) => Ok(None),
        }
    };
    let mut items = Vec::new();
    if let Some(run) = first(OVER_TIME) {
        let mut models = Vec::new();
        for (model, words) in MODELS {
            models.extend(drawn(run, model, words)?);
        }
        let plots = pictures::force_time(&[alone(run)], &models);
        let plots = plots.iter().map(|picture| (picture.title.clone(), force_time_plot(picture))).collect();
        items.push(Item {
            number: "Figure 7".to_owned(),
            title: format!("force over time of the models with the current, experiment {OVER_TIME}"),
            remark: String::new(),
            parts: vec![Part::Plots(plots)],
        });
    }
    if let Some(run) = first(OVER_VELOCITY) {
        for (number, model, words) in [("Figure 8", SP, "S-P"), ("Figure 9", P, "P")] {
            let Some(drawn) = drawn(run, model, words)? else { continue };
            let (plots, caption) = pictures::force_velocity(&[alone(run)], &[drawn]);
            items.push(Item {
                number: number.to_owned(),
                title: format!("force over velocity of {words} with the current, experiment {OVER_VELOCITY}"),
                remark: caption,
                parts: vec![Part::Plots(force_velocity_plots(&plots))],
            });
        }
    }
    Ok(items)
}
