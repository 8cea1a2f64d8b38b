//! Tests of the report on a comparison made by hand.

use super::*;
use mr_damper_model::compare::{CurrentFigure, Figure, InverseTest, Test};
use published::{Figures, PublishedRow};

fn figure(predictor: Predictor, esr: Option<f64>) -> Figure {
    let note = esr.is_none().then(|| "diverged".to_owned());
    Figure { predictor, rsse_n: esr.map(|esr| 400.0 * esr.sqrt()), esr, note }
}

fn cell(model: &str, on: &str, tested: &str, free: [Option<f64>; 2], stepped: Option<f64>) -> Finished {
    let figures = |free| {
        let one_step = stepped.map(|esr| figure(Predictor::OneStep, Some(esr)));
        std::iter::once(figure(Predictor::FreeRun, free)).chain(one_step).collect::<Vec<_>>()
    };
    Finished {
        model: model.to_owned(),
        form: "semi_active".to_owned(),
        trained_on: on.to_owned(),
        parameters: Some(9),
        identification: figures(free[0]),
        cross_validation: vec![
            Test { tested_on: on.to_owned(), replicate: 2, figures: figures(free[0]) },
            Test { tested_on: tested.to_owned(), replicate: 1, figures: figures(free[1]) },
        ],
        warnings: Vec::new(),
        failure: None,
    }
}

fn cells() -> Vec<Finished> {
    let mut failed = cell("sp", "B", "A", [None, None], None);
    (failed.parameters, failed.failure) = (None, Some("has no <current>".to_owned()));
    failed.identification.clear();
    failed.cross_validation.clear();
    vec![
        cell("arx", "A", "B", [Some(0.2), None], Some(0.004)),
        cell("arx", "B", "A", [Some(0.3), Some(0.4)], Some(0.005)),
        cell("sp", "A", "B", [Some(0.0501), Some(0.06)], None),
        failed,
    ]
}

fn with_outcome(check: impl Fn(&CompareOutcome<'_>)) {
    let cells = cells();
    let summaries = Summary::of(&cells);
    let still =
        [Persistence { experiment: "A".to_owned(), replicate: 1, rsse_n: Some(60.0), esr: Some(0.0225) }];
    let published = Published {
        rows: vec![PublishedRow {
            model: "sp".to_owned(),
            form: "semi_active".to_owned(),
            predictor: Predictor::FreeRun,
            experiment: "A".to_owned(),
            identification: Some(Figures { rsse_n: 117.7, esr: 0.0801 }),
            cross_validation: Some(Figures { rsse_n: 111.65, esr: 0.0813 }),
        }],
    };
    let wave =
        |phase: f64| (0..200).map(|k| f64::from(k) * 0.01).map(|t| (t, (9.0 * t + phase).sin())).collect();
    let picture = ForcePlot {
        title: "1.2 A".to_owned(),
        measured: wave(0.0),
        models: vec![Curve { name: "sp".to_owned(), lines: vec![wave(0.2)] }],
    };
    let times = ["sp", "arx"].map(|model| StepTime {
        model: model.to_owned(),
        form: "semi_active".to_owned(),
        ns_per_step: 21.0,
    });
    let figure = |rmse_a| CurrentFigure { rmse_a: Some(rmse_a), nmse: None, note: None };
    let test = InverseTest { tested_on: "B".to_owned(), replicate: 1, figure: figure(0.321) };
    let inverses = [FinishedInverse {
        method: "wang-hu".to_owned(),
        trained_on: "A".to_owned(),
        identification: Some(figure(0.123)),
        cross_validation: vec![test],
        failure: None,
    }];
    check(&CompareOutcome {
        what: "2 models on 2 experiments".to_owned(),
        facts: vec![("seed".to_owned(), "0".to_owned())],
        cells: &cells,
        summaries: &summaries,
        persistence: &still,
        published: Some(&published),
        step_times: &times,
        inverses: &inverses,
        inverse_ranking: &InverseRow::best(&inverses),
        force_time: vec![picture.clone()],
        force_velocity: vec![picture.clone(), picture],
        force_velocity_caption: "Measured, and models.".to_owned(),
    });
}

#[test]
fn the_report_shows_own_and_published_figures_and_loads_nothing_from_the_network() {
    with_outcome(|outcome| {
        let page = html(outcome);
        for word in ["http", "src=", "@import", "url(", "NaN", "inf", "has no <current>"] {
            assert!(!page.contains(word), "{word} in the report");
        }
        for word in [
            "wang-hu",
            "0.123",
            "0.321",
            "0.0501",
            "0.0801",
            "117.7",
            "26.46",
            "0.0813",
            "1 of 2 failed",
            "has no &lt;current&gt;",
            "Persistence",
            "0.0225",
            "Kendall",
            "without figure",
            "1.2 A",
        ] {
            assert!(page.contains(word), "{word} is missing");
        }
        // The mean of 0.0501 and 0.06.
        assert!(page.contains("0.0550") || page.contains("0.0551"), "{page}");
    });
}

#[test]
fn prediction_and_simulation_figures_never_share_a_table() {
    with_outcome(|outcome| {
        let page = tables::best(outcome).into_string();
        let (free, stepped) = page.split_once("One-step-ahead prediction").expect("both headings");
        assert!(free.contains("0.0501") || free.contains("0.055"), "{free}");
        assert!(!free.contains("0.0045") && !stepped.contains("0.055"), "{page}");
        assert!(stepped.contains("Persistence"));
    });
}

#[test]
fn a_report_without_data_is_a_valid_page() {
    let page = html(&CompareOutcome::default());
    assert!(page.ends_with("</html>") && !page.contains("NaN") && !page.contains("inf"));
}
