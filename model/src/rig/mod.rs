//! The virtual rig: a simulated test bench that records runs like a real one.
//!
//! ```text
//! experiment -> set point, current command -> servo -> plant -> force, driver's current, temperature
//!                                                             -> measurement chain -> Run
//! ```
//!
//! The demo replays such a run. Tests of identification and diagnosis use hundreds of them, because only here is the truth known.
//! Such a test is meaningful only if the truth is not the model under test: an effect found with the function that injected it, or a
//! model fitted to its own output, would pass in spite of any fault. Nothing in this folder therefore uses the models, effects,
//! conditioning or identification of this crate, and the plant is not one of the thesis' models. It is the modified Bouc-Wen damper of
//! Spencer et al. with a compliance, a coil lag and a temperature, integrated as differential equations. Its parameters depend on the
//! current by smooth functions, not by fuzzy sets. For tests that need a truth that a model can follow down to the noise, so that only
//! the injected effect remains, the plant has a second, quasi-static valve ([`quasi_static`]); it is as smooth in the current. A third valve
//! with bristles ([`bristle`]), and the second with a fluid that shear thins, are dampers that no model fits exactly.
//!
//! The rig has no side effects and is repeatable: on one machine, runs with the same seed are bit-identical. On other machines the last
//! bits may differ, because the standard library's `sin`, `cos`, `exp`, `tanh`, `ln` and `powf` may.

pub mod bristle;
pub mod channel;
pub mod current;
pub mod experiment;
pub mod inject;
mod integrate;
mod noise;
pub mod plant;
pub mod quasi_static;
pub mod replicate;
pub mod response;
pub mod second_order;
pub mod signal;
pub mod undeclared;
pub mod wave;

pub use bristle::Bristle;
pub use channel::Channels;
pub use current::Current;
pub use experiment::Experiment;
pub use plant::{Plant, ValveForm};
pub use quasi_static::QuasiStatic;
pub use replicate::{Drift, Pattern};
pub use second_order::SecondOrder;
pub use signal::{Displacement, Motion, Road};
pub use wave::Wave;

use crate::sample::{DriveKind, Run, Stamp, Trace};
use channel::{Sensor, filtered};
use noise::{Purpose, stream};
use rand_pcg::Pcg64Mcg;

/// Time from sample to sample, ns: 1/512 s is a whole number of nanoseconds.
const PERIOD_NS: i64 = 1_953_125;

/// Temperatures are logged once in this many samples (4 Hz), because case and room change slowly.
const CASE_EVERY: usize = 128;

/// Runs `experiment` on `plant`, measured by `channels`, and returns the recording, at 512 Hz from stamp zero.
///
/// Displacement is relative, with zero mean. The drive is the driver's measured coil current, which does not show the coil lag.
/// Velocity is logged if the channels have a transducer for it, the set point if the experiment has a servo (`setpoint_m`, without
/// noise), and the room temperature if the channels have a thermocouple for it (`ambient_temp_c`). All random numbers follow from
/// `seed`: the same arguments give the same run, and runs that differ only in `plant` or `channels` have the same excitation. A plant
/// that fails [`Plant::check`] may give forces that are not finite.
#[must_use]
pub fn record(experiment: &Experiment, plant: &Plant, channels: &Channels, seed: u64) -> Run {
    record_while(experiment, plant, channels, seed, &mut |_| true).unwrap_or_default()
}

/// Measurements of one sample, as a controller gets them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// Number of the sample, from 0, at 512 Hz.
    pub sample: usize,
    /// Reading of the displacement transducer, m.
    pub displacement_m: f64,
    /// Reading of the load cell, N.
    pub force_n: f64,
}

/// Moves `plant` by `motion` with the current from `controller`, which returns for each sample the current until the next one, in
/// amperes. Its measurements have the noise, quantisation and offsets of `channels`. The filters and delays of the channels, and the
/// plant's inertia, mount resonance, force loss and force lag, are left out, because they are computed over whole runs. Starts at rest
/// without current.
///
/// ```
/// use mr_damper_model::rig::response::Response;
/// use mr_damper_model::rig::{Channels, Motion, Plant, Shown, control};
///
/// let displacement_m = (0..1024).map(|k| 0.01 * (std::f64::consts::TAU * 2.0 * f64::from(k) / 512.0).sin());
/// let motion = Motion::recorded(displacement_m.collect());
/// // 1 A while the rod is extended, no current while it is compressed
/// let mut on_off = |shown: &Shown| if shown.displacement_m > 0.0 { 1.0 } else { 0.0 };
/// let Response { force_n, .. } = control(&motion, &Plant::default(), &Channels::PERFECT, 1, &mut on_off);
/// let largest_n = |samples: std::ops::Range<usize>| force_n[samples].iter().fold(0.0_f64, |most, n| most.max(n.abs()));
/// assert!(largest_n(544..608) > 2.0 * largest_n(672..736), "a half period each");
/// ```
#[must_use]
pub fn control(
    motion: &Motion,
    plant: &Plant,
    channels: &Channels,
    seed: u64,
    controller: &mut dyn FnMut(&Shown) -> f64,
) -> response::Response {
    let sensor = |noise, step, offset| Sensor { noise, step, offset };
    let transducer = sensor(channels.displacement_noise_m, channels.displacement_step_m, 0.0);
    let cell = sensor(channels.force_noise_n, channels.force_step_n, channels.force_offset_n);
    let mut noise_m = stream(seed, Purpose::DisplacementNoise);
    let mut noise_n = stream(seed, Purpose::ForceNoise);
    let samples = motion.displacement_m.len();
    plant.respond_to(motion, samples, 0.0, plant::SUB_STEPS, &mut |sample, force_n| {
        let displacement_m = transducer.read(motion.displacement_m[sample], &mut noise_m);
        let force_n = cell.read(force_n, &mut noise_n);
        Some(controller(&Shown { sample, displacement_m, force_n }))
    })
}

/// As [`record`], but calls `go_on` once per second of the run, with the seconds done (0 while the excitation is computed), and returns
/// `None` as soon as it returns false.
///
/// ```
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record_while};
///
/// let experiment = Experiment::sine(0.01, 2.0, 1.2, 20.0);
/// let mut record = |most_s: f64| {
///     record_while(&experiment, &Plant::default(), &Channels::default(), 1, &mut |done_s| done_s < most_s)
/// };
/// assert!(record(5.0).is_none(), "cancelled after 5 s of the run");
/// assert_eq!(record(100.0).expect("it runs to its end").displacement_m.len(), 20 * 512);
/// ```
pub fn record_while(
    experiment: &Experiment,
    plant: &Plant,
    channels: &Channels,
    seed: u64,
    go_on: &mut dyn FnMut(f64) -> bool,
) -> Option<Run> {
    let samples = experiment.samples();
    let pattern = experiment.pattern.unwrap_or(seed);
    let rng = &mut stream(pattern, Purpose::Displacement);
    let set = experiment.displacement.motion_while(samples, rng, &mut || go_on(0.0))?;
    let command_a = experiment.current.command_a(samples, &mut stream(pattern, Purpose::Current));
    let (motion, set_point) = match experiment.servo {
        Some(servo) => (servo.follow(&set), Some(set)),
        None => (set, None),
    };
    let name = format!("rig {} seed {seed}", experiment.name);
    let mut run = play_while(&motion, &command_a, plant, channels, seed, go_on)?;
    if let Some(set) = set_point {
        // The set point is a command, not a measurement, so it has no noise.
        let exact = Sensor { noise: 0.0, step: 0.0, offset: 0.0 };
        let trace = measured(&set.displacement_m, 1, exact, stream(seed, Purpose::DisplacementNoise));
        run.other.insert(0, ("setpoint_m".to_owned(), trace));
    }
    Some(Run { name, ..run })
}

/// Plays `motion` with the current `command_a`, one value for each sample at 512 Hz, on `plant`, and returns the recording by `channels`.
/// Calls `go_on` as [`record_while`] does. Missing values of the command repeat the last one.
///
/// ```
/// use mr_damper_model::rig::{Channels, Motion, Plant, play_while};
///
/// let displacement_m = (0..1024).map(|k| 0.01 * (std::f64::consts::TAU * 2.0 * f64::from(k) / 512.0).sin());
/// let motion = Motion::recorded(displacement_m.collect());
/// let run = play_while(&motion, &[1.2; 1024], &Plant::default(), &Channels::PERFECT, 1, &mut |_| true).expect("it runs to its end");
/// assert_eq!(run.displacement_m.values, motion.displacement_m);
/// let force_n = &run.force_n.expect("the rig has a load cell").values;
/// assert!(force_n.iter().any(|n| n.abs() > 200.0));
/// ```
pub fn play_while(
    motion: &Motion,
    command_a: &[f64],
    plant: &Plant,
    channels: &Channels,
    seed: u64,
    go_on: &mut dyn FnMut(f64) -> bool,
) -> Option<Run> {
    let samples = motion.displacement_m.len();
    let mut command_a = command_a.to_vec();
    command_a.resize(samples, command_a.last().copied().unwrap_or(0.0));
    let response = plant.respond_while(motion, &command_a, plant::SUB_STEPS, go_on)?;

    let displacement =
        Sensor { noise: channels.displacement_noise_m, step: channels.displacement_step_m, offset: 0.0 };
    let current = Sensor { noise: channels.current_noise_a, step: channels.current_step_a, offset: 0.0 };
    let force = Sensor {
        noise: channels.force_noise_n,
        step: channels.force_step_n,
        offset: channels.force_offset_n,
    };
    let case = Sensor { noise: channels.case_noise_k, step: channels.case_step_k, offset: 0.0 };
    let trace = |values: &[f64], every: usize, sensor: Sensor, purpose: Purpose| {
        measured(values, every, sensor, stream(seed, purpose))
    };
    let mut other = Vec::new();
    if channels.ambient {
        let room = vec![plant.ambient_c; samples];
        other.push(("ambient_temp_c".to_owned(), trace(&room, CASE_EVERY, case, Purpose::AmbientNoise)));
    }
    let velocity = channels.velocity_noise_m_s.map(|noise| {
        let sensor = Sensor { noise, step: 0.0, offset: 0.0 };
        trace(&motion.velocity_m_s, 1, sensor, Purpose::VelocityNoise)
    });
    let x = filtered(motion.displacement_m.clone(), channels.displacement_filter);
    let i = filtered(response.driver_a, channels.current_filter);
    let f = channels.force_signal(response.force_n);
    Some(Run {
        name: format!("rig seed {seed}"),
        displacement_m: trace(&x, 1, displacement, Purpose::DisplacementNoise),
        velocity_m_s: velocity,
        drive: Some((DriveKind::CoilCurrent, trace(&i, 1, current, Purpose::CurrentNoise))),
        force_n: Some(trace(&f, 1, force, Purpose::ForceNoise)),
        case_temp_c: Some(trace(&response.temperature_c, CASE_EVERY, case, Purpose::CaseNoise)),
        other,
        ..Run::default()
    })
}

/// One channel as logged: every `every`-th value, with the errors of the sensor.
fn measured(values: &[f64], every: usize, sensor: Sensor, mut noise: Pcg64Mcg) -> Trace {
    let mut trace = Trace::default();
    for (k, value) in values.iter().enumerate().step_by(every) {
        trace.stamps.push(Stamp::from_nanos(k as i64 * PERIOD_NS));
        trace.values.push(sensor.read(*value, &mut noise));
    }
    trace
}

#[cfg(test)]
mod tests;
