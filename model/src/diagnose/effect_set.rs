//! The effects of the library that a diagnosis may name.

use crate::effect::Effect;
use crate::error::{DiagnosisError, Error};

/// Effects that may be named. An effect that is left out does not enter the correction for multiple tests; it is listed as untestable,
/// never as absent.
///
/// ```
/// use mr_damper_model::diagnose::EffectSet;
/// use mr_damper_model::effect::Effect;
///
/// let set = EffectSet::only(&["friction", "inertia"])?;
/// assert!(set.has(Effect::Friction) && !set.has(Effect::CoilLag));
/// assert!(!EffectSet::NONE.has(Effect::Friction));
/// let error = EffectSet::only(&["cavitation"]).unwrap_err().to_string();
/// assert!(error.starts_with("unknown effect \"cavitation\"; the known effects are coil_lag,"), "{error}");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EffectSet {
    /// In the order of [`Effect::ALL`].
    included: [bool; Effect::ALL.len()],
}

impl EffectSet {
    /// The whole library.
    pub const ALL: Self = Self { included: [true; Effect::ALL.len()] };
    /// No effect: only terms are searched.
    pub const NONE: Self = Self { included: [false; Effect::ALL.len()] };

    /// The effects with these ids, in all their forms.
    ///
    /// # Errors
    /// [`DiagnosisError::UnknownEffect`]; [`DiagnosisError::NoEffect`] if `ids` is empty.
    pub fn only<S: AsRef<str>>(ids: &[S]) -> Result<Self, Error> {
        if ids.is_empty() {
            return Err(DiagnosisError::NoEffect { known: Effect::ids() }.into());
        }
        ids.iter().try_for_each(|id| check_id(id.as_ref()))?;
        Ok(Self { included: Effect::ALL.map(|effect| ids.iter().any(|id| id.as_ref() == effect.id())) })
    }

    /// This set without the effects with these ids, in all their forms. It may be empty.
    pub(super) fn without(&self, ids: impl IntoIterator<Item = &'static str>) -> Self {
        let ids: Vec<&str> = ids.into_iter().collect();
        Self { included: Effect::ALL.map(|effect| self.has(effect) && !ids.contains(&effect.id())) }
    }

    /// The effects of this set that can be confused with `effect`, and `effect` itself. `None` if that is the only one.
    pub(super) fn among(&self, effect: Effect) -> Option<Self> {
        let alike = |other: Effect| {
            other.id() == effect.id()
                || effect.confounders().contains(&other.id())
                || other.confounders().contains(&effect.id())
        };
        let included = Effect::ALL.map(|other| self.has(other) && alike(other));
        let others = Effect::ALL.iter().zip(included).filter(|(other, is)| *is && other.id() != effect.id());
        (others.count() > 0).then_some(Self { included })
    }

    /// True if a form of the effect with this id may be named.
    pub(super) fn has_id(&self, id: &str) -> bool {
        Effect::ALL.iter().any(|effect| effect.id() == id && self.has(*effect))
    }

    /// True if `effect` may be named.
    #[must_use]
    pub fn has(&self, effect: Effect) -> bool {
        Effect::ALL.iter().zip(self.included).any(|(known, included)| included && *known == effect)
    }
}

/// Rejects an id that no effect of the library has.
pub(super) fn check_id(id: &str) -> Result<(), Error> {
    let known = Effect::ids();
    match known.contains(&id) {
        true => Ok(()),
        false => Err(DiagnosisError::UnknownEffect { id: id.to_owned(), known }.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_selects_all_its_forms_and_an_unknown_id_is_an_error() {
        assert!(Effect::ALL.into_iter().all(|effect| EffectSet::ALL.has(effect)));
        let two = EffectSet::only(&["force_lag", "friction"]).expect("both are there");
        let found: Vec<Effect> = Effect::ALL.into_iter().filter(|effect| two.has(*effect)).collect();
        assert_eq!(
            found,
            [Effect::Friction, Effect::FrictionOwnScale, Effect::ForceLag, Effect::SeriesSpring]
        );
        let message =
            EffectSet::only(&["friction", "cavitation"]).expect_err("none of the library").to_string();
        assert!(
            message.starts_with("unknown effect \"cavitation\"; the known effects are coil_lag, remanence,"),
            "{message}"
        );
        assert!(EffectSet::only::<&str>(&[]).is_err());
    }
}
