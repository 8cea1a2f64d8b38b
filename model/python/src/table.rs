//! Tables to and from Python.
//!
//! A column arrives either as an Arrow array or as bytes, which Python makes from any object with the buffer protocol: the buffer
//! protocol itself is in Python's stable interface only from version 3.11 on. Columns leave as bytes, which NumPy takes without a copy.

use arrow_array::cast::AsArray;
use arrow_array::ffi_stream::RecordBatchStreamReader;
use arrow_array::types::{
    ArrowPrimitiveType, DurationMicrosecondType, DurationMillisecondType, DurationNanosecondType,
    DurationSecondType, Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type,
    TimestampMicrosecondType, TimestampMillisecondType, TimestampNanosecondType, TimestampSecondType,
    UInt8Type, UInt16Type, UInt32Type, UInt64Type,
};
use arrow_array::{Array, RecordBatchReader};
use arrow_pyarrow::FromPyArrow;
use arrow_schema::{DataType, TimeUnit};
use mr_damper_node::NodeError;
use mr_damper_runs::{Column, RunError, Values};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;

/// The columns given as name, kind and values. The kind is `d` for bytes of float64, `n` for the same where NaN may stand for an empty
/// cell ([`without_gaps`]), `e` for the same where it always does, `q` for bytes of int64, `t` for bytes of int64 in
/// nanoseconds since the epoch, and `o` for a list of numbers with `None` for an empty cell.
///
/// # Errors
/// When the values are not of the kind.
pub(crate) fn columns_of_bytes(columns: Vec<(String, String, Bound<'_, PyAny>)>) -> PyResult<Vec<Column>> {
    let column = |(name, kind, values): (String, String, Bound<'_, PyAny>)| -> PyResult<Column> {
        let values = match kind.as_str() {
            "d" => Values::Floats(words(&values)?.map(f64::from_ne_bytes).collect()),
            "n" => without_gaps(words(&values)?.map(f64::from_ne_bytes).collect()),
            "e" => Values::OptionalFloats(words(&values)?.map(f64::from_ne_bytes).map(some).collect()),
            "q" => Values::Integers(words(&values)?.map(i64::from_ne_bytes).collect()),
            // NumPy writes "not a time" as the smallest integer.
            "t" => Values::Stamps(
                words(&values)?.map(i64::from_ne_bytes).map(|ns| (ns != i64::MIN).then_some(ns)).collect(),
            ),
            "o" => Values::OptionalFloats(values.extract()?),
            other => return Err(PyValueError::new_err(format!("unknown kind of column: {other}"))),
        };
        Ok(Column { name, values })
    };
    columns.into_iter().map(column).collect()
}

/// The value; `None` for NaN.
fn some(value: f64) -> Option<f64> {
    (!value.is_nan()).then_some(value)
}

/// The values of a channel that was logged at a fraction of the rows' rate: the cells between its samples are NaN in a data frame and
/// become empty cells. NaN anywhere else stays, and is refused when the run is made.
fn without_gaps(values: Vec<f64>) -> Values {
    let samples: Vec<usize> = (0..values.len()).filter(|row| !values[*row].is_nan()).collect();
    let mut gaps = samples.windows(2).map(|pair| pair[1] - pair[0]);
    let Some(every) = gaps.next().filter(|every| *every > 1) else { return Values::Floats(values) };
    let [Some(first), Some(last)] = [samples.first(), samples.last()] else { return Values::Floats(values) };
    let is_regular = gaps.all(|gap| gap == every) && *first < every && values.len() - last <= every;
    // The rule of the CSV reader for empty cells that are no omissions.
    let is_slower = samples.len() > 2 && values.len() > 2 * samples.len();
    match is_regular && is_slower {
        true => Values::OptionalFloats(values.into_iter().map(some).collect()),
        false => Values::Floats(values),
    }
}

/// The bytes in pieces of eight.
pub(crate) fn words<'a>(bytes: &'a Bound<'_, PyAny>) -> PyResult<impl Iterator<Item = [u8; 8]> + 'a> {
    let (words, rest) = bytes.cast::<PyBytes>()?.as_bytes().as_chunks::<8>();
    if rest.is_empty() {
        Ok(words.iter().copied())
    } else {
        Err(PyValueError::new_err("a column ends within a number"))
    }
}

/// Bytes of float64.
pub(crate) fn floats(py: Python<'_>, values: impl Iterator<Item = f64>) -> Bound<'_, PyBytes> {
    PyBytes::new(py, &values.flat_map(f64::to_ne_bytes).collect::<Vec<u8>>())
}

/// Bytes of int64.
pub(crate) fn ints(py: Python<'_>, values: impl Iterator<Item = i64>) -> Bound<'_, PyBytes> {
    PyBytes::new(py, &values.flat_map(i64::to_ne_bytes).collect::<Vec<u8>>())
}

/// The columns of `table`, an object with `__arrow_c_stream__`.
///
/// # Errors
/// When the stream fails, or a column does not hold numbers or times.
pub(crate) fn columns_of_arrow(name: &str, table: &Bound<'_, PyAny>) -> PyResult<Vec<Column>> {
    let reader = RecordBatchStreamReader::from_pyarrow_bound(table)?;
    let schema = reader.schema();
    let mut columns = Vec::with_capacity(schema.fields().len());
    for field in schema.fields() {
        let Some(values) = empty(field.data_type()) else {
            let why = format!(
                "column `{}` holds {}, and only numbers and times are read: remove the column, or cast it to a float",
                field.name(),
                field.data_type()
            );
            let error = RunError::Table { path: PathBuf::from(name), why };
            return Err(crate::error::exception(table.py(), &NodeError::from(error)));
        };
        columns.push(Column { name: field.name().clone(), values });
    }
    for batch in reader {
        let batch = batch.map_err(|error| PyValueError::new_err(error.to_string()))?;
        for (column, array) in columns.iter_mut().zip(batch.columns()) {
            append(&mut column.values, array.as_ref());
        }
    }
    Ok(columns)
}

/// An empty column for values of this type; `None` if it is neither a number nor a time.
fn empty(data_type: &DataType) -> Option<Values> {
    match data_type {
        DataType::Float64 | DataType::Float32 => Some(Values::Floats(Vec::new())),
        DataType::Int8
        | DataType::Int16
        | DataType::Int32
        | DataType::Int64
        | DataType::UInt8
        | DataType::UInt16
        | DataType::UInt32 => Some(Values::OptionalIntegers(Vec::new())),
        DataType::UInt64 | DataType::Null => Some(Values::OptionalFloats(Vec::new())),
        DataType::Timestamp(..) | DataType::Duration(_) => Some(Values::Stamps(Vec::new())),
        _ => None,
    }
}

/// Appends an array of a type that [`empty`] knows.
fn append(values: &mut Values, array: &dyn Array) {
    match array.data_type() {
        DataType::Float64 => {
            let array = array.as_primitive::<Float64Type>();
            match values {
                Values::Floats(all) if array.null_count() == 0 => all.extend_from_slice(array.values()),
                _ => optional(values, array.iter()),
            }
        }
        DataType::Float32 => {
            let array = array.as_primitive::<Float32Type>();
            match values {
                Values::Floats(all) if array.null_count() == 0 => {
                    all.extend(array.values().iter().map(|v| f64::from(*v)))
                }
                _ => optional(values, array.iter().map(|v| v.map(f64::from))),
            }
        }
        DataType::Int8 => integers::<Int8Type>(values, array, 1),
        DataType::Int16 => integers::<Int16Type>(values, array, 1),
        DataType::Int32 => integers::<Int32Type>(values, array, 1),
        DataType::Int64 => integers::<Int64Type>(values, array, 1),
        DataType::UInt8 => integers::<UInt8Type>(values, array, 1),
        DataType::UInt16 => integers::<UInt16Type>(values, array, 1),
        DataType::UInt32 => integers::<UInt32Type>(values, array, 1),
        DataType::UInt64 => {
            optional(values, array.as_primitive::<UInt64Type>().iter().map(|v| v.map(|v| v as f64)));
        }
        DataType::Timestamp(TimeUnit::Second, _) => {
            integers::<TimestampSecondType>(values, array, 1_000_000_000)
        }
        DataType::Timestamp(TimeUnit::Millisecond, _) => {
            integers::<TimestampMillisecondType>(values, array, 1_000_000)
        }
        DataType::Timestamp(TimeUnit::Microsecond, _) => {
            integers::<TimestampMicrosecondType>(values, array, 1_000)
        }
        DataType::Timestamp(TimeUnit::Nanosecond, _) => integers::<TimestampNanosecondType>(values, array, 1),
        DataType::Duration(TimeUnit::Second) => integers::<DurationSecondType>(values, array, 1_000_000_000),
        DataType::Duration(TimeUnit::Millisecond) => {
            integers::<DurationMillisecondType>(values, array, 1_000_000)
        }
        DataType::Duration(TimeUnit::Microsecond) => {
            integers::<DurationMicrosecondType>(values, array, 1_000)
        }
        DataType::Duration(TimeUnit::Nanosecond) => integers::<DurationNanosecondType>(values, array, 1),
        // The type `Null`: all cells are empty.
        _ => optional(values, std::iter::repeat_n(None, array.len())),
    }
}

/// Appends whole numbers, each times `factor`. A product that does not fit 64 bits becomes an empty cell, which is refused as a time.
fn integers<T: ArrowPrimitiveType<Native: Into<i64>>>(values: &mut Values, array: &dyn Array, factor: i64) {
    if let Values::OptionalIntegers(all) | Values::Stamps(all) = values {
        let array = array.as_primitive::<T>();
        all.extend(array.iter().map(|value| value.and_then(|value| value.into().checked_mul(factor))));
    }
}

/// Appends decimal numbers, of which some may be empty.
fn optional(values: &mut Values, more: impl Iterator<Item = Option<f64>>) {
    let mut all = match std::mem::replace(values, Values::Floats(Vec::new())) {
        Values::Floats(all) => all.into_iter().map(Some).collect(),
        Values::OptionalFloats(all) => all,
        other => {
            *values = other;
            return;
        }
    };
    all.extend(more);
    *values = Values::OptionalFloats(all);
}
