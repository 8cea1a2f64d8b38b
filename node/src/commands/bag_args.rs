//! Arguments for writing bags, shared by the commands that write bags.

use crate::settings::error::NodeError;
use clap::ValueEnum;
use mr_damper_runs::{BagOptions, Storage};
use std::path::Path;
use std::time::Duration;

/// How bags are written.
#[derive(Debug, Clone, Default, clap::Args)]
#[command(next_help_heading = "Writing bags")]
pub struct BagArgs {
    /// Storage of the bag: mcap (.mcap, the default of ROS 2 since Iron) or sqlite3 (.db3, the default before Iron).
    #[arg(long, value_enum)]
    pub storage: Option<StorageArg>,
    /// Compression. In mcap each chunk is compressed; the default is zstd. In sqlite3 each complete file is compressed
    /// (.db3.zstd, mode FILE); the default is none.
    #[arg(long, value_enum)]
    pub compression: Option<CompressionArg>,
    /// Start another file at about this size, in bytes before files are compressed (as `ros2 bag record` does).
    #[arg(long, value_name = "BYTES", value_parser = clap::value_parser!(u64).range(1..))]
    pub max_bag_size: Option<u64>,
    /// Start another file after this many seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub max_bag_duration: Option<f64>,
}

/// A storage, named as in ROS 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum StorageArg {
    /// MCAP.
    Mcap,
    /// An SQLite database.
    Sqlite3,
}

/// A compression method.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CompressionArg {
    /// None.
    None,
    /// Zstandard.
    Zstd,
}

fn seconds(text: &str) -> Result<f64, &'static str> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds < 1e9 => Ok(seconds),
        _ => Err("give a positive number of seconds, below 1e9"),
    }
}

impl BagArgs {
    /// The options for writing a bag.
    #[must_use]
    pub fn options(&self) -> BagOptions {
        let storage = match self.storage {
            Some(StorageArg::Sqlite3) => Storage::Sqlite3,
            Some(StorageArg::Mcap) | None => Storage::Mcap,
        };
        let options = BagOptions::default().stored(storage);
        BagOptions {
            compress: self.compression.map_or(options.compress, |it| it == CompressionArg::Zstd),
            max_file_bytes: self.max_bag_size,
            max_file_duration: self.max_bag_duration.map(Duration::from_secs_f64),
            ..options
        }
    }

    /// The first argument that is given.
    #[must_use]
    pub fn given(&self) -> Option<&'static str> {
        let all = [
            ("--storage", self.storage.is_some()),
            ("--compression", self.compression.is_some()),
            ("--max-bag-size", self.max_bag_size.is_some()),
            ("--max-bag-duration", self.max_bag_duration.is_some()),
        ];
        all.into_iter().find(|(_, given)| *given).map(|(argument, _)| argument)
    }

    /// Refuses arguments that would be ignored because the target is a single file.
    ///
    /// # Errors
    /// When an argument does not apply to the target.
    pub fn check(&self, target: &Path) -> Result<(), NodeError> {
        let extension = target.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
        let (own, what) = match extension.as_deref() {
            Some("mcap") => (Some(StorageArg::Mcap), "an MCAP file"),
            Some("db3") => (Some(StorageArg::Sqlite3), "an sqlite3 file"),
            Some("csv") => (None, "a CSV file"),
            _ => return Ok(()),
        };
        let packed = self.compression == Some(CompressionArg::Zstd) && own != Some(StorageArg::Mcap);
        let unfit = [
            ("--storage", self.storage.is_some() && self.storage != own),
            ("--compression", packed || (self.compression.is_some() && own.is_none())),
            ("--max-bag-size", self.max_bag_size.is_some()),
            ("--max-bag-duration", self.max_bag_duration.is_some()),
        ];
        match unfit.into_iter().find(|(_, given)| *given) {
            Some((argument, _)) => Err(NodeError::Usage(format!(
                "{argument} does not apply to {}, which is {what}: name a directory, without extension, for a bag",
                target.display()
            ))),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_that_do_not_apply_to_the_target_are_refused() {
        let args = |storage, compression, max_bag_size| BagArgs {
            storage,
            compression,
            max_bag_size,
            max_bag_duration: None,
        };
        let check =
            |args: &BagArgs, target: &str| args.check(Path::new(target)).map_err(|error| error.to_string());
        let (sqlite, zstd) = (Some(StorageArg::Sqlite3), Some(CompressionArg::Zstd));
        for (args, target, argument) in [
            (args(sqlite, None, None), "x.mcap", "--storage"),
            (args(sqlite, None, None), "x.csv", "--storage"),
            (args(None, zstd, None), "x.db3", "--compression"),
            (args(None, zstd, None), "x.csv", "--compression"),
            (args(None, None, Some(1)), "x.db3", "--max-bag-size"),
        ] {
            let message = check(&args, target).expect_err("refused");
            assert!(message.starts_with(&format!("{argument} does not apply to {target}")), "{message}");
        }
        for (args, target) in [
            (args(sqlite, zstd, Some(1)), "bag"),
            (args(sqlite, None, None), "x.db3"),
            (args(None, zstd, None), "x.mcap"),
        ] {
            assert_eq!(check(&args, target), Ok(()));
        }
        assert!(!args(sqlite, None, None).options().compress, "a database is not compressed by default");
        assert!(args(None, None, None).options().compress);
    }
}
