//! The virtual rig: a made-up test bench that writes runs as a measured one would.
//!
//! ```text
//! experiment -> set point, current command -> servo -> plant -> force, driver's current, temperature
//!                                                             -> measurement chain -> Run
//! ```
//!
//! The demo replays such a run, and tests of identification and diagnosis use them by the hundred, because
//! only here is the truth known. That proves something only when the truth is not the model under test: an
//! effect that is found with the very function that put it in, or a model that is fitted to its own output,
//! would pass whatever its faults. So nothing in this folder uses the models, the effects, the conditioning
//! or the identification of this crate, and the plant is none of the thesis' models: it is the modified
//! Bouc-Wen damper of Spencer et al. with a compliance, a lag of the coil and a temperature, integrated as
//! differential equations, and its current enters smoothly and not by fuzzy sets. Where a test needs a truth that a
//! model can follow to the noise, so that one effect alone is left over, the plant has another valve, which is
//! quasi-static ([`quasi_static`]); its current enters as smoothly.
//!
//! Pure and repeatable: one seed gives one run, on the same machine to the last bit. Other machines may
//! differ in the last bits of the standard library's `sin`, `cos`, `exp`, `tanh`, `ln` and `powf`.

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
pub mod wave;

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

/// Nanoseconds from sample to sample: 1/512 s is a whole number of them.
const PERIOD_NS: i64 = 1_953_125;

/// Temperatures are logged once in this many samples (4 Hz): neither case nor room changes faster.
const CASE_EVERY: usize = 128;

/// Runs `experiment` on `plant`, measured by `channels`, and returns the recording, at 512 Hz from stamp
/// zero.
///
/// Displacement is relative, with zero mean; the drive is the driver's measured coil current, which knows
/// nothing of the coil's lag. Velocity is logged when the channels have a transducer for it. An experiment with a servo logs the set point too (`setpoint_m`, without noise),
/// and channels with a room thermocouple its reading (`ambient_temp_c`). Everything random follows from `seed`: the same arguments give the same run,
/// and runs that differ in `plant` or `channels` alone have the same excitation. A plant that fails
/// [`Plant::check`] may give forces that are not finite.
#[must_use]
pub fn record(experiment: &Experiment, plant: &Plant, channels: &Channels, seed: u64) -> Run {
    record_while(experiment, plant, channels, seed, &mut |_| true).unwrap_or_default()
}

/// What a controller is shown of the rig at a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// Number of the sample, from 0, at 512 Hz.
    pub sample: usize,
    /// What the displacement transducer reads, m.
    pub displacement_m: f64,
    /// What the load cell reads, N.
    pub force_n: f64,
}

/// Moves `plant` by `motion` while `controller` says the current, in amperes: at each sample that until the next one. What it is
/// shown has the noise, steps and offsets of `channels`; their filters and delays, and the plant's inertia, loss and lag of force,
/// which are made of whole runs, are left out. Begins at rest without current.
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

/// As [`record`], but asks `go_on` once a second of the run, with the seconds done (0 while the excitation is
/// made), and gives up with `None` when it says no.
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
    let response = plant.respond_while(&motion, &command_a, plant::SUB_STEPS, go_on)?;

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
    if let Some(set) = set_point {
        // A command, not a measurement: as the supervisor sent it.
        let exact = Sensor { noise: 0.0, step: 0.0, offset: 0.0 };
        other.push((
            "setpoint_m".to_owned(),
            trace(&set.displacement_m, 1, exact, Purpose::DisplacementNoise),
        ));
    }
    if channels.ambient {
        let room = vec![plant.ambient_c; samples];
        other.push(("ambient_temp_c".to_owned(), trace(&room, CASE_EVERY, case, Purpose::AmbientNoise)));
    }
    let velocity = channels.velocity_noise_m_s.map(|noise| {
        let sensor = Sensor { noise, step: 0.0, offset: 0.0 };
        trace(&motion.velocity_m_s, 1, sensor, Purpose::VelocityNoise)
    });
    let x = filtered(motion.displacement_m, channels.displacement_filter);
    let i = filtered(response.driver_a, channels.current_filter);
    let f = channels.force_signal(response.force_n);
    Some(Run {
        name: format!("rig {} seed {seed}", experiment.name),
        displacement_m: trace(&x, 1, displacement, Purpose::DisplacementNoise),
        velocity_m_s: velocity,
        drive: Some((DriveKind::CoilCurrent, trace(&i, 1, current, Purpose::CurrentNoise))),
        force_n: Some(trace(&f, 1, force, Purpose::ForceNoise)),
        case_temp_c: Some(trace(&response.temperature_c, CASE_EVERY, case, Purpose::CaseNoise)),
        other,
        ..Run::default()
    })
}

/// One channel as logged: every `every`-th value, as the sensor reads it.
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
