//! The calibration file of an export (ASAM MCD-2 MC, version 1.6): a characteristic for each parameter, a measurement for each output.

use crate::parameter::{CParameter, Shape};
use crate::precision::Precision;
use crate::source::CSource;
use std::fmt::Write as _;

/// The two structures in the memory of the control unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Memory {
    /// Address of the parameters that calibration changes, as `nm` prints it.
    pub parameters: u64,
    /// Address of the output that measurement reads.
    pub output: u64,
    /// True if the first byte of a number is its most significant one.
    pub is_big_endian: bool,
}

/// The A2L file of `source`. The variable `parameters_symbol` at `memory.parameters` holds the parameters, and
/// `output_symbol` at `memory.output` the outputs.
///
/// ```
/// use mr_damper_export::{CExport, a2l};
/// use mr_damper_model::preset;
///
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// let source = CExport::new("damper", &model).source().expect("it is exported");
/// let text = a2l::file(&source, ["front_left_parameters", "front_left_output"], a2l::Memory { parameters: 0x2000_0000, output: 0x2000_1000, is_big_endian: false });
/// assert!(text.contains("SYMBOL_LINK \"front_left_parameters\" 0") && text.contains("0x20000008"));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[must_use]
pub fn file(source: &CSource, symbols: [&str; 2], memory: Memory) -> String {
    let [parameters_symbol, output_symbol] = symbols;
    let name = &source.name;
    let (c_type, size) = (source.precision.c_type(), source.precision.size());
    let (real, most) = match source.precision {
        Precision::Double => ("FLOAT64_IEEE", 1e300),
        Precision::Single => ("FLOAT32_IEEE", 3e38),
    };
    let byte_order = if memory.is_big_endian { "MSB_FIRST" } else { "MSB_LAST" };
    let mut text = format!(
        "ASAP2_VERSION 1 60
/begin PROJECT {name} \"Force of a magneto-rheological damper\"
  /begin MODULE {name} \"\"
    /begin MOD_COMMON \"\"
      BYTE_ORDER {byte_order}
      ALIGNMENT_{real} {size}
    /end MOD_COMMON
    /begin RECORD_LAYOUT {name}_{c_type}
      FNC_VALUES 1 {real} COLUMN_DIR DIRECT
    /end RECORD_LAYOUT
"
    );
    // Every field is a number of one type, so fields follow each other without padding.
    let mut offset = 0;
    for parameter in &source.parameters {
        let field = Field {
            layout: &format!("{name}_{c_type}"),
            most,
            symbol: parameters_symbol,
            base: memory.parameters,
            offset,
        };
        characteristic(&mut text, name, parameter, &field);
        offset += size * parameter.shape.len() as u64;
    }
    let mut at = 0;
    for Output { field, kind, count, unit, about, .. } in outputs(source) {
        let (kind, range, size) = match kind {
            Kind::Number => (real, format!("{:E} {most:E}", -most), size),
            Kind::Word => ("ULONG", "0 4294967295".to_owned(), 4),
            Kind::Truth => ("UBYTE", "0 1".to_owned(), 1),
        };
        let array = if count == 1 { String::new() } else { format!("\n      MATRIX_DIM {count} 1 1") };
        let _ = write!(
            text,
            "    /begin MEASUREMENT {name}_{field} \"{about}\"
      {kind} NO_COMPU_METHOD 0 0 {range}{array}
      ECU_ADDRESS 0x{:X}
      PHYS_UNIT \"{unit}\"
      SYMBOL_LINK \"{output_symbol}\" {at}
    /end MEASUREMENT
",
            memory.output + at
        );
        // The fields are in the order of their sizes, so there is no padding between them.
        at += size * count;
    }
    text + "  /end MODULE\n/end PROJECT\n"
}

/// Type of a field of the output structure.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Number,
    Word,
    Truth,
}

/// A field of the output structure.
struct Output {
    field: &'static str,
    kind: Kind,
    count: u64,
    unit: &'static str,
    about: &'static str,
    /// The exports that have the field.
    of: Exports,
}

/// Exports that have a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Exports {
    All,
    WithInverse,
    WithLearnedInverse,
}

/// The fields of the output structure, in its order.
fn outputs(source: &CSource) -> impl Iterator<Item = Output> {
    let plain = |field, kind, unit, about| Output { field, kind, count: 1, unit, about, of: Exports::All };
    let inverse = |field, kind, count, unit, about| Output {
        field,
        kind,
        count,
        unit,
        about,
        of: Exports::WithInverse,
    };
    let about = "1 if the search gave the current, because the learned inverse gave none";
    let is_substituted =
        Output { of: Exports::WithLearnedInverse, ..inverse("is_substituted", Kind::Truth, 1, "", about) };
    let all = [
        plain("force_n", Kind::Number, "N", "force of the damper, positive in extension"),
        plain("reading_n", Kind::Number, "N", "expected reading of the load cell"),
        plain("displacement_m", Kind::Number, "m", "displacement that the model was given"),
        plain("velocity_m_s", Kind::Number, "m/s", "velocity that the model was given"),
        inverse("current_a", Kind::Number, 1, "A", "commanded current"),
        inverse("requested_n", Kind::Number, 1, "N", "demanded force"),
        inverse("expected_n", Kind::Number, 1, "N", "force that the model expects at the commanded current"),
        inverse("achievable_n", Kind::Number, 2, "N", "least and largest force of the damper at this motion"),
        plain(
            "flags",
            Kind::Word,
            "",
            "reasons why the estimate is not as good as it could be; 0 for a good one",
        ),
        inverse(
            "limited_by",
            Kind::Word,
            1,
            "",
            "why the command does not reach the demanded force; 0 if it does",
        ),
        inverse("is_commanded", Kind::Truth, 1, "", "1 if there is a command"),
        inverse(
            "is_achievable",
            Kind::Truth,
            1,
            "",
            "1 if the demanded force is dissipative and in the range",
        ),
        inverse(
            "is_dissipative",
            Kind::Truth,
            1,
            "",
            "1 if the demanded force takes energy out of the motion",
        ),
        is_substituted,
    ];
    let (has_inverse, is_learned) = (source.has_inverse, source.has_learned_inverse);
    all.into_iter().filter(move |own| match own.of {
        Exports::All => true,
        Exports::WithInverse => has_inverse,
        Exports::WithLearnedInverse => is_learned,
    })
}

/// A field of the parameters' structure in memory.
struct Field<'a> {
    /// Its record layout.
    layout: &'a str,
    /// Largest number of its type.
    most: f64,
    /// The structure's symbol and address, and the field's offset in it.
    symbol: &'a str,
    base: u64,
    offset: u64,
}

fn characteristic(text: &mut String, name: &str, parameter: &CParameter, at: &Field<'_>) {
    let Field { layout, most, symbol, base, offset } = *at;
    let (kind, size) = match parameter.shape {
        Shape::Scalar => ("VALUE", String::new()),
        Shape::Array(n) => ("VAL_BLK", format!("\n      MATRIX_DIM {n} 1 1")),
        // The first dimension is that within a row.
        Shape::Rows(rows, n) => ("VAL_BLK", format!("\n      MATRIX_DIM {n} {rows} 1")),
    };
    let [low, high] = parameter.range.unwrap_or([-most, most]);
    let _ = write!(
        text,
        "    /begin CHARACTERISTIC {name}_{field} \"{about}\"
      {kind} 0x{address:X} {layout} 0 NO_COMPU_METHOD {low:E} {high:E}{size}
      PHYS_UNIT \"{unit}\"
      SYMBOL_LINK \"{symbol}\" {offset}
    /end CHARACTERISTIC
",
        field = parameter.name,
        about = parameter.about,
        address = base + offset,
        unit = parameter.unit,
    );
}
