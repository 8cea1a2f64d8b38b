//! The end of a diagnosis: the model that was found, on all runs.
//!
//! Base and model are fitted to the training runs from the coefficients of the search, and taken if the validation runs agree. Intervals come from
//! the training runs, the remaining error from the validation runs, and the verdict from these and the test runs.

use super::discover::placed;
use super::finding::{DiagnosisResult, NamedEffect, RefusedEffect, Verdict};
use super::interval::{Contents, Intervals};
use super::joint::{Fitted, Joint};
use super::procedure::{model_of, remaining_error, verdict};
use super::refusal::Refusal;
use super::round::FINAL;
use super::rows::Rows;
use super::{Runs, Settings, TestResult, test_runs};
use crate::effect::Augmented;
use crate::error::Error;
use crate::identify::{Scales, Watch};
use crate::model::Model;

/// Evaluations of a refit with a term, whose coefficients were fitted to rows of the same runs.
const WITH_TERM: usize = 12;

/// The runs and settings of a completion.
pub(super) struct Completion<'a> {
    train: Rows<'a>,
    confirm: Rows<'a>,
    test: Rows<'a>,
    scales: Scales,
    settings: &'a Settings,
    watch: &'a Watch<'a>,
}

impl<'a> Completion<'a> {
    /// # Errors
    /// As [`Scales::of`].
    pub(super) fn new(runs: &Runs<'a>, settings: &'a Settings, watch: &'a Watch<'a>) -> Result<Self, Error> {
        let [train, confirm, test] =
            [runs.estimate, runs.confirm, runs.test].map(|runs| Rows::new(runs, settings.most_rows));
        Ok(Self { train, confirm, test, scales: Scales::of(runs.estimate)?, settings, watch })
    }

    fn joint(&self) -> Joint<'_> {
        Joint {
            rows: &self.train,
            scales: self.scales,
            ranges: self.settings.ranges,
            base_moves: true,
            watch: self.watch,
        }
    }

    /// Squared error of `model` on the validation runs, N²; infinite if it cannot be simulated on them.
    fn confirm_squares(&self, model: &Augmented) -> f64 {
        Fitted::as_is(*model, &self.confirm).map_or(f64::INFINITY, |fitted| fitted.squares)
    }

    /// `model`, to which a term was added, fitted to the training runs, if that fits the validation runs as well.
    pub(super) fn with_term(&self, model: &Augmented) -> Result<Fitted, Error> {
        let complete = self.joint().refit(model, WITH_TERM)?;
        let as_good =
            |complete: &Fitted| self.confirm_squares(&complete.model) <= self.confirm_squares(model);
        match complete.filter(as_good) {
            Some(complete) => Ok(complete),
            None => test_runs::fitted(&self.train, model),
        }
    }

    /// `model`, which was fitted to stretches of the training runs, fitted to all of them.
    fn fitted(&self, model: &Augmented) -> Result<Fitted, Error> {
        let complete = self.joint().refit(model, FINAL)?;
        match complete.filter(|complete| self.confirm_squares(&complete.model).is_finite()) {
            Some(complete) => Ok(complete),
            None => test_runs::fitted(&self.train, model),
        }
    }

    /// `result`, which was found on stretches of the runs, on all of them.
    pub(super) fn on_all(&self, result: DiagnosisResult) -> Result<DiagnosisResult, Error> {
        let base = self.fitted(&result.before.augmented())?;
        let fitted = match result.is_augmented() {
            true => {
                let own = result.before.effects.terms().iter().count();
                self.fitted(&placed(result.after.augmented(), own, &self.train, &self.confirm)?)?
            }
            false => base.clone(),
        };
        let on_confirm = test_runs::fitted(&self.confirm, &base.model)?;
        let errors = test_runs::run_errors(&self.confirm, &on_confirm, &on_confirm);
        let before = self.model(&result.before, &base, errors.iter().map(|run| run.before.rsse_n));
        self.result(DiagnosisResult { before, ..result }, &fitted)
    }

    fn model(
        &self,
        base: &Model,
        fitted: &Fitted,
        confirm_rsse_n: impl ExactSizeIterator<Item = f64>,
    ) -> Model {
        model_of(base, Some(&self.train), fitted, confirm_rsse_n)
    }

    /// `result` with the model `fitted`, which has the terms of `result` and may lack some of its effects: the terms have taken these over.
    pub(super) fn result(&self, result: DiagnosisResult, fitted: &Fitted) -> Result<DiagnosisResult, Error> {
        let DiagnosisResult { effects, mut refused, mut discovery, base_fault, before, noise_floor, .. } =
            result;
        let block_s = self.settings.training_block_s();
        let joint = self.joint();
        let intervals = Intervals::new(&joint, fitted, block_s, Contents::All)?;
        let own = before.effects.terms().iter().count();
        let terms = fitted.model.effects().terms().iter().enumerate().skip(own);
        for (found, (index, term)) in discovery.terms.iter_mut().zip(terms) {
            (found.term, found.ci95) = (*term, intervals.of_term(index));
        }
        let mut kept = Vec::with_capacity(effects.len());
        for named in effects {
            match fitted.model.effects().position(named.effect.effect()) {
                Some(index) => kept.push(NamedEffect {
                    effect: fitted.model.effects().as_slice()[index],
                    parameters: intervals.of(index),
                    ..named
                }),
                None => refused
                    .push(RefusedEffect { effect: named.effect.effect(), why: Refusal::TakenOverByTerm }),
            }
        }
        let base = before.augmented();
        let both = test_runs::both(&self.confirm, &base, &fitted.model)?;
        let on_test = test_runs::both(&self.test, &base, &fitted.model)?;
        let confirm = test_runs::run_errors(&self.confirm, &both[0], &both[1]);
        let noise_n = noise_floor.rsse_n;
        let remaining = remaining_error(&self.confirm, [&both[0], &both[1]], noise_n, self.settings);
        let test = test_runs::read(&self.test, &on_test[0], &on_test[1], noise_n, self.settings);
        let held = test.as_ref().is_none_or(TestResult::proves);
        let after = self.model(&before, fitted, confirm.iter().map(|run| run.after.rsse_n));
        // With a term, the base lacks something that is known.
        let base_fault = base_fault.filter(|_| discovery.terms.is_empty());
        let named = held && !(kept.is_empty() && discovery.terms.is_empty());
        let verdict = match base_fault {
            Some(_) => Verdict::BaseInadequate,
            None => verdict(&remaining, named, &self.settings.thresholds),
        };
        Ok(DiagnosisResult {
            verdict,
            effects: kept,
            refused,
            confirm,
            test,
            remaining,
            before,
            after,
            discovery,
            noise_floor,
            base_fault,
            ..result
        })
    }
}
