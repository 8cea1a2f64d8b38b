//! A surrogate: a function that replaces the search, fitted to a model, and its accuracy.
//!
//! ```text
//! i(F)    error of current  rms (i(F(i)) - i)         error of force  rms (F(i(F(i))) - F(i))
//! ```
//!
//! Both errors are evaluated at motions and currents between the fitted ones. The force is computed from the model's state at that
//! point. Only points count at which the current moves the force.

use super::cycle::{At, Cycle, CyclePoints};
use super::fuzzy::Fuzzy;
use super::limits::Limits;
use super::method::Method;
use super::parts::InverseMap;
use super::polynomial::Polynomial;
use super::prepare::refused;
use super::shape::{HARDLY, Shape};
use super::solve::{Ends, Moment, Solution};
use crate::effect::{Augmented, Effect, Effects, term};
use crate::error::{Error, NoInverse};
use crate::force::{Inputs, MAX_INPUTS};
use crate::model::Model;
use crate::units::{Ampere, Newton};

/// Amplitudes of the sines for the fit, and of those for its evaluation.
const FITTED: [f64; 5] = [0.2, 0.4, 0.6, 0.8, 1.0];
const LOOKED: [f64; 4] = [0.3, 0.5, 0.7, 0.9];
/// Number of currents for the fit; it is evaluated halfway between them.
const CURRENTS: usize = 11;

/// Largest fall of the force over the current, as a share of the model's largest force. A smaller fall costs no more than the
/// surrogate's own error, and the fit shows it. Fitted models of a saturating damper often fall near the largest current.
const GROSS: f64 = 0.1;

/// Accuracy of a surrogate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurrogateFit {
    /// RMS error of its current.
    pub current: Ampere,
    /// RMS error of the model's force at its current, relative to the demanded force.
    pub force: Newton,
    /// The model's largest force among the points.
    pub largest: Newton,
    /// Number of points at which it gave a current, and number of points at which it was evaluated.
    pub points: [usize; 2],
}

impl SurrogateFit {
    /// The error of force as a share of the largest force.
    #[must_use]
    pub fn force_share(&self) -> f64 {
        self.force.get() / self.largest.get()
    }
}

/// The model's force at one sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// The sample; its drive is the current.
    pub(super) inputs: Inputs,
    /// The model's force, N.
    pub(super) force_n: f64,
}

impl Sample {
    /// The inputs of the rules.
    pub(super) const fn raw(&self) -> [f64; MAX_INPUTS] {
        [self.inputs.displacement_m, self.inputs.velocity_m_s, self.force_n]
    }
}

/// A fitted function and its accuracy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Surrogate {
    map: Map,
    current_max_a: f64,
    fit: SurrogateFit,
}

/// The function.
#[allow(clippy::large_enum_variant, reason = "a box would allocate")]
#[derive(Debug, Clone, Copy, PartialEq)]
enum Map {
    Polynomial(Polynomial),
    Fuzzy(Fuzzy),
}

impl Map {
    /// The current for `force_n`. `way_n` is the change of the damper's force from zero current to the largest.
    #[inline]
    fn current_a(&self, inputs: &Inputs, force_n: f64, way_n: f64) -> Option<f64> {
        let Inputs { displacement_m, velocity_m_s, acceleration_m_s2, .. } = *inputs;
        match self {
            Self::Polynomial(map) => map.current_a(velocity_m_s, acceleration_m_s2, force_n, way_n),
            Self::Fuzzy(map) => map.current_a(displacement_m, velocity_m_s, force_n),
        }
    }
}

impl Surrogate {
    /// The surrogate of `model` by `method`; `None` for another method.
    ///
    /// # Errors
    /// [`InverseError`](crate::error::InverseError) for a model that the method does not support.
    pub(super) fn of(
        model: &Model,
        method: Method,
        shape: &Shape,
        limits: &Limits,
    ) -> Result<Option<Self>, Error> {
        if !matches!(method, Method::Polynomial | Method::Fuzzy) {
            return Ok(None);
        }
        check(model, method, shape)?;
        let alone = Model { effects: Effects::NONE, ..*model };
        let (cycle, bare) = (Cycle::of(&alone), alone.augmented());
        let most_n = Shape::of(&alone, limits.current_max_a).most_n;
        let context = FitContext { cycle, bare: &bare, most_n, limits };
        let samples = context.samples();
        let undetermined = || refused(model, NoInverse::Undetermined { method: method.name() });
        if samples.is_empty() {
            return Err(undetermined());
        }
        let map = match method {
            Method::Polynomial => {
                let fitted = Polynomial::fit(&samples, cycle.fastest_m_s, limits.current_max_a);
                Map::Polynomial(fitted.ok_or_else(undetermined)?)
            }
            _ => Map::Fuzzy(Fuzzy::fit(&samples, &cycle)?.ok_or_else(undetermined)?),
        };
        let fit = context.fit_of(&map);
        if fit.points[0] == 0 {
            return Err(undetermined());
        }
        Ok(Some(Self { map, current_max_a: limits.current_max_a, fit }))
    }

    /// The numbers of the function.
    pub(super) const fn map(&self) -> InverseMap {
        match &self.map {
            Map::Polynomial(map) => map.parts(),
            Map::Fuzzy(map) => map.parts(),
        }
    }

    pub(super) const fn fit(&self) -> &SurrogateFit {
        &self.fit
    }

    /// The current for `demand_n` at `moment`, the moment of `inputs`. A demand outside the model's range gives the nearer end.
    /// Otherwise the function gives the current; if it gives none, the last current is kept. `None` if the model has no force.
    #[inline]
    pub(super) fn solve(
        &self,
        moment: &Moment,
        inputs: &Inputs,
        demand_n: f64,
        last: Ampere,
    ) -> Option<Solution> {
        let max_a = self.current_max_a;
        let ends = Ends::of(moment, max_a)?;
        if let Some(end) = ends.clipped(demand_n) {
            return Some(end);
        }
        let found = self.map.current_a(inputs, demand_n - moment.added_n()?, ends.way_n());
        let current_a = found.filter(|a| !a.is_nan()).unwrap_or(last.get()).clamp(0.0, max_a);
        Some(Solution { current_a, force_n: moment.force_n(current_a)?, achievable_n: ends.achievable_n() })
    }
}

/// The data for a surrogate's fit.
struct FitContext<'a> {
    cycle: Cycle,
    bare: &'a Augmented,
    /// Its largest force, N.
    most_n: f64,
    limits: &'a Limits,
}

impl FitContext<'_> {
    fn samples(&self) -> Vec<Sample> {
        let mut samples = Vec::new();
        for reach in FITTED {
            for step in 0..CURRENTS {
                let current_a = self.limits.current_max_a * step as f64 / (CURRENTS - 1) as f64;
                self.cycle.along(self.bare, reach, current_a, CyclePoints::On, |at| {
                    if self.way_n(at).is_some() {
                        samples.push(Sample { inputs: at.inputs, force_n: at.force_n });
                    }
                });
            }
        }
        samples
    }

    /// Change of the force from zero current to the largest, N; `None` near rest, and where the current hardly changes the force.
    fn way_n(&self, at: &At) -> Option<f64> {
        let way_n = at.force_n_at(self.limits.current_max_a)? - at.force_n_at(0.0)?;
        let moves = way_n.abs() >= HARDLY * self.most_n;
        (moves && at.inputs.velocity_m_s.abs() >= self.limits.hold_m_s).then_some(way_n)
    }

    fn fit_of(&self, map: &Map) -> SurrogateFit {
        let (mut squares_a, mut squares_n, mut largest_n) = (0.0, 0.0, 0.0_f64);
        let mut points = [0; 2];
        let max_a = self.limits.current_max_a;
        for reach in LOOKED {
            for step in 1..CURRENTS {
                let current_a = max_a * (step as f64 - 0.5) / (CURRENTS - 1) as f64;
                self.cycle.along(self.bare, reach, current_a, CyclePoints::Between, |at| {
                    let Some(way_n) = self.way_n(at) else { return };
                    points[1] += 1;
                    largest_n = largest_n.max(at.force_n.abs());
                    let found = map.current_a(&at.inputs, at.force_n, way_n).map(|a| a.clamp(0.0, max_a));
                    let Some((found_a, found_n)) = found.and_then(|a| Some((a, at.force_n_at(a)?))) else {
                        return;
                    };
                    points[0] += 1;
                    squares_a += (found_a - current_a).powi(2);
                    squares_n += (found_n - at.force_n).powi(2);
                });
            }
        }
        let rms = |squares: f64| (squares / points[0] as f64).sqrt();
        SurrogateFit {
            current: Ampere(rms(squares_a)),
            force: Newton(rms(squares_n)),
            largest: Newton(largest_n),
            points,
        }
    }
}

/// Refuses a model whose inverse is not unique, or whose current acts only samples later.
pub(super) fn check_unique(model: &Model, method: Method, shape: &Shape) -> Result<(), Error> {
    let method = method.name();
    if model.force.force_fed_period().is_some() {
        return Err(refused(model, NoInverse::Autoregressive { method }));
    }
    if let Some(fold) = shape.fold.filter(|fold| fold.fall_n > GROSS * shape.most_n) {
        let (fall_n, current_a) = (fold.fall_n, fold.current_a);
        return Err(refused(model, NoInverse::NotUnique { method, fall_n, current_a }));
    }
    Ok(())
}

/// Refuses a model whose inverse is not a function of motion and force.
fn check(model: &Model, method: Method, shape: &Shape) -> Result<(), Error> {
    check_unique(model, method, shape)?;
    let method = method.name();
    let stands = |effect: Effect| effect.only_adds() || effect.lags_drive();
    match model.effects.as_slice().iter().find(|effect| !stands(effect.effect())) {
        Some(effect) => Err(refused(model, NoInverse::NotAForce { method, effect: effect.effect().title() })),
        None if !model.effects.terms().is_empty() => {
            Err(refused(model, NoInverse::NotAForce { method, effect: term::ID.to_owned() }))
        }
        None => Ok(()),
    }
}
