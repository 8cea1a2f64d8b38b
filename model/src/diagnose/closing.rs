//! The closing itself: rounds until nothing more is found, then backwards, then the sealed runs.

use super::finding::{Closing, FloorSource, LeftOver, Mode, Named, NoiseFloor, Refused, Verdict};
use super::joint::{Fitted, Joint};
use super::round::{FINAL, LEAST_CONFIRMED, LEAST_SHARE, Passed, Round};
use super::rows::Rows;
use super::space::without_effect;
use super::{Runs, Settings, Stage, floor, left_over, paired, rival, score, sealed};
use crate::effect::{Augmented, Effect, EffectModel};
use crate::error::Error;
use crate::identify::{Scales, Watch};
use crate::model::Model;
use std::collections::HashMap;

/// Lack of fit up to which there is nothing to explain.
const NOTHING: f64 = 0.1;
/// Share of the explainable error up to which what is left is little.
const LITTLE: f64 = 0.2;
/// Lack of fit above which the base may be at fault.
const INADEQUATE: f64 = 0.5;
/// Share of the explainable error that another base takes away where the given one, with nothing to name, is at fault.
const HALF: f64 = 0.5;
/// What is left to explain, as a share of the first, under which no further effect is sought.
const DONE: f64 = 0.05;
/// Share of squared error by which a refinement of an effect must help, on the estimate runs and on the confirm runs.
const REFINED: f64 = 0.02;

/// Everything that a closing has before it.
pub(super) struct Desk<'a> {
    base: &'a Model,
    settings: &'a Settings,
    watch: &'a Watch<'a>,
    mode: Mode,
    scales: Scales,
    estimate: Rows<'a>,
    confirm: Rows<'a>,
    runs: &'a Runs<'a>,
}

/// What the rounds left behind.
#[derive(Default)]
struct Ledger {
    /// p and class of each effect that was named, by its id.
    named: HashMap<&'static str, (f64, Vec<&'static str>)>,
    /// The base with the first effect that was named.
    first: Option<Augmented>,
    candidates: Vec<super::Candidate>,
    refused: Vec<Refused>,
    untestable: Vec<Refused>,
}

impl<'a> Desk<'a> {
    /// Lays out the rows.
    pub(super) fn new(
        base: &'a Model,
        runs: &'a Runs<'a>,
        settings: &'a Settings,
        watch: &'a Watch<'a>,
    ) -> Result<Self, Error> {
        let mode = if runs.reference.is_empty() { Mode::Absolute } else { Mode::Paired };
        let rows = |datasets| match mode {
            Mode::Absolute => Ok(Rows::new(datasets, settings.most_rows)),
            Mode::Paired => paired::rows(datasets, runs.reference, &base.augmented(), settings.most_rows),
        };
        let (estimate, confirm) = (rows(runs.estimate)?, rows(runs.confirm)?);
        score::check_length(&estimate, settings)?;
        Ok(Self { base, settings, watch, mode, scales: Scales::of(runs.estimate)?, estimate, confirm, runs })
    }

    /// True for an effect that the base brought along: it stays, and is none of the findings.
    fn brought(&self, effect: Effect) -> bool {
        self.base.effects.as_slice().iter().any(|own| own.effect() == effect)
    }

    fn joint(&self) -> Joint<'_> {
        let base_moves = self.mode == Mode::Absolute;
        Joint { rows: &self.estimate, scales: self.scales, base_moves, watch: self.watch }
    }

    fn round(&self, noise: f64, number: usize) -> Round<'_> {
        Round { joint: self.joint(), confirm: &self.confirm, settings: self.settings, noise, number }
    }

    /// Goes through with it.
    pub(super) fn close(&self, stage: &dyn Fn(Stage)) -> Result<Closing, Error> {
        stage(Stage::Base);
        let Some(base) = self.joint().refit(&self.base.augmented(), FINAL)? else {
            return Err(Error::Data {
                message:
                    "the base model does not stay finite on the estimate runs: identify it on them first"
                        .to_owned(),
            });
        };
        let floor = self.noise_floor(&base)?;
        let noise = (floor.rsse_n * floor.rsse_n * self.estimate.len() as f64).min(base.squares);
        let lof_before = 1.0 - noise / base.squares;
        let mut ledger = Ledger::default();
        let mut current = base.clone();
        if lof_before >= NOTHING {
            current = self.name(current, noise, &mut ledger, stage)?;
            stage(Stage::Pruning);
            current = self.refine(current, noise)?;
            current = self.prune(current, noise, &mut ledger)?;
            stage(Stage::Rival);
            if let Some(why) = self.inadequate(&base, ledger.first.as_ref(), &current, floor.rsse_n)? {
                let withdrawn = current.model.effects().as_slice().iter().map(EffectModel::effect);
                let withdrawn = withdrawn.filter(|effect| !self.brought(*effect));
                ledger.refused.extend(withdrawn.map(|effect| Refused { effect, why: why.clone() }));
                current = base.clone();
                stage(Stage::Sealed);
                let closing = self.conclude(&base, &current, floor, noise, ledger)?;
                return Ok(Closing { verdict: Verdict::BaseInadequate, base_fault: Some(why), ..closing });
            }
        }
        stage(Stage::Sealed);
        self.conclude(&base, &current, floor, noise, ledger)
    }

    fn noise_floor(&self, base: &Fitted) -> Result<NoiseFloor, Error> {
        let floor = floor::noise_floor(&self.estimate, &base.model, self.runs.replicates, self.settings)?;
        // A difference of two runs has the noise of both.
        let doubles = self.mode == Mode::Paired && floor.source != FloorSource::Declared;
        let factor = if doubles { 2.0_f64 } else { 1.0 };
        Ok(NoiseFloor { rsse_n: floor.rsse_n * factor.sqrt(), esr: floor.esr * factor, ..floor })
    }

    /// Adds effects as long as one passes.
    fn name(
        &self,
        mut current: Fitted,
        noise: f64,
        ledger: &mut Ledger,
        stage: &dyn Fn(Stage),
    ) -> Result<Fitted, Error> {
        let all = current.squares - noise;
        for number in 1..=self.settings.most_effects {
            if current.squares - noise < DONE * all {
                break;
            }
            stage(Stage::Scores(number));
            let round = self.round(noise, number);
            let (scores, untestable) = score::scores(&round.joint, &self.confirm, &current, self.settings)?;
            if number == 1 {
                ledger.untestable = untestable;
            }
            stage(Stage::Refits(number));
            let outcome = round.run(&current, &scores)?;
            ledger.candidates.extend(outcome.candidates);
            for refused in outcome.refused {
                ledger.refused.retain(|before| before.effect != refused.effect);
                ledger.refused.push(refused);
            }
            let Some(Passed { effect, fitted, class, p_adjusted }) = outcome.passed else { break };
            ledger.refused.retain(|refused| refused.effect.id() != effect.id());
            ledger.named.insert(effect.id(), (p_adjusted, class));
            ledger.first = ledger.first.or(Some(fitted.model));
            current = fitted;
        }
        Ok(current)
    }

    /// Why the base is at fault; `None` when it is not.
    fn inadequate(
        &self,
        base: &Fitted,
        first: Option<&Augmented>,
        current: &Fitted,
        noise_n: f64,
    ) -> Result<Option<String>, Error> {
        if self.mode == Mode::Paired {
            return Ok(None);
        }
        let squares =
            |fitted: &Fitted| sealed::fitted(&self.confirm, &fitted.model).map(|fitted| fitted.squares);
        let (before, after) = (squares(base)?, squares(current)?);
        let noise = noise_n * noise_n * self.confirm.len() as f64;
        if 1.0 - noise / after <= INADEQUATE {
            return Ok(None);
        }
        let Some(rival) =
            rival::rival(self.base, self.runs.estimate, &self.confirm, self.settings.seed, self.watch)?
        else {
            return Ok(None);
        };
        let (own, named) = (self.base.force.name(), current.model.effects() != base.model.effects());
        // With the first effect alone the two are most alike: more of them mend whatever base it is.
        let one = match first.filter(|_| named) {
            Some(first) => sealed::fitted(&self.confirm, first)?.squares,
            None => after,
        };
        let bound = if named { after.max(one) } else { before - HALF * (before - noise).max(0.0) };
        Ok((rival.squares < bound).then(|| {
            format!(
                "the base is at fault: on the confirm runs {} without any effect leaves {:.1} % of the squared error that {own} \
                 leaves, {own} with one effect {:.1} % and with all that was found {:.1} %; take {} as base",
                rival.name,
                100.0 * rival.squares / before,
                100.0 * one / before,
                100.0 * after / before,
                rival.name
            )
        }))
    }

    /// Tries the coil's lag with a time constant each way, where one was named.
    fn refine(&self, current: Fitted, noise: f64) -> Result<Fitted, Error> {
        let effects = current.model.effects().as_slice();
        let Some(index) = effects.iter().position(|e| e.effect() == Effect::CoilLag) else {
            return Ok(current);
        };
        let tau_s = effects[index].parameters()[0];
        let both = EffectModel::new(Effect::CoilLagRiseFall, &[tau_s, tau_s])?;
        let start = super::space::with_effect(&without_effect(&current.model, index)?, both)?;
        let Some(refined) = self.joint().refit(&start, FINAL)? else { return Ok(current) };
        let share = (current.squares - refined.squares) / (current.squares - noise);
        let confirmed = self.round(noise, 0).confirmed(&current.model, &refined.model);
        let better = share >= REFINED && confirmed.is_ok_and(|share| share >= REFINED);
        Ok(if better { refined } else { current })
    }

    /// Takes out what the others do as well.
    fn prune(&self, mut current: Fitted, noise: f64, ledger: &mut Ledger) -> Result<Fitted, Error> {
        let mut index = 0;
        while current.model.effects().as_slice().len() > 1 && index < current.model.effects().as_slice().len()
        {
            let effect = current.model.effects().as_slice()[index].effect();
            if self.brought(effect) {
                index += 1;
                continue;
            }
            let Some(without) = self.joint().refit(&without_effect(&current.model, index)?, FINAL)? else {
                index += 1;
                continue;
            };
            let share = (without.squares - current.squares) / (without.squares - noise);
            let confirmed = self.round(noise, 0).confirmed(&without.model, &current.model);
            if share >= LEAST_SHARE && confirmed.is_ok_and(|share| share >= LEAST_CONFIRMED) {
                index += 1;
                continue;
            }
            ledger.refused.push(Refused {
                effect,
                why: "what was named after it does the same: not needed".to_owned(),
            });
            ledger.named.remove(effect.id());
            current = without;
            index = 0;
        }
        Ok(current)
    }

    /// Reads the sealed runs and says what it all comes to.
    fn conclude(
        &self,
        base: &Fitted,
        current: &Fitted,
        noise_floor: NoiseFloor,
        noise: f64,
        ledger: Ledger,
    ) -> Result<Closing, Error> {
        let round = self.round(noise, 0);
        let all = (base.squares - noise).max(f64::MIN_POSITIVE);
        let mut effects = Vec::new();
        for (index, effect) in current.model.effects().as_slice().iter().enumerate() {
            if self.brought(effect.effect()) {
                continue;
            }
            let id = effect.effect().id();
            let without = without_effect(&current.model, index)?;
            let alone = match without.effects().as_slice().len() == self.base.effects.as_slice().len() {
                true => Some(base.clone()),
                false => self.joint().refit(&without, FINAL)?,
            };
            let (p_adjusted, class) = ledger.named.get(id).cloned().unwrap_or((1.0, vec![id]));
            effects.push(Named {
                effect: *effect,
                class,
                parameters: round.intervals(current, index)?,
                p_adjusted,
                share_removed: alone
                    .as_ref()
                    .map_or(f64::NAN, |alone| (alone.squares - current.squares) / all),
                confirmed: alone
                    .map_or(f64::NAN, |alone| round.confirmed(&alone.model, &current.model).unwrap_or(0.0)),
            });
        }
        let rows = match self.mode {
            Mode::Absolute => Rows::new(self.runs.test, self.settings.most_rows),
            Mode::Paired => paired::rows(
                self.runs.test,
                self.runs.reference,
                &self.base.augmented(),
                self.settings.most_rows,
            )?,
        };
        let test = sealed::read(&rows, &base.model, &current.model, noise_floor.rsse_n, self.settings)?;
        let left_over = self.left_over(base, current, noise_floor.rsse_n)?;
        let held = test.as_ref().is_none_or(|test| test.ratio_ci95[1] < 1.0);
        let verdict = verdict(&left_over, !effects.is_empty() && held);
        let confirm = sealed::changes(&self.confirm, &base.model, &current.model)?;
        Ok(Closing {
            mode: self.mode,
            verdict,
            base_fault: None,
            noise_floor,
            effects,
            refused: ledger.refused,
            untestable: ledger.untestable,
            candidates: ledger.candidates,
            blocks: super::blocks::Blocks::new(&self.estimate, self.settings.block_s).count(),
            before: self.model(base, &confirm, |change| change.before.rsse_n),
            after: self.model(current, &confirm, |change| change.after.rsse_n),
            confirm,
            test,
            left_over,
        })
    }

    /// What is left on the confirm runs, which no coefficient was fitted to.
    fn left_over(&self, base: &Fitted, current: &Fitted, noise_n: f64) -> Result<LeftOver, Error> {
        let on_confirm = |fitted: &Fitted| sealed::fitted(&self.confirm, &fitted.model);
        let (before, after) = (on_confirm(base)?, on_confirm(current)?);
        let noise = noise_n * noise_n * self.confirm.len() as f64;
        let lof = |squares: f64| (1.0 - noise / squares).max(0.0);
        Ok(LeftOver {
            lof: lof(after.squares),
            lof_before: lof(before.squares),
            share: (after.squares - noise).max(0.0) / (before.squares - noise).max(f64::MIN_POSITIVE),
            correlates_with: left_over::correlates_with(&self.confirm, &after.residual_n, self.settings),
        })
    }

    /// `fitted` as a model that can run live: with the mean offset of the estimate runs, and the error of the confirm runs.
    fn model(&self, fitted: &Fitted, confirm: &[super::Change], rsse_n: fn(&super::Change) -> f64) -> Model {
        let offset_n = match self.mode {
            Mode::Paired => 0.0,
            Mode::Absolute => {
                let errors = self.estimate.measured_n().iter().zip(&fitted.predicted_n).map(|(m, p)| m - p);
                errors.sum::<f64>() / self.estimate.len().max(1) as f64
            }
        };
        let force =
            fitted.model.force().with_force_offset_n(fitted.model.force().force_offset_n() + offset_n);
        let squares = confirm.iter().map(|change| rsse_n(change).powi(2)).sum::<f64>();
        let mut model = Model { force, effects: *fitted.model.effects(), ..*self.base };
        model.expected.free_run_rsse_n = Some((squares / confirm.len().max(1) as f64).sqrt());
        model.expected.one_step_rsse_n = None;
        model
    }
}

fn verdict(left: &LeftOver, named: bool) -> Verdict {
    match named {
        _ if left.lof_before < NOTHING => Verdict::NothingToExplain,
        true if left.share <= LITTLE => Verdict::Explained,
        true => Verdict::PartlyExplained,
        false => Verdict::Unexplained,
    }
}
