//! The live view without a terminal: one line without escape codes.

use super::live_summary::LiveSummary;
use mr_damper_model::sample::Channel;

/// The summary as one line of text.
#[must_use]
pub fn line(summary: &LiveSummary) -> String {
    let mut text = format!("{:5.1} s", summary.at_s());
    match &summary.estimate {
        Some(estimate) => {
            let state = [estimate.mode.name(), estimate.validity.name()].join(" ");
            text += &format!("  {state:<16} F {:+7.1} N", estimate.force.get());
        }
        None => text += "  no estimate yet ",
    }
    text += &match summary.measured_n() {
        Some(measured_n) => format!("  measured {measured_n:+7.1} N"),
        None => format!("  measured {:>7} N", "-"),
    };
    if let Some(residual) = &summary.residual {
        text += &if summary.residual_is_fresh() {
            format!("  residual {:+7.1} N", residual.residual.get())
        } else {
            format!("  residual {:>7} N", "-")
        };
        text += &format!("  RMSE {:5.1} N NMSE {:.3}", residual.windowed_rsse.get(), residual.windowed_esr);
    }
    text += &format!(
        "  in {:.0}/{:.0}/{:.0} out {:.0} Hz",
        summary.input_hz(Channel::Displacement),
        summary.input_hz(Channel::Drive),
        summary.input_hz(Channel::Force),
        summary.estimate_hz(),
    );
    if let (Some(median_s), Some(p99_s)) =
        (summary.round_trip.quantile_s(0.5), summary.round_trip.quantile_s(0.99))
    {
        text += &format!("  round trip {:.1} ms (p99 {:.1})", median_s * 1e3, p99_s * 1e3);
    }
    if let Some(alarm) = &summary.alarm {
        text += &format!("  ALARM since {:.1} s", alarm.at_s);
    }
    text += &format!("  refused {} lost {}", summary.counts.refused, summary.counts.lost);
    if let Some(estimate) = summary.estimate.filter(|estimate| estimate.reasons.0 != 0) {
        text += &format!("  {}", estimate.reasons.names().collect::<Vec<_>>().join("+"));
    }
    text
}
