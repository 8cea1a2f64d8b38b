//! The solver: finds the current at which the model gives a force, in a bounded number of steps.
//!
//! ```text
//! F(i) = Fd,   0 <= i <= i_max
//! ```
//!
//! The method is regula falsi with the Illinois modification (the value at a retained end is halved). If two steps have not halved
//! the bracket, it is bisected. This is as fast as the secant method where the force is smooth, and takes at most twice as many
//! steps as bisection. The search stops when the force is within 1/10000 of its range over the current, or when the current is
//! known to 1/10000 of its range.
//!
//! A model whose force is linear in the current at each motion ([`super::Shape::is_linear`]: the polynomial of Choi et al., an ARX
//! model) needs no search. i = i_max (Fd - F(0)) / (F(i_max) - F(0)) is exact and uses the two forces that are computed anyway. It
//! equals the first secant of the search, without a check of the result, so it is not a [`super::Method`] of its own.
//!
//! If a model's force is not monotonic in the current ([`super::Shape`]), the range is searched in [`PARTS`] parts. If several
//! currents give the force, the one nearest the last current is taken.
//!
//! Source: Dowell, M. and Jarratt, P. (1971), BIT 11, 168.
//! See `[dowell1971]` in the bibliography (node/docs/guide/bibliography.md).

use crate::effect::{Augmented, AugmentedState};
use crate::force::{ForceModel, FuzzyTanhAt, Inputs};
use crate::units::{Ampere, Newton};

/// Largest number of steps of a search within a bracket. Half as many bisections of the range reach the tolerance.
pub const MOST_STEPS: u32 = 30;
/// Tolerance, as a share of the range of force and of current.
const NEAR: f64 = 1e-4;
/// Number of parts in which the range of a folded model is searched.
const PARTS: usize = 8;

/// The current that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// The current, A; between 0 and the largest.
    pub current_a: f64,
    /// The model's force at that current, N.
    pub force_n: f64,
    /// The least and the largest force of the model at this motion, N.
    pub achievable_n: [f64; 2],
}

/// A solver for one model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solver {
    /// Largest current, A.
    pub current_max_a: f64,
    /// True for a model whose force is not monotonic in the current.
    pub folded: bool,
    /// True for a model whose force at each motion is linear in the current.
    pub linear: bool,
}

impl Solver {
    /// The current whose force is nearest to `demand_n` at `moment`. `last` is the last current and its force at this moment.
    /// `None` if the model has no force there.
    #[inline]
    #[must_use]
    pub fn solve(&self, moment: &Moment, demand_n: f64, last: (Ampere, Newton)) -> Option<Solution> {
        let (Ampere(current_a), Newton(force_n)) = last;
        self.search(|current_a| moment.force_n(current_a), demand_n, End { current_a, force_n })
    }

    fn search(
        &self,
        mut force_n: impl FnMut(f64) -> Option<f64>,
        demand_n: f64,
        last: End,
    ) -> Option<Solution> {
        let (low, high) = (End::at(0.0, &mut force_n)?, End::at(self.current_max_a, &mut force_n)?);
        let mut achievable_n = [low.force_n.min(high.force_n), low.force_n.max(high.force_n)];
        if self.linear {
            let way_n = high.force_n - low.force_n;
            // If the current has no effect, zero current is as good as any.
            let share = if way_n == 0.0 { 0.0 } else { ((demand_n - low.force_n) / way_n).clamp(0.0, 1.0) };
            let force_n = low.force_n + share * way_n;
            return Some(Solution { current_a: share * self.current_max_a, force_n, achievable_n });
        }
        if !self.folded {
            let near_n = NEAR * (achievable_n[1] - achievable_n[0]);
            // The last current is usually near the solution, and its force is already known, so it serves as one end of the
            // bracket.
            let inside = last.current_a > 0.0 && last.current_a < self.current_max_a;
            let between = |a: &End, b: &End| (demand_n - a.force_n) * (demand_n - b.force_n) <= 0.0;
            let (from, to) = match inside {
                true if between(&low, &last) => (low, last),
                true if between(&last, &high) => (last, high),
                _ => (low, high),
            };
            let found = bracketed(&mut force_n, demand_n, from, to, near_n)?;
            return Some(Solution { current_a: found.current_a, force_n: found.force_n, achievable_n });
        }
        let mut best: Option<End> = None;
        let mut before = low;
        for part in 1..=PARTS {
            let share = part as f64 / PARTS as f64;
            let here = if part == PARTS { high } else { End::at(share * self.current_max_a, &mut force_n)? };
            achievable_n = [achievable_n[0].min(here.force_n), achievable_n[1].max(here.force_n)];
            let near_n = NEAR * (achievable_n[1] - achievable_n[0]);
            let found = bracketed(&mut force_n, demand_n, before, here, near_n)?;
            // Better: nearer to the demand by more than the tolerance, or equally near and nearer to the last current.
            let miss = |end: &End| ((end.force_n - demand_n).abs() - near_n).max(0.0);
            let way = |end: &End| (end.current_a - last.current_a).abs();
            let better = best.as_ref().is_none_or(|best| {
                miss(&found) < miss(best) || miss(&found) == miss(best) && way(&found) < way(best)
            });
            if better {
                best = Some(found);
            }
            before = here;
        }
        best.map(|found| Solution { current_a: found.current_a, force_n: found.force_n, achievable_n })
    }
}

/// The forces of a model at one moment, at both ends of the range of the current.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ends {
    max_a: f64,
    low_n: f64,
    high_n: f64,
}

impl Ends {
    /// The forces without current and at `max_a`; `None` if the model has no force.
    #[inline]
    pub(super) fn of(moment: &Moment, max_a: f64) -> Option<Self> {
        Some(Self { max_a, low_n: moment.force_n(0.0)?, high_n: moment.force_n(max_a)? })
    }

    /// Change of the force from zero current to the largest, N.
    pub(super) const fn way_n(&self) -> f64 {
        self.high_n - self.low_n
    }

    /// The least and the largest force, N.
    pub(super) const fn achievable_n(&self) -> [f64; 2] {
        [self.low_n.min(self.high_n), self.low_n.max(self.high_n)]
    }

    /// The end that is nearer to `demand_n`; `None` if the demand lies between the ends.
    #[inline]
    pub(super) fn clipped(&self, demand_n: f64) -> Option<Solution> {
        let achievable_n = self.achievable_n();
        if achievable_n[0] < demand_n && demand_n < achievable_n[1] {
            return None;
        }
        let near_low = (demand_n - self.low_n).abs() <= (demand_n - self.high_n).abs();
        let (current_a, force_n) = if near_low { (0.0, self.low_n) } else { (self.max_a, self.high_n) };
        Some(Solution { current_a, force_n, achievable_n })
    }
}

/// A model at one motion and from one state, as a function of the current.
#[allow(clippy::large_enum_variant, reason = "a box would allocate")]
#[derive(Debug, Clone, Copy)]
pub enum Moment<'a> {
    /// A fuzzy-tanh model: its tanh functions do not depend on the current and are evaluated once. Effects add a force that does
    /// not depend on the current either.
    Still {
        /// The evaluated functions.
        at: FuzzyTanhAt<'a>,
        /// Force of the effects, N.
        added_n: f64,
    },
    /// Any model, evaluated on a copy of its state.
    Whole {
        /// The model.
        model: &'a Augmented,
        /// Its state before the sample.
        before: AugmentedState,
        /// The sample; its current is replaced.
        inputs: &'a Inputs,
    },
}

impl<'a> Moment<'a> {
    /// Steps `model` from `state` by `inputs` with the current `current_a`. Returns the force, N, and the model at this moment for
    /// any other current. `None` if the force is not finite.
    #[inline]
    #[must_use]
    pub fn step(
        model: &'a Augmented,
        state: &mut AugmentedState,
        inputs: &'a Inputs,
        current_a: f64,
    ) -> Option<(f64, Self)> {
        let here = Inputs { drive: current_a, ..*inputs };
        let effects = model.effects();
        match model.force() {
            ForceModel::FuzzyTanh(fuzzy) if effects.only_add() => {
                let at = fuzzy.at(inputs.displacement_m, inputs.velocity_m_s);
                let alone_n = finite(at.force_n(current_a))?;
                if effects.is_empty() {
                    return Some((alone_n, Self::Still { at, added_n: 0.0 }));
                }
                let force_n = model.free_run(state, &here).and_then(finite)?;
                Some((force_n, Self::Still { at, added_n: force_n - alone_n }))
            }
            _ => {
                let before = *state;
                let force_n = model.free_run(state, &here).and_then(finite)?;
                Some((force_n, Self::Whole { model, before, inputs }))
            }
        }
    }

    /// Force that additive effects add at this moment, N; `None` if the model has no force.
    #[inline]
    #[must_use]
    pub fn added_n(&self) -> Option<f64> {
        match self {
            Self::Still { added_n, .. } => Some(*added_n),
            Self::Whole { model, .. } if model.effects().is_empty() => Some(0.0),
            Self::Whole { model, before, inputs } => {
                let mut alone = before.free;
                let bare_n = model.force().free_run(&mut alone, &Inputs { drive: 0.0, ..**inputs })?;
                finite(self.force_n(0.0)? - bare_n)
            }
        }
    }

    /// The model's force at the current `current_a`, N; `None` if it is not finite.
    #[inline]
    #[must_use]
    pub fn force_n(&self, current_a: f64) -> Option<f64> {
        match self {
            Self::Still { at, added_n } => finite(at.force_n(current_a) + added_n),
            Self::Whole { model, before, inputs } => {
                let mut state = *before;
                model.free_run(&mut state, &Inputs { drive: current_a, ..**inputs }).and_then(finite)
            }
        }
    }
}

fn finite(force_n: f64) -> Option<f64> {
    force_n.is_finite().then_some(force_n)
}

/// A current and its force.
#[derive(Debug, Clone, Copy)]
struct End {
    current_a: f64,
    force_n: f64,
}

impl End {
    fn at(current_a: f64, force_n: &mut impl FnMut(f64) -> Option<f64>) -> Option<Self> {
        Some(Self { current_a, force_n: force_n(current_a)? })
    }
}

/// The point between `from` and `to` where the force is `demand_n`, to `near_n`; the nearer end if the demand is outside.
fn bracketed(
    force_n: &mut impl FnMut(f64) -> Option<f64>,
    demand_n: f64,
    from: End,
    to: End,
    near_n: f64,
) -> Option<End> {
    let excess = |end: &End| end.force_n - demand_n;
    let near_a = NEAR * (to.current_a - from.current_a).abs();
    let nearer = |a: End, b: End| if excess(&a).abs() <= excess(&b).abs() { a } else { b };
    if excess(&from) * excess(&to) > 0.0 || excess(&from).abs() <= near_n || excess(&to).abs() <= near_n {
        return Some(nearer(from, to));
    }
    let (mut a, mut b) = (from, to);
    // Excess at each end for the secant; the Illinois modification halves the excess of a retained end.
    let (mut excess_a, mut excess_b) = (excess(&a), excess(&b));
    let (mut width_a, mut steps_since) = ((b.current_a - a.current_a).abs(), 0);
    for _ in 0..MOST_STEPS {
        let secant = (a.current_a * excess_b - b.current_a * excess_a) / (excess_b - excess_a);
        let middle = 0.5 * (a.current_a + b.current_a);
        let (least, most) = (a.current_a.min(b.current_a), a.current_a.max(b.current_a));
        let next = if steps_since >= 2 || !(secant > least && secant < most) { middle } else { secant };
        let found = End::at(next, force_n)?;
        let excess_found = excess(&found);
        if excess_found.abs() <= near_n {
            return Some(found);
        }
        if (excess_found > 0.0) == (excess_a > 0.0) {
            (a, excess_a) = (found, excess_found);
            excess_b *= 0.5;
        } else {
            (b, excess_b) = (found, excess_found);
            excess_a *= 0.5;
        }
        let width = (b.current_a - a.current_a).abs();
        if width <= near_a {
            break;
        }
        if width <= 0.5 * width_a {
            (width_a, steps_since) = (width, 0);
        } else {
            steps_since += 1;
        }
    }
    Some(nearer(a, b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn solver(folded: bool) -> Solver {
        Solver { current_max_a: 2.5, folded, linear: false }
    }

    proptest! {
        #[test]
        fn the_solution_meets_the_demand_or_is_the_nearer_end(
            base_n in -500.0..500.0_f64,
            gain_n in -1000.0..1000.0_f64,
            sharpness in 0.2..20.0_f64,
            middle_a in 0.0..2.5_f64,
            demand_n in -2000.0..2000.0_f64,
            last_a in 0.0..2.5_f64,
        ) {
            // Any sigmoid, including flat ends and steep middles.
            let force_n = |i: f64| base_n + gain_n * ((i - middle_a) * sharpness).tanh();
            let last = End { current_a: last_a, force_n: force_n(last_a) };
            let mut evaluations = 0;
            let found = solver(false).search(|i| { evaluations += 1; Some(force_n(i)) }, demand_n, last).expect("finite");
            let [low, high] = found.achievable_n;
            prop_assert!((0.0..=2.5).contains(&found.current_a));
            prop_assert!(found.force_n == force_n(found.current_a));
            prop_assert!(evaluations <= 2 + MOST_STEPS);
            let expected = demand_n.clamp(low, high);
            // Within the tolerance of force, or at a step steeper than the tolerance of current resolves.
            let steep_n = gain_n.abs() * sharpness * 2.5 * NEAR;
            prop_assert!((found.force_n - expected).abs() <= NEAR * (high - low) + steep_n, "{found:?} {expected}");
        }
    }

    proptest! {
        #[test]
        fn a_linear_force_needs_two_evaluations(
            base_n in -500.0..500.0_f64,
            gain_n in -1000.0..1000.0_f64,
            demand_n in -2000.0..2000.0_f64,
        ) {
            let force_n = |i: f64| base_n + gain_n * i;
            let mut evaluations = 0;
            let found = Solver { linear: true, ..solver(false) }
                .search(|i| { evaluations += 1; Some(force_n(i)) }, demand_n, End { current_a: 1.0, force_n: 0.0 })
                .expect("finite");
            let [low, high] = found.achievable_n;
            prop_assert!((0.0..=2.5).contains(&found.current_a));
            prop_assert!((force_n(found.current_a) - demand_n.clamp(low, high)).abs() < 1e-9, "{found:?}");
            prop_assert!((found.force_n - force_n(found.current_a)).abs() < 1e-9 && evaluations == 2);
        }
    }

    #[test]
    fn a_current_without_effect_is_zero() {
        let last = End { current_a: 1.0, force_n: 100.0 };
        let found =
            Solver { linear: true, ..solver(false) }.search(|_| Some(100.0), 100.0, last).expect("finite");
        assert_eq!((found.current_a, found.force_n), (0.0, 100.0));
    }

    #[test]
    fn of_two_currents_the_one_nearer_to_the_last_is_taken() {
        // Rises up to 1.25 A and falls again.
        let force_n = |i: f64| Some(100.0 - (i - 1.25).powi(2) * 64.0);
        let last = |current_a: f64| End { current_a, force_n: 0.0 };
        let at = |demand_n: f64, last_a: f64| {
            solver(true).search(force_n, demand_n, last(last_a)).expect("finite")
        };
        assert!((at(50.0, 0.0).current_a - 0.366).abs() < 1e-3);
        assert!((at(50.0, 2.5).current_a - 2.134).abs() < 1e-3);
        assert_eq!(at(50.0, 0.0).achievable_n, [0.0, 100.0]);
        assert!((at(300.0, 0.0).current_a - 1.25).abs() < 0.02, "the current of the largest force");
        assert_eq!(
            at(-300.0, 2.5).current_a,
            2.5,
            "of two ends with equal errors, the one nearer to the last current"
        );
    }

    #[test]
    fn a_model_without_a_force_has_no_current() {
        const NONE: End = End { current_a: 0.0, force_n: 0.0 };
        assert_eq!(solver(false).search(|_| None, 1.0, NONE), None);
        assert_eq!(solver(true).search(|i| (i < 1.0).then_some(i), 0.5, NONE), None);
    }
}
