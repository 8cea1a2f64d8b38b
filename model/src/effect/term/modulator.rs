//! Modulators: the signal that a term's curve is multiplied by.
//!
//! ```text
//! force added = c m g(q)
//! ```
//!
//! | modulator m | unit | what a term with it changes |
//! |---|---|---|
//! | `one` | - | an added force |
//! | `force` | N | the damper's force, by a share |
//! | `force_in_extension`, `force_in_compression` | N | the same in one direction: F (1 + tanh(v / 5 mm/s)) / 2, and with - |
//! | `sign_velocity` | - | a friction: tanh(v / 5 mm/s) |
//! | `velocity`, `displacement`, `acceleration` | m/s, m, m/s² | a damping, a stiffness, a mass |
//! | `drive`, `drive_sign_velocity` | A or V | a force in proportion to the drive |
//! | `force_per_drive` | N/A | the drive: i' = i + c g(q) before the model, which adds dF/di c g(q) to first order |
//! | `force_per_velocity` | N s/m | the velocity: v' = v + c g(q) |

use super::Signals;
use crate::effect::parts::smooth_sign;
use crate::effect::{Need, Unit};
use crate::force::Inputs;
use crate::force::jet::Real;

/// A modulator; see `model/src/effect/term/modulator.rs`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Modulator {
    /// 1.
    One,
    /// The damper's force.
    Force,
    /// The damper's force in extension.
    ForceInExtension,
    /// The damper's force in compression.
    ForceInCompression,
    /// The sign of the velocity.
    SignVelocity,
    /// The velocity.
    Velocity,
    /// The displacement.
    Displacement,
    /// The acceleration.
    Acceleration,
    /// The drive.
    Drive,
    /// The drive times the sign of the velocity.
    DriveSignVelocity,
    /// Acts on the drive.
    ForcePerDrive,
    /// Acts on the velocity.
    ForcePerVelocity,
}

impl Modulator {
    /// All modulators.
    pub const ALL: [Self; 12] = [
        Self::One,
        Self::Force,
        Self::ForceInExtension,
        Self::ForceInCompression,
        Self::SignVelocity,
        Self::Velocity,
        Self::Displacement,
        Self::Acceleration,
        Self::Drive,
        Self::DriveSignVelocity,
        Self::ForcePerDrive,
        Self::ForcePerVelocity,
    ];

    /// Name, as in model files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::One => "one",
            Self::Force => "force",
            Self::ForceInExtension => "force_in_extension",
            Self::ForceInCompression => "force_in_compression",
            Self::SignVelocity => "sign_velocity",
            Self::Velocity => "velocity",
            Self::Displacement => "displacement",
            Self::Acceleration => "acceleration",
            Self::Drive => "drive",
            Self::DriveSignVelocity => "drive_sign_velocity",
            Self::ForcePerDrive => "force_per_drive",
            Self::ForcePerVelocity => "force_per_velocity",
        }
    }

    /// The modulator with this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|modulator| modulator.name() == name)
    }

    /// Unit of what the curve adds: of the amount times the form.
    #[must_use]
    pub const fn unit_of_curve(self) -> Unit {
        match self {
            Self::One | Self::SignVelocity => Unit::NEWTON,
            Self::Force | Self::ForceInExtension | Self::ForceInCompression => Unit::NONE,
            Self::Velocity => Unit::new("_n_s_m", "N s/m"),
            Self::Displacement => Unit::NEWTON_PER_METRE,
            Self::Acceleration => Unit::KILOGRAM,
            Self::Drive | Self::DriveSignVelocity => Unit::new("_n_drive", "N/A"),
            Self::ForcePerDrive => Unit::DRIVE,
            Self::ForcePerVelocity => Unit::METRE_PER_SECOND,
        }
    }

    /// True if a term with it changes an input of the model.
    #[must_use]
    pub const fn acts_on_input(self) -> bool {
        matches!(self, Self::ForcePerDrive | Self::ForcePerVelocity)
    }

    pub(super) const fn needs(self) -> Option<Need> {
        match self {
            Self::Drive | Self::DriveSignVelocity | Self::ForcePerDrive => Some(Need::Drive),
            _ => None,
        }
    }

    /// Its value; 1 for one that acts on an input.
    #[inline]
    pub(crate) fn value<R: Real>(self, signals: &Signals<R>, inputs: &Inputs<R>) -> R {
        let force_n = signals.force_n();
        let sign = || smooth_sign(inputs.velocity_m_s);
        match self {
            Self::One | Self::ForcePerDrive | Self::ForcePerVelocity => R::from(1.0),
            Self::Force => force_n,
            Self::ForceInExtension => force_n * (sign() + 1.0) * 0.5,
            Self::ForceInCompression => force_n * (-sign() + 1.0) * 0.5,
            Self::SignVelocity => sign(),
            Self::Velocity => inputs.velocity_m_s,
            Self::Displacement => inputs.displacement_m,
            Self::Acceleration => inputs.acceleration_m_s2,
            Self::Drive => inputs.drive,
            Self::DriveSignVelocity => inputs.drive * sign(),
        }
    }
}
