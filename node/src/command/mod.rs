//! The commands, one file each: its arguments, and what it does with them.

pub mod convert;
pub mod demo;
pub mod evaluate;
pub mod identify;
pub mod node;
pub mod output;
pub mod presets;
pub mod record;
pub mod replay;
pub mod run_args;
