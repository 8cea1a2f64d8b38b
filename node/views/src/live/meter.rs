//! Rates and latencies, stored in constant space.

/// Events per second, over the last second.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RateMeter {
    /// Counts per tenth of a second. There is one more than a second needs, because the newest is incomplete.
    buckets: [u32; 11],
    newest: u64,
}

impl RateMeter {
    /// Counts an event seen at `now_s`. A time before the newest event counts as the time of the newest.
    pub fn note(&mut self, now_s: f64) {
        self.advance(now_s);
        self.buckets[Self::slot(self.newest)] += 1;
    }

    /// Events per second in the last full second before `now_s`.
    #[must_use]
    pub fn hz(&self, now_s: f64) -> f64 {
        let mut at_now = self.clone();
        at_now.advance(now_s);
        let newest = at_now.buckets[Self::slot(at_now.newest)];
        f64::from(at_now.buckets.iter().sum::<u32>() - newest)
    }

    fn advance(&mut self, now_s: f64) {
        // The cast converts negative values and NaN to zero.
        let bucket = (now_s * 10.0) as u64;
        if bucket > self.newest + 10 {
            self.buckets = [0; 11];
            self.newest = bucket;
        }
        while self.newest < bucket {
            self.newest += 1;
            self.buckets[Self::slot(self.newest)] = 0;
        }
    }

    const fn slot(bucket: u64) -> usize {
        (bucket % 11) as usize
    }
}

/// A histogram of durations from 1 µs to 10 s, with bins 5 % wide.
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    bins: Vec<u64>,
    count: u64,
    max_s: f64,
}

impl Default for Histogram {
    fn default() -> Self {
        Self { bins: vec![0; Self::BINS], count: 0, max_s: 0.0 }
    }
}

impl Histogram {
    const LEAST_S: f64 = 1e-6;
    const RATIO: f64 = 1.05;
    const BINS: usize = 332;

    /// Counts one duration. Negative values count as zero; values that are not finite are ignored.
    pub fn note(&mut self, duration_s: f64) {
        if !duration_s.is_finite() {
            return;
        }
        let bin = ((duration_s / Self::LEAST_S).max(1.0).ln() / Self::RATIO.ln()) as usize;
        self.bins[bin.min(Self::BINS - 1)] += 1;
        self.count += 1;
        self.max_s = self.max_s.max(duration_s);
    }

    /// Number of counted durations.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The longest duration, s.
    #[must_use]
    pub fn max_s(&self) -> f64 {
        self.max_s
    }

    /// The duration, s, below which the share `quantile` of all durations lies, accurate to 2.5 %; `None` without
    /// durations.
    #[must_use]
    pub fn quantile_s(&self, quantile: f64) -> Option<f64> {
        let rank = (quantile.clamp(0.0, 1.0) * self.count as f64).ceil().max(1.0) as u64;
        let mut seen = 0;
        let bin = self.bins.iter().position(|count| {
            seen += count;
            seen >= rank
        })?;
        let middle_s = Self::LEAST_S * Self::RATIO.powf(bin as f64 + 0.5);
        (self.count > 0).then_some(middle_s.min(self.max_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_counts_the_events_of_the_last_second() {
        let mut meter = RateMeter::default();
        for k in 0..2000 {
            meter.note(f64::from(k) / 512.0);
        }
        let end_s = 2000.0 / 512.0;
        assert!((meter.hz(end_s) - 512.0).abs() <= 1.0, "{}", meter.hz(end_s));
        assert!((meter.hz(end_s + 0.5) - 256.0).abs() <= 52.0, "half of the second is without events");
        assert_eq!(meter.hz(end_s + 60.0), 0.0);
    }

    #[test]
    fn quantiles_are_accurate_to_a_bin() {
        let mut histogram = Histogram::default();
        assert_eq!(histogram.quantile_s(0.5), None);
        for k in 1..=1000 {
            histogram.note(f64::from(k) * 1e-5);
        }
        histogram.note(f64::NAN);
        assert_eq!(histogram.count(), 1000);
        for (quantile, expected) in [(0.5, 5e-3), (0.99, 9.9e-3), (1.0, 1e-2)] {
            let found = histogram.quantile_s(quantile).expect("durations were counted");
            assert!((found / expected - 1.0).abs() < 0.03, "{quantile}: {found}");
        }
        assert_eq!(histogram.max_s(), 1e-2);
        histogram.note(-1.0);
        histogram.note(1e9);
        assert_eq!(histogram.count(), 1002);
    }
}
