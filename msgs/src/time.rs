//! Conversion between ROS time and nanoseconds since 1970.

use crate::standard::Time;

/// Nanoseconds in a second.
const SECOND_NS: i64 = 1_000_000_000;

/// A time in nanoseconds that does not fit in the 32-bit seconds of a ROS stamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{nanos} ns since 1970 does not fit in a ROS stamp, which ends in 2038 ({} to {} ns)",
    Time::MIN.as_nanos(),
    Time::MAX.as_nanos()
)]
pub struct TimeOutOfRange {
    /// The requested time in nanoseconds since 1970.
    pub nanos: i64,
}

impl Time {
    /// The earliest stamp, in 1901.
    pub const MIN: Self = Self { sec: i32::MIN, nanosec: 0 };

    /// The latest stamp, in 2038.
    pub const MAX: Self = Self { sec: i32::MAX, nanosec: 999_999_999 };

    /// Nanoseconds since 1970. Every stamp fits.
    ///
    /// A `nanosec` of a second or more, which a faulty peer may send, is carried into the seconds.
    #[must_use]
    pub const fn as_nanos(self) -> i64 {
        // Widening casts; `i64::from` is not const.
        self.sec as i64 * SECOND_NS + self.nanosec as i64
    }

    /// The stamp for a time in nanoseconds since 1970.
    ///
    /// Seconds are rounded down, so that `nanosec` also counts forward before 1970.
    ///
    /// # Errors
    /// If the time is before [`Time::MIN`] or after [`Time::MAX`].
    pub fn from_nanos(nanos: i64) -> Result<Self, TimeOutOfRange> {
        let sec = i32::try_from(nanos.div_euclid(SECOND_NS)).map_err(|_| TimeOutOfRange { nanos })?;
        let nanosec = u32::try_from(nanos.rem_euclid(SECOND_NS)).map_err(|_| TimeOutOfRange { nanos })?;
        Ok(Self { sec, nanosec })
    }

    /// Like [`Time::from_nanos`], but a time out of range becomes [`Time::MIN`] or [`Time::MAX`].
    #[must_use]
    pub fn from_nanos_saturating(nanos: i64) -> Self {
        Self::from_nanos(nanos).unwrap_or(if nanos < 0 { Self::MIN } else { Self::MAX })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn seconds_are_rounded_down_before_1970() {
        assert_eq!(Time::from_nanos(-1), Ok(Time { sec: -1, nanosec: 999_999_999 }));
        assert_eq!(Time::from_nanos(-1_000_000_000), Ok(Time { sec: -1, nanosec: 0 }));
        assert_eq!(Time { sec: -1, nanosec: 999_999_999 }.as_nanos(), -1);
    }

    #[test]
    fn out_of_range_is_an_error_or_saturates() {
        for (inside, outside) in [(Time::MIN, -1), (Time::MAX, 1)] {
            let nanos = inside.as_nanos();
            assert_eq!(Time::from_nanos(nanos), Ok(inside));
            assert_eq!(Time::from_nanos(nanos + outside), Err(TimeOutOfRange { nanos: nanos + outside }));
            assert_eq!(Time::from_nanos_saturating(nanos + outside), inside);
        }
        assert_eq!(Time::from_nanos_saturating(i64::MIN), Time::MIN);
        assert_eq!(Time::from_nanos_saturating(i64::MAX), Time::MAX);
    }

    #[test]
    fn too_many_nanoseconds_are_carried() {
        assert_eq!(Time { sec: 1, nanosec: 2_500_000_000 }.as_nanos(), 3_500_000_000);
        assert_eq!(Time { sec: i32::MAX, nanosec: u32::MAX }.as_nanos(), 2_147_483_651_294_967_295);
    }

    proptest! {
        #[test]
        fn every_time_in_range_round_trips(nanos in Time::MIN.as_nanos()..=Time::MAX.as_nanos()) {
            let time = Time::from_nanos(nanos).expect("in range");
            prop_assert!(time.nanosec < 1_000_000_000);
            prop_assert_eq!(time.as_nanos(), nanos);
        }
    }
}
