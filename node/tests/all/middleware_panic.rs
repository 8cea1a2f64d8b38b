//! A panic in a thread of the DDS library, over real UDP: the node names the thread, and exits with code 1.
//!
//! The panic is an addition that overflows, in `NumberSetIter::next` (rustdds 0.15.1, `src/structure/sequence_number.rs`). It occurs
//! only in debug builds: `docs/decisions/0010-what-rustdds-does-not-survive.md`.

use crate::domain::Domain;
use crate::turn::turn;
use crate::wait::until;
use std::io::{BufRead, BufReader, Read};
use std::net::{Ipv4Addr, UdpSocket};
use std::process::{Child, Command, Stdio};

/// Kinds of submessages.
const DATA: u8 = 0x15;
const GAP: u8 = 0x08;
const STRANGER: [u8; 12] = *b"\xBA\xD0stranger!!";

/// A process that is killed at the end of the test, even if the test fails.
struct Node(Child);

impl Drop for Node {
    fn drop(&mut self) {
        // If the test passed, the process has already ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// An RTPS header from the unknown participant, and one submessage.
fn packet(kind: u8, body: &[u8]) -> Vec<u8> {
    let length = u16::try_from(body.len()).expect("a short one").to_le_bytes();
    [b"RTPS\x02\x04\x01\x12".as_slice(), &STRANGER, &[kind, if kind == DATA { 5 } else { 1 }], &length, body]
        .concat()
}

/// A participant's announcement, so that the node knows its discovery writers (RTPS 2.5, 8.5.3).
fn announcement(to_port: u16) -> Vec<u8> {
    let locator =
        [&1_u32.to_le_bytes()[..], &u32::from(to_port).to_le_bytes(), &[0; 12], &[127, 0, 0, 1]].concat();
    // From the participant's built-in writer to the built-in reader, sequence number 1, as a parameter list.
    let mut body = vec![0, 0, 16, 0, 0, 1, 0, 0xC7, 0, 1, 0, 0xC2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 3, 0, 0];
    for (id, value) in [
        (0x15_u16, [2, 4, 0, 0].to_vec()),
        (0x16, [1, 0x12, 0, 0].to_vec()),
        (0x50, [&STRANGER[..], &[0, 0, 1, 0xC1]].concat()),
        (0x58, 0x0C3F_u32.to_le_bytes().to_vec()),
        (0x31, locator.clone()),
        (0x32, locator),
        (0x02, [100, 0, 0, 0, 0, 0, 0, 0].to_vec()),
        (0x01, Vec::new()),
    ] {
        body.extend(id.to_le_bytes());
        body.extend((value.len() as u16).to_le_bytes());
        body.extend(value);
    }
    packet(DATA, &body)
}

/// A gap that ends one number below the largest sequence number, with a number set beyond it.
fn gap_beyond_all_numbers() -> Vec<u8> {
    // From the participant's publications writer to the publications reader.
    let mut body = vec![0, 0, 3, 0xC7, 0, 0, 3, 0xC2];
    body.extend([0, 0, 0, 0, 1, 0, 0, 0]); // from number 1
    body.extend([0xFF, 0xFF, 0xFF, 0x7F, 0xFE, 0xFF, 0xFF, 0xFF]); // to 2^63 - 2
    body.extend([32, 0, 0, 0, 0xFF, 0xFF, 0xFF, 0xFF]); // and all 32 numbers from there on
    packet(GAP, &body)
}

#[test]
#[cfg_attr(
    any(not(debug_assertions), mr_damper_hardened),
    ignore = "needs a default debug build: in others, the overflow does not panic"
)]
fn a_panic_in_the_dds_library_is_reported_and_ends_the_node() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let parameter = format!("domain_id:={}", domain.id());
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    command.args(["node", "--ros-args", "-p", "model:=thesis/fuzzy-tanh/rp3-cs", "-p", &parameter]);
    // The test waits for a line of the log.
    command.env_remove("RUST_LOG");
    let mut node = Node(command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("started"));

    let to = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
    // The participant's index on this machine is unknown, so all ports are tried.
    let ports = (0..10).map(|index| domain.port(10 + 2 * index));
    let send = |packet: &[u8]| {
        ports.clone().for_each(|port| {
            // Most of these ports have no listener.
            let _ = to.send_to(packet, (Ipv4Addr::LOCALHOST, port));
        });
    };
    let mut log = BufReader::new(node.0.stderr.take().expect("piped"));
    let mut said = String::new();
    // A participant that is announced while the node still starts causes no panic.
    while !said.contains("the node is up") {
        assert!(log.read_line(&mut said).expect("text") > 0, "{said}");
    }
    send(&announcement(domain.port(28)));
    // The gap has an effect once the node has discovered the participant.
    let status = until("the end of the node", || {
        send(&gap_beyond_all_numbers());
        node.0.try_wait().expect("a child of ours")
    });
    log.read_to_string(&mut said).expect("text");
    let error = said.lines().find(|line| line.starts_with("error: ")).unwrap_or_else(|| panic!("{said}"));
    println!("{error}\n{status}");
    assert_eq!(status.code(), Some(1), "{said}");
    assert!(error.contains("RustDDS Participant") && error.contains("event loop thread"), "{said}");
    assert!(said.contains("attempt to add with overflow"), "{said}");
}
