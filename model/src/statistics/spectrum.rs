//! Power densities and coherence of two signals, by Welch's method.
//!
//! ```text
//! X_s, Y_s   transforms of segments that overlap by half, mean subtracted, with a Hann window w
//! S_xx = 2 / (f_s sum w²) mean_s |X_s|²            unit² / Hz, over positive frequencies
//! C_xy = |mean_s X_s* Y_s|² / (mean_s |X_s|²  mean_s |Y_s|²)
//! ```
//!
//! Source: `[welch1967]` in the bibliography (node/docs/guide/bibliography.md).

use super::fourier::transform;
use realfft::RealFftPlanner;
use realfft::num_complex::Complex;

/// Number of independent segments that one half-overlapping segment with a Hann window counts for.
const INDEPENDENT: f64 = 1.0 / 1.056;

/// Spectra of two signals.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectra {
    /// Frequencies above zero, Hz.
    pub hz: Vec<f64>,
    /// Power density of the first signal at each frequency, unit²/Hz.
    pub first: Vec<f64>,
    /// Power density of the second signal at each frequency, unit²/Hz.
    pub second: Vec<f64>,
    /// Coherence of both signals at each frequency, 0 to 1.
    pub coherence: Vec<f64>,
    /// Number of segments.
    pub segments: usize,
}

impl Spectra {
    /// The spectra of stretches of pairs `(first, second)` sampled at `rate_hz`, in segments of `length` samples. `None`
    /// when every stretch is shorter than a segment.
    ///
    /// ```
    /// use mr_damper_model::statistics::spectrum::Spectra;
    /// // A sine of 8 Hz and amplitude 3, and its half: all power is at 8 Hz, and both are coherent there.
    /// let wave = |k: u32| 3.0 * (std::f64::consts::TAU * 8.0 * f64::from(k) / 256.0).sin();
    /// let stretch: Vec<(f64, f64)> = (0..2048).map(|k| (wave(k), 0.5 * wave(k))).collect();
    /// let spectra = Spectra::of(&[stretch], 256.0, 256).expect("longer than a segment");
    /// assert_eq!(spectra.hz[7], 8.0);
    /// let power: f64 = spectra.first.iter().sum(); // the bins are 1 Hz wide
    /// assert!((power - 4.5).abs() < 1e-9 && spectra.coherence[7] > 0.999);
    /// ```
    #[must_use]
    pub fn of(stretches: &[Vec<(f64, f64)>], rate_hz: f64, length: usize) -> Option<Self> {
        if length < 4 {
            return None;
        }
        let window: Vec<f64> = (0..length)
            .map(|k| 0.5 - 0.5 * (std::f64::consts::TAU * k as f64 / length as f64).cos())
            .collect();
        let plan = RealFftPlanner::<f64>::new().plan_fft_forward(length);
        let bins = length / 2 + 1;
        let (mut first, mut second) = (vec![0.0; bins], vec![0.0; bins]);
        let mut cross = vec![Complex::new(0.0, 0.0); bins];
        let mut segments = 0_usize;
        for stretch in stretches {
            for start in (0..(stretch.len() + 1).saturating_sub(length)).step_by(length / 2) {
                let segment = &stretch[start..start + length];
                let x = transform(&*plan, &windowed(segment.iter().map(|pair| pair.0), &window));
                let y = transform(&*plan, &windowed(segment.iter().map(|pair| pair.1), &window));
                for (k, (x, y)) in x.iter().zip(&y).enumerate() {
                    first[k] += x.norm_sqr();
                    second[k] += y.norm_sqr();
                    cross[k] += x.conj() * y;
                }
                segments += 1;
            }
        }
        if segments == 0 {
            return None;
        }
        let scale = 2.0 / (rate_hz * window.iter().map(|w| w * w).sum::<f64>() * segments as f64);
        let coherence = (1..bins).map(|k| {
            let power = first[k] * second[k];
            if power > 0.0 { (cross[k].norm_sqr() / power).min(1.0) } else { 0.0 }
        });
        Some(Self {
            hz: (1..bins).map(|k| k as f64 * rate_hz / length as f64).collect(),
            coherence: coherence.collect(),
            first: first[1..].iter().map(|power| power * scale).collect(),
            second: second[1..].iter().map(|power| power * scale).collect(),
            segments,
        })
    }

    /// The coherence that two unrelated signals exceed at one frequency in twenty. `None` with fewer than two segments,
    /// because the coherence of a single segment is always one.
    #[must_use]
    pub fn chance(&self) -> Option<f64> {
        let independent = INDEPENDENT * self.segments as f64;
        (independent > 1.5).then(|| 1.0 - 0.05_f64.powf(1.0 / (independent - 1.0)))
    }
}

/// The values without their mean, multiplied by the window.
fn windowed(values: impl Iterator<Item = f64> + Clone, window: &[f64]) -> Vec<f64> {
    let mean = values.clone().sum::<f64>() / window.len() as f64;
    values.zip(window).map(|(value, w)| (value - mean) * w).collect()
}

#[cfg(test)]
mod tests {
    use super::super::tests::noise;
    use super::*;

    const RATE_HZ: f64 = 512.0;

    #[test]
    fn a_sine_has_its_power_at_its_frequency() {
        let at = |k: usize| (std::f64::consts::TAU * 20.0 * k as f64 / RATE_HZ + 0.4).sin();
        // An offset has no power at frequencies above zero.
        let stretch: Vec<(f64, f64)> = (0..8192).map(|k| (3.0 * at(k) + 7.0, at(k))).collect();
        let found = Spectra::of(&[stretch], RATE_HZ, 1024).expect("sixteen segments");
        let bin_hz = found.hz[0];
        let total: f64 = found.first.iter().map(|density| density * bin_hz).sum();
        assert!((total - 4.5).abs() < 1e-9, "{total}");
        let peak =
            (0..found.hz.len()).max_by(|a, b| found.first[*a].total_cmp(&found.first[*b])).expect("bins");
        assert!((found.hz[peak] - 20.0).abs() < 1e-9 && found.segments == 15);
        assert!((found.first[peak] / found.second[peak] - 9.0).abs() < 1e-9);
    }

    #[test]
    fn white_noise_is_flat_at_twice_its_variance_over_the_rate() {
        let stretch: Vec<(f64, f64)> = noise(1, 65_536).zip(noise(2, 65_536)).collect();
        let found = Spectra::of(&[stretch], RATE_HZ, 512).expect("segments");
        let mean = found.first.iter().sum::<f64>() / found.first.len() as f64;
        assert!((mean * RATE_HZ / 2.0 - 1.0).abs() < 0.03, "{mean}");
        // Two unrelated signals: one frequency in twenty is above the chance level.
        let chance = found.chance().expect("many segments");
        let above =
            found.coherence.iter().filter(|c| **c > chance).count() as f64 / found.coherence.len() as f64;
        assert!((0.02..0.09).contains(&above), "{above} above {chance}");
    }

    #[test]
    fn a_filtered_signal_is_coherent_with_its_source() {
        let mut lag = 0.0;
        let own = noise(4, 32_768);
        let stretch: Vec<(f64, f64)> = noise(3, 32_768)
            .zip(own)
            .map(|(x, noise)| {
                lag += 0.1 * (x - lag);
                (x, lag + 0.1 * noise)
            })
            .collect();
        let found = Spectra::of(&[stretch], RATE_HZ, 512).expect("segments");
        // The lag has the power |H|² and the noise 0.01, so the coherence is |H|² / (|H|² + 0.01).
        for k in [1_usize, 10, 40, 120] {
            let angle = std::f64::consts::TAU * found.hz[k] / RATE_HZ;
            let h = 0.01 / (1.0 + 0.81 - 1.8 * angle.cos());
            let expected = h / (h + 0.01);
            assert!((found.coherence[k] - expected).abs() < 0.08, "{k}: {} {expected}", found.coherence[k]);
        }
    }

    #[test]
    fn a_stretch_shorter_than_a_segment_has_no_spectrum() {
        let short: Vec<(f64, f64)> = noise(5, 100).zip(noise(6, 100)).collect();
        assert_eq!(Spectra::of(&[short.clone(), Vec::new()], RATE_HZ, 128), None);
        let one = Spectra::of(&[short], RATE_HZ, 100).expect("one segment");
        assert_eq!((one.segments, one.chance()), (1, None));
    }
}
