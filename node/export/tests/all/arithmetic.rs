//! Arithmetic of doubles on Cortex-M processors under QEMU: the bits of this machine, which rounds to the nearest.

use crate::back_to_back::samples;
use crate::cortex::{PROCESSORS, on_board};
use mr_damper_export::arm::{SUM, SUM_FILE, SUM_LINKED};
use mr_damper_export::board::Processor;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const OPERATIONS: [&str; 6] = ["sum", "difference", "product", "quotient", "conversion", "comparison"];

/// A significand: random, with few bits, with few zeros, or with two groups of bits.
fn significand(random: &mut Pcg64Mcg) -> u64 {
    let bits: u64 = random.random();
    let few = 1_u64 << random.random_range(0..52) | 1 << random.random_range(0..52);
    let own = match random.random_range(0..4) {
        0 => bits,
        1 => few,
        2 => !few,
        _ => bits << random.random_range(0..52),
    };
    own & ((1 << 52) - 1)
}

/// Pairs of numbers whose exponents are up to 70 apart, some below the normal numbers, and some that are zero, infinite or none.
fn pairs(count: usize) -> Vec<[f64; 2]> {
    let mut random = Pcg64Mcg::seed_from_u64(754);
    let number = |random: &mut Pcg64Mcg, exponent: u64| {
        let sign = u64::from(random.random::<bool>()) << 63;
        f64::from_bits(sign | exponent << 52 | significand(random))
    };
    let special = [0.0, -0.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN, f64::MIN_POSITIVE, f64::MAX, 1.0];
    let one = |random: &mut Pcg64Mcg| {
        let near = random.random_range(0..2047_u64);
        let far = (near + random.random_range(0..141)).saturating_sub(70).min(2046);
        let mut pair = [number(random, near), number(random, far)];
        if random.random_range(0..100) == 0 {
            pair[random.random_range(0..2)] = special[random.random_range(0..special.len())];
        }
        pair
    };
    (0..count).map(|_| one(&mut random)).collect()
}

/// What `arithmetic.c` computes.
fn results([a, b]: [f64; 2]) -> [f64; 6] {
    let truths = [a < b, a <= b, a > b, a >= b, a == b];
    let compared: u32 = truths.iter().enumerate().map(|(place, truth)| u32::from(*truth) << place).sum();
    [a + b, a - b, a * b, a / b, a.to_bits() as i64 as f64, f64::from(compared)]
}

/// Numbers of wrong results of each operation, and the first of them.
fn wrong(processor: Processor, all: &[[f64; 2]], options: &[&str]) -> ([usize; 6], Option<String>) {
    let dir = tempfile::tempdir().expect("a directory");
    std::fs::write(dir.path().join("arithmetic.c"), include_str!("arithmetic.c")).expect("written");
    std::fs::write(dir.path().join(SUM_FILE), SUM).expect("written");
    let given: Vec<u8> = all.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
    std::fs::write(dir.path().join("in.bin"), given).expect("written");
    let found = on_board(dir.path(), processor, &["arithmetic.c"], options, &[]);
    let (found, []) = found.as_chunks::<8>() else { panic!("it wrote half a number") };
    let (found, []) = found.as_chunks::<6>() else { panic!("it wrote half a result") };
    assert_eq!(found.len(), all.len());
    let (mut counts, mut first) = ([0; 6], None);
    for (pair, found) in all.iter().zip(found) {
        for (operation, (ours, theirs)) in results(*pair).iter().zip(found).enumerate() {
            let theirs = f64::from_le_bytes(*theirs);
            if ours.to_bits() != theirs.to_bits() && !(ours.is_nan() && theirs.is_nan()) {
                counts[operation] += 1;
                first.get_or_insert_with(|| {
                    format!("{} of {pair:?}: {theirs:e}, not {ours:e}", OPERATIONS[operation])
                });
            }
        }
    }
    (counts, first)
}

#[test]
#[ignore = "needs gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm"]
fn arithmetic_is_rounded_to_the_nearest() {
    let all = pairs(samples(200_000));
    for processor in PROCESSORS {
        let (counts, first) = wrong(processor, &all, &["-O2", SUM_FILE, SUM_LINKED]);
        assert_eq!(counts, [0; 6], "{}: {first:?}", processor.name);
    }
}

#[test]
#[ignore = "needs gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm"]
fn the_compilers_sums_are_not_always_the_nearest() {
    let all = pairs(200_000);
    for processor in PROCESSORS {
        let (counts, first) = wrong(processor, &all, &["-O2"]);
        let [sums, differences, others @ ..] = counts;
        println!("{}: {sums} sums and {differences} differences of {}; {first:?}", processor.name, all.len());
        assert_eq!(others, [0; 4], "{}", processor.name);
        // If a newer compiler has mended them, the file that is linked is not needed any more.
        assert_eq!(sums > 0 && differences > 0, processor != Processor::M7, "{}", processor.name);
    }
}
