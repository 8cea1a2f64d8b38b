//! Measures the mean number of windows between alarms about changed values of effects, on generated runs of a damper that does not change
//! and whose base the model does not have.
//!
//! ```text
//! cargo run --release -p mr-damper-model --example change_alarms -- [WINDOWS [SEED]]
//! ```
//!
//! `WINDOWS` is the number of windows of each schedule (1000 if it is not given). Each window is a run of its own. The bound is 75 windows for
//! all values together: the ratio of the forces and two effects. One of them is in the damper: its coil lags. The other is not: the damper
//! has no friction, and what its base lacks decides the estimate alone.

use mr_damper_model::effect::{Effect, Effects};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::Settings;
use mr_damper_model::preset;
use mr_damper_model::rig::{Channels, Current, Displacement, Experiment, Plant, record};
use mr_damper_model::sample::{Sample, Stamp};
use mr_damper_model::tracking::{EffectTracker, Quantity, TrackingSettings};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::error::Error;

const WINDOW_S: f64 = 48.0;
/// Bound of the mean number of windows between false alarms, of all values together.
const BOUND: f64 = 75.0;

/// How the excitation changes from window to window.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Schedule {
    /// Never.
    Same,
    /// Stroke, frequency and current change after 5 to 30 windows.
    Stages,
    /// They change with each window.
    Each,
}

fn excitation(random: &mut Pcg64Mcg) -> Experiment {
    let mut experiment = Experiment::thesis("RP-APRBS").expect("an experiment of the thesis");
    if let Displacement::Road(road) = &mut experiment.displacement {
        road.span_m = road.span_m.map(|span_m| span_m * random.random_range(0.3..1.0));
        road.f_max_hz *= random.random_range(0.5..1.2);
    }
    if let Current::Aprbs { high_a, mean_a, deviation_a, .. } = &mut experiment.current {
        let factor = random.random_range(0.3..1.0);
        *high_a *= factor;
        *mean_a *= factor;
        *deviation_a *= factor;
    }
    experiment
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    let windows: u32 = words.next().map_or(Ok(1000), |word| word.parse())?;
    let seed: u64 = words.next().map_or(Ok(1), |word| word.parse())?;
    println!("schedule  value       windows  alarms  windows per alarm (at least {})", 3.0 * BOUND);
    for schedule in [Schedule::Same, Schedule::Stages, Schedule::Each] {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let effects = [Effect::CoilLag, Effect::Friction].map(Effect::example);
        let model = Model { effects: Effects::new(&effects)?, ..preset::load(preset::BEST_FUZZY_TANH)? };
        let tracking = TrackingSettings { window_s: WINDOW_S, false_alarm_interval_s: BOUND * WINDOW_S };
        let mut tracker = EffectTracker::new(&model, &Settings::default(), &tracking)?;
        let mut experiment = Experiment::thesis("RP-APRBS").expect("an experiment of the thesis");
        let (mut left, mut at_s) = (0_u32, 0.0);
        let mut counts = [[0_u32; 2]; 3];
        for _ in 0..windows {
            let ended = left == 0 && schedule == Schedule::Stages;
            if ended || schedule == Schedule::Each {
                experiment = excitation(&mut random);
                left = random.random_range(5..30);
            }
            left = left.saturating_sub(1);
            let run = record(
                &experiment.clone().with_duration_s(WINDOW_S + 1.5),
                &Plant::default(),
                &Channels::default().with_ambient(),
                random.random(),
            );
            let mut begin = None;
            for sample in run.samples() {
                let begin = *begin.get_or_insert(sample.stamp);
                let stamp = Stamp::from_nanos(((at_s + sample.stamp.since(begin).get()) * 1e9) as i64);
                tracker.step(&Sample { stamp, ..sample }, &mut |value| {
                    // The number of windows begins again at a change.
                    let changed = value.changed && value.windows == 0;
                    let [values, alarms] = &mut counts[place(value.quantity)];
                    (*values, *alarms) = (*values + 1, *alarms + u32::from(changed));
                });
            }
            at_s += 2.0 * WINDOW_S;
        }
        for (name, [values, alarms]) in ["force_ratio", "tau_s", "friction_n"].into_iter().zip(counts) {
            let per_alarm = f64::from(values) / f64::from(alarms);
            println!("{:8}  {name:11}  {values:7}  {alarms:6}  {per_alarm:.0}", format!("{schedule:?}"));
        }
    }
    Ok(())
}

fn place(quantity: Quantity) -> usize {
    match quantity.effect() {
        None => 0,
        Some(Effect::CoilLag) => 1,
        Some(_) => 2,
    }
}
