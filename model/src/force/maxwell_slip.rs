//! Maxwell-slip model under fuzzy sets: a static damping curve, bristles with memory, and a spring for each set over the drive.
//!
//! ```text
//! F          = sum_i w_i(i) f_i + F0
//! f_i        = c_i(v) + sum_k b_ik z_k + k_i x + o_i
//! c_i(v)     = sum_m d_im r_m(v),                        r_m: the part of the way from 0 to v that lies in segment m
//! L_k dz_k/dt = v - |v| z_k                              between samples, with the velocity of the later one:
//! z_k        <- s + (z_k - s) exp(-|v| dt / L_k),        s = sgn v
//! ```
//!
//! | symbol | field | unit | meaning |
//! |---|---|---|---|
//! | x, v | arguments | m, m/s | displacement and velocity, positive in extension |
//! | i | argument | A or V | drive: coil current, or command voltage |
//! | d | `damping_slopes_n_s_m` | N·s/m | slope of the damping curve in each of eight segments of velocity; not negative |
//! | b | `bristle_forces_n` | N | force of a bristle that slips; not negative |
//! | L | `bristle_lengths_m` | m | way on which a bristle yields: its stiffness at rest is b/L |
//! | z | state | 1 | deflection of a bristle as a share of the deflection at which it slips, -1 to 1 |
//! | k | `stiffness_n_m` | N/m | spring in parallel |
//! | o | `set_offset_n` | N | constant of the set: a yield force that differs between extension and compression |
//! | w | `FuzzySets` | 1 | weight of the set; one if the model has no drive |
//! | F0 | `force_offset_n` | N | mean force of the session (gas preload, load cell zero) |
//!
//! The knots of the damping curve are `0`, `±s1`, `±s2` and `±s3` (`knot_speeds_m_s`); the first and the last segment are unbounded.
//! All sets share the knots, the lengths and the bristles' deflections, which do not depend on the drive.
//!
//! # Properties
//! They hold for every valid model, also outside of the data that it was identified from:
//!
//! - The deflections stay within -1 and 1, so the force of the bristles is at most the sum of the b.
//! - At a given state the force does not fall with velocity: c does not, and neither does the deflection after the step.
//! - A bristle is passive. Its work is at least the change of b L z²/2, because `b z v = d/dt (b L z^2 / 2) + b |v| z^2`. The damping
//!   curve dissipates too, because c(0) = 0. The spring stores energy if k is not negative. The set offsets are not passive.
//! - The deflection depends on the way at constant direction, not on the step size. The step is exact for a constant velocity.
//!
//! # Names
//! The parallel connection of slipping elements is the Maxwell-slip model, and with a smooth approach to slip the generalised
//! Maxwell-slip model. One bristle is Dahl's, or LuGre's without its velocity-dependent force of slip and its damping.
//!
//! Source: `[albender2005]` for the parallel connection, `[canudas1995]` and `[dahl1968]` for a bristle, `[thesis]` for the sets
//! (node/docs/guide/bibliography.md), equation 4.8 of the thesis.

use super::Inputs;
use super::sets::{FuzzySets, MAX_FUNCTIONS};
use crate::elementary::exp;
use crate::error::Error;
use crate::sample::DriveKind;

/// Number of bristles.
pub const SLIP_BRISTLES: usize = 5;
/// Number of segments of the damping curve.
pub const SLIP_SEGMENTS: usize = 8;
/// Number of positive knots of the damping curve.
pub const SLIP_KNOTS: usize = SLIP_SEGMENTS / 2 - 1;
/// Number of coefficients of one set.
pub const SLIP_COEFFICIENTS: usize = SLIP_SEGMENTS + SLIP_BRISTLES + 2;

/// The knots of the damping curve and the lengths of the bristles, which all sets share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlipGrid {
    knot_speeds_m_s: [f64; SLIP_KNOTS],
    bristle_lengths_m: [f64; SLIP_BRISTLES],
}

/// Damping curve, bristles and spring at one level of the drive.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SlipFunction {
    /// d, the slopes of the damping curve from the fastest compression to the fastest extension, N·s/m.
    pub damping_slopes_n_s_m: [f64; SLIP_SEGMENTS],
    /// b, the force of each bristle when it slips, N.
    pub bristle_forces_n: [f64; SLIP_BRISTLES],
    /// k, the stiffness of the spring in parallel, N/m.
    pub stiffness_n_m: f64,
    /// o, the constant of the set, N.
    pub set_offset_n: f64,
}

/// The deflections of the bristles, -1 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SlipState {
    deflections: [f64; SLIP_BRISTLES],
}

/// The signals in which the force of a set is linear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SlipSignals {
    ramps_m_s: [f64; SLIP_SEGMENTS],
    deflections: [f64; SLIP_BRISTLES],
    displacement_m: f64,
}

/// The Maxwell-slip model.
///
/// ```
/// use mr_damper_model::force::{Inputs, MaxwellSlip, SLIP_BRISTLES, SLIP_SEGMENTS, SlipFunction, SlipGrid, SlipState};
///
/// // 1000 N s/m, and one bristle that slips at 20 N after some multiples of 1 mm
/// let grid = SlipGrid::new([0.05, 0.1, 0.2], [1e-3, 2e-3, 3e-3, 4e-3, 5e-3])?;
/// let mut bristle_forces_n = [0.0; SLIP_BRISTLES];
/// bristle_forces_n[0] = 20.0;
/// let function =
///     SlipFunction { damping_slopes_n_s_m: [1000.0; SLIP_SEGMENTS], bristle_forces_n, ..SlipFunction::default() };
/// let model = MaxwellSlip::new(grid, None, &[function], 0.0)?;
///
/// let at = |dt_s| Inputs {
///     dt_s, displacement_m: 0.0, velocity_m_s: 0.1, acceleration_m_s2: 0.0, drive: f64::NAN, case_temp_c: 25.0,
/// };
/// let mut state = SlipState::default();
/// assert!((model.force_n(&at(None), &mut state) - 100.0).abs() < 1e-9);
/// // After 10 ms at 0.1 m/s the bristle has moved by its length.
/// let force_n = model.force_n(&at(Some(0.01)), &mut state);
/// assert!((force_n - (100.0 + 20.0 * (1.0 - (-1.0_f64).exp()))).abs() < 1e-9, "{force_n} N");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaxwellSlip {
    grid: SlipGrid,
    sets: Option<FuzzySets>,
    functions: [SlipFunction; MAX_FUNCTIONS],
    force_offset_n: f64,
}

impl SlipGrid {
    /// A grid with knots at zero and at plus and minus `knot_speeds_m_s`, and bristles of the lengths `bristle_lengths_m`.
    ///
    /// # Errors
    /// When a number is not positive and finite, or the numbers of a list do not increase.
    pub fn new(
        knot_speeds_m_s: [f64; SLIP_KNOTS],
        bristle_lengths_m: [f64; SLIP_BRISTLES],
    ) -> Result<Self, Error> {
        increasing("knot_speeds_m_s", &knot_speeds_m_s)?;
        increasing("bristle_lengths_m", &bristle_lengths_m)?;
        Ok(Self { knot_speeds_m_s, bristle_lengths_m })
    }

    /// The positive knots of the damping curve, m/s, increasing.
    #[must_use]
    pub const fn knot_speeds_m_s(&self) -> &[f64; SLIP_KNOTS] {
        &self.knot_speeds_m_s
    }

    /// The lengths of the bristles, m, increasing.
    #[must_use]
    pub const fn bristle_lengths_m(&self) -> &[f64; SLIP_BRISTLES] {
        &self.bristle_lengths_m
    }

    /// The signals at `inputs`, advancing `state` by one sample. If displacement or velocity is not finite, they are NaN and `state`
    /// is unchanged.
    #[inline]
    pub(crate) fn step(&self, state: &mut SlipState, inputs: &Inputs) -> SlipSignals {
        let (x, v) = (inputs.displacement_m, inputs.velocity_m_s);
        if !(x.is_finite() && v.is_finite()) {
            return SlipSignals {
                ramps_m_s: [f64::NAN; SLIP_SEGMENTS],
                deflections: [f64::NAN; SLIP_BRISTLES],
                displacement_m: f64::NAN,
            };
        }
        match inputs.dt_s {
            None => *state = SlipState::default(),
            Some(dt_s) => state.slip(&self.bristle_lengths_m, v, dt_s),
        }
        SlipSignals { ramps_m_s: self.ramps(v), deflections: state.deflections, displacement_m: x }
    }

    /// The part of the way from 0 to `v` in each segment, m/s; the parts sum to `v`.
    #[inline]
    fn ramps(&self, v: f64) -> [f64; SLIP_SEGMENTS] {
        const HALF: usize = SLIP_SEGMENTS / 2;
        let (speed, mut from) = (v.abs(), 0.0);
        let mut ramps = [0.0; SLIP_SEGMENTS];
        for segment in 0..HALF {
            let to = self.knot_speeds_m_s.get(segment).copied().unwrap_or(f64::INFINITY);
            let part = (speed.min(to) - from).max(0.0);
            ramps[if v < 0.0 { HALF - 1 - segment } else { HALF + segment }] = part.copysign(v);
            from = to;
        }
        ramps
    }
}

/// Refuses numbers that are not positive and finite, or do not increase.
fn increasing(list: &str, values: &[f64]) -> Result<(), Error> {
    let mut before = 0.0;
    for (j, value) in values.iter().enumerate() {
        let needed = if j == 0 { "positive and finite" } else { "greater than the number before it" };
        Error::check(&format!("{list}[{j}]"), *value, needed, |value| value > before)?;
        before = *value;
    }
    Ok(())
}

impl SlipState {
    /// Advances the bristles by `dt_s` at the velocity `v`, m/s.
    #[inline]
    fn slip(&mut self, lengths_m: &[f64; SLIP_BRISTLES], v: f64, dt_s: f64) {
        if v == 0.0 {
            return;
        }
        let (way_m, slips) = (v.abs() * dt_s, v.signum());
        for (deflection, length_m) in self.deflections.iter_mut().zip(lengths_m) {
            // In this form rounding cannot carry the deflection beyond 1.
            *deflection = slips + (*deflection - slips) * exp(-way_m / length_m);
        }
    }
}

impl SlipSignals {
    /// The signals in the order of [`SlipFunction::coefficients`].
    pub(crate) fn values(&self) -> [f64; SLIP_COEFFICIENTS] {
        let mut values = [1.0; SLIP_COEFFICIENTS];
        let (ramps, rest) = values.split_at_mut(SLIP_SEGMENTS);
        ramps.copy_from_slice(&self.ramps_m_s);
        rest[..SLIP_BRISTLES].copy_from_slice(&self.deflections);
        rest[SLIP_BRISTLES] = self.displacement_m;
        values
    }
}

impl SlipFunction {
    /// The function with these coefficients: slopes, bristle forces, stiffness, offset.
    #[must_use]
    pub fn of(coefficients: &[f64; SLIP_COEFFICIENTS]) -> Self {
        let mut function = Self::default();
        let (slopes, rest) = coefficients.split_at(SLIP_SEGMENTS);
        function.damping_slopes_n_s_m.copy_from_slice(slopes);
        function.bristle_forces_n.copy_from_slice(&rest[..SLIP_BRISTLES]);
        function.stiffness_n_m = rest[SLIP_BRISTLES];
        function.set_offset_n = rest[SLIP_BRISTLES + 1];
        function
    }

    /// The coefficients: slopes, bristle forces, stiffness, offset.
    #[must_use]
    pub fn coefficients(&self) -> [f64; SLIP_COEFFICIENTS] {
        let mut all = [0.0; SLIP_COEFFICIENTS];
        let (slopes, rest) = all.split_at_mut(SLIP_SEGMENTS);
        slopes.copy_from_slice(&self.damping_slopes_n_s_m);
        rest[..SLIP_BRISTLES].copy_from_slice(&self.bristle_forces_n);
        rest[SLIP_BRISTLES] = self.stiffness_n_m;
        rest[SLIP_BRISTLES + 1] = self.set_offset_n;
        all
    }

    /// True for the coefficient at `index` of [`SlipFunction::coefficients`] if it must not be negative: slopes and bristle forces.
    #[must_use]
    pub const fn is_nonnegative(index: usize) -> bool {
        index < SLIP_SEGMENTS + SLIP_BRISTLES
    }

    /// The force of this set alone, N.
    #[inline]
    fn force_n(&self, at: &SlipSignals) -> f64 {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        dot(&self.damping_slopes_n_s_m, &at.ramps_m_s)
            + dot(&self.bristle_forces_n, &at.deflections)
            + self.stiffness_n_m * at.displacement_m
            + self.set_offset_n
    }

    fn check(&self, set: usize) -> Result<(), Error> {
        for (j, slope) in self.damping_slopes_n_s_m.iter().enumerate() {
            let name = format!("damping_slopes_n_s_m[{set}][{j}]");
            Error::check(&name, *slope, "finite and not negative", |slope| slope >= 0.0)?;
        }
        for (j, force_n) in self.bristle_forces_n.iter().enumerate() {
            let name = format!("bristle_forces_n[{set}][{j}]");
            Error::check(&name, *force_n, "finite and not negative", |force_n| force_n >= 0.0)?;
        }
        Error::check(&format!("stiffness_n_m[{set}]"), self.stiffness_n_m, "finite", |_| true)?;
        Error::check(&format!("set_offset_n[{set}]"), self.set_offset_n, "finite", |_| true)?;
        Ok(())
    }
}

impl MaxwellSlip {
    /// A model with one function for each set, or with one function and no drive.
    ///
    /// # Errors
    /// When there is not one function for each set, a slope or bristle force is negative, or a number is not finite.
    pub fn new(
        grid: SlipGrid,
        sets: Option<FuzzySets>,
        functions: &[SlipFunction],
        force_offset_n: f64,
    ) -> Result<Self, Error> {
        let needed = sets.map_or(1, |sets| sets.len());
        if functions.len() != needed {
            return Err(Error::Length {
                name: "functions".to_owned(),
                found: functions.len(),
                expected: format!("{needed} (one for each set, or one without a drive)"),
            });
        }
        for (set, function) in functions.iter().enumerate() {
            function.check(set)?;
        }
        Error::check("force_offset_n", force_offset_n, "finite", |_| true)?;
        let mut all = [SlipFunction::default(); MAX_FUNCTIONS];
        all[..needed].copy_from_slice(functions);
        Ok(Self { grid, sets, functions: all, force_offset_n })
    }

    /// Knots and lengths.
    #[must_use]
    pub const fn grid(&self) -> &SlipGrid {
        &self.grid
    }

    /// The sets over the drive; `None` for a model without a drive.
    #[must_use]
    pub const fn sets(&self) -> Option<&FuzzySets> {
        self.sets.as_ref()
    }

    /// The drive; `None` for a model without one.
    #[must_use]
    pub const fn drive(&self) -> Option<DriveKind> {
        match &self.sets {
            Some(sets) => Some(sets.drive()),
            None => None,
        }
    }

    /// The functions, one for each set.
    #[must_use]
    pub fn functions(&self) -> &[SlipFunction] {
        &self.functions[..self.copies()]
    }

    const fn copies(&self) -> usize {
        match &self.sets {
            Some(sets) => sets.len(),
            None => 1,
        }
    }

    /// Number of coefficients: [`SLIP_COEFFICIENTS`] for each set.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        SLIP_COEFFICIENTS * self.copies()
    }

    /// Force offset of the session, N.
    #[must_use]
    pub const fn force_offset_n(&self) -> f64 {
        self.force_offset_n
    }

    /// The same model with another session's force offset, N.
    #[must_use]
    pub const fn with_force_offset_n(mut self, force_offset_n: f64) -> Self {
        self.force_offset_n = force_offset_n;
        self
    }

    /// Force, N, at `inputs`, advancing `state` by one sample. Not finite if a needed input is not finite. The bristles start without
    /// deflection at the first sample and after a gap.
    #[inline]
    #[must_use]
    pub fn force_n(&self, inputs: &Inputs, state: &mut SlipState) -> f64 {
        let at = self.grid.step(state, inputs);
        let force_n = match &self.sets {
            Some(sets) => sets.strengths(inputs.drive).mean(|set| self.functions[set].force_n(&at)),
            None => self.functions[0].force_n(&at),
        };
        force_n + self.force_offset_n
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::Membership;
    use proptest::prelude::*;

    const LENGTHS_M: [f64; SLIP_BRISTLES] = [0.5e-3, 1e-3, 2e-3, 4e-3, 8e-3];

    fn grid() -> SlipGrid {
        SlipGrid::new([0.01, 0.03, 0.1], LENGTHS_M).expect("a grid")
    }

    fn inputs(dt_s: f64, velocity_m_s: f64) -> Inputs {
        Inputs {
            dt_s: Some(dt_s),
            displacement_m: 0.002,
            velocity_m_s,
            acceleration_m_s2: f64::NAN,
            drive: 0.4,
            case_temp_c: f64::NAN,
        }
    }

    fn state() -> impl Strategy<Value = SlipState> {
        prop::array::uniform5(-1.0..=1.0_f64).prop_map(|deflections| SlipState { deflections })
    }

    fn function() -> impl Strategy<Value = SlipFunction> {
        let forces = (prop::array::uniform8(0.0..3e3_f64), prop::array::uniform5(0.0..400.0_f64));
        (forces, -2e3..5e3_f64, -50.0..50.0_f64).prop_map(
            |((damping_slopes_n_s_m, bristle_forces_n), stiffness_n_m, set_offset_n)| SlipFunction {
                damping_slopes_n_s_m,
                bristle_forces_n,
                stiffness_n_m,
                set_offset_n,
            },
        )
    }

    fn model() -> impl Strategy<Value = MaxwellSlip> {
        prop::array::uniform3(function()).prop_map(|functions| {
            let membership = Membership { drive: DriveKind::CoilCurrent, sigma: 0.3 };
            let sets = FuzzySets::new(membership, &[0.0, 0.5, 1.0]).expect("sets");
            MaxwellSlip::new(grid(), Some(sets), &functions, 5.0).expect("a model")
        })
    }

    proptest! {
        #[test]
        fn ramps_sum_to_the_velocity_and_stay_in_their_segments(v in -2.0..2.0_f64) {
            let ramps = grid().ramps(v);
            prop_assert!((ramps.iter().sum::<f64>() - v).abs() < 1e-15);
            let widths = [0.01, 0.02, 0.07, f64::INFINITY];
            for (segment, width) in widths.iter().enumerate() {
                prop_assert!((0.0..=width + 1e-15).contains(&ramps[4 + segment]) && ramps[4 + segment] <= v.max(0.0));
                prop_assert!((0.0..=width + 1e-15).contains(&-ramps[3 - segment]) && -ramps[3 - segment] <= (-v).max(0.0));
            }
        }

        #[test]
        fn bristles_stay_within_one(
            start in state(), steps in prop::collection::vec((-1e3..1e3_f64, 0.0..10.0_f64), 1..40),
        ) {
            let mut state = start;
            for (v, dt_s) in steps {
                state.slip(&LENGTHS_M, v, dt_s);
                prop_assert!(state.deflections.iter().all(|z| z.abs() <= 1.0), "{state:?}");
            }
        }

        #[test]
        fn the_step_solves_the_equation(start in state(), v in -0.3..0.3_f64, dt_s in 1e-4..0.02_f64) {
            let mut exact = start;
            exact.slip(&LENGTHS_M, v, dt_s);
            for (k, length_m) in LENGTHS_M.iter().enumerate() {
                // The classical Runge-Kutta method with fine steps.
                let rate = |z: f64| (v - v.abs() * z) / length_m;
                let (h, mut z) = (dt_s / 400.0, start.deflections[k]);
                for _ in 0..400 {
                    let k1 = rate(z);
                    let k2 = rate(z + 0.5 * h * k1);
                    let k3 = rate(z + 0.5 * h * k2);
                    z += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rate(z + h * k3));
                }
                prop_assert!((exact.deflections[k] - z).abs() < 1e-8, "{} {z}", exact.deflections[k]);
            }
        }

        #[test]
        fn the_step_size_does_not_matter(start in state(), v in -0.5..0.5_f64, dt_s in 1e-4..0.1_f64, parts in 1..50_u32) {
            let (mut once, mut often) = (start, start);
            once.slip(&LENGTHS_M, v, dt_s);
            for _ in 0..parts {
                often.slip(&LENGTHS_M, v, dt_s / f64::from(parts));
            }
            for (a, b) in once.deflections.iter().zip(often.deflections) {
                prop_assert!((a - b).abs() < 1e-13, "{a} {b}");
            }
        }

        #[test]
        fn force_does_not_fall_with_velocity(
            model in model(), state in state(), slow in -1.0..1.0_f64, more in 0.0..1.0_f64, drive in -0.5..2.0_f64,
        ) {
            let force_n = |v: f64| model.force_n(&Inputs { drive, ..inputs(0.005, v) }, &mut state.clone());
            prop_assert!(force_n(slow + more) >= force_n(slow) - 1e-9);
        }

        #[test]
        fn the_force_of_the_bristles_is_bounded(
            function in function(), start in state(), v in -1e6..1e6_f64, dt_s in 0.0..1e3_f64,
        ) {
            let bristles = SlipFunction { bristle_forces_n: function.bristle_forces_n, ..SlipFunction::default() };
            let model = MaxwellSlip::new(grid(), None, &[bristles], 0.0).expect("a model");
            let force_n = model.force_n(&inputs(dt_s, v), &mut start.clone());
            prop_assert!(force_n.abs() <= bristles.bristle_forces_n.iter().sum::<f64>() * (1.0 + 1e-15));
        }

        #[test]
        fn a_bristle_takes_at_least_the_work_that_it_stores(start in -1.0..=1.0_f64, v in -0.5..0.5_f64, dt_s in 1e-5..0.1_f64) {
            prop_assume!(v != 0.0);
            let length_m = LENGTHS_M[2];
            let mut state = SlipState { deflections: [start; SLIP_BRISTLES] };
            state.slip(&LENGTHS_M, v, dt_s);
            let end = state.deflections[2];
            // The integral of z v over the step, for a bristle of 1 N.
            let (way_m, slips) = (v.abs() * dt_s, v.signum());
            let work_j = way_m - slips * (start - slips) * length_m * (-way_m / length_m).exp_m1();
            prop_assert!(work_j >= 0.5 * length_m * (end * end - start * start) - 1e-15, "{work_j}");
        }

        #[test]
        fn a_closed_motion_dissipates(function in function(), omega in 1.0..60.0_f64, amplitude_m in 1e-4..0.02_f64) {
            let passive = SlipFunction { stiffness_n_m: function.stiffness_n_m.abs(), set_offset_n: 0.0, ..function };
            let model = MaxwellSlip::new(grid(), None, &[passive], 0.0).expect("a model");
            let (mut state, mut work_j) = (SlipState::default(), 0.0);
            let dt_s = std::f64::consts::TAU / omega / 400.0;
            // The second period: the bristles are periodic then.
            for k in 0..800 {
                let (sin, cos) = (omega * dt_s * f64::from(k)).sin_cos();
                let at = Inputs { displacement_m: amplitude_m * sin, ..inputs(dt_s, amplitude_m * omega * cos) };
                let force_n = model.force_n(&at, &mut state);
                work_j += if k < 400 { 0.0 } else { force_n * at.velocity_m_s * dt_s };
            }
            prop_assert!(work_j >= -1e-9, "{work_j}");
        }
    }

    #[test]
    fn a_slipping_bristle_has_its_force_and_a_gap_relaxes_it() {
        let function =
            SlipFunction { bristle_forces_n: [0.0, 120.0, 0.0, 0.0, 0.0], ..SlipFunction::default() };
        let model = MaxwellSlip::new(grid(), None, &[function], 0.0).expect("a model");
        let mut state = SlipState::default();
        assert_eq!(model.force_n(&Inputs { dt_s: None, ..inputs(0.0, 0.3) }, &mut state), 0.0);
        // After 1 mm, the length of this bristle, it has 1 - 1/e of its force.
        let at_length_n = model.force_n(&inputs(0.01, 0.1), &mut state);
        assert!((at_length_n / 120.0 - (1.0 - (-1.0_f64).exp())).abs() < 1e-12, "{at_length_n}");
        assert!((model.force_n(&inputs(1.0, 0.1), &mut state) - 120.0).abs() < 1e-12);
        assert_eq!(model.force_n(&inputs(0.01, 0.0), &mut state), 120.0, "at rest it holds");
        let held = state;
        assert!(model.force_n(&inputs(0.01, f64::NAN), &mut state).is_nan());
        assert_eq!(state, held);
        assert_eq!(model.force_n(&Inputs { dt_s: None, ..inputs(0.0, 0.3) }, &mut state), 0.0);
    }

    #[test]
    fn wrong_numbers_are_named() {
        let error =
            |function| MaxwellSlip::new(grid(), None, &[function], 0.0).expect_err("refused").to_string();
        let mut function = SlipFunction::default();
        function.bristle_forces_n[3] = -1.0;
        assert!(error(function).contains("bristle_forces_n[0][3] is -1"), "{}", error(function));
        let mut function = SlipFunction::default();
        function.damping_slopes_n_s_m[7] = f64::NAN;
        assert!(error(function).contains("damping_slopes_n_s_m[0][7] is NaN"), "{}", error(function));
        let grid = |knots, lengths| SlipGrid::new(knots, lengths).expect_err("refused").to_string();
        assert!(grid([0.1, 0.1, 0.2], LENGTHS_M).contains("knot_speeds_m_s[1] is 0.1"));
        assert!(grid([0.1, 0.2, 0.3], [0.0; 5]).contains("bristle_lengths_m[0] is 0"));
        let two = MaxwellSlip::new(self::grid(), None, &[SlipFunction::default(); 2], 0.0);
        assert!(two.expect_err("refused").to_string().contains("2 values"));
    }
}
