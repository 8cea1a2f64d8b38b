//! The constants of the definitions as Rust types: modes, validities, limits and reasons.
//!
//! Messages carry plain numbers, so that values of a newer peer survive; convert with `try_from`.

use std::fmt;
use std::ops::{BitOr, BitOrAssign};

use serde::{Deserialize, Serialize};

/// A number that matches none of a definition's constants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{value} is not a known {what}")]
pub struct UnknownValue {
    /// Meaning of the number: `mode`, `validity` or `limit`.
    pub what: &'static str,
    /// The number.
    pub value: u8,
}

macro_rules! wire_enum {
    ($(#[$doc:meta])* $type:ident, $what:literal,
     { $($(#[$variant_doc:meta])* $variant:ident = $value:literal $name:literal,)+ }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u8)]
        pub enum $type {
            $($(#[$variant_doc])* $variant = $value,)+
        }

        impl $type {
            /// All values, in the order of their numbers.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)+];

            /// The name, as in reports and in JSON.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)+ }
            }
        }

        impl fmt::Display for $type {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(self.name())
            }
        }

        impl From<$type> for u8 {
            fn from(value: $type) -> Self {
                value as Self
            }
        }

        impl TryFrom<u8> for $type {
            type Error = UnknownValue;

            fn try_from(value: u8) -> Result<Self, UnknownValue> {
                match value {
                    $($value => Ok(Self::$variant),)+
                    _ => Err(UnknownValue { what: $what, value }),
                }
            }
        }
    };
}

wire_enum! {
    /// The estimator that computes the force (`MODE_` constants of `ForceEstimate`).
    Mode, "mode", {
        /// ARX seeded by fresh measured force.
        Arx = 0 "arx",
        /// Measured force was lost; ARX simulates (free run) from its last seed for a bounded time.
        ArxCoast = 1 "arx_coast",
        /// The loaded model, from displacement and drive (current or voltage) alone.
        Model = 2 "model",
        /// The last good force is held.
        Hold = 3 "hold",
        /// No force is available.
        Fault = 4 "fault",
    }
}

wire_enum! {
    /// How far an estimate may be used (`VALIDITY_` constants of `ForceEstimate`).
    ///
    /// Ordered from best to worst: the validity of a combination is the maximum of its parts.
    Validity, "validity", {
        /// The estimate is as good as the model.
        Valid = 0 "VALID",
        /// Usable, but an input or the estimator is worse than it should be.
        Degraded = 1 "DEGRADED",
        /// An input is outside the range that the model was trained on.
        Extrapolating = 2 "EXTRAPOLATING",
        /// The inputs are too old for the force to describe the present.
        Stale = 3 "STALE",
        /// The force must not be used.
        Invalid = 4 "INVALID",
    }
}

wire_enum! {
    /// The limit that applied to a commanded current (`LIMITED_BY_` constants of `CurrentCommand`).
    LimitedBy, "limit", {
        /// Nothing.
        None = 0 "none",
        /// The largest current allowed.
        CurrentMax = 1 "current_max",
        /// The smallest current, where the damper is softest.
        CurrentMin = 2 "current_min",
        /// The largest rate of change allowed.
        Rate = 3 "rate",
        /// The requested force would drive the rod.
        Passivity = 4 "passivity",
        /// An input is missing or not valid, so the configured safe current is commanded.
        Safe = 5 "safe",
        /// The loaded model has no inverse, so the configured safe current is commanded.
        NoInverse = 6 "no_inverse",
    }
}

/// Why an estimate is not `VALID`: a set of the `REASON_` bits of `ForceEstimate`.
///
/// ```
/// use mr_damper_msgs::Reasons;
///
/// let reasons = Reasons::LATE | Reasons::DRIVE_STALE;
/// assert!(reasons.contains(Reasons::LATE));
/// assert_eq!(reasons.to_string(), "DRIVE_STALE|LATE");
/// ```
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Reasons(u32);

macro_rules! reasons {
    ($($(#[$doc:meta])* $constant:ident = $value:literal $name:literal,)+) => {
        impl Reasons {
            $($(#[$doc])* pub const $constant: Self = Self($value);)+

            /// Every known reason with its name, in the order of the bits.
            pub const ALL: &'static [(&'static str, Self)] = &[$(($name, Self::$constant),)+];
        }
    };
}

reasons! {
    /// No drive (current or voltage) was ever received.
    DRIVE_MISSING = 1 "DRIVE_MISSING",
    /// The last drive sample is older than its timeout.
    DRIVE_STALE = 2 "DRIVE_STALE",
    /// Measured force has stopped arriving.
    FORCE_LOST = 4 "FORCE_LOST",
    /// Displacement samples are missing before this one.
    DISPLACEMENT_GAP = 8 "DISPLACEMENT_GAP",
    /// A reading since the last estimate was refused, for example NaN or a stamp that goes back in time.
    INPUT_REFUSED = 16 "INPUT_REFUSED",
    /// An input is outside the range that the model was trained on.
    OUTSIDE_ENVELOPE = 32 "OUTSIDE_ENVELOPE",
    /// The sample period differs from the ARX model's sample period.
    RATE_MISMATCH = 64 "RATE_MISMATCH",
    /// The sample reached the node late.
    LATE = 128 "LATE",
    /// A current arrived although the model takes a voltage, or the reverse.
    WRONG_DRIVE = 256 "WRONG_DRIVE",
    /// Filters, derivative or history are not settled yet.
    SETTLING = 512 "SETTLING",
    /// The coasting ARX model has no meaningful DC gain, so its force may drift.
    NO_DC = 1024 "NO_DC",
    /// Displacement has stopped.
    DISPLACEMENT_LOST = 2048 "DISPLACEMENT_LOST",
    /// Samples were dropped because a queue was full.
    OVERLOAD = 4096 "OVERLOAD",
    /// The model needs the case temperature, which was never received.
    TEMPERATURE_MISSING = 8192 "TEMPERATURE_MISSING",
    /// A reading was outside its sensor's range and was refused.
    INPUT_RANGE = 16384 "INPUT_RANGE",
    /// A displacement would need a faster rod than is possible, and was refused.
    INPUT_RATE = 32768 "INPUT_RATE",
    /// A reading does not change although the other inputs show that it must.
    SENSOR_STUCK = 65536 "SENSOR_STUCK",
    /// Measured velocity disagrees with the displacement.
    VELOCITY_DISAGREES = 131_072 "VELOCITY_DISAGREES",
    /// The driver cannot have produced this current: too large, or changed too fast.
    DRIVE_IMPLAUSIBLE = 262_144 "DRIVE_IMPLAUSIBLE",
    /// Measured force adds energy, but a damper only dissipates it: the force's sign or offset is wrong.
    NOT_PASSIVE = 524_288 "NOT_PASSIVE",
    /// Samples of one input arrive interleaved from two publishers.
    INPUT_INTERLEAVED = 1_048_576 "INPUT_INTERLEAVED",
    /// The stamp of an input is later than its arrival: the clocks of its publisher and the node differ.
    STAMP_AHEAD = 2_097_152 "STAMP_AHEAD",
    /// No model runs, and no other reason says why: the mode was asked for, it needs a model or a force that is not there, or the models have
    /// not enough samples since a gap.
    NO_MODEL_RUNS = 4_194_304 "NO_MODEL_RUNS",
}

impl Reasons {
    /// No reason.
    pub const NONE: Self = Self(0);

    /// The set of these bits. Unknown bits are kept.
    #[must_use]
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// The bits as sent in messages.
    #[must_use]
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// Whether no bit is set.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether all bits of `other` are set.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Sets or clears the bits of `other`.
    pub const fn set(&mut self, other: Self, on: bool) {
        if on {
            self.0 |= other.0;
        } else {
            self.0 &= !other.0;
        }
    }

    /// The names of the known bits that are set.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::ALL.iter().filter(move |(_, reason)| self.contains(*reason)).map(|(name, _)| *name)
    }

    /// The bits that are set but unknown here.
    #[must_use]
    pub fn unknown_bits(self) -> u32 {
        Self::ALL.iter().fold(self.0, |left, (_, reason)| left & !reason.0)
    }
}

impl BitOr for Reasons {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for Reasons {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

/// `LATE|OVERLOAD`; unknown bits as one hexadecimal number; `none` if empty.
impl fmt::Display for Reasons {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_empty() {
            return f.write_str("none");
        }
        let mut separator = "";
        for name in self.names() {
            write!(f, "{separator}{name}")?;
            separator = "|";
        }
        match self.unknown_bits() {
            0 => Ok(()),
            bits => write!(f, "{separator}{bits:#x}"),
        }
    }
}

impl fmt::Debug for Reasons {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Reasons({self})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_round_trip_and_unknown_ones_are_refused() {
        for mode in Mode::ALL {
            assert_eq!(Mode::try_from(u8::from(*mode)), Ok(*mode));
        }
        assert_eq!(Mode::try_from(5), Err(UnknownValue { what: "mode", value: 5 }));
        assert_eq!(LimitedBy::try_from(255).expect_err("unknown").to_string(), "255 is not a known limit");
    }

    #[test]
    fn the_worst_validity_is_the_maximum() {
        assert_eq!(Validity::Stale.max(Validity::Degraded), Validity::Stale);
    }

    #[test]
    fn reasons_are_a_set() {
        let mut reasons = Reasons::NONE;
        assert_eq!(reasons.to_string(), "none");
        reasons |= Reasons::OVERLOAD;
        reasons.set(Reasons::LATE, true);
        assert_eq!(reasons.names().collect::<Vec<_>>(), ["LATE", "OVERLOAD"]);
        reasons.set(Reasons::OVERLOAD, false);
        assert_eq!(reasons, Reasons::LATE);
        assert!(!(reasons | Reasons::NO_DC).contains(Reasons::NO_DC | Reasons::SETTLING));
        assert_eq!(Reasons::from_bits(0x8000_0080).to_string(), "LATE|0x80000000");
    }
}
