//! Noise for the tests of this module.

/// Reproducible, nearly normal noise with a variance of 1.
pub(super) fn noise(seed: u64, count: usize) -> impl Iterator<Item = f64> + Clone {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut uniform = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let values: Vec<f64> = (0..count).map(|_| (0..12).map(|_| uniform()).sum::<f64>() - 6.0).collect();
    values.into_iter()
}
