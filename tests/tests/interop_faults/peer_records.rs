//! The records of `fault_peer`, and the checks that must hold under any fault.

use crate::interop_support::Lab;
use crate::interop_support::gate::fault_peer_binary;
use crate::interop_support::json::{count, found, text};
use crate::interop_support::process::Program;
use mr_damper_model::pipeline::{Reasons, Settings, Validity};
use serde_json::Value;
use std::collections::HashSet;
use std::path::PathBuf;
use std::time::Duration;

/// Longest time from start to its first output: discovery on a loaded machine.
const READY: Duration = Duration::from_secs(30);

/// A running `fault_peer`.
pub(super) struct FaultPeer {
    program: Program,
    out: PathBuf,
}

impl FaultPeer {
    /// Starts a peer and waits until it has discovered the node.
    pub(super) fn start(lab: &Lab, name: &str, args: &[&str]) -> Self {
        let out = lab.folder().join(format!("{name}.json"));
        let mut all = vec!["--out", out.to_str().expect("UTF-8 path")];
        all.extend(args);
        let mut program = lab.start_commanded(name, &fault_peer_binary(), &all);
        assert_eq!(text(&program.json_line(READY), "/event"), "ready");
        Self { program, out }
    }

    /// Sends it a command.
    pub(super) fn command(&mut self, command: &str) {
        self.program.command(command);
    }

    /// Begins a phase and waits for `seconds`.
    pub(super) fn phase(&mut self, name: &str, seconds: f64) {
        self.command(&format!("phase {name}"));
        std::thread::sleep(Duration::from_secs_f64(seconds));
    }

    /// Stops sending, waits until everything has arrived and is reported in /diagnostics, and reads the records.
    pub(super) fn finish(mut self) -> PeerRecords {
        self.phase("end", 0.3);
        self.command("quiet");
        // Diagnostics come once a second: the second message from here on counts all samples.
        std::thread::sleep(Duration::from_millis(2200));
        self.read_records()
    }

    /// Ends the peer, and reads its records.
    pub(super) fn read_records(self) -> PeerRecords {
        let Self { program, out } = self;
        program.close();
        PeerRecords::read(&out)
    }
}

/// A sample of all three inputs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sent {
    pub(super) stamp_ns: i64,
    pub(super) values: [f64; 3],
    pub(super) phase: usize,
}

/// An estimate.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReceivedEstimate {
    pub(super) stamp_ns: i64,
    pub(super) at_ns: i64,
    pub(super) force_n: f64,
    pub(super) mode: u8,
    pub(super) validity: u8,
    pub(super) reasons: Reasons,
    pub(super) age_s: Option<f64>,
    pub(super) phase: usize,
}

impl ReceivedEstimate {
    /// True for an estimate computed from a displacement; false for one that bridges silence.
    pub(super) fn is_live(&self) -> bool {
        !self.reasons.has(Reasons::DISPLACEMENT_LOST)
    }

    pub(super) fn is_valid(&self) -> bool {
        self.validity == Validity::Valid as u8
    }
}

/// All records of the peer.
pub(super) struct PeerRecords {
    phases: Vec<(String, i64)>,
    pub(super) sent: Vec<Sent>,
    pub(super) estimates: Vec<ReceivedEstimate>,
    pub(super) diagnostics: Vec<Value>,
}

impl PeerRecords {
    fn read(path: &PathBuf) -> Self {
        let file = std::fs::read_to_string(path).expect("fault_peer wrote it");
        let all: Value = serde_json::from_str(&file).expect("JSON");
        let rows = |name: &str| found(&all, &format!("/{name}")).as_array().expect("a list").clone();
        let whole = |row: &Value, k: usize| row[k].as_i64().expect("a whole number");
        let float = |row: &Value, k: usize| f64::from_bits(row[k].as_u64().expect("bits"));
        let small = |row: &Value, k: usize| usize::try_from(whole(row, k)).expect("a small number");
        let phases = rows("phases");
        let sent = rows("sent");
        let estimates = rows("estimates");
        Self {
            phases: phases.iter().map(|p| (p[0].as_str().expect("a name").to_owned(), whole(p, 1))).collect(),
            sent: sent
                .iter()
                .map(|row| Sent {
                    stamp_ns: whole(row, 0),
                    values: [float(row, 2), float(row, 3), float(row, 4)],
                    phase: small(row, 5),
                })
                .collect(),
            estimates: estimates
                .iter()
                .map(|row| ReceivedEstimate {
                    stamp_ns: whole(row, 0),
                    at_ns: whole(row, 1),
                    force_n: float(row, 2),
                    mode: small(row, 3) as u8,
                    validity: small(row, 4) as u8,
                    reasons: Reasons(small(row, 5) as u32),
                    age_s: row[6].as_f64(),
                    phase: small(row, 7),
                })
                .collect(),
            diagnostics: rows("diagnostics"),
        }
    }

    /// The number of a phase, and the time when it began.
    pub(super) fn phase(&self, name: &str) -> (usize, i64) {
        let number = self.phases.iter().position(|(known, _)| known == name);
        let number = number.unwrap_or_else(|| panic!("no phase {name} in {:?}", self.phases));
        (number, self.phases[number].1)
    }

    /// The share of displacements sent in a phase that have an estimate.
    pub(super) fn answered(&self, name: &str) -> f64 {
        let (phase, _) = self.phase(name);
        let answered: HashSet<i64> =
            self.estimates.iter().filter(|h| h.is_live()).map(|h| h.stamp_ns).collect();
        let of_phase: Vec<_> = self.sent.iter().filter(|sent| sent.phase == phase).collect();
        let hits = of_phase.iter().filter(|sent| answered.contains(&sent.stamp_ns)).count();
        hits as f64 / of_phase.len().max(1) as f64
    }

    /// Time from the beginning of a phase to its first VALID estimate of a displacement sent in that phase, s.
    pub(super) fn valid_after_s(&self, name: &str) -> f64 {
        let (phase, began_ns) = self.phase(name);
        let sent_ns: HashSet<i64> =
            self.sent.iter().filter(|s| s.phase == phase).map(|s| s.stamp_ns).collect();
        let first =
            self.estimates.iter().find(|h| h.is_valid() && h.is_live() && sent_ns.contains(&h.stamp_ns));
        let first = first.unwrap_or_else(|| panic!("no VALID estimate in {name}: {}", self.summary()));
        (first.at_ns - began_ns) as f64 * 1e-9
    }

    /// A count in the last status of the node.
    pub(super) fn status(&self, key: &str) -> u64 {
        let status = self.diagnostics.last().expect("diagnostics come once a second");
        text(&status[3], &format!("/{key}")).parse().expect("a count")
    }

    /// Checks what must hold under any fault. Each estimate belongs to a displacement that was sent, one per displacement, in the
    /// order of stamps. It has a finite force or is INVALID. A VALID estimate uses recent inputs that were sent. The node's
    /// counters of messages add up.
    pub(super) fn is_sound(&self) {
        let timeout_s = Settings::default().input_timeout_s;
        let sent: HashSet<i64> = self.sent.iter().map(|sent| sent.stamp_ns).collect();
        let mut last_ns = i64::MIN;
        for estimate in &self.estimates {
            assert!(
                sent.contains(&estimate.stamp_ns),
                "an estimate of a displacement that was not sent: {estimate:?}"
            );
            if estimate.is_live() {
                assert!(
                    estimate.stamp_ns > last_ns,
                    "out of order or repeated: {estimate:?} after {last_ns}"
                );
                last_ns = estimate.stamp_ns;
            }
            let gives = estimate.validity != Validity::Invalid as u8;
            assert_eq!(
                estimate.force_n.is_finite(),
                gives,
                "a finite force exactly if the estimate is not INVALID: {estimate:?}"
            );
            if !estimate.is_valid() {
                assert!(
                    estimate.reasons != Reasons::NONE,
                    "an estimate that is not VALID has a reason: {estimate:?}"
                );
                continue;
            }
            assert!(estimate.is_live(), "an estimate that bridges silence is not VALID: {estimate:?}");
            let age_s = estimate.age_s.unwrap_or_else(|| panic!("VALID without a drive: {estimate:?}"));
            assert!((0.0..=timeout_s).contains(&age_s), "an old drive: {estimate:?}");
            let drive_ns = estimate.stamp_ns - (age_s * 1e9).round() as i64;
            assert!(sent.contains(&drive_ns), "its drive sample was sent: {estimate:?}");
        }
        let known = ["unreadable", "dropped", "idle", "refused", "used"].map(|key| self.status(key));
        assert_eq!(
            self.status("received"),
            known.iter().sum::<u64>(),
            "unreadable, dropped, idle, refused, used: {known:?}"
        );
    }

    /// A summary for messages.
    pub(super) fn summary(&self) -> String {
        let mut text = format!("{} sent, {} estimates; ", self.sent.len(), self.estimates.len());
        for (number, (name, _)) in self.phases.iter().enumerate() {
            let estimate = self.estimates.iter().filter(|estimate| estimate.phase == number);
            let (all, valid) = estimate.fold((0, 0), |(n, v), h| (n + 1, v + usize::from(h.is_valid())));
            text += &format!("{name} {all} ({valid} VALID); ");
        }
        let mut reasons = std::collections::BTreeMap::<_, u64>::new();
        for name in self.estimates.iter().flat_map(|estimate| estimate.reasons.names()) {
            *reasons.entry(name).or_default() += 1;
        }
        text += &format!("reasons {reasons:?}");
        text
    }
}

/// Counts of the wire in a phase: frames lost, repeated, overtaken.
pub(super) fn done(wire: &Value, name: &str) -> [u64; 3] {
    ["lost", "repeated", "overtaken"].map(|what| count(wire, &format!("/{name}/{what}")))
}
