//! Chapter 4 of the thesis: errors of identification, and box plots of cross-validation. Tables 5.1 and 5.2 of its chapter 5.

use super::{ANFIS, ARX, FUZZY_TANH, P, Results, SP, STEPPED, ThesisModel, of};
use mr_damper_model::compare::{BoxPlot, Finished};
use mr_damper_model::force::Form;
use mr_damper_model::preset::published::{self, Published};
use mr_damper_model::rig;
use mr_damper_model::units::N_PER_LBF;
use mr_damper_reports::box_plot::BoxRow;
use mr_damper_reports::reproduction::{Chapter, ComparedFigure, Item, Part};

/// A model with the numbers of its table of identification errors and of its two figures of cross-validation.
type Numbers = (ThesisModel, Form, &'static str, Option<&'static str>, Option<[&'static str; 2]>);

const CHAPTER_4: [Numbers; 8] = [
    (ARX, Form::Passive, "passive ARX", Some("Table 4.1"), Some(["Figure 4.1", "Figure 4.2"])),
    (ARX, Form::SemiActive, "semi-active ARX", Some("Table 4.2"), Some(["Figure 4.3", "Figure 4.4"])),
    (SP, Form::Passive, "passive S-P", Some("Table 4.3"), None),
    (SP, Form::SemiActive, "semi-active S-P", Some("Table 4.4"), Some(["Figure 4.5", "Figure 4.6"])),
    (P, Form::Passive, "passive P", Some("Table 4.5"), Some(["Figure 4.7", "Figure 4.8"])),
    (P, Form::SemiActive, "semi-active P", Some("Table 4.6"), Some(["Figure 4.9", "Figure 4.10"])),
    (ANFIS, Form::SemiActive, "fuzzy (ANFIS)", Some("Table 4.7"), Some(["Figure 4.11", "Figure 4.12"])),
    (
        FUZZY_TANH,
        Form::SemiActive,
        "non-linear fuzzy (fuzzy-tanh)",
        None,
        Some(["Figure 4.14", "Figure 4.15"]),
    ),
];

/// RMSE (RSSE in the thesis) in pounds, and NMSE (ESR in the thesis).
#[derive(Debug, Clone, Copy)]
enum Measure {
    Rsse,
    Esr,
}

impl Measure {
    const BOTH: [Self; 2] = [Self::Rsse, Self::Esr];

    const fn unit(self) -> &'static str {
        match self {
            Self::Rsse => "lbf",
            Self::Esr => "",
        }
    }

    const fn decimals(self) -> usize {
        match self {
            Self::Rsse => 2,
            Self::Esr => 4,
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Rsse => "RMSE (RSSE in the thesis)",
            Self::Esr => "NMSE (ESR in the thesis)",
        }
    }

    fn published(self, found: &Published) -> f64 {
        match self {
            Self::Rsse => found.rsse_lbf,
            Self::Esr => found.esr,
        }
    }

    fn here(self, rsse_n: Option<f64>, esr: Option<f64>) -> Option<f64> {
        match self {
            Self::Rsse => rsse_n.map(|rsse_n| rsse_n / N_PER_LBF),
            Self::Esr => esr,
        }
    }
}

/// What the parts of a box plot are.
pub(super) const BOXES: &str = "A box reaches from the lower to the upper quartile, with a bar at the median; its whiskers reach the \
                                outermost values within 1.5 times its length; dots are values beyond. All axes of box plots are logarithmic.";

/// Chapter 4.
pub(super) fn chapter_4(results: &Results) -> Chapter {
    let mut items = Vec::new();
    for (model, form, words, table, figures) in CHAPTER_4 {
        items.extend(table.map(|number| identification(results, model, form, number, words)));
        if let Some(numbers) = figures {
            let pairs = numbers.into_iter().zip(Measure::BOTH);
            items.extend(pairs.map(|(number, measure)| boxes(results, model, form, number, words, measure)));
        }
    }
    Chapter {
        title: "Thesis, chapter 4: errors of the models".to_owned(),
        remark: "ARX predicts one step ahead from measured force, p explains each measured force by itself, and all others are simulated. \
                 Errors of different kinds cannot be compared. "
            .to_owned()
            + BOXES,
        items,
    }
}

/// A table of identification errors.
fn identification(results: &Results, model: ThesisModel, form: Form, number: &str, words: &str) -> Item {
    let part = |measure: Measure| {
        let row = |experiment: &str| {
            let found = published::identification(model.name, form, experiment);
            let figure = results
                .find(model.name, form, experiment)
                .and_then(|(cell, _)| of(model.predictor, &cell.identification).cloned());
            ComparedFigure {
                of: vec![experiment.to_owned()],
                published: found.as_ref().map(|found| measure.published(found)),
                here: figure.and_then(|figure| measure.here(figure.rsse_n, figure.esr)),
            }
        };
        Part::Figures {
            what: measure.name(),
            unit: measure.unit(),
            decimals: measure.decimals(),
            labels: vec!["trained on"],
            rows: rig::Experiment::names().map(row).collect(),
        }
    };
    Item {
        number: number.to_owned(),
        title: format!("identification errors of the {words} model"),
        remark: misprints(model.name, form),
        parts: Measure::BOTH.map(part).into(),
    }
}

/// The probable misprints of a table, in a sentence each.
fn misprints(model: &str, form: Form) -> String {
    let of = |experiment: &'static str| {
        let what = published::identification(model, form, experiment)?.misprint?;
        Some(format!("Probably misprinted for {experiment}: {what}."))
    };
    rig::Experiment::names().filter_map(of).collect::<Vec<_>>().join(" ")
}

/// Box plots of cross-validation: one box for each training experiment, over all runs that the model is tested on.
fn boxes(
    results: &Results,
    model: ThesisModel,
    form: Form,
    number: &str,
    words: &str,
    measure: Measure,
) -> Item {
    let row = |experiment: &'static str| {
        let (cell, _) = results.find(model.name, form, experiment)?;
        let figures: Vec<_> =
            cell.cross_validation.iter().filter_map(|test| of(model.predictor, &test.figures)).collect();
        let values: Vec<f64> =
            figures.iter().filter_map(|figure| measure.here(figure.rsse_n, figure.esr)).collect();
        let without = figures.len() - values.len();
        Some(BoxRow {
            name: experiment.to_owned(),
            numbers: BoxPlot::of(values),
            remark: if without > 0 { format!("{without} without figure") } else { String::new() },
            yardstick: false,
        })
    };
    let (quantity, axis) = match measure {
        Measure::Rsse => ("RMSE", "RMSE, lbf"),
        Measure::Esr => ("NMSE", "NMSE"),
    };
    let title = format!("{quantity} of the {words} models in cross-validation, by training experiment");
    Item::boxes(number, title, axis, rig::Experiment::names().filter_map(row).collect())
}

/// Tables 5.1 and 5.2: mean errors of cross-validation by model and training experiment.
pub(super) fn tables_5(results: &Results) -> Vec<Item> {
    let table = |(number, measure): (&str, Measure)| {
        let mut rows = Vec::new();
        for (model, form, words, ..) in CHAPTER_4 {
            for experiment in rig::Experiment::names() {
                if model.name == FUZZY_TANH.name && !STEPPED.contains(&experiment) {
                    continue;
                }
                let found = published::cross_validation(model.name, form, experiment);
                let here = results
                    .find(model.name, form, experiment)
                    .and_then(|(cell, _)| mean(cell, model, measure));
                rows.push(ComparedFigure {
                    of: vec![words.to_owned(), experiment.to_owned()],
                    published: found.as_ref().map(|found| measure.published(found)),
                    here,
                });
            }
        }
        let figures = Part::Figures {
            what: "",
            unit: measure.unit(),
            decimals: measure.decimals(),
            labels: vec!["model", "trained on"],
            rows,
        };
        Item {
            number: number.to_owned(),
            title: format!("mean {} over all test runs", measure.name()),
            remark: String::new(),
            parts: vec![figures],
        }
    };
    [("Table 5.1", Measure::Rsse), ("Table 5.2", Measure::Esr)].map(table).into()
}

/// Mean error over all tests of a cell; `None` if one of them has none.
fn mean(cell: &Finished, model: ThesisModel, measure: Measure) -> Option<f64> {
    let errors = cell.cross_validation.iter().map(|test| {
        let figure = of(model.predictor, &test.figures)?;
        measure.here(figure.rsse_n, figure.esr)
    });
    let errors = errors.collect::<Option<Vec<f64>>>()?;
    (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64)
}

/// The training experiment with the lowest mean NMSE of a model.
pub(super) fn best(results: &Results, model: ThesisModel, form: Form) -> Option<&'static str> {
    let esr = |experiment: &&'static str| {
        let (cell, _) = results.find(model.name, form, experiment)?;
        mean(cell, model, Measure::Esr)
    };
    let with: Vec<(&'static str, f64)> =
        rig::Experiment::names().filter_map(|experiment| Some((experiment, esr(&experiment)?))).collect();
    with.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)).map(|(experiment, _)| experiment)
}
