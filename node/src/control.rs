//! What may change while the service runs, whoever asks for it: parameters and models.
//!
//! Changes are checked here, under one lock, and handed to the estimating thread through its ring of commands in the
//! order in which they were accepted: what it is told cannot fail.

use crate::config::{Config, TABLE, Value, find};
use crate::error::NodeError;
use crate::hot::{Command, Hot, HotCounters};
use crate::models;
use crate::sink::ros::SharedNames;
use crate::sink::zenoh::Renamer;
use crate::wire::ModelNames;
use mr_damper_model::inverse::{Commander, Fold, Law, SurrogateFit};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{Models, Plan, Settings};
use ros2_client::{NodeOptions, ParameterValue};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, RwLock};
use std::time::{Duration, Instant};

/// How long the estimating thread may take to swap a model in before its silence is reported. It takes microseconds.
const SWAP_TIMEOUT: Duration = Duration::from_secs(2);

/// The running service, for those who change it.
pub struct Control {
    /// Its damper, for the log.
    damper: String,
    state: Mutex<State>,
    hot: Mutex<Option<Hot>>,
    names: SharedNames,
    mirror: OnceLock<Renamer>,
}

struct State {
    config: Config,
    models: Models,
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
    /// Control over the service of `damper`, which has `config` and is about to run `models`.
    #[must_use]
    pub fn new(config: &Config, damper: &str, models: Models, names: ModelNames) -> Self {
        Self {
            damper: damper.to_owned(),
            state: Mutex::new(State { config: config.clone(), models }),
            hot: Mutex::new(None),
            names: Arc::new(RwLock::new(names)),
            mirror: OnceLock::new(),
        }
    }

    /// The estimating thread runs: tell it what changes. Before that it starts with what has changed by then.
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

    /// The configuration at present.
    #[must_use]
    pub fn config(&self) -> Config {
        lock(&self.state).config.clone()
    }

    /// The models at present.
    #[must_use]
    pub fn models(&self) -> Models {
        lock(&self.state).models
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
        if made_from.is_some_and(|model| *model != state.models.free) {
            return Err(NodeError::Failed(format!(
                "another model was loaded meanwhile, and {name} is made from the one before it"
            )));
        }
        let before = read(&self.names);
        let models = models::succeeding(models, &state.models)?;
        if models.seeded.is_some() && now.seeded.is_none() {
            now.seeded.clone_from(&before.seeded);
        }
        now.hash = models::hash(&models);
        let config = Config { model: asked.model, ..state.config.clone() };
        let settings = config.pipeline_settings(models.free.conditioning.cutoff_hz);
        let plan = Plan::new(models, settings)?;
        let commander = *plan.commander();
        let place = self.send(Command::Take(plan))?;
        *state = State { config, models };
        drop(state);

        if let Some((place, counters)) = place {
            await_obeyed(place, &counters)?;
        }
        *self.names.write().unwrap_or_else(PoisonError::into_inner) = now.clone();
        if let Some(mirror) = self.mirror.get() {
            mirror.rename(now.clone());
        }
        self.say_commands(&models.free, &settings, &commander);
        Ok(Loaded { before, now })
    }

    /// Says what `commander`, which is that of the model `free`, commands, and what it cannot.
    pub(crate) fn say_commands(&self, free: &Model, settings: &Settings, commander: &Commander) {
        let damper = self.damper.as_str();
        match (settings.law, commander.shape()) {
            (Law::Off, _) => tracing::info!(damper, "no current is commanded"),
            (Law::Follow, None) => {
                // A plan does without an inverse only where a search has none: asked again, it says why.
                if let Err(why) = Commander::new(free, settings.limits) {
                    tracing::info!(damper, "a force_request would be answered with the safe current: {why}");
                }
            }
            (law, None) => tracing::info!(damper, law = law.name(), "current_command"),
            (_, Some(shape)) => say_inverse(damper, settings, shape.real_fold(), commander.fit()),
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

    /// Options of a node with the parameters of the table, which checks and applies what peers set.
    pub fn node_options(self: &Arc<Self>) -> NodeOptions {
        let mut options = NodeOptions::new().enable_rosout(true);
        let config = self.config();
        for parameter in TABLE.iter() {
            options = options.declare_parameter(parameter.name, to_ros((parameter.get)(&config)));
        }
        let (checked, applied) = (Arc::clone(self), Arc::clone(self));
        options
            .parameter_validator(Box::new(move |name, value| {
                changed(&lock(&checked.state), name, value).map(drop)
            }))
            .parameter_set_action(Box::new(move |name, value| applied.set_parameter(name, value)))
    }

    fn set_parameter(&self, name: &str, value: &ParameterValue) -> Result<(), String> {
        let mut state = lock(&self.state);
        let Some((config, plan)) = changed(&state, name, value)? else { return Ok(()) };
        self.send(Command::Take(plan)).map_err(|e| format!("{name}: {e}"))?;
        tracing::info!(parameter = name, ?value, "set");
        state.config = config;
        Ok(())
    }
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

/// Says how currents for forces are found, and where there are several.
fn say_inverse(damper: &str, settings: &Settings, fold: Option<Fold>, fit: Option<&SurrogateFit>) {
    if let Some(fold) = fold {
        tracing::warn!(
            damper,
            displacement_m = fold.displacement_m,
            velocity_m_s = fold.velocity_m_s,
            current_a = fold.current_a,
            fall_n = fold.fall_n,
            "the model's force does not grow with the current one way everywhere; of several currents that give a force the one \
             nearest the last is commanded"
        );
    }
    tracing::info!(
        damper,
        law = settings.law.name(),
        max_a = settings.limits.current_max_a,
        "current_command"
    );
    if let Some(fit) = fit {
        tracing::info!(
            damper,
            method = settings.method.name(),
            current_rms_a = format!("{:.3}", fit.current.get()),
            force_rms_share = format!("{:.3}", fit.force_share()),
            "the inverse stands for the model's own as well as this, on motions between those it was fitted to"
        );
    }
}

/// The configuration after `name` is set to `value`, and what runs by it; `None` when that changes nothing.
fn changed(state: &State, name: &str, value: &ParameterValue) -> Result<Option<(Config, Plan)>, String> {
    let value = from_ros(value).ok_or_else(|| format!("{name}: no parameter takes this type"))?;
    let parameter = find(name).map_err(|e| e.to_string())?;
    let value = parameter.check(&value).map_err(|e| e.to_string())?;
    if (parameter.get)(&state.config) == value {
        return Ok(None);
    }
    if !parameter.runtime {
        return Err(format!(
            "parameter {name} cannot change while the node runs; restart it with the new value"
        ));
    }
    let mut config = state.config.clone();
    config.set(name, &value).map_err(|e| e.to_string())?;
    // The pipeline may refuse what each parameter's own range allows: an ARX with a filter behind it.
    let settings = config.pipeline_settings(state.models.free.conditioning.cutoff_hz);
    let plan = Plan::new(state.models, settings).map_err(|e| e.to_string())?;
    Ok(Some((config, plan)))
}

fn to_ros(value: Value) -> ParameterValue {
    match value {
        Value::Bool(b) => ParameterValue::Boolean(b),
        Value::Integer(n) => ParameterValue::Integer(n),
        Value::Double(x) => ParameterValue::Double(x),
        Value::Text(t) => ParameterValue::String(t),
        Value::TextList(t) => ParameterValue::StringArray(t),
    }
}

fn from_ros(value: &ParameterValue) -> Option<Value> {
    Some(match value {
        ParameterValue::Boolean(b) => Value::Bool(*b),
        ParameterValue::Integer(n) => Value::Integer(*n),
        ParameterValue::Double(x) => Value::Double(*x),
        ParameterValue::String(t) => Value::Text(t.clone()),
        ParameterValue::StringArray(t) => Value::TextList(t.clone()),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use tracing_subscriber::fmt;

    /// What the log says while `name` is loaded over the thesis' best model.
    fn said_on_load(name: &str) -> String {
        let mut config = Config::default();
        config.set("model", &Value::Text("thesis/fuzzy-tanh/rp3-cs".to_owned())).expect("a text");
        let (models, names) = models::from_config(&config).expect("a preset");
        let control = Control::new(&config, "rear_left", models, names);
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
        assert!(said.contains(folds) && said.contains("damper=\"rear_left\""), "{said}");
        let said = said_on_load("thesis/fuzzy-tanh/rp1-cs");
        assert!(said.contains("law=\"follow\"") && !said.contains(folds), "{said}");
        let said = said_on_load("thesis/sp-passive/rp-icps");
        assert!(said.contains("answered with the safe current: no inverse of the sp model"), "{said}");
    }
}
