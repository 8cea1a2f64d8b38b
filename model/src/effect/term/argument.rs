//! Arguments: the signal that the curve of a term is a function of.
//!
//! | argument q | unit | value |
//! |---|---|---|
//! | `displacement`, `velocity`, `acceleration`, `drive` | m, m/s, m/s², A or V | as at the model's input |
//! | `displacement_magnitude`, `speed` | m, m/s | abs(x), abs(v) |
//! | `displacement_sign_velocity` | m | x tanh(v / 5 mm/s) |
//! | `force` | N | the damper's force without the session's offset |
//! | `time` | s | since the first sample, or since the last gap |
//! | `path` | m | integral of abs(v) since then |
//! | `energy` | J | integral of F v since then: energy that the damper took up |
//! | `temperature_rise` | K | case temperature since then |
//! | `travel` | m | displacement since the last reversal, with the sign of the motion |
//! | `time_since_reversal` | s | with the sign of the motion |
//! | `time_since_drive_change` | s | since the drive last moved by 0.05 |
//! | `drive_change` | A or V | drive minus the drive behind a lag of 50 ms |
//! | `mean_speed` | m/s | abs(v) behind a lag of 1 s |
//!
//! A reversal counts when the displacement has come back by 0.1 mm; travel and time then count from the turning point. The energy at a
//! sample contains the samples before it, so that it is known before the force.

use crate::effect::parts::smooth_sign;
use crate::effect::{Need, Unit};
use crate::elementary::exp_m1;
use crate::force::Inputs;
use crate::force::jet::Real;

/// Way back from which a reversal counts, m.
const REVERSED_M: f64 = 1e-4;
/// Change of the drive that counts, in its unit.
const DRIVE_CHANGED: f64 = 0.05;
/// Lag of `drive_change`, s.
const DRIVE_LAG_S: f64 = 0.05;
/// Lag of `mean_speed`, s.
const SPEED_LAG_S: f64 = 1.0;

/// An argument; see `model/src/effect/term/argument.rs`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Argument {
    /// The displacement.
    Displacement,
    /// The magnitude of the displacement.
    DisplacementMagnitude,
    /// The displacement times the sign of the velocity.
    DisplacementSignVelocity,
    /// The velocity.
    Velocity,
    /// The speed.
    Speed,
    /// The acceleration.
    Acceleration,
    /// The drive.
    Drive,
    /// The damper's force.
    Force,
    /// Time since the start.
    Time,
    /// Path since the start.
    Path,
    /// Energy taken up since the start.
    Energy,
    /// Rise of the case temperature since the start.
    TemperatureRise,
    /// Travel since the last reversal.
    Travel,
    /// Time since the last reversal.
    TimeSinceReversal,
    /// Time since the last change of the drive.
    TimeSinceDriveChange,
    /// Drive minus the lagged drive.
    DriveChange,
    /// Lagged speed.
    MeanSpeed,
}

/// Kind of signal, which decides what a term may be called.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Origin {
    /// An input of the model, or a short memory of one. The structure of a base may lack a term in it.
    Input,
    /// A position. Only a term with a wavelength or a place of its own cannot be structure.
    Position,
    /// Something that grows while the damper runs. No structure contains it.
    Growing,
}

impl Argument {
    /// All arguments.
    pub const ALL: [Self; 17] = [
        Self::Displacement,
        Self::DisplacementMagnitude,
        Self::DisplacementSignVelocity,
        Self::Velocity,
        Self::Speed,
        Self::Acceleration,
        Self::Drive,
        Self::Force,
        Self::Time,
        Self::Path,
        Self::Energy,
        Self::TemperatureRise,
        Self::Travel,
        Self::TimeSinceReversal,
        Self::TimeSinceDriveChange,
        Self::DriveChange,
        Self::MeanSpeed,
    ];

    /// Name, as in model files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Displacement => "displacement",
            Self::DisplacementMagnitude => "displacement_magnitude",
            Self::DisplacementSignVelocity => "displacement_sign_velocity",
            Self::Velocity => "velocity",
            Self::Speed => "speed",
            Self::Acceleration => "acceleration",
            Self::Drive => "drive",
            Self::Force => "force",
            Self::Time => "time",
            Self::Path => "path",
            Self::Energy => "energy",
            Self::TemperatureRise => "temperature_rise",
            Self::Travel => "travel",
            Self::TimeSinceReversal => "time_since_reversal",
            Self::TimeSinceDriveChange => "time_since_drive_change",
            Self::DriveChange => "drive_change",
            Self::MeanSpeed => "mean_speed",
        }
    }

    /// The argument with this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|argument| argument.name() == name)
    }

    /// Its unit.
    #[must_use]
    pub const fn unit(self) -> Unit {
        match self {
            Self::Displacement
            | Self::DisplacementMagnitude
            | Self::DisplacementSignVelocity
            | Self::Path
            | Self::Travel => Unit::METRE,
            Self::Velocity | Self::Speed | Self::MeanSpeed => Unit::METRE_PER_SECOND,
            Self::Acceleration => Unit::new("_m_s2", "m/s²"),
            Self::Drive | Self::DriveChange => Unit::DRIVE,
            Self::Force => Unit::NEWTON,
            Self::Time | Self::TimeSinceReversal | Self::TimeSinceDriveChange => Unit::SECOND,
            Self::Energy => Unit::new("_j", "J"),
            Self::TemperatureRise => Unit::new("_k", "K"),
        }
    }

    pub(super) const fn needs(self) -> Option<Need> {
        match self {
            Self::Drive | Self::TimeSinceDriveChange | Self::DriveChange => Some(Need::Drive),
            Self::TemperatureRise => Some(Need::CaseTemperature),
            _ => None,
        }
    }

    /// True if it counts from the start of a run: a term with it belongs to one history of the damper.
    #[must_use]
    pub const fn counts_from_start(self) -> bool {
        matches!(self.origin(), Origin::Growing)
    }

    pub(crate) const fn origin(self) -> Origin {
        match self {
            Self::Displacement | Self::DisplacementMagnitude | Self::DisplacementSignVelocity => {
                Origin::Position
            }
            Self::Time | Self::Path | Self::Energy | Self::TemperatureRise => Origin::Growing,
            _ => Origin::Input,
        }
    }

    /// Its value at this sample.
    #[inline]
    pub(crate) fn value<R: Real>(self, signals: &Signals<R>, inputs: &Inputs<R>) -> R {
        match self {
            Self::Displacement => inputs.displacement_m,
            Self::DisplacementMagnitude => inputs.displacement_m.abs(),
            Self::DisplacementSignVelocity => inputs.displacement_m * smooth_sign(inputs.velocity_m_s),
            Self::Velocity => inputs.velocity_m_s,
            Self::Speed => inputs.velocity_m_s.abs(),
            Self::Acceleration => inputs.acceleration_m_s2,
            Self::Drive => inputs.drive,
            Self::Force => signals.force_n,
            Self::Time => R::from(signals.time_s),
            Self::Path => signals.path_m,
            Self::Energy => signals.energy_j,
            Self::TemperatureRise => R::from(inputs.case_temp_c - signals.first_temp_c),
            Self::Travel => inputs.displacement_m - signals.turn_m,
            Self::TimeSinceReversal => R::from(signals.direction * (signals.time_s - signals.turn_s)),
            Self::TimeSinceDriveChange => R::from(signals.time_s - signals.changed_s),
            Self::DriveChange => inputs.drive - signals.lagged_drive,
            Self::MeanSpeed => signals.mean_speed_m_s,
        }
    }
}

/// The past of a simulation that begins within a run: the signals that count from the start of the run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Past {
    /// Time since the first sample of the run, s.
    pub(crate) time_s: f64,
    /// Integral of abs(v) since then, m.
    pub(crate) path_m: f64,
    /// Integral of F v since then, J.
    pub(crate) energy_j: f64,
    /// First case temperature, °C; NaN if there was none yet.
    pub(crate) first_temp_c: f64,
}

/// The signals with a memory.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Signals<R = f64> {
    begun: bool,
    /// Before the first sample: a [`Past`] gave time, path, energy and first temperature.
    resumed: bool,
    time_s: f64,
    /// Time since the sample before, s; 0 at the first one.
    step_s: f64,
    path_m: R,
    energy_j: R,
    first_temp_c: f64,
    /// Furthest displacement since the last reversal, with its time.
    furthest_m: R,
    furthest_s: f64,
    turn_m: R,
    turn_s: f64,
    /// 1 in extension, -1 in compression, 0 before the first motion.
    direction: f64,
    held_drive: f64,
    changed_s: f64,
    lagged_drive: R,
    mean_speed_m_s: R,
    force_n: R,
}

impl<R: Real> Signals<R> {
    /// The damper's force without the session's offset, N.
    #[inline]
    pub(super) const fn force_n(&self) -> R {
        self.force_n
    }

    /// Time since the sample before, s; 0 at the first one.
    #[inline]
    pub(crate) const fn step_s(&self) -> f64 {
        self.step_s
    }

    /// The past of a simulation that begins with this sample.
    pub(crate) fn past(&self) -> Past {
        let Self { time_s, path_m, energy_j, first_temp_c, .. } = *self;
        Past { time_s, path_m: path_m.re(), energy_j: energy_j.re(), first_temp_c }
    }

    /// Before the first sample of a simulation that begins within a run.
    pub(crate) fn after(past: &Past) -> Self
    where
        R: Default,
    {
        Self {
            resumed: true,
            time_s: past.time_s,
            path_m: R::from(past.path_m),
            energy_j: R::from(past.energy_j),
            first_temp_c: past.first_temp_c,
            ..Self::default()
        }
    }

    /// One sample, before the force is known. An input that is not finite leaves its signals as they are.
    #[inline]
    pub(crate) fn before_force(&mut self, inputs: &Inputs<R>) {
        let Some(dt_s) = inputs.dt_s.filter(|dt_s| self.begun && *dt_s > 0.0) else {
            *self = self.begin(inputs);
            return;
        };
        self.time_s += dt_s;
        self.step_s = dt_s;
        let speed_m_s = inputs.velocity_m_s.abs();
        if speed_m_s.re().is_finite() {
            self.path_m = self.path_m + speed_m_s * dt_s;
            let share = -exp_m1(-dt_s / SPEED_LAG_S);
            self.mean_speed_m_s = self.mean_speed_m_s + (speed_m_s - self.mean_speed_m_s) * share;
        }
        self.follow_turns(inputs.displacement_m);
        self.follow_drive(inputs.drive, dt_s);
        if !self.first_temp_c.is_finite() {
            self.first_temp_c = inputs.case_temp_c;
        }
    }

    /// The damper's force at this sample, N, without the session's offset.
    #[inline]
    pub(crate) fn after_force(&mut self, inputs: &Inputs<R>, force_n: R) {
        self.energy_j = self.energy_j + self.force_n * inputs.velocity_m_s * self.step_s;
        self.force_n = force_n;
    }

    /// The signals at a first sample. Everything counts from here if it is not known what lies before.
    fn begin(&self, inputs: &Inputs<R>) -> Self {
        let zero = R::from(0.0);
        let (time_s, path_m, energy_j, first_temp_c) = match self.resumed {
            true => (self.time_s, self.path_m, self.energy_j, self.first_temp_c),
            false => (0.0, zero, zero, inputs.case_temp_c),
        };
        Self {
            begun: true,
            resumed: false,
            time_s,
            step_s: 0.0,
            path_m,
            energy_j,
            first_temp_c,
            furthest_m: inputs.displacement_m,
            furthest_s: time_s,
            turn_m: inputs.displacement_m,
            turn_s: time_s,
            direction: 0.0,
            held_drive: inputs.drive.re(),
            changed_s: time_s,
            lagged_drive: inputs.drive,
            mean_speed_m_s: zero,
            force_n: zero,
        }
    }

    #[inline]
    fn follow_turns(&mut self, displacement_m: R) {
        let onward_m = (displacement_m.re() - self.furthest_m.re()) * self.direction;
        if self.direction == 0.0 {
            let moved_m = displacement_m.re() - self.furthest_m.re();
            if moved_m.abs() > REVERSED_M {
                self.direction = moved_m.signum();
                (self.furthest_m, self.furthest_s) = (displacement_m, self.time_s);
            }
        } else if onward_m >= 0.0 {
            (self.furthest_m, self.furthest_s) = (displacement_m, self.time_s);
        } else if onward_m < -REVERSED_M {
            (self.turn_m, self.turn_s) = (self.furthest_m, self.furthest_s);
            self.direction = -self.direction;
            (self.furthest_m, self.furthest_s) = (displacement_m, self.time_s);
        }
    }

    #[inline]
    fn follow_drive(&mut self, drive: R, dt_s: f64) {
        if !drive.re().is_finite() {
            return;
        }
        if (drive.re() - self.held_drive).abs() > DRIVE_CHANGED || !self.held_drive.is_finite() {
            (self.held_drive, self.changed_s) = (drive.re(), self.time_s);
        }
        let share = -exp_m1(-dt_s / DRIVE_LAG_S);
        self.lagged_drive = if self.lagged_drive.re().is_finite() {
            self.lagged_drive + (drive - self.lagged_drive) * share
        } else {
            drive
        };
    }
}
