//! All integration tests of this crate, in one binary: each binary would link DDS, Zenoh and SQLite.
//!
//! A test that uses DDS leases its own domain ([`domain`]). A test with time limits, or one that keeps the processor busy, takes a
//! turn ([`turn`]). A test that needs more than a new machine has is ignored, and the reason begins with what it needs; `.ci/run` runs
//! these tests too.

mod domain;
mod turn;
mod wait;

mod live_support;
#[path = "../../runs/tests/all/run_support/mod.rs"]
#[expect(dead_code, reason = "the tests of mr-damper-runs use the rest")]
mod run_support;
mod serve_support;
mod vehicle_support;
mod zenoh_support;

// Commands on files.
mod bad_input;
mod close;
mod command_line;
mod compare;
mod conventions;
mod doctor;
mod fis;
mod identify;
mod inverse;
mod offline;
mod predict;
mod reproduce;
mod security;
mod simulate;
mod viewer_layouts;

// Runs on disk.
mod record_disk;
mod run_map;

// The running node, over DDS.
mod live;
mod live_bad_input;
mod live_can;
mod live_close_loop;
mod live_command;
mod live_conventions;
mod live_effects;
mod live_fleet;
mod live_float;
mod live_load_model;
mod live_manage;
mod live_ports;
mod live_publishers;
mod live_realtime;
mod live_record;
mod live_replay;
mod live_rmw;
mod live_sim_time;
mod live_zenoh_commands;
mod middleware_panic;
mod soak;

// The live page and other viewers.
mod foxglove;
mod serve;
mod serve_workshop;

// The Zenoh mirror.
mod zenoh_access;
mod zenoh_faults;
mod zenoh_interop;
mod zenoh_load;
mod zenoh_mirror;
