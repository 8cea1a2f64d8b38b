//! The service: everything that runs for one damper, started in order and ended in order.
//!
//! ```text
//! ROS topics ─→ source thread ─→ ring ─→ estimating thread ─→ ring ─→ ROS thread ─→ topics
//!                                                          ├→ ring ─→ Zenoh thread ─→ keys
//!                                                          └→ ring ─→ whoever asked for one (screen, report)
//! ```

use crate::config::{Config, RosArgs, Value, find};
use crate::error::NodeError;
use crate::hot::{self, Command, Hot, HotCounters, Inlet};
use crate::models;
use crate::ros::{self, Ros};
use crate::sink::ros::{RosSink, RosSinkCounters, SharedNames};
use crate::sink::zenoh::{Damper, Encoding, Link, Mirror, SessionMode, ZenohConfig};
use crate::source::ros::{RosSource, SourceCounters};
use mr_damper_model::pipeline::{Models, Pipeline};
use ros2_client::{NodeOptions, ParameterValue};
use std::sync::{Arc, Mutex, RwLock};

/// A running service.
pub struct Service {
    ros: Ros,
    source: RosSource,
    hot: Arc<Mutex<Option<Hot>>>,
    ros_sink: RosSink,
    zenoh: Option<(Link, Mirror)>,
    counters: Counters,
    names: SharedNames,
}

/// Counters of all threads.
#[derive(Clone)]
pub struct Counters {
    /// Of the estimating thread.
    pub hot: Arc<HotCounters>,
    /// Of the ROS source.
    pub source: Arc<SourceCounters>,
    /// Of the ROS sink.
    pub ros_sink: Arc<RosSinkCounters>,
}

/// What the parameter services may change, shared with their callback.
struct Live {
    config: Config,
    models: Models,
}

impl Service {
    /// Starts the service. `watch`: also return an inlet that gets every event, inputs included.
    ///
    /// # Errors
    /// When a model does not load, or ROS or Zenoh do not start. What had started by then is stopped.
    pub fn start(config: &Config, args: &RosArgs, watch: bool) -> Result<(Self, Option<Inlet>), NodeError> {
        let (models, names) = models::from_config(config)?;
        let velocity = models.free.conditioning.velocity;
        let settings = config.pipeline_settings(models.free.conditioning.cutoff_hz);
        let pipeline = Pipeline::new(models, settings)?;
        let hot: Arc<Mutex<Option<Hot>>> = Arc::new(Mutex::new(None));
        let live = Arc::new(Mutex::new(Live { config: config.clone(), models }));
        let options = parameters(config, &live, &hot);
        let mut ros = Ros::start(config, args, options, args.node_name())?;

        let shared_names: SharedNames = Arc::new(RwLock::new(names.clone()));
        let (ros_outlet, ros_inlet) = hot::channel(false);
        let ros_sink = RosSink::start(&mut ros, args, Arc::clone(&shared_names), ros_inlet)?;
        let mut outlets = vec![ros_outlet.waking(ros_sink.thread())];

        let mut zenoh = None;
        if let Some(settings) = zenoh_config(config) {
            let (outlet, inlet) = hot::channel(true);
            let damper = match args.namespace().trim_matches('/') {
                "" => args.node_name().to_owned(),
                namespace => namespace.to_owned(),
            };
            let link = Link::open(&settings)?;
            let mirror = Mirror::start(&link, Damper::named(&damper), names, inlet.events, inlet.dropped)?;
            outlets.push(outlet.waking(mirror.waker()));
            zenoh = Some((link, mirror));
        }
        let watched = watch.then(|| {
            let (outlet, inlet) = hot::channel(true);
            outlets.push(outlet);
            inlet
        });

        let (running, samples) =
            Hot::start(pipeline, outlets).map_err(NodeError::io("starting the estimating thread"))?;
        let hot_counters = running.counters();
        *lock(&hot) = Some(running);
        let source = RosSource::start(&mut ros, args, config, velocity, samples)?;
        let counters =
            Counters { hot: hot_counters, source: source.counters(), ros_sink: ros_sink.counters() };
        let service = Self { ros, source, hot, ros_sink, zenoh, counters, names: shared_names };
        Ok((service, watched))
    }

    /// Counters of all threads.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters.clone()
    }

    /// Names of the models that run.
    #[must_use]
    pub fn names(&self) -> SharedNames {
        Arc::clone(&self.names)
    }

    /// The mirror, when there is one.
    #[must_use]
    pub fn mirror(&self) -> Option<&Mirror> {
        self.zenoh.as_ref().map(|(_, mirror)| mirror)
    }

    /// The name of a thread that has died, if one has. A panic in a middleware's thread must not go unseen.
    #[must_use]
    pub fn dead_thread(&self) -> Option<&'static str> {
        if !lock(&self.hot).as_ref().is_some_and(Hot::is_alive) {
            return Some("estimating");
        }
        [
            ("ros-source", self.source.is_alive()),
            ("ros-sink", self.ros_sink.is_alive()),
            ("ros-spinner", self.ros.is_alive()),
            ("zenoh-mirror", self.mirror().is_none_or(Mirror::is_alive)),
        ]
        .into_iter()
        .find(|(_, alive)| !alive)
        .map(|(name, _)| name)
    }

    /// Ends the service: inputs first, so that everything taken is still estimated and published; then the
    /// sinks; then the node, so that peers see it go at once.
    ///
    /// # Errors
    /// [`NodeError::Failed`] naming the threads that had panicked.
    pub fn stop(self) -> Result<(), NodeError> {
        let mut panicked = Vec::new();
        let mut note = |name: &'static str, ended: std::thread::Result<()>| {
            if ended.is_err() {
                panicked.push(name);
            }
        };
        note("ros-source", self.source.stop());
        let hot = lock(&self.hot).take();
        if let Some(hot) = hot {
            note("estimating", hot.stop());
        }
        note("ros-sink", self.ros_sink.stop());
        if let Some((link, mirror)) = self.zenoh {
            mirror.stop();
            link.close();
        }
        self.ros.stop();
        if panicked.is_empty() {
            Ok(())
        } else {
            Err(NodeError::Failed(format!("threads had panicked: {}", panicked.join(", "))))
        }
    }
}

/// A lock whose holder panicked still guards whole values here: they are replaced, never half changed.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn zenoh_config(config: &Config) -> Option<ZenohConfig> {
    let zenoh = &config.zenoh;
    (!zenoh.listen.is_empty() || !zenoh.connect.is_empty()).then(|| ZenohConfig {
        listen: zenoh.listen.clone(),
        connect: zenoh.connect.clone(),
        mode: if zenoh.mode == "client" { SessionMode::Client } else { SessionMode::Peer },
        encoding: match zenoh.encoding.as_str() {
            "json" => Encoding::Json,
            "cdr" => Encoding::Cdr,
            _ => Encoding::Cbor,
        },
        web_rate_hz: zenoh.web_rate_hz,
        history_s: zenoh.history_s,
        allow_non_loopback: zenoh.allow_non_loopback,
    })
}

/// Declares the parameters of the table, and checks and applies what peers set.
fn parameters(config: &Config, live: &Arc<Mutex<Live>>, hot: &Arc<Mutex<Option<Hot>>>) -> NodeOptions {
    let mut options = NodeOptions::new().enable_rosout(true);
    for parameter in crate::config::TABLE.iter() {
        options = options.declare_parameter(parameter.name, to_ros((parameter.get)(config)));
    }
    let (checked, applied) = (Arc::clone(live), Arc::clone(live));
    let hot = Arc::clone(hot);
    options
        .parameter_validator(Box::new(move |name, value| {
            let live = lock(&checked);
            changed(&live, name, value).map(drop)
        }))
        .parameter_set_action(Box::new(move |name, value| {
            let mut live = lock(&applied);
            let Some(config) = changed(&live, name, value)? else { return Ok(()) };
            let settings = config.pipeline_settings(live.models.free.conditioning.cutoff_hz);
            // Before the estimating thread starts there is nobody to tell: it starts with these settings.
            if let Some(hot) = lock(&hot).as_mut()
                && !hot.command(Command::Configure(settings))
            {
                return Err(format!("{name}: too many changes at once; try again"));
            }
            tracing::info!(parameter = name, ?value, "set");
            live.config = config;
            Ok(())
        }))
}

/// The configuration after `name` is set to `value`; `None` when that changes nothing.
fn changed(live: &Live, name: &str, value: &ParameterValue) -> Result<Option<Config>, String> {
    let value = from_ros(value).ok_or_else(|| format!("{name}: no parameter takes this type"))?;
    let parameter = find(name).map_err(|e| e.to_string())?;
    let value = parameter.check(&value).map_err(|e| e.to_string())?;
    if (parameter.get)(&live.config) == value {
        return Ok(None);
    }
    if !parameter.runtime {
        return Err(format!(
            "parameter {name} cannot change while the node runs; restart it with the new value"
        ));
    }
    let mut config = live.config.clone();
    config.set(name, &value).map_err(|e| e.to_string())?;
    // The pipeline may refuse what each parameter's own range allows: an ARX with a filter behind it.
    let settings = config.pipeline_settings(live.models.free.conditioning.cutoff_hz);
    Pipeline::new(live.models, settings).map_err(|e| e.to_string())?;
    Ok(Some(config))
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

/// The domain and the reach of a service with `config`, for people.
///
/// # Errors
/// When `ROS_DOMAIN_ID` is no domain.
pub fn reach(config: &Config) -> Result<String, NodeError> {
    let range = if ros::is_loopback_only(config) { "this machine only" } else { "all networks" };
    Ok(format!("domain {}, {range}", ros::domain_id(config)?))
}
