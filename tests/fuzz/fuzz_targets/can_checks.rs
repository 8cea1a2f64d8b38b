//! Checks of a running node's inputs from a CAN bus (`can.check`), one per line, and after an empty line frames: each a byte of length and
//! data. Errors quote the check. A frame that is refused gives no value, a frame that comes twice is refused if it has an alive counter, and
//! so is a frame with a changed bit if it has a checksum.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::file;
use mr_damper_runs::bus::{CanId, FrameReport, InputCheck, Inputs, Refusal, Signals};
use mr_damper_runs::{Map, Mapping};
use std::sync::LazyLock;

/// Messages with counters and checksums in both byte orders, and inputs that use all of their other bytes.
const DBC: &str = r#"VERSION ""
BO_ 288 A: 8 X
 SG_ P : 16|16@1- (0.01,0.5) [-100|100] "mm" X
 SG_ Page M : 32|8@1+ (1,0) [0|0] "" X
 SG_ T m1 : 40|16@1- (0.1,-40) [0|0] "degC" X
 SG_ Crc : 0|8@1+ (1,0) [0|0] "" X
 SG_ Alive : 8|4@1+ (1,0) [0|0] "" X
 SG_ Wide : 8|8@1+ (1,0) [0|0] "" X
BO_ 2566848513 B: 12 X
 SG_ F : 7|32@0- (1,0) [0|0] "kN" X
 SG_ Crc : 95|8@0+ (1,0) [0|0] "" X
 SG_ Alive : 83|4@0+ (1,0) [0|0] "" X
 SG_ Huge : 39|52@0+ (1,0) [0|0] "" X
SIG_VALTYPE_ 2566848513 F : 1;
"#;
const KNOWN: [&str; 3] = ["displacement", "case_temperature", "measured_force"];

static SIGNALS: LazyLock<Signals> =
    LazyLock::new(|| Signals::read(&[file("checks.dbc", DBC.as_bytes())]).expect("a good file"));

fuzz_target!(|bytes: &[u8]| {
    let end = bytes.windows(2).position(|two| two == b"\n\n");
    let (lines, frames) = end.map_or((bytes, &[][..]), |end| (&bytes[..end], &bytes[end + 2..]));
    let Ok(lines) = std::str::from_utf8(lines) else { return };
    let sources = ["displacement=A.P", "case_temperature=A.T", "measured_force=B.F"];
    let map = sources.map(|text| text.parse::<Mapping>().expect("a mapping"));
    let map = Map::new(map.to_vec()).expect("distinct");
    let mut inputs = SIGNALS.inputs(&map, &KNOWN).expect("they fit");
    let used: Vec<&str> = lines.lines().take(4).filter(|text| is_used(&mut inputs, text)).collect();
    let mut rest = frames;
    while let Some((length, after)) = rest.split_first() {
        let (data, after) = after.split_at(after.len().min(usize::from(length % 80)));
        rest = after;
        for (id, name) in [(CanId::new(288, false), "A"), (CanId::new(0x18ff_0001, true), "B")] {
            let id = id.expect("in range");
            let options = used.iter().find(|text| text.split(',').next().is_some_and(|it| it.trim() == name));
            check(&mut inputs, id, options.copied().unwrap_or_default(), data);
        }
    }
});

/// True if the check fits, and is used.
fn is_used(inputs: &mut Inputs, text: &str) -> bool {
    let done = text.parse::<InputCheck>().and_then(|check| inputs.check(&check));
    if let Err(error) = &done {
        assert!(error.to_string().contains(text), "the error does not quote {text:?}: {error}");
    }
    done.is_ok()
}

fn take(inputs: &mut Inputs, id: CanId, data: &[u8]) -> Result<FrameReport, Refusal> {
    let mut values = 0;
    let report = inputs.take(id, data, |_| values += 1);
    assert_eq!(report.map_or(0, |report| report.values), values, "{data:02x?}");
    report
}

fn check(inputs: &mut Inputs, id: CanId, options: &str, data: &[u8]) {
    let has = |name: &str| {
        options.split(',').any(|part| part.split_once('=').is_some_and(|(it, _)| it.trim() == name))
    };
    if take(inputs, id, data).is_err() {
        return;
    }
    let (has_checksum, has_counter) = (has("checksum"), has("counter"));
    // Bytes beyond the message's own are not covered.
    let bytes = data.len().min(if id.extended { 12 } else { 8 });
    for bit in 0..if has_checksum { 8 * bytes } else { 0 } {
        let mut changed = data.to_vec();
        changed[bit / 8] ^= 1 << (bit % 8);
        assert_eq!(take(inputs, id, &changed), Err(Refusal::Checksum), "bit {bit} of {data:02x?}");
    }
    let again = take(inputs, id, data);
    assert_eq!(again == Err(Refusal::Counter), has_counter, "{options}, {data:02x?}: {again:?}");
}
