//! Sums over rows for the fit of a TSK model: normal equations of its conclusions, and of its memberships
//! with the conclusions eliminated.
//!
//! ```text
//! regressors      phi_(a,r) = z_a W_r,     z = (u_1, ..., u_m, 1),     W_r = w_1j w_2k w_3l
//! products        phi_(a,r) phi_(b,s) = (z_a z_b) (w_1j w_1j') (w_2k w_2k') (w_3l w_3l')
//! ```
//!
//! A product depends only on an unordered pair of sets per input. For 3x3x3 rules of four numbers this gives
//! 10 x 6 x 6 x 6 = 2160 different sums instead of 108 x 109 / 2 = 5886, without any loss. With triangles, at
//! most two sets per input are active, so their few products are added one by one instead.
//!
//! Rows are divided into fixed chunks whose sums are added in order, so results do not depend on the number
//! of threads.

use super::premises::Link;
use crate::force::tsk::Firing;
use crate::force::{MAX_INPUTS, MAX_SETS, TskInput};
use crate::lanes::widest;
use crate::parallel;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

/// Number of rows whose outer products are summed together.
const GROUP: usize = 4;
/// Rows of one unit of parallel work.
const CHUNK: usize = 1024;

/// The normalised rows of one run.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Rows {
    /// Inputs; unused ones are zero.
    pub(super) u: Vec<[f64; MAX_INPUTS]>,
    /// Target of the rules, with mean zero over the run.
    pub(super) target: Vec<f64>,
}

/// All rows, and the dimensions of the fitted model.
pub(super) struct Sums<'a> {
    pub(super) runs: Vec<Rows>,
    /// Number of sets of each input; one for an unused input.
    pub(super) counts: [usize; MAX_INPUTS],
    /// Number of values of one conclusion.
    pub(super) width: usize,
    /// Whether sets are triangles, most of which are inactive.
    pub(super) sparse: bool,
    /// Whether rows are processed in parallel; off while whole fits run in parallel.
    pub(super) parallel: bool,
    pub(super) cancel: &'a AtomicBool,
}

/// Normal equations of the conclusions at fixed memberships, with each run's mean removed.
pub(super) struct Linear {
    pub(super) square: DMatrix<f64>,
    pub(super) rhs: DVector<f64>,
    /// Sums of the regressors of each run.
    pub(super) run_sums: Vec<DVector<f64>>,
}

/// Sums over the derivatives of the output with respect to the memberships' parameters, with each run's mean
/// removed.
pub(super) struct Nonlinear {
    /// Sum of squared residuals.
    pub(super) cost: f64,
    /// D'D.
    pub(super) square: DMatrix<f64>,
    /// D'r.
    pub(super) gradient: DVector<f64>,
    /// phi'D.
    pub(super) cross: DMatrix<f64>,
}

/// Sums of one chunk.
struct Part {
    run: usize,
    square: Vec<f64>,
    rhs: Vec<f64>,
    sums: Vec<f64>,
}

/// Buffers for one group of rows, row after row.
struct Group {
    /// Weights of the rules.
    weights: Vec<f64>,
    /// Products of pairs of weights.
    pairs: Vec<f64>,
    /// Products of pairs of regressors.
    products: Vec<f64>,
    /// Regressors, and regressors times the target.
    plain: Vec<f64>,
    times: Vec<f64>,
}

impl Sums<'_> {
    pub(super) fn rules(&self) -> usize {
        self.counts.iter().product()
    }

    /// Number of unknowns of all conclusions. Here they are ordered by coefficient: all rules' first slopes,
    /// all rules' second slopes, and so on; the constants are last.
    pub(super) fn len(&self) -> usize {
        self.rules() * self.width
    }

    pub(super) fn rows(&self) -> usize {
        self.runs.iter().map(|rows| rows.target.len()).sum()
    }

    /// Sum of the squared targets.
    pub(super) fn power(&self) -> f64 {
        self.runs.iter().flat_map(|run| &run.target).map(|t| t * t).sum()
    }

    /// Calls `one` for every chunk, in order; `None` if cancelled.
    pub(super) fn chunks<T: Send>(&self, one: impl Fn(usize, Range<usize>) -> T + Sync) -> Option<Vec<T>> {
        let mut work = Vec::new();
        for (run, rows) in self.runs.iter().enumerate() {
            let len = rows.target.len();
            work.extend((0..len).step_by(CHUNK).map(|from| (run, from..(from + CHUNK).min(len))));
        }
        let one = |(run, range): &(usize, Range<usize>)| {
            (!self.cancel.load(Ordering::Relaxed)).then(|| one(*run, range.clone()))
        };
        if self.parallel {
            parallel::map(&work, one).into_iter().collect()
        } else {
            work.iter().map(one).collect()
        }
    }

    /// Sums for the conclusions; `None` if cancelled.
    pub(super) fn linear(&self, inputs: &[TskInput]) -> Option<Linear> {
        let parts = self.chunks(|run, range| {
            if self.sparse {
                self.sparse_part(inputs, run, range)
            } else {
                self.dense_part(inputs, run, range)
            }
        })?;
        let n = self.len();
        let mut run_sums = vec![DVector::zeros(n); self.runs.len()];
        let mut rhs = DVector::zeros(n);
        let mut square = vec![0.0; parts.first().map_or(0, |part| part.square.len())];
        for part in &parts {
            square.iter_mut().zip(&part.square).for_each(|(total, s)| *total += s);
            rhs.iter_mut().zip(&part.rhs).for_each(|(total, s)| *total += s);
            run_sums[part.run].iter_mut().zip(&part.sums).for_each(|(total, s)| *total += s);
        }
        // Targets have mean zero in each run, so the right side is already centred.
        let mut square = if self.sparse { DMatrix::from_vec(n, n, square) } else { self.unfold(&square) };
        for (rows, sums) in self.runs.iter().zip(&run_sums) {
            square.ger(-1.0 / rows.target.len().max(1) as f64, sums, sums, 1.0);
        }
        Some(Linear { square, rhs, run_sums })
    }

    fn dense_part(&self, inputs: &[TskInput], run: usize, range: Range<usize>) -> Part {
        let (rules, width) = (self.rules(), self.width);
        let pairs: usize = self.counts.map(pair_count).iter().product();
        let products = pair_count(width);
        let mut part = Part {
            run,
            square: vec![0.0; products * pairs],
            rhs: vec![0.0; self.len()],
            sums: vec![0.0; self.len()],
        };
        let mut group = Group {
            weights: vec![0.0; GROUP * rules],
            pairs: vec![0.0; GROUP * pairs],
            products: vec![0.0; GROUP * products],
            plain: vec![0.0; GROUP * width],
            times: vec![0.0; GROUP * width],
        };
        let rows = &self.runs[run];
        for from in range.clone().step_by(GROUP) {
            for k in 0..GROUP {
                let own = &mut group.products[k * products..][..products];
                let plain = &mut group.plain[k * width..][..width];
                let times = &mut group.times[k * width..][..width];
                if from + k >= range.end {
                    // A missing row contributes nothing.
                    own.fill(0.0);
                    plain.fill(0.0);
                    times.fill(0.0);
                    continue;
                }
                let u = rows.u[from + k];
                let w = weights(inputs, &u);
                self.outer(&w, &mut group.weights[k * rules..][..rules]);
                self.pair_outer(&w, &mut group.pairs[k * pairs..][..pairs]);
                plain.copy_from_slice(&regressors(&u, width)[..width]);
                pair_products(plain, own);
                times.iter_mut().zip(plain).for_each(|(t, z)| *t = *z * rows.target[from + k]);
            }
            add_outer(&mut part.square, &group.products, &group.pairs);
            add_outer(&mut part.sums, &group.plain, &group.weights);
            add_outer(&mut part.rhs, &group.times, &group.weights);
        }
        part
    }

    fn sparse_part(&self, inputs: &[TskInput], run: usize, range: Range<usize>) -> Part {
        let n = self.len();
        let mut part = Part { run, square: vec![0.0; n * n], rhs: vec![0.0; n], sums: vec![0.0; n] };
        let rows = &self.runs[run];
        let mut dense = vec![0.0; self.rules()];
        let mut fired = Vec::with_capacity(n);
        for k in range {
            self.fired(&weights(inputs, &rows.u[k]), &rows.u[k], &mut dense, &mut fired);
            for &(i, p) in &fired {
                part.sums[i] += p;
                part.rhs[i] += p * rows.target[k];
                for &(j, q) in &fired {
                    part.square[i * n + j] += p * q;
                }
            }
        }
        part
    }

    /// Non-zero regressors and their positions.
    fn fired(
        &self,
        weights: &[[f64; MAX_SETS]; MAX_INPUTS],
        u: &[f64; MAX_INPUTS],
        dense: &mut [f64],
        fired: &mut Vec<(usize, f64)>,
    ) {
        self.outer(weights, dense);
        fired.clear();
        let z = regressors(u, self.width);
        for (a, z) in z[..self.width].iter().enumerate() {
            let own = dense.iter().enumerate().filter(|(_, w)| **w > 0.0);
            fired.extend(own.map(|(r, w)| (a * dense.len() + r, z * w)));
        }
    }

    /// Weights of the rules: products of the inputs' weights.
    #[inline]
    pub(super) fn outer(&self, w: &[[f64; MAX_SETS]; MAX_INPUTS], rules: &mut [f64]) {
        let [n0, n1, n2] = self.counts;
        let mut rules = rules.chunks_exact_mut(n2);
        for w0 in &w[0][..n0] {
            for (w1, slots) in w[1][..n1].iter().zip(&mut rules) {
                let w01 = w0 * w1;
                slots.iter_mut().zip(&w[2]).for_each(|(slot, w2)| *slot = w01 * w2);
            }
        }
    }

    /// Products as in `outer`, for pairs of sets.
    #[inline]
    fn pair_outer(&self, w: &[[f64; MAX_SETS]; MAX_INPUTS], pairs: &mut [f64]) {
        let mut own = [[0.0; pair_count(MAX_SETS)]; MAX_INPUTS];
        for i in 0..MAX_INPUTS {
            pair_products(&w[i][..self.counts[i]], &mut own[i]);
        }
        let [n0, n1, n2] = self.counts.map(pair_count);
        let mut slots = pairs.chunks_exact_mut(n2);
        for w0 in &own[0][..n0] {
            for (w1, slots) in own[1][..n1].iter().zip(&mut slots) {
                let w01 = w0 * w1;
                slots.iter_mut().zip(&own[2]).for_each(|(slot, w2)| *slot = w01 * w2);
            }
        }
    }

    /// The full matrix from the sums over pairs.
    fn unfold(&self, square: &[f64]) -> DMatrix<f64> {
        let rules = self.rules();
        let [_, n1, n2] = self.counts;
        let pairs = self.counts.map(pair_count);
        let split = |r: usize| [r / (n1 * n2), r / n2 % n1, r % n2];
        DMatrix::from_fn(self.len(), self.len(), |i, j| {
            let (r, s) = (split(i % rules), split(j % rules));
            let pair = |d: usize| pair_index(r[d], s[d], self.counts[d]);
            let place = (pair(0) * pairs[1] + pair(1)) * pairs[2] + pair(2);
            square[pair_index(i / rules, j / rules, self.width) * pairs.iter().product::<usize>() + place]
        })
    }

    /// Sums for the memberships, whose parameters act by `links`, at the given `conclusions`; `None` if
    /// cancelled.
    pub(super) fn nonlinear(
        &self,
        inputs: &[TskInput],
        links: &[Link],
        parameters: usize,
        conclusions: &DVector<f64>,
        run_sums: &[DVector<f64>],
    ) -> Option<Nonlinear> {
        let n = self.len();
        let parts = self.chunks(|run, range| {
            self.slope_part(inputs, links, parameters, conclusions.as_slice(), run, range)
        })?;
        // Columns of E: the derivatives, the residual, and ones.
        let columns = parameters + 2;
        let mut own = vec![DMatrix::<f64>::zeros(columns, columns); self.runs.len()];
        let mut cross = DMatrix::zeros(n, parameters);
        for part in &parts {
            own[part.run].iter_mut().zip(&part.square).for_each(|(total, s)| *total += s);
            for a in 0..self.width {
                for d in 0..parameters {
                    let sums = &part.rhs[(a * parameters + d) * self.rules()..][..self.rules()];
                    let mut column = cross.view_mut((a * self.rules(), d), (self.rules(), 1));
                    column.iter_mut().zip(sums).for_each(|(total, s)| *total += s);
                }
            }
        }
        let mut square = DMatrix::zeros(columns - 1, columns - 1);
        for (own, sums) in own.iter().zip(run_sums) {
            let count = own[(columns - 1, columns - 1)].max(1.0);
            let means = own.view((0, columns - 1), (columns - 1, 1)) / count;
            square += own.view((0, 0), (columns - 1, columns - 1)) - &means * means.transpose() * count;
            cross.ger(-1.0, sums, &means.rows(0, parameters).column(0), 1.0);
        }
        Some(Nonlinear {
            cost: square[(parameters, parameters)],
            gradient: square.view((0, parameters), (parameters, 1)).column(0).into_owned(),
            square: square.view((0, 0), (parameters, parameters)).into_owned(),
            cross,
        })
    }

    /// In the result, `square` is E'E and `rhs` is z D times the weights.
    fn slope_part(
        &self,
        inputs: &[TskInput],
        links: &[Link],
        parameters: usize,
        conclusions: &[f64],
        run: usize,
        range: Range<usize>,
    ) -> Part {
        let (rules, width, columns) = (self.rules(), self.width, parameters + 2);
        let mut part = Part {
            run,
            square: vec![0.0; columns * columns],
            rhs: vec![0.0; width * parameters * rules],
            sums: Vec::new(),
        };
        let mut group_weights = vec![0.0; GROUP * rules];
        let mut group_left = vec![0.0; GROUP * width * parameters];
        let mut group_e = vec![0.0; GROUP * columns];
        let mut functions = vec![0.0; rules];
        let rows = &self.runs[run];
        for from in range.clone().step_by(GROUP) {
            for k in 0..GROUP {
                let weights = &mut group_weights[k * rules..][..rules];
                let left = &mut group_left[k * width * parameters..][..width * parameters];
                let e = &mut group_e[k * columns..][..columns];
                e.fill(0.0);
                if from + k >= range.end {
                    left.fill(0.0);
                    continue;
                }
                let u = rows.u[from + k];
                let z = regressors(&u, width);
                let firing = fire(inputs, &u);
                self.outer(&firing.map(|f| f.weights), weights);
                functions.fill(0.0);
                for (own, z) in conclusions.chunks_exact(rules).zip(&z) {
                    functions.iter_mut().zip(own).for_each(|(f, c)| *f += z * c);
                }
                let (output, under) = self.under(&firing, &functions);
                for link in links {
                    let slope = firing[link.input].slopes[link.set][link.number] * link.factor;
                    e[link.parameter] += (under[link.input][link.set] - output) * slope;
                }
                e[parameters] = output - rows.target[from + k];
                e[parameters + 1] = 1.0;
                for (left, z) in left.chunks_exact_mut(parameters.max(1)).zip(&z[..width]) {
                    left.iter_mut().zip(&*e).for_each(|(left, e)| *left = z * e);
                }
            }
            add_outer(&mut part.square, &group_e, &group_e);
            add_outer(&mut part.rhs, &group_left, &group_weights);
        }
        part
    }

    /// The output, and for each set the output of the rules under it alone.
    #[inline]
    pub(super) fn under(
        &self,
        firing: &[Firing; MAX_INPUTS],
        functions: &[f64],
    ) -> (f64, [[f64; MAX_SETS]; MAX_INPUTS]) {
        let [n0, n1, n2] = self.counts;
        let mut under = [[0.0; MAX_SETS]; MAX_INPUTS];
        let mut functions = functions.chunks_exact(n2);
        let mut output = 0.0;
        for j in 0..n0 {
            let w0 = firing[0].weights[j];
            for k in 0..n1 {
                let w1 = firing[1].weights[k];
                let own = functions.next().unwrap_or(&[]);
                let mut across = 0.0;
                for ((f, w2), under) in own.iter().zip(&firing[2].weights).zip(&mut under[2]) {
                    across += w2 * f;
                    *under += w0 * w1 * f;
                }
                under[1][k] += w0 * across;
                under[0][j] += w1 * across;
            }
            output += w0 * under[0][j];
        }
        (output, under)
    }
}

/// The first `width` - 1 inputs, followed by 1.
#[inline]
pub(super) fn regressors(u: &[f64; MAX_INPUTS], width: usize) -> [f64; MAX_INPUTS + 1] {
    let mut z = [1.0; MAX_INPUTS + 1];
    z[..width - 1].copy_from_slice(&u[..width - 1]);
    z
}

/// Weights of all inputs; 1 for an unused input.
#[inline]
fn weights(inputs: &[TskInput], u: &[f64; MAX_INPUTS]) -> [[f64; MAX_SETS]; MAX_INPUTS] {
    let mut weights = [[1.0; MAX_SETS]; MAX_INPUTS];
    for ((weights, input), u) in weights.iter_mut().zip(inputs).zip(u) {
        *weights = input.weights(*u);
    }
    weights
}

/// Weights of all inputs, and their slopes.
#[inline]
pub(super) fn fire(inputs: &[TskInput], u: &[f64; MAX_INPUTS]) -> [Firing; MAX_INPUTS] {
    let mut firing = [Firing { weights: [1.0; MAX_SETS], ..Firing::default() }; MAX_INPUTS];
    for ((firing, input), u) in firing.iter_mut().zip(inputs).zip(u) {
        *firing = input.fire(*u);
    }
    firing
}

/// Number of unordered pairs of `n` items, including each item with itself.
const fn pair_count(n: usize) -> usize {
    n * (n + 1) / 2
}

/// Index of the pair (j, k) of `n` items, in the order of [`pair_products`].
const fn pair_index(j: usize, k: usize, n: usize) -> usize {
    let (low, high) = if j < k { (j, k) } else { (k, j) };
    low * n - low * (low + 1) / 2 + high
}

/// Products of all pairs.
#[inline]
fn pair_products(values: &[f64], products: &mut [f64]) {
    let mut slots = products.iter_mut();
    for (j, a) in values.iter().enumerate() {
        for (b, slot) in values[j..].iter().zip(&mut slots) {
            *slot = a * b;
        }
    }
}

/// Adds the outer products of the rows of a group: `total[i][j] += sum_k left[k][i] right[k][j]`.
#[inline]
fn add_outer(total: &mut [f64], left: &[f64], right: &[f64]) {
    let (m, n) = (left.len() / GROUP, right.len() / GROUP);
    let (r0, rest) = right.split_at(n);
    let (r1, rest) = rest.split_at(n);
    let (r2, r3) = rest.split_at(n);
    widest(
        #[inline(always)]
        || {
            for i in 0..m {
                let (a, b, c, d) = (left[i], left[m + i], left[2 * m + i], left[3 * m + i]);
                let columns = r0.iter().zip(r1).zip(r2).zip(r3);
                for (total, (((w, x), y), z)) in total[i * n..(i + 1) * n].iter_mut().zip(columns) {
                    *total += (a * w + b * x) + (c * y + d * z);
                }
            }
        },
    );
}

#[cfg(test)]
mod tests;
