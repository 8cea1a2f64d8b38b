//! Measuring instruments worse than the rig's, for cases without an effect.
//!
//! The rig logs each channel with 16 bit at 512 Hz, with exact stamps. [`Instrument::apply`] turns such a run into one of a worse
//! instrument. The truth stays as it is, so a name that an instrument causes is a wrong name.

use mr_damper_model::sample::{Run, Stamp, Trace};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Measuring instrument of the runs of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Instrument {
    /// The rig's channels.
    Fine,
    /// Converters of 12 bit, for 50 mm, 10 kN and 5 A.
    TwelveBit,
    /// 200 samples a second.
    Slow,
    /// Stamps that are off by up to 0.5 ms, a quarter of the period.
    Jitter,
    /// 2 % of the samples are missing.
    Lossy,
    /// The rig's channels, but the current never changes.
    OneCurrent,
}

impl Instrument {
    pub(crate) const WORSE: [Self; 5] =
        [Self::TwelveBit, Self::Slow, Self::Jitter, Self::Lossy, Self::OneCurrent];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Fine => "16 bit, 512 Hz",
            Self::TwelveBit => "12 bit",
            Self::Slow => "200 Hz",
            Self::Jitter => "jitter",
            Self::Lossy => "lost samples",
            Self::OneCurrent => "one current",
        }
    }

    /// `run` as this instrument logs it.
    pub(crate) fn apply(self, run: Run, seed: u64) -> Run {
        let mut rng = Pcg64Mcg::seed_from_u64(seed ^ 0x5eed);
        match self {
            Self::Fine | Self::OneCurrent => run,
            Self::TwelveBit => {
                let coarse = |trace: Trace, full_scale: f64| {
                    let step = full_scale / 4096.0;
                    let values = trace.values.iter().map(|value| (value / step).round() * step).collect();
                    Trace { values, ..trace }
                };
                Run {
                    displacement_m: coarse(run.displacement_m, 0.05),
                    force_n: run.force_n.map(|trace| coarse(trace, 10_000.0)),
                    drive: run.drive.map(|(kind, trace)| (kind, coarse(trace, 5.0))),
                    ..run
                }
            }
            Self::Slow => each(run, |trace| at_rate(&trace, 200.0)),
            Self::Jitter => {
                let offsets_s: Vec<f64> =
                    run.displacement_m.stamps.iter().map(|_| rng.random_range(-5e-4..5e-4)).collect();
                each(run, |trace| {
                    let late = |(stamp, off_s): (&Stamp, &f64)| later(*stamp, *off_s);
                    Trace { stamps: trace.stamps.iter().zip(&offsets_s).map(late).collect(), ..trace }
                })
            }
            Self::Lossy => {
                let kept: Vec<bool> =
                    run.displacement_m.stamps.iter().map(|_| rng.random_bool(0.98)).collect();
                each(run, |trace| {
                    let rows = trace.stamps.iter().zip(&trace.values).zip(&kept).filter(|(_, kept)| **kept);
                    let (stamps, values) = rows.map(|((stamp, value), _)| (*stamp, *value)).unzip();
                    Trace { stamps, values }
                })
            }
        }
    }
}

/// `run` with `change` applied to each channel that has the stamps of the displacement: all but the slow case temperature.
fn each(run: Run, change: impl Fn(Trace) -> Trace) -> Run {
    Run {
        displacement_m: change(run.displacement_m),
        velocity_m_s: run.velocity_m_s.map(&change),
        force_n: run.force_n.map(&change),
        drive: run.drive.map(|(kind, trace)| (kind, change(trace))),
        ..run
    }
}

fn later(stamp: Stamp, by_s: f64) -> Stamp {
    stamp.shifted((1e9 * by_s).round() as i64)
}

/// `trace` at another rate, linear between its samples.
fn at_rate(trace: &Trace, rate_hz: f64) -> Trace {
    let seconds: Vec<f64> = trace.stamps.iter().map(|stamp| stamp.since(trace.stamps[0]).get()).collect();
    let count = (seconds.last().copied().unwrap_or(0.0) * rate_hz) as usize;
    let value = |k: usize| {
        let at_s = k as f64 / rate_hz;
        let next = seconds.partition_point(|s| *s < at_s).clamp(1, seconds.len() - 1);
        let share = (at_s - seconds[next - 1]) / (seconds[next] - seconds[next - 1]);
        (1.0 - share) * trace.values[next - 1] + share * trace.values[next]
    };
    Trace {
        stamps: (0..count).map(|k| later(trace.stamps[0], k as f64 / rate_hz)).collect(),
        values: (0..count).map(value).collect(),
    }
}
