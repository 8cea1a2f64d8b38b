//! A base model with effects as one vector of numbers, for derivatives and joint fits.
//!
//! ```text
//! p = (coefficients of the base, parameters of the first effect, of the second, ..., numbers of the first term, ...)
//! ```
//!
//! In paired mode the base's coefficients are not included.

use super::ranges::Ranges;
use crate::effect::term::{FormParameter, Term, Terms};
use crate::effect::{Augmented, EffectModel, Effects};
use crate::error::{DiagnosisError, Error};
use crate::force::law::Kind;
use crate::force::{Dependence, ForceLaw, ForceModel, LawModel, TanhFunction};
use crate::identify::Scales;

/// Step of a finite difference, relative to the coefficient of the base.
const STEP: f64 = 1e-4;
/// Least magnitude used for a coefficient's step, as a share of its natural scale.
const LEAST_SIZE: f64 = 1e-2;
/// Factor between the steepness of a tanh function and the median, in either direction, beyond which it no longer describes a yield.
const UPRIGHT: f64 = 3.0;
/// Step of a finite difference, relative to the probe of an effect's parameter.
const PROBE_SHARE: f64 = 0.05;

/// A coefficient of a base.
#[derive(Debug, Clone, Copy)]
struct Coefficient {
    value: f64,
    step: f64,
    bounds: [f64; 2],
}

impl Coefficient {
    fn new(value: f64, size: f64, bounds: [f64; 2]) -> Self {
        let step = STEP * value.abs().max(LEAST_SIZE * size);
        // A model that was not identified here may lie outside the bounds of the search.
        Self { value, step, bounds: [bounds[0].min(value), bounds[1].max(value)] }
    }
}

/// The numbers that a fit may change, and the model that they belong to.
pub(super) struct Space {
    base: ForceModel,
    /// Empty if the base is not refitted.
    coefficients: Vec<Coefficient>,
    effects: Vec<EffectModel>,
    terms: Vec<Term>,
    scales: Scales,
    ranges: Ranges,
}

impl Space {
    /// The space around `model`, with the base's coefficients if `base_moves`.
    ///
    /// # Errors
    /// [`DiagnosisError::BaseNotPhysical`] or [`DiagnosisError::BaseNotDetermined`] if `base_moves` is set and the base has no
    /// coefficients that can be refitted here.
    pub(super) fn new(
        model: &Augmented,
        scales: Scales,
        ranges: Ranges,
        base_moves: bool,
    ) -> Result<Self, Error> {
        let coefficients = if base_moves { coefficients(model.force(), &scales)? } else { Vec::new() };
        let effects = model.effects().as_slice().to_vec();
        let terms = model.effects().terms().iter().copied().collect();
        Ok(Self { base: *model.force(), coefficients, effects, terms, scales, ranges })
    }

    /// The numbers of the model at the centre of the space.
    pub(super) fn values(&self) -> Vec<f64> {
        let base = self.coefficients.iter().map(|c| c.value);
        let effects = self.effects.iter().flat_map(|e| e.parameters().iter().copied());
        base.chain(effects).chain(self.terms.iter().flat_map(|t| t.values().iter().copied())).collect()
    }

    /// Number of values that belong to the base.
    pub(super) fn of_base(&self) -> usize {
        self.coefficients.len()
    }

    /// Number of coefficients of the base that do not belong to the space.
    pub(super) fn fixed(&self) -> usize {
        if self.coefficients.is_empty() { self.base.parameter_count() } else { 0 }
    }

    /// Bounds of each number: for a coefficient the bounds of its search, for an effect's parameter its physical range extended to
    /// the neutral value, for a term's [`bounds_of_term`].
    pub(super) fn bounds(&self) -> Vec<[f64; 2]> {
        let base = self.coefficients.iter().map(|c| c.bounds);
        let parameters = |e: &EffectModel| {
            let effect = e.effect();
            effect.parameters().iter().enumerate().map(move |(index, parameter)| (effect, index, parameter))
        };
        let effects = self.effects.iter().flat_map(parameters).map(|(effect, index, parameter)| {
            let size = self.scales.size(parameter.scale);
            let [low, high] = self.ranges.of(effect, index, parameter, size);
            let neutral = if parameter.is_shape() { low } else { parameter.neutral * size };
            [low.min(neutral), high.max(neutral)]
        });
        base.chain(effects).chain(self.terms.iter().flat_map(bounds_of_term)).collect()
    }

    /// The finite-difference step of each number, with its sign such that it stays within the bounds.
    pub(super) fn steps(&self, at: &[f64]) -> Vec<f64> {
        let base = self.coefficients.iter().map(|c| c.step);
        let effects = self.effects.iter().flat_map(|e| e.effect().parameters()).map(|parameter| {
            let size = self.scales.size(parameter.scale);
            let probe = if parameter.is_shape() { 0.05 * parameter.neutral } else { parameter.probe };
            (PROBE_SHARE * probe * size).abs()
        });
        let terms = self.terms.iter().flat_map(|t| t.values()).map(|value| STEP * value.abs().max(1e-6));
        let effects = effects.chain(terms);
        let inside =
            |((step, bounds), at): ((f64, [f64; 2]), &f64)| if at + step > bounds[1] { -step } else { step };
        base.chain(effects).zip(self.bounds()).zip(at).map(inside).collect()
    }

    /// A second start for a search that ended at `values`. Each tanh function whose steepness is less than a third or more than three
    /// times the median gets the median steepness, with the same slope at rest. A function that was flattened to imitate a missing effect
    /// does not recover by itself after the effect is added. A flat one acts as a second damping, and the steepness of one without
    /// height has no influence. `None` if no function is like that, or if the base has no tanh functions.
    pub(super) fn upright(&self, values: &[f64]) -> Option<Vec<f64>> {
        if !matches!(self.base, ForceModel::FuzzyTanh(_)) {
            return None;
        }
        let mut upright = values.to_vec();
        let functions = upright.get_mut(..self.of_base())?.as_chunks_mut::<4>().0;
        let mut slopes: Vec<f64> = functions.iter().map(|f| f[2]).collect();
        slopes.sort_by(f64::total_cmp);
        let middle = *slopes.get(slopes.len() / 2)?;
        let lies = |slope: f64| slope * UPRIGHT < middle || slope > middle * UPRIGHT;
        let mut any = false;
        for [height, _, slope, _] in functions.iter_mut().filter(|f| lies(f[2])) {
            *height *= *slope / middle;
            *slope = middle;
            any = true;
        }
        any.then_some(upright)
    }

    /// The model with these numbers; `None` if they are not valid.
    pub(super) fn model(&self, values: &[f64]) -> Option<Augmented> {
        let (base, mut rest) = values.split_at(self.of_base());
        let force = if base.is_empty() { self.base } else { self.base.with_coefficients(base)? };
        let mut effects = Vec::with_capacity(self.effects.len());
        for effect in &self.effects {
            let (own, others) = rest.split_at(effect.parameters().len());
            effects.push(EffectModel::new(effect.effect(), own).ok()?);
            rest = others;
        }
        let mut terms = Vec::with_capacity(self.terms.len());
        for term in &self.terms {
            let (own, others) = rest.split_at(term.values().len());
            terms.push(term.with_values(own)?);
            rest = others;
        }
        let effects = Effects::new(&effects).ok()?.with_terms(Terms::new(&terms).ok()?);
        Augmented::new(force, effects).ok()
    }
}

/// Bounds of the numbers of a term: any amount, and [`FormParameter::bounds`].
pub(super) fn bounds_of_term(term: &Term) -> impl Iterator<Item = [f64; 2]> {
    let (range, (_, _, form)) = (term.confirmed_in(), term.kind());
    let bounds = move |parameter: &FormParameter| parameter.bounds(range);
    std::iter::once([f64::NEG_INFINITY, f64::INFINITY]).chain(form.parameters().iter().map(bounds))
}

/// The coefficients of `base`, with their bounds and natural sizes.
fn coefficients(base: &ForceModel, scales: &Scales) -> Result<Vec<Coefficient>, Error> {
    match base {
        ForceModel::FuzzyTanh(fuzzy) => {
            Ok(fuzzy.functions().iter().flat_map(|f| of_tanh(f, scales)).collect())
        }
        ForceModel::Law(law) => Ok(of_law(law, scales)),
        ForceModel::MaxwellSlip(_) => Err(DiagnosisError::BaseNotDetermined {
            model: base.name(),
            coefficients: base.parameter_count(),
        }
        .into()),
        _ => {
            let laws = ForceLaw::ALL.map(ForceLaw::name).to_vec();
            Err(DiagnosisError::BaseNotPhysical { model: base.name(), laws }.into())
        }
    }
}

fn of_tanh(f: &TanhFunction, scales: &Scales) -> [Coefficient; 4] {
    let (force, speed, frequency) = (scales.force_n, scales.velocity_m_s, scales.frequency_1_s);
    let anything = [f64::NEG_INFINITY, f64::INFINITY];
    [
        Coefficient::new(f.yield_force_n, force, [0.0, 10.0 * force]),
        Coefficient::new(f.post_yield_damping_n_s_m, force / speed, anything),
        Coefficient::new(f.pre_yield_slope_s_m, 1.0 / speed, [0.03 / speed, 1e4 / speed]),
        Coefficient::new(f.coupling_per_s, frequency, [-5.0 * frequency, 5.0 * frequency]),
    ]
}

fn of_law(model: &LawModel, scales: &Scales) -> Vec<Coefficient> {
    let parameters = model.law().parameters();
    let powers = matches!(model.dependence(), Dependence::Polynomial { .. });
    let coefficient = |(index, value): (usize, &f64)| {
        let (copy, parameter) = (index / parameters.len(), &parameters[index % parameters.len()]);
        let size = scales.size(parameter.scale);
        let fixed = parameter.kind == Kind::Gauge || (powers && copy > 0 && !parameter.follows_drive);
        if fixed {
            return Coefficient::new(*value, size, [*value, *value]);
        }
        if powers && copy > 0 {
            let size = size / scales.drive.powi(copy as i32);
            return Coefficient::new(*value, size, [f64::NEG_INFINITY, f64::INFINITY]);
        }
        Coefficient::new(*value, size, parameter.bounds.map(|bound| bound * size))
    };
    model.coefficients().iter().enumerate().map(coefficient).collect()
}

/// `model` with one more effect, inserted by its place in the damper.
pub(super) fn with_effect(model: &Augmented, effect: EffectModel) -> Result<Augmented, Error> {
    let mut effects = model.effects().as_slice().to_vec();
    let at = effects.partition_point(|other| other.effect().layer() <= effect.effect().layer());
    effects.insert(at, effect);
    Augmented::new(*model.force(), Effects::new(&effects)?.with_terms(*model.effects().terms()))
}

/// `model` without its effect number `index`.
pub(super) fn without_effect(model: &Augmented, index: usize) -> Result<Augmented, Error> {
    let mut effects = model.effects().as_slice().to_vec();
    effects.remove(index);
    Augmented::new(*model.force(), Effects::new(&effects)?.with_terms(*model.effects().terms()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::{FuzzySets, FuzzyTanh, MaxwellSlip, Membership, SlipFunction, SlipGrid};
    use crate::sample::DriveKind;

    const SCALES: Scales = Scales {
        force_n: 1000.0,
        displacement_m: 0.015,
        velocity_m_s: 0.2,
        acceleration_m_s2: 5.0,
        frequency_1_s: 20.0,
        drive: 2.0,
    };

    #[test]
    fn a_base_with_bristles_is_refused_unless_it_is_not_refitted() -> Result<(), Error> {
        let grid = SlipGrid::new([0.01, 0.03, 0.1], [5e-4, 1e-3, 2e-3, 4e-3, 8e-3])?;
        let force = ForceModel::MaxwellSlip(MaxwellSlip::new(grid, None, &[SlipFunction::default()], 0.0)?);
        let base = Augmented::new(force, Effects::NONE)?;
        let refused =
            Space::new(&base, SCALES, Ranges::default(), true).map(|_| ()).expect_err("refused").to_string();
        assert!(refused.contains("the maxwell-slip model cannot be refitted in a diagnosis"), "{refused}");
        assert!(refused.contains("15 coefficients"), "{refused}");
        assert!(
            Space::new(&base, SCALES, Ranges::default(), false)?.values().is_empty(),
            "paired runs do not refit it"
        );
        Ok(())
    }

    #[test]
    fn a_flat_tanh_function_gets_the_median_steepness_and_keeps_its_slope_at_rest() -> Result<(), Error> {
        let membership = Membership { drive: DriveKind::CoilCurrent, sigma: 0.5 };
        let upright = |slopes: [f64; 3]| -> Result<Option<Vec<f64>>, Error> {
            let functions = slopes.map(|slope| TanhFunction::new([300.0, 900.0, slope, 2.0]));
            let sets = FuzzySets::new(membership, &[0.0, 1.0, 2.0])?;
            let force = ForceModel::FuzzyTanh(FuzzyTanh::new(sets, &functions, 0.0)?);
            let space = Space::new(&Augmented::new(force, Effects::NONE)?, SCALES, Ranges::default(), true)?;
            Ok(space.upright(&space.values()))
        };
        assert_eq!(upright([30.0, 45.0, 60.0])?, None);
        let found = upright([30.0, 1.5, 40.0])?.expect("one is flat");
        assert_eq!(found[4..8], [300.0 * 1.5 / 30.0, 900.0, 30.0, 2.0]);
        assert_eq!((found[2], found[10]), (30.0, 40.0));
        Ok(())
    }
}
