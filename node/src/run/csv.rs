//! Runs as CSV: a header row with the unit in every name, or the thesis' acquisition order without header.
//!
//! An empty cell means that the channel has no sample at the row's time. That is how channels of different
//! rates share one table, so a bag survives the way through CSV; it is noted when read, because in a
//! hand-made file it is more often a hole.

use super::column::{Column, Quantity, THESIS_ORDER};
use super::decimal::{parse_nanos, seconds_text};
use super::{LoadOptions, Note, RunError};
use csv::{ByteRecord, ReaderBuilder, Trim};
use mr_damper_model::sample::{DriveKind, Run, Stamp, Trace};
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// How many faults of skipped rows are kept for the note.
const FAULTS_KEPT: usize = 5;

/// Reads a run from CSV text; `path` is for messages and the run's name.
pub(super) fn read(
    path: &Path,
    source: impl Read,
    options: &LoadOptions,
    notes: &mut Vec<Note>,
) -> Result<Run, RunError> {
    let table = if options.thesis_txt {
        read_thesis(path, source, options)?
    } else {
        read_headed(path, source, options)?
    };
    table.into_run(options, notes)
}

/// Reads a table with a header row.
fn read_headed<'a>(path: &'a Path, source: impl Read, options: &LoadOptions) -> Result<Table<'a>, RunError> {
    // Rows of the wrong length are ours to report, with line and column: hence `flexible`.
    let mut reader =
        ReaderBuilder::new().has_headers(false).flexible(true).trim(Trim::All).from_reader(source);
    let mut row = ByteRecord::new();
    if !read_row(path, &mut reader, &mut row)? {
        return Err(RunError::NoDisplacement { path: path.to_owned(), hint: "the file is empty".into() });
    }
    let line = row.position().map_or(1, csv::Position::line);
    let mut table = Table::from_header(path, line, &row, options.skip_bad_rows)?;
    while read_row(path, &mut reader, &mut row)? {
        let line = row.position().map_or(0, csv::Position::line);
        table.push(line, &row)?;
    }
    Ok(table)
}

/// Reads the next row that is not blank; false at the end of the file.
fn read_row(
    path: &Path,
    reader: &mut csv::Reader<impl Read>,
    row: &mut ByteRecord,
) -> Result<bool, RunError> {
    loop {
        let more = reader
            .read_byte_record(row)
            .map_err(|error| RunError::io(path, "read")(std::io::Error::from(error)))?;
        let blank = row.len() == 1 && row[0].is_empty();
        if !more || !blank {
            return Ok(more);
        }
    }
}

/// Reads lines of the thesis' acquisition files: no header, fields split by blanks, tabs or commas.
fn read_thesis<'a>(path: &'a Path, source: impl Read, options: &LoadOptions) -> Result<Table<'a>, RunError> {
    let header = ByteRecord::from(THESIS_ORDER.to_vec());
    let mut table = Table::from_header(path, 1, &header, options.skip_bad_rows)?;
    let mut reader = BufReader::new(source);
    let (mut text, mut row) = (Vec::new(), ByteRecord::new());
    for line in 1.. {
        text.clear();
        if reader.read_until(b'\n', &mut text).map_err(RunError::io(path, "read"))? == 0 {
            break;
        }
        let content = if line == 1 { text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text) } else { &text[..] };
        row.clear();
        if content.contains(&b',') {
            content.split(|&b| b == b',').for_each(|field| row.push_field(field.trim_ascii()));
        } else {
            let fields = content.split(u8::is_ascii_whitespace).filter(|field| !field.is_empty());
            fields.for_each(|field| row.push_field(field));
        }
        if row.is_empty() {
            continue;
        }
        if line == 1 && row.iter().all(|field| number(field).is_none()) {
            return Err(RunError::Header {
                path: path.to_owned(),
                line,
                why: "a header row, but --thesis-txt files have none; leave --thesis-txt out for CSV with \
                      column names"
                    .into(),
            });
        }
        table.push(line, &row)?;
    }
    Ok(table)
}

/// One column while it is read.
struct Reading {
    /// The header as written, for messages.
    header: String,
    column: Column,
    trace: Trace,
    empty: u64,
}

/// A table while it is read.
struct Table<'a> {
    path: &'a Path,
    columns: Vec<Reading>,
    /// Index of `time_s`.
    time: usize,
    skip_bad_rows: bool,
    last: Option<i64>,
    /// Values of the row at hand: a row enters the traces whole or not at all.
    values: Vec<Option<f64>>,
    kept: u64,
    skipped: u64,
    faults: Vec<String>,
}

impl<'a> Table<'a> {
    fn from_header(
        path: &'a Path,
        line: u64,
        header: &ByteRecord,
        skip_bad_rows: bool,
    ) -> Result<Self, RunError> {
        let fail = |why: String| RunError::Header { path: path.to_owned(), line, why };
        let mut columns: Vec<Reading> = Vec::with_capacity(header.len());
        for (index, name) in header.iter().enumerate() {
            let name = if index == 0 { name.strip_prefix(b"\xef\xbb\xbf").unwrap_or(name) } else { name };
            let name = std::str::from_utf8(name.trim_ascii()).map_err(|_| {
                let shown = String::from_utf8_lossy(name);
                fail(format!(
                    "column {} is named `{shown}`, which is not UTF-8: save the file as UTF-8",
                    index + 1
                ))
            })?;
            // Blanks of any alphabet are no name, nor can they be written as one.
            if name.trim().is_empty() {
                return Err(fail(format!("column {} has no name: name it or remove it", index + 1)));
            }
            let column = Column::of_header(name);
            if let Some(twin) =
                columns.iter().find(|other| same_column(&other.header, &other.column, name, &column))
            {
                let (a, b) = (&twin.header, name);
                return Err(fail(format!(
                    "columns `{a}` and `{b}` are the same quantity: remove one of them"
                )));
            }
            columns.push(Reading { header: name.to_owned(), column, trace: Trace::default(), empty: 0 });
        }
        let time = columns.iter().position(|c| matches!(c.column, Column::Time));
        let has_displacement =
            columns.iter().any(|c| matches!(c.column, Column::Known(Quantity::Displacement, _)));
        let (Some(time), true) = (time, has_displacement) else {
            return Err(fail(missing(time.is_none(), &columns)));
        };
        let values = Vec::with_capacity(columns.len());
        Ok(Self {
            path,
            columns,
            time,
            skip_bad_rows,
            last: None,
            values,
            kept: 0,
            skipped: 0,
            faults: vec![],
        })
    }

    /// Takes a row, or refuses it, or drops it when that was asked for.
    fn push(&mut self, line: u64, row: &ByteRecord) -> Result<(), RunError> {
        match self.check(line, row) {
            Ok(nanos) => {
                self.last = Some(nanos);
                self.kept += 1;
                for (column, value) in self.columns.iter_mut().zip(&self.values) {
                    match value {
                        Some(value) => {
                            column.trace.stamps.push(Stamp::from_nanos(nanos));
                            column.trace.values.push(*value);
                        }
                        None => column.empty += 1,
                    }
                }
            }
            Err(fault) if self.skip_bad_rows => {
                self.skipped += 1;
                if self.faults.len() < FAULTS_KEPT {
                    self.faults.push(fault_text(&fault));
                }
            }
            Err(fault) => return Err(fault),
        }
        Ok(())
    }

    /// Parses a row into `self.values` and returns its time in nanoseconds.
    fn check(&mut self, line: u64, row: &ByteRecord) -> Result<i64, RunError> {
        let path = || self.path.to_owned();
        let cell = |index: usize, why| RunError::Cell {
            path: path(),
            line,
            column: self.columns[index].header.clone(),
            value: String::from_utf8_lossy(&row[index]).into_owned(),
            why,
        };
        if row.len() != self.columns.len() {
            let hint = match self.columns.get(row.len()) {
                Some(column) => format!("no value for `{}`", column.header),
                None => format!("`{}` is one too many", String::from_utf8_lossy(&row[self.columns.len()])),
            };
            let (found, expected) = (row.len(), self.columns.len());
            return Err(RunError::RowLength { path: path(), line, found, expected, hint });
        }
        let time = std::str::from_utf8(&row[self.time]).unwrap_or_default();
        let nanos = parse_nanos(time)
            .ok_or_else(|| cell(self.time, "is not a time in decimal seconds within 292 years"))?;
        if let Some(last) = self.last.filter(|&last| nanos <= last) {
            let (value, previous) = (time.to_owned(), seconds_text(last));
            return Err(RunError::TimeOrder { path: path(), line, value, previous });
        }
        self.values.clear();
        for (index, (field, column)) in row.iter().zip(&self.columns).enumerate() {
            let value = match &column.column {
                _ if field.is_empty() => None,
                Column::Time => None,
                Column::Known(_, to_si) => {
                    Some(to_si(number(field).ok_or_else(|| cell(index, "is not a number"))?))
                }
                Column::Other => Some(number(field).ok_or_else(|| {
                    cell(index, "is not a number, and only numbers are carried through: remove the column")
                })?),
            };
            if value.is_some_and(|value| !value.is_finite()) {
                return Err(cell(index, "is not finite"));
            }
            self.values.push(value);
        }
        if self.values.iter().all(Option::is_none) {
            return Err(cell(self.time, "is a time without any value"));
        }
        Ok(nanos)
    }

    fn into_run(self, options: &LoadOptions, notes: &mut Vec<Note>) -> Result<Run, RunError> {
        let path = self.path;
        if self.skipped > self.kept {
            let (skipped, kept) = (self.skipped, self.kept);
            let first = self.faults.into_iter().next().unwrap_or_default();
            return Err(RunError::MostlyBad { path: path.to_owned(), skipped, kept, first });
        }
        if self.skipped > 0 {
            notes.push(Note::RowsSkipped { count: self.skipped, first: self.faults });
        }
        let mut run = Run { name: path.display().to_string(), ..Run::default() };
        let mut drives: [Option<(String, Trace)>; 2] = [None, None];
        for Reading { header, column, trace, empty } in self.columns {
            if empty > 0 && !matches!(column, Column::Time) && !is_slower(&trace, empty) {
                notes.push(Note::EmptyCells { column: header.clone(), count: empty });
            }
            // A column of empty cells alone is a channel that was not recorded.
            let recorded = (!trace.is_empty()).then_some(trace.clone());
            match column {
                Column::Time => {}
                Column::Known(Quantity::Displacement, _) => run.displacement_m = trace,
                Column::Known(Quantity::Velocity, _) => run.velocity_m_s = recorded,
                Column::Known(Quantity::Force, _) => run.force_n = recorded,
                Column::Known(Quantity::CaseTemperature, _) => run.case_temp_c = recorded,
                Column::Known(Quantity::BodyVelocity, _) => run.body_velocity_m_s = recorded,
                Column::Known(Quantity::ForceRequest, _) => run.force_request_n = recorded,
                Column::Known(Quantity::Current, _) => drives[0] = recorded.map(|trace| (header, trace)),
                Column::Known(Quantity::Command, _) => drives[1] = recorded.map(|trace| (header, trace)),
                Column::Known(quantity, _) => run.other.push((quantity.si_name().to_owned(), trace)),
                Column::Other => {
                    if let Some(quantity) = Column::resembles(&header) {
                        notes.push(Note::UnitUnknown { column: header.clone(), known: quantity.names() });
                    }
                    run.other.push((header, trace));
                }
            }
        }
        if run.displacement_m.is_empty() {
            let hint = "there is no row of data below the header".to_owned();
            return Err(RunError::NoDisplacement { path: path.to_owned(), hint });
        }
        settle_drive(path, drives, options, &mut run)?;
        Ok(run)
    }
}

/// Puts the recorded drives, current first, into the run: the only one, or the chosen one. The other is
/// carried under its SI name.
pub(super) fn settle_drive(
    path: &Path,
    drives: [Option<(String, Trace)>; 2],
    options: &LoadOptions,
    run: &mut Run,
) -> Result<(), RunError> {
    let [current, command] = drives;
    if let (Some((current, _)), Some((command, _)), None) = (&current, &command, options.drive) {
        let (current, command) = (current.clone(), command.clone());
        return Err(RunError::BothDrives { path: path.to_owned(), current, command });
    }
    for (kind, trace) in [(DriveKind::CoilCurrent, current), (DriveKind::CommandVoltage, command)] {
        match trace {
            Some((_, trace)) if options.drive.is_none_or(|chosen| chosen == kind) => {
                run.drive = Some((kind, trace))
            }
            Some((_, trace)) => run.other.push((kind.name().to_owned(), trace)),
            None => {}
        }
    }
    Ok(())
}

/// The fault of a dropped row without the advice on how to drop it.
fn fault_text(fault: &RunError) -> String {
    let text = fault.to_string();
    match text.split_once(';') {
        Some((fault, _advice)) => fault.to_owned(),
        None => text,
    }
}

fn same_column(a_name: &str, a: &Column, b_name: &str, b: &Column) -> bool {
    match (a, b) {
        (Column::Time, Column::Time) => true,
        (Column::Known(a, _), Column::Known(b, _)) => a == b,
        (Column::Other, Column::Other) => a_name == b_name,
        _ => false,
    }
}

/// What a header lacks, and the likeliest reason.
fn missing(no_time: bool, columns: &[Reading]) -> String {
    let found: Vec<_> = columns.iter().map(|c| c.header.as_str()).collect();
    if found.iter().all(|name| number(name.as_bytes()).is_some()) {
        return "the first row holds numbers, so the header row is missing: name the columns, or give \
                --thesis-txt for the order time, displacement, force, current, ambient, case, set point"
            .into();
    }
    let lacks = if no_time {
        "`time_s`".to_owned()
    } else {
        format!("displacement ({})", Quantity::Displacement.names())
    };
    let hint = match found.as_slice() {
        [only] if only.contains([';', '\t']) => {
            "; the fields seem to be split by `;` or tabs: split them by commas"
        }
        _ => "; the unit belongs to the name, as in displacement_mm",
    };
    let shown: String = found.join(", ").chars().take(200).collect();
    format!("no column {lacks} among: {shown}{hint}")
}

/// A decimal number, finite or not; `None` when the text is no number.
fn number(field: &[u8]) -> Option<f64> {
    std::str::from_utf8(field).ok()?.parse().ok()
}

/// True when a channel was logged evenly at a fraction of the rows' rate, as a thermocouple is: `empty` cells
/// between its samples are no holes.
fn is_slower(trace: &Trace, empty: u64) -> bool {
    let steps = || trace.stamps.windows(2).map(|pair| pair[1].since(pair[0]).get());
    let (least, most) =
        steps().fold((f64::INFINITY, 0.0_f64), |(least, most), s| (least.min(s), most.max(s)));
    trace.len() > 2 && empty > trace.len() as u64 && most <= 1.01 * least
}
