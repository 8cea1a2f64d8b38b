//! Helpers that the tests of the real service share. Each test uses a part of them.

mod caller;
mod discovery;
pub(crate) mod lagging;
mod offline;

pub(crate) use caller::{Caller, Ended, answer, config, within};
pub(crate) use discovery::wait_for_discovery;
pub(crate) use offline::offline;
