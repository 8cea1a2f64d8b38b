//! Triangles and trapezoids of a file, which are zero outside their feet.
//!
//! The outermost triangles are shoulders in a model and ordinary triangles in a file. Weights are normalised, so the two agree
//! wherever the outermost triangle alone is above zero.

use crate::force::TskSet;

/// Where a shoulder begins in a file, in normalised units: beyond it a model's weights are held constant.
const FAR: f64 = 1e6;

/// Feet and shoulders of a triangle or trapezoid.
const fn corners(set: &TskSet) -> Option<[f64; 4]> {
    match *set {
        TskSet::Triangle { left, peak, right } => Some([left, peak, peak, right]),
        TskSet::Trapezoid { left_foot, left_shoulder, right_shoulder, right_foot } => {
            Some([left_foot, left_shoulder, right_shoulder, right_foot])
        }
        _ => None,
    }
}

const fn trapezoid([left_foot, left_shoulder, right_shoulder, right_foot]: [f64; 4]) -> TskSet {
    TskSet::Trapezoid { left_foot, left_shoulder, right_shoulder, right_foot }
}

/// A triangle as the trapezoid that is zero outside the same feet; other sets stay.
pub(super) fn without_shoulder(set: TskSet) -> TskSet {
    match set {
        TskSet::Triangle { left, peak, right } => trapezoid([left, peak, peak, right]),
        other => other,
    }
}

/// True if triangles that are zero outside their feet have the same weights within `range` as triangles whose outermost
/// two are shoulders, and their numbers are valid for the latter.
pub(super) fn as_shoulders(sets: &[TskSet], range: [f64; 2]) -> bool {
    let Some(corners) = sets.iter().map(corners).collect::<Option<Vec<_>>>() else { return false };
    let (Some(first), Some(last)) = (corners.first(), corners.last()) else { return false };
    let end = corners.len() - 1;
    let increasing = corners.windows(2).all(|pair| pair[0][1] < pair[1][1]);
    let valid = corners.iter().enumerate().all(|(j, [left, peak, _, right])| {
        (left < peak || (j == 0 && left == peak)) && (peak < right || (j == end && right == peak))
    });
    // Nothing of the range is beyond the outermost peak, or the outermost set alone is above zero there.
    let below = range[0] >= first[1]
        || (first[0] <= range[0] && corners[1..].iter().all(|[left, ..]| *left >= first[1]));
    let above = range[1] <= last[1]
        || (last[3] >= range[1] && corners[..end].iter().all(|[.., right]| *right <= last[1]));
    increasing && valid && below && above
}

/// Triangles whose outermost two are shoulders, as trapezoids of a file.
pub(super) fn with_shoulders(sets: &[TskSet], range: [f64; 2]) -> Vec<TskSet> {
    let end = sets.len().saturating_sub(1);
    let one = |(j, set): (usize, &TskSet)| match *set {
        TskSet::Triangle { left, peak, right } => {
            let far = FAR.max(range[0].abs()).max(range[1].abs());
            let (left, from) = if j == 0 { (-far, -far) } else { (left, peak) };
            let (to, right) = if j == end { (far, far) } else { (peak, right) };
            trapezoid([left, from, to, right])
        }
        other => other,
    };
    sets.iter().enumerate().map(one).collect()
}

/// The first part of `range` where all triangles and trapezoids of `sets` are zero; `None` if there is none but single
/// points.
pub(super) fn gap(sets: &[TskSet], range: [f64; 2]) -> Option<[f64; 2]> {
    let mut spans: Vec<[f64; 2]> = sets.iter().filter_map(corners).map(|[a, .., d]| [a, d]).collect();
    if spans.is_empty() {
        return None;
    }
    spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
    spans.push([range[1], range[1]]);
    let mut reached = range[0];
    for [from, to] in spans {
        if from > reached && reached < range[1] {
            return Some([reached, from.min(range[1])]);
        }
        reached = reached.max(to);
    }
    None
}
