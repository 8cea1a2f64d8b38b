//! A damper with jittering stamps and lost samples, and the result of the pipeline on its samples.

#![allow(dead_code, reason = "each binary uses a part of it")]

use mr_damper_model::condition::Conditioning;
use mr_damper_model::identify::{ModelSpec, Options, Watch, identify};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{Estimate, Event, Models, Pipeline, Settings, Validity};
use mr_damper_model::preset;
use mr_damper_model::sample::{Drive, DriveKind, Reading, Run, Sample, Stamp, Trace};
use mr_damper_model::units::{Ampere, Metre, Newton};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Length of a run, s.
pub(crate) const DURATION_S: f64 = 6.0;
/// Part at the start of a run that is not compared, s.
const SKIPPED_S: f64 = 0.5;

/// Distribution of the delays from sampling to stamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Jitter {
    None,
    /// Uniform within plus and minus this number of periods.
    Uniform(f64),
    /// Normal, with a standard deviation of this number of periods.
    Normal(f64),
    /// Exponential with a mean of this number of periods; once in two seconds a sample is 5 to 20 ms late, and the samples after it catch
    /// up.
    Publisher(f64),
}

/// Time at which a reading was taken, relative to its stamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Truth {
    /// The reading was taken on time; only its stamp is wrong.
    ReadOnTime,
    /// The reading was taken at the time of its stamp.
    ReadAtStamp,
}

/// The samples that do not arrive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Loss {
    /// This share of each channel, independently.
    Each(f64),
    /// This share of the instants, with all channels.
    All(f64),
    /// This share of one channel: 0 drive, 1 force, 2 displacement.
    One(usize, f64),
    /// This number of consecutive samples of each channel, twice a second.
    Bursts(u32),
}

/// The current. Steps cannot be predicted by a model; they cause most of the error with clean stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Current {
    Steps,
    Sine,
}

/// One line of the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Case {
    pub(crate) rate_hz: f64,
    pub(crate) current: Current,
    pub(crate) jitter: Jitter,
    pub(crate) truth: Truth,
    /// All channels have the same stamps.
    pub(crate) shared: bool,
    pub(crate) loss: Loss,
    /// True if samples arrive in the order of their stamps; otherwise in the order in which they were taken.
    pub(crate) by_stamp: bool,
    pub(crate) seed: u64,
}

impl Case {
    pub(crate) const CLEAN: Self = Self {
        rate_hz: 512.0,
        current: Current::Sine,
        jitter: Jitter::None,
        truth: Truth::ReadOnTime,
        shared: true,
        loss: Loss::Each(0.0),
        by_stamp: true,
        seed: 1,
    };
}

/// The result of a case.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Outcome {
    /// Changes of mode after the first time in `arx`.
    pub(crate) changes: usize,
    pub(crate) rms_n: f64,
    /// Largest error, N.
    pub(crate) worst_n: f64,
    /// Share of estimates that are VALID.
    pub(crate) valid: f64,
    /// Root mean squared error of the VALID estimates, N.
    pub(crate) valid_rms_n: f64,
}

/// Half width of the uniform noise of the load cell, N.
const FORCE_NOISE_N: f64 = 3.0;
/// Half width of the uniform noise of the displacement sensor, m.
const DISPLACEMENT_NOISE_M: f64 = 2e-6;

fn motion(t: f64, current: Current) -> (f64, f64, f64) {
    let x = 0.008 * (9.0 * t).sin() + 0.002 * (31.0 * t).sin();
    let v = 0.072 * (9.0 * t).cos() + 0.062 * (31.0 * t).cos();
    let i = match current {
        Current::Steps => [0.4, 1.2, 2.1, 0.8][(t.max(0.0) / 0.2) as usize % 4],
        Current::Sine => 1.2 + 0.8 * (5.0 * t).sin(),
    };
    (x, v, i)
}

/// The force at time `t`, N; the same as in `tests/common`.
fn force_n(t: f64, current: Current) -> f64 {
    let (x, v, i) = motion(t, current);
    (150.0 + 300.0 * i) * (12.0 * (v - 2.0 * x)).tanh() + 700.0 * v
}

/// The models at `rate_hz`: the thesis' models at 512 Hz (and 500 Hz); at other rates the ARX is identified on a run without jitter.
pub(crate) fn models(rate_hz: f64, current: Current, conditioning: Conditioning) -> Models {
    let load = |name| preset::load(name).expect("a known preset");
    let free = load(preset::BEST_FUZZY_TANH);
    let thesis = conditioning == Conditioning::THESIS && (rate_hz - 512.0).abs() < 20.0;
    let arx = if thesis { load(preset::BEST_ARX) } else { identified(rate_hz, current, conditioning) };
    Models::alone(free).with_seeded(arx).expect("both want a current")
}

fn identified(rate_hz: f64, current: Current, conditioning: Conditioning) -> Model {
    let mut noise = Pcg64Mcg::seed_from_u64(7);
    let mut noisy = |value: f64, half: f64| value + half * (2.0 * noise.random::<f64>() - 1.0);
    let mut made: [Trace; 3] = Default::default();
    for k in 0..(20.0 * rate_hz) as i64 {
        let t = k as f64 / rate_hz;
        let (x, _, i) = motion(t, current);
        let values = [noisy(x, DISPLACEMENT_NOISE_M), i, noisy(force_n(t, current), FORCE_NOISE_N)];
        for (trace, value) in made.iter_mut().zip(values) {
            trace.stamps.push(Stamp::from_nanos((t * 1e9).round() as i64));
            trace.values.push(value);
        }
    }
    let [displacement_m, drive, force] = made;
    let run = Run {
        name: "clean".to_owned(),
        displacement_m,
        drive: Some((DriveKind::CoilCurrent, drive)),
        force_n: Some(force),
        ..Run::default()
    };
    let options = Options { conditioning, ..Options::default() };
    identify(ModelSpec::ARX_SEMI_ACTIVE, &[run], &options, &Watch::none()).expect("identifies").model
}

/// Delays of one channel, s.
struct Delays {
    random: Pcg64Mcg,
    jitter: Jitter,
    period_s: f64,
    /// Time until which the publisher is stalled, s.
    stands_s: f64,
}

impl Delays {
    /// The stamp of the sample taken at `t`, s.
    fn stamp_s(&mut self, t: f64) -> f64 {
        let p = self.period_s;
        let uniform = |random: &mut Pcg64Mcg| random.random::<f64>();
        match self.jitter {
            Jitter::None => t,
            Jitter::Uniform(share) => t + share * p * (2.0 * uniform(&mut self.random) - 1.0),
            Jitter::Normal(share) => {
                let (a, b) = (1.0 - uniform(&mut self.random), uniform(&mut self.random));
                t + share * p * (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
            }
            Jitter::Publisher(share) => {
                if uniform(&mut self.random) < 0.5 * p {
                    self.stands_s = t + 5e-3 + 15e-3 * uniform(&mut self.random);
                }
                let late = t - share * p * (1.0 - uniform(&mut self.random)).ln();
                let stamp = late.max(self.stands_s);
                // The samples that waited follow at 50 us each.
                self.stands_s = self.stands_s.max(stamp + 50e-6);
                stamp
            }
        }
    }
}

struct Losses {
    random: Pcg64Mcg,
    loss: Loss,
    rate_hz: f64,
}

impl Losses {
    fn lost(&mut self, k: i64) -> [bool; 3] {
        let mut below = |share: f64| self.random.random::<f64>() < share;
        match self.loss {
            Loss::Each(share) => [below(share), below(share), below(share)],
            Loss::All(share) => [below(share); 3],
            Loss::One(which, share) => {
                let mut lost = [false; 3];
                lost[which] = below(share);
                lost
            }
            Loss::Bursts(count) => {
                let every = (self.rate_hz / 2.0) as i64;
                [[0, 1, 2].map(|channel| (k + channel * every / 5) % every < i64::from(count) && k > every)]
                    .concat()
                    .try_into()
                    .expect("three")
            }
        }
    }
}

/// The samples of `case` in their order of arrival, each with the true force at the time when it was taken.
pub(crate) fn samples(case: &Case) -> Vec<(Sample, f64)> {
    let period_s = 1.0 / case.rate_hz;
    let seeded = |salt: u64| Pcg64Mcg::seed_from_u64(case.seed.wrapping_mul(1000) + salt);
    let mut delays =
        [0, 1, 2].map(|c| Delays { random: seeded(c), jitter: case.jitter, period_s, stands_s: f64::MIN });
    let mut losses = Losses { random: seeded(9), loss: case.loss, rate_hz: case.rate_hz };
    let mut noise = seeded(8);
    let mut made = Vec::new();
    for k in 0..(DURATION_S * case.rate_hz) as i64 {
        let t = 1.0 + k as f64 * period_s;
        let lost = losses.lost(k);
        let first = delays[0].stamp_s(t);
        let stamps = [first, delays[1].stamp_s(t), delays[2].stamp_s(t)];
        let stamps = if case.shared { [first; 3] } else { stamps };
        for channel in 0..3 {
            let stamp_s = stamps[channel];
            let taken_s = if case.truth == Truth::ReadOnTime { t } else { stamp_s };
            let (x, _, i) = motion(taken_s, case.current);
            let noise = 2.0 * noise.random::<f64>() - 1.0;
            let truth_n = force_n(taken_s, case.current);
            let reading = match channel {
                0 => Reading::Drive(Drive::CoilCurrent(Ampere(i))),
                1 => Reading::Force(Newton(truth_n + FORCE_NOISE_N * noise)),
                _ => Reading::Displacement(Metre(x + DISPLACEMENT_NOISE_M * noise)),
            };
            let stamp = Stamp::from_nanos((stamp_s * 1e9).round() as i64);
            if !lost[channel] {
                made.push((Sample { stamp, received: stamp, reading }, truth_n));
            }
        }
    }
    if case.by_stamp {
        made.sort_by_key(|(sample, _)| (sample.stamp, sample.reading.channel()));
    }
    made
}

/// Runs the pipeline on `samples`. Errors count from [`SKIPPED_S`] on.
pub(crate) fn outcome(models: Models, settings: Settings, samples: &[(Sample, f64)]) -> Outcome {
    let mut pipeline = Pipeline::new(models, settings).expect("the models run");
    let from = samples[0].0.stamp.shifted((SKIPPED_S * 1e9) as i64);
    let mut changes = 0;
    let mut errors: Vec<(f64, bool)> = Vec::new();
    for (sample, truth_n) in samples {
        pipeline.step(sample, &mut |event| match event {
            Event::Transition(t) if t.stamp >= from => changes += 1,
            Event::Estimate(e) if e.stamp >= from => errors.push(error_and_coverage(&e, *truth_n)),
            _ => {}
        });
    }
    let rms = |errors: &mut dyn Iterator<Item = f64>| {
        let (sum, n) = errors.fold((0.0, 0.0), |(sum, n), e| (sum + e * e, n + 1.0));
        f64::sqrt(sum / n)
    };
    Outcome {
        changes,
        rms_n: rms(&mut errors.iter().map(|(e, _)| *e)),
        worst_n: errors.iter().fold(0.0, |worst, (e, _)| e.abs().max(worst)),
        valid: errors.iter().filter(|(_, valid)| *valid).count() as f64 / errors.len() as f64,
        valid_rms_n: rms(&mut errors.iter().filter(|(_, valid)| *valid).map(|(e, _)| *e)),
    }
}

fn error_and_coverage(estimate: &Estimate, truth_n: f64) -> (f64, bool) {
    (estimate.force.get() - truth_n, estimate.validity == Validity::Valid)
}
