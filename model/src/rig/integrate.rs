//! Integration of the rig's damper over one sample.
//!
//! Dashpot, compliance and hysteresis of the Bouc-Wen and the bristle valve are integrated by the classical Runge-Kutta method of fourth order, with
//! sub-steps; the quasi-static valve has its own method ([`super::quasi_static`]). Displacement between samples is the cubic through the
//! samples' displacements and velocities (Hermite). The first-order lags of the currents are linear, so each half sub-step multiplies
//! by an exact exponential, which is stable for any lag, including zero. Temperature changes over minutes, so Euler's method is enough.

use super::plant::{Instant, Plant, PlantState, Valve, ValveForm};
use super::signal::RATE_HZ;

/// Displacements (m) and velocities (m/s) at the ends of one sample interval.
pub(super) struct Stroke {
    pub(super) x: [f64; 2],
    pub(super) v: [f64; 2],
}

impl Stroke {
    /// Displacement and velocity at the fraction `u` of the interval.
    fn at(&self, u: f64) -> (f64, f64) {
        let ([x0, x1], [v0, v1]) = (self.x, self.v);
        let (m0, m1) = (v0 / RATE_HZ, v1 / RATE_HZ);
        let square = 3.0 * (x1 - x0) - 2.0 * m0 - m1;
        let cube = 2.0 * (x0 - x1) + m0 + m1;
        let x = x0 + u * (m0 + u * (square + u * cube));
        let v = (m0 + u * (2.0 * square + 3.0 * u * cube)) * RATE_HZ;
        (x, v)
    }
}

/// A plant with its sub-step and the factors for that step.
pub(super) struct Integrator<'a> {
    plant: &'a Plant,
    sub_steps: u32,
    step_s: f64,
    driver_half: f64,
    driver_quarter: f64,
    rise_half: f64,
    fall_half: f64,
    fluid_half: f64,
}

impl<'a> Integrator<'a> {
    pub(super) fn new(plant: &'a Plant, sub_steps: u32) -> Self {
        let step_s = 1.0 / (RATE_HZ * f64::from(sub_steps));
        // Share of the distance to the input that a first-order lag keeps; zero without a lag.
        let kept = |time_s: f64, lag_s: f64| if lag_s > 0.0 { (-time_s / lag_s).exp() } else { 0.0 };
        Self {
            plant,
            sub_steps,
            step_s,
            driver_half: kept(step_s / 2.0, plant.driver_lag_s),
            driver_quarter: kept(step_s / 4.0, plant.driver_lag_s),
            rise_half: kept(step_s / 2.0, plant.coil_rise_s),
            fall_half: kept(step_s / 2.0, plant.coil_fall_s),
            fluid_half: kept(step_s / 2.0, plant.fluid_lag_s),
        }
    }

    /// Advances `state` from the start of `stroke` to its end, with the current command held.
    pub(super) fn sample(&self, state: &mut PlantState, stroke: &Stroke, command_a: f64) {
        for j in 0..self.sub_steps {
            let at = |part: f64| stroke.at((f64::from(j) + part) / f64::from(self.sub_steps));
            self.sub_step(state, [at(0.0), at(0.5), at(1.0)], command_a);
        }
    }

    /// One sub-step; `motion` is displacement and velocity at its start, middle and end.
    fn sub_step(&self, state: &mut PlantState, motion: [(f64, f64); 3], command_a: f64) {
        let plant = self.plant;
        let ((x_start, v_start), (x_middle, v_middle), (x_end, v_end)) = (motion[0], motion[1], motion[2]);
        let t = state.temperature_c;
        let force = plant.force_n(state, x_start, v_start);
        let heat = force * v_start + plant.coil_ohm * state.driver_a * state.driver_a;
        let lost = plant.heat_transfer_w_k * (t - plant.ambient_c);

        let start = plant.valve_at(state, x_start, v_start);
        self.half_lag(state, command_a);
        let middle = plant.valve_at(state, x_middle, v_middle);
        self.half_lag(state, command_a);
        let end = plant.valve_at(state, x_end, v_end);

        let h = self.step_s;
        let instants = [(x_start, &start), (x_middle, &middle), (x_end, &end)];
        match plant.valve_form {
            ValveForm::BoucWen => self.runge_kutta(state, instants, |valve, x, at| plant.rates(valve, x, at)),
            ValveForm::Bristle(form) => {
                self.runge_kutta(state, instants, |valve, x, at| plant.bristle_rates(&form, valve, x, at));
            }
            ValveForm::QuasiStatic(form) => {
                state.behind_compliance_m =
                    plant.quasi_static_step(&form, state.behind_compliance_m, h, instants);
            }
        }
        state.temperature_c = t + h * (heat - lost) / plant.heat_capacity_j_k;
        plant.undeclared.step(&mut state.undeclared, h, v_start, force);
    }

    /// One sub-step of a valve with the rates `rates` of dashpot, displacement behind the compliance and hysteresis.
    fn runge_kutta(
        &self,
        state: &mut PlantState,
        [start, middle, end]: [Instant; 3],
        rates: impl Fn(&Valve, f64, [f64; 3]) -> [f64; 3],
    ) {
        let now = [state.dashpot_m, state.behind_compliance_m, state.hysteresis_m];
        let h = self.step_s;
        let a = rates(start.1, start.0, now);
        let b = rates(middle.1, middle.0, moved(now, h / 2.0, a));
        let c = rates(middle.1, middle.0, moved(now, h / 2.0, b));
        let d = rates(end.1, end.0, moved(now, h, c));
        let mean = std::array::from_fn(|n| (a[n] + 2.0 * (b[n] + c[n]) + d[n]) / 6.0);
        [state.dashpot_m, state.behind_compliance_m, state.hysteresis_m] = moved(now, h, mean);
    }

    /// Half a sub-step of driver, coil, core and fluid. The input of the coil is the driver's current in the middle of the half step; the
    /// inputs of core and fluid are the currents of coil and core at its end.
    fn half_lag(&self, state: &mut PlantState, command_a: f64) {
        let toward = command_a - state.driver_a;
        let driver_middle = command_a - toward * self.driver_quarter;
        state.driver_a = command_a - toward * self.driver_half;
        let coil_a = driver_middle * self.plant.undeclared.coil_share(&state.undeclared);
        let gap = coil_a - state.effective_a;
        let kept = if gap > 0.0 { self.rise_half } else { self.fall_half };
        state.effective_a = coil_a - gap * kept;
        let (low, high) =
            (state.effective_a - self.plant.remanence_a, state.effective_a + self.plant.remanence_a);
        // Not `clamp`, which panics if a bound is NaN.
        state.core_a = state.core_a.max(low).min(high);
        state.fluid_a = state.core_a - (state.core_a - state.fluid_a) * self.fluid_half;
    }
}

fn moved(state: [f64; 3], h: f64, rates: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|n| state[n] + h * rates[n])
}
