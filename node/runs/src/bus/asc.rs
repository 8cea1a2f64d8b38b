//! Reads Vector's ASC logs.
//!
//! ```text
//! date Thu Nov 26 07:00:00 pm 2026
//! base hex  timestamps absolute
//!    0.250000 1  120             Rx   d 8 D2 04 03 E8 01 41 00 00
//!    0.250000 CANFD   1 Rx     18FF0001x                                  1 0 a 16 ...
//! ```
//!
//! Times count from the start of the measurement, or with `timestamps relative` from the line before. Events before the start, which a
//! trigger with a pre-trigger time records, have negative times. An `x` ends an identifier of 29 bits. Lines with other events are passed
//! over.

use super::frame::{Bus, BusFrame, CanId, MOST_BYTES};
use super::shown;
use super::text::LineReader;
use crate::decimal::parse_nanos;
use crate::error::LineFault;

/// The format, with the settings of the file's header.
pub(super) struct Asc {
    /// Base of identifiers and data bytes.
    radix: u32,
    /// Time of the line before, ns, if times count from there.
    before: Option<i64>,
    /// True when a line of the format was read.
    is_known: bool,
}

impl Asc {
    pub(super) const fn new() -> Self {
        Self { radix: 16, before: None, is_known: false }
    }

    /// Takes the settings of a line without time.
    fn header(&mut self, line: &str) -> Result<(), LineFault> {
        let mut words = line.split_ascii_whitespace().map(str::to_ascii_lowercase);
        let first = words.next().unwrap_or_default();
        match first.as_str() {
            "base" => {
                self.radix = match words.next().as_deref() {
                    Some("hex") => 16,
                    Some("dec") => 10,
                    _ => return Err(LineFault::AscBase { line: shown(line) }),
                };
                let is_relative = words.next().as_deref() == Some("timestamps")
                    && words.next().as_deref() == Some("relative");
                self.before = is_relative.then_some(0);
            }
            "date" | "begin" | "end" | "internal" | "no" | "//" => {}
            _ if first.starts_with("//") => {}
            // Anything may stand between the events of an ASC file, but another file must not pass for one.
            _ if !self.is_known => return Err(LineFault::Asc { line: shown(line) }),
            _ => return Ok(()),
        }
        self.is_known = true;
        Ok(())
    }

    /// The time of an event, ns.
    fn nanos(&mut self, time: &str) -> Option<i64> {
        let nanos = parse_nanos(time, 0)?;
        let Some(before) = self.before else { return Some(nanos) };
        let sum = before.checked_add(nanos)?;
        self.before = Some(sum);
        Some(sum)
    }

    fn id(&self, text: &str) -> Result<CanId, LineFault> {
        let (digits, extended) = text.strip_suffix(['x', 'X']).map_or((text, false), |digits| (digits, true));
        let value = u32::from_str_radix(digits, self.radix).ok();
        let id = value.and_then(|value| CanId::new(value, extended));
        id.ok_or_else(|| LineFault::Id { found: shown(text) })
    }

    fn push_bytes<'a>(
        &self,
        words: impl Iterator<Item = &'a str>,
        count: usize,
        data: &mut Vec<u8>,
    ) -> Result<(), LineFault> {
        for word in words.take(count) {
            data.push(
                u8::from_str_radix(word, self.radix).map_err(|_| LineFault::Bytes { found: shown(word) })?,
            );
        }
        if data.len() == count {
            Ok(())
        } else {
            Err(LineFault::FewBytes { found: data.len(), wanted: count })
        }
    }
}

/// True if a line that begins with this word is an event. A word that only begins like a negative number is part of a note.
fn is_time(word: &str) -> bool {
    let begins = |text: &str| text.starts_with(|c: char| c.is_ascii_digit()) && text.contains('.');
    match word.strip_prefix('-') {
        Some(rest) => begins(rest) && rest.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.'),
        None => begins(word),
    }
}

fn is_direction(word: &str) -> bool {
    word.eq_ignore_ascii_case("rx") || word.eq_ignore_ascii_case("tx")
}

impl LineReader for Asc {
    fn frame<'a>(&mut self, line: &'a str, data: &'a mut Vec<u8>) -> Result<Option<BusFrame<'a>>, LineFault> {
        data.clear();
        let mut words = line.split_ascii_whitespace();
        let Some(time) = words.next() else { return Ok(None) };
        if !is_time(time) {
            return self.header(line).map(|()| None);
        }
        let nanos = self.nanos(time).ok_or_else(|| LineFault::AscTime { time: shown(time) })?;
        self.is_known = true;
        let form = || LineFault::AscFrame { line: shown(line) };
        let (bus, id) = match words.next() {
            Some("CANFD") => {
                let (bus, direction) = words.next().zip(words.next()).ok_or_else(form)?;
                let id = words.next().ok_or_else(form)?;
                if !is_direction(direction) || id.eq_ignore_ascii_case("errorframe") {
                    return Ok(None);
                }
                let id = self.id(id)?;
                // The name of the message may stand before the bits BRS and ESI, the length code and the number of bytes.
                let mut word = words.next().ok_or_else(form)?;
                if !matches!(word, "0" | "1") {
                    word = words.next().ok_or_else(form)?;
                }
                let (esi, code) = words.next().zip(words.next()).ok_or_else(form)?;
                let bytes = words.next().and_then(|word| word.parse().ok()).ok_or_else(form)?;
                let is_flag = |word: &str| matches!(word, "0" | "1");
                if !is_flag(word)
                    || !is_flag(esi)
                    || u8::from_str_radix(code, 16).is_err()
                    || bytes > MOST_BYTES
                {
                    return Err(form());
                }
                self.push_bytes(words, bytes, data)?;
                (bus, id)
            }
            Some(bus) if bus.bytes().all(|byte| byte.is_ascii_digit()) => {
                let (Some(id), Some(direction)) = (words.next(), words.next()) else { return Ok(None) };
                // Error frames, statistics and transport protocols lack the direction; requests to send precede their frames.
                if !is_direction(direction) {
                    return Ok(None);
                }
                let id = self.id(id)?;
                match words.next() {
                    Some("d" | "D") => {}
                    Some("r" | "R") => return Ok(None),
                    _ => return Err(form()),
                }
                let code =
                    words.next().and_then(|word| u8::from_str_radix(word, 16).ok()).ok_or_else(form)?;
                // Codes above 8 stand for 8 bytes in frames that are not CAN FD.
                self.push_bytes(words, usize::from(code.min(8)), data)?;
                (bus, id)
            }
            _ => return Ok(None),
        };
        let bus = bus.parse().map_or(Bus::Name(bus), Bus::Number);
        Ok(Some(BusFrame { nanos, bus, id, data }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Read = (i64, String, String, Vec<u8>);

    fn read(asc: &mut Asc, line: &str) -> Result<Option<Read>, String> {
        let mut data = Vec::new();
        let frame = asc.frame(line, &mut data).map_err(|fault| fault.to_string())?;
        Ok(frame.map(|frame| (frame.nanos, frame.bus.to_string(), frame.id.to_string(), frame.data.to_vec())))
    }

    #[test]
    fn classic_and_fd_frames_are_read() {
        let mut asc = Asc::new();
        let frame = |nanos, bus: &str, id: &str, data: &[u8]| {
            Ok(Some((nanos, bus.to_owned(), id.to_owned(), data.to_vec())))
        };
        for line in [
            "date Thu Nov 26 07:00:00 pm 2026",
            "base hex  timestamps absolute",
            "internal events logged",
            "// version 8.0.0",
        ] {
            assert_eq!(read(&mut asc, line), Ok(None));
        }
        assert_eq!(
            read(&mut asc, "0.250000 1  120             Rx   d 2 D2 04  Length = 0 BitCount = 0 ID = 288"),
            frame(250_000_000, "1", "0x120", &[0xd2, 4])
        );
        assert_eq!(
            read(&mut asc, "1.5 2 18FF0001x Tx d 1 ff"),
            frame(1_500_000_000, "2", "0x18FF0001 extended", &[0xff])
        );
        let fd = "2.000001 CANFD   1 Rx        120                                   1 0 a 16 00 01 02 03 04 05 06 07 08 09 0a 0b 0c 0d \
                  0e 0f   130000  130 303000 0 0 0 0 0";
        assert_eq!(read(&mut asc, fd), frame(2_000_001_000, "1", "0x120", &(0..16).collect::<Vec<u8>>()));
        let named = "2.1 CANFD 1 Rx 120x SUSP_FL 0 0 1 1 7f 0 0";
        assert_eq!(read(&mut asc, named), frame(2_100_000_000, "1", "0x00000120 extended", &[0x7f]));
        for line in [
            "0.000000 Start of measurement",
            "0.1 1 ErrorFrame",
            "0.1 1 Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%",
            "0.1 1 120 Rx r",
            "0.1 1 120 TxRq d 1 00",
            "0.1 CAN 1 Status:chip status error active",
            "End TriggerBlock",
            "some note",
            "",
        ] {
            assert_eq!(read(&mut asc, line), Ok(None), "{line}");
        }
    }

    #[test]
    fn relative_times_count_from_the_line_before_and_the_base_may_be_ten() {
        let mut asc = Asc::new();
        assert_eq!(read(&mut asc, "base dec timestamps relative"), Ok(None));
        assert_eq!(read(&mut asc, "0.5 Start of measurement"), Ok(None));
        let frame = read(&mut asc, "0.25 1 288 Rx d 2 210 4").expect("good").expect("a frame");
        assert_eq!(frame, (750_000_000, "1".into(), "0x120".into(), vec![210, 4]));
        assert_eq!(read(&mut asc, "0.25 1 288 Rx d 1 1").expect("good").expect("a frame").0, 1_000_000_000);
    }

    #[test]
    fn frames_before_the_trigger_have_negative_times() {
        let mut asc = Asc::new();
        let mut nanos = |line: &str| read(&mut asc, line).map(|frame| frame.map(|frame| frame.0));
        assert_eq!(nanos("-0.500000 1 120 Rx d 1 ff"), Ok(Some(-500_000_000)), "it may be the first line");
        assert_eq!(nanos("-0.000001 CANFD 1 Rx 120 1 0 1 1 7f"), Ok(Some(-1_000)));
        assert_eq!(nanos("-0.25 Start of measurement"), Ok(None));
        assert!(nanos("-0.25 1 120 Rx d 2 00").expect_err("a byte is missing").contains("1 of 2 data bytes"));
        assert_eq!(
            [nanos("-1.5mm was the offset"), nanos("- 1.5"), nanos("-12 1 120 Rx d 1 00")],
            [Ok(None), Ok(None), Ok(None)]
        );
        assert_eq!(nanos("0.5 1 120 Rx d 1 ff"), Ok(Some(500_000_000)));
        let mut relative = Asc::new();
        let mut nanos = |line: &str| read(&mut relative, line).map(|frame| frame.map(|frame| frame.0));
        assert_eq!(nanos("base hex timestamps relative"), Ok(None));
        assert_eq!(nanos("-0.5 Trigger block"), Ok(None));
        assert_eq!(nanos("0.25 1 120 Rx d 1 ff"), Ok(Some(-250_000_000)));
    }

    #[test]
    fn a_bad_line_says_what_is_wrong() {
        for (line, why) in [
            ("time_s,displacement_m", "is not a line of an ASC file"),
            ("base oct timestamps absolute", "neither hex nor dec"),
            ("9999999999999.0 1 120 Rx d 0", "is not a time"),
            ("0.1 1 Engine Rx d 0", "`Engine` is not an identifier"),
            ("0.1 1 120 Rx q 0", "is not a frame"),
            ("0.1 1 120 Rx d 2 00", "1 of 2 data bytes"),
            ("0.1 1 120 Rx d 1 0x", "`0x` is not a row of bytes"),
            ("0.1 CANFD 1 Rx 120 1 0 f 65 00", "is not a frame"),
        ] {
            let message = read(&mut Asc::new(), line).expect_err(line);
            assert!(message.contains(why), "{line}: {message}");
        }
    }
}
