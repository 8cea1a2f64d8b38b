//! Tests of the demo's report and summary on a short run of the rig.

use super::*;
use mr_damper_model::pipeline::{Models, Pipeline, Settings};
use mr_damper_model::preset;
use mr_damper_model::rig::{self, Channels, Experiment, Plant};

/// Four seconds of the rig; the force is withheld from 2 s to 3 s.
fn outcome() -> DemoOutcome {
    let experiment = Experiment::thesis("RP-ICPS").expect("a known experiment").with_duration_s(4.0);
    let mut run = rig::record(&experiment, &Plant::default(), &Channels::default(), 1);
    let force = run.force_n.as_mut().expect("a rig measures force");
    let withheld: Vec<_> =
        (1024..1536_u32).map(|k| (f64::from(k) / 512.0, force.values[k as usize])).collect();
    force.stamps.drain(1024..1536);
    force.values.drain(1024..1536);
    let models = Models::alone(preset::load(preset::BEST_FUZZY_TANH).expect("a preset"))
        .with_seeded(preset::load(preset::BEST_ARX).expect("a preset"))
        .expect("the two models match");
    let mut pipeline = Pipeline::new(models, Settings::default()).expect("defaults are fine");
    let mut recording = Recording::default();
    for sample in run.samples() {
        pipeline.step(&sample, &mut |event| recording.take(&event));
    }
    let found = recording.evaluation();
    let figure = |name: &str, fit| Figure { name: name.to_owned(), live: fit, offline: fit };
    DemoOutcome {
        what: "a run with <angle brackets> & more".to_owned(),
        figures: vec![
            figure("free run", found.free_run),
            figure("one step", found.one_step),
            figure("nothing", None),
            figure(demo::WITHOUT_FORCE, recording.fit_to(&withheld)),
        ],
        withheld,
        agreement: Some(Agreement::Same(0.0)),
        diagnosis: None,
        notes: vec!["a note".to_owned()],
        counts: vec![("samples".to_owned(), "5".to_owned())],
        settings: vec![("coast_s".to_owned(), "0.2".to_owned())],
        provenance: vec![("seed".to_owned(), "1".to_owned())],
        recording,
    }
}

/// Asserts that every element that is opened is closed, in the right order.
pub(super) fn assert_balanced(html: &str) {
    const VOID: [&str; 3] = ["meta", "!DOCTYPE", "br"];
    let mut open: Vec<&str> = Vec::new();
    for piece in html.split('<').skip(1) {
        let (tag, _) = piece.split_once('>').expect("every tag is closed");
        let name = tag.trim_start_matches('/').split([' ', '/']).next().unwrap_or_default();
        if tag.starts_with('/') {
            assert_eq!(open.pop(), Some(name), "near <{tag}>");
        } else if !tag.ends_with('/') && !VOID.contains(&name) {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "left open: {open:?}");
}

#[test]
fn the_report_shows_the_figures_and_loads_nothing_from_the_network() {
    let outcome = outcome();
    let html = demo::html(&outcome);
    assert_balanced(&html);
    for word in ["http", "src=", "@import", "url(", "NaN", "inf"] {
        assert!(!html.contains(word), "{word} in the report");
    }
    for figure in outcome.figures.iter().filter_map(|figure| figure.live) {
        assert!(
            html.contains(&format!("{:.5}", figure.esr)) && html.contains(&format!("{:.2}", figure.rsse_n))
        );
    }
    for word in
        ["&lt;angle brackets&gt; &amp; more", "arx_coast", "FORCE_LOST", "a note", "are bit-identical"]
    {
        assert!(html.contains(word), "{word} is missing");
    }
    assert!(html.len() < 1_500_000, "{} bytes", html.len());
}

#[test]
fn a_report_without_data_is_a_valid_page() {
    let html = demo::html(&DemoOutcome::default());
    assert_balanced(&html);
    assert!(!html.contains("NaN"));
    assert!(!summary::text(&DemoOutcome::default()).is_empty());
}

#[test]
fn the_summary_is_text_for_a_terminal() {
    let text = summary::text(&outcome());
    assert!(text.lines().all(|line| line.chars().count() <= 110), "{text}");
    // The rig's forces differ in the last bits between machines; the digits shown here do not.
    insta::assert_snapshot!(text);
}
