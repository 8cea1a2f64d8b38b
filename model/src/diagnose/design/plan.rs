//! A plan: segments in order, and the run that plays them.
//!
//! ```text
//! run  = rest, part 1, part 2, ..., rest        part 2, 4, ... are mirrored
//! part = move to the home of segment 1, segment 1, move to the home of segment 2, segment 2, ...
//! ```

use super::limits::Limits;
use super::motion::Stroke;
use super::segment::Segment;
use crate::sample::{DriveKind, Run, Stamp, Trace};

/// Share of the limit of the speed that a move between two homes uses, so that rounding does not exceed it.
const USED: f64 = 0.99;
/// Rest before the first and after the last segment, s.
const REST_S: f64 = 0.25;
/// Shortest time at the end of a part that is filled with a shorter segment, s.
const LEAST_FILL_S: f64 = 0.5;

/// A segment with its place in the run.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Placed {
    pub(super) segment: Segment,
    pub(super) from: usize,
    pub(super) to: usize,
}

/// Displacement (m) and drive at each sample, with the places of the segments.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Course {
    pub(super) displacement_m: Vec<f64>,
    pub(super) drive: Vec<f64>,
    pub(super) placed: Vec<Placed>,
}

/// Samples of the rest before the first segment.
fn rest(limits: &Limits) -> usize {
    (REST_S * limits.rate_hz).ceil() as usize
}

/// Samples of a part, if the run has `parts`.
pub(super) fn part_samples(limits: &Limits, parts: usize) -> usize {
    limits.samples().saturating_sub(2 * rest(limits)) / parts.max(1)
}

/// First sample of the last part.
pub(super) fn split_sample(limits: &Limits, parts: usize) -> usize {
    rest(limits) + (parts - 1) * part_samples(limits, parts)
}

/// Samples of a move between two homes.
pub(super) fn transit(from_m: f64, to_m: f64, limits: &Limits) -> usize {
    (Stroke::new(to_m - from_m, USED * limits.speed_m_s, limits).duration_s * limits.rate_hz).ceil() as usize
}

/// The run of `plan`, whose segments have `length` samples, in `parts` parts.
pub(super) fn course(plan: &[Segment], length: usize, parts: usize, limits: &Limits) -> Course {
    let (total, room) = (limits.samples(), part_samples(limits, parts));
    let first = plan.first().map_or(f64::NAN, |segment| segment.play(length.max(1), limits).1[0]);
    let mut course = Course {
        displacement_m: vec![0.0; rest(limits)],
        drive: vec![if first.is_nan() { limits.drive_at(0.0) } else { first }; rest(limits)],
        placed: Vec::new(),
    };
    let mut at_m = 0.0;
    for part in 0..parts {
        let end = rest(limits) + (part + 1) * room;
        let own = |segment: &Segment| if part % 2 == 1 { segment.mirrored() } else { *segment };
        for segment in plan.iter().map(own) {
            let home_m = segment.home_m(limits);
            let needed = transit(at_m, home_m, limits) + length + transit(home_m, 0.0, limits);
            if course.displacement_m.len() + needed <= end {
                course.play(segment, length, &mut at_m, limits);
            }
        }
        // A shorter segment fills the rest of the part.
        let middle = plan.iter().filter(|segment| segment.home == 0.0).map(own);
        if let Some(segment) = middle.clone().nth(part % middle.count().max(1)) {
            let spent = course.displacement_m.len() + transit(at_m, 0.0, limits);
            let left = end.saturating_sub(spent);
            if left as f64 >= LEAST_FILL_S * limits.rate_hz {
                course.play(segment, left, &mut at_m, limits);
            }
        }
    }
    course.go(0.0, &mut at_m, limits);
    let drive = course.drive.last().copied().unwrap_or(f64::NAN);
    course.displacement_m.resize(total, 0.0);
    course.drive.resize(total, drive);
    course
}

impl Course {
    /// Moves from `at_m` to `to_m` with the drive held.
    fn go(&mut self, to_m: f64, at_m: &mut f64, limits: &Limits) {
        let stroke = Stroke::new(to_m - *at_m, USED * limits.speed_m_s, limits);
        let drive = self.drive.last().copied().unwrap_or(f64::NAN);
        for k in 0..transit(*at_m, to_m, limits) {
            self.displacement_m.push(*at_m + stroke.at(k as f64 / limits.rate_hz));
            self.drive.push(drive);
        }
        *at_m = to_m;
    }

    fn play(&mut self, segment: Segment, length: usize, at_m: &mut f64, limits: &Limits) {
        self.go(segment.home_m(limits), at_m, limits);
        let from = self.displacement_m.len();
        let (displacement_m, drive) = segment.play(length, limits);
        self.displacement_m.extend(displacement_m);
        self.drive.extend(drive);
        self.placed.push(Placed { segment, from, to: self.displacement_m.len() });
    }

    /// Largest displacement (m), speed (m/s) and acceleration (m/s²) by differences of the samples from `from` to `to`.
    pub(super) fn peaks(&self, from: usize, to: usize, rate_hz: f64) -> [f64; 3] {
        peaks(&self.displacement_m[from..to.min(self.displacement_m.len())], rate_hz)
    }

    /// The run: displacement and drive.
    pub(super) fn run(&self, name: &str, limits: &Limits, drive: Option<DriveKind>) -> Run {
        let stamp = |k: usize| Stamp::from_nanos((k as f64 * 1e9 / limits.rate_hz).round() as i64);
        let stamps: Vec<Stamp> = (0..self.displacement_m.len()).map(stamp).collect();
        let trace = |values: Vec<f64>| Trace { stamps: stamps.clone(), values };
        Run {
            name: name.to_owned(),
            displacement_m: trace(self.displacement_m.clone()),
            drive: drive.map(|kind| (kind, trace(self.drive.clone()))),
            ..Run::default()
        }
    }
}

/// Largest displacement, speed and acceleration of samples, by their differences.
pub(super) fn peaks(displacement_m: &[f64], rate_hz: f64) -> [f64; 3] {
    let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0_f64, |most, x| most.max(x.abs()));
    [
        most(&mut displacement_m.iter().copied()),
        most(&mut displacement_m.windows(2).map(|x| (x[1] - x[0]) * rate_hz)),
        most(&mut displacement_m.windows(3).map(|x| (x[2] - 2.0 * x[1] + x[0]) * rate_hz * rate_hz)),
    ]
}
