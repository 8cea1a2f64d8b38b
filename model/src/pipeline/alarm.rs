//! The residual alarm: it detects that the simulation is worse than expected, with a bound on the rate of false alarms.
//!
//! Residuals are grouped in blocks. The test bets on the power of each block, relative to its bound, at several stakes:
//!
//! ```text
//! q   = mean(r^2) / (c s)^2              power of a block over its bound
//! e_l = 1 + l (q - 1)                    e-value of the block at the stake l: never negative
//! M_l = e_l (M_l + 1)                    evidence: Shiryaev-Roberts, from 0
//! alarm when  mean over l of M_l >= N,   N = T / B
//! ```
//!
//! | symbol | where | unit | meaning |
//! |---|---|---|---|
//! | r | | N | measured force minus simulated force, where the model had all its inputs |
//! | s | `expected.free_run_rsse_n` of the model file | N | expected RMSE of the simulation (the thesis calls it RSSE) |
//! | c | `residual.alarm_ratio` | - | factor over s that does not count as a fault yet |
//! | B | `residual.alarm_block_s` | s | length of a block |
//! | T | `residual.false_alarm_interval_s` | s | lower bound of the mean time between false alarms |
//! | l | [`STAKES`] | - | a small stake detects a small excess, a large stake detects a large excess sooner |
//!
//! **Guarantee.** The mean time to a false alarm is at least T if the expected power of each block, given all blocks before it,
//! is at most (c s)^2. This holds for any distribution and any correlation of the residual. Proof: the expectation of each e_l
//! given the past is then at most 1, so M minus the count of blocks is a supermartingale, which cannot be expected to reach N
//! in fewer than N blocks. If the expected RMSE is not known, the alarm stays off.
//!
//! **Limits of the guarantee.** The assumption concerns *every* block, while s is the mean over the training runs. A model that
//! is right on average but has an error above c s in one manoeuvre raises the alarm when that manoeuvre lasts. On the virtual
//! rig, a fuzzy-tanh model on other replicates of its own experiment raised no alarm while motion and current varied freely.
//! Where each current was held for half a minute (RP3-CS), it raised one in ten minutes at c = 1.5 and none at c = 2. The
//! factor c also covers the fluctuation of a residual that is correlated from block to block.
//!
//! **Reset.** When the alarm is raised, the evidence is set to zero. The alarm falls when the power has been within (c s)^2 for
//! [`QUIET_BLOCKS`] blocks in a row. It also falls when the model is swapped, on a reset, and after a gap or a jump in
//! displacement, because the residuals from then on are not comparable.
//!
//! Source: Shin, Ramdas, Rinaldo, E-detectors: a nonparametric framework for sequential change detection, New England Journal
//! of Statistics in Data Science (2023), section 3 (the Shiryaev-Roberts e-detector and its average run length) and 4
//! (mixtures). The stakes, the blocks and the reset are ours.
//! See `[shin2023]` in the bibliography (node/docs/guide/bibliography.md).

use super::settings::Settings;
use crate::sample::Stamp;

/// Stakes of the bets, in (0, 1), so that the e-values stay positive.
const STAKES: [f64; 4] = [0.1, 0.3, 0.6, 0.9];

/// Number of blocks in a row within the bound after which a raised alarm falls.
const QUIET_BLOCKS: u32 = 10;

/// The detector.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Alarm {
    block: Option<Block>,
    /// Evidence at each stake.
    evidence: [f64; STAKES.len()],
    raised: bool,
    /// Blocks in a row within the bound, while raised.
    quiet: u32,
}

/// The block that is being filled.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Block {
    begin: Stamp,
    /// Sum of the squared ratios of the residual to the expected RMSE.
    squares: f64,
    count: f64,
}

/// Change of the alarm at the end of a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Edge {
    Rising,
    Falling,
}

impl Alarm {
    /// True while the alarm is raised.
    #[inline]
    pub(super) const fn is_raised(&self) -> bool {
        self.raised
    }

    /// Takes the ratio of a residual to the expected RMSE (NaN if that is not known). If it starts a new block, the block
    /// before it is tested with the current settings.
    #[inline]
    pub(super) fn add(&mut self, stamp: Stamp, normalised: f64, settings: &Settings) -> Option<Edge> {
        if normalised.is_nan() {
            return None;
        }
        let over = self.block.filter(|block| stamp.since(block.begin).get() >= settings.alarm_block_s);
        let edge = over.and_then(|block| self.check(&block, settings));
        if over.is_some() {
            self.block = None;
        }
        let block = self.block.get_or_insert(Block { begin: stamp, squares: 0.0, count: 0.0 });
        block.squares += normalised * normalised;
        block.count += 1.0;
        edge
    }

    /// Resets the detector; true if the alarm was raised.
    pub(super) fn restart(&mut self) -> bool {
        std::mem::take(self).raised
    }

    fn check(&mut self, block: &Block, settings: &Settings) -> Option<Edge> {
        let power = block.squares / block.count / settings.alarm_ratio.powi(2);
        if self.raised {
            self.quiet = if power <= 1.0 { self.quiet + 1 } else { 0 };
            return (self.quiet >= QUIET_BLOCKS && self.restart()).then_some(Edge::Falling);
        }
        for (evidence, stake) in self.evidence.iter_mut().zip(STAKES) {
            *evidence = (1.0 + stake * (power - 1.0)) * (*evidence + 1.0);
        }
        let mean = self.evidence.iter().sum::<f64>() / STAKES.len() as f64;
        let least_evidence = settings.false_alarm_interval_s / settings.alarm_block_s;
        (mean >= least_evidence).then(|| {
            *self = Self { raised: true, ..Self::default() };
            Edge::Rising
        })
    }
}

#[cfg(test)]
mod tests;
