//! What may change while the service runs, whoever asks for it: its state, parameters and models.
//!
//! Changes are checked here, under one lock, and handed to the estimating thread through its ring of commands in the
//! order in which they were accepted: what it is told cannot fail.

use crate::clock::Clock;
use crate::config::{Change, Config, Parameter, Value, find};
use crate::error::NodeError;
use crate::hot::{Command, Hot, HotCounters};
use crate::lifecycle::{Phase, Transition};
use crate::models;
use crate::sink::ros::SharedNames;
use crate::sink::zenoh::Renamer;
use crate::wire::ModelNames;
use mr_damper_model::condition::VelocitySource;
use mr_damper_model::inverse::{Commander, Fold, Law, SurrogateFit};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{Models, Plan, Settings};
use mr_damper_model::sample::Stamp;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// How long the estimating thread may take to swap a model in before its silence is reported. It takes microseconds.
const SWAP_TIMEOUT: Duration = Duration::from_secs(2);

/// The running service, for those who change it.
pub struct Control {
    clock: Arc<Clock>,
    /// The model wants measured velocity: its source waits for it.
    wants_velocity: Arc<AtomicBool>,
    state: Mutex<State>,
    hot: Mutex<Option<Hot>>,
    names: SharedNames,
    mirror: OnceLock<Renamer>,
}

struct State {
    config: Config,
    phase: Phase,
    /// There are some in the states inactive and active.
    models: Option<Models>,
}

/// What a change of models did.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Loaded {
    /// The names before.
    pub before: ModelNames,
    /// The names now.
    pub now: ModelNames,
}

impl Control {
    /// Control over a service that has `config` and is not configured yet.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        Self {
            clock: Arc::new(Clock::new(config.use_sim_time)),
            wants_velocity: Arc::default(),
            state: Mutex::new(State { config: config.clone(), phase: Phase::Unconfigured, models: None }),
            hot: Mutex::new(None),
            names: Arc::default(),
            mirror: OnceLock::new(),
        }
    }

    /// The estimating thread runs: tell it what changes.
    pub fn attach(&self, hot: Hot) {
        *lock(&self.hot) = Some(hot);
    }

    /// The Zenoh mirror wants to know of other models.
    pub fn attach_mirror(&self, mirror: Renamer) {
        // There is one mirror a service, attached once.
        let _ = self.mirror.set(mirror);
    }

    /// Gives the estimating thread back, to be stopped; nothing changes any more.
    pub fn detach(&self) -> Option<Hot> {
        lock(&self.hot).take()
    }

    /// True while the estimating thread runs.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        lock(&self.hot).as_ref().is_some_and(Hot::is_alive)
    }

    /// Names of the models that run.
    #[must_use]
    pub fn names(&self) -> SharedNames {
        Arc::clone(&self.names)
    }

    /// Those names at present.
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
    pub fn phase(&self) -> Phase {
        lock(&self.state).phase
    }

    /// The node's clock.
    #[must_use]
    pub fn clock(&self) -> Arc<Clock> {
        Arc::clone(&self.clock)
    }

    /// True while the model wants measured velocity.
    #[must_use]
    pub fn wants_velocity(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.wants_velocity)
    }

    /// Takes a transition, and returns its ends once it is done.
    ///
    /// # Errors
    /// When it does not begin in the present state; when the models that the parameters name do not load, or do not go with the
    /// settings; when the estimating thread does not answer. Then the state stays.
    pub fn change_state(&self, transition: Transition) -> Result<(Phase, Phase), NodeError> {
        let mut state = lock(&self.state);
        let from = state.phase;
        let to = from.after(transition).map_err(NodeError::Failed)?;
        let place = match transition {
            Transition::Configure => {
                let (models, names) = models::from_config(&state.config)?;
                let (settings, plan) = plan(&state.config, &models)?;
                Self::say_commands(&models.free, &settings, plan.commander());
                state.models = Some(models);
                self.runs_on(Some(&models), names);
                None
            }
            Transition::Cleanup => None,
            Transition::Activate => {
                let models = state.models.ok_or_else(|| NodeError::Failed("there is no model".to_owned()))?;
                self.send(Command::Begin(plan(&state.config, &models)?.1))?
            }
            Transition::Deactivate | Transition::Shutdown => self.send(Command::End)?,
        };
        if let Some((place, counters)) = place {
            await_obeyed(place, &counters)?;
        }
        if matches!(to, Phase::Unconfigured | Phase::Finalized) {
            state.models = None;
            self.runs_on(None, ModelNames::default());
        }
        state.phase = to;
        tracing::info!("the node is {}; it was {}", to.name(), from.name());
        Ok((from, to))
    }

    /// The node's models are other ones from now on, or none.
    fn runs_on(&self, models: Option<&Models>, names: ModelNames) {
        let measured = models.is_some_and(|m| m.free.conditioning.velocity == VelocitySource::Measured);
        self.wants_velocity.store(measured, Ordering::Release);
        *self.names.write().unwrap_or_else(PoisonError::into_inner) = names.clone();
        if let Some(mirror) = self.mirror.get() {
            mirror.rename(names);
        }
    }

    /// Forgets all history: the next sample is the first.
    ///
    /// # Errors
    /// When the node is not active, or too many changes wait.
    pub fn reset(&self) -> Result<(), NodeError> {
        let phase = self.phase();
        if phase != Phase::Active {
            return Err(NodeError::Failed(format!(
                "the node is {}: there is nothing to reset",
                phase.name()
            )));
        }
        self.send(Command::Reset).map(|_| tracing::info!("reset"))
    }

    /// `/clock` says that it is `stamp`. When that is before what it said last, history is forgotten: it is of another run.
    pub fn hear_clock(&self, stamp: Stamp) {
        if let Some(back_s) = self.clock.hear(stamp) {
            tracing::warn!(back_s, "simulated time went back: all history is forgotten");
            if let Err(error) = self.reset() {
                tracing::debug!("{error}");
            }
        }
    }

    /// Loads the preset or model file `name` as the free-running model, and returns once estimates come from it. The ARX
    /// model is chosen as at the start; where that finds none, the one that runs goes on.
    ///
    /// # Errors
    /// When the model does not load, wants another drive than the node is fed with, or does not go with the
    /// settings: then nothing changes. When the estimating thread does not answer.
    pub fn load_model(&self, name: &str) -> Result<Loaded, NodeError> {
        self.load(name, None)
    }

    /// The same, unless another free-running model than `made_from` is in force by then.
    ///
    /// # Errors
    /// Those of [`Control::load_model`]; when another model is in force.
    pub fn load_model_over(&self, name: &str, made_from: &Model) -> Result<Loaded, NodeError> {
        self.load(name, Some(made_from))
    }

    fn load(&self, name: &str, made_from: Option<&Model>) -> Result<Loaded, NodeError> {
        let asked = Config { model: name.to_owned(), ..self.config() };
        let (models, mut now) = models::from_config(&asked)?;

        // From here to the command's place in the ring nothing else may change.
        let mut state = lock(&self.state);
        let Some(running) = state.models else {
            return Err(NodeError::Failed(format!(
                "the node is {}: set the parameter model to {name}, and configure it",
                state.phase.name()
            )));
        };
        if made_from.is_some_and(|model| *model != running.free) {
            return Err(NodeError::Failed(format!(
                "another model was loaded meanwhile, and {name} is made from the one before it"
            )));
        }
        let before = read(&self.names);
        let models = models::succeeding(models, &running)?;
        if models.seeded.is_some() && now.seeded.is_none() {
            now.seeded.clone_from(&before.seeded);
        }
        now.hash = models::hash(&models);
        let config = Config { model: asked.model, ..state.config.clone() };
        let (settings, plan) = plan(&config, &models)?;
        let commander = *plan.commander();
        let place = if state.phase == Phase::Active { self.send(Command::Take(plan))? } else { None };
        (state.config, state.models) = (config, Some(models));
        drop(state);

        if let Some((place, counters)) = place {
            await_obeyed(place, &counters)?;
        }
        self.runs_on(Some(&models), now.clone());
        tracing::info!(model = now.free, before = before.free, hash = now.hash, "another model is in force");
        Self::say_commands(&models.free, &settings, &commander);
        Ok(Loaded { before, now })
    }

    /// Says what `commander`, which is that of the model `free`, commands, and what it cannot.
    fn say_commands(free: &Model, settings: &Settings, commander: &Commander) {
        match (settings.law, commander.shape()) {
            (Law::Off, _) => tracing::info!("no current is commanded"),
            (Law::Follow, None) => {
                // A plan does without an inverse only where a search has none: asked again, it says why.
                if let Err(why) = Commander::new(free, settings.limits) {
                    tracing::info!("a force_request would be answered with the safe current: {why}");
                }
            }
            (law, None) => tracing::info!(law = law.name(), "current_command"),
            (_, Some(shape)) => say_inverse(settings, shape.real_fold(), commander.fit()),
        }
    }

    /// Puts a command into the ring, and returns its place in it; `None` before the thread has started.
    fn send(&self, command: Command) -> Result<Option<(u64, Arc<HotCounters>)>, NodeError> {
        let mut hot = lock(&self.hot);
        let Some(hot) = hot.as_mut() else { return Ok(None) };
        match hot.command(command) {
            Some(place) => Ok(Some((place, hot.counters()))),
            None => Err(NodeError::Failed("too many changes at once; try again".to_owned())),
        }
    }

    /// Sets parameters, all or none, and returns the names of those that have another value now.
    ///
    /// # Errors
    /// When one is unknown, out of range or not to be set in this state, or they do not go together; in words.
    pub fn set_parameters(&self, wanted: &[(&str, Value)]) -> Result<Vec<String>, String> {
        let mut state = lock(&self.state);
        let mut config = state.config.clone();
        let mut changed = Vec::new();
        for (name, value) in wanted {
            if config.qos.get(name).is_some() {
                return Err(format!(
                    "{name} is read-only: the QoS of a topic is set at the start of the node"
                ));
            }
            let parameter = find(name).map_err(|e| e.to_string())?;
            let value = parameter.check(value).map_err(|e| e.to_string())?;
            if (parameter.get)(&config) == value {
                continue;
            }
            may_change(parameter, state.phase)?;
            (parameter.set)(&mut config, &value);
            changed.push((*name).to_owned());
        }
        if changed.is_empty() {
            return Ok(changed);
        }
        if let Some(models) = &state.models {
            // The pipeline may refuse what each parameter's own range allows: an ARX with a filter behind it.
            let (settings, plan) = plan(&config, models).map_err(|e| e.to_string())?;
            let commands =
                |name: &String| name == "law" || name.starts_with("inverse.") || name.starts_with("current.");
            if changed.iter().any(commands) {
                Self::say_commands(&models.free, &settings, plan.commander());
            }
            if state.phase == Phase::Active {
                self.send(Command::Take(plan)).map_err(|e| e.to_string())?;
            }
        }
        tracing::info!(parameters = ?wanted, "set");
        let another_time = self.clock.is_simulated() != config.use_sim_time;
        state.config = config;
        if another_time {
            self.clock.simulate(state.config.use_sim_time);
            if state.phase == Phase::Active {
                tracing::info!("the time is another one: all history is forgotten");
                self.send(Command::Reset).map_err(|e| e.to_string())?;
            }
        }
        Ok(changed)
    }
}

/// Whether `parameter` can be set in the state `phase`; if not, why, and what to do.
fn may_change(parameter: &Parameter, phase: Phase) -> Result<(), String> {
    match (parameter.change, phase) {
        (Change::Running, _) | (Change::Unconfigured, Phase::Unconfigured) => Ok(()),
        (Change::Unconfigured, _) => Err(format!(
            "parameter {} cannot change while the node is {}{}",
            parameter.name,
            phase.name(),
            parameter.instead()
        )),
        (Change::Never, _) => Err(format!(
            "parameter {} cannot change while the node runs; restart it with the new value",
            parameter.name
        )),
    }
}

/// What runs by `config` and `models`.
fn plan(config: &Config, models: &Models) -> Result<(Settings, Plan), NodeError> {
    let settings = config.pipeline_settings(models.free.conditioning.cutoff_hz);
    Ok((settings, Plan::new(*models, settings)?))
}

fn await_obeyed(place: u64, counters: &HotCounters) -> Result<(), NodeError> {
    let deadline = Instant::now() + SWAP_TIMEOUT;
    while counters.obeyed.load(Ordering::Acquire) < place {
        if Instant::now() >= deadline {
            return Err(NodeError::Failed(format!(
                "the estimating thread has not swapped the model in after {} s; see the log, and restart the node",
                SWAP_TIMEOUT.as_secs()
            )));
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    Ok(())
}

/// A lock whose holder panicked still guards whole values here: they are replaced, never half changed.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn read(names: &SharedNames) -> ModelNames {
    names.read().unwrap_or_else(PoisonError::into_inner).clone()
}

/// Says where several currents give a force, and which one is taken.
pub(crate) fn say_fold(fold: &Fold) {
    tracing::warn!(
        displacement_m = fold.displacement_m,
        velocity_m_s = fold.velocity_m_s,
        current_a = fold.current_a,
        fall_n = fold.fall_n,
        "the model's force does not grow with the current one way everywhere; of several currents that give a force the one \
         nearest the last is commanded"
    );
}

/// Says how currents for forces are found, and where there are several.
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
            "the inverse stands for the model's own as well as this, on motions between those it was fitted to"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tracing_subscriber::fmt;

    /// What the log says while `name` is loaded over the thesis' best model.
    fn said_on_load(name: &str) -> String {
        let mut config = Config::default();
        config.set("model", &Value::Text("thesis/fuzzy-tanh/rp3-cs".to_owned())).expect("a text");
        let control = Control::new(&config);
        control.change_state(Transition::Configure).expect("a preset");
        let file = tempfile::NamedTempFile::new().expect("a temporary file");
        let lines = Arc::new(file.reopen().expect("it opens"));
        let log = fmt().with_ansi(false).with_writer(lines).finish();
        tracing::subscriber::with_default(log, || control.load_model(name)).expect("a preset runs");
        std::fs::read_to_string(file.path()).expect("text")
    }

    #[test]
    fn what_a_model_cannot_be_asked_for_is_said_when_it_is_loaded() {
        let folds = "does not grow with the current one way";
        let said = said_on_load("thesis/sp-semi-active/rp-aprbs");
        assert!(said.contains(folds), "{said}");
        let said = said_on_load("thesis/fuzzy-tanh/rp1-cs");
        assert!(said.contains("law=\"follow\"") && !said.contains(folds), "{said}");
        let said = said_on_load("thesis/sp-passive/rp-icps");
        assert!(said.contains("answered with the safe current: no inverse of the sp model"), "{said}");
    }
}
