//! The compiled part of the Python package `hil`: a thin shell over the library.
//!
//! Data frames are taken apart in Python (`hil/_frames.py`); here columns become recordings, and work is done with
//! the interpreter's lock released, on a thread of its own, so that Ctrl-C is seen.

use std::time::Duration;

use hil::recording::{ColumnValues, Mapping, Recording};
use hil::valve::Valve;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

mod work;

pyo3::create_exception!(hil, HilError, PyValueError, "What hil refuses: the message says what, where, and what is allowed.");
pyo3::create_exception!(hil, RecordingError, HilError, "A recording that cannot be read or used.");
pyo3::create_exception!(hil, ModelError, HilError, "A valve model that cannot be read or simulated.");

/// How often a waiting call looks whether the work has ended, and for Ctrl-C.
const LOOK: Duration = Duration::from_millis(5);

/// Runs `work` on a thread with the lock released; Ctrl-C raises at once, and leaves the thread to end by itself.
pub(crate) fn waited<T: Send + 'static>(python: Python<'_>, work: impl FnOnce() -> T + Send + 'static) -> PyResult<T> {
    let thread = std::thread::spawn(work);
    while !thread.is_finished() {
        python.detach(|| std::thread::sleep(LOOK));
        python.check_signals()?;
    }
    thread.join().map_err(|_| HilError::new_err("this is a bug in hil: the work ended without an answer"))
}

/// One column as Python hands it over.
#[derive(FromPyObject)]
enum Column<'py> {
    Numbers(PyReadonlyArray1<'py, f64>),
    Texts(Vec<String>),
    /// Neither: taken to be known as such, and not looked at.
    Other(#[allow(dead_code)] Option<bool>),
}

/// Columns with their names, read into a recording.
pub(crate) struct Columns<'py>(Vec<(String, Column<'py>)>);

impl<'py> Columns<'py> {
    fn of(columns: Vec<(String, Bound<'py, PyAny>)>) -> PyResult<Self> {
        let all = columns.into_iter().map(|(name, values)| Ok((name, values.extract::<Column<'py>>()?)));
        Ok(Self(all.collect::<PyResult<_>>()?))
    }

    fn recording(&self, source: &str, map: &[String]) -> PyResult<Recording> {
        let map = map.iter().map(|m| Mapping::parse(m)).collect::<Result<Vec<_>, _>>();
        let map = map.map_err(|e| RecordingError::new_err(e.to_string()))?;
        let mut columns = Vec::with_capacity(self.0.len());
        for (name, column) in &self.0 {
            let values = match column {
                Column::Numbers(values) => ColumnValues::Numbers(values.as_slice()?),
                Column::Texts(texts) => ColumnValues::Texts(texts),
                Column::Other(_) => ColumnValues::Other,
            };
            columns.push((name.as_str(), values));
        }
        Recording::from_columns(source, &columns, &map).map_err(|e| RecordingError::new_err(e.to_string()))
    }
}

/// A valve model: curves [bar over A], hysteresis, delay and lag [s], noise [bar], effects.
#[pyclass(frozen, module = "hil")]
pub(crate) struct Model {
    pub(crate) valve: Valve,
}

#[pymethods]
impl Model {
    /// Reads a valve file: its path, or the bare name of one that ships with the program.
    #[staticmethod]
    fn load(path: std::path::PathBuf) -> PyResult<Self> {
        let wrong = |e: hil::valve::ValveError| ModelError::new_err(e.to_string());
        let path = Valve::find(&path.to_string_lossy()).map_err(wrong)?;
        Ok(Self { valve: Valve::load(&path).map_err(wrong)? })
    }

    /// Reads the text of a valve file.
    #[staticmethod]
    fn from_toml(text: &str) -> PyResult<Self> {
        Ok(Self { valve: Valve::from_toml(text, "text").map_err(|e| ModelError::new_err(e.to_string()))? })
    }

    /// The text of the valve file.
    fn to_toml(&self) -> String {
        self.valve.to_toml()
    }

    /// Name of the valve.
    #[getter]
    fn name(&self) -> &str {
        &self.valve.name
    }

    /// Dead time [s].
    #[getter]
    fn delay_s(&self) -> f64 {
        self.valve.delay_s
    }

    /// Time constant of the lag [s].
    #[getter]
    fn lag_s(&self) -> f64 {
        self.valve.lag_s
    }

    /// Standard deviation of the sensor noise [bar].
    #[getter]
    fn noise_bar(&self) -> f64 {
        self.valve.noise_bar
    }

    /// Ids of the effects beyond the base model.
    #[getter]
    fn effects(&self) -> Vec<String> {
        self.valve.effects.iter().map(|e| e.id.clone()).collect()
    }

    /// Smallest and largest current that the valve may see [A].
    #[getter]
    fn current_limits_a(&self) -> (f64, f64) {
        self.valve.current_limits_a
    }

    fn __repr__(&self) -> String {
        let effects = self.effects();
        let and = if effects.is_empty() { String::new() } else { format!(" + {}", effects.join(" + ")) };
        format!("<hil.Model {}{and}, delay {:.1} ms>", self.valve.name, 1e3 * self.valve.delay_s)
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.valve == other.valve
    }
}

/// Simulated pressure [bar] of a current [A] every `dt_s` seconds.
#[pyfunction]
fn simulate_even<'py>(
    python: Python<'py>,
    model: &Model,
    input: &str,
    dt_s: f64,
    current_a: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let input = work::input(input).map_err(ModelError::new_err)?;
    let current = current_a.as_slice()?;
    let pressure = python.detach(|| work::simulate_even(&model.valve, input, dt_s, current)).map_err(ModelError::new_err)?;
    Ok(PyArray1::from_vec(python, pressure))
}

/// Simulated pressure [bar] of a current [A] at increasing times [s].
#[pyfunction]
fn simulate_at<'py>(
    python: Python<'py>,
    model: &Model,
    input: &str,
    time_s: PyReadonlyArray1<'py, f64>,
    current_a: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let input = work::input(input).map_err(ModelError::new_err)?;
    let (time, current) = (time_s.as_slice()?, current_a.as_slice()?);
    let pressure =
        python.detach(|| hil::physics::simulate(&model.valve, input, time, current)).map_err(|e| ModelError::new_err(e.to_string()))?;
    Ok(PyArray1::from_vec(python, pressure))
}

/// The model identified from columns: the model, and the answer as JSON, as text, as a page.
#[pyfunction]
fn identify_columns(
    python: Python<'_>,
    columns: Vec<(String, Bound<'_, PyAny>)>,
    source: String,
    map: Vec<String>,
    hysteresis: Option<&str>,
    order: Option<usize>,
    name: Option<String>,
) -> PyResult<(Model, String, String, String)> {
    let recording = Columns::of(columns)?.recording(&source, &map)?;
    let options = work::options(hysteresis, order, name).map_err(HilError::new_err)?;
    let found = waited(python, move || work::identify(&recording, &options))?.map_err(RecordingError::new_err)?;
    Ok((Model { valve: found.valve }, found.json, found.text, found.page))
}

/// The diagnosis of columns: the augmented model, and the answer as JSON, as text, as a page.
#[pyfunction]
fn diagnose_columns(
    python: Python<'_>,
    columns: Vec<(String, Bound<'_, PyAny>)>,
    source: String,
    map: Vec<String>,
    model: &Model,
) -> PyResult<(Model, String, String, String)> {
    let recording = Columns::of(columns)?.recording(&source, &map)?;
    let valve = model.valve.clone();
    let found = waited(python, move || work::diagnose(&recording, &valve))?.map_err(RecordingError::new_err)?;
    Ok((Model { valve: found.valve }, found.json, found.text, found.page))
}

/// The compiled module.
#[pymodule]
fn _hil(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let python = module.py();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("HilError", python.get_type::<HilError>())?;
    module.add("RecordingError", python.get_type::<RecordingError>())?;
    module.add("ModelError", python.get_type::<ModelError>())?;
    module.add_class::<Model>()?;
    module.add_function(wrap_pyfunction!(simulate_even, module)?)?;
    module.add_function(wrap_pyfunction!(simulate_at, module)?)?;
    module.add_function(wrap_pyfunction!(identify_columns, module)?)?;
    module.add_function(wrap_pyfunction!(diagnose_columns, module)?)
}
