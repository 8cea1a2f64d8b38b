//! What may be commanded, and what kept a command from what was asked for.

use crate::error::Error;

/// Limits and time constants of a command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Largest current, A. The least is none: a coil magnetises either way.
    pub current_max_a: f64,
    /// Largest change of the current, A/s; infinite for none.
    pub rate_max_a_s: f64,
    /// Current to go to when there is no demand or the damper's motion is not known, A.
    pub safe_a: f64,
    /// How long that takes, s.
    pub safe_after_s: f64,
    /// Speed below which the last current is held, m/s: there the damper's force hardly follows the current, and its sign turns.
    pub hold_m_s: f64,
    /// Time constant with which a coil that lags is led to its current, s: shorter is faster, and makes more of the noise.
    pub lead_s: f64,
    /// Time constant with which the model's bias is learnt from measured force, s.
    pub feedback_s: f64,
    /// How much of what the measured force misses the demand by is asked for on top, 1; 0 for none.
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

/// What kept a command from the force that was asked for. The values are those of `CurrentCommand.msg`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum LimitedBy {
    /// Nothing.
    None = 0,
    /// The damper is too soft at its largest current.
    CurrentMax = 1,
    /// The damper is too hard without current.
    CurrentMin = 2,
    /// The driver's rate.
    Rate = 3,
    /// The force would drive the rod.
    Passivity = 4,
    /// There is no demand, or no motion to answer it with: the current goes to the safe one.
    Safe = 5,
    /// The model has no inverse: the current goes to the safe one.
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
    fn limits_that_mean_nothing_are_refused_by_name() {
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
