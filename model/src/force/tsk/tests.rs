use super::*;
use num_dual::{Dual64, DualNum};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const AMPERES: DriveKind = DriveKind::CoilCurrent;

/// The numbers of a model as plain lists, for a reference implementation written directly from the equations.
#[derive(Clone)]
struct Plain<T> {
    shapes: Vec<Shape>,
    sets: Vec<Vec<[T; NUMBERS]>>,
    conclusions: Vec<T>,
}

impl<T: DualNum<Primitive = f64> + Copy> Plain<T> {
    /// Normalised output: products, their sum, and the quotient, without protection against underflow.
    fn output(&self, u: &[f64]) -> T {
        let strength = |i: usize, j: usize| -> T {
            let [a, b, c, d] = self.sets[i][j];
            let last = self.sets[i].len() - 1;
            let u = T::from(u[i]);
            let half_square = |distance: T, sigma: T| distance * distance / (sigma * sigma * T::from(2.0));
            match self.shapes[i] {
                Shape::Gaussian => (-half_square(u - a, b)).exp(),
                Shape::Bell => {
                    // |z|^(2 b) of a base and an exponent that both have a derivative.
                    let z = (u - c) / a;
                    let z = if z.re() < 0.0 { -z } else { z };
                    T::one() / (T::one() + (z.ln() * b * T::from(2.0)).exp())
                }
                Shape::TwoSidedGaussian => {
                    let left = if u.re() <= b.re() { (-half_square(u - b, a)).exp() } else { T::one() };
                    let right = if u.re() >= d.re() { (-half_square(u - d, c)).exp() } else { T::one() };
                    left * right
                }
                Shape::Trapezoid => {
                    let [rise, fall] = [(u - a) / (b - a), (d - u) / (d - c)];
                    let least = if rise.re() < fall.re() { rise } else { fall };
                    positive(if least.re() < 1.0 { least } else { T::one() })
                }
                Shape::Triangle if u.re() <= b.re() => {
                    if j == 0 {
                        T::one()
                    } else {
                        positive((u - a) / (b - a))
                    }
                }
                Shape::Triangle => {
                    if j == last {
                        T::one()
                    } else {
                        positive((c - u) / (c - b))
                    }
                }
            }
        };
        let counts: Vec<usize> = self.sets.iter().map(Vec::len).collect();
        let rules: usize = counts.iter().product();
        let width = self.conclusions.len() / rules;
        let (mut above, mut below) = (T::zero(), T::zero());
        for rule in 0..rules {
            let (mut weight, mut rest) = (T::one(), rule);
            for i in (0..counts.len()).rev() {
                weight *= strength(i, rest % counts[i]);
                rest /= counts[i];
            }
            let conclusion = &self.conclusions[rule * width..(rule + 1) * width];
            let slopes = conclusion[..width - 1].iter().zip(u);
            let f = slopes.fold(conclusion[width - 1], |f, (c, u)| f + *c * T::from(*u));
            above += weight * f;
            below += weight;
        }
        above / below
    }
}

fn positive<T: DualNum<Primitive = f64>>(value: T) -> T {
    if value.re() > 0.0 { value } else { T::zero() }
}

/// A model with random numbers and sets at slightly irregular distances.
fn random_model(counts: &[usize], shape: Shape, order: Order, seed: u64) -> Tsk {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut uniform = |low: f64, high: f64| low + (high - low) * random.random::<f64>();
    let signals = [Signal::Displacement, Signal::Velocity, Signal::Drive(AMPERES)];
    let inputs: Vec<TskInput> = counts
        .iter()
        .zip(signals)
        .map(|(&n, signal)| {
            let peaks: Vec<f64> = (0..n).map(|j| 1.5 * j as f64 - 2.0 + uniform(-0.4, 0.4)).collect();
            let sets: Vec<TskSet> = (0..n)
                .map(|j| match shape {
                    Shape::Gaussian => TskSet::Gaussian { centre: peaks[j], sigma: uniform(0.5, 1.0) },
                    Shape::Triangle => TskSet::Triangle {
                        left: peaks[j] - uniform(1.6, 2.0),
                        peak: peaks[j],
                        right: peaks[j] + uniform(1.6, 2.0),
                    },
                    Shape::Bell => TskSet::Bell {
                        half_width: uniform(0.5, 1.0),
                        exponent: uniform(0.6, 3.0),
                        centre: peaks[j],
                    },
                    // Shoulders and centres in either order; the outer sets reach beyond the inputs of the tests.
                    Shape::Trapezoid => TskSet::Trapezoid {
                        left_foot: peaks[j] - if j == 0 { 90.0 } else { uniform(1.6, 2.0) },
                        left_shoulder: peaks[j] + uniform(-0.5, 0.2),
                        right_shoulder: peaks[j] + uniform(-0.2, 0.5),
                        right_foot: peaks[j] + if j + 1 == n { 90.0 } else { uniform(1.6, 2.0) },
                    },
                    Shape::TwoSidedGaussian => TskSet::TwoSidedGaussian {
                        left_sigma: uniform(0.5, 1.0),
                        left_centre: peaks[j] + uniform(-0.4, 0.4),
                        right_sigma: uniform(0.5, 1.0),
                        right_centre: peaks[j] + uniform(-0.4, 0.4),
                    },
                })
                .collect();
            TskInput::new(signal, uniform(-0.01, 0.01), uniform(0.5, 2.0), &sets).expect("an input")
        })
        .collect();
    let needed = counts.iter().product::<usize>() * order.width(counts.len());
    let conclusions: Vec<f64> = (0..needed).map(|_| uniform(-3.0, 3.0)).collect();
    let output = OutputScale { mean_n: 12.0, std_dev_n: 400.0 };
    Tsk::new(TskKind::Anfis, &inputs, order, &conclusions, output, 7.0).expect("a model")
}

fn plain(model: &Tsk) -> Plain<f64> {
    Plain {
        shapes: model.inputs().iter().map(TskInput::shape).collect(),
        sets: model.inputs().iter().map(|input| input.numbers[..input.len()].to_vec()).collect(),
        conclusions: model.conclusions().to_vec(),
    }
}

fn dual(plain: &Plain<f64>) -> Plain<Dual64> {
    Plain {
        shapes: plain.shapes.clone(),
        sets: plain.sets.iter().map(|s| s.iter().map(|n| n.map(Dual64::from)).collect()).collect(),
        conclusions: plain.conclusions.iter().map(|c| Dual64::from(*c)).collect(),
    }
}

fn at(x: f64, v: f64, i: f64) -> Inputs {
    Inputs {
        dt_s: None,
        displacement_m: x,
        velocity_m_s: v,
        acceleration_m_s2: f64::NAN,
        drive: i,
        case_temp_c: f64::NAN,
    }
}

fn normalised(model: &Tsk, inputs: &Inputs) -> Vec<f64> {
    model.inputs().iter().map(|input| input.normalise(input.signal().of(inputs))).collect()
}

const STRUCTURES: [(&[usize], Shape, Order); 10] = [
    (&[3, 3, 3], Shape::Gaussian, Order::First),
    (&[2, 4, 3], Shape::Gaussian, Order::First),
    (&[5, 5, 5], Shape::Triangle, Order::Constant),
    (&[3, 3], Shape::Gaussian, Order::First),
    (&[4, 3], Shape::Triangle, Order::First),
    (&[5], Shape::Gaussian, Order::Constant),
    (&[3, 2, 4], Shape::Bell, Order::First),
    (&[5, 4], Shape::Bell, Order::Constant),
    (&[3, 3, 2], Shape::Trapezoid, Order::First),
    (&[4, 3], Shape::TwoSidedGaussian, Order::First),
];

proptest! {
    #[test]
    fn force_and_gradient_agree_with_automatic_differentiation(
        structure in 0..STRUCTURES.len(), seed in 0_u64..1000, x in -3.0..3.0, v in -3.0..3.0, i in -3.0..3.0,
    ) {
        let (counts, shape, order) = STRUCTURES[structure];
        let model = random_model(counts, shape, order, seed);
        let inputs = at(x, v, i);
        let u = normalised(&model, &inputs);
        let plain = plain(&model);
        let force_n = 19.0 + 400.0 * plain.output(&u);
        prop_assert!((model.force_n(&inputs) - force_n).abs() < 1e-9 * (1.0 + force_n.abs()));
        let (same, gradient) = model.output_and_gradient_at(&model.raw(&inputs));
        prop_assert!((same - force_n).abs() < 1e-9 * (1.0 + force_n.abs()));

        let dual = dual(&plain);
        let check = |found: f64, seeded: Plain<Dual64>| {
            let expected = 400.0 * seeded.output(&u).eps;
            prop_assert!((found - expected).abs() < 1e-8 * (1.0 + expected.abs()), "{found} {expected}");
            Ok(())
        };
        for (input, sets) in dual.sets.iter().enumerate() {
            for set in 0..sets.len() {
                for number in 0..NUMBERS {
                    let mut seeded = dual.clone();
                    seeded.sets[input][set][number].eps = 1.0;
                    check(gradient.sets[input][set][number], seeded)?;
                }
            }
        }
        for number in 0..dual.conclusions.len() {
            let mut seeded = dual.clone();
            seeded.conclusions[number].eps = 1.0;
            check(gradient.conclusions[number], seeded)?;
        }
    }

    #[test]
    fn weights_are_nonnegative_and_sum_to_one_everywhere(u in proptest::num::f64::NORMAL, seed in 0_u64..50) {
        for shape in Shape::ALL {
            let model = random_model(&[4, 5, 1], shape, Order::Constant, seed);
            for input in model.inputs() {
                let weights = input.weights(u);
                prop_assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)), "{weights:?}");
                prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            }
        }
    }
}

#[test]
fn far_outside_only_the_outermost_set_counts() {
    for shape in [Shape::Gaussian, Shape::Triangle] {
        let mut sets = Vec::new();
        for centre in [-1.0, 0.0, 1.0] {
            sets.push(match shape {
                Shape::Gaussian => TskSet::Gaussian { centre, sigma: 0.4 },
                _ => TskSet::Triangle { left: centre - 1.0, peak: centre, right: centre + 1.0 },
            });
        }
        let input = TskInput::new(Signal::Velocity, 0.0, 1.0, &sets).expect("an input");
        assert_eq!(input.weights(-1e9)[..3], [1.0, 0.0, 0.0]);
        assert_eq!(input.weights(1e300)[..3], [0.0, 0.0, 1.0]);
        assert!(input.weights(f64::NAN).iter().any(|w| w.is_nan()));
    }
}

#[test]
fn in_a_gap_between_triangles_the_nearest_peak_counts() {
    let set = |peak: f64| TskSet::Triangle { left: peak - 0.1, peak, right: peak + 0.1 };
    let input =
        TskInput::new(Signal::Velocity, 0.0, 1.0, &[set(-1.0), set(0.0), set(1.0)]).expect("an input");
    assert_eq!(input.weights(-0.6)[..3], [1.0, 0.0, 0.0]);
    assert_eq!(input.weights(-0.4)[..3], [0.0, 1.0, 0.0]);
    assert_eq!(input.weights(0.05)[..3], [0.0, 1.0, 0.0]);
    assert_eq!(input.fire(0.4).slopes, [[0.0; NUMBERS]; MAX_SETS]);
}

#[test]
fn far_outside_all_bells_the_weights_are_their_limit() {
    let bell = |half_width, exponent, centre| TskSet::Bell { half_width, exponent, centre };
    let input = |sets: &[TskSet]| TskInput::new(Signal::Velocity, 0.0, 1.0, sets).expect("an input");
    // Equal exponents: g -> (a / distance)^(2 b), so the weights are as a^4: 1 to 16.
    let equal = input(&[bell(1.0, 2.0, -1.0), bell(2.0, 2.0, 1.0)]);
    // The smallest exponent falls slowest.
    let unequal = input(&[bell(1.0, 1.0, -1.0), bell(1.0, 2.0, 1.0)]);
    // |z|^(2 b) overflows and all strengths are zero, although the nearer one is by far the larger.
    let steep = input(&[bell(1e-3, 400.0, -1.0), bell(1e-3, 400.0, 1.0)]);
    for u in [-1e300, -1e9, 1e9, 1e300] {
        let weights = equal.weights(u);
        assert!((weights[1] / weights[0] - 16.0).abs() < 1e-3, "{weights:?}");
        assert!(unequal.weights(u)[0] > 1.0 - 1e-9);
    }
    // (9 / 11)^800 = 1.9048e-70
    for (u, far) in [(10.0, 0), (-10.0, 1)] {
        let weights = steep.weights(u);
        assert!(
            (weights[far] / 1.904_844_046_5e-70 - 1.0).abs() < 1e-9 && weights[1 - far] == 1.0,
            "{weights:?}"
        );
    }
    assert_eq!(steep.weights(0.0)[..2], [0.5, 0.5]);
    // The two ways to compute the weights agree where both work: strengths of about 1e-100 on both sides of the limit.
    let both = input(&[bell(1.0, 50.0, 0.0), bell(1.0, 49.0, 0.5)]);
    for u in [9.0, 9.9, 10.1, 11.0, 12.0] {
        let expected = 1.0 / (1.0 + f64::powf(u, 100.0) / f64::powf(u - 0.5, 98.0));
        let found = both.weights(u)[0];
        assert!((found / expected - 1.0).abs() < 1e-9, "{u}: {found} {expected}");
    }
}

#[test]
fn between_and_outside_trapezoids_the_nearest_plateau_counts() {
    let set = |left_foot, left_shoulder, right_shoulder, right_foot| TskSet::Trapezoid {
        left_foot,
        left_shoulder,
        right_shoulder,
        right_foot,
    };
    // The first has vertical sides, the last two cross below one.
    let sets = [set(-3.0, -3.0, -2.0, -2.0), set(-1.0, 0.5, 0.0, 1.5), set(2.0, 3.0, 2.5, 4.0)];
    let input = TskInput::new(Signal::Velocity, 0.0, 1.0, &sets).expect("an input");
    for (u, expected) in [
        (-9.0, [1.0, 0.0, 0.0]),
        (-3.0, [1.0, 0.0, 0.0]),
        (-2.0, [1.0, 0.0, 0.0]),
        (-1.2, [1.0, 0.0, 0.0]),
        (-0.9, [0.0, 1.0, 0.0]),
        (1.6, [0.0, 0.0, 1.0]),
        (1e300, [0.0, 0.0, 1.0]),
    ] {
        assert_eq!(input.weights(u)[..3], expected, "{u}");
    }
}

#[test]
fn a_model_of_atray_has_bells_or_gaussians() {
    let output = OutputScale { mean_n: 0.0, std_dev_n: 1.0 };
    let model = |shape: Shape| {
        let like = random_model(&[3, 2, 4], shape, Order::First, 1);
        Tsk::new(TskKind::Atray, like.inputs(), Order::First, like.conclusions(), output, 0.0)
    };
    // 24 rules of four numbers; nine memberships.
    assert_eq!(model(Shape::Bell).expect("bells").parameter_count(), 96 + 27);
    assert_eq!(model(Shape::Gaussian).expect("Gaussians").parameter_count(), 96 + 18);
    for shape in [Shape::Triangle, Shape::Trapezoid, Shape::TwoSidedGaussian] {
        assert!(model(shape).expect_err("another shape").to_string().contains("do not match tsk-324"));
    }
}

#[test]
fn a_force_is_known_only_when_all_inputs_are() {
    for (counts, shape, order) in STRUCTURES {
        let model = random_model(counts, shape, order, 3);
        assert!(model.force_n(&at(0.1, 0.2, 0.3)).is_finite());
        for broken in [f64::NAN, f64::INFINITY] {
            let known = [broken, 0.2, 0.3];
            assert!(!model.force_n(&at(known[0], known[1], known[2])).is_finite(), "{counts:?} {shape:?}");
        }
        // An input that the model does not use has no effect.
        assert_eq!(model.force_n(&at(0.1, 0.2, f64::NAN)).is_finite(), counts.len() < 3);
    }
}

#[test]
fn errors_name_the_field() {
    let gaussian = |centre, sigma| TskSet::Gaussian { centre, sigma };
    let input = |sets: &[TskSet]| TskInput::new(Signal::Velocity, 0.0, 0.07, sets);
    let message = |sets: &[TskSet]| input(sets).expect_err("no input").to_string();
    assert!(message(&[]).contains("velocity_sets has 0 values"));
    assert!(message(&[gaussian(0.0, 1.0); 6]).contains("velocity_sets has 6 values"));
    assert!(message(&[gaussian(0.0, 1.0), gaussian(1.0, 0.0)]).contains("velocity_sets[1].sigma is 0"));
    assert!(message(&[gaussian(f64::NAN, 1.0)]).contains("velocity_sets[0].centre is NaN"));
    let triangle = |left, peak, right| TskSet::Triangle { left, peak, right };
    assert!(message(&[triangle(0.0, 1.0, 2.0), gaussian(0.0, 1.0)]).contains("another shape"));
    assert!(
        message(&[triangle(0.0, 1.0, 2.0), triangle(0.5, 1.0, 2.0)]).contains("velocity_sets[1].peak is 1")
    );
    assert!(
        message(&[triangle(0.0, 1.0, 1.0), triangle(1.0, 2.0, 3.0)]).contains("velocity_sets[0].right is 1")
    );
    let bell = |half_width, exponent| TskSet::Bell { half_width, exponent, centre: 0.0 };
    assert!(message(&[bell(0.0, 1.0)]).contains("velocity_sets[0].half_width is 0"));
    assert!(message(&[bell(1.0, 0.0)]).contains("velocity_sets[0].exponent is 0"));
    assert!(message(&[bell(1.0, f64::INFINITY)]).contains("velocity_sets[0].exponent is inf"));
    let trapezoid = |n: [f64; 4]| TskSet::of(Shape::Trapezoid, n);
    for (numbers, field) in [
        ([f64::NAN, 1.0, 2.0, 3.0], "left_foot is NaN"),
        ([1.0, 0.5, 2.0, 3.0], "left_shoulder is 0.5"),
        ([0.0, 1.0, 3.5, 3.0], "right_shoulder is 3.5"),
        ([0.0, 0.0, 0.0, 0.0], "right_foot is 0"),
    ] {
        let message = message(&[trapezoid(numbers)]);
        assert!(message.contains(&format!("velocity_sets[0].{field}")), "{message}");
    }
    let two_sided = |n: [f64; 4]| TskSet::of(Shape::TwoSidedGaussian, n);
    assert!(message(&[two_sided([0.0, 1.0, 1.0, 2.0])]).contains("velocity_sets[0].left_sigma is 0"));
    assert!(message(&[two_sided([1.0, 1.0, -1.0, 2.0])]).contains("velocity_sets[0].right_sigma is -1"));
    let scale = TskInput::new(Signal::Drive(AMPERES), 0.0, 0.0, &[gaussian(0.0, 1.0)]);
    assert!(scale.expect_err("no scale").to_string().contains("drive_std_dev_a is 0"));

    let one = input(&[gaussian(0.0, 1.0)]).expect("an input");
    let output = OutputScale { mean_n: 0.0, std_dev_n: 1.0 };
    let model = |inputs: &[TskInput], conclusions: &[f64], kind| {
        Tsk::new(kind, inputs, Order::First, conclusions, output, 0.0).expect_err("no model").to_string()
    };
    assert!(model(&[], &[], TskKind::Anfis).contains("inputs has 0 values"));
    assert!(model(&[one, one], &[0.0; 3], TskKind::Anfis).contains("inputs[1] repeats velocity"));
    assert!(model(&[one], &[0.0; 3], TskKind::Anfis).contains("conclusions has 3 values, but 2"));
    assert!(model(&[one], &[0.0, f64::NAN], TskKind::Anfis).contains("conclusions[1] is NaN"));
    assert!(model(&[one], &[0.0; 2], TskKind::Ahn).contains("do not match tsk-555"));
}

#[test]
fn every_kind_has_a_structure_that_fits() {
    for kind in TskKind::ALL {
        assert_eq!(TskKind::from_name(kind.name()), Some(kind));
        for drive in [None, Some(AMPERES)] {
            let structure = kind.structure(drive);
            assert_eq!(structure.len(), if drive.is_some() { 3 } else { 2 });
            let rules: usize = structure.iter().map(|(_, n)| n).product();
            assert!(rules * kind.order().width(structure.len()) <= MAX_CONCLUSIONS, "{kind:?}");
        }
    }
    assert_eq!(TskKind::from_name("tsk"), None);
}
