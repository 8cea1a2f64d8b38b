//! Sampling times of a channel whose stamps are less accurate than its sampling.
//!
//! A driver may sample at even times and stamp the samples late by a varying delay. A signal is then smooth over the sample number and
//! rough over the stamps. For both time bases, the departure of each sample from the parabola through its neighbours is averaged:
//!
//! ```text
//! r = x_b - (w_z x_z + w_a x_a + w_c x_c)            z, a, b, c: four samples in a row; w: Lagrange weights at t_b
//! J = mean of r^2 / (1 + w_z^2 + w_a^2 + w_c^2)      noise alone gives the same J for both time bases
//! ```
//!
//! The stamps are used until the J of the even times is less than half of the stamps' J. They are used again when it exceeds [`LEFT_ABOVE`]
//! times the stamps' J.
//!
//! Even times are the output of a phase-locked loop of second order (F. M. Gardner, *Phaselock Techniques*, 3rd ed., 2005, ch. 2). Each
//! sample is expected one period after the one before, and a share of its departure corrects the phase and the period. The shares come from
//! the least-squares line over the number of samples seen, up to [`SETTLED`] samples. If a sample comes more than three quarters of a
//! period late, samples before it are taken as lost.
//!
//! Source: `[gardner2005]` in the bibliography (node/docs/guide/bibliography.md).

use crate::sample::Stamp;

/// Number of samples that determine the first period, before the loop closes.
const FIRST: u32 = 30;
/// Number of samples in the mean J, and the number from which J is used.
const MEAN_OF: u32 = 100;
const MEAN_FROM: u32 = 30;
/// Number of samples that the first period counts for in the fit of a line, and the number from which the loop's gains stay constant.
const WORTH: u32 = 15;
const SETTLED: u32 = 80;
/// Departure, in periods, beyond which samples were lost or were counted as lost by mistake.
const SLIP: f64 = 0.75;
/// Step after which the loop restarts, periods.
const GAP: f64 = 20.0;
/// Least step of the even times, periods.
const LEAST_STEP: f64 = 0.1;
/// Ratio of the J of even times to the J of the stamps: below the first the even times are used, above the second the stamps are used
/// again.
const TAKEN_BELOW: f64 = 0.5;
const LEFT_ABOVE: f64 = 1.25;
/// Longest time between four samples that are compared, periods.
const COMPARED: f64 = 6.0;

/// Mean squared departure from a parabola over one time base.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Roughness {
    /// The last three steps, newest first, s.
    steps_s: [f64; 3],
    mean: f64,
}

impl Roughness {
    /// Takes the step to the newest of four `values` (newest first), and adds the departure of the value before it to the mean.
    #[inline]
    fn see(&mut self, step_s: f64, values: [f64; 4], most_s: f64, seen: u32) {
        self.steps_s = [step_s, self.steps_s[0], self.steps_s[1]];
        let [cb, ba, az] = self.steps_s;
        if !(cb > 0.0 && ba > 0.0 && az > 0.0 && cb + ba + az <= most_s) {
            return;
        }
        let (ca, bz, cz) = (cb + ba, ba + az, cb + ba + az);
        let [w_c, w_a, w_z] = [bz * ba / (cz * ca), bz * cb / (az * ca), -ba * cb / (az * cz)];
        let [c, b, a, z] = values;
        let departure = b - (w_c * c + w_a * a + w_z * z);
        let square = departure * departure / (1.0 + w_c * w_c + w_a * w_a + w_z * w_z);
        if square.is_finite() {
            self.mean += (square - self.mean) / f64::from(seen.clamp(1, MEAN_OF));
        }
    }
}

/// The times of one channel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Timing {
    /// The last stamp, and the time that was assigned to it.
    last: Option<(Stamp, Stamp)>,
    /// The even time of the last sample minus its stamp, s.
    offset_s: f64,
    period_s: f64,
    /// The last three values, newest first.
    values: [f64; 3],
    seen: u32,
    by_stamp: Roughness,
    by_number: Roughness,
    is_even: bool,
}

impl Timing {
    /// The sampling time of the sample with this stamp.
    #[inline]
    pub(crate) fn place(&mut self, stamp: Stamp, value: f64) -> Stamp {
        let Some((last, given)) = self.last else {
            *self =
                Self { last: Some((stamp, stamp)), values: [value, f64::NAN, f64::NAN], ..Self::default() };
            return stamp;
        };
        let step_s = stamp.since(last).get();
        if self.seen >= FIRST && !(step_s > 0.0 && step_s < GAP * self.period_s) {
            *self = Self::default();
            return self.place(stamp, value);
        }
        self.seen = self.seen.saturating_add(1);
        let even_step_s = if self.seen <= FIRST { self.first(step_s) } else { self.follow(step_s) };
        if self.seen > FIRST {
            let [b, a, z] = self.values;
            let (most_s, seen) = (COMPARED * self.period_s, self.seen - FIRST);
            self.by_stamp.see(step_s, [value, b, a, z], most_s, seen);
            self.by_number.see(even_step_s, [value, b, a, z], most_s, seen);
            self.choose(seen);
        }
        self.values = [value, self.values[0], self.values[1]];
        let even = stamp.shifted((1e9 * self.offset_s).round() as i64);
        let at = if self.is_even { even.max(given.shifted(1)) } else { stamp.max(given.shifted(1)) };
        self.last = Some((stamp, at));
        at
    }

    /// Clears all state: the next sample is the first.
    pub(crate) fn reset(&mut self) {
        *self = Self::default();
    }

    /// Averages the first steps and returns the step, s. The phase is taken from the stamps.
    fn first(&mut self, step_s: f64) -> f64 {
        self.period_s += (step_s - self.period_s) / f64::from(self.seen);
        step_s
    }

    /// Moves the loop by a step of the stamps, and returns its own step, s.
    #[inline]
    fn follow(&mut self, step_s: f64) -> f64 {
        let period_s = self.period_s;
        let mut departure_s = step_s - self.offset_s - period_s;
        let slipped =
            if departure_s.abs() > SLIP * period_s { (departure_s / period_s).round() } else { 0.0 };
        departure_s -= slipped * period_s;
        let [phase_gain, period_gain] = gains(self.seen - FIRST);
        let even_step_s = (period_s * (1.0 + slipped) + phase_gain * departure_s).max(LEAST_STEP * period_s);
        self.period_s += period_gain * departure_s;
        self.offset_s += even_step_s - step_s;
        even_step_s
    }

    #[inline]
    fn choose(&mut self, seen: u32) {
        let (even, stamped) = (self.by_number.mean, self.by_stamp.mean);
        self.is_even = if self.is_even {
            even <= LEFT_ABOVE * stamped
        } else {
            seen > MEAN_FROM && even < TAKEN_BELOW * stamped
        };
    }
}

/// Shares of a departure that correct phase and period: from the least-squares line through all samples, up to [`SETTLED`].
#[inline]
fn gains(seen: u32) -> [f64; 2] {
    let n = f64::from((seen + WORTH).min(SETTLED));
    let fit = n * (n + 1.0);
    [(4.0 * n - 2.0) / fit, 6.0 / fit]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest difference, in periods, between the assigned times and the sampling times, for the last half of 1000 samples of a sine at 1
    /// kHz. `late(k)` is the delay of the stamp of sample `k` in periods, or `None` if the sample is lost.
    fn worst(late: impl Fn(i64) -> Option<f64>) -> f64 {
        let mut timing = Timing::default();
        let mut worst = 0.0_f64;
        for k in 0..1000 {
            let Some(late) = late(k) else { continue };
            let taken = Stamp::from_nanos(k * 1_000_000);
            let value = (20.0 * taken.nanos() as f64 * 1e-9).sin();
            let given = timing.place(taken.shifted((late * 1e6) as i64), value);
            if k >= 500 {
                worst = worst.max((given.since(taken).get() / 1e-3).abs());
            }
        }
        worst
    }

    /// Pseudo-random numbers between -0.5 and 0.5.
    fn jitter(k: i64) -> f64 {
        (k as f64 * 0.618_034 + (k as f64 * 1.7).sin()).rem_euclid(1.0) - 0.5
    }

    #[test]
    fn even_samples_keep_their_stamps() {
        assert_eq!(worst(|_| Some(0.0)), 0.0);
        assert_eq!(worst(|_| Some(0.25)), 0.25, "a common delay of all stamps cannot be detected");
    }

    #[test]
    fn jittering_stamps_of_even_samples_are_corrected() {
        assert!(worst(|k| Some(jitter(k))) < 0.2);
        assert!(
            worst(|k| (k % 50 != 0).then(|| jitter(k))) < 1.2,
            "a lost sample may be detected one sample late"
        );
    }

    #[test]
    fn jittering_samples_keep_their_stamps() {
        let mut timing = Timing::default();
        for k in 0..1000 {
            let stamp = Stamp::from_nanos(k * 1_000_000 + (jitter(k) * 1e6) as i64);
            assert_eq!(timing.place(stamp, (20.0 * stamp.nanos() as f64 * 1e-9).sin()), stamp);
        }
    }

    #[test]
    fn times_increase_whatever_the_stamps_do() {
        let mut timing = Timing::default();
        let mut last = Stamp::from_nanos(-1);
        for k in 0..5000_i64 {
            // The publisher pauses and catches up, changes its rate, and has a gap.
            let step = if k % 97 < 20 { 20_000 } else { 1_000_000 + 700_000 * (k / 1500) };
            let gap = if k == 2500 { 1_000_000_000 } else { 0 };
            let stamp = last.shifted(step + gap + (jitter(k) * 10_000.0) as i64);
            let given = timing.place(stamp, jitter(k * k));
            assert!(given > last || k == 0, "{k}: {given:?} after {last:?}");
            last = last.max(given);
        }
    }
}
