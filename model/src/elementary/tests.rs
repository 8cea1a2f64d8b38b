use super::*;
use astro_float_num::{BigFloat, Consts, RoundingMode};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Bits of the reference's arithmetic.
const PRECISION: usize = 192;

/// The functions of the reference, which rounds to the nearest number.
struct Reference {
    constants: Consts,
}

impl Reference {
    fn value(&mut self, name: &str, x: f64) -> BigFloat {
        let (big, one) = (BigFloat::from_f64(x, PRECISION), BigFloat::from_f64(1.0, PRECISION));
        let (p, mode, constants) = (PRECISION, RoundingMode::ToEven, &mut self.constants);
        match name {
            "exp" => big.exp(p, mode, constants),
            // With small arguments the difference loses as many bits as they have zeros.
            "exp_m1" => big.exp(p + 128, mode, constants).sub(&one, p, mode),
            "ln" => big.ln(p, mode, constants),
            "ln_1p" => one.add(&big, p + 128, mode).ln(p, mode, constants),
            "atan" => big.atan(p, mode, constants),
            "sin" => big.sin(p, mode, constants),
            "cos" => big.cos(p, mode, constants),
            "tanh" => big.tanh(p, mode, constants),
            _ => unreachable!("{name}"),
        }
    }

    /// Error of `found` in units of the last digit of a number of the size `of`.
    fn error_ulp(&mut self, name: &str, x: f64, found: f64, of: Option<f64>) -> f64 {
        let value = self.value(name, x);
        let off = value.sub(&BigFloat::from_f64(found, PRECISION), PRECISION, RoundingMode::ToEven);
        let size = of.unwrap_or(found).abs().max(f64::MIN_POSITIVE);
        let unit = size.next_up() - size;
        off.to_f64().abs() / unit
    }
}

trait ToF64 {
    fn to_f64(&self) -> f64;
}

impl ToF64 for BigFloat {
    fn to_f64(&self) -> f64 {
        let text = self.to_string();
        text.parse().unwrap_or_else(|_| panic!("{text} is a number"))
    }
}

#[test]
fn errors_are_at_most_what_the_table_says() {
    let mut reference = Reference { constants: Consts::new().expect("constants") };
    let mut random = Pcg64Mcg::seed_from_u64(22);
    // Name, function, sizes of arguments, largest error in ulp.
    type Case = (&'static str, fn(f64) -> f64, &'static [f64], f64);
    let cases: [Case; 8] = [
        ("exp", exp, &[1e-9, 1e-3, 0.02, 0.1, 1.0, 5.0, 30.0, 700.0], 0.6),
        ("exp_m1", exp_m1, &[1e-9, 1e-3, 0.0109, 0.02, 0.1, 1.0, 5.0, 50.0], 2.2),
        ("ln", ln, &[1e-9, 1e-3, 0.02, 0.3, 1.0, 5.0, 30.0, 700.0], 2.0),
        ("ln_1p", ln_1p, &[1e-9, 1e-3, 0.1, 1.0], 2.4),
        ("atan", atan, &[1e-6, 0.05, 0.07, 0.3, 1.0, 2.0, 30.0, 1e12], 1.4),
        ("sin", sin, &[1e-6, 0.7, 1.5, 4.0, 50.0, 1e3, 1e5, 1e6], 2.0),
        ("cos", cos, &[1e-6, 0.7, 1.5, 4.0, 50.0, 1e3, 1e5, 1e6], 2.0),
        ("tanh", tanh, &[1e-6, 0.05, 0.3, 1.0, 2.0, 5.0, 15.0, 30.0], 1.9),
    ];
    for (name, ours, sizes, most_ulp) in cases {
        for k in 0..800 {
            let share = 2.0 * random.random::<f64>() - 1.0;
            let x = match name {
                // Logarithms of numbers of every size, and near 1.
                "ln" if k % 2 == 0 => 1.0 + share * sizes[k / 2 % sizes.len()].min(0.9),
                "ln" => exp(share * sizes[k / 2 % sizes.len()]),
                "ln_1p" => share.abs() * sizes[k % sizes.len()],
                _ => share * sizes[k % sizes.len()],
            };
            // An error of tanh is absolute: in units of the last digit of a number just below 1.
            let of = (name == "tanh").then_some(1.0);
            let error = reference.error_ulp(name, x, ours(x), of);
            assert!(error <= most_ulp, "{name}({x:e}) = {:e} is off by {error} ulp", ours(x));
        }
    }
}

#[test]
fn the_standard_library_agrees_over_all_exponents() {
    let mut random = Pcg64Mcg::seed_from_u64(23);
    let near = |a: f64, b: f64, ulp: f64| a == b || (a - b).abs() <= ulp * (b.abs().next_up() - b.abs());
    for _ in 0..200_000 {
        let x = f64::from_bits(random.random::<u64>() >> 1);
        assert!(near(ln(x), x.ln(), 3.0) || x.is_nan(), "ln({x:e})");
        assert!(near(atan(x), x.atan(), 2.5) || x.is_nan(), "atan({x:e})");
        assert!(atan(-x) == -atan(x) || x.is_nan(), "atan is odd");
        let y = 1500.0 * random.random::<f64>() - 750.0;
        // Below the normal numbers a result has fewer digits.
        assert!(
            near(exp(y), y.exp(), 1.6) || y.exp() < 1e-300 && (exp(y) - y.exp()).abs() < 1e-315,
            "exp({y})"
        );
        assert!(near(exp_m1(y), y.exp_m1(), 4.0), "exp_m1({y})");
    }
}

#[test]
fn limits_are_those_of_the_functions() {
    assert_eq!([709.79, 1e4, f64::INFINITY].map(exp), [f64::INFINITY; 3]);
    assert_eq!([-746.0, -1e4, f64::NEG_INFINITY].map(exp), [0.0; 3]);
    assert!(exp(709.78) < f64::INFINITY && exp(-745.0) > 0.0);
    assert_eq!([0.0, -0.0].map(ln), [f64::NEG_INFINITY; 2]);
    assert!(ln(f64::from_bits(1)) < -744.0 && ln(f64::MAX) > 709.78);
    assert_eq!([1.0, 1.0].map(ln), [0.0; 2]);
    let functions = [exp, exp_m1, ln, ln_1p, atan, sin, cos, tanh, tanh_in_lanes];
    assert!(functions.iter().all(|function| function(f64::NAN).is_nan()));
    assert!([f64::INFINITY, -2.0 * LARGEST_ANGLE].iter().all(|x| sin(*x).is_nan() && cos(*x).is_nan()));
    assert!(ln(-1e-300).is_nan() && ln(f64::NEG_INFINITY).is_nan());
}

#[test]
fn both_hyperbolic_tangents_agree_with_the_library() {
    for (name, ours) in [("tanh", tanh as fn(f64) -> f64), ("tanh_in_lanes", tanh_in_lanes)] {
        for k in -400_000..=400_000 {
            let z = f64::from(k) * 6.1e-5;
            assert!((ours(z) - z.tanh()).abs() < 4e-16, "{name}({z})");
        }
        assert_eq!([1e6, 1e300, f64::INFINITY].map(ours), [1.0; 3], "{name}");
        assert_eq!([-1e6, -1e300, f64::NEG_INFINITY].map(ours), [-1.0; 3], "{name}");
        assert_eq!(ours(0.0), 0.0, "{name}");
    }
}
