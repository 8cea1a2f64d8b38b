//! `mr-damper coefficients`: the coefficients of a model as a table; also the table that `identify --coefficients` writes.

pub(super) mod fitted;
mod symbols;

use crate::estimation::models;
use crate::settings::error::{NodeError, PartError};
use clap::ValueEnum;
use mr_damper_model::effect::term::{self, Term};
use mr_damper_model::effect::{EffectModel, Parameter};
use mr_damper_model::model::Model;
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::sample::DriveKind;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

/// Print the coefficients of a model as a table: name in the model file, symbol in the equation, value and unit.
///
/// A model file holds no standard errors. `mr-damper identify --coefficients FILE` writes this table with the standard errors
/// of the fit, and with `--bootstrap N` also with their scatter over the runs. The symbols are those of the equations in the
/// documentation of each model.
///
/// A discovered term has its amount, the parameters of its form, and confirmed_in: the range of its argument in the data that it was found
/// on. Several terms are numbered in the order of the model file. A note gives the equation of each term.
///
/// Example: mr-damper coefficients thesis/fuzzy-tanh/rp3-cs --format latex
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Model file, or preset.
    #[arg(value_name = "MODEL")]
    model: String,
    /// Format of the table.
    #[arg(long, value_enum, default_value_t)]
    format: Format,
}

/// Format of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum Format {
    /// Columns of text.
    #[default]
    Text,
    /// Comma-separated values, with all digits.
    Csv,
    /// A Markdown table.
    Markdown,
    /// A LaTeX tabular, for the package booktabs.
    Latex,
}

impl Format {
    /// The format that the extension of `path` names: .csv, .md or .tex.
    ///
    /// # Errors
    /// [`NodeError::Usage`] for another extension.
    pub fn of(path: &Path) -> Result<Self, NodeError> {
        match path.extension().and_then(|extension| extension.to_str()) {
            Some("csv") => Ok(Self::Csv),
            Some("md") => Ok(Self::Markdown),
            Some("tex") => Ok(Self::Latex),
            _ => Err(NodeError::Usage(format!(
                "--coefficients {}: give a name that ends in .csv, .md or .tex",
                path.display()
            ))),
        }
    }
}

/// A coefficient of a model file.
#[derive(Debug, Clone, PartialEq)]
pub struct Coefficient {
    /// Name in the model file, with the index if it is in a list: `yield_force_n[2]`.
    pub name: String,
    /// Symbol in the model's equation, in LaTeX's notation; empty if the equation has none for it.
    pub symbol: String,
    /// The value, in `unit`.
    pub value: f64,
    /// The unit, `1` if it has none.
    pub unit: String,
    /// Standard error of the fit; `None` if the fit gives none, or the runs do not determine the coefficient.
    pub standard_error: Option<f64>,
    /// Scatter over resampled runs; `None` without a bootstrap.
    pub bootstrap: Option<Scatter>,
}

impl Coefficient {
    /// A coefficient without a symbol, error or scatter; `unit` is a symbol of the model library, empty if it has none.
    fn plain(name: String, value: f64, unit: &str) -> Self {
        let unit = symbols::plain_unit(unit);
        Self { name, symbol: String::new(), value, unit, standard_error: None, bootstrap: None }
    }
}

/// Scatter of a coefficient over fits to resampled runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scatter {
    /// Standard deviation.
    pub standard_error: f64,
    /// The 2.5 % and 97.5 % quantiles.
    pub interval: [f64; 2],
}

impl Scatter {
    /// The scatter of `values`; `None` for fewer than two.
    #[must_use]
    pub fn of(mut values: Vec<f64>) -> Option<Self> {
        if values.len() < 2 {
            return None;
        }
        values.sort_by(f64::total_cmp);
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0);
        // Linear interpolation between order statistics, as numpy.quantile.
        let quantile = |share: f64| {
            let place = share * (n - 1.0);
            let (low, high) = (place.floor() as usize, place.ceil() as usize);
            values[low] + (place - place.floor()) * (values[high] - values[low])
        };
        Some(Self { standard_error: variance.sqrt(), interval: [quantile(0.025), quantile(0.975)] })
    }
}

/// The model file is not the table of numbers that it is expected to be.
#[derive(Debug, thiserror::Error)]
#[error("the model cannot be written as a table: {0}")]
struct NotATable(String);

impl PartError for NotATable {}

/// Prints the table.
///
/// # Errors
/// When the model does not load, or stdout cannot be written.
pub fn run(args: &Args) -> Result<(), NodeError> {
    let model = models::load_whole(&args.model)?.model;
    let table = table(&of_model(&model)?, args.format, &equations(&model));
    match std::io::stdout().lock().write_all(table.as_bytes()) {
        // A closed pipe (`| head`) is not an error.
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(NodeError::io("writing to stdout")(error))
        }
        _ => Ok(()),
    }
}

/// The coefficients of `model`: all numbers of the table `[parameters]` of its file, and those of its effects and terms.
///
/// # Errors
/// When the model cannot be written as a model file.
pub fn of_model(model: &Model) -> Result<Vec<Coefficient>, NodeError> {
    let text = ModelFile { model: *model, provenance: Provenance::default() }.to_toml()?;
    let file: toml::Table = toml::from_str(&text).map_err(|error| NotATable(error.to_string()))?;
    let drive = model.force.drive();
    // Only these numbers are coefficients of powers of the drive.
    let parameters = file.get("parameters").and_then(toml::Value::as_table);
    let is_polynomial = parameters.and_then(|table| table.get("dependence")?.as_str()) == Some("polynomial");
    let power = is_polynomial.then_some(drive).flatten();
    let mut all = Vec::new();
    for (key, value) in parameters.into_iter().flatten() {
        flatten(model.force.name(), key, value, &mut Vec::new(), power, &mut all);
    }
    let of = drive_unit(model);
    all.extend(model.effects.as_slice().iter().flat_map(|effect| of_effect(effect, of)));
    all.extend(named_terms(model).flat_map(|(name, term)| of_term(&name, term, of)));
    Ok(all)
}

/// The unit of the model's drive. No effect needs it if the model has none.
fn drive_unit(model: &Model) -> &'static str {
    model.force.drive().map_or("A", DriveKind::unit)
}

/// The terms of `model` with their names, which have a number if there are several.
fn named_terms(model: &Model) -> impl Iterator<Item = (String, &Term)> {
    let terms = model.effects.terms();
    let several = terms.iter().count() > 1;
    let name =
        move |index: usize| if several { format!("{}[{index}]", term::ID) } else { term::ID.to_owned() };
    terms.iter().enumerate().map(move |(index, term)| (name(index), term))
}

/// The equation of each term, after its name.
fn equations(model: &Model) -> Vec<String> {
    let of = drive_unit(model);
    named_terms(model).map(|(name, term)| format!("{name}: {}", term.equation(of))).collect()
}

/// The parameters of `effect`; `of` is the unit of the drive.
fn of_effect(effect: &EffectModel, of: &str) -> Vec<Coefficient> {
    let id = effect.effect().id();
    let parameters = effect.effect().parameters().iter().zip(effect.parameters());
    let coefficient = |(parameter, value): (&Parameter, &f64)| {
        Coefficient::plain(format!("{id}.{}", parameter.name), *value, parameter.unit.symbol().unwrap_or(of))
    };
    parameters.map(coefficient).collect()
}

/// The amount and the parameters of `term`, then the range that it was confirmed in; `of` is the unit of the drive.
fn of_term(name: &str, term: &Term, of: &str) -> Vec<Coefficient> {
    let numbers = term.numbers(of).into_iter();
    let numbers = numbers
        .map(|number| Coefficient::plain(format!("{name}.{}", number.name), number.value, &number.unit));
    let unit = term.argument_unit(of);
    let ends = term.confirmed_in().into_iter().enumerate();
    let range =
        ends.map(|(end, value)| Coefficient::plain(format!("{name}.confirmed_in[{end}]"), value, &unit));
    numbers.chain(range).collect()
}

/// Appends the numbers of `value`, which has the name `key` and lies at the place `indices` of its list.
fn flatten(
    model: &str,
    key: &str,
    value: &toml::Value,
    indices: &mut Vec<usize>,
    power: Option<DriveKind>,
    out: &mut Vec<Coefficient>,
) {
    let number = match value {
        toml::Value::Float(number) => *number,
        toml::Value::Integer(number) => *number as f64,
        toml::Value::Array(items) => {
            for (index, item) in items.iter().enumerate() {
                indices.push(index);
                flatten(model, key, item, indices, power, out);
                indices.pop();
            }
            return;
        }
        // Names, such as the kind of dependence.
        _ => return,
    };
    let place: String = indices.iter().map(|index| format!("[{index}]")).collect();
    // The last index counts the powers of the drive, except in the lists that place the model.
    let exponent = match (power, indices.last()) {
        (Some(drive), Some(exponent)) => Some((drive, *exponent)),
        _ => None,
    };
    out.push(Coefficient {
        name: format!("{key}{place}"),
        symbol: symbols::symbol(model, key, indices),
        value: number,
        unit: symbols::unit(key, exponent),
        standard_error: None,
        bootstrap: None,
    });
}

/// The table in the given format; `notes` say what the errors cover.
#[must_use]
pub fn table(coefficients: &[Coefficient], format: Format, notes: &[String]) -> String {
    let has_errors = coefficients.iter().any(|it| it.standard_error.is_some());
    let has_bootstrap = coefficients.iter().any(|it| it.bootstrap.is_some());
    let mut heads = vec!["name", "symbol", "value", "unit"];
    if has_errors {
        heads.push("standard error");
    }
    if has_bootstrap {
        heads.extend(["bootstrap standard error", "2.5 %", "97.5 %"]);
    }
    let number = |value: Option<f64>| match (value, format) {
        (None, Format::Csv) => String::new(),
        (None, _) => "-".to_owned(),
        (Some(value), Format::Csv) => value.to_string(),
        (Some(value), Format::Latex) => latex_number(value),
        (Some(value), _) => short(value),
    };
    let rows: Vec<Vec<String>> = coefficients
        .iter()
        .map(|it| {
            let mut row = vec![it.name.clone(), it.symbol.clone(), number(Some(it.value)), it.unit.clone()];
            if has_errors {
                row.push(number(it.standard_error));
            }
            if has_bootstrap {
                let spread = it.bootstrap;
                row.push(number(spread.map(|spread| spread.standard_error)));
                row.extend([0, 1].map(|end| number(spread.map(|spread| spread.interval[end]))));
            }
            row
        })
        .collect();
    match format {
        Format::Text => text(&heads, &rows, notes),
        Format::Csv => csv(&heads, &rows, notes),
        Format::Markdown => markdown(&heads, &rows, notes),
        Format::Latex => latex(&heads, &rows, notes),
    }
}

/// Six significant digits.
fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let exponent = value.abs().log10().floor() as i32;
    if (-4..7).contains(&exponent) {
        let decimals = usize::try_from(5 - exponent).unwrap_or(0);
        let text = format!("{value:.decimals$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    } else {
        format!("{value:.5e}")
    }
}

fn latex_number(value: f64) -> String {
    match short(value).split_once('e') {
        Some((mantissa, exponent)) => format!("${mantissa} \\times 10^{{{exponent}}}$"),
        None => format!("${}$", short(value)),
    }
}

fn text(heads: &[&str], rows: &[Vec<String>], notes: &[String]) -> String {
    let plain =
        |(column, cell): (usize, &String)| if column == 1 { plain_symbol(cell) } else { cell.clone() };
    let rows: Vec<Vec<String>> = rows.iter().map(|row| row.iter().enumerate().map(plain).collect()).collect();
    let width = |column: usize| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        cells.chain([heads[column].chars().count()]).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..heads.len()).map(width).collect();
    let line = |cells: Vec<&str>| {
        let padded: Vec<String> = cells
            .iter()
            .zip(&widths)
            .enumerate()
            // Numbers are aligned to the right.
            .map(|(column, (cell, &width))| match column {
                0 | 1 | 3 => format!("{cell:<width$}"),
                _ => format!("{cell:>width$}"),
            })
            .collect();
        padded.join("  ").trim_end().to_owned() + "\n"
    };
    let mut out = line(heads.to_vec());
    out.extend(rows.iter().map(|row| line(row.iter().map(String::as_str).collect())));
    for note in notes {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{note}");
    }
    out
}

fn csv(heads: &[&str], rows: &[Vec<String>], notes: &[String]) -> String {
    let mut out: String = notes.iter().map(|note| format!("# {note}\n")).collect();
    let names: Vec<String> = heads
        .iter()
        .map(|head| match *head {
            "2.5 %" => "bootstrap_low".to_owned(),
            "97.5 %" => "bootstrap_high".to_owned(),
            head => head.replace(' ', "_"),
        })
        .collect();
    out += &(names.join(",") + "\n");
    for row in rows {
        let cells: Vec<String> = row
            .iter()
            .enumerate()
            .map(|(column, cell)| if column == 1 { plain_symbol(cell) } else { cell.clone() })
            .map(|cell| if cell.contains(',') { format!("\"{cell}\"") } else { cell })
            .collect();
        out += &(cells.join(",") + "\n");
    }
    out
}

fn markdown(heads: &[&str], rows: &[Vec<String>], notes: &[String]) -> String {
    let mut out = format!("| {} |\n|{}\n", heads.join(" | "), "---|".repeat(heads.len()));
    for row in rows {
        let cell = |(column, cell): (usize, &String)| match column {
            0 => format!("`{cell}`"),
            1 if !cell.is_empty() => format!("${cell}$"),
            _ => cell.clone(),
        };
        let cells: Vec<String> = row.iter().enumerate().map(cell).collect();
        let _ = writeln!(out, "| {} |", cells.join(" | "));
    }
    for note in notes {
        let _ = writeln!(out, "\n{note}");
    }
    out
}

fn latex(heads: &[&str], rows: &[Vec<String>], notes: &[String]) -> String {
    let mut out: String = notes.iter().map(|note| format!("% {note}\n")).collect();
    let columns: String =
        (0..heads.len()).map(|column| if matches!(column, 0 | 1 | 3) { 'l' } else { 'r' }).collect();
    let heads: Vec<String> = heads.iter().map(|head| head.replace('%', "\\%")).collect();
    let _ =
        writeln!(out, "\\begin{{tabular}}{{{columns}}}\n\\toprule\n{} \\\\\n\\midrule", heads.join(" & "));
    for row in rows {
        let cell = |(column, cell): (usize, &String)| match column {
            0 => format!("\\texttt{{{}}}", cell.replace('_', "\\_")),
            1 if !cell.is_empty() => format!("${cell}$"),
            3 => format!("$\\mathrm{{{}}}$", cell.replace(' ', "\\,")),
            _ => cell.clone(),
        };
        let cells: Vec<String> = row.iter().enumerate().map(cell).collect();
        let _ = writeln!(out, "{} \\\\", cells.join(" & "));
    }
    out + "\\bottomrule\n\\end{tabular}\n"
}

/// A symbol without LaTeX's commands and braces: `\kappa_{2}` is `kappa_2`.
fn plain_symbol(symbol: &str) -> String {
    symbol.chars().filter(|c| !matches!(c, '\\' | '{' | '}')).collect()
}

#[cfg(test)]
mod tests;
