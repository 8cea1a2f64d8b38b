//! The calibration file of an export (ASAM MCD-2 MC, version 1.6): a characteristic for each parameter, a measurement for each output.

use crate::parameter::{CParameter, Shape};
use crate::source::CSource;
use std::fmt::Write as _;

/// Addresses of the two structures in the memory of the control unit, as `nm` prints them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Addresses {
    /// Of the parameters that calibration changes.
    pub parameters: u64,
    /// Of the output that measurement reads.
    pub output: u64,
}

/// The A2L file of `source`. The variable `parameters_symbol` at `addresses.parameters` holds the parameters, and
/// `output_symbol` at `addresses.output` the outputs.
///
/// ```
/// use mr_damper_export::{CExport, a2l};
/// use mr_damper_model::preset;
///
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// let source = CExport::new("damper", &model).source().expect("it is exported");
/// let text = a2l::file(&source, ["front_left_parameters", "front_left_output"], a2l::Addresses { parameters: 0x2000_0000, output: 0x2000_1000 });
/// assert!(text.contains("SYMBOL_LINK \"front_left_parameters\" 0") && text.contains("0x20000008"));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[must_use]
pub fn file(source: &CSource, symbols: [&str; 2], addresses: Addresses) -> String {
    let [parameters_symbol, output_symbol] = symbols;
    let name = &source.name;
    let mut text = format!(
        "ASAP2_VERSION 1 60
/begin PROJECT {name} \"Force of a magneto-rheological damper\"
  /begin MODULE {name} \"\"
    /begin MOD_COMMON \"\"
      BYTE_ORDER MSB_LAST
      ALIGNMENT_FLOAT64_IEEE 8
    /end MOD_COMMON
    /begin RECORD_LAYOUT {name}_double
      FNC_VALUES 1 FLOAT64_IEEE COLUMN_DIR DIRECT
    /end RECORD_LAYOUT
"
    );
    // Every field is a double, so fields follow each other without padding.
    let mut offset = 0;
    for parameter in &source.parameters {
        characteristic(&mut text, name, parameter, parameters_symbol, addresses.parameters, offset);
        offset += 8 * parameter.shape.len() as u64;
    }
    for (index, (field, unit, about)) in OUTPUTS.iter().enumerate() {
        let at = 8 * index as u64;
        let (kind, range) = if *field == "flags" {
            ("ULONG", "0 4294967295")
        } else {
            ("FLOAT64_IEEE", "-1.0E+300 1.0E+300")
        };
        let _ = write!(
            text,
            "    /begin MEASUREMENT {name}_{field} \"{about}\"
      {kind} NO_COMPU_METHOD 0 0 {range}
      ECU_ADDRESS 0x{:X}
      PHYS_UNIT \"{unit}\"
      SYMBOL_LINK \"{output_symbol}\" {at}
    /end MEASUREMENT
",
            addresses.output + at
        );
    }
    text + "  /end MODULE\n/end PROJECT\n"
}

/// Fields of the output structure, in its order.
const OUTPUTS: [(&str, &str, &str); 5] = [
    ("force_n", "N", "force of the damper, positive in extension"),
    ("reading_n", "N", "expected reading of the load cell"),
    ("displacement_m", "m", "displacement that the model was given"),
    ("velocity_m_s", "m/s", "velocity that the model was given"),
    ("flags", "", "reasons why the estimate is not as good as it could be; 0 for a good one"),
];

fn characteristic(
    text: &mut String,
    name: &str,
    parameter: &CParameter,
    symbol: &str,
    base: u64,
    offset: u64,
) {
    let (kind, size) = match parameter.shape {
        Shape::Scalar => ("VALUE", String::new()),
        Shape::Array(n) => ("VAL_BLK", format!("\n      MATRIX_DIM {n} 1 1")),
        // The first dimension is that within a row.
        Shape::Rows(rows, n) => ("VAL_BLK", format!("\n      MATRIX_DIM {n} {rows} 1")),
    };
    let [low, high] = parameter.range.unwrap_or([-1e300, 1e300]);
    let _ = write!(
        text,
        "    /begin CHARACTERISTIC {name}_{field} \"{about}\"
      {kind} 0x{address:X} {name}_double 0 NO_COMPU_METHOD {low:E} {high:E}{size}
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
