//! Fuzzy sets over the drive in a model file. Keys must be in the drive's unit. Sigma is one number for all
//! sets, or a list with one number for each set.

use super::drive_error;
use super::law::Value;
use crate::error::Error;
use crate::force::{FuzzySets, Membership};
use crate::sample::DriveKind;
use serde::{Deserialize, Serialize};

/// The known keys, to suggest the nearest one.
pub(super) const KEYS: [&str; 4] =
    ["membership_sigma_a", "membership_sigma_v", "membership_centres_a", "membership_centres_v"];

#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Memberships {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    membership_sigma_a: Option<Value>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    membership_sigma_v: Option<Value>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    membership_centres_a: Option<Vec<f64>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    membership_centres_v: Option<Vec<f64>>,
}

impl Memberships {
    pub(super) fn of(sets: &FuzzySets) -> Self {
        let sigma = match sets.sigmas() {
            [first, others @ ..] if others.iter().all(|other| other == first) => Value::One(*first),
            all => Value::Many(all.to_vec()),
        };
        let (sigma, centres) = (Some(sigma), Some(sets.centres().to_vec()));
        match sets.drive() {
            DriveKind::CoilCurrent => {
                Self { membership_sigma_a: sigma, membership_centres_a: centres, ..Self::default() }
            }
            DriveKind::CommandVoltage => {
                Self { membership_sigma_v: sigma, membership_centres_v: centres, ..Self::default() }
            }
        }
    }

    /// The sets over `drive`.
    pub(super) fn read(&self, drive: DriveKind) -> Result<FuzzySets, Error> {
        let amperes = (self.membership_sigma_a.as_ref(), self.membership_centres_a.as_deref());
        let volts = (self.membership_sigma_v.as_ref(), self.membership_centres_v.as_deref());
        let (own, foreign) = match drive {
            DriveKind::CoilCurrent => (amperes, volts),
            DriveKind::CommandVoltage => (volts, amperes),
        };
        match (own, foreign) {
            ((Some(sigma), Some(centres)), (None, None)) => match sigma {
                Value::One(sigma) => FuzzySets::new(Membership { drive, sigma: *sigma }, centres),
                Value::Many(sigmas) => FuzzySets::with_widths(drive, centres, sigmas),
            },
            _ => {
                let unit = drive.unit_suffix();
                Err(drive_error(
                    Some(drive),
                    &format!(
                        "membership_centres_{unit} and membership_sigma_{unit}, but no keys in the other unit"
                    ),
                ))
            }
        }
    }
}
