//! Compares the order of the models here with the published order: how similar they are, where they differ, and what
//! the figures show about the reasons.

use super::published::Published;
use mr_damper_model::compare::{Class, Persistence, Predictor, Summary, kendall_tau};
use std::collections::HashSet;

/// Published means that differ by less than this share count as equal.
const NEAR: f64 = 0.15;
/// Ending of the names of thesis experiments with a stepped current.
const STEPPED: &str = "-CS";

/// A model with its figures in both orders.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranked {
    /// The model, and how it was used in its publication.
    pub class: Class,
    /// The best training experiment in the publication, and the mean NMSE there.
    pub published: (String, f64),
    /// The best training experiment and mean NMSE here; `None` without a mean.
    pub here: Option<(String, f64)>,
}

/// Both orders of the models, and remarks on their differences.
#[derive(Debug, Clone, PartialEq)]
pub struct Orders {
    /// Models in the published order.
    pub ranked: Vec<Ranked>,
    /// Kendall's tau over the models that are in both orders.
    pub tau: Option<f64>,
    /// Kendall's tau with every model in simulation (free run) here, and the published figures unchanged.
    pub tau_free_run: Option<f64>,
    /// Remarks on the differences, one sentence each.
    pub remarks: Vec<String>,
}

/// Compares the orders; `None` when no model is in both.
#[must_use]
pub fn orders(summaries: &[Summary], published: &Published, persistence: &[Persistence]) -> Option<Orders> {
    let here = |class: &Class| {
        let summary = summaries.iter().find(|summary| summary.class == *class)?;
        summary.best().and_then(|row| Some((row.trained_on.clone(), row.mean_esr?)))
    };
    let mut seen = HashSet::new();
    let classes = published.rows.iter().map(|row| Class {
        predictor: row.predictor,
        model: row.model.clone(),
        form: row.form.clone(),
    });
    let mut ranked: Vec<Ranked> = classes
        .filter(|class| seen.insert(class.clone()))
        .filter_map(|class| {
            let (on, esr) = published.best(&class)?;
            Some(Ranked { published: (on.to_owned(), esr), here: here(&class), class })
        })
        .collect();
    ranked.sort_by(|a, b| a.published.1.total_cmp(&b.published.1));
    let both: Vec<(f64, f64)> =
        ranked.iter().filter_map(|r| Some((r.published.1, r.here.as_ref()?.1))).collect();
    if both.is_empty() {
        return None;
    }
    let free = |class: &Class| here(&Class { predictor: Predictor::FreeRun, ..class.clone() });
    let all_free: Vec<(f64, f64)> =
        ranked.iter().filter_map(|r| Some((r.published.1, free(&r.class)?.1))).collect();
    let mut remarks = pairs(&ranked);
    remarks.extend(one_step(&ranked, free, persistence));
    remarks.extend(other_training(&ranked));
    remarks.extend(missing(&ranked, summaries));
    Some(Orders { tau: kendall_tau(&both), tau_free_run: kendall_tau(&all_free), ranked, remarks })
}

/// Remarks on the pairs of models whose order is reversed.
fn pairs(ranked: &[Ranked]) -> Vec<String> {
    let known: Vec<(&Ranked, f64)> = ranked.iter().filter_map(|r| Some((r, r.here.as_ref()?.1))).collect();
    let (mut all, mut turned) = (0, Vec::new());
    for (index, (first, here_first)) in known.iter().enumerate() {
        for (second, here_second) in &known[index + 1..] {
            all += 1;
            if here_first > here_second {
                let near = second.published.1 <= (1.0 + NEAR) * first.published.1;
                turned.push(format!(
                    "{} is before {} in the thesis ({:.4} against {:.4}) but after it here ({here_first:.4} against \
                     {here_second:.4}){}",
                    name(&first.class),
                    name(&second.class),
                    first.published.1,
                    second.published.1,
                    if near { "; the published figures are within 15 % of each other" } else { "" }
                ));
            }
        }
    }
    let mut remarks = vec![format!(
        "{} of {all} pairs of models are in the same order as in the thesis.",
        all - turned.len()
    )];
    remarks.extend(turned.into_iter().map(|text| text + "."));
    remarks
}

/// Remarks that put one-step-ahead figures into perspective when one of them leads.
fn one_step(
    ranked: &[Ranked],
    free: impl Fn(&Class) -> Option<(String, f64)>,
    persistence: &[Persistence],
) -> Vec<String> {
    let mut remarks = Vec::new();
    let stepped = ranked.iter().filter(|r| r.class.predictor == Predictor::OneStep);
    let best_free = ranked
        .iter()
        .filter(|r| r.class.predictor == Predictor::FreeRun)
        .filter_map(|r| r.here.as_ref())
        .map(|(_, esr)| *esr)
        .fold(f64::INFINITY, f64::min);
    let still: Vec<f64> = persistence.iter().filter_map(|p| p.esr).collect();
    let still = still.iter().sum::<f64>() / still.len().max(1) as f64;
    let leading: Vec<String> = stepped
        .clone()
        .filter(|r| r.here.as_ref().is_some_and(|(_, esr)| *esr < best_free))
        .map(|r| name(&r.class))
        .collect();
    if !leading.is_empty() && still > 0.0 && still < best_free {
        remarks.push(format!(
            "{}: given the measured force up to the previous sample, unlike all other models. Persistence, which has no \
             damper model, reaches a mean NMSE of {still:.4} with this input and would be ahead of every simulated model \
             (the best: {best_free:.4}). The lead comes from the input.",
            leading.join(", ")
        ));
    }
    for r in ranked.iter().filter(|r| r.class.predictor == Predictor::SameInstant && r.here.is_some()) {
        remarks.push(format!(
            "{}: the measured force itself is an input, so nothing is predicted and its place among the others means little.",
            name(&r.class)
        ));
    }
    for r in stepped {
        let Some((_, esr)) = &r.here else { continue };
        let own = name(&Class { predictor: Predictor::FreeRun, ..r.class.clone() });
        match free(&r.class) {
            Some((_, free)) if free > *esr => remarks.push(format!(
                "In simulation, like the others, {own} has a mean NMSE of {free:.4} instead of {esr:.4}."
            )),
            None => remarks.push(format!(
                "In simulation, {own} has no mean: it diverges in some test or has no figure there."
            )),
            Some(_) => {}
        }
    }
    remarks
}

/// Remarks on models whose best training experiment has the other kind of current (stepped or varying) than in the thesis.
fn other_training(ranked: &[Ranked]) -> Vec<String> {
    let stepped = |name: &str| name.ends_with(STEPPED);
    let differs =
        |r: &&Ranked| r.here.as_ref().is_some_and(|here| stepped(&here.0) != stepped(&r.published.0));
    ranked
        .iter()
        .filter(differs)
        .filter_map(|r| Some((r, r.here.as_ref()?)))
        .map(|(r, here)| {
            let kind = |on: &str| if stepped(on) { "stepped current" } else { "varying current" };
            format!(
                "{} predicts best when trained on {} ({}); in the thesis on {} ({}).",
                name(&r.class),
                here.0,
                kind(&here.0),
                r.published.0,
                kind(&r.published.0)
            )
        })
        .collect()
}

/// Remarks on published models that have no mean here, with the reason.
fn missing(ranked: &[Ranked], summaries: &[Summary]) -> Vec<String> {
    let why = |class: &Class| {
        let of = |s: &&Summary| s.class.model == class.model && s.class.form == class.form;
        match summaries.iter().find(of) {
            None => "it was not part of this comparison".to_owned(),
            Some(summary) => match summary.failures.first() {
                Some((on, why)) => format!("on {on}: {why}"),
                None => "a test has no figure, so a mean is not defined".to_owned(),
            },
        }
    };
    let without = ranked.iter().filter(|r| r.here.is_none());
    without.map(|r| format!("{} has no place here: {}.", name(&r.class), why(&r.class))).collect()
}

/// Model, form and predictor as text.
#[must_use]
pub fn name(class: &Class) -> String {
    let how = match class.predictor {
        Predictor::FreeRun => "",
        Predictor::OneStep => ", one step ahead",
        Predictor::SameInstant => ", given the force at the same instant",
    };
    format!("{} ({}{how})", class.model, class.form.replace('_', "-"))
}

#[cfg(test)]
mod tests {
    use super::super::published::{Figures, PublishedRow};
    use super::*;
    use mr_damper_model::compare::Row;

    fn class(model: &str, predictor: Predictor) -> Class {
        Class { predictor, model: model.to_owned(), form: "passive".to_owned() }
    }

    fn published(model: &str, predictor: Predictor, on: &str, esr: f64) -> PublishedRow {
        PublishedRow {
            model: model.to_owned(),
            form: "passive".to_owned(),
            predictor,
            experiment: on.to_owned(),
            identification: None,
            cross_validation: Some(Figures { rsse_n: 100.0, esr }),
        }
    }

    fn summary(model: &str, predictor: Predictor, on: &str, esr: f64) -> Summary {
        let row = Row {
            trained_on: on.to_owned(),
            mean_rsse_n: Some(100.0),
            rsse_interval_n: None,
            mean_esr: Some(esr),
            tests: 3,
            without: 0,
        };
        let failures = Vec::new();
        Summary {
            class: class(model, predictor),
            parameters: 4,
            rows: vec![row],
            esr: vec![esr],
            without: 0,
            failures,
        }
    }

    #[test]
    fn differences_from_the_thesis_are_reported_with_their_figures() {
        use Predictor::{FreeRun, OneStep};
        let thesis = Published {
            rows: vec![
                published("arx", OneStep, "RP-ICPS", 0.016),
                published("p", FreeRun, "RP-ICPS", 0.072),
                published("sp", FreeRun, "RP-ICPS", 0.077),
                published("anfis", FreeRun, "RP1-CS", 0.086),
            ],
        };
        let here = [
            summary("anfis", FreeRun, "RP-ICPS", 0.05),
            summary("sp", FreeRun, "RP-ICPS", 0.06),
            summary("arx", FreeRun, "RP-ICPS", 0.3),
            summary("arx", OneStep, "RP-ICPS", 0.004),
        ];
        let still =
            [Persistence { experiment: "a".into(), replicate: 1, rsse_n: Some(9.0), esr: Some(0.02) }];
        let found = orders(&here, &thesis, &still).expect("three models are in both orders");
        assert!((found.tau.expect("an order") - 1.0 / 3.0).abs() < 1e-12);
        assert_eq!(found.tau_free_run, Some(-1.0));
        let all = found.remarks.join("\n");
        for expected in [
            "2 of 3 pairs",
            "sp (passive) is before anfis (passive) in the thesis (0.0770 against 0.0860)",
            "within 15 %",
            "arx (passive, one step ahead): given the measured force",
            "reaches a mean NMSE of 0.0200 with this input",
            "In simulation, like the others, arx (passive) has a mean NMSE of 0.3000 instead of 0.0040",
            "anfis (passive) predicts best when trained on RP-ICPS (varying current); in the thesis on RP1-CS",
            "p (passive) has no place here: it was not part of this comparison",
        ] {
            assert!(all.contains(expected), "{expected}: {all}");
        }
        assert_eq!(orders(&here, &Published::default(), &still), None);
    }
}
