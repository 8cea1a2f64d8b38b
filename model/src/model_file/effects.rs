//! Effects in a model file: one table per effect, in order of application, with parameters by name. A discovered term is a table with the
//! id `term`; its place in the order is fixed, so it may stand anywhere.

use super::{missing, not_a_number};
use crate::edit_distance::edit_distance;
use crate::effect::term::{Argument, Form, ID, Modulator, Term, Terms};
use crate::effect::{Effect, EffectModel, Effects};
use crate::error::{Error, ModelFileError};
use crate::force::ForceModel;
use crate::sample::DriveKind;
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;
use toml::{Table, Value};

/// Keys of a term.
const KEYS: [&str; 8] =
    ["id", "modulator", "argument", "form", "confirmed_in", "equation", "parameters", "units"];

/// One effect as written: id, form, and its parameters in their own order; or one term.
#[derive(Debug)]
pub(super) enum Written {
    Effect(EffectModel),
    /// With the unit of the drive.
    Term(Term, &'static str),
}

impl Serialize for Written {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        let own = match self {
            Self::Effect(own) => own,
            Self::Term(term, drive) => {
                let (modulator, argument, form) = term.kind();
                map.serialize_entry("id", ID)?;
                map.serialize_entry("modulator", modulator.name())?;
                map.serialize_entry("argument", argument.name())?;
                map.serialize_entry("form", form.name())?;
                map.serialize_entry("confirmed_in", &term.confirmed_in())?;
                map.serialize_entry("equation", &term.equation(drive))?;
                let numbers = term.numbers(drive);
                let values: BTreeMap<&str, f64> = numbers.iter().map(|own| (own.name, own.value)).collect();
                let units: BTreeMap<&str, &str> =
                    numbers.iter().map(|own| (own.name, &own.unit[..])).collect();
                map.serialize_entry("parameters", &values)?;
                map.serialize_entry("units", &units)?;
                return map.end();
            }
        };
        let effect = own.effect();
        map.serialize_entry("id", effect.id())?;
        if let Some(form) = effect.form() {
            map.serialize_entry("form", form)?;
        }
        for (parameter, value) in effect.parameters().iter().zip(own.parameters()) {
            map.serialize_entry(parameter.name, value)?;
        }
        map.end()
    }
}

/// The tables of `effects`, which are around `force`.
pub(super) fn write(effects: &Effects, force: &ForceModel) -> Vec<Written> {
    let terms = effects.terms().iter().map(|term| Written::Term(*term, drive_unit(force)));
    effects.as_slice().iter().copied().map(Written::Effect).chain(terms).collect()
}

/// The effects in `tables`, checked against `force`.
pub(super) fn read(tables: &[Table], force: &ForceModel) -> Result<Effects, Error> {
    let (mut models, mut terms) = (Vec::new(), Vec::new());
    for (index, table) in tables.iter().enumerate() {
        match table.get("id").and_then(Value::as_str) {
            Some(ID) => terms.push(term(index, table, drive_unit(force))?),
            _ => models.push(one(index, table)?),
        }
    }
    let effects = Effects::new(&models)?.with_terms(Terms::new(&terms)?);
    effects.check(force)?;
    Ok(effects)
}

/// The unit of a model's drive; A without one.
fn drive_unit(force: &ForceModel) -> &'static str {
    force.drive().map_or("A", DriveKind::unit)
}

fn term(index: usize, table: &Table, drive: &str) -> Result<Term, Error> {
    let at = format!("effects[{index}]");
    if let Some(key) = table.keys().find(|key| !KEYS.contains(&key.as_str())) {
        return Err(unknown_key(&at, key, KEYS.iter().copied()));
    }
    let modulator = named(table, &at, "modulator", Modulator::named, &Modulator::ALL.map(Modulator::name))?;
    let argument = named(table, &at, "argument", Argument::named, &Argument::ALL.map(Argument::name))?;
    let form = named(table, &at, "form", Form::named, &Form::ALL.map(Form::name))?;
    let confirmed_in = range(table, &at, "confirmed_in")?;
    let (of, at) = (sub_table(table, &at, "parameters")?, format!("{at}.parameters"));
    let names = || std::iter::once("amount").chain(form.parameters().iter().map(|parameter| parameter.name));
    if let Some(key) = of.keys().find(|key| names().all(|name| name != key.as_str())) {
        return Err(unknown_key(&at, key, names()));
    }
    let values: Vec<f64> = names().map(|name| number(of, &at, name)).collect::<Result<_, _>>()?;
    let term = Term::new((modulator, argument, form), values[0], &values[1..], confirmed_in)
        .map_err(|error| ModelFileError::Effect { index, error: Box::new(error) })?;
    check_units(index, table, &term, drive)?;
    Ok(term)
}

/// Refuses units that are not the ones of `term`: its numbers would mean something else.
fn check_units(index: usize, table: &Table, term: &Term, drive: &str) -> Result<(), Error> {
    let at = format!("effects[{index}]");
    if !table.contains_key("units") {
        return Ok(());
    }
    let (units, at) = (sub_table(table, &at, "units")?, format!("{at}.units"));
    for own in term.numbers(drive) {
        if let Some(found) = text(units, &at, own.name)?.filter(|found| *found != own.unit) {
            let (key, found, expected) = (format!("{at}.{}", own.name), found.to_owned(), own.unit);
            return Err(ModelFileError::TermUnit { key, found, expected }.into());
        }
    }
    Ok(())
}

fn sub_table<'a>(table: &'a Table, at: &str, key: &str) -> Result<&'a Table, Error> {
    match table.get(key) {
        Some(Value::Table(own)) => Ok(own),
        Some(other) => {
            let (key, found) = (format!("{at}.{key}"), other.to_string());
            Err(ModelFileError::WrongType { key, found, expected: "a table" }.into())
        }
        None => Err(missing(format!("{at}.{key}"))),
    }
}

/// The part of a term whose name is `table[key]`.
fn named<T>(
    table: &Table,
    at: &str,
    key: &'static str,
    of_name: impl Fn(&str) -> Option<T>,
    known: &[&'static str],
) -> Result<T, Error> {
    let name = text(table, at, key)?.ok_or_else(|| missing(format!("{at}.{key}")))?;
    let nearest = || known.iter().min_by_key(|other| edit_distance(other, name)).copied().unwrap_or_default();
    of_name(name).ok_or_else(|| {
        let (key, found, known) = (format!("{at}.{key}"), name.to_owned(), known.to_vec());
        ModelFileError::TermPart { key, found, nearest: nearest(), known }.into()
    })
}

fn number(table: &Table, at: &str, key: &str) -> Result<f64, Error> {
    match table.get(key) {
        Some(Value::Float(value)) => Ok(*value),
        Some(Value::Integer(value)) => Ok(*value as f64),
        Some(other) => Err(not_a_number(format!("{at}.{key}"), other)),
        None => Err(missing(format!("{at}.{key}"))),
    }
}

/// A list of two numbers.
fn range(table: &Table, at: &str, key: &str) -> Result<[f64; 2], Error> {
    let one = |value: &Value| match value {
        Value::Float(value) => Some(*value),
        Value::Integer(value) => Some(*value as f64),
        _ => None,
    };
    let Some(found) = table.get(key) else { return Err(missing(format!("{at}.{key}"))) };
    match found.as_array().map(Vec::as_slice) {
        Some([low, high]) => one(low).zip(one(high)).map(|(low, high)| [low, high]),
        _ => None,
    }
    .ok_or_else(|| {
        let (key, found) = (format!("{at}.{key}"), found.to_string());
        ModelFileError::WrongType { key, found, expected: "two numbers" }.into()
    })
}

fn unknown_key(at: &str, key: &str, known: impl Iterator<Item = &'static str>) -> Error {
    let nearest = known.min_by_key(|name| edit_distance(name, key)).unwrap_or("id").to_owned();
    ModelFileError::UnknownKey { key: format!("{at}.{key}"), nearest }.into()
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
            return Err(unknown_key(&at, key, parameters.iter().map(|p| p.name)));
        }
    }
    let mut values = Vec::with_capacity(parameters.len());
    for parameter in parameters {
        values.push(number(table, &at, parameter.name)?);
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
    known.push(ID);
    let nearest = known.iter().min_by_key(|name| edit_distance(name, id)).copied().unwrap_or_default();
    ModelFileError::UnknownEffectId { index, id: id.to_owned(), nearest, known }.into()
}
