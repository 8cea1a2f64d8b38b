//! Effects with parameters, and force models with effects around them.

use super::definition::{Inversion, Values};
use super::parts::{Coefficients, Elapsed, Lag, Ring};
use super::term::{self, Past, Terms, TermsState};
use super::{Effect, Layer, MAX_EFFECT_PARAMETERS, MAX_EFFECTS, Need, sensor_delay};
use crate::error::{Error, ForceError};
use crate::force::jet::{Jet, Real};
use crate::force::{ForceModel, ForceOnJets, FreeRun, FuzzyTanhAlong, Inputs, Kept, LawState, Number};

/// An effect with its parameters, ready to run. `R` is `f64`, except inside of this crate, where it may carry derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectModel<R = f64> {
    effect: Effect,
    /// In the order of [`Effect::parameters`]; zeros beyond.
    parameters: Values<R>,
}

impl EffectModel {
    /// `effect` with `parameters`, in the order of [`Effect::parameters`].
    ///
    /// # Errors
    /// [`Error::Length`] if the number of parameters is wrong; [`ForceError::EffectParameter`] if a value is not within
    /// [`super::Parameter::allowed`].
    pub fn new(effect: Effect, parameters: &[f64]) -> Result<Self, Error> {
        let known = effect.parameters();
        if parameters.len() != known.len() {
            return Err(Error::Length {
                name: format!("parameters of {}", effect.title()),
                found: parameters.len(),
                expected: known.len().to_string(),
            });
        }
        for (parameter, value) in known.iter().zip(parameters) {
            let [low, high] = parameter.allowed();
            if !(value.is_finite() && (low..=high).contains(value)) {
                return Err(ForceError::EffectParameter {
                    effect: effect.title(),
                    parameter: parameter.name,
                    value: *value,
                    allowed: [low, high],
                }
                .into());
            }
        }
        let mut model = Self { effect, parameters: [0.0; MAX_EFFECT_PARAMETERS] };
        model.parameters[..parameters.len()].copy_from_slice(parameters);
        Ok(model)
    }

    /// Without a check, for values from this library.
    pub(super) const fn unchecked(effect: Effect, parameters: Values) -> Self {
        Self { effect, parameters }
    }

    /// The effect.
    #[must_use]
    pub const fn effect(&self) -> Effect {
        self.effect
    }

    /// Its parameters, in the order of [`Effect::parameters`].
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        &self.parameters[..self.effect.parameters().len()]
    }

    /// The refined form with the values at which it equals this one, if there is a refined form.
    #[must_use]
    pub fn refined(&self) -> Option<Self> {
        let refinement = self.effect.properties().refinement?;
        Some(Self { effect: refinement.effect, parameters: (refinement.values)(self.parameters) })
    }

    /// True if it changes the reading of the load cell and not the force of the damper.
    #[must_use]
    pub fn is_of_load_cell(&self) -> bool {
        let displacement_is_late =
            self.effect == Effect::SensorDelay && sensor_delay::displacement_is_late(self.parameters);
        matches!(self.effect.layer(), Layer::Measurement(_)) && !displacement_is_late
    }

    /// Time constants of rise and fall, s, if it is a lag of the drive.
    pub(crate) fn drive_lag_s(&self) -> Option<[f64; 2]> {
        match self.effect.properties().inversion {
            Inversion::Lead(taus_s) => Some(taus_s(self.parameters)),
            Inversion::Subtract | Inversion::Search => None,
        }
    }

    /// Stiffness of the force that it adds at rest over the whole stroke, N/m.
    pub(crate) fn static_stiffness_n_m(&self) -> f64 {
        (self.effect.properties().static_stiffness_n_m)(self.parameters)
    }
}

/// State of an effect. All effects share one type so that states are a plain array; each effect uses a part of it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct EffectState<R: Real = f64> {
    pub(super) elapsed: Elapsed,
    pub(super) lags: [Lag<R>; 2],
    pub(super) coefficients: [Coefficients<R>; 2],
    pub(super) held: [R; 3],
    pub(super) ring: Ring<R>,
    /// Solution of the next sample, if it is known: see [`Solved`].
    pub(super) solved: Option<[f64; 2]>,
}

impl<R: Number> EffectState<R> {
    /// The force of the model inside, and the time since its last force (`None` at the first one and after a gap). Returns `None` for a
    /// sample without a force; its time counts towards the next step.
    #[inline]
    pub(super) fn force_inside(
        &mut self,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<(R, Option<f64>)> {
        let force_n = inside.finite(inputs);
        if force_n.is_none() {
            self.elapsed.miss(inputs.dt_s);
        }
        Some((force_n?, self.elapsed.hit(inputs.dt_s)))
    }

    /// The time since the last finite drive (inner `None` at the first one and after a gap); `None` if the drive is not finite.
    #[inline]
    pub(super) fn drive(&mut self, inputs: &Inputs<R>) -> Option<Option<f64>> {
        if inputs.drive.re().is_finite() {
            return Some(self.elapsed.hit(inputs.dt_s));
        }
        self.elapsed.miss(inputs.dt_s);
        None
    }
}

/// The inside of an effect: the model with the effects before it, and their states.
pub(super) struct Inside<'a, R: Number> {
    force: &'a R::Force,
    effects: &'a [EffectModel<R>],
    free: &'a mut R::State,
    states: &'a mut [EffectState<R>],
    /// The terms around the first `of_damper` effects, until they have been stepped.
    terms: Option<InsideTerms<'a, R>>,
}

/// The terms of a model, with their state and their place among the effects.
struct InsideTerms<'a, R: Number> {
    terms: &'a Terms<R>,
    state: &'a mut TermsState<R>,
    of_damper: usize,
}

impl<'a, R: Number> Inside<'a, R> {
    /// One sample of the model inside, with the effects around it. Without effects the force may be not finite; with effects it is `None`
    /// then.
    #[inline]
    pub(super) fn run(&mut self, inputs: &Inputs<R>) -> Option<R> {
        if let Some(own) = self.terms.take_if(|own| own.of_damper == self.effects.len()) {
            return term::step(own.terms, own.state, inputs, self);
        }
        let Some((outermost, effects)) = self.effects.split_last() else {
            return R::free_run(self.force, self.free, inputs);
        };
        let (own, states) = self.states.split_last_mut()?;
        let terms = self.terms.take();
        let mut inside = Inside { force: self.force, effects, free: &mut *self.free, states, terms };
        let force_n = outermost.effect.step(outermost.parameters, own, inputs, &mut inside);
        force_n.filter(|force_n| force_n.re().is_finite())
    }

    /// As [`Inside::run`], but `None` if the force is not finite.
    #[inline]
    pub(super) fn finite(&mut self, inputs: &Inputs<R>) -> Option<R> {
        self.run(inputs).filter(|force_n| force_n.re().is_finite())
    }

    /// The model at a fixed drive, if it can give its slope and has no effects around it inside.
    #[inline]
    pub(super) fn along(&self, drive: f64) -> Option<FuzzyTanhAlong<'_>> {
        if self.effects.is_empty() { R::along(self.force, drive) } else { None }
    }

    /// Trial steps of one sample, each of which can be undone.
    #[inline]
    pub(super) fn trials(&mut self) -> Trials<'_, 'a, R> {
        let free = Kept::of(self.force, self.free);
        Trials { free, states: KeptEffects::of(self.states), inside: self, stepped: false }
    }

    /// The session's force offset, N, which does not come from the damper.
    #[inline]
    pub(super) fn offset_n(&self) -> f64 {
        R::model(self.force).force_offset_n()
    }
}

/// Trial steps of the model inside. Each starts from the state before the sample; the state after the last one is kept.
pub(super) struct Trials<'a, 'b, R: Number> {
    inside: &'a mut Inside<'b, R>,
    free: Kept<R>,
    states: KeptEffects<R>,
    stepped: bool,
}

impl<R: Number> Trials<'_, '_, R> {
    /// Undoes the step before, if there was one, and steps with `inputs`; `None` if the force is not finite.
    #[inline]
    pub(super) fn step(&mut self, inputs: &Inputs<R>) -> Option<R> {
        if self.stepped {
            self.free.restore(self.inside.free);
            self.states.restore(self.inside.states);
        }
        self.stepped = true;
        self.inside.finite(inputs)
    }
}

/// A trial step of an effect may change this. The delay line, most of a state's kilobyte, is copied only if it is in use.
#[derive(Clone, Copy)]
struct KeptEffect<R: Real> {
    elapsed: Elapsed,
    lags: [Lag<R>; 2],
    held: [R; 3],
    ring: Option<Ring<R>>,
}

impl<R: Real> KeptEffect<R> {
    #[inline]
    fn of(state: &EffectState<R>) -> Self {
        let EffectState { elapsed, lags, held, ring, .. } = state;
        Self {
            elapsed: *elapsed,
            lags: *lags,
            held: *held,
            ring: if ring.is_empty() { None } else { Some(*ring) },
        }
    }

    #[inline]
    fn restore(&self, state: &mut EffectState<R>) {
        state.elapsed = self.elapsed;
        state.lags = self.lags;
        state.held = self.held;
        match &self.ring {
            Some(ring) => state.ring = *ring,
            None => state.ring.clear(),
        }
    }
}

/// Kept states of the effects inside another one, at most [`MAX_EFFECTS`] - 1.
#[allow(clippy::large_enum_variant, reason = "a box would allocate")]
enum KeptEffects<R: Real> {
    None,
    One(KeptEffect<R>),
    Two([KeptEffect<R>; MAX_EFFECTS - 1]),
}

impl<R: Real> KeptEffects<R> {
    #[inline]
    fn of(states: &[EffectState<R>]) -> Self {
        match states {
            [] => Self::None,
            [one] => Self::One(KeptEffect::of(one)),
            [one, two, ..] => Self::Two([one, two].map(KeptEffect::of)),
        }
    }

    #[inline]
    fn restore(&self, states: &mut [EffectState<R>]) {
        let kept = match self {
            Self::None => [].as_slice(),
            Self::One(one) => std::slice::from_ref(one),
            Self::Two(both) => both,
        };
        states.iter_mut().zip(kept).for_each(|(state, kept)| kept.restore(state));
    }
}

/// Up to [`MAX_EFFECTS`] effects, in order of application: the last one is the outermost. Effects of the load cell are outside all others.
/// Terms that a diagnosis discovered ([`super::term`]) are around all effects of the damper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effects {
    list: [EffectModel; MAX_EFFECTS],
    len: usize,
    /// Number of effects that change the damper's force; the others are effects of the load cell.
    of_damper: usize,
    terms: Terms,
}

impl Effects {
    /// No effects: the model alone.
    pub const NONE: Self = Self {
        list: [EffectModel::unchecked(Effect::Friction, [0.0; MAX_EFFECT_PARAMETERS]); MAX_EFFECTS],
        len: 0,
        of_damper: 0,
        terms: Terms::NONE,
    };

    /// These effects, the first one nearest to the model.
    ///
    /// # Errors
    /// [`Error::Length`] if there are more than [`MAX_EFFECTS`]; [`ForceError::EffectAfterLoadCell`] if another effect comes after an
    /// effect of the load cell.
    pub fn new(effects: &[EffectModel]) -> Result<Self, Error> {
        let mut all = Self::NONE;
        let Some(list) = all.list.get_mut(..effects.len()) else {
            return Err(Error::Length {
                name: "effects".to_owned(),
                found: effects.len(),
                expected: format!("at most {MAX_EFFECTS}"),
            });
        };
        list.copy_from_slice(effects);
        all.len = effects.len();
        all.of_damper = effects.iter().take_while(|effect| !effect.is_of_load_cell()).count();
        let outer = &effects[all.of_damper..];
        match (outer.first(), outer.iter().find(|effect| !effect.is_of_load_cell())) {
            (Some(first), Some(late)) => Err(ForceError::EffectAfterLoadCell {
                effect: late.effect().title(),
                load_cell: first.effect().title(),
            }
            .into()),
            _ => Ok(all),
        }
    }

    /// The same effects with these terms.
    #[must_use]
    pub const fn with_terms(self, terms: Terms) -> Self {
        Self { terms, ..self }
    }

    /// The terms.
    #[must_use]
    pub const fn terms(&self) -> &Terms {
        &self.terms
    }

    /// The effects and terms that change the damper's force, without the effects of the load cell.
    #[must_use]
    pub fn of_damper(&self) -> Self {
        let Self { of_damper, terms, .. } = *self;
        let mut damper = Self { len: of_damper, of_damper, terms, ..Self::NONE };
        damper.list[..self.of_damper].copy_from_slice(&self.list[..self.of_damper]);
        damper
    }

    /// True if one of them is an effect of the load cell.
    #[must_use]
    pub const fn include_load_cell(&self) -> bool {
        self.of_damper < self.len
    }

    /// The effects of the library, in order of application.
    #[must_use]
    pub fn as_slice(&self) -> &[EffectModel] {
        &self.list[..self.len]
    }

    /// The place of `effect` in the order of application; `None` if it is not one of them.
    pub(crate) fn position(&self, effect: Effect) -> Option<usize> {
        self.as_slice().iter().position(|own| own.effect() == effect)
    }

    /// Their ids, in order of application.
    pub(crate) fn ids(&self) -> impl Iterator<Item = &'static str> {
        self.as_slice().iter().map(|effect| effect.effect().id())
    }

    /// True if there is neither an effect nor a term: the model alone.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.len == 0 && self.terms.is_empty()
    }

    /// True if one of them needs the channel `need`.
    #[must_use]
    pub fn need(&self, need: Need) -> bool {
        self.needing(need).is_some()
    }

    /// Id of the first effect or term that needs the channel `need`.
    #[must_use]
    pub fn needing(&self, need: Need) -> Option<&'static str> {
        let effects = self.as_slice().iter().map(EffectModel::effect);
        let effect = effects.map(|effect| (effect.id(), effect.needs().contains(&need)));
        let terms = self.terms.iter().map(|term| (term::ID, term.need(need)));
        effect.chain(terms).find_map(|(id, needs)| needs.then_some(id))
    }

    /// True if the effects and terms are the same, with any parameters; a state of `other` is then valid here.
    pub(crate) fn same_kinds(&self, other: &Self) -> bool {
        let alike = self
            .as_slice()
            .iter()
            .map(EffectModel::effect)
            .eq(other.as_slice().iter().map(EffectModel::effect));
        alike && self.terms.same_kinds(&other.terms)
    }

    /// True if they add a force that does not depend on the drive, and change no input.
    pub(crate) fn only_add(&self) -> bool {
        self.terms.is_empty() && self.as_slice().iter().all(|effect| effect.effect().only_adds())
    }

    /// Checks that the effects can be added to `force`.
    ///
    /// # Errors
    /// [`ForceError::EffectWithoutDrive`].
    pub fn check(&self, force: &ForceModel) -> Result<(), Error> {
        match self.needing(Need::Drive) {
            Some(effect) if force.drive().is_none() => {
                Err(ForceError::EffectWithoutDrive { effect, model: force.name() }.into())
            }
            _ => Ok(()),
        }
    }

    /// The state before the first sample of a segment, given what lies before it if that is known.
    pub(crate) fn begin(&self, past: Option<&Past>) -> AugmentedState {
        past.map_or_else(AugmentedState::default, |past| AugmentedState {
            free: FreeRun::default(),
            effects: EffectState::after(self.as_slice(), past),
            terms: TermsState::after(past),
        })
    }

    /// Simulates `force` with these effects for one sample; see [`Augmented::free_run`].
    #[inline]
    pub fn free_run(&self, force: &ForceModel, state: &mut AugmentedState, inputs: &Inputs) -> Option<f64> {
        if self.is_empty() {
            return force.free_run(&mut state.free, inputs);
        }
        let states = &mut state.effects[..self.len];
        let terms = inside_terms(&self.terms, &mut state.terms, self.of_damper);
        Inside { force, effects: self.as_slice(), free: &mut state.free, states, terms }.run(inputs)
    }
}

/// The terms with their state, if there are any.
fn inside_terms<'a, R: Number>(
    terms: &'a Terms<R>,
    state: &'a mut TermsState<R>,
    of_damper: usize,
) -> Option<InsideTerms<'a, R>> {
    (!terms.is_empty()).then_some(InsideTerms { terms, state, of_damper })
}

impl Default for Effects {
    fn default() -> Self {
        Self::NONE
    }
}

/// A force model with effects around it.
///
/// ```
/// use mr_damper_model::effect::{Augmented, AugmentedState, Effect, EffectModel, Effects};
/// use mr_damper_model::force::Inputs;
/// use mr_damper_model::preset;
///
/// let force = preset::load(preset::BEST_FUZZY_TANH)?.force;
/// let friction = EffectModel::new(Effect::Friction, &[60.0])?; // N
/// let model = Augmented::new(force, Effects::new(&[friction])?)?;
/// let extending = Inputs {
///     dt_s: None, displacement_m: 0.0, velocity_m_s: 0.2, acceleration_m_s2: 0.0, drive: 1.2, case_temp_c: f64::NAN,
/// };
/// let force_n = |model: &Augmented| model.free_run(&mut AugmentedState::default(), &extending).expect("it is finite");
/// let added_n = force_n(&model) - force_n(&Augmented::from(force));
/// assert!((added_n - 60.0).abs() < 0.1, "{added_n} N");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Augmented {
    force: ForceModel,
    effects: Effects,
}

/// Simulation state of an [`Augmented`] model: the model's state and each effect's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AugmentedState {
    pub(crate) free: FreeRun,
    effects: [EffectState; MAX_EFFECTS],
    terms: TermsState,
}

impl AugmentedState {
    /// The same model state with every effect restarted, for a model with other effects that replaces the running one.
    pub(crate) fn without_effects(&self) -> Self {
        Self { free: self.free, ..Self::default() }
    }

    /// True if at the last sample a term had an argument outside of the range in which it was confirmed.
    #[must_use]
    pub const fn extrapolates(&self) -> bool {
        self.terms.extrapolates()
    }
}

impl<R: Number + Default> EffectState<R> {
    /// Before the first sample of a simulation that begins within a run, for each of `effects`.
    fn after(effects: &[EffectModel<R>], past: &Past) -> [Self; MAX_EFFECTS] {
        let mut states = [Self::default(); MAX_EFFECTS];
        for (state, effect) in states.iter_mut().zip(effects) {
            effect.effect.resume(state, past);
        }
        states
    }
}

impl From<ForceModel> for Augmented {
    /// The model without effects.
    fn from(force: ForceModel) -> Self {
        Self { force, effects: Effects::NONE }
    }
}

impl Augmented {
    /// `force` with `effects` around it.
    ///
    /// # Errors
    /// See [`Effects::check`].
    pub fn new(force: ForceModel, effects: Effects) -> Result<Self, Error> {
        effects.check(&force)?;
        Ok(Self { force, effects })
    }

    pub(crate) const fn unchecked(force: ForceModel, effects: Effects) -> Self {
        Self { force, effects }
    }

    /// The model without the effects.
    #[must_use]
    pub const fn force(&self) -> &ForceModel {
        &self.force
    }

    /// The effects around it.
    #[must_use]
    pub const fn effects(&self) -> &Effects {
        &self.effects
    }

    /// The same with the force offset of another session, N.
    #[must_use]
    pub const fn with_force_offset_n(self, force_offset_n: f64) -> Self {
        Self { force: self.force.with_force_offset_n(force_offset_n), ..self }
    }

    /// True if it can predict one step ahead from measured force: the model can, and it is without effects. Measured force
    /// already contains the effects.
    #[must_use]
    pub const fn feeds_on_force(&self) -> bool {
        self.effects.is_empty() && self.force.force_fed_period().is_some()
    }

    /// As [`Effects::begin`].
    pub(crate) fn begin(&self, past: Option<&Past>) -> AugmentedState {
        self.effects.begin(past)
    }

    /// Simulates one sample (free run) and returns the force in newtons. Returns `None` while the model's history is still filling, and
    /// with effects also if the force is not finite. Without effects the result is bit-identical to [`ForceModel::free_run`]. Effects
    /// restart if `dt_s` is `None`.
    #[inline]
    pub fn free_run(&self, state: &mut AugmentedState, inputs: &Inputs) -> Option<f64> {
        self.effects.free_run(&self.force, state, inputs)
    }
}

/// The force that an effect has solved for at each sample of a simulation, for a simulation of the same model with derivatives.
#[derive(Debug, Clone)]
pub(crate) struct Solved {
    /// Place of the effect.
    index: usize,
    /// Force, N, and slope; `None` for a sample without a force.
    samples: Vec<Option<[f64; 2]>>,
}

impl Solved {
    /// Without samples; `None` if `model` has no effect that solves for its force by trials.
    pub(crate) fn of(model: &Augmented) -> Option<Self> {
        let index = model.effects.position(Effect::SeriesSpring)?;
        let by_slope = index == 0 && model.force.along(0.0).is_some();
        (!by_slope).then(|| Self { index, samples: Vec::new() })
    }

    /// Adds a sample at which the model has `force_n`, and then `state`.
    pub(crate) fn push(&mut self, force_n: Option<f64>, state: &AugmentedState) {
        let [own_n, _, slope] = state.effects[self.index].held;
        self.samples.push(force_n.map(|_| [own_n, slope]));
    }

    /// Prepares `state` for sample number `index`.
    #[inline]
    pub(crate) fn prepare<const N: usize>(&self, index: usize, state: &mut JetState<N>) {
        state.effects[self.index].solved = self.samples.get(index).copied().flatten();
    }
}

/// An [`Augmented`] model whose numbers carry derivatives.
#[derive(Debug, Clone)]
pub(crate) struct AugmentedOnJets<const N: usize> {
    force: ForceOnJets<N>,
    effects: Vec<EffectModel<Jet<N>>>,
    of_damper: usize,
    terms: Terms<Jet<N>>,
}

/// State of an [`AugmentedOnJets`].
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct JetState<const N: usize> {
    free: LawState<Jet<N>>,
    effects: [EffectState<Jet<N>>; MAX_EFFECTS],
    terms: TermsState<Jet<N>>,
}

impl<const N: usize> AugmentedOnJets<N> {
    /// `model` with each of its numbers as `jet` makes it, given its index and value: the coefficients of the force model, then the
    /// parameters of each effect, then the numbers of each term. `None` if the force model has no derivatives by its coefficients.
    pub(crate) fn new(model: &Augmented, mut jet: impl FnMut(usize, f64) -> Jet<N>) -> Option<Self> {
        let mut index = 0..;
        let mut next = |value: f64| index.next().map(|index| jet(index, value)).unwrap_or_default();
        let force = ForceOnJets::new(model.force(), &mut next)?;
        let mut effects = Vec::with_capacity(model.effects().len);
        for effect in model.effects().as_slice() {
            let mut parameters = [Jet::default(); MAX_EFFECT_PARAMETERS];
            parameters.iter_mut().zip(effect.parameters()).for_each(|(jet, value)| *jet = next(*value));
            effects.push(EffectModel { effect: effect.effect, parameters });
        }
        let Effects { of_damper, terms, .. } = model.effects();
        Some(Self { force, effects, of_damper: *of_damper, terms: terms.map(next) })
    }

    /// True if the force model needs a drive.
    pub(crate) fn needs_drive(&self) -> bool {
        Jet::model(&self.force).drive().is_some()
    }

    /// As [`Augmented::begin`].
    pub(crate) fn begin(&self, past: Option<&Past>) -> JetState<N> {
        past.map_or_else(JetState::default, |past| JetState {
            free: LawState::default(),
            effects: EffectState::after(&self.effects, past),
            terms: TermsState::after(past),
        })
    }

    /// As [`Augmented::free_run`], with derivatives.
    #[inline]
    pub(crate) fn free_run(&self, state: &mut JetState<N>, inputs: &Inputs) -> Option<Jet<N>> {
        let JetState { free, effects, terms } = state;
        let states = &mut effects[..self.effects.len()];
        let terms = inside_terms(&self.terms, terms, self.of_damper);
        Inside { force: &self.force, effects: &self.effects, free, states, terms }.run(&inputs.lifted())
    }
}
