//! An orthonormal basis, built column by column, for projecting a series off the span of others.
//!
//! ```text
//! q = v - Q Q'v, twice, then normalised        Q: the columns before (QR by Gram-Schmidt)
//! ```
//!
//! The projection is done twice, because one pass loses digits if a column is nearly within the span of the others. A column of
//! which less than [`DEPENDENT`] of its length is left is within the span, up to rounding, and is not added.

use super::rows::dot;

/// Share of its length below which a column counts as dependent on the others.
const DEPENDENT: f64 = 1e-7;

/// Orthonormal columns.
#[derive(Default)]
pub(super) struct Basis {
    columns: Vec<Vec<f64>>,
}

impl Basis {
    /// The basis of `columns`.
    pub(super) fn of(columns: impl IntoIterator<Item = Vec<f64>>) -> Self {
        let mut basis = Self::default();
        for column in columns {
            basis.push(column);
        }
        basis
    }

    /// The columns.
    pub(super) fn into_columns(self) -> Vec<Vec<f64>> {
        self.columns
    }

    /// Adds the part of `column` that is orthogonal to the basis, unless the column is dependent.
    fn push(&mut self, mut column: Vec<f64>) {
        let length = dot(&column, &column).sqrt();
        self.take_out(&mut column);
        let own = dot(&column, &column).sqrt();
        if own > DEPENDENT * length {
            column.iter_mut().for_each(|value| *value /= own);
            self.columns.push(column);
        }
    }

    /// Projects `series` off the basis, and returns the share of its length that is left.
    pub(super) fn take_out(&self, series: &mut [f64]) -> f64 {
        let length = dot(series, series).sqrt();
        for _ in 0..2 {
            for column in &self.columns {
                let part = dot(column, series);
                series.iter_mut().zip(column).for_each(|(value, q)| *value -= part * q);
            }
        }
        let left = dot(series, series).sqrt();
        if length > 0.0 { left / length } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_rest_is_orthogonal_and_a_series_in_the_span_vanishes(
            columns in prop::collection::vec(prop::collection::vec(-1.0..1.0_f64, 12), 5),
            weights in prop::collection::vec(-1.0..1.0_f64, 5),
            mut series in prop::collection::vec(-1.0..1.0_f64, 12),
        ) {
            let basis = Basis::of(columns.clone());
            let share = basis.take_out(&mut series);
            prop_assert!((0.0..=1.0 + 1e-12).contains(&share));
            for column in &columns {
                prop_assert!(dot(column, &series).abs() < 1e-9);
            }
            let mut held: Vec<f64> =
                (0..12).map(|k| columns.iter().zip(&weights).map(|(c, w)| c[k] * w).sum()).collect();
            prop_assert!(basis.take_out(&mut held) < 1e-6);
        }
    }

    #[test]
    fn a_dependent_column_is_not_added() {
        let basis = Basis::of([vec![1.0, 2.0, 3.0], vec![2.0, 4.0, 6.0 + 1e-12]]);
        assert_eq!(basis.columns.len(), 1);
        assert_eq!(Basis::default().take_out(&mut [0.0, 0.0]), 0.0);
    }
}
