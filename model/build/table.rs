//! Reads one table of `data/`: cells between commas, `#` comments, one line with the column names, one line a row.
//!
//! The first columns of a table hold its keys, for example the experiment, and the others hold numbers. A [`Shape`]
//! gives the columns and the keys of each row in their order, so that a swapped column or a lost row is an error.

use std::fmt::Write;

/// The columns and rows that a table must have.
pub(crate) struct Shape {
    /// Names of all columns; the names of the keys come first.
    pub(crate) columns: Vec<&'static str>,
    /// Keys of each row.
    pub(crate) keys: Vec<Vec<String>>,
}

/// The numbers of one row.
type Numbers = Vec<f64>;

/// The numbers of each row in `text`, the content of `file`.
///
/// # Errors
/// A message with the file, the line and the column: names or keys that differ from `shape`, a missing or
/// additional cell or row, a cell that is not a finite number.
pub(crate) fn parse(file: &str, text: &str, shape: &Shape) -> Result<Vec<Numbers>, String> {
    let mut lines = text.lines().enumerate().filter_map(|(index, line)| {
        let content = line.trim();
        (!content.is_empty() && !content.starts_with('#')).then_some((index + 1, content))
    });
    let end = text.lines().count();
    let (line, header) =
        lines.next().ok_or_else(|| format!("{file}:{end}: the line with the column names is missing"))?;
    check_header(header, shape).map_err(|message| format!("{file}:{line}: {message}"))?;
    let rows = shape
        .keys
        .iter()
        .map(|keys| {
            let (line, row) = lines
                .next()
                .ok_or_else(|| format!("{file}:{end}: the row \"{}\" is missing", keys.join(", ")))?;
            read_row(row, keys, shape).map_err(|message| format!("{file}:{line}: {message}"))
        })
        .collect::<Result<_, String>>()?;
    match lines.next() {
        None => Ok(rows),
        Some((line, _)) => {
            Err(format!("{file}:{line}: the table has {} rows; remove this line", shape.keys.len()))
        }
    }
}

/// Rust code of a static array `name`: the keys and the numbers of each row.
pub(crate) fn rust(name: &str, shape: &Shape, rows: &[Numbers]) -> String {
    let keys = shape.keys.first().map_or(0, Vec::len);
    let numbers = shape.columns.len() - keys;
    let mut code = format!("pub(super) static {name}: [Row<{keys}, {numbers}>; {}] = [\n", rows.len());
    for (keys, numbers) in shape.keys.iter().zip(rows) {
        // Both print as Rust literals; the shortest text of a number reads back as the same number. Writing to a
        // string cannot fail.
        let _ = writeln!(code, "    ({keys:?}, {numbers:?}),");
    }
    code + "];\n"
}

fn cells(line: &str) -> Vec<&str> {
    line.split(',').map(str::trim).collect()
}

fn check_header(line: &str, shape: &Shape) -> Result<(), String> {
    let found = cells(line);
    for (index, name) in shape.columns.iter().enumerate() {
        match found.get(index) {
            Some(cell) if cell == name => {}
            Some(cell) => return Err(format!("column {} is \"{cell}\", but must be \"{name}\"", index + 1)),
            None => return Err(format!("column {}, \"{name}\", is missing", index + 1)),
        }
    }
    match found.get(shape.columns.len()) {
        None => Ok(()),
        Some(cell) => Err(format!("column {}, \"{cell}\", is not known", shape.columns.len() + 1)),
    }
}

fn read_row(line: &str, keys: &[String], shape: &Shape) -> Result<Numbers, String> {
    let cells = cells(line);
    if let Some((cell, key)) = cells.iter().zip(keys).find(|(cell, key)| *cell != key) {
        return Err(format!("\"{cell}\" must be \"{key}\"; this table has its rows in a fixed order"));
    }
    if cells.len() != shape.columns.len() {
        return Err(format!(
            "the row has {} cells, but the table has {} columns",
            cells.len(),
            shape.columns.len()
        ));
    }
    let number = |(cell, column): (&&str, &&str)| match cell.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        _ => Err(format!("{column} is \"{cell}\", which is not a finite number such as -1.25 or 2.53E-05")),
    };
    cells.iter().zip(&shape.columns).skip(keys.len()).map(number).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "\
# Two rows.
experiment, a1 (lbf),   a2
RP-ICPS,       1.308, -5E-2

# The second one is doubtful.
RP1-CS,        1.335,  -625
";

    fn shape() -> Shape {
        let keys = ["RP-ICPS", "RP1-CS"].map(|name| vec![name.to_owned()]);
        Shape { columns: vec!["experiment", "a1 (lbf)", "a2"], keys: keys.to_vec() }
    }

    #[test]
    fn rows_become_rust_literals() {
        let rows = parse("t.csv", TEXT, &shape()).expect("a table");
        assert_eq!(rows, [[1.308, -0.05], [1.335, -625.0]]);
        assert_eq!(
            rust("TABLE", &shape(), &rows),
            "pub(super) static TABLE: [Row<1, 2>; 2] = [\n    \
             ([\"RP-ICPS\"], [1.308, -0.05]),\n    ([\"RP1-CS\"], [1.335, -625.0]),\n];\n"
        );
    }

    #[test]
    fn errors_name_file_line_and_column() {
        for (from, to, expected) in [
            ("1.335", "1.3x35", "t.csv:6: a1 (lbf) is \"1.3x35\", which is not a finite number"),
            ("1.335", "inf", "t.csv:6: a1 (lbf) is \"inf\", which is not a finite number"),
            ("-5E-2", "", "t.csv:3: a2 is \"\", which is not a finite number"),
            (", -5E-2", "", "t.csv:3: the row has 2 cells, but the table has 3 columns"),
            ("-5E-2", "-5E-2, 1", "t.csv:3: the row has 4 cells, but the table has 3 columns"),
            ("1.335", "1,335", "t.csv:6: the row has 4 cells, but the table has 3 columns"),
            ("a1 (lbf)", "a1 (N)", "t.csv:2: column 2 is \"a1 (N)\", but must be \"a1 (lbf)\""),
            (",   a2", "", "t.csv:2: column 3, \"a2\", is missing"),
            ("  a2", "  a2, a3", "t.csv:2: column 4, \"a3\", is not known"),
            ("RP-ICPS", "RP1-CS", "t.csv:3: \"RP1-CS\" must be \"RP-ICPS\""),
            ("RP1-CS,        1.335,  -625\n", "", "t.csv:5: the row \"RP1-CS\" is missing"),
            ("-625", "-625\nRP1-CS, 1, 2", "t.csv:7: the table has 2 rows; remove this line"),
            (TEXT, "# Two rows.\n", "t.csv:1: the line with the column names is missing"),
        ] {
            assert!(TEXT.contains(from), "the test must change the table: {from}");
            let message = parse("t.csv", &TEXT.replace(from, to), &shape()).expect_err("a wrong table");
            assert!(message.starts_with(expected), "{to}: {message}");
        }
    }
}
