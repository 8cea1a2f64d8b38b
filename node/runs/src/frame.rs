//! Runs from tables in memory, such as data frames. Columns have the names, units and checks of CSV files.

use super::csv::{Row, Table};
use super::csv_write;
use super::decimal::{parse_nanos, push_value, seconds_text};
use super::hash::{Hash, HashingWriter};
use super::sign;
use super::{LoadOptions, Loaded, Note, RunError};
use csv::ByteRecord;
use mr_damper_model::sample::Run;
use std::path::Path;

/// A column of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Its name, with the unit as in the header of a CSV file: `time_s`, `force_n`, `displacement_mm`, ...
    pub name: String,
    /// Its values, one for each row.
    pub values: Values,
}

/// The values of a column. `None` is an empty cell: the channel has no sample at the time of the row.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Decimal numbers without empty cells.
    Floats(Vec<f64>),
    /// Decimal numbers.
    OptionalFloats(Vec<Option<f64>>),
    /// Whole numbers, such as times in nanoseconds.
    Integers(Vec<i64>),
    /// Whole numbers with empty cells.
    OptionalIntegers(Vec<Option<i64>>),
    /// Times in nanoseconds since the epoch, exact in a column of any unit of time.
    Stamps(Vec<Option<i64>>),
}

/// One cell.
#[derive(Debug, Clone, Copy)]
enum Cell {
    Empty,
    Float(f64),
    Integer(i64),
    Stamp(i64),
}

impl Values {
    fn len(&self) -> usize {
        match self {
            Self::Floats(values) => values.len(),
            Self::OptionalFloats(values) => values.len(),
            Self::Integers(values) => values.len(),
            Self::OptionalIntegers(values) | Self::Stamps(values) => values.len(),
        }
    }

    fn cell(&self, row: usize) -> Cell {
        match self {
            Self::Floats(values) => Cell::Float(values[row]),
            Self::OptionalFloats(values) => values[row].map_or(Cell::Empty, Cell::Float),
            Self::Integers(values) => Cell::Integer(values[row]),
            Self::OptionalIntegers(values) => values[row].map_or(Cell::Empty, Cell::Integer),
            Self::Stamps(values) => values[row].map_or(Cell::Empty, Cell::Stamp),
        }
    }
}

/// One row of a table.
struct FrameRow<'a> {
    columns: &'a [Column],
    row: usize,
}

impl FrameRow<'_> {
    fn cell(&self, field: usize) -> Cell {
        self.columns[field].values.cell(self.row)
    }
}

impl Row for FrameRow<'_> {
    fn len(&self) -> usize {
        self.columns.len()
    }

    fn is_empty(&self, field: usize) -> bool {
        matches!(self.cell(field), Cell::Empty)
    }

    fn number(&self, field: usize) -> Option<f64> {
        match self.cell(field) {
            Cell::Empty | Cell::Stamp(_) => None,
            Cell::Float(value) => Some(value),
            Cell::Integer(value) => Some(value as f64),
        }
    }

    fn nanos(&self, field: usize, exponent: i32) -> Option<i64> {
        match self.cell(field) {
            Cell::Empty => None,
            // The shortest decimal text of a time is the text that it was read from, so a table that was read from a CSV file has the
            // stamps of that file.
            Cell::Float(value) => {
                let mut text = String::new();
                push_value(&mut text, value);
                parse_nanos(&text, exponent)
            }
            Cell::Integer(value) => {
                let factor = 10_i64.checked_pow(u32::try_from(9 + exponent).ok()?)?;
                value.checked_mul(factor)
            }
            Cell::Stamp(nanos) => Some(nanos),
        }
    }

    fn text(&self, field: usize) -> String {
        match self.cell(field) {
            Cell::Empty => String::new(),
            Cell::Float(value) => value.to_string(),
            Cell::Integer(value) => value.to_string(),
            Cell::Stamp(nanos) => seconds_text(nanos),
        }
    }
}

/// The run in a table. `name` is its name in messages and in the provenance of models; rows count from 0 in messages.
///
/// [`Loaded::sha256`] is the hash of the run as a CSV file in canonical form: the one of the file that `mr-damper convert` writes.
///
/// ```
/// use mr_damper_runs::{Column, LoadOptions, Values, from_columns};
///
/// let column = |name: &str, values: &[f64]| Column { name: name.to_owned(), values: Values::Floats(values.to_vec()) };
/// let table = [column("time_s", &[0.0, 0.002, 0.004]), column("displacement_mm", &[1.0, 2.0, 4.0])];
/// let run = from_columns("by hand", &table, &LoadOptions::default())?.run;
/// assert_eq!(run.displacement_m.values, [0.001, 0.002, 0.004]);
/// # Ok::<(), mr_damper_runs::RunError>(())
/// ```
///
/// # Errors
/// Those of a CSV file with this header; [`RunError::Row`] in place of an error with a line; [`RunError::Table`] in place
/// of an error of the header, and for columns of different lengths.
pub fn from_columns(name: &str, columns: &[Column], options: &LoadOptions) -> Result<Loaded, RunError> {
    let path = Path::new(name);
    if options.thesis_txt {
        let why =
            "a table with column names, so it is not a --thesis-txt file; leave thesis_txt out".to_owned();
        return Err(RunError::Table { path: path.to_owned(), why });
    }
    if columns.is_empty() {
        let why = "a table without columns; give time_s and displacement_m at least".to_owned();
        return Err(RunError::Table { path: path.to_owned(), why });
    }
    let rows = columns.first().map_or(0, |column| column.values.len());
    if let Some(other) = columns.iter().find(|column| column.values.len() != rows) {
        let (found, first) = (other.values.len(), &columns[0].name);
        let why = format!(
            "column `{}` has {found} rows, but `{first}` has {rows}; all columns need the same number of rows",
            other.name
        );
        return Err(RunError::Table { path: path.to_owned(), why });
    }
    let header: ByteRecord = columns.iter().map(|column| column.name.as_bytes()).collect();
    let mut table = Table::from_header(path, 0, &header, options).map_err(of_frame)?;
    for row in 0..rows {
        table.push(row as u64, &FrameRow { columns, row }).map_err(of_frame)?;
    }
    let mut notes = Vec::new();
    let mut run = table.into_run(options, &mut notes)?;
    sign::apply(&options.signs, &mut run, path)?;
    of_run(run, notes)
}

/// `run` with the hash of its canonical CSV form.
///
/// # Errors
/// When CSV cannot hold the run: it has no displacement, or two columns have the same name.
pub fn of_run(run: Run, notes: Vec<Note>) -> Result<Loaded, RunError> {
    let mut hash = Hash::default();
    let name = run.name.clone();
    csv_write::write(&run, Path::new(&name), HashingWriter::new(&mut hash))?;
    Ok(Loaded { run, notes, sha256: hash.finish() })
}

/// The error of a table for the error of a CSV file: rows in place of lines.
fn of_frame(error: RunError) -> RunError {
    match error {
        RunError::Header { path, why, .. } => RunError::Table { path, why },
        RunError::Cell { path, line: row, column, value, why } => {
            RunError::Row { path, row, column, value, why: why.to_owned() }
        }
        RunError::TimeOrder { path, line: row, column, value, previous } => {
            let why = format!(
                "does not come after {previous} s of the row before: times must increase by 1 ns at least, so sort the rows and \
                 remove duplicates"
            );
            RunError::Row { path, row, column, value, why }
        }
        other => other,
    }
}
