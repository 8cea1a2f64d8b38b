//! Readings of real dampers are not flagged as implausible, and the same readings with an injected fault are.

use crate::measured::folder;
use mr_damper_model::model::{Envelope, Model};
use mr_damper_model::pipeline::{Event, Models, Pipeline, Reasons, Settings};
use mr_damper_model::preset;
use mr_damper_model::sample::{Run, Trace};

/// The plausibility checks of readings, with short names.
const ODD: [(Reasons, &str); 6] = [
    (Reasons::INPUT_RANGE, "range"),
    (Reasons::INPUT_RATE, "rate"),
    (Reasons::SENSOR_STUCK, "stuck"),
    (Reasons::VELOCITY_DISAGREES, "velocity"),
    (Reasons::DRIVE_IMPLAUSIBLE, "drive"),
    (Reasons::NOT_PASSIVE, "passivity"),
];

/// Share of the estimates of `run` that are flagged with each of [`ODD`].
fn odd(run: &Run) -> [f64; ODD.len()] {
    let range = |trace: &Trace| {
        let mut range = None;
        trace.values.iter().for_each(|value| Envelope::widen(&mut range, *value));
        range
    };
    // The checks use only the ranges of the model, so any model with a current input will do, also for runs with a voltage.
    let envelope = Envelope {
        displacement_m: range(&run.displacement_m),
        force_n: run.force_n.as_ref().and_then(range),
        ..Envelope::default()
    };
    let model = Model { envelope, ..preset::load(preset::BEST_FUZZY_TANH).expect("a preset") };
    let mut pipeline = Pipeline::new(Models::alone(model), Settings::default()).expect("a preset runs");
    let (mut all, mut bear) = (0, [0; ODD.len()]);
    for sample in run.samples() {
        pipeline.step(&sample, &mut |event| {
            if let Event::Estimate(estimate) = event {
                all += 1;
                for (count, (reason, _)) in bear.iter_mut().zip(ODD) {
                    *count += u32::from(estimate.reasons.has(reason));
                }
            }
        });
    }
    bear.map(|count| f64::from(count) / f64::from(all))
}

fn text(shares: &[f64; ODD.len()]) -> String {
    let said = ODD.iter().zip(shares).filter(|(_, share)| **share > 0.0);
    said.map(|((_, name), share)| format!("{name} {:.1} %", 100.0 * share)).collect::<Vec<_>>().join(", ")
}

#[test]
#[ignore = "needs the measured runs: set MR_DAMPER_DATA"]
fn readings_of_real_dampers_are_flagged_only_with_a_fault() {
    for name in ["utfsm-mr", "utfpr-mr", "nees-mr"] {
        let runs = folder(name);
        let (mut worst, mut caught) = ([0.0_f64; ODD.len()], [0_usize; 2]);
        for run in &runs {
            let shares = odd(run);
            if shares.iter().any(|share| *share > 0.01) {
                println!("{name}/{}: {}", run.name, text(&shares));
            }
            worst.iter_mut().zip(shares).for_each(|(worst, share)| *worst = worst.max(share));

            let mut turned = run.clone();
            turned.force_n.iter_mut().for_each(|force| force.values.iter_mut().for_each(|f| *f = -*f));
            caught[0] += usize::from(odd(&turned)[5] > 0.3);
            let mut stuck = run.clone();
            stuck.force_n.iter_mut().for_each(|force| {
                let half = force.len() / 2;
                let held = force.values[half];
                force.values[half..].fill(held);
            });
            caught[1] += usize::from(odd(&stuck)[2] > 0.1);
        }
        println!(
            "{name}: {} runs, at most {}; inverted force found in {}, stuck force in {}",
            runs.len(),
            text(&worst),
            caught[0],
            caught[1]
        );
        assert!(worst.iter().all(|share| *share < 0.02), "{name}: {}", text(&worst));
        assert!(caught.iter().all(|count| *count * 10 >= runs.len() * 9), "{name}: {caught:?}");
    }
}
