//! Recorded runs.

use crate::arguments::load_options;
use crate::error::{exception, of_run};
use crate::table::{columns_of_arrow, columns_of_bytes, floats, ints, words};
use crate::work;
use mr_damper_model::sample::{DriveKind, Run as Recorded, Stamp, Trace};
use mr_damper_runs::{Column, Loaded, SaveOptions, channels};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::path::PathBuf;
use std::sync::Arc;

/// A recorded run. Runs are immutable and may be shared between threads.
#[pyclass(frozen, skip_from_py_object, module = "mr_damper._native")]
#[derive(Debug, Clone)]
pub(crate) struct Run(pub(crate) Arc<Loaded>);

impl Run {
    pub(crate) fn of(loaded: Loaded) -> Self {
        Self(Arc::new(loaded))
    }

    fn recorded(&self) -> &Recorded {
        &self.0.run
    }
}

#[pymethods]
impl Run {
    /// Reads the run at `path` with `options`, the words of a command line.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf, options: Vec<String>) -> PyResult<Self> {
        work::run(py, None, |_| {
            let options = load_options(&options)?;
            Ok(Self::of(mr_damper_runs::load(&path, &options)?))
        })
    }

    /// The run in `columns`: name, kind (`d`, `q`, `t` or `o`) and values of each; see `table.rs`.
    #[staticmethod]
    fn from_columns(
        py: Python<'_>,
        name: &str,
        columns: Vec<(String, String, Bound<'_, PyAny>)>,
        options: Vec<String>,
    ) -> PyResult<Self> {
        of_columns(py, name, &columns_of_bytes(columns)?, &options)
    }

    /// The run in `table`, an object with the Arrow PyCapsule interface.
    #[staticmethod]
    fn from_arrow(
        py: Python<'_>,
        name: &str,
        table: &Bound<'_, PyAny>,
        options: Vec<String>,
    ) -> PyResult<Self> {
        let columns = columns_of_arrow(name, table)?;
        of_columns(py, name, &columns, &options)
    }

    /// The run with these channels: stamps (nanoseconds, int64) and values (float64) as bytes for each name, as [`Run::traces`] gives
    /// them. `drive` is the name of the channel that is the drive.
    #[staticmethod]
    fn from_traces(
        name: String,
        sha256: [u8; 32],
        drive: Option<String>,
        traces: Vec<(String, Bound<'_, PyBytes>, Bound<'_, PyBytes>)>,
    ) -> PyResult<Self> {
        let mut run = Recorded { name, ..Recorded::default() };
        for (name, stamps, values) in traces {
            let trace = Trace {
                stamps: words(&stamps)?.map(i64::from_ne_bytes).map(Stamp::from_nanos).collect(),
                values: words(&values)?.map(f64::from_ne_bytes).collect(),
            };
            let kinds = [DriveKind::CoilCurrent, DriveKind::CommandVoltage];
            let kind =
                kinds.into_iter().find(|kind| kind.name() == name && drive.as_deref() == Some(kind.name()));
            match (name.as_str(), kind) {
                (_, Some(kind)) => run.drive = Some((kind, trace)),
                ("displacement_m", _) => run.displacement_m = trace,
                ("velocity_m_s", _) => run.velocity_m_s = Some(trace),
                ("force_n", _) => run.force_n = Some(trace),
                ("case_temp_c", _) => run.case_temp_c = Some(trace),
                ("body_velocity_m_s", _) => run.body_velocity_m_s = Some(trace),
                ("force_request_n", _) => run.force_request_n = Some(trace),
                _ => run.other.push((name, trace)),
            }
        }
        Ok(Self::of(Loaded { run, notes: Vec::new(), sha256 }))
    }

    /// For pickle.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let py = slf.py();
        let run = slf.get();
        let traces = slf.get().traces(py)?;
        let mut listed = Vec::with_capacity(traces.len());
        for (name, pair) in traces {
            let (stamps, values): (Bound<'py, PyAny>, Bound<'py, PyAny>) = pair.extract()?;
            listed.push((name, stamps, values));
        }
        let drive = run.drive();
        let arguments = (run.name(), run.0.sha256, drive, listed).into_pyobject(py)?.into_any();
        Ok((slf.get_type().getattr("from_traces")?, arguments))
    }

    /// Writes the run to a CSV file, an .mcap or .db3 file, or a new directory for a rosbag2 bag.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| mr_damper_runs::save(self.recorded(), &path, &SaveOptions::default()))
            .map_err(|error| of_run(py, error))
    }

    #[getter]
    fn name(&self) -> &str {
        &self.recorded().name
    }

    /// Name of the channel that is the drive.
    #[getter]
    fn drive(&self) -> Option<&'static str> {
        self.recorded().drive_kind().map(DriveKind::name)
    }

    #[getter]
    fn duration_s(&self) -> f64 {
        self.recorded().duration().get()
    }

    #[getter]
    fn rate_hz(&self) -> Option<f64> {
        self.recorded().displacement_m.mean_rate_hz()
    }

    #[getter]
    fn channels(&self) -> Vec<String> {
        channels(self.recorded()).into_iter().map(str::to_owned).collect()
    }

    #[getter]
    fn sha256(&self) -> String {
        self.0.sha256_hex()
    }

    #[getter]
    fn notes(&self) -> Vec<String> {
        self.0.notes.iter().map(ToString::to_string).collect()
    }

    /// Stamps (nanoseconds, int64) and values (float64) of each channel, as bytes.
    fn traces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let run = self.recorded();
        let all = PyDict::new(py);
        for name in channels(run) {
            if let Some(trace) = trace(run, name) {
                let stamps = trace.stamps.iter().map(|stamp| stamp.nanos());
                let pair: (Bound<'py, PyBytes>, Bound<'py, PyBytes>) =
                    (ints(py, stamps), floats(py, trace.values.iter().copied()));
                all.set_item(name, pair)?;
            }
        }
        Ok(all)
    }

    /// Number of displacements.
    fn __len__(&self) -> usize {
        self.recorded().displacement_m.len()
    }
}

fn of_columns(py: Python<'_>, name: &str, columns: &[Column], words: &[String]) -> PyResult<Run> {
    let options = load_options(words).map_err(|error| exception(py, &error))?;
    let loaded = py.detach(|| mr_damper_runs::from_columns(name, columns, &options));
    loaded.map(Run::of).map_err(|error| of_run(py, error))
}

/// The channel of `run` with this column name.
fn trace<'a>(run: &'a Recorded, name: &str) -> Option<&'a Trace> {
    match name {
        "displacement_m" => Some(&run.displacement_m),
        "velocity_m_s" => run.velocity_m_s.as_ref(),
        "force_n" => run.force_n.as_ref(),
        "case_temp_c" => run.case_temp_c.as_ref(),
        "body_velocity_m_s" => run.body_velocity_m_s.as_ref(),
        "force_request_n" => run.force_request_n.as_ref(),
        _ => match &run.drive {
            Some((kind, trace)) if kind.name() == name => Some(trace),
            _ => run.other.iter().find(|(other, _)| other == name).map(|(_, trace)| trace),
        },
    }
}
