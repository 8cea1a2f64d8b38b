//! Input data of the crate: stamps, samples of one channel, and recorded runs.
//!
//! A damper has several channels (displacement, drive, force, ...), each with its own rate and its own
//! stamps. A [`Sample`] is one reading of one channel; a [`Run`] is a recording of all channels. Live topics
//! and a replayed run deliver the same samples in the same order.

use crate::units::{Ampere, Celsius, Metre, MetrePerSecond, Newton, Second, Volt};
use serde::{Deserialize, Serialize};

/// Ratio of a step to the mean step above which it is a gap.
const GAP: f64 = 10.0;

/// A time stamp in whole nanoseconds since an epoch that the source defines.
///
/// Computations use only differences of stamps, so results do not depend on the epoch.
///
/// ```
/// use mr_damper_model::sample::Stamp;
///
/// let first = Stamp::from_nanos(1_700_000_000_000_000_000);
/// let second = first.shifted(1_953_125); // one sample at 512 Hz
/// assert!((second.since(first).get() - 1.0 / 512.0).abs() < 1e-15);
/// assert!(first < second && first.since(second).get() < 0.0);
/// assert_eq!(Stamp::from_seconds(f64::NAN), None);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Stamp(i64);

impl Stamp {
    /// A stamp from nanoseconds since the epoch.
    #[must_use]
    pub const fn from_nanos(nanos: i64) -> Self {
        Self(nanos)
    }

    /// A stamp from seconds since the epoch, rounded to the nearest nanosecond. `None` when `seconds` is not
    /// finite or does not fit 64-bit nanoseconds (about 292 years).
    #[must_use]
    pub fn from_seconds(seconds: f64) -> Option<Self> {
        let nanos = (seconds * 1e9).round();
        (nanos.abs() < 9.2e18).then_some(Self(nanos as i64))
    }

    /// Nanoseconds since the epoch.
    #[must_use]
    pub const fn nanos(self) -> i64 {
        self.0
    }

    /// Time from `earlier` to `self`, in seconds; negative when `self` is earlier.
    #[inline]
    #[must_use]
    pub fn since(self, earlier: Self) -> Second {
        Second(self.0.wrapping_sub(earlier.0) as f64 * 1e-9)
    }

    /// This stamp plus `nanos` nanoseconds, saturating at the ends of the range.
    #[must_use]
    pub const fn shifted(self, nanos: i64) -> Self {
        Self(self.0.saturating_add(nanos))
    }
}

/// The recorded input of the damper's coil: a measured (or commanded) current, or a command voltage.
///
/// A model that was identified on one kind refuses the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum DriveKind {
    /// Coil current in amperes (`current_a`).
    #[serde(rename = "current_a")]
    CoilCurrent,
    /// Command voltage in volts (`command_v`).
    #[serde(rename = "command_v")]
    CommandVoltage,
}

impl DriveKind {
    /// The column and parameter name: `current_a` or `command_v`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::CoilCurrent => "current_a",
            Self::CommandVoltage => "command_v",
        }
    }

    /// The kind in words: `coil current` or `command voltage`.
    #[must_use]
    pub const fn in_words(self) -> &'static str {
        match self {
            Self::CoilCurrent => "coil current",
            Self::CommandVoltage => "command voltage",
        }
    }

    /// The unit suffix of names: `a` or `v`.
    #[must_use]
    pub const fn unit_suffix(self) -> &'static str {
        match self {
            Self::CoilCurrent => "a",
            Self::CommandVoltage => "v",
        }
    }

    /// The symbol of its unit: `A` or `V`.
    #[must_use]
    pub const fn unit(self) -> &'static str {
        match self {
            Self::CoilCurrent => "A",
            Self::CommandVoltage => "V",
        }
    }
}

impl std::fmt::Display for DriveKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// One reading of the drive, with its kind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Drive {
    /// A coil current.
    CoilCurrent(Ampere),
    /// A command voltage.
    CommandVoltage(Volt),
}

impl Drive {
    /// The kind of this drive.
    #[must_use]
    pub const fn kind(self) -> DriveKind {
        match self {
            Self::CoilCurrent(_) => DriveKind::CoilCurrent,
            Self::CommandVoltage(_) => DriveKind::CommandVoltage,
        }
    }

    /// The number in the unit of its kind.
    #[must_use]
    pub const fn get(self) -> f64 {
        match self {
            Self::CoilCurrent(a) => a.0,
            Self::CommandVoltage(v) => v.0,
        }
    }

    /// A drive of the given kind.
    #[must_use]
    pub const fn new(kind: DriveKind, value: f64) -> Self {
        match kind {
            DriveKind::CoilCurrent => Self::CoilCurrent(Ampere(value)),
            DriveKind::CommandVoltage => Self::CommandVoltage(Volt(value)),
        }
    }
}

/// The value that a sample carries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reading {
    /// Damper displacement, positive in extension.
    Displacement(Metre),
    /// Measured damper velocity, positive in extension; only models with measured velocity use it.
    Velocity(MetrePerSecond),
    /// Coil current or command voltage.
    Drive(Drive),
    /// Measured rod force, positive in tension.
    Force(Newton),
    /// Temperature of the damper's case.
    CaseTemperature(Celsius),
    /// Velocity of the body above the damper, positive upwards.
    BodyVelocity(MetrePerSecond),
    /// Demanded force, positive in tension.
    ForceRequest(Newton),
}

impl Reading {
    /// The channel of this reading.
    #[must_use]
    pub const fn channel(self) -> Channel {
        match self {
            Self::Displacement(_) => Channel::Displacement,
            Self::Velocity(_) => Channel::Velocity,
            Self::Drive(_) => Channel::Drive,
            Self::Force(_) => Channel::Force,
            Self::CaseTemperature(_) => Channel::CaseTemperature,
            Self::BodyVelocity(_) => Channel::BodyVelocity,
            Self::ForceRequest(_) => Channel::ForceRequest,
        }
    }

    /// The number in SI units.
    #[must_use]
    pub const fn get(self) -> f64 {
        match self {
            Self::Displacement(x) => x.0,
            Self::Velocity(v) | Self::BodyVelocity(v) => v.0,
            Self::Drive(d) => d.get(),
            Self::Force(f) | Self::ForceRequest(f) => f.0,
            Self::CaseTemperature(t) => t.0,
        }
    }
}

/// The channels, in the order in which samples with equal stamps enter the pipeline. Displacement is last: it
/// triggers the estimate, which needs the other readings of that stamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Channel {
    /// Case temperature.
    CaseTemperature,
    /// Coil current or command voltage.
    Drive,
    /// Measured velocity.
    Velocity,
    /// Measured force.
    Force,
    /// Velocity of the body.
    BodyVelocity,
    /// Demanded force.
    ForceRequest,
    /// Displacement.
    Displacement,
}

impl Channel {
    /// All channels, in the order of processing.
    pub const ALL: [Self; 7] = [
        Self::CaseTemperature,
        Self::Drive,
        Self::Velocity,
        Self::Force,
        Self::BodyVelocity,
        Self::ForceRequest,
        Self::Displacement,
    ];

    /// The channel's name in topics and messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::CaseTemperature => "case_temperature",
            Self::Drive => "drive",
            Self::Velocity => "velocity",
            Self::Force => "measured_force",
            Self::BodyVelocity => "body_velocity",
            Self::ForceRequest => "force_request",
            Self::Displacement => "displacement",
        }
    }
}

/// One reading of one channel.
///
/// ```
/// use mr_damper_model::sample::{Channel, Drive, DriveKind, Reading, Sample, Stamp};
/// use mr_damper_model::units::Metre;
///
/// let stamp = Stamp::from_nanos(0);
/// let at = |reading| Sample { stamp, received: stamp, reading };
/// let current = Drive::new(DriveKind::CoilCurrent, 1.2); // A
/// let mut samples = [at(Reading::Displacement(Metre(0.01))), at(Reading::Drive(current))];
///
/// // Samples with equal stamps enter the pipeline in the order of their channels: displacement is last.
/// samples.sort_by_key(|sample| sample.reading.channel());
/// assert_eq!(samples.map(|sample| sample.reading.channel()), [Channel::Drive, Channel::Displacement]);
/// assert_eq!((samples[0].reading.get(), current.kind().name()), (1.2, "current_a"));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// When the reading was taken, by the source's stamp.
    pub stamp: Stamp,
    /// When the reading arrived, on the same clock as the stamps. Equal to `stamp` for a recorded run without
    /// arrival times.
    pub received: Stamp,
    /// The reading.
    pub reading: Reading,
}

/// One recorded channel: values with their own stamps, in time order.
///
/// ```
/// use mr_damper_model::sample::{Stamp, Trace};
///
/// let at_ms = |ms: i64| Stamp::from_nanos(ms * 1_000_000);
/// let trace = Trace { stamps: [0, 5, 10, 15].map(at_ms).to_vec(), values: vec![0.0, 1.0, 2.0, 3.0] };
/// assert_eq!(trace.mean_rate_hz(), Some(200.0));
/// assert_eq!(trace.between(at_ms(5), at_ms(15)).values, [1.0, 2.0]);
/// // A gap of a second does not change the rate.
/// let stamps: Vec<Stamp> = (0..40).map(|k| at_ms(5 * k + if k < 20 { 0 } else { 1000 })).collect();
/// let with_gap = Trace { values: vec![0.0; stamps.len()], stamps };
/// assert_eq!(with_gap.mean_rate_hz(), Some(200.0));
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Trace {
    /// Stamps, strictly increasing.
    pub stamps: Vec<Stamp>,
    /// Values in SI units, one for each stamp.
    pub values: Vec<f64>,
}

impl Trace {
    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.stamps.len()
    }

    /// True when the trace has no samples.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.stamps.is_empty()
    }

    /// The samples from `from` (included) to `to` (excluded).
    #[must_use]
    pub fn between(&self, from: Stamp, to: Stamp) -> Self {
        let at = |limit: Stamp| self.stamps.partition_point(|stamp| *stamp < limit);
        let range = at(from)..at(to).max(at(from));
        Self { stamps: self.stamps[range.clone()].to_vec(), values: self.values[range].to_vec() }
    }

    /// Mean sample rate of the trace between its gaps, in hertz; `None` with fewer than two samples. A gap is a step of more than ten times the
    /// mean.
    #[must_use]
    pub fn mean_rate_hz(&self) -> Option<f64> {
        // Computed in whole nanoseconds, so that 200 Hz is exactly 200.0.
        let mut span_ns = self.stamps.last()?.nanos().saturating_sub(self.stamps.first()?.nanos());
        let mut steps = self.len() - 1;
        let step_ns = |pair: &[Stamp]| pair[1].nanos().saturating_sub(pair[0].nanos());
        // Without its longest gaps, the mean shows shorter ones.
        while steps > 0 && span_ns > 0 {
            let longest_ns = (GAP * span_ns as f64 / steps as f64) as i64;
            let kept = || self.stamps.windows(2).map(step_ns).filter(|step_ns| *step_ns <= longest_ns);
            let (count, sum_ns) = (kept().count(), kept().sum());
            if count == steps {
                return Some(steps as f64 * 1e9 / span_ns as f64);
            }
            (steps, span_ns) = (count, sum_ns);
        }
        None
    }
}

/// A recorded run: the measurements of each channel.
///
/// A run from numbers, and its samples in the order in which they are known:
///
/// ```
/// use mr_damper_model::sample::{Channel, DriveKind, Run, Stamp, Trace};
///
/// let trace = |values: &[f64], period_s: f64| Trace {
///     stamps: (0..values.len()).map(|k| Stamp::from_seconds(k as f64 * period_s).unwrap()).collect(),
///     values: values.to_vec(),
/// };
/// let run = Run {
///     name: "by hand".to_owned(),
///     displacement_m: trace(&[0.0, 1e-3, 2e-3], 0.002),
///     force_n: Some(trace(&[0.0, 80.0, 120.0], 0.002)),
///     drive: Some((DriveKind::CoilCurrent, trace(&[0.5], 0.002))),
///     ..Run::default()
/// };
/// assert_eq!(run.samples().count(), 7);
/// assert_eq!(run.samples().filter(|sample| sample.reading.channel() == Channel::Force).count(), 3);
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Run {
    /// Source of the run for messages and provenance: a path or a name.
    pub name: String,
    /// Damper displacement in metres. Every run has this channel.
    pub displacement_m: Trace,
    /// Measured velocity in m/s.
    pub velocity_m_s: Option<Trace>,
    /// The drive, in the unit of its kind.
    pub drive: Option<(DriveKind, Trace)>,
    /// Measured force in newtons.
    pub force_n: Option<Trace>,
    /// Case temperature in °C.
    pub case_temp_c: Option<Trace>,
    /// Velocity of the body above the damper in m/s.
    pub body_velocity_m_s: Option<Trace>,
    /// Demanded force in newtons.
    pub force_request_n: Option<Trace>,
    /// Columns that the pipeline does not use (ambient temperature, set point, unknown columns), by name with
    /// unit suffix. Conversions keep them.
    pub other: Vec<(String, Trace)>,
}

impl Run {
    /// The kind of drive that the run recorded.
    #[must_use]
    pub fn drive_kind(&self) -> Option<DriveKind> {
        self.drive.as_ref().map(|(kind, _)| *kind)
    }

    /// The samples of `channel`; `None` without it.
    ///
    /// ```
    /// use mr_damper_model::sample::{Channel, Run, Stamp, Trace};
    ///
    /// let force = Trace { stamps: vec![Stamp::from_nanos(7)], values: vec![450.0] };
    /// let run = Run { force_n: Some(force.clone()), ..Run::default() };
    /// assert_eq!(run.trace(Channel::Force), Some(&force));
    /// assert_eq!(run.trace(Channel::Drive), None);
    /// assert_eq!(run.span(), Some((Stamp::from_nanos(7), Stamp::from_nanos(7))));
    /// ```
    #[must_use]
    pub fn trace(&self, channel: Channel) -> Option<&Trace> {
        match channel {
            Channel::Displacement => Some(&self.displacement_m),
            Channel::Velocity => self.velocity_m_s.as_ref(),
            Channel::Drive => self.drive.as_ref().map(|(_, trace)| trace),
            Channel::Force => self.force_n.as_ref(),
            Channel::CaseTemperature => self.case_temp_c.as_ref(),
            Channel::BodyVelocity => self.body_velocity_m_s.as_ref(),
            Channel::ForceRequest => self.force_request_n.as_ref(),
        }
    }

    /// Stamps of the first and the last sample of all channels; `None` without a sample.
    #[must_use]
    pub fn span(&self) -> Option<(Stamp, Stamp)> {
        let stamps =
            || Channel::ALL.into_iter().filter_map(|channel| self.trace(channel)).map(|trace| &trace.stamps);
        let first = stamps().filter_map(|stamps| stamps.first()).min()?;
        let last = stamps().filter_map(|stamps| stamps.last()).max()?;
        Some((*first, *last))
    }

    /// Duration of the displacement channel, in seconds.
    #[must_use]
    pub fn duration(&self) -> Second {
        match (self.displacement_m.stamps.first(), self.displacement_m.stamps.last()) {
            (Some(first), Some(last)) => last.since(*first),
            _ => Second(0.0),
        }
    }

    /// The part of the run from `from` (included) to `to` (excluded), in every channel.
    #[must_use]
    pub fn between(&self, from: Stamp, to: Stamp) -> Self {
        let cut = |trace: &Trace| trace.between(from, to);
        Self {
            name: self.name.clone(),
            displacement_m: cut(&self.displacement_m),
            velocity_m_s: self.velocity_m_s.as_ref().map(cut),
            drive: self.drive.as_ref().map(|(kind, trace)| (*kind, cut(trace))),
            force_n: self.force_n.as_ref().map(cut),
            case_temp_c: self.case_temp_c.as_ref().map(cut),
            body_velocity_m_s: self.body_velocity_m_s.as_ref().map(cut),
            force_request_n: self.force_request_n.as_ref().map(cut),
            other: self.other.iter().map(|(name, trace)| (name.clone(), cut(trace))).collect(),
        }
    }

    /// All samples in the order in which the pipeline processes them: by stamp, and for equal stamps in the
    /// order of [`Channel::ALL`].
    pub fn samples<'a>(&'a self) -> impl Iterator<Item = Sample> + 'a {
        let mut cursors: Vec<Cursor<'a>> = Vec::with_capacity(Channel::ALL.len());
        let mut add = |trace: Option<&'a Trace>, make: fn(f64) -> Reading| {
            if let Some(trace) = trace {
                cursors.push(Cursor { make, stamps: &trace.stamps, values: &trace.values });
            }
        };
        add(self.case_temp_c.as_ref(), |t| Reading::CaseTemperature(Celsius(t)));
        match &self.drive {
            Some((DriveKind::CoilCurrent, trace)) => {
                add(Some(trace), |i| Reading::Drive(Drive::CoilCurrent(Ampere(i))));
            }
            Some((DriveKind::CommandVoltage, trace)) => {
                add(Some(trace), |u| Reading::Drive(Drive::CommandVoltage(Volt(u))));
            }
            None => {}
        }
        add(self.velocity_m_s.as_ref(), |v| Reading::Velocity(MetrePerSecond(v)));
        add(self.force_n.as_ref(), |f| Reading::Force(Newton(f)));
        add(self.body_velocity_m_s.as_ref(), |v| Reading::BodyVelocity(MetrePerSecond(v)));
        add(self.force_request_n.as_ref(), |f| Reading::ForceRequest(Newton(f)));
        add(Some(&self.displacement_m), |x| Reading::Displacement(Metre(x)));
        std::iter::from_fn(move || {
            // The first cursor with the smallest stamp; equal stamps keep the order of `Channel::ALL`.
            let next = cursors
                .iter_mut()
                .filter(|cursor| !cursor.stamps.is_empty())
                .min_by_key(|cursor| cursor.stamps[0])?;
            Some(next.take())
        })
    }
}

/// A position in one trace during the merge.
struct Cursor<'a> {
    make: fn(f64) -> Reading,
    stamps: &'a [Stamp],
    values: &'a [f64],
}

impl Cursor<'_> {
    fn take(&mut self) -> Sample {
        let (stamp, value) = (self.stamps[0], self.values[0]);
        (self.stamps, self.values) = (&self.stamps[1..], &self.values[1..]);
        Sample { stamp, received: stamp, reading: (self.make)(value) }
    }
}
