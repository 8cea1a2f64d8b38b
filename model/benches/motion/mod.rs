//! The motion for timing models.

use mr_damper_model::force::Inputs;

/// Number of samples.
pub(crate) const SAMPLES: usize = 512;
const RATE_HZ: f64 = 512.0;

/// One second of a sine of 15 mm at 2 Hz, with a current that rises and falls.
pub(crate) fn motion() -> Vec<Inputs> {
    let omega = std::f64::consts::TAU * 2.0;
    let at = |k: usize| {
        let t = k as f64 / RATE_HZ;
        Inputs {
            dt_s: (k > 0).then_some(1.0 / RATE_HZ),
            displacement_m: 0.015 * (omega * t).sin(),
            velocity_m_s: 0.015 * omega * (omega * t).cos(),
            acceleration_m_s2: -0.015 * omega * omega * (omega * t).sin(),
            drive: 1.2 + (3.0 * t).sin(),
            case_temp_c: 30.0,
        }
    };
    (0..SAMPLES).map(at).collect()
}
