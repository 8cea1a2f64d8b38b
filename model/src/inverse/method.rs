//! How the current for a force is found.
//!
//! ```text
//! search       F(i, x, v, states) = Fd by a bracketed search on the model          exact, for any model
//! polynomial   i = (Fd - sum_k b_k v^k) / sum_k c_k v^k                             Choi, Lee, Park (2001)
//! fuzzy        i = sum_r W_r(x, v, Fd) f_r(x, v, Fd) / sum_r W_r                    ANFIS, force and current swapped
//! chen         i_k = N(x, v, Fd of two samples, i_{k-1})                             identified from runs, see InverseModel
//! wang-liao    i_k = N(x, v, Fd of five samples, i_{k-1} .. i_{k-5})                 likewise
//! wang-hu      i = sum_r W_r(v, a, Fd) f_r(v, a, Fd) / sum_r W_r                    likewise
//! ```
//!
//! A model that is linear in the current has a closed form. It is not a method of its own: the search uses it automatically, because it
//! needs only the two forces that are computed anyway ([`super::Solver`], [`super::Shape::is_linear`]).
//!
//! `polynomial` and `fuzzy` are **surrogates**: functions fitted to the model when it is loaded, as usual in the literature. They take the
//! same time at every sample, and have an error relative to the model. They replace the search only. The damper's achievable range is still
//! computed from the model at each sample, so clipping, dissipation, bias, lead, rate and hold work as with the search.
//!
//! A surrogate is a function of motion and force alone. It does not support a model whose force turns back over the current by more than a
//! tenth, because two currents then give one force. If the force turns back by less, demands above the force at the largest current are
//! clipped to it. It does not support a model that is autoregressive in force (the current acts samples later), or effects that do more
//! than lag the coil or add a force.
//!
//! `chen`, `wang-liao` and `wang-hu` are **learned inverses** ([`super::InverseModel`]): they were identified from recorded runs and come
//! with the model. They replace the search in the same way as surrogates, with these differences:
//!
//! - Their past forces are the demands, clipped to the achievable range. Their past currents are the commanded currents after limits.
//! - They invert the damper of the runs and not the model, so the model's bias and its added effects are not subtracted from the demand.
//! - Their current is the driver's. They have learned the lag of the coil, so no lead is added.
//! - If they give no current, the search does, and the command says so ([`super::CurrentCommand::substituted`]). They give none if it is
//!   not finite, or if a needed past sample is not known: at the start, after a gap, after a swap of the model, after a sample without a
//!   demand, and at another sample rate.
//!
//! They do not support a model that is autoregressive in force, or whose force turns back, because the achievable range comes from that
//! model.

use crate::inverse_model::InverseKind;

/// How the current for a force is found.
///
/// ```
/// use mr_damper_model::inverse::{InverseController, Limits, Method};
/// use mr_damper_model::preset;
///
/// let method = Method::named("polynomial").expect("a method of the library");
/// let fuzzy_tanh = preset::load(preset::BEST_FUZZY_TANH)?;
/// assert!(InverseController::with_method(&fuzzy_tanh, Limits::default(), method).is_ok());
/// // ARX is autoregressive in force, so its inverse is not a function of motion and force.
/// let arx = preset::load(preset::BEST_ARX)?;
/// assert!(InverseController::with_method(&arx, Limits::default(), method).is_err());
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Method {
    /// A bracketed search on the model, or its closed form if it is linear in the current.
    #[default]
    Search,
    /// A polynomial in the velocity with coefficients linear in the current, fitted to the model.
    Polynomial,
    /// Fuzzy rules over displacement, velocity and force, fitted to the model.
    Fuzzy,
    /// The learned inverse network of Chen.
    Chen,
    /// The learned inverse recurrent network of Wang and Liao.
    WangLiao,
    /// The learned inverse fuzzy rules of Wang and Hu.
    WangHu,
}

impl Method {
    /// All methods.
    pub const ALL: [Self; 6] =
        [Self::Search, Self::Polynomial, Self::Fuzzy, Self::Chen, Self::WangLiao, Self::WangHu];

    /// The name, as in parameters.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Search => "search",
            Self::Polynomial => "polynomial",
            Self::Fuzzy => "fuzzy",
            Self::Chen => InverseKind::Chen.name(),
            Self::WangLiao => InverseKind::WangLiao.name(),
            Self::WangHu => InverseKind::WangHu.name(),
        }
    }

    /// The learned inverse that the method needs in the model file; `None` for the search and the surrogates.
    #[must_use]
    pub const fn learned(self) -> Option<InverseKind> {
        match self {
            Self::Search | Self::Polynomial | Self::Fuzzy => None,
            Self::Chen => Some(InverseKind::Chen),
            Self::WangLiao => Some(InverseKind::WangLiao),
            Self::WangHu => Some(InverseKind::WangHu),
        }
    }

    /// The method called `name`.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|method| method.name() == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_parses_back_to_its_method() {
        for method in Method::ALL {
            assert_eq!(Method::named(method.name()), Some(method));
        }
        assert_eq!((Method::default(), Method::named("closed")), (Method::Search, None));
    }
}
