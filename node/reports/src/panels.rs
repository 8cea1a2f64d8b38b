//! Panels that several reports share.

use super::correlate::{self, ResidualPoint};
use super::plot::{Ink, Plot, Series, Shape, binned_mean};
use super::recording::Recording;
use super::table::bars;
use maud::{Markup, html};
use mr_damper_model::sample::DriveKind;

/// Range of the time axis for a whole run, s: from zero to its end, rounded up to a tenth of a second.
pub(super) fn whole_run(recording: &Recording) -> (f64, f64) {
    (0.0, (recording.length_s() * 10.0).ceil().max(1.0) / 10.0)
}

/// The points, with a break (NaN) wherever two neighbours are more than 0.1 s apart.
pub(super) fn with_breaks(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut broken = Vec::with_capacity(points.len() + 4);
    for point in points {
        if broken.last().is_some_and(|last: &(f64, f64)| point.0 - last.0 > 0.1) {
            broken.push((point.0, f64::NAN));
        }
        broken.push(*point);
    }
    broken
}

/// Bounds of four equally wide levels of the drive. A current below zero is noise, so the levels start at zero; a voltage may be negative.
fn level_bounds(points: &[ResidualPoint], drive: DriveKind) -> [f64; 5] {
    let (low, high) =
        points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| (a.min(p.drive), b.max(p.drive)));
    let least = if drive == DriveKind::CoilCurrent { low.max(0.0) } else { low };
    let (low, high) = if least < high { (least, high) } else { (0.0, 1.0) };
    [0.0, 0.25, 0.5, 0.75, 1.0].map(|share| low + share * (high - low))
}

pub(super) fn force_over_velocity(points: &[ResidualPoint], drive: DriveKind) -> Markup {
    let (what, unit) = (drive.in_words(), drive.unit());
    let bounds = level_bounds(points, drive);
    let bound_n =
        points.iter().map(|p| p.measured_n.abs().max(p.predicted_n.abs())).fold(1.0, f64::max) * 1.05;
    let bound_v = points.iter().map(|p| p.velocity_m_s.abs()).fold(1e-3, f64::max) * 1.05;
    let panel = |name: &str, force: fn(&ResidualPoint) -> f64| Plot {
        description: format!("{name} force over velocity, coloured by {what}"),
        x_label: "velocity, m/s".to_owned(),
        y_label: format!("force, N: {name}"),
        x_range: Some((-bound_v, bound_v)),
        y_range: Some((-bound_n, bound_n)),
        height: 440.0,
        series: (0..4_u8)
            .map(|level| {
                let (from, to) = (bounds[usize::from(level)], bounds[usize::from(level) + 1]);
                let inside =
                    |p: &&ResidualPoint| (level == 0 || p.drive >= from) && (level == 3 || p.drive < to);
                Series {
                    name: format!("{from:.1} to {to:.1} {unit}"),
                    ink: Ink::Level(level),
                    shape: Shape::Dots,
                    points: points.iter().filter(inside).map(|p| (p.velocity_m_s, force(p))).collect(),
                }
            })
            .collect(),
        ..Plot::default()
    };
    html! {
        div.pair {
            (panel("measured", |p| p.measured_n).figure(""))
            (panel("simulation (free run)", |p| p.predicted_n).figure(""))
        }
        p.lead { "The colour shows the " (what) ". Both panels have the same axes. The velocity shown here is computed offline, without "
            "delay. The model uses a causal and therefore delayed velocity, which widens its loop." }
    }
}

pub(super) fn residual_panels(points: &[ResidualPoint], drive: DriveKind) -> Markup {
    let against = |label: &str, pick: fn(&ResidualPoint) -> f64| {
        let all: Vec<(f64, f64)> = points.iter().map(|p| (pick(p), p.residual_n)).collect();
        let trend = binned_mean(&all, 24, 20);
        Plot {
            description: format!("Residual against {label}"),
            x_label: label.to_owned(),
            y_label: "residual, N".to_owned(),
            height: 380.0,
            series: vec![
                Series { name: "residual".to_owned(), ink: Ink::Residual, shape: Shape::Dots, points: all },
                Series { name: "mean".to_owned(), ink: Ink::Trend, shape: Shape::Line, points: trend },
            ],
            ..Plot::default()
        }
    };
    let (what, unit) = (drive.in_words(), drive.unit());
    html! {
        p { "The residual of the simulation against quantities that might explain it. A correlation does not prove a "
            "cause. The service does not know how much of the residual is noise of the load cell." }
        (bars("residual and", "correlation", &correlate::correlations(points)))
        div.pair {
            (against("velocity, m/s", |p| p.velocity_m_s).figure(""))
            (against(&format!("{what}, {unit}"), |p| p.drive).figure(""))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_of_a_current_start_at_zero_and_those_of_a_voltage_may_be_negative() {
        let points = [-4.0, 0.0, 4.0].map(|drive| ResidualPoint {
            displacement_m: 0.0,
            velocity_m_s: 0.0,
            acceleration_m_s2: 0.0,
            drive,
            drive_slope: 0.0,
            measured_n: 0.0,
            predicted_n: 0.0,
            residual_n: 0.0,
        });
        assert_eq!(level_bounds(&points, DriveKind::CoilCurrent), [0.0, 1.0, 2.0, 3.0, 4.0]);
        assert_eq!(level_bounds(&points, DriveKind::CommandVoltage), [-4.0, -2.0, 0.0, 2.0, 4.0]);
    }
}
