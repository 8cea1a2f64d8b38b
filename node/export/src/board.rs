//! Programs for Cortex-M processors on QEMU's MPS2 boards, and the instructions that a step takes there.
//!
//! QEMU lets each instruction take 32 ns of the board's time (`-icount shift=5`). The timer of the processor, SysTick, counts steps of 40 ns.
//! So a program counts its own instructions: [`driver`](crate::driver::driver), compiled with `-DTICKS`.

use std::fmt;

/// A processor, and how to compile and run for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Processor {
    /// Its name.
    pub name: &'static str,
    /// Options of `arm-none-eabi-gcc`.
    pub options: &'static [&'static str],
    /// QEMU's name for a board with it.
    pub machine: &'static str,
}

impl Processor {
    /// Without an FPU.
    pub const M3: Self =
        Self { name: "Cortex-M3", options: &["-mcpu=cortex-m3", "-mthumb"], machine: "mps2-an385" };
    /// With an FPU for single precision.
    pub const M4F: Self = Self {
        name: "Cortex-M4F",
        options: &["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"],
        machine: "mps2-an386",
    };
    /// With an FPU for single and double precision.
    pub const M7: Self = Self {
        name: "Cortex-M7",
        options: &["-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-d16"],
        machine: "mps2-an500",
    };

    /// Options of `qemu-system-arm` that run `program`. It reads and writes files of this machine, in the current folder.
    #[must_use]
    pub const fn qemu(self, program: &str) -> [&str; 11] {
        let files = "enable=on,target=native";
        [
            "-M",
            self.machine,
            "-nographic",
            "-monitor",
            "none",
            "-serial",
            "none",
            "-semihosting-config",
            files,
            "-kernel",
            program,
        ]
    }
}

/// More options of `qemu-system-arm`, with which the timer counts instructions.
pub const COUNTED: [&str; 2] = ["-icount", "shift=5"];

/// Options of the linker: the script [`LINK`] in the file `link.ld`, and files of this machine for the C library (newlib).
pub const LINKED: [&str; 3] = ["--specs=rdimon.specs", "-T", "link.ld"];

/// A C file with the vector table and the start, which switches the FPU on before the C library starts.
pub const START: &str = "#include <stdint.h>
extern void _start(void);
void reset(void) {
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20;
    __asm volatile(\"dsb\\n isb\");
    _start();
    for (;;) {
    }
}
__attribute__((section(\".vectors\"), used)) const uintptr_t vectors[2] = { 0x20400000u, (uintptr_t)reset };
";

/// The linker script: code from address 0, data from 0x20000000, which is the memory of these boards.
pub const LINK: &str =
    "MEMORY { code (rx) : ORIGIN = 0, LENGTH = 4M  data (rwx) : ORIGIN = 0x20000000, LENGTH = 4M }
ENTRY(reset)
SECTIONS {
    .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) *(.init) *(.fini) *(.eh_frame*) } > code
    .ARM.exidx : { *(.ARM.exidx*) } > code
    __data_load = LOADADDR(.data);
    .data : { *(.data*) } > data
    .bss (NOLOAD) : { __bss_start__ = .; *(.bss*) *(COMMON) __bss_end__ = .; end = .; __end__ = .; } > data
    __stack = 0x20400000;
}
";

/// Instructions of a step, with the routines of the compiler's library.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Instructions {
    /// Mean over the readings that the code accepted.
    pub mean: u64,
    /// The most of any reading.
    pub most: u64,
}

impl fmt::Display for Instructions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} instructions a step, at most {}", self.mean, self.most)
    }
}

impl Instructions {
    /// Instructions from what the driver writes with `-DTICKS`; `None` if it accepted nothing, or if a step took more than the timer holds
    /// (20 million instructions).
    #[must_use]
    pub fn of(written: &[u8]) -> Option<Self> {
        // An instruction takes 32 ns, a tick 40 ns.
        let instructions = |ticks: u64| (ticks * 40 + 16) / 32;
        let (mut sum, mut accepted, mut most) = (0, 0, 0);
        for word in written.as_chunks::<4>().0 {
            let word = u64::from(u32::from_le_bytes(*word));
            let ticks = word & 0x00FF_FFFF;
            if word & WRAPPED != 0 {
                return None;
            }
            most = most.max(ticks);
            if word & ACCEPTED != 0 {
                sum += ticks;
                accepted += 1;
            }
        }
        (accepted > 0).then(|| Self { mean: instructions(sum) / accepted, most: instructions(most) })
    }
}

/// Bits above the 24 of the timer.
const ACCEPTED: u64 = 1 << 31;
const WRAPPED: u64 = 1 << 30;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_become_instructions() {
        let written = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
        let accepted = 1 << 31;
        // 8 ticks are 10 instructions; a refused reading does not count towards the mean.
        let found = Instructions::of(&written(&[accepted | 8, accepted | 24, 80]));
        assert_eq!(found, Some(Instructions { mean: 20, most: 100 }));
        assert_eq!(Instructions::of(&written(&[640])), None, "nothing was accepted");
        assert_eq!(Instructions::of(&written(&[accepted | 64, accepted | 1 << 30])), None, "too long");
    }
}
