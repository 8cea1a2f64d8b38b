//! The model description of an FMU, and the build description of its sources.

use super::unit::FmuUnit;
use super::{FmiVersion, Fmu};
use crate::error::ExportError;
use crate::parameter::{CParameter, Shape};
use crate::source::CSource;
use mr_damper_model::sample::DriveKind;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Value reference of the first parameter; the C code has the same.
const FIRST_PARAMETER: usize = 1000;

/// Range of forces, N.
const FORCES_N: [f64; 2] = [-1e9, 1e9];

/// Type of a variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Number,
    Word,
    Truth,
}

/// A variable of an FMU.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Variable {
    reference: usize,
    name: String,
    about: String,
    causality: &'static str,
    kind: Kind,
    shape: Shape,
    unit: String,
    range: Option<[f64; 2]>,
    /// Start values; none for a variable that is calculated.
    start: Vec<f64>,
}

impl Variable {
    fn number(reference: usize, name: &str, about: &str, causality: &'static str, unit: &str) -> Self {
        let (name, about, unit) = (name.to_owned(), about.to_owned(), unit.to_owned());
        let (kind, shape) = (Kind::Number, Shape::Scalar);
        Self { reference, name, about, causality, kind, shape, unit, range: None, start: Vec::new() }
    }

    fn word(reference: usize, name: &str, about: &str, most: f64) -> Self {
        let own = Self::number(reference, name, about, "output", "");
        Self { kind: Kind::Word, range: Some([0.0, most]), ..own }
    }

    fn truth(reference: usize, name: &str, about: &str) -> Self {
        Self { kind: Kind::Truth, ..Self::number(reference, name, about, "output", "") }
    }

    fn within(self, range: [f64; 2]) -> Self {
        Self { range: Some(range), ..self }
    }

    /// One variable for each element, with value references that follow each other.
    fn elements(self) -> Vec<Self> {
        let index = |k: usize| match self.shape {
            Shape::Scalar => String::new(),
            Shape::Array(_) => format!("[{}]", k + 1),
            Shape::Rows(_, n) => format!("[{},{}]", k / n + 1, k % n + 1),
        };
        let element = |k: usize| Self {
            reference: self.reference + k,
            name: format!("{}{}", self.name, index(k)),
            shape: Shape::Scalar,
            start: self.start.get(k).copied().into_iter().collect(),
            ..self.clone()
        };
        (0..self.shape.len()).map(element).collect()
    }

    fn variability(&self) -> &'static str {
        match (self.kind, self.causality) {
            (_, "parameter") => "tunable",
            (Kind::Number, _) => "continuous",
            _ => "discrete",
        }
    }

    /// `initial`, which only outputs and parameters have.
    fn initial(&self) -> Option<&'static str> {
        match self.causality {
            "output" => Some("calculated"),
            "parameter" => Some("exact"),
            _ => None,
        }
    }
}

/// `text` as the value of an attribute.
pub(super) fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            // XML 1.0 has no other control characters.
            c if c.is_control() => safe.push(' '),
            c => safe.push(c),
        }
    }
    safe
}

/// An input of an FMU: a field of the step's inputs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Input {
    /// Its value reference.
    pub(super) reference: usize,
    /// Its field.
    pub(super) field: &'static str,
    about: &'static str,
    unit: &'static str,
    range: [f64; 2],
    /// Its start value.
    pub(super) start: f64,
}

/// The inputs, in the order of their value references.
pub(super) fn inputs(source: &CSource) -> Vec<Input> {
    let limit = |name: &str| {
        let own = source.parameters.iter().find(|parameter| parameter.name == name);
        own.map_or(f64::MAX, |parameter| parameter.values[0])
    };
    let input =
        |reference, field, about, unit, range, start| Input { reference, field, about, unit, range, start };
    let (far_m, fast_m_s) = (limit("displacement_max_m"), limit("speed_max_m_s"));
    let about = "displacement, positive in extension";
    let mut all = vec![input(1, "displacement_m", about, "m", [-far_m, far_m], 0.0)];
    if let Some(kind) = source.drive {
        let about = match kind {
            DriveKind::CoilCurrent => "coil current; NaN without a new reading",
            DriveKind::CommandVoltage => "command voltage; NaN without a new reading",
        };
        all.push(input(2, kind.name(), about, kind.unit(), [-1e3, 1e3], 0.0));
    }
    if source.needs_velocity {
        let about = "measured velocity, positive in extension; NaN without a new reading";
        all.push(input(3, "velocity_m_s", about, "m/s", [-fast_m_s, fast_m_s], 0.0));
    }
    if source.needs_temperature {
        let about = "temperature of the damper's case; NaN without a new reading";
        all.push(input(4, "case_temp_c", about, "degrees Celsius", [-100.0, 400.0], 25.0));
    }
    if source.has_inverse {
        let about = "demanded force, positive in extension; NaN without a new request";
        // An FMU whose input is not connected requests nothing, and so commands nothing.
        all.push(input(5, "force_request_n", about, "N", FORCES_N, f64::NAN));
    }
    all
}

/// All variables. FMI 3.0 has arrays; in FMI 2.0 each element is a variable.
pub(super) fn variables(fmu: &Fmu<'_>) -> Vec<Variable> {
    let mut all = vec![Variable::number(0, "time", "simulation time", "independent", "s")];
    for Input { reference, field, about, unit, range, start } in inputs(fmu.source) {
        let own = Variable::number(reference, field, about, "input", unit).within(range);
        all.push(Variable { start: vec![start], ..own });
    }
    let output = |reference, name, about, unit| Variable::number(reference, name, about, "output", unit);
    let flags_about = "reasons why the estimate is not as good as it could be: bits, see the documentation; 0 for a good one";
    let force_about = "force of the damper, positive in extension; NaN if there is none";
    let reading_about = "reading that the load cell should show; NaN if there is none";
    all.extend([
        output(11, "force_n", force_about, "N").within(FORCES_N),
        output(12, "reading_n", reading_about, "N").within(FORCES_N),
        output(13, "conditioned.displacement_m", "displacement that the model was given", "m"),
        output(14, "conditioned.velocity_m_s", "velocity that the model was given", "m/s"),
        Variable::word(15, "flags", flags_about, 65_535.0),
        Variable::truth(16, "valid", "true if there is a force"),
        Variable::truth(17, "accepted", "true if the displacement was accepted"),
    ]);
    if fmu.source.has_inverse {
        all.extend(command(fmu.source));
    }
    let mut place = FIRST_PARAMETER;
    for parameter in &fmu.source.parameters {
        all.push(whole(parameter, place));
        place += if fmu.version == FmiVersion::V3 { 1 } else { parameter.values.len() };
    }
    match fmu.version {
        FmiVersion::V3 => all,
        FmiVersion::V2 => all.into_iter().flat_map(Variable::elements).collect(),
    }
}

/// The outputs of the inverse controller.
fn command(source: &CSource) -> Vec<Variable> {
    let output = |reference, name, about, unit| Variable::number(reference, name, about, "output", unit);
    // The largest current is a parameter, so the current can have any value that this parameter can have.
    let limit = source.parameters.iter().find(|parameter| parameter.name == "inverse_current_max_a");
    let most_a = limit.and_then(|parameter| parameter.range).map_or(f64::MAX, |[_, most_a]| most_a);
    let current_about = "commanded current, from 0 to parameters.inverse_current_max_a; always finite";
    let expected_about = "force that the model expects at the commanded current; NaN if there is none";
    let achievable_about = "least and largest force of the damper at this motion; NaN if they are not known";
    let limited_about = "why the command does not reach the demanded force: 0 it does, 1 largest current, 2 least current, 3 rate, \
                         4 passivity, 5 safe current";
    let commanded_about = "false before the first request, and if the displacement was refused";
    let achievable = output(24, "command.achievable_n", achievable_about, "N");
    let mut all = vec![
        output(21, "command.current_a", current_about, "A").within([0.0, most_a]),
        output(22, "command.requested_n", "demanded force; NaN if there is none", "N").within(FORCES_N),
        output(23, "command.expected_n", expected_about, "N").within(FORCES_N),
        Variable { shape: Shape::Array(2), ..achievable }.within(FORCES_N),
        Variable::word(26, "command.limited_by", limited_about, 5.0),
        Variable::truth(27, "command.is_commanded", commanded_about),
        Variable::truth(
            28,
            "command.is_achievable",
            "true if the demanded force is dissipative and in the range",
        ),
        Variable::truth(
            29,
            "command.is_dissipative",
            "true if the demanded force takes energy out of the motion",
        ),
    ];
    if source.has_learned_inverse {
        let substituted_about = "true if the search gave the current, because the learned inverse gave none";
        all.push(Variable::truth(30, "command.is_substituted", substituted_about));
    }
    all
}

/// A parameter, which may be an array.
fn whole(parameter: &CParameter, reference: usize) -> Variable {
    let name = format!("parameters.{}", parameter.name);
    let own = Variable::number(reference, &name, &parameter.about, "parameter", &parameter.unit);
    Variable { shape: parameter.shape, range: parameter.range, start: parameter.values.clone(), ..own }
}

/// The units of `variables`, by symbol.
fn units(variables: &[Variable]) -> Result<BTreeMap<&str, FmuUnit>, ExportError> {
    let symbols = variables.iter().map(|variable| variable.unit.as_str()).filter(|symbol| !symbol.is_empty());
    symbols.map(|symbol| Ok((symbol, FmuUnit::of(symbol)?))).collect()
}

/// `modelDescription.xml`.
pub(super) fn model_description(fmu: &Fmu<'_>) -> Result<String, ExportError> {
    let variables = variables(fmu);
    let units = units(&variables)?;
    let source = fmu.source;
    let mut definitions: Vec<String> = units.values().map(FmuUnit::definition).collect();
    definitions.sort();
    definitions.dedup();
    let (version, token, state) = match fmu.version {
        FmiVersion::V3 => ("3.0", "instantiationToken", "FMUState"),
        FmiVersion::V2 => ("2.0", "guid", "FMUstate"),
    };
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>
<fmiModelDescription
  fmiVersion=\"{version}\"
  modelName=\"{title}\"
  {token}=\"{}\"
  description=\"{}\"
  generationTool=\"mr-damper {}\"
  variableNamingConvention=\"structured\"",
        fmu.token(),
        escaped(&format!("Force of a magneto-rheological damper. {}", source.provenance.join(" "))),
        env!("CARGO_PKG_VERSION"),
        title = escaped(&source.title),
    );
    let _ = write!(
        text,
        ">
  <CoSimulation
    modelIdentifier=\"{name}\"
    canHandleVariableCommunicationStepSize=\"true\"
    canGetAndSet{state}=\"true\"
    canSerialize{state}=\"true\"",
        name = source.name
    );
    match fmu.version {
        FmiVersion::V3 => text += "/>\n",
        FmiVersion::V2 => {
            text += "\n    canNotUseMemoryManagementFunctions=\"true\">\n    <SourceFiles>\n";
            for file in fmu.compiled() {
                let _ = writeln!(text, "      <File name=\"{file}\"/>");
            }
            text += "    </SourceFiles>\n  </CoSimulation>\n";
        }
    }
    text += "  <UnitDefinitions>\n";
    text += &definitions.concat();
    let period_s = if source.rate_hz > 0.0 { 1.0 / source.rate_hz } else { 1e-3 };
    let _ = write!(
        text,
        "  </UnitDefinitions>
  <LogCategories>
    <Category name=\"logStatusError\" description=\"errors\"/>
  </LogCategories>
  <DefaultExperiment startTime=\"0\" stopTime=\"10\" stepSize=\"{period_s:?}\"/>
  <ModelVariables>
"
    );
    for variable in &variables {
        let unit = units.get(variable.unit.as_str());
        text += &match fmu.version {
            FmiVersion::V3 => variable_3(variable, unit),
            FmiVersion::V2 => variable_2(variable, unit),
        };
    }
    text += "  </ModelVariables>\n  <ModelStructure>\n";
    text += &structure(fmu.version, &variables);
    Ok(text + "  </ModelStructure>\n</fmiModelDescription>\n")
}

/// Outputs have no value that depends on others before the first step.
fn structure(version: FmiVersion, variables: &[Variable]) -> String {
    let outputs: Vec<(usize, usize)> = variables
        .iter()
        .enumerate()
        .filter(|(_, variable)| variable.causality == "output")
        .map(|(index, variable)| (index + 1, variable.reference))
        .collect();
    let list = |element: &str, more: &str| -> String {
        let line = |(index, reference): &(usize, usize)| match version {
            FmiVersion::V3 => format!("    <{element} valueReference=\"{reference}\"{more}/>\n"),
            FmiVersion::V2 => format!("      <Unknown index=\"{index}\"{more}/>\n"),
        };
        outputs.iter().map(line).collect()
    };
    const NONE: &str = " dependencies=\"\"";
    match version {
        FmiVersion::V3 => list("Output", "") + &list("InitialUnknown", NONE),
        FmiVersion::V2 => format!(
            "    <Outputs>\n{}    </Outputs>\n    <InitialUnknowns>\n{}    </InitialUnknowns>\n",
            list("", ""),
            list("", NONE)
        ),
    }
}

/// Unit, range and start value as attributes.
fn attributes(variable: &Variable, unit: Option<&FmuUnit>) -> String {
    let mut text = String::new();
    if let Some(unit) = unit {
        let _ = write!(text, " unit=\"{}\"", unit.name);
    }
    let number = |value: f64| match variable.kind {
        Kind::Word => format!("{value}"),
        _ => format!("{value:?}"),
    };
    if let Some([low, high]) = variable.range {
        let _ = write!(text, " min=\"{}\" max=\"{}\"", number(low), number(high));
    }
    if !variable.start.is_empty() {
        let values: Vec<String> = variable.start.iter().map(|value| number(*value)).collect();
        let _ = write!(text, " start=\"{}\"", values.join(" "));
    }
    text
}

/// The attributes that a variable has in both versions of the standard, without its unit, range and start.
fn identity(variable: &Variable) -> String {
    let initial = variable.initial().map_or(String::new(), |initial| format!(" initial=\"{initial}\""));
    format!(
        "name=\"{}\" valueReference=\"{}\" causality=\"{}\" variability=\"{}\"{initial} description=\"{}\"",
        escaped(&variable.name),
        variable.reference,
        variable.causality,
        variable.variability(),
        escaped(&variable.about)
    )
}

fn variable_3(variable: &Variable, unit: Option<&FmuUnit>) -> String {
    let kind = match variable.kind {
        Kind::Number => "Float64",
        Kind::Word => "UInt32",
        Kind::Truth => "Boolean",
    };
    let head = format!("    <{kind} {}{}", identity(variable), attributes(variable, unit));
    let dimension = |n: usize| format!("<Dimension start=\"{n}\"/>");
    match variable.shape {
        Shape::Scalar => format!("{head}/>\n"),
        Shape::Array(n) => format!("{head}>{}</{kind}>\n", dimension(n)),
        Shape::Rows(rows, n) => format!("{head}>{}{}</{kind}>\n", dimension(rows), dimension(n)),
    }
}

fn variable_2(variable: &Variable, unit: Option<&FmuUnit>) -> String {
    let kind = match variable.kind {
        Kind::Number => "Real",
        Kind::Word => "Integer",
        Kind::Truth => "Boolean",
    };
    let (identity, attributes) = (identity(variable), attributes(variable, unit));
    format!("    <ScalarVariable {identity}><{kind}{attributes}/></ScalarVariable>\n")
}

/// `sources/buildDescription.xml` of FMI 3.0.
pub(super) fn build_description(fmu: &Fmu<'_>) -> String {
    let mut files = String::new();
    for file in fmu.compiled() {
        let _ = writeln!(files, "      <SourceFile name=\"{file}\"/>");
    }
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>
<fmiBuildDescription fmiVersion=\"3.0\">
  <BuildConfiguration modelIdentifier=\"{}\" description=\"C99; without -ffast-math\">
    <SourceFileSet language=\"C99\">
{files}    </SourceFileSet>
  </BuildConfiguration>
</fmiBuildDescription>
",
        fmu.source.name
    )
}
