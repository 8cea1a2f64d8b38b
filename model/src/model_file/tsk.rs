//! Parameters of a TSK model in a model file.
//!
//! ```toml
//! inputs = ["displacement", "velocity", "drive"]
//! order = "first"                      # or "constant"
//! displacement_mean_m = 0.0            # for each input: its normalisation, in its unit,
//! displacement_std_dev_m = 0.004
//! displacement_centres = [-3, 0, 3]    # and its Gaussians, or another shape of the table
//! displacement_sigmas = [1, 1, 1]
//! conclusions = [[0.1, 0.2, 0.3, 0.4]] # rule by rule, the last input's sets fastest; normalised
//! force_mean_n = 0.0
//! force_std_dev_n = 400.0
//! force_offset_n = 0.0
//! ```
//!
//! | shape | keys |
//! |---|---|
//! | Gaussians | `_centres`, `_sigmas` |
//! | generalised bells | `_half_widths`, `_exponents`, `_centres` |
//! | triangles | `_left_feet`, `_peaks`, `_right_feet` |
//! | trapezoids | `_left_feet`, `_left_shoulders`, `_right_shoulders`, `_right_feet` |
//! | two-sided Gaussians | `_left_sigmas`, `_left_centres`, `_right_sigmas`, `_right_centres` |

use super::law::Value;
use super::{drive_error, missing, table_into};
use crate::error::{Error, ModelFileError};
use crate::force::tsk::NUMBERS;
use crate::force::{Order, OutputScale, Shape, Signal, Tsk, TskInput, TskKind, TskSet};
use crate::sample::DriveKind;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Parameters {
    inputs: Vec<String>,
    order: String,
    force_offset_n: f64,
    force_mean_n: f64,
    force_std_dev_n: f64,
    conclusions: Vec<Vec<f64>>,
    #[serde(flatten)]
    values: BTreeMap<String, Value>,
}

/// The known keys except the inputs' keys, to suggest the nearest one.
const KEYS: [&str; 6] =
    ["inputs", "order", "force_offset_n", "force_mean_n", "force_std_dev_n", "conclusions"];

/// Numbers of a set of this shape, in the order of its fields, as the last part of the key.
const fn endings(shape: Shape) -> &'static [&'static str] {
    match shape {
        Shape::Gaussian => &["centres", "sigmas"],
        Shape::Triangle => &["left_feet", "peaks", "right_feet"],
        Shape::Bell => &["half_widths", "exponents", "centres"],
        Shape::Trapezoid => &["left_feet", "left_shoulders", "right_shoulders", "right_feet"],
        Shape::TwoSidedGaussian => &["left_sigmas", "left_centres", "right_sigmas", "right_centres"],
    }
}

impl Parameters {
    pub(super) fn of(model: &Tsk) -> Self {
        let width = model.order().width(model.inputs().len());
        let mut values = BTreeMap::new();
        for input in model.inputs() {
            let (name, unit) = (input.signal().name(), input.signal().unit_suffix());
            values.insert(format!("{name}_mean_{unit}"), Value::One(input.mean()));
            values.insert(format!("{name}_std_dev_{unit}"), Value::One(input.std_dev()));
            for (k, ending) in endings(input.shape()).iter().enumerate() {
                let list = input.sets().map(|set| set.numbers()[k]).collect();
                values.insert(format!("{name}_{ending}"), Value::Many(list));
            }
        }
        Self {
            inputs: model.inputs().iter().map(|input| input.signal().name().to_owned()).collect(),
            order: match model.order() {
                Order::Constant => "constant",
                Order::First => "first",
            }
            .to_owned(),
            force_offset_n: model.force_offset_n(),
            force_mean_n: model.output().mean_n,
            force_std_dev_n: model.output().std_dev_n,
            conclusions: model.conclusions().chunks_exact(width).map(<[f64]>::to_vec).collect(),
            values,
        }
    }
}

pub(super) fn read(kind: TskKind, drive: Option<DriveKind>, table: &toml::Table) -> Result<Tsk, Error> {
    let names = table.get("inputs").and_then(toml::Value::as_array);
    let takes_drive = names.is_some_and(|names| names.iter().any(|name| name.as_str() == Some("drive")));
    if takes_drive != drive.is_some() {
        return Err(drive_error(drive, "an input \"drive\" if and only if there is a drive"));
    }
    let signals = signals(drive);
    let keys: Vec<String> = signals
        .iter()
        .flat_map(|signal| {
            let (name, unit) = (signal.name(), signal.unit_suffix());
            let endings = Shape::ALL.into_iter().flat_map(endings);
            let sets = endings.map(move |ending| format!("{name}_{ending}"));
            sets.chain([format!("{name}_mean_{unit}"), format!("{name}_std_dev_{unit}")])
        })
        .collect();
    let known: Vec<&str> = KEYS.into_iter().chain(keys.iter().map(String::as_str)).collect();
    let p: Parameters = table_into("parameters", table.clone(), &known)?;
    let order = match p.order.as_str() {
        "first" => Order::First,
        "constant" => Order::Constant,
        other => {
            return Err(ModelFileError::UnknownWord {
                key: "parameters.order".to_owned(),
                found: other.to_owned(),
                expected: "first or constant",
            }
            .into());
        }
    };
    let named = |name: &String| {
        signals
            .iter()
            .find(|signal| signal.name() == name)
            .copied()
            .ok_or_else(|| Error::from(ModelFileError::UnknownInput { input: name.clone() }))
    };
    let inputs: Vec<TskInput> =
        p.inputs.iter().map(|name| input(named(name)?, &p.values)).collect::<Result<_, Error>>()?;
    if let Some(foreign) = p.values.keys().find(|key| {
        let own = |name: &String| key.starts_with(&format!("{name}_"));
        !p.inputs.iter().any(own)
    }) {
        return Err(ModelFileError::NoInput { key: format!("parameters.{foreign}") }.into());
    }
    let width = order.width(inputs.len());
    if let Some((rule, conclusion)) = p.conclusions.iter().enumerate().find(|(_, c)| c.len() != width) {
        return Err(Error::Length {
            name: format!("parameters.conclusions[{rule}]"),
            found: conclusion.len(),
            expected: format!("{width}"),
        });
    }
    let output = OutputScale { mean_n: p.force_mean_n, std_dev_n: p.force_std_dev_n };
    Tsk::new(kind, &inputs, order, &p.conclusions.concat(), output, p.force_offset_n)
}

/// All inputs that are possible with this drive.
fn signals(drive: Option<DriveKind>) -> Vec<Signal> {
    let motion = [Signal::Displacement, Signal::Velocity, Signal::Acceleration];
    motion.into_iter().chain(drive.map(Signal::Drive)).collect()
}

fn input(signal: Signal, values: &BTreeMap<String, Value>) -> Result<TskInput, Error> {
    let (name, unit) = (signal.name(), signal.unit_suffix());
    let list = |key: String| {
        let value = values.get(&key).ok_or_else(|| missing(format!("parameters.{key}")))?;
        Ok::<_, Error>(value.as_slice())
    };
    let one = |key: String| match values.get(&key) {
        Some(Value::One(value)) => Ok(*value),
        Some(Value::Many(_)) => Err(Error::from(ModelFileError::WrongType {
            key: format!("parameters.{key}"),
            found: "a list".to_owned(),
            expected: "a number",
        })),
        None => Err(missing(format!("parameters.{key}"))),
    };
    let shape = shape(name, |ending| values.contains_key(&format!("{name}_{ending}")))?;
    let lists: Vec<&[f64]> =
        endings(shape).iter().map(|ending| list(format!("{name}_{ending}"))).collect::<Result<_, Error>>()?;
    if let Some((ending, short)) = endings(shape).iter().zip(&lists).find(|(_, l)| l.len() != lists[0].len())
    {
        return Err(Error::Length {
            name: format!("parameters.{name}_{ending}"),
            found: short.len(),
            expected: format!("{} (one for each of {name}_{})", lists[0].len(), endings(shape)[0]),
        });
    }
    let foreign =
        |ending: &&&str| !endings(shape).contains(ending) && values.contains_key(&format!("{name}_{ending}"));
    if Shape::ALL.into_iter().flat_map(endings).any(|ending| foreign(&ending)) {
        return Err(ModelFileError::TwoShapes { input: name }.into());
    }
    let set = |j: usize| {
        let mut numbers = [0.0; NUMBERS];
        numbers.iter_mut().zip(&lists).for_each(|(number, list)| *number = list[j]);
        TskSet::of(shape, numbers)
    };
    let sets: Vec<TskSet> = (0..lists[0].len()).map(set).collect();
    TskInput::new(signal, one(format!("{name}_mean_{unit}"))?, one(format!("{name}_std_dev_{unit}"))?, &sets)
}

/// The shape that the keys of the input `name` belong to; Gaussian if none of them tells. `has` says whether there is a
/// key with this ending.
fn shape(name: &'static str, has: impl Fn(&str) -> bool) -> Result<Shape, Error> {
    let of = |shape: Shape| match shape {
        Shape::Gaussian => has("centres") && !has("half_widths"),
        Shape::Triangle => has("peaks"),
        Shape::Bell => has("half_widths"),
        Shape::Trapezoid => has("left_shoulders"),
        Shape::TwoSidedGaussian => has("left_centres"),
    };
    let mut shapes = Shape::ALL.into_iter().filter(|shape| of(*shape));
    match (shapes.next(), shapes.next()) {
        (Some(_), Some(_)) => Err(ModelFileError::TwoShapes { input: name }.into()),
        (shape, _) => Ok(shape.unwrap_or(Shape::Gaussian)),
    }
}
