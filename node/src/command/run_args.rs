//! Arguments on how runs are read, shared by the commands that read some.

use crate::error::NodeError;
use crate::run::{self, LoadOptions, Loaded};
use clap::ValueEnum;
use mr_damper_model::sample::DriveKind;
use std::path::Path;

/// How runs are read.
#[derive(Debug, Clone, Default, clap::Args)]
#[command(next_help_heading = "Reading runs")]
pub struct RunArgs {
    /// Drop bad CSV rows and count them, instead of refusing the file.
    #[arg(long)]
    pub skip_bad_rows: bool,
    /// CSV without header, columns as in the thesis: time, displacement, force, current, ambient and case
    /// temperature, set point, in inches, pounds, amperes and degrees Celsius.
    #[arg(long)]
    pub thesis_txt: bool,
    /// Drive to use when a run holds both.
    #[arg(long, value_enum)]
    pub drive: Option<DriveArg>,
    /// Namespace to read when a bag holds several dampers, e.g. /front_left.
    #[arg(long, value_name = "NS")]
    pub bag_namespace: Option<String>,
    /// Joint to take from JointState topics of a bag.
    #[arg(long, value_name = "NAME")]
    pub bag_joint: Option<String>,
}

/// A kind of drive, as its CSV column is called.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
pub enum DriveArg {
    /// Coil current.
    CurrentA,
    /// Command voltage.
    CommandV,
}

impl RunArgs {
    /// The options that these arguments stand for.
    #[must_use]
    pub fn options(&self) -> LoadOptions {
        LoadOptions {
            skip_bad_rows: self.skip_bad_rows,
            thesis_txt: self.thesis_txt,
            drive: self.drive.map(|drive| match drive {
                DriveArg::CurrentA => DriveKind::CoilCurrent,
                DriveArg::CommandV => DriveKind::CommandVoltage,
            }),
            namespace: self.bag_namespace.clone(),
            joint: self.bag_joint.clone(),
        }
    }

    /// Reads the run at `path` and logs what is to be said of it.
    ///
    /// # Errors
    /// When the run does not load.
    pub fn load(&self, path: &Path) -> Result<Loaded, NodeError> {
        let loaded = run::load(path, &self.options())?;
        for note in &loaded.notes {
            tracing::warn!(run = %path.display(), "{note}");
        }
        Ok(loaded)
    }
}
