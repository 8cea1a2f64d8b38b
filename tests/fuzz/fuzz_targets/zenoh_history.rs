//! `_time` of a query for a damper's history: it is a range of times, or gives an error that quotes it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_node::streams::sink::zenoh::TimeRange;

/// The node's time, ns since 1970.
const NOW: i64 = 1_800_000_000_000_000_000;

fuzz_target!(|text: &str| {
    let range = match TimeRange::parse(text, NOW) {
        Ok(range) => range,
        Err(why) => return assert!(why.to_string().contains(text), "{why}"),
    };
    for at_ns in [i64::MIN, 0, NOW, i64::MAX, range.from_ns, range.to_ns] {
        assert_eq!(range.contains(at_ns), range.from_ns <= at_ns && at_ns <= range.to_ns, "{range:?}");
    }
    // A missing bound is the extreme value, and an open bound excludes only the bound itself.
    let inner = &text[1..text.len() - 1];
    assert!(!inner.starts_with("..") || range.from_ns == i64::MIN, "{range:?}");
    assert!(!inner.ends_with("..") || range.to_ns == i64::MAX, "{range:?}");
    let closed = TimeRange::parse(&format!("[{inner}]"), NOW).expect("read before");
    assert!(
        closed.from_ns <= range.from_ns && range.from_ns <= closed.from_ns.saturating_add(1),
        "{range:?}"
    );
    assert!(range.to_ns <= closed.to_ns && closed.to_ns.saturating_sub(1) <= range.to_ns, "{range:?}");
});
