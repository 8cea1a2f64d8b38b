//! Faults of damper, drive and mounting that the effect library does not contain.
//!
//! ```text
//! rod       Fr + Fd sign(v) |v / vd|^0.4                                               seal_drag
//!           Fr + q i_d^2                                                               stray_field
//!           F + m (u - F),        u'' = wm^2 (F - u) - 2 zeta wm u'                    mount_resonance
//! valve     lean (1 - d / (1 + ((x - xs) / ws)^4))                                     bore_score
//!           Fy (1 + b g),         g' = (1 - g) / tg - |v| g / lg                       thixotropy
//!           Fy (1 - e / (1 + exp((po - |v| i) / pw)))                                  wall_slip
//! force     Fv (1 - r a),         a' = |v / va|^3 (1 - a) / ta - a / tr                aeration
//!           Fv ho / (ho + h)      if Fv < 0;
//!                                 h' = k v if v > 0 and F > Fh, v if v < 0, h >= 0     cavitation
//!           Fv (1 - l)            if Fv < 0 and the path of the rod is longer than pb  seal_blowout
//!           Fv - c max(0, |Fv| - Fo) sign Fv                                           relief_valve
//! current   i / (1 + (f i)^4)^(1/4)                                                    core_saturation
//!           i_d / (1 + n frac(t / tn))                                                 current_sensor_creep
//! ```
//!
//! Each line replaces a term of the equations in [`super::plant`] by another. The letters Fd, q, m, d, b, e, r, k, l, c, f and n are the
//! sizes of the effects; size 0 leaves the term as it is.
//!
//! | effect | phenomenon |
//! |---|---|
//! | seal_drag | The lubricated rod seal drags with a power of the velocity. |
//! | stray_field | The stray field of the coil pulls on the load cell. |
//! | mount_resonance | The mount of the load cell has a resonance, through which the share m of the force passes. |
//! | bore_score | A score in the cylinder at xs lets fluid past the piston. |
//! | thixotropy | The fluid builds a structure g at rest, and shear breaks it. |
//! | wall_slip | The fluid slips at the walls of the gap where the field is strong and the shear is fast. |
//! | aeration | Fast strokes mix gas into the fluid, a as a share of the most; it separates within the time tr. |
//! | cavitation | Extension with more than Fh opens a void of length h; compression has little force until the void is closed. |
//! | seal_blowout | The piston seal fails after the path pb, and then leaks in compression. |
//! | relief_valve | A relief valve opens at Fo. |
//! | core_saturation | The flux in the core saturates, so the effective current has the limit 1/f. |
//! | current_sensor_creep | The gain of the driver's current sensor creeps until its auto-zero, once in the time tn. |
//!
//! The driver controls the reading of its sensor. The measured current i_d therefore follows the command, and the creep is an error of the
//! coil's current. The states g, a and h are integrated by Euler's method with the plant's sub-step. The method is implicit for g and a,
//! whose rates grow with velocity. The integration starts with the fluid at rest (g = 1), without gas and without a void.

use super::plant::PlantState;
use super::second_order::SecondOrder;
use crate::Error;

/// Velocity vd at which the seal drag has its size, in m/s.
const DRAG_VELOCITY_M_S: f64 = 0.1;
/// Mode of the mount: wm = 2 pi 32 Hz and zeta.
pub(super) const MOUNT: SecondOrder = SecondOrder { corner_hz: 32.0, damping: 0.06 };
/// Displacement xs of the middle of the score, in metres.
const SCORE_AT_M: f64 = 3e-3;
/// Half the width ws of the score, in metres.
const SCORE_HALF_M: f64 = 2e-3;
/// Time tg in which the structure builds, in seconds.
const BUILD_S: f64 = 0.3;
/// Path lg over which shear breaks the structure, in metres.
const BREAK_M: f64 = 5e-3;
/// Product po of velocity and current at which half the slip is there, in A·m/s.
const SLIP_AT_A_M_S: f64 = 0.08;
/// Width pw of the slip's onset, in A·m/s.
const SLIP_WIDTH_A_M_S: f64 = 0.015;
/// Velocity va above which strokes mix gas into the fluid, in m/s.
const MIX_VELOCITY_M_S: f64 = 0.1;
/// Time ta in which a stroke at va mixes gas into the fluid, in seconds.
const MIX_S: f64 = 0.3;
/// Time tr in which the gas separates, in seconds.
const SEPARATE_S: f64 = 1.5;
/// Force Fh above which extension opens a void, in newtons.
const VOID_FROM_N: f64 = 300.0;
/// Length ho of the void that halves the force, in metres.
const VOID_HALF_M: f64 = 5e-4;
/// Path pb of the rod after which the seal fails, in metres.
const SEAL_PATH_M: f64 = 0.5;
/// Force Fo at which the relief valve opens, in newtons.
const RELIEF_N: f64 = 500.0;
/// Time tn from auto-zero to auto-zero, in seconds.
const AUTO_ZERO_S: f64 = 7.0;

/// Sizes of the effects that are not an explicit added force; see the equations at the top of this file. By default all are 0.
///
/// ```
/// use mr_damper_model::rig::Plant;
/// use mr_damper_model::rig::undeclared::Undeclared;
///
/// // The seal for compression fails after half a metre, and a fifth of the force is lost.
/// let plant = Plant { undeclared: Undeclared { seal_blowout: 0.2, ..Undeclared::default() }, ..Plant::default() };
/// assert!(plant != Plant::default());
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Undeclared {
    /// Share m of the force that passes through the resonance of the mount.
    pub mount_resonance: f64,
    /// Share d of the valve's force that is lost in the middle of the score.
    pub bore_score: f64,
    /// Share b by which the structure of the fluid at rest increases the yield force.
    pub thixotropy: f64,
    /// Share e of the yield force that is lost with full slip.
    pub wall_slip: f64,
    /// Share r of the valve's force that is lost with the most gas in the fluid.
    pub aeration: f64,
    /// Share k of the extension stroke that opens a void.
    pub cavitation: f64,
    /// Share l of the valve's compression force that is lost after the seal has failed.
    pub seal_blowout: f64,
    /// Share c of the valve's force above Fo that is lost.
    pub relief_valve: f64,
    /// Reciprocal f of the current at which the core saturates, in 1/A.
    pub core_saturation_per_a: f64,
    /// Growth n of the current sensor's gain until its auto-zero.
    pub current_sensor_creep: f64,
}

/// State of the effects in [`Undeclared`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UndeclaredState {
    /// Time t since the start, in seconds.
    pub time_s: f64,
    /// Path of the rod since the start, in metres.
    pub path_m: f64,
    /// Structure g of the fluid, 0 to 1.
    pub structure: f64,
    /// Gas a in the fluid, 0 to 1.
    pub gas: f64,
    /// Length h of the void, in metres.
    pub void_m: f64,
}

impl UndeclaredState {
    /// The state at the start.
    pub(super) const START: Self = Self { time_s: 0.0, path_m: 0.0, structure: 1.0, gas: 0.0, void_m: 0.0 };
}

/// Drag of the rod seal in newtons at `v_m_s`, if it is `size_n` at vd.
pub(super) fn seal_drag_n(size_n: f64, _: &PlantState, _x_m: f64, v_m_s: f64) -> f64 {
    size_n * (v_m_s.abs() / DRAG_VELOCITY_M_S).powf(0.4) * v_m_s.signum()
}

/// Pull of the coil's stray field on the load cell, in newtons.
pub(super) fn stray_field_n(size_n_a2: f64, state: &PlantState, _x_m: f64, _v_m_s: f64) -> f64 {
    size_n_a2 * state.driver_a * state.driver_a
}

impl Undeclared {
    /// Checks that every size is within its range.
    pub(super) fn check(&self) -> Result<(), Error> {
        for (name, value, most, range) in [
            ("mount_resonance", self.mount_resonance, 1.0, "0 to 1"),
            ("bore_score", self.bore_score, 0.4, "0 to 0.4"),
            ("thixotropy", self.thixotropy, 0.9, "0 to 0.9"),
            ("wall_slip", self.wall_slip, 0.9, "0 to 0.9"),
            ("aeration", self.aeration, 0.9, "0 to 0.9"),
            ("cavitation", self.cavitation, 0.9, "0 to 0.9"),
            ("seal_blowout", self.seal_blowout, 0.9, "0 to 0.9"),
            ("relief_valve", self.relief_valve, 0.9, "0 to 0.9"),
            ("core_saturation_per_a", self.core_saturation_per_a, 5.0, "0 to 5"),
            ("current_sensor_creep", self.current_sensor_creep, 1.0, "0 to 1"),
        ] {
            Error::check(name, value, range, |size| (0.0..=most).contains(&size))?;
        }
        Ok(())
    }

    /// Factor of the score on the valve's forces.
    pub(super) fn score(&self, x_m: f64) -> f64 {
        let from_middle = (x_m - SCORE_AT_M) / SCORE_HALF_M;
        1.0 - self.bore_score / (1.0 + from_middle.powi(4))
    }

    /// Factor of structure and slip on the yield force.
    pub(super) fn yield_share(&self, state: &PlantState, v_m_s: f64) -> f64 {
        let built = 1.0 + self.thixotropy * state.undeclared.structure;
        if self.wall_slip == 0.0 {
            return built;
        }
        let over = (v_m_s.abs() * state.fluid_a - SLIP_AT_A_M_S) / SLIP_WIDTH_A_M_S;
        built * (1.0 - self.wall_slip / (1.0 + (-over).exp()))
    }

    /// Force of the valve that reaches the rod, in newtons, if the valve without these effects has the force `valve_n`.
    pub(super) fn transmitted_n(&self, valve_n: f64, state: &UndeclaredState) -> f64 {
        if *self == Self::default() {
            return valve_n;
        }
        let mut force_n = valve_n * (1.0 - self.aeration * state.gas);
        if force_n < 0.0 {
            let leak = if state.path_m > SEAL_PATH_M { self.seal_blowout } else { 0.0 };
            force_n *= (1.0 - leak) * VOID_HALF_M / (VOID_HALF_M + state.void_m);
        }
        force_n - self.relief_valve * (force_n.abs() - RELIEF_N).max(0.0) * force_n.signum()
    }

    /// Effective current in amperes with the saturation of the core.
    pub(super) fn saturated_a(&self, current_a: f64) -> f64 {
        if self.core_saturation_per_a == 0.0 {
            return current_a;
        }
        current_a / (1.0 + (self.core_saturation_per_a * current_a).powi(4)).powf(0.25)
    }

    /// Current of the coil as a share of the driver's measured current.
    pub(super) fn coil_share(&self, state: &UndeclaredState) -> f64 {
        1.0 / (1.0 + self.current_sensor_creep * (state.time_s / AUTO_ZERO_S).fract())
    }

    /// Advances `state` by `step_s` seconds, with the velocity `v_m_s` and the rod force `force_n` at their start.
    pub(super) fn step(&self, state: &mut UndeclaredState, step_s: f64, v_m_s: f64, force_n: f64) {
        if *self == Self::default() {
            return;
        }
        state.time_s += step_s;
        state.path_m += step_s * v_m_s.abs();
        let (build, shear) = (step_s / BUILD_S, step_s * v_m_s.abs() / BREAK_M);
        state.structure = (state.structure + build) / (1.0 + build + shear);
        let (mix, separate) =
            (step_s / MIX_S * (v_m_s / MIX_VELOCITY_M_S).abs().powi(3), step_s / SEPARATE_S);
        state.gas = (state.gas + mix) / (1.0 + mix + separate);
        let opens = v_m_s > 0.0 && force_n > VOID_FROM_N;
        let void_rate_m_s = if opens { self.cavitation * v_m_s } else { v_m_s.min(0.0) };
        state.void_m = (state.void_m + step_s * void_rate_m_s).max(0.0);
    }
}

#[cfg(test)]
mod tests;
