//! The service: all threads of one damper, started and ended in order.
//!
//! ```text
//! ROS topics ─→ source thread ─→ ring ─→ estimating thread ─→ ring ─→ thread of commands ─→ current_command
//!                                                          ├→ ring ─→ ROS thread ─→ the other topics
//!                                                          ├→ ring ─→ Zenoh thread ─→ keys
//!                                                          ├→ ring ─→ overseer ─→ /diagnostics, log, history
//!                                                          └→ ring ─→ an optional watcher (screen, report)
//! rmw_zenoh topics ─→ queue ─→ source thread
//! Zenoh commands ─→ commands thread ─→ ring ─→ source thread (forces), and control as the services below
//! parameters, ─→ services thread ─→ control ─→ ring of commands ─→ estimating thread
//! load_model, state
//! close_loop ─→ actions thread ─→ diagnosing thread, on a copy of the history ─→ control, if loading is allowed
//! ```

use crate::config::{Config, RosArgs};
use crate::control::Control;
use crate::error::NodeError;
use crate::frame::Frame;
use crate::hot::{self, Hot, HotCounters, Inlet, Wanted};
use crate::lifecycle::{Phase, Transition};
use crate::overseer::{Overseeing, Overseer, SharedHistory};
use crate::panics;
use crate::realtime::{self, Standing};
use crate::ros::{self, Domain, Ros};
use crate::ros_environment::{self, Reach};
use crate::rosout::Rosout;
use crate::services::Services;
use crate::sink::ros::{Inlets, RosSink, RosSinkCounters, SharedNames};
use crate::sink::zenoh::{Damper, Encoding, Link, Mirror, Rmw, RmwPresence, SessionMode, ZenohConfig};
use crate::source;
use crate::source::ros::{RosSource, SourceCounters};
use crate::source::zenoh::rmw::RmwSource;
use crate::source::zenoh::{ByZenoh, Obeying, ZenohSource};
use crate::wire;
use ros2_client::NodeOptions;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Name that [`Service::dead_thread`] returns for threads of the DDS library that ended without a panic.
pub const DDS_THREAD: &str = "RustDDS";

/// A running service.
pub struct Service {
    ros: Ros,
    source: RosSource,
    control: Arc<Control>,
    ros_sink: RosSink,
    overseer: Overseer,
    services: Services,
    commands: Option<ZenohSource>,
    rmw_inputs: Option<RmwSource>,
    zenoh: Option<(Arc<Link>, Mirror)>,
    counters: Counters,
}

/// The parts that the dampers of a process share: the participant in the ROS domain, and the Zenoh session.
pub struct Process {
    domain: Domain,
    /// The requested real-time priority.
    priority: u8,
    /// The resulting scheduling.
    standing: Standing,
    link: Option<Arc<Link>>,
}

impl Process {
    /// Joins the domain and opens the Zenoh session given by `config`. `enclave` is used if DDS-Security is requested.
    ///
    /// # Errors
    /// When ROS or Zenoh do not start.
    pub fn join(config: &Config, enclave: Option<&str>) -> Result<Self, NodeError> {
        panics::watch();
        // The parameter table limits it to 0 to 99.
        let priority = u8::try_from(config.realtime_priority).unwrap_or_default();
        let (domain, standing) = Domain::join_raised(config, enclave, priority)?;
        if let Standing::Refused { why, .. } = &standing {
            tracing::warn!(priority, "no real-time priority: {why}; {}", realtime::ADVICE);
        }
        let link = zenoh_config(config).map(|settings| Link::open(&settings)).transpose()?;
        Ok(Self { domain, priority, standing, link: link.map(Arc::new) })
    }
}

/// Counters of all threads.
#[derive(Clone, Default)]
pub struct Counters {
    /// Of the estimating thread.
    pub hot: Arc<HotCounters>,
    /// Of the ROS source.
    pub source: Arc<SourceCounters>,
    /// Of the ROS sink.
    pub ros_sink: Arc<RosSinkCounters>,
    /// Events lost because the ring between the estimating thread and a sink was full, by sink.
    pub rings: Vec<(&'static str, Arc<AtomicU64>)>,
    /// Scheduling of the counting threads.
    pub standing: Standing,
}

impl Counters {
    /// Everything lost in the node, by name: samples, events, and messages.
    #[must_use]
    pub fn losses(&self) -> Vec<(String, u64)> {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let rings = self.rings.iter().map(|(sink, lost)| (format!("lost_{sink}"), read(lost)));
        let others = [
            ("dropped", &self.hot.overflow),
            ("not_published", &self.ros_sink.failed),
            ("late_commands", &self.ros_sink.late_commands),
        ];
        let others = others.into_iter().map(|(name, count)| (name.to_owned(), read(count)));
        others.chain(rings).collect()
    }

    /// The sum of all losses.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.losses().iter().map(|(_, count)| count).sum()
    }

    /// The losses as `name=count`; `none` without losses.
    #[must_use]
    pub fn losses_in_words(&self) -> String {
        let losses = self.losses().into_iter().filter(|(_, count)| *count > 0);
        let words: Vec<_> = losses.map(|(name, count)| format!("{name}={count}")).collect();
        if words.is_empty() { "none".to_owned() } else { words.join(" ") }
    }
}

impl Service {
    /// Starts the service of the process's only damper; see [`Service::start_in`].
    ///
    /// # Errors
    /// The same as for [`Process::join`] and [`Service::start_in`].
    pub fn start(config: &Config, args: &RosArgs, watch: bool) -> Result<(Self, Option<Inlet>), NodeError> {
        let process = Process::join(config, args.enclave.as_deref())?;
        Self::start_in(&process, config, args, watch)
    }

    /// Starts the service of one damper. With `watch`, also returns an inlet that gets every event, including inputs.
    ///
    /// # Errors
    /// When a model does not load, or the node or the mirror does not start. Threads that were already started end with
    /// the process.
    pub fn start_in(
        process: &Process,
        config: &Config,
        args: &RosArgs,
        watch: bool,
    ) -> Result<(Self, Option<Inlet>), NodeError> {
        let control = Arc::new(Control::new(config));
        if config.autostart {
            // Before everything else, so that a model that does not load is reported at once.
            control.change_state(Transition::Configure)?;
        }
        let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        let mut ros = Ros::start_in(&process.domain, args, options, args.node_name())?;
        ros.override_qos(config.qos.clone());
        let rosout = args.rosout_logs.then(|| Rosout::start(&mut ros, &args.full_name())).transpose()?;

        // Commands come first wherever the order matters.
        let (commands_outlet, commands) = hot::channel(Wanted::Commands);
        let (reports_outlet, reports) = hot::channel(Wanted::Reports);
        let mut rings =
            vec![("commands", Arc::clone(&commands.dropped)), ("reports", Arc::clone(&reports.dropped))];
        let (names, clock) = (control.names(), control.clock());
        let deadline = (config.deadline_s > 0.0).then(|| Duration::from_secs_f64(config.deadline_s));
        let frame = Frame::new(&wire::frame_id(&args.namespace()));
        let (sink_frame, inlets) = (frame.clone(), Inlets { commands, reports });
        let start_sink = || RosSink::start(&mut ros, args, names, clock, deadline, sink_frame, inlets);
        let ros_sink = realtime::raised(process.priority, start_sink).0?;
        let mut outlets = vec![
            commands_outlet.waking(ros_sink.commands_thread()),
            reports_outlet.waking(ros_sink.reports_thread()),
        ];

        let presence = rmw_presence(process, config, args, &frame)?;
        let mut zenoh = None;
        if let Some(link) = &process.link {
            let (outlet, inlet) = hot::channel(Wanted::All);
            rings.push(("mirror", Arc::clone(&inlet.dropped)));
            let mirror = Mirror::start(
                link,
                Damper {
                    name: args.damper().to_owned(),
                    frame: frame.with_default(args.damper()),
                    rmw: presence.clone(),
                },
                control.models_names(),
                inlet.events,
                inlet.dropped,
            )?;
            outlets.push(outlet.waking(mirror.waker()));
            control.attach_mirror(mirror.renamer());
            zenoh = Some((Arc::clone(link), mirror));
        }
        let (outlet, overseen) = hot::channel(Wanted::All);
        rings.push(("history", Arc::clone(&overseen.dropped)));
        outlets.push(outlet);
        let overseeing = Overseeing::offer(&mut ros, args, &control, rosout)?;
        let watched = watch.then(|| {
            let (outlet, inlet) = hot::channel(Wanted::All);
            rings.push(("watch", Arc::clone(&inlet.dropped)));
            outlets.push(outlet);
            inlet
        });

        let (running, samples) = realtime::raised(process.priority, || Hot::start(control.clock(), outlets))
            .0
            .map_err(NodeError::io("starting the estimating thread"))?;
        let hot_counters = running.counters();
        control.attach(running);
        let (asking, forces) = source::zenoh::forces();
        let (arriving, arrived) = source::zenoh::rmw::queue();
        let by_zenoh = ByZenoh { forces, samples: arrived };
        let start_source = || RosSource::start(&mut ros, args, config, &control, by_zenoh, frame, samples);
        let source = realtime::raised(process.priority, start_source).0?;
        let counters = Counters {
            hot: hot_counters,
            source: source.counters(),
            ros_sink: ros_sink.counters(),
            rings,
            standing: process.standing.clone(),
        };
        let overseer = overseeing.start(overseen, counters.clone())?;
        let services = Services::start(&mut ros, args, &control, overseer.history())?;
        if config.autostart {
            services.announce(Transition::Configure, Phase::Unconfigured, Phase::Inactive);
            services.change_state(Transition::Activate)?;
        }
        let commands = match &zenoh {
            Some((link, mirror)) if !config.zenoh.commands.is_empty() => {
                let obeying = Obeying {
                    changes: services.changes(),
                    forces: asking,
                    clock: control.clock(),
                    model_dir: config.zenoh.model_dir.clone().into(),
                    counters: Arc::default(),
                };
                mirror.attach_commands(Arc::clone(&obeying.counters));
                Some(ZenohSource::start(link, args.damper(), &config.zenoh.commands, obeying)?)
            }
            _ => None,
        };
        let rmw_inputs = match (&process.link, &presence) {
            (Some(link), Some(presence)) if rmw(config) == Rmw::Both => {
                Some(RmwSource::start(link, presence, args, config, &source, &arriving)?)
            }
            _ => None,
        };
        let service = Self {
            ros,
            source,
            control,
            ros_sink,
            overseer,
            services,
            commands,
            rmw_inputs,
            zenoh,
            counters,
        };
        Ok((service, watched))
    }

    /// Counters of all threads.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters.clone()
    }

    /// Names of the running models.
    #[must_use]
    pub fn names(&self) -> SharedNames {
        self.control.names()
    }

    /// The mirror, if enabled.
    #[must_use]
    pub fn mirror(&self) -> Option<&Mirror> {
        self.zenoh.as_ref().map(|(_, mirror)| mirror)
    }

    /// The name of a thread that has died, if any. It includes the middlewares' threads, which belong to all services
    /// of the process: their panics would otherwise stay undetected.
    #[must_use]
    pub fn dead_thread(&self) -> Option<&'static str> {
        if let Some(thread) = panics::of_middleware() {
            return Some(thread);
        }
        if !self.ros.domain().is_alive() {
            return Some(DDS_THREAD);
        }
        if !self.control.is_alive() {
            return Some("estimating");
        }
        [
            ("ros-source", self.source.is_alive()),
            ("ros-sink", self.ros_sink.is_alive()),
            ("overseer", self.overseer.is_alive()),
            ("ros-services", self.services.is_alive()),
            ("ros-graph", self.ros.is_alive()),
            ("zenoh-commands", self.commands.as_ref().is_none_or(ZenohSource::is_alive)),
            ("zenoh-inputs", self.rmw_inputs.as_ref().is_none_or(RmwSource::is_alive)),
            ("zenoh-mirror", self.mirror().is_none_or(Mirror::is_alive)),
        ]
        .into_iter()
        .find(|(_, alive)| !alive)
        .map(|(name, _)| name)
    }

    /// The last minutes of raw input.
    #[must_use]
    pub fn history(&self) -> SharedHistory {
        self.overseer.history()
    }

    /// The handle that changes models and parameters of the running service.
    #[must_use]
    pub fn control(&self) -> &Arc<Control> {
        &self.control
    }

    /// Ends the service. Inputs end first, so that all received samples are still estimated and published; then the
    /// sinks; then the node, so that peers are informed at once.
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
        if let Some(commands) = self.commands {
            note("zenoh-commands", commands.stop());
        }
        if let Some(inputs) = self.rmw_inputs {
            note("zenoh-inputs", inputs.stop());
        }
        note("ros-services", self.services.stop());
        note("ros-source", self.source.stop());
        if let Some(hot) = self.control.detach() {
            note("estimating", hot.stop());
        }
        note("ros-sink", self.ros_sink.stop());
        note("overseer", self.overseer.stop());
        if let Some((link, mirror)) = self.zenoh {
            mirror.stop();
            // The last damper of the process closes the session.
            drop(link);
        }
        self.ros.stop();
        if panicked.is_empty() {
            Ok(())
        } else {
            Err(NodeError::Failed(format!("threads had panicked: {}", panicked.join(", "))))
        }
    }
}

/// The exchange with nodes on rmw_zenoh. The parameter table allows only valid names.
fn rmw(config: &Config) -> Rmw {
    Rmw::named(&config.zenoh.rmw).unwrap_or_default()
}

/// The damper's presence for nodes on rmw_zenoh, if enabled.
fn rmw_presence(
    process: &Process,
    config: &Config,
    args: &RosArgs,
    frame: &Frame,
) -> Result<Option<RmwPresence>, NodeError> {
    let link = process.link.as_ref().filter(|_| rmw(config) != Rmw::Off);
    let domain = ros::domain_id(config);
    link.map(|link| Ok(RmwPresence::of(args, domain?, link.next_entity(), frame))).transpose()
}

/// The Zenoh session given by `config`, if any.
pub(crate) fn zenoh_config(config: &Config) -> Option<ZenohConfig> {
    let zenoh = &config.zenoh;
    let rmw = rmw(config);
    // Commands or rmw presence without an endpoint are an error, which the check of the settings reports.
    let asked = !(zenoh.listen.is_empty()
        && zenoh.connect.is_empty()
        && zenoh.config.is_empty()
        && zenoh.commands.is_empty()
        && rmw == Rmw::Off);
    asked.then(|| ZenohConfig {
        file: (!zenoh.config.is_empty()).then(|| zenoh.config.clone().into()),
        listen: zenoh.listen.clone(),
        connect: zenoh.connect.clone(),
        mode: SessionMode::named(&zenoh.mode),
        encoding: match zenoh.encoding.as_str() {
            "json" => Encoding::Json,
            "cdr" => Encoding::Cdr,
            _ => Encoding::Cbor,
        },
        web_rate_hz: zenoh.web_rate_hz,
        history_s: zenoh.history_s,
        allow_non_loopback: zenoh.allow_non_loopback,
        commands: zenoh.commands.clone(),
        rmw,
    })
}

/// The domain and the reach of a service with `config`, as text.
///
/// # Errors
/// When `ROS_DOMAIN_ID` is not a valid domain.
pub fn reach(config: &Config) -> Result<String, NodeError> {
    let asked = ros_environment::asked(config, &ros_environment::of_process)?;
    let mut range = match asked.reach {
        Reach::Loopback => "this machine only".to_owned(),
        Reach::Network => "all networks".to_owned(),
    };
    if !asked.peers.is_empty() {
        range += &format!(" and {}", asked.peers.join(", "));
    }
    Ok(format!("domain {}, {range}", ros::domain_id(config)?))
}
