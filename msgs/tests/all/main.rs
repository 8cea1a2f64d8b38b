//! All integration tests of this crate, in one binary.

mod constants;
mod golden;
mod hostile;
