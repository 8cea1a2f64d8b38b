//! A model as Functional Mock-up Unit (FMU) for co-simulation, for FMI 3.0 and FMI 2.0.
//!
//! ```text
//! Model ── CSource ── NAME.h, NAME.c ──────────┐
//!             └────── modelDescription.xml ────┼─→ NAME.fmu (zip)
//! fmu.c, fmi3.c or fmi2.c ── NAME_fmu.c, ... ──┤
//! shared object, compiled from these ──────────┘
//! ```
//!
//! | variable | causality | what |
//! |---|---|---|
//! | `displacement_m`, `current_a` or `command_voltage_v`, `velocity_m_s`, `case_temp_c` | input | those that the model needs |
//! | `force_request_n` | input | with an inverse controller: the demanded force |
//! | `force_n`, `reading_n`, `conditioned.*` | output | the estimate |
//! | `flags`, `valid`, `accepted` | output | its reasons, whether there is a force, whether the displacement was accepted |
//! | `command.*` | output | with an inverse controller: the commanded current, and what the model expects of it |
//! | `parameters.*` | tunable parameter | each field of the parameters' structure |
//!
//! A communication step is one sample. The inputs are the readings at its communication point, whose time is rounded to 1 ns. The outputs
//! after the step are the estimate for these readings. The step size may vary, and time must increase.
//!
//! At a step whose displacement is lost or refused, `command.current_a` is the current that goes to the safe one in silence.
//! `command.limited_by` is an integer: an enumeration would need a class in Simulink before its port can be connected, and other importers
//! have no enumerations.
//!
//! Source: Modelica Association, Functional Mock-up Interface, versions 3.0.2 and 2.0.5. The few types and prototypes that the C code needs
//! are written in it, so that the FMU needs no header of the standard.

mod description;
mod unit;

use crate::error::ExportError;
use crate::features::Features;
use crate::fragment::resolve;
use crate::parameter::{Shape, number};
use crate::precision::Precision;
use crate::source::CSource;
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::io::{Cursor, Write as _};

/// Version of the standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum FmiVersion {
    /// FMI 3.0.
    #[default]
    V3,
    /// FMI 2.0.
    V2,
}

impl FmiVersion {
    /// All versions.
    pub const ALL: [Self; 2] = [Self::V3, Self::V2];

    /// The version as the standard writes it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::V3 => "3.0",
            Self::V2 => "2.0",
        }
    }

    /// The version called `name`.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|version| version.name() == name)
    }

    /// Folder of the shared object for this machine in the archive, and the object's extension; `None` on a machine that the
    /// standard does not name.
    #[must_use]
    pub fn platform(self) -> Option<(&'static str, &'static str)> {
        match (self, std::env::consts::ARCH, std::env::consts::OS) {
            (Self::V3, "x86_64", "linux") => Some(("binaries/x86_64-linux", "so")),
            (Self::V2, "x86_64", "linux") => Some(("binaries/linux64", "so")),
            (Self::V3, "aarch64", "linux") => Some(("binaries/aarch64-linux", "so")),
            // FMI 2.0 names no folder for other processors.
            _ => None,
        }
    }
}

/// An FMU.
///
/// ```
/// use mr_damper_export::CExport;
/// use mr_damper_export::fmu::{FmiVersion, Fmu};
/// use mr_damper_model::preset;
///
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// let source = CExport::new("damper", &model).source().expect("it is exported");
/// let fmu = Fmu::new(&source, FmiVersion::V3);
/// // Without a shared object it has sources only.
/// let archive = fmu.archive(None).expect("its units are known");
/// assert_eq!(archive[..4], *b"PK\x03\x04");
/// let files = fmu.files().expect("its units are known");
/// assert!(files.iter().any(|(path, text)| path == "modelDescription.xml" && text.contains("fmiVersion=\"3.0\"")));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Fmu<'a> {
    source: &'a CSource,
    version: FmiVersion,
}

impl<'a> Fmu<'a> {
    /// The FMU of `source`.
    #[must_use]
    pub const fn new(source: &'a CSource, version: FmiVersion) -> Self {
        Self { source, version }
    }

    /// Its text files: paths in the archive, and content.
    ///
    /// # Errors
    /// [`ExportError::FmuPrecision`] for code in single precision; [`ExportError::Unit`].
    pub fn files(&self) -> Result<Vec<(String, String)>, ExportError> {
        if self.source.precision != Precision::Double {
            return Err(ExportError::FmuPrecision);
        }
        let name = &self.source.name;
        let interface = match self.version {
            FmiVersion::V3 => include_str!("fmi3.c"),
            FmiVersion::V2 => include_str!("fmi2.c"),
        };
        let mut all = vec![
            ("modelDescription.xml".to_owned(), description::model_description(self)?),
            ("documentation/index.html".to_owned(), self.documentation()),
            (format!("sources/{name}.h"), self.source.header.clone()),
            (format!("sources/{name}.c"), self.source.source.clone()),
            (format!("sources/{name}_fmu.h"), self.finish(include_str!("fmu.h"))?),
            (format!("sources/{name}_fmu.c"), self.finish(include_str!("fmu.c"))?),
            (format!("sources/{}", self.interface_file()), self.finish(interface)?),
        ];
        if self.version == FmiVersion::V3 {
            all.push(("sources/buildDescription.xml".to_owned(), description::build_description(self)));
        }
        Ok(all)
    }

    /// The names of the files in `sources` that a compiler is given.
    #[must_use]
    pub fn compiled(&self) -> [String; 3] {
        let name = &self.source.name;
        [format!("{name}.c"), format!("{name}_fmu.c"), self.interface_file()]
    }

    fn interface_file(&self) -> String {
        let version = match self.version {
            FmiVersion::V3 => "fmi3",
            FmiVersion::V2 => "fmi2",
        };
        format!("{}_{version}.c", self.source.name)
    }

    /// The FMU as a zip archive, with `binary`, the shared object for this machine, if there is one. Equal models give equal archives.
    ///
    /// # Errors
    /// Those of [`Fmu::files`]; [`ExportError::Archive`] when the archive cannot be written.
    pub fn archive(&self, binary: Option<&[u8]>) -> Result<Vec<u8>, ExportError> {
        let fault = |error: &dyn std::fmt::Display| ExportError::Archive { what: error.to_string() };
        // Without a time of modification, so that equal models give equal archives.
        let options = zip::write::SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Deflated)
            .last_modified_time(zip::DateTime::default());
        let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
        let mut add = |path: &str, bytes: &[u8]| {
            archive.start_file(path, options).map_err(|error| fault(&error))?;
            archive.write_all(bytes).map_err(|error| fault(&error))
        };
        for (path, text) in self.files()? {
            add(&path, text.as_bytes())?;
        }
        if let (Some(bytes), Some((folder, extension))) = (binary, self.version.platform()) {
            add(&format!("{folder}/{}.{extension}", self.source.name), bytes)?;
        }
        Ok(archive.finish().map_err(|error| fault(&error))?.into_inner())
    }

    /// The token that instances are created with: the same for equal sources.
    fn token(&self) -> String {
        let mut hash = Sha256::new();
        for text in [self.version.name(), env!("CARGO_PKG_VERSION"), &self.source.header, &self.source.source]
        {
            hash.update(text.as_bytes());
            hash.update([0]);
        }
        let digits = hash.finalize().iter().fold(String::new(), |mut text, byte| {
            let _ = write!(text, "{byte:02x}");
            text
        });
        format!(
            "{{{}-{}-{}-{}-{}}}",
            &digits[..8],
            &digits[8..12],
            &digits[12..16],
            &digits[16..20],
            &digits[20..32]
        )
    }

    /// A file of C code with what depends on the model.
    fn finish(&self, text: &str) -> Result<String, ExportError> {
        let mut features = Features::default();
        features.set("HAS_INVERSE", self.source.has_inverse);
        features.set("INVERSE_LEARNED", self.source.has_learned_inverse);
        features.set("HAS_ARRAYS", self.version == FmiVersion::V3);
        let (mut starts, mut inputs) = (String::new(), String::new());
        for input in description::inputs(self.source) {
            let (field, reference) = (input.field, input.reference);
            let start = if input.start.is_nan() { "mrd_fmu_nan()".to_owned() } else { number(input.start) };
            let _ = writeln!(starts, "    fmu->input.{field} = {start};");
            let name = ["DISPLACEMENT", "DRIVE", "VELOCITY", "TEMPERATURE", "REQUEST"][reference - 1];
            let _ = write!(inputs, "    case MRD_FMU_{name}:\n        return &fmu->input.{field};\n");
        }
        let (places, count) = self.places();
        let text = resolve(text, &features)?
            .replace("@STARTS@", &starts)
            .replace("@INPUTS@", &inputs)
            .replace("@PLACES@", &places)
            .replace("@NUMBERS@", &format!("{count}U"))
            .replace("@TOKEN@", &self.token())
            .replace("@NAME@", &self.source.name);
        if let Some(at) = text.find('@') {
            let fragment = text[at..].lines().next().unwrap_or_default().to_owned();
            return Err(ExportError::Fragment { fragment, what: "it is not filled in".to_owned() });
        }
        Ok(self.source.named(&text))
    }

    /// A line of C for each parameter, with its place among the numbers and its range, and the count of numbers.
    fn places(&self) -> (String, usize) {
        let (mut places, mut first) = (String::new(), 0);
        for parameter in &self.source.parameters {
            let count = parameter.shape.len();
            let [least, most] = parameter.range.unwrap_or([f64::MIN, f64::MAX]).map(number);
            // FMI 2.0 has no arrays.
            let parts = if self.version == FmiVersion::V3 { vec![count] } else { vec![1; count] };
            for part in parts {
                let _ = writeln!(places, "    {{ {first}U, {part}U, {least}, {most} }},");
                first += part;
            }
        }
        (places, first)
    }

    /// `documentation/index.html`.
    fn documentation(&self) -> String {
        let mut parameters = String::new();
        for parameter in &self.source.parameters {
            let size = match parameter.shape {
                Shape::Scalar => String::new(),
                Shape::Array(n) => format!("[{n}]"),
                Shape::Rows(rows, n) => format!("[{rows},{n}]"),
            };
            let _ = writeln!(
                parameters,
                "<tr><td><code>parameters.{}{size}</code></td><td>{}</td><td>{}</td></tr>",
                description::escaped(&parameter.name),
                description::escaped(&parameter.unit),
                description::escaped(&parameter.about)
            );
        }
        let commands = match self.source.has_inverse {
            true => include_str!("command.html").replace("@LIMITS@\n", &rows(&LIMITS)),
            false => String::new(),
        };
        include_str!("index.html")
            .replace("@TITLE@", &description::escaped(&self.source.title))
            .replace("@PROVENANCE@", &description::escaped(&self.source.provenance.join(" ")))
            .replace("@FLAGS@\n", &rows(&FLAGS))
            .replace("@COMMANDS@\n", &commands)
            .replace("@PARAMETERS@\n", &parameters)
    }
}

/// The rows of a table of numbers and what they mean.
fn rows(all: &[(u32, &str)]) -> String {
    all.iter().fold(String::new(), |mut text, (number, what)| {
        let _ = writeln!(text, "<tr><td>{number}</td><td>{what}</td></tr>");
        text
    })
}

/// The bits of `flags`.
const FLAGS: [(u32, &str); 9] = [
    (1, "a drive has not been read yet, and there is no force"),
    (2, "the last drive is older than parameters.input_timeout_s"),
    (8, "the displacement before is older than parameters.gap_s, or was at another place"),
    (16, "a reading since the last estimate was refused"),
    (32, "the model extrapolates beyond its training data"),
    (512, "the filters have not settled yet"),
    (8192, "a case temperature has not been read yet"),
    (16_384, "a refused reading was beyond what its sensor can have"),
    (32_768, "a refused displacement would have needed too high a speed"),
];

/// The values of `command.limited_by`.
const LIMITS: [(u32, &str); 6] = [
    (0, "nothing"),
    (1, "the damper is too soft at its largest current"),
    (2, "the damper is too hard even without current"),
    (3, "the largest rate of the current"),
    (4, "passivity: the force would drive the rod"),
    (5, "no demand, or the motion is not known: the current goes to the safe current"),
];
