//! Tracking of a demanded force over a whole run: on the model itself, and on the rig, which differs from the model, with or
//! without force feedback.
//!
//! On the **model**, the command of a sample acts at that sample. The remaining error comes from the search, the limits and the
//! damper's range. On the **rig**, the command acts from that sample to the next, through a driver and a coil that lag, on a damper
//! that differs from the model, measured by noisy transducers. The remaining error is what a vehicle would see.
//!
//! ```text
//! tracking error = rms(F - Fd) / rms(Fd)
//! ```

use super::control_law::Demand;
use super::controller::{CurrentCommand, InverseController};
use super::limits::LimitedBy;
use crate::condition::{Conditioning, LowPass, MotionState, VelocitySource};
use crate::effect::{AugmentedState, REFERENCE_TEMP_C};
use crate::error::Error;
use crate::force::Inputs;
use crate::metrics::{ErrorSum, Fit};
use crate::model::Model;
use crate::rig::signal::RATE_HZ;
use crate::rig::{Channels, Motion, Plant, control};
use crate::units::{Metre, MetrePerSecond, Newton, Second};

/// One sample of a tracking run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Time since the first sample.
    pub time: Second,
    /// Displacement that the command was computed from.
    pub displacement: Metre,
    /// Velocity that the command was computed from.
    pub velocity: MetrePerSecond,
    /// The achieved force; on the rig the true force.
    pub achieved: Newton,
    /// The command, with the demanded force.
    pub command: CurrentCommand,
}

/// Tracking figures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Error over all samples with a demand and a motion.
    pub tracking: Option<Fit>,
    /// Error over the samples whose demand is achievable by the model.
    pub achievable: Option<Fit>,
    /// RMS error divided by the RMS demand, all samples.
    pub error: f64,
    /// The same over the samples whose demand is achievable.
    pub error_achievable: f64,
    /// Share of the samples whose demand is not achievable.
    pub infeasible_share: f64,
    /// Samples whose demand would drive the rod but whose current is larger than at the sample before.
    pub dissipative_violations: u64,
    /// Samples at which the rate limit acted.
    pub rate_limited: u64,
    /// Samples at which the search gave the current, because the learned inverse gave none.
    pub substituted: u64,
}

/// Sums of squared errors and squared demands.
#[derive(Default)]
struct Squares {
    errors: ErrorSum,
    demand: f64,
}

impl Squares {
    fn add(&mut self, demand_n: f64, achieved_n: f64) {
        if (demand_n - achieved_n).is_finite() {
            self.errors.add(demand_n, achieved_n);
            self.demand += demand_n * demand_n;
        }
    }

    /// RMS error divided by the RMS demand.
    fn ratio(&self) -> f64 {
        self.errors.fit().map_or(f64::NAN, |fit| fit.rsse_n / (self.demand / fit.samples as f64).sqrt())
    }
}

impl Figures {
    /// The figures of `points`.
    #[must_use]
    pub fn of(points: &[Point]) -> Self {
        let (mut all, mut able) = (Squares::default(), Squares::default());
        let (mut demanded, mut infeasible, mut violations, mut rate_limited) = (0_u64, 0_u64, 0, 0);
        let mut substituted = 0;
        let mut last_a = 0.0;
        for Point { achieved, command, .. } in points {
            if command.limited_by != LimitedBy::Safe {
                demanded += 1;
                all.add(command.requested.get(), achieved.get());
                if command.is_achievable {
                    able.add(command.requested.get(), achieved.get());
                } else {
                    infeasible += 1;
                }
                violations += u64::from(!command.dissipative && command.current.get() > last_a);
                rate_limited += u64::from(command.limited_by == LimitedBy::Rate);
                substituted += u64::from(command.substituted);
            }
            last_a = command.current.get();
        }
        Self {
            tracking: all.errors.fit(),
            achievable: able.errors.fit(),
            error: all.ratio(),
            error_achievable: able.ratio(),
            infeasible_share: infeasible as f64 / (demanded.max(1)) as f64,
            dissipative_violations: violations,
            rate_limited,
            substituted,
        }
    }
}

/// Displacement, demanded force and case temperature, one value per sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Time since the sample before, s; `None` for the first and after a gap.
    pub dt_s: Vec<Option<f64>>,
    /// Displacement, m.
    pub displacement_m: Vec<f64>,
    /// Demanded force, N; NaN without a demand.
    pub force_n: Vec<f64>,
    /// Case temperature, °C; NaN where it is not known, which counts as [`REFERENCE_TEMP_C`].
    pub case_temp_c: Vec<f64>,
}

/// Tracks `trajectory` on `model` itself, with a copy of `controller`, which must belong to that model.
///
/// ```
/// use mr_damper_model::inverse::track::{Figures, Trajectory, on_model};
/// use mr_damper_model::inverse::{InverseController, Limits};
/// use mr_damper_model::preset;
///
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// let controller = InverseController::new(&model, Limits::default())?;
/// // Demand a linear damper of 5000 N s/m while the rod moves by 0.01 m at 2 Hz.
/// let phase = |k: usize| std::f64::consts::TAU * 2.0 * k as f64 / 512.0;
/// let speed_m_s = 0.01 * std::f64::consts::TAU * 2.0;
/// let trajectory = Trajectory {
///     dt_s: (0..1024).map(|k| (k > 0).then_some(1.0 / 512.0)).collect(),
///     displacement_m: (0..1024).map(|k| 0.01 * phase(k).sin()).collect(),
///     force_n: (0..1024).map(|k| 5000.0 * speed_m_s * phase(k).cos()).collect(),
///     case_temp_c: vec![25.0; 1024],
/// };
/// let figures = Figures::of(&on_model(&model, &controller, &trajectory)?);
/// assert!(figures.error_achievable < 0.02, "{figures:?}");
/// assert_eq!((figures.dissipative_violations, figures.rate_limited), (0, 0));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// [`Error::MissingChannel`] for a model that needs measured velocity.
pub fn on_model(
    model: &Model,
    controller: &InverseController,
    trajectory: &Trajectory,
) -> Result<Vec<Point>, Error> {
    let mut controller = *controller;
    let mut conditioner = InputConditioner::new(model)?;
    let damper = model.of_damper();
    let mut state = AugmentedState::default();
    let mut time_s = 0.0;
    let samples = trajectory.dt_s.iter().zip(&trajectory.displacement_m).zip(&trajectory.force_n);
    let samples = samples.zip(&trajectory.case_temp_c);
    let follow = |(((dt_s, displacement_m), force_n), case_temp_c): (((&Option<f64>, &f64), &f64), &f64)| {
        time_s += dt_s.unwrap_or(0.0);
        let inputs = conditioner.see(*dt_s, *displacement_m, *case_temp_c);
        let command = controller.step(&inputs, Demand::Force(*force_n), None);
        let driven = Inputs { drive: command.current.get(), ..inputs };
        let known = inputs.velocity_m_s.is_finite();
        let achieved_n = if known { damper.free_run(&mut state, &driven) } else { None };
        point(time_s, &inputs, achieved_n.unwrap_or(f64::NAN), command)
    };
    Ok(samples.map(follow).collect())
}

/// The virtual rig for tracking.
#[derive(Debug, Clone, Copy)]
pub struct TrackingRig<'a> {
    /// The damper.
    pub plant: &'a Plant,
    /// Its transducers.
    pub channels: &'a Channels,
    /// Seed of their noise.
    pub seed: u64,
    /// True if the controller gets the load cell's force.
    pub feedback: bool,
}

/// Tracks `force_n`, one value per sample of `motion`, on the rig, with a copy of `controller`, which must belong to `model`.
///
/// ```
/// use mr_damper_model::inverse::track::{Figures, TrackingRig, on_rig};
/// use mr_damper_model::inverse::{InverseController, Limits};
/// use mr_damper_model::preset;
/// use mr_damper_model::rig::{Channels, Motion, Plant};
///
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// let controller = InverseController::new(&model, Limits::default())?;
/// // Demand a linear damper of 5000 N s/m while the rod moves by 0.01 m at 2 Hz.
/// let displacement_m = (0..1024).map(|k| 0.01 * (std::f64::consts::TAU * 2.0 * f64::from(k) / 512.0).sin());
/// let motion = Motion::recorded(displacement_m.collect());
/// let force_n: Vec<f64> = motion.velocity_m_s.iter().map(|v| 5000.0 * v).collect();
/// let error = |feedback| {
///     let rig = TrackingRig { plant: &Plant::default(), channels: &Channels::default(), seed: 1, feedback };
///     Ok::<_, mr_damper_model::Error>(Figures::of(&on_rig(&model, &controller, &motion, &force_n, &rig)?).error)
/// };
/// // The plant differs from the model. Measured force corrects a part of that.
/// let (open, closed) = (error(false)?, error(true)?);
/// assert!(closed < open && open < 1.0, "{closed} {open}");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// Those of [`on_model`].
pub fn on_rig(
    model: &Model,
    controller: &InverseController,
    motion: &Motion,
    force_n: &[f64],
    rig: &TrackingRig,
) -> Result<Vec<Point>, Error> {
    let mut controller = *controller;
    let mut conditioner = InputConditioner::new(model)?;
    let mut commands = Vec::with_capacity(force_n.len());
    let response = control(motion, rig.plant, rig.channels, rig.seed, &mut |shown| {
        let inputs = conditioner.see(
            (shown.sample > 0).then_some(1.0 / RATE_HZ),
            shown.displacement_m,
            rig.plant.start_c,
        );
        let demand_n = force_n.get(shown.sample).copied();
        let command =
            controller.step(&inputs, Demand::of_force(demand_n), rig.feedback.then_some(shown.force_n));
        commands.push((inputs, command));
        command.current.get()
    });
    let sample = |(k, ((inputs, command), achieved_n)): (usize, ((Inputs, CurrentCommand), &f64))| {
        point(k as f64 / RATE_HZ, &inputs, *achieved_n, command)
    };
    Ok(commands.into_iter().zip(&response.force_n).enumerate().map(sample).collect())
}

fn point(time_s: f64, inputs: &Inputs, achieved_n: f64, command: CurrentCommand) -> Point {
    Point {
        time: Second(time_s),
        displacement: Metre(inputs.displacement_m),
        velocity: MetrePerSecond(inputs.velocity_m_s),
        achieved: Newton(achieved_n),
        command,
    }
}

/// The displacement path of a model.
struct InputConditioner {
    conditioning: Conditioning,
    low_pass: LowPass,
    state: MotionState,
}

impl InputConditioner {
    fn new(model: &Model) -> Result<Self, Error> {
        model.conditioning.validate()?;
        if model.conditioning.velocity == VelocitySource::Measured {
            return Err(Error::MissingChannel {
                run: "demand".to_owned(),
                channel: "velocity_m_s",
                needed_by: "the model's conditioning (velocity = measured)".to_owned(),
            });
        }
        let conditioning = model.conditioning;
        Ok(Self { conditioning, low_pass: conditioning.low_pass(), state: MotionState::default() })
    }

    fn see(&mut self, dt_s: Option<f64>, displacement_m: f64, case_temp_c: f64) -> Inputs {
        let motion = self.conditioning.step(&self.low_pass, &mut self.state, dt_s, displacement_m, None);
        Inputs {
            dt_s,
            displacement_m: motion.map_or(f64::NAN, |motion| motion.displacement_m),
            velocity_m_s: motion.map_or(f64::NAN, |motion| motion.velocity_m_s),
            acceleration_m_s2: motion.map_or(f64::NAN, |motion| motion.acceleration_m_s2),
            drive: f64::NAN,
            case_temp_c: if case_temp_c.is_finite() { case_temp_c } else { REFERENCE_TEMP_C },
        }
    }
}
