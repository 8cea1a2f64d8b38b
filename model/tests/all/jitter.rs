//! Estimates with jittering stamps and lost samples. `cargo run --release -p mr-damper-model --example jitter` prints the whole table.

use crate::jitter_support::{Case, Current, Jitter, Loss, Outcome, Truth, models, outcome, samples};
use mr_damper_model::condition::Conditioning;
use mr_damper_model::pipeline::Settings;

/// The outcome of `case`, and the ratio of its error to the error with clean stamps.
fn fares(case: Case) -> (Outcome, f64) {
    let models = models(case.rate_hz, case.current, Conditioning::THESIS);
    let of = |case: &Case| outcome(models, Settings::default(), &samples(case));
    let clean = of(&Case { rate_hz: case.rate_hz, current: case.current, ..Case::CLEAN });
    let got = of(&case);
    (got, got.rms_n / clean.rms_n)
}

/// All variants of jitter: all channels together or each independently, samples in order of their stamps or of sampling, and stamps that
/// are right or wrong.
fn ways(case: Case) -> impl Iterator<Item = Case> {
    [(true, true), (false, false), (false, true)].into_iter().flat_map(move |(shared, by_stamp)| {
        [Truth::ReadOnTime, Truth::ReadAtStamp].map(|truth| Case { shared, by_stamp, truth, ..case })
    })
}

#[test]
fn jitter_of_half_a_period_with_two_percent_loss_keeps_the_mode_and_most_accuracy() {
    for rate_hz in [500.0, 512.0, 1000.0, 2000.0] {
        for current in [Current::Sine, Current::Steps] {
            let (jitter, loss) = (Jitter::Uniform(0.5), Loss::Each(0.02));
            for case in ways(Case { rate_hz, current, jitter, loss, ..Case::CLEAN }) {
                let (got, ratio) = fares(case);
                assert!(got.changes <= 2 && ratio <= 1.3, "{ratio:.2} times the error: {got:?} of {case:?}");
            }
        }
    }
}

/// With few samples per period of the motion, interpolation between them is less accurate.
#[test]
fn jitter_at_low_rates_keeps_the_mode() {
    for (rate_hz, most) in [(100.0, 3.5), (200.0, 3.0)] {
        let (jitter, loss) = (Jitter::Uniform(0.5), Loss::Each(0.02));
        for case in ways(Case { rate_hz, jitter, loss, ..Case::CLEAN }) {
            let (got, ratio) = fares(case);
            assert!(got.changes == 0 && ratio <= most, "{ratio:.2} times the error: {got:?} of {case:?}");
        }
    }
}

#[test]
fn lost_samples_alone_keep_mode_and_accuracy() {
    for rate_hz in [100.0, 200.0, 512.0, 1000.0, 2000.0] {
        for loss in
            [Loss::Each(0.02), Loss::All(0.02), Loss::One(0, 0.02), Loss::One(1, 0.02), Loss::One(2, 0.02)]
        {
            let case = Case { rate_hz, loss, ..Case::CLEAN };
            let (got, ratio) = fares(case);
            assert!(got.changes == 0 && ratio <= 1.3, "{ratio:.2} times the error: {got:?} of {case:?}");
        }
    }
}

/// Gaps in evenly spaced samples do not count as a different sample rate.
#[test]
fn gaps_of_five_samples_do_not_change_the_detected_rate() {
    for rate_hz in [500.0, 512.0, 1000.0, 2000.0] {
        let case = Case { rate_hz, loss: Loss::Bursts(5), ..Case::CLEAN };
        let (got, ratio) = fares(case);
        assert!(got.changes == 0 && ratio <= 1.3, "{ratio:.2} times the error: {got:?} of {case:?}");
    }
}

/// A timer of rclpy at 500 Hz that stamps when it publishes, and stalls for up to 20 ms at times.
#[test]
fn a_publisher_that_stalls_for_a_moment_does_not_change_the_mode() {
    for shared in [true, false] {
        let case = Case {
            rate_hz: 500.0,
            jitter: Jitter::Publisher(0.1),
            truth: Truth::ReadAtStamp,
            shared,
            ..Case::CLEAN
        };
        let (got, ratio) = fares(case);
        assert!(got.changes <= 2 && ratio < 1.5, "{ratio:.2} times the error: {got:?}");
    }
}
