//! Cost of one step, including the worst case: of a command, and of a complete sample of the pipeline with
//! commands.
//!
//! ```text
//! cargo run --release -p mr-damper-model --example step_cost                 # times of 10^6 single steps
//! model/examples/step_cost.sh                                                # instructions per step, by valgrind
//! ```
//!
//! Times are for this machine. Each step is timed in five bit-identical passes, and the minimum is used: the
//! worst of a million is then a long step, not one that was preempted. The step "nothing" shows the cost of
//! timing itself. Instructions are the difference between two run lengths, and do not depend on the machine.

#[path = "../benches/learned/mod.rs"]
mod learned;
#[path = "../benches/subject/mod.rs"]
mod subject;

use mr_damper_model::force::{FreeRun, Inputs};
use mr_damper_model::inverse::{Demand, InverseController, Limits, Method};
use mr_damper_model::preset;
use std::hint::black_box;
use std::process::ExitCode;
use std::time::Instant;
use subject::{PIPELINES, PRESETS};

const RATE_HZ: f64 = 512.0;
/// Number of passes in which each step is timed.
const PASSES: usize = 5;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        [] => times(1_000_000),
        ["list"] => all().iter().for_each(|what| println!("{what}")),
        [what, count] if count.parse::<u64>().is_ok() => {
            let count = count.parse().unwrap_or_default();
            let Some(mut step) = step(what) else {
                eprintln!("{what} is unknown; choose one of {}", all().join(", "));
                return ExitCode::from(2);
            };
            for k in 0..count {
                step(k);
            }
        }
        _ => {
            eprintln!("usage: step_cost [WHAT COUNT]     WHAT: {}", all().join(", "));
            return ExitCode::from(2);
        }
    }
    ExitCode::SUCCESS
}

/// All steps: nothing, a command by each method, models of the thesis, the whole pipeline.
fn all() -> Vec<&'static str> {
    ["nothing"].into_iter().chain(METHODS).chain(PRESETS).chain(PIPELINES).collect()
}

/// Methods to find the current for a demanded force.
const METHODS: [&str; 6] = ["search", "polynomial", "fuzzy", "chen", "wang-liao", "wang-hu"];

/// A road of three sines, and a changing demanded force that sometimes exceeds the damper's range.
fn inputs(k: u64) -> (Inputs, f64) {
    let t = k as f64 / RATE_HZ;
    let [a, b, c] = [9.0, 31.0, 57.0].map(|omega: f64| omega * t);
    let velocity_m_s = 0.072 * a.cos() + 0.062 * b.cos() + 0.03 * c.cos();
    let inputs = Inputs {
        dt_s: (k > 0).then_some(1.0 / RATE_HZ),
        displacement_m: 0.008 * a.sin() + 0.002 * b.sin() + 0.03 / 57.0 * c.sin(),
        velocity_m_s,
        acceleration_m_s2: -0.65 * a.sin() - 1.9 * b.sin() - 1.7 * c.sin(),
        drive: f64::NAN,
        case_temp_c: f64::NAN,
    };
    let share = 0.5 + 0.7 * (4.4 * t).sin();
    (inputs, share * (700.0 * (20.0 * velocity_m_s).tanh() + 1500.0 * velocity_m_s))
}

/// The step `what`; `None` for an unknown name.
#[expect(clippy::expect_used, reason = "presets always run; an example may panic otherwise")]
fn step(what: &str) -> Option<Box<dyn FnMut(u64)>> {
    if what == "nothing" {
        return Some(Box::new(|k| {
            black_box(inputs(k));
        }));
    }
    if let Some(method) = Method::named(what).filter(|_| METHODS.contains(&what)) {
        let model = preset::load(preset::BEST_FUZZY_TANH).expect("a preset");
        let model = method.learned().map_or(model, |kind| learned::with_learned(model, kind));
        let mut controller = InverseController::with_method(&model, Limits::default(), method)
            .expect("a model with an inverse");
        return Some(Box::new(move |k| {
            let (inputs, demand_n) = inputs(k);
            black_box(controller.step(&inputs, Demand::Force(demand_n), None));
        }));
    }
    if PRESETS.contains(&what) {
        let (force, mut state) = (preset::load(what).expect("a preset").force, FreeRun::default());
        return Some(Box::new(move |k| {
            black_box(force.free_run(&mut state, &inputs(k).0));
        }));
    }
    let name = PIPELINES.into_iter().find(|name| *name == what)?;
    let mut pipeline = subject::pipeline(name);
    Some(Box::new(move |k| {
        for sample in subject::instant(name, k) {
            pipeline.step(&sample, &mut |event| {
                black_box(event);
            });
        }
    }))
}

/// Prints the distribution of single steps.
fn times(count: u64) {
    println!("{count} steps, minimum of {PASSES}, ns        median       99 %    99.99 %      worst");
    for what in all() {
        let mut ns = vec![u32::MAX; usize::try_from(count).unwrap_or_default()];
        for _ in 0..PASSES {
            let Some(mut step) = step(what) else { continue };
            for (k, least) in (0..count).zip(&mut ns) {
                let begin = Instant::now();
                step(k);
                *least = (*least).min(u32::try_from(begin.elapsed().as_nanos()).unwrap_or(u32::MAX));
            }
        }
        ns.sort_unstable();
        let at = |share: f64| ns[((ns.len() - 1) as f64 * share) as usize];
        println!("  {what:<32}{:>12}{:>11}{:>11}{:>11}", at(0.5), at(0.99), at(0.9999), at(1.0));
    }
}
