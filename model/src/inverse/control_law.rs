//! Control laws: they set the demanded force or current.
//!
//! ```text
//! follow      Fd = F_request
//! skyhook     Fd = c v_b            a damper between body and sky, where that takes energy out
//!             c  = sum_j w_j(i) c_j, if gains are given for several currents,   w_j = g_j / sum_k g_k,
//!             g_j = exp(-(i - a_j)^2 / (2 s^2)),   s = half the mean distance of the a_j
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
//! | c_j, a_j | `skyhook.gains_n_s_m`, `skyhook.centres_a` | N s/m, A |
//! | i in w_j | measured current if it is known, otherwise the last commanded one | A |
//!
//! The damper pulls the body down and the wheel up with Fd. The wheel's velocity is valid for a damper that stands upright between
//! the two. With several gains, the controllers are blended by the same fuzzy sets over the current as the fuzzy-tanh model, which the
//! thesis proposes as future work. If a law demands a force that would drive the rod, the command is zero current; this makes the laws semi-active.
//!
//! Source: Karnopp, Crosby, Harwood (1974), J. Eng. Ind. 96, 619 (skyhook); Valasek, Novak, Sika, Vaculin (1997), Vehicle System
//! Dynamics 27, 289 (groundhook).
//! See `[karnopp1974]` and `[valasek1997]` in the bibliography (node/docs/guide/bibliography.md).

use crate::error::Error;
use crate::force::{MAX_FUNCTIONS, blend};

/// A control law.
///
/// ```
/// use mr_damper_model::inverse::{ControlLaw, Demand};
///
/// // The body moves up at 0.5 m/s and the damper extends at 0.2 m/s: a skyhook damper of 800 N s/m pulls with 400 N.
/// let skyhook = ControlLaw::Skyhook(800.0);
/// assert_eq!(skyhook.demand(None, Some(0.5), 0.2, 0.0), Demand::Force(400.0));
/// assert_eq!(skyhook.demand(None, None, 0.2, 0.0), Demand::None, "the velocity of the body is not known");
/// let error = ControlLaw::Fixed(3.0).validate(2.5).unwrap_err();
/// assert_eq!(error.to_string(), "fixed.current_a is 3, but must be between 0 and current.max_a");
/// ```
#[allow(clippy::large_enum_variant, reason = "boxing the lists would put them on the heap, out of `Copy`")]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum ControlLaw {
    /// Commands nothing.
    Off,
    /// Demands the requested force.
    #[default]
    Follow,
    /// A damper between body and sky of this many N s/m.
    Skyhook(f64),
    /// A damper between body and sky whose damping depends on the current.
    SkyhookGains(SkyhookGains),
    /// A damper between wheel and ground of this many N s/m.
    Groundhook(f64),
    /// This current, A.
    Fixed(f64),
}

/// Dampings of the skyhook law at several currents, blended by fuzzy sets.
///
/// ```
/// use mr_damper_model::inverse::{ControlLaw, SkyhookGains};
///
/// let gains = SkyhookGains::new(&[2000.0, 1000.0], &[0.0, 2.0]);
/// // Both sets have the same weight in the middle.
/// assert_eq!(gains.damping_n_s_m(1.0), 1500.0);
/// let error = ControlLaw::SkyhookGains(SkyhookGains::new(&[2000.0], &[0.0, 2.0])).validate(2.5).unwrap_err();
/// assert_eq!(error.to_string(), "skyhook.gains_n_s_m has 1 values, but 2 (one for each of skyhook.centres_a) are needed");
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkyhookGains {
    gains_n_s_m: [f64; MAX_FUNCTIONS],
    centres_a: [f64; MAX_FUNCTIONS],
    /// Numbers of gains and of centres, as given.
    counts: [usize; 2],
    sigma_a: f64,
}

impl SkyhookGains {
    /// The dampings, N s/m, at the currents `centres_a`, A. [`ControlLaw::validate`] checks them; before, a list that is too long is cut.
    #[must_use]
    pub fn new(gains_n_s_m: &[f64], centres_a: &[f64]) -> Self {
        let kept = |list: &[f64]| std::array::from_fn(|j| list.get(j).copied().unwrap_or(0.0));
        // One set covers all currents, whatever its width.
        let sigma_a = match centres_a {
            [first, .., last] => 0.5 * (last - first) / (centres_a.len() - 1) as f64,
            _ => 1.0,
        };
        let counts = [gains_n_s_m.len(), centres_a.len()];
        Self { gains_n_s_m: kept(gains_n_s_m), centres_a: kept(centres_a), counts, sigma_a }
    }

    /// Number of sets.
    fn len(&self) -> usize {
        self.counts[1].min(MAX_FUNCTIONS)
    }

    /// The blended damping at a current, N s/m; NaN at a current that is not finite.
    #[inline]
    #[must_use]
    pub fn damping_n_s_m(&self, current_a: f64) -> f64 {
        let sets = self.len();
        let weights = blend(current_a, &self.centres_a[..sets], &[self.sigma_a; MAX_FUNCTIONS][..sets]);
        weights.iter().zip(&self.gains_n_s_m).map(|(weight, gain)| weight * gain).sum()
    }

    fn validate(&self, current_max_a: f64) -> Result<(), Error> {
        let [gains, centres] = self.counts;
        let length = |name: &str, found, expected| Error::Length { name: name.to_owned(), found, expected };
        if !(1..=MAX_FUNCTIONS).contains(&centres) {
            return Err(length("skyhook.centres_a", centres, format!("1 to {MAX_FUNCTIONS}")));
        }
        if gains != centres {
            let expected = format!("{centres} (one for each of skyhook.centres_a)");
            return Err(length("skyhook.gains_n_s_m", gains, expected));
        }
        for (j, gain) in self.gains_n_s_m[..gains].iter().enumerate() {
            check_damping(&format!("skyhook.gains_n_s_m[{j}]"), *gain)?;
        }
        let mut least_a = 0.0;
        for (j, centre) in self.centres_a[..centres].iter().enumerate() {
            let name = format!("skyhook.centres_a[{j}]");
            Error::check(&name, *centre, "between 0 and current.max_a", |a| {
                (0.0..=current_max_a).contains(&a)
            })?;
            Error::check(&name, *centre, "greater than the centre before it", |a| j == 0 || a > least_a)?;
            least_a = *centre;
        }
        Ok(())
    }
}

fn check_damping(name: &str, damping_n_s_m: f64) -> Result<(), Error> {
    Error::check(name, damping_n_s_m, "between 0 and 1000000 N s/m", |c| (0.0..=1e6).contains(&c)).map(drop)
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
    /// The demand at the damper velocity `velocity_m_s` and the current `current_a`. `request_n` is the requested force and `body_m_s` the
    /// body's velocity, if present and fresh.
    #[inline]
    #[must_use]
    pub fn demand(
        &self,
        request_n: Option<f64>,
        body_m_s: Option<f64>,
        velocity_m_s: f64,
        current_a: f64,
    ) -> Demand {
        match *self {
            Self::Off => Demand::None,
            Self::Follow => Demand::of_force(request_n),
            Self::Skyhook(damping) => Demand::of_force(body_m_s.map(|body| damping * body)),
            Self::SkyhookGains(gains) => {
                Demand::of_force(body_m_s.map(|body| gains.damping_n_s_m(current_a) * body))
            }
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
            Self::Skyhook(_) | Self::SkyhookGains(_) => "skyhook",
            Self::Groundhook(_) => "groundhook",
            Self::Fixed(_) => "fixed",
        }
    }

    /// True if the law always demands forces, whether or not one is requested.
    #[must_use]
    pub const fn needs_inverse(self) -> bool {
        matches!(self, Self::Skyhook(_) | Self::SkyhookGains(_) | Self::Groundhook(_))
    }

    /// Checks that the law's parameter lies in its range.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the parameter, its value and its range; [`Error::Length`] names a list of a wrong length.
    pub fn validate(self, current_max_a: f64) -> Result<(), Error> {
        match self {
            Self::Off | Self::Follow => Ok(()),
            Self::Skyhook(number) => check_damping("skyhook.damping_n_s_m", number),
            Self::SkyhookGains(gains) => gains.validate(current_max_a),
            Self::Groundhook(number) => check_damping("groundhook.damping_n_s_m", number),
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
            cases.map(|(request_n, body, v)| match law.demand(request_n, body, v, 1.0) {
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
    fn several_gains_are_blended_by_the_sets_over_the_current() {
        let (gains, centres) = ([2000.0, 1200.0, 600.0, 400.0], [0.0, 0.5, 1.5, 2.4]);
        let law = ControlLaw::SkyhookGains(SkyhookGains::new(&gains, &centres));
        assert_eq!(law.validate(2.5), Ok(()));
        // Half of the mean distance: (2.4 - 0) / 3 / 2.
        let sigma = 0.4;
        for current_a in [0.0, 0.3, 0.77, 1.5, 2.2, 2.5] {
            let strengths = centres.map(|c: f64| f64::exp(-(current_a - c).powi(2) / (2.0 * sigma * sigma)));
            let blended: f64 = strengths.iter().zip(gains).map(|(g, gain)| g * gain).sum();
            let expected_n = 0.5 * blended / strengths.iter().sum::<f64>();
            let Demand::Force(found_n) = law.demand(Some(9.0), Some(0.5), 0.2, current_a) else {
                panic!("a force is demanded")
            };
            // A set below 1e-7 of the strongest is ignored.
            assert!((found_n - expected_n).abs() < 1e-3, "{current_a}: {found_n} {expected_n}");
        }
        assert_eq!(law.demand(Some(9.0), None, 0.2, 1.0), Demand::None);
        // Equal gains are the law with one gain, and so is one set.
        for one in [SkyhookGains::new(&[800.0; 3], &[0.0, 1.0, 2.0]), SkyhookGains::new(&[800.0], &[1.0])] {
            assert!((one.damping_n_s_m(0.7) - 800.0).abs() < 1e-9);
        }
    }

    #[test]
    fn gains_that_do_not_fit_are_refused() {
        for (gains, centres, expected) in [
            (&[][..], &[][..], "skyhook.centres_a has 0 values"),
            (
                &[1.0, 2.0],
                &[0.0],
                "skyhook.gains_n_s_m has 2 values, but 1 (one for each of skyhook.centres_a)",
            ),
            (&[1.0; 17], &[0.0; 17], "skyhook.centres_a has 17 values, but 1 to 16"),
            (&[1.0, -2.0], &[0.0, 1.0], "skyhook.gains_n_s_m[1] is -2"),
            (&[1.0, f64::NAN], &[0.0, 1.0], "skyhook.gains_n_s_m[1] is NaN"),
            (
                &[1.0, 2.0],
                &[1.0, 1.0],
                "skyhook.centres_a[1] is 1, but must be greater than the centre before it",
            ),
            (
                &[1.0, 2.0],
                &[0.0, 2.6],
                "skyhook.centres_a[1] is 2.6, but must be between 0 and current.max_a",
            ),
        ] {
            let law = ControlLaw::SkyhookGains(SkyhookGains::new(gains, centres));
            let refused = law.validate(2.5).expect_err("does not fit").to_string();
            assert!(refused.starts_with(expected), "{refused}");
            assert_eq!((law.name(), law.needs_inverse()), ("skyhook", true));
        }
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
