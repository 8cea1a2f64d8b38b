//! How the current for a force is found.
//!
//! ```text
//! search       F(i, x, v, states) = Fd by a bracketed search on the model          exact, for any model
//! polynomial   i = (Fd - sum_k b_k v^k) / sum_k c_k v^k                             Choi, Lee, Park (2001)
//! fuzzy        i = sum_r W_r(x, v, Fd) f_r(x, v, Fd) / sum_r W_r                    ANFIS, force and current swapped
//! ```
//!
//! The closed form of a model that is linear in the current has no name here: the search takes it where there is one, by the same
//! two forces, and nobody would want the one without the other ([`super::Solver`], [`super::Shape::is_linear`]).
//!
//! The other two are **surrogates**: functions fitted to the model when it is loaded, as the literature commands dampers. They cost the same
//! time at every sample, and as much as they miss the model by. They take the search's place and nothing else: what the damper can
//! give is still asked of the model at each sample, and so clipping, dissipation, bias, lead, rate and hold are those of the search.
//!
//! A surrogate is a function of motion and force alone. It cannot stand for a model whose force turns back over the current by more
//! than a tenth (two currents give one force; of one that turns back by less, forces beyond that at the largest current are
//! clipped to it), for one that is fed with its own force (the current's work comes samples later), nor for effects that do
//! more than lag the coil or add a force.

/// How the current for a force is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Method {
    /// By a bracketed search on the model, or by its closed form where it is linear in the current.
    #[default]
    Search,
    /// By a polynomial in the velocity whose coefficients are linear in the current, fitted to the model.
    Polynomial,
    /// By fuzzy rules over displacement, velocity and force, fitted to the model.
    Fuzzy,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Search, Self::Polynomial, Self::Fuzzy];

    /// The name, as in parameters.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Search => "search",
            Self::Polynomial => "polynomial",
            Self::Fuzzy => "fuzzy",
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
    fn names_go_both_ways() {
        for method in Method::ALL {
            assert_eq!(Method::named(method.name()), Some(method));
        }
        assert_eq!((Method::default(), Method::named("closed")), (Method::Search, None));
    }
}
