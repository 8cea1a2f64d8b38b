//! Prints the samples of signals in a log of a CAN bus, for comparisons with other decoders.
//!
//! usage: `cargo run -p mr-damper-runs --example signals -- FILE.dbc LOG <SIGNALS`
//!
//! SIGNALS has the name of one signal in each line: MESSAGE.SIGNAL. Each sample is a line with the name, the time in nanoseconds and the 16
//! hexadecimal digits of the value's double. A signal that cannot be read gives a line with its name and the error after `!`.

use mr_damper_runs::{LoadOptions, Map, load};
use std::error::Error;
use std::fmt::Write as _;
use std::io::{BufRead, Write};
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(dbc), Some(log)) = (arguments.next(), arguments.next()) else {
        return Err("usage: signals FILE.dbc LOG <SIGNALS".into());
    };
    let mut out = std::io::stdout().lock();
    for name in std::io::stdin().lock().lines() {
        let name = name?;
        // In metres the values are those of the signal.
        let map = Map::new(vec![format!("displacement={name},unit=m").parse()?])?;
        let mut text = String::new();
        match load(&log, &LoadOptions { dbc: vec![dbc.clone()], map, ..LoadOptions::default() }) {
            Ok(loaded) => {
                let trace = loaded.run.displacement_m;
                for (stamp, value) in trace.stamps.iter().zip(&trace.values) {
                    writeln!(text, "{name} {} {:016x}", stamp.nanos(), value.to_bits())?;
                }
            }
            Err(error) => {
                writeln!(text, "{name} ! {}", error.to_string().lines().next().unwrap_or_default())?
            }
        }
        out.write_all(text.as_bytes())?;
    }
    Ok(())
}
