//! Which effects of the library a closing looks for.

use crate::effect::Effect;
use crate::error::Error;

/// Effects that may be named. Those that are left out weigh on no other's significance; they are listed as untestable, never as
/// absent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sought {
    /// In the order of [`Effect::ALL`].
    sought: [bool; Effect::ALL.len()],
}

impl Sought {
    /// The whole library.
    pub const ALL: Self = Self { sought: [true; Effect::ALL.len()] };

    /// The effects of these ids, each in every form.
    ///
    /// # Errors
    /// [`Error::Data`] when an id is none of the library's, or there is none.
    pub fn only<S: AsRef<str>>(ids: &[S]) -> Result<Self, Error> {
        let known = Effect::ids();
        let wrong = ids.iter().map(AsRef::as_ref).find(|id| !known.contains(id));
        if let Some(id) = wrong.or(ids.is_empty().then_some("")) {
            return Err(Error::Data {
                message: format!("there is no effect \"{id}\" to look for; there are {}", known.join(", ")),
            });
        }
        Ok(Self { sought: Effect::ALL.map(|effect| ids.iter().any(|id| id.as_ref() == effect.id())) })
    }

    /// True for one that may be named.
    #[must_use]
    pub fn has(&self, effect: Effect) -> bool {
        Effect::ALL.iter().zip(self.sought).any(|(known, sought)| sought && *known == effect)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_stands_for_all_its_forms_and_a_wrong_one_is_told() {
        assert!(Effect::ALL.into_iter().all(|effect| Sought::ALL.has(effect)));
        let two = Sought::only(&["force_lag", "friction"]).expect("both are there");
        let found: Vec<Effect> = Effect::ALL.into_iter().filter(|effect| two.has(*effect)).collect();
        assert_eq!(found, [Effect::Friction, Effect::ForceLag, Effect::SeriesSpring]);
        let told = Sought::only(&["friction", "cavitation"]).expect_err("none of the library").to_string();
        assert!(
            told.starts_with("there is no effect \"cavitation\" to look for; there are coil_lag, remanence,"),
            "{told}"
        );
        assert!(Sought::only::<&str>(&[]).is_err());
    }
}
