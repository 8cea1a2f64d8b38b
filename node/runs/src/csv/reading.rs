//! The columns of a CSV file while it is read.

use crate::column::{Column, Quantity};
use crate::map::{Convert, Map};
use mr_damper_model::sample::Trace;

/// Use of a column.
#[derive(Debug, Clone, Copy)]
pub(super) enum Use {
    Time,
    Known(Quantity, Convert),
    /// Numbers that are carried through, or text.
    Other,
}

impl Use {
    pub(super) fn by_name(header: &str) -> Self {
        match Column::of_header(header) {
            Column::Time => Self::Time,
            Column::Known(quantity, to_si) => Self::Known(quantity, Convert::plain(to_si)),
            Column::Other => Self::Other,
        }
    }

    /// True if `map` has a source for this use.
    pub(super) fn is_mapped(self, map: &Map) -> bool {
        match self {
            Self::Time => map.of_time().is_some(),
            Self::Known(quantity, _) => map.of(quantity).is_some(),
            Self::Other => false,
        }
    }
}

/// One channel while it is read.
pub(super) struct Reading {
    /// Index of its field in a row.
    pub(super) field: usize,
    /// The header as written, for messages.
    pub(super) header: String,
    pub(super) what: Use,
    pub(super) trace: Trace,
    /// Number of empty cells.
    pub(super) empty: u64,
    /// Line and text of the first cell, if it is not a number in a column that nothing uses: the column is left out.
    pub(super) first_text: Option<(u64, String)>,
}

impl Reading {
    pub(super) fn new(field: usize, header: &str, what: Use) -> Self {
        Self { field, header: header.to_owned(), what, trace: Trace::default(), empty: 0, first_text: None }
    }
}
