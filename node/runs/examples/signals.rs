//! Prints the samples of signals in a log of a CAN bus, for comparisons with other decoders.
//!
//! usage: `cargo run -p mr-damper-runs --example signals -- FILE.dbc LOG <SIGNALS`
//!
//! SIGNALS has the name of one signal in each line: MESSAGE.SIGNAL. Each sample is a line with the name, the time in nanoseconds and the 16
//! hexadecimal digits of the value's double, separated by tabs. A signal that cannot be read gives a line with its name, `!` and the error.

use mr_damper_model::sample::{Run, Trace};
use mr_damper_runs::{LoadOptions, Map, RunError, load};
use std::error::Error;
use std::fmt::Write as _;
use std::io::{BufRead, Write};
use std::path::{Path, PathBuf};

/// The channels of a run with their SI units, so that no value is converted.
const CHANNELS: [&str; 8] = [
    "displacement={},unit=m",
    "velocity={},unit=m/s",
    "measured_force={},unit=N",
    "coil_current={},unit=A",
    "case_temperature={},unit=C",
    "body_velocity={},unit=m/s",
    "force_request={},unit=N",
    "setpoint={},unit=m",
];

/// The traces of the channels, in order.
fn traces(run: Run) -> [Option<Trace>; 8] {
    let setpoint = run.other.into_iter().find(|(name, _)| name == "setpoint_m").map(|(_, trace)| trace);
    let drive = run.drive.map(|(_, trace)| trace);
    let displacement = Some(run.displacement_m);
    [
        displacement,
        run.velocity_m_s,
        run.force_n,
        drive,
        run.case_temp_c,
        run.body_velocity_m_s,
        run.force_request_n,
        setpoint,
    ]
}

/// The samples of up to as many signals as there are channels.
fn read(dbc: &Path, log: &Path, names: &[String]) -> Result<String, Box<dyn Error>> {
    let mappings = names.iter().zip(CHANNELS).map(|(name, channel)| channel.replace("{}", name).parse());
    let map = Map::new(mappings.collect::<Result<_, _>>()?)?;
    let options = LoadOptions { dbc: vec![dbc.to_owned()], map, ..LoadOptions::default() };
    let run = load(log, &options).map_err(Box::<RunError>::new)?.run;
    let mut text = String::new();
    for (name, trace) in names.iter().zip(traces(run)) {
        let trace = trace.unwrap_or_default();
        for (stamp, value) in trace.stamps.iter().zip(&trace.values) {
            writeln!(text, "{name}\t{}\t{:016x}", stamp.nanos(), value.to_bits())?;
        }
    }
    Ok(text)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(dbc), Some(log)) = (arguments.next(), arguments.next()) else {
        return Err("usage: signals FILE.dbc LOG <SIGNALS".into());
    };
    let mut out = std::io::stdout().lock();
    let names = std::io::stdin().lock().lines().collect::<Result<Vec<_>, _>>()?;
    for several in names.chunks(CHANNELS.len()) {
        if let Ok(text) = read(&dbc, &log, several) {
            out.write_all(text.as_bytes())?;
            continue;
        }
        // One of them cannot be read.
        for name in several.chunks(1) {
            let text = read(&dbc, &log, name).unwrap_or_else(|error| {
                format!("{}\t!\t{}\n", name[0], error.to_string().lines().next().unwrap_or_default())
            });
            out.write_all(text.as_bytes())?;
        }
    }
    Ok(())
}
