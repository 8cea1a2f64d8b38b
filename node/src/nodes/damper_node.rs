//! The service: all threads of one damper, started and ended in order.
//!
//! ```text
//! ROS topics ─→ source thread ─→ ring ─→ estimating thread ─→ ring ─→ thread of commands ─→ current_command
//!                                                          ├→ ring ─→ ROS thread ─→ the other topics
//!                                                          ├→ ring ─→ Zenoh thread ─→ keys
//!                                                          ├→ ring ─→ CAN threads ─→ frames: commands, estimates
//!                                                          ├→ ring ─→ overseer ─→ /diagnostics, log, history
//!                                                          └→ ring ─→ an optional watcher (screen, report)
//! rmw_zenoh topics, CAN frames ─→ queues ─→ source thread
//! Zenoh commands ─→ commands thread ─→ ring ─→ source thread (forces), and control as the services below
//! parameters, ─→ services thread ─→ control ─→ ring of commands ─→ estimating thread
//! load_model, state
//! close_loop ─→ actions thread ─→ diagnosing thread, on a copy of the history ─→ control, if loading is allowed
//! ```

use crate::estimation::control::Control;
use crate::estimation::estimator::{self, Estimator, EventFilter, EventReceiver};
use crate::estimation::frame::Frame;
use crate::estimation::lifecycle::{LifecycleState, Transition};
use crate::estimation::wire::{self, SharedNames};
use crate::nodes::can_threads::{CanContext, CanSinks, OpenCan};
use crate::nodes::services::Services;
use crate::process::panics;
use crate::ros2::participant::{self, Domain, Ros};
use crate::ros2::rosout::Rosout;
use crate::settings::config::{Config, RosArgs, rmw, zenoh_config};
use crate::settings::error::{NodeError, PartError};
use crate::streams::can::CanBus;
use crate::streams::sink::ros_sink::{EventReceivers, RosSink, SinkSettings};
use crate::streams::sink::zenoh::{Damper, Mirror, RmwPresence};
use crate::streams::source;
use crate::streams::source::can::CanSource;
use crate::streams::source::queued;
use crate::streams::source::ros_source::{OtherInputs, RosSource};
use crate::streams::source::zenoh::rmw_input::RmwSource;
use crate::streams::source::zenoh::{CommandContext, ZenohSource};
use crate::watchdogs::diagnostics::Counters;
use crate::watchdogs::overseer::{Overseeing, Overseer, SharedHistory};
use crate::zenoh::session::{Link, Rmw};
use mr_damper_base::realtime::{self, Request, Scheduling};
use ros2_client::NodeOptions;
use std::sync::Arc;
use std::time::Duration;

/// Name that [`DamperNode::dead_thread`] returns for threads of the DDS library that ended without a panic.
pub const DDS_THREAD: &str = "RustDDS";

/// A running service.
pub struct DamperNode {
    ros: Ros,
    source: RosSource,
    control: Arc<Control>,
    ros_sink: RosSink,
    overseer: Overseer,
    services: Services,
    commands: Option<ZenohSource>,
    rmw_inputs: Option<RmwSource>,
    can: Option<(CanSource, CanSinks)>,
    zenoh: Option<(Arc<Link>, Mirror)>,
    counters: Counters,
}

/// The parts that the dampers of a process share: the participant in the ROS domain, and the Zenoh session.
pub struct Process {
    domain: Domain,
    /// The requested real-time priority.
    priority: Request,
    /// The resulting scheduling.
    scheduling: Scheduling,
    link: Option<Arc<Link>>,
    /// A bus in the place of the interfaces that `can.interface` names.
    can: Option<Arc<dyn CanBus>>,
}

impl Process {
    /// The same process, whose dampers use `bus` in the place of an interface of the kernel: for tests.
    #[must_use]
    pub fn with_can_bus(self, bus: Arc<dyn CanBus>) -> Self {
        Self { can: Some(bus), ..self }
    }

    /// Joins the domain and opens the Zenoh session given by `config`. `enclave` is used if DDS-Security is requested.
    ///
    /// # Errors
    /// When ROS or Zenoh do not start.
    pub fn join(config: &Config, enclave: Option<&str>) -> Result<Self, NodeError> {
        panics::watch();
        let priority = Request::from_parameter(config.realtime_priority);
        let (domain, scheduling) = Domain::join_raised(config, enclave, priority)?;
        match &scheduling {
            Scheduling::Ordinary | Scheduling::Fifo(_) => {}
            Scheduling::NotPermitted { priority, why } => tracing::info!(
                priority,
                "no real-time priority: {why}; readers on a busy machine can delay estimates; {}",
                realtime::ADVICE
            ),
            Scheduling::Refused { priority, why } => {
                tracing::warn!(priority, "no real-time priority: {why}; {}", realtime::ADVICE);
            }
        }
        let link = zenoh_config(config).map(|settings| Link::open(&settings)).transpose()?;
        Ok(Self { domain, priority, scheduling, link: link.map(Arc::new), can: None })
    }
}

impl DamperNode {
    /// Starts the service of the process's only damper; see [`DamperNode::start_in`].
    ///
    /// # Errors
    /// The same as for [`Process::join`] and [`DamperNode::start_in`].
    pub fn start(
        config: &Config,
        args: &RosArgs,
        watch: bool,
    ) -> Result<(Self, Option<EventReceiver>), NodeError> {
        let process = Process::join(config, args.enclave.as_deref())?;
        Self::start_in(&process, config, args, watch)
    }

    /// Starts the service of one damper. With `watch`, also returns a receiver that gets every event, including inputs.
    ///
    /// # Errors
    /// When a model does not load, or the node or the mirror does not start. Threads that were already started end with
    /// the process.
    pub fn start_in(
        process: &Process,
        config: &Config,
        args: &RosArgs,
        watch: bool,
    ) -> Result<(Self, Option<EventReceiver>), NodeError> {
        let control = Arc::new(Control::new(config));
        if config.autostart {
            // Before everything else, so that a model that does not load is reported at once.
            control.change_state(Transition::Configure)?;
        }
        let can = OpenCan::of(config, process.can.clone())?;
        let can_counters = can.as_ref().map(OpenCan::counters);
        let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        let mut ros = Ros::start_in(&process.domain, args, options, args.node_name())?;
        ros.override_qos(config.qos.clone());
        let rosout = args.rosout_logs.then(|| Rosout::start(&mut ros, &args.full_name())).transpose()?;

        // Commands come first wherever the order matters.
        let (commands_sender, commands) = estimator::channel(EventFilter::Commands);
        let (reports_sender, reports) = estimator::channel(EventFilter::Reports);
        let mut rings =
            vec![("commands", Arc::clone(&commands.dropped)), ("reports", Arc::clone(&reports.dropped))];
        let (names, clock) = (control.names(), control.clock());
        let deadline = (config.deadline_s > 0.0).then(|| Duration::from_secs_f64(config.deadline_s));
        let frame = Frame::new(&wire::frame_id(&args.namespace()));
        let settings = SinkSettings { deadline, frame: frame.clone(), standard: &config.standard };
        let receivers = EventReceivers { commands, reports };
        let start_sink = || RosSink::start(&mut ros, args, names, clock, settings, receivers);
        let ros_sink = realtime::raised(process.priority, start_sink).0?;
        let mut senders = vec![
            commands_sender.waking(ros_sink.commands_thread()),
            reports_sender.waking(ros_sink.reports_thread()),
        ];

        let can_context = CanContext { clock: control.clock(), deadline, priority: process.priority };
        let can = can.map(|can| can.start_sinks(&can_context)).transpose()?;
        let can = can.map(|(input, sinks, can_rings)| {
            for (sender, ring) in can_rings {
                senders.push(sender);
                rings.push(ring);
            }
            (input, sinks)
        });

        let presence = rmw_presence(process, config, args, &frame)?;
        let mut zenoh = None;
        if let Some(link) = &process.link {
            let (sender, receiver) = estimator::channel(EventFilter::All);
            rings.push(("mirror", Arc::clone(&receiver.dropped)));
            let mirror = Mirror::start(
                link,
                Damper {
                    name: args.damper().to_owned(),
                    frame: frame.with_default(args.damper()),
                    rmw: presence.clone(),
                },
                control.models_names(),
                receiver.events,
                receiver.dropped,
            )?;
            senders.push(sender.waking(mirror.waker()));
            let renamer = mirror.renamer();
            control.attach_mirror(move |names| renamer.rename(names));
            zenoh = Some((Arc::clone(link), mirror));
        }
        let (sender, overseen) = estimator::channel(EventFilter::All);
        rings.push(("history", Arc::clone(&overseen.dropped)));
        senders.push(sender);
        let overseeing = Overseeing::offer(&mut ros, args, &control, rosout, frame.clone())?;
        let watched = watch.then(|| {
            let (sender, receiver) = estimator::channel(EventFilter::All);
            rings.push(("watch", Arc::clone(&receiver.dropped)));
            senders.push(sender);
            receiver
        });

        let (running, samples) =
            realtime::raised(process.priority, || Estimator::start(control.clock(), senders))
                .0
                .map_err(NodeError::io("starting the estimating thread"))?;
        let estimator_counters = running.counters();
        control.attach(running);
        let (demanded, forces) = source::zenoh::forces();
        let (rmw_queue, rmw_inputs) = queued::queue();
        let (can_queue, can_inputs) = queued::queue();
        let others = OtherInputs { forces, samples: rmw_inputs, can: can_inputs };
        let start_source = || RosSource::start(&mut ros, args, config, &control, others, frame, samples);
        let source = realtime::raised(process.priority, start_source).0?;
        let counters = Counters {
            estimator: estimator_counters,
            source: source.counters(),
            ros_sink: ros_sink.counters(),
            can: can_counters,
            rings,
            scheduling: process.scheduling.clone(),
        };
        let overseer = overseeing.start(overseen, counters.clone())?;
        let services = Services::start(&mut ros, args, &control, overseer.history())?;
        if config.autostart {
            services.announce(Transition::Configure, LifecycleState::Unconfigured, LifecycleState::Inactive);
            services.change_state(Transition::Activate)?;
        }
        let commands = match &zenoh {
            Some((link, mirror)) if !config.zenoh.commands.is_empty() => {
                let context = CommandContext {
                    changes: services.changes(),
                    forces: demanded,
                    clock: control.clock(),
                    model_dir: config.zenoh.model_dir.clone().into(),
                    counters: Arc::default(),
                };
                mirror.attach_commands(Arc::clone(&context.counters));
                Some(ZenohSource::start(link, args.damper(), &config.zenoh.commands, context)?)
            }
            _ => None,
        };
        let rmw_inputs = match (&process.link, &presence) {
            (Some(link), Some(presence)) if rmw(config) == Rmw::Both => {
                Some(RmwSource::start(link, presence, args, config, &source, &rmw_queue)?)
            }
            _ => None,
        };
        // A log is played from here on, so the node has to be active.
        let can = match can {
            Some((input, sinks)) => Some((input.start(&can_context, can_queue, &source)?, sinks)),
            None => None,
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
            can,
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
            ("can-source", self.can.as_ref().is_none_or(|(source, _)| source.is_alive())),
            ("can-sink", self.can.as_ref().is_none_or(|(_, sinks)| sinks.is_alive())),
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
    /// [`ThreadsPanicked`].
    pub fn stop(self) -> Result<(), ThreadsPanicked> {
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
        let can_sinks = self.can.map(|(source, sinks)| {
            note("can-source", source.stop());
            sinks
        });
        note("ros-services", self.services.stop());
        note("ros-source", self.source.stop());
        if let Some(estimator) = self.control.detach() {
            note("estimating", estimator.stop());
        }
        note("ros-sink", self.ros_sink.stop());
        if let Some(sinks) = can_sinks {
            note("can-sink", sinks.stop());
        }
        note("overseer", self.overseer.stop());
        if let Some((link, mirror)) = self.zenoh {
            mirror.stop();
            // The last damper of the process closes the session.
            drop(link);
        }
        self.ros.stop();
        if panicked.is_empty() { Ok(()) } else { Err(ThreadsPanicked { threads: panicked }) }
    }
}

/// Threads of a service had panicked before it was stopped.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("threads of the node had panicked: {}; the log shows where. Please report this as a bug", threads.join(", "))]
pub struct ThreadsPanicked {
    /// Names of the threads.
    pub threads: Vec<&'static str>,
}

impl PartError for ThreadsPanicked {}

/// The damper's presence for nodes on rmw_zenoh, if enabled.
fn rmw_presence(
    process: &Process,
    config: &Config,
    args: &RosArgs,
    frame: &Frame,
) -> Result<Option<RmwPresence>, NodeError> {
    let link = process.link.as_ref().filter(|_| rmw(config) != Rmw::Off);
    let domain = participant::domain_id(config);
    link.map(|link| Ok(RmwPresence::of(args, domain?, link.next_entity(), frame))).transpose()
}
