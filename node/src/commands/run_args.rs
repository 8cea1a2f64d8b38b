//! Arguments for reading runs, shared by the commands that read runs.

use crate::settings::error::NodeError;
use clap::ValueEnum;
use mr_damper_model::sample::DriveKind;
use mr_damper_runs::{ColumnMapping, LoadOptions, Loaded, Map, Mapping, Note, Sign};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// How runs are read.
// The brackets are for `--help`, which shows them literally.
#[allow(rustdoc::broken_intra_doc_links)]
#[derive(Debug, Clone, Default, clap::Args)]
#[command(next_help_heading = "Reading runs")]
pub struct RunArgs {
    /// Drop bad CSV rows and count them, instead of refusing the file.
    #[arg(long)]
    pub skip_bad_rows: bool,
    /// Read CSV files without a header, with the columns of the thesis: time, displacement, force, current, ambient
    /// and case temperature, set point, in inches, pounds, amperes and degrees Celsius.
    #[arg(long)]
    pub thesis_txt: bool,
    /// Drive to use if a run has both.
    #[arg(long, value_enum)]
    pub drive: Option<DriveArg>,
    /// Namespace to read if a bag has several dampers, e.g. /front_left.
    #[arg(long, value_name = "NS")]
    pub bag_namespace: Option<String>,
    /// Joint to read from JointState topics that have the node's topic names; for topics with other names use --map.
    #[arg(long, value_name = "NAME")]
    pub bag_joint: Option<String>,
    /// DBC file that describes the frames in logs of a CAN bus (.mf4, .asc, .blf, candump's .log); --map names the signal of each
    /// channel. May be given several times.
    #[arg(long, value_name = "FILE.dbc")]
    pub dbc: Vec<PathBuf>,
    /// Read a channel from a topic, column or signal with another name; may be given several times.
    ///
    /// A source that begins with a slash is a topic of a bag. Any other is a column of a CSV file, a signal in
    /// a log of a CAN bus, or a channel of an MDF4 file:
    ///
    ///   --map displacement=/fl/susp/pos
    ///   --map displacement=/joint_states:fl_damper,sign=-1,offset=0.01
    ///   --map measured_force=/wrench:z
    ///   --map 'displacement=Stroke [mm]' --map measured_force=load,unit=kN --map time=t,unit=ms
    ///   --dbc car.dbc --map displacement=SUSP_FL.Position --map measured_force=SUSP_FL.Load
    ///
    /// The value is sign * (reading - offset), as for the node's inputs. The offset
    /// is in SI units (m, m/s, N, A, V, C), also if the reading has another unit.
    /// After a colon comes a joint of sensor_msgs/JointState, or an axis (x, y, z)
    /// of geometry_msgs/WrenchStamped or TwistStamped. After a signal comes the bus, if
    /// several have its message, as in SUSP_FL.Position:can1. A signal's unit is that of
    /// the DBC file if the map names none.
    ///
    /// Channels: displacement, velocity, measured_force, coil_current,
    /// command_voltage, case_temperature, body_velocity, force_request,
    /// ambient_temperature, setpoint; for CSV files also time.
    #[arg(long, value_name = "CHANNEL=SOURCE[,sign=-1][,offset=X][,unit=U]", verbatim_doc_comment)]
    pub map: Vec<Mapping>,
    /// Names of CSV columns that have other headers: NAME is a name of the run format, whose ending is the unit of the column.
    /// An unknown NAME lists all names. A header with a comma needs --map.
    ///
    /// Example: --column time_s=t,displacement_in=x_in,force_lbf=F_lbf
    #[arg(long, value_name = "NAME=HEADER,...", value_delimiter = ',')]
    pub column: Vec<ColumnMapping>,
    /// Change the sign of a channel, for a sensor that counts in the opposite direction: extension and tension are positive.
    ///
    /// Example: --sign displacement=-1,force=-1
    #[arg(long, value_name = "CHANNEL=-1,...", value_delimiter = ',')]
    pub sign: Vec<Sign>,
    /// TOML file with a table [map] that has one line per channel, e.g. displacement = "/fl/susp/pos,sign=-1"; --map
    /// overrides it.
    #[arg(long, value_name = "FILE.toml")]
    pub map_file: Option<PathBuf>,
    /// Runs that a caller of this library already holds, by name. A path that is one of these names is not read from disk.
    #[arg(skip)]
    pub held: Vec<(PathBuf, Arc<Loaded>)>,
}

/// A kind of drive, named like its CSV column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
pub enum DriveArg {
    /// Coil current.
    CurrentA,
    /// Command voltage.
    CommandV,
}

impl RunArgs {
    /// The first argument that is given.
    #[must_use]
    pub fn given(&self) -> Option<&'static str> {
        let all = [
            ("--skip-bad-rows", self.skip_bad_rows),
            ("--thesis-txt", self.thesis_txt),
            ("--drive", self.drive.is_some()),
            ("--bag-namespace", self.bag_namespace.is_some()),
            ("--bag-joint", self.bag_joint.is_some()),
            ("--dbc", !self.dbc.is_empty()),
            ("--map", !self.map.is_empty()),
            ("--column", !self.column.is_empty()),
            ("--sign", !self.sign.is_empty()),
            ("--map-file", self.map_file.is_some()),
        ];
        all.into_iter().find(|(_, given)| *given).map(|(argument, _)| argument)
    }

    /// The options for loading a run.
    ///
    /// # Errors
    /// When a channel is mapped twice, or the file of the map cannot be used.
    pub fn options(&self) -> Result<LoadOptions, NodeError> {
        let map = self.map()?;
        if let Some(twice) = self.sign.iter().find(|sign| sign.is_given_by(&map)) {
            let channel = twice.channel();
            return Err(NodeError::Usage(format!(
                "--sign and the map both give {channel} a sign: leave one of them out"
            )));
        }
        Ok(LoadOptions {
            skip_bad_rows: self.skip_bad_rows,
            thesis_txt: self.thesis_txt,
            drive: self.drive.map(|drive| match drive {
                DriveArg::CurrentA => DriveKind::CoilCurrent,
                DriveArg::CommandV => DriveKind::CommandVoltage,
            }),
            namespace: self.bag_namespace.clone(),
            joint: self.bag_joint.clone(),
            dbc: self.dbc.clone(),
            map,
            signs: self.sign.clone(),
        })
    }

    /// The sources of the channels. Flags override the file.
    fn map(&self) -> Result<Map, NodeError> {
        let columns = self.column.iter().map(|column| column.0.clone());
        let flags = Map::new(self.map.iter().cloned().chain(columns).collect())
            .map_err(|error| NodeError::Usage(format!("--map and --column: {error}")))?;
        let Some(path) = &self.map_file else { return Ok(flags) };
        let in_file = |message: String| NodeError::File { path: path.clone(), message };
        let text = std::fs::read_to_string(path).map_err(|error| in_file(error.to_string()))?;
        Ok(Map::from_toml(&text).map_err(|error| in_file(error.to_string()))?.overridden_by(flags))
    }

    /// True if the caller holds the run called `path`.
    #[must_use]
    pub fn holds(&self, path: &Path) -> bool {
        self.held.iter().any(|(name, _)| name == path)
    }

    /// Reads the run at `path` and logs its notes as warnings. A run that the caller holds is taken as it is.
    ///
    /// # Errors
    /// When the run does not load.
    pub fn load(&self, path: &Path) -> Result<Loaded, NodeError> {
        if let Some((_, held)) = self.held.iter().find(|(name, _)| name == path) {
            return Ok(Loaded::clone(held));
        }
        let loaded = mr_damper_runs::load(path, &self.options()?)?;
        log_notes(path, &loaded.notes);
        Ok(loaded)
    }
}

/// Logs the notes on the run at `path`: as warnings, but what is expected at the level debug.
pub fn log_notes(path: &Path, notes: &[Note]) {
    for note in notes {
        if note.is_warning() {
            tracing::warn!(run = %path.display(), "{note}");
        } else {
            tracing::debug!(run = %path.display(), "{note}");
        }
    }
}
