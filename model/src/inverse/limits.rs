//! Limits of a command, and the reasons why a command does not meet its demand.

use crate::error::Error;

/// Limits and time constants of a command.
///
/// ```
/// use mr_damper_model::inverse::Limits;
///
/// let driver = Limits { current_max_a: 2.0, safe_a: 0.5, ..Limits::default() };
/// assert!(driver.validate().is_ok());
/// let error = Limits { safe_a: 3.0, ..driver }.validate().unwrap_err();
/// assert_eq!(error.to_string(), "current.safe_a is 3, but must be between 0 and current.max_a");
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Largest current, A. The least is 0: the sign of a coil's current does not matter.
    pub current_max_a: f64,
    /// Largest change of the current, A/s; infinite for none.
    pub rate_max_a_s: f64,
    /// Safe current, A: commanded without a demand, or if the damper's motion is not known.
    pub safe_a: f64,
    /// Time to reach the safe current, s.
    pub safe_after_s: f64,
    /// Speed below which the last current is held, m/s: there the force hardly depends on the current, and its sign reverses.
    pub hold_m_s: f64,
    /// Time constant of the coil current with lead compensation, s: a shorter one is faster and amplifies noise more.
    pub lead_s: f64,
    /// Time constant with which the model's bias is learnt from measured force, s.
    pub feedback_s: f64,
    /// Gain of the feedback of demanded minus measured force, dimensionless; 0 for no feedback.
    pub feedback_gain: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            current_max_a: 2.5,
            rate_max_a_s: f64::INFINITY,
            safe_a: 0.0,
            safe_after_s: 0.5,
            hold_m_s: 2e-3,
            lead_s: 4e-3,
            feedback_s: 15e-3,
            feedback_gain: 1.2,
        }
    }
}

impl Limits {
    /// Checks that every number lies in its range.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the limit, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        Error::check("current.max_a", self.current_max_a, "above 0 and at most 100 A", |a| {
            a > 0.0 && a <= 100.0
        })?;
        if self.rate_max_a_s != f64::INFINITY {
            Error::check("current.rate_max_a_s", self.rate_max_a_s, "above 0", |rate| rate > 0.0)?;
        }
        let max_a = self.current_max_a;
        Error::check("current.safe_a", self.safe_a, "between 0 and current.max_a", |a| {
            (0.0..=max_a).contains(&a)
        })?;
        let time = |s: f64| (0.0..=60.0).contains(&s);
        Error::check("current.safe_after_s", self.safe_after_s, "between 0 and 60 s", time)?;
        Error::check("current.hold_m_s", self.hold_m_s, "between 0 and 1 m/s", |v| (0.0..=1.0).contains(&v))?;
        Error::check("current.lead_s", self.lead_s, "between 0 and 60 s", time)?;
        Error::check("current.feedback_s", self.feedback_s, "between 0 and 60 s", time)?;
        Error::check("current.feedback_gain", self.feedback_gain, "between 0 and 5", |g| {
            (0.0..=5.0).contains(&g)
        })?;
        Ok(())
    }
}

/// The reason why a command does not reach the demanded force, with the values of `CurrentCommand.msg`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum LimitedBy {
    /// Nothing.
    None = 0,
    /// The damper is too soft at its largest current.
    CurrentMax = 1,
    /// The damper is too hard even without current.
    CurrentMin = 2,
    /// The rate limit of the driver.
    Rate = 3,
    /// The force would drive the rod.
    Passivity = 4,
    /// No demand, or the motion is not known: the current goes to the safe current.
    Safe = 5,
    /// The model has no inverse: the current goes to the safe current.
    NoInverse = 6,
}

impl LimitedBy {
    /// The name, as in the message.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "NONE",
            Self::CurrentMax => "CURRENT_MAX",
            Self::CurrentMin => "CURRENT_MIN",
            Self::Rate => "RATE",
            Self::Passivity => "PASSIVITY",
            Self::Safe => "SAFE",
            Self::NoInverse => "NO_INVERSE",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_out_of_range_are_refused_by_name() {
        let refused =
            |limits: Limits| limits.validate().map_err(|e| e.to_string()).expect_err("out of range");
        let base = Limits::default();
        assert_eq!(base.validate(), Ok(()));
        for (limits, name) in [
            (Limits { current_max_a: 0.0, ..base }, "current.max_a is 0"),
            (Limits { current_max_a: f64::NAN, ..base }, "current.max_a is NaN"),
            (Limits { rate_max_a_s: -1.0, ..base }, "current.rate_max_a_s is -1"),
            (Limits { safe_a: 3.0, ..base }, "current.safe_a is 3"),
            (Limits { safe_after_s: f64::INFINITY, ..base }, "current.safe_after_s is inf"),
            (Limits { hold_m_s: -0.1, ..base }, "current.hold_m_s is -0.1"),
            (Limits { lead_s: 61.0, ..base }, "current.lead_s is 61"),
            (Limits { feedback_s: -1.0, ..base }, "current.feedback_s is -1"),
            (Limits { feedback_gain: 6.0, ..base }, "current.feedback_gain is 6"),
        ] {
            assert!(refused(limits).starts_with(name), "{name}");
        }
    }
}
