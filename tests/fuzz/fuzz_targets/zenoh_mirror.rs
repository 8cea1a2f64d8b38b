//! Samples that `mr-damper serve` and `top` receive from a mirror, one per line: topic (first byte) and JSON. The page gets JSON of
//! bounded size.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_node::watch::{Origin, TOPICS, Wall, json, zenoh::news};

fuzz_target!(|bytes: &[u8]| {
    let mut wall = Wall::of(Origin::Zenoh);
    wall.add("front");
    let mut now_s = 0.0;
    for line in bytes.split(|byte| *byte == b'\n').take(200) {
        let Some((&which, payload)) = line.split_first() else { continue };
        now_s += 0.01;
        if let Ok(heard) = news(TOPICS[usize::from(which) % TOPICS.len()], payload) {
            wall.take("front", heard.expect("one of the topics"), now_s);
        }
        let (_, batch) = wall.batch(now_s);
        serde_json::from_str::<serde_json::Value>(&batch).expect("the page gets valid JSON");
        assert!(batch.len() < 8192 + 4 * line.len(), "a sample of {} bytes makes {batch}", line.len());
    }
    serde_json::from_str::<serde_json::Value>(&json(&wall.start(now_s))).expect("the page gets valid JSON");
});
