use super::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;
use std::fmt::Write;

/// Sample rate of the noise, Hz.
const RATE: i64 = 100;

/// A detector that gets samples at [`RATE`]: residuals as ratios to the expected RMSE.
struct Fed {
    alarm: Alarm,
    settings: Settings,
    k: i64,
}

impl Fed {
    fn new(settings: Settings) -> Self {
        Self { alarm: Alarm::default(), settings, k: 0 }
    }

    fn add(&mut self, normalised: f64) -> Option<Edge> {
        let stamp = Stamp::from_nanos(self.k * 1_000_000_000 / RATE);
        self.k += 1;
        self.alarm.add(stamp, normalised, &self.settings)
    }

    fn seconds(&self) -> f64 {
        self.k as f64 / RATE as f64
    }
}

fn gauss(random: &mut Pcg64Mcg) -> f64 {
    let (a, b): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
}

/// Residuals of unit power.
#[derive(Debug, Clone, Copy)]
enum Noise {
    White,
    /// Student's t with 4 degrees of freedom: its fourth moment is infinite.
    HeavyTails,
    /// One sample in 200 holds all the power: many blocks have none, some have four times the mean power.
    Clicks,
    /// First order with a time constant of 0.1 s.
    Coloured,
}

struct Source {
    noise: Noise,
    random: Pcg64Mcg,
    last: f64,
}

impl Source {
    fn new(noise: Noise, seed: u64) -> Self {
        Self { noise, random: Pcg64Mcg::seed_from_u64(seed), last: 0.0 }
    }

    fn next(&mut self) -> f64 {
        let white = gauss(&mut self.random);
        match self.noise {
            Noise::White => white,
            Noise::HeavyTails => {
                let chi: f64 = (0..4).map(|_| gauss(&mut self.random).powi(2)).sum();
                // Variance 2 with 4 degrees of freedom.
                white / (chi / 4.0).sqrt() / 2.0_f64.sqrt()
            }
            Noise::Clicks if self.random.random::<f64>() < 0.005 => white * 200.0_f64.sqrt(),
            Noise::Clicks => 0.0,
            Noise::Coloured => {
                let keep = (-10.0 / RATE as f64).exp();
                self.last = keep * self.last + (1.0 - keep * keep).sqrt() * white;
                self.last
            }
        }
    }
}

/// A script of powers per block, and the alarm's reaction: it rises late or soon, falls, and restarts.
#[test]
fn a_script_as_text() {
    let settings = Settings { alarm_ratio: 1.5, false_alarm_interval_s: 1000.0, ..Settings::default() };
    let mut fed = Fed::new(settings);
    let mut text = String::new();
    let script = [
        ("as expected", 1.0, 10.0),
        ("at the bound", 1.5, 10.0),
        ("twice the expected", 2.0, 15.0),
        ("as expected for less than ten blocks", 1.0, 4.0),
        ("twice again", 2.0, 2.0),
        ("as expected", 1.0, 7.0),
        ("ten times", 10.0, 5.0),
        ("as expected", 1.0, 7.0),
        ("expectation unknown", f64::NAN, 5.0),
    ];
    for (what, normalised, seconds) in script {
        let begin = fed.seconds();
        writeln!(text, "{begin:4.1} s  {what}").expect("a text");
        while fed.seconds() < begin + seconds - 1e-9 {
            let at = fed.seconds();
            if let Some(edge) = fed.add(normalised) {
                writeln!(text, "           {edge:?} at {at:4.1} s, after {:.1} s", at - begin)
                    .expect("a text");
            }
        }
    }
    insta::assert_snapshot!(text, @"
     0.0 s  as expected
    10.0 s  at the bound
    20.0 s  twice the expected
               Rising at 25.5 s, after 5.5 s
    35.0 s  as expected for less than ten blocks
    39.0 s  twice again
    41.0 s  as expected
               Falling at 46.0 s, after 5.0 s
    48.0 s  ten times
               Rising at 49.5 s, after 1.5 s
    53.0 s  as expected
               Falling at 58.0 s, after 5.0 s
    60.0 s  expectation unknown
    ");
}

#[test]
fn a_restart_clears_the_evidence_and_returns_whether_the_alarm_was_raised() {
    let mut fed = Fed::new(Settings { false_alarm_interval_s: 1000.0, ..Settings::default() });
    let until_raised = |fed: &mut Fed| (0..).find(|_| fed.add(3.0).is_some()).expect("it rises");
    let first = until_raised(&mut fed);
    assert!(fed.alarm.restart() && !fed.alarm.is_raised());
    assert!(!fed.alarm.restart());
    // Before the restart, the sample that raised the alarm had begun a block. After the restart, no block is open.
    assert_eq!(until_raised(&mut fed), first, "the detector restarts from zero evidence");
}

/// At the very bound, where an alarm is not due yet, with an interval that is short enough to be tested.
#[test]
fn false_alarms_are_not_more_frequent_than_stated() {
    let interval_s = 500.0;
    let (intervals, mut most, mut table) = (60.0, 0.0_f64, String::new());
    // Noise that is correlated from block to block breaks the assumption at the bound, so its level is a tenth below.
    for (noise, level) in [
        (Noise::White, 1.5),
        (Noise::HeavyTails, 1.5),
        (Noise::Clicks, 1.5),
        (Noise::Coloured, 1.35),
        (Noise::Coloured, 1.0),
    ] {
        let mut fed = Fed::new(Settings { false_alarm_interval_s: interval_s, ..Settings::default() });
        let mut source = Source::new(noise, 11);
        let mut alarms = 0.0;
        while fed.seconds() < intervals * interval_s {
            if fed.add(level * source.next()) == Some(Edge::Rising) {
                alarms += 1.0;
                // The bound is on the time to an alarm, so the detector is reset after each.
                fed.alarm.restart();
            }
        }
        writeln!(table, "{noise:?} at {level}: {alarms} in {intervals} intervals").expect("a text");
        most = most.max(alarms);
    }
    println!("{table}");
    assert!(most <= intervals, "{table}");
}

/// With the default settings there is at most one false alarm per day, and a residual of twice the expected one is
/// detected in half a minute.
#[test]
fn a_residual_of_twice_the_expected_one_is_detected() {
    for noise in [Noise::White, Noise::HeavyTails, Noise::Coloured] {
        let mut worst_s = 0.0_f64;
        for seed in 0..100 {
            let mut fed = Fed::new(Settings::default());
            let mut source = Source::new(noise, seed);
            while fed.seconds() < 60.0 {
                assert_eq!(fed.add(source.next()), None, "{noise:?}, seed {seed}: false alarm");
            }
            while fed.add(2.0 * source.next()) != Some(Edge::Rising) {
                assert!(fed.seconds() < 120.0, "{noise:?}, seed {seed}: not detected in a minute");
            }
            worst_s = worst_s.max(fed.seconds() - 60.0);
        }
        println!("{noise:?}: detected after {worst_s:.1} s at most");
        assert!(
            worst_s < if matches!(noise, Noise::Coloured) { 45.0 } else { 30.0 },
            "{noise:?}: {worst_s} s"
        );
    }
}
