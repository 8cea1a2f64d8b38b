//! A function that stands for the search, fitted to a model, and what it is worth.
//!
//! ```text
//! i(F)    error of current  rms (i(F(i)) - i)         error of force  rms (F(i(F(i))) - F(i))
//! ```
//!
//! Both errors are at motions and currents between those that it was fitted on, the force from the memory that the model
//! has there, and only where the current moves the force at all.

use super::cycle::{At, Cycle, Phase};
use super::fuzzy::Fuzzy;
use super::limits::Limits;
use super::method::Method;
use super::polynomial::Polynomial;
use super::prepare::refused;
use super::shape::{HARDLY, Shape};
use super::solve::{Moment, Solution};
use crate::effect::{Augmented, Effect, Effects};
use crate::error::Error;
use crate::force::{Inputs, MAX_INPUTS};
use crate::model::Model;
use crate::units::{Ampere, Newton};

/// Reaches of the sines that it is fitted on, and that it is looked at on.
const FITTED: [f64; 5] = [0.2, 0.4, 0.6, 0.8, 1.0];
const LOOKED: [f64; 4] = [0.3, 0.5, 0.7, 0.9];
/// Currents that it is fitted on; it is looked at halfway between them.
const CURRENTS: usize = 11;

/// Share of the model's largest force by which it may turn back over the current. What turns back by less costs no more than a
/// surrogate is off by anyway, and the fit shows it; fitted models of a damper that saturates often do near the largest current.
const GROSS: f64 = 0.1;

/// How well a surrogate stands for its model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurrogateFit {
    /// Root mean square of what its current is off by.
    pub current: Ampere,
    /// Root mean square of what the model's force at its current is off the one that was asked for.
    pub force: Newton,
    /// The model's largest force among the points.
    pub largest: Newton,
    /// Points at which it gave a current, and at which it was asked for one.
    pub points: [usize; 2],
}

impl SurrogateFit {
    /// The error of force as a share of the largest force.
    #[must_use]
    pub fn force_share(&self) -> f64 {
        self.force.get() / self.largest.get()
    }
}

/// What the model does at one sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// The sample; its drive is the current.
    pub(super) inputs: Inputs,
    /// The model's force, N.
    pub(super) force_n: f64,
}

impl Sample {
    /// What the rules are over.
    pub(super) const fn raw(&self) -> [f64; MAX_INPUTS] {
        [self.inputs.displacement_m, self.inputs.velocity_m_s, self.force_n]
    }
}

/// A function, and what it is worth.
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
    /// The current for `force_n` on a damper whose force grows with the current by `way_n` in all.
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
    /// The surrogate of `model` that `method` is; `None` for the search.
    ///
    /// # Errors
    /// [`Error::Data`] for a model that it cannot stand for, with the reason.
    pub(super) fn of(
        model: &Model,
        method: Method,
        shape: &Shape,
        limits: &Limits,
    ) -> Result<Option<Self>, Error> {
        if method == Method::Search {
            return Ok(None);
        }
        check(model, method, shape)?;
        let alone = Model { effects: Effects::NONE, ..*model };
        let (cycle, bare) = (Cycle::of(&alone), alone.augmented());
        let most_n = Shape::of(&alone, limits.current_max_a).most_n;
        let ground = Ground { cycle, bare: &bare, most_n, limits };
        let samples = ground.samples();
        let undetermined =
            || refused(model, &format!("leaves its {} inverse undetermined; take search", method.name()));
        if samples.is_empty() {
            return Err(undetermined());
        }
        let map = match method {
            Method::Polynomial => {
                let fitted = Polynomial::fit(&samples, cycle.fastest_m_s, limits.current_max_a);
                Map::Polynomial(fitted.ok_or_else(undetermined)?)
            }
            _ => Map::Fuzzy(Fuzzy::fit(&samples, &cycle)?),
        };
        let fit = ground.fit_of(&map);
        if fit.points[0] == 0 {
            return Err(undetermined());
        }
        Ok(Some(Self { map, current_max_a: limits.current_max_a, fit }))
    }

    pub(super) const fn fit(&self) -> &SurrogateFit {
        &self.fit
    }

    /// The current for `demand_n` at `moment`, which is that of `inputs`: beyond what the model has the end that is nearer, between what
    /// the function says, and where that says nothing the last one. `None` when the model has no force.
    #[inline]
    pub(super) fn solve(
        &self,
        moment: &Moment,
        inputs: &Inputs,
        demand_n: f64,
        last: Ampere,
    ) -> Option<Solution> {
        let max_a = self.current_max_a;
        let (low_n, high_n) = (moment.force_n(0.0)?, moment.force_n(max_a)?);
        let achievable_n = [low_n.min(high_n), low_n.max(high_n)];
        if !(achievable_n[0] < demand_n && demand_n < achievable_n[1]) {
            let near_low = (demand_n - low_n).abs() <= (demand_n - high_n).abs();
            let (current_a, force_n) = if near_low { (0.0, low_n) } else { (max_a, high_n) };
            return Some(Solution { current_a, force_n, achievable_n });
        }
        let found = self.map.current_a(inputs, demand_n - moment.added_n()?, high_n - low_n);
        let current_a = found.filter(|a| !a.is_nan()).unwrap_or(last.get()).clamp(0.0, max_a);
        Some(Solution { current_a, force_n: moment.force_n(current_a)?, achievable_n })
    }
}

/// What a surrogate is fitted on.
struct Ground<'a> {
    cycle: Cycle,
    bare: &'a Augmented,
    /// Its largest force, N.
    most_n: f64,
    limits: &'a Limits,
}

impl Ground<'_> {
    fn samples(&self) -> Vec<Sample> {
        let mut samples = Vec::new();
        for reach in FITTED {
            for step in 0..CURRENTS {
                let current_a = self.limits.current_max_a * step as f64 / (CURRENTS - 1) as f64;
                self.cycle.along(self.bare, reach, current_a, Phase::On, |at| {
                    if self.way_n(at).is_some() {
                        samples.push(Sample { inputs: at.inputs, force_n: at.force_n });
                    }
                });
            }
        }
        samples
    }

    /// By how much the current moves the force in all; `None` where a commander holds.
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
                self.cycle.along(self.bare, reach, current_a, Phase::Between, |at| {
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

/// Refuses a model that no function of motion and force stands for.
fn check(model: &Model, method: Method, shape: &Shape) -> Result<(), Error> {
    let refuse =
        |why: &str| Err(refused(model, &format!("{why}: no {} inverse; take search", method.name())));
    if model.force.force_fed_period().is_some() {
        return refuse("feeds on its own force, in which a current shows samples later");
    }
    if let Some(fold) = shape.fold.filter(|fold| fold.fall_n > GROSS * shape.most_n) {
        return refuse(&format!(
            "gives one force at several currents (it turns back by {:.1} N from {:.2} A on)",
            fold.fall_n, fold.current_a
        ));
    }
    let stands =
        |effect: Effect| effect.only_adds() || matches!(effect, Effect::CoilLag | Effect::CoilLagRiseFall);
    match model.effects.as_slice().iter().find(|effect| !stands(effect.effect())) {
        Some(effect) => refuse(&format!("has {}, which does more than add a force", effect.effect().title())),
        None => Ok(()),
    }
}
