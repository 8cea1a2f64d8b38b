//! Events for the tests of this module.

use crate::estimation::wire::ModelNames;
use mr_damper_model::inverse::{CurrentCommand, LimitedBy};
use mr_damper_model::pipeline::{
    AlarmChange, Cause, Estimate, Event, Mode, Reasons, Refusal, Refused, Residual, Slot, StampedCommand,
    Transition, Validity,
};
use mr_damper_model::sample::{Drive, Reading, Sample, Stamp};
use mr_damper_model::units::{Ampere, Celsius, Metre, MetrePerSecond, Newton, Second, Volt};

pub(super) fn names() -> ModelNames {
    ModelNames {
        free: "thesis/fuzzy-tanh/rp3-cs".into(),
        seeded: Some("thesis/arx".into()),
        hash: "abc".into(),
    }
}

pub(super) fn input(nanos: i64, reading: Reading) -> Event {
    Event::Input(sample(nanos, reading))
}

fn sample(nanos: i64, reading: Reading) -> Sample {
    let stamp = Stamp::from_nanos(nanos);
    Sample { stamp, received: stamp, reading }
}

pub(in crate::streams::sink) fn estimate(nanos: i64, force_n: f64) -> Event {
    Event::Estimate(Estimate {
        stamp: Stamp::from_nanos(nanos),
        received: None,
        force: Newton(force_n),
        smoothing: Newton(0.0),
        std_dev: Newton(12.5),
        slot: Slot::Free,
        mode: Mode::Model,
        validity: Validity::Valid,
        reasons: Reasons::NONE,
        input_age: Second(0.001),
        band: [Newton(force_n - 20.0), Newton(force_n + 20.0)],
        calibrated: true,
    })
}

pub(super) fn residual(nanos: i64, residual_n: f64) -> Event {
    Event::Residual(Residual {
        stamp: Stamp::from_nanos(nanos),
        measured: Newton(100.0),
        predicted: Newton(100.0 - residual_n),
        load_cell: Newton(0.0),
        residual: Newton(residual_n),
        expected_rsse: Newton(10.0),
        normalised: residual_n / 10.0,
        windowed_rsse: Newton(8.0),
        windowed_esr: 0.001,
        window: Second(5.0),
        counts: true,
        alarm: false,
    })
}

/// One event for each topic.
pub(super) fn one_of_each() -> Vec<Event> {
    vec![
        input(1, Reading::Displacement(Metre(0.01))),
        input(2, Reading::Velocity(MetrePerSecond(0.1))),
        input(3, Reading::Drive(Drive::CoilCurrent(Ampere(0.8)))),
        input(4, Reading::Drive(Drive::CommandVoltage(Volt(2.0)))),
        input(5, Reading::Force(Newton(120.0))),
        input(6, Reading::CaseTemperature(Celsius(31.0))),
        estimate(7, 119.0),
        residual(8, 1.0),
        Event::Transition(Transition {
            stamp: Stamp::from_nanos(9),
            from: Mode::Fault,
            to: Mode::Model,
            cause: Cause::ModelReady,
        }),
        Event::Refusal(Refusal {
            sample: sample(10, Reading::Displacement(Metre(f64::NAN))),
            why: Refused::NotFinite,
        }),
        Event::Alarm(AlarmChange { stamp: Stamp::from_nanos(11), raised: true, ratio: 1.75 }),
        input(12, Reading::BodyVelocity(MetrePerSecond(0.2))),
        input(13, Reading::ForceRequest(Newton(300.0))),
        Event::Command(StampedCommand {
            stamp: Stamp::from_nanos(14),
            known_at: Stamp::from_nanos(14),
            command: CurrentCommand {
                current: Ampere(0.6),
                requested: Newton(300.0),
                expected: Newton(299.5),
                achievable: [Newton(80.0), Newton(900.0)],
                is_achievable: true,
                dissipative: true,
                limited_by: LimitedBy::None,
                substituted: false,
            },
        }),
    ]
}
