//! A C program around an export that reads readings and writes what the code returns, both as bits. With it a host compares the code with
//! the service.
//!
//! | direction | bytes of each sample |
//! |---|---|
//! | read | time in ns; displacement, drive, velocity, case temperature, requested force |
//! | written | accepted, flags; force, expected reading |
//! | written with an inverse, after these | `limited_by`, truths; current, requested, expected, least and largest force, current after a silence |
//!
//! Words are `uint32_t`, the time is `int64_t`, and numbers are `double`, also around code in single precision.
//!
//! With `-DTICKS`, on a Cortex-M processor, it writes one word for each sample instead. Its low bits count the ticks of the processor's timer
//! during the step. Bit 30 is set if the timer ran out, and bit 31 if the reading was accepted.

use crate::source::CSource;
use crate::vectors::{Expected, Readings, SILENCE_NS};
use std::fmt::Write as _;

/// `driver.c` for the files of `source`. It reads from stdin and writes to stdout; with `-DFILES`, from `in.bin` to `out.bin`.
///
/// ```
/// use mr_damper_export::{CExport, driver::driver};
/// use mr_damper_model::preset;
///
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// let source = CExport::new("damper", &model).source().expect("it is exported");
/// assert!(driver(&source).contains("damper_step(&damper_default_parameters, &state, &in, &out)"));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[must_use]
pub fn driver(source: &CSource) -> String {
    let name = &source.name;
    let mut fields = String::new();
    if let Some(kind) = source.drive {
        let _ = writeln!(fields, "        in.{} = (real)given[1];", kind.name());
    }
    if source.needs_velocity {
        fields += "        in.velocity_m_s = (real)given[2];\n";
    }
    if source.needs_temperature {
        fields += "        in.case_temp_c = (real)given[3];\n";
    }
    let mut commands = String::new();
    if source.has_inverse {
        fields += "        in.force_request_n = (real)given[4];\n";
        let substituted = if source.has_learned_inverse { " | (out.is_substituted ? 8U : 0U)" } else { "" };
        commands = format!(
            "        {{
            const double numbers[6] = {{ (double)out.current_a, (double)out.requested_n, (double)out.expected_n,
                (double)out.achievable_n[0], (double)out.achievable_n[1], (double){name}_silent_current_a(&{name}_default_parameters, &state, time_ns + INT64_C({SILENCE_NS})) }};
            words[0] = out.limited_by;
            words[1] = (out.is_commanded ? 1U : 0U) | (out.is_achievable ? 2U : 0U) | (out.is_dissipative ? 4U : 0U){substituted};
            fwrite(words, sizeof words, 1, to);
            fwrite(numbers, sizeof numbers, 1, to);
        }}
"
        );
    }
    format!(
        "#include <stdio.h>
#include \"{name}.h\"
typedef {real} real;
#ifdef TICKS
/* SysTick counts 24 bits down: control and status, value after 0, value. */
#define SYSTICK ((volatile uint32_t *)0xE000E010U)
#endif
int main(void) {{
    static {name}_state state;
    int64_t time_ns;
    double given[5];
#ifdef FILES
    FILE *from = fopen(\"in.bin\", \"rb\"), *to = fopen(\"out.bin\", \"wb\");
#else
    FILE *from = stdin, *to = stdout;
#endif
#ifdef TICKS
    SYSTICK[1] = 0xFFFFFFU;
    SYSTICK[0] = 5U;
#endif
    while (fread(&time_ns, sizeof time_ns, 1, from) == 1 && fread(given, sizeof given, 1, from) == 1) {{
        {name}_input in;
        {name}_output out;
        uint32_t words[2];
        in.time_ns = time_ns;
        in.displacement_m = (real)given[0];
{fields}#ifdef TICKS
        SYSTICK[2] = 0U;
        while (SYSTICK[2] == 0U) {{
        }}
        words[0] = SYSTICK[2];
        words[1] = {name}_step(&{name}_default_parameters, &state, &in, &out) ? (1U << 31) : 0U;
        words[0] = (words[0] - SYSTICK[2]) & 0xFFFFFFU;
        words[0] |= words[1] | ((SYSTICK[0] & (1U << 16)) != 0U ? (1U << 30) : 0U);
        fwrite(words, sizeof words[0], 1, to);
#else
        double forces[2];
        words[0] = {name}_step(&{name}_default_parameters, &state, &in, &out) ? 1U : 0U;
        words[1] = out.flags;
        fwrite(words, sizeof words, 1, to);
        forces[0] = (double)out.force_n;
        forces[1] = (double)out.reading_n;
        fwrite(forces, sizeof forces, 1, to);
{commands}#endif
    }}
    fclose(to);
    return 0;
}}
",
        real = source.precision.c_type()
    )
}

/// The readings as the driver reads them.
#[must_use]
pub fn bytes(readings: &[Readings]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(48 * readings.len());
    for r in readings {
        bytes.extend(r.time_ns.to_le_bytes());
        for value in [r.displacement_m, r.drive, r.velocity_m_s, r.case_temp_c, r.force_request_n] {
            bytes.extend(value.to_le_bytes());
        }
    }
    bytes
}

/// Bytes that the driver of `source` writes for each sample.
#[must_use]
pub const fn size(source: &CSource) -> usize {
    if source.has_inverse { 80 } else { 24 }
}

/// The driver's result for one sample; `None` if `bytes` has fewer than its 24 bytes.
#[must_use]
pub fn parse(bytes: &[u8]) -> Option<Expected> {
    let (&[accepted, flags], _) = bytes.as_chunks::<4>().0.split_first_chunk::<2>()?;
    let number = |at: usize| bytes.get(at..)?.first_chunk().map(|bytes| f64::from_le_bytes(*bytes));
    Some(Expected {
        accepted: u32::from_le_bytes(accepted) == 1,
        force_n: number(8)?,
        reading_n: number(16)?,
        flags: u32::from_le_bytes(flags),
    })
}
