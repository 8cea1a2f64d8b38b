//! The inverse controller: from a demanded force to a current, sample by sample.
//!
//! ```text
//! preload  P = offset + k x                            gas spring: its work over a stroke is zero
//! Fd (v) dissipative        (Fd - P) v >= 0
//! solve    F(i*, x, v, states) + b = Fd + g (Fd - Fm)  within [0, i_max]
//! lead     u = c + (i* - c) (1 - e^(-dt/T)) / (1 - e^(-dt/tau))
//! coil     c' = c + (u - c) (1 - e^(-dt/tau))          the current that acts on the fluid
//! bias     b' = b + (1 - e^(-dt/Tb)) (Fm - F - b)      without a measured force b decays to 0 at the same rate
//! ```
//!
//! | symbol | what |
//! |---|---|
//! | tau | the model's coil lag, if it has that effect (time constant of rise or fall, depending on the side of i*); else u = i* |
//! | T, Tb, g | [`Limits::lead_s`], [`Limits::feedback_s`], [`Limits::feedback_gain`] |
//! | F | the model with all effects of the damper except the coil lag, which the lead compensates |
//! | Fm | the reading of the load cell, minus what the model's effects of the load cell add to F (for a sensor delay: F of then minus F) |
//!
//! The bias is the model's error at the present current and speed. The residual of the pipeline's simulation does not use it. The gain g
//! serves a coil that lags without lead compensation: gain and bias form a controller whose zero cancels the coil's pole. With a lead
//! less error remains to correct, so g is reduced in proportion, by T over tau. A demand that would drive the rod gets zero current.
//! Near rest the sign of the force reverses and its size hardly depends on the current, so the last target current is held.
//!
//! Source: clipping to dissipative forces follows Dyke et al. (1996), Smart Mater. Struct. 5, 565, who use two currents, zero and the
//! largest. The search for a current between them needs an identified forward model.
//! See `[dyke1996]` in the bibliography (node/docs/guide/bibliography.md).

use super::control_law::Demand;
use super::limits::{LimitedBy, Limits};
use super::method::Method;
use super::parts::InverseParts;
use super::prepare::{Found, Inverse};
use super::shape::{HARDLY, Shape};
use super::solve::Moment;
use super::surrogate::{Surrogate, SurrogateFit};
use crate::effect::{AugmentedState, Effects};
use crate::elementary::exp_m1;
use crate::error::Error;
use crate::force::Inputs;
use crate::inverse_model::InverseState;
use crate::model::Model;
use crate::units::{Ampere, Newton};

/// Tolerance of "achievable", as a share of the force range over the current.
const SLACK: f64 = 1e-3;

/// A current command and its expected force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurrentCommand {
    /// The current; always finite, between 0 and the largest.
    pub current: Ampere,
    /// The demanded force; NaN if nothing or a current was demanded.
    pub requested: Newton,
    /// The force that the model expects at the current that will act on the fluid; NaN if the model has no force.
    pub expected: Newton,
    /// The least and the largest force of the damper at this motion; NaN if not known.
    pub achievable: [Newton; 2],
    /// The demanded force is dissipative and within the achievable range.
    pub is_achievable: bool,
    /// The demanded force takes energy out of the motion; false if no force was demanded.
    pub dissipative: bool,
    /// The reason why the command does not reach the demanded force.
    pub limited_by: LimitedBy,
    /// The search found the current, because the learned inverse of [`Method`] gave none; see there when. False for other methods.
    pub substituted: bool,
}

/// The inverse controller of one damper. It is `Copy` and uses no heap, because it is handed to a real-time thread.
///
/// ```
/// use mr_damper_model::force::Inputs;
/// use mr_damper_model::inverse::{Demand, InverseController, Limits};
/// use mr_damper_model::preset;
///
/// let limits = Limits { current_max_a: 2.0, rate_max_a_s: 100.0, ..Limits::default() };
/// let mut controller = InverseController::new(&preset::load(preset::BEST_FUZZY_TANH)?, limits)?;
/// let extending = Inputs {
///     dt_s: Some(1.0 / 512.0), displacement_m: 0.0, velocity_m_s: 0.2, acceleration_m_s2: 0.0, drive: f64::NAN, case_temp_c: 25.0,
/// };
/// // The driver cannot jump: the current rises at 100 A/s, and stops at its largest value.
/// let currents: Vec<f64> =
///     (0..20).map(|_| controller.step(&extending, Demand::Force(5_000.0), None).current.get()).collect();
/// assert!((currents[0] - 100.0 / 512.0).abs() < 1e-9 && currents[19] == 2.0, "{currents:?}");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InverseController {
    limits: Limits,
    /// `None` if the model has no inverse. Then only a current can be demanded.
    inverse: Option<Inverse>,
    memory: Memory,
}

/// State from sample to sample.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Memory {
    state: AugmentedState,
    /// State of the model that gives the expected reading, if there is one.
    reading_state: AugmentedState,
    /// Last command, A.
    last_a: f64,
    /// Last target for the current in the fluid, A.
    target_a: f64,
    /// Current that acts on the fluid, A.
    fluid_a: f64,
    /// Past samples of a learned inverse; only consecutive samples with a demanded force are in it.
    learned: InverseState,
    /// Bias: error of the model as learnt from measured force, N.
    bias_n: f64,
    /// Rate at which the current goes to the safe current, A/s, once it has started to.
    safe_rate_a_s: Option<f64>,
}

impl InverseController {
    /// A controller for `model` that searches for currents. It starts at rest with the safe current.
    ///
    /// # Errors
    /// Those of [`InverseController::with_method`].
    pub fn new(model: &Model, limits: Limits) -> Result<Self, Error> {
        Self::with_method(model, limits, Method::Search)
    }

    /// A controller for `model` that finds currents by `method`. It starts at rest with the safe current. A surrogate is fitted here.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a limit out of range. [`Error::Inverse`] for a model without a current input (none, or a voltage), for a
    /// model without a finite force everywhere in its own envelope, and for a model that `method` does not support, see [`Method`].
    pub fn with_method(model: &Model, limits: Limits, method: Method) -> Result<Self, Error> {
        let inverse = Some(Inverse::new(model, &limits, method)?);
        Ok(Self { inverse, ..Self::without_inverse(limits)? })
    }

    /// A controller without a model: it passes a demanded current on, and answers every demanded force with the safe current.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a limit out of range.
    pub fn without_inverse(limits: Limits) -> Result<Self, Error> {
        limits.validate()?;
        let memory = Memory {
            state: AugmentedState::default(),
            reading_state: AugmentedState::default(),
            last_a: limits.safe_a,
            target_a: limits.safe_a,
            fluid_a: limits.safe_a,
            learned: InverseState::default(),
            bias_n: 0.0,
            safe_rate_a_s: None,
        };
        Ok(Self { limits, inverse: None, memory })
    }

    /// The last commanded current; before the first command, the safe current.
    #[must_use]
    pub const fn last_current(&self) -> Ampere {
        Ampere(self.memory.last_a)
    }

    /// Shape of the model's force over the current; `None` without an inverse.
    #[must_use]
    pub fn shape(&self) -> Option<&Shape> {
        self.inverse.as_ref().map(|inverse| &inverse.shape)
    }

    /// Accuracy of the surrogate; `None` if the controller searches.
    #[must_use]
    pub fn fit(&self) -> Option<&SurrogateFit> {
        self.inverse.as_ref()?.surrogate.as_ref().map(Surrogate::fit)
    }

    /// The numbers of the controller; `None` without an inverse.
    #[must_use]
    pub fn parts(&self) -> Option<InverseParts> {
        self.inverse.as_ref().map(|inverse| inverse.parts(&self.limits))
    }

    /// Takes over the state of `old`: the driver keeps its current, and the model's state is kept if its effects are of the same kinds.
    pub fn inherit(&mut self, old: &Self) {
        let max_a = self.limits.current_max_a;
        let Memory { last_a, target_a, fluid_a, safe_rate_a_s, .. } = old.memory;
        let same_kinds = |effects: fn(&Inverse) -> Option<&Effects>| {
            let (new, old) =
                (self.inverse.as_ref().and_then(effects), old.inverse.as_ref().and_then(effects));
            new.zip(old).is_some_and(|(new, old)| new.same_kinds(old))
        };
        let same = same_kinds(|inverse| Some(inverse.model.effects()));
        let state = if same { old.memory.state } else { old.memory.state.without_effects() };
        // The effects of the damper come first in both models, so the damper's state is valid for the reading.
        let same = same_kinds(|inverse| inverse.reading.as_ref());
        let reading_state = if same { old.memory.reading_state } else { state };
        let bias_n = if self.inverse == old.inverse { old.memory.bias_n } else { 0.0 };
        self.memory = Memory {
            state,
            reading_state,
            last_a: last_a.min(max_a),
            target_a: target_a.min(max_a),
            fluid_a,
            // The past demands were clipped to the range of the old model.
            learned: InverseState::default(),
            bias_n,
            safe_rate_a_s,
        };
    }

    /// The current for `demand` at `inputs`, whose drive is the measured current or NaN. `measured_n` is the load cell's reading at this
    /// sample, if there is one.
    #[inline]
    pub fn step(&mut self, inputs: &Inputs, demand: Demand, measured_n: Option<f64>) -> CurrentCommand {
        let demand = demand.if_finite();
        let dt_s = inputs.dt_s.filter(|dt_s| *dt_s > 0.0 && dt_s.is_finite());
        match (&self.inverse, demand) {
            (Some(inverse), _) => {
                let step = Step { limits: &self.limits, inverse, inputs, dt_s };
                self.memory.step(&step, demand, measured_n)
            }
            (None, Demand::Current(current_a)) => self.memory.go_to(&self.limits, current_a, dt_s),
            (None, _) => {
                let command = self.memory.safe(&self.limits, demand, dt_s);
                let limited_by = if demand == Demand::None { LimitedBy::Safe } else { LimitedBy::NoInverse };
                CurrentCommand { limited_by, ..command }
            }
        }
    }

    /// The current after `elapsed_s` without a sample: a demanded current stays; otherwise the current goes to the safe current.
    #[inline]
    pub fn idle(&mut self, demand: Demand, elapsed_s: f64) -> CurrentCommand {
        match demand.if_finite() {
            Demand::Current(current_a) => self.memory.go_to(&self.limits, current_a, Some(elapsed_s)),
            Demand::None | Demand::Force(_) => self.memory.safe(&self.limits, Demand::None, Some(elapsed_s)),
        }
    }
}

/// Largest change of the current within `dt_s` at `rate_a_s`, A. An infinite rate allows every change, also within an unknown time or a step
/// of 0 s. At a finite rate the current does not change within an unknown time.
fn most_change_a(rate_a_s: f64, dt_s: Option<f64>) -> f64 {
    match dt_s {
        _ if rate_a_s == f64::INFINITY => f64::INFINITY,
        None => 0.0,
        Some(dt_s) => rate_a_s * dt_s,
    }
}

/// Inputs of a step.
struct Step<'a> {
    limits: &'a Limits,
    inverse: &'a Inverse,
    inputs: &'a Inputs,
    /// Time since the sample before, if there is one.
    dt_s: Option<f64>,
}

impl Memory {
    fn step(&mut self, on: &Step, demand: Demand, measured_n: Option<f64>) -> CurrentCommand {
        let Step { limits, inverse, inputs, dt_s } = *on;
        if dt_s.is_none() {
            // The model's history is not valid after a gap. The driver still has its current.
            self.state = AugmentedState::default();
            if inverse.reading.is_some() {
                self.reading_state = AugmentedState::default();
            }
            self.bias_n = 0.0;
        }
        self.follow_coil(on);
        let moves = inputs.displacement_m.is_finite() && inputs.velocity_m_s.is_finite();
        // Keep NaN out of the model's state.
        let stepped =
            if moves { Moment::step(&inverse.model, &mut self.state, inputs, self.fluid_a) } else { None };
        let modelled_n = stepped.as_ref().map(|(modelled_n, _)| *modelled_n);
        let measured_n = if moves { self.measured_on_damper_n(on, modelled_n, measured_n) } else { None };
        if moves {
            self.learn(on, modelled_n, measured_n);
        }
        match (demand, stepped) {
            (Demand::Force(demand_n), Some(stepped)) => self.track_force(on, demand_n, stepped, measured_n),
            (Demand::Current(current_a), stepped) => {
                let command = self.go_to(limits, current_a, dt_s);
                stepped.map_or(command, |stepped| self.with_forces(on, command, stepped))
            }
            (Demand::None, _) | (_, None) => self.safe(limits, demand, dt_s),
        }
    }

    /// The current for a force.
    fn track_force(
        &mut self,
        on: &Step,
        demand_n: f64,
        (modelled_n, moment): (f64, Moment),
        measured_n: Option<f64>,
    ) -> CurrentCommand {
        let Step { limits, inverse, inputs, dt_s } = *on;
        let target_n = demand_n - self.bias_n + self.feedback_n(on, demand_n, measured_n);
        let last = (Ampere(self.fluid_a), Newton(modelled_n));
        let Some(Found { solution: solved, substituted }) =
            inverse.solve(&moment, inputs, target_n, self.bias_n, last, &mut self.learned)
        else {
            return self.safe(limits, Demand::Force(demand_n), dt_s);
        };
        self.safe_rate_a_s = None;

        let (x_m, v_m_s) = (inputs.displacement_m, inputs.velocity_m_s);
        let dissipative = (demand_n - inverse.preload.at_n(x_m)) * v_m_s >= 0.0;
        let achievable_n = solved.achievable_n.map(|force_n| force_n + self.bias_n);
        let moves_n = achievable_n[1] - achievable_n[0];
        let slack_n = SLACK * moves_n;
        let is_achievable =
            (achievable_n[0] - slack_n..=achievable_n[1] + slack_n).contains(&demand_n) && dissipative;
        let near_rest = v_m_s.abs() < limits.hold_m_s || moves_n < HARDLY * inverse.shape.most_n;
        self.target_a = match (near_rest, dissipative) {
            (true, _) => self.target_a,
            (false, true) => solved.current_a,
            (false, false) => 0.0,
        };
        let force_limited_by = match is_achievable {
            _ if !dissipative => LimitedBy::Passivity,
            true => LimitedBy::None,
            false if solved.current_a > 0.5 * limits.current_max_a => LimitedBy::CurrentMax,
            false => LimitedBy::CurrentMin,
        };
        // A learned inverse gives the driver's current; every other target is the current in the fluid.
        let is_led = inverse.learned.is_none() || substituted;
        let led_a = if is_led { self.lead_a(on) } else { self.target_a };
        // The current in the fluid is held. If the demand would drive the rod, the current must not rise.
        let led_a = if dissipative { led_a } else { led_a.min(self.last_a) };
        let (current_a, limited_by) = self.limited(limits, led_a, force_limited_by, dt_s);
        let fluid_a = self.after(inverse, current_a, dt_s);
        let expected_n =
            if fluid_a == solved.current_a { Some(solved.force_n) } else { moment.force_n(fluid_a) };
        self.last_a = current_a;
        self.learned.feed(current_a);
        CurrentCommand {
            current: Ampere(current_a),
            requested: Newton(demand_n),
            expected: Newton(expected_n.map_or(f64::NAN, |force_n| force_n + self.bias_n)),
            achievable: achievable_n.map(Newton),
            is_achievable,
            dissipative,
            limited_by,
            substituted,
        }
    }

    /// `command` with the model's expected and achievable forces.
    fn with_forces(
        &self,
        on: &Step,
        command: CurrentCommand,
        (modelled_n, moment): (f64, Moment),
    ) -> CurrentCommand {
        let last = (Ampere(self.fluid_a), Newton(modelled_n));
        let achievable_n = on.inverse.achievable_n(&moment, modelled_n, last);
        let fluid_a = self.after(on.inverse, command.current.get(), on.dt_s);
        let biased = |force_n: f64| Newton(force_n + self.bias_n);
        CurrentCommand {
            expected: biased(moment.force_n(fluid_a).unwrap_or(f64::NAN)),
            achievable: achievable_n.unwrap_or([f64::NAN; 2]).map(biased),
            ..command
        }
    }

    /// Updates the current in the fluid at this sample, from the driver's current since the last one.
    fn follow_coil(&mut self, on: &Step) {
        // A measured current below zero is a transducer offset, and one far above the limit is a transducer fault.
        let (measured_a, most_a) = (on.inputs.drive, 2.0 * on.limits.current_max_a);
        let driver_a = if measured_a.is_finite() { measured_a.clamp(0.0, most_a) } else { self.last_a };
        self.fluid_a = match on.dt_s {
            Some(_) => self.after(on.inverse, driver_a, on.dt_s),
            None => driver_a,
        };
    }

    /// The current in the fluid `dt_s` after the driver went to `driver_a`.
    fn after(&self, inverse: &Inverse, driver_a: f64, dt_s: Option<f64>) -> f64 {
        match (&inverse.coil, dt_s) {
            (Some(coil), Some(dt_s)) => {
                let share = approach(dt_s, coil.tau_s(self.fluid_a, driver_a));
                self.fluid_a + share * (driver_a - self.fluid_a)
            }
            _ => driver_a,
        }
    }

    /// The measured force of the damper, N: the reading `measured_n` without the part that the effects of the load cell add to the force
    /// `modelled_n` of the damper. `None` without a reading, or if the model has no force.
    fn measured_on_damper_n(
        &mut self,
        on: &Step,
        modelled_n: Option<f64>,
        measured_n: Option<f64>,
    ) -> Option<f64> {
        let Some(reading) = &on.inverse.reading else { return measured_n };
        let here = Inputs { drive: self.fluid_a, ..*on.inputs };
        let reading_n = reading.free_run(on.inverse.model.force(), &mut self.reading_state, &here);
        Some(measured_n? - (reading_n? - modelled_n?))
    }

    fn learn(&mut self, on: &Step, modelled_n: Option<f64>, measured_n: Option<f64>) {
        let Some(dt_s) = on.dt_s else { return };
        let measured_n = measured_n.filter(|force_n| force_n.is_finite());
        let lacks_n =
            measured_n.zip(modelled_n).map_or(0.0, |(measured_n, modelled_n)| measured_n - modelled_n);
        // An error above the damper's largest force does not come from the model.
        let most_n = on.inverse.shape.most_n;
        self.bias_n += approach(dt_s, on.limits.feedback_s) * (lacks_n.clamp(-most_n, most_n) - self.bias_n);
    }

    /// Feedback: force added to the demand because the last sample missed it, N.
    fn feedback_n(&self, on: &Step, demand_n: f64, measured_n: Option<f64>) -> f64 {
        let Some(measured_n) = measured_n.filter(|force_n| force_n.is_finite()) else { return 0.0 };
        let left =
            on.inverse.coil.map_or(1.0, |coil| (on.limits.lead_s / coil.rise_s.min(coil.fall_s)).min(1.0));
        on.limits.feedback_gain * left * (demand_n - measured_n)
    }

    /// The driver current that leads the coil to the target current.
    fn lead_a(&self, on: &Step) -> f64 {
        match (&on.inverse.coil, on.dt_s) {
            (Some(coil), Some(dt_s)) => {
                let way_a = self.target_a - self.fluid_a;
                let tau_s = coil.tau_s(self.fluid_a, self.target_a);
                // A lead slower than the coil would only delay it.
                let lead = approach(dt_s, on.limits.lead_s.min(tau_s));
                self.fluid_a + way_a * lead / approach(dt_s, tau_s)
            }
            _ => self.target_a,
        }
    }

    /// `current_a` limited in range and rate. A clipped lead does not count as a limit of the force, because the coil still reaches it.
    fn limited(&self, limits: &Limits, current_a: f64, by: LimitedBy, dt_s: Option<f64>) -> (f64, LimitedBy) {
        // A time step near zero can make the lead NaN. The last current then stays.
        let current_a = if current_a.is_finite() { current_a } else { self.last_a };
        let inside_a = current_a.clamp(0.0, limits.current_max_a);
        let most_a = most_change_a(limits.rate_max_a_s, dt_s);
        let cut_a = inside_a.clamp(self.last_a - most_a, self.last_a + most_a);
        (cut_a, if cut_a == inside_a { by } else { LimitedBy::Rate })
    }

    /// Goes to a demanded current. The command holds no force.
    fn go_to(&mut self, limits: &Limits, current_a: f64, dt_s: Option<f64>) -> CurrentCommand {
        self.safe_rate_a_s = None;
        let by = if current_a > limits.current_max_a { LimitedBy::CurrentMax } else { LimitedBy::None };
        let (current_a, limited_by) = self.limited(limits, current_a, by, dt_s);
        (self.last_a, self.target_a) = (current_a, current_a);
        self.learned = InverseState::default();
        self.without_forces(Demand::None, limited_by)
    }

    /// Goes towards the safe current.
    fn safe(&mut self, limits: &Limits, demand: Demand, dt_s: Option<f64>) -> CurrentCommand {
        let Limits { safe_a, safe_after_s, rate_max_a_s, current_max_a, .. } = *limits;
        let way_a = safe_a - self.last_a;
        let rate_a_s = *self.safe_rate_a_s.get_or_insert((way_a.abs() / safe_after_s).min(rate_max_a_s));
        let most_a = most_change_a(rate_a_s, dt_s);
        let step_a = way_a.clamp(-most_a, most_a);
        self.last_a = (self.last_a + step_a).clamp(0.0, current_max_a);
        self.target_a = self.last_a;
        self.learned = InverseState::default();
        self.without_forces(demand, LimitedBy::Safe)
    }

    /// The last current, as a command without forces.
    fn without_forces(&self, demand: Demand, limited_by: LimitedBy) -> CurrentCommand {
        CurrentCommand {
            current: Ampere(self.last_a),
            requested: Newton(demand.force_n()),
            expected: Newton(f64::NAN),
            achievable: [Newton(f64::NAN); 2],
            is_achievable: false,
            dissipative: false,
            limited_by,
            substituted: false,
        }
    }
}

/// Share of its final value that a first-order lag of `tau_s` reaches in `dt_s`; 1 without a lag.
fn approach(dt_s: f64, tau_s: f64) -> f64 {
    if tau_s > 0.0 { -exp_m1(-dt_s / tau_s) } else { 1.0 }
}
