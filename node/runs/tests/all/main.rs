//! All integration tests of this crate, in one binary: each binary would link SQLite and MCAP.
//!
//! A test with time limits, or one that keeps the processor busy, takes a turn ([`turn`]).

#[path = "../../../tests/all/turn.rs"]
mod turn;

mod run_support;

mod bag;
mod bus;
mod bus_j1939;
mod bus_live;
mod convert;
mod csv;
mod damage;
mod frame;
mod kill;
mod map;
mod split;
mod sqlite;
