//! The parameters of an exported model: fields of one flat structure, which calibration may change.

use std::fmt::Write as _;

/// Shape of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// One number.
    Scalar,
    /// An array of that length.
    Array(usize),
    /// Rows, and numbers in a row.
    Rows(usize, usize),
}

impl Shape {
    /// Number of values.
    #[must_use]
    pub const fn len(self) -> usize {
        match self {
            Self::Scalar => 1,
            Self::Array(n) => n,
            Self::Rows(rows, n) => rows * n,
        }
    }

    /// False: there is at least one value.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }
}

/// A field of the parameters' structure.
///
/// ```
/// use mr_damper_export::{CExport, Shape};
/// use mr_damper_model::preset;
///
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// let source = CExport::new("damper", &model).source().expect("it is exported");
/// let sigma = source.parameters.iter().find(|parameter| parameter.name == "membership_sigma_a").expect("a field");
/// assert!(sigma.unit == "A" && matches!(sigma.shape, Shape::Array(sets) if sets == sigma.values.len()));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct CParameter {
    /// Name of the field; ends in its unit.
    pub name: String,
    /// Its unit, empty without one.
    pub unit: String,
    /// What it is, in one line.
    pub about: String,
    /// Its shape.
    pub shape: Shape,
    /// Its values, row by row.
    pub values: Vec<f64>,
    /// Values that make sense, where they are known.
    pub range: Option<[f64; 2]>,
}

impl CParameter {
    pub(crate) fn scalar(name: impl Into<String>, unit: &str, about: impl Into<String>, value: f64) -> Self {
        let (name, unit, about) = (name.into(), unit.to_owned(), about.into());
        Self { name, unit, about, shape: Shape::Scalar, values: vec![value], range: None }
    }

    pub(crate) fn array(
        name: impl Into<String>,
        unit: &str,
        about: impl Into<String>,
        values: &[f64],
    ) -> Self {
        let (name, unit, about) = (name.into(), unit.to_owned(), about.into());
        Self { name, unit, about, shape: Shape::Array(values.len()), values: values.to_vec(), range: None }
    }

    pub(crate) fn rows(
        name: impl Into<String>,
        unit: &str,
        about: impl Into<String>,
        rows: usize,
        values: Vec<f64>,
    ) -> Self {
        let (name, unit, about) = (name.into(), unit.to_owned(), about.into());
        let shape = Shape::Rows(rows, values.len() / rows.max(1));
        Self { name, unit, about, shape, values, range: None }
    }

    pub(crate) fn within(self, range: [f64; 2]) -> Self {
        Self { range: Some(range), ..self }
    }

    /// Its line in the structure.
    pub(crate) fn declaration(&self) -> String {
        let size = match self.shape {
            Shape::Scalar => String::new(),
            Shape::Array(n) => format!("[{n}]"),
            Shape::Rows(rows, n) => format!("[{rows}][{n}]"),
        };
        let unit = if self.unit.is_empty() { String::new() } else { format!(", {}", self.unit) };
        format!("    double {}{size}; /* {}{unit} */\n", self.name, self.about)
    }

    /// Its line in the default values.
    pub(crate) fn initialiser(&self) -> String {
        let list = |values: &[f64]| {
            let mut text = "{ ".to_owned();
            for (k, value) in values.iter().enumerate() {
                let comma = if k == 0 { "" } else { ", " };
                let _ = write!(text, "{comma}{}", number(*value));
            }
            text + " }"
        };
        let values = match self.shape {
            Shape::Scalar => number(self.values[0]),
            Shape::Array(_) => list(&self.values),
            Shape::Rows(_, n) => {
                let rows: Vec<String> = self.values.chunks(n).map(list).collect();
                format!("{{\n        {}\n    }}", rows.join(",\n        "))
            }
        };
        format!("    /* {} */ {values}", self.name)
    }
}

/// A number as C reads it back to the same bits. It is finite.
pub(crate) fn number(value: f64) -> String {
    format!("{value:?}")
}
