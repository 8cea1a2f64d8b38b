//! Prints the frames of outputs, for comparisons with other encoders.
//!
//! usage: `cargo run -p mr-damper-runs --example outputs -- FILE.dbc <LINES`
//!
//! Each line has an output as the node's parameter `can.out` names it, a tab, and the 16 hexadecimal digits of a force's double, N. The
//! line for it has the data of the frame in hexadecimal, after `!` if the signal cannot carry the force. Lines with the same output are
//! frames of one sender.

use mr_damper_model::pipeline::Validity;
use mr_damper_runs::Map;
use mr_damper_runs::bus::{FieldValue, OutputField, OutputMapping, OutputMessage, Signals};
use std::collections::HashMap;
use std::error::Error;
use std::io::{BufRead, Write};

fn main() -> Result<(), Box<dyn Error>> {
    let dbc = std::env::args_os().nth(1).ok_or("usage: outputs FILE.dbc <LINES")?;
    let signals = Signals::read(&[dbc.into()])?;
    let none = signals.inputs(&Map::default(), &[])?;
    let mut messages: HashMap<String, OutputMessage> = HashMap::new();
    let mut out = std::io::stdout().lock();
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let (text, digits) = line.split_once('\t').ok_or("a line without a tab")?;
        let force_n = f64::from_bits(u64::from_str_radix(digits, 16)?);
        if !messages.contains_key(text) {
            let mapping: OutputMapping = text.parse()?;
            messages.insert(text.to_owned(), signals.outputs(&[mapping], &none)?.remove(0));
        }
        let Some(message) = messages.get_mut(text) else { continue };
        let mark = if message.can_carry(OutputField::Force, force_n) { "" } else { "!" };
        let data = message.encode(|field| match field {
            OutputField::Force => FieldValue::Number(force_n),
            _ => FieldValue::Code(Validity::Degraded as u64),
        });
        let digits: String = data.iter().map(|byte| format!("{byte:02x}")).collect();
        writeln!(out, "{mark}{digits}")?;
    }
    Ok(())
}
