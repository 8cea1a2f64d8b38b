//! The second paper: ANFIS and fuzzy-tanh, tested on each experiment.
//!
//! The paper counts seven replicates of each experiment with stepped current, one for each step of the current. The error of a step is
//! relative to the variance of the force in this step.

use super::thesis_tables::BOXES;
use super::{ANFIS, FUZZY_TANH, Results, STEPPED, ThesisModel, of};
use mr_damper_model::compare::{BoxPlot, Finished};
use mr_damper_model::force::Form;
use mr_damper_model::identify::{Dataset, walk};
use mr_damper_model::metrics::ErrorSum;
use mr_damper_model::model::Model;
use mr_damper_model::preset::published;
use mr_damper_model::rig;
use mr_damper_reports::box_plot::BoxRow;
use mr_damper_reports::reproduction::{Chapter, ComparedFigure, Item, Part};
use std::ops::ControlFlow;

/// Currents of the steps, A.
const LEVELS_A: [f64; 7] = [0.0, 0.4, 0.8, 1.2, 1.6, 2.1, 2.5];
/// A row belongs to a step if its current is this near to the step's, A.
const NEAR_A: f64 = 0.1;

/// The figures: model, training experiment, number.
const FIGURES: [(ThesisModel, &str, &str); 5] = [
    (ANFIS, "RP-ICPS", "Figure 5"),
    (ANFIS, "RP2-CS", "Figure 6"),
    (FUZZY_TANH, "RP1-CS", "Figure 8"),
    (FUZZY_TANH, "RP2-CS", "Figure 9"),
    (FUZZY_TANH, "RP3-CS", "Figure 10"),
];

/// NMSE of a model on the replicates of one experiment.
struct Tested {
    experiment: &'static str,
    esr: Vec<f64>,
}

/// The chapter.
pub(super) fn chapter(results: &Results) -> Chapter {
    let trained = |model: ThesisModel, on: &[&'static str]| -> Vec<(&'static str, Vec<Tested>)> {
        on.iter().filter_map(|on| Some((*on, tested(results, model, on)?))).collect()
    };
    let all: Vec<&'static str> = rig::Experiment::names().collect();
    let (anfis, fuzzy) = (trained(ANFIS, &all), trained(FUZZY_TANH, &STEPPED));
    let mut items = vec![table_3(&anfis), table_4(&anfis, &fuzzy)];
    for (model, on, number) in FIGURES {
        let of = if model.name == ANFIS.name { &anfis } else { &fuzzy };
        if let Some((_, tests)) = of.iter().find(|(trained_on, _)| *trained_on == on) {
            items.push(boxes(model, on, number, tests));
        }
    }
    Chapter {
        title: "Second paper: fuzzy models".to_owned(),
        remark: "Simulations. On experiments with stepped current each step counts as a replicate, as in the paper; the steps that a model \
                 was trained on are included, because the paper does not leave them out. "
            .to_owned()
            + BOXES,
        items,
    }
}

/// The errors of `model`, trained on `on`, on each experiment.
fn tested(results: &Results, model: ThesisModel, on: &str) -> Option<Vec<Tested>> {
    let (cell, found) = results.find(model.name, Form::SemiActive, on)?;
    let found = found?;
    let of = |experiment: &'static str| Tested {
        experiment,
        esr: match results.experiment(experiment) {
            Some(runs) if STEPPED.contains(&experiment) => {
                runs.replicates.iter().flat_map(|run| by_step(found, &run.data)).collect()
            }
            Some(_) => by_replicate(cell, model, experiment),
            None => Vec::new(),
        },
    };
    Some(rig::Experiment::names().map(of).collect())
}

/// NMSE of the cell's tests on `experiment`.
fn by_replicate(cell: &Finished, model: ThesisModel, experiment: &str) -> Vec<f64> {
    let tests = cell.cross_validation.iter().filter(|test| test.tested_on == experiment);
    tests.filter_map(|test| of(model.predictor, &test.figures)?.esr).collect()
}

/// NMSE of the simulation in each step of the current.
fn by_step(model: &Model, data: &Dataset) -> Vec<f64> {
    let mut sums = LEVELS_A.map(|_| ErrorSum::default());
    let _ = walk(&model.augmented(), data, |row, predicted| {
        let step = LEVELS_A.iter().position(|level_a| (row.drive - level_a).abs() < NEAR_A);
        if let (Some(step), true) = (step, row.counts) {
            sums[step].add(row.force_n, predicted.free_run_n);
        }
        ControlFlow::Continue(())
    });
    sums.iter().filter_map(ErrorSum::fit).map(|fit| fit.esr).filter(|esr| esr.is_finite()).collect()
}

fn mean(esr: &[f64]) -> Option<f64> {
    (!esr.is_empty()).then(|| esr.iter().sum::<f64>() / esr.len() as f64)
}

fn table_3(anfis: &[(&'static str, Vec<Tested>)]) -> Item {
    let row = |on: &'static str, test: &Tested| ComparedFigure {
        of: vec![on.to_owned(), test.experiment.to_owned()],
        published: published::anfis_pair_esr(on, test.experiment),
        here: mean(&test.esr),
    };
    let rows = anfis.iter().flat_map(|(on, tests)| tests.iter().map(move |test| row(on, test))).collect();
    Item {
        number: "Table 3".to_owned(),
        title: "mean NMSE of the ANFIS models on each experiment".to_owned(),
        remark: "The published value of RP2-CS on RP-PRBS is probably 0.10.".to_owned(),
        parts: vec![Part::Figures {
            what: "",
            unit: "",
            decimals: 2,
            labels: vec!["trained on", "tested on"],
            rows,
        }],
    }
}

fn table_4(anfis: &[(&'static str, Vec<Tested>)], fuzzy: &[(&'static str, Vec<Tested>)]) -> Item {
    let rows = |model: ThesisModel, of: &[(&'static str, Vec<Tested>)]| {
        let row = |(on, tests): &(&'static str, Vec<Tested>)| ComparedFigure {
            of: vec![model.name.to_owned(), (*on).to_owned()],
            published: published::average_esr(model.name, on),
            here: mean(&tests.iter().flat_map(|test| test.esr.iter().copied()).collect::<Vec<_>>()),
        };
        of.iter().map(row).collect::<Vec<_>>()
    };
    let rows = [rows(ANFIS, anfis), rows(FUZZY_TANH, fuzzy)].concat();
    Item {
        number: "Table 4".to_owned(),
        title: "mean NMSE over all replicates".to_owned(),
        remark: String::new(),
        parts: vec![Part::Figures {
            what: "",
            unit: "",
            decimals: 2,
            labels: vec!["model", "trained on"],
            rows,
        }],
    }
}

fn boxes(model: ThesisModel, on: &str, number: &str, tests: &[Tested]) -> Item {
    let row = |test: &Tested| BoxRow {
        name: test.experiment.to_owned(),
        numbers: BoxPlot::of(test.esr.iter().copied()),
        remark: String::new(),
        yardstick: false,
    };
    let title = format!("NMSE of {} trained on {on}, by tested experiment", model.name);
    Item::boxes(number, title, "NMSE", tests.iter().map(row).collect())
}
