//! The live view without a terminal: one line without escape codes.

use super::board::Board;
use mr_damper_model::sample::Channel;

/// The board as one line of text.
#[must_use]
pub fn line(board: &Board) -> String {
    let mut text = format!("{:5.1} s", board.at_s());
    match &board.estimate {
        Some(estimate) => {
            let state = [estimate.mode.name(), estimate.validity.name()].join(" ");
            text += &format!("  {state:<16} F {:+7.1} N", estimate.force.get());
        }
        None => text += "  no estimate yet ",
    }
    text += &match board.measured_n() {
        Some(measured_n) => format!("  measured {measured_n:+7.1} N"),
        None => format!("  measured {:>7} N", "-"),
    };
    if let Some(residual) = &board.residual {
        text += &if board.residual_is_fresh() {
            format!("  residual {:+7.1} N", residual.residual.get())
        } else {
            format!("  residual {:>7} N", "-")
        };
        text += &format!("  RSSE {:5.1} N ESR {:.3}", residual.windowed_rsse.get(), residual.windowed_esr);
    }
    text += &format!(
        "  in {:.0}/{:.0}/{:.0} out {:.0} Hz",
        board.input_hz(Channel::Displacement),
        board.input_hz(Channel::Drive),
        board.input_hz(Channel::Force),
        board.estimate_hz(),
    );
    if let (Some(median_s), Some(p99_s)) =
        (board.round_trip.quantile_s(0.5), board.round_trip.quantile_s(0.99))
    {
        text += &format!("  round trip {:.1} ms (p99 {:.1})", median_s * 1e3, p99_s * 1e3);
    }
    if let Some(alarm) = &board.alarm {
        text += &format!("  ALARM since {:.1} s", alarm.at_s);
    }
    text += &format!("  refused {} lost {}", board.counts.refused, board.counts.lost);
    if let Some(estimate) = board.estimate.filter(|estimate| estimate.reasons.0 != 0) {
        text += &format!("  {}", estimate.reasons.names().collect::<Vec<_>>().join("+"));
    }
    text
}
