//! The header row of a CSV file: its names, and why it does not describe the rows.

use super::number;
use crate::column::{Column, Quantity, THESIS_ORDER};
use crate::map::Map;
use crate::names::topic_of;
use crate::suggest;
use crate::unit::TimeUnit;
use crate::unit::all_names;
use csv::ByteRecord;
use mr_damper_base::shown::count;

/// Number of rows below the header that are compared with it.
pub(super) const ROWS_COMPARED: usize = 5;

/// Example of a header.
const EXAMPLE: &str = "time_s,displacement_m,current_a,force_n";

/// Why a header cannot be used. Columns count from 1.
#[derive(Debug, thiserror::Error)]
pub(super) enum HeaderFault {
    #[error("column {number} is named `{name}`, which is not UTF-8: save the file as UTF-8")]
    NotUtf8 { number: usize, name: String },
    #[error("column {number} has no name: name it or remove it")]
    Unnamed { number: usize },
    #[error("columns `{first}` and `{second}` are the same quantity: remove one of them")]
    SameQuantity { first: String, second: String },
    #[error(
        "all fields are numbers, so the file has no header row; add one with the names in the order of the columns, such as \
         `{EXAMPLE}`{}{}",
        if *fields == THESIS_ORDER.len() {
            ", or give --thesis-txt for the order time, displacement, force, current, ambient, case, set point"
        } else {
            ""
        },
        comment.map(|line| format!("; if line {line} is the header, remove its `#`")).unwrap_or_default()
    )]
    Numbers {
        /// Number of fields.
        fields: usize,
        /// Line of a comment above that has as many fields.
        comment: Option<u64>,
    },
    #[error(
        "no column `time_s` among: {columns}; the fields seem to be split by `;` or tabs: split them by commas, and write numbers with \
         decimal points"
    )]
    OtherSeparator { columns: String },
    #[error(
        "no column {lacks} among: {columns}; all of them hold other quantities: add what is missing to the file"
    )]
    NotInFile { lacks: String, columns: String },
    #[error(
        "no column {lacks} among: {columns}; the unit belongs to the name, as in displacement_mm, or say which column it is, as in \
         {flag}, or name the columns with --column NAME=HEADER,...; all names are {}",
        all_names()
    )]
    NotNamed { lacks: String, columns: String, flag: String },
    #[error(
        "{}, {expected} expected; the fields seem to be split by `;`, tabs or blanks: split them by commas, and write numbers with \
         decimal points",
        count(*found, "field")
    )]
    RowSeparator { found: usize, expected: usize },
    #[error(
        "{found} fields, {expected} expected; the numbers probably have decimal commas, and a comma splits two fields: write the numbers \
         with decimal points"
    )]
    DecimalCommas { found: usize, expected: usize },
    #[error(
        "{found} fields, {expected} expected; the header has too few names for the rows below it: name every column, or remove the \
         surplus fields from every row"
    )]
    TooShort { found: usize, expected: usize },
    #[error("`{row}` looks like a row of units, because no field is a number: remove the row")]
    Units { row: String },
}

/// The names of the columns.
pub(super) fn names(header: &ByteRecord) -> Result<Vec<String>, HeaderFault> {
    let name_of = |(index, name): (usize, &[u8])| {
        let name = if index == 0 { without_bom(name) } else { name };
        let number = index + 1;
        let text = std::str::from_utf8(name.trim_ascii())
            .map_err(|_| HeaderFault::NotUtf8 { number, name: String::from_utf8_lossy(name).into_owned() })?;
        // A name of Unicode blanks is refused, because it could not be written again.
        if text.trim().is_empty() {
            return Err(HeaderFault::Unnamed { number });
        }
        Ok(text.to_owned())
    };
    header.iter().enumerate().map(name_of).collect()
}

/// `text` without a byte order mark at its beginning.
pub(super) fn without_bom(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text)
}

/// The names of the columns, for a message.
pub(super) fn shown(names: &[String]) -> String {
    names.join(", ").chars().take(200).collect()
}

/// The fault of a header in which time or displacement has no name.
pub(super) fn missing(no_time: bool, no_displacement: bool, names: &[String]) -> HeaderFault {
    let columns = shown(names);
    if let [only] = names
        && only.contains([';', '\t'])
    {
        return HeaderFault::OtherSeparator { columns };
    }
    let displacement = || format!("displacement ({})", Quantity::Displacement.names());
    let (lacks, quantity) = match (no_time, no_displacement) {
        (true, false) => ("`time_s`".to_owned(), None),
        (true, true) => (format!("`time_s` and no {}", displacement()), None),
        (false, _) => (displacement(), Some(Quantity::Displacement)),
    };
    let mut others = names.iter().map(String::as_str).filter(|name| is_other(name)).peekable();
    if others.peek().is_none() {
        return HeaderFault::NotInFile { lacks, columns };
    }
    let flag = suggest::column_for(quantity, others)
        .unwrap_or_else(|| format!("--map {}=COLUMN", quantity.map_or("time", topic_of)));
    HeaderFault::NotNamed { lacks, columns, flag }
}

/// The names in a comment. The `#` belongs to the first of them only if that name is not known without it: a column of numbers of rows
/// may be named `#`.
pub(super) fn in_comment(fields: &ByteRecord, map: &Map) -> ByteRecord {
    let is_known = |name: &[u8]| {
        std::str::from_utf8(name).is_ok_and(|name| !is_other(name))
            || map.all().iter().any(|mapping| mapping.source.as_bytes() == name)
    };
    let name_of =
        |(index, field)| match (index, without_bom(field).strip_prefix(b"#").map(<[u8]>::trim_ascii)) {
            (0, Some(name)) if is_known(name) => name,
            _ => field,
        };
    fields.iter().enumerate().map(name_of).collect()
}

/// True if one of the names is that of the time, or the map takes the time from it.
pub(super) fn names_time(names: &ByteRecord, map: &Map) -> bool {
    let mapped = map.of_time().map(|mapping| mapping.source.as_bytes());
    let is_time = |(index, name): (usize, &[u8])| {
        let name = if index == 0 { without_bom(name).trim_ascii() } else { name };
        mapped == Some(name) || std::str::from_utf8(name).is_ok_and(|name| TimeUnit::of_name(name).is_some())
    };
    names.iter().enumerate().any(is_time)
}

/// True if the name is not one of the run format.
fn is_other(name: &str) -> bool {
    matches!(Column::of_header(name), Column::Other) && TimeUnit::of_name(name).is_none()
}

/// The fault of a header that has only numbers, which may be split by blanks and tabs, too. `None` if the map names one of them: pandas
/// gives columns such names. `comment` is the line of a comment with as many fields.
pub(super) fn only_numbers(row: &ByteRecord, comment: Option<u64>, map: &Map) -> Option<HeaderFault> {
    let of_field = |(index, field)| if index == 0 { without_bom(field) } else { field };
    let parts = row.iter().enumerate().map(of_field).flat_map(|field| field.split(u8::is_ascii_whitespace));
    let mut numbers = parts.filter(|part| !part.is_empty()).map(number);
    let fields = numbers.try_fold(0, |found, number| number.map(|_| found + 1))?;
    let is_mapped = map.all().iter().any(|mapping| row.iter().any(|it| it == mapping.source.as_bytes()));
    let comment = comment.filter(|_| row.len() > 1);
    (fields > 0 && !is_mapped).then_some(HeaderFault::Numbers { fields, comment })
}

/// The fault of a header of `expected` names that the first rows below it show. `None` if some of them fit: then the others are bad.
pub(super) fn against(expected: usize, rows: &[ByteRecord]) -> Option<HeaderFault> {
    let (first, rest) = rows.split_first()?;
    let found = first.len();
    let is_split_otherwise = |row: &ByteRecord| {
        let has = |bytes: &[u8]| row.iter().any(|field| field.iter().any(|byte| bytes.contains(byte)));
        row.len() != expected && (has(b";") || (row.len() == 1 && has(b"\t ")))
    };
    if rows.iter().all(is_split_otherwise) {
        return Some(HeaderFault::RowSeparator { found, expected });
    }
    if rows.iter().all(|row| row.len() > expected) {
        // The parts of a number with a decimal comma have no point.
        let is_part = |field: &[u8]| number(field).is_some() && !field.contains(&b'.');
        let is_in_parts = |row: &ByteRecord| row.len() <= 2 * expected && row.iter().all(is_part);
        return Some(match rows.iter().all(is_in_parts) {
            true => HeaderFault::DecimalCommas { found, expected },
            false => HeaderFault::TooShort { found, expected },
        });
    }
    let has_number = |row: &ByteRecord| row.iter().any(|field| number(field).is_some());
    let is_blank = |row: &ByteRecord| row.iter().all(<[u8]>::is_empty);
    if !has_number(first) && !is_blank(first) && rest.first().is_some_and(has_number) {
        let fields: Vec<_> = first.iter().map(|field| String::from_utf8_lossy(field).into_owned()).collect();
        return Some(HeaderFault::Units { row: shown(&fields) });
    }
    None
}
