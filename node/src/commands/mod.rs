//! The command line. Each command has a file: its arguments and its implementation.

pub mod bag_args;
pub mod cli;
pub mod close;
pub mod compare;
pub mod conditioning;
pub mod context;
pub mod convert;
pub mod demo;
pub mod doctor;
pub mod evaluate;
pub mod fis;
pub mod identify;
pub mod inverse;
pub mod logging;
pub mod node;
pub(crate) mod number;
pub mod output;
pub mod presets;
pub(crate) mod progress;
pub mod record;
pub mod replay;
pub mod reproduce;
pub mod run_args;
pub mod serve;
pub mod simulate;
pub mod top;
