//! How far code in single precision is from the service.

use crate::vectors::Expected;
use mr_damper_model::units::Newton;

/// A force counts as far off beyond this share of the largest force. Rounding errors stay below it, unless the model jumps.
const FAR: f64 = 1e-4;

/// Differences of exported code from the service on the same readings.
///
/// ```
/// use mr_damper_export::{Difference, vectors::Expected};
///
/// let sample = |force_n| Expected { accepted: true, force_n, reading_n: f64::NAN, flags: 0 };
/// let own = Difference::of(&[sample(1000.0), sample(500.0)], &[sample(1000.0), sample(500.003)]);
/// assert_eq!((own.samples, own.far, own.other), (2, 0, 0));
/// assert!((own.largest.get() - 0.003).abs() < 1e-9 && own.most.get() == 1000.0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Difference {
    /// Samples on which both have a force and the same flags.
    pub samples: usize,
    /// Largest difference of the force on these.
    pub largest: Newton,
    /// Root mean square of the difference on these.
    pub rms: Newton,
    /// Largest force of the service.
    pub most: Newton,
    /// Samples whose force differs by more than 1e-4 of the largest force: the model jumps there, or amplifies rounding errors.
    pub far: usize,
    /// Samples that differ in their flags, or in whether there is a force.
    pub other: usize,
}

impl Difference {
    /// The differences of `exported` from `service`, sample by sample. Flags of refused samples do not count.
    #[must_use]
    pub fn of(service: &[Expected], exported: &[Expected]) -> Self {
        let most_n =
            service.iter().map(|own| own.force_n.abs()).filter(|n| n.is_finite()).fold(0.0, f64::max);
        let mut own = Self { most: Newton(most_n), ..Self::default() };
        let (mut largest_n, mut squares) = (0.0_f64, 0.0);
        for (ours, theirs) in service.iter().zip(exported) {
            let same_flags = !ours.accepted || ours.flags == theirs.flags;
            if ours.accepted != theirs.accepted
                || !same_flags
                || ours.force_n.is_nan() != theirs.force_n.is_nan()
            {
                own.other += 1;
            } else if ours.force_n.is_finite() {
                let difference_n = (theirs.force_n - ours.force_n).abs();
                largest_n = largest_n.max(difference_n);
                squares += difference_n * difference_n;
                own.far += usize::from(difference_n > FAR * most_n);
                own.samples += 1;
            }
        }
        let rms_n = (squares / own.samples.max(1) as f64).sqrt();
        Self { largest: Newton(largest_n), rms: Newton(rms_n), ..own }
    }

    /// Largest difference as a share of the largest force; NaN without a force.
    #[must_use]
    pub fn largest_share(&self) -> f64 {
        self.largest.get() / self.most.get()
    }

    /// Root mean square of the difference as a share of the largest force; NaN without a force.
    #[must_use]
    pub fn rms_share(&self) -> f64 {
        self.rms.get() / self.most.get()
    }
}

impl Difference {
    /// The figures in sentences.
    #[must_use]
    pub fn sentences(&self) -> Vec<String> {
        let Self { samples, largest, rms, most, far, other } = self;
        let [largest_n, rms_n, most_n] = [largest, rms, most].map(|force| force.get());
        let mut all = vec![
            format!(
                "On {samples} generated readings the force differs from the service's by at most {largest_n:.2e} N."
            ),
            format!(
                "The root mean square of the difference is {rms_n:.2e} N. The largest force is {most_n:.0} N."
            ),
        ];
        if *far > 0 {
            all.push(format!(
                "On {far} of them it differs by more than 0.01 % of the largest force, where the model jumps or amplifies rounding errors."
            ));
        }
        if *other > 0 {
            all.push(format!("{other} more readings have other flags, or a force in one of the two only."));
        }
        all
    }
}
