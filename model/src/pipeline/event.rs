//! Events that the pipeline reports. They are plain `Copy` data, because they cross threads in wait-free rings.

use super::mode::Mode;
use crate::inverse::CurrentCommand;
use crate::sample::{Sample, Stamp};
use crate::units::{Newton, Second};

/// One report of the pipeline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event {
    /// A sample was accepted.
    Input(Sample),
    /// A sample was refused.
    Refusal(Refusal),
    /// A force estimate.
    Estimate(Estimate),
    /// A residual of the simulation (free run).
    Residual(Residual),
    /// The mode changed.
    Transition(Transition),
    /// The residual alarm was raised, or it fell.
    Alarm(AlarmChange),
    /// A current is commanded.
    Command(StampedCommand),
}

/// A current command. It is caused by the displacement sample whose stamp it bears or, while displacement is silent, by elapsed time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedCommand {
    /// Stamp of the displacement sample; in silence, the last stamp plus the silence.
    pub stamp: Stamp,
    /// When the command was computed: on receipt of that sample or, in silence, at the tick. On the clock of [`Sample::received`].
    pub known_at: Stamp,
    /// The command.
    pub command: CurrentCommand,
}

/// The model that an estimate comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slot {
    /// The free-run model.
    Free,
    /// The ARX model.
    Seeded,
}

/// A force estimate, caused by the displacement sample whose stamp it bears.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Stamp of the displacement sample.
    pub stamp: Stamp,
    /// When that sample was received, on the clock of [`Sample::received`]; `None` in silence.
    pub received: Option<Stamp>,
    /// Estimated force of the damper; NaN if there is none (validity is then [`Validity::Invalid`]).
    pub force: Newton,
    /// Part of `force` that smooths a change of mode or model, so that the estimate neither steps nor kinks. `force` minus `smoothing` is
    /// the output of the mode's model.
    pub smoothing: Newton,
    /// Expected standard deviation: from the model's calibration, or else from its identification; NaN if not known.
    pub std_dev: Newton,
    /// 90 % band of the force, low and high; NaN if not known. It lies around the output of the mode's model and is extended to contain
    /// `force`: the two differ for a while after a change of mode.
    pub band: [Newton; 2],
    /// The band comes from a calibration ([`crate::uncertainty`]), and the operating point is within the calibrated range. Otherwise the
    /// band is estimated from the standard deviation or, while the last estimate is held, from the range of the training forces.
    pub calibrated: bool,
    /// Model that the estimate comes from.
    pub slot: Slot,
    /// Mode of the pipeline.
    pub mode: Mode,
    /// How far the estimate can be trusted.
    pub validity: Validity,
    /// Why it is not [`Validity::Valid`], and what else happened.
    pub reasons: Reasons,
    /// Stamp of the displacement minus stamp of the drive that was used; NaN if there was no drive.
    pub input_age: Second,
}

impl Estimate {
    /// Output of the mode's model, N: the force without smoothing.
    #[must_use]
    pub fn unsmoothed_n(&self) -> f64 {
        self.force.get() - self.smoothing.get()
    }
}

/// Measured force compared with the simulated reading of the load cell (free run).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Stamp of the displacement sample.
    pub stamp: Stamp,
    /// Measured force at that stamp; low-passed if the model's output is.
    pub measured: Newton,
    /// Expected reading of the load cell: the simulated force (free run) with all effects of the model.
    pub predicted: Newton,
    /// Part of `predicted` that comes from effects of the load cell: the reading minus the damper's force. Zero for a model without such
    /// effects; NaN if the model has no force.
    pub load_cell: Newton,
    /// Measured minus predicted.
    pub residual: Newton,
    /// Expected RMSE of the simulation, from the model's identification; NaN if not known. The thesis calls it RSSE.
    pub expected_rsse: Newton,
    /// Residual divided by the expected RMSE; NaN if that is not known.
    pub normalised: f64,
    /// Root mean squared residual (RMSE), with exponential forgetting.
    pub windowed_rsse: Newton,
    /// NMSE: the mean squared residual over the variance of the measured force, with the same forgetting. The thesis calls it ESR.
    pub windowed_esr: f64,
    /// Time constant of the forgetting.
    pub window: Second,
    /// The model had all its inputs and its filters had settled, so the residual counts for the alarm.
    pub counts: bool,
    /// The residual alarm is raised: the model error is larger than the settings allow. See [`AlarmChange`].
    pub alarm: bool,
}

/// The residual alarm was raised, or it fell.
///
/// It is raised when the residual of the simulation has exceeded `residual.alarm_ratio` times the model's expected RMSE for so long that
/// noise alone would cause it at most once in `residual.false_alarm_interval_s`. A larger excess takes less time. It falls when the
/// residual has been smaller for ten blocks, when the model is swapped, on a reset, and after a gap in displacement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AlarmChange {
    /// Stamp of the displacement sample at which it happened.
    pub stamp: Stamp,
    /// True when it was raised.
    pub raised: bool,
    /// Ratio of the windowed RMSE to the model's expected RMSE at that stamp; NaN if a swap, a reset or a gap ended the alarm.
    pub ratio: f64,
}

/// A change of mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transition {
    /// Stamp of the displacement sample at which it happened.
    pub stamp: Stamp,
    /// Mode before.
    pub from: Mode,
    /// Mode after.
    pub to: Mode,
    /// Why.
    pub cause: Cause,
}

/// Why the mode changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// Measured force is fresh and the ARX model has its history.
    ForceFresh,
    /// Measured force is older than `force_timeout_s`.
    ForceLost,
    /// Measured force is stuck, or implies that the damper delivers energy.
    ForceImplausible,
    /// The ARX model has coasted for `coast_s`.
    CoastEnded,
    /// The ARX model has no valid history (a gap, another rate, a missing drive).
    ArxUnready,
    /// The free-run model has its inputs again.
    ModelReady,
    /// The model's inputs are missing.
    InputsMissing,
    /// Displacement has been silent for longer than `input_timeout_s`.
    DisplacementLost,
    /// The last estimate was held for `hold_s`.
    HoldEnded,
    /// Stamps jumped, so history was dropped.
    TimeJumped,
    /// A reset was requested.
    Reset,
    /// The mode was requested.
    Requested,
}

impl Cause {
    /// The cause in words.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::ForceFresh => "measured force is fresh",
            Self::ForceLost => "measured force is older than force_timeout_s",
            Self::ForceImplausible => "measured force is not plausible",
            Self::CoastEnded => "ARX has coasted for coast_s",
            Self::ArxUnready => "ARX has no valid history",
            Self::ModelReady => "the model's inputs are available",
            Self::InputsMissing => "the model's inputs are missing",
            Self::DisplacementLost => "displacement is silent for longer than input_timeout_s",
            Self::HoldEnded => "the last estimate was held for hold_s",
            Self::TimeJumped => "stamps jumped; history was dropped",
            Self::Reset => "reset",
            Self::Requested => "the mode was asked for",
        }
    }
}

/// A sample that was not used.
///
/// ```
/// use mr_damper_model::pipeline::{Event, Models, Pipeline, Reasons, Refused, Settings};
/// use mr_damper_model::preset;
/// use mr_damper_model::sample::{Reading, Sample, Stamp};
/// use mr_damper_model::units::Metre;
///
/// let models = Models::alone(preset::load(preset::BEST_FUZZY_TANH)?);
/// let mut pipeline = Pipeline::new(models, Settings::default())?;
/// let mut refused = Vec::new();
/// for (ms, displacement_m) in [(0, 0.0), (2, f64::NAN), (1, 0.0), (1, 0.001)] {
///     let stamp = Stamp::from_nanos(ms * 1_000_000);
///     let sample = Sample { stamp, received: stamp, reading: Reading::Displacement(Metre(displacement_m)) };
///     pipeline.step(&sample, &mut |event| {
///         if let Event::Refusal(refusal) = event {
///             refused.push(refusal.why);
///         }
///     });
/// }
/// assert_eq!(refused, [Refused::NotFinite, Refused::Repeated]);
/// assert!(Refused::Repeated.reasons().has(Reasons::INPUT_REFUSED));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refusal {
    /// The sample.
    pub sample: Sample,
    /// Why it was refused.
    pub why: Refused,
}

/// Why a sample was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refused {
    /// The value is NaN or infinite.
    NotFinite,
    /// The stamp repeats the stamp of the sample before.
    Repeated,
    /// The stamp is older than the stamp of the sample before.
    TimeBack,
    /// The drive is a current and the model needs a voltage, or the other way round.
    WrongDrive,
    /// The value is outside the range of its sensor.
    OutOfRange,
    /// The rod cannot have moved there since the displacement before.
    TooFast,
    /// The stamp is far later than the sample's arrival.
    Ahead,
}

impl Refused {
    /// The reasons that the next estimate reports for it.
    #[must_use]
    pub const fn reasons(self) -> Reasons {
        match self {
            Self::WrongDrive => Reasons::WRONG_DRIVE,
            Self::NotFinite | Self::Repeated | Self::TimeBack => Reasons::INPUT_REFUSED,
            Self::OutOfRange => Reasons(Reasons::INPUT_REFUSED.0 | Reasons::INPUT_RANGE.0),
            Self::TooFast => Reasons(Reasons::INPUT_REFUSED.0 | Reasons::INPUT_RATE.0),
            Self::Ahead => Reasons(Reasons::INPUT_REFUSED.0 | Reasons::STAMP_AHEAD.0),
        }
    }

    /// All variants.
    pub const ALL: [Self; 7] = [
        Self::NotFinite,
        Self::Repeated,
        Self::TimeBack,
        Self::WrongDrive,
        Self::OutOfRange,
        Self::TooFast,
        Self::Ahead,
    ];

    /// The reason as the name of a counter.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NotFinite => "not_finite",
            Self::Repeated => "repeated",
            Self::TimeBack => "time_back",
            Self::WrongDrive => "wrong_drive",
            Self::OutOfRange => "out_of_range",
            Self::TooFast => "too_fast",
            Self::Ahead => "stamp_ahead",
        }
    }

    /// The reason in words.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::NotFinite => "the value is not finite",
            Self::Repeated => "its stamp repeats the one before",
            Self::TimeBack => "its stamp is older than the one before",
            Self::WrongDrive => "the model wants the other kind of drive",
            Self::OutOfRange => "the value is beyond what its sensor can have",
            Self::TooFast => "the rod cannot have moved there so fast",
            Self::Ahead => "its stamp is more than a second later than its arrival",
        }
    }
}

/// How far an estimate can be trusted. Of several reasons the worst counts, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Validity {
    /// As accurate as the model.
    Valid = 0,
    /// Usable, but less accurate than the model.
    Degraded = 1,
    /// Outside the model's training range.
    Extrapolating = 2,
    /// Computed from inputs that are too old.
    Stale = 3,
    /// No estimate.
    Invalid = 4,
}

impl Validity {
    /// The name, as in the contract.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Valid => "VALID",
            Self::Degraded => "DEGRADED",
            Self::Extrapolating => "EXTRAPOLATING",
            Self::Stale => "STALE",
            Self::Invalid => "INVALID",
        }
    }
}

/// Reason bits of an estimate, with the values of `ForceEstimate.msg`.
///
/// ```
/// use mr_damper_model::pipeline::{Reasons, Validity};
///
/// let reasons = Reasons::FORCE_LOST | Reasons::DRIVE_STALE;
/// assert_eq!(reasons.names().collect::<Vec<_>>(), ["DRIVE_STALE", "FORCE_LOST"]);
/// assert_eq!(reasons.validity(), Validity::Stale, "the worst of the two");
/// assert!(reasons.has(Reasons::FORCE_LOST) && !reasons.any(Reasons::OVERLOAD | Reasons::LATE));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Reasons(pub u32);

macro_rules! reasons {
    ($($(#[$doc:meta])* $name:ident = $bit:expr, $validity:ident;)*) => {
        impl Reasons {
            $($(#[$doc])* pub const $name: Self = Self($bit);)*

            /// All reasons with their names.
            pub const ALL: &'static [(Self, &'static str)] = &[$((Self::$name, stringify!($name))),*];

            /// The worst validity of the reasons that are set.
            #[must_use]
            pub fn validity(self) -> Validity {
                let mut worst = Validity::Valid;
                $(if self.has(Self::$name) { worst = worst.max(Validity::$validity); })*
                worst
            }
        }
    };
}

reasons! {
    /// The model needs a drive and none has arrived.
    DRIVE_MISSING = 1, Invalid;
    /// The drive is older than `input_timeout_s`.
    DRIVE_STALE = 2, Stale;
    /// Measured force is lost, and ARX coasts.
    FORCE_LOST = 4, Degraded;
    /// Displacement came after a gap, so history restarted.
    DISPLACEMENT_GAP = 8, Degraded;
    /// A reading since the last estimate was refused.
    INPUT_REFUSED = 16, Degraded;
    /// Displacement, velocity, drive, force or temperature lies outside the training range, or the argument of a term outside the range in
    /// which it was confirmed.
    OUTSIDE_ENVELOPE = 32, Extrapolating;
    /// Samples do not come at the rate of the ARX model, so it is not used.
    RATE_MISMATCH = 64, Degraded;
    /// The sample reached the node later than `input_timeout_s` after its stamp.
    LATE = 128, Stale;
    /// A drive of the other kind arrived and was refused.
    WRONG_DRIVE = 256, Degraded;
    /// The filter or the derivative is still settling.
    SETTLING = 512, Degraded;
    /// The coasting ARX model has no meaningful static gain.
    NO_DC = 1024, Degraded;
    /// Displacement is silent; the estimate is the last one.
    DISPLACEMENT_LOST = 2048, Stale;
    /// Samples were lost because a queue was full.
    OVERLOAD = 4096, Degraded;
    /// An effect of the model needs the case temperature and none has arrived.
    TEMPERATURE_MISSING = 8192, Invalid;
    /// A reading was outside the range of its sensor and was refused.
    INPUT_RANGE = 16384, Degraded;
    /// Displacement moved faster than `plausible.speed_max_m_s` and was refused.
    INPUT_RATE = 32768, Degraded;
    /// A reading is stuck while the others say that it must change.
    SENSOR_STUCK = 65536, Degraded;
    /// Measured velocity disagrees with the displacement.
    VELOCITY_DISAGREES = 131_072, Degraded;
    /// The driver cannot have produced this current: it is too large, or it changed too fast.
    DRIVE_IMPLAUSIBLE = 262_144, Degraded;
    /// Measured force implies that the damper delivers energy, but a damper can only absorb it: the sign or offset of the force is wrong.
    NOT_PASSIVE = 524_288, Degraded;
    /// Two publishers interleave samples on one input.
    INPUT_INTERLEAVED = 1_048_576, Degraded;
    /// The stamp of an input is later than its arrival: the clocks of its publisher and of the node differ.
    STAMP_AHEAD = 2_097_152, Degraded;
    /// No model runs, and no other reason says why: the mode was asked for, it needs a model or a force that is not there, or the models have
    /// not enough samples since a gap.
    NO_MODEL_RUNS = 4_194_304, Stale;
}

impl Reasons {
    /// No reason.
    pub const NONE: Self = Self(0);

    /// True if all bits of `other` are set.
    #[inline]
    #[must_use]
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// True if any bit of `other` is set.
    #[inline]
    #[must_use]
    pub const fn any(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// Names of the reasons that are set.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::ALL.iter().filter(move |(bit, _)| self.has(*bit)).map(|(_, name)| *name)
    }
}

impl std::ops::BitOr for Reasons {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl std::ops::BitOrAssign for Reasons {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}
