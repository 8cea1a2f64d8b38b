//! Alive counter and checksum of a message.
//!
//! | given | checksum | counter |
//! |---|---|---|
//! | a data ID | AUTOSAR E2E profile 1, both bytes of the data ID: CRC-8 with polynomial 0x1D, first over the low and the high byte of the data ID, then over all bytes of the message but the checksum | 0 to 14, in 4 bits |
//! | no data ID | CRC-8 SAE J1850 over all bytes of the message but the checksum | 0 to the greatest number of its bits |
//!
//! Profile 1 starts with 0 and inverts nothing, which the catalogue of CRCs calls GSM-A; SAE J1850 starts with 0xFF and inverts the
//! result. The checksum has its own byte, at any place.

use super::dbc::Message;
use super::error::BusError;
use super::signal::{Decoded, Kind, Presence, Signal, decode};
use crc::{CRC_8_GSM_A, CRC_8_SAE_J1850, Crc};

/// Checksum of AUTOSAR E2E profile 1.
const PROFILE_1: Crc<u8> = Crc::<u8>::new(&CRC_8_GSM_A);
/// Checksum without a data ID.
const J1850: Crc<u8> = Crc::<u8>::new(&CRC_8_SAE_J1850);
/// Number of values of the counter of profile 1: the fifteenth is reserved.
const PROFILE_1_COUNTS: u64 = 15;

/// The signals that protect a message, by name.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct ProtectionNames {
    pub(super) counter: Option<String>,
    pub(super) checksum: Option<String>,
    pub(super) data_id: Option<u16>,
}

impl ProtectionNames {
    /// Takes the option `name=value`; false if it is none of these.
    ///
    /// # Errors
    /// When an option is given twice, or the data ID is not a number of 16 bits.
    pub(super) fn take(&mut self, text: &str, name: &str, value: &str) -> Result<bool, BusError> {
        let twice = || BusError::Twice { text: text.to_owned(), name: name.to_owned() };
        let place = match name {
            "counter" => &mut self.counter,
            "checksum" => &mut self.checksum,
            "data_id" => {
                let digits = value.strip_prefix("0x").or_else(|| value.strip_prefix("0X"));
                let number = digits.map_or_else(|| value.parse(), |hex| u16::from_str_radix(hex, 16));
                let number = number
                    .map_err(|_| BusError::DataId { text: text.to_owned(), value: value.to_owned() })?;
                return self.data_id.replace(number).map_or(Ok(true), |_| Err(twice()));
            }
            _ => return Ok(false),
        };
        place.replace(value.to_owned()).map_or(Ok(true), |_| Err(twice()))
    }
}

/// Alive counter and checksum of a message, with the last counter.
#[derive(Debug, Clone)]
pub(super) struct Protection {
    counter: Option<Signal>,
    /// Number of the counter's values.
    counts: u64,
    /// The byte of the checksum.
    checksum: Option<usize>,
    data_id: Option<u16>,
    /// Bytes of the message.
    bytes: usize,
    last: Option<u64>,
}

/// A protected frame that is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Passed {
    /// Number of frames that are missing before it.
    pub(super) missing: u64,
}

/// Why a protected frame is not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Failed {
    /// The frame is shorter than its message.
    Short,
    /// The checksum is another one.
    Checksum,
    /// The counter has the value of the frame before.
    Repeated,
    /// The counter has a value that its profile does not have.
    Counter,
}

impl Protection {
    /// The protection of `message`.
    ///
    /// # Errors
    /// When a signal is not in the message, or is not what the checksum's rules need.
    pub(super) fn new(text: &str, message: &Message, names: &ProtectionNames) -> Result<Self, BusError> {
        let signal = |name: &String| signal_of(text, message, name).cloned();
        let counter = names.counter.as_ref().map(signal).transpose()?;
        let checksum = names.checksum.as_ref().map(signal).transpose()?;
        let unfit = |signal: &Signal, needs: &'static str| BusError::Unfit {
            text: text.to_owned(),
            signal: format!("{}.{}", message.name, signal.name),
            needs: needs.to_owned(),
        };
        let is_profile_1 = names.data_id.is_some();
        if let Some(signal) = &counter
            && (!is_plain(signal) || (is_profile_1 && signal.length != 4))
        {
            let needs = if is_profile_1 {
                "the counter of profile 1 has 4 unsigned bits, factor 1 and offset 0"
            } else {
                "a counter is unsigned, with factor 1 and offset 0"
            };
            return Err(unfit(signal, needs));
        }
        let place = |signal: &Signal| {
            let lowest = if signal.big_endian { 7 } else { 0 };
            (is_plain(signal) && signal.length == 8 && signal.start % 8 == lowest)
                .then_some(signal.start as usize / 8)
        };
        let checksum = match &checksum {
            Some(signal) => Some(place(signal).ok_or_else(|| {
                unfit(signal, "a checksum fills one byte: 8 unsigned bits, factor 1 and offset 0")
            })?),
            None => None,
        };
        if is_profile_1 && (checksum.is_none() || counter.is_none()) {
            return Err(BusError::Profile { text: text.to_owned() });
        }
        let of_bits = |signal: &Signal| signal.all_ones().saturating_add(1);
        let counts = if is_profile_1 { PROFILE_1_COUNTS } else { counter.as_ref().map_or(1, of_bits) };
        let bytes = usize::try_from(message.bytes).unwrap_or_default();
        Ok(Self { counter, counts, checksum, data_id: names.data_id, bytes, last: None })
    }

    /// The signal of the counter, and the byte of the checksum.
    pub(super) fn places(&self) -> (Option<&Signal>, Option<usize>) {
        (self.counter.as_ref(), self.checksum)
    }

    /// Counts a frame that is sent, and writes counter and checksum into its data. The first counter is 0.
    pub(super) fn protect(&mut self, data: &mut [u8]) {
        let count = self.last.map_or(0, |last| (last + 1) % self.counts);
        self.last = Some(count);
        if let Some(counter) = &self.counter {
            counter.put(count, data);
        }
        if let Some(checksum) = self.checksum_of(data)
            && let Some(byte) = self.checksum.and_then(|place| data.get_mut(place))
        {
            *byte = checksum;
        }
    }

    /// Checks a received frame.
    pub(super) fn check(&mut self, data: &[u8]) -> Result<Passed, Failed> {
        let data = data.get(..self.bytes).ok_or(Failed::Short)?;
        if self.checksum_of(data) != self.checksum.and_then(|place| data.get(place).copied()) {
            return Err(Failed::Checksum);
        }
        let Some(counter) = &self.counter else { return Ok(Passed { missing: 0 }) };
        let Decoded::Value(count) = decode(std::slice::from_ref(counter), 0, data) else {
            return Err(Failed::Short);
        };
        // At most 32 bits are compared exactly; a wider counter is a number of `f64`, too.
        let count = count as u64;
        if count >= self.counts {
            return Err(Failed::Counter);
        }
        let last = self.last.replace(count);
        let step = last.map_or(1, |last| (count + self.counts - last) % self.counts);
        if step == 0 { Err(Failed::Repeated) } else { Ok(Passed { missing: step - 1 }) }
    }

    /// The checksum of a message's data; `None` without a checksum.
    fn checksum_of(&self, data: &[u8]) -> Option<u8> {
        let place = self.checksum?;
        let (before, after) = (data.get(..place)?, data.get(place + 1..)?);
        let mut digest = match self.data_id {
            Some(_) => PROFILE_1.digest(),
            None => J1850.digest(),
        };
        if let Some(data_id) = self.data_id {
            digest.update(&data_id.to_le_bytes());
        }
        digest.update(before);
        digest.update(after);
        Some(digest.finalize())
    }
}

/// True for an unsigned whole number without scaling that is always present.
pub(super) fn is_plain(signal: &Signal) -> bool {
    let is_unscaled = signal.factor.value == 1.0 && signal.offset.value == 0.0;
    signal.kind == Kind::Unsigned && is_unscaled && signal.presence == Presence::Always && signal.length < 53
}

/// The signal called `name` of a message.
///
/// # Errors
/// When the message has no such signal, or no frame can hold it.
pub(super) fn signal_of<'a>(text: &str, message: &'a Message, name: &str) -> Result<&'a Signal, BusError> {
    let found = message.signals.iter().find(|signal| signal.name == name);
    let signal = found.ok_or_else(|| BusError::NoSignal {
        text: text.to_owned(),
        message: message.name.clone(),
        signal: name.to_owned(),
        signals: message.signals.iter().map(|signal| &*signal.name).collect::<Vec<_>>().join(", "),
    })?;
    super::lookup::check_signal(message, signal)
        .map_err(|why| BusError::Map { text: text.to_owned(), why: Box::new(why) })?;
    Ok(signal)
}

#[cfg(test)]
mod tests {
    use super::super::Signals;
    use super::*;
    use std::io::Write as _;

    const DBC: &str = r#"BO_ 1 A: 8 X
 SG_ Crc : 0|8@1+ (1,0) [0|0] "" X
 SG_ Alive : 8|4@1+ (1,0) [0|0] "" X
 SG_ Rest : 12|4@1+ (1,0) [0|0] "" X
 SG_ Wide : 16|8@1+ (1,0) [0|0] "" X
BO_ 2 B: 7 X
 SG_ Crc : 23|8@0+ (1,0) [0|0] "" X
 SG_ Alive : 24|4@1+ (1,0) [0|0] "" X
"#;

    fn protection(message: &str, options: &str) -> Result<Protection, BusError> {
        let mut file = tempfile::NamedTempFile::new().expect("a file");
        file.write_all(DBC.as_bytes()).expect("written");
        let signals = Signals::read(&[file.path().to_owned()]).expect("a good file");
        let mut names = ProtectionNames::default();
        for option in options.split(',') {
            let (name, value) = option.split_once('=').expect("a form");
            assert!(names.take(options, name, value)?, "{option}");
        }
        Protection::new(options, signals.0.message(options, message)?, &names)
    }

    fn hex(text: &str) -> Vec<u8> {
        (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).expect("hex")).collect()
    }

    // The expected frames come from autosar-e2e 1.0.0: `e2e.p01.e2e_p01_protect(data, 0x123)`, and with `offset=2` and 0xbeef for B.
    #[test]
    fn frames_of_profile_1_equal_those_of_another_implementation() {
        let mut sent = protection("A", "counter=Alive,checksum=Crc,data_id=0x123").expect("it fits");
        let mut found = Vec::new();
        for _ in 0..16 {
            let mut data = hex("00a0112233445566");
            sent.protect(&mut data);
            found.push(data);
        }
        for (count, expected) in [
            (0, "13a0112233445566"),
            (1, "4ea1112233445566"),
            (14, "12ae112233445566"),
            (15, "13a0112233445566"),
        ] {
            assert_eq!(found[count], hex(expected), "frame {count}: the counter goes from 14 to 0");
        }
        let mut received = protection("A", "counter=Alive,checksum=Crc,data_id=291").expect("it fits");
        for data in &found {
            assert_eq!(received.check(data), Ok(Passed { missing: 0 }));
        }
        let mut other = protection("B", "counter=Alive,checksum=Crc,data_id=0xbeef").expect("it fits");
        assert_eq!(other.check(&hex("1122f8a3445566")), Ok(Passed { missing: 0 }));
    }

    // The expected checksum comes from crccheck 1.3.1: `Crc8SaeJ1850.calc(bytes.fromhex("a0112233445566"))`.
    #[test]
    fn without_a_data_id_the_checksum_is_that_of_sae_j1850() {
        let mut sent = protection("A", "checksum=Crc").expect("it fits");
        let mut data = hex("00a0112233445566");
        sent.protect(&mut data);
        assert_eq!(data, hex("d5a0112233445566"));
        assert_eq!(sent.check(&data), Ok(Passed { missing: 0 }));
    }

    #[test]
    fn frames_that_are_changed_short_repeated_or_missing_are_noticed() {
        let names = "counter=Alive,checksum=Crc,data_id=291";
        let mut sent = protection("A", names).expect("it fits");
        let mut next = || {
            let mut data = hex("00a0112233445566");
            sent.protect(&mut data);
            data
        };
        let mut received = protection("A", names).expect("it fits");
        let first = next();
        assert_eq!(received.check(&first), Ok(Passed { missing: 0 }));
        assert_eq!(received.check(&first), Err(Failed::Repeated));
        let second = next();
        for bit in 0..64 {
            let mut changed = second.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(received.check(&changed), Err(Failed::Checksum), "bit {bit}");
        }
        assert_eq!(received.check(&second[..7]), Err(Failed::Short));
        let _ = (next(), next());
        assert_eq!(received.check(&next()), Ok(Passed { missing: 3 }));
        let mut counter_only = protection("A", "counter=Wide").expect("it fits");
        let at = |count: u8| [0, 0, count, 0, 0, 0, 0, 0];
        assert_eq!(counter_only.check(&at(255)), Ok(Passed { missing: 0 }));
        assert_eq!(counter_only.check(&at(0)), Ok(Passed { missing: 0 }));
        assert_eq!(counter_only.check(&at(255)), Ok(Passed { missing: 254 }));
    }

    #[test]
    fn signals_that_cannot_protect_are_refused_with_the_reason() {
        for (options, why) in [
            ("counter=Alve", "message A has no signal `Alve`; its signals are Crc, Alive, Rest, Wide"),
            ("checksum=Alive", "A.Alive is not suitable: a checksum fills one byte"),
            ("counter=Wide,checksum=Crc,data_id=1", "the counter of profile 1 has 4 unsigned bits"),
            ("checksum=Crc,data_id=1", "needs both a counter and a checksum"),
            ("counter=Alive,data_id=65536", "data_id is `65536`"),
            ("counter=Alive,counter=Wide", "counter is given twice"),
        ] {
            let error = protection("A", options).expect_err(options).to_string();
            assert!(error.contains(why), "{options}: {error}");
        }
    }
}
