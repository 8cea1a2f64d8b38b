//! Estimates under jittering stamps and lost samples. The whole table: `cargo run --release -p mr-damper-model --example jitter`.

mod jitter_support;

use jitter_support::{Case, Current, Jitter, Loss, Outcome, Truth, models, outcome, samples};
use mr_damper_model::condition::Conditioning;
use mr_damper_model::pipeline::Settings;

/// The outcome of `case`, and its error over that on clean stamps.
fn fares(case: Case) -> (Outcome, f64) {
    let models = models(case.rate_hz, case.current, Conditioning::THESIS);
    let of = |case: &Case| outcome(models, Settings::default(), &samples(case));
    let clean = of(&Case { rate_hz: case.rate_hz, current: case.current, ..Case::CLEAN });
    let got = of(&case);
    (got, got.rms_n / clean.rms_n)
}

/// All ways in which stamps may jitter: all channels alike or each by itself, samples in order of stamps or as they were taken, and
/// stamps that are right or wrong.
fn ways(case: Case) -> impl Iterator<Item = Case> {
    [(true, true), (false, false), (false, true)].into_iter().flat_map(move |(shared, by_stamp)| {
        [Truth::ReadOnTime, Truth::ReadAtStamp].map(|truth| Case { shared, by_stamp, truth, ..case })
    })
}

#[test]
fn jitter_of_half_a_period_and_two_percent_lost_cost_no_mode_and_little_accuracy() {
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

/// At few samples a period of the motion, what lies between them is known less well.
#[test]
fn slow_samples_that_jitter_keep_the_mode() {
    for (rate_hz, most) in [(100.0, 3.5), (200.0, 3.0)] {
        let (jitter, loss) = (Jitter::Uniform(0.5), Loss::Each(0.02));
        for case in ways(Case { rate_hz, jitter, loss, ..Case::CLEAN }) {
            let (got, ratio) = fares(case);
            assert!(got.changes == 0 && ratio <= most, "{ratio:.2} times the error: {got:?} of {case:?}");
        }
    }
}

#[test]
fn lost_samples_alone_cost_nothing() {
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

/// Gaps between even samples do not count as another sample rate.
#[test]
fn gaps_of_five_samples_are_no_other_rate() {
    for rate_hz in [500.0, 512.0, 1000.0, 2000.0] {
        let case = Case { rate_hz, loss: Loss::Bursts(5), ..Case::CLEAN };
        let (got, ratio) = fares(case);
        assert!(got.changes == 0 && ratio <= 1.3, "{ratio:.2} times the error: {got:?} of {case:?}");
    }
}

/// A timer of rclpy at 500 Hz that stamps when it publishes, and stands still for up to 20 ms now and then.
#[test]
fn a_publisher_that_stands_still_for_a_moment_does_not_change_the_mode() {
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
