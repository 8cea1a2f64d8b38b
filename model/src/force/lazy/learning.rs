//! Live learning of [`Lazy`]: new samples enter its memory, which keeps its size.
//!
//! ```text
//! d(p, q)      distance of two points in the model's metric
//! r            mean distance of a point of the loaded memory to its nearest neighbour
//! learn q      if d(q, q_last) >= r:
//!                nearest point p with d(p, q) < r:  q replaces p, because both describe the same place and q is newer
//!                no such point:                     q replaces the older one of the two points that are closest to each other
//! ```
//!
//! The memory of Boada et al. grows with the data; a live system needs a bound on memory and time, so the least useful point
//! makes room. Points where the damper is at work follow it; points elsewhere keep what they were trained on, and a
//! place without points takes one from where they are densest. The distance r to the sample learned before keeps slow
//! motion from drawing one point along with it.
//!
//! A step searches the memory once, and once more for each point whose nearest neighbour was replaced: a few in general, all
//! of them at worst. It does not allocate, and its result depends on the samples and their order only.
//!
//! Source: `[boada2008]` and `[bontempi]` in the bibliography (node/docs/guide/bibliography.md) for recursive lazy learning; the
//! choice of the replaced point is ours.

use super::{Lazy, MAX_POINTS};
use crate::force::ForceModel;

/// A model that learns, with what the choice of the replaced point needs.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Learning {
    /// The model with the present memory; always [`ForceModel::Lazy`].
    force: ForceModel,
    /// Number of the sample that each point came from; 0 for a point of the loaded memory.
    learned: [u64; MAX_POINTS],
    /// Squared distance of each point to its nearest neighbour, and that neighbour.
    nearest: [(f64, usize); MAX_POINTS],
    /// r squared.
    spacing: f64,
    /// Where the last sample was learned: displacement, velocity, drive.
    last: Option<[f64; 3]>,
    count: u64,
}

impl Learning {
    /// Nothing learned; the memory is that of `lazy`.
    pub(crate) fn new(lazy: &Lazy) -> Self {
        let mut nearest = [(f64::INFINITY, 0); MAX_POINTS];
        for (j, nearest) in nearest[..lazy.len].iter_mut().enumerate() {
            *nearest = lazy.nearest_to(j);
        }
        let distances = nearest[..lazy.len].iter().map(|(square, _)| square.sqrt());
        let mean = distances.sum::<f64>() / lazy.len as f64;
        Self {
            force: ForceModel::Lazy(*lazy),
            learned: [0; MAX_POINTS],
            nearest,
            spacing: mean * mean,
            last: None,
            count: 0,
        }
    }

    /// The model with the present memory.
    pub(crate) const fn force(&self) -> &ForceModel {
        &self.force
    }

    /// Learns the measured `force_n` (with the session's offset) at displacement `x_m`, velocity `v_m_s` and drive `i`. A sample with a
    /// needed value that is not finite is not learned.
    pub(crate) fn learn(&mut self, x_m: f64, v_m_s: f64, i: f64, force_n: f64) {
        let ForceModel::Lazy(lazy) = &mut self.force else { return };
        let at = [x_m, v_m_s, if lazy.drive().is_some() { i } else { 0.0 }];
        if !at.iter().chain([&force_n]).all(|value| value.is_finite()) {
            return;
        }
        let square = |from: [f64; 3]| lazy.square(from, at);
        if self.last.is_some_and(|last| square(last) < self.spacing) {
            return;
        }
        let all = 0..lazy.len;
        let closest = |of: &dyn Fn(usize) -> f64| {
            all.clone().map(|j| (of(j), j)).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default()
        };
        let (near, same) = closest(&|j| square(lazy.place(j)));
        let replaced = if near < self.spacing {
            same
        } else {
            let (_, one) = closest(&|j| self.nearest[j].0);
            let (_, other) = self.nearest[one];
            if self.learned[other] < self.learned[one] { other } else { one }
        };
        self.count += 1;
        self.last = Some(at);
        self.learned[replaced] = self.count;
        [lazy.displacement_m[replaced], lazy.velocity_m_s[replaced], lazy.drive[replaced]] = at;
        lazy.force_n[replaced] = force_n - lazy.force_offset_n;
        for j in 0..lazy.len {
            if j == replaced || self.nearest[j].1 == replaced {
                self.nearest[j] = lazy.nearest_to(j);
                continue;
            }
            let square = lazy.square(lazy.place(j), at);
            if square < self.nearest[j].0 {
                self.nearest[j] = (square, replaced);
            }
        }
    }
}

impl Lazy {
    /// Where point `j` lies: displacement, velocity, drive.
    fn place(&self, j: usize) -> [f64; 3] {
        [self.displacement_m[j], self.velocity_m_s[j], self.drive[j]]
    }

    /// Squared distance of two places in the metric.
    fn square(&self, a: [f64; 3], b: [f64; 3]) -> f64 {
        let m = &self.metric;
        let drive_scale = m.drive_scale.map_or(1.0, |(_, scale)| scale);
        let scales = [m.displacement_scale_m, m.velocity_scale_m_s, drive_scale];
        (0..3).map(|d| ((a[d] - b[d]) / scales[d]).powi(2)).sum()
    }

    /// Squared distance of point `j` to its nearest neighbour, and that neighbour: the first of several at the same distance.
    fn nearest_to(&self, j: usize) -> (f64, usize) {
        let mut nearest = (f64::INFINITY, j);
        for other in (0..self.len).filter(|other| *other != j) {
            let square = self.square(self.place(j), self.place(other));
            if square < nearest.0 {
                nearest = (square, other);
            }
        }
        nearest
    }
}

#[cfg(test)]
mod tests {
    use super::super::{LazyMetric, LazyPoint};
    use super::*;
    use crate::numbers::agrees;
    use crate::sample::DriveKind;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    fn model(points: &[[f64; 3]]) -> Lazy {
        let metric = LazyMetric { displacement_scale_m: 1.0, velocity_scale_m_s: 0.5, drive_scale: None };
        let point = |[x, v, force_n]: &[f64; 3]| LazyPoint {
            displacement_m: *x,
            velocity_m_s: *v,
            drive: 0.0,
            force_n: *force_n,
        };
        let points: Vec<LazyPoint> = points.iter().map(point).collect();
        Lazy::new(metric, [5, 6], &points, 10.0).expect("a model")
    }

    fn memory(learning: &Learning) -> Vec<[f64; 3]> {
        let ForceModel::Lazy(lazy) = learning.force() else { panic!("it stays a lazy model") };
        lazy.points().map(|p| [p.displacement_m, p.velocity_m_s, p.force_n]).collect()
    }

    #[test]
    fn a_sample_replaces_the_point_at_its_place_or_the_older_of_the_closest_pair() {
        // Points at distances of 4; the last two are 1 apart. r is (5 * 4 + 2 * 1) / 7 = 3.14.
        let points = [0.0, 4.0, 8.0, 12.0, 16.0, 20.0, 21.0].map(|x| [x, 0.0, 100.0 + x]);
        let mut learning = Learning::new(&model(&points));
        let mut expected = points.to_vec();
        let mut learns = |sample: [f64; 3], replaced: Option<usize>| {
            learning.learn(sample[0], sample[1], f64::NAN, sample[2]);
            if let Some(replaced) = replaced {
                // The memory holds forces without the session's offset.
                expected[replaced] = [sample[0], sample[1], sample[2] - 10.0];
            }
            assert_eq!(memory(&learning), expected, "{sample:?}");
        };
        // The place of point 2.
        learns([9.0, 0.0, 50.0], Some(2));
        // Nearer than r to the sample learned before.
        learns([11.0, 0.0, 60.0], None);
        // A place without points: point 5 and 6 are the closest pair, and as old as each other.
        learns([40.0, 0.0, 70.0], Some(5));
        // Now points 1 and 2 are 5 apart, 2 and 3 are 3 apart: 3 is older than 2.
        learns([60.0, 0.0, 80.0], Some(3));
        // A velocity counts twice as much as a displacement.
        learns([60.0, 1.0, 90.0], None);
        learns([60.0, 2.0, 90.0], Some(0));
        learns([f64::NAN, 0.0, 1.0], None);
        learns([80.0, 0.0, f64::NAN], None);
    }

    #[test]
    fn nearest_neighbours_stay_exact() {
        let mut random = Pcg64Mcg::seed_from_u64(2);
        let mut draw = || [random.random::<f64>(), random.random::<f64>(), random.random::<f64>()];
        let points: Vec<[f64; 3]> = (0..60).map(|_| draw()).collect();
        let mut learning = Learning::new(&model(&points));
        for _ in 0..500 {
            let [x, v, force_n] = draw();
            learning.learn(x, v, f64::NAN, force_n);
        }
        assert!(learning.count > 300, "{}", learning.count);
        let points = memory(&learning);
        for (j, p) in points.iter().enumerate() {
            let distance = |q: &[f64; 3]| (q[0] - p[0]).powi(2) + (2.0 * (q[1] - p[1])).powi(2);
            let others = points.iter().enumerate().filter(|(other, _)| *other != j);
            let truth = others.map(|(_, q)| distance(q)).fold(f64::INFINITY, f64::min);
            assert!((learning.nearest[j].0 - truth).abs() < 1e-12, "{j}");
        }
        assert_eq!(points.len(), 60);
    }

    /// The rule by brute force in numpy: the sample that each point of the memory came from, and forces of the learned memory.
    #[test]
    fn four_hundred_samples_leave_the_memory_of_a_replay_in_numpy() {
        let share = |k: usize, step: f64| 2.0 * (k as f64 * step).fract() - 1.0;
        let point = |k: usize| {
            let [x, v, i] = [0.819_172_513, 0.671_043_607, 0.549_700_477].map(|step| share(k, step));
            LazyPoint {
                displacement_m: x,
                velocity_m_s: v,
                drive: i,
                force_n: 100.0 * (3.0 * x).sin() + 80.0 * v + 50.0 * i,
            }
        };
        let points: Vec<LazyPoint> = (0..40).map(point).collect();
        let drive_scale = Some((DriveKind::CoilCurrent, 0.8));
        let metric = LazyMetric { displacement_scale_m: 0.5, velocity_scale_m_s: 0.3, drive_scale };
        let mut learning = Learning::new(&Lazy::new(metric, [5, 12], &points, 15.0).expect("a model"));
        let sample = |k: usize| {
            let k = k as f64;
            let [x, v, i] = [0.9 * (0.37 * k).sin(), 0.7 * (0.91 * k).cos(), (0.053 * k).sin()];
            [x, v, i, 60.0 * (3.0 * x).sin() + 90.0 * v + 40.0 * i]
        };
        for k in 0..400 {
            let [x, v, i, force_n] = sample(k);
            learning.learn(x, v, i, force_n + 15.0);
        }
        let ForceModel::Lazy(lazy) = learning.force() else { panic!("it stays a lazy model") };
        let origin = |p: LazyPoint| {
            let found = (0..400).position(|k| sample(k)[..2] == [p.displacement_m, p.velocity_m_s]);
            found.map_or(-1.0, |k| k as f64)
        };
        let origins: Vec<f64> = lazy.points().map(origin).collect();
        agrees("boada.origin", &origins, 0.0);
        let forces_n =
            [(0.1, 0.2, -0.3), (-0.6, 0.4, 0.5), (0.8, -0.5, 0.9)].map(|(x, v, i)| lazy.force_n(x, v, i));
        agrees("boada.force_n", &forces_n, 1e-9);
    }
}
