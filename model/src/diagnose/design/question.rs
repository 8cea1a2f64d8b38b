//! The question that a run decides: effects that confound each other, and effects that may be there or not.

use super::super::effect_set::check_id;
use super::DesignError;
use crate::effect::Effect;
use crate::error::Error;

/// The question that a run decides. The effects of a group are rivals of each other; an effect that is alone in its group has the model without it as
/// rival.
///
/// ```
/// use mr_damper_model::diagnose::design::Question;
///
/// let question = Question::parse("friction|gas_spring, inertia")?;
/// assert_eq!(question.groups(), [vec!["friction", "gas_spring"], vec!["inertia"]]);
/// assert_eq!(question.to_string(), "friction|gas_spring, inertia");
/// let error = Question::parse("friction|cavitation").unwrap_err().to_string();
/// assert!(error.starts_with("unknown effect \"cavitation\"; the known effects are coil_lag,"), "{error}");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Question {
    groups: Vec<Vec<&'static str>>,
}

impl Question {
    /// The groups of ids. A group or an id that is given again is left out.
    ///
    /// # Errors
    /// [`DiagnosisError::UnknownEffect`](crate::error::DiagnosisError::UnknownEffect); [`DesignError::NoRival`] if there is no id.
    pub fn new<S: AsRef<str>>(groups: &[Vec<S>]) -> Result<Self, Error> {
        let known = Effect::ids();
        let mut found: Vec<Vec<&'static str>> = Vec::new();
        for group in groups {
            let mut ids: Vec<&'static str> = Vec::new();
            for id in group {
                check_id(id.as_ref())?;
                if let Some(id) = known.iter().find(|known| **known == id.as_ref() && !ids.contains(known)) {
                    ids.push(id);
                }
            }
            if !ids.is_empty() && !found.contains(&ids) {
                found.push(ids);
            }
        }
        if found.is_empty() {
            return Err(DesignError::NoRival { known }.into());
        }
        Ok(Self { groups: found })
    }

    /// The question in `text`: a comma between groups, `|` between the effects of a group.
    ///
    /// # Errors
    /// As [`Question::new`].
    pub fn parse(text: &str) -> Result<Self, Error> {
        let words = |group: &str| -> Vec<String> {
            group.split('|').map(|id| id.trim().to_owned()).filter(|id| !id.is_empty()).collect()
        };
        Self::new(&text.split(',').map(words).collect::<Vec<_>>())
    }

    /// The groups of ids.
    #[must_use]
    pub fn groups(&self) -> &[Vec<&'static str>] {
        &self.groups
    }

    /// All ids, each once, in the order of the library.
    pub(super) fn ids(&self) -> Vec<&'static str> {
        let has = |id: &&'static str| self.groups.iter().any(|group| group.contains(id));
        Effect::ids().into_iter().filter(has).collect()
    }

    /// Rivals of the effect `id`; `None` stands for the model without it.
    pub(super) fn rivals(&self, id: &str) -> Vec<Option<&'static str>> {
        let mut rivals = Vec::new();
        for group in self.groups.iter().filter(|group| group.contains(&id)) {
            let others = group.iter().filter(|other| **other != id).map(|other| Some(*other));
            let own: Vec<_> = if group.len() > 1 { others.collect() } else { vec![None] };
            rivals.extend(own.into_iter().filter(|rival| !rivals.contains(rival)).collect::<Vec<_>>());
        }
        rivals
    }
}

impl std::fmt::Display for Question {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let groups: Vec<String> = self.groups.iter().map(|group| group.join("|")).collect();
        f.write_str(&groups.join(", "))
    }
}
