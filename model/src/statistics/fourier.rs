//! Discrete Fourier transform of a real series.
//!
//! ```text
//! X_m = sum_t x_t e^(-2 pi i m t / N),   m = 0 .. N / 2
//! ```

use realfft::RealToComplex;
use realfft::num_complex::Complex;

/// The Fourier transform of `values`. The plan must have their length.
pub(crate) fn transform(plan: &dyn RealToComplex<f64>, values: &[f64]) -> Vec<Complex<f64>> {
    let (mut input, mut output) = (values.to_vec(), plan.make_output_vec());
    // This cannot fail: the lengths are the plan's own.
    let _ = plan.process(&mut input, &mut output);
    output
}
