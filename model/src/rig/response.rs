//! The response of a plant, and the parts of its force that need more than one instant: inertia, resonance, loss and lag.

use super::signal::RATE_HZ;
use super::undeclared::MOUNT;

/// Response of a [`super::Plant`]: true values, one per sample.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Response {
    /// Rod force in newtons.
    pub force_n: Vec<f64>,
    /// Driver's current in amperes.
    pub driver_a: Vec<f64>,
    /// Current after the lag by eddy currents, in amperes.
    pub effective_a: Vec<f64>,
    /// Temperature in °C.
    pub temperature_c: Vec<f64>,
}

impl Response {
    /// Adds the inertial force of a mass of `mass_kg` kilograms that moves with `velocity_m_s`; acceleration by central differences.
    pub(super) fn add_inertia(&mut self, mass_kg: f64, velocity_m_s: &[f64]) {
        if mass_kg == 0.0 {
            return;
        }
        let last = velocity_m_s.len().saturating_sub(1);
        for (k, force) in self.force_n.iter_mut().enumerate() {
            let (before, after) = (k.saturating_sub(1), (k + 1).min(last));
            let span_s = (after - before).max(1) as f64 / RATE_HZ;
            *force += mass_kg * (velocity_m_s[after] - velocity_m_s[before]) / span_s;
        }
    }

    /// Lets the share `share` of the force pass through the resonance of the mount.
    pub(super) fn resonate(&mut self, share: f64) {
        if share == 0.0 {
            return;
        }
        let mode_n = MOUNT.filter(&self.force_n);
        for (force, mode) in self.force_n.iter_mut().zip(mode_n) {
            *force += share * (mode - *force);
        }
    }

    /// Removes the share `lost` of the force from the middle of the run to its end.
    pub(super) fn lose_force(&mut self, lost: f64) {
        let middle = self.force_n.len() / 2;
        self.force_n[middle..].iter_mut().for_each(|force| *force *= 1.0 - lost);
    }

    /// Applies a first-order lag of `lag_s` seconds to the force; exact for a force that is linear between samples.
    pub(super) fn lag_force(&mut self, lag_s: f64) {
        let Some(&first) = self.force_n.first() else { return };
        if lag_s <= 0.0 {
            return;
        }
        let kept = (-1.0 / (RATE_HZ * lag_s)).exp();
        let (mut lagged, mut before) = (first, first);
        for force in &mut self.force_n {
            // For a ramp the lagged force settles at the ramp minus `behind`.
            let behind = (*force - before) * RATE_HZ * lag_s;
            lagged = *force - behind + (lagged - before + behind) * kept;
            before = std::mem::replace(force, lagged);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lag_of_steps_and_ramps_matches_its_equation() {
        let mut response = Response { force_n: vec![0.0; 10], ..Response::default() };
        response.force_n.resize(1024, 100.0);
        response.lag_force(0.02);
        // The step is a ramp from sample 9 to 10, so it is at 9.5.
        let t = (100.0 - 9.5) / RATE_HZ;
        assert!((response.force_n[100] - 100.0 * (1.0 - (-t / 0.02f64).exp())).abs() < 0.01);
        let mut ramp = Response { force_n: (0..1024).map(f64::from).collect(), ..Response::default() };
        ramp.lag_force(0.02);
        assert!((1000.0 - ramp.force_n[1000] - 0.02 * RATE_HZ).abs() < 1e-6);
    }

    #[test]
    fn inertia_is_mass_times_acceleration() {
        let velocity: Vec<f64> = (0..100).map(|k| 3.0 * f64::from(k) / RATE_HZ).collect();
        let mut response = Response { force_n: vec![1.0; 100], ..Response::default() };
        response.add_inertia(2.0, &velocity);
        assert!(response.force_n.iter().all(|force| (force - 7.0).abs() < 1e-9));
    }
}
