//! The road profile that a design is compared with: the usual run of the same length, within the same limits.
//!
//! ```text
//! x(t) = c r(t)       r: a road whose spectrum is level below 3 Hz, with a band of 8 Hz;   c: the largest that keeps the limits
//! i(t): random values, normal around the middle of the range and bounded by it, each held for 100 samples on average
//! ```

use super::limits::Limits;
use super::plan::{Course, peaks};
use crate::rig::current::Current;
use crate::rig::signal::{Displacement, RATE_HZ, Road};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

/// Samples of the road, at the rig's rate: limits that hold for it.
pub(super) fn course(limits: &Limits, seed: u64) -> Course {
    let limits = Limits { rate_hz: RATE_HZ, ..*limits };
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let road = Road { level_hz: 3.0, band_hz: 8.0, ..Road::SMOOTH_HIGHWAY };
    let mut displacement_m = Displacement::Road(road).motion(limits.samples(), &mut rng).displacement_m;
    let [most, fastest, sharpest] = peaks(&displacement_m, RATE_HZ);
    let limit = |limit: f64, found: f64| if found > 0.0 { limit / found } else { f64::INFINITY };
    let scale = limit(limits.stroke_m, most)
        .min(limit(limits.speed_m_s, fastest))
        .min(limit(limits.acceleration_m_s2, sharpest));
    displacement_m.iter_mut().for_each(|x| *x *= scale);
    let drive = match limits.drive {
        None => vec![f64::NAN; displacement_m.len()],
        Some([low, high]) => Current::Aprbs {
            low_a: low,
            high_a: high,
            mean_a: 0.5 * (low + high),
            deviation_a: 0.4 * (high - low),
            hold_probability: 0.99,
        }
        .command_a(displacement_m.len(), &mut rng),
    };
    Course { displacement_m, drive, placed: Vec::new() }
}
