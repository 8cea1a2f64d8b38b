//! Runs with the force of a known model, for tests of identification.

pub(crate) mod peers;

use mr_damper_model::force::{FuzzySets, FuzzyTanh, History, Inputs, Membership, TanhFunction};
use mr_damper_model::sample::{DriveKind, Run, Stamp, Trace};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Parameters of a generated run. Times are in s, forces in N.
#[derive(Clone, Copy)]
pub(crate) struct Recipe<'a> {
    pub(crate) name: &'a str,
    pub(crate) rate_hz: f64,
    pub(crate) duration_s: f64,
    /// Drive as a function of time.
    pub(crate) drive: fn(f64) -> f64,
    pub(crate) offset_n: f64,
    /// Half width of the uniform noise on force.
    pub(crate) noise_n: f64,
    pub(crate) seed: u64,
}

impl Default for Recipe<'_> {
    fn default() -> Self {
        Self {
            name: "run",
            rate_hz: 500.0,
            duration_s: 8.0,
            drive: |_| 0.5,
            offset_n: 0.0,
            noise_n: 0.0,
            seed: 1,
        }
    }
}

/// Displacement and velocity: four sines whose phases follow from the seed.
fn motion(t: f64, seed: u64) -> (f64, f64) {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    [(0.008, 5.0), (0.003, 13.1), (0.0012, 31.3), (0.0004, 60.7)].iter().fold((0.0, 0.0), |(x, v), (a, w)| {
        let phase = random.random::<f64>() * std::f64::consts::TAU;
        (x + a * (w * t + phase).sin(), v + a * w * (w * t + phase).cos())
    })
}

/// A run with the force `force(x, v, i)` plus offset and noise, and with its exact velocity.
pub(crate) fn run(recipe: Recipe, kind: DriveKind, force: impl Fn(f64, f64, f64) -> f64) -> Run {
    let period_ns = (1e9 / recipe.rate_hz).round() as i64;
    let mut noise = Pcg64Mcg::seed_from_u64(recipe.seed ^ 0xabcd);
    let mut made: [Trace; 4] = Default::default();
    for k in 0..(recipe.duration_s * recipe.rate_hz) as i64 {
        let stamp = Stamp::from_nanos(k * period_ns);
        let t = (k * period_ns) as f64 * 1e-9;
        let ((x, v), i) = (motion(t, recipe.seed), (recipe.drive)(t));
        let f = force(x, v, i) + recipe.offset_n + recipe.noise_n * (2.0 * noise.random::<f64>() - 1.0);
        for (trace, value) in made.iter_mut().zip([x, v, i, f]) {
            trace.stamps.push(stamp);
            trace.values.push(value);
        }
    }
    let [displacement_m, velocity, drive, force] = made;
    Run {
        name: recipe.name.to_owned(),
        displacement_m,
        velocity_m_s: Some(velocity),
        drive: Some((kind, drive)),
        force_n: Some(force),
        ..Run::default()
    }
}

/// A run with the force that `predict` computes from the run's own past, driven by noise of half width `noise_n`, plus the recipe's
/// offset.
pub(crate) fn fed_run(
    noise_n: f64,
    recipe: Recipe,
    kind: DriveKind,
    predict: impl Fn(&History) -> Option<f64>,
) -> Run {
    let mut made = run(recipe, kind, |_, _, _| 0.0);
    let mut noise = Pcg64Mcg::seed_from_u64(recipe.seed);
    let mut history = History::default();
    let (velocity, drive) = (made.velocity_m_s.clone().expect("made"), made.drive.clone().expect("made").1);
    let force = made.force_n.as_mut().expect("made");
    for k in 0..force.len() {
        history.push_inputs(&Inputs {
            dt_s: None,
            acceleration_m_s2: f64::NAN,
            displacement_m: made.displacement_m.values[k],
            velocity_m_s: velocity.values[k],
            drive: drive.values[k],
            case_temp_c: f64::NAN,
        });
        let f = predict(&history).unwrap_or(0.0) + noise_n * (2.0 * noise.random::<f64>() - 1.0);
        history.push_force(f);
        force.values[k] = f + recipe.offset_n;
    }
    made
}

/// A tanh function with this yield force, damping, slope and coupling.
pub(crate) fn tanh_function(a1: f64, a2: f64, a3: f64, kappa: f64) -> TanhFunction {
    TanhFunction {
        yield_force_n: a1,
        post_yield_damping_n_s_m: a2,
        pre_yield_slope_s_m: a3,
        coupling_per_s: kappa,
    }
}

/// A damper with three levels, 0, .5 and 1 (A or V).
pub(crate) fn truth(kind: DriveKind) -> FuzzyTanh {
    let functions = [
        tanh_function(90.0, 500.0, 60.0, -0.6),
        tanh_function(400.0, 900.0, 45.0, -1.2),
        tanh_function(800.0, 1100.0, 38.0, 0.8),
    ];
    let sets = FuzzySets::new(Membership { drive: kind, sigma: 0.25 }, &[0.0, 0.5, 1.0]).expect("sets");
    FuzzyTanh::new(sets, &functions, 0.0).expect("a model")
}
