//! Turns the tables of `data/` into Rust arrays, which `src/preset/tables.rs` includes.
//!
//! This script checks each table against the columns and rows that it lists here. An error fails the build with the
//! file, the line and the column.

#[path = "build/table.rs"]
mod table;

use std::path::Path;
use table::Shape;

/// The thesis' experiments, in the order of its tables.
const EXPERIMENTS: [&str; 8] =
    ["RP-ICPS", "RP-APRBS", "RP-PRBS", "RP-APRBS-L", "RP-ICPS-L", "RP1-CS", "RP2-CS", "RP3-CS"];
/// The experiments from which the fuzzy-tanh models were identified.
const CONSTANT_CURRENT: [&str; 3] = ["RP1-CS", "RP2-CS", "RP3-CS"];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=build");
    println!("cargo::rerun-if-changed=data");
    let mut code = String::new();
    for (name, shape) in tables() {
        match read(name, &shape) {
            Ok(array) => code += &array,
            Err(message) => println!("cargo::error={message}"),
        }
    }
    let written = std::env::var("OUT_DIR").map_err(|e| e.to_string()).and_then(|folder| {
        std::fs::write(Path::new(&folder).join("tables.rs"), code).map_err(|e| e.to_string())
    });
    if let Err(error) = written {
        println!("cargo::error=cannot write tables.rs to OUT_DIR: {error}");
    }
}

/// Rust code of the table `data/<name>.csv`.
fn read(name: &str, shape: &Shape) -> Result<String, String> {
    let file = format!("data/{name}.csv");
    let text = std::fs::read_to_string(&file).map_err(|error| format!("{file}: {error}"))?;
    let rows = table::parse(&file, &text, shape)?;
    Ok(table::rust(&name.replace('-', "_").to_uppercase(), shape, &rows))
}

/// All tables: the name of the file without its extension, its columns and its rows.
#[rustfmt::skip]
fn tables() -> Vec<(&'static str, Shape)> {
    let experiments = || grid(&[list(&EXPERIMENTS)]);
    let anfis = |functions| grid(&[list(&EXPERIMENTS), functions]);
    let memberships = (1..=3).flat_map(|input| numbered(&format!("in{input}mf"), 3)).collect();
    let passive_and_semi_active =
        || grid(&[list(&["arx", "sp", "p"]), list(&["passive", "semi-active"]), list(&EXPERIMENTS)]);
    let anfis_errors = || grid(&[list(&["anfis"]), list(&["semi-active"]), list(&EXPERIMENTS)]);
    let fuzzy_tanh_errors = grid(&[list(&["fuzzy-tanh"]), list(&["semi-active"]), list(&CONSTANT_CURRENT)]);
    let first_paper = |form, experiments| grid(&[list(&["arx", "sp", "p"]), list(&[form]), numbered("", experiments)]);
    let table = |name, columns: &[&'static str], keys| (name, Shape { columns: columns.to_vec(), keys });
    vec![
        table("arx-passive", &[
            "experiment", "a1", "a2", "a3", "a4 (lbf/in)", "a5 (lbf/in)", "a6 (lbf/in)",
            "a7 (lbf·s/in)", "a8 (lbf·s/in)", "a9 (lbf·s/in)",
        ], experiments()),
        table("arx-semi-active", &[
            "experiment", "a1", "a2", "a3", "a4 (lbf/in)", "a5 (lbf/in)", "a6 (lbf/in)",
            "a7 (lbf·s/in)", "a8 (lbf·s/in)", "a9 (lbf·s/in)", "a10 (lbf/A)", "a11 (lbf/A)", "a12 (lbf/A)",
        ], experiments()),
        table("sp-passive", &["experiment", "A1 (lbf)", "A2 (lbf·s/in)", "A3 (s/in)", "X0", "V0"], experiments()),
        table("sp-semi-active", &[
            "experiment", "A11 (lbf)", "A12 (lbf/A)", "A13 (lbf/A²)",
            "A21 (lbf·s/in)", "A22 (lbf·s/in/A)", "A23 (lbf·s/in/A²)", "A31 (s/in)", "A32 (s/in/A)", "A33 (s/in/A²)",
            "X01", "X02", "X03", "V01", "V02", "V03",
        ], experiments()),
        table("p-passive", &[
            "experiment", "c1 (lbf·s/in)", "c2 (s)", "c3 (s²)", "c4 (lbf^-2)", "c5 (lbf^-4)",
        ], experiments()),
        table("p-semi-active", &[
            "experiment", "c11 (lbf·s/in)", "c12 (lbf·s/in/A)", "c13 (lbf·s/in/A²)",
            "c21 (s)", "c22 (s/A)", "c23 (s/A²)", "c31 (s²)", "c32 (s²/A)", "c33 (s²/A²)",
            "c41 (lbf^-2)", "c42 (lbf^-2/A)", "c43 (lbf^-2/A²)", "c51 (lbf^-4)", "c52 (lbf^-4/A)", "c53 (lbf^-4/A²)",
        ], experiments()),
        table("fuzzy-tanh", &["experiment", "function", "d1 (lbf)", "d2 (lbf·s/in)", "d3 (s/in)", "d4", "d5"],
            grid(&[list(&CONSTANT_CURRENT), numbered("f", 7)])),
        table("anfis-normalisation", &[
            "experiment", "displacement sd (in)", "velocity sd (in/s)", "current sd (A)",
            "current mean (A)", "force sd (lbf)",
        ], experiments()),
        table("anfis-ranges", &[
            "experiment", "displacement min", "displacement max", "velocity min", "velocity max",
            "current min", "current max", "force min", "force max",
        ], experiments()),
        table("anfis-memberships", &["experiment", "function", "sigma", "centre"], anfis(memberships)),
        table("anfis-conclusions", &[
            "experiment", "function", "displacement slope", "velocity slope", "current slope", "constant",
        ], anfis(numbered("out1mf", 27))),
        table("errors-training", &["model", "form", "experiment", "RSSE (lbf)", "ESR"],
            [passive_and_semi_active(), anfis_errors()].concat()),
        table("errors-average", &["model", "form", "experiment", "RSSE (lbf)", "ESR"],
            [passive_and_semi_active(), anfis_errors(), fuzzy_tanh_errors].concat()),
        table("errors-first-paper", &["model", "form", "experiment", "ESR (%)"],
            [first_paper("passive", 10), first_paper("semi-active", 5)].concat()),
        table("errors-second-paper", &["model", "experiment", "ESR"],
            [grid(&[list(&["anfis"]), list(&EXPERIMENTS)]), grid(&[list(&["fuzzy-tanh"]), list(&CONSTANT_CURRENT)])]
                .concat()),
        table("errors-second-paper-pairs", &[
            "trained on", "RP-ICPS", "RP-APRBS", "RP-PRBS", "RP-APRBS-L", "RP-ICPS-L", "RP1-CS", "RP2-CS", "RP3-CS",
        ], experiments()),
    ]
}

fn list(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

/// `prefix1` to `prefix<count>`.
fn numbered(prefix: &str, count: usize) -> Vec<String> {
    (1..=count).map(|k| format!("{prefix}{k}")).collect()
}

/// All combinations of one key from each list; the key from the last list varies fastest.
fn grid(lists: &[Vec<String>]) -> Vec<Vec<String>> {
    lists.iter().fold(vec![vec![]], |rows, list| {
        rows.iter()
            .flat_map(|row| list.iter().map(move |key| [row.as_slice(), std::slice::from_ref(key)].concat()))
            .collect()
    })
}
