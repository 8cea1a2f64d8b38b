//! Data that nodes on rmw_zenoh send besides messages: attachments, and liveliness tokens of publishers.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_node::zenoh::rmw::{Attachment, Publisher};

fuzz_target!(|bytes: &[u8]| {
    match Attachment::from_bytes(bytes) {
        Ok(attachment) => assert_eq!(attachment.to_bytes(), bytes),
        Err(error) => assert!(bytes.len() != 33 || bytes[16] != 16, "{error}"),
    }
    let Ok(token) = std::str::from_utf8(bytes) else { return };
    if let Some(publisher) = Publisher::read(token) {
        assert!(publisher.node.contains('/') && token.contains(publisher.dds_type_name), "{publisher:?}");
    }
});
