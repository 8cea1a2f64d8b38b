//! Control laws: they set the demanded force or current.
//!
//! ```text
//! follow      Fd = F_request
//! skyhook     Fd = c v_b            a damper between body and sky, where that takes energy out
//! groundhook  Fd = -c (v_b - v)     a damper between wheel and ground
//! fixed       i  = i_0
//! ```
//!
//! | symbol | what | unit |
//! |---|---|---|
//! | Fd, i | demanded force, tension positive; current | N, A |
//! | v_b | velocity of the body above the damper, up positive | m/s |
//! | v | velocity of the damper, extension positive; v_b - v is the velocity of the wheel | m/s |
//! | c | `skyhook.damping_n_s_m`, `groundhook.damping_n_s_m` | N s/m |
//!
//! The damper pulls the body down and the wheel up with Fd. The wheel's velocity is valid for a damper that stands upright between
//! the two. If a law demands a force that would drive the rod, the command is zero current; this makes the laws semi-active.
//!
//! Source: Karnopp, Crosby, Harwood (1974), J. Eng. Ind. 96, 619 (skyhook); Valasek, Novak, Sika, Vaculin (1997), Vehicle System
//! Dynamics 27, 289 (groundhook).
//! See `[karnopp1974]` and `[valasek1997]` in the bibliography (node/docs/guide/bibliography.md).

use crate::error::Error;

/// A control law.
///
/// ```
/// use mr_damper_model::inverse::{ControlLaw, Demand};
///
/// // The body moves up at 0.5 m/s and the damper extends at 0.2 m/s: a skyhook damper of 800 N s/m pulls with 400 N.
/// let skyhook = ControlLaw::Skyhook(800.0);
/// assert_eq!(skyhook.demand(None, Some(0.5), 0.2), Demand::Force(400.0));
/// assert_eq!(skyhook.demand(None, None, 0.2), Demand::None, "the velocity of the body is not known");
/// let error = ControlLaw::Fixed(3.0).validate(2.5).unwrap_err();
/// assert_eq!(error.to_string(), "fixed.current_a is 3, but must be between 0 and current.max_a");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum ControlLaw {
    /// Commands nothing.
    Off,
    /// Demands the requested force.
    #[default]
    Follow,
    /// A damper between body and sky of this many N s/m.
    Skyhook(f64),
    /// A damper between wheel and ground of this many N s/m.
    Groundhook(f64),
    /// This current, A.
    Fixed(f64),
}

/// The demand on the damper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Demand {
    /// Nothing, or nothing known.
    None,
    /// A force, N.
    Force(f64),
    /// A current, A.
    Current(f64),
}

impl Demand {
    /// A force, or nothing if there is none.
    #[must_use]
    pub fn of_force(force_n: Option<f64>) -> Self {
        force_n.map_or(Self::None, Self::Force)
    }

    /// The same demand, but nothing in place of a number that is not finite.
    #[must_use]
    pub const fn if_finite(self) -> Self {
        match self {
            Self::Force(number) | Self::Current(number) if !number.is_finite() => Self::None,
            demand => demand,
        }
    }

    /// The force, N; NaN if none is demanded.
    #[must_use]
    pub const fn force_n(self) -> f64 {
        match self {
            Self::Force(force_n) => force_n,
            Self::None | Self::Current(_) => f64::NAN,
        }
    }
}

impl ControlLaw {
    /// The demand at the damper velocity `velocity_m_s`. `request_n` is the requested force and `body_m_s` the body's velocity, if
    /// present and fresh.
    #[inline]
    #[must_use]
    pub fn demand(self, request_n: Option<f64>, body_m_s: Option<f64>, velocity_m_s: f64) -> Demand {
        match self {
            Self::Off => Demand::None,
            Self::Follow => Demand::of_force(request_n),
            Self::Skyhook(damping) => Demand::of_force(body_m_s.map(|body| damping * body)),
            Self::Groundhook(damping) => {
                Demand::of_force(body_m_s.map(|body| -damping * (body - velocity_m_s)))
            }
            Self::Fixed(current_a) => Demand::Current(current_a),
        }
    }

    /// The law's name, as in the parameter `law`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Follow => "follow",
            Self::Skyhook(_) => "skyhook",
            Self::Groundhook(_) => "groundhook",
            Self::Fixed(_) => "fixed",
        }
    }

    /// True if the law always demands forces, whether or not one is requested.
    #[must_use]
    pub const fn needs_inverse(self) -> bool {
        matches!(self, Self::Skyhook(_) | Self::Groundhook(_))
    }

    /// Checks that the law's parameter lies in its range.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the parameter, its value and its range.
    pub fn validate(self, current_max_a: f64) -> Result<(), Error> {
        let damping = |name, number| {
            Error::check(name, number, "between 0 and 1000000 N s/m", |c| (0.0..=1e6).contains(&c)).map(drop)
        };
        match self {
            Self::Off | Self::Follow => Ok(()),
            Self::Skyhook(number) => damping("skyhook.damping_n_s_m", number),
            Self::Groundhook(number) => damping("groundhook.damping_n_s_m", number),
            Self::Fixed(current_a) => {
                Error::check("fixed.current_a", current_a, "between 0 and current.max_a", |a| {
                    (0.0..=current_max_a).contains(&a)
                })
                .map(drop)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_law_demands_what_its_equation_says() {
        let text = |law: ControlLaw| {
            let cases = [(Some(300.0), Some(0.5), 0.2), (None, Some(-0.5), 0.2), (Some(300.0), None, 0.2)];
            cases.map(|(request_n, body, v)| match law.demand(request_n, body, v) {
                Demand::None => "nothing".to_owned(),
                Demand::Force(force_n) => format!("{force_n} N"),
                Demand::Current(current_a) => format!("{current_a} A"),
            })
        };
        assert_eq!(text(ControlLaw::Off), ["nothing", "nothing", "nothing"]);
        assert_eq!(text(ControlLaw::Follow), ["300 N", "nothing", "300 N"]);
        assert_eq!(text(ControlLaw::Skyhook(1000.0)), ["500 N", "-500 N", "nothing"]);
        assert_eq!(text(ControlLaw::Groundhook(1000.0)), ["-300 N", "700 N", "nothing"]);
        assert_eq!(text(ControlLaw::Fixed(1.5)), ["1.5 A", "1.5 A", "1.5 A"]);
    }

    #[test]
    fn numbers_out_of_range_are_named() {
        for (law, name) in [
            (ControlLaw::Skyhook(-1.0), "skyhook.damping_n_s_m is -1"),
            (ControlLaw::Groundhook(f64::NAN), "groundhook.damping_n_s_m is NaN"),
            (ControlLaw::Fixed(3.0), "fixed.current_a is 3"),
        ] {
            let refused = law.validate(2.5).expect_err("out of range").to_string();
            assert!(refused.starts_with(name), "{refused}");
        }
        assert_eq!(ControlLaw::Fixed(2.5).validate(2.5), Ok(()));
    }
}
