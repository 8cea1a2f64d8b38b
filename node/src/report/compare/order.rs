//! The order of the models here beside the published one: how alike they are, where they differ, and what the figures
//! say of why.

use super::published::Published;
use mr_damper_model::compare::{Class, Persistence, Predictor, Summary, kendall_tau};
use std::collections::HashSet;

/// Published means closer than this share are as good as equal.
const NEAR: f64 = 0.15;
/// Experiments of the thesis with a stepped current end in this.
const STEPPED: &str = "-CS";

/// A model in both orders.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranked {
    /// The model, and how it was used when it was published.
    pub class: Class,
    /// Published mean ESR of the best training experiment, and that experiment.
    pub published: (String, f64),
    /// The same here; `None` where there is no mean.
    pub here: Option<(String, f64)>,
}

/// Both orders.
#[derive(Debug, Clone, PartialEq)]
pub struct Orders {
    /// Models in the published order.
    pub ranked: Vec<Ranked>,
    /// Kendall's tau over those that have both.
    pub tau: Option<f64>,
    /// Kendall's tau when every model runs free here; published figures as they are.
    pub tau_free_run: Option<f64>,
    /// What is to be said of them.
    pub remarks: Vec<String>,
}

/// Compares the orders; `None` when no model has both.
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

/// Each pair that stands the other way round.
fn pairs(ranked: &[Ranked]) -> Vec<String> {
    let known: Vec<(&Ranked, f64)> = ranked.iter().filter_map(|r| Some((r, r.here.as_ref()?.1))).collect();
    let (mut all, mut turned) = (0, Vec::new());
    for (index, (first, here_first)) in known.iter().enumerate() {
        for (second, here_second) in &known[index + 1..] {
            all += 1;
            if here_first > here_second {
                let near = second.published.1 <= (1.0 + NEAR) * first.published.1;
                turned.push(format!(
                    "{} is before {} in the thesis ({:.4} against {:.4}) and after it here ({here_first:.4} against \
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
        "{} of {all} pairs of models stand the same way round as in the thesis.",
        all - turned.len()
    )];
    remarks.extend(turned.into_iter().map(|text| text + "."));
    remarks
}

/// What one-step figures are worth, said when one of them leads.
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
            "{}: given the measured force up to the sample before, as no other model is. Persistence, which knows \
             nothing of dampers, has a mean ESR of {still:.4} that way and would stand before every model that runs \
             free (the best: {best_free:.4}). The place in front is that of the input.",
            leading.join(", ")
        ));
    }
    for r in ranked.iter().filter(|r| r.class.predictor == Predictor::SameInstant && r.here.is_some()) {
        remarks.push(format!(
            "{}: the force is explained by itself and nothing is predicted, so its place beside the others says little.",
            name(&r.class)
        ));
    }
    for r in stepped {
        let Some((_, esr)) = &r.here else { continue };
        let own = name(&Class { predictor: Predictor::FreeRun, ..r.class.clone() });
        match free(&r.class) {
            Some((_, free)) if free > *esr => remarks.push(format!(
                "Running free, as the others do, {own} has a mean ESR of {free:.4} in place of {esr:.4}."
            )),
            None => remarks.push(format!(
                "Running free, {own} has no mean: it diverges in some test, or has no figure there."
            )),
            Some(_) => {}
        }
    }
    remarks
}

/// Models whose best training experiment is of the other kind: stepped against varying current.
fn other_training(ranked: &[Ranked]) -> Vec<String> {
    let stepped = |name: &str| name.ends_with(STEPPED);
    let differs =
        |r: &&Ranked| r.here.as_ref().is_some_and(|here| stepped(&here.0) != stepped(&r.published.0));
    ranked
        .iter()
        .filter(differs)
        .filter_map(|r| Some((r, r.here.as_ref()?)))
        .map(|(r, here)| {
            let kind = |on: &str| if stepped(on) { "current in steps" } else { "varying current" };
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

/// Published models without a mean here, with the reason.
fn missing(ranked: &[Ranked], summaries: &[Summary]) -> Vec<String> {
    let why = |class: &Class| {
        let of = |s: &&Summary| s.class.model == class.model && s.class.form == class.form;
        match summaries.iter().find(of) {
            None => "it was not part of this comparison".to_owned(),
            Some(summary) => match summary.failures.first() {
                Some((on, why)) => format!("on {on}: {why}"),
                None => "a test has no figure, so there is no mean".to_owned(),
            },
        }
    };
    let without = ranked.iter().filter(|r| r.here.is_none());
    without.map(|r| format!("{} has no place here: {}.", name(&r.class), why(&r.class))).collect()
}

/// Model, form and predictor in a few words.
#[must_use]
pub fn name(class: &Class) -> String {
    let how = match class.predictor {
        Predictor::FreeRun => "",
        Predictor::OneStep => ", one step ahead",
        Predictor::SameInstant => ", given the force of the same instant",
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
    fn what_differs_is_said_with_its_figures() {
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
        let found = orders(&here, &thesis, &still).expect("three models have both");
        assert!((found.tau.expect("an order") - 1.0 / 3.0).abs() < 1e-12);
        assert_eq!(found.tau_free_run, Some(-1.0));
        let all = found.remarks.join("\n");
        for wanted in [
            "2 of 3 pairs",
            "sp (passive) is before anfis (passive) in the thesis (0.0770 against 0.0860)",
            "within 15 %",
            "arx (passive, one step ahead): given the measured force",
            "has a mean ESR of 0.0200 that way",
            "Running free, as the others do, arx (passive) has a mean ESR of 0.3000 in place of 0.0040",
            "anfis (passive) predicts best when trained on RP-ICPS (varying current); in the thesis on RP1-CS",
            "p (passive) has no place here: it was not part of this comparison",
        ] {
            assert!(all.contains(wanted), "{wanted}: {all}");
        }
        assert_eq!(orders(&here, &Published::default(), &still), None);
    }
}
