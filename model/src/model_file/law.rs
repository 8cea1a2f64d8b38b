//! Parameters of a force law in a model file.
//!
//! Each parameter is a number (no dependence on the drive), a list of coefficients of i^0, i^1, ... (each in
//! the parameter's unit over that power of the drive's unit), or a list with one value for each fuzzy set.

use super::memberships::{self, Memberships};
use super::{drive_error, missing, table_into};
use crate::error::{Error, ModelFileError};
use crate::force::{Dependence, ForceLaw, LawModel};
use crate::sample::DriveKind;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Parameters {
    force_offset_n: f64,
    /// `none`, `polynomial` or `fuzzy`.
    dependence: String,
    #[serde(flatten)]
    memberships: Memberships,
    #[serde(flatten)]
    values: BTreeMap<String, Value>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum Value {
    One(f64),
    Many(Vec<f64>),
}

impl Value {
    pub(super) fn as_slice(&self) -> &[f64] {
        match self {
            Self::One(value) => std::slice::from_ref(value),
            Self::Many(values) => values,
        }
    }
}

impl Parameters {
    pub(super) fn of(model: &LawModel) -> Self {
        let names = model.law().parameters();
        let copies = || model.coefficients().chunks_exact(names.len());
        let value = |j: usize| match model.dependence() {
            Dependence::None => Value::One(model.coefficients()[j]),
            _ => Value::Many(copies().map(|copy| copy[j]).collect()),
        };
        Self {
            force_offset_n: model.force_offset_n(),
            dependence: model.dependence().name().to_owned(),
            memberships: match model.dependence() {
                Dependence::Fuzzy(sets) => Memberships::of(sets),
                _ => Memberships::default(),
            },
            values: names.iter().enumerate().map(|(j, p)| (p.name.to_owned(), value(j))).collect(),
        }
    }
}

pub(super) fn read(law: ForceLaw, drive: Option<DriveKind>, table: &toml::Table) -> Result<LawModel, Error> {
    let parameters = law.parameters();
    let mut keys = vec!["force_offset_n", "dependence"];
    keys.extend(memberships::KEYS);
    keys.extend(parameters.iter().map(|p| p.name));
    let p: Parameters = table_into("parameters", table.clone(), &keys)?;
    let values = |j: usize| {
        let name = parameters[j].name;
        let value = p.values.get(name).ok_or_else(|| missing(format!("parameters.{name}")))?;
        Ok::<_, Error>((name, value.as_slice()))
    };
    let first = values(0)?.1.len();
    let dependence = dependence(&p.dependence, drive, first, &p.memberships)?;
    let copies = dependence.copies();
    let mut coefficients = vec![0.0; copies * parameters.len()];
    for j in 0..parameters.len() {
        let (name, list) = values(j)?;
        if list.len() != copies {
            return Err(Error::Length {
                name: format!("parameters.{name}"),
                found: list.len(),
                expected: format!("{copies} (one for each power of the drive, or each membership centre)"),
            });
        }
        for (copy, value) in list.iter().enumerate() {
            coefficients[copy * parameters.len() + j] = *value;
        }
    }
    LawModel::new(law, dependence, &coefficients, p.force_offset_n)
}

/// The dependence `name`; a polynomial has `copies` coefficients per parameter.
pub(super) fn dependence(
    name: &str,
    drive: Option<DriveKind>,
    copies: usize,
    memberships: &Memberships,
) -> Result<Dependence, Error> {
    Ok(match (name, drive) {
        ("none", None) => Dependence::None,
        ("polynomial", Some(drive)) => Dependence::Polynomial { drive, degree: copies.saturating_sub(1) },
        ("fuzzy", Some(drive)) => Dependence::Fuzzy(memberships.read(drive)?),
        ("none" | "polynomial" | "fuzzy", _) => {
            return Err(drive_error(
                drive,
                "dependence = \"none\" without a drive, or another dependence with one",
            ));
        }
        (other, _) => {
            return Err(ModelFileError::UnknownWord {
                key: "parameters.dependence".to_owned(),
                found: other.to_owned(),
                expected: "none, polynomial or fuzzy",
            }
            .into());
        }
    })
}
