//! The residual alarm: says that the free-running model is off, with a stated time between false alarms.
//!
//! Residuals are taken together in blocks. A block's power, over what the model may have, is bet on at a few stakes:
//!
//! ```text
//! q   = mean(r^2) / (c s)^2              power of a block, over the most that the model may have
//! e_l = 1 + l (q - 1)                    e-value of the block at the stake l: never negative
//! M_l = e_l (M_l + 1)                    evidence: Shiryaev-Roberts, from 0
//! alarm when  mean over l of M_l >= N,   N = T / B
//! ```
//!
//! | symbol | where | unit | meaning |
//! |---|---|---|---|
//! | r | | N | measured force minus the free run; the model had all that it needs |
//! | s | `expected.free_run_rsse_n` of the model file | N | RSSE to expect |
//! | c | `residual.alarm_ratio` | - | factor over s that is no fault yet |
//! | B | `residual.alarm_block_s` | s | length of a block |
//! | T | `residual.false_alarm_interval_s` | s | mean time between false alarms, at least |
//! | l | [`STAKES`] | - | a small one finds a small excess, a large one a large excess sooner |
//!
//! **What is promised, and when.** As long as the residual's power in the block to come, given all before, is not
//! expected to exceed (c s)^2, the mean time to a false alarm is at least T, whatever the residual's distribution
//! and colour. For then the expectation of every e_l given the past is at most 1, and M minus the count of blocks
//! is a supermartingale, which cannot be expected to reach N in fewer than N blocks. Without an expected RSSE there is
//! no yardstick, and never an alarm.
//!
//! **When it does not hold.** The assumption is one of *every* block, while s is the mean over the runs of an identification: a
//! model that is right on average but further off than c s in one manoeuvre raises the alarm when that lasts. On the virtual
//! rig, a fuzzy-tanh model on other replicates of its own experiment raises none while motion and current vary
//! freely; where each current is held for half a minute (RP3-CS) it raised one in ten minutes at c = 1.5 and none at
//! c = 2. The factor also covers what a residual that is correlated from block to block strays by.
//!
//! **Down again.** Once raised, the evidence is put to zero and the alarm stands until the power has been within (c s)^2
//! for [`QUIET_BLOCKS`] blocks in a row. It also falls when the model is swapped, on a reset, and after a gap
//! or a jump in displacement, because the residuals from then on are other ones.
//!
//! Source: Shin, Ramdas, Rinaldo, E-detectors: a nonparametric framework for sequential change detection, New England
//! Journal of Statistics in Data Science (2023), section 3 (the Shiryaev-Roberts e-detector and its average run
//! length) and 4 (mixtures). The stakes, blocks and the way down are ours.

use super::settings::Settings;
use crate::sample::Stamp;

/// Stakes of the bets, in (0, 1): the e-values stay positive.
const STAKES: [f64; 4] = [0.1, 0.3, 0.6, 0.9];

/// Blocks in a row within the bound after which a raised alarm falls.
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
    /// Sum of the squared residuals over the expected RSSE.
    squares: f64,
    count: f64,
}

/// What a finished block did to the alarm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Edge {
    Rising,
    Falling,
}

impl Alarm {
    /// True while the alarm stands.
    #[inline]
    pub(super) const fn is_raised(&self) -> bool {
        self.raised
    }

    /// Takes a residual over the expected RSSE (NaN when that is not known). When it is the first of a new block, the
    /// block before is judged by the settings at present.
    #[inline]
    pub(super) fn add(&mut self, stamp: Stamp, normalised: f64, settings: &Settings) -> Option<Edge> {
        if normalised.is_nan() {
            return None;
        }
        let over = self.block.filter(|block| stamp.since(block.begin).get() >= settings.alarm_block_s);
        let edge = over.and_then(|block| self.judge(&block, settings));
        if over.is_some() {
            self.block = None;
        }
        let block = self.block.get_or_insert(Block { begin: stamp, squares: 0.0, count: 0.0 });
        block.squares += normalised * normalised;
        block.count += 1.0;
        edge
    }

    /// Starts anew; true when the alarm stood.
    pub(super) fn restart(&mut self) -> bool {
        std::mem::take(self).raised
    }

    fn judge(&mut self, block: &Block, settings: &Settings) -> Option<Edge> {
        let power = block.squares / block.count / settings.alarm_ratio.powi(2);
        if self.raised {
            self.quiet = if power <= 1.0 { self.quiet + 1 } else { 0 };
            return (self.quiet >= QUIET_BLOCKS && self.restart()).then_some(Edge::Falling);
        }
        for (evidence, stake) in self.evidence.iter_mut().zip(STAKES) {
            *evidence = (1.0 + stake * (power - 1.0)) * (*evidence + 1.0);
        }
        let mean = self.evidence.iter().sum::<f64>() / STAKES.len() as f64;
        let wanted = settings.false_alarm_interval_s / settings.alarm_block_s;
        (mean >= wanted).then(|| {
            *self = Self { raised: true, ..Self::default() };
            Edge::Rising
        })
    }
}

#[cfg(test)]
mod tests;
