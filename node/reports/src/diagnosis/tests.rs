//! Tests of text, JSON and page, on diagnoses made by hand.

use super::*;
use crate::augmented_file::{self, TrainingOrigin};
use crate::tests::assert_balanced;
use json::DiagnosisReport;
use mr_damper_model::Error;
use mr_damper_model::diagnose::discover::{
    Claim, CurvePoint, Discovery, FoundTerm, Hum, RefusedTerm, TermRefusal,
};
use mr_damper_model::diagnose::{
    Alignment, BaseFault, Candidate, Change, Correlation, DiagnosisError, DiagnosisMode, DiagnosisResult,
    FloorSource, FoundParameter, MeanShift, NamedEffect, NoInterval, NoiseFloor, Refusal, RefusedEffect,
    RemainingError, RunErrors, Runs, Searched, SinceHealthy, StructureFit, StructureRow, TestResult, Verdict,
};
use mr_damper_model::effect::term::{Argument, Form, Modulator, Term, Terms};
use mr_damper_model::effect::{Effect, EffectModel, Effects};
use mr_damper_model::identify::{
    Dataset, DatasetOptions, ModelSpec, Options, SweptFault, SweptFaultKind, SweptRange, SweptResponse,
    SweptSine, Watch, identify,
};
use mr_damper_model::metrics::Fit;
use mr_damper_model::model::Model;
use mr_damper_model::preset;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::{Drive, DriveKind};
use mr_damper_model::units::{Ampere, MetrePerSecond, Newton};

const fn fit(rsse_n: f64, esr: f64, samples: u64) -> Fit {
    Fit { rsse_n, esr, samples }
}

fn run_errors(run: &str, before_n: f64, after_n: f64) -> RunErrors {
    let of = |rsse_n: f64| fit(rsse_n, (rsse_n / 390.0).powi(2), 15_000);
    RunErrors { run: run.to_owned(), before: of(before_n), after: of(after_n) }
}

fn coil_lag() -> NamedEffect {
    NamedEffect {
        effect: EffectModel::new(Effect::CoilLag, &[0.012]).expect("in range"),
        class: vec!["coil_lag", "force_lag"],
        parameters: vec![FoundParameter {
            name: "tau_s",
            value: 0.012,
            ci95: [0.0114, 0.0126],
            range: [1e-3, 40e-3],
        }],
        p_adjusted: 3.2e-9,
        share_removed: 0.83,
        confirmed: 0.79,
        since_healthy: None,
    }
}

fn friction() -> NamedEffect {
    NamedEffect {
        effect: EffectModel::new(Effect::Friction, &[48.0]).expect("in range"),
        class: vec!["friction"],
        parameters: vec![FoundParameter {
            name: "friction_n",
            value: 48.0,
            ci95: [41.0, 55.0],
            range: [0.0, 240.0],
        }],
        p_adjusted: 0.004,
        share_removed: 0.11,
        confirmed: 0.31,
        since_healthy: None,
    }
}

fn candidate(effect: Effect, round: usize, p: f64, promises: f64, removes: Option<f64>) -> Candidate {
    let p_adjusted = f64::min(17.0 * p, 1.0);
    Candidate { effect, round, identifiable: 0.42, p, p_adjusted, promises, removes }
}

/// A diagnosis of `before` that named the coil's lag and friction, with test runs named `sealed`.
pub(super) fn diagnosis_result(before: Model, test_runs: &[&str]) -> DiagnosisResult {
    let effects = vec![coil_lag(), friction()];
    let models: Vec<EffectModel> = effects.iter().map(|named| named.effect).collect();
    let after = Model { effects: Effects::new(&models).expect("two"), ..before };
    let refused = |effect, why| RefusedEffect { effect, why };
    let worse = Refusal::WorseInValidation { run: "confirm <2>.csv".to_owned(), increase: 0.12 };
    let beyond = Refusal::AtEndOfRange { parameter: "tau_s", value: 0.015, range: [0.0, 0.015] };
    let no_temperature = Refusal::MissingChannel { run: "a.csv".to_owned(), channel: "case_temp_c" };
    DiagnosisResult {
        mode: DiagnosisMode::Absolute,
        verdict: Verdict::Explained,
        base_fault: None,
        noise_floor: NoiseFloor { source: FloorSource::Replicates, rsse_n: 5.0, esr: 1.6e-4 },
        effects,
        refused: vec![
            // Named in a later round.
            refused(Effect::Friction, Refusal::TooSmall { share: 0.08, needed: 0.1 }),
            refused(Effect::Inertia, worse),
            refused(Effect::ForceLag, beyond),
        ],
        untestable: vec![refused(Effect::ThermalFade, no_temperature)],
        candidates: vec![
            candidate(Effect::CoilLag, 1, 1e-11, 0.80, Some(0.83)),
            candidate(Effect::ForceLag, 1, 2e-11, 0.76, Some(0.71)),
            candidate(Effect::Inertia, 1, 1e-4, 0.12, None),
            candidate(Effect::Asymmetry, 1, 0.4, -0.01, None),
            candidate(Effect::Friction, 2, 2e-4, 0.10, Some(0.11)),
            candidate(Effect::Inertia, 2, 0.2, 0.01, None),
        ],
        blocks: 30,
        searched: None,
        confirm: vec![run_errors("confirm.csv", 30.1, 9.4)],
        test: Some(TestResult {
            before: fit(31.0, 0.0063, 30_000),
            after: fit(5.2, 1.8e-4, 30_000),
            ratio: 0.028,
            ratio_ci95: Ok([0.024, 0.033]),
            blocks: 10,
            block_s: 3.0,
            removed: Some(0.99),
            runs: test_runs.iter().map(|run| run_errors(run, 31.0, 5.2)).collect(),
        }),
        discovery: Discovery::default(),
        structures: structures(),
        alignments: Vec::new(),
        mean_shift: None,
        swept: None,
        remaining: RemainingError {
            lof: 0.07,
            lof_before: 0.974,
            share: 0.06,
            correlates_with: vec![
                Correlation { with: "acceleration", coefficient: -0.21 },
                Correlation { with: "drive rate", coefficient: 0.08 },
            ],
        },
        before,
        after,
    }
}

/// One structure of each outcome: it fits worse, it is chosen, it fits about as well, and it cannot be used.
fn structures() -> Vec<StructureRow> {
    let fit = |alone_rsse_n, rsse_n, effects: &[&'static str], fits_as_well, chosen| StructureFit {
        alone_rsse_n,
        rsse_n,
        effects: effects.to_vec(),
        restarts: 12,
        verdict: Verdict::Explained,
        fits_as_well,
        chosen,
    };
    let fits = [
        ("fuzzy-tanh", Ok(fit(44.0, 21.0, &["deadzone"], false, false))),
        ("bouc-wen", Ok(fit(30.1, 9.4, &["coil_lag", "friction"], true, true))),
        ("kwok", Ok(fit(31.2, 31.2, &[], true, false))),
        ("sp", Err(DiagnosisError::BaseDiverges.into())),
    ];
    let row = |(structure, outcome)| StructureRow { structure, given: structure == "fuzzy-tanh", outcome };
    fits.into_iter().map(row).collect()
}

fn base() -> Model {
    preset::load(preset::BEST_FUZZY_TANH).expect("a preset")
}

/// The diagnosis without named effects and with this verdict.
fn without_names(verdict: Verdict) -> DiagnosisResult {
    let found = diagnosis_result(base(), &["sealed-1.csv"]);
    DiagnosisResult { verdict, effects: Vec::new(), after: found.before, test: None, ..found }
}

/// A force that falls by an eighth at 11.5 s. These runs cannot tell time from path.
fn loss_of_force() -> FoundTerm {
    let kind = (Modulator::Force, Argument::Time, Form::Step);
    FoundTerm {
        term: Term::new(kind, -0.126, &[11.5, 0.05], [0.0, 30.0]).expect("valid"),
        claim: Claim::Effect { on_healthy: Some(0.04) },
        class: vec![(Modulator::Force, Argument::Path)],
        p: 0.002,
        confirmed: 0.64,
        ci95: vec![[-0.131, -0.121], [11.4, 11.6], [0.01, 0.09]],
        curve: [(0.0, 0.0), (10.0, 0.002), (20.0, -0.124), (30.0, -0.127)]
            .map(|(argument, value)| CurvePoint { argument, value, ci95: [value - 0.01, value + 0.01] })
            .to_vec(),
    }
}

/// A friction that grows with the drive, which may be structure.
fn drive_friction() -> FoundTerm {
    let kind = (Modulator::SignVelocity, Argument::Drive, Form::Linear);
    FoundTerm {
        term: Term::new(kind, 14.0, &[], [0.0, 2.0]).expect("valid"),
        claim: Claim::EffectOrStructure { on_healthy: None },
        class: Vec::new(),
        p: 0.004,
        confirmed: 0.11,
        ci95: Vec::new(),
        curve: Vec::new(),
    }
}

/// The mount of the load cell swings.
fn resonance() -> FoundTerm {
    let kind = (Modulator::One, Argument::Force, Form::Resonance);
    FoundTerm {
        term: Term::new(kind, 0.3, &[32.0, 0.06], [-900.0, 1100.0]).expect("valid"),
        claim: Claim::Effect { on_healthy: Some(0.002) },
        class: Vec::new(),
        p: 0.0002,
        confirmed: 0.97,
        ci95: vec![[-9.0, 9.6], [31.9, 32.1], [0.058, 0.062]],
        curve: Vec::new(),
    }
}

fn hum() -> Hum {
    Hum {
        frequency_hz: 50.01,
        frequency_ci95_hz: [50.0, 50.02],
        amplitude_n: 28.1,
        amplitude_ci95_n: [27.9, 28.3],
        p: 1e-12,
        share: 0.41,
    }
}

fn bump() -> RefusedTerm {
    let kind = (Modulator::One, Argument::Displacement, Form::Bump);
    RefusedTerm {
        term: Term::new(kind, 9.0, &[0.004, 0.002], [-0.02, 0.02]).expect("valid"),
        why: TermRefusal::NotSignificant { p: 0.21, allowed: 0.01 },
    }
}

/// The diagnosis that found these terms and no effect.
fn with_terms(terms: Vec<FoundTerm>) -> DiagnosisResult {
    let found = DiagnosisResult { effects: Vec::new(), ..diagnosis_result(base(), &["sealed-1.csv"]) };
    let all = Terms::new(&terms.iter().map(|found| found.term).collect::<Vec<_>>()).expect("few enough");
    let after = Model { effects: Effects::NONE.with_terms(all), ..found.before };
    DiagnosisResult { after, discovery: Discovery { terms, refused: Some(bump()), hum: None }, ..found }
}

#[test]
fn the_text_says_what_a_term_is_and_what_may_be_claimed_about_it() {
    let found = with_terms(vec![loss_of_force(), drive_friction()]);
    let text = text(&found, Some(DriveKind::CoilCurrent));
    assert!(text.lines().all(|line| line.chars().count() <= 110), "{text}");
    let terms: Vec<&str> =
        text.lines().skip_while(|line| *line != "Terms beside the effects of the library").collect();
    let terms = terms.split(|line| line.starts_with("Structures")).next().expect("a part");
    insta::assert_snapshot!(terms.join("\n").trim_end());
    let verdict =
        "Explained: term (force, time, step) and term (sign_velocity, drive, linear) account for 94 %";
    assert!(text.starts_with(verdict), "{text}");
    let refused = "\nBest term that was not accepted\n  term (one, displacement, bump), F' = ";
    assert!(text.contains(refused) && text.contains("p is 0.210"), "{text}");
    assert!(!text.contains("Named"), "{text}");
    let volts = short(&found, Some(DriveKind::CommandVoltage));
    assert!(volts.contains("amount = 14.0 N/V"), "{volts}");
}

#[test]
fn a_resonance_and_a_hum_are_said_with_numbers_and_pictures() {
    let found = with_terms(vec![resonance()]);
    let discovery = Discovery { hum: Some(hum()), ..found.discovery };
    let found = DiagnosisResult { discovery, ..found };
    let text = text(&found, Some(DriveKind::CoilCurrent));
    let said: Vec<&str> =
        text.lines().skip_while(|line| *line != "Terms beside the effects of the library").collect();
    let said = said.split(|line| line.starts_with("Structures")).next().expect("a part");
    insta::assert_snapshot!(said.join("\n").trim_end());
    let json = serde_json::to_value(DiagnosisReport::of(&found, Some(DriveKind::CoilCurrent))).expect("JSON");
    assert_eq!(json["hum"]["frequency_hz"], 50.01);
    assert_eq!(
        json["terms"][0]["units"],
        serde_json::json!({ "amount": "N/N", "frequency": "Hz", "damping": "" })
    );
    let page = terms::markup(&found.discovery, Some(DriveKind::CoilCurrent)).into_string();
    for part in ["frequency, Hz", "The gain of the resonance", "hum of 28.1 N", "the mains"] {
        assert!(page.contains(part), "{part}: {page}");
    }
}

#[test]
fn each_claim_has_its_own_words() {
    let say = |claim| terms::claim(claim, None);
    assert_eq!(say(Claim::Effect { on_healthy: None }), "an effect that the library does not have");
    assert_eq!(
        say(Claim::Effect { on_healthy: Some(0.04) }),
        "an effect that the library does not have; on the healthy runs its amount is 4.0 % of this"
    );
    assert_eq!(
        say(Claim::Structure { on_healthy: 0.97 }),
        "the healthy damper has it too: the structure of the base lacks it; on the healthy runs its amount is 97 % of this"
    );
    assert_eq!(
        say(Claim::EffectOrStructure { on_healthy: None }),
        "effect or structure of the base: cannot tell without healthy runs with the same excitation (--healthy)"
    );
    let both = say(Claim::EffectOrStructure { on_healthy: Some(0.3) });
    assert!(both.contains("the healthy runs cannot tell either") && !both.contains("--healthy"), "{both}");
    assert_eq!(
        terms::claim(Claim::Effect { on_healthy: None }, Some("inertia")),
        "an effect; the library has this form as inertia, which was searched and not named"
    );
}

#[test]
fn an_effect_says_whether_the_healthy_damper_has_it() {
    let since = |change| {
        let amount = FoundParameter { value: 0.0031, ci95: [0.0028, 0.0034], ..coil_lag().parameters[0] };
        let named = NamedEffect { since_healthy: Some(SinceHealthy { amount, change }), ..coil_lag() };
        words::since_healthy(&named, None).expect("there are healthy runs")
    };
    let there = "on the healthy runs tau = 0.00310 s, 95 %: 0.00280 to 0.00340 s";
    assert_eq!(since(Change::New), format!("new: the healthy damper does not have it; {there}"));
    assert_eq!(since(Change::None), format!("not new: the healthy damper has it too; {there}"));
    assert_eq!(
        since(Change::Amount),
        format!("changed: the healthy damper has it with another amount; {there}")
    );
    assert_eq!(since(Change::Unknown), "new or not: the healthy runs cannot show it");
    assert_eq!(words::since_healthy(&coil_lag(), None), None);
}

#[test]
fn the_json_has_the_terms_and_the_refused_one() {
    let found = with_terms(vec![loss_of_force(), drive_friction()]);
    let json = serde_json::to_value(DiagnosisReport::of(&found, Some(DriveKind::CoilCurrent))).expect("JSON");
    let shown = serde_json::json!({ "terms": json["terms"], "refused_term": json["refused_term"] });
    insta::assert_snapshot!(serde_json::to_string_pretty(&shown).expect("JSON"));
}

#[test]
fn a_term_without_an_effect_is_a_model_with_curves_after() {
    let (rig, data) = on_the_rig();
    let terms = with_terms(vec![loss_of_force()]);
    let found = DiagnosisResult {
        before: rig.before,
        after: Model { effects: terms.after.effects, ..rig.before },
        ..terms
    };
    let page = html(&DiagnosisOutcome {
        what: String::new(),
        result: &found,
        drive: Some(DriveKind::CoilCurrent),
        traces: vec![RunTrace::of(&found, &data[0], &[])],
        provenance: Vec::new(),
    });
    assert_balanced(&page);
    for word in [
        "term (force, time, step)",
        "No effect of the library was named.",
        "An effect that the library does not have",
        "Hypotheses about the cause, with what would tell them apart.",
        "a fault of the coil; to test it: ",
        "Confirmed for time since the start from 0 to 30 s",
        "Curve of the term (force, time, step) over its argument",
        "The best term that was not accepted:",
        ">after<",
    ] {
        assert!(page.contains(word), "{word} is missing");
    }
    assert!(!page.contains("NaN"));
}

#[test]
fn the_json_is_as_contracted() {
    let found = diagnosis_result(base(), &["sealed-1.csv", "sealed-2.csv"]);
    insta::assert_snapshot!(
        serde_json::to_string_pretty(&DiagnosisReport::of(&found, Some(DriveKind::CoilCurrent)))
            .expect("JSON")
    );
}

#[test]
fn a_search_on_stretches_is_said() {
    let mut found = diagnosis_result(base(), &["sealed-1.csv"]);
    let said =
        |found: &DiagnosisResult| text(found, Some(DriveKind::CoilCurrent)).contains("128 s of the 600 s");
    assert!(!said(&found));
    found.searched = Some(Searched { used_s: 127.8, of_s: 600.2 });
    assert!(said(&found));
    let json = serde_json::to_value(DiagnosisReport::of(&found, Some(DriveKind::CoilCurrent))).expect("JSON");
    assert_eq!(json["searched"], serde_json::json!({ "used_s": 127.8, "of_s": 600.2 }));
}

#[test]
fn unknown_values_are_null_in_json() {
    let mut found = without_names(Verdict::Unexplained);
    found.remaining.share = f64::NAN;
    let json = serde_json::to_value(DiagnosisReport::of(&found, Some(DriveKind::CoilCurrent))).expect("JSON");
    assert!(json["test"].is_null() && json["left_over"]["share"].is_null(), "{json:#}");
    assert_eq!(
        (&json["verdict"], json["effects"].as_array().map(Vec::len)),
        (&"unexplained".into(), Some(0))
    );
}

#[test]
fn the_text_states_the_result_and_its_uncertainty() {
    let found = diagnosis_result(base(), &["sealed-1.csv", "sealed-2.csv"]);
    let text = text(&found, Some(DriveKind::CoilCurrent));
    assert!(text.lines().all(|line| line.chars().count() <= 110), "{text}");
    assert!(!text.contains("named in a later round"), "a named effect is not listed as refused: {text}");
    insta::assert_snapshot!(text);
}

#[test]
fn every_verdict_has_its_own_text() {
    use Verdict::{BaseInadequate, NothingToExplain, PartlyExplained, Unexplained};
    // The text is wrapped: a phrase may continue on the next line.
    let words = |found: &DiagnosisResult| text(found, None).split_whitespace().collect::<Vec<_>>().join(" ");
    let say = |verdict| words(&without_names(verdict));
    assert!(say(NothingToExplain).starts_with("Nothing to explain: "));
    assert!(say(Unexplained).contains("no effect of the library accounts for it"));
    assert!(
        say(Unexplained).contains("give its range with --range"),
        "a refused effect is at the end of its range"
    );
    let within = DiagnosisResult { refused: Vec::new(), ..without_names(Unexplained) };
    assert!(words(&within).contains("effect of your own"));
    let short = DiagnosisResult { blocks: 6, ..without_names(Unexplained) };
    assert!(words(&short).contains("fewer than 10 blocks"));
    assert!(say(BaseInadequate).contains("--reference"));
    let fault = Some(fault());
    let inadequate = DiagnosisResult { base_fault: fault, ..without_names(BaseInadequate) };
    assert!(text(&inadequate, None).contains("): the base is inadequate: on the validation runs, bouc-wen"));
    let paired = DiagnosisResult { mode: DiagnosisMode::Paired, ..without_names(BaseInadequate) };
    let shown = text(&paired, None);
    assert!(!shown.contains("--reference") && shown.contains("Paired mode: "), "{shown}");
    let partly = DiagnosisResult { verdict: PartlyExplained, ..diagnosis_result(base(), &["a"]) };
    assert!(
        text(&partly, None).starts_with("Partly explained: coil_lag (one_tau) and friction account for 94 %")
    );
}

fn fault() -> BaseFault {
    BaseFault {
        base: "sp",
        alternative: "bouc-wen",
        alternative_share: 0.2,
        one_effect_share: 0.6,
        all_effects_share: 0.5,
    }
}

#[test]
fn json_gives_the_code_and_the_numbers_of_each_reason() {
    let found = DiagnosisResult {
        base_fault: Some(fault()),
        refused: vec![RefusedEffect { effect: Effect::CoilLag, why: Refusal::BaseInadequate(fault()) }],
        ..without_names(Verdict::BaseInadequate)
    };
    let json = serde_json::to_value(DiagnosisReport::of(&found, Some(DriveKind::CoilCurrent))).expect("JSON");
    let reason = serde_json::json!({
        "code": "base_inadequate", "base": "sp", "alternative": "bouc-wen", "alternative_share": 0.2, "one_effect_share": 0.6,
        "all_effects_share": 0.5,
    });
    assert_eq!((&json["base_fault_reason"], &json["refused"][0]["reason"]), (&reason, &reason));
    assert_eq!(json["base_fault"], json["refused"][0]["why"]);

    let short = DiagnosisError::TooShort { blocks: 3, needed_blocks: 6, block_s: 3.0, needed_s: 18.0 };
    let code = serde_json::to_value(Error::from(short)).expect("JSON");
    let reason = serde_json::json!({
        "code": "too_short", "blocks": 3, "needed_blocks": 6, "block_s": 3.0, "needed_s": 18.0,
    });
    assert_eq!(code, reason);
}

#[test]
fn only_an_interval_below_one_counts_as_proof() {
    let mut found = diagnosis_result(base(), &["a"]);
    let mut say = |ratio_ci95: Option<[f64; 2]>| {
        if let (Some(test), Some(interval)) = (&mut found.test, ratio_ci95) {
            test.ratio_ci95 = Ok(interval);
        } else {
            found.test = None;
        }
        text(&found, None)
    };
    assert!(!say(Some([0.5, 0.9])).contains("NOT PROVED"));
    assert!(say(Some([0.9, 1.1])).contains("NOT PROVED: on the test run, read once"));
    assert!(say(Some([1.1, 1.3])).contains("grows to"));
    assert!(say(None).contains("NOT PROVED: there were no test runs"));
}

#[test]
fn short_test_runs_give_no_interval_and_say_how_much_motion_is_needed() {
    let short = NoInterval::TooShort { seconds: 9.0, blocks: 3, block_s: 3.0, needed_s: 24.0 };
    let mut found = diagnosis_result(base(), &["a"]);
    found.verdict = Verdict::Unexplained;
    found.test.as_mut().expect("a test").ratio_ci95 = Err(short);
    let words = text(&found, None).split_whitespace().collect::<Vec<_>>().join(" ");
    for part in [
        "the test runs do not prove that coil_lag (one_tau) and friction would reduce it",
        "Give longer test runs",
        "comes to 2.8 % of what it was, without a 95 % interval: the test runs hold 9.0 s of motion",
        "give at least 24 s of motion",
    ] {
        assert!(words.contains(part), "{part} is missing: {words}");
    }
    let json = serde_json::to_value(DiagnosisReport::of(&found, Some(DriveKind::CoilCurrent))).expect("JSON");
    let test = &json["test"];
    assert!(test["ratio_ci95"].is_null() && test["needed_s"] == 24.0, "{test:#}");
    assert!(test["no_interval"].as_str().is_some_and(|why| why.contains("needs 8")), "{test:#}");
}

#[test]
fn an_unknown_noise_floor_is_null_in_json_and_named_in_the_text() {
    let mut found = diagnosis_result(base(), &["a"]);
    found.noise_floor = NoiseFloor { source: FloorSource::Unknown, rsse_n: 0.0, esr: 0.0 };
    let json = serde_json::to_value(DiagnosisReport::of(&found, Some(DriveKind::CoilCurrent))).expect("JSON");
    let floor = &json["noise_floor"];
    assert!(floor["source"] == "unknown" && floor["rsse_n"].is_null() && floor["esr"].is_null(), "{floor:#}");
    let words = text(&found, None).split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(words.contains("noise floor unknown") && !words.contains("0.00 N"), "{words}");
}

/// A diagnosis of a base model without lag, identified on the rig, whose coil has a lag of 12 ms; and two test runs.
fn on_the_rig() -> (DiagnosisResult, Vec<Dataset>) {
    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(12.0);
    let run = |seed| record(&experiment, &Plant::default(), &Channels::default(), seed);
    let options = Options { restarts: 1, choose_velocity: false, ..Options::default() };
    let found = identify(ModelSpec::FUZZY_TANH, &[run(1)], &options, &Watch::none()).expect("it fits");
    let made_up = diagnosis_result(found.model, &["rig RP-ICPS seed 2", "rig RP-ICPS seed 3"]);
    let lag = coil_lag();
    let after = Model { effects: Effects::new(&[lag.effect]).expect("one"), ..found.model };
    let rows = |seed| {
        Dataset::from_run(&run(seed), &found.model.conditioning, &DatasetOptions::default()).expect("rows")
    };
    (DiagnosisResult { effects: vec![lag], after, ..made_up }, vec![rows(2), rows(3)])
}

fn power(trace: &RunTrace, pick: fn(&TracePoint) -> f64) -> f64 {
    trace.points().map(|point| pick(point).powi(2)).sum()
}

#[test]
fn a_report_shows_the_result_and_loads_nothing_from_the_network() {
    let (found, data) = on_the_rig();
    let traces: Vec<RunTrace> = data.iter().map(|data| RunTrace::of(&found, data, &[])).collect();
    for trace in &traces {
        let (before, after) = (power(trace, |p| p.before_n), power(trace, |p| p.after_n));
        assert!(after < 0.7 * before, "the effect reduces the residual: {before} {after}");
        let mean = trace.points().map(|p| p.after_n).sum::<f64>() / trace.points().count() as f64;
        assert!(mean.abs() < 1e-9 && trace.points().count() > 5000);
    }
    let outcome = DiagnosisOutcome {
        what: "a base & <its> runs".to_owned(),
        result: &found,
        drive: Some(DriveKind::CoilCurrent),
        traces,
        provenance: vec![("seed".to_owned(), "0".to_owned())],
    };
    let page = html(&outcome);
    assert_balanced(&page);
    for word in ["http", "src=", "@import", "url(", "NaN", "inf<", ">inf"] {
        assert!(!page.contains(word), "{word} in the report");
    }
    for word in [
        "a base &amp; &lt;its&gt; runs",
        "read once, the squared error falls to 2.8 % of what it was",
        "These runs cannot tell it from force_lag",
        "Excitation that separates confounded effects",
        "motion over a wide band with the current held",
        "95 % intervals of the parameters of the effects",
        ">coil_lag (one_tau): tau<",
        "Structures of the base by their RMSE on the validation runs",
        "Dashed: the noise floor",
        "validation run confirm &lt;2&gt;.csv gets worse with it (+12.0 % squared error)",
        "tau_s is 0.015, at or beyond the end of its physical range",
        "run a.csv has no case_temp_c",
        "coherence with velocity",
        "correlation with slope of the current, directed",
        "rig RP-ICPS seed 3",
        "Round 2",
        "1 more that may be chance",
    ] {
        assert!(page.contains(word), "{word} is missing");
    }
    assert!(page.matches("<svg").count() >= 18, "{}", page.matches("<svg").count());
    assert!(page.len() < 1_500_000, "{} bytes", page.len());
}

#[test]
fn a_report_without_named_effects_is_a_valid_page() {
    let (found, data) = on_the_rig();
    let unnamed = DiagnosisResult {
        verdict: Verdict::Unexplained,
        effects: Vec::new(),
        after: found.before,
        test: None,
        ..found
    };
    let mut outcome = DiagnosisOutcome {
        what: String::new(),
        result: &unnamed,
        drive: None,
        traces: vec![RunTrace::of(&unnamed, &data[0], &[])],
        provenance: Vec::new(),
    };
    let page = html(&outcome);
    assert_balanced(&page);
    assert!(page.contains("pictures below are of the confirm runs") && !page.contains("NaN"));
    assert!(
        !page.contains(">after<") && page.contains("<svg"),
        "without a named effect no curve \"after\" is drawn"
    );
    let mut empty = data[0].clone();
    empty.rows.clear();
    outcome.traces = vec![RunTrace::of(&unnamed, &empty, &[])];
    assert!(html(&outcome).contains("The runs have no residual to draw."));
}

#[test]
fn in_paired_mode_the_text_says_how_runs_were_aligned_and_what_moved_the_mean_force() {
    let aligned = |period_s| Alignment {
        run: "runs/worn.csv".to_owned(),
        reference: "runs/new.csv".to_owned(),
        period_s,
        lag_s: -0.0117,
        offset_m: 0.0019,
        difference: 0.004,
    };
    let paired = DiagnosisResult {
        mode: DiagnosisMode::Paired,
        alignments: vec![aligned(Some(0.95)), aligned(None)],
        mean_shift: Some(MeanShift { force_n: -39.1, ci95_n: [-39.8, -38.4], blocks: 8 }),
        ..without_names(Verdict::NothingToExplain)
    };
    let shown = text(&paired, None).split_whitespace().collect::<Vec<_>>().join(" ");
    for part in [
        "worn.csv on new.csv by crank angle (period 0.950 s); the zeros of displacement are 1.90 mm apart, 0.4 % of",
        "worn.csv on new.csv by time (-0.0117 s);",
        "Since the reference runs the mean force has changed by -39.10 N (95 %: -39.8 to -38.4 N)",
        "the pressure of the gas or the zero of the load cell changed; these runs cannot tell which",
    ] {
        assert!(shown.contains(part), "{part}: {shown}");
    }
    let json =
        serde_json::to_value(DiagnosisReport::of(&paired, Some(DriveKind::CoilCurrent))).expect("JSON");
    assert_eq!(json["alignments"][0]["by"], "crank_angle");
    assert_eq!(json["mean_shift"]["causes"], serde_json::json!(["gas_pressure", "load_cell_zero"]));
    // Within chance there is nothing to say.
    let chance = MeanShift { force_n: 0.3, ci95_n: [-0.4, 1.0], blocks: 8 };
    assert!(!text(&DiagnosisResult { mean_shift: Some(chance), ..paired }, None).contains("mean force"));
}

#[test]
fn in_paired_mode_the_residual_is_the_difference_to_the_healthy_run() {
    let (found, data) = on_the_rig();
    let paired = DiagnosisResult { mode: DiagnosisMode::Paired, ..found.clone() };
    let shifted = |offset_n: f64| {
        let mut other = data[0].clone();
        // Another session: the stamps begin at another time, and the load cell has an offset.
        for row in &mut other.rows {
            row.stamp = row.stamp.shifted(5_000_000_000);
            row.force_n += offset_n;
        }
        other
    };
    // The reference run is chosen by its motion, not by its position in the list.
    let trace = RunTrace::of(&paired, &data[0], &[data[1].clone(), shifted(40.0)]);
    assert!(trace.points().count() > 5000);
    assert!(trace.points().all(|p| p.before_n.abs() < 1e-6), "the same run has no residual");
    // The residual after is reduced by the effect's contribution, because the healthy run contains the effect too.
    let effect = RunTrace::of(&found, &data[0], &[]);
    let made = |p: &TracePoint| p.after_n - p.before_n;
    assert!(trace.points().zip(effect.points()).all(|(a, b)| (made(a) - made(b)).abs() < 1e-6));
    assert!(power(&trace, |p| p.after_n) > 0.0);
}

/// A sweep of four sines, one of them with this fault.
fn swept(kind: Option<SweptFaultKind>) -> SweptRange {
    let sine = |speed_m_s| SweptSine {
        drive: Some(Drive::CoilCurrent(Ampere(0.5))),
        speed: MetrePerSecond(speed_m_s),
        is_above_the_runs: false,
        runs_s: 0.2,
        response: Some(SweptResponse { largest: Newton(900.0), energy_j: 12.0 }),
    };
    let sines: Vec<SweptSine> = [0.06, 0.12, 0.24, 0.36].map(sine).to_vec();
    let faults = kind.map(|kind| SweptFault { sine: sines[2], kind }).into_iter().collect();
    SweptRange { sines, faults, grows: true }
}

#[test]
fn a_fault_beyond_the_runs_stands_beside_the_verdict() {
    let with =
        |kind| DiagnosisResult { swept: Some(swept(kind)), ..diagnosis_result(base(), &["sealed.csv"]) };
    let sound = with(None);
    let calm = "On sines over the range of the runs and half as fast again (0.50 to 0.50 A, up to 0.360 m/s) the force stays bounded";
    let one_line = |text: String| text.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(one_line(text::text(&sound, None)).contains(calm), "{}", text::text(&sound, None));
    assert!(!text::short(&sound, None).contains("sines"), "a short text has no room for it");
    let fault = with(Some(SweptFaultKind::DrivesMotion { energy_j: -3.0 }));
    let warned = "Beyond the runs, on a sine at 0.50 A with a peak speed of 0.240 m/s, where the runs have 0.2 s, the model drives the motion";
    assert!(one_line(text::short(&fault, None)).contains(warned), "{}", text::short(&fault, None));
    let json = serde_json::to_value(DiagnosisReport::of(&fault, None)).expect("JSON");
    assert_eq!(json["swept"]["faults"][0]["code"], "drives_motion");
    assert_eq!(json["swept"]["sines"].as_array().map(Vec::len), Some(4));
}

#[test]
fn a_model_that_diverges_beyond_its_runs_is_not_written() {
    let write = |kind| {
        let result = DiagnosisResult { swept: Some(swept(kind)), ..diagnosis_result(base(), &[]) };
        augmented_file::model_file(&result, &Runs::default(), TrainingOrigin::default())
    };
    assert!(write(None).is_ok());
    let refused = write(Some(SweptFaultKind::Diverges)).expect_err("nothing that diverges is written");
    let said = refused.to_string();
    assert!(
        said.contains("does not stay finite on a sine at 0.50 A with a peak speed of 0.240 m/s"),
        "{said}"
    );
}
