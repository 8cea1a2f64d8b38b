//! Chapter 5 of the thesis: mean errors, and force over time and over velocity for the best model of each kind.

use super::{ANFIS, ARX, FUZZY_TANH, P, Results, SP, ThesisModel, thesis_tables};
use crate::commands::compare::drawn::Drawn;
use crate::commands::compare::pictures;
use mr_damper_model::compare::Predictor;
use mr_damper_model::force::Form;
use mr_damper_model::identify::Options;
use mr_damper_reports::compare::{force_time_plot, force_velocity_plots};
use mr_damper_reports::reproduction::{Chapter, Item, Part};

/// The models with the numbers of their figures of force over time and over velocity.
const FIGURES: [(ThesisModel, &str, [&str; 2]); 5] = [
    (ARX, "ARX, one step ahead", ["Figure 5.1", "Figure 5.2"]),
    (SP, "S-P", ["Figure 5.3", "Figure 5.4"]),
    (P, "P, from the measured force of the same instant", ["Figure 5.5", "Figure 5.6"]),
    (ANFIS, "fuzzy (ANFIS)", ["Figure 5.7", "Figure 5.8"]),
    (FUZZY_TANH, "non-linear fuzzy (fuzzy-tanh)", ["Figure 5.9", "Figure 5.10"]),
];

/// Experiment of the figures of force over time, and of those over velocity.
const OVER_TIME: &str = "RP-APRBS";
const OVER_VELOCITY: &str = "RP1-CS";

/// Chapter 5.
pub(super) fn chapter_5(results: &Results) -> Chapter {
    let mut items = thesis_tables::tables_5(results);
    for (model, words, numbers) in FIGURES {
        if let Some((drawn, trained_on)) = drawn(results, model) {
            items.extend(figures(results, &drawn, &format!("{words}, trained on {trained_on}"), numbers));
        }
    }
    Chapter {
        title: "Thesis, chapter 5: comparison of the best models".to_owned(),
        remark: "The best model of each kind is the semi-active one whose training experiment gives the lowest mean NMSE here, which need \
                 not be the experiment of the thesis. Tables have the units of the thesis, plots SI units."
            .to_owned(),
        items,
    }
}

/// The best model of its kind, and its training experiment.
fn drawn(results: &Results, model: ThesisModel) -> Option<(Drawn, &'static str)> {
    let trained_on = thesis_tables::best(results, model, Form::SemiActive)?;
    let name = model.name.to_owned();
    let (_, found) = results.find(model.name, Form::SemiActive, trained_on)?;
    let drawn = match (model.predictor, found) {
        (Predictor::FreeRun, Some(found)) => Drawn::simulated(name, *found),
        (Predictor::OneStep, Some(found)) => Drawn::one_step(name, *found),
        (Predictor::SameInstant, _) => {
            let training = &results.experiment(trained_on)?.replicates.first()?.data;
            Drawn::identified_relation(name, training, training.drive, Options::default().degree)?
        }
        (_, None) => return None,
    };
    Some((drawn, trained_on))
}

fn figures(results: &Results, drawn: &Drawn, words: &str, [time, velocity]: [&str; 2]) -> Vec<Item> {
    let one = std::slice::from_ref(drawn);
    let item = |number: &str, title: String, remark: String, plots| Item {
        number: number.to_owned(),
        title,
        remark,
        parts: vec![Part::Plots(plots)],
    };
    let mut items = Vec::new();
    if let Some(experiment) = results.experiment(OVER_TIME) {
        let plots = pictures::force_time(std::slice::from_ref(experiment), one);
        let plots = plots.iter().map(|picture| (picture.title.clone(), force_time_plot(picture))).collect();
        items.push(item(time, format!("force over time: {words}"), String::new(), plots));
    }
    if let Some(experiment) = results.experiment(OVER_VELOCITY) {
        let (plots, caption) = pictures::force_velocity(std::slice::from_ref(experiment), one);
        let plots = force_velocity_plots(&plots);
        items.push(item(velocity, format!("force over velocity: {words}"), caption, plots));
    }
    items
}
