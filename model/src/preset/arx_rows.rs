//! ARX coefficients of the thesis (tables B.1 passive, B.2 and B.3 semi-active).
//!
//! Printed units: a1..a3 dimensionless, a4..a6 lbf/in, a7..a9 lbf·s/in, a10..a12 lbf/A; three decimals, at
//! 512 Hz. Checksums of the transcription: x and v are collinear, so their terms cancel; a4..a6 sum to less
//! than 13, a7..a9 to less than 2, and a10..a12 to less than 0.14 (tested).

use crate::force::{Arx, LAGS};
use crate::sample::DriveKind;
use crate::units::{N_M_PER_LBF_IN, N_PER_LBF, Second};

/// Half a unit of the last printed decimal.
const RESOLUTION: f64 = 0.0005;
/// Sample rate of the thesis' rig, Hz.
const RATE_HZ: f64 = 512.0;

#[rustfmt::skip]
const PASSIVE: [[f64; 9]; 8] = [
    [1.308, -0.543, 0.198, 38.484, -0.447, -49.072, 8.956, -4.039, -3.938], // RP-ICPS
    [1.335, -0.625, 0.253, 34.932, 4.319, -52.095, 7.987, -2.939, -4.030], // RP-APRBS
    [1.261, -0.401, 0.108, 25.777, 2.602, -35.203, 7.811, -5.430, -1.788], // RP-PRBS
    [1.238, -0.501, 0.196, 91.372, -4.248, -98.815, 15.834, -3.737, -10.159], // RP-APRBS-L
    [1.199, -0.366, 0.118, 67.708, -3.602, -74.215, 12.371, -3.587, -7.504], // RP-ICPS-L
    [1.965, -1.111, 0.144, 508.236, -464.142, -44.018, -83.719, 159.628, -77.020], // RP1-CS
    [2.182, -1.466, 0.283, -58.581, 42.815, 14.460, -0.142, 1.271, -0.998], // RP2-CS
    [2.160, -1.461, 0.299, -306.676, 851.727, -545.478, -13.986, 26.319, -12.804], // RP3-CS
];

#[rustfmt::skip]
const SEMI_ACTIVE: [[f64; 12]; 8] = [
    [1.308, -0.542, 0.197, 38.632, 0.784, -50.360, 9.028, -3.971, -4.079, -7.187, 17.996, -10.832], // RP-ICPS
    [1.333, -0.620, 0.250, 35.256, 4.891, -52.948, 7.995, -2.847, -4.123, -13.694, 26.577, -12.827], // RP-APRBS
    [1.260, -0.399, 0.106, 26.065, 3.503, -36.247, 7.962, -5.398, -1.973, -2.930, 7.580, -4.665], // RP-PRBS
    [1.236, -0.497, 0.194, 90.876, -3.479, -99.061, 15.764, -3.650, -10.187, -18.968, 30.806, -11.821], // RP-APRBS-L
    [1.198, -0.365, 0.117, 67.767, -2.459, -75.441, 12.450, -3.520, -7.627, -6.254, 14.783, -8.397], // RP-ICPS-L
    [1.978, -1.129, 0.148, -154.514, 936.415, -781.942, -86.508, 164.171, -78.931, 241.241, -497.047, 255.806], // RP1-CS
    [2.201, -1.521, 0.317, -285.952, 689.071, -403.801, -0.861, 1.429, -0.771, 265.862, -805.376, 539.518], // RP2-CS
    [2.248, -1.639, 0.389, 679.039, -1037.871, 358.646, -18.202, 31.743, -14.151, 533.283, -1058.675, 525.392], // RP3-CS
];

/// The passive model of experiment number `row`.
pub(super) fn passive(row: usize) -> Option<Arx> {
    let c = PASSIVE.get(row)?;
    build(c[..9].try_into().ok()?, None)
}

/// The semi-active model of experiment number `row`.
pub(super) fn semi_active(row: usize) -> Option<Arx> {
    let c = SEMI_ACTIVE.get(row)?;
    let drive = [c[9], c[10], c[11]].map(|a| a * N_PER_LBF);
    build(c[..9].try_into().ok()?, Some(drive))
}

fn build(c: [f64; 9], drive: Option<[f64; LAGS]>) -> Option<Arx> {
    let si = N_M_PER_LBF_IN;
    let arx = Arx::new(
        [c[0], c[1], c[2]],
        [c[3] * si, c[4] * si, c[5] * si],
        [c[6] * si, c[7] * si, c[8] * si],
        drive.map(|d| (DriveKind::CoilCurrent, d)),
        Second(1.0 / RATE_HZ),
        0.0,
    );
    // The tables hold finite numbers only, so construction cannot fail; a `None` would fail the tests.
    arx.ok().map(|arx| arx.with_resolution(RESOLUTION))
}

#[cfg(test)]
mod tests {
    use super::super::EXPERIMENTS;
    use super::*;

    #[test]
    fn the_transcription_checksums_hold() {
        let sum = |c: &[f64]| c.iter().sum::<f64>().abs();
        for (row, name) in EXPERIMENTS.iter().enumerate() {
            for c in [&PASSIVE[row][..], &SEMI_ACTIVE[row][..]] {
                assert!(sum(&c[3..6]) < 13.0, "{name}: displacement terms");
                assert!(sum(&c[6..9]) < 2.0, "{name}: velocity terms");
                assert!(sum(&c[9..]) < 0.14, "{name}: current terms");
            }
        }
    }
}
