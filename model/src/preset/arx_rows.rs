//! ARX models of the thesis, from `data/arx-passive.csv` and `data/arx-semi-active.csv`.
//!
//! Checksums of the transcription: x and v are collinear, so their terms cancel; a4..a6 sum to less than 13,
//! a7..a9 to less than 2, and a10..a12 to less than 0.14 (tested).

use super::tables::{ARX_PASSIVE, ARX_SEMI_ACTIVE, find};
use crate::force::{Arx, LAGS};
use crate::sample::DriveKind;
use crate::units::{N_M_PER_LBF_IN, N_PER_LBF, Second};

/// Half a unit of the last printed decimal.
const RESOLUTION: f64 = 0.0005;
/// Sample rate of the thesis' rig, Hz.
const RATE_HZ: f64 = 512.0;

/// The passive model of `experiment`.
pub(super) fn passive(experiment: &str) -> Option<Arx> {
    build(find(&ARX_PASSIVE, [experiment])?, None)
}

/// The semi-active model of `experiment`.
pub(super) fn semi_active(experiment: &str) -> Option<Arx> {
    let [motion @ .., a10, a11, a12] = find(&ARX_SEMI_ACTIVE, [experiment])?;
    build(motion, Some([a10, a11, a12].map(|a| a * N_PER_LBF)))
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
        for name in EXPERIMENTS {
            let passive = find(&ARX_PASSIVE, [name]).expect("a row");
            let semi_active = find(&ARX_SEMI_ACTIVE, [name]).expect("a row");
            for c in [&passive[..], &semi_active[..]] {
                assert!(sum(&c[3..6]) < 13.0, "{name}: displacement terms");
                assert!(sum(&c[6..9]) < 2.0, "{name}: velocity terms");
                assert!(sum(&c[9..]) < 0.14, "{name}: current terms");
            }
        }
    }
}
