//! Reads runs from CSV: with a header row that has the unit in every name, or in the thesis' acquisition order without
//! header.
//!
//! An empty cell means that the channel has no sample at the row's time. In this way channels with different rates share one
//! table, and a bag can be converted to CSV and back. Empty cells are reported in a note, because in a hand-made file they
//! are more often an omission.
//!
//! Lines before the header that begin with `#` are comments. The last of them is the header if it names the time and the row below it
//! does not, as `numpy.savetxt` writes it.

mod begin;
mod header;
mod lines;
mod reading;

use super::column::{Column, Quantity, THESIS_ORDER};
use super::decimal::{parse_nanos, seconds_text};
use super::error::MapFault;
use super::map::{Channel, Map, Mapping};
use super::names::topic_of;
use super::suggest;
use super::unit::{self, TIME, TimeUnit, Unit};
use super::{LoadOptions, Note, RunError};
use begin::{Begin, records};
use csv::ByteRecord;
use header::{HeaderFault, ROWS_COMPARED, shown, without_bom};
use lines::Lines;
use mr_damper_model::sample::{DriveKind, Run, Stamp, Trace};
use reading::{Reading, Use};
use std::io::{BufRead, BufReader, Cursor, Read};
use std::path::Path;

/// Number of faults of skipped rows that are kept for the note.
const FAULTS_KEPT: usize = 5;

/// Reads a run from CSV text; `path` is used in messages and as the run's name.
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
    let mut source = BufReader::new(source);
    let Begin { line, text, comment } = Begin::read(&mut source).map_err(RunError::io(path, "read"))?;
    let mut reader = records(Lines::from_line(Cursor::new(text).chain(source), line));
    let mut row = ByteRecord::new();
    let Some(mut line) = read_row(path, &mut reader, &mut row)? else {
        let hint = if comment.is_some() {
            "the file holds only comments, which begin with `#`"
        } else {
            "the file is empty"
        };
        return Err(RunError::NoDisplacement { path: path.to_owned(), hint: hint.into() });
    };
    let mut rows = Vec::with_capacity(ROWS_COMPARED);
    let comment = comment.filter(|(_, fields)| fields.len() == row.len());
    match comment.as_ref().map(|(above, fields)| (*above, header::in_comment(fields, &options.map))) {
        Some((above, names))
            if header::names_time(&names, &options.map) && !header::names_time(&row, &options.map) =>
        {
            rows.push((line, std::mem::replace(&mut row, names)));
            line = above;
        }
        _ => {
            let comment = comment.map(|(above, _)| above);
            if let Some(fault) = header::only_numbers(&row, comment, &options.map) {
                return Err(RunError::Header { path: path.to_owned(), line, why: fault.to_string() });
            }
        }
    }
    let mut table = Table::from_header(path, line, &row, options)?;
    while rows.len() < ROWS_COMPARED
        && let Some(line) = read_row(path, &mut reader, &mut row)?
    {
        rows.push((line, row.clone()));
    }
    table.compare(&rows)?;
    for (line, row) in rows {
        table.push(line, &row)?;
    }
    while let Some(line) = read_row(path, &mut reader, &mut row)? {
        table.push(line, &row)?;
    }
    Ok(table)
}

/// Reads the next row that is not blank, and returns its line; `None` at the end of the file.
fn read_row(
    path: &Path,
    reader: &mut csv::Reader<Lines<impl Read>>,
    row: &mut ByteRecord,
) -> Result<Option<u64>, RunError> {
    loop {
        let more = reader
            .read_byte_record(row)
            .map_err(|error| RunError::io(path, "read")(std::io::Error::from(error)))?;
        if !more {
            return Ok(None);
        }
        let begins = row.position().map_or(0, csv::Position::byte);
        let line = reader.get_mut().of_record(begins);
        let is_blank = row.len() == 1 && row[0].is_empty();
        if !is_blank {
            return Ok(Some(line));
        }
    }
}

/// Reads an acquisition file of the thesis: no header, fields separated by blanks, tabs or commas.
fn read_thesis<'a>(path: &'a Path, source: impl Read, options: &LoadOptions) -> Result<Table<'a>, RunError> {
    let header = ByteRecord::from(THESIS_ORDER.to_vec());
    let mut table = Table::from_header(path, 1, &header, options)?;
    let mut reader = BufReader::new(source);
    let (mut text, mut row) = (Vec::new(), ByteRecord::new());
    for line in 1.. {
        text.clear();
        if reader.read_until(b'\n', &mut text).map_err(RunError::io(path, "read"))? == 0 {
            break;
        }
        let content = if line == 1 { without_bom(&text) } else { &text[..] };
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

/// The fields of one row.
pub(super) trait Row {
    /// Number of fields.
    fn len(&self) -> usize;

    /// True if the field has no value.
    fn is_empty(&self, field: usize) -> bool;

    /// The field as a number, finite or not; `None` if it is not a number.
    fn number(&self, field: usize) -> Option<f64>;

    /// The field as a time in a unit of ten to the power of `exponent` seconds; `None` if it is not a time within 292 years.
    fn nanos(&self, field: usize, exponent: i32) -> Option<i64>;

    /// The field as text, for messages.
    fn text(&self, field: usize) -> String;
}

impl Row for ByteRecord {
    fn len(&self) -> usize {
        ByteRecord::len(self)
    }

    fn is_empty(&self, field: usize) -> bool {
        self[field].is_empty()
    }

    fn number(&self, field: usize) -> Option<f64> {
        number(&self[field])
    }

    fn nanos(&self, field: usize, exponent: i32) -> Option<i64> {
        parse_nanos(std::str::from_utf8(&self[field]).unwrap_or_default(), exponent)
    }

    fn text(&self, field: usize) -> String {
        String::from_utf8_lossy(&self[field]).into_owned()
    }
}

/// A table while it is read.
pub(super) struct Table<'a> {
    path: &'a Path,
    headers: Vec<String>,
    columns: Vec<Reading>,
    /// Index of the time field, and its unit.
    time: (usize, TimeUnit),
    skip_bad_rows: bool,
    last: Option<i64>,
    /// Values of the current row: a row is added to the traces completely or not at all.
    values: Vec<Option<f64>>,
    kept: u64,
    skipped: u64,
    faults: Vec<String>,
    /// The fault of the header that the first rows show, if bad rows are skipped.
    header_fault: Option<RunError>,
    /// Notes on the header.
    notes: Vec<Note>,
}

impl<'a> Table<'a> {
    pub(super) fn from_header(
        path: &'a Path,
        line: u64,
        header: &ByteRecord,
        options: &LoadOptions,
    ) -> Result<Self, RunError> {
        let fail =
            |fault: HeaderFault| RunError::Header { path: path.to_owned(), line, why: fault.to_string() };
        let headers = header::names(header).map_err(fail)?;
        let mut by_name: Vec<Use> = headers.iter().map(|header| Use::by_name(header)).collect();
        // Without `time_s`, the time may be in another unit. Beside it, such a column is carried through.
        if options.map.of_time().is_none() && !by_name.iter().any(|what| matches!(what, Use::Time)) {
            let times =
                by_name.iter_mut().zip(&headers).filter(|(_, name)| TimeUnit::of_name(name).is_some());
            times.for_each(|(what, _)| *what = Use::Time);
        }
        for (index, (name, what)) in headers.iter().zip(&by_name).enumerate() {
            let same = |(other, of): &(&String, &Use)| same_column(other, of, name, what);
            let twin = headers[..index].iter().zip(&by_name).find(same);
            if let Some((twin, _)) = twin.filter(|_| !what.is_mapped(&options.map)) {
                return Err(fail(HeaderFault::SameQuantity { first: twin.clone(), second: name.clone() }));
            }
        }
        let mut table = Self {
            path,
            columns: Vec::with_capacity(headers.len()),
            time: (headers.len(), TIME[0]),
            headers,
            skip_bad_rows: options.skip_bad_rows,
            last: None,
            values: Vec::new(),
            kept: 0,
            skipped: 0,
            faults: vec![],
            header_fault: None,
            notes: vec![],
        };
        let mut mapped = Vec::new();
        for mapping in options.map.all() {
            let map = || mapping.to_string();
            let field = table.take_mapped(mapping).map_err(|why| RunError::Map {
                path: path.to_owned(),
                map: map(),
                why: Box::new(why),
            })?;
            mapped.push(field);
        }
        table.take_by_name(&by_name, &mapped, &options.map);
        let has_displacement =
            table.columns.iter().any(|c| matches!(c.what, Use::Known(Quantity::Displacement, _)));
        let no_time = table.time.0 == table.headers.len();
        if no_time || !has_displacement {
            return Err(fail(header::missing(no_time, !has_displacement, &table.headers)));
        }
        Ok(table)
    }

    /// Adds the column that a channel is mapped to; returns the index of the column's field.
    fn take_mapped(&mut self, mapping: &Mapping) -> Result<usize, MapFault> {
        let headers = || self.headers.iter().map(String::as_str);
        let source = mapping.source.as_str();
        let place = headers().position(|header| header == source);
        let Some(field) = place.or_else(|| headers().position(|it| it.eq_ignore_ascii_case(source))) else {
            let nearest = suggest::nearest(source, headers()).map(str::to_owned);
            let columns = shown(&self.headers);
            return Err(MapFault::NoColumn { column: source.to_owned(), nearest, columns });
        };
        let header = self.headers[field].clone();
        let by_name = Column::of_header(&header);
        let (unit, by_unit, given, what) = match (mapping.channel, by_name) {
            (Channel::Time(unit), _) => {
                let found = TimeUnit::in_column(&header);
                self.time = (field, unit.or(found).unwrap_or(TIME[0]));
                (self.time.1.name, found.is_some(), unit.is_some(), Use::Time)
            }
            (Channel::Known(..), Column::Time) => return Err(MapFault::IsTime { column: header }),
            (Channel::Known(quantity, _), Column::Known(other, _))
                if other.dimension() != quantity.dimension() =>
            {
                let (found, needed) = (other.dimension(), quantity.dimension());
                return Err(MapFault::Quantity {
                    column: header,
                    found,
                    channel: topic_of(quantity),
                    needed,
                });
            }
            (Channel::Known(quantity, unit), by_name) => {
                let found = Unit::in_column(quantity.dimension(), &header);
                let taken = unit.or(found).unwrap_or(unit::of(quantity.dimension())[0]);
                let what = Use::Known(quantity, mapping.convert(taken.to_si));
                // A column with a name of the run format has a known unit.
                let given = unit.is_some() || matches!(by_name, Column::Known(..));
                (taken.name, found.is_some(), given, what)
            }
        };
        if !given {
            self.notes.push(Note::UnitTaken { column: header.clone(), unit, by_name: by_unit });
        }
        self.columns.push(Reading::new(field, &header, what));
        Ok(field)
    }

    /// Adds every column according to its name, except channels for which the map has a source.
    fn take_by_name(&mut self, by_name: &[Use], mapped: &[usize], map: &Map) {
        for (field, what) in by_name.iter().enumerate() {
            let header = &self.headers[field];
            let is_source = mapped.contains(&field);
            match what {
                Use::Other if is_source => continue,
                _ if what.is_mapped(map) => {
                    let channel = match what {
                        Use::Known(quantity, _) => topic_of(*quantity),
                        Use::Time | Use::Other => "time",
                    };
                    if !is_source {
                        self.notes.push(Note::ColumnReplaced { column: header.clone(), channel });
                    }
                    continue;
                }
                Use::Time => self.time = (field, TimeUnit::of_name(header).unwrap_or(TIME[0])),
                Use::Known(..) | Use::Other => {}
            }
            self.columns.push(Reading::new(field, header, *what));
        }
    }

    /// Compares the header with the first rows below it, which come with their lines. A fault of the header is an error; with `skip_bad_rows`
    /// it is one only if most rows are bad.
    fn compare(&mut self, rows: &[(u64, ByteRecord)]) -> Result<(), RunError> {
        let records: Vec<_> = rows.iter().map(|(_, row)| row.clone()).collect();
        let fault = header::against(self.headers.len(), &records);
        let (Some(fault), Some((line, _))) = (fault, rows.first()) else { return Ok(()) };
        let error = RunError::Header { path: self.path.to_owned(), line: *line, why: fault.to_string() };
        if !self.skip_bad_rows {
            return Err(error);
        }
        self.header_fault = Some(error);
        Ok(())
    }

    /// Adds a row. A bad row is an error, or is dropped with `skip_bad_rows`.
    pub(super) fn push(&mut self, line: u64, row: &impl Row) -> Result<(), RunError> {
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
    fn check(&mut self, line: u64, row: &impl Row) -> Result<i64, RunError> {
        let path = || self.path.to_owned();
        let cell = |field: usize, why| RunError::Cell {
            path: path(),
            line,
            column: self.headers[field].clone(),
            value: row.text(field),
            why,
        };
        if row.len() != self.headers.len() {
            let hint = match self.headers.get(row.len()) {
                Some(header) => format!("no value for `{header}`"),
                None => format!("`{}` is one too many", row.text(self.headers.len())),
            };
            let (found, expected) = (row.len(), self.headers.len());
            return Err(RunError::RowLength { path: path(), line, found, expected, hint });
        }
        let (time_field, unit) = self.time;
        let nanos = row.nanos(time_field, unit.exponent).ok_or_else(|| {
            let in_seconds = unit == TIME[0];
            cell(
                time_field,
                if in_seconds {
                    "is not a time in decimal seconds within 292 years"
                } else {
                    "is not a decimal time within 292 years"
                },
            )
        })?;
        if let Some(last) = self.last.filter(|&last| nanos <= last) {
            let value = if unit == TIME[0] { row.text(time_field) } else { seconds_text(nanos) };
            let (column, previous) = (self.headers[time_field].clone(), seconds_text(last));
            return Err(RunError::TimeOrder { path: path(), line, column, value, previous });
        }
        self.values.clear();
        for column in &mut self.columns {
            let value = match &column.what {
                _ if row.is_empty(column.field) || column.first_text.is_some() => None,
                Use::Time => None,
                Use::Known(_, convert) => {
                    let raw =
                        row.number(column.field).ok_or_else(|| cell(column.field, "is not a number"))?;
                    Some(convert.apply(raw))
                }
                Use::Other => match row.number(column.field) {
                    None if column.trace.is_empty() => {
                        column.first_text = Some((line, row.text(column.field)));
                        None
                    }
                    None => return Err(cell(column.field, "is not a number, as the cells above it are")),
                    number => number,
                },
            };
            if value.is_some_and(|value| !value.is_finite()) {
                return Err(cell(column.field, "is not finite"));
            }
            self.values.push(value);
        }
        if self.values.iter().all(Option::is_none) {
            return Err(cell(time_field, "is a time without any value"));
        }
        Ok(nanos)
    }

    pub(super) fn into_run(self, options: &LoadOptions, notes: &mut Vec<Note>) -> Result<Run, RunError> {
        let path = self.path;
        if self.skipped > self.kept {
            if let Some(fault) = self.header_fault {
                return Err(fault);
            }
            let (skipped, kept) = (self.skipped, self.kept);
            let first = self.faults.into_iter().next().unwrap_or_default();
            return Err(RunError::MostlyBad { path: path.to_owned(), skipped, kept, first });
        }
        if self.skipped > 0 {
            notes.push(Note::RowsSkipped { count: self.skipped, first: self.faults });
        }
        notes.extend(self.notes);
        let mut run = Run { name: path.display().to_string(), ..Run::default() };
        let mut drives: [Option<(String, Trace)>; 2] = [None, None];
        let mut columns = self.columns;
        // Mapped columns were added first; carried columns must be in the order of the file.
        columns.sort_by_key(|column| column.field);
        for Reading { header, what, trace, empty, first_text, .. } in columns {
            if let Some((line, text)) = first_text {
                notes.push(Note::TextColumn { column: header, line, text });
                continue;
            }
            if empty > 0 && !matches!(what, Use::Time) && !is_slower(&trace, empty) {
                notes.push(Note::EmptyCells { column: header.clone(), count: empty });
            }
            // If all cells of a column are empty, the channel was not recorded.
            let recorded = |trace: Trace| (!trace.is_empty()).then_some(trace);
            match what {
                Use::Time => {}
                Use::Known(Quantity::Displacement, _) => run.displacement_m = trace,
                Use::Known(Quantity::Velocity, _) => run.velocity_m_s = recorded(trace),
                Use::Known(Quantity::Force, _) => run.force_n = recorded(trace),
                Use::Known(Quantity::CaseTemperature, _) => run.case_temp_c = recorded(trace),
                Use::Known(Quantity::BodyVelocity, _) => run.body_velocity_m_s = recorded(trace),
                Use::Known(Quantity::ForceRequest, _) => run.force_request_n = recorded(trace),
                Use::Known(Quantity::Current, _) => drives[0] = recorded(trace).map(|trace| (header, trace)),
                Use::Known(Quantity::Command, _) => drives[1] = recorded(trace).map(|trace| (header, trace)),
                Use::Known(quantity, _) => run.other.push((quantity.si_name().to_owned(), trace)),
                Use::Other => {
                    let resembled = Column::resembles(&header);
                    if let Some(quantity) = resembled.filter(|it| options.map.of(*it).is_none()) {
                        let (column, channel) = (header.clone(), topic_of(quantity));
                        notes.push(Note::UnitUnknown { column, channel, known: quantity.names() });
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

/// Puts the recorded drive into the run: the only one, or the chosen one. The other one is carried through under its SI name.
/// `drives` holds the current, then the voltage.
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

/// The fault of a dropped row, without the advice to drop such rows.
fn fault_text(fault: &RunError) -> String {
    let text = fault.to_string();
    match text.split_once(';') {
        Some((fault, _advice)) => fault.to_owned(),
        None => text,
    }
}

fn same_column(a_name: &str, a: &Use, b_name: &str, b: &Use) -> bool {
    match (a, b) {
        (Use::Time, Use::Time) => true,
        (Use::Known(a, _), Use::Known(b, _)) => a == b,
        (Use::Other, Use::Other) => a_name == b_name,
        _ => false,
    }
}

/// A decimal number, finite or not; `None` if the text is not a number.
fn number(field: &[u8]) -> Option<f64> {
    std::str::from_utf8(field).ok()?.parse().ok()
}

/// True if a channel was logged evenly at a fraction of the rows' rate, like a thermocouple. Then the `empty` cells between
/// its samples are not omissions.
fn is_slower(trace: &Trace, empty: u64) -> bool {
    let steps = || trace.stamps.windows(2).map(|pair| pair[1].since(pair[0]).get());
    let (least, most) =
        steps().fold((f64::INFINITY, 0.0_f64), |(least, most), s| (least.min(s), most.max(s)));
    trace.len() > 2 && empty > trace.len() as u64 && most <= 1.01 * least
}
