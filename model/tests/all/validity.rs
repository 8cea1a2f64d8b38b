//! Every reason of an estimate, each with a case that gives it and a similar case that does not.

use crate::common::{Harness, PERIOD_NS, both, preset, samples};
use mr_damper_model::condition::{ApplyTo, VelocitySource};
use mr_damper_model::effect::{Effect, EffectModel, Effects};
use mr_damper_model::force::{Arx, ForceModel, LAGS};
use mr_damper_model::inverse::Limits;
use mr_damper_model::model::{Envelope, Model};
use mr_damper_model::pipeline::{Event, Mode, Models, Pipeline, Reasons, Settings, Validity};
use mr_damper_model::preset::{BEST_ARX, BEST_FUZZY_TANH};
use mr_damper_model::sample::{Drive, Reading, Sample, Stamp};
use mr_damper_model::units::{Ampere, Celsius, Metre, MetrePerSecond, Newton, Second, Volt};

/// Samples of a case. Reasons are collected from sample `COUNTS_FROM` on.
const LENGTH: i64 = 800;
const COUNTS_FROM: i64 = 400;

/// A change of a sample's readings, given the number of the sample and its readings, of which displacement is the last.
type Edit = fn(i64, &mut Vec<Sample>);

/// A case: the models, the settings and the input.
#[derive(Clone, Copy)]
struct Scenario {
    models: fn() -> Models,
    settings: fn() -> Settings,
    edit: Edit,
    /// A step after the samples: silence, or a note of lost samples.
    end: fn(&mut Pipeline, &mut dyn FnMut(Event)),
}

/// Both models on the thesis' motion, with all inputs present.
const SOUND: Scenario =
    Scenario { models: both, settings: Settings::default, edit: |_, _| {}, end: |_, _| {} };

impl Scenario {
    /// The reasons of the estimates from `COUNTS_FROM` on, and the mode at the end.
    fn run(&self) -> (Reasons, Mode) {
        let mut pipeline = Pipeline::new((self.models)(), (self.settings)()).expect("presets run");
        let mut said = Reasons::NONE;
        let from = Stamp::from_nanos(COUNTS_FROM * PERIOD_NS);
        let mut record = |event: Event| {
            if let Event::Estimate(estimate) = event
                && estimate.stamp >= from
            {
                said |= estimate.reasons;
                let least = estimate.reasons.validity();
                assert!(estimate.validity >= least, "{:?} says {:?}", estimate.validity, estimate.reasons);
                assert!(estimate.force.is_finite() || estimate.validity == Validity::Invalid);
            }
        };
        for k in 0..LENGTH {
            let mut feed = samples(k, 0).to_vec();
            (self.edit)(k, &mut feed);
            for sample in feed {
                pipeline.step(&sample, &mut record);
            }
        }
        (self.end)(&mut pipeline, &mut record);
        let mode = pipeline.mode();
        (said, mode)
    }
}

fn seconds(k: i64) -> f64 {
    (k * PERIOD_NS) as f64 * 1e-9
}

fn put(feed: &mut Vec<Sample>, reading: Reading) {
    let sample = Sample { reading, ..feed[0] };
    feed.insert(0, sample);
}

fn without(feed: &mut Vec<Sample>, what: fn(&Reading) -> bool) {
    feed.retain(|sample| !what(&sample.reading));
}

fn is_force(reading: &Reading) -> bool {
    matches!(reading, Reading::Force(_))
}

fn is_drive(reading: &Reading) -> bool {
    matches!(reading, Reading::Drive(_))
}

/// Changes the value of the readings of one kind.
fn change(feed: &mut [Sample], what: fn(&Reading) -> bool, to: impl Fn(f64) -> f64) {
    for sample in feed.iter_mut().filter(|sample| what(&sample.reading)) {
        sample.reading = match sample.reading {
            Reading::Displacement(x) => Reading::Displacement(Metre(to(x.0))),
            Reading::Force(f) => Reading::Force(Newton(to(f.0))),
            Reading::Drive(i) => Reading::Drive(Drive::CoilCurrent(Ampere(to(i.get())))),
            other => other,
        };
    }
}

fn is_displacement(reading: &Reading) -> bool {
    matches!(reading, Reading::Displacement(_))
}

/// Velocity of the thesis' motion at sample `k`, m/s, `late_s` ago.
fn velocity_m_s(k: i64, late_s: f64) -> f64 {
    let t = seconds(k) - late_s;
    0.072 * (9.0 * t).cos() + 0.062 * (31.0 * t).cos()
}

fn shift(feed: &mut [Sample], nanos: i64) {
    for sample in feed {
        sample.stamp = sample.stamp.shifted(nanos);
        sample.received = sample.received.shifted(nanos);
    }
}

fn fading() -> Models {
    let mut model = preset(BEST_FUZZY_TANH);
    let fade = EffectModel::new(Effect::ThermalFade, &[-0.002]).expect("a fade");
    model.effects = Effects::new(&[fade]).expect("one effect");
    Models::alone(model)
}

fn driver() -> Settings {
    Settings { limits: Limits { rate_max_a_s: 20.0, ..Limits::default() }, ..Settings::default() }
}

/// Each reason with a case that must give it, and a similar case that must not.
fn scenarios() -> Vec<(Reasons, Scenario, Scenario)> {
    let edited = |edit: Edit| Scenario { edit, ..SOUND };
    let enveloped = |edit: Edit| Scenario { models: || trained(WIDE), edit, ..SOUND };
    vec![
        (
            Reasons::DRIVE_MISSING,
            edited(|_, feed| without(feed, is_drive)),
            edited(|k, feed| {
                if k > 10 {
                    without(feed, is_drive);
                }
            }),
        ),
        (
            Reasons::DRIVE_STALE,
            edited(|k, feed| {
                if k > 200 {
                    without(feed, is_drive);
                }
            }),
            // The drive comes at 4 Hz.
            edited(|k, feed| {
                if k % 128 != 0 {
                    without(feed, is_drive);
                }
            }),
        ),
        (
            Reasons::FORCE_LOST,
            edited(|k, feed| {
                if k > 500 {
                    without(feed, is_force);
                }
            }),
            // Lost for less than force_timeout_s.
            edited(|k, feed| {
                if (500..520).contains(&k) {
                    without(feed, is_force);
                }
            }),
        ),
        (
            Reasons::DISPLACEMENT_GAP,
            edited(|k, feed| {
                if (450..510).contains(&k) {
                    feed.clear();
                }
            }),
            edited(|k, feed| {
                if (450..490).contains(&k) {
                    feed.clear();
                }
            }),
        ),
        (
            Reasons::INPUT_REFUSED,
            edited(|k, feed| {
                if k == 500 {
                    change(feed, is_force, |_| f64::NAN);
                }
            }),
            edited(|k, feed| {
                if k == 500 {
                    change(feed, is_force, |f| 2.0 * f);
                }
            }),
        ),
        (
            Reasons::RATE_MISMATCH,
            edited(|k, feed| shift(feed, k * PERIOD_NS / 5)),
            edited(|k, feed| shift(feed, k * PERIOD_NS / 50)),
        ),
        (
            Reasons::LATE,
            edited(|_, feed| feed.iter_mut().for_each(|s| s.received = s.received.shifted(600_000_000))),
            edited(|_, feed| feed.iter_mut().for_each(|s| s.received = s.received.shifted(400_000_000))),
        ),
        (
            // The clock of the publisher is 50 ms ahead.
            Reasons::STAMP_AHEAD,
            edited(|_, feed| feed.iter_mut().for_each(|s| s.received = s.received.shifted(-50_000_000))),
            edited(|_, feed| feed.iter_mut().for_each(|s| s.received = s.received.shifted(-25_000_000))),
        ),
        (
            // Only the clock of the driver is ahead.
            Reasons::STAMP_AHEAD,
            edited(|_, feed| feed[0].received = feed[0].received.shifted(-50_000_000)),
            SOUND,
        ),
        (
            Reasons::WRONG_DRIVE,
            edited(|k, feed| {
                if k == 500 {
                    put(feed, Reading::Drive(Drive::CommandVoltage(Volt(1.0))));
                }
            }),
            edited(|_, feed| put(feed, Reading::CaseTemperature(Celsius(30.0)))),
        ),
        (
            Reasons::SETTLING,
            edited(|k, feed| {
                if (450..510).contains(&k) {
                    feed.clear();
                }
            }),
            SOUND,
        ),
        (
            // An ARX whose force lags sum to one has no static gain; the thesis' best ARX has one.
            Reasons::NO_DC,
            Scenario { models: without_dc, edit: force_ends, ..SOUND },
            Scenario { models: both, edit: force_ends, ..SOUND },
        ),
        (
            Reasons::NO_MODEL_RUNS,
            Scenario {
                settings: || Settings { only_mode: Some(Mode::Fault), ..Settings::default() },
                ..SOUND
            },
            Scenario {
                settings: || Settings { only_mode: Some(Mode::Model), ..Settings::default() },
                ..SOUND
            },
        ),
        (
            Reasons::DISPLACEMENT_LOST,
            Scenario { end: |p, record| p.tick(after(0.6), &mut |e| record(e)), ..SOUND },
            Scenario { end: |p, record| p.tick(after(0.4), &mut |e| record(e)), ..SOUND },
        ),
        (
            Reasons::OVERLOAD,
            Scenario {
                end: |p, record| {
                    p.note_overload();
                    for sample in samples(LENGTH, 0) {
                        p.step(&sample, &mut |e| record(e));
                    }
                },
                ..SOUND
            },
            SOUND,
        ),
        (
            Reasons::INPUT_INTERLEAVED,
            Scenario {
                end: |p, record| {
                    p.note_interleaved();
                    for sample in samples(LENGTH, 0) {
                        p.step(&sample, &mut |e| record(e));
                    }
                },
                ..SOUND
            },
            SOUND,
        ),
        (
            Reasons::TEMPERATURE_MISSING,
            Scenario { models: fading, ..SOUND },
            Scenario {
                models: fading,
                edit: |_, feed| put(feed, Reading::CaseTemperature(Celsius(30.0))),
                ..SOUND
            },
        ),
        (
            Reasons::INPUT_RANGE,
            edited(|k, feed| {
                if k == 500 {
                    change(feed, is_force, |_| 2e5);
                }
            }),
            edited(|k, feed| {
                if k == 500 {
                    change(feed, is_force, |_| 9e4);
                }
            }),
        ),
        (
            Reasons::INPUT_RATE,
            edited(|k, feed| {
                if k == 500 {
                    change(feed, is_displacement, |x| x + 0.02);
                }
            }),
            // 3 m/s for a while.
            edited(|k, feed| {
                let away_m = 3.0 * seconds((k - 500).clamp(0, 20));
                change(feed, is_displacement, |x| x + away_m);
            }),
        ),
        (
            Reasons::SENSOR_STUCK,
            // Displacement is stuck, while the measured force shows that the rod moves.
            enveloped(|k, feed| {
                if k > 450 {
                    change(feed, is_displacement, |_| 0.004);
                }
            }),
            // A parked car: nothing moves except the load cell's noise.
            enveloped(|k, feed| {
                if k > 450 {
                    let noise_n = (k * 7 % 11) as f64;
                    change(feed, is_displacement, |_| 0.004);
                    change(feed, is_force, |_| 40.0 + noise_n);
                }
            }),
        ),
        (
            Reasons::SENSOR_STUCK,
            // The load cell is stuck while the rod moves.
            edited(|k, feed| {
                if k > 450 {
                    change(feed, is_force, |_| 350.0);
                }
            }),
            // The force is absent, not stuck.
            edited(|k, feed| {
                if k > 450 {
                    without(feed, is_force);
                }
            }),
        ),
        (
            Reasons::VELOCITY_DISAGREES,
            edited(|k, feed| put(feed, Reading::Velocity(MetrePerSecond(-velocity_m_s(k, 0.0))))),
            // 4 ms late, with a gain 10 % too large and noise.
            edited(|k, feed| {
                let noise_m_s = 0.01 * ((k * 7 % 11) as f64 - 5.0) / 5.0;
                let velocity_m_s = 1.1 * velocity_m_s(k, 4e-3) + noise_m_s;
                put(feed, Reading::Velocity(MetrePerSecond(velocity_m_s)));
            }),
        ),
        (
            Reasons::DRIVE_IMPLAUSIBLE,
            edited(|k, feed| {
                if k > 500 {
                    change(feed, is_drive, |_| 3.5);
                }
            }),
            edited(|k, feed| {
                if k > 500 {
                    change(feed, is_drive, |_| 2.6);
                }
            }),
        ),
        (
            Reasons::DRIVE_IMPLAUSIBLE,
            // The thesis' steps of the current, from a driver of 20 A/s.
            Scenario { settings: driver, ..SOUND },
            Scenario {
                settings: driver,
                edit: |k, feed| change(feed, is_drive, |_| (15.0 * seconds(k)).min(2.4)),
                ..SOUND
            },
        ),
        (
            Reasons::DRIVE_IMPLAUSIBLE,
            Scenario {
                settings: driver,
                edit: |k, feed| change(feed, is_drive, |_| if k > 500 { 1.9 } else { 1.2 }),
                ..SOUND
            },
            // The driver's clock is set back, while its current stays constant.
            Scenario {
                settings: driver,
                edit: |k, feed| {
                    change(feed, is_drive, |_| 1.2);
                    if k > 500 {
                        shift(&mut feed[..1], -10_000_000_000);
                    }
                },
                ..SOUND
            },
        ),
        (
            Reasons::NOT_PASSIVE,
            edited(|_, feed| change(feed, is_force, |f| -f)),
            edited(|_, feed| change(feed, is_force, |f| 0.7 * f + 120.0)),
        ),
    ]
}

fn force_ends(k: i64, feed: &mut Vec<Sample>) {
    if k > 420 {
        without(feed, is_force);
    }
}

fn after(silence_s: f64) -> Stamp {
    Stamp::from_nanos((LENGTH - 1) * PERIOD_NS + (silence_s * 1e9) as i64)
}

/// An ARX that predicts a constant force: its pole is one.
fn without_dc() -> Models {
    let none = [0.0; LAGS];
    let stays = Arx::new([1.0, 0.0, 0.0], none, none, None, Second(1.0 / 512.0), 0.0).expect("finite");
    let arx = Model { force: ForceModel::Arx(stays), ..preset(BEST_ARX) };
    Models::alone(preset(BEST_FUZZY_TANH)).with_seeded(arx).expect("it wants no drive")
}

#[test]
fn each_reason_is_given_in_its_case_and_not_in_a_similar_one() {
    for (reason, makes, must_not) in scenarios() {
        let name = reason.names().next().expect("one reason");
        let (said, _) = makes.run();
        assert!(said.has(reason), "{name} is missing: {:?}", said.names().collect::<Vec<_>>());
        let (said, _) = must_not.run();
        assert!(!said.has(reason), "{name} must not be given: {:?}", said.names().collect::<Vec<_>>());
    }
}

/// An envelope just wide enough for the thesis' motion.
const WIDE: Envelope = Envelope {
    displacement_m: Some([-0.01, 0.01]),
    velocity_m_s: Some([-0.135, 0.135]),
    drive: Some([0.4, 2.1]),
    case_temp_c: Some([20.0, 40.0]),
    force_n: Some([-950.0, 950.0]),
};

/// Both models with this training envelope.
fn trained(envelope: Envelope) -> Models {
    let fuzzy = Model { envelope, ..preset(BEST_FUZZY_TANH) };
    Models::alone(fuzzy).with_seeded(Model { envelope, ..preset(BEST_ARX) }).expect("both want a current")
}

/// Each range of the training envelope in turn: once just wide enough for the thesis' motion, once too narrow.
#[test]
fn leaving_the_training_envelope_is_extrapolating() {
    type Trained = (&'static str, fn() -> Models);
    let narrow: [Trained; 5] = [
        ("none", || trained(WIDE)),
        ("displacement", || trained(Envelope { displacement_m: Some([-0.01, 0.008]), ..WIDE })),
        ("velocity", || trained(Envelope { velocity_m_s: Some([-0.1, 0.135]), ..WIDE })),
        ("drive", || trained(Envelope { drive: Some([0.8, 2.1]), ..WIDE })),
        ("force", || trained(Envelope { force_n: Some([-950.0, 500.0]), ..WIDE })),
    ];
    for (what, models) in narrow {
        for (by_arx, edit) in [(true, (|_, _| {}) as Edit), (false, |_, feed| without(feed, is_force))] {
            let (said, _) = Scenario { models, edit, ..SOUND }.run();
            assert_eq!(said.has(Reasons::OUTSIDE_ENVELOPE), what != "none", "{what}, ARX {by_arx}: {said:?}");
        }
    }
    let warm: fn() -> Models = || {
        let mut models = fading();
        models.free.envelope = Envelope { case_temp_c: Some([20.0, 25.0]), ..Envelope::default() };
        models
    };
    let at = |edit: Edit| Scenario { models: warm, edit, ..SOUND }.run().0;
    let said = at(|_, feed| put(feed, Reading::CaseTemperature(Celsius(30.0))));
    assert!(said.has(Reasons::OUTSIDE_ENVELOPE));
    let said = at(|_, feed| put(feed, Reading::CaseTemperature(Celsius(22.0))));
    assert_eq!(said, Reasons::NONE);
}

/// The low-pass on the output still contains earlier model forces.
#[test]
fn a_filtered_force_beyond_the_training_is_flagged_until_it_is_back() {
    let range = Some([-300.0, 300.0]);
    let mut model = preset(BEST_FUZZY_TANH);
    model.envelope = Envelope { force_n: range, ..Envelope::default() };
    model.conditioning.apply_to = ApplyTo::Output;
    let mut harness = Harness::of(Models::alone(model), Settings::default());
    harness.run(0..2000, |_| false);
    let beyond: Vec<_> = harness.estimates().filter(|e| Envelope::leaves(range, e.force.get())).collect();
    assert!(beyond.len() > 100, "the motion leaves the range");
    assert!(beyond.iter().all(|e| e.reasons.has(Reasons::OUTSIDE_ENVELOPE)));
}

#[test]
fn every_reason_has_a_case() {
    // OUTSIDE_ENVELOPE has its own test.
    let covered = scenarios().into_iter().fold(Reasons::OUTSIDE_ENVELOPE, |mut all, (reason, _, _)| {
        all |= reason;
        all
    });
    let all = Reasons::ALL.iter().fold(0, |all, (reason, _)| all | reason.0);
    assert_eq!(covered.0, all);
}

#[test]
fn a_healthy_damper_is_valid() {
    let (said, mode) = SOUND.run();
    assert_eq!((said, mode), (Reasons::NONE, Mode::Arx));
    let measured = Scenario {
        models: || {
            let mut model = preset(BEST_FUZZY_TANH);
            model.conditioning.velocity = VelocitySource::Measured;
            Models::alone(model)
        },
        edit: |k, feed| put(feed, Reading::Velocity(MetrePerSecond(velocity_m_s(k, 0.0)))),
        ..SOUND
    };
    assert_eq!(measured.run(), (Reasons::NONE, Mode::Model));
}

#[test]
fn implausible_measured_force_does_not_seed_the_arx() {
    for edit in [(|_, feed| change(feed, is_force, |f| -f)) as Edit, |k, feed| {
        if k > 300 {
            change(feed, is_force, |_| 350.0);
        }
    }] {
        let (_, mode) = Scenario { edit, ..SOUND }.run();
        assert_eq!(mode, Mode::Model);
    }
}
