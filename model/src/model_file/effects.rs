//! Effects in a model file: one table per effect, in order of application, with parameters by name.

use super::{missing, not_a_number};
use crate::edit_distance::edit_distance;
use crate::effect::{Effect, EffectModel, Effects};
use crate::error::{Error, ModelFileError};
use crate::force::ForceModel;
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use toml::{Table, Value};

/// One effect as written: id, form, and its parameters in their own order.
#[derive(Debug)]
pub(super) struct Written(EffectModel);

impl Serialize for Written {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let effect = self.0.effect();
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("id", effect.id())?;
        if let Some(form) = effect.form() {
            map.serialize_entry("form", form)?;
        }
        for (parameter, value) in effect.parameters().iter().zip(self.0.parameters()) {
            map.serialize_entry(parameter.name, value)?;
        }
        map.end()
    }
}

/// The tables of `effects`.
pub(super) fn write(effects: &Effects) -> Vec<Written> {
    effects.as_slice().iter().copied().map(Written).collect()
}

/// The effects in `tables`, checked against `force`.
pub(super) fn read(tables: &[Table], force: &ForceModel) -> Result<Effects, Error> {
    let models: Vec<EffectModel> =
        tables.iter().enumerate().map(|(index, table)| one(index, table)).collect::<Result<_, _>>()?;
    let effects = Effects::new(&models)?;
    effects.check(force)?;
    Ok(effects)
}

fn one(index: usize, table: &Table) -> Result<EffectModel, Error> {
    let at = format!("effects[{index}]");
    let id = text(table, &at, "id")?.ok_or_else(|| missing(format!("{at}.id")))?;
    let forms: Vec<Effect> = Effect::ALL.into_iter().filter(|effect| effect.id() == id).collect();
    if forms.is_empty() {
        return Err(unknown_id(index, id));
    }
    let form = text(table, &at, "form")?;
    let Some(effect) = forms.iter().copied().find(|effect| effect.form() == form) else {
        let known: Vec<&str> = forms.iter().filter_map(|effect| effect.form()).collect();
        let (id, found) = (forms[0].id(), form.map(str::to_owned));
        let plain = forms.iter().any(|effect| effect.form().is_none());
        return Err(ModelFileError::EffectForm { index, id, found, known, plain }.into());
    };
    let parameters = effect.parameters();
    for key in table.keys().filter(|key| !["id", "form"].contains(&key.as_str())) {
        if parameters.iter().all(|parameter| parameter.name != key) {
            let nearest = parameters.iter().map(|p| p.name).min_by_key(|name| edit_distance(name, key));
            let (key, nearest) = (format!("{at}.{key}"), nearest.unwrap_or("id").to_owned());
            return Err(ModelFileError::UnknownKey { key, nearest }.into());
        }
    }
    let mut values = Vec::with_capacity(parameters.len());
    for parameter in parameters {
        values.push(match table.get(parameter.name) {
            Some(Value::Float(value)) => *value,
            Some(Value::Integer(value)) => *value as f64,
            Some(other) => {
                return Err(not_a_number(format!("{at}.{}", parameter.name), other));
            }
            None => return Err(missing(format!("{at}.{}", parameter.name))),
        });
    }
    EffectModel::new(effect, &values)
        .map_err(|error| ModelFileError::Effect { index, error: Box::new(error) }.into())
}

fn text<'a>(table: &'a Table, at: &str, key: &str) -> Result<Option<&'a str>, Error> {
    match table.get(key) {
        None => Ok(None),
        Some(Value::String(text)) => Ok(Some(text)),
        Some(other) => Err(ModelFileError::WrongType {
            key: format!("{at}.{key}"),
            found: other.to_string(),
            expected: "a string in quotes",
        }
        .into()),
    }
}

fn unknown_id(index: usize, id: &str) -> Error {
    let mut known: Vec<&str> = Effect::ALL.into_iter().map(Effect::id).collect();
    known.dedup();
    let nearest = known.iter().min_by_key(|name| edit_distance(name, id)).copied().unwrap_or_default();
    ModelFileError::UnknownEffectId { index, id: id.to_owned(), nearest, known }.into()
}
