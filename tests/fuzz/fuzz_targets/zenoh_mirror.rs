//! Samples that `mr-damper serve` and `top` receive from a mirror, one per line: topic (first byte) and JSON. The page gets JSON of
//! bounded size.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_node::views::watch::zenoh_watcher::decode;
use mr_damper_views::watch::{DamperRegistry, DataOrigin, TOPICS, json};

fuzz_target!(|bytes: &[u8]| {
    let mut registry = DamperRegistry::of(DataOrigin::Zenoh);
    registry.add("front");
    let mut now_s = 0.0;
    for line in bytes.split(|byte| *byte == b'\n').take(200) {
        let Some((&which, payload)) = line.split_first() else { continue };
        now_s += 0.01;
        if let Ok(message) = decode(TOPICS[usize::from(which) % TOPICS.len()], payload) {
            registry.take("front", message.expect("one of the topics"), now_s);
        }
        let (_, batch) = registry.batch(now_s);
        serde_json::from_str::<serde_json::Value>(&batch).expect("the page gets valid JSON");
        assert!(batch.len() < 8192 + 4 * line.len(), "a sample of {} bytes makes {batch}", line.len());
    }
    serde_json::from_str::<serde_json::Value>(&json(&registry.start(now_s)))
        .expect("the page gets valid JSON");
});
