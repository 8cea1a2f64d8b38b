//! Loops on the widest vectors of the processor that runs them.
//!
//! The program is compiled for every x86-64 processor, so its vectors hold two numbers. Most processors have vectors of four (AVX2). The
//! result is the same: each lane rounds as a single number does, sums keep the order in which they are written, and products and sums are
//! not fused.

/// Runs `work`, compiled for the widest vectors of this processor. `work` must be marked `#[inline(always)]`, and so must be what it
/// calls; other functions keep vectors of two.
#[inline(always)]
pub(crate) fn widest<R>(work: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(work)
}
