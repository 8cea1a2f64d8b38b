//! Settings that can be changed on a running pipeline.

use super::mode::Mode;
use super::plausible::Plausible;
use crate::condition::ApplyTo;
use crate::error::{Error, PipelineError};
use crate::inverse::{ControlLaw, Limits, Method};
use crate::model::Model;

/// Whether measured force may seed the ARX model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum UseForce {
    /// It seeds the ARX model while it is fresh.
    Auto,
    /// It is used for the residual only.
    Never,
    /// While it is fresh, it corrects the simulation through a bias with this time constant, s. No ARX model is seeded.
    Observer(f64),
}

/// Settings of a pipeline.
///
/// ```
/// use mr_damper_model::pipeline::Settings;
///
/// let slow_force = Settings { force_timeout_s: 0.2, ..Settings::default() };
/// assert!(slow_force.validate().is_ok());
/// let error = Settings { force_timeout_s: -0.05, ..slow_force }.validate().unwrap_err();
/// assert_eq!(error.to_string(), "force_timeout_s is -0.05, but must be above 0 and at most 3600 s");
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// The only mode that is allowed: arx, model or fault. `None`: the best mode whose conditions hold.
    pub only_mode: Option<Mode>,
    /// Whether measured force may seed the ARX model.
    pub use_measured_force: UseForce,
    /// True: a `boada` model learns from measured force while it runs. Each measured force enters its memory after the estimate
    /// at its sample, if no reason speaks against the sample, so neither flags nor uncertainty bands change with what is learned:
    /// the range of training and the calibration stay those of the model file. The alarm compares with the learned memory.
    pub lazy_learning: bool,
    /// Age beyond which measured force counts as lost, s.
    pub force_timeout_s: f64,
    /// How long ARX may continue from its own predictions after measured force is lost, s.
    pub coast_s: f64,
    /// Age beyond which displacement and drive count as stale, s.
    pub input_timeout_s: f64,
    /// Lead of stamps over their arrival beyond which estimates report it, s.
    pub stamp_ahead_s: f64,
    /// How long the last estimate is held if no model can run, s.
    pub hold_s: f64,
    /// Time constant with which the step at a change of mode decays, s.
    pub bumpless_tau_s: f64,
    /// Gap between displacements beyond which history restarts, s.
    pub gap_s: f64,
    /// Time constant of the windowed residual figures, s.
    pub residual_window_s: f64,
    /// Factor over the expected RMSE that does not count as a fault yet. A residual that stays above it raises the alarm.
    pub alarm_ratio: f64,
    /// Length of the blocks over which the alarm averages the residual's power, s.
    pub alarm_block_s: f64,
    /// Lower bound of the mean time between false alarms, s.
    pub false_alarm_interval_s: f64,
    /// Limits of plausible readings.
    pub plausible: Plausible,
    /// Control law: it sets the demanded force or current.
    pub law: ControlLaw,
    /// Limits of the command.
    pub limits: Limits,
    /// Method that finds the current for a demanded force.
    pub method: Method,
    /// Age beyond which a force request, a body velocity and a displacement no longer count for the command, s.
    pub request_timeout_s: f64,
    /// Filter that replaces the filter of the model file: its place and its corner in Hz. `None`: the model file's filter.
    pub filter: Option<(ApplyTo, f64)>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            only_mode: None,
            use_measured_force: UseForce::Auto,
            lazy_learning: false,
            force_timeout_s: 0.05,
            coast_s: 0.2,
            input_timeout_s: 0.5,
            stamp_ahead_s: Self::STAMP_AHEAD_S,
            hold_s: 1.0,
            bumpless_tau_s: 0.05,
            gap_s: 0.1,
            residual_window_s: 5.0,
            alarm_ratio: 1.5,
            alarm_block_s: 0.5,
            false_alarm_interval_s: 86_400.0,
            plausible: Plausible::default(),
            law: ControlLaw::default(),
            limits: Limits::default(),
            method: Method::default(),
            request_timeout_s: 0.1,
            filter: None,
        }
    }
}

impl Settings {
    /// Spacing of the estimates while displacement is silent, s.
    pub const STALE_REPORT_S: f64 = 0.1;
    /// Default of `stamp_ahead_s`, s: clocks that NTP synchronises differ by less.
    pub const STAMP_AHEAD_S: f64 = 0.03;
    /// The same under simulated time, s: arrivals are stamped with the last `/clock`, which comes at least ten times per
    /// second.
    pub const SIMULATED_STAMP_AHEAD_S: f64 = 0.15;

    /// Checks that every number lies in its range.
    ///
    /// # Errors
    /// Names the setting, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        if let Some(mode @ (Mode::ArxCoast | Mode::Hold)) = self.only_mode {
            return Err(PipelineError::TemporaryMode { mode: mode.name() }.into());
        }
        if self.lazy_learning && self.use_measured_force == UseForce::Never {
            return Err(PipelineError::LearningWithoutForce.into());
        }
        let positive = |s: f64| s > 0.0 && s <= 3600.0;
        for (name, value) in [
            ("force_timeout_s", self.force_timeout_s),
            ("input_timeout_s", self.input_timeout_s),
            ("stamp_ahead_s", self.stamp_ahead_s),
            ("gap_s", self.gap_s),
            ("request_timeout_s", self.request_timeout_s),
            ("residual.window_s", self.residual_window_s),
        ] {
            Error::check(name, value, "above 0 and at most 3600 s", positive)?;
        }
        for (name, value) in
            [("coast_s", self.coast_s), ("hold_s", self.hold_s), ("bumpless_tau_s", self.bumpless_tau_s)]
        {
            Error::check(name, value, "between 0 and 3600 s", |s| (0.0..=3600.0).contains(&s))?;
        }
        Error::check("residual.alarm_ratio", self.alarm_ratio, "between 1 and 1000", |r| {
            (1.0..=1000.0).contains(&r)
        })?;
        Error::check("residual.alarm_block_s", self.alarm_block_s, "between 0.05 and 10 s", |s| {
            (0.05..=10.0).contains(&s)
        })?;
        let interval_s = self.false_alarm_interval_s;
        Error::check("residual.false_alarm_interval_s", interval_s, "between 60 and 1e9 s", |s| {
            (60.0..=1e9).contains(&s)
        })?;
        if let UseForce::Observer(tau_s) = self.use_measured_force {
            Error::check("observer_tau_s", tau_s, "above 0 and at most 3600 s", positive)?;
        }
        self.plausible.validate()?;
        self.limits.validate()?;
        self.law.validate(self.limits.current_max_a)?;
        if let Some((_, cutoff_hz)) = self.filter {
            Error::check("filter.cutoff_hz", cutoff_hz, "between 0.1 and 10000 Hz", |f| {
                (0.1..=10_000.0).contains(&f)
            })?;
        }
        Ok(())
    }

    /// `model` with the filter of these settings, if they have one.
    pub(super) fn applied_to(&self, mut model: Model) -> Model {
        if let Some((apply_to, cutoff_hz)) = self.filter {
            let conditioning = &model.conditioning;
            if (apply_to, cutoff_hz) != (conditioning.apply_to, conditioning.cutoff_hz) {
                // The calibration holds only for the model's own filter.
                model.expected.uncertainty = None;
            }
            model.conditioning.apply_to = apply_to;
            model.conditioning.cutoff_hz = cutoff_hz;
        }
        model
    }
}
