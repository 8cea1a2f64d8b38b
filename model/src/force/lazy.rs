//! Recursive lazy learning: `boada`.
//!
//! ```text
//! memory     m points (x, v, i, F);   at a query q the K nearest ones, p_1 .. p_K, by
//! d^2        = ((x - x_q)/s_x)^2 + ((v - v_q)/s_v)^2 ( + ((i - i_q)/s_i)^2 )
//! local      F = b_0 + b . z,   z = (p - q)/s:    F(q) = b_0 + F0
//! recursive  g = V z_k / (1 + z_k' V z_k),   b += g (F_k - z_k' b),   V -= g z_k' V       k = 1 .. K
//! k          the one of K_min .. K with the least  PRESS_k = (1/k) sum_{j<=k} ( (F_j - z_j' b) / (1 - z_j' V z_j) )^2
//! ```
//!
//! | symbol | field | unit | meaning |
//! |---|---|---|---|
//! | x, v | arguments | m, m/s | displacement from the rest position, velocity; positive in extension |
//! | i | argument | A or V | drive: coil current, or command voltage; semi-active form only |
//! | s | `*_scale` | of the signal | unit of distance; the smaller it is, the more the signal matters |
//! | K_min, K | `neighbours` | 1 | smallest and largest number of points of a local regression |
//! | b, V | - | N, 1 | local coefficients, and their covariance divided by the noise variance |
//! | F0 | `force_offset_n` | N | mean force of the session; the points' forces exclude it |
//!
//! Only the memory is prepared in advance; each query solves a regression of its own (Boada et al. for an MR damper;
//! Bontempi et al. for the recursion and PRESS, the error of each point predicted from the others). In z, q is the origin,
//! so b_0 is the prediction. V starts at 1e4, as if each coefficient had been observed before with a weight of 1e-4. This
//! determines coefficients that the neighbours leave undetermined, for example if all have the same drive.
//!
//! The model keeps no state between samples, unless it is told to learn from measured force while it runs (`lazy/learning.rs`).
//! Outside its points it extrapolates along a plane.
//!
//! Source: `[boada2008]` and `[bontempi]` in the bibliography (node/docs/guide/bibliography.md), section 2.1.3 of the thesis.

mod learning;

pub(crate) use learning::Learning;

use crate::error::Error;
use crate::sample::DriveKind;

/// Largest number of points of the memory.
pub const MAX_POINTS: usize = 256;
/// Largest number of points of a local regression.
pub const MAX_NEIGHBOURS: usize = 16;
/// Smallest number of points of a local regression: one more than it has coefficients.
pub const MIN_NEIGHBOURS: usize = 5;

/// Coefficients of a local regression: one, x, v, i.
const COEFFICIENTS: usize = 4;
/// Diagonal of V at the start.
const PRIOR: f64 = 1e4;

/// A point of the memory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LazyPoint {
    /// Displacement, m.
    pub displacement_m: f64,
    /// Velocity, m/s.
    pub velocity_m_s: f64,
    /// Drive, A or V; ignored by a passive model.
    pub drive: f64,
    /// Force without the session's offset, N.
    pub force_n: f64,
}

/// Unit of distance of each signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LazyMetric {
    /// Displacement, m.
    pub displacement_scale_m: f64,
    /// Velocity, m/s.
    pub velocity_scale_m_s: f64,
    /// Drive, A or V, with its kind; `None` for the passive form.
    pub drive_scale: Option<(DriveKind, f64)>,
}

/// A memory of points with a local regression at each query.
///
/// ```
/// use mr_damper_model::force::{Lazy, LazyMetric, LazyPoint};
///
/// // A memory of points of a damper of 1000 N s/m. Between the points, the model is the plane through the nearest ones.
/// let point = |k: i32| LazyPoint {
///     displacement_m: 0.005 * f64::from(k % 3 - 1),
///     velocity_m_s: 0.05 * f64::from(k / 3 - 2),
///     drive: 0.0,
///     force_n: 50.0 * f64::from(k / 3 - 2),
/// };
/// let points: Vec<LazyPoint> = (0..15).map(point).collect();
/// let metric = LazyMetric { displacement_scale_m: 0.005, velocity_scale_m_s: 0.05, drive_scale: None };
/// let model = Lazy::new(metric, [5, 9], &points, 0.0)?;
/// assert!((model.force_n(0.001, 0.03, f64::NAN) - 30.0).abs() < 0.1);
/// assert!(Lazy::new(metric, [5, 9], &points[..8], 0.0).is_err(), "fewer points than neighbours");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lazy {
    metric: LazyMetric,
    neighbours: [usize; 2],
    len: usize,
    displacement_m: [f64; MAX_POINTS],
    velocity_m_s: [f64; MAX_POINTS],
    drive: [f64; MAX_POINTS],
    force_n: [f64; MAX_POINTS],
    force_offset_n: f64,
}

impl Lazy {
    /// A model from its memory. `neighbours` are the smallest and largest number of points of a local regression.
    ///
    /// # Errors
    /// When there are fewer points than neighbours, or more than [`MAX_POINTS`]; when `neighbours` are not in increasing
    /// order between [`MIN_NEIGHBOURS`] and [`MAX_NEIGHBOURS`]; when a scale is not positive or a number is not finite.
    pub fn new(
        metric: LazyMetric,
        neighbours: [usize; 2],
        points: &[LazyPoint],
        force_offset_n: f64,
    ) -> Result<Self, Error> {
        let positive = |name: &str, value| Error::check(name, value, "positive and finite", |s| s > 0.0);
        positive("displacement_scale_m", metric.displacement_scale_m)?;
        positive("velocity_scale_m_s", metric.velocity_scale_m_s)?;
        if let Some((kind, scale)) = metric.drive_scale {
            positive(
                if kind == DriveKind::CoilCurrent { "current_scale_a" } else { "voltage_scale_v" },
                scale,
            )?;
        }
        Error::check("neighbours[0]", neighbours[0] as f64, "5 to 16", |k| {
            (MIN_NEIGHBOURS as f64..=MAX_NEIGHBOURS as f64).contains(&k)
        })?;
        Error::check("neighbours[1]", neighbours[1] as f64, "at least neighbours[0], at most 16", |k| {
            (neighbours[0] as f64..=MAX_NEIGHBOURS as f64).contains(&k)
        })?;
        if !(neighbours[1]..=MAX_POINTS).contains(&points.len()) {
            return Err(Error::Length {
                name: "the memory".to_owned(),
                found: points.len(),
                expected: format!("{} (neighbours[1]) to {MAX_POINTS}", neighbours[1]),
            });
        }
        Error::check("force_offset_n", force_offset_n, "finite", |_| true)?;
        let mut model = Self {
            metric,
            neighbours,
            len: points.len(),
            displacement_m: [0.0; MAX_POINTS],
            velocity_m_s: [0.0; MAX_POINTS],
            drive: [0.0; MAX_POINTS],
            force_n: [0.0; MAX_POINTS],
            force_offset_n,
        };
        for (j, p) in points.iter().enumerate() {
            let drive = metric.drive_scale.map_or(0.0, |_| p.drive);
            for (name, to, value) in [
                ("displacement_m", &mut model.displacement_m, p.displacement_m),
                ("velocity_m_s", &mut model.velocity_m_s, p.velocity_m_s),
                ("drive", &mut model.drive, drive),
                ("force_n", &mut model.force_n, p.force_n),
            ] {
                to[j] = Error::check(&format!("points: {name}[{j}]"), value, "finite", |_| true)?;
            }
        }
        Ok(model)
    }

    /// The units of distance.
    #[must_use]
    pub const fn metric(&self) -> LazyMetric {
        self.metric
    }

    /// Smallest and largest number of points of a local regression.
    #[must_use]
    pub const fn neighbours(&self) -> [usize; 2] {
        self.neighbours
    }

    /// The memory.
    pub fn points(&self) -> impl Iterator<Item = LazyPoint> + '_ {
        (0..self.len).map(|j| LazyPoint {
            displacement_m: self.displacement_m[j],
            velocity_m_s: self.velocity_m_s[j],
            drive: self.drive[j],
            force_n: self.force_n[j],
        })
    }

    /// The drive that the model needs; `None` for the passive form.
    #[must_use]
    pub const fn drive(&self) -> Option<DriveKind> {
        match self.metric.drive_scale {
            Some((kind, _)) => Some(kind),
            None => None,
        }
    }

    /// Number of values in the memory.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        self.len * if self.metric.drive_scale.is_some() { 4 } else { 3 }
    }

    /// Force offset of the session, N.
    #[must_use]
    pub const fn force_offset_n(&self) -> f64 {
        self.force_offset_n
    }

    /// The same model with another session's force offset, N.
    #[must_use]
    pub const fn with_force_offset_n(mut self, force_offset_n: f64) -> Self {
        self.force_offset_n = force_offset_n;
        self
    }

    /// Force, N, at displacement `x_m`, velocity `v_m_s` and drive `i` (in the unit of [`Lazy::drive`]). Not finite if a
    /// needed argument is not finite.
    #[must_use]
    pub fn force_n(&self, x_m: f64, v_m_s: f64, i: f64) -> f64 {
        let (drive, drive_scale) = self.metric.drive_scale.map_or((0.0, 1.0), |(_, scale)| (i, scale));
        let query = [x_m, v_m_s, drive];
        if !query.iter().all(|q| q.is_finite()) {
            return f64::NAN;
        }
        let scales = [self.metric.displacement_scale_m, self.metric.velocity_scale_m_s, drive_scale];
        let mut nearest = [(f64::INFINITY, 0); MAX_NEIGHBOURS];
        let nearest = &mut nearest[..self.neighbours[1]];
        self.find(query, scales.map(f64::recip), nearest);
        let mut rows = [[0.0; COEFFICIENTS]; MAX_NEIGHBOURS];
        let mut forces = [0.0; MAX_NEIGHBOURS];
        for ((row, force), (_, j)) in rows.iter_mut().zip(&mut forces).zip(nearest.iter()) {
            let at = [self.displacement_m[*j], self.velocity_m_s[*j], self.drive[*j]];
            row[0] = 1.0;
            for d in 0..3 {
                row[d + 1] = (at[d] - query[d]) / scales[d];
            }
            *force = self.force_n[*j];
        }
        let count = nearest.len();
        self.force_offset_n + regression(&rows[..count], &forces[..count], self.neighbours[0])
    }

    /// Fills `nearest` with the squared distances and indices of the points nearest to `query`, nearest first. Of points
    /// at equal distances, the one with the lower index comes first.
    #[inline]
    fn find(&self, query: [f64; 3], per_scale: [f64; 3], nearest: &mut [(f64, usize)]) {
        let mut squares = [0.0; MAX_POINTS];
        let [x, v, i] = query;
        for (j, square) in squares[..self.len].iter_mut().enumerate() {
            let (dx, dv, di) = (
                (self.displacement_m[j] - x) * per_scale[0],
                (self.velocity_m_s[j] - v) * per_scale[1],
                (self.drive[j] - i) * per_scale[2],
            );
            *square = dx * dx + dv * dv + di * di;
        }
        let last = nearest.len() - 1;
        for (j, square) in squares[..self.len].iter().enumerate() {
            if *square < nearest[last].0 {
                let mut at = last;
                while at > 0 && *square < nearest[at - 1].0 {
                    nearest[at] = nearest[at - 1];
                    at -= 1;
                }
                nearest[at] = (*square, j);
            }
        }
    }
}

/// b_0 of the regression of `forces` on the first `k` of `rows`, where `k` is at least `least` and gives the smallest
/// PRESS.
fn regression(rows: &[[f64; COEFFICIENTS]], forces: &[f64], least: usize) -> f64 {
    let mut v = [[0.0; COEFFICIENTS]; COEFFICIENTS];
    for (j, row) in v.iter_mut().enumerate() {
        row[j] = PRIOR;
    }
    // Forces are relative to the nearest point's force, so that the prior pulls towards it and not towards zero.
    let base = forces[0];
    let mut b = [0.0; COEFFICIENTS];
    // F_j - z_j' b and 1 - z_j' V z_j of the points so far. A new point updates both through its own z alone.
    let (mut residuals, mut left_out) = ([0.0; MAX_NEIGHBOURS], [0.0; MAX_NEIGHBOURS]);
    let (mut best, mut found) = (f64::INFINITY, 0.0);
    for (k, (z, force)) in rows.iter().zip(forces).enumerate() {
        let vz = times(&v, z);
        let share = 1.0 / (1.0 + dot(&vz, z));
        let innovation = force - base - dot(&b, z);
        for i in 0..COEFFICIENTS {
            b[i] += vz[i] * share * innovation;
            for j in 0..COEFFICIENTS {
                v[i][j] -= vz[i] * vz[j] * share;
            }
        }
        for ((z, residual), left_out) in rows[..k].iter().zip(&mut residuals).zip(&mut left_out) {
            let common = dot(&vz, z);
            *residual -= common * share * innovation;
            *left_out += common * common * share;
        }
        (residuals[k], left_out[k]) = (innovation * share, share);
        if k + 1 >= least {
            let squares = residuals[..=k].iter().zip(&left_out).map(|(r, l)| (r / l).powi(2));
            let press = squares.sum::<f64>() / (k + 1) as f64;
            if press < best {
                (best, found) = (press, b[0]);
            }
        }
    }
    base + found
}

#[inline]
fn dot(a: &[f64; COEFFICIENTS], b: &[f64; COEFFICIENTS]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

#[inline]
fn times(m: &[[f64; COEFFICIENTS]; COEFFICIENTS], z: &[f64; COEFFICIENTS]) -> [f64; COEFFICIENTS] {
    [dot(&m[0], z), dot(&m[1], z), dot(&m[2], z), dot(&m[3], z)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    fn metric(driven: bool) -> LazyMetric {
        LazyMetric {
            displacement_scale_m: 0.01,
            velocity_scale_m_s: 0.1,
            drive_scale: driven.then_some((DriveKind::CoilCurrent, 0.5)),
        }
    }

    fn memory(seed: u64, force: impl Fn(f64, f64, f64) -> f64) -> Vec<LazyPoint> {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut uniform = |half: f64| half * (2.0 * random.random::<f64>() - 1.0);
        let point = |_| {
            let (displacement_m, velocity_m_s, drive) = (uniform(0.02), uniform(0.3), uniform(1.0));
            let force_n = force(displacement_m, velocity_m_s, drive);
            LazyPoint { displacement_m, velocity_m_s, drive, force_n }
        };
        (0..MAX_POINTS).map(point).collect()
    }

    /// PRESS by leaving out each point in turn, and the prediction, by plain least squares with the prior.
    fn press_and_force(rows: &[[f64; 4]], forces: &[f64]) -> (f64, f64) {
        let base = forces[0];
        let fit = |left_out: Option<usize>| {
            let (mut square, mut right) = (DMatrix::identity(4, 4) / PRIOR, DVector::zeros(4));
            for (_, (z, f)) in rows.iter().zip(forces).enumerate().filter(|(j, _)| Some(*j) != left_out) {
                let z = DVector::from_column_slice(z);
                square += &z * z.transpose();
                right += z * (f - base);
            }
            square.lu().solve(&right).expect("the prior makes it regular")
        };
        let error = |j: usize| forces[j] - base - fit(Some(j)).dot(&DVector::from_column_slice(&rows[j]));
        let press = (0..rows.len()).map(|j| error(j).powi(2)).sum::<f64>() / rows.len() as f64;
        (press, base + fit(None)[0])
    }

    #[test]
    fn recursion_and_press_agree_with_leaving_points_out() {
        let mut random = Pcg64Mcg::seed_from_u64(5);
        for _ in 0..20 {
            let rows: Vec<[f64; 4]> = (0..16)
                .map(|_| {
                    [1.0, 0.0, 0.0, 0.0]
                        .map(|one| if one == 1.0 { 1.0 } else { random.random::<f64>() - 0.4 })
                })
                .collect();
            let forces: Vec<f64> = (0..16).map(|_| 900.0 * random.random::<f64>()).collect();
            let by_hand = (6..=16).map(|k| press_and_force(&rows[..k], &forces[..k]));
            let best = by_hand.min_by(|a, b| a.0.total_cmp(&b.0)).expect("some");
            let found = regression(&rows, &forces, 6);
            assert!((found - best.1).abs() < 1e-6, "{found} {best:?}");
        }
    }

    #[test]
    fn a_plane_is_reproduced_and_the_passive_form_ignores_the_drive() {
        let plane = |x: f64, v: f64, i: f64| 3000.0 * x + 700.0 * v + 90.0 * i + 5.0;
        let model = Lazy::new(metric(true), [6, 14], &memory(1, plane), 40.0).expect("a model");
        let found = model.force_n(0.004, -0.12, 0.3);
        assert!((found - plane(0.004, -0.12, 0.3) - 40.0).abs() < 0.1, "{found}");
        let passive = Lazy::new(metric(false), [6, 14], &memory(1, |x, v, _| plane(x, v, 0.0)), 40.0);
        let passive = passive.expect("a model");
        let found = passive.force_n(0.004, -0.12, f64::NAN);
        assert!((found - plane(0.004, -0.12, 0.0) - 40.0).abs() < 0.1, "{found}");
        assert!(model.force_n(0.004, f64::NAN, 0.3).is_nan());
    }

    #[test]
    fn invalid_models_are_refused() {
        let points = memory(1, |x, _, _| x);
        let refused = |metric, neighbours, points: &[LazyPoint]| {
            Lazy::new(metric, neighbours, points, 0.0).expect_err("refused").to_string()
        };
        assert!(refused(metric(true), [4, 14], &points).contains("neighbours[0] is 4"));
        assert!(refused(metric(true), [8, 7], &points).contains("neighbours[1] is 7"));
        assert!(refused(metric(true), [8, 15], &points[..14]).contains("the memory has 14 values"));
        let flat = LazyMetric { velocity_scale_m_s: 0.0, ..metric(true) };
        assert!(refused(flat, [8, 15], &points).contains("velocity_scale_m_s is 0"));
        let broken = [LazyPoint { force_n: f64::NAN, ..points[0] }; 30];
        assert!(refused(metric(true), [8, 15], &broken).contains("points: force_n[0] is NaN"));
    }

    proptest! {
        #[test]
        fn every_query_has_a_finite_force(x in -1.0..1.0, v in -5.0..5.0, i in -9.0..9.0, same: bool) {
            let mut points = memory(3, |x, v, i| 500.0 * (20.0 * v).tanh() * (1.0 + i) + 1e4 * x);
            if same {
                points = vec![points[0]; 40];
            }
            let model = Lazy::new(metric(true), [5, 16], &points, 0.0).expect("a model");
            prop_assert!(model.force_n(x, v, i).is_finite());
        }

        #[test]
        fn the_nearest_are_found(x in -0.02..0.02, v in -0.3..0.3, i in -1.0..1.0) {
            let points = memory(9, |_, _, _| 0.0);
            let model = Lazy::new(metric(true), [5, 12], &points, 0.0).expect("a model");
            let mut nearest = [(f64::INFINITY, 0); 12];
            model.find([x, v, i], [100.0, 10.0, 2.0], &mut nearest);
            let distance = |p: &LazyPoint| {
                let d = [(p.displacement_m - x) * 100.0, (p.velocity_m_s - v) * 10.0, (p.drive - i) * 2.0];
                d.iter().map(|d| d * d).sum::<f64>()
            };
            let mut all: Vec<(f64, usize)> = points.iter().map(distance).zip(0..).collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
            for (found, truth) in nearest.iter().zip(&all) {
                prop_assert!((found.0 - truth.0).abs() < 1e-9);
            }
        }
    }
}
