//! The end of a diagnosis: the model that was found, on all runs.
//!
//! The model is fitted to the training runs from the coefficients of the search; after a search on stretches, the base too. Intervals come from the
//! training runs, the remaining error from the validation runs, and the verdict from these and the test runs.

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

    /// `model`, to which a term was added, fitted to the training runs, if that fits the validation runs as well.
    pub(super) fn with_term(&self, model: &Augmented) -> Result<Fitted, Error> {
        self.fitted(model, WITH_TERM, Fitted::squares_of(model, &self.confirm))
    }

    /// `model`, which was fitted to stretches of the training runs, fitted to all of them.
    fn on_all_rows(&self, model: &Augmented) -> Result<Fitted, Error> {
        self.fitted(model, FINAL, f64::MAX)
    }

    /// `model` fitted to the training runs with at most `evaluations`; as it is if the fit has more than the squared error `most`, N², on the
    /// validation runs.
    fn fitted(&self, model: &Augmented, evaluations: usize, most: f64) -> Result<Fitted, Error> {
        let complete = self.joint().refit(model, evaluations)?;
        match complete.filter(|complete| Fitted::squares_of(&complete.model, &self.confirm) <= most) {
            Some(complete) => Ok(complete),
            None => test_runs::fitted(&self.train, model),
        }
    }

    /// `result`, which was found on stretches of the runs, on all of them.
    pub(super) fn on_all(&self, result: DiagnosisResult) -> Result<DiagnosisResult, Error> {
        let base = self.on_all_rows(&result.before.augmented())?;
        let fitted = match result.is_augmented() {
            true => {
                let own = result.before.effects.terms().iter().count();
                self.on_all_rows(&placed(result.after.augmented(), own, &self.train, &self.confirm)?)?
            }
            false => base.clone(),
        };
        let (force, effects) = (*base.model.force(), *base.model.effects());
        let before = Model { force, effects, ..result.before };
        let completed = self.result(DiagnosisResult { before, ..result }, &fitted)?;
        let rsse_n = completed.confirm.iter().map(|run| run.before.rsse_n);
        let before = model_of(&completed.before, Some(&self.train), &base, rsse_n);
        Ok(DiagnosisResult { before, ..completed })
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
        let rsse_n = confirm.iter().map(|run| run.after.rsse_n);
        let after = model_of(&before, Some(&self.train), fitted, rsse_n);
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
