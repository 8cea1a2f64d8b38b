//! Test vectors: generated readings with everything that goes wrong with sensors and buses, and what the service makes of them.

use mr_damper_model::Error;
use mr_damper_model::condition::VelocitySource;
use mr_damper_model::effect::Need;
use mr_damper_model::inverse::CurrentCommand;
use mr_damper_model::model::{Envelope, Model};
use mr_damper_model::pipeline::{Event, Mode, Models, Pipeline, Reasons, Settings, UseForce};
use mr_damper_model::sample::{Drive, Reading, Sample, Stamp};
use mr_damper_model::units::{Celsius, Metre, MetrePerSecond, Newton};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::fmt::Write as _;

/// Reasons that exported code gives, too.
const SHARED: u32 = Reasons::DRIVE_MISSING.0
    | Reasons::DRIVE_STALE.0
    | Reasons::DISPLACEMENT_GAP.0
    | Reasons::INPUT_REFUSED.0
    | Reasons::OUTSIDE_ENVELOPE.0
    | Reasons::SETTLING.0
    | Reasons::TEMPERATURE_MISSING.0
    | Reasons::INPUT_RANGE.0
    | Reasons::INPUT_RATE.0;

/// The readings of one sample; NaN where there is none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Readings {
    /// Time of the readings, ns.
    pub time_ns: i64,
    /// Displacement, m.
    pub displacement_m: f64,
    /// Drive, A or V.
    pub drive: f64,
    /// Measured velocity, m/s.
    pub velocity_m_s: f64,
    /// Case temperature, degrees Celsius.
    pub case_temp_c: f64,
    /// Requested force, N.
    pub force_request_n: f64,
}

/// The service's result for one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Expected {
    /// False if the displacement was refused.
    pub accepted: bool,
    /// Force of the damper, N; NaN if there is none.
    pub force_n: f64,
    /// Expected reading of the load cell, N; NaN if there is none.
    pub reading_n: f64,
    /// Reasons, as far as exported code gives them.
    pub flags: u32,
}

/// `count` samples at a rate of 500 Hz to 2 kHz for `model`: sums of sines with amplitudes, frequencies and drives that change. Among them
/// are lost samples, gaps, NaN, infinities, readings out of range, jumps of the rod, repeated stamps, and a clock that is set back. The
/// same `seed` gives the same readings. Channels that the model does not take are NaN. If the model has a learned inverse that holds at one
/// rate, the readings have that rate.
#[must_use]
pub fn readings(model: &Model, count: usize, seed: u64) -> Vec<Readings> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let has_drive = model.force.drive().is_some();
    let has_velocity = model.conditioning.velocity == VelocitySource::Measured;
    let has_temperature = model.effects.need(Need::CaseTemperature);
    let mut all = Vec::with_capacity(count);
    let (mut time_ns, mut phase, mut place_m) = (1_000_000_000_i64, 0.0_f64, 0.0);
    // The service corrects stamps that jitter, and exported code only on request, so the period stays the same.
    let drawn_ns = [500_000_i64, 1_000_000, 1_953_125, 2_000_000][random.random_range(0..4)];
    let period_ns = learned_period_ns(model).unwrap_or(drawn_ns);
    // Samples since the last event, and since the last restart.
    let (mut calm, mut settled, mut due) = (0_u32, 0_u32, true);
    let (mut hertz, mut stroke_m, mut level, mut temp_c) = (2.0, 0.01, 1.0, 25.0);
    let chance = |random: &mut Pcg64Mcg, one_in: u32| random.random_range(0..one_in) == 0;
    while all.len() < count {
        due |= all.len() % 2000 == 0;
        if due && (calm > 10 || all.is_empty()) {
            (calm, settled, due) = (0, 0, false);
            hertz = 0.3 * 60.0_f64.powf(random.random::<f64>());
            stroke_m = 0.002 * 12.0_f64.powf(random.random::<f64>());
            temp_c = 20.0 + 60.0 * random.random::<f64>();
        }
        if chance(&mut random, 150) {
            level = if chance(&mut random, 5) { 0.0 } else { 3.0 * random.random::<f64>() };
        }
        let before_ns = time_ns;
        time_ns += period_ns;
        // The service corrects stamps that jitter. Two events within a few samples, or lost samples soon after a restart, can look so.
        (calm, settled) = (calm + 1, settled + 1);
        if chance(&mut random, 300) && calm > 10 {
            // A few lost samples, or a gap.
            if chance(&mut random, 4) {
                time_ns += 400 * period_ns;
                (calm, settled) = (0, 0);
            } else if settled > 60 {
                // With three lost samples, four samples take just as long as the service compares.
                time_ns += period_ns * [1, 2, 4, 5][random.random_range(0..4)];
                calm = 0;
            }
        }
        if chance(&mut random, 4000) && calm > 10 {
            time_ns -= [2_000_000_000, 100_000_000, period_ns][random.random_range(0..3)];
            (calm, settled) = (0, 0);
        }
        if chance(&mut random, 3000) && calm > 10 {
            place_m = 0.03 * (random.random::<f64>() - 0.5);
            (calm, settled) = (0, 0);
        }
        phase += std::f64::consts::TAU * hertz * (time_ns - before_ns).max(0) as f64 * 1e-9;
        // A micrometre of noise: the service compares the stamps with even times by the roughness of the displacement.
        let noise_m = 1e-6 * (random.random::<f64>() - 0.5);
        let mut displacement_m =
            place_m + stroke_m * phase.sin() + 0.1 * stroke_m * (7.3 * phase).sin() + noise_m;
        if chance(&mut random, 400) && calm > 10 {
            calm = 0;
            displacement_m = [f64::NAN, f64::INFINITY, -5.0, displacement_m + 0.4][random.random_range(0..4)];
        }
        let drive = match random.random_range(0..900) {
            _ if !has_drive => f64::NAN,
            0 => [f64::NEG_INFINITY, 5e3][random.random_range(0..2)],
            1..150 => f64::NAN,
            _ => level + 0.02 * (3.1 * phase).sin(),
        };
        let velocity_m_s = if !has_velocity || chance(&mut random, 40) {
            f64::NAN
        } else {
            stroke_m * hertz * 6.2 * phase.cos()
        };
        let case_temp_c =
            if has_temperature && chance(&mut random, 50) { temp_c + phase.sin() } else { f64::NAN };
        let force_request_n = f64::NAN;
        all.push(Readings { time_ns, displacement_m, drive, velocity_m_s, case_temp_c, force_request_n });
    }
    all
}

/// The sample period of the model's learned inverse, ns; `None` without one, for rules, and beyond 50 Hz to 20 kHz.
fn learned_period_ns(model: &Model) -> Option<i64> {
    let period_s = model.inverse?.sample_period()?.get();
    // A cast from float to integer saturates.
    Some((period_s * 1e9).round() as i64).filter(|period_ns| (50_000..=20_000_000).contains(period_ns))
}

/// The command of the service's inverse controller at one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpectedCommand {
    /// The command; `None` before the first request, and if the displacement was refused.
    pub command: Option<CurrentCommand>,
    /// The current after [`SILENCE_NS`] without a displacement, A; `None` where that is not known.
    pub silent_a: Option<f64>,
    /// The current that applies at this sample, A: the command, or the current in silence if the displacement was refused. `None` before
    /// the first command.
    pub applied_a: Option<f64>,
}

/// Time after a sample for which [`ExpectedCommand::silent_a`] holds, ns.
pub const SILENCE_NS: i64 = 300_000_000;

/// `all` with stamps that are late by a varying part of the sample period, up to nine tenths, in stretches with less and more of it. The
/// displacements do not change, as with a driver that samples at even times and stamps late.
#[must_use]
pub fn with_late_stamps(mut all: Vec<Readings>, seed: u64) -> Vec<Readings> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let period_ns = match all.as_slice() {
        [first, second, ..] => (second.time_ns - first.time_ns) as f64,
        _ => return all,
    };
    let mut share = 0.0;
    for (index, reading) in all.iter_mut().enumerate() {
        if index % 700 == 0 {
            share = [0.0, 0.02, 0.3, 0.9][random.random_range(0..4)];
        }
        reading.time_ns += (share * period_ns * random.random::<f64>()) as i64;
    }
    all
}

/// `all` with requested forces, for a damper with forces of up to about `most_n`: mostly along the motion, some against it, some out of
/// range or infinite, and times without a request. The measured current is lost for long times, so that the command takes its place.
#[must_use]
pub fn with_requests(mut all: Vec<Readings>, most_n: f64, seed: u64) -> Vec<Readings> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let (mut damping_n_s_m, mut pauses, mut measures, mut before) = (0.0, false, true, None);
    for (index, own) in all.iter_mut().enumerate() {
        if index % 500 == 0 {
            damping_n_s_m = most_n * 20.0 * random.random::<f64>();
            pauses = random.random_range(0..8) == 0;
            measures = random.random_range(0..3) == 0;
        }
        let speed_m_s = before.map_or(0.0, |(time_ns, from_m): (i64, f64)| {
            (own.displacement_m - from_m) / ((own.time_ns - time_ns).max(1) as f64 * 1e-9)
        });
        before = Some((own.time_ns, own.displacement_m));
        let along_n = (damping_n_s_m * speed_m_s).clamp(-2.0 * most_n, 2.0 * most_n);
        own.force_request_n = match random.random_range(0..200) {
            _ if pauses || index < 50 => f64::NAN,
            0 => [f64::INFINITY, f64::NEG_INFINITY, 3e5, 0.0][random.random_range(0..4)],
            1..20 => f64::NAN,
            20..40 => 2.0 * most_n * (random.random::<f64>() - 0.5),
            _ => along_n,
        };
        if !measures {
            own.drive = f64::NAN;
        }
    }
    all
}

/// As many readings as `count` says, whose time increases, as in a simulation. With `has_lost`, gaps are filled: see [`with_lost_samples`].
#[must_use]
pub fn simulated(model: &Model, count: usize, seed: u64, has_lost: bool) -> Vec<Readings> {
    let mut generated = count;
    loop {
        let all = increasing(readings(model, generated, seed));
        let mut all = if has_lost { with_lost_samples(all) } else { all };
        if all.len() >= count {
            all.truncate(count);
            return all;
        }
        generated += count;
    }
}

/// The readings of `all` with increasing time. Readings that are late are left out. Where the clock is set back, time goes on after a pause
/// of 1 s: without it, the next step would be a part of a period, which the service takes for a stamp that jitters.
#[must_use]
pub fn increasing(mut all: Vec<Readings>) -> Vec<Readings> {
    const PAUSE_NS: i64 = 1_000_000_000;
    let (mut last_ns, mut shift_ns, mut late) = (i64::MIN, 0, 0);
    all.retain_mut(|reading| {
        reading.time_ns += shift_ns;
        if reading.time_ns <= last_ns {
            late += 1;
            if late < 3 {
                return false;
            }
            shift_ns += last_ns + PAUSE_NS - reading.time_ns;
            reading.time_ns = last_ns + PAUSE_NS;
        }
        (last_ns, late) = (reading.time_ns, 0);
        true
    });
    all
}

/// `all` with samples in its gaps, as a simulation steps on while nothing arrives: one in 5 ms, without readings. `all` increases.
#[must_use]
pub fn with_lost_samples(all: Vec<Readings>) -> Vec<Readings> {
    const STEP_NS: i64 = 5_000_000;
    let mut filled: Vec<Readings> = Vec::with_capacity(all.len());
    for own in all {
        let before_ns = filled.last().map_or(own.time_ns, |before| before.time_ns);
        // Shorter gaps are single samples that are lost.
        let lost =
            if own.time_ns - before_ns > 10 * STEP_NS { (own.time_ns - before_ns - 1) / STEP_NS } else { 0 };
        let nothing = f64::NAN;
        filled.extend((1..=lost).map(|k| Readings {
            time_ns: before_ns + k * STEP_NS,
            displacement_m: nothing,
            drive: nothing,
            velocity_m_s: nothing,
            case_temp_c: nothing,
            force_request_n: nothing,
        }));
        filled.push(own);
    }
    filled
}

/// The results of the service's free-run channel for `readings`, with default settings and without measured force.
///
/// # Errors
/// When the model cannot run in a pipeline.
pub fn expected(model: &Model, readings: &[Readings]) -> Result<Vec<Expected>, Error> {
    let all = run(model, Settings::default(), readings, true)?;
    Ok(all.into_iter().map(|(estimate, _)| estimate).collect())
}

/// The estimates and commands of the service for `readings`, with these settings and without measured force. The estimates have no
/// expected reading.
///
/// # Errors
/// When the model cannot run in a pipeline.
pub fn expected_commands(
    model: &Model,
    settings: &Settings,
    readings: &[Readings],
) -> Result<Vec<(Expected, ExpectedCommand)>, Error> {
    run(model, *settings, readings, false)
}

/// Runs the pipeline. The expected reading needs a measured force, from which an inverse controller would learn.
fn run(
    model: &Model,
    settings: Settings,
    readings: &[Readings],
    has_force: bool,
) -> Result<Vec<(Expected, ExpectedCommand)>, Error> {
    // Without bumpless transfer the estimate is the model's force.
    let settings = Settings { use_measured_force: UseForce::Never, bumpless_tau_s: 0.0, ..settings };
    let mut pipeline = Pipeline::new(Models { free: *model, seeded: None }, settings)?;
    // Without a force of the model the service holds the last one, and flags it if it is beyond the training data. The code holds no force.
    let unranged = Model { envelope: Envelope { force_n: None, ..model.envelope }, ..*model };
    let mut holds = match model.envelope.force_n {
        Some(_) => Some(Pipeline::new(Models { free: unranged, seeded: None }, settings)?),
        None => None,
    };
    let drive_kind = model.force.drive();
    let mut all = Vec::with_capacity(readings.len());
    let (mut accepted_ns, mut last_a) = (None, None);
    for r in readings {
        let stamp = Stamp::from_nanos(r.time_ns);
        let given = |value: f64| (!value.is_nan()).then_some(value);
        let channels = [
            drive_kind.zip(given(r.drive)).map(|(kind, value)| Reading::Drive(Drive::new(kind, value))),
            given(r.velocity_m_s).map(|v| Reading::Velocity(MetrePerSecond(v))),
            given(r.case_temp_c).map(|t| Reading::CaseTemperature(Celsius(t))),
            given(r.force_request_n).map(|force_n| Reading::ForceRequest(Newton(force_n))),
            Some(Reading::Displacement(Metre(r.displacement_m))),
            // The expected reading is part of a residual, and a residual needs a measured force.
            has_force.then_some(Reading::Force(Newton(0.0))),
        ];
        let refused = Reasons::INPUT_REFUSED.0;
        let mut own = Expected { accepted: false, force_n: f64::NAN, reading_n: f64::NAN, flags: refused };
        let mut command = None;
        for reading in channels.into_iter().flatten() {
            let sample = Sample { stamp, received: stamp, reading };
            let mut held = None;
            if let Some(holds) = &mut holds {
                holds.step(&sample, &mut |event| {
                    if let Event::Estimate(estimate) = event {
                        held = Some(estimate.reasons);
                    }
                });
            }
            pipeline.step(&sample, &mut |event| match event {
                Event::Estimate(estimate) => {
                    let (force_n, reasons) = match estimate.mode {
                        Mode::Model => (estimate.force.get(), estimate.reasons),
                        _ => (f64::NAN, held.unwrap_or(estimate.reasons)),
                    };
                    own =
                        Expected { accepted: true, force_n, reading_n: f64::NAN, flags: reasons.0 & SHARED };
                }
                Event::Residual(residual) if residual.stamp == stamp => {
                    own.reading_n = residual.predicted.get()
                }
                Event::Command(commanded) => command = Some(commanded.command),
                _ => {}
            });
        }
        let mut silent_a = None;
        if own.accepted {
            accepted_ns = Some(r.time_ns);
        }
        if let Some(command) = &command {
            last_a = Some(command.current.get());
        }
        // A refused displacement is silence. A copy is asked, because a silence longer than a timeout would change the mode.
        let applied_a = match own.accepted {
            true => command.map(|command: CurrentCommand| command.current.get()),
            false => current_in_silence(&mut pipeline.clone(), stamp).or(last_a),
        };
        // A longer silence would change the state.
        if accepted_ns
            .is_some_and(|at_ns| (r.time_ns - at_ns + SILENCE_NS) as f64 * 1e-9 < settings.input_timeout_s)
        {
            silent_a = current_in_silence(&mut pipeline, stamp.shifted(SILENCE_NS)).or(last_a);
        }
        all.push((own, ExpectedCommand { command, silent_a, applied_a }));
    }
    Ok(all)
}

/// The current at `now`, A, if no displacement arrives until then; `None` while the command before holds.
fn current_in_silence(pipeline: &mut Pipeline, now: Stamp) -> Option<f64> {
    let mut current_a = None;
    pipeline.tick(now, &mut |event| {
        if let Event::Command(commanded) = event {
            current_a = Some(commanded.command.current.get());
        }
    });
    current_a
}

/// Test vectors as CSV: the readings, and what the exported code must return, each number exact. An empty cell is NaN.
///
/// # Errors
/// See [`expected`].
pub fn csv(model: &Model, readings: &[Readings]) -> Result<String, Error> {
    let drive = model.force.drive().map_or("drive", |kind| kind.name());
    let mut text =
        format!("time_ns,displacement_m,{drive},velocity_m_s,case_temp_c,accepted,force_n,reading_n,flags\n");
    let cell = |value: f64| if value.is_nan() { String::new() } else { format!("{value:?}") };
    for (r, e) in readings.iter().zip(expected(model, readings)?) {
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{}",
            r.time_ns,
            cell(r.displacement_m),
            cell(r.drive),
            cell(r.velocity_m_s),
            cell(r.case_temp_c),
            u32::from(e.accepted),
            cell(e.force_n),
            cell(e.reading_n),
            e.flags
        );
    }
    Ok(text)
}

/// Test vectors of a model with an inverse controller as CSV: the readings with the requested force, the estimate without the expected
/// reading, the command, and the current that applies: see [`ExpectedCommand::applied_a`]. An empty cell is NaN; the cells of a command
/// are empty if there is none. For a learned inverse the last column is 1 where the search gave the current.
///
/// # Errors
/// See [`expected_commands`].
pub fn csv_with_commands(model: &Model, settings: &Settings, readings: &[Readings]) -> Result<String, Error> {
    let drive = model.force.drive().map_or("drive", |kind| kind.name());
    let is_learned = settings.method.learned().is_some();
    let last = if is_learned { ",is_substituted" } else { "" };
    let mut text = format!(
        "time_ns,displacement_m,{drive},velocity_m_s,case_temp_c,force_request_n,accepted,force_n,flags,command_a,requested_n,expected_n,\
         least_n,most_n,limited_by,is_achievable,is_dissipative,applied_a{last}\n"
    );
    let cell = |value: f64| if value.is_nan() { String::new() } else { format!("{value:?}") };
    for (r, (e, c)) in readings.iter().zip(expected_commands(model, settings, readings)?) {
        let inputs = [r.displacement_m, r.drive, r.velocity_m_s, r.case_temp_c, r.force_request_n].map(cell);
        let command = c.command.map_or(",,,,,,,".to_owned(), |command| {
            let [least, most] = command.achievable;
            let forces = [command.requested, command.expected, least, most];
            let truths = [command.is_achievable, command.dissipative].map(u32::from);
            format!(
                "{},{},{},{},{}",
                cell(command.current.get()),
                forces.map(|force| cell(force.get())).join(","),
                command.limited_by as u8,
                truths[0],
                truths[1]
            )
        });
        let substituted = match c.command {
            _ if !is_learned => "",
            None => ",",
            Some(command) if command.substituted => ",1",
            Some(_) => ",0",
        };
        let _ = writeln!(
            text,
            "{},{},{},{},{},{command},{}{substituted}",
            r.time_ns,
            inputs.join(","),
            u32::from(e.accepted),
            cell(e.force_n),
            e.flags,
            c.applied_a.map_or(String::new(), cell)
        );
    }
    Ok(text)
}
