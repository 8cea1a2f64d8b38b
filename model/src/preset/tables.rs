//! The tables of the thesis and its papers, as printed.
//!
//! They are text files in `model/data`: one file a printed table, one line a row, with the columns and units of the
//! table and its number in the thesis. `model/build.rs` checks them and turns them into the arrays that this module
//! includes. The alternative was to include the text (`include_str!`) and to parse it at the first use. With the
//! build script, a mistake in a file fails the build with its file, line and column, so that loading a preset needs
//! no error of its own and parses nothing. The build script uses no other crate.

// Two digits of a table may happen to be the first digits of pi or e.
#![allow(clippy::approx_constant)]

/// Keys of a row, for example the experiment, and its numbers.
pub(super) type Row<const K: usize, const N: usize> = ([&'static str; K], [f64; N]);

include!(concat!(env!("OUT_DIR"), "/tables.rs"));

/// The numbers of the row with `keys`, which may be in upper or lower case.
pub(super) fn find<const K: usize, const N: usize>(table: &[Row<K, N>], keys: [&str; K]) -> Option<[f64; N]> {
    let same = |known: &[&str; K]| known.iter().zip(keys).all(|(known, key)| known.eq_ignore_ascii_case(key));
    table.iter().find(|(known, _)| same(known)).map(|(_, numbers)| *numbers)
}

/// The numbers of all rows of `experiment`, which may be in upper or lower case.
pub(super) fn rows_of<const N: usize>(table: &[Row<2, N>], experiment: &str) -> Vec<[f64; N]> {
    let own = table.iter().filter(|([known, _], _)| known.eq_ignore_ascii_case(experiment));
    own.map(|(_, numbers)| *numbers).collect()
}

// The build script's parser, for its tests.
#[cfg(test)]
#[path = "../../build/table.rs"]
mod build_table;
