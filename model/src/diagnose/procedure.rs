//! The sequence of a diagnosis: rounds until no further effect is found, then pruning, then the test runs.

use super::discover::Discovery;
use super::finding::{
    DiagnosisMode, DiagnosisResult, FloorSource, NamedEffect, NoiseFloor, RefusedEffect, RemainingError,
    Verdict,
};
use super::interval::Contents;
use super::joint::{Fitted, Joint};
use super::paired::{self, Paired, PairedRun};
use super::refusal::{BaseFault, Refusal};
use super::round::{FINAL, Passed, Round, implausible};
use super::rows::{Rows, dot};
use super::space::{with_effect, without_effect};
use super::{Runs, Settings, Stage, Thresholds, alternative, check, correlation, floor, score, test_runs};
use crate::effect::{Augmented, Effect, EffectModel};
use crate::error::{DiagnosisError, Error};
use crate::identify::{Dataset, Scales, Watch};
use crate::model::Model;
use crate::parallel;
use std::collections::HashMap;

/// The inputs of a diagnosis: base, settings, and the rows of its runs.
pub(super) struct Procedure<'a> {
    base: &'a Model,
    /// As given; in paired mode on a cyclic motion, blocks may be as short as a cycle.
    settings: Settings,
    watch: &'a Watch<'a>,
    mode: DiagnosisMode,
    scales: Scales,
    estimate: Rows<'a>,
    /// Sum of the squared force of the training runs, each run's mean removed, N².
    force: f64,
    confirm: Rows<'a>,
    /// The training runs and the validation runs with their references; empty in absolute mode.
    pairs: Vec<PairedRun>,
    confirm_pairs: Vec<PairedRun>,
    runs: &'a Runs<'a>,
    /// The caller compares the base with other structures.
    structure_compared: bool,
}

/// The base alone and the base with the effects found: fitted on the training runs, and evaluated without refitting on the validation
/// runs.
struct Pair {
    base: Fitted,
    found: Fitted,
    base_confirm: Fitted,
    found_confirm: Fitted,
}

/// The base and what the rounds found, before the effects are checked against each other.
pub(super) struct Searched {
    base: Fitted,
    found: Fitted,
    floor: NoiseFloor,
    /// Squared error of the noise on the training rows, N².
    noise: f64,
    /// No round is left, or the last one found nothing.
    complete: bool,
    results: RoundResults,
}

impl Searched {
    /// The base with the effects that the rounds found.
    pub(super) const fn model(&self) -> &Augmented {
        &self.found.model
    }

    /// Lack of fit of the base.
    fn lof(&self) -> f64 {
        1.0 - self.noise / self.base.squares
    }

    /// True if no round is left, or the last one found nothing.
    pub(super) const fn is_complete(&self) -> bool {
        self.complete
    }
}

/// The results of the rounds.
#[derive(Default)]
struct RoundResults {
    /// p and class of each effect that was named, by its id.
    named: HashMap<&'static str, (f64, Vec<&'static str>)>,
    /// The effects of the model at the start of each round, in order.
    starts: Vec<Vec<&'static str>>,
    /// Why the base is inadequate; `None` if it is adequate.
    base_fault: Option<BaseFault>,
    candidates: Vec<super::Candidate>,
    refused: Vec<RefusedEffect>,
    untestable: Vec<RefusedEffect>,
    /// All complete fits so far, each with a different list of effects.
    fits: Vec<Fitted>,
    /// The current model without each of its effects in turn, if it has several.
    without: Vec<Option<Fitted>>,
}

impl RoundResults {
    /// Takes back `effect`, which was named, for the reason `why`; the model `without` it was fitted for that.
    fn withdraw(&mut self, effect: Effect, why: Refusal, without: &Fitted) {
        self.refused.push(RefusedEffect { effect, why });
        self.named.remove(effect.id());
        self.fits.push(without.clone());
    }
}

impl Pair {
    /// The pair with all effects withdrawn: the base alone takes the place of the augmented model.
    fn base_alone(self) -> Self {
        let Self { base, base_confirm, .. } = self;
        Self { found: base.clone(), found_confirm: base_confirm.clone(), base, base_confirm }
    }
}

/// The rows of `datasets` with the force to explain: the measured force, or in paired mode [`paired::rows`].
fn rows<'a>(
    base: &Model,
    runs: &Runs,
    (datasets, first): (&'a [Dataset], usize),
    settings: &Settings,
) -> Result<Paired<'a>, Error> {
    if runs.reference.is_empty() {
        return Ok(Paired { rows: Rows::new(datasets, settings.most_rows), pairs: Vec::new() });
    }
    paired::rows(datasets, (runs.reference, first), &base.augmented(), settings.most_rows)
}

impl<'a> Procedure<'a> {
    /// Checks settings and runs, prepares the rows, and checks that the training runs are long enough.
    pub(super) fn new(
        base: &'a Model,
        runs: &'a Runs<'a>,
        settings: &Settings,
        watch: &'a Watch<'a>,
    ) -> Result<Self, Error> {
        check::check(base, runs, settings)?;
        let mode = if runs.reference.is_empty() { DiagnosisMode::Absolute } else { DiagnosisMode::Paired };
        let [own, others, _] = runs.with_first_reference();
        let [estimate, confirm] = [own, others].map(|own| rows(base, runs, own, settings));
        let (Paired { rows: estimate, pairs }, Paired { rows: confirm, pairs: confirm_pairs }) =
            (estimate?, confirm?);
        let settings =
            Settings { block_s: settings.block_s.or_else(|| paired::period_s(&pairs)), ..*settings };
        score::check_length(&estimate, &settings)?;
        let mut force_n = estimate.measured_n().to_vec();
        estimate.centre(&mut force_n);
        Ok(Self {
            force: dot(&force_n, &force_n),
            base,
            settings,
            watch,
            mode,
            scales: Scales::of(runs.estimate)?,
            estimate,
            confirm,
            pairs,
            confirm_pairs,
            runs,
            structure_compared: false,
        })
    }

    /// Leaves out the check against an alternative structure: the caller compares structures. None of them need be the damper's, so effects
    /// that are too small for that are refused ([`Thresholds::least_of_force`]).
    pub(super) fn with_structure_compared(self) -> Self {
        Self { structure_compared: true, ..self }
    }

    /// True if the base already has `effect`: it is kept and not reported as found.
    fn is_in_base(&self, effect: Effect) -> bool {
        self.base.effects.position(effect).is_some()
    }

    /// The effects of `model` that the base does not have.
    fn findings(&self, model: &Augmented) -> impl Iterator<Item = EffectModel> {
        let effects = model.effects().as_slice().to_vec();
        effects.into_iter().filter(|effect| !self.is_in_base(effect.effect()))
    }

    /// Training and validation runs with their references.
    fn both_pairs(&self) -> impl Iterator<Item = &PairedRun> {
        self.pairs.iter().chain(&self.confirm_pairs)
    }

    fn joint(&self) -> Joint<'_> {
        let base_moves = self.mode == DiagnosisMode::Absolute;
        Joint {
            rows: &self.estimate,
            scales: self.scales,
            ranges: self.settings.ranges,
            base_moves,
            watch: self.watch,
        }
    }

    fn round(&self, noise: f64, number: usize) -> Round<'_> {
        Round {
            joint: self.joint(),
            confirm: &self.confirm,
            settings: &self.settings,
            noise,
            base_reducible: 0.0,
            force: if self.structure_compared { self.force } else { 0.0 },
            number,
        }
    }

    /// Runs the diagnosis.
    pub(super) fn run(&self, stage: &dyn Fn(Stage)) -> Result<DiagnosisResult, Error> {
        let mut searched = self.begin(stage)?;
        while !searched.complete {
            self.next_round(&mut searched, stage)?;
        }
        self.finish(self.check(searched, stage)?, stage)
    }

    /// Fits the base, before the first round.
    pub(super) fn begin(&self, stage: &dyn Fn(Stage)) -> Result<Searched, Error> {
        stage(Stage::Base);
        let Some(base) = self.joint().refit(&self.base.augmented(), FINAL)? else {
            return Err(DiagnosisError::BaseDiverges.into());
        };
        let floor = self.noise_floor(&base)?;
        let noise = (floor.rsse_n * floor.rsse_n * self.estimate.len() as f64).min(base.squares);
        let (found, results) = (base.clone(), RoundResults::default());
        let searched = Searched { base, found, floor, noise, complete: false, results };
        Ok(Searched { complete: searched.lof() < self.settings.thresholds.nothing_left, ..searched })
    }

    /// Refines the effects found and checks them against each other.
    pub(super) fn check(&self, searched: Searched, stage: &dyn Fn(Stage)) -> Result<Searched, Error> {
        if searched.results.named.is_empty() {
            return Ok(searched);
        }
        stage(Stage::Pruning);
        let Searched { noise, mut results, .. } = searched;
        let mut found = self.refine(searched.found, noise)?;
        found = self.prune(found, noise, &mut results)?;
        found = self.exchange(found, noise, &mut results)?;
        found = self.plausible(found, noise, &mut results)?;
        Ok(Searched { found, results, ..searched })
    }

    /// Checks the base, reads the test runs, and puts the result together.
    pub(super) fn finish(&self, searched: Searched, stage: &dyn Fn(Stage)) -> Result<DiagnosisResult, Error> {
        let lof_before = searched.lof();
        let Searched { base, found, floor: base_floor, noise, mut results, .. } = searched;
        let mut pair = self.pair(base, found)?;
        // The model maps input noise to force noise, so the floor is computed again for the augmented model.
        let mut floor = match results.named.is_empty() {
            true => base_floor,
            false => self.noise_floor(&pair.found)?,
        };
        if lof_before >= self.settings.thresholds.nothing_left && !self.structure_compared {
            stage(Stage::Alternative);
            results.base_fault = self.inadequate(&pair, floor.rsse_n, &results.fits)?;
        }
        let why = results.base_fault.clone().map(Refusal::BaseInadequate);
        if let Some(why) = why.or_else(|| self.something_else(&pair, noise)) {
            let withdrawn = self.findings(&pair.found.model).map(|effect| effect.effect());
            results.refused.extend(withdrawn.map(|effect| RefusedEffect { effect, why: why.clone() }));
            results.named.clear();
            (pair, floor) = (pair.base_alone(), base_floor);
        }
        stage(Stage::TestRuns);
        self.conclude(&pair, floor, noise, results)
    }

    fn pair(&self, base: Fitted, found: Fitted) -> Result<Pair, Error> {
        let [base_confirm, found_confirm] = test_runs::both(&self.confirm, &base.model, &found.model)?;
        Ok(Pair { base, found, base_confirm, found_confirm })
    }

    fn noise_floor(&self, fitted: &Fitted) -> Result<NoiseFloor, Error> {
        let given = self.settings.noise_floor_n.is_some() || !self.runs.replicates.is_empty();
        if let Some(rsse_n) = paired::noise_n(&self.pairs).filter(|_| !given) {
            let esr = rsse_n * rsse_n * self.estimate.len() as f64 / self.estimate.spread();
            return Ok(NoiseFloor { source: FloorSource::Cycles, rsse_n, esr });
        }
        let floor = floor::noise_floor(&self.estimate, &fitted.model, self.runs.replicates, &self.settings)?;
        // The difference of two runs contains the noise of both.
        let doubles = self.mode == DiagnosisMode::Paired && floor.source != FloorSource::Declared;
        let factor = if doubles { 2.0_f64 } else { 1.0 };
        let floor = NoiseFloor { rsse_n: floor.rsse_n * factor.sqrt(), esr: floor.esr * factor, ..floor };
        let contradicted = floor.rsse_n * floor.rsse_n * self.estimate.len() as f64
            > self.settings.thresholds.floor_contradicted * fitted.squares;
        Ok(if floor.source == FloorSource::Estimated && contradicted { NoiseFloor::UNKNOWN } else { floor })
    }

    /// Adds at most one effect. The search is complete if no candidate passes.
    pub(super) fn next_round(&self, searched: &mut Searched, stage: &dyn Fn(Stage)) -> Result<(), Error> {
        let Searched { base, found, noise, results, complete, .. } = searched;
        let base_reducible = base.squares - *noise;
        *complete |= found.squares - *noise < self.settings.thresholds.least_of_base * base_reducible;
        if *complete {
            return Ok(());
        }
        results.starts.push(found.model.effects().ids().collect());
        let number = results.starts.len();
        stage(Stage::Scores(number));
        // On a single motion, effects that the runs cannot tell from a named one would share its change.
        let taken = results.named.values().flat_map(|(_, class)| class.iter().copied());
        let settings = match self.mode {
            DiagnosisMode::Paired => {
                Settings { effects: self.settings.effects.without(taken), ..self.settings }
            }
            DiagnosisMode::Absolute => self.settings,
        };
        let round = Round { base_reducible, settings: &settings, ..self.round(*noise, number) };
        let scores = score::scores(&round.joint, &self.confirm, found, &settings)?;
        stage(Stage::Refits(number));
        let outcome = round.run(found, &scores)?;
        if number == 1 {
            results.untestable = scores.untestable;
        }
        results.candidates.extend(outcome.candidates);
        for refused in outcome.refused {
            results.refused.retain(|before| before.effect != refused.effect);
            results.refused.push(refused);
        }
        *complete = number == self.settings.most_effects || outcome.passed.is_none();
        if let Some(Passed { effect, fitted, class, p_adjusted }) = outcome.passed {
            results.refused.retain(|refused| refused.effect.id() != effect.id());
            results.named.insert(effect.id(), (p_adjusted, class));
            results.fits.push(fitted.clone());
            *found = fitted;
        }
        Ok(())
    }

    /// In paired mode, why the effects found are not the change since the references; `None` if they may be.
    fn something_else(&self, pair: &Pair, noise: f64) -> Option<Refusal> {
        let share =
            (pair.base.squares - pair.found.squares) / (pair.base.squares - noise).max(f64::MIN_POSITIVE);
        let found = self.findings(&pair.found.model).next().is_some();
        let needed = self.settings.thresholds.most_of_change;
        (self.mode == DiagnosisMode::Paired && found && share < needed)
            .then_some(Refusal::MostIsSomethingElse { share, needed })
    }

    /// Why the base is inadequate; `None` if it is adequate.
    fn inadequate(&self, pair: &Pair, noise_n: f64, fits: &[Fitted]) -> Result<Option<BaseFault>, Error> {
        if self.mode == DiagnosisMode::Paired || alternative::is_one(self.base) {
            return Ok(None);
        }
        let (before, after) = (pair.base_confirm.squares, pair.found_confirm.squares);
        let noise = noise_n * noise_n * self.confirm.len() as f64;
        if 1.0 - noise / after <= self.settings.thresholds.lack_of_fit {
            return Ok(None);
        }
        let (alternative, one) = rayon::join(
            || {
                alternative::identify(
                    self.base,
                    self.runs.estimate,
                    &self.confirm,
                    self.settings.seed,
                    self.watch,
                )
            },
            || self.with_one(pair, fits),
        );
        let (Some(alternative), one) = (alternative?, one?) else { return Ok(None) };
        let (named, one) = (one.is_some(), one.unwrap_or(after));
        let bound = if named {
            after.max(one)
        } else {
            before - self.settings.thresholds.alternative_removes * (before - noise).max(0.0)
        };
        Ok((alternative.squares < bound).then(|| BaseFault {
            base: self.base.force.name(),
            alternative: alternative.name,
            alternative_share: alternative.squares / before,
            one_effect_share: one / before,
            all_effects_share: after / before,
        }))
    }

    /// Least squared error of the base with one of the effects found, on the validation rows; `None` if none was found. The comparison
    /// with the alternative structure is fairest with one effect: several effects improve any base.
    fn with_one(&self, pair: &Pair, fits: &[Fitted]) -> Result<Option<f64>, Error> {
        let effects: Vec<EffectModel> = self.findings(&pair.found.model).collect();
        if effects.len() < 2 {
            return Ok(effects.first().map(|_| pair.found_confirm.squares));
        }
        let with = |effect: &EffectModel| {
            let start = with_effect(&pair.base.model, *effect)?;
            let Some(one) = self.fitted(fits, &start)? else { return Ok(f64::INFINITY) };
            Ok(test_runs::fitted(&self.confirm, &one.model)?.squares)
        };
        let squares: Vec<f64> = parallel::map(&effects, with).into_iter().collect::<Result<_, Error>>()?;
        Ok(squares.into_iter().reduce(f64::min))
    }

    /// Tries the refined form of each effect that has one: a coil lag with separate time constants for rise and fall, or friction with a
    /// velocity scale of its own.
    fn refine(&self, mut current: Fitted, noise: f64) -> Result<Fitted, Error> {
        for plain in Effect::ALL.into_iter().filter(|effect| effect.refined().is_some()) {
            let Some(index) = current.model.effects().position(plain) else { continue };
            let Some(refined) = current.model.effects().as_slice()[index].refined() else { continue };
            let start = with_effect(&without_effect(&current.model, index)?, refined)?;
            let Some(refined) = self.joint().refit(&start, FINAL)? else { continue };
            let share = (current.squares - refined.squares) / (current.squares - noise);
            let confirmed = self.round(noise, 0).confirmed(&current.model, &refined.model);
            let needed = self.settings.thresholds.least_refinement;
            if share >= needed && confirmed.is_ok_and(|share| share >= needed) {
                current = refined;
            }
        }
        Ok(current)
    }

    /// Removes effects whose part the other effects can take over.
    fn prune(&self, mut current: Fitted, noise: f64, results: &mut RoundResults) -> Result<Fitted, Error> {
        // A single effect was already tested against the base alone.
        while results.named.len() > 1 {
            results.without = self.without_each(&current, &results.fits)?;
            let effects = current.model.effects().as_slice();
            let needless = |(index, without): (usize, &Option<Fitted>)| {
                let why = self.needed(effects[index].effect(), &current, without.as_ref()?, noise).err()?;
                Some((index, why))
            };
            let Some((index, why)) = results.without.iter().enumerate().find_map(needless) else { break };
            let effect = effects[index].effect();
            let Some(without) = results.without.swap_remove(index) else { break };
            results.withdraw(effect, why, &without);
            current = without;
        }
        Ok(current)
    }

    /// Searches each of several effects again among its confounders, in the presence of the others. An effect was chosen, and its class
    /// found, while the error of those named after it was still there, which may have hidden that another one fits better. The effect of
    /// a round that began with all the others is not searched again.
    fn exchange(&self, mut current: Fitted, noise: f64, results: &mut RoundResults) -> Result<Fitted, Error> {
        if results.named.len() < 2 {
            return Ok(current);
        }
        let named: Vec<Effect> = self.findings(&current.model).map(|effect| effect.effect()).collect();
        for effect in named {
            let Some(index) = current.model.effects().position(effect) else { continue };
            let Some(without) = results.without[index].clone() else { continue };
            if results.starts.iter().any(|start| without.model.effects().ids().eq(start.iter().copied())) {
                continue;
            }
            let Some(effects) = self.settings.effects.among(effect) else { continue };
            let settings = Settings { effects, ..self.settings };
            let round = Round { settings: &settings, ..self.round(noise, 0) };
            let scores = score::scores(&round.joint, &self.confirm, &without, &settings)?;
            let Some(passed) = round.run(&without, &scores)?.passed else { continue };
            let (found, mut class) = (passed.effect, passed.class);
            if found != effect && passed.fitted.squares < current.squares {
                let left = (without.squares - noise).max(f64::MIN_POSITIVE);
                let share = |fitted: &Fitted| (without.squares - fitted.squares) / left;
                let why = Refusal::OtherRemovesMore {
                    share: share(&current),
                    other: found.title(),
                    other_share: share(&passed.fitted),
                };
                results.refused.retain(|refused| refused.effect.id() != found.id());
                results.refused.push(RefusedEffect { effect, why });
                results.named.remove(effect.id());
                results.named.insert(found.id(), (passed.p_adjusted, class));
                results.fits.push(passed.fitted.clone());
                current = passed.fitted;
                results.without = self.without_each(&current, &results.fits)?;
            } else if let Some((_, known)) = results.named.get_mut(found.id()) {
                // A model has one form of an id, so a member whose id is there in another form could not be tested again.
                let beside: Vec<&str> = without.model.effects().ids().collect();
                class.extend(known.iter().filter(|id| beside.contains(id)));
                *known = class;
            }
        }
        Ok(current)
    }

    /// Removes effects whose parameters are not plausible beside the others: an effect was accepted before those named after it.
    fn plausible(
        &self,
        mut current: Fitted,
        noise: f64,
        results: &mut RoundResults,
    ) -> Result<Fitted, Error> {
        while results.named.len() > 1 {
            let joint = self.joint();
            let round = self.round(noise, 0);
            let intervals = round.intervals(&current, Contents::All)?;
            let effects = current.model.effects().as_slice();
            let objection = |(index, effect): (usize, &EffectModel)| {
                results.named.contains_key(effect.effect().id()).then_some(())?;
                let why = intervals.of(index).iter().find_map(|found| implausible(effect, found, &joint))?;
                Some((index, effect.effect(), why))
            };
            let Some((index, effect, why)) = effects.iter().enumerate().find_map(objection) else { break };
            let Some(without) = results.without.get(index).cloned().flatten() else { break };
            results.withdraw(effect, why, &without);
            results.without = self.without_each(&without, &results.fits)?;
            current = without;
        }
        Ok(current)
    }

    /// The base with the effects of `start`, fitted: taken from `fits` if it is there, otherwise fitted from `start`.
    fn fitted(&self, fits: &[Fitted], start: &Augmented) -> Result<Option<Fitted>, Error> {
        let before = fits.iter().find(|fit| fit.model.effects().same_kinds(start.effects()));
        before.map_or_else(|| self.joint().refit(start, FINAL), |fit| Ok(Some(fit.clone())))
    }

    /// `current` without each of its effects in turn, refitted. `None` for an effect that the base already has, or if the model does not
    /// run without the effect.
    fn without_each(&self, current: &Fitted, fits: &[Fitted]) -> Result<Vec<Option<Fitted>>, Error> {
        let effects = current.model.effects().as_slice();
        let without = |index: usize| {
            if self.is_in_base(effects[index].effect()) {
                return Ok(None);
            }
            self.fitted(fits, &without_effect(&current.model, index)?)
        };
        parallel::map_indices(effects.len(), without).into_iter().collect()
    }

    /// Rejects `effect` if `current` is not better than `without` it by the least share required of an effect.
    fn needed(&self, effect: Effect, current: &Fitted, without: &Fitted, noise: f64) -> Result<(), Refusal> {
        let round = self.round(noise, 0);
        let drop = without.squares - current.squares;
        let confirmed = round.confirmed(&without.model, &current.model);
        let needed = drop / (without.squares - noise) >= self.settings.thresholds.least_share
            && confirmed.is_ok_and(|share| share >= self.settings.thresholds.least_confirmed);
        if needed { round.beyond_structure(effect, drop) } else { Err(Refusal::NotNeeded) }
    }

    /// Reads the test runs and puts the result together.
    fn conclude(
        &self,
        pair: &Pair,
        noise_floor: NoiseFloor,
        noise: f64,
        mut results: RoundResults,
    ) -> Result<DiagnosisResult, Error> {
        let effects = self.named(pair, noise, &mut results)?;
        let test_rows = rows(self.base, self.runs, self.runs.with_first_reference()[2], &self.settings)?.rows;
        let [before, after] = test_runs::both(&test_rows, &pair.base.model, &pair.found.model)?;
        let test = test_runs::read(&test_rows, &before, &after, noise_floor.rsse_n, &self.settings);
        let both = [&pair.base_confirm, &pair.found_confirm];
        let remaining = remaining_error(&self.confirm, both, noise_floor.rsse_n, &self.settings);
        let held = test.as_ref().is_none_or(super::TestResult::proves);
        let verdict = match results.base_fault {
            Some(_) => Verdict::BaseInadequate,
            None => verdict(&remaining, !effects.is_empty() && held, &self.settings.thresholds),
        };
        let confirm = test_runs::run_errors(&self.confirm, &pair.base_confirm, &pair.found_confirm);
        Ok(DiagnosisResult {
            mode: self.mode,
            verdict,
            base_fault: results.base_fault,
            noise_floor,
            effects,
            refused: results.refused,
            untestable: results.untestable,
            candidates: results.candidates,
            searched: None,
            blocks: super::blocks::Blocks::new(&self.estimate, self.settings.training_block_s()).count(),
            before: self.model(&pair.base, &confirm, |change| change.before.rsse_n),
            after: self.model(&pair.found, &confirm, |change| change.after.rsse_n),
            confirm,
            test,
            remaining,
            discovery: Discovery::default(),
            structures: Vec::new(),
            alignments: Vec::new(),
            mean_shift: paired::mean_shift(self.both_pairs(), &self.settings),
            swept: None,
        })
    }

    /// The effects that were named and not pruned, each with the error that the model gains without it.
    fn named(&self, pair: &Pair, noise: f64, results: &mut RoundResults) -> Result<Vec<NamedEffect>, Error> {
        if results.named.is_empty() {
            return Ok(Vec::new());
        }
        let round = self.round(noise, 0);
        let intervals = round.intervals(&pair.found, Contents::All)?;
        let (found, all) = (&pair.found, (pair.base.squares - noise).max(f64::MIN_POSITIVE));
        let alone = results.named.len() == 1;
        let mut effects = Vec::new();
        for (index, effect) in found.model.effects().as_slice().iter().enumerate() {
            // An effect that no round named was already in the base.
            let Some((p_adjusted, class)) = results.named.remove(effect.effect().id()) else { continue };
            // Without the checks, the model without an effect is not known.
            let without =
                if alone { Some(&pair.base) } else { results.without.get(index).and_then(Option::as_ref) };
            let share = |without: &Fitted| (without.squares - found.squares) / all;
            let confirmed = |without: &Fitted| round.confirmed(&without.model, &found.model).unwrap_or(0.0);
            effects.push(NamedEffect {
                effect: *effect,
                class,
                parameters: intervals.of(index),
                p_adjusted,
                share_removed: without.map_or(f64::NAN, share),
                confirmed: without.map_or(f64::NAN, confirmed),
                since_healthy: None,
            });
        }
        Ok(effects)
    }

    /// `fitted` as a model that can run live; see [`model_of`].
    fn model(
        &self,
        fitted: &Fitted,
        confirm: &[super::RunErrors],
        rsse_n: fn(&super::RunErrors) -> f64,
    ) -> Model {
        let rows = (self.mode == DiagnosisMode::Absolute).then_some(&self.estimate);
        model_of(self.base, rows, fitted, confirm.iter().map(rsse_n))
    }
}

/// The remaining error on the validation runs `confirm`, to which no coefficient was fitted, of the base and of the model found.
pub(super) fn remaining_error(
    confirm: &Rows,
    [before, after]: [&Fitted; 2],
    noise_n: f64,
    settings: &Settings,
) -> RemainingError {
    let noise = noise_n * noise_n * confirm.len() as f64;
    let lof = |squares: f64| (1.0 - noise / squares).max(0.0);
    RemainingError {
        lof: lof(after.squares),
        lof_before: lof(before.squares),
        share: (after.squares - noise).max(0.0) / (before.squares - noise).max(f64::MIN_POSITIVE),
        correlates_with: correlation::correlates_with(confirm, &after.residual_n, settings),
    }
}

/// `fitted` as a model that can run live: with the mean force offset of the training rows, if there are any, and the RMSE of the validation
/// runs as its expected error.
pub(super) fn model_of(
    base: &Model,
    train: Option<&Rows>,
    fitted: &Fitted,
    confirm_rsse_n: impl ExactSizeIterator<Item = f64>,
) -> Model {
    let offset_n = train.map_or(0.0, |rows| {
        let errors = rows.measured_n().iter().zip(&fitted.predicted_n).map(|(m, p)| m - p);
        errors.sum::<f64>() / rows.len().max(1) as f64
    });
    let force = fitted.model.force().with_force_offset_n(fitted.model.force().force_offset_n() + offset_n);
    let runs = confirm_rsse_n.len().max(1) as f64;
    let squares = confirm_rsse_n.map(|rsse_n| rsse_n.powi(2)).sum::<f64>();
    let mut model = Model { force, effects: *fitted.model.effects(), ..*base };
    model.expected.free_run_rsse_n = Some((squares / runs).sqrt());
    model.expected.one_step_rsse_n = None;
    model.expected.uncertainty = None;
    model
}

/// The verdict; `named` if effects or terms were found and hold on the test runs.
pub(super) fn verdict(left: &RemainingError, named: bool, thresholds: &Thresholds) -> Verdict {
    match named {
        _ if left.lof_before < thresholds.nothing_left => Verdict::NothingToExplain,
        true if left.share <= thresholds.little_left => Verdict::Explained,
        true => Verdict::PartlyExplained,
        false => Verdict::Unexplained,
    }
}
