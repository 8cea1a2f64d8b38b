//! Fuzzy sets whose centres and widths are identified together with the functions under them (future work in
//! the thesis).
//!
//! ```text
//! F = sum_j w_j f_j,   w_j = g_j / sum g,   ln g_j = -(i - c_j)^2 / (2 s_j^2)
//! dF/d ln g_j = w_j (f_j - F)
//! dF/dc_j     = w_j (f_j - F) (i - c_j) / s_j^2
//! dF/d ln s_j = w_j (f_j - F) (i - c_j)^2 / s_j^2
//! ```
//!
//! This wraps any model that is a sum over sets ([`Blended`]), with or without memory: hidden variables
//! belong to one set and do not depend on its weight. Centres keep their order: each may move nearly half way
//! to its neighbours, and the outer ones equally far outwards. A width may change by a factor of four either
//! way; the solver uses its logarithm. Restarts begin at the sets that are suggested by the runs, or at
//! random draws around them.
//!
//! Source: `[thesis]` in the bibliography (node/docs/guide/bibliography.md), future work of the thesis.

use super::levels::{MembershipSource, Memberships};
use super::row_problem::Columns;
use super::search::SearchedModel;
use crate::error::{Error, IdentifyError};
use crate::force::{FuzzySets, Inputs, MAX_FUNCTIONS, blend};

/// Largest move of a centre as a share of the distance to its neighbour: less than half, so that two never
/// meet.
const REACH: f64 = 0.45;
/// Largest factor by which a width may change.
const WIDEN: f64 = 4.0;
/// Widths are drawn within this factor of their starting value.
const DRAWN: f64 = 1.6;

/// A model that is a sum over fuzzy sets.
pub(super) trait Blended: SearchedModel {
    /// As [`Columns::row`], with `weights` as the basis. The force of each set with non-zero weight is
    /// written to `forces`.
    fn row_by_set(
        &self,
        memory: &mut Self::Memory,
        inputs: &Inputs,
        weights: &[f64],
        natural: &[f64],
        columns: &mut [f64],
        forces: &mut [f64],
    ) -> f64;
}

/// A blended model with free sets.
#[derive(Debug, Clone, Copy)]
pub(super) struct FreeSets<S> {
    inner: S,
    /// Starting values of the sets.
    sets: FuzzySets,
}

impl<S: Blended> FreeSets<S> {
    /// Makes the `sets` of `inner` free. The drive takes `levels` discrete values; `None` if it varies
    /// continuously.
    ///
    /// # Errors
    /// [`IdentifyError::OneFreeSet`]; [`IdentifyError::TooFewLevels`] for at least as many sets as levels, because the
    /// runs then do not determine centres and widths.
    pub(super) fn new(inner: S, sets: FuzzySets, levels: Option<usize>) -> Result<Self, Error> {
        let (count, drive) = (sets.len(), sets.drive());
        match levels {
            _ if count < 2 => Err(IdentifyError::OneFreeSet { drive }.into()),
            Some(levels) if count >= levels => {
                Err(IdentifyError::TooFewLevels { drive, levels, sets: count }.into())
            }
            _ => Ok(Self { inner, sets }),
        }
    }

    fn count(&self) -> usize {
        self.sets.len()
    }

    /// The model's own parameters, without the centres and widths of the sets.
    pub(super) fn own<'a>(&self, natural: &'a [f64]) -> &'a [f64] {
        &natural[..self.inner.parameters()]
    }

    /// The sets with the identified centres and widths.
    pub(super) fn found(&self, natural: &[f64]) -> Result<Memberships, Error> {
        let (centres, sigmas) = natural[self.inner.parameters()..].split_at(self.count());
        let sets = FuzzySets::with_widths(self.sets.drive(), centres, sigmas)?;
        Ok(Memberships { sets, source: MembershipSource::Identified })
    }

    /// Bounds of each centre.
    fn centre_bounds(&self) -> Vec<[f64; 2]> {
        let centres = self.sets.centres();
        let gaps: Vec<f64> = centres.windows(2).map(|pair| REACH * (pair[1] - pair[0])).collect();
        let (first, last) = (gaps[0], gaps[gaps.len() - 1]);
        let below = std::iter::once(&first).chain(&gaps);
        let above = gaps.iter().chain([&last]);
        centres.iter().zip(below.zip(above)).map(|(c, (below, above))| [c - below, c + above]).collect()
    }
}

/// Names of the sets' free parameters, as in the model file.
pub(super) fn names(sets: &FuzzySets) -> Vec<String> {
    let list = |what: &str| {
        let name = format!("membership_{what}_{}", sets.drive().unit_suffix());
        (0..sets.len()).map(move |j| format!("{name}[{j}]"))
    };
    list("centres").chain(list("sigma")).collect()
}

impl<S: Blended> Columns for FreeSets<S> {
    type Memory = S::Memory;

    fn parameters(&self) -> usize {
        self.inner.parameters() + 2 * self.count()
    }

    fn has_memory(&self) -> bool {
        self.inner.has_memory()
    }

    fn basis_len(&self) -> usize {
        0
    }

    fn push_basis(&self, _drive: f64, _basis: &mut Vec<f64>) {}

    fn takes(&self, drive: f64) -> bool {
        self.inner.takes(drive)
    }

    fn natural(&self, parameters: &[f64]) -> Vec<f64> {
        let (own, sets) = parameters.split_at(self.inner.parameters());
        let (centres, log_sigmas) = sets.split_at(self.count());
        let mut natural = self.inner.natural(own);
        natural.extend(centres);
        natural.extend(log_sigmas.iter().map(|s| s.exp()));
        natural
    }

    fn at_rest(&self) -> S::Memory {
        self.inner.at_rest()
    }

    #[inline]
    fn row(
        &self,
        memory: &mut S::Memory,
        inputs: &Inputs,
        _basis: &[f64],
        natural: &[f64],
        columns: &mut [f64],
    ) -> f64 {
        let (own, sets) = natural.split_at(self.inner.parameters());
        let (centres, sigmas) = sets.split_at(self.count());
        let weights = blend(inputs.drive, centres, sigmas);
        let (columns, of_sets) = columns.split_at_mut(own.len());
        let mut forces = [0.0; MAX_FUNCTIONS];
        let weights = &weights[..self.count()];
        let force = self.inner.row_by_set(memory, inputs, weights, own, columns, &mut forces);
        let (by_centre, by_width) = of_sets.split_at_mut(self.count());
        for (j, weight) in weights.iter().enumerate() {
            let distance = (inputs.drive - centres[j]) / sigmas[j];
            let by_strength = weight * (forces[j] - force);
            by_centre[j] = by_strength * distance / sigmas[j];
            by_width[j] = by_strength * distance * distance;
        }
        force
    }
}

impl<S: Blended> SearchedModel for FreeSets<S> {
    fn bounds(&self) -> Vec<[f64; 2]> {
        let mut bounds = self.inner.bounds();
        bounds.extend(self.centre_bounds());
        let sigmas = self.sets.sigmas();
        bounds.extend(sigmas.iter().map(|s| [(s / WIDEN).ln(), (s * WIDEN).ln()]));
        bounds
    }

    fn is_linear(&self, j: usize) -> bool {
        j < self.inner.parameters() && self.inner.is_linear(j)
    }

    fn draw(&self, restart: u32, uniform: &mut dyn FnMut(f64, f64) -> f64) -> Vec<f64> {
        let mut start = self.inner.draw(restart, uniform);
        let plain = restart == 0;
        let sets = &self.sets;
        for (centre, [low, high]) in sets.centres().iter().zip(self.centre_bounds()) {
            start.push(if plain { *centre } else { uniform(low, high) });
        }
        for sigma in sets.sigmas() {
            let ratio = DRAWN.ln();
            start.push(sigma.ln() + if plain { 0.0 } else { uniform(-ratio, ratio) });
        }
        start
    }

    fn settle(&self, start: &mut [f64]) {
        self.inner.settle(&mut start[..self.inner.parameters()]);
    }

    fn natural_slopes(&self, parameters: &[f64]) -> Vec<f64> {
        let (own, sets) = parameters.split_at(self.inner.parameters());
        let mut slopes = self.inner.natural_slopes(own);
        slopes.extend(std::iter::repeat_n(1.0, self.count()));
        slopes.extend(sets[self.count()..].iter().map(|s| s.exp()));
        slopes
    }
}

#[cfg(test)]
mod tests {
    use super::super::scales::Scales;
    use super::super::tanh_columns::TanhColumns;
    use super::*;
    use crate::force::Membership;
    use crate::sample::DriveKind;
    use num_dual::{Dual64, DualNum};
    use proptest::prelude::*;

    const SETS: usize = 3;

    /// The equation at the top of this file for tanh functions, on dual numbers: functions, centres, log
    /// widths.
    fn equation(p: &[Dual64], x: f64, v: f64, i: f64) -> Dual64 {
        let (functions, sets) = p.split_at(4 * SETS);
        let distance = |j: usize| (-sets[j] + i) / sets[SETS + j].exp();
        // A common factor of all strengths, so that they do not all underflow.
        let nearest = (0..SETS).map(|j| distance(j).re.powi(2)).fold(f64::INFINITY, f64::min);
        let (mut sum, mut strengths) = (Dual64::from(0.0), Dual64::from(0.0));
        for (j, f) in functions.chunks_exact(4).enumerate() {
            let strength = ((-distance(j) * distance(j) + nearest) * 0.5).exp();
            let u = f[3] * x + v;
            sum += strength * (f[0] * (f[2].exp() * u).tanh() + f[1] * u);
            strengths += strength;
        }
        sum / strengths
    }

    proptest! {
        #[test]
        fn columns_match_automatic_differentiation(
            x in -0.02..0.02, v in -0.3..0.3, i in -0.3..2.8,
            // The steepest functions overflow the cosh of dual numbers.
            shares in prop::collection::vec(0.0..0.7, 6 * SETS),
        ) {
            let membership = Membership { drive: DriveKind::CoilCurrent, sigma: 0.5 };
            let sets = FuzzySets::new(membership, &[0.0, 1.0, 2.0]).expect("sets");
            let scales = Scales { force_n: 1e3, displacement_m: 0.02, velocity_m_s: 0.3, acceleration_m_s2: 5.0, frequency_1_s: 15.0, drive: 2.0 };
            let free = FreeSets::new(TanhColumns { sets, scales }, sets, None).expect("three sets");
            // Any point within the bounds; infinite bounds are taken as +-1000.
            let point: Vec<f64> = free
                .bounds()
                .iter()
                .zip(&shares)
                .map(|([low, high], share)| low.max(-1e3) + (high.min(1e3) - low.max(-1e3)) * share)
                .collect();
            let inputs = Inputs { dt_s: Some(0.002), displacement_m: x, velocity_m_s: v, acceleration_m_s2: 0.0, drive: i, case_temp_c: f64::NAN };
            let mut columns = vec![0.0; point.len()];
            let force = free.row(&mut (), &inputs, &[], &free.natural(&point), &mut columns);
            for (j, column) in columns.iter().enumerate() {
                let dual: Vec<Dual64> = point
                    .iter()
                    .enumerate()
                    .map(|(k, p)| if k == j { Dual64::from(*p).derivative() } else { Dual64::from(*p) })
                    .collect();
                let exact = equation(&dual, x, v, i);
                // Strengths below 1e-7 are taken as zero, and forces here reach several kilonewtons.
                let slack = 1e-2 + 1e-9 * exact.eps.abs();
                prop_assert!((force - exact.re).abs() < 1e-2, "{force} {}", exact.re);
                prop_assert!((column - exact.eps).abs() <= slack, "{j}: {column} {}", exact.eps);
            }
        }
    }
}
