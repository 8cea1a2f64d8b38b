//! Discovery of terms: what is left after the library of effects is searched for an effect that no entry describes.
//!
//! ```text
//! term            c m(t) g(q(t))                               modulator m, argument q, form g: [`crate::effect::term`]
//! nuisance N      derivatives of the model by all its numbers, and a space of structures ([`structure`])
//! screen          every pair (m, q): g as a curve of hat functions, then closed forms, with N projected off; fitted on the
//!                 training runs, its gain measured on the validation runs with the same coefficients      ([`screen`])
//! settle          the best pairs: numbers of the term refitted, then base, effects and terms together     ([`settle`])
//! accept          gains on blocks of both sides, each fitted on the other, signs flipped, against the best of all pairs: p <= 0.01,
//!                 and at least 5 % less squared error on the validation runs
//! claim           effect, or structure that the base lacks, or one of the two                             ([`claim`])
//! instead         a term in place of a named effect of the library that fits much worse                  ([`instead`])
//! simplify        simpler forms of the terms, now that the model has all of them                          ([`simplify`])
//! hum             a sine in the measured force that is left; it is said, and not added                    ([`hum`])
//! ```
//!
//! A wrong structure of the base leaves a residual that a term could take for an effect. The space of structures, a generalised Maxwell-slip
//! model under fuzzy sets, contains the forces of many dampers, so what it can take away is not evidence for a term. With healthy runs, its
//! weights must also fit these runs: what the healthy damper does not need of the space is not structure, so an effect within it stays visible
//! (`nuisance.rs`). Where nothing is found beyond that space, the next pass searches without it. Such a term may be structure: only a healthy run
//! decides. A term is added to the model if it holds on runs that it was not fitted on, whatever its claim is. At most [`MAX_TERMS`] are
//! added. The test runs decide nothing here, as everywhere: they can only take the verdict away.
//!
//! Multiple testing: under the null hypothesis the gain on each block could equally be a loss. The largest gain of any pair under a flip of
//! signs is compared with the gain found, so the number of pairs is paid for. Losses count at most as much as the pair's largest gain: a pair
//! that explodes on one block would widen the distribution otherwise.

mod around;
mod claim;
mod curve;
mod hum;
mod hypotheses;
mod instead;
mod nuisance;
mod place;
mod resonance;
mod screen;
mod series;
mod settle;
mod simplify;
mod structure;

pub use claim::Claim;
pub use curve::CurvePoint;
pub use hum::Hum;
pub use hypotheses::Hypothesis;

pub(super) use place::placed;

use super::blocks::Blocks;
use super::completion::Completion;
use super::joint::{Fitted, Joint};
use super::rows::Rows;
use super::space::without_effect;
use super::{DiagnosisMode, DiagnosisResult, EffectSet, Runs, Settings, Stage, Verdict, test_runs};
use crate::effect::term::{Argument, MAX_TERMS, Modulator, Term, Terms};
use crate::effect::{Augmented, Effects};
use crate::error::Error;
use crate::identify::{Dataset, Scales, Watch};
use claim::Healthy;
use nuisance::Sides;
use screen::Pair;
use settle::{Settled, Unsettled};

/// Rate of the rows in the search, Hz. They are selected, not filtered.
const RATE_HZ: f64 = 128.0;
/// Largest number of rows of training or validation runs in the search.
const MOST_ROWS: usize = 20_000;
/// Evaluations of the last refits.
const REFIT: usize = 12;

/// A term that was discovered.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundTerm {
    /// The term, as it is in the model.
    pub term: Term,
    /// The claim about it.
    pub claim: Claim,
    /// Modulator and argument of the other pairs that these runs cannot tell from it.
    pub class: Vec<(Modulator, Argument)>,
    /// Probability of a gain like this by chance, over all pairs.
    pub p: f64,
    /// Share of the squared error on the validation runs that it removes when it is added.
    pub confirmed: f64,
    /// 95 % interval of the amount and of each parameter.
    pub ci95: Vec<[f64; 2]>,
    /// The curve c g(q) without a closed form; empty for a resonance, and if the runs have too few blocks.
    pub curve: Vec<CurvePoint>,
}

/// A term that was not accepted, with the reason.
#[derive(Debug, Clone, PartialEq)]
pub struct RefusedTerm {
    /// The term, as it was fitted.
    pub term: Term,
    /// The reason.
    pub why: TermRefusal,
}

/// Why a term was not accepted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TermRefusal {
    /// The gain on runs that it was not fitted on may be chance.
    NotSignificant {
        /// Probability of a gain like this by chance, over all pairs.
        p: f64,
        /// Largest probability allowed.
        allowed: f64,
    },
    /// It removes too little of the squared error on the validation runs that no structure of the base could explain; without the space of
    /// structures, of all of it.
    TooSmall {
        /// Share that it removes.
        share: f64,
        /// Least share.
        needed: f64,
    },
    /// Training and validation runs have too few blocks for the test.
    TooFewBlocks {
        /// Number of blocks.
        blocks: usize,
        /// Least number.
        needed: usize,
    },
}

impl TermRefusal {
    /// Name in JSON.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::NotSignificant { .. } => "not_significant",
            Self::TooSmall { .. } => "too_small",
            Self::TooFewBlocks { .. } => "too_few_blocks",
        }
    }
}

impl std::fmt::Display for TermRefusal {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Self::NotSignificant { p, allowed } => {
                write!(
                    f,
                    "its gain on runs that it was not fitted on may be chance: p is {p:.3}, allowed is {allowed}"
                )
            }
            Self::TooSmall { share, needed } => write!(
                f,
                "it removes {:.1} % of the squared error on the validation runs that another structure of the base could not, and \
                 needs {:.0} %",
                100.0 * share,
                100.0 * needed
            ),
            Self::TooFewBlocks { blocks, needed } => write!(
                f,
                "training and validation runs have {blocks} blocks, and the test needs {needed}: give more or longer runs"
            ),
        }
    }
}

/// The result of a discovery.
///
/// ```
/// use mr_damper_model::diagnose::discover::Discovery;
///
/// /// The terms that may be called effects, as equations.
/// fn effects(Discovery { terms, .. }: &Discovery) -> Vec<String> {
///     terms.iter().filter(|found| found.claim.is_effect()).map(|found| found.term.equation("A")).collect()
/// }
/// assert!(effects(&Discovery::default()).is_empty());
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Discovery {
    /// Terms that were added to the model, in the order in which they were found.
    pub terms: Vec<FoundTerm>,
    /// The best term of the last round, which was not accepted; `None` if no pair had a gain.
    pub refused: Option<RefusedTerm>,
    /// A hum in what the model leaves; it is not in the model.
    pub hum: Option<Hum>,
}

/// Searches what `result` leaves for terms, and adds them to the model.
///
/// # Errors
/// [`Error::Cancelled`]; errors of the simulation of the test runs.
pub(super) fn extend(
    result: DiagnosisResult,
    runs: &Runs,
    settings: &Settings,
    watch: &Watch,
    stage: &dyn Fn(Stage),
) -> Result<DiagnosisResult, Error> {
    let nothing_left = result.remaining.lof < settings.thresholds.nothing_left;
    let nothing_to_find = match result.verdict {
        Verdict::NothingToExplain => true,
        // Another structure would do as well as what the library says. Without a library, terms can say what is missing.
        Verdict::BaseInadequate => settings.effects != EffectSet::NONE,
        _ => nothing_left,
    };
    if settings.most_terms == 0 || result.mode == DiagnosisMode::Paired || nothing_to_find {
        return Ok(result);
    }
    let [train, confirm] = [runs.estimate, runs.confirm].map(selected);
    let search = Search {
        beyond_structure: true,
        of_base: result.before.effects,
        noise: result.noise_floor.rsse_n.powi(2) * confirm.len() as f64,
        base_squares: test_runs::fitted(&confirm, &result.before.augmented())?.squares,
        train: &train,
        confirm: &confirm,
        runs,
        settings,
        joint: Joint {
            rows: &train,
            scales: Scales::of(runs.estimate)?,
            ranges: settings.ranges,
            base_moves: true,
            watch,
        },
    };
    // Where the library has explained the error, what is left is a detail of the structure, or an effect that no structure contains.
    // The verdict is not asked: it depends on the test runs.
    let only_beyond = !result.effects.is_empty() && result.remaining.share <= settings.thresholds.little_left;
    let most = settings.most_terms.min(MAX_TERMS - result.before.effects.terms().iter().count());
    let mut result = match Fitted::as_is(result.after.augmented(), &train) {
        Some(library) => {
            let library = Found::begin(library);
            let limits = Limits { only_beyond, most, goal: None };
            let beside = search.run(library.clone(), limits, stage)?;
            let mut found = instead::instead(&search, library, beside, &result, most, stage)?;
            let model = found.fitted.model;
            if simplify::simplify(&search, &mut found)? {
                // A term that has left a part to another one may leave an error behind.
                found = search.run(found, limits, stage)?;
            } else if found.fitted.model != model {
                found = search.prune(found)?;
            }
            search.conclude(result, found)?
        }
        None => result,
    };
    result.discovery.hum = hum::find(&search, &result.after.augmented());
    Ok(result)
}

/// The rows of the search: at most [`RATE_HZ`].
fn selected(datasets: &[Dataset]) -> Rows<'_> {
    let counted: usize = datasets.iter().map(Dataset::counted).sum();
    let fastest = datasets.iter().map(|dataset| dataset.rate_hz).fold(RATE_HZ, f64::max);
    let most = (counted as f64 * RATE_HZ / fastest).ceil() as usize;
    Rows::new(datasets, most.clamp(1, MOST_ROWS))
}

/// The inputs of a search.
#[derive(Clone, Copy)]
struct Search<'a> {
    /// The space of structures is projected off.
    beyond_structure: bool,
    /// The effects that the base had already.
    of_base: Effects,
    /// Squared error of the noise on the validation runs, N².
    noise: f64,
    /// Squared error of the base on the validation runs, N².
    base_squares: f64,
    train: &'a Rows<'a>,
    confirm: &'a Rows<'a>,
    runs: &'a Runs<'a>,
    settings: &'a Settings,
    joint: Joint<'a>,
}

/// One way to search; the next one is used when a round finds nothing.
#[derive(Debug, Clone, Copy)]
struct Pass {
    /// The space of structures is projected off.
    beyond_structure: bool,
    /// Terms that the healthy runs show too are among those searched.
    structure_too: bool,
}

impl Pass {
    /// With healthy runs: first what they do not show, then what the structure of the base lacks.
    const WITH_HEALTHY: [Self; 2] = [
        Self { beyond_structure: true, structure_too: false },
        Self { beyond_structure: false, structure_too: true },
    ];
    /// Without them.
    const WITHOUT_HEALTHY: [Self; 2] = [
        Self { beyond_structure: true, structure_too: true },
        Self { beyond_structure: false, structure_too: true },
    ];
}

/// The limits of a search.
#[derive(Debug, Clone, Copy)]
struct Limits {
    /// Only what no structure of a damper contains is searched.
    only_beyond: bool,
    /// Largest number of terms to discover.
    most: usize,
    /// Errors that the model must come near with the next term; the search ends if no term does.
    goal: Option<SquaredErrors>,
}

/// The screen of a model. It serves every pass over the same model that leaves out the same space.
struct Screened<'a> {
    beyond_structure: bool,
    sides: Sides<'a>,
    healthy: Option<Healthy<'a>>,
    pairs: Vec<Pair>,
}

/// Blocks of the training and the validation runs.
struct BothBlocks {
    train: Blocks,
    confirm: Blocks,
}

impl BothBlocks {
    const fn count(&self) -> usize {
        self.train.count() + self.confirm.count()
    }
}

/// Squared error on the validation runs, N².
#[derive(Debug, Clone, Copy)]
struct SquaredErrors {
    all: f64,
    /// With the space of structures projected off.
    beyond: f64,
}

impl SquaredErrors {
    fn sum(self) -> f64 {
        self.all + self.beyond
    }

    fn times(self, factor: f64) -> Self {
        Self { all: factor * self.all, beyond: factor * self.beyond }
    }
}

/// A model with the terms found.
#[derive(Clone)]
struct Found {
    fitted: Fitted,
    discovery: Discovery,
    /// For each term, whether it was found with the space of structures projected off.
    beyond: Vec<bool>,
}

impl Found {
    /// A model before the first term.
    fn begin(fitted: Fitted) -> Self {
        Self { fitted, discovery: Discovery::default(), beyond: Vec::new() }
    }
}

impl<'a> Search<'a> {
    /// Adds terms to `found`, and removes the effects that they have taken over.
    fn run(&self, found: Found, limits: Limits, stage: &dyn Fn(Stage)) -> Result<Found, Error> {
        self.prune(self.rounds(found, limits, stage)?)
    }

    /// The rounds, which add terms to `found`.
    fn rounds(&self, mut found: Found, limits: Limits, stage: &dyn Fn(Stage)) -> Result<Found, Error> {
        let blocks = self.blocks();
        let healthy_rows = selected(self.runs.healthy);
        let passes: &[Pass] =
            if self.runs.healthy.is_empty() { &Pass::WITHOUT_HEALTHY } else { &Pass::WITH_HEALTHY };
        let mut passes = passes.iter().filter(|pass| pass.beyond_structure || !limits.only_beyond).peekable();
        let Found { fitted, discovery, beyond } = &mut found;
        let mut screened = None;
        while let Some(&&Pass { beyond_structure, structure_too }) = passes.peek()
            && discovery.terms.len() < limits.most
        {
            let search = Search { beyond_structure, ..*self };
            stage(Stage::Terms(discovery.terms.len() + 1));
            let kept = screened.take().filter(|kept: &Screened| kept.beyond_structure == beyond_structure);
            let here = match kept {
                Some(kept) => kept,
                None => match search.screen(fitted, &healthy_rows, &blocks)? {
                    Some(here) => here,
                    None => break,
                },
            };
            let (left, thresholds) = (here.sides.confirm.raw_squares(), &self.settings.thresholds);
            if 1.0 - self.noise / left < thresholds.nothing_left
                || left - self.noise < thresholds.least_of_base * (self.base_squares - self.noise)
            {
                break;
            }
            let shown = |pair: &&Pair| {
                structure_too || pair.on_healthy.is_none_or(|ratio| ratio < thresholds.structure_on_healthy)
            };
            let pairs: Vec<&Pair> = here.pairs.iter().filter(shown).collect();
            let known = here.healthy.as_ref().and_then(Healthy::structure);
            let goal = limits.goal.map(|goal| if beyond_structure { goal.beyond } else { goal.all });
            match settle::settle(&search, fitted, &here.sides, known, &pairs, &blocks, goal)? {
                Ok(Settled { fitted: next, term, class, p, confirmed }) => {
                    let claim = claim::claim(here.healthy.as_ref(), &term, thresholds);
                    let (ci95, curve) = (Vec::new(), Vec::new());
                    discovery.terms.push(FoundTerm { term, claim, class, p, confirmed, ci95, curve });
                    beyond.push(beyond_structure);
                    *fitted = next;
                }
                // A term of the next pass must reach the goal beyond the space of structures, too.
                Err(Unsettled::FarFromGoal) => break,
                Err(Unsettled::Refused(refused)) => {
                    discovery.refused = refused;
                    passes.next();
                    screened = Some(here);
                }
            }
        }
        Ok(found)
    }

    /// Squared error of a model on the validation runs, N²; infinite if it cannot be simulated on them.
    fn confirm_squares(&self, fitted: &Fitted) -> f64 {
        Fitted::squares_of(&fitted.model, self.confirm)
    }

    /// True if the squared errors of `fitted` on the validation runs are at most those of `goal`. False for a model that cannot be simulated on
    /// them.
    fn reaches(&self, fitted: &Fitted, goal: SquaredErrors) -> Result<bool, Error> {
        // The second error takes many times the time of the first.
        if self.confirm_squares(fitted) > goal.all {
            return Ok(false);
        }
        Ok(self.confirm_errors(fitted)?.is_some_and(|own| own.beyond <= goal.beyond))
    }

    /// The squared errors of a model on the validation runs; `None` if it cannot be simulated on them.
    fn confirm_errors(&self, fitted: &Fitted) -> Result<Option<SquaredErrors>, Error> {
        let search = Search { beyond_structure: true, ..*self };
        let sides = Sides::new(&search, fitted, None)?;
        Ok(sides.map(|Sides { confirm, .. }| SquaredErrors {
            all: confirm.raw_squares(),
            beyond: confirm.squares(),
        }))
    }

    /// The blocks of both sides.
    fn blocks(&self) -> BothBlocks {
        let [train, confirm] =
            [self.train, self.confirm].map(|rows| Blocks::new(rows, self.settings.training_block_s()));
        BothBlocks { train, confirm }
    }

    /// The curve of each discovered term of `model` without a closed form. `own` is the number of terms that the base has.
    fn add_curves(
        &self,
        discovery: &mut Discovery,
        model: &Augmented,
        own: usize,
        beyond: &[bool],
    ) -> Result<(), Error> {
        let Some(fitted) = Fitted::as_is(*model, self.train) else { return Ok(()) };
        let (blocks, healthy_rows) = (self.blocks(), selected(self.runs.healthy));
        for (index, (found, beyond_structure)) in discovery.terms.iter_mut().zip(beyond).enumerate() {
            let search = Search { beyond_structure: *beyond_structure, ..*self };
            found.curve = curve::curve(&search, &fitted, &healthy_rows, &blocks, own + index)?;
        }
        Ok(())
    }

    /// Screens all pairs; `None` if `fitted` cannot be simulated on the validation runs.
    fn screen(
        &self,
        fitted: &Fitted,
        healthy_rows: &'a Rows<'a>,
        blocks: &BothBlocks,
    ) -> Result<Option<Screened<'a>>, Error> {
        let healthy = Healthy::new(self, healthy_rows, &fitted.model)?;
        let known = healthy.as_ref().and_then(Healthy::structure);
        let Some(sides) = Sides::new(self, fitted, known)? else { return Ok(None) };
        let pairs = screen::pairs(
            &sides,
            healthy.as_ref(),
            fitted.model.effects().terms(),
            blocks,
            &self.settings.thresholds,
        );
        Ok(Some(Screened { beyond_structure: self.beyond_structure, sides, healthy, pairs }))
    }

    /// `result` with the terms found: effects that they replace, intervals, the errors on validation and test runs, and the verdict.
    fn conclude(&self, result: DiagnosisResult, found: Found) -> Result<DiagnosisResult, Error> {
        let Found { fitted, mut discovery, beyond } = found;
        if discovery.terms.is_empty() {
            return Ok(DiagnosisResult { discovery, ..result });
        }
        let completion = Completion::new(self.runs, self.settings, self.joint.watch)?;
        let fitted = completion.with_term(&fitted.model)?;
        let own = self.of_base.terms().iter().count();
        self.add_curves(&mut discovery, &fitted.model, own, &beyond)?;
        completion.result(DiagnosisResult { discovery, ..result }, &fitted)
    }

    /// Removes effects of the library whose part the terms of `found` have taken over; not those that the base had already.
    fn prune(&self, mut found: Found) -> Result<Found, Error> {
        if found.discovery.terms.is_empty() {
            return Ok(found);
        }
        let mut index = 0;
        while let Some(effect) = found.fitted.model.effects().as_slice().get(index) {
            let without = match self.of_base.position(effect.effect()).is_some() {
                true => None,
                false => self.joint.refit(&without_effect(&found.fitted.model, index)?, REFIT)?,
            };
            let needless = |without: &Fitted| {
                self.confirm_squares(without)
                    <= (1.0 + self.settings.thresholds.least_confirmed) * self.confirm_squares(&found.fitted)
            };
            match without.filter(needless) {
                Some(without) => found.fitted = without,
                None => index += 1,
            }
        }
        Ok(found)
    }
}

/// `model` with one more term.
fn with_term(model: &Augmented, term: Term) -> Result<Augmented, Error> {
    let mut terms: Vec<Term> = model.effects().terms().iter().copied().collect();
    terms.push(term);
    with_terms(model, &terms)
}

/// `model` with `terms` in place of its own.
pub(super) fn with_terms(model: &Augmented, terms: &[Term]) -> Result<Augmented, Error> {
    Augmented::new(*model.force(), model.effects().with_terms(Terms::new(terms)?))
}
