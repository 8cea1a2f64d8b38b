//! The values of one window.
//!
//! ```text
//! d    = A^-1 b,   A = sum g g' - n m m',   b = sum g r - n m c             m, c: means of g and r over the window
//! d_k  +-  t95 sqrt((B - 1)/B sum over blocks of (d_k without block - d_k)^2)
//! ```
//!
//! g are the derivatives of the expected reading by the values, r the residual in newtons, and d the differences of the values to the values
//! of the model: one step of least squares. The mean of r is left out, because it is the session's force offset. The window has B = 16
//! blocks of equal length.
//!
//! Source: the jackknife over blocks, `[mackinnon2023]` in the bibliography (node/docs/guide/bibliography.md).

use crate::statistics::block_sums::t95;
use nalgebra::{DMatrix, DVector};

/// Blocks of a window.
pub(super) const BLOCKS: usize = 16;
/// Share of a derivative that the other derivatives leave, below which a value is not determined: squared, of its sum of squares.
const LEAST_OWN: f64 = 1e-6;

/// Sums over a block.
#[derive(Debug, Clone)]
struct Sums {
    count: f64,
    g: DVector<f64>,
    r: f64,
    gg: DMatrix<f64>,
    gr: DVector<f64>,
}

impl Sums {
    fn new(values: usize) -> Self {
        let zeros = DVector::zeros(values);
        Self { count: 0.0, g: zeros.clone(), r: 0.0, gg: DMatrix::zeros(values, values), gr: zeros }
    }

    fn add(&mut self, g: &DVector<f64>, r: f64) {
        self.count += 1.0;
        self.g += g;
        self.r += r;
        self.gg.ger(1.0, g, g, 1.0);
        self.gr.axpy(r, g, 1.0);
    }

    /// Adds `factor` times `other`.
    fn add_sums(&mut self, factor: f64, other: &Self) {
        self.count += factor * other.count;
        self.g.axpy(factor, &other.g, 1.0);
        self.r += factor * other.r;
        self.gg += factor * &other.gg;
        self.gr.axpy(factor, &other.gr, 1.0);
    }

    /// The differences d; `None` for a value that the sums do not determine.
    fn solve(&self) -> Vec<Option<f64>> {
        let a = &self.gg - &self.g * self.g.transpose() / self.count;
        let b = &self.gr - &self.g * (self.r / self.count);
        // A value without an influence is left out, and the others are scaled to a unit diagonal.
        let active: Vec<usize> =
            (0..b.len()).filter(|&k| a[(k, k)] > LEAST_OWN * self.gg[(k, k)] && a[(k, k)] > 0.0).collect();
        let scale = DVector::from_iterator(active.len(), active.iter().map(|&k| a[(k, k)].sqrt()));
        let scaled = DMatrix::from_fn(active.len(), active.len(), |i, j| {
            a[(active[i], active[j])] / (scale[i] * scale[j])
        });
        let right = DVector::from_fn(active.len(), |i, _| b[active[i]] / scale[i]);
        let mut found = vec![None; b.len()];
        let Some(inverse) = scaled.cholesky().map(|cholesky| cholesky.inverse()) else { return found };
        let solution = &inverse * right;
        for (i, &k) in active.iter().enumerate() {
            let is_own = inverse[(i, i)] * LEAST_OWN < 1.0;
            found[k] = Some(solution[i] / scale[i]).filter(|d| is_own && d.is_finite());
        }
        found
    }
}

/// Estimate of a value from a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Found {
    /// Difference to the value of the model.
    pub difference: f64,
    /// Half of the 95 % interval.
    pub half: f64,
}

/// A window that is being filled.
#[derive(Debug)]
pub(super) struct Window {
    block_s: f64,
    blocks: Vec<Sums>,
    /// Time in the block that is being filled, s.
    filled_s: f64,
    values: usize,
}

impl Window {
    pub(super) fn new(values: usize, window_s: f64) -> Self {
        Self { block_s: window_s / BLOCKS as f64, blocks: vec![Sums::new(values)], filled_s: 0.0, values }
    }

    /// Takes the derivatives and the residual of a sample `dt_s` after the one before. At the end of the window: the values that it found, or
    /// `None` for a value that it does not determine.
    pub(super) fn add(
        &mut self,
        dt_s: f64,
        derivatives: &[f64],
        residual_n: f64,
    ) -> Option<Vec<Option<Found>>> {
        self.filled_s += dt_s;
        if let Some(block) = self.blocks.last_mut() {
            block.add(&DVector::from_column_slice(derivatives), residual_n);
        }
        if self.filled_s < self.block_s {
            return None;
        }
        self.filled_s = 0.0;
        let is_full = self.blocks.len() == BLOCKS;
        let blocks = if is_full { std::mem::take(&mut self.blocks) } else { Vec::new() };
        self.blocks.push(Sums::new(self.values));
        is_full.then(|| found(&blocks, self.values))
    }
}

fn found(blocks: &[Sums], values: usize) -> Vec<Option<Found>> {
    let mut all = Sums::new(values);
    blocks.iter().for_each(|block| all.add_sums(1.0, block));
    let differences = all.solve();
    let mut squares = vec![Some(0.0); values];
    for block in blocks {
        let mut others = all.clone();
        others.add_sums(-1.0, block);
        for ((square, without), with) in squares.iter_mut().zip(others.solve()).zip(&differences) {
            // A value that one block alone determines has no interval.
            *square = (*square)
                .zip(without.zip(*with))
                .map(|(sum, (without, with))| sum + (without - with).powi(2));
        }
    }
    let count = blocks.len() as f64;
    let found = |(difference, square): (&Option<f64>, Option<f64>)| {
        let (difference, square) = (*difference).zip(square)?;
        Some(Found { difference, half: t95(blocks.len()) * ((count - 1.0) / count * square).sqrt() })
    };
    differences.iter().zip(squares).map(found).collect()
}
