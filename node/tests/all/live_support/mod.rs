//! Helpers that the tests of the real service share. Each test uses a part of them.

mod caller;
pub(crate) mod lagging;
mod offline;

pub(crate) use caller::{Caller, Ended, answer, config, within};
pub(crate) use offline::offline;
