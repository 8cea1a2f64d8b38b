//! A diagnosis as JSON, schema `mr-damper/close/1`: printed by the command and returned by the action.

use super::{terms, words};
use crate::swept::SweptReport;
use mr_damper_base::provenance::TOOL;
use mr_damper_model::diagnose::discover::{CurvePoint, FoundTerm, Hum, Hypothesis, RefusedTerm};
use mr_damper_model::diagnose::{
    Alignment, Candidate, Correlation, DiagnosisResult, NamedEffect, Refusal, RefusedEffect, RunErrors,
    Searched, SinceHealthy, StructureRow, TestResult,
};
use mr_damper_model::effect::term::Term;
use mr_damper_model::metrics::Fit;
use mr_damper_model::sample::DriveKind;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// The schema's name.
pub const SCHEMA: &str = "mr-damper/close/1";

/// The report. Numbers that are not finite become `null`.
#[derive(Debug, Serialize)]
pub struct DiagnosisReport<'a> {
    schema: &'static str,
    mode: &'static str,
    base: BaseRow<'a>,
    noise_floor: FloorRow,
    verdict: &'static str,
    /// The sentence of `base_fault_reason`.
    base_fault: Option<String>,
    base_fault_reason: Option<Refusal>,
    effects: Vec<EffectRow<'a>>,
    /// Discovered terms; the model has them beside the effects.
    terms: Vec<TermRow>,
    /// The best term that was not accepted.
    refused_term: Option<RefusedTermRow>,
    /// A hum in the measured force; it is not in the model.
    hum: Option<HumRow>,
    refused: Vec<RefusedRow<'a>>,
    untestable: Vec<RefusedRow<'a>>,
    test: Option<TestRow<'a>>,
    left_over: RemainingErrorRow,
    confirm: Vec<RunErrorsRow<'a>>,
    candidates: Vec<CandidateRow>,
    blocks: usize,
    /// The part of the training runs on which effects and terms were searched; `null` if it was all of it.
    searched: Option<SearchedRow>,
    /// The structures that were tried as base; empty if only the given base was diagnosed.
    structures: Vec<StructureJson<'a>>,
    /// How each run was placed on its reference; empty without reference runs.
    alignments: Vec<AlignmentRow<'a>>,
    /// Change of the mean force since the reference runs; `null` without them.
    mean_shift: Option<MeanShiftRow>,
    /// The damper's force of the augmented model on sines over the whole range of the training runs.
    swept: Option<SweptReport>,
}

/// How a run was placed on its reference.
#[derive(Debug, Serialize)]
struct AlignmentRow<'a> {
    run: &'a str,
    reference: &'a str,
    /// `crank_angle` or `time`.
    by: &'static str,
    period_s: Option<f64>,
    lag_s: f64,
    offset_m: f64,
    difference: f64,
}

#[derive(Debug, Serialize)]
struct MeanShiftRow {
    force_n: f64,
    ci95_n: [f64; 2],
    blocks: usize,
    causes: &'static [&'static str],
}

#[derive(Debug, Serialize)]
struct SearchedRow {
    used_s: f64,
    of_s: f64,
}

#[derive(Debug, Serialize)]
struct BaseRow<'a> {
    model: &'a str,
    parameters: usize,
}

#[derive(Debug, Serialize)]
struct FloorRow {
    source: &'static str,
    /// `null` with the source `unknown`.
    rsse_n: Option<f64>,
    esr: Option<f64>,
}

/// The report with its provenance. The command writes exactly this; the action's answer has some more fields.
#[derive(Debug, Serialize)]
pub struct ReportDocument<'a, R> {
    #[serde(flatten)]
    report: DiagnosisReport<'a>,
    tool: &'static str,
    seed: u64,
    seconds: f64,
    runs: Vec<R>,
    /// The model file; `null` when neither an effect nor a term was found.
    model_file: Option<&'a Path>,
}

impl<'a, R: Serialize> ReportDocument<'a, R> {
    /// The report on `result`, which took `seconds` on `runs` with the random seed `seed` and whose model is in
    /// `model_file`. `drive` is the kind of the drive in the runs.
    #[must_use]
    pub fn new(
        result: &'a DiagnosisResult,
        drive: Option<DriveKind>,
        seed: u64,
        seconds: f64,
        runs: impl IntoIterator<Item = R>,
        model_file: Option<&'a Path>,
    ) -> Self {
        let runs = runs.into_iter().collect();
        Self { report: DiagnosisReport::of(result, drive), tool: TOOL, seed, seconds, runs, model_file }
    }
}

/// The report of a diagnosis that failed: written by the command, and returned by the action.
#[derive(Debug, Serialize)]
pub struct FailureDocument {
    schema: &'static str,
    /// The sentence.
    error: String,
    /// Its stable `code` and its fields; `null` if the error is not one of the model crate.
    reason: Option<serde_json::Value>,
}

impl FailureDocument {
    /// The report of the sentence `error`, with the code and the fields of its `reason`.
    #[must_use]
    pub const fn new(error: String, reason: Option<serde_json::Value>) -> Self {
        Self { schema: SCHEMA, error, reason }
    }
}

/// Id of an effect, and its form where it has several.
#[derive(Debug, Clone, Copy, Serialize)]
struct EffectName {
    id: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    form: Option<&'static str>,
}

#[derive(Debug, Serialize)]
struct EffectRow<'a> {
    #[serde(flatten)]
    name: EffectName,
    class: &'a [&'static str],
    parameters: BTreeMap<&'static str, f64>,
    ci95: BTreeMap<&'static str, [f64; 2]>,
    range: BTreeMap<&'static str, [f64; 2]>,
    p_adjusted: f64,
    share_removed: f64,
    confirmed: f64,
    /// `null` without healthy runs.
    since_healthy: Option<SinceHealthyRow>,
}

/// An effect on the healthy runs.
#[derive(Debug, Serialize)]
struct SinceHealthyRow {
    /// `new`, `amount`, `none` or `unknown`.
    change: &'static str,
    parameter: &'static str,
    value: f64,
    ci95: [f64; 2],
}

/// The kind and the numbers of a term.
#[derive(Debug, Serialize)]
struct TermNumbers {
    modulator: &'static str,
    argument: &'static str,
    form: &'static str,
    /// The amount, and the parameters of the form.
    parameters: BTreeMap<&'static str, f64>,
    /// Their units; empty for a share of the force.
    units: BTreeMap<&'static str, String>,
    equation: String,
}

#[derive(Debug, Serialize)]
struct TermRow {
    #[serde(flatten)]
    numbers: TermNumbers,
    /// Of each of `parameters`; empty if there are none.
    ci95: BTreeMap<&'static str, [f64; 2]>,
    /// Range of the argument in the data.
    confirmed_in: [f64; 2],
    sentence: String,
    /// `effect`, `structure` or `effect_or_structure`.
    claim: &'static str,
    /// Amount on the healthy runs as a share of `amount`; `null` without healthy runs that can tell.
    on_healthy: Option<f64>,
    /// Modulator and argument of the pairs that the runs cannot distinguish from the term's.
    class: Vec<[&'static str; 2]>,
    p: f64,
    /// Share of the squared error on the validation runs.
    share_removed: f64,
    hypotheses: Vec<HypothesisRow>,
    /// The curve without a closed form.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    curve: Vec<CurveRow>,
}

/// The curve of a term at one value of its argument, in the unit of the curve.
#[derive(Debug, Serialize)]
struct CurveRow {
    argument: f64,
    value: f64,
    ci95: [f64; 2],
}

#[derive(Debug, Serialize)]
struct HypothesisRow {
    cause: &'static str,
    test: &'static str,
}

#[derive(Debug, Serialize)]
struct RefusedTermRow {
    #[serde(flatten)]
    numbers: TermNumbers,
    /// The sentence of `code`.
    why: String,
    code: &'static str,
}

#[derive(Debug, Serialize)]
struct HumRow {
    frequency_hz: f64,
    frequency_ci95_hz: [f64; 2],
    amplitude_n: f64,
    amplitude_ci95_n: [f64; 2],
    p: f64,
    share: f64,
    sentence: String,
    hypothesis: HypothesisRow,
}

#[derive(Debug, Serialize)]
struct RefusedRow<'a> {
    #[serde(flatten)]
    name: EffectName,
    /// The sentence of `reason`.
    why: String,
    reason: &'a Refusal,
}

#[derive(Debug, Serialize)]
struct TestRow<'a> {
    before: Fit,
    after: Fit,
    ratio: f64,
    /// `null` if the test runs give no interval; then `no_interval` is the reason.
    ratio_ci95: Option<[f64; 2]>,
    no_interval: Option<String>,
    /// Motion that an interval needs, s.
    needed_s: Option<f64>,
    blocks: usize,
    block_s: f64,
    removed: Option<f64>,
    runs: Vec<RunErrorsRow<'a>>,
}

#[derive(Debug, Serialize)]
struct RunErrorsRow<'a> {
    run: &'a str,
    before: Fit,
    after: Fit,
}

#[derive(Debug, Serialize)]
struct RemainingErrorRow {
    lof: f64,
    lof_before: f64,
    share: f64,
    correlates_with: Vec<CorrelationRow>,
}

#[derive(Debug, Serialize)]
struct CorrelationRow {
    with: &'static str,
    coefficient: f64,
}

#[derive(Debug, Serialize)]
struct CandidateRow {
    #[serde(flatten)]
    name: EffectName,
    round: usize,
    identifiable: f64,
    p: f64,
    p_adjusted: f64,
    promises: f64,
    removes: Option<f64>,
}

/// A structure: either its figures or `error`.
#[derive(Debug, Serialize)]
struct StructureJson<'a> {
    structure: &'static str,
    /// True for the base that was given.
    given: bool,
    /// RMSE on the validation runs, N.
    alone_rsse_n: Option<f64>,
    rsse_n: Option<f64>,
    effects: &'a [&'static str],
    /// Random starting points of its identification; 0 for the given base.
    restarts: Option<u32>,
    verdict: Option<&'static str>,
    fits_as_well: bool,
    chosen: bool,
    error: Option<String>,
}

impl<'a> DiagnosisReport<'a> {
    /// Everything that `result` found. `drive` is the kind of the drive in the runs.
    #[must_use]
    pub fn of(result: &'a DiagnosisResult, drive: Option<DriveKind>) -> Self {
        let (base, floor, left) = (&result.before.force, &result.noise_floor, &result.remaining);
        Self {
            schema: SCHEMA,
            mode: result.mode.name(),
            base: BaseRow { model: base.name(), parameters: base.parameter_count() },
            noise_floor: FloorRow {
                source: floor.source.name(),
                rsse_n: floor.is_known().then_some(floor.rsse_n),
                esr: floor.is_known().then_some(floor.esr),
            },
            verdict: result.verdict.name(),
            base_fault: result.base_fault.as_ref().map(ToString::to_string),
            base_fault_reason: result.base_fault.clone().map(Refusal::BaseInadequate),
            effects: result.effects.iter().map(effect).collect(),
            terms: result.discovery.terms.iter().map(|found| term(found, drive)).collect(),
            refused_term: result.discovery.refused.as_ref().map(|refused| refused_term(refused, drive)),
            hum: result.discovery.hum.as_ref().map(hum),
            refused: words::refused(result).into_iter().map(refused).collect(),
            untestable: result.untestable.iter().map(refused).collect(),
            test: result.test.as_ref().map(test_row),
            left_over: RemainingErrorRow {
                lof: left.lof,
                lof_before: left.lof_before,
                share: left.share,
                correlates_with: left.correlates_with.iter().map(correlation).collect(),
            },
            confirm: result.confirm.iter().map(run_errors).collect(),
            candidates: result.candidates.iter().map(candidate).collect(),
            blocks: result.blocks,
            searched: result.searched.map(|Searched { used_s, of_s }| SearchedRow { used_s, of_s }),
            structures: result.structures.iter().map(structure).collect(),
            alignments: result.alignments.iter().map(alignment).collect(),
            mean_shift: result.mean_shift.map(|shift| MeanShiftRow {
                force_n: shift.force_n,
                ci95_n: shift.ci95_n,
                blocks: shift.blocks,
                causes: result.causes_of_mean_shift(),
            }),
            swept: result.swept.as_ref().map(SweptReport::of),
        }
    }
}

fn alignment(of: &Alignment) -> AlignmentRow<'_> {
    AlignmentRow {
        run: &of.run,
        reference: &of.reference,
        by: if of.period_s.is_some() { "crank_angle" } else { "time" },
        period_s: of.period_s,
        lag_s: of.lag_s,
        offset_m: of.offset_m,
        difference: of.difference,
    }
}

fn name(effect: mr_damper_model::effect::Effect) -> EffectName {
    EffectName { id: effect.id(), form: effect.form() }
}

fn structure(row: &StructureRow) -> StructureJson<'_> {
    let fit = row.outcome.as_ref().ok();
    StructureJson {
        structure: row.structure,
        given: row.given,
        alone_rsse_n: fit.map(|fit| fit.alone_rsse_n),
        rsse_n: fit.map(|fit| fit.rsse_n),
        effects: fit.map_or(&[], |fit| &fit.effects),
        restarts: fit.map(|fit| fit.restarts),
        verdict: fit.map(|fit| fit.verdict.name()),
        fits_as_well: fit.is_some_and(|fit| fit.fits_as_well),
        chosen: fit.is_some_and(|fit| fit.chosen),
        error: row.outcome.as_ref().err().map(ToString::to_string),
    }
}

fn effect(named: &NamedEffect) -> EffectRow<'_> {
    EffectRow {
        name: name(named.effect.effect()),
        class: &named.class,
        parameters: named.parameters.iter().map(|p| (p.name, p.value)).collect(),
        ci95: named.parameters.iter().map(|p| (p.name, p.ci95)).collect(),
        range: named.parameters.iter().map(|p| (p.name, p.range)).collect(),
        p_adjusted: named.p_adjusted,
        share_removed: named.share_removed,
        confirmed: named.confirmed,
        since_healthy: named.since_healthy.map(|SinceHealthy { amount, change }| SinceHealthyRow {
            change: change.name(),
            parameter: amount.name,
            value: amount.value,
            ci95: amount.ci95,
        }),
    }
}

fn term_numbers(term: &Term, drive: Option<DriveKind>) -> TermNumbers {
    let (modulator, argument, form) = term.kind();
    let unit = words::drive_unit(drive);
    let numbers = term.numbers(unit);
    TermNumbers {
        modulator: modulator.name(),
        argument: argument.name(),
        form: form.name(),
        parameters: numbers.iter().map(|own| (own.name, own.value)).collect(),
        units: numbers.into_iter().map(|own| (own.name, own.unit)).collect(),
        equation: term.equation(unit),
    }
}

fn term(found: &FoundTerm, drive: Option<DriveKind>) -> TermRow {
    let term = &found.term;
    let numbers = terms::numbers(term, &found.ci95, drive);
    TermRow {
        numbers: term_numbers(term, drive),
        ci95: numbers.iter().filter_map(|number| Some((number.name, number.ci95?))).collect(),
        confirmed_in: term.confirmed_in(),
        sentence: term.sentence(words::drive_unit(drive)),
        claim: found.claim.name(),
        on_healthy: terms::on_healthy(found.claim),
        class: found.class.iter().map(|(modulator, argument)| [modulator.name(), argument.name()]).collect(),
        p: found.p,
        share_removed: found.confirmed,
        hypotheses: found.hypotheses().into_iter().map(hypothesis).collect(),
        curve: found
            .curve
            .iter()
            .map(|&CurvePoint { argument, value, ci95 }| CurveRow { argument, value, ci95 })
            .collect(),
    }
}

fn refused_term(refused: &RefusedTerm, drive: Option<DriveKind>) -> RefusedTermRow {
    let RefusedTerm { term, why } = refused;
    RefusedTermRow { numbers: term_numbers(term, drive), why: why.to_string(), code: why.name() }
}

fn hum(hum: &Hum) -> HumRow {
    let Hum { frequency_hz, frequency_ci95_hz, amplitude_n, amplitude_ci95_n, p, share } = *hum;
    let sentence = hum.sentence();
    let hypothesis = hypothesis(hum.hypothesis());
    HumRow { frequency_hz, frequency_ci95_hz, amplitude_n, amplitude_ci95_n, p, share, sentence, hypothesis }
}

const fn hypothesis(Hypothesis { cause, test }: Hypothesis) -> HypothesisRow {
    HypothesisRow { cause, test }
}

fn refused(refused: &RefusedEffect) -> RefusedRow<'_> {
    RefusedRow { name: name(refused.effect), why: refused.why.to_string(), reason: &refused.why }
}

fn test_row(test: &TestResult) -> TestRow<'_> {
    TestRow {
        before: test.before,
        after: test.after,
        ratio: test.ratio,
        ratio_ci95: test.ratio_ci95.ok(),
        no_interval: test.ratio_ci95.err().map(|why| why.to_string()),
        needed_s: test.ratio_ci95.err().and_then(|why| why.needed_s()),
        blocks: test.blocks,
        block_s: test.block_s,
        removed: test.removed,
        runs: test.runs.iter().map(run_errors).collect(),
    }
}

fn run_errors(errors: &RunErrors) -> RunErrorsRow<'_> {
    RunErrorsRow { run: &errors.run, before: errors.before, after: errors.after }
}

fn correlation(of: &Correlation) -> CorrelationRow {
    CorrelationRow { with: of.with, coefficient: of.coefficient }
}

fn candidate(of: &Candidate) -> CandidateRow {
    CandidateRow {
        name: name(of.effect),
        round: of.round,
        identifiable: of.identifiable,
        p: of.p,
        p_adjusted: of.p_adjusted,
        promises: of.promises,
        removes: of.removes,
    }
}
