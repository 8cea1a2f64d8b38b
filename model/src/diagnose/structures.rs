//! A diagnosis that also chooses the structure of the base model.
//!
//! A base of the wrong structure leads to a wrong name: what its structure cannot follow looks like an effect. So several structures
//! are identified on the training runs and diagnosed, beside the base that is given, if there is one. The validation runs compare them with
//! the effects that each of them found:
//!
//! ```text
//! best structure       the least squared error on the validation runs
//! fits about as well   the interval of (error of the best / error of this one) reaches one, or the ratio is above 0.9
//! chosen               the first structure that fits about as well as the best: the given base, then from simple to flexible
//! named                an effect of the chosen structure that every structure that fits about as well names too, with the same
//!                      parameters within their intervals; likewise every simpler structure that is not far behind
//! ```
//!
//! Noise in the velocity favours structures with memory, which filter it. A simpler structure that fits worse for that reason may still be
//! the damper's.
//!
//! The structures are identified in parallel, and searched in parallel for one effect each, round by round. A structure that another one
//! surpasses by far, although that one had a round less, is not searched further. One round less is what a structure with memory is ahead of one without: it may contain one effect of the
//! library by itself. Structures that are far behind after the rounds cannot be chosen, and their effects are not checked against each
//! other, which costs more than the rounds.
//!
//! An effect that only some of them need may be a part of the damper's own behaviour that the others already contain. It is refused
//! with that reason, and the chosen structure is diagnosed again with the effects that hold.

use super::finding::{
    DiagnosisResult, FoundParameter, NamedEffect, RefusedEffect, StructureFit, StructureRow,
};
use super::joint::Fitted;
use super::procedure::{Procedure, Searched};
use super::refusal::Refusal;
use super::rows::Rows;
use super::stretches::Stretches;
use super::{Runs, Settings, Stage, Thresholds, check, completed, test_runs};
use crate::error::{DiagnosisError, Error, IdentifyError};
use crate::force::{ForceLaw, Form};
use crate::identify::{ModelSpec, Options, Structure, Watch, identify_datasets};
use crate::model::Model;
use crate::parallel;

/// Restarts for a force law, whose parameters are polynomials of the drive; each costs several times one of fuzzy-tanh. With 4, the fit of
/// the Bouc-Wen law ends at a local minimum in 2 of 4 cases.
const LAW_RESTARTS: u32 = 12;
/// Degrees of these polynomials, of which the validation runs choose one. Degree 4 follows a valve that saturates more closely, but a fit
/// may diverge beyond its training runs.
const LAW_DEGREES: [usize; 2] = [4, 3];

/// The structures that [`close_any`] tries by default, from simple to flexible: a static curve, and the Bouc-Wen law, which has
/// memory. With a drive, the curve is fuzzy-tanh; without one, it is the S-P law.
///
/// ```
/// use mr_damper_model::diagnose::default_structures;
///
/// let names = |with_drive| -> Result<Vec<_>, mr_damper_model::Error> {
///     Ok(default_structures(with_drive)?.iter().map(|spec| spec.structure().name()).collect())
/// };
/// assert_eq!(names(true)?, ["fuzzy-tanh", "bouc-wen"]);
/// assert_eq!(names(false)?, ["sp", "bouc-wen"]);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// None for the structures listed here.
pub fn default_structures(with_drive: bool) -> Result<Vec<ModelSpec>, Error> {
    let form = if with_drive { Form::SemiActive } else { Form::Passive };
    let curve = if with_drive { Structure::FuzzyTanh } else { Structure::Law(ForceLaw::Sp) };
    [curve, Structure::Law(ForceLaw::BoucWen)].into_iter().map(|s| ModelSpec::new(s, form)).collect()
}

/// The bases that [`close_any`] chooses from.
#[derive(Debug, Clone, Copy)]
pub struct Bases<'a> {
    /// The base in use, conditioned as the runs are; the first choice. `None` without one.
    pub given: Option<&'a Model>,
    /// Structures to identify on the training runs, in order of preference. One that the given base has is left out.
    pub structures: &'a [ModelSpec],
    /// Settings of their identification.
    pub options: &'a Options,
}

/// The result for each structure so far, or its error, with its name.
type ByStructure<T> = Vec<(&'static str, Result<T, Error>)>;

/// A structure that was identified and is searched for effects.
struct Candidate {
    base: Model,
    /// Starting points of its identification; 0 for the given base.
    restarts: u32,
    searched: Searched,
    /// The model with its effects on the validation runs.
    confirm: Fitted,
}

/// A structure that was identified and diagnosed.
struct Diagnosed {
    base: Model,
    restarts: u32,
    result: DiagnosisResult,
    confirm: Fitted,
}

impl Diagnosed {
    fn row(&self, chosen: bool, fits_as_well: bool) -> StructureFit {
        let rsse_n = |model: &Model| model.expected.free_run_rsse_n.unwrap_or(f64::NAN);
        StructureFit {
            alone_rsse_n: rsse_n(&self.result.before),
            rsse_n: rsse_n(&self.result.after),
            effects: self.result.effects.iter().map(|named| named.effect.effect().id()).collect(),
            restarts: self.restarts,
            verdict: self.result.verdict,
            fits_as_well,
            chosen,
        }
    }
}

/// Chooses the base among `bases` and diagnoses it; see the module.
///
/// [`DiagnosisResult::structures`] lists all of them. `stage` is called at the start of each stage.
///
/// ```no_run
/// use mr_damper_model::diagnose::{Bases, Runs, Settings, close_any, default_structures};
/// use mr_damper_model::identify::{Dataset, DatasetOptions, Options, Watch};
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let options = Options::default();
/// let experiment = Experiment::thesis("RP-ICPS").expect("an experiment of the thesis").with_duration_s(30.0);
/// let run = |seed| {
///     let run = record(&experiment, &Plant::default(), &Channels::default(), seed);
///     Dataset::from_run(&run, &options.conditioning, &DatasetOptions::default())
/// };
/// let (estimate, confirm) = ([run(1)?], [run(2)?]);
/// let runs = Runs { estimate: &estimate, confirm: &confirm, ..Runs::default() };
/// let bases = Bases { given: None, structures: &default_structures(true)?, options: &options };
/// let found = close_any(&bases, &runs, &Settings::default(), &Watch::none(), &|_| {})?;
/// assert_eq!(found.chosen().map(|(row, _)| row.structure), Some("bouc-wen"), "the rig's valve has memory");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// As [`super::close`], also for the given base; [`DiagnosisError::BaseNeeded`] without any base or with reference runs; the error of the
/// first structure if none of them can be identified and simulated.
pub fn close_any(
    bases: &Bases,
    runs: &Runs,
    settings: &Settings,
    watch: &Watch,
    stage: &dyn Fn(Stage),
) -> Result<DiagnosisResult, Error> {
    if bases.given.is_none() && bases.structures.is_empty() || !runs.reference.is_empty() {
        return Err(DiagnosisError::BaseNeeded.into());
    }
    check::check_before_base(runs, settings)?;
    bases.given.map_or(Ok(()), |base| check::check(base, runs, settings))?;
    let stretches = Stretches::new(runs, settings.most_samples);
    let searched_runs = stretches.runs();
    let confirm = Rows::new(searched_runs.confirm, settings.most_rows);
    let choice = Choice { options: bases.options, all: runs, runs: &searched_runs, settings, confirm, watch };
    let given = bases.given.map(|base| base.force.name());
    let others = bases.structures.iter().filter(|spec| Some(spec.structure().name()) != given);
    let starts: Vec<Start> =
        bases.given.into_iter().map(Start::Given).chain(others.copied().map(Start::Structure)).collect();
    starts.iter().for_each(|start| stage(Stage::Structure(start.name())));
    let begun = in_parallel(starts, |start| (start.name(), choice.begun(start)))?;
    if given.is_some()
        && let Some((_, Err(error))) = begun.first()
    {
        return Err(error.clone());
    }
    let tried = choice.diagnosed(choice.searched(begun, stage)?, stage)?;
    let usable: Vec<(&'static str, &Diagnosed)> =
        tried.iter().filter_map(|(name, one)| Some((*name, one.as_ref().ok()?))).collect();
    let best = usable.iter().min_by(|(_, a), (_, b)| a.confirm.squares.total_cmp(&b.confirm.squares));
    let Some((_, best)) = best else {
        let first = tried.into_iter().find_map(|(_, one)| one.err());
        return Err(first.unwrap_or_else(|| DiagnosisError::BaseDiverges.into()));
    };
    let fitting: Vec<(&'static str, &Diagnosed)> =
        usable.iter().filter(|(_, one)| choice.fits_as_well(one, best)).copied().collect();
    let Some((_, chosen)) = fitting.first() else {
        return Err(DiagnosisError::BaseDiverges.into());
    };
    let simpler = usable.iter().take_while(|(_, one)| !std::ptr::eq(*one, *chosen));
    let not_far = simpler.filter(|(_, one)| choice.keeps_up(&one.confirm, best.confirm.squares));
    let others: Vec<(&'static str, &Diagnosed)> = fitting[1..].iter().chain(not_far).copied().collect();
    let row = |one: &Diagnosed| {
        let fits_as_well = fitting.iter().any(|(_, fits)| std::ptr::eq(*fits, one));
        one.row(std::ptr::eq(*chosen, one), fits_as_well)
    };
    let rows = tried.iter().enumerate().map(|(index, (structure, one))| StructureRow {
        structure,
        given: given.is_some() && index == 0,
        outcome: one.as_ref().map(row).map_err(Clone::clone),
    });
    let found = DiagnosisResult { structures: rows.collect(), ..choice.holding(chosen, &others, stage)? };
    completed(found, &stretches, runs, settings, watch, stage)
}

/// The choice among structures: what all of them are identified and diagnosed with.
struct Choice<'a> {
    options: &'a Options,
    /// All runs, on which a structure is identified.
    all: &'a Runs<'a>,
    /// The runs of the search.
    runs: &'a Runs<'a>,
    settings: &'a Settings,
    confirm: Rows<'a>,
    watch: &'a Watch<'a>,
}

/// A structure before it is identified, or the given base.
#[derive(Clone, Copy)]
enum Start<'a> {
    Given(&'a Model),
    Structure(ModelSpec),
}

impl Start<'_> {
    fn name(&self) -> &'static str {
        match self {
            Self::Given(base) => base.force.name(),
            Self::Structure(spec) => spec.structure().name(),
        }
    }
}

/// `of` each of `items` in parallel; [`Error::Cancelled`] if one of them was cancelled.
fn in_parallel<T: Send, R: Send>(
    items: Vec<T>,
    of: impl Fn(T) -> (&'static str, Result<R, Error>) + Sync,
) -> Result<ByStructure<R>, Error> {
    let all = parallel::map_owned(items, of);
    match all.iter().any(|(_, one)| matches!(one, Err(Error::Cancelled))) {
        true => Err(Error::Cancelled),
        false => Ok(all),
    }
}

/// A structure, identified on the training runs; if these hold one level of the drive, without the drive.
fn identified(spec: ModelSpec, runs: &Runs, options: &Options, watch: &Watch) -> Result<Model, Error> {
    let identified = |spec| identify_datasets(spec, runs.estimate, options, watch);
    match identified(spec) {
        Err(Error::Identify(IdentifyError::ConstantDrive { .. })) => {
            Ok(identified(ModelSpec::new(spec.structure(), Form::Passive)?)?.model)
        }
        identified => Ok(identified?.model),
    }
}

impl Choice<'_> {
    /// Identifies a structure on the training runs, if it is not given, and fits it.
    fn begun(&self, start: Start) -> Result<Candidate, Error> {
        let spec = match start {
            Start::Given(base) => return self.candidate(*base, 0),
            Start::Structure(spec) => spec,
        };
        match spec.structure() {
            Structure::Law(_) => {
                let restarts = self.options.restarts.min(LAW_RESTARTS);
                self.candidate(self.identified_law(spec, restarts)?, restarts)
            }
            _ => {
                let model = identified(spec, self.all, self.options, self.watch)?;
                self.candidate(model, self.options.restarts)
            }
        }
    }

    fn candidate(&self, base: Model, restarts: u32) -> Result<Candidate, Error> {
        check::check(&base, self.all, self.settings)?;
        let searched = self.procedure(&base, self.settings)?.begin(&|_| {})?;
        let confirm = test_runs::fitted(&self.confirm, searched.model())?;
        Ok(Candidate { base, restarts, searched, confirm })
    }

    /// Searches the structures for effects, round by round.
    fn searched(
        &self,
        mut all: ByStructure<Candidate>,
        stage: &dyn Fn(Stage),
    ) -> Result<ByStructure<Candidate>, Error> {
        // The least error a round earlier; before the first round no structure is surpassed.
        let mut earlier = f64::INFINITY;
        for round in 1..=self.settings.most_effects {
            stage(Stage::Search(round));
            let usable = all.iter().filter_map(|(_, one)| one.as_ref().ok());
            let least = usable.map(|one| one.confirm.squares).fold(f64::INFINITY, f64::min);
            let next = |one: Candidate| match one.searched.is_complete()
                || earlier < self.settings.thresholds.surpassed * one.confirm.squares
            {
                true => Ok(one),
                false => self.next_round(one),
            };
            all = in_parallel(all, |(name, one)| (name, one.and_then(next)))?;
            earlier = least;
        }
        Ok(all)
    }

    fn next_round(&self, mut one: Candidate) -> Result<Candidate, Error> {
        self.procedure(&one.base, self.settings)?.next_round(&mut one.searched, &|_| {})?;
        one.confirm = test_runs::fitted(&self.confirm, one.searched.model())?;
        Ok(one)
    }

    /// Completes the diagnosis of each structure. The effects of a structure that is far behind are not checked against each other.
    fn diagnosed(
        &self,
        searched: ByStructure<Candidate>,
        stage: &dyn Fn(Stage),
    ) -> Result<ByStructure<Diagnosed>, Error> {
        stage(Stage::Pruning);
        let squares = |one: &Candidate| one.confirm.squares;
        let least = searched
            .iter()
            .filter_map(|(_, one)| one.as_ref().ok())
            .map(squares)
            .fold(f64::INFINITY, f64::min);
        let complete = |one: Candidate| {
            let procedure = self.procedure(&one.base, self.settings)?;
            let found = if self.keeps_up(&one.confirm, least) {
                procedure.check(one.searched, &|_| {})?
            } else {
                one.searched
            };
            let result = procedure.finish(found, &|_| {})?;
            let confirm = test_runs::fitted(&self.confirm, &result.after.augmented())?;
            Ok(Diagnosed { base: one.base, restarts: one.restarts, result, confirm })
        };
        in_parallel(searched, |(name, one)| (name, one.and_then(complete)))
    }

    /// A force law with the degree that has the least squared error on the validation runs.
    fn identified_law(&self, spec: ModelSpec, restarts: u32) -> Result<Model, Error> {
        let Self { options, all: runs, ref confirm, watch, .. } = *self;
        let with_degree = |degree| -> Result<(f64, Model), Error> {
            let model = identified(spec, runs, &Options { restarts, degree, ..options.clone() }, watch)?;
            // A model that diverges on the validation runs may still be the only one.
            Ok((Fitted::squares_of(&model.augmented(), confirm), model))
        };
        let [first, second] = LAW_DEGREES;
        match rayon::join(|| with_degree(first), || with_degree(second)) {
            (Ok(first), Ok(second)) => Ok(if second.0 < first.0 { second.1 } else { first.1 }),
            (Err(Error::Cancelled), _) | (_, Err(Error::Cancelled)) => Err(Error::Cancelled),
            (Ok((_, model)), Err(_)) | (Err(_), Ok((_, model))) => Ok(model),
            (Err(error), Err(_)) => Err(error),
        }
    }

    /// The diagnosis of one base, without its check against an alternative structure: the structures are compared here.
    fn procedure<'b>(&'b self, base: &'b Model, settings: &'b Settings) -> Result<Procedure<'b>, Error> {
        Ok(Procedure::new(base, self.runs, settings, self.watch)?.with_structure_compared())
    }

    /// True if a structure with the errors `one` on the validation rows is not far behind one with the squared error `best`.
    fn keeps_up(&self, one: &Fitted, best: f64) -> bool {
        best > self.settings.thresholds.far_behind * one.squares
    }

    /// True if `one` fits the validation rows about as well as `best`.
    fn fits_as_well(&self, one: &Diagnosed, best: &Diagnosed) -> bool {
        let compared = test_runs::read(&self.confirm, &one.confirm, &best.confirm, 0.0, self.settings);
        compared.is_some_and(|compared| match compared.ratio_ci95 {
            Ok([_, high]) => high >= 1.0 || compared.ratio > self.settings.thresholds.about_as_well,
            Err(_) => compared.ratio > self.settings.thresholds.about_as_well_unproved,
        })
    }

    /// The result of `chosen` with only those effects that hold under `others`, too.
    fn holding(
        &self,
        chosen: &Diagnosed,
        others: &[(&'static str, &Diagnosed)],
        stage: &dyn Fn(Stage),
    ) -> Result<DiagnosisResult, Error> {
        let (mut result, mut dependent) = (chosen.result.clone(), Vec::<RefusedEffect>::new());
        // Without an effect that depends on the base, others may be found, which are checked in turn.
        loop {
            let alike = if dependent.is_empty() { Alike::ByClass } else { Alike::ById };
            let objection = |named: &NamedEffect| {
                let why = others
                    .iter()
                    .find_map(|other| objection(named, *other, alike, &self.settings.thresholds))?;
                Some(RefusedEffect { effect: named.effect.effect(), why })
            };
            let more: Vec<RefusedEffect> = result.effects.iter().filter_map(objection).collect();
            if more.is_empty() {
                break;
            }
            dependent.extend(more);
            let effects = self.settings.effects.without(dependent.iter().map(|refused| refused.effect.id()));
            let settings = Settings { effects, ..*self.settings };
            result = self.procedure(&chosen.base, &settings)?.run(stage)?;
        }
        let excluded = |refused: &RefusedEffect| refused.why == Refusal::Excluded;
        result.untestable.retain(|refused| !(excluded(refused) && self.settings.effects.has(refused.effect)));
        result.refused.extend(dependent);
        Ok(result)
    }
}

/// When two structures show the same effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Alike {
    /// Those that have one id, or of which one is in the other's class.
    ByClass,
    /// Those that have one id. An effect that was found after another one was refused may have taken its place: the class of an effect of
    /// the other structure must not confirm it.
    ById,
}

/// Why `named` does not hold under another structure; `None` if it does.
fn objection(
    named: &NamedEffect,
    (structure, other): (&'static str, &Diagnosed),
    alike: Alike,
    thresholds: &Thresholds,
) -> Option<Refusal> {
    let id = named.effect.effect().id();
    let same = |theirs: &&NamedEffect| {
        let their_id = theirs.effect.effect().id();
        let in_class = named.class.contains(&their_id) || theirs.class.contains(&id);
        their_id == id || alike == Alike::ByClass && in_class
    };
    let Some(theirs) = other.result.effects.iter().find(same) else {
        return Some(Refusal::DependsOnBase { structure });
    };
    let pairs = named.parameters.iter().filter_map(|own| {
        theirs.parameters.iter().find(|their| their.name == own.name).map(|their| (own, their))
    });
    pairs
        .filter(|(own, their)| !agree(own, their, thresholds))
        .map(|(own, their)| differs(structure, own, their))
        .next()
}

fn differs(structure: &'static str, own: &FoundParameter, their: &FoundParameter) -> Refusal {
    Refusal::DiffersBetweenBases {
        structure,
        parameter: own.name,
        value: own.value,
        other_value: their.value,
    }
}

/// True if two values of a parameter are the same within their intervals or within [`Thresholds::same_parameter`].
fn agree(own: &FoundParameter, their: &FoundParameter, thresholds: &Thresholds) -> bool {
    let overlap = own.ci95[0] <= their.ci95[1] && their.ci95[0] <= own.ci95[1];
    overlap || own.is_close_to(their, thresholds.same_parameter)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_agree_if_their_intervals_overlap_or_they_are_close() {
        let (own, thresholds) = (FoundParameter::tau_s(0.012, 0.001), Thresholds::default());
        assert!(agree(&own, &FoundParameter::tau_s(0.0138, 0.001), &thresholds), "intervals overlap");
        assert!(agree(&own, &FoundParameter::tau_s(0.0145, 0.0001), &thresholds), "21 % apart");
        assert!(
            !agree(&own, &FoundParameter::tau_s(0.02, 0.001), &thresholds),
            "67 % apart, and intervals apart"
        );
        assert!(!agree(&own, &FoundParameter::tau_s(-0.012, 0.001), &thresholds), "another sign");
    }
}
