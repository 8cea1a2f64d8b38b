//! What a pipeline runs on, made ready beforehand: models, settings, and a commander.
//!
//! Making a plan may take milliseconds and may fail; taking it over does neither, so that a running pipeline changes between two
//! samples, on a thread that cannot wait.

use super::Models;
use super::lane::{FreeLane, SeededLane};
use super::settings::Settings;
use crate::error::Error;
use crate::inverse::{Commander, Method};

/// Models and settings that go together.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    pub(super) settings: Settings,
    pub(super) free: FreeLane,
    pub(super) seeded: Option<SeededLane>,
    pub(super) commander: Commander,
}

impl Plan {
    /// Checks `models` and `settings`, and makes what they need.
    ///
    /// A model without an inverse goes with every law that needs none; forces are then answered with the safe current.
    ///
    /// # Errors
    /// When a model or a setting is out of range, or law or method needs what the model has not; the message says which.
    pub fn new(models: Models, settings: Settings) -> Result<Self, Error> {
        settings.validate()?;
        let commander = match Commander::with_method(&models.free, settings.limits, settings.method) {
            Err(why) if settings.law.needs_inverse() => {
                return Err(Error::Data { message: format!("law {}: {why}", settings.law.name()) });
            }
            Err(why) if settings.method != Method::Search => {
                return Err(Error::Data {
                    message: format!("inverse.method {}: {why}", settings.method.name()),
                });
            }
            Err(_) => Commander::without_inverse(settings.limits)?,
            Ok(commander) => commander,
        };
        Ok(Self {
            settings,
            free: FreeLane::new(settings.applied_to(models.free))?,
            seeded: match models.seeded {
                Some(model) => SeededLane::new(settings.applied_to(model))?,
                None => None,
            },
            commander,
        })
    }

    /// What will command currents, at rest; without an inverse where the free model has none.
    #[must_use]
    pub const fn commander(&self) -> &Commander {
        &self.commander
    }
}
