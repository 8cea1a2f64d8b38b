//! Time of the derivatives of each law: as this project computes them, and by dual numbers of `num-dual`.
//!
//! ```text
//! cargo test --release -p mr-damper-model --lib cost_of_dual_numbers -- --ignored --nocapture
//! ```
//!
//! The dual numbers carry all derivatives at once, in a vector of fixed size, and have the same fast tanh as the laws. Both run in turns,
//! [`TURNS`] times, over one second of motion. The table shows the median time per sample of each, the median of the ratios with its 95 %
//! interval, and the largest relative difference of a derivative.

use super::jet::Real;
use super::*;
use nalgebra::{Const, U1};
use num_dual::DualSVec64;
use std::hint::black_box;
use std::time::Instant;

/// Number of comparisons.
const TURNS: usize = 400;
/// Ranks of the 95 % interval of a median of [`TURNS`] values: 200 -+ 1.96 sqrt(400)/2.
const INTERVAL: [usize; 2] = [180, 220];
const RATE_HZ: f64 = 512.0;

impl<const N: usize> Scalar for DualSVec64<N> {
    #[inline]
    fn bend(self) -> Self {
        let t = tanh(self.re);
        Self::new(t, self.eps * (1.0 - t * t))
    }
}

impl<const N: usize> Real for DualSVec64<N> {
    #[inline]
    fn re(self) -> f64 {
        self.re
    }

    #[inline]
    fn exp(self) -> Self {
        DualNum::exp(&self)
    }

    #[inline]
    fn ln(self) -> Self {
        DualNum::ln(&self)
    }
}

fn variable<const N: usize>(re: f64, direction: usize) -> DualSVec64<N> {
    DualSVec64::from_re(re).derivative(direction)
}

fn derivatives<const N: usize>(value: DualSVec64<N>) -> [f64; N] {
    value.eps.unwrap_generic(Const::<N>, U1).into()
}

/// [`MemorylessLaw::gradient`] by dual numbers.
#[inline]
fn gradient<L: MemorylessLaw, const N: usize>(p: &[f64], inputs: &Inputs, gradient: &mut [f64]) -> f64 {
    let p: [DualSVec64<N>; N] = std::array::from_fn(|j| variable(p[j], j));
    let force = L::force_n(&p, inputs);
    gradient[..N].copy_from_slice(&derivatives(force));
    force.re
}

/// [`Law::sensitivity`] of the Bouc-Wen law by dual numbers: [`by_jets`] with another number type.
#[inline]
fn bouc_wen_sensitivity(p: &[f64], inputs: &Inputs, hidden: &mut Hidden) -> Sensitivity {
    const COUNT: usize = bouc_wen::COUNT;
    let p: [DualSVec64<{ COUNT + MAX_HIDDEN }>; COUNT] = std::array::from_fn(|j| variable(p[j], j));
    let mut next = std::array::from_fn(|h| variable(hidden[h], COUNT + h));
    let force = bouc_wen::step(&p, inputs, &mut next);
    let mut found = Sensitivity { force_n: force.re, ..Sensitivity::default() };
    let by = derivatives(force);
    found.force_by_parameter[..COUNT].copy_from_slice(&by[..COUNT]);
    found.force_by_hidden.copy_from_slice(&by[COUNT..]);
    for (h, value) in next.into_iter().enumerate() {
        hidden[h] = value.re;
        let by = derivatives(value);
        found.hidden_by_parameter[h][..COUNT].copy_from_slice(&by[..COUNT]);
        found.hidden_by_hidden[h].copy_from_slice(&by[COUNT..]);
    }
    found
}

/// One second of a sine of 15 mm at 2 Hz.
fn motion() -> Vec<Inputs> {
    let omega = std::f64::consts::TAU * 2.0;
    let at = |k: u32| {
        let (sin, cos) = (omega * f64::from(k) / RATE_HZ).sin_cos();
        Inputs {
            dt_s: (k > 0).then_some(1.0 / RATE_HZ),
            displacement_m: 0.015 * sin,
            velocity_m_s: 0.015 * omega * cos,
            acceleration_m_s2: -0.015 * omega * omega * sin,
            drive: f64::NAN,
            case_temp_c: f64::NAN,
        }
    };
    (0..512).map(at).collect()
}

/// All derivatives of a sample.
fn list(found: &Sensitivity) -> Vec<f64> {
    let hidden = [found.hidden_by_parameter.as_flattened(), found.hidden_by_hidden.as_flattened()].concat();
    [&found.force_by_parameter[..], &found.force_by_hidden, &hidden].concat()
}

/// Largest relative difference of a derivative between two ways to compute a sample.
fn difference(motion: &[Inputs], mut ours: impl Sample, mut duals: impl Sample) -> f64 {
    let mut hidden = [Hidden::default(); 2];
    let mut largest = 0.0_f64;
    for inputs in motion {
        let mut found = [Sensitivity::default(); 2];
        ours(inputs, &mut hidden[0], &mut found[0]);
        duals(inputs, &mut hidden[1], &mut found[1]);
        let [ours, duals] = found.each_ref().map(list);
        for (a, b) in ours.iter().zip(&duals).filter(|(a, b)| a != b) {
            largest = largest.max((a - b).abs() / a.abs().max(b.abs()));
        }
    }
    largest
}

/// Computes one sample with its derivatives.
trait Sample: FnMut(&Inputs, &mut Hidden, &mut Sensitivity) {}

impl<F: FnMut(&Inputs, &mut Hidden, &mut Sensitivity)> Sample for F {}

/// Time per sample, ns.
fn time_ns(motion: &[Inputs], mut sample: impl Sample) -> f64 {
    const PASSES: u32 = 4;
    let mut found = Sensitivity::default();
    let begin = Instant::now();
    for _ in 0..PASSES {
        let mut hidden = Hidden::default();
        for inputs in motion {
            sample(black_box(inputs), &mut hidden, &mut found);
            black_box(&found);
        }
    }
    begin.elapsed().as_secs_f64() * 1e9 / (f64::from(PASSES) * motion.len() as f64)
}

/// Prints the line of a law.
fn compare(name: &str, ours: impl Sample + Copy, duals: impl Sample + Copy) {
    let motion = motion();
    let difference = difference(&motion, ours, duals);
    let turn = |turn: usize| {
        if turn.is_multiple_of(2) {
            let ours_ns = time_ns(&motion, ours);
            [ours_ns, time_ns(&motion, duals)]
        } else {
            let duals_ns = time_ns(&motion, duals);
            [time_ns(&motion, ours), duals_ns]
        }
    };
    let turns: Vec<[f64; 2]> = (0..TURNS).map(turn).collect();
    let sorted = |value: fn(&[f64; 2]) -> f64| {
        let mut values: Vec<f64> = turns.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let (ours_ns, duals_ns) = (sorted(|turn| turn[0])[TURNS / 2], sorted(|turn| turn[1])[TURNS / 2]);
    let ratios = sorted(|turn| turn[1] / turn[0]);
    let [low, high] = INTERVAL.map(|rank| ratios[rank]);
    println!(
        "{name:<14}{ours_ns:>8.1}{duals_ns:>8.1}{:>8.2}   {low:.2} to {high:.2}   {difference:.0e}",
        ratios[TURNS / 2]
    );
}

fn compare_memoryless<L: MemorylessLaw, const N: usize>() {
    let values = tests::sensible(ForceLaw::named(L::NAME).expect("a law"), &[0.7; MAX_PARAMETERS]);
    let p = values.as_slice();
    compare(
        L::NAME,
        |inputs, _, found| found.force_n = L::gradient(black_box(p), inputs, &mut found.force_by_parameter),
        |inputs, _, found| {
            found.force_n = gradient::<L, N>(black_box(p), inputs, &mut found.force_by_parameter);
        },
    );
}

fn compare_bouc_wen() {
    let values = tests::sensible(ForceLaw::BoucWen, &[0.7; MAX_PARAMETERS]);
    let p = values.as_slice();
    compare(
        ForceLaw::BoucWen.name(),
        |inputs, hidden, found| *found = bouc_wen::BoucWen::sensitivity(black_box(p), inputs, hidden),
        |inputs, hidden, found| *found = bouc_wen_sensitivity(black_box(p), inputs, hidden),
    );
}

#[test]
#[ignore = "measures time: use a release build"]
fn cost_of_dual_numbers() {
    println!("law           ours, ns   duals   ratio   95 % interval   difference");
    compare_memoryless::<sp::Sp, 5>();
    compare_bouc_wen();
    compare_memoryless::<kwok::Kwok, 5>();
    compare_memoryless::<li::Li, 10>();
    compare_memoryless::<cesmeci_engin::CesmeciEngin, 5>();
    compare_memoryless::<choi::Choi, 14>();
    compare_memoryless::<arctan::Arctan, 5>();
    compare_memoryless::<linear::Linear, 2>();
}
