//! Changes to the running service: its state, parameters and models.
//!
//! Changes are checked here, under one lock. They reach the estimating thread through its command ring, in the order in
//! which they were accepted. A command on the ring cannot fail.

mod error;

pub use error::{Awaited, ControlError};

use crate::estimation::estimator::{Estimator, EstimatorCounters, PipelineCommand};
use crate::estimation::lifecycle::{LifecycleState, Transition};
use crate::estimation::models;
use crate::estimation::wire::{ModelNames, SharedNames};
use crate::settings::config::{Config, Mutability, Parameter, Value, find};
use crate::settings::error::{NodeError, RequestError};
use mr_damper_base::clock::Clock;
use mr_damper_model::condition::VelocitySource;
use mr_damper_model::effect::Effects;
use mr_damper_model::inverse::{ControlLaw, Fold, InverseController, SurrogateFit};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{Models, PipelineSetup, Settings};
use mr_damper_model::sample::Stamp;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// Longest time for the estimating thread to execute a command before an error is returned. A swap normally takes
/// microseconds.
const SWAP_TIMEOUT: Duration = Duration::from_secs(2);

/// The handle through which the running service is changed.
pub struct Control {
    clock: Arc<Clock>,
    /// True if the model needs measured velocity; the source then waits for it.
    wants_velocity: Arc<AtomicBool>,
    state: Mutex<State>,
    estimator: Mutex<Option<Estimator>>,
    names: SharedNames,
    mirror: OnceLock<Box<dyn Fn(ModelNames) + Send + Sync>>,
}

struct State {
    config: Config,
    lifecycle: LifecycleState,
    /// Set in the states inactive and active.
    models: Option<Models>,
}

/// The result of loading a model.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Loaded {
    /// Names of the previous models.
    pub before: ModelNames,
    /// Names of the present models.
    pub now: ModelNames,
}

impl Control {
    /// Control over a service with `config`, in the state unconfigured.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        Self {
            clock: Arc::new(Clock::new(config.use_sim_time)),
            wants_velocity: Arc::default(),
            state: Mutex::new(State {
                config: config.clone(),
                lifecycle: LifecycleState::Unconfigured,
                models: None,
            }),
            estimator: Mutex::new(None),
            names: Arc::default(),
            mirror: OnceLock::new(),
        }
    }

    /// Connects the estimating thread; it receives all changes from now on.
    pub fn attach(&self, estimator: Estimator) {
        *lock(&self.estimator) = Some(estimator);
    }

    /// Connects the Zenoh mirror: `rename` gets the names of the models whenever the models change.
    pub fn attach_mirror(&self, rename: impl Fn(ModelNames) + Send + Sync + 'static) {
        // A service has one mirror, which is attached once.
        let _ = self.mirror.set(Box::new(rename));
    }

    /// Returns the estimating thread so that it can be stopped. No change is possible afterwards.
    pub fn detach(&self) -> Option<Estimator> {
        lock(&self.estimator).take()
    }

    /// True while the estimating thread runs.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        lock(&self.estimator).as_ref().is_some_and(Estimator::is_alive)
    }

    /// Names of the running models, shared.
    #[must_use]
    pub fn names(&self) -> SharedNames {
        Arc::clone(&self.names)
    }

    /// Names of the running models at present.
    #[must_use]
    pub fn models_names(&self) -> ModelNames {
        read(&self.names)
    }

    /// The configuration at present.
    #[must_use]
    pub fn config(&self) -> Config {
        lock(&self.state).config.clone()
    }

    /// The models at present; `None` while the node is not configured.
    #[must_use]
    pub fn models(&self) -> Option<Models> {
        lock(&self.state).models
    }

    /// The state at present.
    #[must_use]
    pub fn lifecycle_state(&self) -> LifecycleState {
        lock(&self.state).lifecycle
    }

    /// The node's clock.
    #[must_use]
    pub fn clock(&self) -> Arc<Clock> {
        Arc::clone(&self.clock)
    }

    /// True while the model needs measured velocity.
    #[must_use]
    pub fn wants_velocity(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.wants_velocity)
    }

    /// Makes a transition, and returns the old and the new state once it is done.
    ///
    /// # Errors
    /// When the transition is not possible in the present state; when the models named by the parameters do not load or
    /// do not fit the settings; when the estimating thread does not answer. The state then stays as it was.
    pub fn change_state(
        &self,
        transition: Transition,
    ) -> Result<(LifecycleState, LifecycleState), NodeError> {
        let mut state = lock(&self.state);
        let from = state.lifecycle;
        let to = from.after(transition)?;
        let place = match transition {
            Transition::Configure => {
                let (models, names) = models::from_config(&state.config)?;
                let (settings, setup) = setup(&state.config, &models)?;
                Self::say_commands(&models.free, &settings, setup.controller());
                state.models = Some(models);
                self.runs_on(Some(&models), names);
                None
            }
            Transition::Cleanup => None,
            Transition::Activate => {
                let models = state.models.ok_or(RequestError::NoModel)?;
                self.send(&[PipelineCommand::Begin(*setup(&state.config, &models)?.1)])?
            }
            Transition::Deactivate | Transition::Shutdown => self.send(&[PipelineCommand::End])?,
        };
        if let Some((place, counters)) = place {
            await_executed(place, &counters, Awaited::Transition)?;
        }
        if matches!(to, LifecycleState::Unconfigured | LifecycleState::Finalized) {
            state.models = None;
            self.runs_on(None, ModelNames::default());
        }
        state.lifecycle = to;
        tracing::info!("the node is {}; it was {}", to.name(), from.name());
        Ok((from, to))
    }

    /// Publishes that the node uses other models from now on, or none.
    fn runs_on(&self, models: Option<&Models>, names: ModelNames) {
        let measured = models.is_some_and(|m| m.free.conditioning.velocity == VelocitySource::Measured);
        self.wants_velocity.store(measured, Ordering::Release);
        *self.names.write().unwrap_or_else(PoisonError::into_inner) = names.clone();
        if let Some(rename) = self.mirror.get() {
            rename(names);
        }
    }

    /// Clears all history: the next sample is treated as the first.
    ///
    /// # Errors
    /// When the node is not active, or too many changes are waiting.
    pub fn reset(&self) -> Result<(), NodeError> {
        let lifecycle = self.lifecycle_state();
        if lifecycle != LifecycleState::Active {
            return Err(RequestError::NothingToReset { state: lifecycle.name() }.into());
        }
        self.send(&[PipelineCommand::Reset])?;
        tracing::info!("reset");
        Ok(())
    }

    /// Takes the time `stamp` from `/clock`. If it went back, the history is cleared, because it belongs to another
    /// run.
    pub fn hear_clock(&self, stamp: Stamp) {
        if let Some(back_s) = self.clock.observe(stamp) {
            tracing::warn!(back_s, "simulated time went back: all history is cleared");
            if let Err(error) = self.reset() {
                tracing::debug!("{error}");
            }
        }
    }

    /// Loads the preset or model file `name` as the model for simulation (free run), and returns once estimates come
    /// from it. The ARX model is chosen as at the start of the node; if none is found, the present one stays.
    ///
    /// # Errors
    /// When the model does not load, needs another drive than the node's input, or does not fit the settings: then
    /// nothing changes. When the estimating thread does not answer.
    pub fn load_model(&self, name: &str) -> Result<Loaded, NodeError> {
        self.load(name, None)
    }

    /// Like [`Control::load_model`], but only if the present free-running model is still `made_from`.
    ///
    /// # Errors
    /// The same as for [`Control::load_model`]; also when another model was loaded meanwhile.
    pub fn load_model_over(&self, name: &str, made_from: &Model) -> Result<Loaded, NodeError> {
        self.load(name, Some(made_from))
    }

    fn load(&self, name: &str, made_from: Option<&Model>) -> Result<Loaded, NodeError> {
        let requested = Config { model: name.to_owned(), ..self.config() };
        let (models, mut now) = models::from_config(&requested)?;

        // From here until the command is in the ring, nothing else may change.
        let mut state = lock(&self.state);
        let Some(running) = state.models else {
            let state = state.lifecycle.name();
            return Err(ControlError::NotConfigured { state, model: name.to_owned() }.into());
        };
        if made_from.is_some_and(|model| *model != running.free) {
            return Err(ControlError::Replaced { model: name.to_owned() }.into());
        }
        let before = read(&self.names);
        let models = models::succeeding(models, &running)?;
        if models.seeded.is_some() && now.seeded.is_none() {
            now.seeded.clone_from(&before.seeded);
        }
        now.hash = models::hash(&models)?;
        let config = Config { model: requested.model, ..state.config.clone() };
        let (settings, setup) = setup(&config, &models)?;
        let controller = *setup.controller();
        let place = if state.lifecycle == LifecycleState::Active {
            self.send(&[PipelineCommand::Take(setup.learning_anew())])?
        } else {
            None
        };
        (state.config, state.models) = (config, Some(models));
        let executed =
            place.map_or(Ok(()), |(place, counters)| await_executed(place, &counters, Awaited::Swap));
        // Also after a timeout, because the thread takes the model as soon as it continues. The names change before another
        // model can be loaded, so they always belong to the last one.
        self.runs_on(Some(&models), now.clone());
        drop(state);
        executed?;
        tracing::info!(model = now.free, before = before.free, hash = now.hash, "a new model is in use");
        Self::say_commands(&models.free, &settings, &controller);
        Ok(Loaded { before, now })
    }

    /// Gives the effects of the running model, `made_from`, other values.
    ///
    /// # Errors
    /// When another model runs by now, or too many changes are waiting. Nothing changes then.
    pub fn move_effects(&self, effects: Effects, made_from: &Model) -> Result<(), NodeError> {
        let mut state = lock(&self.state);
        let running = state.models.filter(|models| models.free == *made_from);
        let Some(running) = running else {
            let model = read(&self.names).free;
            return Err(ControlError::Replaced { model }.into());
        };
        let models = Models { free: Model { effects, ..running.free }, ..running };
        let hash = models::hash(&models)?;
        let setup = setup(&state.config, &models)?.1;
        if state.lifecycle == LifecycleState::Active {
            self.send(&[PipelineCommand::Take(*setup)])?;
        }
        state.models = Some(models);
        let now = ModelNames { hash, ..read(&self.names) };
        tracing::info!(
            model = now.free,
            hash = now.hash,
            "the values of the model's effects have been adapted"
        );
        self.runs_on(Some(&models), now);
        Ok(())
    }

    /// Logs how `controller`, the inverse controller for the model `free`, commands currents, and where it cannot.
    fn say_commands(free: &Model, settings: &Settings, controller: &InverseController) {
        match (settings.law, controller.shape()) {
            (ControlLaw::Off, _) => tracing::info!("no current is commanded"),
            (ControlLaw::Follow, None) => {
                // A setup lacks an inverse only if the search found none; a second try returns the reason.
                if let Err(why) = InverseController::new(free, settings.limits) {
                    tracing::info!("a force_request would be answered with the safe current: {why}");
                }
            }
            (law, None) => tracing::info!(law = law.name(), "current_command"),
            (_, Some(shape)) => say_inverse(settings, shape.real_fold(), controller.fit()),
        }
    }

    /// Puts all commands into the ring, or none, and returns the position of the last one; `None` before the thread has started.
    fn send(
        &self,
        commands: &[PipelineCommand],
    ) -> Result<Option<(u64, Arc<EstimatorCounters>)>, ControlError> {
        let mut estimator = lock(&self.estimator);
        let Some(estimator) = estimator.as_mut() else { return Ok(None) };
        match estimator.command(commands) {
            Some(place) => Ok(Some((place, estimator.counters()))),
            None => Err(ControlError::TooManyChanges),
        }
    }

    /// Sets all parameters or none, and returns the names of those whose value changed.
    ///
    /// # Errors
    /// When a parameter is unknown, out of range or cannot be set in this state, or when the values do not fit
    /// together.
    pub fn set_parameters(&self, requested: &[(&str, Value)]) -> Result<Vec<String>, NodeError> {
        let mut state = lock(&self.state);
        let mut config = state.config.clone();
        let mut changed = Vec::new();
        for (name, value) in requested {
            if config.qos.get(name).is_some() {
                return Err(RequestError::Qos { name: (*name).to_owned() }.into());
            }
            let parameter = find(name)?;
            let value = parameter.check(value)?;
            if (parameter.get)(&config) == value {
                continue;
            }
            may_change(parameter, state.lifecycle)?;
            (parameter.set)(&mut config, &value);
            changed.push((*name).to_owned());
        }
        if changed.is_empty() {
            return Ok(changed);
        }
        let another_time = self.clock.is_simulated() != config.use_sim_time;
        if let Some(models) = &state.models {
            // The pipeline may refuse a combination that each parameter's own range allows, for example an ARX model
            // with an output filter.
            let (settings, setup) = setup(&config, models)?;
            let commands =
                |name: &String| name == "law" || name.starts_with("inverse.") || name.starts_with("current.");
            if changed.iter().any(commands) {
                Self::say_commands(&models.free, &settings, setup.controller());
            }
            if state.lifecycle == LifecycleState::Active {
                let take = PipelineCommand::Take(*setup);
                if another_time {
                    self.send(&[take, PipelineCommand::Reset])?;
                    tracing::info!("the clock is switched: all history is cleared");
                } else {
                    self.send(&[take])?;
                }
            }
        }
        // Nothing below can fail, so either everything was set or nothing.
        let set: Vec<String> = requested.iter().map(|(name, value)| format!("{name} = {value}")).collect();
        tracing::info!("set: {}", set.join(", "));
        state.config = config;
        if another_time {
            self.clock.simulate(state.config.use_sim_time);
        }
        Ok(changed)
    }
}

/// Checks whether `parameter` can be set in the state `lifecycle`; the error says why not and what to do.
fn may_change(parameter: &Parameter, lifecycle: LifecycleState) -> Result<(), RequestError> {
    match (parameter.mutability, lifecycle) {
        (Mutability::Running, _) | (Mutability::Unconfigured, LifecycleState::Unconfigured) => Ok(()),
        (Mutability::Unconfigured, _) => Err(RequestError::ParameterInState {
            name: parameter.name,
            state: lifecycle.name(),
            instead: parameter.instead(),
        }),
        (Mutability::Never, _) => Err(RequestError::ParameterNeedsRestart { name: parameter.name }),
    }
}

/// The settings and the setup for `config` and `models`. The setup is boxed, because it is large: an unoptimised program keeps a copy on the
/// stack for each move.
fn setup(config: &Config, models: &Models) -> Result<(Settings, Box<PipelineSetup>), NodeError> {
    let settings = config.pipeline_settings(models.free.conditioning.cutoff_hz);
    Ok((settings, Box::new(PipelineSetup::new(*models, settings).map_err(NodeError::Settings)?)))
}

/// Waits until the estimating thread has executed the command at `place`, which does `work`.
fn await_executed(place: u64, counters: &EstimatorCounters, work: Awaited) -> Result<(), ControlError> {
    let deadline = Instant::now() + SWAP_TIMEOUT;
    while counters.executed.load(Ordering::Acquire) < place {
        if Instant::now() >= deadline {
            return Err(ControlError::NotExecuted { work, within_s: SWAP_TIMEOUT.as_secs() });
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    Ok(())
}

/// Locks `mutex`. A panic of the last holder does no harm: values are replaced as a whole, never half changed.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn read(names: &SharedNames) -> ModelNames {
    names.read().unwrap_or_else(PoisonError::into_inner).clone()
}

/// Warns that several currents give the same force, and says which one is used.
pub(crate) fn say_fold(fold: &Fold) {
    tracing::warn!(
        displacement_m = fold.displacement_m,
        velocity_m_s = fold.velocity_m_s,
        current_a = fold.current_a,
        fall_n = fold.fall_n,
        "the model's force does not grow with the current one way everywhere; where several currents give the same force, the one \
         nearest the last is commanded"
    );
}

/// Logs which method finds currents for demanded forces, and where several currents give the same force.
fn say_inverse(settings: &Settings, fold: Option<Fold>, fit: Option<&SurrogateFit>) {
    if let Some(fold) = fold {
        say_fold(&fold);
    }
    tracing::info!(law = settings.law.name(), max_a = settings.limits.current_max_a, "current_command");
    if let Some(fit) = fit {
        tracing::info!(
            method = settings.method.name(),
            current_rms_a = format!("{:.3}", fit.current.get()),
            force_rms_share = format!("{:.3}", fit.force_share()),
            "accuracy of the fitted inverse, on motions between those that it was fitted to"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::estimator;
    use tracing_subscriber::fmt;

    /// A configured service with the thesis' best model.
    fn configured() -> Control {
        let mut config = Config::default();
        config.set("model", &Value::Text("thesis/fuzzy-tanh/rp3-cs".to_owned())).expect("a text");
        let control = Control::new(&config);
        control.change_state(Transition::Configure).expect("a preset");
        control
    }

    /// Log output while `name` is loaded over the thesis' best model.
    fn said_on_load(name: &str) -> String {
        let control = configured();
        let file = tempfile::NamedTempFile::new().expect("a temporary file");
        let lines = Arc::new(file.reopen().expect("it opens"));
        let log = fmt().with_ansi(false).with_writer(lines).finish();
        tracing::subscriber::with_default(log, || control.load_model(name)).expect("a preset runs");
        std::fs::read_to_string(file.path()).expect("text")
    }

    #[test]
    fn names_and_hash_are_those_of_the_model_that_was_loaded_last() {
        let control = configured();
        let (estimator, _sink) = Estimator::start(control.clock(), Vec::new()).expect("a thread");
        control.attach(estimator);
        control.change_state(Transition::Activate).expect("a model");
        for round in 0..50 {
            let control = &control;
            std::thread::scope(|scope| {
                for name in ["thesis/fuzzy-tanh/rp1-cs", "thesis/fuzzy-tanh/rp2-cs"] {
                    scope.spawn(move || control.load_model(name).expect("a preset runs"));
                }
            });
            let running = control.models().expect("it is configured");
            assert_eq!(
                control.models_names().hash,
                models::hash(&running).expect("it writes"),
                "round {round}"
            );
        }
        control.detach().expect("it was attached").stop().expect("no panic");
    }

    #[test]
    fn a_model_is_loaded_only_over_the_model_that_it_was_made_from() {
        let (control, name) = (configured(), "thesis/fuzzy-tanh/rp1-cs");
        let made_from = control.models().expect("it is configured").free;
        control.load_model_over(name, &made_from).expect("it is the running model");
        let error = control.load_model_over(name, &made_from).expect_err("another model runs");
        assert_eq!(error.part(), Some(&ControlError::Replaced { model: name.to_owned() }));
        control.change_state(Transition::Cleanup).expect("it is inactive");
        let error = control.load_model(name).expect_err("it is not configured");
        let unconfigured = ControlError::NotConfigured { state: "unconfigured", model: name.to_owned() };
        assert_eq!(error.part(), Some(&unconfigured));
    }

    /// An active service whose estimating thread hangs.
    fn hung() -> Control {
        let control = configured();
        control.change_state(Transition::Activate).expect("a model");
        control.attach(Estimator::hung());
        control
    }

    #[test]
    fn a_transition_that_the_thread_does_not_execute_is_reported_as_such() {
        let control = configured();
        control.attach(Estimator::hung());
        let error = control.change_state(Transition::Activate).expect_err("nobody executes it");
        assert!(error.to_string().contains("has not carried out the transition after"), "{error}");
        control.detach().expect("it was attached").stop().expect("no panic");
    }

    #[test]
    fn after_a_timeout_names_and_hash_are_those_of_the_model_that_waits_in_the_ring() {
        let control = hung();
        let error = control.load_model("thesis/fuzzy-tanh/rp1-cs").expect_err("nobody executes it");
        assert!(error.to_string().contains("has not swapped the model in"), "{error}");
        let models = control.models().expect("it is configured");
        assert_eq!(control.models_names().hash, models::hash(&models).expect("it writes"));
        control.detach().expect("it was attached").stop().expect("no panic");
    }

    #[test]
    fn parameters_that_switch_the_clock_are_all_set_or_none() {
        let control = hung();
        let coast = |coast_s: f64| ("coast_s", Value::Double(coast_s));
        // The ring then has room for one command, and the request needs two.
        for k in 1..estimator::COMMANDS as u32 {
            control.set_parameters(&[coast(0.01 * f64::from(k))]).expect("there is room");
        }
        let before = control.config();
        let refused = control.set_parameters(&[("use_sim_time", Value::Bool(true)), coast(0.7)]);
        assert_eq!(refused.expect_err("no room").part(), Some(&ControlError::TooManyChanges));
        assert_eq!(control.config(), before);
        assert!(!control.clock().is_simulated());
        control.set_parameters(&[coast(0.7)]).expect("there is room for one");
        control.detach().expect("it was attached").stop().expect("no panic");
    }

    #[test]
    fn loading_a_model_logs_the_forces_it_cannot_be_inverted_for() {
        let folds = "does not grow with the current one way";
        let said = said_on_load("thesis/sp-semi-active/rp-aprbs");
        assert!(said.contains(folds), "{said}");
        let said = said_on_load("thesis/fuzzy-tanh/rp1-cs");
        assert!(said.contains("law=\"follow\"") && !said.contains(folds), "{said}");
        let said = said_on_load("thesis/sp-passive/rp-icps");
        assert!(said.contains("answered with the safe current: no inverse of the sp model"), "{said}");
    }
}
