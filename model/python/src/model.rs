//! Models: files, predictions, and one step at a time.

use crate::error::{exception, of_model};
use crate::run::Run;
use crate::table::{floats, ints};
use crate::work;
use mr_damper_model::model_file::ModelFile;
use mr_damper_model::pipeline::{Event, Models, Pipeline, Settings};
use mr_damper_model::sample::{Drive, DriveKind, Reading, Sample, Stamp};
use mr_damper_model::tracking::{
    ChangeTest, EffectTracker, EffectValue, Observed, Quantity, TrackingSettings,
};
use mr_damper_model::units::{Celsius, Metre, MetrePerSecond, Newton};
use mr_damper_node::NodeError;
use mr_damper_node::commands::fis;
use mr_damper_node::commands::predict::{PredictedRow, predict};
use mr_damper_node::estimation::models;
use mr_damper_runs::write_text;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// A model file. Models are immutable and may be shared between threads.
#[pyclass(frozen, skip_from_py_object, module = "mr_damper._native")]
#[derive(Debug, Clone)]
pub(crate) struct Model(pub(crate) Arc<ModelFile>);

#[pymethods]
impl Model {
    /// The model called `name`: a preset, or the path of a model file.
    #[staticmethod]
    fn load(py: Python<'_>, name: &str) -> PyResult<Self> {
        let file = py.detach(|| models::load_whole(name)).map_err(|error| exception(py, &error))?;
        Ok(Self(Arc::new(file)))
    }

    /// The model in the text of a model file.
    #[staticmethod]
    fn from_toml(py: Python<'_>, text: &str) -> PyResult<Self> {
        let file = ModelFile::from_toml(text).map_err(|error| of_model(py, error))?;
        Ok(Self(Arc::new(file)))
    }

    /// For pickle.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        Ok((slf.get_type().getattr("from_toml")?, (slf.get().to_toml(slf.py())?,)))
    }

    /// The text of the model file.
    fn to_toml(&self, py: Python<'_>) -> PyResult<String> {
        self.0.to_toml().map_err(|error| of_model(py, error))
    }

    /// The content of the model file as JSON.
    fn to_json(&self, py: Python<'_>) -> PyResult<String> {
        let table: toml::Table = self
            .to_toml(py)?
            .parse()
            .map_err(|error: toml::de::Error| PyValueError::new_err(error.to_string()))?;
        serde_json::to_string(&table).map_err(|error| PyValueError::new_err(error.to_string()))
    }

    /// Writes the model file or, if the name of the file ends in .fis, the FIS file of a model of fuzzy rules.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let write = || -> Result<(), NodeError> {
            let text = match fis::is_fis(&path) {
                true => fis::text_of(&self.0.model, &path.to_string_lossy())?,
                false => self.0.to_toml()?,
            };
            Ok(write_text(&path, &text)?)
        };
        py.detach(write).map_err(|error| exception(py, &error))
    }

    #[getter]
    fn name(&self) -> &'static str {
        self.0.model.force.name()
    }

    #[getter]
    fn drive(&self) -> Option<&'static str> {
        self.0.model.force.drive().map(DriveKind::name)
    }

    #[getter]
    fn rate_hz(&self) -> f64 {
        self.0.model.rate_hz
    }

    /// True if the model predicts one step ahead from measured force.
    #[getter]
    fn feeds_on_force(&self) -> bool {
        self.0.model.feeds_on_force()
    }

    #[getter]
    fn parameter_count(&self) -> usize {
        self.0.model.force.parameter_count()
    }

    /// The forces at each displacement of `run`: a column of bytes (float64, or int64 for `time_ns`) or a list for each name.
    fn predict<'py>(&self, py: Python<'py>, run: &Bound<'py, Run>) -> PyResult<Bound<'py, PyDict>> {
        let run = run.get();
        let rows = work::run(py, None, |context| {
            let rows = predict(&self.0.model, &run.0.run, || context.interrupt.is_raised())?;
            rows.ok_or(NodeError::Interrupted)
        })?;
        let columns = PyDict::new(py);
        columns.set_item("time_ns", ints(py, rows.iter().map(|row| row.stamp.nanos())))?;
        for (index, name) in NUMBERS.into_iter().enumerate() {
            columns.set_item(name, floats(py, rows.iter().map(|row| numbers(row)[index])))?;
        }
        columns
            .set_item("band_calibrated", rows.iter().map(|row| row.band_calibrated).collect::<Vec<_>>())?;
        columns.set_item("mode", rows.iter().map(|row| row.mode.name()).collect::<Vec<_>>())?;
        columns.set_item("validity", rows.iter().map(|row| row.validity.name()).collect::<Vec<_>>())?;
        columns.set_item("reasons", rows.iter().map(reasons).collect::<Vec<_>>())?;
        Ok(columns)
    }

    /// The values that a tracker with windows of `window_s` seconds finds in `runs` of one damper: a column for each field.
    fn effect_values<'py>(
        &self,
        py: Python<'py>,
        runs: Vec<Bound<'py, Run>>,
        window_s: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let mut runs: Vec<_> = runs.iter().map(|run| Arc::clone(&run.get().0)).collect();
        runs.sort_by_key(|run| run.run.displacement_m.stamps.first().copied());
        let tracking = TrackingSettings { window_s, ..TrackingSettings::default() };
        let values = work::run(py, None, |context| {
            let mut tracker = EffectTracker::new(&self.0.model, &Settings::default(), &tracking)?;
            let mut values = Vec::new();
            for sample in runs.iter().flat_map(|run| run.run.samples()) {
                if context.interrupt.is_raised() {
                    return Err(NodeError::Interrupted);
                }
                tracker.step(&sample, &mut |value| values.push(value));
            }
            Ok(values)
        })?;
        let columns = PyDict::new(py);
        let all = |of: fn(&EffectValue) -> f64| floats(py, values.iter().map(of));
        columns.set_item("time_ns", ints(py, values.iter().map(|value| value.stamp.nanos())))?;
        columns.set_item("running", all(|value| value.running))?;
        columns.set_item("value", all(|value| value.value))?;
        columns.set_item("low", all(|value| value.ci95[0]))?;
        columns.set_item("high", all(|value| value.ci95[1]))?;
        columns.set_item("displacement_std_m", all(|value| value.excitation[0].exp()))?;
        columns.set_item("velocity_rms_m_s", all(|value| value.excitation[1].exp()))?;
        columns.set_item("drive_share", all(|value| value.excitation[2]))?;
        let texts = |of: fn(Quantity) -> &'static str| -> Vec<&str> {
            values.iter().map(|value| of(value.quantity)).collect()
        };
        columns.set_item("effect", texts(Quantity::effect_id))?;
        columns.set_item("form", texts(Quantity::form))?;
        columns.set_item("parameter", texts(Quantity::name))?;
        Ok(columns)
    }
}

/// For each value whether it completes the evidence that the value has changed, with at least `values_per_alarm` values, in the mean, before a
/// false alarm.
#[pyfunction]
pub(crate) fn changes(
    values: Vec<f64>,
    halves: Vec<f64>,
    excitations: Vec<[f64; 3]>,
    values_per_alarm: f64,
) -> Vec<bool> {
    let mut test = ChangeTest::new(values_per_alarm);
    let observed = values.into_iter().zip(halves).zip(excitations);
    observed.map(|((value, half), excitation)| test.see(&Observed { value, half, excitation })).collect()
}

/// Names of the columns with numbers.
const NUMBERS: [&str; 7] =
    ["estimate_n", "simulation_n", "one_step_n", "band_low_n", "band_high_n", "measured_n", "residual_n"];

/// The numbers of a row, in the order of [`NUMBERS`].
fn numbers(row: &PredictedRow) -> [f64; 7] {
    let [low_n, high_n] = row.band_n;
    [row.estimate_n, row.simulation_n, row.one_step_n, low_n, high_n, row.measured_n, row.residual_n]
}

fn reasons(row: &PredictedRow) -> String {
    row.reasons.names().collect::<Vec<_>>().join("|")
}

/// The pipeline of a live node, fed one instant at a time.
#[pyclass(frozen, module = "mr_damper._native")]
pub(crate) struct Stepper(Mutex<Pipeline>);

#[pymethods]
impl Stepper {
    #[new]
    fn new(py: Python<'_>, model: &Model) -> PyResult<Self> {
        let pipeline = Pipeline::new(Models::alone(model.0.model), Settings::default());
        Ok(Self(Mutex::new(pipeline.map_err(|error| of_model(py, error))?)))
    }

    /// Takes the readings of one instant. Returns the row of the estimate that they cause, if any: numbers, then mode, validity and
    /// reasons.
    #[pyo3(signature = (time_ns, displacement_m=None, velocity_m_s=None, force_n=None, current_a=None, command_v=None, case_temp_c=None))]
    #[expect(clippy::too_many_arguments, reason = "one for each channel")]
    fn step(
        &self,
        time_ns: i64,
        displacement_m: Option<f64>,
        velocity_m_s: Option<f64>,
        force_n: Option<f64>,
        current_a: Option<f64>,
        command_v: Option<f64>,
        case_temp_c: Option<f64>,
    ) -> PyResult<(Option<StepRow>, Vec<String>)> {
        // In the order of `Channel::ALL`: displacement is last.
        let readings = [
            case_temp_c.map(|t| Reading::CaseTemperature(Celsius(t))),
            current_a.map(|i| Reading::Drive(Drive::new(DriveKind::CoilCurrent, i))),
            command_v.map(|u| Reading::Drive(Drive::new(DriveKind::CommandVoltage, u))),
            velocity_m_s.map(|v| Reading::Velocity(MetrePerSecond(v))),
            force_n.map(|f| Reading::Force(Newton(f))),
            displacement_m.map(|x| Reading::Displacement(Metre(x))),
        ];
        let stamp = Stamp::from_nanos(time_ns);
        let (mut estimate, mut residual, mut refused) = (None, None, Vec::new());
        let mut pipeline = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        for reading in readings.into_iter().flatten() {
            let sample = Sample { stamp, received: stamp, reading };
            pipeline.step(&sample, &mut |event| match event {
                Event::Estimate(of) => estimate = Some(of),
                Event::Residual(of) => residual = Some(of),
                Event::Refusal(of) => {
                    refused.push(format!("{}: {}", of.sample.reading.channel().name(), of.why.text()));
                }
                _ => {}
            });
        }
        let row = estimate.map(|estimate| {
            let of_same = residual.filter(|residual| residual.stamp == estimate.stamp);
            let row = PredictedRow::of(&estimate, of_same.as_ref());
            (numbers(&row), row.band_calibrated, row.mode.name(), row.validity.name(), reasons(&row))
        });
        Ok((row, refused))
    }
}

/// Numbers of a row in the order of [`NUMBERS`], whether its band is calibrated, mode, validity, and reasons.
type StepRow = ([f64; 7], bool, &'static str, &'static str, String);
