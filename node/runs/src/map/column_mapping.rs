//! Columns by name: `--column displacement_in=x_in`.

use super::{Channel, MapError, Mapping};
use crate::column::Column;
use crate::unit::{TimeUnit, Unit};
use std::str::FromStr;

/// A mapping that is given as a name of the run format and the header of a column: `displacement_in=x_in`.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnMapping(pub Mapping);

impl FromStr for ColumnMapping {
    type Err = MapError;

    fn from_str(text: &str) -> Result<Self, MapError> {
        let form = || MapError::ColumnForm { text: text.to_owned() };
        let (name, header) = text.split_once('=').ok_or_else(form)?;
        let (name, header) = (name.trim(), header.trim());
        if header.is_empty() || header.starts_with('/') {
            return Err(form());
        }
        let unknown = || MapError::ColumnName { name: name.to_owned() };
        let channel = match (TimeUnit::of_name(name), Column::of_header(name)) {
            (Some(unit), _) => Channel::Time(Some(unit)),
            (None, Column::Known(quantity, _)) => {
                Channel::Known(quantity, Unit::in_column(quantity.dimension(), name))
            }
            (None, _) => return Err(unknown()),
        };
        Ok(Self(Mapping { channel, source: header.to_owned(), negative: false, offset: 0.0 }))
    }
}
