//! Chooses the fit for a structure and prepares its other inputs: fuzzy sets, degrees, samples of rows.

use super::dataset::{self, Dataset};
use super::free_sets;
use super::levels::Memberships;
use super::report::{self, Details, Identified, WithoutPrior, names_of_copies};
use super::row_problem::{Prior, Training};
use super::spec::{ModelSpec, Structure, Variant};
use super::tsk::{TskOptions, fit_tsk};
use super::{Options, Placement, Watch, arx, fuzzy_tanh, law, lazy, lpv, maxwell_slip, network, prior, tsk};
use crate::condition::Conditioning;
use crate::effect::Effects;
use crate::error::{Error, IdentifyError};
use crate::force::{ArxShape, Dependence, ForceLaw, ForceModel, Form, LAGS, NetworkStructure, TskKind};
use crate::model::{Envelope, Expected, Model};
use crate::sample::DriveKind;
use std::borrow::Cow;

/// A fitted model, the offset of each run in N, and further details.
type Fitted = (ForceModel, Vec<f64>, Details);

/// Fits a model to conditioned runs.
pub(super) fn fit(
    spec: ModelSpec,
    drive: Option<DriveKind>,
    datasets: &[Dataset],
    options: &Options,
    watch: &Watch,
) -> Result<Identified, Error> {
    let all = datasets;
    let options = &of_variant(spec, options);
    let job = Job { spec, drive, datasets: &shortened(spec, all, options), prior: None, options, watch };
    let found = job.identified(all)?;
    if found.faults().is_empty() || !job.takes_prior() {
        return physical(found);
    }
    let Some(prior) = prior::prior(job.datasets, drive, options.seed, watch)? else { return physical(found) };
    let again = Job { prior: Some(&prior), ..job }.identified(all)?;
    if !prior::is_better(&again, &found) {
        return physical(found);
    }
    let without_prior = WithoutPrior {
        model: Box::new(found.model),
        faults: found.faults().to_vec(),
        free_run: found.free_run,
    };
    physical(Identified { without_prior: Some(without_prior), ..again })
}

/// The result with warnings about its faults, unless its simulation does not stay finite. A model that uses measured force may
/// diverge in simulation and still predict one step ahead.
fn physical(mut found: Identified) -> Result<Identified, Error> {
    let Some(swept) = &found.swept else { return Ok(found) };
    if let Some(sine) = swept.diverges() {
        return Err(
            IdentifyError::Diverges { model: found.model.force.name(), sine: sine.to_string() }.into()
        );
    }
    found.warnings.extend(found.without_prior.as_ref().map(ToString::to_string));
    found.warnings.extend(swept.warning());
    Ok(found)
}

/// How well a model of this kind fits `datasets`: mean NMSE of the runs after a few restarts.
pub(super) fn sample_esr(
    spec: ModelSpec,
    drive: Option<DriveKind>,
    datasets: &[Dataset],
    options: &Options,
    watch: &Watch,
) -> Result<f64, Error> {
    let job = Job { spec, drive, datasets, prior: None, options, watch };
    match (spec.structure(), drive) {
        (Structure::Law(law), _) => {
            let (dependence, _) = job.dependence()?;
            law::sample_esr(datasets, law, dependence, options.seed, watch)
        }
        (Structure::MaxwellSlip, drive) => {
            let memberships = drive.map(|kind| job.memberships(kind)).transpose()?;
            maxwell_slip::mean_esr(datasets, memberships.as_ref(), watch)
        }
        (Structure::Tsk(kind), drive) => tsk::grid_esr(datasets, kind, drive, watch),
        (_, Some(kind)) => fuzzy_tanh::sample_esr(datasets, &job.memberships(kind)?, options.seed, watch),
        (_, None) => law::sample_esr(datasets, ForceLaw::Sp, Dependence::None, options.seed, watch),
    }
}

/// `options` with what the variant of `spec` prescribes.
fn of_variant(spec: ModelSpec, options: &Options) -> Cow<'_, Options> {
    match spec.variant() {
        // Kwok et al. fit parameters that are linear in the drive by a swarm.
        Some(Variant::Linear | Variant::Swarm) => Cow::Owned(Options { degree: 1, ..options.clone() }),
        _ => Cow::Borrowed(options),
    }
}

/// The inputs of a fit.
#[derive(Clone, Copy)]
struct Job<'a> {
    spec: ModelSpec,
    drive: Option<DriveKind>,
    datasets: &'a [Dataset],
    prior: Option<&'a Prior>,
    options: &'a Options,
    watch: &'a Watch<'a>,
}

impl Job<'_> {
    /// True if a prior can be added to the fit.
    fn takes_prior(&self) -> bool {
        let structure = self.spec.structure();
        matches!(structure, Structure::FuzzyTanh | Structure::MaxwellSlip | Structure::Law(_))
            && self.spec.variant() != Some(Variant::Swarm)
    }

    /// The fitted model with its errors on `all` rows.
    fn identified(&self, all: &[Dataset]) -> Result<Identified, Error> {
        let (force, offsets_n, mut details) = match self.spec.structure() {
            Structure::Phase => return Err(cannot_run()),
            Structure::Arx => self.arx(ArxShape::PLAIN)?,
            Structure::ArxDelayed => self.arx(ArxShape::DELAYED)?,
            Structure::Savaresi => self.arx(ArxShape::SAVARESI)?,
            Structure::Lpv => self.lpv()?,
            Structure::FuzzyTanh => self.fuzzy_tanh()?,
            Structure::MaxwellSlip => self.maxwell_slip()?,
            Structure::Law(law) => self.law(law)?,
            Structure::Tsk(kind) => self.tsk(kind)?,
            Structure::Boada => self.lazy()?,
            Structure::Network(structure) => self.network(structure)?,
        };
        if let Some(level) = self.only_level().filter(|_| force.drive().is_some()) {
            let drive = force.drive().map_or("the drive", DriveKind::name);
            details.warnings.push(format!(
                "the runs hold one level of {drive}, {level:.3}: the model is valid at this level only; \
                 add runs at other levels, or use a passive form"
            ));
        }
        let model = model(force, all[0].conditioning, all);
        Ok(report::assemble(model, all, &offsets_n, details))
    }

    fn training(&self) -> Training<'_> {
        Training { runs: self.datasets, prior: self.prior }
    }

    fn arx(&self, shape: ArxShape) -> Result<Fitted, Error> {
        let recursively = self.spec.variant() == Some(Variant::Recursive);
        let fitted = arx::fit(self.datasets, shape, self.drive, recursively, self.watch)?;
        let details = Details {
            rank: fitted.rank,
            parameters: fitted.parameters,
            converged: true,
            ..Details::default()
        };
        Ok((ForceModel::Arx(fitted.model), fitted.offsets_n, details))
    }

    fn lpv(&self) -> Result<Fitted, Error> {
        let (dependence, memberships) = self.dependence()?;
        if let Some(memberships) = &memberships {
            memberships.check_support(self.datasets, 3 * LAGS)?;
        }
        let fitted = lpv::fit(self.datasets, dependence, self.watch)?;
        let mut warnings = self.lowered_degree(&dependence);
        warnings.extend(fitted.warnings);
        let (rank, parameters) = (fitted.rank, fitted.parameters);
        let details =
            Details { rank, parameters, converged: true, memberships, warnings, ..Details::default() };
        Ok((ForceModel::Lpv(fitted.model), fitted.offsets_n, details))
    }

    fn fuzzy_tanh(&self) -> Result<Fitted, Error> {
        let Some(kind) = self.drive else { return Err(no_passive_form(self.spec.structure())) };
        let memberships = self.memberships(kind)?;
        let names = names_of_copies(fuzzy_tanh::NAMES.into_iter(), memberships.sets.len());
        let (fitted, names) = if self.spec.form() == Form::FreeFuzzy {
            let names = [names, free_sets::names(&memberships.sets)].concat();
            let levels = self.levels(kind);
            (fuzzy_tanh::fit_free(self.training(), &memberships, levels, self.options, self.watch)?, names)
        } else {
            (fuzzy_tanh::fit(self.training(), memberships, self.options, self.watch)?, names)
        };
        let details = Details::of(&fitted.found, &names).with_memberships(Some(fitted.memberships));
        Ok((ForceModel::FuzzyTanh(fitted.model), fitted.found.offsets_n, details))
    }

    fn maxwell_slip(&self) -> Result<Fitted, Error> {
        let memberships = self.drive.map(|kind| self.memberships(kind)).transpose()?;
        let fitted = maxwell_slip::fit(self.training(), memberships.as_ref(), self.watch)?;
        let details =
            Details { converged: fitted.converged, ..Details::default() }.with_memberships(memberships);
        Ok((ForceModel::MaxwellSlip(fitted.model), fitted.offsets_n, details))
    }

    fn law(&self, law: ForceLaw) -> Result<Fitted, Error> {
        let (dependence, mut memberships) = self.dependence()?;
        if let Some(memberships) = &memberships {
            memberships.check_support(self.datasets, law.parameters().len())?;
        }
        let mut names = names_of_copies(law.parameters().iter().map(|p| p.name), dependence.copies());
        let (model, found) = match (self.spec.form(), &memberships) {
            (Form::FreeFuzzy, Some(start)) => {
                names.extend(free_sets::names(&start.sets));
                let levels = self.levels(start.sets.drive());
                let (model, found, sets) =
                    law::fit_free(self.training(), law, start.sets, levels, self.options, self.watch)?;
                memberships = Some(sets);
                (model, found)
            }
            _ if self.spec.variant() == Some(Variant::Swarm) => {
                law::fit_by_swarm(self.datasets, law, dependence, self.options, self.watch)?
            }
            _ => law::fit(self.training(), law, dependence, self.options, self.watch)?,
        };
        let mut details = Details::of(&found, &names).with_memberships(memberships);
        details.warnings.extend(self.lowered_degree(&dependence));
        Ok((ForceModel::Law(model), found.offsets_n, details))
    }

    fn tsk(&self, kind: TskKind) -> Result<Fitted, Error> {
        let options = TskOptions::of(self.options, self.spec.variant());
        let found = fit_tsk(self.datasets, kind, self.drive, &options, self.watch)?;
        let details = Details { converged: found.converged, ..Details::default() };
        Ok((ForceModel::Tsk(found.model), found.offsets_n, details))
    }

    fn lazy(&self) -> Result<Fitted, Error> {
        let fitted = lazy::fit(self.datasets, self.drive, self.options.seed, self.watch)?;
        let details =
            Details { restart_rsse_n: fitted.restart_rsse_n, converged: true, ..Details::default() };
        Ok((ForceModel::Lazy(fitted.model), fitted.offsets_n, details))
    }

    fn network(&self, structure: NetworkStructure) -> Result<Fitted, Error> {
        let restarts = self.options.restarts.div_ceil(network::RESTARTS_PER_RESTART);
        let seed = self.options.seed;
        let fitted = network::fit(self.datasets, structure, self.drive, restarts, seed, self.watch)?;
        let details = Details {
            restart_rsse_n: fitted.restart_rsse_n,
            warnings: fitted.warnings,
            converged: true,
            ..Details::default()
        };
        Ok((ForceModel::Network(fitted.model), fitted.offsets_n, details))
    }

    /// How parameters depend on the drive in the requested form, and the memberships if there are sets.
    fn dependence(&self) -> Result<(Dependence, Option<Memberships>), Error> {
        match (self.spec.form(), self.drive) {
            (Form::SemiActive, Some(drive)) => {
                let degree = self.usable_degree(drive)?;
                Ok((Dependence::Polynomial { drive, degree }, None))
            }
            (Form::Fuzzy | Form::FreeFuzzy, Some(drive)) => {
                let memberships = self.memberships(drive)?;
                Ok((Dependence::Fuzzy(memberships.sets), Some(memberships)))
            }
            (Form::Passive, _) | (_, None) => Ok((Dependence::None, None)),
        }
    }

    /// Drive values of the counted rows.
    fn drives(&self) -> impl Iterator<Item = f64> {
        self.datasets.iter().flat_map(|d| &d.rows).filter(|row| row.counts).map(|row| row.drive)
    }

    /// The level of the drive, if it has only one.
    fn only_level(&self) -> Option<f64> {
        // A thousand values are enough; sorting all values of a long run takes longer than a regression on
        // it.
        let every = (self.drives().count() / 1024).max(1);
        match Memberships::levels(self.drive?, self.drives().step_by(every))?.as_slice() {
            [level] => Some(*level),
            _ => None,
        }
    }

    /// Number of levels of the drive; `None` if it varies continuously.
    fn levels(&self, kind: DriveKind) -> Option<usize> {
        Memberships::levels(kind, self.drives()).map(|levels| levels.len())
    }

    /// The highest degree, up to the requested one, that the levels of the drive determine.
    fn usable_degree(&self, kind: DriveKind) -> Result<usize, Error> {
        match Memberships::levels(kind, self.drives()).as_deref() {
            Some([level]) => Err(IdentifyError::ConstantDrive { drive: kind, value: *level }.into()),
            Some(levels) => Ok(self.options.degree.min(levels.len() - 1)),
            None => Ok(self.options.degree),
        }
    }

    /// A warning if the degree of the polynomials is lower than requested.
    fn lowered_degree(&self, dependence: &Dependence) -> Vec<String> {
        let &Dependence::Polynomial { drive, degree } = dependence else { return Vec::new() };
        let requested = self.options.degree;
        let text = || {
            let levels = degree + 1;
            format!(
                "the runs hold {levels} levels of {drive}: polynomials over it have degree {degree} instead of {requested}"
            )
        };
        (degree < requested).then(text).into_iter().collect()
    }

    /// Fuzzy sets as requested by the options.
    fn memberships(&self, kind: DriveKind) -> Result<Memberships, Error> {
        match &self.options.placement {
            Placement::Given { centres, sigma } => Memberships::given(kind, centres, *sigma),
            Placement::Even(count) => Memberships::even(kind, self.drives(), *count),
            Placement::FromRuns => Memberships::from_drive(kind, self.drives()),
        }
    }
}

/// The datasets for a model that learns from sequences: stretches of them if `most_rows` limits the number of
/// rows. Linear regressions use all rows, and searches draw their own samples.
fn shortened<'a>(spec: ModelSpec, datasets: &'a [Dataset], options: &Options) -> Cow<'a, [Dataset]> {
    let learns = matches!(spec.structure(), Structure::Tsk(_) | Structure::Boada | Structure::Network(_));
    let rows: usize = datasets.iter().map(Dataset::counted).sum();
    match options.most_rows.filter(|most| learns && rows > *most) {
        Some(most) => {
            let every = rows.div_ceil(most.max(1));
            datasets.iter().map(|dataset| dataset.stretches(every)).collect()
        }
        None => Cow::Borrowed(datasets),
    }
}

/// The error for P, which cannot run as a model.
pub(super) fn cannot_run() -> Error {
    IdentifyError::CannotRun.into()
}

fn no_passive_form(structure: Structure) -> Error {
    let known = structure.forms().iter().map(|form| form.name()).collect();
    IdentifyError::UnknownForm { model: structure.name(), form: Form::Passive.name(), known }.into()
}

/// The model, with the rate and envelope of the rows.
fn model(force: ForceModel, conditioning: Conditioning, datasets: &[Dataset]) -> Model {
    let envelope = datasets.iter().fold(Envelope::default(), |all, d| dataset::union(&all, &d.envelope));
    Model {
        force,
        effects: Effects::NONE,
        conditioning,
        rate_hz: datasets.iter().map(|d| d.rate_hz).fold(f64::INFINITY, f64::min),
        envelope: Envelope { drive: envelope.drive.filter(|_| force.drive().is_some()), ..envelope },
        expected: Expected::default(),
        inverse: None,
    }
}
