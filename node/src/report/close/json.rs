//! A diagnosis as JSON, schema `mr-damper/close/1`: printed by the command and returned by the action.

use super::words;
use crate::provenance::TOOL;
use mr_damper_model::diagnose::{Candidate, Change, Closing, Correlation, Named, Refused, Sealed};
use mr_damper_model::metrics::Fit;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// The schema's name.
pub const SCHEMA: &str = "mr-damper/close/1";

/// The report. Numbers that are not finite become `null`.
#[derive(Debug, Serialize)]
pub struct Report<'a> {
    schema: &'static str,
    mode: &'static str,
    base: Base<'a>,
    noise_floor: Floor,
    verdict: &'static str,
    base_fault: Option<&'a str>,
    effects: Vec<EffectRow<'a>>,
    refused: Vec<RefusedRow<'a>>,
    untestable: Vec<RefusedRow<'a>>,
    test: Option<SealedRow<'a>>,
    left_over: LeftOverRow,
    confirm: Vec<ChangeRow<'a>>,
    candidates: Vec<CandidateRow>,
    blocks: usize,
}

#[derive(Debug, Serialize)]
struct Base<'a> {
    model: &'a str,
    parameters: usize,
}

#[derive(Debug, Serialize)]
struct Floor {
    source: &'static str,
    rsse_n: f64,
    esr: f64,
}

/// The report with its provenance. The command writes exactly this; the action's answer has some more fields.
#[derive(Debug, Serialize)]
pub struct Written<'a, R> {
    #[serde(flatten)]
    report: Report<'a>,
    tool: &'static str,
    seed: u64,
    seconds: f64,
    runs: Vec<R>,
    /// The model file; `null` when no effect was named.
    model_file: Option<&'a Path>,
}

impl<'a, R: Serialize> Written<'a, R> {
    /// The report on `closing`, which took `seconds` on `runs` with the random seed `seed` and whose model is in
    /// `model_file`.
    #[must_use]
    pub fn new(
        closing: &'a Closing,
        seed: u64,
        seconds: f64,
        runs: impl IntoIterator<Item = R>,
        model_file: Option<&'a Path>,
    ) -> Self {
        let runs = runs.into_iter().collect();
        Self { report: Report::of(closing), tool: TOOL, seed, seconds, runs, model_file }
    }
}

/// Id of an effect, and its form where it has several.
#[derive(Debug, Clone, Copy, Serialize)]
struct Name {
    id: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    form: Option<&'static str>,
}

#[derive(Debug, Serialize)]
struct EffectRow<'a> {
    #[serde(flatten)]
    name: Name,
    class: &'a [&'static str],
    parameters: BTreeMap<&'static str, f64>,
    ci95: BTreeMap<&'static str, [f64; 2]>,
    range: BTreeMap<&'static str, [f64; 2]>,
    p_adjusted: f64,
    share_removed: f64,
    confirmed: f64,
}

#[derive(Debug, Serialize)]
struct RefusedRow<'a> {
    #[serde(flatten)]
    name: Name,
    why: &'a str,
}

#[derive(Debug, Serialize)]
struct SealedRow<'a> {
    before: Fit,
    after: Fit,
    ratio: f64,
    ratio_ci95: [f64; 2],
    removed: Option<f64>,
    runs: Vec<ChangeRow<'a>>,
}

#[derive(Debug, Serialize)]
struct ChangeRow<'a> {
    run: &'a str,
    before: Fit,
    after: Fit,
}

#[derive(Debug, Serialize)]
struct LeftOverRow {
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
    name: Name,
    round: usize,
    identifiable: f64,
    p: f64,
    p_adjusted: f64,
    promises: f64,
    removes: Option<f64>,
}

impl<'a> Report<'a> {
    /// Everything that `closing` found.
    #[must_use]
    pub fn of(closing: &'a Closing) -> Self {
        let (base, floor, left) = (&closing.before.force, &closing.noise_floor, &closing.left_over);
        Self {
            schema: SCHEMA,
            mode: closing.mode.name(),
            base: Base { model: base.name(), parameters: base.parameter_count() },
            noise_floor: Floor { source: floor.source.name(), rsse_n: floor.rsse_n, esr: floor.esr },
            verdict: closing.verdict.name(),
            base_fault: closing.base_fault.as_deref(),
            effects: closing.effects.iter().map(effect).collect(),
            refused: words::refused(closing).into_iter().map(refused).collect(),
            untestable: closing.untestable.iter().map(refused).collect(),
            test: closing.test.as_ref().map(sealed),
            left_over: LeftOverRow {
                lof: left.lof,
                lof_before: left.lof_before,
                share: left.share,
                correlates_with: left.correlates_with.iter().map(correlation).collect(),
            },
            confirm: closing.confirm.iter().map(change).collect(),
            candidates: closing.candidates.iter().map(candidate).collect(),
            blocks: closing.blocks,
        }
    }
}

fn name(effect: mr_damper_model::effect::Effect) -> Name {
    Name { id: effect.id(), form: effect.form() }
}

fn effect(named: &Named) -> EffectRow<'_> {
    EffectRow {
        name: name(named.effect.effect()),
        class: &named.class,
        parameters: named.parameters.iter().map(|p| (p.name, p.value)).collect(),
        ci95: named.parameters.iter().map(|p| (p.name, p.ci95)).collect(),
        range: named.parameters.iter().map(|p| (p.name, p.range)).collect(),
        p_adjusted: named.p_adjusted,
        share_removed: named.share_removed,
        confirmed: named.confirmed,
    }
}

fn refused(refused: &Refused) -> RefusedRow<'_> {
    RefusedRow { name: name(refused.effect), why: &refused.why }
}

fn sealed(sealed: &Sealed) -> SealedRow<'_> {
    SealedRow {
        before: sealed.before,
        after: sealed.after,
        ratio: sealed.ratio,
        ratio_ci95: sealed.ratio_ci95,
        removed: sealed.removed,
        runs: sealed.runs.iter().map(change).collect(),
    }
}

fn change(change: &Change) -> ChangeRow<'_> {
    ChangeRow { run: &change.run, before: change.before, after: change.after }
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
